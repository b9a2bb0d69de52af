# SPDX-License-Identifier: Apache-2.0
"""Repeated surveys at one depth in the report: spread compared with the tool code, and resulting sensor biases."""

from __future__ import annotations

import math

from mwd_surface.exports.report_section import DOUBTFUL, GOOD, REJECT, Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed
from mwd_surface.surveys import check_shots
from mwd_surface.surveys.check_shots import bias_text, shots_of, tools_text

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
    sheet = sheet_of(
        "Rotation shots and check shots",
        [(convention.heading if title == "Inc" else title, unit) for title, unit in _COLUMNS],
        rows,
        tints=tints,
        legend=legend,
    )
    return Section(sheet.heading, sheets=(sheet,))
