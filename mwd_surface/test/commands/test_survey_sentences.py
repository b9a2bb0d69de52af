# SPDX-License-Identifier: Apache-2.0
"""The table of surveys on the terminal: which revised stations are named, and what the list says of others."""

from __future__ import annotations

import dataclasses
import math

from example_stations import survey

from mwd_estimation.survey.survey import Verdict
from mwd_surface.commands.survey_table import list_warnings, revision_sentences, show_actions
from mwd_surface.surveys.survey_record import SurveyRecord


def value(number, azimuth_deg, sigma_deg, verdict=Verdict.ACCEPT):
    covariance = (1e-6, 0.0, 0.0, 0.0, math.radians(sigma_deg) ** 2, 0.0, 0.0, 0.0, 1e-6)
    given = {"azimuth": math.radians(azimuth_deg), "covariance": covariance, "verdict": int(verdict)}
    return dataclasses.replace(survey(number), **given)


def test_a_station_is_named_by_another_verdict_or_an_azimuth_more_than_its_sigma_away():
    told = revision_sentences(
        [
            SurveyRecord(value(1, 158.4, 3.3), first=(value(1, 136.6, 0.8),)),
            SurveyRecord(value(2, 158.4, 3.3), first=(value(2, 157.6, 3.0, Verdict.DOUBTFUL),)),
            SurveyRecord(value(3, 162.0, 2.9), first=(value(3, 161.6, 3.0),)),
            SurveyRecord(value(4, 162.0, 2.9), first=(value(4, 162.01, 3.0),)),
            SurveyRecord(value(5, 162.0, 2.9)),
            SurveyRecord(value(6, 62.0, 9.9, Verdict.REJECT), first=(value(6, 162.0, 9.9, Verdict.REJECT),)),
        ]
    )
    assert told == [
        "1-3, 6 revised with the other surveys of the run, azimuth by 100.0 deg at most",
        "   1 was accept at first, 136.6 ±0.8; it is now accept, 158.4 ±3.3",
        "   2 was doubtful at first, 157.6 ±3.0; it is now accept, 158.4 ±3.3",
    ]


def test_many_reasons_that_differ_in_their_numbers_are_one_line_with_an_example(capsys):
    show_actions([(k, "reject", f"dip {60.5 + k} deg: look") for k in (1, 2, 4, 5)] + [(3, "doubtful", "steel near")])
    show_actions([(k, "reject", f"dip {60.5 + k} deg: look") for k in (1, 2, 4)])
    assert capsys.readouterr().out.splitlines() == [
        "1-2, 4-5 reject: dip 61.5 deg: look (the values are those of survey 1)",
        "   3 doubtful: steel near",
        "   1 reject: dip 61.5 deg: look",
        "   2 reject: dip 62.5 deg: look",
        "   4 reject: dip 64.5 deg: look",
    ]


def test_a_station_without_depth_is_named_once_with_its_other_flags():
    def record(number, depth, *flags, why=""):
        return SurveyRecord(survey(number), depth, comment=why, flags=flags)

    no_row, later = "the table does not have it", "later surveys say: doubtful"
    told = list_warnings(
        [
            record(4, math.nan, "no measured depth", why=no_row),
            record(5, math.nan, "no measured depth", later, why=no_row),
            record(6, math.nan, "no measured depth"),
            record(1, 100.0, "gap"),
            record(2, 190.0, "gap"),
        ]
    )
    assert told == [
        f"survey 4-5 has no depth: {no_row}",
        f"survey 5: {later}",
        "survey 6: no measured depth",
        "survey 2: gap",
    ]
