# SPDX-License-Identifier: Apache-2.0
"""Position uncertainty of surveys that were taken while the string turned."""

import dataclasses

import example_surveys as example
import numpy as np

from mwd_estimation.survey.survey import ROTARY
from mwd_surface.uncertainty.programme import ROTARY_CODE, Interval


def table_of(kind):
    whole = example.surveys(dataclasses.replace(example.WELL, error_model="MWD+SRGM"))
    records = [dataclasses.replace(r, survey=dataclasses.replace(r.survey, kind=kind)) for r in whole.records]
    return example.survey_table(whole.with_records(records), example.MADE)


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
