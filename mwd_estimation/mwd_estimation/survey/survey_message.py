# SPDX-License-Identifier: Apache-2.0
"""
A survey as the fields of mwd_msgs/msg/Survey, unknown values as that message defines them; nothing of ROS is imported.

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


def known(value: float | None, otherwise: float) -> float:
    """The value, or the stand-in that the message defines for unknown."""
    return otherwise if value is None or not math.isfinite(value) else float(value)


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
        **{name: known(off, 0.0) for name, off in zip(DEVIATIONS, station.deviations.values, strict=True)},
        **{name: known(limit, -1.0) for name, limit in zip(LIMITS, station.limits, strict=True)},
    }


def survey_fields(survey: Survey) -> dict[str, Any]:
    """Every field but the header, by name; `azimuths` as tables of the fields of mwd_msgs/msg/AzimuthEstimate."""
    station, reference = survey.station, survey.station.reference
    has_mag = bool(np.isfinite(station.b_t).all())
    covariance = np.nan_to_num(station.covariance)
    if not math.isfinite(station.azimuth):
        covariance[1, :], covariance[:, 1] = 0.0, 0.0
        covariance[1, 1] = -1.0
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
        "specific_force": np.nan_to_num(station.f_t),
        "specific_force_covariance": survey.covariance_f.ravel(),
        "magnetic_field": np.nan_to_num(station.b_t),
        "magnetic_field_covariance": survey.covariance_b.ravel() if has_mag else np.array([-1.0] + [0.0] * 8),
        "angular_rate": survey.rate_t,
        "temperature": known(survey.temperature, -300.0),
        "inclination": known(station.inclination, 0.0),
        "azimuth": known(station.azimuth, 0.0),
        "gravity_toolface": known(station.gravity_toolface, 0.0),
        "magnetic_toolface": known(station.magnetic_toolface, 0.0),
        "covariance": covariance.ravel(),
        "north": north,
        "azimuth_method": str(station.method),
        "azimuths": [
            {
                "method": str(one.method),
                "north": north,
                "azimuth": known(one.azimuth, 0.0),
                "sigma": known(one.sigma, -1.0),
                "weight": survey.weights.get(one.method, 0.0),
                "reason": _words(one.refused),
            }
            for one in station.azimuths
        ],
        "g_total": known(station.g_total, 0.0),
        "b_total": known(station.b_total, -1.0),
        "dip": known(station.dip, 0.0),
        "g_reference": known(reference.gravity if reference else None, -1.0),
        "b_reference": known(reference.total if reference else None, -1.0),
        "dip_reference": known(reference.dip if reference else None, 0.0),
        "declination": known(reference.declination if reference else None, math.nan),
        "convergence": known(reference.convergence if reference else None, math.nan),
        "reference_source": reference.source if reference else "",
        "axial_interference": known(station.interference, 0.0),
        "sigma_axial_interference": known(station.sigma_interference, -1.0),
        **_totals_fields(station),
        **_verdict_fields(station),
        "status": survey.status,
    }
