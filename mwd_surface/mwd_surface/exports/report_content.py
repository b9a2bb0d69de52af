"""
The content of a survey report, apart from its layout.

It has a head, the definitive table, the quality page, decisions, the slide sheet and a certificate. HTML and
PDF print exactly these texts, so they cannot differ in a number.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.survey_table import SurveyTable, fixed, plain, utc
from mwd_surface.surveys.slide_sheet import ROTATE, SLIDE, Stretch, yields
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord, Verdict

_DEG = 180.0 / math.pi
_MILLI_G = 1e3 / STANDARD_GRAVITY


@dataclasses.dataclass(frozen=True)
class Sheet:
    """
    One table: heading, column titles and units, and rows of texts.

    marks: of each row, "" or a word that says why it stands out ("projected", "rejected", "doubtful").
    words: numbers of the columns that hold text and want to be read from the left.
    """

    heading: str
    titles: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marks: tuple[str, ...]
    words: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True)
class Content:
    """
    The report: title, head block, notes, the tables, certificate and the lines to sign on.

    slides: the slide sheet and what the slides gave; empty where nothing was slid.
    """

    title: str
    header: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    definitive: Sheet
    quality: Sheet
    decisions: Sheet
    slides: tuple[Sheet, ...]
    certificate: str
    signatures: tuple[str, ...]


def content(table: SurveyTable) -> Content:
    """The report of a table, in words and printed numbers."""
    well = table.surveys.well
    notes = [*table.left_out]
    if table.path.kind[-1] == "projected":
        notes.append("The last station is projected to the bit; it was not surveyed.")
    by_hand = [r for r in table.surveys.records if r.in_use and r.survey.verdict != Verdict.ACCEPT]
    if by_hand:
        numbers = ", ".join(str(r.survey.sequence) for r in by_hand)
        notes.append(f"Used on a person's word against the automatic verdict: survey {numbers}.")
    return Content(
        title=plain(f"Survey report {well.name}" + (f", {well.wellbore}" if well.wellbore else "")),
        header=table.header,
        notes=tuple(notes),
        definitive=_definitive(table),
        quality=_quality(table),
        decisions=_decisions(table),
        slides=_slides(table),
        certificate=(
            "Certified that this survey was computed by the minimum curvature method from the surveys marked as used,"
            f" from {well.north_reference} north, with the references and corrections stated above."
        ),
        signatures=("Survey engineer", "Directional driller", "Company representative"),
    )


def _definitive(table: SurveyTable) -> Sheet:
    shown = [c for c in table.columns if any(v is not None for v in c.values)]
    rows, marks = [], []
    for k in table.rows:
        record, kind = table.records[k], table.path.kind[k]
        name = str(record.survey.sequence) if record is not None else kind
        rows.append((name, *(c.cell(k, paper=True) for c in shown), "; ".join(record.flags) if record else ""))
        marks.append("projected" if kind == "projected" else _mark(record))
    return Sheet(
        "Definitive survey",
        ("Survey", *(c.title for c in shown), "Flags"),
        ("", *(c.unit for c in shown), ""),
        tuple(rows),
        tuple(marks),
        (len(shown) + 1,),
    )


def _quality(table: SurveyTable) -> Sheet:
    rows, marks = [], []
    for record in sorted(table.surveys.records, key=lambda r: r.survey.sequence):
        s = record.survey
        field, gravity = s.has_reference and s.b_total >= 0.0, s.has_readings and s.g_reference > 0.0
        rows.append(
            (
                str(s.sequence),
                utc(s.stamp_ns)[:19].replace("T", " "),
                fixed(record.measured_depth, 2) if record.measured_depth >= 0.0 else "",
                fixed(s.inclination * _DEG, 2),
                fixed(s.sigma_inclination * _DEG, 2) if s.sigma_inclination >= 0.0 else "",
                fixed(s.azimuth * _DEG, 2, 360.0) if s.has_azimuth else "",
                fixed(s.sigma_azimuth * _DEG, 2) if s.sigma_azimuth >= 0.0 else "",
                s.azimuth_method,
                fixed(s.g_total, 4) if s.has_readings else "",
                fixed((s.g_total - s.g_reference) * _MILLI_G, 2) if gravity else "",
                fixed(s.b_total * 1e9, 0) if s.b_total >= 0.0 else "",
                fixed((s.b_total - s.b_reference) * 1e9, 0) if field else "",
                fixed(s.dip * _DEG, 2) if s.b_total >= 0.0 else "",
                fixed((s.dip - s.dip_reference) * _DEG, 2) if field else "",
                fixed(s.axial_interference * 1e9, 0) if s.sigma_axial_interference >= 0.0 else "",
                Verdict(s.verdict).name.lower(),
                "yes" if record.in_use else "no",
            )
        )
        marks.append(_mark(record))
    titles = (
        "Survey",
        "UTC",
        "MD",
        "Inc",
        "1σ",
        "Azi measured",
        "1σ",
        "Method",
        "G total",
        "ΔG",
        "B total",
        "ΔB",
        "Dip",
        "ΔDip",
        "Axial",
        "Automatic",
        "Used",
    )
    units = ("", "", "m", "deg", "deg", "deg", "deg", "", "m/s2", "mg", "nT", "nT", "deg", "deg", "nT", "", "")
    return Sheet("Quality control of every survey taken", titles, units, tuple(rows), tuple(marks), (1, 7, 15, 16))


def _decisions(table: SurveyTable) -> Sheet:
    rows, marks = [], []
    for record in sorted(table.surveys.records, key=lambda r: r.survey.sequence):
        s = record.survey
        silent = s.verdict == Verdict.ACCEPT and not (s.reasons or record.flags or record.comment or record.judgement)
        if silent:
            continue
        person = ""
        if record.judgement != Judgement.NOT_JUDGED:
            person = f"{Judgement(record.judgement).name.lower()} by {record.operator_name}, {utc(record.judged_ns)}"
        automatic = Verdict(s.verdict).name.lower() + (f": {'; '.join(s.reasons)}" if s.reasons else "")
        cells = (str(s.sequence), automatic, person, record.reason, "; ".join(record.flags), record.comment)
        rows.append(tuple(plain(c) for c in cells))
        marks.append(_mark(record))
    titles = ("Survey", "Automatic verdict", "Person's judgement", "Why", "Flags", "Comment")
    return Sheet("Verdicts, judgements and remarks", titles, ("",) * 6, tuple(rows), tuple(marks), (1, 2, 3, 4, 5))


def _slides(table: SurveyTable) -> tuple[Sheet, ...]:
    made = {mode: sum(s.length for s in table.stretches if s.mode == mode) for mode in (SLIDE, ROTATE)}
    if made[SLIDE] <= 0.0:
        return ()
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
        "What the slides gave; the tendency of formation and rotation is in it",
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
    return (sheet, motor) if gave else (sheet,)


def _stretch(s: Stretch) -> tuple[str, ...]:
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


def _mark(record: SurveyRecord | None) -> str:
    if record is None:
        return ""
    if not record.in_use:
        return "not used"
    return "" if record.survey.verdict == Verdict.ACCEPT else "by hand"
