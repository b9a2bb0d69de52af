# SPDX-License-Identifier: Apache-2.0
"""
Soak test: the whole graph at many times its pace, with clients of page and rig, while its nodes are killed in turn.

`make soak` runs it for an hour, `make soak MINUTES=10` for ten minutes, `make soak LOSS=0.3` over a network that loses
and reorders that share of the datagrams. It fails where memory, file handles or threads of a node grow, a survey is
listed twice or lost, a client stays without answers, or the recordings miss more of the time in which the graph was
whole than the kills may cost.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import itertools
import math
import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import soak_clients
from lossy_network import LossyNetwork
from mwd_estimation.nodes.warm_up import warm_up
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan
from mwd_surface.runs.supervise import Order, Supervisor
from mwd_surface.surveys.survey_store import decoded

RATE = 10.0
KILL_EVERY_S = 120.0
SETTLED_S = 120.0  # after a start a node loads and compiles, which takes memory once
GROWTH = 0.05
LOST_S = 2.0  # of wall time for each kill: what was received and not yet on the disk
AGAIN_S = 120.0  # within which a killed node is there again
SEEN_S = 5.0  # the page shows a stream as live for so long after its end
GAP_S = 1.0
LIVE = "live"
NODES = ("surface", "estimator", "sonde")
WELL = "soak"
# The pace of a fast rig; a cycle takes `CYCLE_S` of the tool's time.
CYCLE_S = 240.0
SCENARIO = """
name: soak
place: {{latitude_deg: 38.3, longitude_deg: 109.6, height_m: 1150.0}}
well: {{stations: [[0.0, 20.0, 40.0], [20000.0, 60.0, 90.0]], bit_m: 63.0, sensor_to_bit_m: 3.0}}
rig: {{ramp_s: 5.0, pump_ramp_s: 5.0, pick_up_m: 1.0, stand_m: 10.0}}
schedule:
  - {{kind: still, seconds: 20.0, pumps: false}}
  - {{kind: drill, seconds: 150.0, rpm: 118.0, rop_m_h: 240.0}}
  - {{kind: connection, seconds: 30.0}}
  - {{kind: slide, seconds: 40.0, rop_m_h: 120.0, toolface_deg: 30.0}}
cycles: {cycles}
vibration:
  random:
    - {{band_hz: [8.0, 300.0], acceleration_mps2: [6.0, 12.0, 12.0], rate_deg_s: [4.0, 1.0, 1.0], when: drilling}}
interference: {{axial_nt: 2500.0}}
"""


@dataclasses.dataclass
class Usage:
    """What the process of a node used since its last start, and what was wrong with it after the last kill."""

    pid: int = 0
    since: float = 0.0
    seen: list[tuple[float, int, int]] = dataclasses.field(default_factory=list)
    faults: list[str] = dataclasses.field(default_factory=list)

    def look(self, pid: int, now: float) -> None:
        """Take resident memory, kB, file handles and threads of a process; another process begins anew."""
        if pid != self.pid:
            self.pid, self.since, self.seen = pid, now, []
        # A process that ends meanwhile is the supervisor's matter.
        with contextlib.suppress(OSError):
            status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
            handles = len(list(Path(f"/proc/{pid}/fd").iterdir()))
            if now - self.since >= SETTLED_S:
                self.seen.append((float(status["VmRSS"].split()[0]), handles, int(status["Threads"])))

    def judge(self, name: str) -> None:
        """Compare the last third of what was seen with the first."""
        third = len(self.seen) // 3
        if third < 10:
            return
        for what, values in zip(("memory, kB,", "file handles", "threads"), zip(*self.seen, strict=True), strict=True):
            first, last = statistics.median(values[:third]), statistics.median(values[-third:])
            # One client that comes or goes is two handles.
            allowed = first * (1.0 + GROWTH) if what.startswith("memory") else first + 2
            print(f"{name}: {what} {first:g} to {last:g}")
            if last > allowed:
                self.faults.append(f"{name}: {what} grew from {first:g} to {last:g}")


@dataclasses.dataclass
class Outages:
    """When the graph was not whole: from a kill until streams and recorder are back."""

    spans: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    since: float | None = None

    def begin(self, now: float) -> None:
        """A node is gone."""
        self.since = now if self.since is None else self.since

    def look(self, now: float, sections: Mapping[str, Any]) -> None:
        """Take what the page shows; now: s since 1970."""
        if self.since is not None and now - self.since > SEEN_S and is_whole(sections):
            self.spans.append((self.since, now))
            self.since = None

    def faults(self, now: float) -> list[str]:
        """Outages that were too long."""
        spans = self.spans if self.since is None else [*self.spans, (self.since, now)]
        return [f"{end - begin:.0f} s until the graph was whole again" for begin, end in spans if end - begin > AGAIN_S]


def is_whole(sections: Mapping[str, Any]) -> bool:
    """Whether a page shows a recording and a live attitude."""
    if not sections or sections["recorder"] is None or sections["recorder"]["state"] != "recording":
        return False
    return bool(sections["attitude"]["inclination"]["state"] == LIVE)


@dataclasses.dataclass
class Run:
    """What was seen of a run; times in s since 1970."""

    began: float = 0.0
    ended: float = 0.0
    kills: int = 0
    outages: Outages = dataclasses.field(default_factory=Outages)
    heard: set[str] = dataclasses.field(default_factory=set)
    faults: list[str] = dataclasses.field(default_factory=list)


def write_scenario(path: Path, seconds: float) -> Path:
    """Write a scenario that lasts longer than the run."""
    path.write_text(SCENARIO.format(cycles=math.ceil(seconds * RATE / CYCLE_S) + 1))
    return path


def orders(folder: Path, scenario: Path, page: int, rig: Mapping[str, Any]) -> dict[str, Order]:
    """Return what starts each node."""
    parameters = {
        "surface": {"folder": str(folder / "data"), "page.port": page, "record.name": "run", **rig},
        "estimator": launch_plan.reference_parameters(read(scenario)),
        "sonde": {"scenario": str(scenario), "rate": RATE, "wait_for_listener_s": 10.0},
    }
    return {
        node: Order(node, launch_plan.node_words(node, WELL, given), folder / f"{node}.log")
        for node, given in parameters.items()
    }


def play(folder: Path, seconds: float, environment: Mapping[str, str], page: int, rig: Mapping[str, Any]) -> Run:
    """Run the graph with its clients; returns what was seen."""
    supervisor = Supervisor(environment, print)
    started = orders(folder, write_scenario(folder / "soak.yaml", seconds), page, rig)
    usage, run = {node: Usage() for node in NODES}, Run()
    listener = soak_clients.SurveyListener(environment, WELL)
    clients = soak_clients.Clients(page, *(rig[f"rig.{name}.port"] for name in ("wits0_server", "modbus", "opcua")))
    turn, end = itertools.cycle(NODES), time.monotonic() + seconds
    next_kill = time.monotonic() + KILL_EVERY_S
    run.began = time.time()
    run.outages.begin(run.began)
    for node in NODES:
        supervisor.start(started[node])
    try:
        while (now := time.monotonic()) < end:
            supervisor.watch()
            for node, used in usage.items():
                if pid := supervisor.pid(node):
                    used.look(pid, now)
            run.outages.look(time.time(), soak_clients.state_of(page))
            # Growth is judged while nothing disturbs: in the second half.
            if now > next_kill and now < end - seconds / 2.0:
                node, next_kill = next(turn), now + KILL_EVERY_S
                run.kills += 1
                print(f"kill -9 {node}")
                run.outages.begin(time.time())
                if pid := supervisor.pid(node):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.5)
    finally:
        run.ended = time.time()
        run.faults += clients.stop()
        killed = supervisor.stop((("sonde", "estimator"), ("surface",)))
        run.heard = listener.stop()
    for node, used in usage.items():
        used.judge(node)
        run.faults += used.faults
    run.faults += [f"{node} did not end when asked" for node in killed] + run.outages.faults(run.ended)
    return run


def missing_s(received_ns: np.ndarray[Any, Any], run: Run) -> float:
    """Seconds in which the graph was whole and no attitude is in the recordings for longer than `GAP_S`."""
    inside = received_ns[(received_ns > run.began * 1e9) & (received_ns < run.ended * 1e9)] * 1e-9
    # Of the end as of the beginning, which is an outage: what the last node flushes as it ends is there.
    times = np.concatenate([[run.began], np.sort(inside), [run.ended]])
    total = 0.0
    for k in np.flatnonzero(np.diff(times) > GAP_S):
        a, b = times[k], times[k + 1]
        total += b - a - sum(max(0.0, min(b, end) - max(a, begin)) for begin, end in run.outages.spans)
    return total


def check_records(folder: Path, run: Run) -> list[str]:
    """Return what is missing in the recordings, and which surveys are lost or listed twice."""
    faults, received = [], []
    recorded: set[str] = set()
    for path in sorted((folder / "data" / WELL / "bags").glob("run*")):
        with Bag(path) as bag:
            faults += [note for note in bag.notes if "damaged" in note]
            wanted = [topic for topic in (f"/{WELL}/attitude", f"/{WELL}/survey/accepted") if topic in bag.topics]
            for log_ns, topic, _, data in bag.messages(wanted) if wanted else ():
                if topic.endswith("attitude"):
                    received.append(log_ns)
                else:
                    recorded.add(bag.decode(topic, data).survey.uuid)
    missing, allowed = missing_s(np.array(received), run), run.kills * LOST_S
    spans = [end - begin for begin, end in run.outages.spans] or [0.0]
    print(f"outages: {len(spans)}, median {statistics.median(spans):.1f} s, longest {max(spans):.1f} s")
    print(f"recordings: {len(received)} attitudes, {missing:.1f} s missing of {allowed:.0f} s allowed")
    if missing > allowed:
        faults.append(f"{missing:.0f} s are not in the recordings; {run.kills} kills may cost {allowed:.0f} s")
    kept = decoded((folder / "data" / WELL / "surveys" / "surveys.json").read_bytes())
    listed = [record.survey.uuid for record in kept.records]
    if len(listed) != len(set(listed)):
        faults.append("a survey is listed twice")
    if lost := (recorded | run.heard) - set(listed):
        faults.append(f"{len(lost)} surveys are not in the list")
    print(f"surveys: {len(listed)} in the list, {len(run.heard)} heard, {len(recorded)} accepted ones recorded")
    return faults


def main() -> int:
    """Run the soak test; returns 1 where something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="how long; default 60")
    parser.add_argument("--loss", type=float, default=0.0, help="share of datagrams lost, and of those reordered; 0")
    parser.add_argument("--folder", type=Path, help="for logs and recordings; default: a temporary one")
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp(prefix="mwd_soak_"))
    folder.mkdir(parents=True, exist_ok=True)
    # A node that compiles takes memory that it keeps.
    place = launch_plan.reference_parameters(read(write_scenario(folder / "soak.yaml", 1.0)))
    warm_up(changed(EstimatorSettings(), place))
    network = LossyNetwork(folder) if given.loss > 0.0 else None
    with (
        launch_plan.own_domain(os.environ) as domain,
        launch_plan.page_port(None) as page,
        launch_plan.rig_parameters() as rig,
    ):
        environment = launch_plan.graph_environment(os.environ, domain, folder)
        if network is not None:
            network.disturb(given.loss, given.loss)
            environment = network.environment(environment)
        run = play(folder, 60.0 * given.minutes, environment, page, rig)
    faults = run.faults + check_records(folder, run)
    if network is not None:
        sent, lost, delayed = network.counts()
        print(f"datagrams: {sent} sent, {lost} of them lost, {delayed} delayed")
    for fault in faults:
        print(f"FAULT: {fault}")
    print(f"{run.kills} kills, {len(faults)} faults; logs in {folder}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
