"""Axis consistency: of 48 ways to exchange and reverse axes, those that a motion allows and no others."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mwd_estimation.health import axis_consistency as axes
from mwd_sensors.core.kalman import in_turned_axes

F = np.array([3.0, 2.0, -9.0])
B = np.array([2.0e-5, -1.0e-5, 4.0e-5])
IDENTITY = np.eye(3)


def steadily(*rate):
    return lambda _: rate


def window(rate, gyro=IDENTITY, accel=IDENTITY, mag=IDENTITY, seconds=3.0, hz=100, scale=1.0):
    """Sums of a window in which the tool turns at `rate`(t), rad/s, its sensors' axes mapped by three matrices."""
    sums = np.zeros(axes.SIZE)
    axes.begin(sums)
    f, b, dt, since = F.copy(), B.copy(), 1.0 / hz, 0
    for k in range(round(seconds * hz)):
        w = np.asarray(rate(k * dt), dtype=float)
        f, b = (np.array(in_turned_axes(*v, *(w * dt))) for v in (f, b))
        turned2 = axes.add_rate(sums, dt, *(scale * gyro @ w))
        axes.add_force(sums, *(accel @ f))
        axes.add_field(sums, *(mag @ b))
        since += 1
        if turned2 > axes.STEP_ANGLE2 or since >= hz // 10:
            axes.carry(sums)
            since = 0
    axes.carry(sums)
    return sums


def shares(sums):
    """Length of the mean carried force over its magnitude, for each way."""
    out = np.zeros(50)
    axes.lengths(axes.TABLE_WAYS, sums, False, out)
    return np.sqrt(out / axes.mean_square(sums, False))


def test_there_are_48_ways_and_every_mistake_of_one_sensor_is_one_of_them():
    assert len(np.unique(axes.TABLE_WAYS, axis=0)) == 48
    assert len(axes.MISTAKES) == 3 * 47
    for sensor in (axes.GYRO, axes.ACCEL, axes.MAG):
        rows = axes.MISTAKES[axes.MISTAKES[:, 0] == sensor]
        assert sorted(rows[:, 1]) == list(range(1, 48))
    # Gyros show themselves in gravity and field alike, the others in their own only.
    gyro = axes.MISTAKES[axes.MISTAKES[:, 0] == axes.GYRO]
    assert np.array_equal(gyro[:, 2], gyro[:, 3])
    assert np.all(axes.MISTAKES[axes.MISTAKES[:, 0] == axes.ACCEL][:, 3] == 0)


def test_right_axes_carry_gravity_unsmeared_and_a_still_tool_tells_nothing():
    assert shares(window(steadily(12.0, 1.0, -2.0)))[0] == pytest.approx(1.0, abs=0.02)
    assert shares(window(steadily(0.0, 0.0, 0.0)))[:48] == pytest.approx(1.0)


@pytest.mark.parametrize("mistake", range(0, 141, 4))
def test_a_full_motion_leaves_one_way_and_it_is_that_of_the_mistake(mistake):
    sensor, mapping, by_gravity, _ = axes.MISTAKES[mistake]
    mats = [IDENTITY] * 3
    mats[sensor] = axes.MAPPINGS[mapping]
    found = shares(window(lambda t: (4.0 * math.cos(t), 3.0 * math.sin(1.3 * t), 2.0 + math.sin(2.0 * t)), *mats))[:48]
    assert int(np.argmax(found)) == by_gravity
    assert found[by_gravity] > 0.97
    # The way's own overall sign is not seen, everything else is.
    assert np.sort(found)[-2] < 0.95


def test_turning_about_one_axis_only_leaves_what_keeps_that_axis():
    found = shares(window(steadily(12.0, 0.0, 0.0)))[:48]
    gyro = {int(m[1]): found[m[2]] for m in axes.MISTAKES if m[0] == axes.GYRO}
    for mapping, share in gyro.items():
        keeps_x = axes.MAPPINGS[mapping][0, 0] == 1
        assert (share > 0.97) == keeps_x


def test_rates_in_degrees_are_recognised_and_a_vector_fixed_in_the_tool_too():
    sums = window(steadily(2.0, 0.0, 1.0), scale=180.0 / math.pi)
    found = shares(sums)
    assert found[48] == pytest.approx(1.0, abs=0.03)
    assert found[:48].max() < 0.9
    still = window(steadily(0.0, 0.0, 0.0))
    assert shares(still)[49] == pytest.approx(1.0)
    assert axes.path(sums) == pytest.approx(3.0 * math.sqrt(5.0) * 180.0 / math.pi, rel=1e-6)
    assert axes.turned(sums, 0) == pytest.approx(6.0 * 180.0 / math.pi)


def parted(push):
    """Sums of a still window whose force is pushed by `push`(k), of six parts."""
    rng = np.random.default_rng(1)
    sums = np.zeros(axes.SIZE)
    axes.begin(sums)
    for k in range(300):
        axes.add_rate(sums, 0.01, 0.0, 0.0, 0.0)
        axes.add_force(sums, *(F + rng.standard_normal(3) + push(k)))
        axes.carry(sums)
        if k % 50 == 49:
            axes.mark(sums)
    return sums


def test_noise_is_what_the_parts_of_a_window_differ_by():
    sums = parted(lambda _: 0.0)
    assert 0.6 / math.sqrt(300.0) < axes.force_noise(axes.TABLE_WAYS, sums, 0) < 1.5 / math.sqrt(300.0)
    assert axes.mean_force(sums, 2) == pytest.approx(F[2], abs=0.3)
    # What pushes for a second is noise of the mean too.
    assert axes.force_noise(axes.TABLE_WAYS, parted(lambda k: 10.0 * (100 <= k < 200)), 0) > 1.5


def test_a_window_of_one_part_tells_no_noise():
    sums = np.zeros(axes.SIZE)
    axes.begin(sums)
    axes.add_force(sums, *F)
    axes.carry(sums)
    axes.mark(sums)
    assert axes.force_noise(axes.TABLE_WAYS, sums, 0) == math.inf


def test_products_give_the_dip():
    sums = window(steadily(12.0, 0.0, 0.0))
    dot = sum(axes.product(sums, k, k) for k in range(3))
    assert dot == pytest.approx(float(F @ B), rel=0.03)
