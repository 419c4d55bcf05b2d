# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What every node has: checked names and parameters, guarded callbacks, a steady clock."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable
from copy import copy
from functools import wraps
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.ros.environment import check_clock
from occ_constraints_pkg.ros.log import OneLineLogger
from occ_constraints_pkg.ros.parameters import ParameterNode
from occ_constraints_pkg.ros.rclpy_internals import RCLError
from occ_constraints_pkg.terminal import printable

# How often a node checks whether another one has its name.
_DUPLICATE_NAME_SECONDS = 2.0
# How long the last messages may take to reach subscribers that are there.
_FLUSH_SECONDS = 1.0
# Periods that would mean never, for a clock in ns ends after 292 years: this is 30.
_LONGEST_SECONDS = 1e9


class OccNode(ParameterNode):
    """A node that can end its own process, and ends it on a user's mistake.

    An :class:`OccError` or an error of the operating system in a callback ends the process with
    that one sentence and exit code 2.

    Attributes:
        done: set when the process should end; its result is the exit code.
        takes_turns: whether each subscription has its turn however fast messages come on another
            one; else they are handled in the order in which they came, with less work for each.
        drain_on_shutdown: whether messages that have come when the process is asked to end are
            still handed to their callbacks.
    """

    drain_on_shutdown = False
    takes_turns = False

    def __init__(self, name: str, **kwargs: Any) -> None:
        self.done: Future = Future()
        self._one_line_logger: OneLineLogger | None = None
        super().__init__(name, **kwargs)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._has_duplicate = False
        self.steady_timer(_DUPLICATE_NAME_SECONDS, self._check_duplicate_name)

    def get_logger(self) -> OneLineLogger:
        """Return the node's logger, which writes one line for each message."""
        if self._one_line_logger is None:
            self._one_line_logger = OneLineLogger(super().get_logger().name)
        return self._one_line_logger

    def finish(self, exit_code: int = 0) -> None:
        """End the process after the present callback."""
        if not self.done.done():
            self.done.set_result(exit_code)

    def begin(self) -> None:
        """Begin to work; called once, before the node spins."""

    def close(self) -> None:
        """Release files and threads; called once before the node is destroyed."""

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Any,
        qos_profile: QoSProfile | int,
        *args: Any,
        **kw: Any,
    ) -> Subscription:
        """Subscribe as :meth:`rclpy.node.Node.create_subscription` does, but guarded.

        A callback with two arguments also gets what the middleware knows of the message.

        Raises:
            OccError: ``topic`` is no valid name.
        """
        self.full_name(topic)
        # rclpy writes overrides by parameter into the profile, which others may share.
        return super().create_subscription(
            msg_type, topic, self._guarded(callback), copy(qos_profile), *args, **kw
        )

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int, *args: Any, **kw: Any
    ) -> Publisher:
        """Create a publisher as :meth:`rclpy.node.Node.create_publisher` does."""
        # As for subscriptions.
        return super().create_publisher(msg_type, topic, copy(qos_profile), *args, **kw)

    def create_timer(self, timer_period_sec: float, callback: Any, *args: Any, **kw: Any) -> Timer:
        """Create a timer as :meth:`rclpy.node.Node.create_timer` does, but guarded.

        Periods may be of any length.
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

    def flush(self, *publishers: Publisher, seconds: float = _FLUSH_SECONDS) -> None:
        """Wait, not for long, until reliable subscribers have what was published last."""
        end = self.steady_seconds() + seconds
        for publisher in publishers:
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - self.steady_seconds())))

    def fail(self, error: OccError | OSError) -> None:
        """End the process with exit code 2 and one sentence."""
        report_error(error)
        self.finish(2)

    def _check_duplicate_name(self) -> None:
        """Warn of another node with the same full name: each would answer for the other."""
        full = self.get_fully_qualified_name()
        nodes = self.get_node_names_and_namespaces()
        count = sum(f'{space.rstrip("/")}/{name}' == full for name, space in nodes)
        if count > 1 and not self._has_duplicate:
            self.get_logger().warning(
                f'{count} nodes are called {full}; allowed is one, so end the others, or rename '
                'this one with -r __node:=NAME (one that was killed is listed for some 20 s yet)'
            )
        self._has_duplicate = count > 1

    def _guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        # Left to the executor, the error would be printed three times over, with lines of code.
        @wraps(callback)
        def call(*args: Any) -> Any:
            # The events executor hands a message and what is known of it over as one tuple.
            if len(args) == 1 and isinstance(args[0], tuple):
                args = args[0]
            try:
                return callback(*args)
            except (OccError, OSError) as error:
                self.fail(error)
            except RCLError as error:
                self.fail(refusal_of(error))

        return call


def report_error(error: OccError | OSError) -> int:
    """Print a mistake as one sentence on stderr; return the exit code 2."""
    print(f'error: {printable(str(error))}', file=sys.stderr, flush=True)
    return 2


def refusal_of(error: Exception) -> OccError:
    """Return in one sentence why the layers below rclpy refuse something."""
    try:
        check_clock()
    except OccError as reason:
        return reason
    return ConfigurationError(f'ROS refuses: {without_source_lines(error)}')


def one_line(error: Exception) -> str:
    """Return the text of an error of the layers below rclpy on one line."""
    return ' '.join(str(error).split())


def without_source_lines(error: Exception) -> str:
    """Return the text of an error of rcl on one line, without the lines of its source."""
    return re.sub(r', at \S+:\d+', '', one_line(error))
