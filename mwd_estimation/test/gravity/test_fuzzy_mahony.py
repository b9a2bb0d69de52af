# SPDX-License-Identifier: Apache-2.0
"""S3's method: recursion against exact rotation, coning, the fuzzy table, and a real recording with optical truth."""

import numpy as np
import pytest
from gravity_runs import error_deg, inclination_error, recorded, rms

from consistency import assert_consistent
from mwd_estimation.gravity import fuzzy_mahony
from mwd_sensors.core import frames
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.kalman import coning_rotation, in_turned_axes

G0 = STANDARD_GRAVITY


def stamps_of(n: int, rate: float) -> np.ndarray:
    return np.round(np.arange(n) * 1e9 / rate).astype(np.int64)


def carried(rates: np.ndarray, dt: float, coning: float) -> np.ndarray:
    """Gravity carried by the recursion alone from (0, 0, 1)."""
    g, last, out = (0.0, 0.0, 1.0), np.zeros(3), []
    for rate in rates:
        angle = rate * dt
        g = in_turned_axes(*g, *coning_rotation(*last, *angle, coning))
        last = angle
        out.append(g)
    return np.array(out)


def test_recursion_is_exact_for_a_constant_rotation_vector():
    rate, dt, n = np.array([16.2, -3.0, 2.0]), 0.01, 400
    got = carried(np.tile(rate, (n, 1)), dt, 1.0)
    exact = frames.mat_from_quat(frames.quat_from_rotvec(rate * dt * np.arange(1, n + 1)[:, None])).transpose(0, 2, 1)
    assert np.abs(got - exact @ [0.0, 0.0, 1.0]).max() < 1e-11


def test_coning_term_is_right_for_mean_rates_and_wrong_for_strapdown_integrated_ones():
    # S3's 1/12 term re-computed: 5 Hz coning of 2 deg half angle at 100 Hz, drift about the cone's axis in deg/h.
    half, omega, dt, n, fine = np.radians(2.0), 2 * np.pi * 5.0, 0.01, 6000, 10
    t = (np.arange(n * fine) + 0.5) * dt / fine
    across = omega * np.sin(half)
    rate = np.stack(
        [np.full_like(t, -omega * (1 - np.cos(half))), -across * np.sin(omega * t), across * np.cos(omega * t)], axis=-1
    )
    # The cone is closed, so that a whole number of turns brings gravity back to where it was.
    phi = half * np.array([0.0, 1.0, 0.0])
    start = frames.mat_from_quat(frames.quat_from_rotvec(phi)).T
    turns = frames.quat_from_rotvec(rate * dt / fine).reshape(n, fine, 4)
    whole = turns[:, 0]
    for k in range(1, fine):
        whole = frames.quat_multiply(whole, turns[:, k])
    strapdown = 2.0 * whole[:, :3] / dt  # sin(a)/a of these angles is one to 1e-4, alike in all samples
    mean = rate.reshape(n, fine, 3).mean(axis=1)

    def drift(rates: np.ndarray, coning: float) -> float:
        g, last = tuple(start @ [0.0, 0.0, 1.0]), np.zeros(3)
        for sample in rates:
            g = in_turned_axes(*g, *coning_rotation(*last, *(sample * dt), coning))
            last = sample * dt
        back = start.T @ np.array(g)
        return abs(np.degrees(np.arctan2(back[1], back[2]))) * 3600.0 / (n * dt)

    assert drift(mean, 0.0) == pytest.approx(65.0, abs=2.0)
    assert drift(mean, 1.0) < 3.0
    assert drift(strapdown, 0.0) < 3.0
    assert drift(strapdown, 1.0) == pytest.approx(63.0, abs=3.0)


@pytest.mark.parametrize(
    ("vibration", "rpm", "step"),
    [
        (0, 0, 0.06),
        (25, 0, 0.03),
        (50, 0, -0.03),
        (0, 100, 0.0),
        (25, 100, 0.0),
        (50, 100, -0.03),
        (0, 200, 0.0),
        (25, 200, -0.03),
        (50, 200, -0.06),
        (500, 900, -0.06),
        (50, -200, -0.06),
    ],
)
def test_fuzzy_table_at_its_corners(vibration, rpm, step):
    assert fuzzy_mahony.fuzzy_step(float(vibration), float(rpm)) == pytest.approx(step, abs=1e-15)


def test_fuzzy_output_between_corners_is_the_centroid_of_the_four_fired_rules():
    # vib 10 -> S .6, M .4; rot 150 -> M .5, L .5; minima .5 .4 .5 .4 on Z Z Z NS.
    assert fuzzy_mahony.fuzzy_step(10.0, 150.0) == pytest.approx(-0.03 * 0.4 / 1.8)


def test_correction_pulls_towards_the_accelerometer_and_not_away():
    p = fuzzy_mahony.MahonyParams(start_s=0.0, k_i=0.0)
    state = fuzzy_mahony.initial(p)
    f = np.array([[-np.cos(0.5), 0.0, np.sin(0.5)]]) * G0
    # Starts from one tilted sample, then gets true samples: the error must shrink.
    fuzzy_mahony.run(p, state, [0], np.zeros((1, 3)), [[-G0, 0.0, 0.0]])
    got = fuzzy_mahony.run(p, state, stamps_of(6000, 100.0)[1:], np.zeros((5999, 3)), np.repeat(f, 5999, axis=0))
    assert got.g_t[-1] == pytest.approx(-f[0] / G0, abs=1e-3)


def test_rotating_start_needs_no_still_interval():
    rate, n = 155.0 / 60.0 * 2 * np.pi, 3000
    t = np.arange(n) / 100.0
    truth = np.stack([np.zeros(n), np.sin(rate * t), np.cos(rate * t)], axis=-1)
    rng = np.random.default_rng(3)
    accel = -G0 * truth + 8.0 * rng.standard_normal((n, 3))
    gyro = np.tile([rate, 0.0, 0.0], (n, 1))
    p = fuzzy_mahony.MahonyParams()
    got = fuzzy_mahony.run(p, fuzzy_mahony.initial(p), stamps_of(n, 100.0), gyro, accel)
    assert rms(error_deg(got, truth)[1000:]) < 3.0


def test_real_recording_is_followed_within_a_degree_and_sigma_knows_it():
    ((data, scored),) = recorded("27_disturbed_phone_vibration_B")
    p = fuzzy_mahony.MahonyParams()
    got = fuzzy_mahony.run(p, fuzzy_mahony.initial(p), *data[:3])
    assert rms(error_deg(got, data.down)[scored]) < 1.0
    errors = inclination_error(got, data.down)[scored]
    assert_consistent(errors, got.sigma_inclination[scored], correlated=True)
