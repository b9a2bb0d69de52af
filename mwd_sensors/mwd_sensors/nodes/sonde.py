# SPDX-License-Identifier: Apache-2.0
"""Node of the simulated sonde: publish the sensor topics of a scenario, in wall time, simulated time, or faster."""

from __future__ import annotations

import csv
import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mwd_msgs.msg import ControlState, RigAcknowledge, RigCommand
from mwd_msgs.srv import InjectFault
from sensor_msgs.msg import JointState

from mwd_sensors.core import burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import contents_hidden, printable
from mwd_sensors.core.process_starts import starts_before
from mwd_sensors.core.settings import from_mapping, setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.nodes.telemetry import TelemetryTopics
from mwd_sensors.ros import qos
from mwd_sensors.ros.deferred import answering
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.discovery import SubscriberDiscovery
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import message_type
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.ros.time_stamps import header
from mwd_sensors.simulator import scenario_files, steering
from mwd_sensors.simulator.faults import Fault
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde

# Length of a block that is simulated at a time: 0.1 s of the clock, at most 1 s of the scenario. With a rig that obeys
# commands it is 0.1 s of the scenario, because a command acts on the next block.
_BLOCK_S, _MOST_BLOCK_S = 0.1, 1.0
_TIMER_PERIOD = 0.005  # time between two timer callbacks, s
_CALL_S = 0.05  # longest time of one timer callback, s, not counting the last simulated block
_MOST_BEHIND_S = 1.0  # longest lag that the simulation catches up, s of wall time; a longer lag is skipped
_SET_BACK_S = 1.0  # a step back of simulated time, s, after which the scenario starts again (`time_jumps.BACK_NS`)
# Largest number of messages that one timer callback publishes: more messages at once, after a delay, would overrun the
# middleware's queues.
_MAX_PER_CALLBACK = 100
# At equal stamps the AHRS comes last, so that the other samples that the estimator needs are already published.
_ORDER = (
    *("rig/state", "imu/temperature", wire.GAMMA_TOPIC, wire.STATUS_TOPIC),
    *("gyro/data_raw", "imu/mag", "truth", "imu/data_raw"),
)

_NO_SAMPLES = wire.TRUTH.empty(0)
_THINNED = ("imu/mag", "truth")  # topics to which the parameter `thin` applies
_BURST_TOPIC = {single: name for name, single in burst.TOPICS.items()}


@dataclasses.dataclass(frozen=True)
class SondeSettings:
    """Parameters of the sonde node."""

    scenario: str = setting("default", "Scenario to run: a name from bags/scenarios or the path of a YAML file.")
    seed: int = setting(-1, "Seed of all random numbers. -1 uses the seed of the scenario.", low=-1, high=2**31 - 1)
    rate: float = setting(
        1.0,
        "Seconds of the scenario per second of wall time; 0 runs as fast as possible. Subscribers lose samples if "
        "they cannot follow the rate.",
        low=0.0,
        high=1000.0,
    )
    wait_for_listener_s: float = setting(
        0.0, "Longest wait for subscribers before the scenario starts; 0 starts at once.", low=0.0, high=600.0
    )
    wait_for_node: str = setting(
        "",
        "Name of a node that must subscribe before the scenario starts, without a time limit. Use it for a node "
        "that first compiles its filters and would miss the start. Empty: only wait_for_listener_s applies.",
    )
    exit_at_end: bool = setting(False, "End the process when the scenario is over.")
    burst: int = setting(
        0,
        "Number of samples in one message of imu/burst and gyro/burst, which then replace imu/data_raw and "
        "gyro/data_raw. 0 sends one message per sample. Raise it for units beyond 1 kHz: larger bursts cost less "
        "computing time, but arrive later.",
        low=0,
        high=burst.MOST,
    )
    thin: int = setting(
        1,
        "Publish only every n-th sample of magnetometer and truth. Raise it for units beyond 1 kHz.",
        low=1,
        high=1000,
    )
    fault_injection: bool = setting(
        False, "Allow the service inject_fault, which injects faults into the sensors of the running sonde."
    )
    truth_file: str = setting(
        "",
        "CSV file for the truth, one row per second of the scenario, for runs where the surface receives only the "
        "telemetry link. Empty writes no file.",
    )


class SondeNode(GraphNode[SondeSettings]):
    """
    Node of the simulated sonde, which publishes the topics of `wire.SONDE_TOPICS`.

    The stamps begin at the time of the node at the start of the scenario. With `use_sim_time` the scenario follows
    `/clock`: it runs as fast, stops while the clock stops, and starts again if the clock goes back by more than a
    second.
    """

    changeable = ("fault_injection",)

    def __init__(self, **node_options: Any) -> None:
        super().__init__("sonde", SondeSettings(), **node_options)
        self._published = dict.fromkeys(_ORDER, 0)
        self._starts = starts_before(os.environ)
        self._sonde: Sonde | None = None
        self._telemetry: TelemetryTopics | None = None
        self._truth_file: TruthFile | None = None
        self._finished = False

    def configure(self) -> None:
        """Read the scenario and create topics, service and timer; raise SettingsError if the file is not valid."""
        changes = {} if self.settings.seed < 0 else {"seed": self.settings.seed}
        file = scenario_files.find(self.settings.scenario)
        with contents_hidden(file, "`mwd simulate`"):
            self._scenario = read(file, changes)
        # Compile the simulator now, so that the scenario does not start late.
        example = Sonde(self._scenario)
        next(example.blocks(_BLOCK_S))
        types = {topic: example.topics[topic].type_name for topic in _ORDER if topic in example.topics}
        if self.settings.burst:
            types |= dict.fromkeys(burst.TOPICS, burst.TYPE_NAME)
        self._topic_publishers = {
            topic: self.add_publisher(message_type(name), topic, qos.EVENT if topic == "rig/state" else qos.STREAM)
            for topic, name in types.items()
        }
        self.add_service(InjectFault, "inject_fault", self._inject_fault)
        self._rig_commands = SimulatedRigCommands(self, lambda: self._sonde, self.settings.rate)
        if self._scenario.steering is not None:
            self._quill = self.add_publisher(JointState, "rig/quill", qos.STATE)
        self._telemetry = None
        if self._scenario.telemetry is not None:
            self._telemetry = TelemetryTopics(self, self._scenario.telemetry, self.settings.rate)
        self._truth_file = TruthFile(Path(self.settings.truth_file)) if self.settings.truth_file else None
        self.add_timer(_TIMER_PERIOD, self._on_timer)

    def cleanup(self) -> None:
        """Close the truth file."""
        if self._truth_file is not None:
            self._truth_file.close()

    def activate(self) -> None:
        """Start the scenario from its beginning, once subscribers have been found."""
        self._sonde = None
        self._finished = False
        self._finished_at = 0.0
        self._discovery = SubscriberDiscovery(time.monotonic(), self.settings.wait_for_listener_s)

    def _start(self) -> Sonde:
        # Each start has other noise. The estimator would reject samples with the noise of an earlier start as messages
        # that were sent twice.
        sonde = self._sonde = Sonde(self._scenario, self.get_clock().now().nanoseconds, self._starts)
        self._starts += 1
        pace = 1.0 if sonde.string is not None else max(self.settings.rate, 1.0)
        self._block_s = min(_BLOCK_S * pace, _MOST_BLOCK_S)
        self._blocks: Iterator[dict[str, Samples]] = sonde.blocks(self._block_s)
        self._all_simulated = False
        self._simulated_until = 0.0
        self._sample_counts = dict.fromkeys(_THINNED, 0)
        self._pending: list[tuple[float, int, str, bytes]] = []
        self._started_at = self._latest = self._now()
        self._dropped_s = 0.0
        if self._telemetry is not None:
            self._telemetry.start(sonde)
        self.get_logger().info(
            printable(f"scenario {self._scenario.name}: {sonde.duration:.0f} s, field {sonde.reference.source}")
        )
        return sonde

    def _now(self) -> float:
        """Return the time that the scenario follows, s: simulated time with `use_sim_time`, otherwise steady time."""
        if self.get_parameter("use_sim_time").value:
            return float(1e-9 * self.get_clock().now().nanoseconds)
        return time.monotonic()

    def _awaits_node(self) -> bool:
        wanted = self.settings.wait_for_node
        readers = (
            reader.node_name
            for publisher in self._topic_publishers.values()
            for reader in self.get_subscriptions_info_by_topic(publisher.topic_name)
        )
        return bool(wanted) and wanted not in readers

    def _on_timer(self) -> None:
        sonde = self._sonde
        if sonde is None:
            if self._awaits_node() or not self._discovery.complete(self._topic_publishers.values(), time.monotonic()):
                return
            if self.get_clock().now().nanoseconds == 0:
                # Simulated time without a clock message yet: wait, so that no sample is stamped with 1970.
                return
            sonde = self._start()
        now = self._now()
        if now < self._latest - _SET_BACK_S:
            self.get_logger().warning("time went back: the scenario starts again")
            self._sonde, self._finished = None, False
            return
        self._latest = max(self._latest, now)
        if self._finished:
            drained = self._telemetry is None or self._telemetry.drained(time.monotonic() - self._finished_at)
            if self.settings.exit_at_end and drained:
                self.request_stop()
            return
        rate = self.settings.rate
        elapsed = now - self._started_at
        until = elapsed * rate if rate > 0.0 else self._simulated_until + self._block_s
        if rate > 0.0 and until - self._simulated_until > _MOST_BEHIND_S * max(rate, 1.0):
            # Do not try to catch up: shift the start of the scenario by the backlog.
            dropped = until - self._simulated_until
            self._dropped_s += dropped / rate
            self._started_at += dropped / rate
            until = self._simulated_until
            self.get_logger().warning(
                printable(
                    f"this machine cannot simulate at rate {rate:g}: {self._dropped_s:.0f} s behind the clock so far"
                ),
                throttle_duration_sec=10.0,
            )
        # Simulate for a limited time, so that requests are answered even if the simulation is slow. Do not simulate
        # while messages of earlier blocks are overdue: the backlog would grow as long as publishing is slow.
        enough = time.monotonic() + _CALL_S
        overdue = bool(self._pending) and self._pending[0][0] <= until
        while not (self._all_simulated or overdue) and self._simulated_until <= until:
            self._simulate_block(sonde)
            if time.monotonic() > enough:
                break
        self._publish_due(until)
        if self._telemetry is not None:
            self._telemetry.publish(min(until, self._simulated_until))
        if self._all_simulated and not self._pending:
            self._finished, self._finished_at = True, time.monotonic()
            self.get_logger().info("scenario is over")

    def _publish_due(self, until: float) -> None:
        count = 0
        for due, _, topic, message in self._pending[:_MAX_PER_CALLBACK]:
            if due > until:
                break
            self._topic_publishers[topic].publish(message)
            self._published[topic] = self._published.get(topic, 0) + 1
            count += 1
        del self._pending[:count]

    def _simulate_block(self, sonde: Sonde) -> None:
        block = next(self._blocks, None)
        if block is None:
            self._all_simulated = True
            return
        if self._truth_file is not None:
            self._truth_file.take(block["truth"])
        for order, topic in enumerate(_ORDER):
            samples = self._thinned(topic, block.get(topic, _NO_SAMPLES))
            if len(samples):
                self._pending += self._messages(sonde, order, topic, samples)
        self._pending.sort(key=lambda item: item[:2])
        self._simulated_until += self._block_s
        if sonde.string is not None:
            self._publish_quill(sonde, sonde.string.quill)

    def _publish_quill(self, sonde: Sonde, angle: float) -> None:
        about = header(sonde.stamp_ns(self._simulated_until, of_tool=False))
        self._quill.publish(JointState(header=about, name=["quill"], position=[angle]))

    def _thinned(self, topic: str, samples: Samples) -> Samples:
        """Return every n-th sample counted from the start of the scenario, independent of the block boundaries."""
        if topic not in _THINNED:
            return samples
        first = -self._sample_counts[topic] % self.settings.thin
        self._sample_counts[topic] += len(samples)
        return samples[first :: self.settings.thin]

    def _messages(self, sonde: Sonde, order: int, topic: str, samples: Samples) -> list[tuple[float, int, str, bytes]]:
        """Return (due time in s after the start, rank of the topic, topic, message) for the messages of one topic."""
        frame = self.frame(wire.RIG_FRAME if topic == "rig/state" else wire.SONDE_FRAME)
        dues = (samples["stamp_ns"] - sonde.epoch_ns) * 1e-9
        if not self.settings.burst or topic not in _BURST_TOPIC:
            rows = sonde.topics[topic].encode(samples, frame)
            return [(float(due), order, topic, row.tobytes()) for due, row in zip(dues, rows, strict=True)]
        return [
            (float(dues[part][-1]), order, _BURST_TOPIC[topic], burst.encode(samples[part], frame))
            for part in burst.parts(samples, self.settings.burst)
        ]

    @answering
    def _inject_fault(self, request: Any, _response: Any) -> str:
        if not self.settings.fault_injection:
            raise ValueError("fault injection is off; set the parameter fault_injection to true")
        if self._sonde is None:
            raise ValueError("the scenario has not started")
        fault = {"component": request.component, "fault": request.fault, "axis": request.axis or "all"}
        if request.duration != 0.0:
            fault["seconds"] = request.duration
        self._sonde.inject(from_mapping(Fault, fault))
        until = f"for {request.duration:g} s" if request.duration > 0.0 else "from now on"
        message = f"{request.component} {request.fault} {until}"
        self.get_logger().warning(printable(f"fault injected: {message}"))
        return message

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the progress of the scenario, and the state of rig commands and telemetry link if there are any."""
        link = self._telemetry.diagnostics() if self._telemetry is not None else []
        return (self._progress_diagnostic(), *self._rig_commands.diagnostics(), *link)

    def _progress_diagnostic(self) -> Diagnostic:
        values = tuple((topic, str(count)) for topic, count in self._published.items())
        if self._sonde is None:
            wanted = self.settings.wait_for_node
            remedy = f"start {wanted}, or wait until it is active" if wanted else "start the estimator"
            return Diagnostic("scenario", WARN, f"waiting for {wanted or 'a listener'}", remedy, values)
        if self._finished:
            return Diagnostic("scenario", OK, "over", values=(*values, wire.OVER))
        elapsed, rate = self._dropped_s + self._now() - self._started_at, self.settings.rate
        if rate > 0.0 and (behind := elapsed - self._simulated_until / rate) > 1.0:
            remedy = "lower the rate, or end other programs on this machine"
            return Diagnostic("scenario", WARN, f"{behind:.1f} s behind the clock", remedy, values)
        message = f"{self._simulated_until:.0f} of {self._sonde.duration:.0f} s"
        return Diagnostic("scenario", OK, message, values=values)


def main(args: Sequence[str] | None = None) -> int:
    """Run the sonde node."""
    return run_node(SondeNode, args)


# Write the truth of a simulation to a small file, for scoring when the surface receives only the tool's telemetry link.


HEADER = ("stamp_ns", "inclination_rad", "azimuth_true_rad", "gravity_toolface_rad", "measured_depth_m")


class TruthFile:
    """
    CSV file of the true attitude and depth, with one row for each second of the simulation.

    Parameters
    ----------
    path : Path
        File to write; an existing file is replaced.

    Raises
    ------
    OSError
        The file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="utf-8", newline="")
        self._table = csv.writer(self._file, lineterminator="\n")
        self._table.writerow(HEADER)
        self._second = -1

    def take(self, samples: Samples) -> None:
        """Write the first sample of `wire.TRUTH` in each second."""
        for k, second in enumerate((samples["stamp_ns"] // NANOSECONDS).tolist()):
            if second != self._second:
                self._second = second
                row = samples[k]
                names = ("inclination", "azimuth", "gravity_toolface", "measured_depth")
                self._table.writerow((int(row["stamp_ns"]), *(f"{float(row[name]):.9g}" for name in names)))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


# Simulated rig: carry out each rig/command of the newest lease once, and acknowledge it.


_WORDS = {steering.HOLD: "holding", steering.ROTATE: "rotating", steering.ORIENT: "turning to an angle"}


class SimulatedRigCommands:
    """
    Carries out the commands of the control authority on the simulated rig.

    Parameters
    ----------
    node : GraphNode
        Node of the simulated tool and rig.
    sonde : callable
        Returns the simulation, or None before the scenario has started.
    rate : float
        Seconds of the scenario per second of wall time; the validity of a command is in wall time of the sender.
    """

    def __init__(self, node: GraphNode[Any], sonde: Callable[[], Sonde | None], rate: float = 1.0) -> None:
        self._node, self._sonde, self._rate = node, sonde, rate if rate > 0.0 else 1.0
        self._lease = self._obeyed = self._refused = 0
        self._numbers: dict[bool, int] = {}
        self._refusal = ""
        self._answers = node.add_publisher(RigAcknowledge, "rig/acknowledge", qos.STATE)
        node.add_subscription(RigCommand, "rig/command", self.obey, qos.STATE)
        node.add_subscription(ControlState, "control/state", self.on_control, qos.STATE)

    def obey(self, message: RigCommand) -> None:
        """
        Carry out a command or refuse it, and publish the acknowledgement, with the reason of a refusal.

        A repeated command (equal lease and sequence) is not acknowledged again.
        """
        pumps = message.mode == steering.PUMP
        repeated = message.lease == self._lease and self._numbers.get(pumps) == message.sequence
        try:
            self._command(message, repeated=repeated)
            self._refusal = ""
        except ValueError as error:
            self._refusal = str(error)
        else:
            self._lease, self._numbers[pumps] = message.lease, message.sequence
        if repeated:
            return
        if self._refusal:
            self._refused += 1
            self._node.get_logger().warning(
                printable(f"rig/command not obeyed: {self._refusal}"), throttle_duration_sec=5.0
            )
        else:
            self._obeyed += 1
        answer = RigAcknowledge(lease=message.lease, sequence=message.sequence, message=self._refusal)
        answer.obeyed = not self._refusal
        answer.header = header(self._node.get_clock().now().nanoseconds, self._node.frame(wire.RIG_FRAME))
        self._answers.publish(answer)

    def on_control(self, message: ControlState) -> None:
        """Apply the torque limit of the lease in force; without a lease only the top drive's own limit applies."""
        sonde = self._sonde()
        if sonde is not None and sonde.string is not None:
            sonde.string.limit_torque(message.torque_limit if message.lease else 0.0)

    def _command(self, message: RigCommand, *, repeated: bool) -> None:
        sonde = self._sonde()
        if sonde is None:
            raise ValueError("the scenario has not started")
        if message.lease < 1 or message.sequence < 1:
            raise ValueError("lease: the rig obeys only the control authority; request a lease with request_control")
        if message.lease < self._lease:
            raise ValueError(f"lease: {message.lease} has ended; {self._lease} is in force")
        valid_for = message.valid_for * self._rate
        command = steering.SteeringCommand(
            message.mode,
            message.rotary_speed,
            message.turn,
            valid_for,
            message.flow_rate,
            message.returns,
        )
        if repeated and message.mode == steering.ORIENT and sonde.string is not None:
            # A repeated turn command is not carried out again; it only extends the validity of the first.
            sonde.string.prolong(valid_for)
            return
        sonde.command(command)

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the state of the commanded rig, if any command was received."""
        if not self._obeyed + self._refused:
            return ()
        values = (("taken", str(self._obeyed)), ("refused", str(self._refused)))
        if self._refusal:
            remedy = "correct the command; the previous one stays in force until its validity ends"
            return (Diagnostic("rig command", WARN, self._refusal, remedy, values),)
        sonde = self._sonde()
        string = sonde.string if sonde is not None else None
        mode = string.obeys if string is not None else None
        return (Diagnostic("rig command", OK, _WORDS.get(mode, "") if mode is not None else "", values=values),)
