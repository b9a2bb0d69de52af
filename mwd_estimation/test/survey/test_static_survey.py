# SPDX-License-Identifier: Apache-2.0
"""Surveys in still intervals: one each, after settling, on request at once, and refusals that say why."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.time_bins import Bin, Binner
from mwd_estimation.survey.static_survey import BIN_NS, BinSet, Refusal, StillAverage, StillSurvey
from mwd_estimation.survey.survey_settings import SurveySettings

RATE = 100

WAIT = Reason(ReasonCode.SEEK_TOO_SHORT, 5.0, 30.0)


def _bins(seconds, force=(-6.0, 0.0, 7.75), rate=(0.0, 0.0, 0.0), *, noise=1e-3, shaken=0.0, start=10**18, seed=0):
    """Closed bins of a tool that keeps still (or turns, or shakes)."""
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE) + 1
    stamps = start + np.arange(n) * (10**9 // RATE)
    values = np.hstack([np.tile(rate, (n, 1)), np.tile(force, (n, 1))]) + noise * rng.normal(size=(n, 6))
    values[:, 3:] += shaken * (-1.0) ** np.arange(n)[:, None]
    return Binner(6, BIN_NS).add(stamps, values)


def _results(survey, bins, reason=None):
    """Return the result of the survey after each bin; reason: why it waits."""
    return [survey.add(BinSet(one), reason) for one in bins]


def _outcomes(survey, bins):
    return [result for result in _results(survey, bins) if result is not None]


def _at(results):
    """Numbers of the bins with an outcome."""
    return [k for k, result in enumerate(results) if result is not None]


def test_one_survey_is_taken_per_still_interval_after_settling():
    survey = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0))
    (average,) = _outcomes(survey, _bins(30.0))
    assert isinstance(average, StillAverage)
    assert average.start_ns == 10**18 + 2 * 10**9
    assert average.end_ns - average.start_ns == 5 * 10**9
    assert average.imu.count == 500
    assert not average.requested
    assert survey.progress == 1.0
    np.testing.assert_allclose(average.imu.mean[3:], (-6.0, 0.0, 7.75), atol=3e-4)


@pytest.mark.parametrize("moving", [{"rate": (0.045, 0.0, 0.0)}, {"noise": 0.045}, {"shaken": 0.3}])
def test_a_survey_may_move_as_much_as_is_set(moving):
    taken = [len(_outcomes(StillSurvey(SurveySettings(motion=motion)), _bins(30.0, **moving))) for motion in (1.0, 2.0)]
    assert taken == [0, 1]


def test_moving_in_between_allows_the_next_survey():
    survey = StillSurvey(SurveySettings(settle_s=1.0, duration_s=2.0))
    still = _bins(5.0)
    turning = _bins(2.0, rate=(5.0, 0.0, 0.0), start=10**18 + 5 * 10**9)
    again = _bins(5.0, start=10**18 + 7 * 10**9)
    assert len(_outcomes(survey, still + turning + again)) == 2


@pytest.mark.parametrize(
    ("moving", "code"),
    [
        ({"rate": (0.5, 0.0, 0.0)}, ReasonCode.TOOL_TURNS),
        ({"noise": 0.06}, ReasonCode.TOOL_MOVES),
        ({"force": (-5.0, 0.0, 8.0)}, ReasonCode.TOOL_SHIFTS),
    ],
)
def test_a_requested_survey_is_refused_with_value_and_limit_when_the_tool_moves(moving, code):
    survey = StillSurvey(SurveySettings())
    _outcomes(survey, _bins(1.0))
    survey.request(4.0)
    survey.add(BinSet(_bins(0.5, start=10**18 + 10**9)[0]))
    (refused,) = _outcomes(survey, _bins(0.6, start=10**18 + 15 * 10**8, **moving))
    assert isinstance(refused, Refusal)
    assert refused.reason.code is code
    assert refused.reason.value > refused.reason.limit


def test_a_requested_survey_starts_at_once_without_settling_and_does_not_wait():
    survey, bins = StillSurvey(SurveySettings(automatic=False, settle_s=10.0)), _bins(20.0)
    assert _outcomes(survey, bins[:6]) == []
    survey.request(3.0)
    results = _results(survey, bins[6:], WAIT)
    assert _at(results) == [5]
    assert results[5].requested
    assert results[5].start_ns == bins[6].index * BIN_NS
    assert results[5].end_ns - results[5].start_ns == 3 * 10**9


@pytest.mark.parametrize("duration_s", [-1.0, 0.2, 601.0, 1e9, math.inf, math.nan])
def test_a_request_for_an_average_that_says_nothing_or_never_ends_is_refused(duration_s):
    survey = StillSurvey(SurveySettings())
    with pytest.raises(ValueError, match="duration: must be 1 to 600 s, or 0 for the configured one"):
        survey.request(duration_s)
    assert not survey.requested


def test_a_gap_between_bins_ends_the_interval():
    survey = StillSurvey(SurveySettings(settle_s=0.0, duration_s=4.0))
    bins = _bins(8.0)
    assert _outcomes(survey, bins[:6] + bins[8:12]) == []


def test_a_bin_with_hardly_any_samples_is_not_called_still():
    survey = StillSurvey(SurveySettings())
    survey.request()
    one = _bins(0.5)[0]
    (refused,) = _outcomes(survey, [Bin(one.index, 2, one.mean, one.scatter, one.low, one.high)])
    assert refused.reason.code is ReasonCode.TOO_FEW_SAMPLES


@pytest.mark.fault_case(49)
def test_a_stream_that_was_silent_for_part_of_the_time_is_not_averaged():
    survey = StillSurvey(SurveySettings(settle_s=0.0, duration_s=2.0))
    bins = _bins(2.5)
    mag = Binner(3, BIN_NS).add(10**18 + np.arange(251) * 10**7, np.full((251, 3), 1e-5))
    sets = [BinSet(imu, mag=field) for imu, field in zip(bins, [*mag[:2], None, *mag[3:]], strict=True)]
    results = [result for one in sets if (result := survey.add(one)) is not None]
    assert results[0].mag is None


def _without_gyro(rpm, seconds=12.0, *, noise=50e-9, mag_hz=RATE, inclination=0.0):
    """Closed bins of a tool without a gyro that turns about its axis in a field of 50 uT, dip 66 deg."""
    rng, turned = np.random.default_rng(3), rpm * math.pi / 30.0
    n = int(seconds * RATE) + 1
    angle = turned * np.arange(n) / RATE
    force = np.column_stack([-np.full(n, math.cos(inclination)), np.cos(angle), np.sin(angle)]) * 9.8
    force[:, 1:] *= math.sin(inclination)
    imu = np.hstack([np.zeros((n, 3)), force + 1e-3 * rng.normal(size=(n, 3))])
    k = np.arange(0, n, RATE // mag_hz)
    field = np.column_stack([np.full(len(k), 45.7e-6), 20e-6 * np.cos(angle[k]), 20e-6 * np.sin(angle[k])])
    stamps = 10**18 + np.arange(n) * (10**9 // RATE)
    mags = {b.index: b for b in Binner(3, BIN_NS).add(stamps[k], field + noise * rng.normal(size=field.shape))}
    return [BinSet(one, mag=mags.get(one.index)) for one in Binner(6, BIN_NS).add(stamps, imu)]


@pytest.mark.fault_case(20)
@given(rpm=st.floats(0.4, 200.0), mag_hz=st.sampled_from([10, 25, 100]))
def test_without_a_gyro_a_vertical_tool_that_turns_is_not_still(rpm, mag_hz):
    survey = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0))
    assert [survey.add(one) for one in _without_gyro(rpm, mag_hz=mag_hz)].count(None) == 24
    assert ReasonCode.FIELD_TURNS in survey.hindrances


@pytest.mark.fault_case(20)
@pytest.mark.parametrize("noise", [0.0, 50e-9, 1e-6])
@pytest.mark.parametrize("mag_hz", [1, 10, 100])
def test_without_a_gyro_a_vertical_tool_at_rest_is_surveyed(noise, mag_hz):
    survey = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0))
    results = [survey.add(one) for one in _without_gyro(0.0, noise=noise, mag_hz=mag_hz)]
    assert sum(isinstance(one, StillAverage) for one in results) == 1


def test_how_long_a_survey_has_waited_counts_from_when_it_had_averaged_enough():
    survey = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0, wait_for_gyro_s=30.0))
    waited = []
    for one in _bins(10.0):
        survey.add(BinSet(one), WAIT)
        waited.append(survey.waited_s)
    enough = round(7.0e9 / BIN_NS)
    assert waited[: enough - 1] == [0.0] * (enough - 1)
    assert waited[enough:] == [(k + 1) * BIN_NS * 1e-9 for k in range(len(waited) - enough)]


def test_a_survey_taken_by_itself_waits_for_what_is_reported_and_averages_all_of_it():
    survey, bins = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0, wait_for_gyro_s=30.0)), _bins(30.0)
    results = [*_results(survey, bins[:40], WAIT), *_results(survey, bins[40:])]
    assert _at(results) == [40]
    assert results[40].end_ns - results[40].start_ns == (41 - 4) * BIN_NS
    assert not results[40].moved


def test_waiting_has_an_end_and_motion_gives_what_was_held():
    survey, bins = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0, wait_for_gyro_s=10.0)), _bins(30.0)
    assert _at(_results(survey, bins, WAIT)) == [4 + 10 + 20 - 1]
    survey = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0, wait_for_gyro_s=100.0))
    turning = _bins(2.0, rate=(5.0, 0.0, 0.0), start=10**18 + 30 * 10**9)
    results = _results(survey, (*bins, *turning), WAIT)
    assert _at(results) == [len(bins)]
    held = results[len(bins)]
    assert held.moved
    assert held.end_ns - held.start_ns == (len(bins) - 4) * BIN_NS


def test_when_nothing_more_comes_what_was_held_is_given_once():
    survey, bins = StillSurvey(SurveySettings(settle_s=2.0, duration_s=5.0)), _bins(20.0)
    assert _at(_results(survey, bins, WAIT)) == []
    held = survey.finish()
    assert held.end_ns - held.start_ns == (len(bins) - 4) * BIN_NS
    assert survey.finish() is None
    assert survey.progress == 1.0
