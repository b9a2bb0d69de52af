# SPDX-License-Identifier: Apache-2.0
"""Service responses and action results that are sent after the callback has returned; the executor does not wait."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.lifecycle import LifecycleNode
from rclpy.service import Service


class DeferredResponse:
    """A service response that is sent later; the client waits, the executor does not."""

    def __init__(self) -> None:
        self._sender: Callable[[Any], None] | None = None

    def send_through(self, sender: Callable[[Any], None]) -> None:
        """Set the function that sends the response; `send` calls this function, and only once."""
        self._sender = sender

    def send(self, response: Any) -> None:
        """Send the response. Only the first call has an effect."""
        sender, self._sender = self._sender, None
        if sender is not None:
            sender(response)


def answering(method: Callable[..., str | DeferredResponse]) -> Callable[..., Any]:
    """
    Make the callback of a service whose response has `success` and `message` from a method that returns the message.

    The method gets the same arguments as the callback. If it raises ValueError, the request was refused, and the
    message is the text of the error. A `DeferredResponse` is returned unchanged.
    """

    @functools.wraps(method)
    def callback(self: Any, request: Any, response: Any, *more: Any) -> Any:
        try:
            answer = method(self, request, response, *more)
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        if isinstance(answer, DeferredResponse):
            return answer
        response.success, response.message = True, answer
        return response

    return callback


def allow_deferred_responses(service: Service) -> None:
    """
    Let the callback of a service return a `DeferredResponse` instead of a response.

    The executor passes the callback's return value to `send_response`, together with the header of the request.
    """
    send_now = service.send_response

    def send_response(response: Any, header: Any) -> None:
        if isinstance(response, DeferredResponse):
            response.send_through(lambda known: send_now(known, header))
        else:
            send_now(response, header)

    service.send_response = send_response


class DeferredGoal:
    """Accepted goal of an action: publish feedback while it runs, and finish it once."""

    def __init__(self, server: DeferredActionServer, handle: ServerGoalHandle) -> None:
        self._server, self._handle = server, handle
        self.request = handle.request  #: goal part of the action

    @property
    def done(self) -> bool:
        """Whether the goal was finished."""
        return not self._handle.is_active

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback; has no effect on a finished goal."""
        if self._handle.is_active:
            self._handle.publish_feedback(feedback)

    def finish(self, result: Any) -> None:
        """
        Send the result; has no effect on a finished goal.

        The goal succeeds if the field `success` of the result is true. Otherwise it is cancelled if a client requested
        cancellation, and aborted if not.
        """
        if not self._handle.is_active:
            return
        if result.success:
            self._handle.succeed()
        elif self._handle.is_cancel_requested:
            self._handle.canceled()
        else:
            self._handle.abort()
        self._server.send_result(self._handle, result)


class DeferredActionServer(ActionServer):
    """
    Action server whose goals end when `DeferredGoal.finish` is called, not when a callback returns.

    The server of rclpy awaits a coroutine for the whole duration of a goal, which the events executor does not support.
    Here the executor only makes calls that return at once: one starts the goal and a later one sends its result.

    Parameters
    ----------
    start_goal : callable
        Called with each accepted `DeferredGoal`; must return at once.
    cancel_goal : callable
        Called with a goal whose cancellation was requested; must finish the goal.
    """

    def __init__(
        self,
        node: LifecycleNode,
        action_type: Any,
        name: str,
        start_goal: Callable[[DeferredGoal], None],
        cancel_goal: Callable[[DeferredGoal], None],
    ) -> None:
        self._goals: dict[bytes, DeferredGoal] = {}
        self._owner, self._start_goal, self._cancel_goal = node, start_goal, cancel_goal
        super().__init__(node, action_type, name, lambda _handle: None, cancel_callback=self._on_cancel_request)

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:  # noqa: ARG002
        """Start an accepted goal (called by rclpy when its state is `executing`)."""
        for key in [key for key, goal in self._goals.items() if goal.done]:
            del self._goals[key]
        goal = self._goals[bytes(goal_handle.goal_id.uuid)] = DeferredGoal(self, goal_handle)
        self._start_goal(goal)

    def send_result(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Make the result available to the client, which may request it now or later."""
        super().notify_execute(goal_handle, lambda _handle: result)

    def _on_cancel_request(self, goal_handle: ServerGoalHandle) -> CancelResponse:
        goal = self._goals.get(bytes(goal_handle.goal_id.uuid))
        if goal is None or goal.done:
            return CancelResponse.REJECT
        # The goal gets the state `canceling` only after this callback has returned.
        self._owner.executor.create_task(self._cancel_goal, goal)
        return CancelResponse.ACCEPT
