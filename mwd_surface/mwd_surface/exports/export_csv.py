# SPDX-License-Identifier: Apache-2.0
"""
Surveys as CSV: the definitive survey with its head block, and the raw log of everything that was ever measured.

Lines starting with # are the head block; then one line of column names with units; then numbers with a decimal point
whatever the locale. Text is always in quotes, on one line, and cannot be taken for a formula by a spreadsheet.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from mwd_sensors.core.constants import CELSIUS_ZERO
from mwd_surface.exports.survey_table import SurveyTable, fixed, plain, utc
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.station_quality import totals
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, Survey, SurveyRecord, Verdict
from mwd_surface.trajectory.north import North

_DEG = 180.0 / math.pi
_AXES = ("x", "y", "z")


def quoted(text: str) -> str:
    """A text cell: one line, in quotes, with an apostrophe before what a spreadsheet would compute."""
    line = plain(text)
    if line[:1] in ("=", "+", "-", "@"):
        line = "'" + line
    return '"' + line.replace('"', '""') + '"'


def definitive_csv(table: SurveyTable) -> str:
    """
    The definitive survey: head block, names, one line a station; the projection to the bit is the last, marked.

    Text is UTF-8 when encoded; lines end with a newline.
    """
    lines = [f"# {label}: {value}" for label, value in table.header]
    lines += [f"# {why}" for why in table.left_out]
    lines.append(",".join([*(c.key for c in table.columns), "station", *_DECIDED]))
    for k in table.rows:
        record = table.records[k]
        cells = [column.cell(k) for column in table.columns]
        cells.append(quoted(table.path.kind[k]))
        bare = [quoted(table.path.leg), "", *[quoted("")] * (len(_DECIDED) - 2)]
        cells += _decided(record, table.surveys.north) if record else bare
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def raw_csv(surveys: SurveyList, header: Iterable[tuple[str, str]] = ()) -> str:
    """Every survey of the list, used or not, by number: time, depth, six axes, totals, azimuths, judgements."""
    lines = [f"# {label}: {value}" for label, value in header]
    ordered = sorted(surveys.records, key=lambda r: r.survey.sequence)
    methods = tuple(dict.fromkeys(a.method for r in ordered for a in r.survey.azimuths))
    columns = [*_COLUMNS, *(f"azimuth_{m}_deg" for m in methods), *(f"sigma_azimuth_{m}_deg" for m in methods)]
    lines.append(",".join([*columns, *_TEXTS]))
    lines.extend(",".join(_raw_cells(record, methods)) for record in ordered)
    return "\n".join(lines) + "\n"


_VERDICTS = (
    "verdict_inclination",
    "verdict_azimuth",
    "verdict_toolface",
    "headline",
    "alternatives_deg",
    "alternative_odds",
)
_DECIDED = (
    "leg",
    "survey",
    "time_utc",
    "tool",
    "automatic",
    *_VERDICTS,
    "person",
    "operator",
    "flags",
    "comment",
)
_COLUMNS = (
    "survey",
    "time_utc",
    "md_m",
    "depth_age_s",
    *(f"specific_force_{a}_mps2" for a in _AXES),
    *(f"magnetic_field_{a}_nt" for a in _AXES),
    *(f"angular_rate_{a}_degph" for a in _AXES),
    "temperature_degc",
    "duration_s",
    "samples",
    "g_total_mps2",
    "b_total_nt",
    "dip_deg",
    "g_reference_mps2",
    "b_reference_nt",
    "dip_reference_deg",
    "b_judged_nt",
    "dip_judged_deg",
    "g_limit_mps2",
    "b_limit_nt",
    "dip_limit_deg",
    "declination_deg",
    "convergence_deg",
    "inclination_deg",
    "azimuth_deg",
    "gravity_toolface_deg",
    "magnetic_toolface_deg",
    "sigma_inclination_deg",
    "sigma_azimuth_deg",
    "axial_interference_nt",
    "sigma_axial_interference_nt",
    "gyro_share",
)
_TEXTS = (
    "azimuth_reference",
    "azimuth_method",
    "in_use",
    "automatic",
    *_VERDICTS,
    "hypotheses",
    "reasons",
    "person",
    "operator",
    "why",
    "judged_utc",
    "leg",
    "tool",
    "flags",
    "comment",
    "uuid",
)


def _verdicts(survey: Survey, north: North) -> list[str]:
    """Verdicts of each quantity, the reason to act on, and the other azimuths that fit, from `north`, with odds."""
    others = survey.alternatives_from(north)
    return [
        *(quoted(word.replace(" ", "_")) for word in survey.verdicts),
        quoted(survey.action),
        quoted(" ".join(fixed(azimuth * _DEG, 4, 360.0) for azimuth, _ in others)),
        quoted(" ".join(fixed(odds, 4) for _, odds in others)),
    ]


def _decided(record: SurveyRecord, north: North) -> list[str]:
    return [
        quoted(record.leg),
        str(record.survey.sequence),
        quoted(utc(record.survey.stamp_ns)),
        quoted(record.tool),
        quoted(Verdict(record.survey.verdict).word),
        *_verdicts(record.survey, north),
        quoted(_person(record)),
        quoted(record.operator_name),
        quoted("; ".join(record.flags)),
        quoted(record.comment),
    ]


def _raw_cells(record: SurveyRecord, methods: tuple[str, ...]) -> list[str]:
    s, source = record.survey, azimuth_source(record.survey)
    causes = zip(s.hypotheses, s.hypothesis_odds, strict=True)
    magnetic = s.magnetic_field_covariance[0] >= 0.0
    known = {a.method: a for a in s.azimuths if a.sigma >= 0.0}
    return [
        str(s.sequence),
        quoted(utc(s.stamp_ns)),
        _known(record.measured_depth, 3),
        _known(record.depth_age, 1),
        *(fixed(v, 6) if s.has_readings else "" for v in s.specific_force),
        *(fixed(v * 1e9, 1) if magnetic else "" for v in s.magnetic_field),
        *(fixed(v * _DEG * 3600.0, 3) if s.has_readings else "" for v in s.angular_rate),
        fixed(s.temperature, 2) if s.temperature > -CELSIUS_ZERO else "",
        fixed(s.duration, 3),
        str(s.samples),
        fixed(s.g_total, 6) if s.has_readings else "",
        _known(s.b_total, 1, 1e9),
        fixed(s.dip * _DEG, 4) if s.b_total >= 0.0 else "",
        _known(s.g_reference, 6),
        _known(s.b_reference, 1, 1e9),
        fixed(s.dip_reference * _DEG, 4) if s.has_reference else "",
        *_judged(s),
        *(fixed(v * _DEG, 4) if s.has_reference else "" for v in (s.declination, s.convergence)),
        fixed(s.inclination * _DEG, 4),
        fixed(s.azimuth * _DEG, 4, 360.0) if s.has_azimuth else "",
        *("" if toolface is None else fixed(toolface * _DEG, 4, 360.0) for toolface in s.toolfaces),
        _known(s.sigma_inclination, 4, _DEG),
        _known(s.sigma_azimuth, 4, _DEG),
        fixed(s.axial_interference * 1e9, 1) if s.sigma_axial_interference >= 0.0 else "",
        _known(s.sigma_axial_interference, 1, 1e9),
        fixed(source.gyro_share, 3) if source.known else "",
        *(fixed(known[m].azimuth * _DEG, 4, 360.0) if m in known else "" for m in methods),
        *(fixed(known[m].sigma * _DEG, 4) if m in known else "" for m in methods),
        quoted(North(s.north).name.lower()),
        quoted(s.azimuth_method),
        quoted("yes" if record.in_use else "no"),
        quoted(Verdict(s.verdict).word),
        *_verdicts(s, North(s.north)),
        quoted(" ".join(f"{name} {fixed(odds, 3)}" for name, odds in causes)),
        quoted("; ".join(s.reasons)),
        quoted(_person(record)),
        quoted(record.operator_name),
        quoted(record.reason),
        quoted(utc(record.judged_ns)),
        quoted(record.leg),
        quoted(record.tool),
        quoted("; ".join(record.flags)),
        quoted(record.comment),
        quoted(s.uuid),
    ]


def _judged(survey: Survey) -> list[str]:
    """Field and dip as they are judged, and the limits of the deviations of gravity, field and dip."""
    gravity, field, dip = totals(survey)
    return [
        fixed(None if field.value is None else field.value * 1e9, 1),
        fixed(None if dip.value is None else dip.value * _DEG, 4),
        fixed(gravity.limit, 6),
        fixed(field.limit * 1e9, 1),
        fixed(dip.limit * _DEG, 4),
    ]


def _person(record: SurveyRecord) -> str:
    return "" if record.judgement == Judgement.NOT_JUDGED else Judgement(record.judgement).name.lower()


def _known(value: float, decimals: int, factor: float = 1.0) -> str:
    return fixed(value * factor, decimals) if value >= 0.0 else ""
