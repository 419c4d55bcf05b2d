# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, spin, a clean end on Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.ros.node import (
    OccNode,
    one_line,
    refusal_of,
    report_error,
    without_source_lines,
)
from occ_constraints_pkg.ros.parameters import describing, set_command_line
from occ_constraints_pkg.ros.rclpy_internals import RCLError
from occ_constraints_pkg.stopping import parent_is_gone, stop_request

try:
    from rclpy.experimental import EventsExecutor
except ImportError as error:
    raise ConfigurationError(
        'the installed rclpy has no events executor; allowed is rclpy from 7.1.4: sudo apt install '
        "--only-upgrade ros-jazzy-rclpy, or pip install -U 'occ_constraints_pkg[ros]'"
    ) from error

# How often a quiet process checks whether it was asked to end. The executor needs a finite limit
# in any case: with some C++ libraries an unlimited wait overflows and spins at full load.
_WAKE_SECONDS = 0.2


def run_node(make_node: Callable[[], OccNode], argv: Sequence[str] | None = None) -> int:
    """Run one node until it finishes or the process is asked to end.

    Args:
        make_node: builds the node once ROS is initialised.
        argv: command-line arguments, ``--ros-args`` included.

    Returns:
        0 after a clean end, Ctrl-C and SIGTERM included; the node's own code if it finished
        with one; 2 after a mistake in its input, reported in one sentence on stderr. With
        ``--help`` among the arguments, the node's parameters are printed instead.
    """
    if '--help' in (argv or ()):
        _print_parameters(make_node)
        return 0
    node: OccNode | None = None
    code = 1
    with stop_request.listening():
        try:
            _initialise(list(argv or []))
            node = make_node()
            node.check_qos()
            node.begin()
            code = _spin(node)
        except (KeyboardInterrupt, ExternalShutdownException):
            code = 0
        except (OccError, OSError) as error:
            code = report_error(error)
        except NameValidationException as error:
            code = report_error(ConfigurationError(f'cannot start: {one_line(error)}'))
        except RCLError as error:
            code = report_error(refusal_of(error))
        finally:
            if node is not None:
                code = _close(node) or code
            rclpy.try_shutdown()
        return code


def _print_parameters(make_node: Callable[[], OccNode]) -> None:
    # The node is made as far as it declares its parameters, and where no other one sees it.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    try:
        with describing() as described:
            _initialise([])
            make_node()
    finally:
        rclpy.try_shutdown()
    names, defaults = (max(len(item[column]) for item in described) for column in (0, 1))
    for name, default, description, bounds in described:
        note = f' ({bounds})' if bounds else ''
        print(f'  {name:{names}}  {default:{defaults}}  {description}{note}')


def _initialise(argv: list[str]) -> None:
    set_command_line(argv)
    allowed = 'allowed are ROS arguments such as -p NAME:=VALUE, -r FROM:=TO, --params-file FILE'
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        other = remove_ros_args(argv)
    # rclpy has no public type for a malformed command line.
    except Exception as error:
        reason = without_source_lines(error)
        raise ConfigurationError(
            f'the arguments are not understood: {reason}; {allowed}'
        ) from error
    if other:
        raise ConfigurationError(f'unknown argument {other[0]!r}; {allowed}, after --ros-args')


def _spin(node: OccNode) -> int:
    executor = SingleThreadedExecutor() if node.takes_turns else EventsExecutor()
    executor.add_node(node)
    try:
        while not (stop_request.made or node.done.done() or parent_is_gone()):
            # One callback at a time: longer spins do not end while messages come faster than they
            # are handled, whatever their timeout.
            executor.spin_once(_WAKE_SECONDS)
        if node.drain_on_shutdown:
            # Those that have come by now, and no others, for more may come for ever.
            rest = executor.create_task(lambda: None)
            while not (rest.done() or node.done.done()):
                executor.spin_once(_WAKE_SECONDS)
    finally:
        executor.shutdown()
    return node.done.result() if node.done.done() else 0


def _close(node: OccNode) -> int:
    try:
        node.close()
    except (OccError, OSError) as error:
        return report_error(error)
    except RCLError as error:
        # What ended the node has mostly been reported by now, and this is a consequence of it.
        return 2 if node.done.done() else report_error(refusal_of(error))
    finally:
        node.destroy_node()
    return 0
