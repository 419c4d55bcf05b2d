# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Calls of the services of monitors and learners, made while the view goes on."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.fleet.model import Fleet
from occ_constraints_pkg.terminal import printable

_ANSWER_SECONDS = 10.0
_LEARN_SECONDS = 600.0
# A client knows a service a moment before the service knows the client, and an answer that is sent
# within that moment is lost.
_SETTLED_SECONDS = 0.4

# One request after the other: yields service, its type and the request; is sent the answer;
# returns what to tell.
Steps = Generator[tuple[str, Any, Any], Any, str]


@dataclass
class _Call:
    """A call under way."""

    source: str
    what: str
    steps: Steps
    seconds: float
    service: str = ''
    client: Client | None = None
    request: Any = None
    future: Future | None = None
    ready_at: float | None = None
    end: float = 0.0


class Calls:
    """Calls services; what comes of it is noted in the fleet's changes.

    Args:
        context: of ROS.
        fleet: where results are noted.
    """

    def __init__(self, context: Context, fleet: Fleet) -> None:
        self._fleet = fleet
        self._node = Node(
            f'_occ_calls_{time.time_ns() % 10**9}',
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._under_way: list[_Call] = []

    @property
    def under_way(self) -> list[str]:
        """What is being done, in words."""
        return [f'{call.source}: {call.what}' for call in self._under_way]

    def close(self) -> None:
        """Drop the calls under way."""
        self._executor.shutdown()
        self._node.destroy_node()

    def prune(self, monitor: str) -> None:
        """Let a monitor disable the rules that were rarely violated."""
        self._begin(monitor, 'prune rules', _trigger(f'{monitor}/prune'))

    def reset_stats(self, monitor: str) -> None:
        """Let a monitor set its counters to 0."""
        self._begin(monitor, 'reset statistics', _trigger(f'{monitor}/reset_stats'))

    def enable(self, monitor: str, is_enabled: bool) -> None:
        """Let a monitor judge, or answer every input by UNKNOWN."""
        what = 'enable the monitor' if is_enabled else 'disable the monitor'
        self._begin(monitor, what, _enable(f'{monitor}/enable', is_enabled))

    def learn(self, learner: str) -> None:
        """Let a learner learn from what it has collected."""
        self._begin(learner, 'learn rules', _trigger(f'{learner}/learn'), _LEARN_SECONDS)

    def enable_rule(self, monitor: str, rule: str, is_enabled: bool) -> None:
        """Enable or disable one rule of a monitor by its parameters."""
        what = f'{"enable" if is_enabled else "disable"} rule {rule}'
        self._begin(monitor, what, _enable_rule(monitor, rule, is_enabled))

    def spin(self) -> None:
        """Go on with the calls under way, without waiting."""
        if not self._under_way:
            return
        # A few answers at most are there.
        for _ in range(4 * len(self._under_way)):
            self._executor.spin_once(0.0)
        for call in list(self._under_way):
            self._go_on(call)

    def _begin(
        self, source: str, what: str, steps: Steps, seconds: float = _ANSWER_SECONDS
    ) -> None:
        call = _Call(source, what, steps, seconds)
        self._under_way.append(call)
        self._advance(call, None)

    def _advance(self, call: _Call, answer: Any) -> None:
        """Take an answer, and prepare the next request if there is one."""
        self._drop_client(call)
        try:
            call.service, kind, call.request = call.steps.send(answer)
        except StopIteration as done:
            self._finish(call, 'done', str(done.value))
        except OccError as error:
            self._finish(call, 'failed', str(error))
        else:
            call.client = self._node.create_client(kind, call.service)
            call.future, call.ready_at = None, None
            call.end = time.monotonic() + call.seconds

    def _go_on(self, call: _Call) -> None:
        now = time.monotonic()
        if call.future is not None and call.future.done():
            self._advance(call, call.future.result())
        elif now > call.end:
            sent = (
                'sent, but not answered; it may still be done'
                if call.future is not None
                else f'nobody offers {call.service}'
            )
            self._drop_client(call)
            self._finish(call, 'failed', f'{sent} (after {call.seconds:g} s)')
        elif call.future is None and call.client.service_is_ready():
            if call.ready_at is None:
                call.ready_at = now + _SETTLED_SECONDS
            elif now >= call.ready_at:
                call.future = call.client.call_async(call.request)

    def _drop_client(self, call: _Call) -> None:
        if call.client is not None:
            self._node.destroy_client(call.client)
            call.client = None

    def _finish(self, call: _Call, kind: str, text: str) -> None:
        self._under_way.remove(call)
        self._fleet.note(
            time.monotonic(), call.source, kind, f'{call.what}: {printable(text) or "done"}'
        )


def _trigger(service: str) -> Steps:
    answer = yield service, Trigger, Trigger.Request()
    return _told(answer)


def _enable(service: str, is_enabled: bool) -> Steps:
    answer = yield service, SetBool, SetBool.Request(data=is_enabled)
    return _told(answer)


def _told(answer: Any) -> str:
    if not answer.success:
        raise ConfigurationError(answer.message)
    return answer.message


def _enable_rule(monitor: str, rule: str, is_enabled: bool) -> Steps:
    names = ['disabled_rules', 'enabled_rules']
    answer = yield (
        f'{monitor}/get_parameters',
        GetParameters,
        GetParameters.Request(names=names),
    )
    lists = [[text for text in value.string_array_value if text] for value in answer.values]
    if len(lists) != len(names):
        raise ConfigurationError(f'{monitor} has no parameters {" and ".join(names)}')
    answer = yield (
        f'{monitor}/set_parameters_atomically',
        SetParametersAtomically,
        SetParametersAtomically.Request(
            parameters=[
                _texts(name, texts)
                for name, texts in zip(names, edited(*lists, rule, is_enabled), strict=True)
            ]
        ),
    )
    if not answer.result.successful:
        raise ConfigurationError(answer.result.reason)
    return 'in force; its file stays'


def edited(
    disabled: list[str], enabled: list[str], rule: str, is_enabled: bool
) -> tuple[list[str], list[str]]:
    """Return ``disabled_rules`` and ``enabled_rules`` of a monitor with one rule switched.

    To list an enabled rule as enabled changes nothing, so whether the file disables it need not be
    known.
    """
    disabled, enabled = ([name for name in names if name != rule] for names in (disabled, enabled))
    (enabled if is_enabled else disabled).append(rule)
    return disabled, enabled


def _texts(name: str, texts: list[str]) -> Parameter:
    # ROS has no empty list of texts.
    value = ParameterValue(
        type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=texts or ['']
    )
    return Parameter(name=name, value=value)
