# SPDX-License-Identifier: Apache-2.0
"""
Base class of the nodes of this project: a lifecycle node with autostart, checked parameters and diagnostics.

The ``add_...`` methods create the same entities as rclpy's ``create_...`` with the same arguments. In addition the
entities exist only between configure and cleanup, their callbacks run only while the node is active, and an exception
in a callback is logged and counted instead of ending the process.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.ros.deferred import DeferredActionServer, DeferredGoal, allow_deferred_responses
from mwd_sensors.ros.diagnostics import OK, WARN, CallbackFailures, Diagnostic, clock_diagnostics, diagnostic_array
from mwd_sensors.ros.message_buffer import MessageBuffer
from mwd_sensors.ros.middleware_events import MiddlewareEvents
from mwd_sensors.ros.parameters import SettingsParameters, given_at_start
from mwd_sensors.ros.qos import STATE, offered
from mwd_sensors.ros.refused_entity import RefusedEntityError, TopicPublisher, is_enforced, named_refusal
from mwd_sensors.ros.request_rules import refusal

T = TypeVar("T")

_FRAME_PREFIX = re.compile(r"[A-Za-z0-9_/.-]{0,200}")
_NAMESPACE = "auto"  # value of `frame_prefix`: the namespace and a slash
_DIAGNOSTICS_PERIOD = 1.0  # time between two messages of diagnostics and heartbeat, s
# Shortest time from the last message to the end of a process that ends by itself, s: it lets messages reach best-effort
# readers, which do not acknowledge.
_DELIVERY_TIME = 0.5
# Longest wait for the acknowledgements of reliable subscriptions, s. By then Fast DDS has removed dead participants,
# whose lease has ended.
_ACKNOWLEDGEMENT_TIME = 20.0


class GraphNode(LifecycleNode, Generic[T]):
    """
    Base class of the nodes of this project.

    A subclass creates its topics, services and timers in `configure`; those made with the ``add_...`` methods are
    destroyed automatically. It may override `activate`, `deactivate` and `cleanup`, and reports its state in
    `diagnostics`.

    Parameters
    ----------
    name : str
        Name of the node.
    default : dataclass
        Settings of the node with their defaults; every field is declared as a parameter.
    **node_options
        Options of `rclpy.lifecycle.LifecycleNode`.

    Raises
    ------
    SettingsError
        A parameter given at start is unknown or not allowed.
    """

    #: Beginnings of the names of the parameters that can change at run time; all other parameters are read-only.
    changeable: tuple[str, ...] = ()

    def __init__(self, name: str, default: T, **node_options: Any) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **node_options)
        given = given_at_start(self)
        self.declare_parameter("autostart", True)
        words = "Prefix of the names of this node's frames; auto: its namespace and a slash. Set at start only."
        fixed = ParameterDescriptor(description=words, read_only=True)
        prefix = self.declare_parameter("frame_prefix", _NAMESPACE, fixed).value
        if not _FRAME_PREFIX.fullmatch(prefix):
            raise SettingsError(f"frame_prefix: {printable(prefix)[:80]!r} has characters that no frame has")
        self._parameter_set = SettingsParameters(
            self, given, default, self._settings_changed, self.changeable, self.check_settings
        )
        self._entities: list[tuple[Any, Callable[[], Any]]] = []
        self._retired: list[contextlib.ExitStack] = []
        self._buffers: list[MessageBuffer] = []
        self.active = False  #: True while the node is in the state `active`
        self._configured = self._finalized = False
        self._failures = CallbackFailures()
        #: Done when the process should end; its exception, if any, is the reason why the node cannot do its work.
        self.stop_requested: Future = Future()
        self._stop_timer: Timer | None = None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._middleware = MiddlewareEvents(self)
        self._heartbeat = Heartbeat(self.get_fully_qualified_name(), self.get_namespace())
        self._heartbeat_publisher = self.create_publisher(DiagnosticStatus, "heartbeat", STATE)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        report = partial(self._guarded, "diagnostics", self._publish_diagnostics)
        self._diagnostics_timer = self.create_timer(_DIAGNOSTICS_PERIOD, report, clock=steady)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions that the executor serves: all except the buffered ones."""
        buffered = {buffer.subscription for buffer in self._buffers}
        yield from (subscription for subscription in super().subscriptions if subscription not in buffered)

    @property
    def settings(self) -> T:
        """Settings in force."""
        return self._parameter_set.value

    def frame(self, name: str) -> str:
        """Return a frame name with `frame_prefix`, for headers and transforms, so that each well has its own frames."""
        prefix: str = self.get_parameter("frame_prefix").value
        if prefix == _NAMESPACE:
            namespace = self.get_namespace().strip("/")
            prefix = f"{namespace}/" if namespace else ""
        return prefix + name

    # Hooks of subclasses.

    def configure(self) -> None:
        """Create topics, services and timers, and open files. An error is logged and leaves the node unconfigured."""

    def activate(self) -> None:
        """Start the work of the node, such as publishing; callbacks run from now on."""

    def deactivate(self) -> None:
        """Stop working; keep everything that `activate` needs to continue."""

    def cleanup(self) -> None:
        """Release what `configure` acquired, even if it failed; the base class releases topics, services and timers."""

    def check_settings(self, settings: T) -> None:
        """Raise ValueError for settings that the node cannot work with; such settings are refused, also at start."""

    def on_settings_changed(self, settings: T) -> None:
        """React to a change of parameters that was checked and is in force; called only on a configured node."""

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the state of the active node; called once a second."""
        return ()

    def prepare(self, warm_up: Callable[[], None]) -> None:
        """Call `warm_up`, which compiles the kernels, and log its start and end; `mwd run` waits for these lines."""
        self.get_logger().info("preparing the filters; the first time after a change they are compiled")
        warm_up()
        self.get_logger().info("the filters are ready")

    # Entities.

    def create_publisher(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """Create a publisher as rclpy does; if the middleware refuses it, the error names the topic."""
        with named_refusal("publish", self._full_name(topic)):
            return super().create_publisher(msg_type, topic, *args, **options)

    def create_subscription(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """Create a subscription as rclpy does; if the middleware refuses it, the error names the topic."""
        with named_refusal("subscribe", self._full_name(topic)):
            return super().create_subscription(msg_type, topic, *args, **options)

    def create_service(self, srv_type: Any, srv_name: str, *args: Any, **options: Any) -> Any:
        """Create a service as rclpy does; if the middleware refuses it, the error names the service."""
        with named_refusal("reply", self._full_name(srv_name)):
            return super().create_service(srv_type, srv_name, *args, **options)

    def create_client(self, srv_type: Any, srv_name: str, *args: Any, **options: Any) -> Any:
        """Create a client as rclpy does; if the middleware refuses it, the error names the service."""
        with named_refusal("request", self._full_name(srv_name)):
            return super().create_client(srv_type, srv_name, *args, **options)

    def _full_name(self, name: str) -> str:
        # Expand the name by the rules of ROS, without remapping: rclpy creates services before it can resolve names.
        space = self.get_namespace().rstrip("/")
        return name if name.startswith("/") else f"{space}/{name.replace('~', self.get_name(), 1)}"

    def add_publisher(self, msg_type: Any, topic: str, qos: QoSProfile) -> Any:
        """Create a reliable lifecycle publisher with this profile; it publishes nothing while the node is inactive."""
        profile = offered(qos)
        events = self._middleware.of_publisher(topic, profile)
        publisher = self.create_publisher(
            msg_type, topic, profile, event_callbacks=events, publisher_class=TopicPublisher
        )
        publisher.on_refusal = partial(self._not_sent, topic)
        self.add_managed_entity(publisher)
        self._entities.append((publisher, lambda: self.destroy_lifecycle_publisher(publisher)))
        return publisher

    def add_subscription(
        self, msg_type: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile, *, raw: bool = False
    ) -> None:
        """Create a subscription; a message that arrives while the node is inactive is dropped."""
        events = self._middleware.of_subscription(topic, qos)
        subscription = self.create_subscription(
            msg_type, topic, partial(self._call, topic, callback), qos, raw=raw, event_callbacks=events
        )
        self._entities.append((subscription, lambda: self.destroy_subscription(subscription)))

    def add_buffered_subscription(self, msg_type: Any, topic: str, qos: QoSProfile) -> MessageBuffer:
        """
        Create a subscription without callback and return its buffer.

        Serialised messages wait in the middleware until they are read from the buffer.
        """
        events = self._middleware.of_subscription(topic, qos)
        subscription = self.create_subscription(
            msg_type, topic, lambda _message: None, qos, raw=True, event_callbacks=events
        )
        # Exclude the subscription from `subscriptions` at once: the executor must never read messages from it.
        buffer = MessageBuffer(subscription)
        self._buffers.append(buffer)

        def destroy() -> None:
            self._buffers.remove(buffer)
            self.destroy_subscription(subscription)

        self._entities.append((subscription, destroy))
        return buffer

    def add_service(self, srv_type: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """
        Create a service whose response has `success` and `message`.

        An inactive node, and a request that breaks the rules of `request_rules`, get a response with the reason.
        `callback` returns the response, or a `DeferredResponse` through which the response is sent later.
        """

        def respond(request: Any, response: Any) -> Any:
            answer, failure = None, refusal(request)
            if not failure:
                answer, failure = self._call(name, callback, request, response)
            if failure:
                response.success, response.message = False, failure
            return response if failure else answer

        service = self.create_service(srv_type, name, respond)
        allow_deferred_responses(service)
        self._entities.append((service, lambda: self.destroy_service(service)))

    def add_action_server(
        self,
        action_type: Any,
        name: str,
        start_goal: Callable[[DeferredGoal], None],
        cancel_goal: Callable[[DeferredGoal], None],
    ) -> None:
        """
        Create an action server whose result has `success` and `message`.

        For an inactive node, and for a request that breaks the rules of `request_rules`, the result is the reason. The
        callbacks are those of `DeferredActionServer`: a goal ends when `DeferredGoal.finish` is called.
        """

        def call(callback: Callable[[DeferredGoal], None], goal: DeferredGoal) -> None:
            failure = refusal(goal.request) or self._call(name, callback, goal)[1]
            if failure:
                goal.finish(action_type.Result(success=False, message=failure))

        with named_refusal("execute", self._full_name(name)):
            server = DeferredActionServer(
                self, action_type, name, lambda goal: call(start_goal, goal), lambda goal: call(cancel_goal, goal)
            )
        self._entities.append((server, server.destroy))

    def add_client(self, srv_type: Any, name: str) -> Any:
        """Create a client of another node's service."""
        client = self.create_client(srv_type, name)
        self._entities.append((client, lambda: self.destroy_client(client)))
        return client

    def add_timer(self, period: float, callback: Callable[[], None]) -> None:
        """Create a timer of `period` seconds of steady time (never simulated time), called while the node is active."""
        protected = partial(self._call, callback.__name__, callback)
        timer = self.create_timer(period, protected, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._entities.append((timer, lambda: self.destroy_timer(timer)))

    def _call(self, name: str, callback: Callable[..., Any], *arguments: Any) -> tuple[Any, str]:
        """
        Call a callback if the node is active; an exception is logged and counted, and the node continues.

        Returns the result and an empty text, or None and the reason why there is no result.
        """
        if not self.active:
            return None, f"{self.get_name()} is not active; activate it first"
        return self._guarded(name, callback, *arguments)

    def _guarded(self, name: str, callback: Callable[..., Any], *arguments: Any) -> tuple[Any, str]:
        try:
            with self._heartbeat.timed():
                return callback(*arguments), ""
        except Exception:  # noqa: BLE001  (one bad message or request must not end the node)
            self._failures.count(name)
            self.get_logger().error(printable(f"{name}:\n{traceback.format_exc()}"), throttle_duration_sec=5.0)
            return None, f"{name} failed inside the node; see its log"

    def _not_sent(self, topic: str, error: Exception) -> None:
        self._failures.count(f"publish {topic}")
        self.get_logger().error(printable(f"{topic}: a message was not sent: {error}"), throttle_duration_sec=5.0)

    @property
    def finalized(self) -> bool:
        """Whether the node is shut down for good."""
        return self._finalized

    @property
    def state(self) -> str:
        """State of the node's lifecycle, as ROS names it."""
        if self._finalized:
            return "finalized"
        return "active" if self.active else "inactive" if self._configured else "unconfigured"

    def request_stop(self) -> None:
        """
        End the process once reliable subscribers have acknowledged the last messages, or after `_ACKNOWLEDGEMENT_TIME`.

        The caller must not publish afterwards. The last diagnostics of the node are among these messages, so that other
        nodes know why this node has ended.
        """
        if self._stop_timer is None:
            self._publish_diagnostics()
            self._stop_asked_at = time.monotonic()
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._stop_timer = self.create_timer(_DELIVERY_TIME, self._stop_when_acknowledged, clock=steady)

    def _stop_when_acknowledged(self) -> None:
        # A subscription cannot request a missing message from a publisher that no longer exists.
        waiting = [
            publisher.topic_name
            for publisher in self.publishers
            if isinstance(publisher, TopicPublisher) and not publisher.wait_for_all_acked(Duration())
        ]
        if waiting and time.monotonic() - self._stop_asked_at < _ACKNOWLEDGEMENT_TIME:
            self.get_logger().info(printable(f"waiting for subscribers of {', '.join(waiting)}"), once=True)
            return
        if waiting:
            self.get_logger().warning(
                printable(f"the last messages did not reach every subscriber of {', '.join(waiting)}")
            )
        self._stop()

    def _stop(self, reason: Exception | None = None) -> None:
        if self.stop_requested.done():
            return
        if reason is None:
            self.stop_requested.set_result(None)
        else:
            self.stop_requested.set_exception(reason)

    def _settings_changed(self, settings: T) -> None:
        if self._configured:
            self._guarded("parameters", self.on_settings_changed, settings)

    # Lifecycle.

    def autostart(self) -> None:
        """Configure and activate, unless the parameter `autostart` is false."""
        if self.get_parameter("autostart").value and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """
        Configure completely, or release what was acquired and return FAILURE.

        If SROS2 refused a topic, service or action, the process ends too.
        """
        try:
            self.configure()
        except Exception as error:  # noqa: BLE001  (the lifecycle would swallow the reason)
            expected = isinstance(error, (OSError, ValueError, RuntimeError))
            self.get_logger().error(printable(f"cannot configure: {error if expected else traceback.format_exc()}"))
            self._release()
            if isinstance(error, RefusedEntityError) and is_enforced(os.environ):
                # The permissions are read once, at the start of the process, so a second try would fail as well.
                self._stop(error)
            return TransitionCallbackReturn.FAILURE
        self._configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """
        Activate the publishers, then the node; drop messages that were buffered before.

        Return ERROR if `activate` raises.
        """
        result = super().on_activate(state)
        for buffer in self._buffers:
            buffer.drain()
        self.active = True
        try:
            self.activate()
        except Exception:  # noqa: BLE001  (the lifecycle would swallow the reason)
            self.get_logger().error(printable(f"cannot activate:\n{traceback.format_exc()}"))
            self.active = False
            return TransitionCallbackReturn.ERROR
        self.get_logger().info("active")
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate the node, then its publishers."""
        self.deactivate()
        self.active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release what `configure` acquired."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down from any state and end the process, because a finalized node does nothing any more."""
        if self.active:
            self.deactivate()
        self._release()
        self._stop()
        self._finalized = True
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Log the failed transition and return to unconfigured, so that the transition can be tried again."""
        self.get_logger().error(printable(f"a transition from {state.label} failed; the node is unconfigured again"))
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _release(self) -> None:
        self.active = self._configured = False
        self.cleanup()
        self._destroy_entities()

    def _destroy_entities(self) -> None:
        """
        Destroy the entities that `configure` created, but keep their handles until their last queued event is done.

        The events executor keeps borrowed references in its queue: a queued event of an entity that no longer exists
        would end the process (rclpy 7.1).
        """
        held = contextlib.ExitStack()
        for entity, destroy in reversed(self._entities):
            for handle in (getattr(entity, "handle", entity), *getattr(entity, "event_handlers", ())):
                held.enter_context(handle)
            held.callback(lambda _entity: None, entity)
            destroy()
        self._entities.clear()
        self._retired.append(held)
        executor = self.executor
        if executor is None:
            self._let_go(held)
        else:
            # The first task runs after the executor has dropped the entities, the second after all their queued events.
            executor.create_task(lambda: executor.create_task(self._let_go, held))

    def _let_go(self, held: contextlib.ExitStack) -> None:
        if held in self._retired:
            self._retired.remove(held)
            held.close()

    def destroy_node(self) -> None:
        """Destroy the node; the node must have been removed from its executor."""
        for held in list(self._retired):
            self._let_go(held)
        super().destroy_node()

    def _publish_diagnostics(self) -> None:
        state = self.state
        if self.active:
            own, _ = self._guarded("diagnostics", lambda: [*self.diagnostics(), *self._middleware.diagnostics()])
            found = [Diagnostic("lifecycle", OK, state), *(own or ())]
        else:
            found = [Diagnostic("lifecycle", WARN, state, "activate the node")]
        found += clock_diagnostics(self.get_parameter("use_sim_time").value, self.get_clock().now().nanoseconds)
        found += self._failures.diagnostics()
        self._diagnostics_publisher.publish(diagnostic_array(self, found))
        self._heartbeat_publisher.publish(self._heartbeat.message(state, max(one.level for one in found)))


# Heartbeat of a node: its lifecycle state and health, published once a second on the topic `heartbeat` of its well.


_PAGE = os.sysconf("SC_PAGE_SIZE")


class Heartbeat:
    """Source of the heartbeat messages of one node; `name` is the node's full name, `namespace` its namespace."""

    def __init__(self, name: str, namespace: str) -> None:
        self._name, self._namespace = name, namespace
        self._count = 0
        self._longest_s = 0.0

    @contextlib.contextmanager
    def timed(self) -> Iterator[None]:
        """Measure the duration of a callback for the next heartbeat, which reports the longest."""
        began = time.monotonic()
        try:
            yield
        finally:
            self._longest_s = max(self._longest_s, time.monotonic() - began)

    def message(self, state: str, level: bytes) -> DiagnosticStatus:
        """Return the next heartbeat: state, worst diagnostics level, count, longest callback and memory."""
        self._count += 1
        values = {
            "count": str(self._count),
            "longest_callback_s": f"{self._longest_s:.3f}",
            "memory_mb": f"{_resident_bytes() / 1e6:.1f}",
        }
        self._longest_s = 0.0
        return DiagnosticStatus(
            level=level,
            name=self._name,
            message=state,
            hardware_id=self._namespace,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )


def _resident_bytes() -> int:
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123  (once a second for years: no path object)
        return int(file.read().split()[1]) * _PAGE
