# SPDX-License-Identifier: Apache-2.0
"""
Monte Carlo of the survey decision on stations drawn from physics and the OWSG tool code, as Markdown.

Single stations of any attitude, healthy and disturbed; runs of thirty stations, decided one after the other; runs
analysed together; gyro azimuths of one position a station. By itself ``bench_surveys.py`` takes six minutes on one
core; ``--small`` less, with shares of rare errors that say little; ``--full`` draws 20 000 disturbed stations. Other
seeds by ``--seed``, some kinds by ``--only`` and a part of their name. ``--drawn 20 --only connections`` takes surveys
in twenty drawn runs with steel, from raw samples, a minute each.
"""

from __future__ import annotations

import argparse
import dataclasses

from printed import head, show
from stations import connections, judge, runs, seeks, singles, together

# Stations of each kind, runs of each kind; runs of each gyro for each of those.
SMALL, USUAL, FULL = (300, 3), (500, 6), (4000, 40)
GYROS = 4


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[1])
    parser.add_argument("--small", action="store_true", help="a quick look, half a minute")
    parser.add_argument("--full", action="store_true", help="20 000 disturbed stations")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drawn", type=int, default=0, help="drawn runs from raw samples, too")
    parser.add_argument("--only", default="", help="kinds whose name contains this")
    options = parser.parse_args()
    count, length = SMALL if options.small else FULL if options.full else USUAL

    def chosen(names: dict) -> list[str]:
        return [name for name in names if options.only in name]

    title = f"Single stations, seed {options.seed}; shares of > 3 sigma, > 10 and > 45 deg are of the accepted"
    head(title, judge.HEAD)
    pooled = []
    for name in chosen(singles.KINDS):
        found = singles.stations(name, count, options.seed)
        pooled += found if name in singles.POOLED else []
        show(judge.row(name, found))
    if pooled:
        show(judge.row("all disturbed but sensor defects", pooled))
    head(f"{length} runs of {runs.STATIONS} stations each", judge.HEAD)
    pooled, numbers = [], []
    for name in chosen(runs.KINDS):
        for words, found in runs.parts(name, length, options.seed).items():
            label = f"{name}{words and f': {words}'}"
            show(judge.row(label, found))
            if runs.POOLED.get(name) == words:
                pooled += found
                numbers.append(f"{len(found)} of {label}")
    if pooled:
        show(judge.row(f"stations pooled: {'; '.join(numbers)}", pooled))
    head(f"{2 * length} runs analysed together, declination known; deg", together.HEAD)
    for name in chosen(together.RUNS):
        show(together.row(name, 2 * length, options.seed))
    head(f"Gyro azimuths, one position of a minute, {GYROS * length} runs of {seeks.STATIONS} stations", seeks.HEAD)
    for name in chosen(seeks.UNITS):
        show(*seeks.rows(name, GYROS * length, options.seed))
    if options.only in "connections":
        from_samples(options.seed, options.drawn)


def from_samples(seed: int, drawn: int) -> None:
    """Surveys of simulated sondes; drawn: number of runs that are drawn, from a seed on."""
    head("Simulated sondes, a survey at each connection, from raw samples", connections.HEAD)
    for run in connections.RUNS:
        show(connections.row(connections.outcome(dataclasses.replace(run, seed=run.seed + 100 * (seed - 1)))))
    found = []
    for k in range(drawn):
        found.append(connections.outcome(connections.drawn(1000 * seed + k)))
        show(connections.row(found[-1]))
    if found:
        show(connections.all_rows(found))


if __name__ == "__main__":
    main()
