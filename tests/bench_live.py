"""
What the live chain costs: sonde, estimator and surface with recorder, against the same chain as plain rclpy.

    python tests/bench_live.py [--seconds 20] [--json FILE]

Both carry two inertial units at 1 kHz, the magnetometer and the truth, run the same estimator and record everything.
The plain chain is what a first version would be: typed messages, the stock executor, a callback for each message, the
`mcap` library's writer. Processor time is that of all processes and threads; latency is from a sample's publication to
the arrival of its attitude, both by the middleware's own times. Absolute figures belong to the machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import running_graph
from mwd_surface.bags.bag_reader import Bag
from running_graph import PLACE, until

HERE = Path(__file__).resolve().parent
RATE_HZ = 1000
SCENARIO = f"""
name: live
seed: 5
rate_hz: {RATE_HZ}
place: {{latitude_deg: 38.3, longitude_deg: 109.6}}
well: {{stations: [[0.0, 30.0, 40.0], [60.0, 36.0, 47.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}}
schedule: [{{kind: drill, seconds: 600.0, rpm: 120.0, rop_m_h: 20.0}}]
vibration: {{random: [{{band_hz: [8.0, 300.0], acceleration_mps2: [6.0, 12.0, 12.0], when: drilling}}]}}
precision: {{grade: tactical_north}}
interference: {{axial_nt: 2500.0}}
"""
_WARM_S = 5.0


@dataclasses.dataclass(frozen=True)
class Result:
    """Cores used by each process, samples heard and attitudes of them that arrived, latency ms; lost in recording."""

    cores: dict[str, float]
    published: int
    estimated: int
    latency_ms: tuple[float, float]
    recorded: dict[str, tuple[int, int]] = dataclasses.field(default_factory=dict)

    @property
    def total(self) -> float:
        """Cores in all."""
        return sum(self.cores.values())


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


# A listener of its own process: times of sending and arrival as the middleware gives them.
LISTENER = """
import json, sys, time, rclpy
from sensor_msgs.msg import Imu
from mwd_msgs.msg import Attitude
from mwd_sensors.nodes import profiles
rclpy.init(); node = rclpy.create_node("bench")
kinds = {"imu": (Imu, "/w1/imu/data_raw"), "attitude": (Attitude, "/w1/attitude")}
qos = profiles.deep(profiles.STREAM)
readers = {name: node.create_subscription(*about, print, qos, raw=True) for name, about in kinds.items()}
time.sleep(2.0)
sent, arrived, end = {}, {}, time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    time.sleep(0.02)
    for name, reader in readers.items():
        with reader.handle:
            while (found := reader.handle.take_message(reader.msg_type, True)) is not None:
                if name == "imu": sent[found[0][4:12]] = found[1]["source_timestamp"]
                else: arrived[found[0][4:12]] = found[1]["received_timestamp"]
print(json.dumps([len(sent), len(arrived), [(arrived[k] - sent[k]) * 1e-6 for k in arrived if k in sent]]))
"""


def listened(environment: dict[str, str], seconds: float) -> tuple[int, int, tuple[float, float]]:
    """Samples, attitudes, and the latency's median and 99th percentile, ms."""
    out = subprocess.run(
        [sys.executable, "-c", LISTENER, str(seconds)], env=environment, check=True, capture_output=True, text=True
    ).stdout
    sent, arrived, latency = json.loads(out.splitlines()[-1])
    p50, p99 = np.percentile(latency, [50.0, 99.0])
    return sent, arrived, (float(p50), float(p99))


def ours(folder: Path, seconds: float) -> Result:
    """The graph as it is."""
    (folder / "live.yaml").write_text(SCENARIO)
    with running_graph.graph(folder) as graph:
        surface = graph.start("surface", "w1", folder=folder / "data", page__port=0, record__name="run")
        estimator = graph.start("estimator", "w1", **{key.replace(".", "__"): value for key, value in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 300, f"{name} is active")
        sonde = graph.start("sonde", "w1", scenario=folder / "live.yaml", wait_for_listener_s=60.0)
        until(lambda: "scenario live" in graph.log(sonde), 120, "the scenario begins")
        found = _measured(graph.running, graph.environment, seconds)
    return dataclasses.replace(found, recorded=recorded(folder))


def recorded(folder: Path) -> dict[str, tuple[int, int]]:
    """Messages of each stream in the recording, and how many are missing between them by their stamps."""
    found = {}
    (file,) = folder.rglob("*.mcap")
    with Bag(file) as bag:
        for topic in ("/w1/imu/data_raw", "/w1/gyro/data_raw", "/w1/imu/mag", "/w1/attitude"):
            stamps = np.concatenate([block[topic][1]["stamp_ns"] for block in bag.blocks([topic])])
            found[topic] = len(stamps), round(float(np.ptp(stamps)) * 1e-9 * RATE_HZ) + 1 - len(stamps)
    return found


def plain(folder: Path, seconds: float) -> Result:
    """The same work by typed messages, a callback each, on the stock executor."""
    (folder / "live.yaml").write_text(SCENARIO)
    with running_graph.graph(folder) as graph:
        for role in ("recorder", "estimator", "source"):
            words = [sys.executable, str(HERE / "plain_chain.py"), role, str(folder / "live.yaml")]
            with (folder / f"{role}.log").open("wb") as log:
                graph.running[role] = subprocess.Popen(
                    words, env=graph.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder
                )
            until(lambda role=role: b"ready" in (folder / f"{role}.log").read_bytes(), 300, f"{role} is ready")
        return _measured(graph.running, graph.environment, seconds)


def _measured(processes: dict[str, subprocess.Popen[bytes]], environment: dict[str, str], seconds: float) -> Result:
    time.sleep(_WARM_S)
    used = cores(processes, seconds)
    published, estimated, latency = listened(environment, min(seconds, 10.0))
    return Result(used, published, estimated, latency)


def lines(ours_: Result, plain_: Result) -> list[str]:
    """The table as text."""
    load = f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    text = [f"Two units, magnetometer and truth at {RATE_HZ} Hz, estimator, recorder; {load}.", ""]
    for name, one in (("ours", ours_), ("plain rclpy", plain_)):
        parts = ", ".join(f"{who.rpartition('/')[2]} {share:.2f}" for who, share in one.cores.items())
        p50, p99 = one.latency_ms
        text.append(
            f"- {name}: {one.total:.2f} cores ({parts}); sample to attitude p50 {p50:.1f} ms, p99 {p99:.1f} ms; "
            f"a listener heard {one.estimated} attitudes and {one.published} samples"
        )
        if one.recorded:
            counts = ", ".join(f"{topic} {count} (missing {gone})" for topic, (count, gone) in one.recorded.items())
            text.append(f"- recorded by ours: {counts}")
    # A chain that cannot keep up uses what it gets and loses the rest: what counts is the work done.
    costs = [one.total / max(one.estimated, 1) for one in (ours_, plain_)]
    return [*text, f"- processor time for an attitude that arrived, plain to ours: {costs[1] / costs[0]:.1f}"]


def main(seconds: float = 20.0) -> tuple[list[str], dict[str, Any]]:
    """Measure both chains, one after the other."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        found = ours(Path(one), seconds), plain(Path(two), seconds)
    return lines(*found), {name: dataclasses.asdict(r) for name, r in zip(("ours", "plain"), found, strict=True)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    text, figures = main(options.seconds)
    print("\n".join(text))
    if options.json:
        options.json.write_text(json.dumps(figures))
