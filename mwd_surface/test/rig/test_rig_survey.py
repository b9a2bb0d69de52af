# SPDX-License-Identifier: Apache-2.0
"""Accepted surveys carry the numbers of the path, and None where nothing is known."""

import dataclasses
import math

import pytest
from example_surveys import START, WELL, S, survey, surveys

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import AzimuthEstimate, Verdict
from mwd_surface.rig import survey as rig_survey
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.surveys.survey_list import SurveyList


def test_the_accepted_are_those_in_use_oldest_first_with_the_numbers_of_the_path():
    whole = surveys()
    path = whole.definitive()
    accepted = accepted_surveys(whole)
    assert [s.result.sequence for s in accepted] == [k for k in range(1, 13) if k != 6]
    for s in accepted:
        k = path.sequence.index(s.result.sequence)
        there = [s.value(name) for name in ("measured_depth", "inclination", "azimuth")]
        assert there == [path.md[k], path.inclination[k], path.azimuth[k]]
        assert [s.value(n) for n in ("position_north", "position_east", "vertical_depth")] == list(path.positions[k])


def test_no_more_than_the_interfaces_have_are_kept_and_they_are_the_last(monkeypatch):
    monkeypatch.setattr(rig_survey, "LAST", 3)
    assert [s.result.sequence for s in accepted_surveys(surveys())] == [10, 11, 12]
    assert accepted_surveys(SurveyList()) == ()


def test_a_judgement_against_the_verdict_is_published_and_is_a_change():
    before = next(s for s in accepted_surveys(surveys()) if s.result.sequence == 9)
    assert before.overridden
    assert before.result.verdict == Verdict.DOUBTFUL
    again = surveys().accept(9, "Bo", "again", START + 91_000 * S)
    after = next(s for s in accepted_surveys(again) if s.result.sequence == 9)
    assert before.key != after.key
    assert not next(s for s in accepted_surveys(surveys()) if s.result.sequence == 8).overridden


def test_the_uncorrected_azimuth_is_the_magnetic_one_of_the_raw_method():
    last = accepted_surveys(surveys())[-1]
    assert math.degrees(last.value("azimuth_uncorrected")) == pytest.approx(75.0 + 0.4 * 12 - 2.0 + 0.8)
    assert last.source.corrected


def test_the_uncorrected_azimuth_stays_known_where_a_reference_turns_azimuths_to_another_north():
    raw = (AzimuthEstimate("raw", int(North.GRID), math.radians(76.0), 0.01),)
    fields = {"b_reference": 5e-5, "declination": math.radians(5.0), "convergence": math.radians(1.0)}
    one = survey(1, 30.0, 75.0, azimuths=raw, north=int(North.GRID), **fields)
    well = dataclasses.replace(WELL, north_reference="grid")
    (accepted,) = accepted_surveys(SurveyList(well=well).add(one, 300.0, 0.0))
    # Magnetic = grid + convergence - declination.
    assert math.degrees(accepted.value("azimuth_uncorrected")) == pytest.approx(72.0)


@pytest.mark.parametrize(
    ("method", "status", "remark"),
    [
        ("raw", Status.UNCORRECTED, "not corrected"),
        ("raw", Status.CORRECTION_REFUSED, "not corrected"),
        ("fused", Status.CORRECTED, ""),
        ("gyro", Status.MAG_DISTURBED, ""),
    ],
)
def test_an_azimuth_that_lacks_its_correction_is_remarked(method, status, remark):
    one = survey(1, 30.0, 75.0, azimuth_method=method, status=int(status))
    (accepted,) = accepted_surveys(SurveyList(well=WELL).add(one, 300.0, 0.0))
    assert remark in accepted.remark
    assert bool(accepted.remark) == bool(remark)


def test_what_a_survey_does_not_know_is_none():
    bare = survey(
        1,
        30.0,
        75.0,
        b_total=math.nan,
        dip=math.nan,
        b_reference=math.nan,
        temperature=math.nan,
        axial_interference=math.nan,
        sigma_axial_interference=math.nan,
        azimuths=(),
        magnetic_field=(math.nan,) * 3,
        azimuth_method="gyro",
        north=2,
        covariance=(math.nan, *(0.0,) * 3, 1e-6, *(0.0,) * 4),
    )
    well = dataclasses.replace(WELL, north_reference="true")
    (s,) = accepted_surveys(SurveyList(well=well).add(bare, 300.0, 0.0))
    unknown = ("b_total", "dip", "temperature", "axial_interference", "azimuth_uncorrected", "sigma_inclination")
    assert [s.value(name) for name in unknown] == [None] * 6
    assert s.value("sigma_azimuth") == pytest.approx(1e-3)
