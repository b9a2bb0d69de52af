# SPDX-License-Identifier: Apache-2.0
"""Runs whose stations are analysed together: what is left of 650 or 900 nT along the axis, declination known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.surveys import multi_station_analysis
from stations import judge, tool_code, truth
from stations.tool_code import DEG

HEAD = (
    "| run | interference nT | uncorrected deg | multi-station deg | its sigma | NEES | refused "
    "| its last station deg | the last as decided deg | its sigma | NEES |"
)
# Number of stations, interference, T, and attitudes, deg: inclination and azimuth of the first and the last.
RUNS = {
    "build": (40, 650e-9, (5.0, 85.0), (70.0, 75.0)),
    "tangent": (40, 650e-9, (44.0, 46.0), (118.0, 122.0)),
    "north-south horizontal": (40, 650e-9, (89.0, 91.0), (-4.0, 4.0)),
    "build, 5 stations": (5, 650e-9, (20.0, 60.0), (70.0, 75.0)),
    "east-west horizontal": (40, 900e-9, (89.0, 91.0), (86.0, 94.0)),
}
_ALIGNED = StationSettings(errors=SensorErrors(misalignment_deg=0.0, course_misalignment_deg=0.0, sag_deg=0.0))


def drawn(name: str, rng: np.random.Generator) -> tuple[Array, Array, Array, Reference]:
    """Specific force, m/s^2, and field, T, shape (n, 3), true azimuth, rad, shape (n,), and the reference."""
    n, axial, inclinations, azimuths = RUNS[name]
    inclination, azimuth = np.linspace(*inclinations, n) * DEG, np.linspace(*azimuths, n) * DEG
    earth, reference = truth.drawn_place(rng)
    earth = dataclasses.replace(earth, declination=reference.declination)
    drawn_tool = tool_code.drawn_tool(rng)
    tool = dataclasses.replace(
        drawn_tool, field_bias=drawn_tool.field_bias + np.array([axial, 0.0, 0.0]), misalignment=np.zeros(2), sag=0.0
    )
    readings = []
    total, dip, *_ = tool_code.OF_STATION
    for k in range(n):
        here = earth.drawn((total, dip, 0.0, 0.0), rng)
        mat_tn = truth.mat_nt(inclination[k], azimuth[k], rng.uniform(0.0, math.tau)).T
        readings.append(tool.read(mat_tn @ np.array([0.0, 0.0, -here.gravity]), mat_tn @ here.field_n, rng))
    f_t, b_t = (np.array(part) for part in zip(*readings, strict=True))
    return f_t, b_t, azimuth, dataclasses.replace(reference, sigma_declination=0.0, sigma_declination_field=0.0)


def row(name: str, count: int, seed: int) -> str:
    """Row under `HEAD`: the runs of a kind together."""
    rng = np.random.default_rng([seed, 200 + list(RUNS).index(name)])
    raw, errors, sigmas, together, last, refused = [], [], [], [], [], 0
    for _ in range(count):
        f_t, b_t, azimuth, reference = drawn(name, rng)
        done = multi_station_analysis.analyse(f_t, b_t, reference, _ALIGNED.errors)
        turn = reference.declination
        raw.append(wrap_pi(done.azimuth_raw + turn - azimuth))
        refused += done.refused is not None
        if done.refused is None:
            errors.append(wrap_pi(done.azimuth + turn - azimuth))
            sigmas.append(done.sigma_azimuth)
            together.append(errors[-1][-1])
        decision = judge.new_decision(_ALIGNED)
        for k in range(len(azimuth)):
            average = judge.still(f_t[k], b_t[k], 1800 * k)
            survey = judge.decide(decision, average, reference)
        last.append(judge.judged(survey, 0.0, azimuth[-1]))
    words = [f"{RUNS[name][1] * 1e9:.0f}", _rms(np.concatenate(raw))]
    error, sigma = (np.concatenate(part) if part else np.zeros(0) for part in (errors, sigmas))
    words += [_rms(error), _rms(sigma), _nees(error, sigma), str(refused), _rms(np.array(together))]
    error, sigma = np.array([one.error for one in last]), np.array([one.sigma for one in last])
    words += [_rms(error), _rms(sigma), _nees(error, sigma)]
    return f"| {name} | " + " | ".join(words) + " |"


def _rms(values: Array) -> str:
    return f"{math.sqrt(np.mean(values**2)) / DEG:.2f}" if len(values) else ""


def _nees(error: Array, sigma: Array) -> str:
    return f"{np.mean((error / sigma) ** 2):.2f}" if len(error) else ""
