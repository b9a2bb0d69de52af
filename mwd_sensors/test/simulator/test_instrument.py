# SPDX-License-Identifier: Apache-2.0
"""Instruments: every error term switched on alone has the effect that its formula says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator import instrument, instrument_grade
from mwd_sensors.simulator.instrument_grade import AccelerometerGrade, GyroGrade, MagnetometerGrade

G = 9.80665
DEG_H = math.radians(1.0) / 3600.0


def drawn(**figures):
    return instrument.gyro_triad(GyroGrade(**figures), np.random.default_rng(1))


def read(triad, x, f=None, warm=0.0, gravity=G, noise=None):
    x = np.atleast_2d(np.asarray(x, dtype=float))
    f = np.zeros_like(x) if f is None else np.atleast_2d(np.asarray(f, dtype=float))
    state = instrument.TriadState(np.zeros(3), np.zeros(3))
    warm = np.array([warm])
    bias, out = np.empty((1, 3)), np.empty_like(x)
    instrument.advance(triad, state, 1.0, warm, np.zeros((1, 2, 3)), bias)
    noise = np.zeros_like(x) if noise is None else noise
    instrument.convert(triad, bias, warm, x, f, np.array([gravity]), noise, out)
    return out


def advanced(triad, state, seconds, steps, rng):
    bias = np.empty((steps, 3))
    instrument.advance(triad, state, seconds, np.zeros(steps), rng.standard_normal((steps, 2, 3)), bias)
    return bias


def test_no_error_means_no_error():
    ideal = instrument_grade.grade("ideal")
    x = 0.1 * np.random.default_rng(3).standard_normal((50, 3))
    rng = np.random.default_rng(1)
    for triad in (
        instrument.gyro_triad(ideal.gyro, rng),
        instrument.accelerometer_triad(ideal.accelerometer, rng),
        instrument.magnetometer_triad(ideal.magnetometer, rng),
    ):
        assert np.array_equal(read(triad, x, 9.0 * x, 30.0), x)
        assert triad.noise == 0.0


def test_a_turn_on_bias_adds_itself():
    triad = drawn(bias_deg_h=100.0)
    assert_allclose(read(triad, [1.0, 2.0, 3.0])[0] - [1.0, 2.0, 3.0], triad.bias, atol=1e-15)
    assert 10.0 < np.abs(triad.bias).max() / DEG_H < 400.0


def test_scale_multiplies_and_misalignment_leaks():
    triad = drawn(scale_ppm=1000.0)
    error = read(triad, np.eye(3)) - np.eye(3)
    assert_allclose(error, np.diag(np.diag(error)), atol=1e-15)
    assert 1e-5 < np.abs(np.diag(error)).max() < 5e-3
    leak = read(drawn(misalignment_mrad=1.0), [10.0, 0.0, 0.0])[0]
    assert leak[0] == 10.0
    assert np.all(leak[1:] != 0.0)
    assert np.abs(leak[1:]).max() < 0.05


def test_temperature_moves_bias_and_scale():
    biased, scaled = drawn(bias_deg_h_per_c=10.0), drawn(scale_ppm_per_c=100.0)
    for warm in (0.0, 20.0):
        assert_allclose(read(biased, np.zeros(3), warm=warm)[0], warm * biased.bias_per_c)
        assert_allclose(read(scaled, np.ones(3), warm=warm)[0] - 1.0, warm * scaled.scale_per_c, atol=1e-15)


def test_gyros_feel_acceleration_by_their_g_sensitivity():
    triad = drawn(g_deg_h_g=3.6)
    got = read(triad, np.zeros((3, 3)), G * np.eye(3))
    assert_allclose(got, G * triad.g_matrix.T)
    assert 0.3 < np.abs(triad.g_matrix).max() * G / DEG_H < 15.0


def test_vibration_is_rectified_by_its_mean_square_and_rest_is_not():
    a = AccelerometerGrade(g2_ug_g2=100.0)
    triad = instrument.accelerometer_triad(a, np.random.default_rng(1))
    shake = np.zeros((20000, 3))
    shake[:, 0] = math.sqrt(2.0) * 3.0 * G * np.sin(np.arange(20000) * 0.7)
    shift = (read(triad, shake, shake, gravity=0.0) - shake).mean(axis=0)
    assert_allclose(shift, [9.0 * G**2 * triad.g2[0], 0.0, 0.0], rtol=1e-2, atol=1e-12)
    # All three axes alike at rest on the space diagonal: nothing is left over.
    rest = np.full(3, G / math.sqrt(3.0))
    assert_allclose(read(triad, rest, rest)[0], rest, atol=1e-12)


def test_readings_are_steps_and_clip_at_the_range_of_their_axis():
    triad = drawn(step_deg_s=0.7, range_deg_s=(300.0, 100.0, 100.0))
    x = np.radians(np.linspace(-450.0, 450.0, 3003).reshape(-1, 3))
    got, inside = read(triad, x), np.abs(x) < np.radians([299.0, 99.0, 99.0])
    steps = got[inside] / triad.step
    assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(got[inside] - x[inside]).max() <= 0.5001 * triad.step
    assert_allclose(np.degrees(np.abs(got).max(axis=0)), [300.0, 100.0, 100.0], atol=0.7)
    assert (np.degrees(np.abs(got)) <= [300.0, 100.0, 100.0]).all()


def test_the_slow_bias_has_its_steady_spread_and_forgets_in_its_time():
    triad, rng = drawn(instability_deg_h=10.0, instability_s=100.0), np.random.default_rng(2)
    runs = [instrument.initial(triad, rng) for _ in range(400)]
    first = np.array([run.markov for run in runs])
    later = np.array([advanced(triad, run, 10.0, 10, rng)[-1] for run in runs])
    for bias in (first, later):
        assert bias.std() == pytest.approx(triad.instability, rel=0.06)
    assert np.corrcoef(first.ravel(), later.ravel())[0, 1] == pytest.approx(math.exp(-1.0), abs=0.08)


def test_a_rate_random_walk_grows_with_the_root_of_time():
    triad, rng = drawn(walk_deg_h_sqrt_h=5.0), np.random.default_rng(4)
    ends = [advanced(triad, instrument.initial(triad, rng), 600.0, 6, rng)[-1] for _ in range(200)]
    assert np.std(ends) / DEG_H == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize("bandwidth", [60.0, 255.0, 324.0])
def test_the_low_pass_is_3_db_down_at_its_bandwidth_and_has_no_delay(bandwidth):
    weights = instrument.low_pass(bandwidth, 0.0, 2000.0)
    assert weights.sum() == pytest.approx(1.0)
    assert_allclose(weights, weights[::-1])
    k = np.arange(len(weights)) - len(weights) // 2
    response = np.sum(weights * np.cos(2.0 * math.pi * bandwidth / 2000.0 * k))
    # Sampling a bell of less than one step's width costs a little at 324 Hz.
    assert 20.0 * math.log10(response) == pytest.approx(-3.0, abs=0.15)


def test_the_noise_band_is_that_of_the_low_pass():
    x = np.random.default_rng(1).standard_normal((200_000, 3))
    weights = instrument.low_pass(60.0, 0.0, 2000.0)
    out = np.empty((90_000, 3))
    instrument.filtered(x, weights, 100, 2, out)
    assert out.var() * 2000.0 == pytest.approx(instrument.noise_band(60.0, 2000.0), rel=0.02)
    assert instrument.noise_band(900.0, 1000.0) == 1000.0
    assert instrument.noise_band(0.0, 1000.0) == 1000.0


def test_a_delay_is_a_delay_and_no_bandwidth_is_none():
    assert_allclose(instrument.low_pass(0.0, 0.0, 2000.0), [1.0])
    ramp = np.repeat(np.arange(100.0)[:, None], 3, axis=1)
    out = np.empty((5, 3))
    for delay, bandwidth in ((1e-3, 0.0), (0.7e-3, 0.0), (1e-3, 100.0)):
        weights = instrument.low_pass(bandwidth, delay, 2000.0)
        instrument.filtered(ramp, weights, 40, 2, out)
        assert_allclose(out[:, 0], 40.0 + 2.0 * np.arange(5) - delay * 2000.0, atol=0.01)


def test_strapdown_integration_is_exact_for_a_constant_rotation():
    rate = np.array([16.0, 1.0, -2.0])
    f_start = np.array([1.0, 2.0, 9.0])
    dt, ratio = 1e-3, 10
    middles = (np.arange(ratio) + 0.5) * dt
    # A force constant in space, seen from the turning tool.
    f = Rotation.from_rotvec(np.outer(middles, rate)).inv().apply(f_start)
    rate_out, f_out = np.empty((1, 3)), np.empty((1, 3))
    instrument.strapdown(np.tile(rate, (ratio, 1)), f, ratio, dt, rate_out, f_out)
    assert_allclose(rate_out[0], rate, rtol=1e-12)
    expected = Rotation.from_rotvec(rate * ratio * dt).inv().apply(f_start)
    assert_allclose(f_out[0], expected, rtol=1e-12)


def test_strapdown_integration_keeps_coning():
    # Classical coning: rates of two axes a quarter apart turn the third (Bortz 1971).
    dt, ratio, beta, omega = 1e-4, 100, 0.02, 2.0 * math.pi * 20.0
    t = (np.arange(ratio * 5) + 0.5) * dt
    rate = np.stack([np.zeros_like(t), beta * omega * np.cos(omega * t), -beta * omega * np.sin(omega * t)], axis=1)
    rate_out, f_out = np.empty((5, 3)), np.empty((5, 3))
    instrument.strapdown(rate, np.zeros_like(rate), ratio, dt, rate_out, f_out)
    whole = Rotation.identity()
    for step in rate * dt:
        whole = whole * Rotation.from_rotvec(step)
    got = Rotation.identity()
    for step in rate_out * (ratio * dt):
        got = got * Rotation.from_rotvec(step)
    assert (whole.inv() * got).magnitude() < 1e-12
    # Over one period of the cone the plain mean of the rates is zero, the strapdown one is not.
    assert abs(rate[:, 0].mean()) < 1e-12
    assert abs(rate_out[:, 0].mean()) > 1e-3


@pytest.mark.parametrize("rate", [0.0, 300.0])
def test_a_strapdown_of_nothing_is_nothing_and_half_turns_are_survived(rate):
    rate_out, f_out = np.empty((1, 3)), np.empty((1, 3))
    instrument.strapdown(np.tile([rate, 0.0, 0.0], (10, 1)), np.ones((10, 3)), 10, 1e-3, rate_out, f_out)
    assert_allclose(rate_out, [[rate, 0.0, 0.0]], atol=1e-9)
    assert_allclose(f_out[:, 0], 1.0)


def test_every_grade_has_a_name_a_source_and_sensible_order():
    grades = {name: instrument_grade.grade(name) for name in instrument_grade.grade_names()}
    assert {"ideal", "mti3", "mti3_calibrated", "tactical_north", "navigation", "owsg_mwd"} <= set(grades)
    for name, grade in grades.items():
        assert grade.name == name
        assert grade.source
    noise = [grades[n].gyro.noise_deg_sqrt_h for n in ("navigation", "tactical_north", "mti3")]
    assert noise == sorted(noise)
    # MTi 1-series: 0.007 deg/s/sqrt(Hz), 120 ug/sqrt(Hz).
    assert grades["mti3"].gyro.noise_deg_sqrt_h / 60.0 == pytest.approx(0.007)
    assert grades["mti3"].accelerometer.noise_ug_sqrt_hz == 120.0
    # OWSG: 0.004 m/s^2 and 70 nT.
    assert grades["owsg_mwd"].accelerometer.bias_ug * G * 1e-6 == pytest.approx(0.004, rel=1e-3)
    assert grades["owsg_mwd"].magnetometer.bias_nt == 70.0


def test_the_units_of_s1_have_the_figures_of_its_table_and_of_a_published_north_seeker():
    # S1 table 1: differences of the conventional tool in inclination and azimuth, deg, at 30, 60 and 90 m.
    inclination, azimuth = (np.sqrt(np.mean(np.square(one))) for one in ((0.12, 0.31, 0.41), (0.95, 1.44, 1.62)))
    conventional, precision = (instrument_grade.grade(name) for name in ("s1_ahrs", "s1_precision"))
    assert conventional.accelerometer.bias_ug == pytest.approx(1e6 * np.radians(inclination), rel=0.02)
    assert conventional.magnetometer.bias_nt == pytest.approx(31_000.0 * np.radians(azimuth), rel=0.02)
    assert (precision.gyro.noise_deg_sqrt_h, precision.gyro.instability_deg_h) == (0.005, 0.02)
    assert precision.gyro.range_deg_s[1:] == (100.0, 100.0)


def test_figures_of_a_grade_can_be_changed_and_wrong_ones_are_named():
    assert instrument_grade.grade("mti3", {"gyro": {"bandwidth_hz": 100.0}}).gyro.bandwidth_hz == 100.0
    with pytest.raises(SettingsError, match="did you mean mti3"):
        instrument_grade.grade("mti3x")
    with pytest.raises(SettingsError, match="did you mean noise_deg_sqrt_h"):
        instrument_grade.grade("mti3", {"gyro": {"noise_deg_sqrth": 1.0}})


def test_magnetometer_figures_are_in_tesla():
    triad = instrument.magnetometer_triad(MagnetometerGrade(bias_nt=100.0, step_nt=10.0), np.random.default_rng(1))
    assert 1e-9 < np.abs(triad.bias).max() < 5e-7
    assert triad.step == pytest.approx(1e-8)
    assert_allclose(triad.limit, 8e-4)
