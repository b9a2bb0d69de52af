# SPDX-License-Identifier: Apache-2.0
"""Errors of the accelerometers: their influence against simulated tools, and what gravity shows of them."""

import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.gravity.bounded import accelerometer_errors
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.measurement import hole_direction
from mwd_sensors.core import frames
from mwd_sensors.core.constants import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY
FACTORY = bounded.Params(
    accel_bias_sigma=0.03, accel_scale_sigma=0.0015, accel_misalignment_sigma=0.001, gravity_sigma=0.002
)


def tool_errors(rng):
    """Biases, m/s^2, and error matrix of the accelerometers of one tool."""
    matrix = FACTORY.accel_misalignment_sigma * rng.standard_normal((3, 3))
    np.fill_diagonal(matrix, FACTORY.accel_scale_sigma * rng.standard_normal(3))
    return FACTORY.accel_bias_sigma * rng.standard_normal(3), matrix


def drilled(inclination, rng, speed=9.0):
    """Samples of a factory tool that turns at a speed, rad/s, at inclinations, rad, 100 a second, with true down."""
    n = len(inclination)
    mat = frames.mat_nt(inclination, 0.3, speed * 0.01 * np.arange(n))
    turn = np.einsum("nji,njk->nik", mat[:-1], mat[1:])
    gyro = np.zeros((n, 3))
    gyro[1:, 0], gyro[1:, 1] = 100.0 * turn[:, 2, 1], 100.0 * turn[:, 0, 2]
    gyro[1:, 2] = 100.0 * turn[:, 1, 0]
    gyro[1:] *= speed * 0.01 / math.sin(speed * 0.01)
    down, (bias, matrix) = mat[:, 2, :], tool_errors(rng)
    force = -G0 * down
    accel = force + force @ matrix.T + bias + 0.05 * rng.standard_normal((n, 3))
    return (10**7 * np.arange(n, dtype=np.int64), gyro, accel), down


def inclination_of(down):
    return np.arctan2(np.hypot(down[:, 1], down[:, 2]), down[:, 0])


@pytest.mark.parametrize("inclination_deg", [10.0, 45.0, 88.0])
def test_rotation_averages_out_what_is_fixed_across_the_axis_and_nothing_else(inclination_deg):
    rng, inclination = np.random.default_rng(1), math.radians(inclination_deg)
    s = bounded.initial(FACTORY).record[0]
    mats = frames.mat_nt(inclination, 0.0, 0.1 * math.pi * np.arange(2000))
    s.sums.time = 0.03
    for mat in mats:
        s.C[:] = mat
        accelerometer_errors.follow(FACTORY, s, 10.0)
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


@pytest.mark.slow
def test_gravity_at_several_inclinations_narrows_the_errors_along_the_axis_and_sigma_stays_true():
    held, built = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        for inclinations, found in ((np.full(6000, 1.3), held), (np.linspace(0.1, 1.5, 24000), built)):
            samples, down = drilled(inclinations, rng)
            got = bounded.run(FACTORY, bounded.initial(FACTORY), *samples)
            error = got.inclination - inclination_of(down)
            found.append((error[-1], got.sigma_inclination[-1]))
    (held_error, held_sigma), (built_error, built_sigma) = np.array(held).T, np.array(built).T
    assert np.mean(built_sigma) < 0.5 * np.mean(held_sigma)
    assert_consistent(held_error, held_sigma)
    assert_consistent(built_error, built_sigma)


def test_a_tool_worse_than_its_figures_widens_sigma():
    rng = np.random.default_rng(5)
    samples, _ = drilled(np.full(3000, 1.0), rng)
    stated = bounded.Params(gravity_sigma=0.002)
    worse = samples[0], samples[1], samples[2] * 1.01
    good, bad = (bounded.run(stated, bounded.initial(stated), *one).sigma_inclination[-1] for one in (samples, worse))
    assert bad > 2.0 * good
