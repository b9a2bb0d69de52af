"""Dynamics in a driller's numbers, each against motion whose answer is known in closed form."""

import numpy as np
import pytest

from mwd_estimation import dynamics_summary as dynamics
from mwd_estimation.track import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY
DOWN = np.array([0.6, 0.0, 0.8])


def window(n=1000, rate_hz=100.0):
    t = np.arange(n) / rate_hz
    return t, np.round(t * 1e9).astype(np.int64), np.zeros((n, 3)), np.tile(-G0 * DOWN, (n, 1)), np.tile(DOWN, (n, 1))


def test_steady_rotation_has_no_stick_slip():
    _, stamps, gyro, accel, g = window()
    gyro[:, 0] = 12.0
    got = dynamics.summary(dynamics.Params(), stamps, gyro, accel, g)
    assert got.rotary_speed == pytest.approx(12.0)
    assert got.stick_slip_index == pytest.approx(0.0, abs=1e-12)
    assert got.stick_share == 0.0
    assert (got.axial_rms, got.lateral_rms) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("depth", [0.3, 1.0, 1.4])
def test_stick_slip_index_is_half_the_swing_over_the_mean(depth):
    t, stamps, gyro, accel, g = window()
    gyro[:, 0] = -15.0 * (1 - depth * np.cos(2 * np.pi * 0.2 * t))
    got = dynamics.summary(dynamics.Params(speed_smoothing=0.0), stamps, gyro, accel, g)
    assert got.stick_slip_index == pytest.approx(depth, rel=1e-3)
    assert (got.stick_share > 0.0) == (depth > 0.9)


def test_a_sliding_tool_has_no_stick_slip_index():
    _, stamps, gyro, accel, g = window()
    assert np.isnan(dynamics.summary(dynamics.Params(), stamps, gyro, accel, g).stick_slip_index)


def test_vibration_is_split_along_and_across_the_axis():
    t, stamps, gyro, accel, g = window()
    accel[:, 0] += 3.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 7.0 * t)
    accel[:, 1] += 4.0 * np.cos(2 * np.pi * 11.0 * t)
    accel[:, 2] += 4.0 * np.sin(2 * np.pi * 11.0 * t)
    got = dynamics.summary(dynamics.Params(), stamps, gyro, accel, g)
    assert got.axial_rms == pytest.approx(3.0, rel=1e-6)
    assert got.lateral_rms == pytest.approx(4.0, rel=1e-6)
    assert got.lateral_peak == pytest.approx(4.0, rel=1e-6)
    assert got.axial_peak == pytest.approx(3.0 * np.sqrt(2.0), rel=0.01)


def test_shocks_are_counted_once_each_and_the_highest_is_named():
    _, stamps, gyro, accel, g = window()
    for at, size in ((100, 300.0), (101, 400.0), (103, 260.0), (500, 260.0)):
        accel[at, 1] += size
    got = dynamics.summary(dynamics.Params(shock_separation=0.02), stamps, gyro, accel, g)
    assert got.shocks == 2
    assert dynamics.summary(dynamics.Params(), stamps, gyro, accel, g).shocks == 3
    assert got.shock_peak == pytest.approx(400.0)


def test_samples_that_are_not_finite_are_left_out():
    _, stamps, gyro, accel, g = window()
    gyro[3, 0], accel[4, 1], g[5] = np.nan, np.inf, np.nan
    got = dynamics.summary(dynamics.Params(), stamps, gyro, accel, g)
    assert got.samples == 997
    assert np.isfinite(got.axial_peak)


def test_a_window_without_samples_shows_nothing_and_says_so():
    got = dynamics.summary(dynamics.Params(), [], np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
    assert got.samples == 0
    assert np.isnan(got.rotary_speed)
    assert got.shocks == 0


def test_blocks_of_the_wrong_shape_are_named():
    with pytest.raises(ValueError, match="accel_t"):
        dynamics.summary(dynamics.Params(), [0, 1], np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((2, 3)))
