# SPDX-License-Identifier: Apache-2.0
"""The record of a survey: its norths, its unknowns, its way to a plain table and back."""

import dataclasses
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core import settings
from mwd_surface.surveys.survey_record import SurveyRecord, checked_survey

COVARIANCE = (1e-6, 0.0, 0.0, 0.0, 4e-4, 0.0, 0.0, 0.0, 1e-6)


def survey(**changes):
    given_ = {
        "stamp_ns": 1,
        "uuid": "u",
        "sequence": 1,
        "inclination": 0.5,
        "azimuth": 1.0,
        "north": int(North.MAGNETIC),
    }
    return Survey(**{**given_, "covariance": COVARIANCE, "b_reference": 5e-5, **changes})


def test_true_is_magnetic_plus_declination_and_grid_is_true_minus_convergence():
    shot = survey(azimuth=math.radians(359.0), declination=math.radians(3.0), convergence=math.radians(0.5))
    assert math.degrees(shot.azimuth_from(North.TRUE)) == pytest.approx(2.0)
    assert math.degrees(shot.azimuth_from(North.GRID)) == pytest.approx(1.5)
    assert math.degrees(shot.azimuth_from(North.MAGNETIC)) == pytest.approx(359.0)


@given(
    azimuth=st.floats(0.0, math.tau - 1e-9),
    declination=st.floats(-0.5, 0.5),
    convergence=st.floats(-0.1, 0.1),
    start=st.sampled_from([North.MAGNETIC, North.TRUE, North.GRID]),
    end=st.sampled_from([North.MAGNETIC, North.TRUE, North.GRID]),
)
def test_there_and_back_through_another_north_changes_nothing(azimuth, declination, convergence, start, end):
    shot = survey(azimuth=azimuth, declination=declination, convergence=convergence, north=int(start))
    there = dataclasses.replace(shot, azimuth=shot.azimuth_from(end), north=int(end))
    assert math.cos(there.azimuth_from(start) - azimuth) == pytest.approx(1.0, abs=1e-12)


def test_without_a_reference_field_no_azimuth_is_turned_to_another_north():
    bare = survey(b_reference=math.nan)
    assert bare.azimuth_from(North.TRUE) is None
    assert bare.azimuth_from(North.MAGNETIC) == 1.0
    gyro = survey(north=int(North.TRUE), b_reference=math.nan, convergence=0.01)
    assert gyro.azimuth_from(North.GRID) == pytest.approx(0.99)
    assert survey(azimuth=math.nan).azimuth_from(North.MAGNETIC) is None


def test_sigmas_are_roots_of_the_covariance_and_minus_one_where_withheld():
    assert (survey().sigma_inclination, survey().sigma_azimuth) == pytest.approx((1e-3, 2e-2))
    assert math.isnan(survey(covariance=(math.nan,) * 9).sigma_azimuth)


def test_a_record_survives_json_unchanged():
    shot = survey(azimuths=(AzimuthEstimate("gyro", 2, 1.1, 0.02, 0.4, "pæn"),), reasons=("dip 6.4 deg over 0.45",))
    record = SurveyRecord(shot, 1234.5, 0.2, flags=("gap",), comment="Ünïcode")
    text = json.dumps(settings.to_mapping(record), allow_nan=False)
    assert settings.from_mapping(SurveyRecord, json.loads(text)) == record


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"inclination": math.nan}, "survey.inclination: must be finite"),
        ({"inclination": 4.0}, "survey.inclination: must be within 0 and pi"),
        ({"azimuth": -0.1}, "survey.azimuth: must be within 0 and 2 pi"),
        ({"specific_force": (0.0, math.inf, 0.0)}, r"survey.specific_force\[1\]: must be finite"),
        ({"specific_force": (0.0, 0.0)}, "survey.specific_force: expected 3 values, got 2"),
        ({"uuid": ""}, "survey.uuid: must not be empty"),
        ({"sequence": 0}, "survey.sequence: must be 1 or more"),
        ({"north": 9}, "survey.north: expected 0, 1, 2, 3, got 9"),
    ],
)
def test_an_impossible_survey_is_refused_by_field(changes, says):
    with pytest.raises(ValueError, match=says):
        checked_survey(survey(**changes))


def test_a_doubted_azimuth_is_named_by_the_number_and_the_depth_that_the_list_has():
    off = survey(sequence=7, verdict_azimuth=int(Verdict.REJECT), headline="total field +900 nT off the reference")
    words = "survey 7 at 1486.8 m: azimuth reject: total field +900 nT off the reference"
    assert SurveyRecord(off, measured_depth=1486.8).azimuth_doubt == words
    assert SurveyRecord(off).azimuth_doubt == words.replace(" at 1486.8 m", "")
    for fine in (Verdict.ACCEPT, Verdict.NOT_DETERMINED):
        assert not SurveyRecord(survey(verdict_azimuth=int(fine))).azimuth_doubt
