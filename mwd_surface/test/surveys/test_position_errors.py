# SPDX-License-Identifier: Apache-2.0
"""Position uncertainty of surveys whose errors the tool code does not describe: rotary ones, and failed ones."""

import dataclasses
import math

import example_surveys as example
import numpy as np

from mwd_estimation.survey.survey import ROTARY, Verdict
from mwd_surface.uncertainty.programme import ROTARY_CODE, Interval


def table_of(kind=0, **of_last):
    """A list of surveys of a kind, with other fields of the last one."""
    whole = example.surveys(dataclasses.replace(example.WELL, error_model="MWD+SRGM"))
    records = [dataclasses.replace(r, survey=dataclasses.replace(r.survey, kind=kind)) for r in whole.records]
    records[-1] = dataclasses.replace(records[-1], survey=dataclasses.replace(records[-1].survey, **of_last))
    return example.survey_table(whole.with_records(records), example.MADE)


def test_a_survey_that_is_used_against_its_verdict_has_its_own_sigma():
    wide = {"covariance": (math.radians(0.2) ** 2, 0.0, 0.0, 0.0, math.radians(40.0) ** 2, 0.0, 0.0, 0.0, 1.0)}
    passed, failed = table_of(**wide), table_of(**wide, verdict=int(Verdict.DOUBTFUL))
    # One other survey of the example is accepted by a person although its verdict is doubtful.
    assert "with their own sigmas: 2" in failed.covariance_note
    assert "with their own sigmas: 1" in passed.covariance_note
    deepest = int(np.argmax([r.measured_depth for r in passed.surveys.records]))
    np.testing.assert_array_equal(passed.covariance[1], failed.covariance[1])
    assert np.trace(failed.covariance[deepest]) > 1.2 * np.trace(passed.covariance[deepest])


def test_rotary_surveys_have_the_error_model_of_the_iscwsa_for_them():
    still, turning = table_of(0), table_of(ROTARY)
    assert "11 rotary surveys: Rot 6Axis" in turning.covariance_note
    assert "rotary" not in still.covariance_note
    assert np.isfinite(turning.covariance).all()
    assert not np.allclose(still.covariance[-1], turning.covariance[-1])


def test_a_programme_may_name_another_code_for_them():
    assert Interval("MWD+SRGM").code_of("rotary") == ROTARY_CODE
    assert Interval("GYRO-NS").code_of("rotary") == "GYRO-NS"
    assert Interval("MWD+SRGM", methods={"rotary": "MWD+SRGM"}).code_of("rotary") == "MWD+SRGM"
