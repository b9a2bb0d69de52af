# SPDX-License-Identifier: Apache-2.0
"""Verdicts: fixed limits, limits from the tool's own sigma, and refusals of the axial correction in words."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mwd_estimation.core.reason_text import text
from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_estimation.survey import acceptance
from mwd_estimation.survey.acceptance import Deviations, correction_refusal, judge

DEG = math.pi / 180.0
COVARIANCE = np.diag([0.006**2, 200e-9**2, (0.25 * DEG) ** 2])


def deviations(gravity=0.0, field=0.0, dip=0.0):
    return Deviations(gravity, field, dip, COVARIANCE)


@pytest.mark.fault_case(8)
@pytest.mark.parametrize(
    ("off", "limits", "verdict", "words"),
    [
        (deviations(0.02, 250e-9, 0.2 * DEG), "service", "accept", None),
        (deviations(0.03), "service", "doubtful", "total gravity +3.1 mG off the reference, limit 2.5 mG"),
        (deviations(0.05), "service", "reject", "+5.1 mG"),
        (deviations(field=-320e-9), "service", "doubtful", "total field -320 nT off the reference, limit 300 nT"),
        (deviations(field=-500e-9), "iscwsa", "reject", "-500 nT"),
        (deviations(dip=0.3 * DEG), "service", "accept", None),
        (deviations(dip=0.3 * DEG), "iscwsa", "doubtful", "dip +0.30 deg off the reference, limit 0.25 deg"),
        (deviations(field=450e-9), "toolcode", "doubtful", "limit 400 nT"),
        (deviations(field=650e-9), "toolcode", "reject", "+650 nT"),
    ],
)
def test_a_deviation_beyond_its_limit_is_named_with_value_and_limit(off, limits, verdict, words):
    judged = judge(off, limits)
    assert judged.verdict == verdict
    assert (not judged.reasons) if words is None else words in text(judged.reasons[0])


def test_deviations_that_fit_singly_but_not_together_are_doubted_by_the_tool_code():
    cov = np.diag([0.006**2, 200e-9**2, (0.25 * DEG) ** 2])
    cov[1, 2] = cov[2, 1] = 0.95 * 200e-9 * 0.25 * DEG
    judged = judge(Deviations(0.0, 300e-9, -0.375 * DEG, cov), "toolcode")
    assert judged.verdict == "reject"
    assert "together" in text(judged.reasons[0])


def test_unknown_deviations_are_not_judged():
    assert judge(Deviations(math.nan, math.nan, math.nan, COVARIANCE), "toolcode").verdict == "accept"
    assert acceptance.totals(Deviations(math.nan, math.nan, math.nan, COVARIANCE), "service") == []


def test_an_accepted_station_says_what_it_was_held_against():
    (remark,) = acceptance.totals(deviations(0.01, -193e-9, -0.22 * DEG), "service")
    totals = "total gravity +1.0 mG (limit 2.5 mG), total field -193 nT (limit 300 nT)"
    assert text(remark) == f"within limits: {totals}, dip -0.22 deg (limit 0.45 deg)"


@pytest.mark.parametrize("limits", ["service", "iscwsa", "toolcode"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_station_is_accepted_up_to_its_bounds_and_doubted_beyond(limits, axis):
    bounds = acceptance.bounds(deviations(), limits)
    for share, verdict in ((0.999, "accept"), (1.001, "doubtful")):
        off = np.zeros(3)
        off[axis] = share * bounds[axis]
        assert judge(deviations(*off), limits).verdict == verdict
        assert (acceptance.bounds(deviations(*off), limits) == bounds).all()


def test_what_is_not_judged_has_no_bound():
    bounds = acceptance.bounds(Deviations(0.0, math.nan, 0.0, COVARIANCE), "service")
    assert np.isnan(bounds).tolist() == [False, True, False]


def test_unknown_limits_are_an_error_that_lists_the_known():
    with pytest.raises(ValueError, match="service, iscwsa, toolcode"):
        judge(deviations(), "strict")
    with pytest.raises(ValueError, match="service, iscwsa, toolcode"):
        acceptance.bounds(deviations(), "strict")


def test_the_graver_verdict_wins():
    assert acceptance.worse("accept", "reject") == acceptance.worse("reject", "doubtful") == "reject"
    assert acceptance.worse("accept", "doubtful") == "doubtful"


GOOD = AxialCorrection(
    azimuth=np.array(1.0),
    sigma_azimuth=np.array(0.5 * DEG),
    interference=np.array(1e-6),
    sigma_interference=np.array(1e-7),
    chi_square=np.array(0.5),
    mirror=np.array(False),
    both=np.full(2, np.nan),
    share=np.array(0.0),
    sensitivity=np.zeros(6),
)


@pytest.mark.fault_case(30)
@pytest.mark.parametrize(
    ("changes", "inclination", "words"),
    [
        ({}, 40.0, ""),
        ({}, 0.5, "only 0.50 deg from vertical"),
        ({}, 179.5, "only 0.50 deg from vertical"),
        ({"chi_square": np.array(80.0)}, 40.0, "not axial"),
        ({"mirror": np.array(True), "both": np.array([1.0, 2.0])}, 90.0, "two azimuths, 57.3 and 114.6 deg"),
        (
            {"sigma_azimuth": np.array(9.8 * DEG), "azimuth": np.array(88 * DEG)},
            87.0,
            "3 deg from horizontal and 2 deg from magnetic east-west: corrected azimuth good only to 9.8 deg",
        ),
    ],
)
def test_a_correction_that_geometry_forbids_is_refused_in_words(changes, inclination, words):
    refused = correction_refusal(replace(GOOD, **changes), inclination * DEG)
    assert (refused is None) if words == "" else words in text(refused)
