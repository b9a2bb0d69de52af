# SPDX-License-Identifier: Apache-2.0
"""
What the live chain costs: sonde, estimator and surface with recorder, against the same chain as plain rclpy.

    python tests/benchmarks/bench_live.py [--seconds 20]

Both carry two inertial units at 1 kHz, the magnetometer and the truth, run the same estimator and record everything.
The plain chain is what a first version would be: typed messages, the stock executor, a callback for each message, the
`mcap` library's writer. Processor time is that of all processes and threads; latency is from a sample's publication to
the arrival of its attitude, both by the middleware's own times. Absolute figures belong to the machine.

Then a unit of 5 kHz in bursts, and the pace of a replay. Prints Markdown.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import running_graph
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan, simulate
from running_graph import PLACE, until

HERE = Path(__file__).resolve().parent
SCENARIO = """
name: live
seed: 5
rate_hz: {rate_hz}
kinematics_hz: {kinematics_hz}
place: {{latitude_deg: 38.3, longitude_deg: 109.6}}
well: {{stations: [[0.0, 30.0, 40.0], [60.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}}
schedule: [{{kind: drill, seconds: {seconds}, rpm: 120.0, rop_m_h: 20.0}}]
vibration: {{random: [{{band_hz: [8.0, 300.0], acceleration_mps2: [6.0, 12.0, 12.0], when: drilling}}]}}
ahrs: {{changes: {{adc_hz: {adc_hz}}}}}
precision: {{grade: tactical_north, changes: {{adc_hz: {adc_hz}}}}}
interference: {{axial_nt: 2500.0}}
"""
RATE_HZ, BURST_HZ, BURST, REPLAY_HZ = 1000, 5000, 10, 100
STREAMS = ("imu/data_raw", "gyro/data_raw", "imu/mag", "attitude")
PACES = (1.0, 2.0, 10.0)
_WARM_S = 5.0


@dataclasses.dataclass(frozen=True)
class Received:
    """A stream as a listener of its own process had it: stamps, times of sending and of arrival, shape (n,), ns."""

    stamp_ns: NDArray[np.int64]
    sent_ns: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]

    @property
    def missing_share(self) -> float:
        """How much of a kilohertz is not there between the first and the last."""
        gone = absent(self.stamp_ns, RATE_HZ)
        return gone / (gone + len(self.stamp_ns))


@dataclasses.dataclass(frozen=True)
class Result:
    """Figures of one chain of nodes."""

    cores: dict[str, float]  #: processor cores used by each process
    samples: float = 0.0  #: samples received per second
    attitudes: float = 0.0  #: attitudes received per second
    #: Missing samples and attitudes, in per cent of those between the first and the last.
    missing: tuple[float, float] = (0.0, 0.0)
    latency_ms: tuple[float, float] = (0.0, 0.0)  #: median and 99th percentile
    #: For each stream: number of recorded messages, and of those missing between them.
    recorded: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    @property
    def total(self) -> float:
        """Cores in all."""
        return sum(self.cores.values())


def scenario(rate_hz: int, seconds: float) -> str:
    """Drilling for so long, sampled at that rate; a fast unit needs a fast converter and finer kinematics."""
    adc_hz = max(rate_hz, 1000)
    return SCENARIO.format(rate_hz=rate_hz, adc_hz=adc_hz, kinematics_hz=2 * adc_hz, seconds=seconds)


def absent(stamps: NDArray[np.int64], rate_hz: float) -> int:
    """How many of a steady rate are not there between the first stamp, ns, and the last."""
    return round(float(np.ptp(stamps)) * 1e-9 * rate_hz) + 1 - len(np.unique(stamps))


def cpu_seconds(pid: int) -> float:
    """Processor time of a process and all its threads, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def cores(processes: dict[str, subprocess.Popen[bytes]], seconds: float) -> dict[str, float]:
    """Cores each of them uses over that time."""
    before, began = {name: cpu_seconds(one.pid) for name, one in processes.items()}, time.monotonic()
    time.sleep(seconds)
    spent = time.monotonic() - began
    return {name: (cpu_seconds(one.pid) - before[name]) / spent for name, one in processes.items()}


# A listener of its own process: it counts from when it receives every stream, for discovery finds one after the other.
LISTENER = """
import json, struct, sys, time, rclpy
from sensor_msgs.msg import Imu
from mwd_msgs.msg import Attitude
from mwd_sensors.ros.qos import STREAM, buffered
rclpy.init(); node = rclpy.create_node("bench")
kinds, qos = {"imu/data_raw": Imu, "attitude": Attitude}, buffered(STREAM)
readers = {name: node.create_subscription(kinds[name], "/w1/" + name, print, qos, raw=True) for name in sys.argv[2:]}
received, end = {name: [] for name in readers}, None
while end is None or time.monotonic() < end:
    time.sleep(0.02)
    for name, reader in readers.items():
        with reader.handle:
            while (found := reader.handle.take_message(reader.msg_type, True)) is not None:
                sec, nanosec = struct.unpack_from("<iI", found[0], 4)
                times = found[1]["source_timestamp"], found[1]["received_timestamp"]
                received[name].append((sec * 10**9 + nanosec, *times))
    if end is None and all(received.values()):
        received, end = {name: [] for name in readers}, time.monotonic() + float(sys.argv[1])
print(json.dumps(received))
"""


@contextlib.contextmanager
def listening(environment: dict[str, str], seconds: float, *topics: str) -> Iterator[dict[str, Received]]:
    """Listen so long from when every topic has arrived; what arrived is there at the end of the block."""
    received: dict[str, Received] = {}
    words = [sys.executable, "-c", LISTENER, str(seconds), *topics]
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as listener:
        try:
            yield received
            out = listener.communicate(timeout=300.0 + seconds)[0]
        finally:
            listener.kill()
    for name, rows in json.loads(out.splitlines()[-1]).items():
        received[name] = Received(*np.array(rows, dtype=np.int64).T)


@contextlib.contextmanager
def chain(folder: Path, rate_hz: int, **sonde: Any) -> Iterator[running_graph.Graph]:
    """The graph as it is, recording, its scenario under way; the sonde with these parameters."""
    (folder / "live.yaml").write_text(scenario(rate_hz, 600.0))
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", folder=folder / "data", page__port=0, record__name="run")
        estimator = graph.start("estimator", "w1", **{key.replace(".", "__"): value for key, value in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 300, f"{name} is active")
        source = graph.start("sonde", "w1", scenario=folder / "live.yaml", wait_for_listener_s=60.0, **sonde)
        until(lambda: "scenario live" in graph.log(source), 120, "the scenario begins")
        yield graph
        for name in (source, estimator, surface):
            graph.end(name)


def ours(folder: Path, seconds: float) -> Result:
    """The graph at 1 kHz."""
    with chain(folder, RATE_HZ) as graph:
        found = _measured(graph, seconds)
    return dataclasses.replace(found, recorded=recorded(folder, RATE_HZ, STREAMS))


def one_process(folder: Path, seconds: float) -> Result:
    """The graph at 1 kHz, its three nodes in one process."""
    (folder / "live.yaml").write_text(scenario(RATE_HZ, 600.0))
    parameters: dict[str, dict[str, Any]] = {
        "surface": {"folder": str(folder / "data"), "page.port": 0, "record.name": "run"},
        "estimator": PLACE,
        "sonde": {"scenario": str(folder / "live.yaml"), "wait_for_listener_s": 60.0},
    }
    (folder / "parameters.yaml").write_text(launch_plan.parameter_yaml(parameters, "w1"))
    with running_graph.graph(folder) as graph:
        well = graph.start("well", "w1", arguments=["--params-file", str(folder / "parameters.yaml")])
        until(lambda: "scenario live" in graph.log(well), 300, "the scenario begins")
        found = _measured(graph, seconds)
        graph.end(well)
    return dataclasses.replace(found, recorded=recorded(folder, RATE_HZ, STREAMS))


def in_bursts(folder: Path, seconds: float) -> Result:
    """The graph at 5 kHz, inertial samples in bursts, the magnetometer at 100 Hz."""
    with chain(folder, BURST_HZ, burst=BURST, thin=BURST_HZ // 100) as graph:
        time.sleep(_WARM_S)
        used = cores(graph.running, seconds)
    return Result(used, recorded=recorded(folder, BURST_HZ, ("imu/burst", "gyro/burst")))


def recorded(folder: Path, rate_hz: int, streams: tuple[str, ...]) -> dict[str, tuple[int, int]]:
    """Samples of each stream in the recording, and how many are missing between them by their stamps."""
    found = {}
    (file,) = folder.rglob("*.mcap")
    with Bag(file) as bag:
        for topic in (f"/w1/{name}" for name in streams):
            stamps = np.concatenate([block[topic][1]["stamp_ns"] for block in bag.blocks([topic])])
            found[topic] = len(stamps), absent(stamps, rate_hz)
    return found


def plain(folder: Path, seconds: float) -> Result:
    """The same work by typed messages, a callback each, on the stock executor."""
    (folder / "live.yaml").write_text(scenario(RATE_HZ, 600.0))
    with running_graph.graph(folder) as graph:
        for role in ("recorder", "estimator", "source"):
            words = [sys.executable, str(HERE / "plain_chain.py"), role, str(folder / "live.yaml")]
            with (folder / f"{role}.log").open("wb") as log:
                graph.running[role] = subprocess.Popen(
                    words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder
                )
            until(lambda role=role: b"ready" in (folder / f"{role}.log").read_bytes(), 300, f"{role} is ready")
        return _measured(graph, seconds)


def _measured(graph: running_graph.Graph, seconds: float) -> Result:
    time.sleep(_WARM_S)
    used = cores(graph.running, seconds)
    listened = min(seconds, 10.0)
    with listening(graph.environment, listened, "imu/data_raw", "attitude") as received:
        pass
    imu, attitude = received["imu/data_raw"], received["attitude"]
    _, sent, arrived = np.intersect1d(imu.stamp_ns, attitude.stamp_ns, return_indices=True)
    latency_ms = (attitude.arrived_ns[arrived] - imu.sent_ns[sent]) * 1e-6
    p50, p99 = np.percentile(latency_ms, [50.0, 99.0])
    return Result(
        used,
        len(imu.stamp_ns) / listened,
        len(attitude.stamp_ns) / listened,
        (100.0 * imu.missing_share, 100.0 * attitude.missing_share),
        (float(p50), float(p99)),
    )


def replayed(folder: Path, rate: float, seconds: float) -> tuple[float, float, int]:
    """
    A recording at 100 Hz of both units, published again at that rate.

    Returns the error of its pace, in per cent, how late the worst message of a hundred was against it, ms, and how many
    samples are missing. Pace and lateness are from the times of publication; an even pace is what counts, so the most
    punctual message is the one that nobody is early against.
    """
    bag = folder / "bag"
    if not bag.exists():
        (folder / "replay.yaml").write_text(scenario(REPLAY_HZ, (seconds + 5.0) * max(PACES)))
        simulate.record(read(folder / "replay.yaml"), bag, "w1")
    with running_graph.graph(folder) as graph:
        words = [sys.executable, "-P", "-m", "mwd_surface.cli", "replay", str(bag), "--rate", str(rate), "--wait", "60"]
        with (
            listening(graph.environment, seconds, "imu/data_raw") as received,
            (folder / "replay.log").open("wb") as log,
        ):
            graph.running["replay"] = subprocess.Popen(
                words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
    imu = received["imu/data_raw"]
    wall_s, run_s = ((times - times[0]) * 1e-9 for times in (imu.sent_ns, imu.stamp_ns))
    late_s = wall_s - run_s / rate
    error = float(run_s[-1] / wall_s[-1]) / rate - 1.0
    return 100.0 * error, 1e3 * float(np.percentile(late_s - late_s.min(), 99.0)), absent(imu.stamp_ns, REPLAY_HZ)


def chains(ours_: Result, plain_: Result, single_: Result) -> list[str]:
    """What each chain costs and loses."""
    head = f"Two units, magnetometer and truth at {RATE_HZ} Hz, estimator, recorder; {load()}."
    text = [head, "", "| | cores | of them | sample to attitude, p50 / p99 | received a second | missing |"]
    text.append("|---|---|---|---|---|---|")
    for name, one in (("ours", ours_), ("ours in one process", single_), ("plain rclpy", plain_)):
        parts = ", ".join(f"{who.rpartition('/')[2]} {share:.2f}" for who, share in one.cores.items())
        p50, p99 = one.latency_ms
        text.append(
            f"| {name} | {one.total:.2f} | {parts} | {p50:.1f} / {p99:.1f} ms | {one.samples:.0f} samples, "
            f"{one.attitudes:.0f} attitudes | {one.missing[0]:.1f} %, {one.missing[1]:.1f} % |"
        )
    # A chain that cannot keep up uses what it gets and loses the rest: what counts is the work done.
    costs = [one.total / max(one.attitudes, 1.0) for one in (ours_, plain_)]
    return [
        *text,
        "",
        f"Processor time for an attitude that arrived, plain to ours: {costs[1] / costs[0]:.1f}.",
        f"Recorded by ours: {kept(ours_)}.",
    ]


def bursts(one: Result) -> list[str]:
    """What a fast unit costs, and what of it is recorded."""
    parts = ", ".join(f"{who.rpartition('/')[2]} {share:.2f}" for who, share in one.cores.items())
    head = f"Two units at {BURST_HZ} Hz in bursts of {BURST}, magnetometer at 100 Hz, estimator, recorder; {load()}."
    return [head, "", f"{one.total:.2f} cores ({parts}). Recorded: {kept(one)}."]


def kept(one: Result) -> str:
    """Messages recorded, and missing, of each stream."""
    return ", ".join(f"{topic} {count} (missing {gone})" for topic, (count, gone) in one.recorded.items())


def load() -> str:
    """How busy the machine is."""
    return f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def main(seconds: float) -> None:
    """Measure and print."""
    found = {}
    for name, measure in (("ours", ours), ("plain", plain), ("single", one_process)):
        with tempfile.TemporaryDirectory() as one:
            found[name] = measure(Path(one), seconds)
    print("\n".join(chains(**{f"{name}_": one for name, one in found.items()})), end="\n\n", flush=True)
    with tempfile.TemporaryDirectory() as one:
        print("\n".join(bursts(in_bursts(Path(one), seconds))), end="\n\n", flush=True)
    print(f"| `mwd replay` of two units at {REPLAY_HZ} Hz | error of pace | 99 % no later than | missing |")
    print("|---|---|---|---|")
    with tempfile.TemporaryDirectory() as one:
        for rate in PACES:
            error, late_ms, gone = replayed(Path(one), rate, seconds)
            print(f"| {rate:g} x | {error:+.4f} % | {late_ms:.1f} ms | {gone} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    main(parser.parse_args().seconds)
