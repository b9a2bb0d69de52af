# SPDX-License-Identifier: Apache-2.0
"""Outside the calibrated temperatures the errors of the continuous attitude agree with its sigmas."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tool_streams import REFERENCE, START, streams

from mwd_estimation.core.calibrated_range import CalibratedRange, HeatedSigmas
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.settings import changed

SLOPES = CalibratedRange(10.0, 150.0, 1e-4, 1e-9)
SECOND = 10**9
SIGMAS = ("sigma_inclination", "sigma_gravity_toolface", "sigma_azimuth", "sigma_magnetic_toolface")


def rows(count=50, sigma=1e-3):
    attitude, gravity = wire.ATTITUDE.empty(count), wire.GRAVITY.empty(count)
    for samples in (attitude, gravity):
        samples["stamp_ns"] = START + np.arange(count) * SECOND // 10
    attitude["inclination"] = 0.8
    for name in SIGMAS:
        attitude[name] = sigma
    gravity["sigma"] = sigma
    return attitude, gravity


def widened(celsius, attitude, gravity, cuts=()):
    heated = HeatedSigmas(SLOPES)
    times = START + np.arange(len(celsius)) * SECOND
    edges = [0, *cuts, len(attitude)]
    for start, stop in itertools.pairwise(edges):
        if start < stop:
            new = (times <= attitude["stamp_ns"][stop - 1]) & ((times > attitude["stamp_ns"][start - 1]) | (start == 0))
            heated.take(times[new], np.array(celsius)[new])
            heated.widen(attitude[start:stop], gravity[start:stop], REFERENCE)
    return attitude, gravity


def test_sigmas_grow_with_the_distance_to_the_range_and_are_untouched_inside_of_it():
    attitude, gravity = widened([20.0, 150.0, 170.0, 190.0, 60.0], *rows())
    for name in SIGMAS:
        by_second = attitude[name].reshape(5, 10)
        assert (by_second == by_second[:, :1]).all()
        assert by_second[0, 0] == by_second[1, 0] == by_second[4, 0] == 1e-3
        assert 1e-3 < by_second[2, 0] < by_second[3, 0]
    assert gravity["sigma"][35] == pytest.approx(math.hypot(1e-3, 40.0 * 1e-4 / 9.80665))


@given(cuts=st.lists(st.integers(0, 50), max_size=6).map(sorted), back=st.integers(0, 48))
@settings(max_examples=50)
def test_however_the_stream_is_cut_the_bits_are_the_same_also_where_a_stamp_goes_back(cuts, back):
    celsius = [20.0, 190.0, math.nan, 170.0, 20.0]

    def sent():
        attitude, gravity = rows()
        attitude["stamp_ns"][back] -= 2 * SECOND
        return attitude, gravity

    # A temperature comes before the samples of its time, in any cut.
    cuts = [cut for cut in cuts if cut != back + 1]
    whole, parts = widened(celsius, *sent()), widened(celsius, *sent(), cuts)
    assert whole[0].tobytes() == parts[0].tobytes()
    assert whole[1].tobytes() == parts[1].tobytes()


def test_unknown_sigmas_stay_unknown_and_none_is_above_pi():
    attitude, gravity = rows(10)
    attitude["inclination"] = 0.0
    attitude["sigma_azimuth"], attitude["sigma_magnetic_toolface"] = math.nan, math.pi
    widened([190.0], attitude, gravity)
    assert np.isnan(attitude["sigma_azimuth"]).all()
    assert (attitude["sigma_magnetic_toolface"] == math.pi).all()
    assert (attitude["sigma_gravity_toolface"] == math.pi).all()


@pytest.mark.slow
@pytest.mark.fault_case(23)
def test_a_tool_at_190_degrees_is_as_wrong_as_its_continuous_sigma_says():
    rng, n, found = np.random.default_rng(23), 1500, {name: [] for name in SIGMAS[:3]}
    mats = mat_nt(np.full(n, 0.8), np.full(n, 1.9), np.full(n, 0.6))
    place = {"place.field": "fixed", "place.total_nt": 5e4, "place.dip_deg": math.degrees(1.1), "place.lat_deg": 55.0}
    given_settings = changed(EstimatorSettings(), place)
    slopes = Pipeline(given_settings).temperature._range
    beyond, heat = slopes.beyond(190.0), wire.TEMPERATURE.empty(15)
    heat["stamp_ns"], heat["temperature"] = START + np.arange(15) * SECOND, 190.0
    for _ in range(40):
        imu, mag = streams(mats, rng)
        imu["linear_acceleration"] += slopes.accelerometer_mps2_per_c * beyond * rng.normal(size=3)
        mag["magnetic_field"] += slopes.magnetometer_t_per_c * beyond * rng.normal(size=3)
        pipeline = Pipeline(given_settings)
        pipeline.push_mag(mag)
        pipeline.push_temperature(heat)
        last = pipeline.push_imu(imu).attitude[-1]
        for name, true in (("inclination", 0.8), ("gravity_toolface", 0.6), ("azimuth", 1.9)):
            found[f"sigma_{name}"].append(float(wrap_pi(last[name] - true)) / float(last[f"sigma_{name}"]))
    for name, ratios in found.items():
        assert np.mean(np.square(ratios)) < 1.6, name
