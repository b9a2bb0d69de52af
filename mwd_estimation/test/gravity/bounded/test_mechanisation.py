# SPDX-License-Identifier: Apache-2.0
"""Mechanics of the bounded filter: transition and measurement against finite differences; a velocity that was lost."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mwd_estimation.gravity.bounded import measurement, mechanisation
from mwd_estimation.gravity.bounded.filter import BoundedParams, initial
from mwd_estimation.gravity.bounded.state import ASKEW, BIAS, DOWN, LEVER, POS, SCALE, STEADY, TILT, VEL
from mwd_sensors.core.constants import STANDARD_GRAVITY

KERNEL = BoundedParams()
NEVER = 1e30


def nominal(seed):
    """A state drawn around a working point."""
    rng = np.random.default_rng(seed)
    state = initial(BoundedParams())
    s = state.record[0]
    q = rng.standard_normal(4)
    s.q[:] = q / np.linalg.norm(q)
    mechanisation.set_matrix(s)
    s.vel[:], s.pos[:] = 0.3 * rng.standard_normal((2, 3))
    s.bias[:], s.lever[:] = 0.01 * rng.standard_normal(3), 0.1 * rng.standard_normal(2)
    s.scale, s.down = 0.01, 0.02
    s.askew[:] = 0.01 * rng.standard_normal(2)
    return state


def perturbed(state, error):
    out = state.copy()
    out.record[0].correction[:STEADY] = error
    measurement.correct(out.record[0], STEADY)
    return out


def difference(a, b):
    """Error that brings b to a, with the filter's own conventions."""
    turn = a.C @ b.C.T
    tilt = [0.5 * (turn[2, 1] - turn[1, 2]), 0.5 * (turn[0, 2] - turn[2, 0])]
    sensors = [a.bias - b.bias, [a.scale - b.scale], a.askew - b.askew, a.lever - b.lever, [a.down - b.down]]
    return np.concatenate([tilt, a.vel - b.vel, a.pos - b.pos, *sensors])


def carried(state, gyro, accel, dt):
    out = state.copy()
    for w, f in zip(gyro, accel, strict=True):
        mechanisation.mechanise(KERNEL, out.record[0], dt, w, f)
    mechanisation.move(out.record[0])
    return out


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_transition_of_the_errors_matches_finite_differences_of_the_mechanisation(seed):
    rng = np.random.default_rng(seed)
    state, dt, n = nominal(seed), 0.005, 8
    gyro = np.array([8.0, 0.3, -0.2]) + 0.2 * rng.standard_normal((n, 3))
    # Only gravity acts through the tilt in the filter's transition.
    accel, at = np.zeros((n, 3)), state.copy()
    for k in range(n):
        mechanisation.mechanise(KERNEL, at.record[0], dt, gyro[k], np.zeros(3))
        accel[k] = -STANDARD_GRAVITY * at.record[0].C[2]
    base = carried(state, gyro, accel, dt)
    step = 1e-6
    for j in range(STEADY):
        e = np.zeros(STEADY)
        e[j] = step
        plus, minus = (carried(perturbed(state, sign * e), gyro, accel, dt).record[0] for sign in (1.0, -1.0))
        column = (difference(plus, base.record[0]) - difference(minus, base.record[0])) / (2 * step)
        P = base.record[0].P
        P[:] = 0.0
        P[j, j] = 1.0
        mechanisation.propagate(base.record[0], STEADY)
        P = P[:STEADY, :STEADY]
        # F e e' F' of a unit error is the outer product of the column of F; second order in the interval is left out.
        assert np.abs(P[:, j] - column * column[j]).max() < 0.03 * max(1.0, np.abs(column).max()), j


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_measurement_takes_back_an_error_of_position_and_lever_arm(axis):
    state = nominal(7 + axis)
    s = state.record[0]
    s.pos[:] = s.C[:, 1:] @ s.lever
    s.P[:] = 0.0
    for j in range(3):
        s.P[POS + j, POS + j] = 1.0
    s.pos[:] += 0.01 * s.C[:, axis]
    s.correction[:] = 0.0
    measurement.update(s, STEADY, 1e-9, NEVER)
    assert s.correction[POS : POS + 3] == pytest.approx(-0.01 * s.C[:, axis], abs=1e-9)
    assert s.correction[[TILT, VEL, BIAS, SCALE, ASKEW, LEVER, DOWN]] == pytest.approx(0.0, abs=1e-15)
    assert pytest.approx(np.eye(3), abs=1e-12) == s.C.T @ s.C


def test_an_innovation_beyond_the_gate_makes_velocity_uncertain_and_leaves_the_tilt_alone():
    tilts, speeds = {}, {}
    for gate in (4.0, NEVER):
        s = initial(BoundedParams()).record[0]
        for first, size, variance in ((TILT, 2, 1e-5), (VEL, 3, 1e-4), (POS, 3, 1e-4)):
            for j in range(size):
                s.P[first + j, first + j] = variance
        s.sums.time = 0.2
        mechanisation.propagate(s, STEADY)
        s.pos[0] = 0.2
        s.correction[:] = 0.0
        measurement.update(s, STEADY, 1e-5, gate)
        tilts[gate], speeds[gate] = abs(s.correction[TILT + 1]), s.P[VEL, VEL]
    assert tilts[4.0] < 0.1 * tilts[NEVER]
    assert speeds[4.0] > speeds[NEVER]


def test_the_rotation_is_exact():
    s = initial(BoundedParams()).record[0]
    rng = np.random.default_rng(4)
    expected = np.eye(3)
    for turn in np.repeat([0.05, 0.4, 2.0], 5)[:, None] * rng.standard_normal((15, 3)):
        mechanisation.rotate(s, *turn)
        expected = expected @ Rotation.from_rotvec(turn).as_matrix()
    assert pytest.approx(expected, abs=1e-12) == s.C
