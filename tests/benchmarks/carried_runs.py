"""
Monte Carlo of the azimuth carried while drilling: error, sigma and NEES over what a string does, from raw samples.

Everything that its sigma allows for is drawn, run by run: the reference's field and declination, interference along
and across the axis, and by the sonde every error of its instruments.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any

import numpy as np
import yaml

from mwd_estimation.pipeline import Pipeline
from mwd_estimation.settings import EstimatorSettings, Place, reference_of
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde

# Cases: stations of the hole (m, deg, deg), depth of the bit, phases, and what else is special.
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
        TANGENT, 50.0, [_still(15.0), _drill(70.0), CONNECTION, _drill(70.0)],
        {"vibration": {**VIBRATION, "stick_slip": {"frequency_hz": 0.2, "depth": 1.0}}},
    ),
    "slide, warming up": (
        TANGENT, 50.0, [_still(15.0), _slide(50.0, 30.0), _slide(50.0, -60.0), CONNECTION, _slide(40.0, 180.0)],
        {"vibration": HUNTING, "temperature": {"warm_up_c": 15.0, "warm_up_s": 120.0}},
    ),
    "build, 1800 m/h": (
        ([0.0, 20.0, 35.0], [150.0, 50.0, 50.0], [250.0, 70.0, 60.0]), 20.0, [_drill(50.0, 1800.0), CONNECTION] * 3, {},
    ),
    "beside a cased well, 4 m": (
        SHOE, 20.0, FAST,
        {"offset_wells": [
            {"start_m": [2.0, 10.0, 20.0], "end_m": [12.0, 60.0, 110.0], "joint_m": 12.0, "strength_uwb": 150.0}
        ], "tool_joints": {"spacing_m": 9.0, "axial_nt": 1500.0, "width_m": 0.4}},
    ),
    "out of a casing shoe": (
        SHOE, 20.0, FAST, {"poles": [{"position_m": [0.5, 3.5, 16.0], "strength_uwb": 400.0}]},
    ),
    "horizontal, due east": (([0.0, 90.0, 90.0],), 500.0, FAST, {}),
    "magnetometer lost, drilling": (TANGENT, 50.0, [_still(20.0), _drill(140.0)], {"faults": OFF_AFTER_60_S}),
    "magnetometer lost, sliding": (TANGENT, 50.0, [_still(20.0), _slide(140.0, 30.0)], {"faults": OFF_AFTER_60_S}),
}  # fmt: skip
HEAD = "| while | gyros | given % | error rms deg | sigma deg | NEES |"


def spread(runs: int, columns: int, rng: np.random.Generator) -> Array:
    """Normal draws, shape (runs, columns), each column a shuffle of evenly likely values of unit mean square."""
    evenly = np.array([NormalDist().inv_cdf((k + 0.5) / runs) for k in range(runs)])
    evenly /= math.sqrt(float(np.mean(evenly**2)))
    return np.stack([rng.permutation(evenly) for _ in range(columns)], axis=1)


def carried(name: str, runs: int, first: int) -> list[str]:
    """
    Rows of a case with the precision unit and without, judged once a second.

    600 nT of interference along the axis, 60 nT across it, one sigma; `first` is the first of the seeds.
    """
    stations, bit, phases, special = CASES[name]
    special = dict(special)
    interference = {key: special.pop(key) for key in ("offset_wells", "tool_joints", "poles") if key in special}
    told: dict[str, Any] = {
        "date": "2026-03-01", "vibration": VIBRATION, "schedule": phases,
        "well": {"stations": [list(one) for one in stations], "bit_m": bit, "sensor_to_bit_m": 3.0}, **special,
    }  # fmt: skip
    # Every case its own draws, so that chance is not the same in all.
    first += 1000 * list(CASES).index(name)
    draws = spread(runs, 6, np.random.default_rng(first))
    table, shown = [], {True: [], False: []}
    for r in range(runs):
        told["seed"] = first + r
        told["interference"] = {
            **interference, "axial_nt": 600.0 * float(draws[r, 0]), "cross_nt": [60.0 * float(v) for v in draws[r, 1:3]]
        }  # fmt: skip
        plain = scenario.parse(yaml.safe_dump(told))
        field = Place(
            field="model", lat_deg=plain.place.latitude_deg, lon_deg=plain.place.longitude_deg,
            height_m=plain.place.height_m, date="2026-03-01",
        )  # fmt: skip
        reference = reference_of(field, 0)
        assert reference is not None
        assert reference.total is not None
        assert reference.dip is not None
        assert reference.declination is not None
        declination = math.sqrt(reference.declination_variance(reference.horizontal))
        drawn = [
            (reference.total + reference.sigma_total * float(draws[r, 3])) * 1e9,
            math.degrees(reference.dip + reference.sigma_dip * float(draws[r, 4])),
            math.degrees(reference.declination + declination * float(draws[r, 5])),
        ]
        blocks = list(Sonde(scenario.parse(yaml.safe_dump({**told, "field_override": drawn}))).blocks(2.0))
        for fine in (True, False):
            pipeline = Pipeline(EstimatorSettings(place=field))
            attitude = []
            for block in blocks:
                pipeline.push_mag(block["imu/mag"])
                if fine:
                    pipeline.push_precision(block["gyro/data_raw"])
                pipeline.push_temperature(block["imu/temperature"])
                attitude.append(pipeline.push_imu(block["imu/data_raw"]).attitude)
            rows_ = np.concatenate(attitude)[::100]
            truth = np.concatenate([block["truth"] for block in blocks])
            azimuth = truth["azimuth"][np.searchsorted(truth["stamp_ns"], rows_["stamp_ns"])]
            known = rows_["sigma_azimuth"] > 0.0
            off = wrap_pi(rows_["azimuth"] - azimuth)[known]
            shown[fine].append((float(np.mean(known)), off, rows_["sigma_azimuth"][known]))
    for fine, gyros in ((True, "tactical"), (False, "MTi class alone")):
        given = float(np.mean([one[0] for one in shown[fine]]))
        error = math.sqrt(float(np.mean([np.mean(one[1] ** 2) for one in shown[fine]])))
        sigma = float(np.median(np.concatenate([one[2] for one in shown[fine]])))
        nees = float(np.mean([np.mean((one[1] / one[2]) ** 2) for one in shown[fine]]))
        table.append(
            f"| {name} | {gyros} | {100.0 * given:.0f} | {math.degrees(error):.2f} | {math.degrees(sigma):.2f} | "
            f"{nees:.2f} |"
        )
    return table
