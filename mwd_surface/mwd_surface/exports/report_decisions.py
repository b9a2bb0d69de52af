# SPDX-License-Identifier: Apache-2.0
"""Decisions in the report: automatic verdicts, manual decisions in order, and the slide sheet."""

from __future__ import annotations

import math

from mwd_estimation.survey.survey import Verdict
from mwd_surface.exports.report_quality import numbered, row_mark, verdict_cells
from mwd_surface.exports.report_section import Section, Sheet, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import Printed, Typed, fixed, plain, typed, utc
from mwd_surface.surveys.survey_record import COORDINATES_ASSUMED, Judgement, SurveyRecord
from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch, yields

_DEG = 180.0 / math.pi
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
    sheet = sheet_of("Automatic verdicts that need attention", columns, rows, marks, tints=tints)
    return Section(sheet.heading, sheets=(sheet,))


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
