"""What three seconds of motion show of units, axes and signs."""

import math

import numpy as np
import pytest

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import cross_axes
from mwd_estimation.health import fault_debounce as ev
from mwd_estimation.health import motion_checks as motion
from mwd_sensors.core.frames import mat_nt

REFERENCE = np.array([9.81, 50e-6, math.radians(65.0)])
FIELD_N = 50e-6 * np.array([math.cos(math.radians(65.0)), 0.0, math.sin(math.radians(65.0))])
SECONDS, RATE = 3.0, 100


def noted(
    gyro=None, accel=None, mag=None, reference=REFERENCE, spoilt=(0, 0, 0, 0, 0, 0), turning=True, shake=0.05,
    push=None, known=False,
):  # fmt: skip
    """
    Notes of a window of a tool that turns about its axis and wobbles, each sensor mapped by a matrix.

    shake : white noise of the force, m/s^2; push : a force added to it, by the time; known : its axes are known.
    """
    sums, lengths = np.zeros(axes.SIZE), np.zeros((2, 50))
    checks, notes, _, _ = ev.blank()
    checks[ev.AXES, ev.STATE] = ev.OK if known else ev.UNKNOWN
    cross = np.zeros(cross_axes.SIZE)
    cross_axes.begin(cross)
    axes.begin(sums)
    n = round(SECONDS * RATE)
    toolface = 8.0 * np.arange(n) / RATE if turning else np.zeros(n)
    inclination = math.radians(40.0) + (math.radians(8.0) * np.sin(6.0 * np.arange(n) / RATE) if turning else 0.0)
    mats = mat_nt(inclination, np.full(n, 0.7), toolface)
    rng = np.random.default_rng(4)
    for k in range(n):
        step = mats[k].T @ mats[min(k + 1, n - 1)]
        rate = 0.5 * RATE * np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]])
        force = mats[k].T @ np.array([0.0, 0.0, -9.81]) + shake * rng.standard_normal(3)
        force = force + (push(k / RATE) if push is not None else 0.0)
        field = mats[k].T @ FIELD_N + 5e-8 * rng.standard_normal(3)
        rate, force, field = (
            np.asarray(one) @ value if one is not None else value
            for one, value in ((gyro, rate), (accel, force), (mag, field))
        )
        axes.add_force(sums, *force)
        axes.add_field(sums, *field)
        axes.add_rate(sums, 1.0 / RATE, *rate)
        cross_axes.add(cross, sums, 1.0 / RATE)
        axes.carry(sums)
        if k % 50 == 49:
            axes.mark(sums)
    motion.judge(np.asarray(reference), sums, cross, lengths, np.array(spoilt), checks, notes, 7_000_000_000, SECONDS)
    return notes


def faults(notes):
    return set(np.flatnonzero(notes[:, ev.SEEN] >= ev.FOR))


def mapping(k):
    return next(n for n, m in enumerate(axes.MAPPINGS) if np.array_equal(m, k))


def test_a_sound_tool_in_motion_speaks_against_every_fault():
    notes = noted()
    assert faults(notes) == set()
    against = set(np.flatnonzero(notes[:, ev.SEEN] == ev.AGAINST))
    assert against >= {ev.UNIT, ev.AXES, ev.SIGN, ev.FRAME, ev.MISMATCH}
    assert notes[ev.UNIT + 1, ev.SEEN] == notes[ev.UNIT + 2, ev.SEEN] == ev.AGAINST


def test_at_rest_the_axes_are_not_to_be_seen():
    notes = noted(turning=False, reference=[9.81, math.nan, math.nan])
    assert faults(notes) == set()
    assert notes[ev.AXES, ev.SEEN] == notes[ev.UNIT, ev.SEEN] == ev.NOTHING


@pytest.mark.parametrize(
    ("sensor", "factor", "detail"),
    [
        ("gyro", math.degrees(1.0), 1), ("accel", 1 / 9.80665, 1), ("accel", 101.97, 2), ("mag", 1e3, 1),
        ("mag", 1e4, 2), ("mag", 1e6, 3), ("mag", 1e7, 4), ("mag", 1e9, 5),
    ],
)  # fmt: skip
def test_another_unit_is_named_by_the_length(sensor, factor, detail):
    notes = noted(**{sensor: factor * np.eye(3)})
    k = ev.UNIT + ("gyro", "accel", "mag").index(sensor)
    assert faults(notes) == {k}
    assert notes[k, 2] == detail
    assert notes[k, ev.BEGAN] == 4_000_000_000


@pytest.mark.parametrize(
    ("sensor", "matrix"),
    [("gyro", np.diag([-1, 1, 1])), ("gyro", np.eye(3)[[1, 0, 2]])]
    + [(sensor, m) for sensor in ("accel", "mag") for m in (np.diag([1, -1, 1]), np.eye(3)[[1, 0, 2]])],
)
def test_wrong_axes_of_one_sensor_are_among_what_is_noted(sensor, matrix):
    notes = noted(**{sensor: matrix})
    assert faults(notes) == {ev.AXES}
    s = ("gyro", "accel", "mag").index(sensor)
    assert int(notes[ev.AXES, 2 + s]) >> mapping(matrix) & 1


def test_a_reversed_magnetometer_shows_in_the_dip_only():
    assert faults(noted(mag=-np.eye(3))) == {ev.SIGN}
    assert faults(noted(mag=-np.eye(3), reference=[9.81, math.nan, math.nan])) == set()
    assert noted(accel=-np.eye(3), reference=[9.81, math.nan, math.nan])[ev.SIGN, 2] == ev.ACCEL


def test_spoilt_windows_judge_no_axes():
    assert ev.AXES in faults(noted(accel=np.diag([1, -1, 1])))
    assert ev.AXES not in faults(noted(accel=np.diag([1, -1, 1]), spoilt=(1, 0, 0, 0, 0, 0)))


@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize(("shake", "mean"), [(20.0, 0.0), (5.0, 0.0), (2.0, 20.0)])
def test_a_force_that_gravity_cannot_be_in_is_noted_strongly(turning, shake, mean):
    notes = noisy(turning, shake, lambda _: np.full(3, mean))
    assert notes[ev.LENGTH, ev.SEEN] == ev.STRONGLY
    assert faults(notes) == {ev.LENGTH}


def noisy(turning, shake, push, spoilt=(0, 0, 0, 0, 0, 0)):
    """Notes of an accelerometer that reads noise and `push` instead of the tool's forces."""
    gravity = mat_nt(math.radians(40.0), 0.7, 0.0).T @ np.array([0.0, 0.0, 9.81])
    if turning:
        return noted(shake=0.0, known=True, spoilt=spoilt, push=_Instead(shake, push))
    return noted(turning=False, shake=shake, known=True, spoilt=spoilt, push=lambda t: gravity + push(t))


class _Instead:
    """A force that takes gravity out of the tool's own axes as `noted` turns it, and puts something else there."""

    def __init__(self, shake, push):
        self.shake, self.push, self.rng = shake, push, np.random.default_rng(8)

    def __call__(self, t):
        inclination = math.radians(40.0) + math.radians(8.0) * math.sin(6.0 * t)
        gravity = mat_nt(inclination, 0.7, 8.0 * t).T @ np.array([0.0, 0.0, 9.81])
        return gravity + self.shake * self.rng.standard_normal(3) + self.push(t)


def test_a_pushed_window_is_weaker_evidence_and_never_that_gravity_is_missing_in_noise():
    notes = noisy(False, 2.0, lambda _: np.full(3, 12.0), (0, 0, 0, 2, 0, 0))
    assert notes[ev.LENGTH, ev.SEEN] == ev.FOR
    assert noisy(False, 20.0, lambda _: np.zeros(3), (0, 0, 0, 2, 0, 0))[ev.LENGTH, ev.SEEN] != ev.STRONGLY


def test_gravity_under_white_noise_or_an_alias_is_neither_missing_nor_of_another_dip_or_axis():
    for shake in (10.0, 30.0):
        assert faults(noted(shake=shake, known=True)) == set()
        assert faults(noted(shake=shake, known=True, turning=False)) == set()

    def alias(t):
        return np.array([0.0, 0.0, 50.0 * math.cos(0.84 * math.pi * (t - 1.0) ** 2)])

    for turning in (True, False):
        assert not faults(noted(push=alias, known=True, turning=turning, spoilt=(0, 0, 0, 2, 0, 0))) - {ev.LENGTH}


def test_the_cross_axes_of_the_gyro_are_judged_once_the_others_are_known():
    assert noted(known=True)[ev.CROSS, ev.SEEN] == ev.AGAINST
    assert noted()[ev.CROSS, ev.SEEN] == ev.NOTHING
    # Missing samples leave turns unknown.
    assert noted(known=True, spoilt=(0, 0, 0, 0, 1, 0))[ev.CROSS, ev.SEEN] == ev.NOTHING


def test_a_window_whose_every_half_second_is_noise_is_noted_as_such():
    notes = noted(shake=90.0, spoilt=(0, 0, 0, 6, 0, 6))
    assert notes[ev.LENGTH, ev.SEEN] == ev.STRONGLY
    assert notes[ev.LENGTH, 4] == 1
    assert notes[ev.LENGTH, 2] == pytest.approx(9000.0, rel=0.05)
    assert noted(shake=90.0, spoilt=(0, 0, 0, 6, 0, 5))[ev.LENGTH, ev.SEEN] < ev.FOR
