# SPDX-License-Identifier: Apache-2.0
"""Tie-on, legs and tools by settings: applied once, refused whole, kept where nothing is set."""

import math

import pytest

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey
from mwd_surface.surveys.leg_settings import LegSettings, arranged
from mwd_surface.surveys.survey_list import SurveyList


def shot(k, inc_deg):
    covariance = (1e-6, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-6)
    return Survey(k * 10**9, f"u{k}", k, math.radians(inc_deg), 1.0, int(North.TRUE), covariance=covariance)


def filled():
    whole = SurveyList()
    for k in range(1, 5):
        whole = whole.add(shot(k, 3.0 * k), 30.0 * k + 100.0, 0.0)
    return whole


def test_settings_that_say_nothing_change_nothing():
    whole = filled().using(tool="T-1")
    assert arranged(whole, LegSettings()) is whole


def test_a_new_leg_leaves_its_parent_at_the_kick_off_and_stays_after_a_restart():
    asked = LegSettings(name="ST1", kick_off_depth=175.0, tool="T-2")
    made = arranged(filled(), asked)
    assert (made.leg, made.tool, made.legs[-1].parent) == ("ST1", "T-2", "main")
    assert made.legs[-1].tie_on.measured_depth == 175.0
    assert arranged(made, asked) is made
    after = arranged(SurveyList.from_mapping(made.to_mapping()), LegSettings())
    assert after.leg == "ST1"
    with_more = made.add(shot(9, 12.0), 200.0, 0.0)
    assert (with_more.records[-1].leg, with_more.records[-1].tool) == ("ST1", "T-2")
    assert arranged(made, LegSettings(name="main")).leg == "main"


def test_a_new_leg_without_its_kick_off_is_refused_with_the_name_of_the_setting():
    with pytest.raises(ValueError, match=r"give leg\.kick_off_depth"):
        arranged(filled(), LegSettings(name="ST1"))
    with pytest.raises(ValueError, match="outside the stations"):
        arranged(filled(), LegSettings(name="ST1", kick_off_depth=5000.0))


def test_a_tie_on_moves_the_main_leg_in_metres_and_degrees():
    asked = LegSettings(
        tie_on_depth=100.0,
        tie_on_inclination_deg=2.0,
        tie_on_azimuth_deg=57.0,
        tie_on_north=5.0,
        tie_on_east=-3.0,
        tie_on_vertical_depth=99.5,
    )
    made = arranged(filled(), asked)
    path = made.definitive()
    assert path.md[0] == 100.0
    assert math.degrees(path.inclination[0]) == pytest.approx(2.0)
    assert tuple(path.positions[0]) == (5.0, -3.0, 99.5)
    assert arranged(made, asked) is made
    with pytest.raises(ValueError, match="at or above"):
        arranged(filled(), LegSettings(tie_on_depth=150.0))
