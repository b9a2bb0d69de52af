# SPDX-License-Identifier: Apache-2.0
"""
Surveys in the report: figures of the run, every station against its limits, azimuths by method, repeated surveys.

The automatic verdicts, the manual decisions in order and the slide sheet follow.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence

from mwd_estimation.core.north import North
from mwd_estimation.core.reason_text import HYPOTHESES, METHODS
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.report_plots import quality_view
from mwd_surface.exports.report_section import (
    DOUBTFUL,
    GOOD,
    REJECT,
    TINTS,
    Drawing,
    Section,
    Sheet,
    sheet_of,
    table_section,
)
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import Printed, Typed, fixed, plain, typed, utc
from mwd_surface.surveys import check_shots
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.check_shots import bias_text, shots_of, tools_text
from mwd_surface.surveys.station_quality import Total, totals
from mwd_surface.surveys.survey_record import COORDINATES_ASSUMED, Judgement, SurveyRecord
from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch, yields

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
    return table_section("Quality of the run", _RUN, rows, legend=_RUN_LEGEND)


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
    return table_section(
        f"Azimuth by method, from {table.surveys.well.north_reference} north",
        columns,
        rows,
        [row_mark(record) for record in records],
        legend="Others that fit: other azimuths that explain the readings, with their probability.",
    )


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


_VERDICT_TITLES = ("Survey", "MD", "Inc", "Azi", "Toolface", "What to do", "May be disturbed by", "Details")


def verdicts(table: SurveyTable) -> Section | None:
    """
    Return the section on surveys whose automatic verdict needs attention; None if there are none.

    These are surveys with a verdict other than "accept", or with a doubtful or rejected angle. Each has its main reason
    and its possible disturbances.
    """
    rows: list[tuple[str, ...]] = []
    marks, tints = [], {}
    for record in numbered(table):
        s = record.survey
        if s.verdict == Verdict.ACCEPT and not {"doubtful", "reject"} & set(s.verdicts):
            continue
        cells, shades = verdict_cells(s, len(rows), 2)
        tints.update(shades)
        causes = ", ".join(f"{words} {100.0 * odds:.0f} %" for words, odds in s.disturbances)
        details = [reason for reason in s.reasons if reason != s.action]
        texts = (*cells, s.action, causes, "; ".join(details))
        rows.append(
            (
                str(s.sequence),
                fixed(record.measured_depth, 2),
                *(plain(text) for text in texts),
            )
        )
        marks.append(row_mark(record))
    if not rows:
        return None
    columns = [(title, "m" if title == "MD" else "") for title in _VERDICT_TITLES]
    return table_section("Automatic verdicts that need attention", columns, rows, marks, tints=tints)


def decisions(table: SurveyTable) -> Section | None:
    """
    Return the section with the decisions on each survey, and with flags and remarks; None if there is nothing to list.

    The first decision is automatic; changes by later surveys of the run and the decisions of people follow.
    """
    rows, marks, remarks = [], [], []
    for record in numbered(table):
        s, number = record.survey, str(record.survey.sequence)
        if record.decisions or record.replaced is not None:
            first = record.as_first_decided
            lines = [
                (utc(s.stamp_ns), "automatic", Verdict(first.verdict).word, "", first.action),
                *_by_the_run(record),
                *(
                    (
                        utc(d.stamp_ns),
                        typed(d.operator_name),
                        Judgement(d.judgement).name.lower(),
                        fixed(d.measured_depth, 2),
                        typed(d.reason),
                    )
                    for d in record.decisions
                ),
            ]
            rows += [
                (number, *(cell if isinstance(cell, (Printed, Typed)) else plain(cell) for cell in line))
                for line in lines
            ]
            marks += ["", *[""] * (len(lines) - 2), row_mark(record)]
        # The head of the report says that the coordinates of the whole path are assumed.
        flags = [flag for flag in record.flags if flag != COORDINATES_ASSUMED or not table.path.assumed]
        if flags or record.comment:
            remarks.append((number, plain("; ".join(flags)), plain(record.comment)))
    sheets = []
    if rows:
        columns = (("Survey", ""), ("UTC", ""), ("By", ""), ("Decision", ""), ("MD then", "m"), ("Why", ""))
        sheets.append(sheet_of("Decisions; the last line of a survey applies", columns, rows, marks))
    if remarks:
        sheets.append(sheet_of("Flags and remarks", (("Survey", ""), ("Flags", ""), ("Remark", "")), remarks))
    return Section("Decisions", sheets=tuple(sheets)) if sheets else None


def _by_the_run(record: SurveyRecord) -> list[tuple[str, ...]]:
    """Return the line on the change of a survey by later surveys of the run; an empty list without a change."""
    now = record.survey if record.replaced is not None else record.proposal
    if now is None:
        return []
    word = Verdict(now.verdict).word + ("" if record.proposal is None else ", waits for a person")
    return [("", "the whole run", word, "", now.action or "magnetic field at the later surveys")]


def slides(table: SurveyTable) -> Section | None:
    """Return the section with the slide sheet and the yield of the slides; None if nothing was drilled by sliding."""
    made = {mode: sum(s.length for s in table.stretches if s.mode == mode) for mode in (SLIDE, ROTATE)}
    if made[SLIDE] <= 0.0:
        return None
    share = 100.0 * made[SLIDE] / (made[SLIDE] + made[ROTATE])
    legs = "" if len(table.surveys.legs) == 1 else "; legs are not separated"
    sheet = Sheet(
        f"Slide sheet: slid {fixed(made[SLIDE], 1)} m, rotated {fixed(made[ROTATE], 1)} m, {share:.0f} % slid{legs}",
        ("From", "To", "Length", "Mode", "Toolface", "Counted from", "Steady", "Rotary", "Begun, UTC", "Ended, UTC"),
        ("m", "m", "m", "", "deg", "", "%", "r/min", "", ""),
        tuple(_stretch(s) for s in table.stretches),
        ("",) * len(table.stretches),
        (3, 5, 8, 9),
    )
    gave = yields(table.stretches, table.path)
    motor = Sheet(
        "Yield of the slides, including the tendency of formation and rotation",
        ("From", "To", "Slid", "Rotated", "Dogleg", "DLS", "Motor yield"),
        ("m", "m", "m", "m", "deg", "deg/30 m", "deg/30 m slid"),
        tuple(
            (
                fixed(y.from_depth, 2),
                fixed(y.to_depth, 2),
                fixed(y.slid, 1),
                fixed(y.rotated, 1),
                fixed(y.dogleg * _DEG, 2),
                fixed(y.dogleg / (y.to_depth - y.from_depth) * 30.0 * _DEG, 2),
                fixed(y.motor * 30.0 * _DEG, 2) if y.motor is not None else "",
            )
            for y in gave
        ),
        ("",) * len(gave),
    )
    return Section("Slide sheet", sheets=(sheet, motor) if gave else (sheet,))


def _stretch(s: DrilledStretch) -> tuple[str, ...]:
    known = s.toolface is not None
    return (
        fixed(s.from_depth, 2),
        fixed(s.to_depth, 2),
        fixed(s.length, 2),
        s.mode,
        fixed(s.toolface * _DEG, 0, 360.0) if s.toolface is not None else "",
        ("north" if s.magnetic else "high side") if known else "",
        fixed(s.steadiness * 100.0, 0) if s.steadiness is not None else "",
        fixed(s.rotary_speed * 30.0 / math.pi, 0) if s.mode == ROTATE else "",
        *(utc(stamp)[:19].replace("T", " ") for stamp in (s.begin_ns, s.end_ns)),
    )


_COLUMNS = (
    ("MD", "m"),
    ("Surveys", ""),
    ("Tools", ""),
    ("Inc", "deg"),
    ("spread", "deg"),
    ("expected", "deg"),
    ("Azi, magnetic", "deg"),
    ("spread", "deg"),
    ("expected", "deg"),
    ("χ²", ""),
    ("of", ""),
    ("Result", ""),
    ("Transverse biases", ""),
)
_TINTS = {check_shots.PASS: GOOD, check_shots.DOUBTFUL: DOUBTFUL, check_shots.FAIL: REJECT}


def repeated(table: SurveyTable) -> Section | None:
    """Return the section with rotation shots and check shots; None if no survey was repeated."""
    rows: list[tuple[str, ...]] = []
    tints, convention = {}, table.surveys.well.angles
    for shot, numbers in shots_of(table.surveys.records, table.surveys.well.error_model):
        tints[len(rows), 11] = _TINTS[shot.verdict]
        angles = (
            fixed(math.degrees(value), 3, 360.0)
            for value in (
                convention.shown(shot.inclination),
                shot.spread_inclination,
                shot.expected_inclination,
                shot.azimuth,
                shot.spread_azimuth,
                shot.expected_azimuth,
            )
        )
        biases = "; ".join(bias_text(bias) for bias in shot.biases)
        surveys = ", ".join(str(number) for number in numbers)
        quality = fixed(shot.chi_square, 1), str(shot.degrees_of_freedom), shot.verdict
        rows.append((fixed(shot.md, 2), surveys, tools_text(shot), *angles, *quality, biases))
    if not rows:
        return None
    legend = (
        "Spread and expected are standard deviations of the repeated surveys, uncorrected for interference; expected is"
        " that of the tool code. Doubtful or fail: such differences occur by chance once in 100 or in 1000 times."
    )
    columns = [(convention.heading if title == "Inc" else title, unit) for title, unit in _COLUMNS]
    return table_section("Rotation shots and check shots", columns, rows, tints=tints, legend=legend)
