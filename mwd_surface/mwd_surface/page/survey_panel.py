# SPDX-License-Identifier: Apache-2.0
"""
Survey tables of the page: rows of the survey table, quality lights of the last survey, the well path with ellipses.

The tables are plain JSON data; numbers are in SI and rad, None is unknown.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import ROTARY, Survey, Verdict
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.remark import sentences
from mwd_surface.page.plain import number, numbers
from mwd_surface.signals.signal import Signal
from mwd_surface.signals.table import LISTED, page_fields
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.station_quality import QualityLimits, totals
from mwd_surface.surveys.survey_csv import Line
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.trajectory.well_path import Definitive
from mwd_surface.uncertainty.position_covariance import ellipse, in_section

_ON_PATH = {signal.name for signal, _ in LISTED}
_ROW = page_fields("surveys")
# Kind of number on the page (units.js) for each unit used in files.
_KINDS = {
    "m": "length",
    "deg": "angle",
    "deg/30 m": "dogleg",
    "m/s^2": "gravity",
    "nT": "field",
    "deg/h": "slow_rate",
    "rpm": "rotation",
    "degC": "temperature",
    "s": "seconds",
    "1": "index",
}


def _kind(signal: Signal) -> str:
    """Return the kind of number of a signal on the page, such as "length"; "inclination" may be shown as a dip."""
    return "inclination" if signal.is_inclination else _KINDS[signal.listed_scale.symbol]


#: Columns of the survey table, in order: field of a row, title, kind of number, and smallest screen on which the column
#: is shown (0: any, 1: tablet, 2: wide).
COLUMNS = [
    {"field": name, "title": signal.listed.title, "kind": _kind(signal), "width": shown.width}
    for shown, name, signal in sorted((one.shown, name, one) for name, one in _ROW.items() if one.shown is not None)
    if signal.listed is not None
]


def survey_row(record: SurveyRecord, north: North, limits: QualityLimits | None = None) -> dict[str, Any]:
    """
    Return one row of the survey table; the azimuth is from `north` if possible, else from the survey's own north.

    limits: limits of the totals, used if the survey has none.
    """
    s, line = record.survey, Line(record, north)
    word, by = _verdict(record)
    return {
        "sequence": s.sequence,
        "stamp_ns": s.stamp_ns,
        "kind": "rotary" if s.kind == ROTARY else "static",
        **{name: number(line.value(signal.record)) for name, signal in _ROW.items()},
        "azimuth_north": line.north_word,
        "method": azimuth_source(s).words or s.azimuth_method,
        "automatic": Verdict(s.verdict).word,
        "verdicts": list(s.verdicts),
        "headline": s.action,
        "first": _other_value(record.replaced, line.north),
        "revised": _other_value(record.proposal, line.north),
        "alternatives": _alternatives(s, line.north),
        "totals": _lights(s, limits),
        "disturbances": [[words, number(odds)] for words, odds in s.disturbances],
        "verdict": word,
        "accepted_by": by,
        "in_use": record.in_use,
        "assumed": record.assumed,
        "reasons": list(s.reasons),
        "judged_reason": record.reason,
        "flags": list(record.flags),
        "comment": record.comment,
        "leg": record.leg,
        "tool": record.tool,
    }


def _other_value(survey: Survey | None, north: North) -> dict[str, Any] | None:
    """Return azimuth, its sigma and the verdict of a replaced or proposed revision of a survey; None without one."""
    if survey is None:
        return None
    return {
        "azimuth": number(survey.azimuth_from(north)),
        "sigma_azimuth": number(survey.sigma_azimuth),
        "verdict": Verdict(survey.verdict).word,
    }


def _alternatives(s: Survey, north: North) -> list[list[float | None]]:
    return [[number(other), number(odds)] for other, odds in s.alternatives_from(north)]


def _verdict(record: SurveyRecord) -> tuple[str, str]:
    """Return the verdict in force, and the name of the person who gave it, or "automatic"."""
    if record.judgement == Judgement.ACCEPTED:
        return "accepted", record.operator_name
    if record.judgement == Judgement.REJECTED:
        return "rejected", record.operator_name
    if record.in_use:
        return "accepted", "automatic"
    automatic = Verdict(record.survey.verdict)
    return {Verdict.ACCEPT: "waiting", Verdict.DOUBTFUL: "doubtful", Verdict.REJECT: "rejected"}[automatic], "automatic"


def _lights(s: Survey, limits: QualityLimits | None) -> list[dict[str, Any]]:
    return [
        {
            "name": total.name,
            "unit": total.unit,
            "value": number(total.value),
            "reference": number(total.reference),
            "deviation": number(total.deviation),
            "limit": number(total.limit),
            "light": total.light,
            "corrected": total.corrected,
        }
        for total in totals(s, limits)
    ]


def quality_lights(record: SurveyRecord, limits: QualityLimits, north: North = North.UNKNOWN) -> dict[str, Any]:
    """
    Return the quality of a survey: verdicts, totals, and alternative azimuths.

    limits: limits of the totals, used if the survey has none. north: north of the azimuths, if possible.
    """
    s = record.survey
    line = Line(record, north)
    return {
        "lights": _lights(s, limits),
        "verdict": Verdict(s.verdict).name.lower(),
        "verdicts": list(s.verdicts),
        "headline": s.action,
        "azimuth": number(line.azimuth),
        "alternatives": _alternatives(s, line.north),
        "reasons": [text for text in dict.fromkeys((*s.reasons, *record.flags)) if text],
        "sequence": s.sequence,
        "stamp_ns": s.stamp_ns,
    }


def path_table(path: Definitive | None, section: float, covariance: Array | None, most: int) -> dict[str, Any]:
    """
    Return the well path as columns for the page.

    section: azimuth of the vertical section, rad. covariance, shape (m, 3, 3): covariance of the first m positions,
    m^2, for the ellipses. most: number of stations to keep, counted from the last.
    """
    columns = {name: signal.field for name, signal in page_fields("path").items() if signal.name in _ON_PATH}
    if path is None:
        return {
            **{name: [] for name in columns},
            "kind": [],
            "assumptions": [],
            "north_reference": "",
            "ellipses": [],
            "left_out": 0,
        }
    first = max(0, len(path.md) - most)
    return {
        **{name: numbers(getattr(path, field)[first:]) for name, field in columns.items()},
        "kind": list(path.kind[first:]),
        "assumptions": list(sentences(path.assumptions)),
        "north_reference": path.north.name.lower(),
        "section_azimuth": number(section),
        "ellipses": [] if covariance is None else _ellipses(np.asarray(covariance, dtype=float), first, section),
        "left_out": first,
    }


def _ellipses(covariance: Array, first: int, section: float) -> list[dict[str, Any]]:
    """Return two-sigma ellipses of up to ten stations: in the map (north, east) and in the section (along, down)."""
    rows = []
    stations = range(first, len(covariance))
    for k in list(stations)[:: max(1, -(-len(stations) // 10))]:
        whole = covariance[k]
        if not np.all(np.isfinite(whole)):
            continue
        plan, side = ellipse(whole[:2, :2]), ellipse(in_section(whole, section))
        rows.append(
            {
                "station": k - first,
                "plan": [number(plan.major), number(plan.minor), number(plan.angle)],
                "section": [number(side.major), number(side.minor), number(side.angle)],
            }
        )
    return rows
