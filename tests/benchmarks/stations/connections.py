# SPDX-License-Identifier: Apache-2.0
"""Simulated sondes on a rig that makes a connection every stand: surveys from raw samples, steel beside the hole."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.settings import from_mapping
from mwd_sensors.simulator.scenario import Scenario
from simulated_surveys import Beside, surveys
from stations.tool_code import DEG

HEAD = (
    "| rest s | sway deg | conventional unit | steel | clean stations | accepted % | > 3 sigma | rms deg "
    "| best single method | at steel: accepted | > 3 sigma | first after it |"
)
_STATIONS, _STAND_M = 20, 28.0
# Sonde depths between which steel turns and stretches the field: seven stations of the twenty.
_STEEL_M = (220.0, 400.0)
_SWAY_HZ = 0.12


@dataclasses.dataclass(frozen=True)
class Run:
    """Seconds at rest at a connection, sway of the string there, deg, grade of the conventional unit, steel, seed."""

    rest_s: float
    sway_deg: float
    grade: str
    steel: bool
    seed: int


RUNS = (
    Run(27.0, 0.0, "mti3_calibrated", False, 1),
    Run(50.0, 0.0, "mti3_calibrated", False, 2),
    Run(50.0, 0.2, "mti3_calibrated", False, 3),
    Run(40.0, 0.1, "owsg_mwd", False, 4),
    Run(27.0, 0.05, "owsg_mwd", True, 5),
    Run(50.0, 0.2, "owsg_mwd", True, 6),
)


def story(run: Run) -> Scenario:
    """Twenty stands of a curve; penetration is hurried, so that a run takes half an hour."""
    anomalies: list[dict[str, Any]] = []
    if run.steel:
        rng = np.random.default_rng(run.seed)
        size = rng.uniform(800.0, 4000.0, 3) * rng.choice([-1.0, 1.0], 3)
        first, last = _STEEL_M
        depths = (first, first + 5.0, 0.5 * (first + last), last - 5.0, last)
        shares = ((0.0, 0.0, 0.0), (1.0, 0.4, 0.2), (0.3, 1.0, 0.6), (0.2, 0.5, 1.0), (0.0, 0.0, 0.0))
        anomalies = [
            {"md_m": md, "field_nt": (size * share).tolist()} for md, share in zip(depths, shares, strict=True)
        ]
    sway = 2.0 * math.pi * _SWAY_HZ * run.sway_deg
    table = {
        "name": "connections",
        "seed": run.seed,
        "well": {"stations": [[0.0, 20.0, 40.0], [600.0, 80.0, 95.0]], "bit_m": 30.0, "sensor_to_bit_m": 12.0},
        "rig": {"stand_m": _STAND_M},
        "schedule": [
            {"kind": "drill", "seconds": 31.0, "rpm": 120.0, "rop_m_h": 3600.0},
            {"kind": "connection", "seconds": run.rest_s},
        ],
        "cycles": _STATIONS,
        "vibration": {
            "random": [
                {"band_hz": [8.0, 300.0], "acceleration_mps2": [5.0, 10.0, 10.0], "rate_deg_s": [4.0, 1.0, 1.0]}
            ],
            "tones": [{"frequency_hz": _SWAY_HZ, "rate_deg_s": [0.3 * sway, sway, sway], "when": "always"}],
        },
        "ahrs": {"grade": run.grade},
        "interference": {"axial_nt": 700.0, "anomalies": anomalies},
    }
    return from_mapping(Scenario, table)


def drawn(seed: int) -> Run:
    """A run with steel whose rest, sway and conventional unit are drawn."""
    rng = np.random.default_rng(seed)
    grade = str(rng.choice(["mti3_calibrated", "owsg_mwd"]))
    return Run(round(float(rng.uniform(27.0, 50.0))), round(float(rng.uniform(0.0, 0.2)), 2), grade, True, seed)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Surveys of a run."""

    run: Run
    #: `clean`, `at_steel`: stations away from steel and beside it.
    clean: int
    at_steel: int
    #: `accepted`, `accepted_at_steel`: accepted ones of these.
    accepted: int
    accepted_at_steel: int
    #: `beyond`, `beyond_at_steel`: accepted ones with an azimuth more than 3 sigma off.
    beyond: int
    beyond_at_steel: int
    error: Array  #: shape (accepted,); error of the azimuths accepted away from steel, rad
    best: float  #: root mean square error, rad, of the single method that errs least away from steel
    method: str  #: name of this method
    first_after: str  #: verdict of the first station after steel


def outcome(run: Run) -> Outcome:
    """Take the surveys of a run."""
    found = surveys(story(run))
    md = np.array([one.measured_depth for one in found])
    at = run.steel & (md > _STEEL_M[0]) & (md < _STEEL_M[1])
    accepted = np.array([one.accepted for one in found])
    error = np.array([one.azimuth_error for one in found])
    beyond = accepted & (np.abs(error) > 3.0 * np.array([one.sigma_azimuth for one in found]))
    best, method = _best([one for one, out in zip(found, at, strict=True) if not out])
    after = [one.survey.station.verdict for one, depth in zip(found, md, strict=True) if depth > _STEEL_M[1]]
    return Outcome(
        run,
        int((~at).sum()),
        int(at.sum()),
        int((accepted & ~at).sum()),
        int((accepted & at).sum()),
        int((beyond & ~at).sum()),
        int((beyond & at).sum()),
        error[accepted & ~at],
        best,
        method,
        after[0] if run.steel else "",
    )


def row(one: Outcome) -> str:
    """Row of a run under `HEAD`."""
    run = one.run
    words = [f"{run.rest_s:g}", f"{run.sway_deg:g}", run.grade, "yes" if run.steel else "no"]
    return _row(words, [one], f"{one.best / DEG:.2f} {one.method}", one.first_after)


def all_rows(found: Sequence[Outcome]) -> str:
    """Row of several runs with steel together, and in how many an azimuth errs more than 1.1 times the best method."""
    best = math.sqrt(np.mean([one.best**2 for one in found]))
    above = sum(_rms(one.error) > 1.1 * one.best for one in found)
    normal = sum(one.first_after == "accept" for one in found)
    words = [f"all {len(found)}", "", "", "yes"]
    return _row(words, found, f"{best / DEG:.2f}; exceeded by a tenth in {above}", f"{normal} of {len(found)} accept")


def _row(words: list[str], found: Sequence[Outcome], best: str, first_after: str) -> str:
    def total(name: str) -> int:
        return sum(getattr(one, name) for one in found)

    error = np.concatenate([one.error for one in found])
    words = [*words, str(total("clean")), f"{100.0 * total('accepted') / max(total('clean'), 1):.0f}"]
    words += [str(total("beyond")), f"{_rms(error) / DEG:.2f}", best]
    at_steel = total("at_steel")
    words += [f"{total('accepted_at_steel')} of {at_steel}", str(total("beyond_at_steel"))] if at_steel else [""] * 2
    return "| " + " | ".join([*words, first_after]) + " |"


def _best(found: Sequence[Beside]) -> tuple[float, str]:
    """Root mean square error, rad, of the single method that errs least over the stations, and its name."""
    errors: dict[str, list[float]] = {}
    for one in found:
        for azimuth in (two for two in one.survey.station.azimuths if two.method != AzimuthMethod.GYRO_PROPAGATED):
            turned = float(wrap_pi(azimuth.azimuth - one.survey.station.azimuth))
            errors.setdefault(str(azimuth.method), []).append(turned + one.azimuth_error)
    whole = {name: _rms(np.array(values)) for name, values in errors.items() if len(values) > 0.8 * len(found)}
    return min((size, name) for name, size in whole.items() if math.isfinite(size))


def _rms(values: Array) -> float:
    return math.sqrt(np.mean(values**2)) if len(values) else math.nan
