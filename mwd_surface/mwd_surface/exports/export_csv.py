# SPDX-License-Identifier: Apache-2.0
"""
Surveys as CSV: the definitive survey with its head block, and the raw log of everything that was measured.

Lines starting with # are the head block; then follow one line of column names with units and the rows, with a decimal
point in every locale. Text is always in quotes, on one line, and never interpreted as a formula by a spreadsheet.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_surface.exports.survey_table import SurveyTable, degrees, fixed, plain, utc
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.surveys.station_quality import totals
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord

_DEG = 180.0 / math.pi


def quoted(text: str) -> str:
    """Return a text cell: one line, in quotes, with an apostrophe before what a spreadsheet would compute."""
    line = plain(text)
    if line[:1] in ("=", "+", "-", "@"):
        line = "'" + line
    return '"' + line.replace('"', '""') + '"'


def definitive_csv(table: SurveyTable) -> str:
    """
    Return the definitive survey: head block, column names, one line per station; the projection to the bit is last.

    The column `station` gives the kind of station: tie-on, assumed (a first station that nobody gave), survey,
    projected. The column `coordinates` is "assumed" if depths and positions rest on an assumption, which the head block
    names.

    Text is UTF-8 when encoded; lines end with a newline.
    """
    lines = [f"# {label}: {value}" for label, value in table.header]
    lines += [f"# {why}" for why in (*table.left_out, *map(plain, table.remarks))]
    lines += [f"# {line}" for line in provenance_of(table.surveys, table.path.leg).lines()]
    nothing = dict.fromkeys(_decided(_NO_RECORD, table.surveys.north), quoted(""))
    lines.append(",".join([*(c.key for c in table.columns), "station", "coordinates", *nothing]))
    bare = nothing | {"leg": quoted(table.path.leg), "survey": ""}
    for k in table.rows:
        record = table.records[k]
        cells = [column.cell(k) for column in table.columns]
        cells += [quoted(table.path.kind[k]), quoted("assumed" if table.path.assumed else "")]
        cells += (_decided(record, table.surveys.north) if record else bare).values()
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def raw_csv(surveys: SurveyList, header: Iterable[tuple[str, str]] = (), notes: Iterable[str] = ()) -> str:
    """
    Return every survey of the list, used or not, by number: time, depth, six axes, totals, azimuths, judgements.

    header, notes: labels and values of the head block, and comment lines below it.
    """
    lines = [f"# {label}: {value}" for label, value in header]
    lines += [f"# {plain(note)}" for note in notes]
    ordered = sorted(surveys.records, key=lambda r: r.survey.sequence)
    methods = tuple(dict.fromkeys(a.method for r in ordered for a in r.survey.azimuths))
    lines.append(",".join(_raw(_NO_RECORD, methods)))
    lines.extend(",".join(_raw(record, methods).values()) for record in ordered)
    return "\n".join(lines) + "\n"


# An empty record, from which only the column names are taken.
_NO_RECORD = SurveyRecord(Survey(0, "", 0, 0.0, 0.0, 0))


def _verdicts(survey: Survey, north: North) -> dict[str, str]:
    """Return the verdict of each quantity, the main reason, and the other possible azimuths from `north` with odds."""
    others = survey.alternatives_from(north)
    inclination, azimuth, toolface = (quoted(word.replace(" ", "_")) for word in survey.verdicts)
    return {
        "verdict_inclination": inclination,
        "verdict_azimuth": azimuth,
        "verdict_toolface": toolface,
        "headline": quoted(survey.action),
        "alternatives_deg": quoted(" ".join(fixed(azimuth * _DEG, 4, 360.0) for azimuth, _ in others)),
        "alternative_odds": quoted(" ".join(fixed(odds, 4) for _, odds in others)),
    }


def _first(record: SurveyRecord, north: North) -> dict[str, str]:
    """Return the value as first decided, with its azimuth from `north`, and why later surveys changed it."""
    first = record.as_first_decided
    azimuth = first.azimuth_from(north)
    return {
        "first_azimuth_deg": fixed(None if azimuth is None else azimuth * _DEG, 4, 360.0),
        "first_sigma_azimuth_deg": fixed(first.sigma_azimuth * _DEG, 4),
        "first_verdict": quoted(Verdict(first.verdict).word),
        "revised_because": quoted(record.revised_because),
    }


def _decided(record: SurveyRecord, north: North) -> dict[str, str]:
    """Return the cells of a survey in the definitive list, by name."""
    return {
        "leg": quoted(record.leg),
        "survey": str(record.survey.sequence),
        "time_utc": quoted(utc(record.survey.stamp_ns)),
        "tool": quoted(record.tool),
        "automatic": quoted(Verdict(record.survey.verdict).word),
        **_verdicts(record.survey, north),
        **_first(record, north),
        "person": quoted(_person(record)),
        "operator": quoted(record.operator_name),
        "flags": quoted("; ".join(record.flags)),
        "comment": quoted(record.comment),
    }


def _raw(record: SurveyRecord, methods: tuple[str, ...]) -> dict[str, str]:
    """Return the cells of a survey in the raw log, by name; methods: azimuth methods that occur in the log."""
    s, source = record.survey, azimuth_source(record.survey)
    magnetic = math.isfinite(s.magnetic_field[0])
    known = {a.method: a for a in s.azimuths if math.isfinite(a.sigma)}
    gravity_toolface, magnetic_toolface = (
        "" if toolface is None else fixed(toolface * _DEG, 4, 360.0) for toolface in s.toolfaces
    )
    return {
        "survey": str(s.sequence),
        "time_utc": quoted(utc(s.stamp_ns)),
        "md_m": fixed(record.measured_depth, 3),
        "depth_age_s": fixed(record.depth_age, 1),
        **_axes("specific_force_{}_mps2", s.specific_force, 6, 1.0, s.has_readings),
        **_axes("magnetic_field_{}_nt", s.magnetic_field, 1, 1e9, magnetic),
        **_axes("angular_rate_{}_degph", s.angular_rate, 3, _DEG * 3600.0, s.has_readings),
        "temperature_degc": fixed(s.temperature, 2),
        "duration_s": fixed(s.duration, 3) if s.has_readings else "",
        "samples": str(s.samples) if s.has_readings else "",
        "g_total_mps2": fixed(s.g_total, 6),
        "b_total_nt": fixed(s.b_total * 1e9, 1),
        "dip_deg": fixed(s.dip * _DEG, 4),
        "g_reference_mps2": fixed(s.g_reference, 6),
        "b_reference_nt": fixed(s.b_reference * 1e9, 1),
        "dip_reference_deg": fixed(s.dip_reference * _DEG, 4),
        **_judged(s),
        "declination_deg": degrees(s.declination, 4),
        "convergence_deg": degrees(s.convergence, 4),
        "inclination_deg": fixed(s.inclination * _DEG, 4),
        "azimuth_deg": fixed(s.azimuth * _DEG, 4, 360.0) if s.has_azimuth else "",
        "gravity_toolface_deg": gravity_toolface,
        "magnetic_toolface_deg": magnetic_toolface,
        "sigma_inclination_deg": fixed(s.sigma_inclination * _DEG, 4),
        "sigma_azimuth_deg": fixed(s.sigma_azimuth * _DEG, 4),
        "axial_interference_nt": fixed(s.axial_interference * 1e9, 1),
        "sigma_axial_interference_nt": fixed(s.sigma_axial_interference * 1e9, 1),
        "gyro_share": fixed(source.gyro_share, 3) if source.known else "",
        **{f"azimuth_{m}_deg": fixed(known[m].azimuth * _DEG, 4, 360.0) if m in known else "" for m in methods},
        **{f"sigma_azimuth_{m}_deg": fixed(known[m].sigma * _DEG, 4) if m in known else "" for m in methods},
        **_raw_texts(record),
    }


def _raw_texts(record: SurveyRecord) -> dict[str, str]:
    """Return the text cells of a survey in the raw log, by name."""
    s = record.survey
    causes = zip(s.hypotheses, s.hypothesis_odds, strict=True)
    return {
        "azimuth_reference": quoted(North(s.north).name.lower()),
        "azimuth_method": quoted(s.azimuth_method),
        "in_use": quoted("yes" if record.in_use else "no"),
        "automatic": quoted(Verdict(s.verdict).word),
        **_verdicts(s, North(s.north)),
        **_first(record, North(s.north)),
        "hypotheses": quoted(" ".join(f"{name} {fixed(odds, 3)}" for name, odds in causes)),
        "reasons": quoted("; ".join(s.reasons)),
        "person": quoted(_person(record)),
        "operator": quoted(record.operator_name),
        "why": quoted(record.reason),
        "judged_utc": quoted(utc(record.judged_ns)),
        "leg": quoted(record.leg),
        "tool": quoted(record.tool),
        "flags": quoted("; ".join(record.flags)),
        "comment": quoted(record.comment),
        "uuid": quoted(s.uuid),
    }


def _axes(name: str, values: Iterable[float], decimals: int, factor: float, known: bool) -> dict[str, str]:
    """Return the cells of a vector; name: with a placeholder for the axis."""
    return {name.format(a): fixed(v * factor, decimals) if known else "" for a, v in zip("xyz", values, strict=True)}


def _judged(survey: Survey) -> dict[str, str]:
    """Return field and dip as judged, and the limits of the deviations of gravity, field and dip."""
    gravity, field, dip = totals(survey)
    return {
        "b_judged_nt": fixed(None if field.value is None else field.value * 1e9, 1),
        "dip_judged_deg": fixed(None if dip.value is None else dip.value * _DEG, 4),
        "g_limit_mps2": fixed(gravity.limit, 6),
        "b_limit_nt": fixed(field.limit * 1e9, 1),
        "dip_limit_deg": fixed(dip.limit * _DEG, 4),
    }


def _person(record: SurveyRecord) -> str:
    return "" if record.judgement == Judgement.NOT_JUDGED else Judgement(record.judgement).name.lower()
