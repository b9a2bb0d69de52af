# SPDX-License-Identifier: Apache-2.0
"""Tilt due to errors of the accelerometers: its variance against simulated tools, and the filter's response."""

import math

import numpy as np
import pytest
from gravity_runs import Drilled, followed

from mwd_estimation.gravity.bounded import accelerometer_errors
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.measurement import hole_direction
from mwd_sensors.core import frames
from mwd_sensors.core.constants import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY
FACTORY = bounded.BoundedParams(
    accel_bias_sigma=0.03, accel_scale_sigma=0.0015, accel_misalignment_sigma=0.001, gravity_sigma=0.002
)


def tool_errors(rng):
    """Biases, m/s^2, and error matrix of the accelerometers of one tool."""
    matrix = FACTORY.accel_misalignment_sigma * rng.standard_normal((3, 3))
    np.fill_diagonal(matrix, FACTORY.accel_scale_sigma * rng.standard_normal(3))
    return FACTORY.accel_bias_sigma * rng.standard_normal(3), matrix


def drilled(inclination, rng, speed, n=6000):
    """Samples of a factory tool that turns at a speed, rad/s, at an inclination, rad, 100 a second, with true down."""
    mat = frames.mat_nt(inclination, 0.3, speed * 0.01 * np.arange(n))
    turn = np.einsum("nji,njk->nik", mat[:-1], mat[1:])
    gyro = np.zeros((n, 3))
    gyro[1:, 0], gyro[1:, 1] = 100.0 * turn[:, 2, 1], 100.0 * turn[:, 0, 2]
    gyro[1:, 2] = 100.0 * turn[:, 1, 0]
    gyro[1:] /= np.sinc(speed * 0.01 / math.pi)
    down, (bias, matrix) = mat[:, 2, :], tool_errors(rng)
    force = -G0 * down
    accel = force + force @ matrix.T + bias + 0.05 * rng.standard_normal((n, 3))
    return Drilled(10**7 * np.arange(n, dtype=np.int64), gyro, accel, down)


@pytest.mark.parametrize("inclination_deg", [10.0, 45.0, 88.0])
def test_rotation_averages_out_what_is_fixed_across_the_axis_and_nothing_else(inclination_deg):
    rng, inclination = np.random.default_rng(1), math.radians(inclination_deg)
    s = bounded.initial(FACTORY).record[0]
    mats = frames.mat_nt(inclination, 0.0, 0.7 * math.pi * np.arange(2000))
    s.sums.time = 0.03
    for mat in mats:
        s.C[:] = mat
        accelerometer_errors.follow(FACTORY, s)
    along, across = accelerometer_errors.variances(FACTORY, s, *hole_direction(s))
    errors = []
    for _ in range(2000):
        bias, matrix = tool_errors(rng)
        force = -G0 * mats[:200, 2, :]
        errors.append(np.einsum("nij,nj->i", mats[:200], force @ matrix.T + bias) / (200 * G0))
    tilt = np.asarray(errors)
    d = np.array(hole_direction(s))
    assert along == pytest.approx(np.mean((tilt[:, :2] @ d) ** 2), rel=0.15)
    assert across == pytest.approx(np.mean((tilt[:, :2] @ np.array([-d[1], d[0]])) ** 2), rel=0.15)


@pytest.mark.parametrize("speed", [0.0, 12.0])
def test_the_tilt_follows_a_level_force_within_the_response_time(speed):
    data = drilled(0.8, np.random.default_rng(3), speed)
    level = np.cross(data.down, [1.0, 0.0, 0.0])
    level /= np.linalg.norm(level, axis=1)[:, None]
    late = np.where(np.arange(len(level)) >= 4000, 0.005, 0.0)[:, None]
    without, with_force = (followed(one, FACTORY) for one in (data, data._replace(accel=data.accel + late * level)))
    tilt = np.linalg.norm(np.cross(without.g_t, with_force.g_t), axis=1) * G0 / 0.005
    reached = 0.01 * (int(np.flatnonzero(tilt > 1.0 - math.exp(-1.0))[0]) - 4000)
    assert tilt[-1] == pytest.approx(1.0, abs=0.05)
    assert 0.7 * accelerometer_errors.RESPONSE < reached < 1.4 * accelerometer_errors.RESPONSE


def test_a_tool_worse_than_its_figures_widens_sigma():
    data, stated = drilled(1.0, np.random.default_rng(5), 9.0, 3000), bounded.BoundedParams(gravity_sigma=0.002)
    good, bad = (followed(data._replace(accel=scale * data.accel), stated) for scale in (1.0, 1.01))
    assert bad.sigma_inclination[-1] > 2.0 * good.sigma_inclination[-1]
