"""All benchmarks in one run, printed and written to BENCHMARKS.md: ours, the papers' methods and the peers."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from pathlib import Path

import bench_gravity
import bench_north

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Run everything; about ten minutes with the defaults on two cores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each drilling case")
    parser.add_argument("--runs", type=int, default=50, help="Monte Carlo runs of north seeking")
    options = parser.parse_args()
    gravity = bench_gravity.main(options.seeds)
    north = list(bench_north.rows(options.runs, lambda row: print(row, flush=True)))
    bags = subprocess.run(
        [sys.executable, str(HERE / "bench_bags.py")], check=True, capture_output=True, text=True
    ).stdout.splitlines()
    print("\n".join(bags))
    head = [
        "# Benchmarks",
        "",
        "Written by `make bench`: ours, the papers' methods and the peers on the same data in the same run.",
        f"Quote ratios; times are of one machine ({os.cpu_count()} cores, CPython {platform.python_version()}).",
        "",
        "## Gravity while drilling",
        "",
    ]
    text = [*head, *gravity, "## North seeking", "", *north, "", "## Bags", "", "```", *bags, "```", ""]
    (HERE / "BENCHMARKS.md").write_text("\n".join(text))


if __name__ == "__main__":
    main()
