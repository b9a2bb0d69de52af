# SPDX-License-Identifier: Apache-2.0
"""Stations on the screen: a table of numbers and, below it, the reasons for action."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import best_north, north_correction
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core.angle_convention import AngleConvention
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.commands import terminal
from mwd_surface.commands.spoken_console import SpokenTable
from mwd_surface.surveys.station_checks import NO_DEPTH
from mwd_surface.surveys.station_quality import DOUBTFUL, REJECT, totals

if TYPE_CHECKING:
    from mwd_estimation.core.reference_field import Reference
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.surveys.survey_record import SurveyRecord
    from mwd_surface.surveys.table_run import TableSurvey

COLOURS = {"accept": "green", "doubtful": "yellow", "reject": "red"}
_MOST = 12  # largest number of surveys that are printed
_MOST_ALIKE = 3  # largest number of reasons that are printed if they differ only in their numbers
_NUMBER = re.compile(r"\d[\d.]*")


def show_surveys(records: Sequence[SurveyRecord], convention: AngleConvention = AngleConvention.INCLINATION) -> None:
    """
    Print a table of surveys with their depths, in the given order, then the reasons for their verdicts.

    The table has only the last `_MOST` surveys of a long list. A last line names surveys that were accepted although
    total field or dip is beyond its limit.
    """
    first = max(len(records) - _MOST, 0)
    title = ("1 survey" if len(records) == 1 else f"{len(records)} surveys") + (f", the last {_MOST}" if first else "")
    angle = convention.heading if convention.points else "inclination"
    columns = ("nr", "depth m", angle, "azimuth", "", "toolface", "nT", "dip", "verdict")
    table = narrow_table(title, columns)
    for record in records[first:]:
        survey, depth = record.survey, record.measured_depth
        word = Verdict(survey.verdict).word
        table.add_row(
            str(survey.sequence),
            f"{depth:.1f}" if math.isfinite(depth) else "-",
            f"{degrees(convention.shown(survey.inclination))} ±{degrees(survey.sigma_inclination)}",
            _azimuth(survey),
            North(survey.north).name.lower() if survey.has_azimuth else "",
            direction(survey.gravity_toolface),
            f"{survey.b_total * 1e9:.0f}" if math.isfinite(survey.b_total) else "-",
            degrees(survey.dip),
            Text(word, style=COLOURS[word]),
        )
    terminal.output().print(table, soft_wrap=False)
    show_actions([(r.survey.sequence, Verdict(r.survey.verdict).word, r.survey.action) for r in records])
    off = [r.survey.sequence for r in records if _accepted_beyond(r.survey)]
    if off:
        terminal.tell(
            f"{numbered(off):>4} accepted with total field or dip beyond its limit, because of a wider sigma; if all "
            "stations deviate alike, check place, date and reference"
        )


def narrow_table(title: str, names: Sequence[str]) -> SpokenTable:
    """Return a table of surveys, with the verdict as text on the left, that just fits the 80 columns of a terminal."""
    table = SpokenTable(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0), header_style="dim")
    for name in names:
        table.add_column(name, justify="left" if name in ("", "verdict") else "right", no_wrap=True)
    return table


def show_actions(stations: Sequence[tuple[int, str, str]]) -> None:
    """
    Print the main reasons for verdicts; stations with the same verdict and reason are on one line.

    More than `_MOST_ALIKE` reasons that differ only in their numbers are on one line too, with the first as an example.

    stations: number, verdict ("accept", "doubtful", "reject") and main reason; a station with an empty reason is
    omitted.
    """
    alike: dict[tuple[str, str], dict[str, list[int]]] = {}
    for number, verdict, action in stations:
        if action:
            same = alike.setdefault((verdict, _NUMBER.sub("#", action)), {})
            same.setdefault(action, []).append(number)
    console = terminal.output()
    for (verdict, _), actions in alike.items():
        lines = [(which, action) for action, which in actions.items()]
        if len(lines) > _MOST_ALIKE:
            whole, (first, action) = sorted(n for which, _ in lines for n in which), lines[0]
            lines = [(whole, f"{action} (the values are those of survey {first[0]})")]
        for which, action in lines:
            console.print(Text.assemble(f"{numbered(which):>4} ", (verdict, COLOURS[verdict]), f": {action}"))


def _accepted_beyond(survey: Survey) -> bool:
    """Return whether a survey is accepted although its total field or dip is outside the limits of the reference."""
    _, field, dip = totals(survey)
    return survey.verdict == Verdict.ACCEPT and not {field.light, dip.light}.isdisjoint({DOUBTFUL, REJECT})


def numbered(numbers: Sequence[int]) -> str:
    """Return ascending numbers as text, with ranges: `1, 4-7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("-".join(str(end) for end in run) for run in runs)


def run_sentences(rows: Sequence[TableSurvey]) -> list[str]:
    """Return sentences about the joint analysis of each run: number of stations, and outliers."""
    counts: dict[str, int] = {}
    for row in rows:
        counts[row.run] = counts.get(row.run, 0) + 1
    named = ", ".join(f"{name or 'the table'}: {count}" for name, count in counts.items())
    lines = [f"stations of each run, analysed together: {named}"]
    outliers = [row.record.survey.sequence for row in rows if row.outlier]
    if outliers:
        lines.append(
            f"{numbered(outliers):>4} outlier: the field differs from the field at the other stations of the run"
        )
    return lines


def correction_sentences(references: Sequence[Reference | None]) -> list[str]:
    """
    Return one sentence for each correction from magnetic north, with its declination and convergence.

    After three sentences, a last one gives the number of other corrections.
    """
    found: dict[str, None] = {}
    for reference in references:
        north = best_north(reference)
        correction = north_correction(reference, north)
        if reference is None or reference.declination is None or correction is None:
            continue
        parts = f"declination {math.degrees(reference.declination):+.2f} deg"
        if north == "grid" and reference.convergence is not None:
            parts += f", convergence {math.degrees(reference.convergence):+.2f} deg, both east positive"
        total = f"{math.degrees(correction):+.2f} deg"
        found[f"azimuths are from {north} north: {total} is added to magnetic azimuths ({parts})"] = None
    sentences = list(found)
    return sentences[:3] + ([f"and {len(sentences) - 3} other corrections"] if len(sentences) > 3 else [])


def revision_sentences(records: Sequence[SurveyRecord]) -> list[str]:
    """Return sentences about the surveys whose definitive values differ from the values as first decided."""
    revised = [(first, record.survey) for record in records if (first := record.replaced) is not None]
    if not revised:
        return []
    moves = [abs(float(wrap_pi(now.azimuth - first.azimuth))) for first, now in revised]
    known = [move for move in moves if math.isfinite(move)]
    most = f", azimuth by {degrees(max(known), 1)} deg at most" if known else ""
    numbers = numbered([now.sequence for _, now in revised])
    lines = [f"{numbers:>4} revised with the other surveys of the run{most}"]
    for (first, now), move in zip(revised, moves, strict=True):
        words = [Verdict(one.verdict).word for one in (first, now)]
        if words[0] != words[1] or (move > first.sigma_azimuth and now.verdict == Verdict.ACCEPT):
            lines.append(
                f"{now.sequence:>4} was {words[0]} at first, {_azimuth(first)}; it is now {words[1]}, {_azimuth(now)}"
            )
    return lines


def list_warnings(records: Sequence[SurveyRecord]) -> list[str]:
    """
    Return sentences about surveys without a depth, with the reason, and about surveys with flags.

    Flags of the first survey with a depth are left out.
    """
    without: dict[str, list[int]] = {}
    flagged: dict[str, list[int]] = {}
    # Do not report flags of the first record with a depth, because a recording does not contain the hole above it.
    first = next((record for record in records if math.isfinite(record.measured_depth)), None)
    for record in records:
        number, why = record.survey.sequence, record.comment if math.isnan(record.measured_depth) else ""
        if why:
            without.setdefault(why, []).append(number)
        for flag in record.flags if record is not first else ():
            if not why or flag != NO_DEPTH:
                flagged.setdefault(flag, []).append(number)
    return [
        *(f"survey {numbered(which)} has no depth: {why}" for why, which in without.items()),
        *(f"survey {numbered(which)}: {flag}" for flag, which in flagged.items()),
    ]


def _azimuth(survey: Survey) -> str:
    """Return azimuth and 1 sigma as text in deg; a dash if unknown."""
    if not survey.has_azimuth:
        return "-"
    return f"{direction(survey.azimuth)} ±{degrees(survey.sigma_azimuth, 1)}"


def repeated(rows: Sequence[TableSurvey], settings: EstimatorSettings) -> list[str]:
    """Return sentences about rows of a six-axis table that were measured at the same depth."""
    import numpy as np

    from mwd_estimation.settings.derivation import sensor_errors
    from mwd_surface.surveys.check_shots import check_shots, sentence

    if len(rows) < 2:
        return []
    surveys = [row.record.survey for row in rows]
    force = [np.array(survey.specific_force) for survey in surveys]
    field = [np.array(survey.magnetic_field) for survey in surveys]
    # A run is one tool in its collars, so different runs have no common errors.
    runs = [row.run for row in rows]
    found = check_shots([row.record.measured_depth for row in rows], force, field, sensor_errors(settings), runs)
    return [sentence(shot) for shot in found]


def direction(angle: float) -> str:
    """Return a direction, rad, as text from 0.0 to 359.9 deg; a dash if unknown."""
    return f"{round(math.degrees(angle), 1) % 360.0:.1f}" if math.isfinite(angle) else "-"


def degrees(angle: float, decimals: int = 2) -> str:
    """Return an angle in rad as text in deg; a dash if unknown."""
    return f"{math.degrees(angle):.{decimals}f}" if math.isfinite(angle) else "-"
