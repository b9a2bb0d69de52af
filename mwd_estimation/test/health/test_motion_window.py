# SPDX-License-Identifier: Apache-2.0
"""A window of motion: of 48 ways to exchange and reverse axes, those that it allows and no others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from window_steps import steps_of

from mwd_estimation.core.axis_mappings import ACCEL, GYRO, MAG, MAPPINGS, MISTAKES
from mwd_estimation.health import motion_window
from mwd_estimation.health.motion_window import Consistency, ExpectedField
from mwd_estimation.health.window_checks import Window
from mwd_sensors.core.kalman import in_turned_axes

F = np.array([-3.0, 2.0, -9.0])
B = np.array([2.0e-5, -1.0e-5, 4.0e-5])
DIP = -math.asin(float(F @ B) / np.linalg.norm(F) / np.linalg.norm(B))
EXPECTED = ExpectedField(float(np.linalg.norm(F)), float(np.linalg.norm(B)), DIP)
IDENTITY = np.eye(3)
HZ, SECONDS = 100, 3.0


def steadily(*rate):
    return lambda _: rate


def filled(rate, gyro=IDENTITY, accel=IDENTITY, mag=IDENTITY, push=None):
    """Steps of a tool that turns at `rate`(t), rad/s, its sensors mapped by three matrices."""
    n = round(SECONDS * HZ)
    rates, forces, fields = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    f, b = F.copy(), B.copy()
    for k in range(n):
        w = np.asarray(rate(k / HZ), dtype=float)
        if k:
            f, b = (np.array(in_turned_axes(*v, *(w / HZ))) for v in (f, b))
        rates[k], forces[k], fields[k] = gyro @ w, accel @ f + (0.0 if push is None else push(k)), mag @ b
    steps, stream = steps_of(rates, forces, fields, HZ)
    assert stream.mag_first == n
    return steps


def window(*args, **kwargs):
    return Window(filled(*args, **kwargs), 0, SECONDS)


def shares(found):
    """Length of the mean carried force over its magnitude, for each way."""
    return np.sqrt(found.force / found.force2)


def test_every_mistake_of_one_sensor_is_one_of_48_ways():
    assert len(MISTAKES) == 3 * 47
    for sensor in (GYRO, ACCEL, MAG):
        assert sorted(MISTAKES[MISTAKES[:, 0] == sensor][:, 1]) == list(range(1, 48))
    # Gyros show themselves in gravity and field alike, the others in their own only.
    gyro = MISTAKES[MISTAKES[:, 0] == GYRO]
    assert np.array_equal(gyro[:, 2], gyro[:, 3])
    assert np.all(MISTAKES[MISTAKES[:, 0] == ACCEL][:, 3] == 0)


def test_right_axes_carry_gravity_unsmeared_and_a_still_tool_tells_nothing():
    assert shares(window(steadily(12.0, 1.0, -2.0)))[0] == pytest.approx(1.0, abs=0.02)
    assert shares(window(steadily(0.0, 0.0, 0.0))) == pytest.approx(1.0)


@pytest.mark.fault_case(10)
@pytest.mark.parametrize("mistake", range(0, 141, 4))
def test_a_full_motion_leaves_one_way_and_it_is_that_of_the_mistake(mistake):
    sensor, mapping, by_gravity, _ = MISTAKES[mistake]
    mats = [IDENTITY] * 3
    mats[sensor] = MAPPINGS[mapping]
    found = shares(window(lambda t: (4.0 * math.cos(t), 3.0 * math.sin(1.3 * t), 2.0 + math.sin(2.0 * t)), *mats))
    assert int(np.argmax(found)) == by_gravity
    assert found[by_gravity] > 0.97
    # The way's own overall sign is not seen, everything else is.
    assert np.sort(found)[-2] < 0.95


def test_turning_about_one_axis_only_leaves_what_keeps_that_axis():
    found = shares(window(steadily(12.0, 0.0, 0.0)))
    for _, mapping, way, _ in MISTAKES[MISTAKES[:, 0] == GYRO]:
        assert (found[way] > 0.97) == (MAPPINGS[mapping][0, 0] == 1)


def test_rates_in_degrees_are_recognised_and_a_vector_fixed_in_the_tool_too():
    found = window(steadily(2.0, 0.0, 1.0), gyro=np.degrees(IDENTITY))
    assert math.sqrt(found.force_deg / found.force2) == pytest.approx(1.0, abs=0.03)
    assert shares(found).max() < 0.9
    assert found.path == pytest.approx(math.degrees((SECONDS - 1 / HZ) * math.sqrt(5.0)), rel=1e-6)
    assert found.turn[0] == pytest.approx(math.degrees((SECONDS - 1 / HZ) * 2.0))
    still = window(steadily(0.0, 0.0, 0.0))
    assert still.force_fixed == pytest.approx(still.force2)


def test_noise_is_what_the_half_seconds_of_a_window_differ_by():
    rng = np.random.default_rng(1)
    found = window(steadily(0.0, 0.0, 0.0), push=lambda _: rng.standard_normal(3))
    assert 0.6 / math.sqrt(300.0) < found.noise(0) < 1.5 / math.sqrt(300.0)
    # What pushes for a second is noise of the mean too, and an alias where it does so in the tool's axes.
    pushed = window(steadily(0.0, 0.0, 0.0), push=lambda k: 10.0 * (100 <= k < 200))
    assert pushed.noise(0) > 1.5
    assert pushed.push == pytest.approx(12.0)


def test_products_give_the_dip_whatever_the_axes():
    found = window(steadily(12.0, 0.0, 0.0))
    assert np.trace(found.product) == pytest.approx(float(F @ B), rel=0.03)


def test_a_healthy_window_is_consistent_and_each_mistake_that_shows_is_not():
    def motion(t):
        return 8.0, 0.5 * math.sin(3.0 * t), 0.5 * math.cos(3.0 * t)

    def healthy(*mats, expected=EXPECTED, motion=motion, push=None):
        carried = motion_window.carry(filled(motion, *mats, push=push))
        return motion_window.consistent(Consistency(), expected, carried, SECONDS)

    assert healthy()
    assert healthy(motion=steadily(0.0, 0.0, 0.0))
    flipped = np.diag([1.0, -1.0, 1.0])
    for mats in ((flipped @ np.diag([-1.0, 1, 1]), IDENTITY), (IDENTITY, flipped), (IDENTITY, IDENTITY, flipped)):
        assert not healthy(*mats)
    for mats in ((np.degrees(IDENTITY),), (IDENTITY, IDENTITY / 9.8), (IDENTITY, IDENTITY, 1e6 * IDENTITY)):
        assert not healthy(*mats)
    # Reversed altogether, the dip shows it; without a dip nothing does.
    assert not healthy(IDENTITY, IDENTITY, -IDENTITY)
    assert healthy(IDENTITY, IDENTITY, -IDENTITY, expected=EXPECTED._replace(dip=math.nan, total=math.nan))
    rng = np.random.default_rng(2)
    assert healthy(push=lambda _: 10.0 * rng.standard_normal(3))
