# SPDX-License-Identifier: Apache-2.0
"""Linear Kalman extraction: its scalar covariance is the full six-state filter, and it follows a real recording."""

import numpy as np
import pytest
from gravity_runs import error_deg, recorded, rms

from mwd_estimation.gravity import ligorio_kalman as kalman
from mwd_sensors.core.constants import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY


def test_three_numbers_carry_the_covariance_of_the_full_six_state_filter():
    rng = np.random.default_rng(4)
    n, dt = 50, 0.01
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    gyro, accel = rng.standard_normal((n, 3)), -G0 * np.array([0.0, 0.6, 0.8]) + rng.standard_normal((n, 3))
    p = kalman.LigorioParams(rate_noise=0.0, bias_gain=0.0)
    state = kalman.initial(p)
    kalman.run(p, state, stamps, gyro, accel)
    P = np.diag([(0.5 * G0) ** 2] * 3 + [p.motion**2] * 3)
    H = np.hstack([-np.eye(3), np.eye(3)])
    keep = np.exp(-dt / p.memory)
    for k in range(n):
        F = np.eye(6)
        Q = np.zeros((6, 6))
        if k:
            angle = np.linalg.norm(gyro[k] * dt)
            u = gyro[k] / np.linalg.norm(gyro[k])
            K = np.cross(np.eye(3), u)
            F[:3, :3] = (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K).T
            F[3:, 3:] = keep * F[:3, :3]
            Q[:3, :3] = np.eye(3) * (G0 * p.angle_noise) ** 2 * dt
            Q[3:, 3:] = np.eye(3) * (1 - keep**2) * p.motion**2
        P = F @ P @ F.T + Q
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(3) * p.accel_noise**2)
        P = P - gain @ H @ P
    assert np.diag(P)[:3] == pytest.approx(state[0].p_gg, rel=1e-9)
    assert np.diag(P)[3:] == pytest.approx(state[0].p_aa, rel=1e-9)


def test_a_still_tool_is_exact():
    p, n, down = kalman.LigorioParams(), 2000, np.array([0.6, 0.0, 0.8])
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    got = kalman.run(p, kalman.initial(p), stamps, np.zeros((n, 3)), np.tile(-G0 * down, (n, 1)))
    assert got.g_t[-1] == pytest.approx(down, abs=1e-12)


def test_real_recording_is_followed_within_three_degrees():
    ((data, scored),) = recorded("27_disturbed_phone_vibration_B")
    p = kalman.LigorioParams()
    got = kalman.run(p, kalman.initial(p), *data[:3])
    assert rms(error_deg(got, data.down)[scored]) < 3.0
