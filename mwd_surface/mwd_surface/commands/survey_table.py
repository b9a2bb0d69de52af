# SPDX-License-Identifier: Apache-2.0
"""Stations on the screen: a table of numbers and, below it, the reasons for action."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.verdicts import ACCEPT
from mwd_sensors.core.frames import wrap_pi
from mwd_surface.surveys.station_checks import NO_DEPTH

if TYPE_CHECKING:
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_estimation.survey.station import Station
    from mwd_surface.list_files.six_axis_table import TableStation
    from mwd_surface.surveys.survey_record import SurveyRecord

COLOURS = {"accept": "green", "doubtful": "yellow", "reject": "red"}
_MOST = 12


def show_surveys(console: Console, stations: Sequence[tuple[Station, float]]) -> None:
    """Print stations with their measured depths, m (nan if unknown); of a long list only the last ones."""
    first = max(len(stations) - _MOST, 0)
    title = ("1 survey" if len(stations) == 1 else f"{len(stations)} surveys") + (
        f", the last {_MOST}" if first else ""
    )
    # With the widest numbers it just fits the 80 columns of a plain terminal.
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0), header_style="dim")
    for name in ("no", "depth m", "inclination", "azimuth", "", "toolface", "nT", "dip"):
        table.add_column(name, justify="left" if not name else "right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for number, (station, depth) in enumerate(stations[first:], first + 1):
        known = math.isfinite(station.azimuth)
        table.add_row(
            str(number),
            f"{depth:.1f}" if math.isfinite(depth) else "-",
            f"{degrees(station.inclination)} ±{degrees(station.sigma_inclination)}",
            f"{direction(station.azimuth)} ±{degrees(station.sigma_azimuth, 1)}" if known else "-",
            station.north if known else "",
            direction(station.gravity_toolface),
            f"{station.b_total * 1e9:.0f}" if math.isfinite(station.b_total) else "-",
            degrees(station.dip),
            Text(station.verdict, style=COLOURS[station.verdict]),
        )
    console.print(table, soft_wrap=False)
    actions = [
        (number, station.verdict, joined(() if station.headline is None else (station.headline,)))
        for number, (station, _) in enumerate(stations, 1)
    ]
    show_actions(console, actions)
    off = [number for number, (station, _) in enumerate(stations, 1) if _accepted_beyond(station)]
    if off:
        console.print(
            f"{numbered(off):>4} accepted with total field or dip beyond its limit, because of a wider sigma; if all "
            "stations deviate alike, check place, date and reference",
            markup=False,
        )


def show_actions(console: Console, stations: Sequence[tuple[int, str, str]]) -> None:
    """
    Print the reasons for stations not accepted, those with the same reason in one line.

    stations: number, verdict ("accept", "doubtful", "reject") and the main reason; empty if there is none.
    """
    numbers: dict[tuple[str, str], list[int]] = {}
    for number, verdict, action in stations:
        if action:
            numbers.setdefault((verdict, action), []).append(number)
    for (verdict, action), which in numbers.items():
        console.print(Text.assemble(f"{numbered(which):>4} ", (verdict, COLOURS[verdict]), f": {action}"))


def _accepted_beyond(station: Station) -> bool:
    """Return whether the station is accepted although its field or dip deviates from the reference."""
    codes = {reason.code for reason in station.reasons}
    return station.verdict == ACCEPT and not codes.isdisjoint({ReasonCode.FIELD_OFF, ReasonCode.DIP_OFF})


def numbered(numbers: Sequence[int]) -> str:
    """Return ascending numbers as text, with ranges: `1, 4-7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join("-".join(str(end) for end in run) for run in runs)


def run_sentences(rows: Sequence[TableStation]) -> list[str]:
    """Return sentences on the joint analysis of runs: their size, outliers and revisions."""
    if all(row.first is None for row in rows):
        return []
    counts: dict[str, int] = {}
    for row in rows:
        counts[row.run] = counts.get(row.run, 0) + 1
    named = ", ".join(f"{name or 'the table'}: {count}" for name, count in counts.items())
    lines = [f"stations of each run, analysed together: {named}"]
    outliers = [number for number, row in enumerate(rows, 1) if row.outlier]
    if outliers:
        lines.append(f"{numbered(outliers):>4} outlier: its field differs from that of the other stations of the run")
    firsts = [(number, row, row.first) for number, row in enumerate(rows, 1)]
    return lines + revision_sentences(
        [(number, first, row.station) for number, row, first in firsts if row.revised and first is not None]
    )


def revision_sentences(revised: Sequence[tuple[int, Station, Station]]) -> list[str]:
    """Return sentences on revised stations; revised: number, station at first, and now."""
    if not revised:
        return []
    moves = [abs(float(wrap_pi(now.azimuth - first.azimuth))) for _, first, now in revised]
    known = [move for move in moves if math.isfinite(move)]
    most = f", azimuth by {degrees(max(known), 1)} deg at most" if known else ""
    lines = [f"{numbered([number for number, _, _ in revised]):>4} revised with the other stations of the run{most}"]
    for (number, first, now), move in zip(revised, moves, strict=True):
        if first.verdict != now.verdict or move > first.sigma_azimuth:
            lines.append(
                f"{number:>4} was {first.verdict} at first: {_azimuth(first)}; now {now.verdict}: {_azimuth(now)}"
            )
    return lines


def list_warnings(records: Sequence[SurveyRecord]) -> list[str]:
    """Return sentences on the records of a list: those without a depth, with the reason, and flagged ones."""
    without: dict[str, list[int]] = {}
    flagged: dict[str, list[int]] = {}
    # Not the first: a recording does not contain the hole above it.
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


def _azimuth(station: Station) -> str:
    """Return azimuth and 1 sigma as text in deg."""
    if not math.isfinite(station.azimuth):
        return "-"
    return f"{direction(station.azimuth)} ±{degrees(station.sigma_azimuth, 1)}"


def repeated(rows: Sequence[TableStation], settings: EstimatorSettings) -> list[str]:
    """Return sentences on rows of a six-axis table that were taken at one depth."""
    from mwd_estimation.settings.derivation import sensor_errors
    from mwd_surface.surveys.check_shots import check_shots
    from mwd_surface.surveys.repeated_surveys import sentence

    if len(rows) < 2:
        return []
    force, field = [row.station.f_t for row in rows], [row.station.b_t for row in rows]
    # A run is one tool in its collars: different runs share no errors.
    runs = [row.run for row in rows]
    found = check_shots([row.md for row in rows], force, field, sensor_errors(settings), runs)
    return [sentence(shot) for shot in found]


def direction(angle: float) -> str:
    """Return a direction, rad, as text from 0.0 to 359.9 deg; a dash if unknown."""
    return f"{round(math.degrees(angle), 1) % 360.0:.1f}" if math.isfinite(angle) else "-"


def degrees(angle: float, decimals: int = 2) -> str:
    """Return an angle in rad as text in deg; a dash if unknown."""
    return f"{math.degrees(angle):.{decimals}f}" if math.isfinite(angle) else "-"
