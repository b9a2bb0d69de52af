"""What every node of the graph does the same way: lifecycle with autostart, parameters, diagnostics, a clean end."""

from __future__ import annotations

import dataclasses
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future

from mwd_sensors.core.settings import SettingsError
from mwd_sensors.ros.message_buffer import Inbox
from mwd_sensors.ros.parameters import SettingsParameters

T = TypeVar("T")

OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))
_LONGEST_SPIN = 1e6  # s; the events executor treats "no limit" as "already over"
_SIGNAL_PERIOD = 0.2  # s; how long an idle node may take to see a signal


@dataclasses.dataclass(frozen=True)
class Finding:
    """One line of diagnostics: what was looked at, how it is, what to do, and figures."""

    name: str
    level: bytes
    message: str
    remedy: str = ""
    values: tuple[tuple[str, str], ...] = ()


class Later:
    """A service response that is not known yet; the caller waits, the executor does not."""

    def __init__(self) -> None:
        self._send: Callable[[Any], None] | None = None

    def bind(self, send: Callable[[Any], None]) -> None:
        """Whom to answer; called once, when the service callback has returned."""
        self._send = send

    def answer(self, response: Any) -> None:
        """Answer, once."""
        send, self._send = self._send, None
        if send is not None:
            send(response)


class Errand:
    """
    A goal of an action that is under way: tell its progress as often as there is news, finish it once.

    Attributes
    ----------
    goal : message
        What was asked for.
    """

    def __init__(self, server: _Door, handle: ServerGoalHandle) -> None:
        self._server, self._handle = server, handle
        self.goal = handle.request

    @property
    def done(self) -> bool:
        """Whether it was finished."""
        return not self._handle.is_active

    def progress(self, feedback: Any) -> None:
        """Tell who asked how far it is."""
        if self._handle.is_active:
            self._handle.publish_feedback(feedback)

    def finish(self, result: Any) -> None:
        """Give the result: succeeded by its `success`, else cancelled where that was asked, else aborted."""
        if not self._handle.is_active:
            return
        if result.success:
            self._handle.succeed()
        elif self._handle.is_cancel_requested:
            self._handle.canceled()
        else:
            self._handle.abort()
        self._server.give(self._handle, result)


class _Door(ActionServer):
    """
    An action server whose goals end when somebody ends them, not when a callback returns.

    The stock server awaits a coroutine for the whole time of a goal, which the events executor doesn't do. Here the
    executor sees only what is over at once: a goal is begun, and later its result is given.
    """

    def __init__(self, node: LifecycleNode, kind: Any, name: str, **callbacks: Any) -> None:
        self._begun: Callable[[ServerGoalHandle], None] | None = callbacks.pop("begun")
        super().__init__(node, kind, name, lambda _handle: None, **callbacks)

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:  # noqa: ARG002
        """A goal was accepted and is now executing."""
        if self._begun is not None:
            self._begun(goal_handle)

    def give(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Send the result to whoever asks for it, now or later."""
        super().notify_execute(goal_handle, lambda _handle: result)


class GraphNode(LifecycleNode, Generic[T]):
    """
    Base of the graph's nodes.

    A subclass opens its topics in `open` (on configure), closes nothing itself (all it made through the methods here is
    destroyed on cleanup), may act in `start` and `halt` (activate, deactivate), and says how it is in `findings`.
    """

    def __init__(self, name: str, default: T, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self.declare_parameter("autostart", True)
        self._checked_settings = SettingsParameters(self, default, self.settings_changed, self.takes_live)
        self._made: list[Callable[[], Any]] = []
        self._inboxes: list[Inbox] = []
        self.active = False
        self._failures: dict[str, int] = {}
        self.stop_requested: Future = Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._report_timer = self.create_timer(1.0, self._report, clock=steady)
        # An idle executor waits in native code; Python sees a signal only when some callback runs.
        self._signal_timer = self.create_timer(_SIGNAL_PERIOD, lambda: None, clock=steady)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions for the executor to wait for: those it calls somebody for."""
        waiting = {inbox.subscription for inbox in self._inboxes}
        yield from (subscription for subscription in super().subscriptions if subscription not in waiting)

    @property
    def settings(self) -> T:
        """Settings in force."""
        return self._checked_settings.value

    # For subclasses.

    def open(self) -> None:
        """Open topics, services and files. An error here leaves the node unconfigured, with its reason logged."""

    def start(self) -> None:
        """Begin to work."""

    def halt(self) -> None:
        """Stop working; nothing is lost, `start` can follow."""

    def close(self) -> None:
        """Let go of what `open` took that is not a topic, service or timer."""

    def takes_live(self, name: str) -> bool:  # noqa: ARG002
        """Whether a running node can take a change of that parameter; those it cannot take are read-only."""
        return True

    def settings_changed(self, settings: T) -> None:
        """A checked change of parameters is in force."""

    def findings(self) -> Sequence[Finding]:
        """How the node is, once a second."""
        return ()

    def publish_on(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
        """A publisher that is silent while the node is inactive."""
        publisher = self.create_lifecycle_publisher(kind, topic, qos)
        self._made.append(lambda: self.destroy_lifecycle_publisher(publisher))
        return publisher

    def listen(self, kind: Any, topic: str, act: Callable[[Any], None], qos: QoSProfile, *, raw: bool = False) -> None:
        """Subscribe; what arrives while the node is inactive is dropped."""
        guarded = self._guarded(topic, act)
        subscription = self.create_subscription(
            kind, topic, lambda message: guarded(message) if self.active else None, qos, raw=raw
        )
        self._made.append(lambda: self.destroy_subscription(subscription))

    def collect(self, kind: Any, topic: str, qos: QoSProfile) -> Inbox:
        """Subscribe to serialised messages that wait to be taken; what arrived before activation is dropped."""
        # Before the executor learns of it: it must never take from this one.
        subscription = self.create_subscription(kind, topic, _nobody, qos, raw=True)
        inbox = Inbox(subscription)
        self._inboxes.append(inbox)

        def destroy() -> None:
            self._inboxes.remove(inbox)
            self.destroy_subscription(subscription)

        self._made.append(destroy)
        return inbox

    def serve(self, kind: Any, name: str, act: Callable[[Any, Any], Any]) -> None:
        """
        Offer a service with `success` and `message`; an inactive node answers with the reason.

        `act` returns the response, or a `Later` to whom the response is given when it is known.
        """

        def answer(request: Any, response: Any) -> Any:
            if not self.active:
                response.success, response.message = False, f"{self.get_name()} is not active; activate it first"
                return response
            try:
                return act(request, response)
            except Exception:  # noqa: BLE001  (one bad request must not end the node)
                self._failed(name)
                response.success, response.message = False, f"{name} failed inside the node; its log says where"
                return response

        service = self.create_service(kind, name, answer)
        # The executor hands to `send_response` whatever the callback returned, together with whom to answer.
        at_once = service.send_response

        def send_response(response: Any, header: Any) -> None:
            if isinstance(response, Later):
                response.bind(lambda known: at_once(known, header))
            else:
                at_once(response, header)

        service.send_response = send_response
        self._made.append(lambda: self.destroy_service(service))

    def perform(self, kind: Any, name: str, begin: Callable[[Errand], None], cancel: Callable[[Errand], None]) -> None:
        """
        Offer an action whose result has `success` and `message`; an inactive node answers with the reason.

        `begin` is told each goal and returns at once; whoever knows the result finishes the errand. `cancel` is told
        that nobody wants it any more, and finishes it.
        """

        def tell(act: Callable[[Errand], None], errand: Errand) -> None:
            try:
                act(errand)
            except Exception:  # noqa: BLE001  (one bad goal must not end the node)
                self._failed(name)
                errand.finish(kind.Result(success=False, message=f"{name} failed inside the node; its log says where"))

        errands: dict[bytes, Errand] = {}

        def begun(handle: ServerGoalHandle) -> None:
            for key in [key for key, errand in errands.items() if errand.done]:
                del errands[key]
            errand = errands[bytes(handle.goal_id.uuid)] = Errand(server, handle)
            if self.active:
                tell(begin, errand)
            else:
                message = f"{self.get_name()} is not active; activate it first"
                errand.finish(kind.Result(success=False, message=message))

        def cancelled(handle: ServerGoalHandle) -> CancelResponse:
            errand = errands.get(bytes(handle.goal_id.uuid))
            if errand is None or errand.done:
                return CancelResponse.REJECT
            # Behind this callback, when the goal has become one that is being cancelled.
            self.executor.create_task(tell, cancel, errand)
            return CancelResponse.ACCEPT

        server = _Door(self, kind, name, begun=begun, cancel_callback=cancelled)
        self._made.append(server.destroy)

    def reach(self, kind: Any, name: str) -> Any:
        """A client of another node's service."""
        client = self.create_client(kind, name)
        self._made.append(lambda: self.destroy_client(client))
        return client

    def every(self, period: float, act: Callable[[], None]) -> None:
        """Call while active, once per period, s, of a clock nobody sets."""
        guarded = self._guarded(act.__name__, act)
        timer = self.create_timer(
            period, lambda: guarded() if self.active else None, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._made.append(lambda: self.destroy_timer(timer))

    def _guarded(self, name: str, act: Callable[..., None]) -> Callable[..., None]:
        """One bad message must not end the node: what goes wrong is logged, counted and shown in the diagnostics."""

        def guarded(*arguments: Any) -> None:
            try:
                act(*arguments)
            except Exception:  # noqa: BLE001
                self._failed(name)

        return guarded

    def _failed(self, name: str) -> None:
        self._failures[name] = self._failures.get(name, 0) + 1
        self.get_logger().error(f"{name}:\n{traceback.format_exc()}", throttle_duration_sec=5.0)

    def request_stop(self) -> None:
        """End the process in order, as a signal would."""
        if not self.stop_requested.done():
            self.stop_requested.set_result(None)

    # Lifecycle.

    def autostart(self) -> None:
        """Configure and activate, unless the parameter `autostart` says no."""
        if self.get_parameter("autostart").value and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open everything, or nothing."""
        try:
            self.open()
        except (OSError, ValueError, RuntimeError) as error:
            self.get_logger().error(f"cannot configure: {error}")
            self._destroy_made()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publishers first, work second."""
        result = super().on_activate(state)
        for inbox in self._inboxes:
            inbox.take()
        self.active = True
        try:
            self.start()
        except Exception:  # noqa: BLE001  (the lifecycle would swallow the reason)
            self.get_logger().error(f"cannot start:\n{traceback.format_exc()}")
            self.active = False
            return TransitionCallbackReturn.ERROR
        self.get_logger().info("active")
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Work first, publishers second."""
        self.halt()
        self.active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close what `open` opened."""
        self.close()
        self._destroy_made()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End from whatever state the node is in."""
        if self.active:
            self.halt()
            self.active = False
        self.close()
        self._destroy_made()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Say what went wrong and go back to unconfigured, so that it can be tried again."""
        self.get_logger().error(f"a transition from {state.label} failed; the node is unconfigured again")
        self.active = False
        self.close()
        self._destroy_made()
        return TransitionCallbackReturn.SUCCESS

    def _destroy_made(self) -> None:
        for destroy in reversed(self._made):
            destroy()
        self._made.clear()

    def _report(self) -> None:
        name = self.get_fully_qualified_name()
        state = self._state_machine.current_state[1]
        found = [Finding("lifecycle", OK if self.active else WARN, state, "" if self.active else "activate the node")]
        if self.active:
            found += self.findings()
        if self._failures:
            values = tuple((where, str(count)) for where, count in self._failures.items())
            found.append(Finding("failures", ERROR, "the node went on after an error", "read its log", values))
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        for finding in found:
            values = [KeyValue(key=key, value=value) for key, value in finding.values]
            if finding.remedy:
                values.append(KeyValue(key="remedy", value=finding.remedy))
            message.status.append(
                DiagnosticStatus(
                    level=finding.level,
                    name=f"{name}: {finding.name}",
                    message=finding.message,
                    hardware_id=self.get_namespace(),
                    values=values,
                )
            )
        self._diagnostics.publish(message)


def _nobody(_message: bytes) -> None:
    """Of a subscription that is taken from, not called back."""


def run_node(make: Callable[[], GraphNode[Any]], args: Sequence[str] | None = None) -> int:
    """
    Run one node until it is told to stop.

    SIGINT and SIGTERM end it in order (deactivate, clean up) with status 0; settings that are not allowed end it with
    status 2 and one sentence.
    """
    rclpy.init(args=list(args) if args is not None else None, signal_handler_options=SignalHandlerOptions.NO)
    try:
        return _spin(make)
    finally:
        rclpy.try_shutdown()


def _spin(make: Callable[[], GraphNode[Any]]) -> int:
    try:
        node = make()
    except SettingsError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    stopped = node.stop_requested

    def stop(_number: int, _frame: Any) -> None:
        if not stopped.done():
            stopped.set_result(None)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        node.autostart()
        while not stopped.done():
            executor.spin_until_future_complete(stopped, _LONGEST_SPIN)
    except ExternalShutdownException:
        node.get_logger().info("the middleware was shut down from outside")
    finally:
        node.trigger_shutdown()
        executor.remove_node(node)
        node.destroy_node()
    return 0
