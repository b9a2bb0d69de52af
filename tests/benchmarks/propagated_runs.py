# SPDX-License-Identifier: Apache-2.0
"""
Monte Carlo of the azimuth while drilling: error, sigma and NEES over what a string does, from raw samples.

Everything that its sigma allows for is drawn, run by run: the reference's field and declination, interference along
and across the axis, and by the sonde every error of its instruments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
import yaml

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place, reference_of
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde

# Interference along and across the axis, one sigma, nT.
_AXIAL_NT, _CROSS_NT = 600.0, 60.0
_DATE = "2026-03-01"
# Keys of a case that belong to the scenario's interference.
_INTERFERENCE = ("offset_wells", "tool_joints", "poles")
# Cases: stations of the hole (m, deg, deg), depth of the bit, phases, and other keys of the scenario.
VIBRATION = {
    "random": [{"band_hz": [8.0, 300.0], "acceleration_mps2": [5.0, 10.0, 10.0], "rate_deg_s": [4.0, 1.0, 1.0]}],
    "per_turn": [{"per_turn": 1, "speed_fraction": 0.02}],
}
HUNTING = {**VIBRATION, "per_turn": [], "hunting": {"toolface_deg": 12.0, "band_hz": [0.02, 0.4]}}
TANGENT, SHOE = ([0.0, 40.0, 300.0], [200.0, 45.0, 305.0]), ([0.0, 15.0, 80.0], [150.0, 35.0, 90.0])


def _still(seconds: float) -> dict[str, Any]:
    return {"kind": "still", "seconds": seconds, "pumps": False}


def _drill(seconds: float, rop: float = 200.0) -> dict[str, Any]:
    return {"kind": "drill", "seconds": seconds, "rpm": 110.0, "rop_m_h": rop}


def _slide(seconds: float, toolface: float) -> dict[str, Any]:
    return {"kind": "slide", "seconds": seconds, "rop_m_h": 200.0, "toolface_deg": toolface}


CONNECTION = {"kind": "connection", "seconds": 20.0}
FAST = [_still(15.0), *[_drill(20.0, 1800.0), CONNECTION] * 3]
OFF_AFTER_60_S = [{"component": "mag", "fault": "off", "start_s": 60.0}]
CASES: dict[str, tuple[Any, float, list[dict[str, Any]], dict[str, Any]]] = {
    "steady drilling": (TANGENT, 50.0, [_still(15.0), _drill(70.0), CONNECTION, _drill(70.0)], {}),
    "stick-slip": (
        TANGENT,
        50.0,
        [_still(15.0), _drill(70.0), CONNECTION, _drill(70.0)],
        {"vibration": {**VIBRATION, "stick_slip": {"frequency_hz": 0.2, "depth": 1.0}}},
    ),
    "slide, warming up": (
        TANGENT,
        50.0,
        [_still(15.0), _slide(50.0, 30.0), _slide(50.0, -60.0), CONNECTION, _slide(40.0, 180.0)],
        {"vibration": HUNTING, "temperature": {"warm_up_c": 15.0, "warm_up_s": 120.0}},
    ),
    "build, 1800 m/h": (
        ([0.0, 20.0, 35.0], [150.0, 50.0, 50.0], [250.0, 70.0, 60.0]),
        20.0,
        [_drill(50.0, 1800.0), CONNECTION] * 3,
        {},
    ),
    "beside a cased well, 4 m": (
        SHOE,
        20.0,
        FAST,
        {
            "offset_wells": [
                {"start_m": [2.0, 10.0, 20.0], "end_m": [12.0, 60.0, 110.0], "joint_m": 12.0, "strength_uwb": 150.0}
            ],
            "tool_joints": {"spacing_m": 9.0, "axial_nt": 1500.0, "width_m": 0.4},
        },
    ),
    "out of a casing shoe": (
        SHOE,
        20.0,
        FAST,
        {"poles": [{"position_m": [0.5, 3.5, 16.0], "strength_uwb": 400.0}]},
    ),
    "horizontal, due east": (([0.0, 90.0, 90.0],), 500.0, FAST, {}),
    "magnetometer lost, drilling": (TANGENT, 50.0, [_still(20.0), _drill(140.0)], {"faults": OFF_AFTER_60_S}),
    "magnetometer lost, sliding": (TANGENT, 50.0, [_still(20.0), _slide(140.0, 30.0)], {"faults": OFF_AFTER_60_S}),
}
HEAD = "| while | gyros | given % | error rms deg | sigma deg | NEES |"


def evenly_drawn(runs: int, columns: int, rng: np.random.Generator) -> Array:
    """Draw normal numbers, shape (runs, columns): a column shuffles evenly likely values of unit mean square."""
    evenly = np.array([NormalDist().inv_cdf((k + 0.5) / runs) for k in range(runs)])
    evenly /= math.sqrt(float(np.mean(evenly**2)))
    return np.stack([rng.permutation(evenly) for _ in range(columns)], axis=1)


def rows(name: str, runs: int, first_seed: int) -> list[str]:
    """Rows of a case with the precision unit and without, judged once a second."""
    # Every case has draws of its own, so that chance is not the same in all.
    first_seed += 1000 * list(CASES).index(name)
    draws = evenly_drawn(runs, 6, np.random.default_rng(first_seed))
    judged: dict[bool, list[tuple[float, Array, Array]]] = {True: [], False: []}
    for r in range(runs):
        field, blocks = simulated(name, first_seed + r, draws[r])
        for precision in (True, False):
            judged[precision].append(judge(blocks, field, precision))
    return [_row(name, "tactical", judged[True]), _row(name, "MTi class alone", judged[False])]


def simulated(name: str, seed: int, draws: Array) -> tuple[Place, list[Any]]:
    """
    Place and sample blocks of one run of a case.

    draws, shape (6,): interference along and across (2) the axis; field, dip and declination off the model; in sigmas.
    """
    stations, bit, phases, special = CASES[name]
    plan: dict[str, Any] = {
        "date": _DATE,
        "vibration": VIBRATION,
        "schedule": phases,
        "well": {"stations": [list(one) for one in stations], "bit_m": bit, "sensor_to_bit_m": 3.0},
        **{key: value for key, value in special.items() if key not in _INTERFERENCE},
        "seed": seed,
        "interference": {
            **{key: value for key, value in special.items() if key in _INTERFERENCE},
            "axial_nt": _AXIAL_NT * float(draws[0]),
            "cross_nt": [_CROSS_NT * float(v) for v in draws[1:3]],
        },
    }
    place = scenario.parse(yaml.safe_dump(plan)).place
    field = Place(
        field="model",
        lat_deg=place.latitude_deg,
        lon_deg=place.longitude_deg,
        height_m=place.height_m,
        date=_DATE,
    )
    plan["field_override"] = drawn_field(field, draws[3:])
    return field, list(Sonde(scenario.parse(yaml.safe_dump(plan))).blocks(2.0))


def drawn_field(field: Place, draws: Array) -> list[float]:
    """Total field, nT, dip and declination, deg, off the model by `draws`, shape (3,), in sigmas."""
    reference = reference_of(field, 0)
    if reference is None or reference.total is None or reference.dip is None or reference.declination is None:
        raise ValueError("field: the model gives no field here")
    declination = math.sqrt(reference.declination_variance(reference.horizontal))
    return [
        (reference.total + reference.sigma_total * float(draws[0])) * 1e9,
        math.degrees(reference.dip + reference.sigma_dip * float(draws[1])),
        math.degrees(reference.declination + declination * float(draws[2])),
    ]


def judge(blocks: Sequence[Any], field: Place, precision: bool) -> tuple[float, Array, Array]:
    """Share of rows with an azimuth, their errors and their sigmas, rad; with the precision unit or without."""
    pipeline = Pipeline(EstimatorSettings(place=field))
    attitude = []
    for block in blocks:
        pipeline.push_mag(block["imu/mag"])
        if precision:
            pipeline.push_precision(block["gyro/data_raw"])
        pipeline.push_temperature(block["imu/temperature"])
        attitude.append(pipeline.push_imu(block["imu/data_raw"]).attitude)
    estimate = np.concatenate(attitude)[::100]
    truth = np.concatenate([block["truth"] for block in blocks])
    azimuth = truth["azimuth"][np.searchsorted(truth["stamp_ns"], estimate["stamp_ns"])]
    known = estimate["sigma_azimuth"] > 0.0
    error = wrap_pi(estimate["azimuth"] - azimuth)[known]
    return float(np.mean(known)), error, estimate["sigma_azimuth"][known]


def _row(name: str, gyros: str, judged: Sequence[tuple[float, Array, Array]]) -> str:
    given = float(np.mean([share for share, _, _ in judged]))
    error = math.sqrt(float(np.mean([np.mean(e**2) for _, e, _ in judged])))
    sigma = float(np.median(np.concatenate([s for _, _, s in judged])))
    nees = float(np.mean([np.mean((e / s) ** 2) for _, e, s in judged]))
    angles = f"{math.degrees(error):.2f} | {math.degrees(sigma):.2f}"
    return f"| {name} | {gyros} | {100.0 * given:.0f} | {angles} | {nees:.2f} |"
