# SPDX-License-Identifier: Apache-2.0
"""A survey on a turning string: the same angles as at rest, and a refusal where nothing turns."""

import math

import numpy as np
import pytest

from mwd_estimation.attitude.sample import samples_of
from mwd_estimation.attitude.time_alignment import PAIR
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.track import Track
from mwd_estimation.survey.rotary_survey import RotarySurvey
from mwd_estimation.survey.static_survey import Refusal
from mwd_estimation.survey.station import station
from mwd_sensors.core.frames import mat_nt, wrap_pi

START = 10**18
FIELD_N = np.array([2e-5, 0.0, 4.5e-5])
REFERENCE = Reference(total=float(np.hypot(2e-5, 4.5e-5)), dip=math.atan2(4.5, 2.0), gravity=9.81, source="test")


def turning(seconds, rate=12.0, own=(0.0, 4e-7, -3e-7), shake=5.0, seed=1):
    rng = np.random.default_rng(seed)
    n = round(seconds * 100) + 1
    stamps = START + np.arange(n) * 10**7
    mat = mat_nt(0.9, np.full(n, 2.0), rate * np.arange(n) * 0.01)
    down = np.ascontiguousarray(mat[:, 2, :])
    accel = -9.81 * down + shake * rng.normal(size=(n, 3))
    gyro, one = np.outer(np.full(n, rate), [1.0, 0.0, 0.0]), np.full(n, 1e-3)
    track = Track(down, one, one, np.zeros(n), np.full(n, rate), np.zeros(n, dtype=np.uint32), np.zeros(n))
    b_t = np.einsum("kji,j->ki", mat, FIELD_N) + own
    at = np.arange(0, n, 20)
    pairs = np.zeros(len(at), dtype=PAIR)
    pairs["place"], pairs["stamp_ns"], pairs["g_t"], pairs["b_t"] = at, stamps[at], down[at], b_t[at]
    return samples_of((stamps, stamps), gyro, accel, track, np.zeros(n, dtype=np.uint8)), pairs


def cut(block, part):
    samples, pairs = block
    chosen = (pairs["place"] >= part[0]) & (pairs["place"] <= part[-1])
    return samples[part], pairs[chosen]


def test_a_turning_string_gives_the_angles_it_would_give_at_rest():
    survey = RotarySurvey(30.0)
    average = survey.add(*turning(30.0))
    assert (average.end_ns - average.start_ns) == 30 * 10**9
    assert average.requested
    found = station(
        average.imu.mean[3:],
        average.mag.mean,
        REFERENCE,
        covariance_f=average.imu.covariance[3:, 3:],
        covariance_b=average.mag.covariance,
    )
    assert found.inclination == pytest.approx(0.9, abs=1e-3)
    # Cross-axial field of 500 nT, 1.4 deg at rest, averages out.
    assert wrap_pi(found.azimuth - 2.0) == pytest.approx(0.0, abs=math.radians(0.1))
    assert found.g_total == pytest.approx(9.81, abs=0.2)
    assert survey.rotary_speed == pytest.approx(12.0)


def test_any_cut_gives_the_same_average():
    block = turning(12.0)
    whole = RotarySurvey(10.0).add(*block)
    survey = RotarySurvey(10.0)
    results = [survey.add(*cut(block, part)) for part in np.split(np.arange(len(block[0])), [1, 300, 999, 1001])]
    (average,) = [result for result in results if result is not None][:1]
    np.testing.assert_allclose(average.imu.mean, whole.imu.mean, rtol=1e-12)
    np.testing.assert_allclose(average.mag.mean, whole.mag.mean, rtol=1e-12)
    assert survey.progress().remaining == 0.0


def test_a_string_that_does_not_turn_is_refused():
    refused = RotarySurvey(5.0).add(*turning(6.0, rate=0.0))
    assert isinstance(refused, Refusal)
    assert refused.reason.code is ReasonCode.STRING_DOES_NOT_TURN


def test_progress_tells_time_and_samples():
    survey = RotarySurvey(30.0)
    assert survey.progress().samples == 0
    assert survey.add(*turning(4.0)) is None
    given = survey.progress()
    assert (given.elapsed, given.remaining, given.samples, given.state) == (4.0, 26.0, 401, "averaging")
    with pytest.raises(ValueError, match="duration"):
        RotarySurvey(1.0)
