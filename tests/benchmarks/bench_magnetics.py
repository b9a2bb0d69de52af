# SPDX-License-Identifier: Apache-2.0
"""
Monte Carlo of azimuths by single magnetic methods: error, sigma and NEES, as Markdown.

Multi-station runs are of two kinds: with the small errors that the figures of the compared tool can be reproduced with,
and with every error as large as the tool code has it. Surveys as they are decided: bench_surveys.py.
``nice -n 10 python tests/benchmarks/bench_magnetics.py [RUNS]``; 200 runs, as it comes, take a minute on one core.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from printed import head, show
from test_multi_station_analysis import QUIET, drawn_run

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.magnetic import axial_correction
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.surveys import multi_station_analysis

DEG = math.radians(1.0)
MSA_HEAD = (
    "| run of 40 stations | errors | raw | single station | multi-station "
    "| its sigma | NEES | refused | compared tool |"
)


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


def main() -> None:
    """Print the tables; the first argument is the number of runs."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    head("Multi-station analysis, azimuth error rms in deg", MSA_HEAD)
    for small in (True, False):
        for kind in ("build", "east-west"):
            show(multi(kind, small, max(runs // 4, 2)))


if __name__ == "__main__":
    main()
