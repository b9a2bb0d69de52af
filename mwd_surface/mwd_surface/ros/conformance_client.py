# SPDX-License-Identifier: Apache-2.0
"""Conformance test over ROS with the topics and services of docs/rig/control.md; each client has its own key."""

from __future__ import annotations

import copy
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from mwd_msgs import msg, srv
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from mwd_sensors.ros.qos import STATE
from mwd_surface.conformance.bench import Bench, ControlAnswer, NotPossibleError, Point, View, Wish
from mwd_surface.control.status import ControlJudgement
from mwd_surface.ros.controller import Controller

_DISCOVERY_S, _ANSWER_S = 30.0, 30.0  # longest waits for the authority and for the answer of a service, s
_SEEN_S = 1.0  # longest wait for the state to show a set-point, s; usually a tenth of it is enough


class RosConformance:
    """
    Interface under test: the control authority on a ROS graph, with the decisions of the person at the rig.

    Raises
    ------
    ValueError
        No control authority answers in this namespace.
    """

    name, largest, lag_s = "ROS", 2**32 - 1, 0.0

    def __init__(self, domain: int, namespace: str) -> None:
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self.node = rclpy.create_node(
            "mwd_conformance", namespace=namespace, context=self._context, start_parameter_services=False
        )
        self._states: list[tuple[float, Any]] = []
        self.node.create_subscription(
            msg.ControlState, "control/state", lambda one: self._states.append((time.monotonic(), one)), STATE
        )
        self._judge = self.node.create_client(srv.JudgeControl, "judge_control")
        self._peers = {number: RosPeer(self, f"peer {number}") for number in range(8)}
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        end = time.monotonic() + _DISCOVERY_S
        while not (self._states and all(p.ready for p in self._peers.values()) and self._judge.service_is_ready()):
            if time.monotonic() > end:
                self.close()
                raise ValueError(f"no control authority answers in namespace {namespace} of domain {domain}")
            time.sleep(0.1)
        time.sleep(0.5)  # wait until the server has also discovered its clients

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def answer(self, asked: Any) -> Any:
        """Return the answer of a service after waiting for it; raise ValueError without an answer in time."""
        end = time.monotonic() + _ANSWER_S
        while not asked.done():
            if time.monotonic() > end:
                raise ValueError("the authority does not answer")
            time.sleep(0.005)
        return asked.result()

    def peer(self, number: int) -> RosPeer:
        """Return a client (controller) by its number."""
        return self._peers[number]

    @property
    def state(self) -> Any:
        """Newest received state of control."""
        del self._states[:-1]
        return self._states[-1][1]

    def view(self) -> View:
        """Return the public state from a message received after this call, or the last one if none comes in 1 s."""
        asked = time.monotonic()
        while self._states[-1][0] < asked and time.monotonic() < asked + _SEEN_S:
            time.sleep(0.01)
        state = self.state
        return View(state.lease, state.mode, state.sequence, state.rotary_speed, state.turn, state.pending)

    def grant(self, number: int) -> bool:
        """Grant a request, as the person at the rig; return whether the request was granted."""
        return self._judged(decision=int(ControlJudgement.GRANT), number=number, operator_name="conformance")

    def abort(self, name: str = "conformance") -> bool:
        """Take control back, as the person at the rig; return whether this was accepted."""
        return self._judged(decision=int(ControlJudgement.ABORT), operator_name=name)

    def _judged(self, **fields: Any) -> bool:
        return bool(self.answer(self._judge.call_async(srv.JudgeControl.Request(**fields))).success)

    def attacks(self) -> list[tuple[str, str, Callable[[Bench], tuple[bool, str]]]]:
        """Return the cases that only this interface has: title, expected result, and function that runs the case."""
        return [
            ("a set-point that is not signed", "refused", self._unsigned),
            ("a set-point that was changed after it was signed", "refused", self._changed),
            ("another client sends a signed set-point again", "refused", self._replayed),
            ("another client sends a signed heartbeat again", "not a heartbeat: the lease ends", self._replayed_beat),
            ("a request that is not signed", "denied", self._unsigned_request),
            (
                "a set-point whose stamp is an hour old, or in the future",
                "the validity of the set-point counts from its arrival",
                self._stamps,
            ),
            ("a person grants a request that does not exist", "refused", self._grants_nothing),
        ]

    def _stays(self, lease: int) -> tuple[bool, str]:
        time.sleep(_SEEN_S)
        view = self.view()
        return (view.lease, view.sequence, view.speed <= 0.6) == (lease, 1, True), f"set-point {view.sequence}"

    def _unsigned(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        command = _command(lease, 2, Point(speed=0.9))
        self.peer(0).publish(msg.SealedCommand(command=command))
        return self._stays(lease)

    def _changed(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        sealed = self.peer(0).sealed(_command(lease, 2, Point(speed=0.5)))
        sealed.command.rotary_speed = 0.9
        self.peer(0).publish(sealed)
        return self._stays(lease)

    def _replayed(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.take(bench.one())
        sealed = self.peer(0).sealed(_command(lease, 1, Point()))
        self.peer(0).publish(sealed)
        bench.until(lambda: self.view().sequence == 1)
        for _ in range(5):
            self.peer(1).publish(sealed)
        return self._stays(lease)

    def _replayed_beat(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.turning()
        sealed = self.peer(0).sealed(_command(lease, 0, Point()))
        end = time.monotonic() + bench.heartbeat_s + 1.5
        while time.monotonic() < end and self.view().lease == lease:
            self.peer(1).publish(sealed)
            time.sleep(0.1)
        ended = self.view().lease != lease
        return ended, f"the lease {'ended' if ended else 'was kept alive'}"

    def _unsigned_request(self, _bench: Bench) -> tuple[bool, str]:
        client = self.node.create_client(srv.RequestControl, "request_control")
        while not client.service_is_ready():
            time.sleep(0.05)
        time.sleep(0.5)
        answer = self.answer(client.call_async(srv.RequestControl.Request(controller="nobody")))
        return (answer.permission, answer.lease) == (0, 0), f"permission {answer.permission}"

    def _stamps(self, bench: Bench) -> tuple[bool, str]:
        lease = bench.take(bench.one())
        now = self.node.get_clock().now().nanoseconds // 10**9
        for sequence, stamp in ((1, now - 3600), (2, now + 3600)):
            command = _command(lease, sequence, Point(valid_for=0.4))
            command.header.stamp.sec = stamp
            self.peer(0).publish(self.peer(0).sealed(command))
        held = bench.until(lambda: self.view().mode == msg.RigCommand.HOLD, bench.heartbeat_s)
        return held, f"mode {self.view().mode}"

    def _grants_nothing(self, bench: Bench) -> tuple[bool, str]:
        done = bench.person.grant(4_000_000_000)
        return not done and self.view().lease == 0, "done" if done else "refused"

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        self._context.try_shutdown()
        self._thread.join(timeout=5.0)


class RosPeer:
    """Controller that signs its messages with its own key."""

    def __init__(self, interface: RosConformance, name: str) -> None:
        self._interface = interface
        self._controller = Controller(interface.node, name)

    @property
    def ready(self) -> bool:
        """Whether the authority is available."""
        return self._controller.ready

    def sealed(self, command: Any) -> Any:
        """Return a sealed command without sending it."""
        return self._controller.sealed(command)

    def publish(self, sealed: Any) -> None:
        """Send a sealed command unchanged."""
        self._controller.publish(copy.deepcopy(sealed))

    def ask(self, wish: Wish) -> ControlAnswer:
        """Request control; return the answer. NotPossibleError: the priority exceeds a byte; ValueError: no answer."""
        if not 0 <= wish.priority <= 255:
            raise NotPossibleError("a priority over ROS is at most 255")
        fields = {"priority": wish.priority, "wait": wish.wait, "duration": wish.duration}
        self._controller.name = wish.name
        limits = {"speed_limit": wish.speed, "left_speed_limit": wish.left_speed}
        answer = self._interface.answer(self._controller.ask(**fields, **limits))
        return ControlAnswer(answer.permission, answer.lease, answer.message)

    def send(self, lease: int, sequence: int, point: Point) -> bool:
        """Send a set-point; return whether it is in force within `_SEEN_S`. True for a heartbeat (sequence 0)."""
        self.publish(self.sealed(_command(lease, sequence, point)))
        if sequence == 0:
            return True
        before = self._interface.state
        end = time.monotonic() + _SEEN_S
        while time.monotonic() < end:
            state = self._interface.state
            if state.lease == lease and state.sequence == sequence != before.sequence:
                return True
            if state.refusal and state.refusal != before.refusal:
                return False
            time.sleep(0.01)
        return False

    def release(self, lease: int) -> bool:
        """Give a lease back; return whether this was accepted."""
        self._controller.lease = lease
        return bool(self._interface.answer(self._controller.release("conformance")).success)


def _command(lease: int, sequence: int, point: Point) -> Any:
    return msg.RigCommand(
        mode=int(point.mode),
        lease=lease,
        sequence=sequence,
        rotary_speed=float(point.speed),
        turn=float(point.turn),
        flow_rate=float(point.flow),
        valid_for=float(point.valid_for),
    )
