# SPDX-License-Identifier: Apache-2.0
"""What three seconds of motion show of units, axes and signs."""

import math

import numpy as np
import pytest
from window_steps import steps_of

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.sensor_fault import ACCEL, FaultCode
from mwd_estimation.health import fault_debounce as debounce
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING, OK, STRONGLY, UNKNOWN
from mwd_estimation.health.motion_window import ExpectedField
from mwd_estimation.health.window_checks import CLIPPED, Window, WindowJudge, WindowLimits
from mwd_sensors.core.frames import mat_nt

EXPECTED = ExpectedField(9.81, 50e-6, math.radians(65.0))
NO_FIELD = ExpectedField(9.81, math.nan, math.nan)
FIELD_N = 50e-6 * np.array([math.cos(math.radians(65.0)), 0.0, math.sin(math.radians(65.0))])
SECONDS, RATE = 3.0, 100
SENSORS = ("gyro", "accel", "mag")


def observed(expected=EXPECTED, spoilt=(0, 0, 0), turning=True, shake=0.05, push=None, known=False, **matrices):
    """
    Checks after a window of a tool that turns about its axis and wobbles, sensors mapped by `matrices`.

    shake : white noise of the force, m/s^2; push : a force added to it, by the time; known : its axes are known.
    """
    n = round(SECONDS * RATE)
    toolface = 8.0 * np.arange(n) / RATE if turning else np.zeros(n)
    inclination = math.radians(40.0) + (math.radians(8.0) * np.sin(6.0 * np.arange(n) / RATE) if turning else 0.0)
    mats = mat_nt(inclination, np.full(n, 0.7), toolface)
    rng = np.random.default_rng(4)
    rates, forces, fields = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        step = mats[max(k - 1, 0)].T @ mats[k]
        rates[k] = 0.5 * RATE * np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]])
        forces[k] = mats[k].T @ np.array([0.0, 0.0, -9.81]) + shake * rng.standard_normal(3)
        forces[k] += push(k / RATE) if push is not None else 0.0
        fields[k] = mats[k].T @ FIELD_N + 5e-8 * rng.standard_normal(3)
    rates, forces, fields = (
        np.ascontiguousarray(v @ np.asarray(matrices.get(sensor, np.eye(3))).T)
        for sensor, v in zip(SENSORS, (rates, forces, fields), strict=True)
    )
    steps, _ = steps_of(rates, forces, fields, RATE)
    checks = debounce.blank()
    checks[FaultCode.AXES, 0].state = OK if known else UNKNOWN
    window = Window(steps, 4_000_000_000, SECONDS)
    WindowJudge(WindowLimits(), expected, window, np.array(spoilt), checks).judge()
    return checks


def seen(checks, least=FOR):
    return {(FaultCode(code), int(place)) for code, place in np.argwhere(checks["seen"] >= least)}


def mapping(matrix):
    return next(n for n, m in enumerate(MAPPINGS) if np.array_equal(m, matrix))


def test_a_sound_tool_in_motion_speaks_against_every_fault():
    checks = observed()
    assert seen(checks) == set()
    units = {(FaultCode.UNIT, place) for place in (0, 3, 6)}
    assert seen(checks, AGAINST) >= units | {(FaultCode.AXES, 0), (FaultCode.SIGN, 3), (FaultCode.FRAME, 3)}


def test_at_rest_the_axes_are_not_to_be_seen():
    checks = observed(turning=False, expected=NO_FIELD)
    assert seen(checks) == set()
    assert checks[FaultCode.AXES, 0].seen == checks[FaultCode.UNIT, 0].seen == NOTHING


@pytest.mark.parametrize(
    ("sensor", "factor", "number"),
    [("gyro", math.degrees(1.0), 1), ("accel", 1 / 9.80665, 1)],
)
def test_another_unit_is_named_by_the_length(sensor, factor, number):
    checks = observed(**{sensor: factor * np.eye(3)})
    place = 3 * SENSORS.index(sensor)
    assert seen(checks) == {(FaultCode.UNIT, place)}
    assert checks[FaultCode.UNIT, place].seen_which[0] == number
    assert checks[FaultCode.UNIT, place].seen_ns == 4_000_000_000


@pytest.mark.parametrize(
    ("sensor", "matrix"),
    [("gyro", np.diag([-1, 1, 1])), ("gyro", np.eye(3)[[1, 0, 2]])]
    + [(sensor, m) for sensor in ("accel", "mag") for m in (np.diag([1, -1, 1]), np.eye(3)[[1, 0, 2]])],
)
def test_wrong_axes_of_one_sensor_are_among_what_is_seen(sensor, matrix):
    checks = observed(**{sensor: matrix})
    assert seen(checks) == {(FaultCode.AXES, 0)}
    assert int(checks[FaultCode.AXES, 0].seen_which[SENSORS.index(sensor)]) >> mapping(matrix) & 1


def test_a_reversed_magnetometer_shows_in_the_dip_only():
    assert seen(observed(mag=-np.eye(3))) == {(FaultCode.SIGN, 3)}
    assert seen(observed(mag=-np.eye(3), expected=NO_FIELD)) == set()
    upwards = observed(accel=-np.eye(3), expected=NO_FIELD)
    assert seen(upwards) == {(FaultCode.POINTS_UP, 3)}
    assert debounce.suspected(upwards) == ACCEL


def test_windows_with_clipped_samples_judge_no_axes():
    assert (FaultCode.AXES, 0) in seen(observed(accel=np.diag([1, -1, 1])))
    assert (FaultCode.AXES, 0) not in seen(observed(accel=np.diag([1, -1, 1]), spoilt=(CLIPPED, 0, 0)))


def without_gravity(turning, shake, push):
    """Checks of an accelerometer that reads noise and `push` instead of the tool's forces."""

    def instead(t):
        wobble = math.radians(8.0) * math.sin(6.0 * t) if turning else 0.0
        mat = mat_nt(math.radians(40.0) + wobble, 0.7, 8.0 * t if turning else 0.0)
        return mat.T @ np.array([0.0, 0.0, 9.81]) + push

    return observed(turning=turning, shake=shake, known=True, push=instead)


@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize("shake", [20.0, 5.0])
def test_a_force_that_gravity_cannot_be_in_is_seen_strongly(turning, shake):
    checks = without_gravity(turning, shake, np.zeros(3))
    assert checks[FaultCode.GRAVITY, 3].seen == STRONGLY
    assert seen(checks) == {(FaultCode.GRAVITY, 3)}


def test_a_push_along_an_axis_is_weaker_evidence_as_it_may_be_an_alias():
    assert without_gravity(False, 2.0, np.full(3, 20.0))[FaultCode.GRAVITY, 3].seen == FOR


def test_gravity_under_white_noise_or_an_alias_is_neither_missing_nor_of_another_dip_or_axis():
    for shake in (10.0, 30.0):
        for turning in (True, False):
            assert seen(observed(shake=shake, known=True, turning=turning)) == set()

    def alias(t):
        return np.array([0.0, 0.0, 50.0 * math.cos(0.84 * math.pi * (t - 1.0) ** 2)])

    for turning in (True, False):
        checks = observed(push=alias, known=True, turning=turning)
        assert not seen(checks) - {(FaultCode.GRAVITY, 3)}
        assert checks[FaultCode.GRAVITY, 3].seen < STRONGLY
