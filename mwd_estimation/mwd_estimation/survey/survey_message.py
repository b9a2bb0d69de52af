# SPDX-License-Identifier: Apache-2.0
"""
A survey as the fields of mwd_msgs/msg/Survey; nothing of ROS is imported.

The estimator node and those who write bags without middleware fill the same message from here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.core import reason_text
from mwd_estimation.core.reasons import Reason
from mwd_estimation.survey.magnetic_feedback import NORTH_CODES
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.survey import ROTARY, STATIC, Survey

KINDS = {STATIC: 0, ROTARY: 1}
# Of gravity, field and dip, as `Station.limits` has them.
DEVIATIONS, LIMITS = ("g_deviation", "b_deviation", "dip_deviation"), ("g_limit", "b_limit", "dip_limit")
VERDICTS = {"accept": 0, "doubtful": 1, "reject": 2, "not_determined": 3}


def _number(value: float | None) -> float:
    """Return a number of the message: NaN where it is not known."""
    return math.nan if value is None or not math.isfinite(value) else float(value)


def _words(reason: Reason | None) -> str:
    return "" if reason is None else reason_text.text(reason)


def _verdict_fields(station: Station) -> dict[str, Any]:
    """The verdicts with their reasons, other azimuths and hypotheses."""
    return {
        "verdict": VERDICTS[station.verdict],
        "verdict_inclination": VERDICTS[station.verdicts.inclination],
        "verdict_azimuth": VERDICTS[station.verdicts.azimuth],
        "verdict_toolface": VERDICTS[station.verdicts.toolface],
        "headline": _words(station.headline),
        "reasons": reason_text.texts(station.reasons),
        "alternatives": np.array([azimuth for azimuth, _ in station.alternatives]),
        "alternative_odds": np.array([odds for _, odds in station.alternatives]),
        "hypotheses": [str(name) for name, _ in station.hypotheses],
        "hypothesis_odds": np.array([odds for _, odds in station.hypotheses]),
    }


def _totals_fields(station: Station) -> dict[str, Any]:
    """Deviations of the totals as the verdict takes them, and what makes it doubtful."""
    return {
        **{name: _number(off) for name, off in zip(DEVIATIONS, station.deviations.values, strict=True)},
        **{name: _number(limit) for name, limit in zip(LIMITS, station.limits, strict=True)},
    }


def survey_fields(survey: Survey) -> dict[str, Any]:
    """Every field but the header, by name; `azimuths` as tables of the fields of mwd_msgs/msg/AzimuthEstimate."""
    station, reference = survey.station, survey.station.reference
    covariance = np.array(station.covariance, dtype=float)
    covariance[:, ~np.isfinite([station.inclination, station.azimuth, station.gravity_toolface])] = np.nan
    covariance[np.isnan(covariance.T)] = np.nan
    north = NORTH_CODES[station.north]
    return {
        "uuid": survey.uuid,
        "sequence": survey.sequence,
        "revision": survey.revision,
        "withdrawn": survey.withdrawn,
        "kind": KINDS[survey.kind],
        "requested": survey.requested,
        "duration": survey.duration,
        "samples": survey.samples,
        "specific_force": station.f_t,
        "specific_force_covariance": survey.covariance_f.ravel(),
        "magnetic_field": station.b_t,
        "magnetic_field_covariance": survey.covariance_b.ravel(),
        "angular_rate": survey.rate_t,
        "temperature": _number(survey.temperature),
        "inclination": _number(station.inclination),
        "azimuth": _number(station.azimuth),
        "gravity_toolface": _number(station.gravity_toolface),
        "magnetic_toolface": _number(station.magnetic_toolface),
        "covariance": covariance.ravel(),
        "north": north,
        "azimuth_method": str(station.method),
        "azimuths": [
            {
                "method": str(one.method),
                "north": north,
                "azimuth": _number(one.azimuth),
                "sigma": _number(one.sigma),
                "weight": survey.weights.get(one.method, 0.0),
                "reason": _words(one.refused),
            }
            for one in station.azimuths
        ],
        "g_total": _number(station.g_total),
        "b_total": _number(station.b_total),
        "dip": _number(station.dip),
        "g_reference": _number(reference.gravity if reference else None),
        "b_reference": _number(reference.total if reference else None),
        "dip_reference": _number(reference.dip if reference else None),
        "declination": _number(reference.declination if reference else None),
        "convergence": _number(reference.convergence if reference else None),
        "reference_source": reference.source if reference else "",
        "axial_interference": _number(station.interference),
        "sigma_axial_interference": _number(station.sigma_interference),
        **_totals_fields(station),
        **_verdict_fields(station),
        "status": survey.status,
    }
