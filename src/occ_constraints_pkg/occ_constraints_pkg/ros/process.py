# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, spin, a clean end on Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    NameValidationException,
)
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from occ_constraints_pkg.documents import read_text
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.ros.environment import check_clock
from occ_constraints_pkg.ros.log import OneLineLogger
from occ_constraints_pkg.ros.overrides import (
    OF_SUBSCRIPTION,
    QOS_PREFIX,
    ROS_SWITCHES,
    check_qos_overrides,
    check_unknown,
    params_files,
)
from occ_constraints_pkg.stopping import parent_is_gone, stop_request
from occ_constraints_pkg.terminal import printable

try:
    from rclpy.experimental import EventsExecutor
except ImportError as error:
    raise ConfigurationError(
        'the installed rclpy has no events executor; allowed is rclpy from 7.1.4: sudo apt install '
        "--only-upgrade ros-jazzy-rclpy, or pip install -U 'occ_constraints_pkg[ros]'"
    ) from error

# How often a quiet process looks whether it was asked to end. The executor needs a finite limit
# in any case: with some C++ libraries an unlimited wait overflows and spins at full load.
_LOOK_SECONDS = 0.2
# How often a node looks whether another one has its name.
_NAMESAKE_SECONDS = 2.0
# How long the last messages may take to reach subscribers that are there.
_LEAVE_SECONDS = 1.0
# Periods that would mean never, for a clock in ns ends after 292 years: this is 30.
_LONGEST_SECONDS = 1e9
# What rclpy raises when the layers below refuse something; it has no public name.
_RCLError = rclpy_implementation.RCLError

# So large a number of seconds is still finite in ns.
_LARGEST = 1e290

# What the present node was started with; rclpy keeps it where it cannot be read.
_arguments: list[str] = []
# What a node that is only described has declared so far; None for one that is to run.
_described: list[tuple[str, str, str, str]] | None = None

_Value = TypeVar('_Value', bool, int, float, str, list)


class _DescribedError(Exception):
    """All parameters of a node that is only described are declared."""


class OccNode(Node):
    """A node that can end its own process and checks its parameters.

    An :class:`OccError` or an error of the operating system in a callback ends the process with
    that one sentence and exit code 2.

    Attributes:
        done: set when the process should end; its result is the exit code.
        takes_the_rest: whether messages that have come when the process is asked to end are still
            handed to their callbacks.
        subscribes_later: whether it subscribes to topics that it learns of while it runs.

    Raises:
        OccError: a parameter of ROS's own, such as ``use_sim_time``, has a wrong value.
    """

    takes_the_rest = False
    subscribes_later = False

    def __init__(self, name: str, **kwargs: Any) -> None:
        self.done: Future = Future()
        try:
            super().__init__(name, **kwargs)
        except InvalidParameterTypeException as error:
            wrong = next(
                item
                for item in self._parameter_overrides.values()
                if item.name in ROS_SWITCHES and item.type_ != Parameter.Type.BOOL
            )
            raise ConfigurationError(
                f'parameter {wrong.name!r} of node {name!r}: got {wrong.value!r}; allowed is true '
                'or false'
            ) from error
        self._logger = OneLineLogger(self._logger.name)
        check_qos_overrides(self._parameter_overrides.values())
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._has_namesake = False
        self.steady_timer(_NAMESAKE_SECONDS, self._look_for_namesakes)

    def make_executor(self) -> Executor:
        """Return what is to spin this node."""
        return EventsExecutor()

    def finish(self, exit_code: int = 0) -> None:
        """End the process after the present callback."""
        if not self.done.done():
            self.done.set_result(exit_code)

    def begin(self) -> None:
        """Begin to work; called once, before the node spins."""

    def close(self) -> None:
        """Release files and threads; called once before the node is destroyed."""

    def create_subscription(self, msg_type: Any, topic: str, callback: Any, *args: Any, **kw: Any):
        """Subscribe as :meth:`rclpy.node.Node.create_subscription` does, but guarded.

        A callback with two arguments also gets what the middleware knows of the message.

        Raises:
            OccError: ``topic`` is no valid name.
        """
        self.full_name(topic)
        return super().create_subscription(msg_type, topic, self._guarded(callback), *args, **kw)

    def create_timer(self, timer_period_sec: float, callback: Any, *args: Any, **kw: Any) -> Timer:
        """Create a timer as :meth:`rclpy.node.Node.create_timer` does, but guarded.

        It takes periods of any length.
        """
        period = min(timer_period_sec, _LONGEST_SECONDS)
        return super().create_timer(period, self._guarded(callback), *args, **kw)

    def steady_timer(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Create a timer on the steady clock, which runs on when the ROS clock stands still."""
        return self.create_timer(seconds, callback, clock=self._steady)

    def steady_seconds(self) -> float:
        """Return the steady clock's reading in seconds."""
        # The same clock, read without making messages of the time.
        return time.monotonic()

    def ros_ns(self) -> int:
        """Return the ROS clock's reading in ns; 0 with ``use_sim_time`` and before ``/clock``."""
        clock = self.get_clock()
        # Without simulated time it is the time of the system, read without making messages of it.
        return clock.now().nanoseconds if clock.ros_time_is_active else time.time_ns()

    def full_name(self, topic: str) -> str:
        """Return a topic's name with namespace and remapping.

        Raises:
            OccError: it is no valid name.
        """
        try:
            validate_topic_name(topic)
            # Raises what is a RuntimeError where the name grows too long by the namespace.
            full_name = self.resolve_topic_name(topic)
            validate_full_topic_name(full_name)
        except (NameValidationException, RuntimeError) as error:
            raise ConfigurationError(
                f'{topic!r} cannot name a topic; allowed are letters, digits and _, joined by /, '
                'and no digit first, up to 247 characters with the namespace'
            ) from error
        return full_name

    def let_leave(self, *publishers: Publisher, seconds: float = _LEAVE_SECONDS) -> None:
        """Wait, not for long, until reliable subscribers have what was published last."""
        end = self.steady_seconds() + seconds
        for publisher in publishers:
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - self.steady_seconds())))

    def parameter(
        self,
        name: str,
        default: _Value,
        description: str,
        *,
        low: float | None = None,
        high: float | None = None,
        read_only: bool = True,
    ) -> _Value:
        """Declare a parameter and return its value.

        A whole number will do for one with a decimal point, and one text for a list of texts.

        Args:
            name: the parameter's name.
            default: value where none is given; its type is the parameter's type. A list is one
                of strings.
            description: one sentence for ``ros2 param describe``.
            low: smallest allowed number.
            high: largest allowed number.
            read_only: whether it keeps the value that it has at the start.

        Raises:
            OccError: a value was given that has another type or is out of range.
        """
        if _described is not None:
            _described.append((name, _shown(default), description, _range(low, high).strip()))
            return default
        descriptor = ParameterDescriptor(description=description, read_only=read_only)
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
                        from_value=-_LARGEST if low is None else float(low),
                        to_value=_LARGEST if high is None else float(high),
                    )
                ]
        self._adapt_override(name, default)
        # rclpy takes an empty list for one of bytes, so a list of strings is declared by one.
        given = [''] if default == [] else default
        try:
            value = self.declare_parameter(name, given, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            got = self._parameter_overrides[name].value
            raise ConfigurationError(
                f'parameter {name!r} of node {self.get_name()!r}: got {got!r}; allowed is '
                f'{_allowed(default, low, high)} ({description})'
            ) from error
        return [item for item in value if item] if isinstance(default, list) else value

    def declared(self) -> None:
        """Call it when all parameters are declared, before anything that has effects.

        Raises:
            OccError: a parameter was given to this node by name, or on its command line, that it
                does not have; rclpy would ignore it.
        """
        if _described is not None:
            raise _DescribedError
        self._check_given(qos=False)

    def check_qos(self) -> None:
        """Refuse overrides of quality of service for topics that the node does not have.

        Call it when the node is made.

        Raises:
            OccError: there is one.
        """
        self._check_given(qos=True)

    def _check_given(self, *, qos: bool) -> None:
        ignored = [
            name
            for name in self._parameter_overrides
            if name.startswith(QOS_PREFIX) == qos and not self.has_parameter(name)
        ]
        if self.subscribes_later:
            ignored = [name for name in ignored if not OF_SUBSCRIPTION.fullmatch(name)]
        check_unknown(
            ignored,
            list(self._parameters),
            _arguments,
            self.get_fully_qualified_name(),
            self.get_logger().warning,
        )

    def fail(self, error: OccError | OSError) -> None:
        """End the process with exit code 2 and one sentence."""
        tell(error)
        self.finish(2)

    def _look_for_namesakes(self) -> None:
        """Warn of another node with the same full name: each would answer for the other."""
        full = self.get_fully_qualified_name()
        nodes = self.get_node_names_and_namespaces()
        count = sum(f'{space.rstrip("/")}/{name}' == full for name, space in nodes)
        if count > 1 and not self._has_namesake:
            self.get_logger().warning(
                f'{count} nodes are called {full}; allowed is one, so end the others, or rename '
                'this one with -r __node:=NAME (one that was killed is listed for some 20 s yet)'
            )
        self._has_namesake = count > 1

    def _adapt_override(self, name: str, default: Any) -> None:
        override = self._parameter_overrides.get(name)
        if override is None:
            return
        if isinstance(default, float) and override.type_ == Parameter.Type.INTEGER:
            self._parameter_overrides[name] = Parameter(name, value=float(override.value))
        elif isinstance(default, list) and not override.value:
            # rclpy gives an empty list as no value at all.
            del self._parameter_overrides[name]
        elif isinstance(default, list) and override.type_ == Parameter.Type.STRING:
            self._parameter_overrides[name] = Parameter(name, value=[override.value])

    def _guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        # Left to the executor, the error would be told three times over, with lines of code.
        @wraps(callback)
        def call(*args: Any) -> Any:
            # The events executor hands a message and what is known of it over as one tuple.
            if len(args) == 1 and isinstance(args[0], tuple):
                args = args[0]
            try:
                return callback(*args)
            except (OccError, OSError) as error:
                self.fail(error)
            except _RCLError as error:
                self.fail(_refusal(error))

        return call


def run_node(make_node: Callable[[], OccNode], argv: Sequence[str] | None = None) -> int:
    """Run one node until it finishes or the process is asked to end.

    Args:
        make_node: builds the node once ROS is initialised.
        argv: command-line arguments, ``--ros-args`` included.

    Returns:
        0 after a clean end, Ctrl-C and SIGTERM included; the node's own code if it finished
        with one; 2 after a mistake in its input, told in one sentence on stderr. With ``--help``
        among the arguments, the node's parameters are printed instead.
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
            code = tell(error)
        except NameValidationException as error:
            code = tell(ConfigurationError(f'cannot start: {_one_line(error)}'))
        except _RCLError as error:
            code = tell(_refusal(error))
        finally:
            if node is not None:
                code = _close(node) or code
            rclpy.try_shutdown()
        return code


def _print_parameters(make_node: Callable[[], OccNode]) -> None:
    described = _describe(make_node)
    names, defaults = (max(len(item[column]) for item in described) for column in (0, 1))
    for name, default, meaning, bounds in described:
        note = f' ({bounds})' if bounds else ''
        print(f'  {name:{names}}  {default:{defaults}}  {meaning}{note}')


def _describe(make_node: Callable[[], OccNode]) -> list[tuple[str, str, str, str]]:
    """Return the parameters of a node: name, default, meaning and range of each, in their order.

    The node is made as far as it declares them, and where no other one sees it.
    """
    global _described
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    described = _described = []
    try:
        _initialise([])
        make_node()
    except _DescribedError:
        return described
    finally:
        _described = None
        rclpy.try_shutdown()
    raise AssertionError(f'{make_node} does not say when its parameters are declared')


def tell(error: OccError | OSError) -> int:
    """Print a mistake as one sentence on stderr; return the exit code 2."""
    print(f'error: {printable(str(error))}', file=sys.stderr, flush=True)
    return 2


def _initialise(argv: list[str]) -> None:
    global _arguments
    _arguments = argv
    for path in params_files(argv):
        read_text(path)
    allowed = 'allowed are ROS arguments such as -p NAME:=VALUE, -r FROM:=TO, --params-file FILE'
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        other = remove_ros_args(argv)
    # rclpy has no public type for a malformed command line.
    except Exception as error:
        reason = _without_places(error)
        raise ConfigurationError(
            f'the arguments are not understood: {reason}; {allowed}'
        ) from error
    if other:
        raise ConfigurationError(f'unknown argument {other[0]!r}; {allowed}, after --ros-args')


def _spin(node: OccNode) -> int:
    executor = node.make_executor()
    executor.add_node(node)
    try:
        while not (stop_request.made or node.done.done() or parent_is_gone()):
            # One callback at a time: longer spins do not end while messages come faster than they
            # are handled, whatever their timeout.
            executor.spin_once(_LOOK_SECONDS)
        if node.takes_the_rest:
            # Those that have come by now, and no others, for more may come for ever.
            rest = executor.create_task(lambda: None)
            while not (rest.done() or node.done.done()):
                executor.spin_once(_LOOK_SECONDS)
    finally:
        executor.shutdown()
    return node.done.result() if node.done.done() else 0


def _close(node: OccNode) -> int:
    try:
        node.close()
    except (OccError, OSError) as error:
        return tell(error)
    except _RCLError as error:
        # What ended the node has mostly been told by now, and this is a consequence of it.
        return 2 if node.done.done() else tell(_refusal(error))
    finally:
        node.destroy_node()
    return 0


def _refusal(error: Exception) -> OccError:
    """Return in one sentence why the layers below rclpy refuse something."""
    try:
        check_clock()
    except OccError as reason:
        return reason
    return ConfigurationError(f'ROS refuses: {_without_places(error)}')


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split())


def _without_places(error: Exception) -> str:
    """Return an error of rcl without the places in its source."""
    return re.sub(r', at \S+:\d+', '', _one_line(error))


def _allowed(default: Any, low: float | None, high: float | None) -> str:
    kind = {bool: 'true or false', int: 'a whole number', float: 'a number'}
    text = kind.get(type(default), 'text' if isinstance(default, str) else 'a list of texts')
    return text + _range(low, high)


def _range(low: float | None, high: float | None) -> str:
    return ('' if low is None else f' from {low:g}') + ('' if high is None else f' up to {high:g}')


def _shown(default: Any) -> str:
    """Return a default as it is written on a command line."""
    if isinstance(default, bool):
        return str(default).lower()
    return "['']" if default == [] else repr(default)
