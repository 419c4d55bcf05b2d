# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A managed node: configured, activated, deactivated and cleaned up from outside, or by itself."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.rclpy_internals import lifecycle_state, lifecycle_transitions


class ManagedNode(LifecycleNodeMixin, OccNode):
    """An :class:`OccNode` with the states of a ROS lifecycle node.

    A subclass overrides :meth:`configure`, :meth:`activate`, :meth:`deactivate` and
    :meth:`cleanup`, and asks :attr:`is_active` before it does anything that only an active node
    may: rclpy goes on calling the callbacks of subscriptions and timers in every state.

    An :class:`OccError` in :meth:`configure` is reported in one sentence, and the node stays
    unconfigured. Anything else that goes wrong in a transition is a defect; its traceback is
    logged.

    Args:
        name: of the node.
    """

    def __init__(self, name: str) -> None:
        OccNode.__init__(self, name)
        self._mistake: OccError | OSError | None = None
        self._autostart = self.parameter(
            'autostart', True, 'configure and activate at once, without a lifecycle manager'
        )
        self._is_starting = False
        self._settings: set[str] = set()
        LifecycleNodeMixin.__init__(self)
        service = next(one for one in self.services if one.srv_type is ChangeState)
        self._change_state = service.callback
        service.callback = self._change_if_possible
        self.add_on_set_parameters_callback(self._check_settings)

    @property
    def state(self) -> str:
        """The present state: ``unconfigured``, ``inactive``, ``active`` or ``finalized``."""
        return lifecycle_state(self)[1]

    @property
    def is_active(self) -> bool:
        """Whether the node is active."""
        return lifecycle_state(self)[0] == State.PRIMARY_STATE_ACTIVE

    def begin(self) -> None:
        """Configure and activate, if the parameter ``autostart`` says so.

        Raises:
            OccError: the node cannot be configured.
            OSError: likewise.
        """
        if not self._autostart:
            name = self.get_fully_qualified_name()
            self.get_logger().info(
                f'unconfigured, as autostart is false: waiting for the transitions configure and '
                f'activate on {name}/change_state, as of a lifecycle manager or of `ros2 lifecycle '
                f'set {name} configure` and `... activate`'
            )
            return
        self._is_starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self._mistake or ConfigurationError(
                    f'node {self.get_name()!r} could not be started'
                )
        self._is_starting = False

    def configure(self) -> None:
        """Make ready to be activated.

        Raises:
            OccError: that is not possible.
        """

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working, but stay ready."""

    def cleanup(self) -> None:
        """Drop all that :meth:`configure` made; also called when that failed half-way."""

    def setting(self, name: str, default: Any, description: str, **bounds: float) -> None:
        """Declare a parameter that can be set as long as the node is unconfigured.

        Read it with :meth:`value` in :meth:`configure`; see :meth:`OccNode.parameter` for the
        arguments.
        """
        self.parameter(name, default, description, read_only=False, **bounds)
        self._settings.add(name)

    def live_setting(self, name: str, default: Any, description: str, **bounds: float) -> None:
        """Declare a parameter that can be set in any state; see :meth:`setting`."""
        self.parameter(name, default, description, read_only=False, **bounds)

    def value(self, name: str) -> Any:
        """Return the present value of a parameter; a list without the empty text, for none."""
        value = self.get_parameter(name).value
        return [item for item in value if item] if isinstance(value, list) else value

    def _check_settings(self, parameters: list[Parameter]) -> SetParametersResult:
        fixed = [item.name for item in parameters if item.name in self._settings]
        if fixed and self.state != 'unconfigured':
            reason = (
                f'parameter {fixed[0]!r} can only be set while the node is unconfigured; it is '
                f'{self.state}'
            )
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _change_if_possible(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Refuse a transition that the state does not have; given by number, rclpy raises."""
        asked = request.transition
        there = lifecycle_transitions(self)
        if asked.label or asked.id in there:
            return self._change_state(request, response)
        self.get_logger().error(
            f'there is no transition {asked.id} from {self.state}; allowed are '
            + ', '.join(f'{number} ({label})' for number, label in there.items())
        )
        response.success = False
        return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run :meth:`configure` for rclpy."""
        return self._run(self.configure, 'inactive', undo=self.cleanup)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run :meth:`activate` for rclpy."""
        return self._run(self.activate, 'active')

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run :meth:`deactivate` for rclpy."""
        return self._run(self.deactivate, 'inactive')

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run :meth:`cleanup` for rclpy."""
        return self._run(self.cleanup, 'unconfigured')

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate if active, and clean up."""
        if state.state_id == State.PRIMARY_STATE_ACTIVE:
            self._run(self.deactivate, 'inactive')
        return self._run(self.cleanup, 'finalized')

    def _run(
        self, step: Callable[[], None], state: str, *, undo: Callable[[], None] | None = None
    ) -> TransitionCallbackReturn:
        self._mistake = None
        try:
            step()
        except (OccError, OSError) as error:
            self._mistake = error
            if undo is not None:
                undo()
            if not self._is_starting:
                # What ends the start is reported by whoever called `begin`.
                self.get_logger().error(f'{step.__name__} failed: {error}')
            return TransitionCallbackReturn.FAILURE
        except Exception:
            # rclpy would swallow it.
            self.get_logger().fatal(traceback.format_exc())
            raise
        if not self._is_starting:
            self.get_logger().info(f'the node is {state} now')
        return TransitionCallbackReturn.SUCCESS
