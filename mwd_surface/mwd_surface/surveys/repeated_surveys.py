# SPDX-License-Identifier: Apache-2.0
"""Rotation shots and check shots of a survey list, and their description in a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.survey import tool_code
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.surveys.check_shots import Bias, CheckShot, check_shots
from mwd_surface.surveys.survey_record import SurveyRecord

# Unit, factor from SI and number of decimals of a bias.
_UNITS = {"accelerometer": ("mG", 1e3 / STANDARD_GRAVITY, 2), "magnetometer": ("nT", 1e9, 0)}


def shots_of(records: Iterable[SurveyRecord], code: str) -> tuple[tuple[CheckShot, tuple[int, ...]], ...]:
    """
    Return the comparisons of surveys that were repeated at one depth, each with the numbers of its surveys.

    code: tool code of the well; for a code without magnetic sensors the default `SensorErrors` are used. Surveys
    without force, field or depth, and surveys with the verdict reject, are left out.
    """
    used = [
        record
        for record in records
        if record.survey.has_readings
        and math.isfinite(record.survey.b_total)
        and math.isfinite(record.measured_depth)
        and record.survey.verdict != Verdict.REJECT
    ]
    if len(used) < 2:
        return ()
    try:
        errors = tool_code.sensor_errors(code)
    except ValueError:
        errors = SensorErrors()
    found = check_shots(
        [record.measured_depth for record in used],
        [record.survey.specific_force for record in used],
        [record.survey.magnetic_field for record in used],
        errors,
        [record.tool for record in used],
    )
    return tuple((shot, tuple(used[k].survey.sequence for k in shot.rows)) for shot in found)


def tools_text(shot: CheckShot) -> str:
    """Return the names of the tools of a check shot; empty for a rotation shot, which has one tool only."""
    return " and ".join(tool or "an unnamed tool" for tool in shot.tools) if len(shot.tools) > 1 else ""


def sentence(shot: CheckShot) -> str:
    """Return a sentence on the comparison of surveys at one depth."""
    kind = "rotation shot"
    if len(shot.tools) > 1:
        kind = f"check shot by {tools_text(shot)}"
    spread, expected = math.degrees(shot.spread_inclination), math.degrees(shot.expected_inclination)
    parts = [f"inclination spread {spread:.3f} deg (expected {expected:.3f})"]
    if math.isfinite(shot.azimuth):
        parts.append(
            f"azimuth {math.degrees(shot.spread_azimuth):.2f} deg (expected {math.degrees(shot.expected_azimuth):.2f})"
        )
    parts += [bias_text(bias) for bias in shot.biases if bias.excessive]
    return f"{shot.md:.1f} m, {kind} of {len(shot.rows)} surveys: {shot.verdict}; " + ", ".join(parts)


def bias_text(bias: Bias) -> str:
    """Return a sentence with a bias, its 1 sigma, and the 1 sigma of the tool code."""
    unit, factor, decimals = _UNITS[bias.sensor]
    value, sigma, expected = (factor * x for x in (bias.value, bias.sigma, bias.expected))
    return (
        f"{bias.sensor} {bias.axis} bias {value:+.{decimals}f} +- {sigma:.{decimals}f} {unit}"
        f" (1 sigma of the tool code {expected:.{decimals}f})"
    )
