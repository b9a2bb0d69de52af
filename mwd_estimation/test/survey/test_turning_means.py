# SPDX-License-Identifier: Apache-2.0
"""Means over whole turns against strings of known axes, lever arms and interference."""

import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.core.time_bins import Bin
from mwd_estimation.survey.turning_means import TurningMeans

_RATE_HZ, _BIN = 100, 50
GRAVITY, FIELD = np.array([-8.0, 5.7, 0.0]), np.array([3.0e-5, 2.0e-5, -1.5e-5])


def turned(vector, roll):
    """A vector that stands still, in tool axes that have turned by `roll` about x; shape (n, 3)."""
    across = (vector[1] + 1j * vector[2]) * np.exp(-1j * roll)
    return np.stack([np.full(len(roll), vector[0]), across.real, across.imag], axis=1)


def string(minutes, rng, *, tilt=(0.0, 0.0), arm=(0.0, 0.0), across=(0.0, 0.0), steady=False):
    """Bins of a string that drills a minute, rests, drills on: tilt of the accelerometers, rad, arm, m, field, T."""
    means, period = TurningMeans(), 60.0
    n = int(minutes * period * _RATE_HZ)
    t = np.arange(n) / _RATE_HZ
    phase = t % period
    rate = np.clip(np.minimum(phase - 5.0, period - phase) * 2.0, 0.0, 12.0)
    rate = np.full(n, 12.0) if steady else rate
    roll = np.cumsum(rate) / _RATE_HZ
    pull = (arm[0] + 1j * arm[1]) * (1j * np.gradient(rate) * _RATE_HZ - rate**2)
    force = turned(GRAVITY, roll) + np.stack([np.zeros(n), pull.real, pull.imag], axis=1)
    # Accelerometers that are turned by (0, y, z) read their turn x force besides.
    force = force + np.cross(np.array([0.0, tilt[0], tilt[1]]), force) + rng.normal(0.0, 1.0, (n, 3))
    field = turned(FIELD, roll) + np.array([0.0, *across]) + rng.normal(0.0, 2e-7, (n, 3))
    gyro = np.stack([rate, np.zeros(n), np.zeros(n)], axis=1) + rng.normal(0.0, 0.002, (n, 3))
    imu = np.hstack([gyro, force])
    for k in range(n // _BIN):
        part = slice(k * _BIN, (k + 1) * _BIN)
        means.add(_bin(k, imu[part]), _bin(k, field[part]))
    return means.found


def _bin(index, values):
    mean = values.mean(axis=0)
    off = values - mean
    return Bin(index, len(values), mean, off.T @ off, values.min(axis=0), values.max(axis=0))


def test_what_is_fixed_in_the_tool_is_left_when_it_turns_and_its_sigma_holds():
    tilt, across = np.radians([1.2, -1.6]), np.array([4e-7, -9e-7])
    off_force, off_field = [], []
    for seed in range(12):
        found = string(4.0, np.random.default_rng(seed), tilt=tilt, arm=(0.006, -0.004), across=across)
        want = np.cross([0.0, *tilt], [GRAVITY[0], 0.0, 0.0])[1:]
        off_force += list((found.force[1:] - want) / found.sigma_force)
        off_field += list((found.field[1:] - across) / found.sigma_field)
        assert found.force[0] == pytest.approx(GRAVITY[0], abs=0.1)
        assert found.field[0] == pytest.approx(FIELD[0], abs=1e-7)
        assert found.sigma_force < math.radians(0.5) * abs(GRAVITY[0])
    assert_consistent(off_force, 1.0, name="mean force across the axis")
    # The floor of a bin's sigma is for roll that is not quite known, and here it is.
    assert np.mean(np.square(off_field)) < 1.0


def test_a_rate_that_never_changes_leaves_the_lever_arm_in_the_sigma():
    found = string(4.0, np.random.default_rng(1), arm=(0.006, 0.0), steady=True)
    assert found.sigma_force > 1.0
    assert abs(found.force[1]) < 3.0 * found.sigma_force


def test_a_string_that_stands_or_has_just_begun_to_turn_shows_nothing():
    assert string(0.3, np.random.default_rng(1)) is None
