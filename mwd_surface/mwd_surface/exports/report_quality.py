# SPDX-License-Identifier: Apache-2.0
"""Quality control in the report: figures of the run, every station against its limits, azimuths by method."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence

from mwd_estimation.core.north import North
from mwd_estimation.core.reason_text import HYPOTHESES, METHODS
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.report_plots import quality_view
from mwd_surface.exports.report_section import DOUBTFUL, GOOD, REJECT, TINTS, Drawing, Section, Sheet, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed, utc
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.station_quality import Total, totals
from mwd_surface.surveys.survey_record import SurveyRecord

_DEG = 180.0 / math.pi
# Total gravity, total field and dip: title, display unit, factor from SI, decimals.
TOTALS = (("G", "mg", 1e3 / STANDARD_GRAVITY, 2), ("B", "nT", 1e9, 0), ("Dip", "deg", _DEG, 2))
_VERDICT_TINTS = {"accept": GOOD, "doubtful": DOUBTFUL, "reject": REJECT}
_TINT_LEGEND = (
    "Green: within the limit. Yellow: beyond the limit, or doubtful. Red: beyond 1.5 times the limit, or rejected. "
    "Shaded lines: not used, or used by manual decision. B and dip are judged without the drill string's axial field "
    "if the azimuth is corrected for it (judged as: corrected), otherwise as read; each limit applies to the value on "
    "its left."
)
_RUN_LEGEND = (
    "rms: root mean square of the deviations of the surveys in use from their references, with the values as judged. "
    "Axial: mean field of the drill string along the tool, and its spread, over the surveys in use. Inc 1σ, Azi 1σ: "
    "median of the surveys in use. Azi accepted: accepted azimuths as a share of all azimuths that were determined."
)
# Columns of the tables: title and unit.
_STATION = (
    *(("Survey", ""), ("UTC", ""), ("MD", "m"), ("Inc", "deg"), ("1σ", "deg")),
    *(("Azi", "deg"), ("north", ""), ("1σ", "deg")),
    *((title, unit) for name, unit, _, _ in TOTALS for title in (f"Δ{name}", "limit ±")),
    *(("Judged as", ""), ("Axial", "nT"), ("1σ", "nT")),
    *(("Inc is", ""), ("Azi is", ""), ("Toolface is", ""), ("Used", "")),
)
_READ = (
    *(("Survey", ""), ("MD", "m"), ("G read", "m/s2"), ("reference", "m/s2")),
    *(("B read", "nT"), ("B judged", "nT"), ("reference", "nT")),
    *(("Dip read", "deg"), ("Dip judged", "deg"), ("reference", "deg")),
)
_RUN = (
    *(("Leg", ""), ("Tool", ""), ("Taken", ""), ("Inc accepted", "%"), ("Azi accepted", "%"), ("Azi doubtful", "")),
    *(("Azi rejected", ""), ("Used", ""), ("By hand", ""), *((f"rms Δ{name}", unit) for name, unit, _, _ in TOTALS)),
    *(("Axial", "nT"), ("spread", "nT"), ("Inc 1σ", "deg"), ("Azi 1σ", "deg"), ("Disturbed by", "")),
)


def numbered(table: SurveyTable) -> list[SurveyRecord]:
    """Return the records of all surveys, in order of number."""
    return sorted(table.surveys.records, key=lambda r: r.survey.sequence)


def row_mark(record: SurveyRecord | None) -> str:
    """Return the reason why the line of a survey is highlighted, or an empty text."""
    if record is None:
        return ""
    if not record.in_use:
        return "not used"
    return "by hand" if record.survey.verdict != Verdict.ACCEPT else ""


def verdict_cells(survey: Survey, row: int, first: int) -> tuple[tuple[str, ...], dict[tuple[int, int], str]]:
    """Return the verdicts of inclination, azimuth and toolface as cells from column `first` on, and tints by cell."""
    words = survey.verdicts
    return words, {(row, first + k): _VERDICT_TINTS[v] for k, v in enumerate(words) if v in _VERDICT_TINTS}


def stations(table: SurveyTable) -> Section | None:
    """Return the section that compares every survey with its limits; None for a list without sensor readings."""
    records = [record for record in numbered(table) if record.survey.has_readings]
    if not records:
        return None
    rows, tints, angles = [], {}, table.surveys.well.angles
    for i, record in enumerate(records):
        s = record.survey
        found = totals(s)
        cells = [
            str(s.sequence),
            utc(s.stamp_ns)[:19].replace("T", " "),
            _depth(record),
            fixed(angles.shown(s.inclination) * _DEG, 2),
            fixed(s.sigma_inclination * _DEG, 2),
            fixed(s.azimuth * _DEG, 2, 360.0) if s.has_azimuth else "",
            North(s.north).name.lower() if s.has_azimuth else "",
            fixed(s.sigma_azimuth * _DEG, 2),
        ]
        for total, (_, _, factor, decimals) in zip(found, TOTALS, strict=True):
            if total.light in TINTS:
                tints[i, len(cells)] = total.light
            cells += [_scaled(total.deviation, factor, decimals), _limit(total, factor, decimals)]
        field = "" if found[1].value is None else "corrected" if found[1].corrected else "as read"
        cells += [field, fixed(s.axial_interference * 1e9, 0), fixed(s.sigma_axial_interference * 1e9, 0)]
        verdicts, shades = verdict_cells(s, i, len(cells))
        tints.update(shades)
        rows.append((*cells, *verdicts, "yes" if record.in_use else "no"))
    sheet = sheet_of(
        "Quality control of every survey taken",
        [(angles.heading if title == "Inc" else title, unit) for title, unit in _STATION],
        rows,
        [row_mark(record) for record in records],
        tints=tints,
        legend=_TINT_LEGEND,
    )
    drawing = Drawing(
        "Deviation from the reference; shaded: within the limit of each survey", lambda: quality_view(table), wide=True
    )
    return Section(sheet.heading, sheets=(sheet, _as_read(records)), drawings=(drawing,))


def _as_read(records: Sequence[SurveyRecord]) -> Sheet:
    """Return the table of total gravity, total field and dip, as read and as judged, and their references."""
    rows = []
    for record in records:
        gravity, field, dip = totals(record.survey)
        rows.append(
            (
                str(record.survey.sequence),
                _depth(record),
                _scaled(gravity.read, 1.0, 4),
                _scaled(gravity.reference, 1.0, 4),
                *(_scaled(v, 1e9, 0) for v in (field.read, field.value, field.reference)),
                *(_scaled(v, _DEG, 2) for v in (dip.read, dip.value, dip.reference)),
            )
        )
    heading = "Totals as read, as judged, and their references"
    return sheet_of(heading, _READ, rows, [row_mark(record) for record in records])


def run_quality(table: SurveyTable) -> Section | None:
    """Return the section with quality figures of each tool's run; None for a list without sensor readings."""
    records = [record for record in numbered(table) if record.survey.has_readings]
    if not records:
        return None
    runs = dict.fromkeys((record.leg, record.tool) for record in records)
    rows = [_run(leg, tool, [r for r in records if (r.leg, r.tool) == (leg, tool)]) for leg, tool in runs]
    sheet = sheet_of("Quality of the run", _RUN, rows, legend=_RUN_LEGEND)
    return Section(sheet.heading, sheets=(sheet,))


def _run(leg: str, tool: str, records: Sequence[SurveyRecord]) -> tuple[str, ...]:
    surveys = [r.survey for r in records]
    used = [r.survey for r in records if r.in_use]
    verdicts = [Verdict(s.verdict_azimuth) for s in surveys]
    azimuth = [v for v in verdicts if v != Verdict.NOT_DETERMINED]
    inclination = sum(s.verdict_inclination == Verdict.ACCEPT for s in surveys)
    deviations = [[t.deviation for t in totals(s)] for s in used]
    axial = [s.axial_interference for s in used if math.isfinite(s.axial_interference)]
    sigmas = [
        [sigma for sigma in several if math.isfinite(sigma)]
        for several in ([s.sigma_inclination for s in used], [s.sigma_azimuth for s in used])
    ]
    likeliest = [s.disturbances[0][0] for s in surveys if s.disturbances]
    causes = [cause for cause in likeliest if cause != HYPOTHESES["clean"]]
    return (
        leg,
        tool,
        str(len(records)),
        f"{100.0 * inclination / len(records):.0f}",
        f"{100.0 * azimuth.count(Verdict.ACCEPT) / len(azimuth):.0f}" if azimuth else "",
        str(verdicts.count(Verdict.DOUBTFUL)),
        str(verdicts.count(Verdict.REJECT)),
        str(len(used)),
        str(sum(r.judgement != 0 for r in records)),
        *(
            _scaled(_rms(d[k] for d in deviations), factor, decimals)
            for k, (_, _, factor, decimals) in enumerate(TOTALS)
        ),
        _scaled(statistics.fmean(axial) if axial else None, 1e9, 0),
        _scaled(statistics.stdev(axial) if len(axial) > 1 else None, 1e9, 0),
        *(_scaled(statistics.median(known) if known else None, _DEG, 2) for known in sigmas),
        ", ".join(f"{cause} ({causes.count(cause)})" for cause in dict.fromkeys(causes)),
    )


def azimuths(table: SurveyTable) -> Section | None:
    """
    Return the section with the azimuth of each survey by each method, all from the north of the well.

    Stations of a list of angles have no method and are left out. None if no survey has an azimuth by a method.
    """
    records = [r for r in numbered(table) if any(math.isfinite(a.sigma) for a in r.survey.azimuths)]
    methods = list(dict.fromkeys(a.method for r in records for a in r.survey.azimuths if math.isfinite(a.sigma)))
    if not methods:
        return None
    north = table.surveys.north
    rows = []
    for record in records:
        s = record.survey
        by = {a.method: a for a in s.azimuths if math.isfinite(a.sigma)}
        known = s.azimuth_from(north)
        cells = [str(s.sequence), _depth(record), fixed(known * _DEG, 2, 360.0) if known is not None else ""]
        cells += [
            fixed(s.sigma_azimuth * _DEG, 2),
            azimuth_source(s).words or METHODS.get(s.azimuth_method, s.azimuth_method),
        ]
        for method in methods:
            cells += _by_method(s, by.get(method), north)
        others = ", ".join(
            f"{fixed(a * _DEG, 1, 360.0)} ({100.0 * odds:.1f} %)" for a, odds in s.alternatives_from(north)
        )
        rows.append((*cells, others))
    columns = (
        *(("Survey", ""), ("MD", "m"), ("Azi", "deg"), ("1σ", "deg"), ("Taken from", "")),
        *((title, "deg") for method in methods for title in (METHODS.get(method, method), "1σ")),
        ("Others that fit, deg", ""),
    )
    sheet = sheet_of(
        f"Azimuth by method, from {table.surveys.well.north_reference} north",
        columns,
        rows,
        [row_mark(record) for record in records],
        legend="Others that fit: other azimuths that explain the readings, with their probability.",
    )
    return Section(sheet.heading, sheets=(sheet,))


def _by_method(survey: Survey, estimate: AzimuthEstimate | None, north: North) -> tuple[str, str]:
    if estimate is None:
        return "", ""
    azimuth = survey.turned(estimate.azimuth, North(estimate.north), north)
    return (fixed(azimuth * _DEG, 2, 360.0), fixed(estimate.sigma * _DEG, 2)) if azimuth is not None else ("", "")


def _depth(record: SurveyRecord) -> str:
    return fixed(record.measured_depth, 2)


def _scaled(value: float | None, factor: float, decimals: int) -> str:
    return fixed(None if value is None else value * factor, decimals)


def _limit(total: Total, factor: float, decimals: int) -> str:
    return "" if total.reference is None else fixed(total.limit * factor, decimals)


def _rms(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return math.sqrt(sum(v * v for v in known) / len(known)) if known else None
