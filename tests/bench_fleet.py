"""
A fleet of simulated bags: scaling on one and two workers; then one cut off, one empty, and a worker killed on the way.

    python tests/bench_fleet.py [--bags 200]

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

import pyarrow.parquet as parquet

from mwd_estimation.pipeline import EstimatorSettings
from mwd_sensors import scenario
from mwd_surface.fleet import fleet_dataset, fleet_run
from mwd_surface.fleet.fleet_task import Outcome, Work, config_text
from mwd_surface.runs import simulate
from mwd_surface.runs.bag_input import InputSettings

BAGS = Path(__file__).resolve().parents[1] / "bags"
SHORT, LONG = BAGS / "golden" / "stations" / "scenario.yaml", BAGS / "scenarios" / "curve_and_lateral.yaml"


def simulated(folder: Path, source: Path, count: int) -> list[Path]:
    """Bags of a scenario, each with a seed of its own."""
    told = scenario.read(source, {})
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


def scaling(folder: Path) -> list[str]:
    """Speed on one worker and on two, over a few long bags, and what goes in and out."""
    bags = simulated(folder / "long", LONG, 4)
    size = sum(file.stat().st_size for bag in bags for file in bag.iterdir())
    table = ["| workers | s | samples/s | per worker |", "|---|---|---|---|"]
    elapsed = {}
    samples = 0
    for workers in (1, 2):
        with fleet_run.cluster("processes", workers) as client:
            # Imports and compiled kernels are there before the clock starts: a fleet takes hours, they take seconds.
            warm = [client.submit(fleet_run.carry_out, work, pure=False) for work in works(bags[:2], folder / "warm")]
            client.gather(warm)
            began = time.perf_counter()
            outcomes = fleet_run.run(bags, folder / f"fleet_{workers}", client, EstimatorSettings())
            elapsed[workers] = time.perf_counter() - began
        samples = sum(one.row["samples"] for one in outcomes)
        rate = samples / elapsed[workers]
        table.append(f"| {workers} | {elapsed[workers]:.1f} | {rate:,.0f} | {rate / workers:,.0f} |")
    written = sum(file.stat().st_size for file in (folder / "fleet_1").rglob("*.parquet"))
    times = elapsed[1] / elapsed[2]
    return [
        *table,
        "",
        f"{len(bags)} bags of {samples / len(bags):,.0f} samples of the AHRS, default method:",
        f"two workers are {times:.2f} times as fast as one.",
        f"In: {size / samples:.0f} bytes a sample, all topics. Out: {written / samples:.2f} bytes a sample.",
    ]


def works(bags: list[Path], folder: Path) -> list[Work]:
    """Tasks whose results nobody reads."""
    text = config_text(EstimatorSettings())
    return [Work(str(bag), str(folder), text, InputSettings()) for bag in bags]


def robustness(folder: Path, count: int) -> list[str]:
    """What becomes of many bags, two of them bad, when a worker dies."""
    bags = simulated(folder / "bags", SHORT, count)
    damage(bags)
    killer = Killer()
    with fleet_run.cluster("processes", 2) as client:
        outcomes = fleet_run.run(bags, folder / "fleet", client, EstimatorSettings(), told=killer)
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
