# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, spin, a clean end on Ctrl-C or SIGTERM."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer

from occ_constraints_pkg.errors import OccError

# How often a quiet process looks whether it was asked to end. The executor needs a finite limit
# in any case: with some C++ libraries an unlimited wait overflows and spins at full load.
_LOOK_SECONDS = 0.2

_Value = TypeVar('_Value', bool, int, float, str, list)


class OccNode(Node):
    """A node that can end its own process and checks its parameters.

    Attributes:
        done: set when the process should end; its result is the exit code.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.done: Future = Future()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    def finish(self, exit_code: int = 0) -> None:
        """End the process after the present callback."""
        if not self.done.done():
            self.done.set_result(exit_code)

    def close(self) -> None:
        """Release files and threads; called once before the node is destroyed."""

    def steady_timer(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Create a timer on the steady clock, which runs on when the ROS clock stands still."""
        return self.create_timer(seconds, callback, clock=self._steady)

    def steady_seconds(self) -> float:
        """Return the steady clock's reading in seconds."""
        return self._steady.now().nanoseconds * 1e-9

    def parameter(
        self,
        name: str,
        default: _Value,
        description: str,
        *,
        low: float | None = None,
        high: float | None = None,
    ) -> _Value:
        """Declare a read-only parameter and return its value.

        Args:
            name: the parameter's name.
            default: value where none is given; its type is the parameter's type. A list is one
                of strings.
            description: one sentence for ``ros2 param describe``.
            low: smallest allowed number.
            high: largest allowed number.

        Raises:
            OccError: a value was given that has another type or is out of range.
        """
        descriptor = ParameterDescriptor(description=description, read_only=True)
        if low is not None or high is not None:
            if isinstance(default, int):
                bounds = IntegerRange(
                    from_value=-(2**62) if low is None else int(low),
                    to_value=2**62 if high is None else int(high),
                )
                descriptor.integer_range = [bounds]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(
                        from_value=-1e300 if low is None else float(low),
                        to_value=1e300 if high is None else float(high),
                    )
                ]
        # rclpy takes an empty list for one of bytes, so a list of strings is declared by one.
        given = [''] if default == [] else default
        try:
            value = self.declare_parameter(name, given, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            got = self._given(name)
            raise OccError(
                f'parameter {name!r} of node {self.get_name()!r}: got {got!r}; allowed is '
                f'{_allowed(default, low, high)} ({description})'
            ) from error
        return [item for item in value if item] if isinstance(default, list) else value

    def _given(self, name: str) -> Any:
        override = self._parameter_overrides.get(name)
        return None if override is None else override.value


def run_node(make_node: Callable[[], OccNode], argv: Sequence[str] | None = None) -> int:
    """Run one node until it finishes or the process is asked to end.

    Signals only set a mark: the callback in progress runs to its end, so that files are left
    whole and nothing is published to a context that is already gone.

    Args:
        make_node: builds the node once ROS is initialised.
        argv: command-line arguments, ``--ros-args`` included.

    Returns:
        0 after a clean end, Ctrl-C and SIGTERM included; the node's own code if it finished
        with one; 2 after a mistake in its input, told in one sentence on stderr.
    """
    asked_to_end = False

    def ask(_number: int, _frame: object) -> None:
        nonlocal asked_to_end
        asked_to_end = True

    handlers = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    node: OccNode | None = None
    try:
        try:
            rclpy.init(args=list(argv or []), signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:
            # rclpy has no public type for a malformed command line.
            raise OccError(f'cannot start: {" ".join(str(error).split())}') from error
        node = make_node()
        executor = EventsExecutor()
        executor.add_node(node)
        while not asked_to_end and not node.done.done():
            executor.spin_until_future_complete(node.done, _LOOK_SECONDS)
        return node.done.result() if node.done.done() else 0
    except ExternalShutdownException:
        return 0
    except OccError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _allowed(default: Any, low: float | None, high: float | None) -> str:
    kind = {bool: 'true or false', int: 'a whole number', float: 'a number with a decimal point'}
    text = kind.get(type(default), 'text' if isinstance(default, str) else 'a list of texts')
    if low is not None:
        text += f' from {low:g}'
    if high is not None:
        text += f' up to {high:g}'
    return text
