# SPDX-License-Identifier: Apache-2.0
"""
A fleet of simulated bags: scaling on one and two workers; then one cut off, one empty, and a worker killed on the way.

    python tests/benchmarks/bench_fleet.py [--bags 200]

Prints Markdown. What a fleet costs on one's own machines follows from samples per second and worker, and bytes.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import signal
import tempfile
import time
from pathlib import Path

import distributed
import pyarrow.parquet as parquet

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.simulator import scenario
from mwd_surface.fleet import fleet_dataset, fleet_run
from mwd_surface.fleet.fleet_task import FleetWork, Outcome, config_text
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.runs import simulate

BAGS = Path(__file__).resolve().parents[2] / "bags"
SHORT, LONG = BAGS / "golden" / "stations" / "scenario.yaml", BAGS / "scenarios" / "curve_and_lateral.yaml"

ROUNDS = 3


def simulated(folder: Path, source: Path, count: int) -> list[Path]:
    """Bags of a scenario, each with a seed of its own."""
    given = scenario.read(source, {})
    bags = []
    for seed in range(count):
        path = folder / f"{seed:04d}"
        bags.append(path)
        simulate.record(dataclasses.replace(given, seed=seed), path)
    return bags


def damage(bags: list[Path]) -> None:
    """The first loses its end, the second all of it."""
    cut, empty = (next(bag.glob("*.mcap")) for bag in bags[:2])
    cut.write_bytes(cut.read_bytes()[:-1000])
    empty.write_bytes(b"")


class Killer:
    """Ends the worker of the tenth outcome."""

    def __init__(self) -> None:
        self.given = self.killed = 0

    def __call__(self, outcome: Outcome, _share: float) -> None:
        """Count, and kill once."""
        self.given += 1
        if self.given == 10:
            self.killed = int(outcome.row["worker"].rpartition(":")[2])
            os.kill(self.killed, signal.SIGKILL)


def pin(core: int) -> None:
    """Keep this process, all its threads, on one core."""
    for thread in Path("/proc/self/task").iterdir():
        os.sched_setaffinity(int(thread.name), {core})


def cpu_seconds() -> float:
    """Processor time of this process so far, s."""
    used = os.times()
    return used.user + used.system


@dataclasses.dataclass
class Crew:
    """Workers that do the same bags again and again."""

    client: distributed.Client
    workers: int
    pinned: bool
    elapsed: list[float] = dataclasses.field(default_factory=list)
    used: list[float] = dataclasses.field(default_factory=list)
    samples: int = 0

    def prepare(self, bags: list[Path], folder: Path) -> None:
        """Imports and compiled kernels are there before the clock starts: a fleet takes hours, they take seconds."""
        for core, address in enumerate(self.client.scheduler_info()["workers"]):
            if self.pinned:
                self.client.run(pin, sorted(os.sched_getaffinity(0))[core], workers=[address])
            warm = self.client.submit(fleet_run.carry_out, works(bags[:1], folder)[0], pure=False, workers=[address])
            self.client.gather(warm)

    def work(self, bags: list[Path], folder: Path) -> None:
        """Do them all once more, into a folder where nothing is."""
        before, began = sum(self.client.run(cpu_seconds).values()), time.perf_counter()
        outcomes = fleet_run.run(bags, folder, self.client, EstimatorSettings())
        self.elapsed.append(time.perf_counter() - began)
        self.used.append(sum(self.client.run(cpu_seconds).values()) - before)
        self.samples = sum(one.row["samples"] for one in outcomes)

    def row(self) -> str:
        """The round that others on the machine disturbed least; processor time hardly depends on them."""
        rate = self.samples / min(self.elapsed)
        return (
            f"| {self.workers}{', a core each' if self.pinned else ''} | {min(self.elapsed):.1f} | {rate:,.0f} "
            f"| {rate / self.workers:,.0f} | {1e6 * min(self.used) / self.samples:.2f} |"
        )


def scaling(folder: Path) -> list[str]:
    """
    Speed on one worker and on two, over a few long bags, and what goes in and out.

    Taken in turns, the best of some rounds: what else runs on the machine then meets all of them alike.
    """
    bags = simulated(folder / "long", LONG, 4)
    size = sum(file.stat().st_size for bag in bags for file in bag.iterdir())
    with contextlib.ExitStack() as stack:
        crews = [
            Crew(stack.enter_context(fleet_run.cluster("processes", workers)), workers, pinned)
            for pinned in (True, False)
            for workers in (1, 2)
        ]
        for k, crew in enumerate(crews):
            crew.prepare(bags, folder / f"warm_{k}")
        for turn in range(ROUNDS):
            for k, crew in enumerate(crews):
                crew.work(bags, folder / f"fleet_{k}_{turn}")
    samples = crews[0].samples
    written = sum(file.stat().st_size for file in (folder / "fleet_0_0").rglob("*.parquet"))
    pinned, free = (min(one.elapsed) / min(two.elapsed) for one, two in (crews[:2], crews[2:]))
    undisturbed = 2.0 * min(crews[0].used) / min(crews[1].used)
    return [
        "| workers | s | samples/s | per worker | us of processor a sample |",
        "|---|---|---|---|---|",
        *(crew.row() for crew in crews),
        "",
        f"{len(bags)} bags of {samples / len(bags):,.0f} samples of the AHRS, default method; best of {ROUNDS} rounds",
        f"in turns, load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores:",
        f"two workers with a core each are {pinned:.2f} times as fast as one with a core;",
        f"{undisturbed:.2f} times by their processor time, as on a machine with nothing else to do. A worker with",
        f"both cores reads and writes on the second, so that there two workers are {free:.2f} times as fast as one.",
        f"In: {size / samples:.0f} bytes a sample, all topics. Out: {written / samples:.2f} bytes a sample.",
    ]


def works(bags: list[Path], folder: Path) -> list[FleetWork]:
    """Tasks whose results nobody reads."""
    text = config_text(EstimatorSettings())
    return [FleetWork(str(bag), str(folder), text, InputSettings()) for bag in bags]


def robustness(folder: Path, count: int) -> list[str]:
    """What becomes of many bags, two of them bad, when a worker dies."""
    bags = simulated(folder / "bags", SHORT, count)
    damage(bags)
    killer = Killer()
    with fleet_run.cluster("processes", 2) as client:
        outcomes = fleet_run.run(bags, folder / "fleet", client, EstimatorSettings(), report=killer)
        again = fleet_run.run(bags, folder / "fleet", client, EstimatorSettings())
    surveys = parquet.read_table(folder / "fleet" / "surveys")
    failed = [one for one in outcomes if one.row["outcome"] == fleet_dataset.FAILED]
    different = len(set(zip(surveys.column("key").to_pylist(), surveys.column("uuid").to_pylist(), strict=True)))
    kept = sum(one.kept for one in again)
    return [
        f"{count} bags, one cut off, one empty, a worker {'killed' if killer.killed else 'left alone'} on the way:",
        f"{count - len(failed)} worked out, {len(failed)} failed with their reason; {surveys.num_rows} surveys,",
        f"{different} of them different. Called again: {kept} kept, none worked out twice.",
    ]


def main() -> None:
    """Print what came of the fleet, and its speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=int, default=200)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        print("\n".join(scaling(Path(name))), end="\n\n", flush=True)
        print("\n".join(robustness(Path(name), options.bags)))


if __name__ == "__main__":
    main()
