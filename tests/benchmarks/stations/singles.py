# SPDX-License-Identifier: Apache-2.0
"""Single stations of any attitude, each of a tool, a hole and a place of its own."""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.survey.station_settings import StationSettings
from stations import disturbances, judge, tool_code, truth
from stations.disturbances import Disturbance
from stations.judge import Judged
from stations.tool_code import DEG

KINDS: dict[str, Disturbance] = {
    "healthy": disturbances.nothing,
    "cross-axial .1-3 uT": disturbances.cross_axial,
    "axial .3-5 and cross-axial .1-3 uT": disturbances.axial_and_cross,
    "steel outside .2-10 uT": disturbances.steel,
    "storm 200-1000 nT": disturbances.storm,
    "reference off 400 nT, .5, 1 deg": disturbances.reference_off,
    "magnetometer 2 % strong": disturbances.strong_magnetometer,
    "accelerometers turned 2 deg": disturbances.turned_accelerometers,
    "accelerometers turned 2 deg, as the tool states": disturbances.turned_accelerometers,
}
# Settings of kinds that are not judged with the defaults. A turn of 2 deg about any axis has this rms about each axis.
_SETTINGS = {
    "accelerometers turned 2 deg, as the tool states": StationSettings(
        errors=SensorErrors(mount_deg=2.0 / math.sqrt(3.0))
    ),
}
# What the table's row of all disturbed stations holds: interference, storms, references.
POOLED = tuple(KINDS)[1:6]


def station(kind: Disturbance, rng: np.random.Generator, settings: StationSettings | None = None) -> Judged:
    """One drawn station, decided with nothing before it."""
    earth, reference = truth.drawn_place(rng)
    inclination, azimuth = rng.uniform(3.0, 110.0) * DEG, rng.uniform(0.0, math.tau)
    now = kind(tool_code.drawn_tool(rng), earth.drawn(tool_code.OF_STATION, rng), rng)
    mat_tn = truth.tool_attitude(inclination, azimuth, rng.uniform(0.0, math.tau), now.tool, rng).T
    f_t = mat_tn @ np.array([0.0, 0.0, -now.earth.gravity])
    b_t = mat_tn @ (now.earth.field_n + now.outside_n) + now.of_string
    average = judge.still(*now.tool.read(f_t, b_t, rng), 0)
    return judge.judged(judge.decide(judge.new_decision(settings), average, reference), inclination, azimuth)


def stations(name: str, count: int, seed: int) -> list[Judged]:
    """So many stations of a kind; the same for the same seed, whatever other kinds are drawn."""
    rng = np.random.default_rng([seed, list(KINDS).index(name)])
    return [station(KINDS[name], rng, _SETTINGS.get(name)) for _ in range(count)]
