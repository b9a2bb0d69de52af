# SPDX-License-Identifier: Apache-2.0
"""
Monte Carlo of azimuths by single magnetic methods: error, sigma and NEES, as Markdown.

Multi-station runs are of two kinds: with the small errors that the figures of the compared tool can be reproduced with,
and with every error as large as the tool code has it. Then S0's table. Surveys as they are decided: bench_surveys.py.
``nice -n 10 python tests/benchmarks/bench_magnetics.py [RUNS]``; 200 runs, as it comes, take a minute on one core.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np
from test_multi_station_analysis import QUIET, drawn_run

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.magnetic import axial_correction
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_surface.surveys import multi_station_analysis

DEG = math.radians(1.0)
MSA_HEAD = (
    "| run of 40 stations | errors | raw | single station | multi-station "
    "| its sigma | NEES | refused | compared tool |"
)
S0_HEAD = "| axial interference nT | raw, S0 | raw, ours | corrected, S0 | corrected, ours | its sigma |"


def rms(values: Array) -> float:
    """Root mean square of angles in rad, in deg."""
    return math.degrees(float(np.sqrt(np.mean(np.square(values))))) if len(values) else math.nan


def ratio(error: Array, sigma: Array) -> str:
    """NEES as text."""
    return f"{np.mean((error / sigma) ** 2):.2f}" if len(error) else ""


def multi(kind: str, small: bool, runs: int) -> str:
    """Row of a kind of run: build with 650 nT, or east-west horizontal with 900 nT; angles in deg."""
    options = QUIET if small else {}
    errors = SensorErrors(0.001, 0.0001, 25.0, 0.0003) if small else SensorErrors()
    noise = np.diag([4e-6] * 3 + [4e-16] * 3)
    raw, single, msa, sigma, refused = [], [], [], [], 0
    for seed in range(runs):
        f_t, b_t, reference, _, azi, _, _ = drawn_run(kind, seed, **options)
        done = multi_station_analysis.analyse(f_t, b_t, reference)
        alone = axial_correction.axial_correction(
            f_t,
            b_t,
            reference.horizontal,
            reference.vertical,
            errors.covariance(f_t, b_t) + noise,
            reference.covariance,
            plausible=3e-6,
        )
        raw.append(wrap_pi(done.azimuth_raw - azi))
        single.append(wrap_pi(alone.azimuth - azi))
        refused += bool(done.refused)
        if done.refused:
            continue
        msa.append(wrap_pi(done.azimuth - azi))
        sigma.append(done.sigma_azimuth)
    figures = [rms(np.concatenate(v)) for v in (raw, single, msa, sigma)]
    name = "build 5-85 deg, 650 nT" if kind == "build" else "east-west horizontal, 900 nT"
    given = {"build": "1.63, .34, .089", "east-west": "3.21, 3.72, .290"}[kind] if small else ""
    words = [f"{v:.3f}" for v in figures]
    words += [ratio(np.concatenate(msa), np.concatenate(sigma)), str(refused)]
    words.append(given)
    return f"| {name} | {'small' if small else 'tool code'} | " + " | ".join(words) + " |"


def s0_rows() -> list[str]:
    """Rows of S0's table 1: 40 uT, dip 12 deg, the tool at 67 deg inclination and 42 deg from magnetic north."""
    total, dip = 4e-5, 12.0 * DEG
    mat_tn = mat_nt(67.0 * DEG, 42.0 * DEG, 112.0 * DEG).T
    f_t = mat_tn @ np.array([0.0, 0.0, -9.81])
    reference = Reference(total, dip, 0.0, 0.0, 9.81, "S0")
    table = []
    for axial_nt, paper in ((20000.0, 28.87), (40000.0, 21.67), (80000.0, 14.30)):
        b_t = mat_tn @ np.array([total * math.cos(dip), 0.0, total * math.sin(dip)]) + [axial_nt * 1e-9, 0.0, 0.0]
        done = axial_correction.axial_correction(
            f_t,
            b_t,
            reference.horizontal,
            reference.vertical,
            SensorErrors().covariance(f_t, b_t),
            reference.covariance,
        )
        table.append(
            f"| {axial_nt:g} | {paper:.2f} | {math.degrees(float(magnetic_geometry.raw_azimuth(f_t, b_t))):.2f} "
            "| 42.00 | "
            f"{math.degrees(float(done.azimuth)):.2f} | {math.degrees(float(done.sigma_azimuth)):.2f} |"
        )
    return table


def rows(runs: int = 200, progress: Callable[[str], None] | None = None) -> list[str]:
    """All Markdown rows of the tables, titles and heads first."""
    table: list[str] = []

    def add(*more: str) -> None:
        table.extend(more)
        if progress:
            for row in more:
                progress(row)

    def head(title: str, names: str) -> None:
        add("", f"### {title}", "", names, "|" + "---|" * (names.count("|") - 1))

    head("Multi-station analysis, azimuth error rms in deg", MSA_HEAD)
    for small in (True, False):
        for kind in ("build", "east-west"):
            add(multi(kind, small, max(runs // 4, 2)))
    head("S0, table 1: azimuth by one station, deg", S0_HEAD)
    add(*s0_rows())
    return table


def main() -> None:
    """Print the tables; the first argument is the number of runs."""
    rows(int(sys.argv[1]) if len(sys.argv) > 1 else 200, lambda row: print(row, flush=True))


if __name__ == "__main__":
    main()
