# SPDX-License-Identifier: Apache-2.0
"""
Monte Carlo of north seeking: its bounds, S1's cases, and the azimuth propagated by gyros while drilling, as Markdown.

``python bench.py --only north``; by itself ``bench_north.py [RUNS] [--full]`` takes four minutes on one core (30 runs,
6 of each case from raw samples); more runs, in proportion longer. ``--full``: 200 runs of the cells.
"""

from __future__ import annotations

import argparse
import math

import north_cells
import propagated_runs
import s1_runs
from printed import head, show
from scipy.stats import chi2

NOISES, LATITUDES = (0.003, 0.01, 0.05, 0.15), (0.0, 34.0, 44.0, 60.0)
FULL = 200


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[1])
    parser.add_argument("runs", nargs="?", type=int, default=30, help="of each cell")
    parser.add_argument("--full", action="store_true", help=f"{FULL} runs of each cell")
    options = parser.parse_args()
    runs = FULL if options.full else options.runs
    limits(runs)
    s1_filter(max(runs // 2, 2))
    head("S1, from raw samples to the fused azimuth", s1_runs.HEAD)
    show(*(s1_runs.case_row(case, max(options.runs // 20, 1)) for case in s1_runs.CASES))
    drilling(max(options.runs // 5, 2))


def limits(runs: int) -> None:
    """Still, turning and two-position tools against the bounds, and a sentence on all of them."""
    head("Limit, deg: error and sigma over it, NEES", north_cells.HEAD)
    cells: list[north_cells.Cell] = []
    for number, noise in enumerate(NOISES):
        for lat in LATITUDES:
            found = [north_cells.seek("still", noise, lat, runs, 1000 + 10 * number + round(lat))]
            found.append(north_cells.seek("rotating", noise, lat, runs, 2000 + 100 * number + round(lat)))
            if lat in (34.0, 60.0):
                found.append(north_cells.half_turn(noise, lat, runs, 3000 + 100 * number + round(lat)))
            for one in found:
                show(north_cells.table_row(one))
                cells += one
    # Band of the mean of n squared normal numbers, normal approximation.
    half = 1.96 * math.sqrt(2.0 / runs)
    show("", north_cells.conclusion(cells, runs, 1.0 - half, 1.0 + half))


def s1_filter(runs: int) -> None:
    """S1's filter at one latitude."""
    head("S1's own filter, still, bias known, the same", north_cells.HEAD)
    for number, noise in enumerate(NOISES):
        show(north_cells.table_row(north_cells.s1_filter(noise, 34.0, runs, 300 + number)))


def drilling(runs: int) -> None:
    """Azimuth while drilling, from raw samples."""
    low, high = chi2.ppf([0.025, 0.975], runs) / runs
    head(
        f"Azimuth while drilling, {runs} runs a row; 95 % band of NEES {low:.2f} to {high:.2f}",
        propagated_runs.HEAD,
    )
    for name in propagated_runs.CASES:
        show(*propagated_runs.rows(name, runs, 500))


if __name__ == "__main__":
    main()
