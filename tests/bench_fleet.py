"""
A fleet of simulated bags: scaling on one and two workers; then one cut off, one empty, and a worker killed on the way.

    python tests/bench_fleet.py [--bags 40]

Prints Markdown. What a fleet costs on one's own machines follows from samples per second and worker, and bytes.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import signal
import tempfile
import time
from pathlib import Path

from mwd_estimation.pipeline import EstimatorSettings
from mwd_sensors import scenario
from mwd_surface.fleet import fleet_dataset, fleet_run
from mwd_surface.fleet.fleet_task import Outcome
from mwd_surface.runs import simulate

SCENARIO = Path(__file__).resolve().parents[1] / "bags" / "scenarios" / "default.yaml"


def simulated(folder: Path, count: int) -> list[Path]:
    """Bags of the default scenario, each with a seed of its own."""
    told = scenario.read(SCENARIO, {})
    bags = []
    for seed in range(count):
        path = folder / f"{seed:04d}"
        bags.append(path)
        simulate.record(dataclasses.replace(told, seed=seed), path)
    return bags


def damage(bags: list[Path]) -> None:
    """The first loses its end, the second all of it."""
    cut, empty = (next(bag.glob("*.mcap")) for bag in bags[:2])
    cut.write_bytes(cut.read_bytes()[:-1000])
    empty.write_bytes(b"")


class Killer:
    """Ends the worker of the tenth outcome."""

    def __init__(self) -> None:
        self.told = self.killed = 0

    def __call__(self, outcome: Outcome, _share: float) -> None:
        """Count, and kill once."""
        self.told += 1
        if self.told == 10:
            self.killed = int(outcome.row["worker"].rpartition(":")[2])
            os.kill(self.killed, signal.SIGKILL)


def main() -> None:
    """Print what came of the fleet, and its speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=int, default=40)
    options = parser.parse_args()
    estimator = EstimatorSettings()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bags = simulated(folder / "bags", options.bags)
        whole = bags[2:]
        size = sum(file.stat().st_size for bag in whole for file in bag.iterdir())
        speeds: dict[int, tuple[float, int]] = {}
        for workers in (1, 2):
            with fleet_run.cluster("processes", workers) as client:
                # Imports and compiled kernels are there before the clock starts: a fleet takes hours, they seconds.
                fleet_run.run(whole[:workers] * 2, folder / f"warm_{workers}", client, estimator)
                began = time.perf_counter()
                outcomes = fleet_run.run(whole, folder / f"fleet_{workers}", client, estimator)
                speeds[workers] = (time.perf_counter() - began, sum(one.row["samples"] for one in outcomes))
        damage(bags)
        killer = Killer()
        with fleet_run.cluster("processes", 2) as client:
            outcomes = fleet_run.run(bags, folder / "fleet", client, estimator, told=killer)
            again = fleet_run.run(bags, folder / "fleet", client, estimator)
        surveys = fleet_dataset.read(folder / "fleet", "surveys")
        written = sum(file.stat().st_size for file in (folder / "fleet").rglob("*.parquet"))
    failed = [one for one in outcomes if one.row["outcome"] == fleet_dataset.FAILED]
    different = len(set(surveys.column("uuid").to_pylist()))
    kept = sum(one.kept for one in again)
    print(f"{len(bags)} bags, one cut off, one empty, a worker killed on the way:")
    print(f"{len(outcomes) - len(failed)} worked out, {len(failed)} failed; {surveys.num_rows} surveys,")
    print(f"{different} of them different; called again, {kept} are kept and none is worked out twice.")
    print("\n| workers | s | samples/s | per worker |\n|---|---|---|---|")
    for workers, (elapsed, samples) in speeds.items():
        print(f"| {workers} | {elapsed:.1f} | {samples / elapsed:,.0f} | {samples / elapsed / workers:,.0f} |")
    samples = speeds[1][1]
    print(f"\nTwo workers are {speeds[1][0] / speeds[2][0]:.2f} times as fast as one.")
    print(
        f"In: {size / samples:.0f} bytes a sample of the AHRS, all topics. Out: {written / samples:.2f} bytes a sample."
    )


if __name__ == "__main__":
    main()
