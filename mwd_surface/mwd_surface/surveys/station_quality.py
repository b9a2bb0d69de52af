# SPDX-License-Identifier: Apache-2.0
"""
Comparison of total gravity, total field and dip of a survey with their references and limits.

All tables, quality lights and plots use this comparison. If the azimuth is corrected for the string's field, total
field and dip are judged without that field. The measured values are shown separately, because the limits do not apply
to them.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.survey.quality_settings import LIMITS, REJECT_FACTOR
from mwd_estimation.survey.survey import STATIC, Survey, Verdict
from mwd_surface.surveys.azimuth_source import azimuth_source

GOOD, DOUBTFUL, REJECT = "good", "doubtful", "reject"
NO_REFERENCE, NOT_MEASURED = "no reference", "not measured"
# Limits of gravity, m/s^2, field, T, and dip, rad, of a survey that has no limits of its own.
_USUAL = LIMITS["service"].tolist()


@dataclasses.dataclass(frozen=True)
class Total:
    """One total of a survey: gravity, m/s^2, field, T, or dip, rad."""

    name: str
    unit: str
    read: float | None  #: measured value, None without that sensor
    value: float | None  #: value that is judged
    reference: float | None  #: reference value, None if there is none
    deviation: float | None  #: value minus reference as used by the verdict, None if either is unknown
    limit: float  #: largest absolute deviation that is good
    light: str  #: GOOD, DOUBTFUL or REJECT; NO_REFERENCE or NOT_MEASURED if no judgement is possible
    corrected: bool  #: whether `value` excludes the string's field


def totals(survey: Survey) -> tuple[Total, Total, Total]:
    """Return total gravity, total field and dip of a survey."""
    s = survey
    magnetic = math.isfinite(s.b_total)
    reference = magnetic and s.has_reference
    gravity = s.g_total if s.has_readings else None
    field, dip, corrected = _earth_field(s)
    rows = (
        ("total gravity", "m/s^2", gravity, gravity, s.g_reference if math.isfinite(s.g_reference) else None),
        ("total field", "T", *((s.b_total, field) if magnetic else (None, None)), s.b_reference if reference else None),
        ("dip", "rad", *((s.dip, dip) if magnetic else (None, None)), s.dip_reference if reference else None),
    )
    own = zip((s.g_deviation, s.b_deviation, s.dip_deviation), (s.g_limit, s.b_limit, s.dip_limit), strict=True)
    found = []
    for (name, unit, read, value, wanted), (off, mine), default in zip(rows, own, _USUAL, strict=True):
        limit = mine if math.isfinite(mine) else default
        away = None if value is None or wanted is None else value - wanted
        if away is not None and math.isfinite(off):
            # Use the deviation that the verdict used. For example, gravity is compared with standard gravity if the
            # tool was calibrated with that value.
            away = off
        light = NOT_MEASURED if value is None else _light(away, limit)
        of_string = corrected and name != "total gravity"
        found.append(Total(name, unit, read, value, wanted, away, limit, light, of_string))
    return found[0], found[1], found[2]


def _earth_field(s: Survey) -> tuple[float, float, bool]:
    """Return total field, T, and dip, rad, as judged, and whether they are corrected for the string's field."""
    # In a hole so steep that the toolface is undetermined, the verdict uses the measured field.
    steep = s.kind == STATIC and s.verdict_toolface == Verdict.NOT_DETERMINED
    corrected = azimuth_source(s).without_axial and not steep
    if not corrected or not math.isfinite(s.b_total + s.specific_force[0]):
        return s.b_total, s.dip, False
    b_t = np.array(s.magnetic_field) - np.array([s.axial_interference, 0.0, 0.0])
    return float(np.linalg.norm(b_t)), float(magnetic_geometry.dip(np.array(s.specific_force), b_t)), True


def _light(deviation: float | None, limit: float) -> str:
    if deviation is None or not math.isfinite(deviation):
        return NO_REFERENCE
    size = abs(deviation)
    if size <= limit:
        return GOOD
    return DOUBTFUL if size <= REJECT_FACTOR * limit else REJECT
