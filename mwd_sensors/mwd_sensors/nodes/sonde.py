"""The simulated sonde as a node: publishes what a scenario lets the sensors feel, at wall time or faster."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence
from typing import Any

from mwd_msgs.msg import ImuBurst, RigCommand, RigState, Truth
from mwd_msgs.srv import InjectFault
from sensor_msgs.msg import Imu, MagneticField, Temperature

from mwd_sensors.core import burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import from_mapping, setting
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.discovery import SubscriberDiscovery
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.simulator import scenario_files, steering
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde

_BLOCK_S = 0.1  # of the run, simulated at a time
_TICK_S = 0.005
_LAST_WAY_S = 0.5
_MOST_PER_TICK = 100  # after a stall: more at once overruns the queues of the middleware on a busy machine
_TYPES = {
    "imu/data_raw": Imu,
    "imu/mag": MagneticField,
    "gyro/data_raw": Imu,
    "imu/temperature": Temperature,
    "truth": Truth,
    "rig/state": RigState,
}
# At equal stamps the AHRS comes last: the other samples the estimator needs have then been published.
_ORDER = ("rig/state", "imu/temperature", "gyro/data_raw", "imu/mag", "truth", "imu/data_raw")

_OBEYED = {steering.HOLD: "holding", steering.ROTATE: "rotating", steering.ORIENT: "turning to an angle"}
_THINNED = ("imu/mag", "truth")
_IN_BURSTS = {single: name for name, single in burst.TOPICS.items()}


@dataclasses.dataclass(frozen=True)
class SondeSettings:
    """Parameters of the sonde node."""

    scenario: str = setting("default", "Scenario: a name from bags/scenarios or the path of a YAML file", fixed=True)
    seed: int = setting(-1, "Of every random number; -1: as the scenario says", low=-1, high=2**31 - 1, fixed=True)
    rate: float = setting(
        1.0, "Seconds of the run per second of wall time; 0: as fast as possible", low=0.0, high=1000.0, fixed=True
    )
    wait_for_listener_s: float = setting(
        0.0, "Wait up to so long for somebody to listen before starting", unit="s", low=0.0, high=600.0, fixed=True
    )
    exit_at_end: bool = setting(False, "End the process when the scenario is over", fixed=True)
    burst: int = setting(
        0,
        "Samples in one message on imu/burst and gyro/burst, in place of imu/data_raw and gyro/data_raw; 0: singly",
        low=0,
        high=burst.MOST,
        fixed=True,
    )
    thin: int = setting(
        1, "Publish every n-th sample of magnetometer and truth, for fast units", low=1, high=1000, fixed=True
    )
    fault_injection: bool = setting(False, "Allow the inject_fault service")


class SondeNode(GraphNode[SondeSettings]):
    """Publishes the topics of `wire.SONDE_TOPICS`; stamps start at the wall time of activation."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("sonde", SondeSettings(), **node_options)
        self._sent = dict.fromkeys(_ORDER, 0)
        self._sonde: Sonde | None = None
        self._finished = False

    def configure(self) -> None:
        """Read the scenario and open the topics."""
        changes = {} if self.settings.seed < 0 else {"seed": self.settings.seed}
        self._scenario = read(scenario_files.find(self.settings.scenario), changes)
        # Compiles the simulator, so that the run does not begin late.
        next(Sonde(self._scenario).blocks(_BLOCK_S))
        self._out = {
            topic: self.add_publisher(_TYPES[topic], topic, qos.EVENT if topic == "rig/state" else qos.STREAM)
            for topic in _ORDER
        }
        if self.settings.burst:
            self._out |= {topic: self.add_publisher(ImuBurst, topic, qos.STREAM) for topic in burst.TOPICS}
        self.add_service(InjectFault, "inject_fault", self._inject_fault)
        self.add_subscription(RigCommand, "rig/command", self._on_command, qos.STATE)
        self.add_timer(_TICK_S, self._tick)

    def activate(self) -> None:
        """Begin the scenario at its beginning."""
        self._sonde = None
        self._finished = False
        self._over_at = 0.0
        self._taken = self._not_taken = 0
        self._why_not = ""
        self._discovery = SubscriberDiscovery(time.monotonic(), self.settings.wait_for_listener_s)

    def _begin(self) -> None:
        self._sonde = Sonde(self._scenario, epoch_ns=self.get_clock().now().nanoseconds)
        self._blocks: Iterator[dict[str, Samples]] = self._sonde.blocks(_BLOCK_S)
        self._made_until = 0.0
        self._seen = dict.fromkeys(_THINNED, 0)
        self._pending: list[tuple[float, int, str, bytes]] = []
        self._started = time.monotonic()
        self.get_logger().info(
            f"scenario {self._scenario.name}: {self._sonde.duration:.0f} s, field {self._sonde.reference.source}"
        )

    def _tick(self) -> None:
        if self._sonde is None:
            if not self._discovery.complete(self._out.values(), time.monotonic()):
                return
            self._begin()
        if self._finished:
            # What was published last is still on its way.
            if self.settings.exit_at_end and time.monotonic() - self._over_at > _LAST_WAY_S:
                self.request_stop()
            return
        rate = self.settings.rate
        elapsed = time.monotonic() - self._started
        until = elapsed * rate if rate > 0.0 else self._made_until + _BLOCK_S
        while not self._finished and self._made_until <= until:
            self._make_block()
        count = 0
        for due, _, topic, message in self._pending[:_MOST_PER_TICK]:
            if due > until:
                break
            self._out[topic].publish(message)
            self._sent[topic] = self._sent.get(topic, 0) + 1
            count += 1
        del self._pending[:count]
        if self._finished and self._pending:
            self._finished = False
        elif self._finished:
            self._over_at = time.monotonic()
            self.get_logger().info("scenario is over")

    def _make_block(self) -> None:
        block = next(self._blocks, None)
        if block is None or self._sonde is None:
            self._finished = True
            return
        for order, topic in enumerate(_ORDER):
            samples = block[topic]
            if not len(samples):
                continue
            frame = wire.RIG_FRAME if topic == "rig/state" else wire.SONDE_FRAME
            if topic in _THINNED:
                # Every n-th of the whole run, wherever its blocks end.
                first = -self._seen[topic] % self.settings.thin
                self._seen[topic] += len(samples)
                samples = samples[first :: self.settings.thin]
            dues = (samples["stamp_ns"] - self._sonde.epoch_ns) * 1e-9
            if self.settings.burst and topic in _IN_BURSTS:
                for start in range(0, len(samples), self.settings.burst):
                    part = slice(start, start + self.settings.burst)
                    due = float(dues[part][-1])
                    self._pending.append((due, order, _IN_BURSTS[topic], burst.encode(samples[part], frame)))
                continue
            rows = wire.SONDE_TOPICS[topic].encode(samples, frame)
            self._pending += [(float(due), order, topic, row.tobytes()) for due, row in zip(dues, rows, strict=True)]
        self._pending.sort(key=lambda item: item[:2])
        self._made_until += _BLOCK_S

    def _on_command(self, message: RigCommand) -> None:
        command = steering.Command(message.mode, message.rotary_speed, message.turn, message.valid_for)
        try:
            if self._sonde is not None:
                self._sonde.command(command)
            self._why_not = "" if self._sonde is not None else "the scenario has not started"
        except ValueError as error:
            self._why_not = str(error)
        if self._why_not:
            self._not_taken += 1
            self.get_logger().warning(f"rig/command not obeyed: {self._why_not}", throttle_duration_sec=5.0)
        else:
            self._taken += 1

    def _inject_fault(self, request: InjectFault.Request, response: InjectFault.Response) -> InjectFault.Response:
        if not self.settings.fault_injection:
            response.success = False
            response.message = "fault injection is off; set the parameter fault_injection to true"
            return response
        if self._sonde is None:
            response.success, response.message = False, "the scenario has not started"
            return response
        asked = {"component": request.component, "fault": request.fault, "axis": request.axis or "all"}
        if request.duration > 0.0:
            asked["seconds"] = request.duration
        try:
            self._sonde.inject(from_mapping(Fault, asked))
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f"{request.component} {request.fault} from now on"
        self.get_logger().warning(f"fault injected: {response.message}")
        return response

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Progress and what was sent; commands, where any came."""
        return (*self._progress(), *self._commanded())

    def _commanded(self) -> Sequence[Diagnostic]:
        string = self._sonde.string if self._sonde is not None else None
        if not self._taken + self._not_taken:
            return ()
        values = (("taken", str(self._taken)), ("refused", str(self._not_taken)))
        if self._why_not:
            remedy = "mend the command; the one before stays in force until its time is over"
            return (Diagnostic("rig command", WARN, self._why_not, remedy, values),)
        obeyed = _OBEYED[string.obeys] if string is not None and string.obeys is not None else ""
        return (Diagnostic("rig command", OK, obeyed, values=values),)

    def _progress(self) -> Sequence[Diagnostic]:
        values = tuple((topic, str(count)) for topic, count in self._sent.items())
        if self._sonde is None:
            return (Diagnostic("scenario", WARN, "waiting for a listener", "start the estimator", values),)
        if self._finished:
            return (Diagnostic("scenario", OK, "over", values=values),)
        behind = (time.monotonic() - self._started) * self.settings.rate - self._made_until
        if self.settings.rate > 0.0 and behind > 1.0:
            remedy = "lower the rate, or free the machine"
            return (Diagnostic("scenario", ERROR, f"{behind:.1f} s behind", remedy, values),)
        message = f"{self._made_until:.0f} of {self._sonde.duration:.0f} s"
        return (Diagnostic("scenario", OK, message, values=values),)


def main(args: Sequence[str] | None = None) -> int:
    """Run the sonde node."""
    return run_node(SondeNode, args)
