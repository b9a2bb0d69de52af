# SPDX-License-Identifier: Apache-2.0
"""
Soak test: the whole graph at many times its pace, with a page client, while its nodes are killed in turn.

`make soak` runs it for an hour, `make soak MINUTES=10` for ten minutes. It fails where memory, file handles or threads
of a node grow, a survey is listed twice or lost, or more of the run is missing in the recordings than the kills cost.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import itertools
import json
import os
import signal
import statistics
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np

from mwd_estimation.nodes.warm_up import warm_up
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator import scenario_files
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.runs import launch_plan
from mwd_surface.runs.supervise import Order, Supervisor
from mwd_surface.surveys.survey_store import decoded

RATE = 10.0
KILL_EVERY_S = 120.0
SETTLED_S = 120.0  # after a start a node loads and compiles, which takes memory once
GROWTH = 0.05
LOST_S = 2.0  # of wall time for each kill; a restarted node needs some more to be there again
RESTART_S = 15.0
NODES = ("surface", "estimator", "sonde")
WELL = "soak"


@dataclasses.dataclass
class Usage:
    """What the process of a node used since its last start, and what was wrong with it."""

    pid: int = 0
    since: float = 0.0
    seen: list[tuple[float, int, int]] = dataclasses.field(default_factory=list)
    faults: list[str] = dataclasses.field(default_factory=list)

    def look(self, name: str, pid: int, now: float) -> None:
        """Take resident memory, kB, file handles and threads of a process; another process begins anew."""
        if pid != self.pid:
            self.judge(name)
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


def orders(folder: Path, page: int) -> dict[str, Order]:
    """Return what starts each node."""
    parameters = {
        "surface": {"folder": str(folder / "data"), "page.port": page, "record.name": "run"},
        "estimator": launch_plan.reference_parameters(read(scenario_files.find("default"))),
        "sonde": {"scenario": "default", "rate": RATE, "wait_for_listener_s": 10.0, "exit_at_end": True},
    }
    return {
        node: Order(node, launch_plan.node_words(node, WELL, given), folder / f"{node}.log")
        for node, given in parameters.items()
    }


def pid_of(folder: Path, node: str) -> int:
    """Number of the process of a node of this run; 0 while there is none."""
    for path in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            words = (path / "cmdline").read_bytes().split(b"\0") if path.name.isdigit() else []
            environment = (path / "environ").read_bytes() if node.encode() in words else b""
            if f"ROS_LOG_DIR={folder}".encode() in environment:
                return int(path.name)
    return 0


def ask(page: int) -> bool:
    """Whether the page answers with a state."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{page}/state.json", timeout=5) as answer:
            return "sections" in json.load(answer)
    except (OSError, ValueError):
        return False


def play(folder: Path, seconds: float, page: int, domain: int) -> tuple[list[str], int, int]:
    """Run the graph; returns what was wrong, and how often it was killed and the scenario begun."""
    supervisor = Supervisor(launch_plan.graph_environment(os.environ, domain, folder), print)
    started, usage, kills = orders(folder, page), {node: Usage() for node in NODES}, 0
    turn, next_kill = itertools.cycle(NODES), time.monotonic() + KILL_EVERY_S
    faults, silent_since, end, rounds = [], None, time.monotonic() + seconds, 1
    for node in NODES:
        supervisor.start(started[node])
    try:
        while (now := time.monotonic()) < end:
            supervisor.watch()
            if supervisor.finished("sonde"):
                rounds += 1
                supervisor.start(started["sonde"])
            for node, used in usage.items():
                if pid := pid_of(folder, node):
                    used.look(node, pid, now)
            silent_since = None if ask(page) else (silent_since or now)
            if silent_since is not None and now - silent_since > 120.0:
                faults.append("the page did not answer for two minutes")
                break
            if now > next_kill and now < end - 2.0 * RESTART_S:
                node, next_kill = next(turn), now + KILL_EVERY_S
                kills += 1
                print(f"kill -9 {node}")
                if pid := pid_of(folder, node):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(1.0)
    finally:
        killed = supervisor.stop((("sonde", "estimator"), ("surface",)))
    for node, used in usage.items():
        used.judge(node)
        faults += used.faults
    return faults + [f"{node} did not end when asked" for node in killed], kills, rounds


def check_records(folder: Path, kills: int, rounds: int) -> list[str]:
    """Return what is missing in the recordings, or listed twice."""
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
    gaps = np.diff(np.sort(np.array(received))) * 1e-9
    missing = float(gaps[gaps > 1.0].sum())
    allowed = kills * LOST_S + (kills + rounds) * RESTART_S
    print(f"recordings: {len(received)} attitudes, {missing:.1f} s missing of {allowed:.0f} s allowed")
    if missing > allowed:
        faults.append(f"{missing:.0f} s are not in the recordings; {kills} kills may cost {allowed:.0f} s")
    kept = decoded((folder / "data" / WELL / "surveys" / "surveys.json").read_bytes())
    listed = [record.survey.uuid for record in kept.records]
    if len(listed) != len(set(listed)):
        faults.append("a survey is listed twice")
    if lost := recorded - set(listed):
        faults.append(f"{len(lost)} accepted surveys are not in the list")
    print(f"surveys: {len(listed)} in the list, {len(recorded)} accepted ones recorded")
    return faults


def main() -> int:
    """Run the soak test; returns 1 where something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="how long; default 60")
    parser.add_argument("--folder", type=Path, help="for logs and recordings; default: a temporary one")
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp(prefix="mwd_soak_"))
    folder.mkdir(parents=True, exist_ok=True)
    # A node that compiles takes memory that it keeps.
    place = launch_plan.reference_parameters(read(scenario_files.find("default")))
    warm_up(changed(EstimatorSettings(), place))
    with launch_plan.own_domain(os.environ) as domain, launch_plan.page_port(None) as page:
        faults, kills, rounds = play(folder, 60.0 * given.minutes, page, domain)
    faults += check_records(folder, kills, rounds)
    for fault in faults:
        print(f"FAULT: {fault}")
    print(f"{kills} kills, {rounds} rounds, {len(faults)} faults; logs in {folder}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
