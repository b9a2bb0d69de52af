"""y and z of the gyros, held against the field along the axis of the tool."""

import math

import numpy as np
import pytest

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import cross_axes
from mwd_sensors.core.frames import mat_nt

FIELD_N = 50e-6 * np.array([math.cos(1.1), 0.0, math.sin(1.1)])
RATE, SECONDS = 100, 3.0
WRONG = {
    "y reversed": np.diag([1, -1, 1]), "z reversed": np.diag([1, 1, -1]), "y and z exchanged": np.eye(3)[[0, 2, 1]],
}  # fmt: skip
MOTIONS = {"building while it rotates": (10.0, 0.0), "rocking while it slides": (0.1, 4.0)}


def window(gyro=None, motion="building while it rotates", across=1.0, late=0, bias=0.0, leak=0.0, every=1):
    """Sums of a window; `late` samples late the field comes, `across` times the motion across the axis is done."""
    sums, cross = np.zeros(axes.SIZE), np.zeros(cross_axes.SIZE)
    axes.begin(sums)
    cross_axes.begin(cross)
    rotation, rocks = MOTIONS[motion]
    n = round(SECONDS * RATE)
    t = np.arange(-late - 1, n) / RATE
    inclination = 0.7 + across * (math.radians(2.0) * np.sin(rocks * t) if rocks else math.radians(0.3) * t)
    azimuth = 0.7 + across * math.radians(1.5) * np.cos(0.7 * rocks * t)
    mats = mat_nt(inclination, azimuth, rotation * t + 0.3)
    rng = np.random.default_rng(7)
    since = 0
    for k in range(n):
        now = k + late + 1
        step = mats[now - 1].T @ mats[now]
        rate = 0.5 * RATE * np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]])
        rate = (gyro if gyro is not None else np.eye(3)) @ rate + bias
        field = mats[now - late].T @ FIELD_N
        field = field + leak * field[1] * np.array([1.0, 0.0, 0.0]) + 5e-8 * rng.standard_normal(3)
        turned2 = axes.add_rate(sums, 1.0 / RATE, *rate)
        since += 1
        if k % every == 0:
            axes.add_field(sums, *field)
        if turned2 > axes.STEP_ANGLE2 or since == 10:
            cross_axes.add(cross, sums, since / RATE)
            axes.carry(sums)
            since = 0
    return cross


def judged(cross, rotates=True):
    found = np.zeros(1, dtype=np.int64)
    return cross_axes.judge(cross, rotates, found), int(found[0])


def bit(matrix):
    return 1 << next(k for k, m in enumerate(axes.MAPPINGS) if np.array_equal(m, matrix))


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_cross_axis_is_among_what_explains_the_field_and_right_ones_are_not_accused(name, motion):
    seen, found = judged(window(WRONG[name], motion), motion.endswith("rotates"))
    assert seen == 1
    assert found & bit(WRONG[name])
    assert judged(window(None, motion), motion.endswith("rotates"))[0] == 0


def test_what_does_not_turn_across_its_axis_says_nothing():
    for gyro in (None, *WRONG.values()):
        assert judged(window(gyro, across=0.0)) == (-1, 0)


def test_biases_and_what_leaks_between_the_axes_of_the_field_are_no_mistake():
    assert judged(window(bias=0.005))[0] == 0
    assert judged(window(leak=0.01))[0] == 0
    assert judged(window(WRONG["y reversed"], bias=0.005, leak=0.01)) == (1, bit(WRONG["y reversed"]))


@pytest.mark.parametrize("late", [2, 10, 30])
def test_a_magnetometer_that_comes_late_is_no_mistake_of_the_gyro(late):
    assert judged(window(late=late))[0] != 1
    assert judged(window(motion="rocking while it slides", late=late), False)[0] != 1


def test_other_units_of_the_field_make_no_difference():
    sums = window(WRONG["z reversed"])
    before = judged(sums)
    assert before[0] == 1
    first = cross_axes.SIZE - 121
    scale = np.outer(*[np.r_[1.0, np.full(10, 1e6)]] * 2)
    sums[first:] = (sums[first:].reshape(11, 11) * scale).ravel()
    assert judged(sums) == before


def test_a_field_that_comes_too_seldom_while_the_tool_rotates_is_not_judged():
    assert judged(window(WRONG["y reversed"], every=20)) == (-1, 0)
    slow = window(WRONG["y reversed"], "rocking while it slides", every=10)
    assert judged(slow, False)[0] == 1
