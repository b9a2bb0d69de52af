"""Mechanics of the bounded filter: transition and measurement against finite differences; a velocity that was lost."""

import numpy as np
import pytest

from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_sensors.core import frames
from mwd_sensors.core.constants import STANDARD_GRAVITY

G0 = STANDARD_GRAVITY


def nominal(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """Nominal values drawn around a working point."""
    x = np.zeros(model.NOMINAL)
    q = rng.standard_normal(4)
    x[:4] = q / np.linalg.norm(q)
    x[model.N_VEL : model.N_VEL + 6] = size * 0.3 * rng.standard_normal(6)
    x[model.N_BIAS : model.N_BIAS + 3] = 0.01 * rng.standard_normal(3)
    x[model.N_SCALE] = 0.01
    x[model.N_LEVER : model.N_LEVER + 3] = 0.1 * rng.standard_normal(3)
    x[model.N_DOWN] = 0.02
    x[model.N_MISSING], x[model.N_SLOPE] = 1.5, -20.0
    return x


def perturbed(x: np.ndarray, error: np.ndarray) -> np.ndarray:
    out = x.copy()
    model.correct(out, error, model.ERRORS, 0.0)
    return out


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Error that brings b to a, with the filter's own conventions."""
    e = np.zeros(model.ERRORS)
    turn = frames.mat_from_quat(a[:4]) @ frames.mat_from_quat(b[:4]).T
    e[0], e[1] = 0.5 * (turn[2, 1] - turn[1, 2]), 0.5 * (turn[0, 2] - turn[2, 0])
    e[2:] = a[4:] - b[4:]
    return e


def carried(x: np.ndarray, gyro: np.ndarray, accel: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Nominal values and sums after the samples; the missing rate follows its slope as while clipping."""
    x, sums, mat = x.copy(), np.zeros(model.SUMS), np.zeros((3, 3))
    for w, f in zip(gyro, accel, strict=True):
        # Mean over the sample, so that the discrete sum has the exact transition.
        x[model.N_MISSING] += 0.5 * x[model.N_SLOPE] * dt
        model.mechanise(x, sums, mat, G0, dt, *w, 0.0, 0.0, 0.0, *f)
        x[model.N_MISSING] += 0.5 * x[model.N_SLOPE] * dt
    return x, sums


@pytest.mark.parametrize("seed", range(5))
def test_transition_of_the_errors_matches_finite_differences_of_the_mechanisation(seed):
    rng = np.random.default_rng(seed)
    x, dt, n = nominal(rng), 0.005, 8
    gyro = np.array([8.0, 0.3, -0.2]) + 0.2 * rng.standard_normal((n, 3))
    accel = -G0 * frames.mat_from_quat(x[:4])[2] + rng.standard_normal((n, 3))
    base, sums = carried(x, gyro, accel, dt)
    step = 1e-6
    for j in range(model.ERRORS):
        e = np.zeros(model.ERRORS)
        e[j] = step
        plus, _ = carried(perturbed(x, e), gyro, accel, dt)
        e[j] = -step
        minus, _ = carried(perturbed(x, e), gyro, accel, dt)
        column = (difference(plus, base) - difference(minus, base)) / (2 * step)
        # F e e' F' of a unit error is the outer product of the column of F.
        P = np.zeros((model.ERRORS, model.ERRORS))
        P[j, j] = 1.0
        model.propagate(P, sums, model.ERRORS)
        # Second order in the 40 ms of the interval is left out: compare to that order.
        assert np.abs(P[:, j] - column * column[j]).max() < 0.02 * max(1.0, np.abs(column).max()), j
        assert np.abs(np.diag(P) - column**2).max() < 0.03 * max(1.0, (column**2).max()), j


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_measurement_row_matches_finite_differences(axis):
    rng = np.random.default_rng(7 + axis)
    x, mat, row = nominal(rng), np.zeros((3, 3)), np.zeros(5)
    # Where the position is that of the lever arm; what it is beside that is noise and must not count.
    model.rotation(x, mat)
    x[model.N_POS : model.N_POS + 3] = mat @ x[model.N_LEVER : model.N_LEVER + 3]

    def innovation(at: np.ndarray) -> float:
        model.rotation(at, mat)
        return model.measurement(at, mat, axis, np.zeros(5))

    model.rotation(x, mat)
    model.measurement(x, mat, axis, row)
    full = np.zeros(model.ERRORS)
    full[:2], full[model.POS : model.POS + 3], full[model.LEVER + axis] = row[:2], row[2:], -1.0
    step = 1e-6
    for j in range(model.ERRORS):
        e = np.zeros(model.ERRORS)
        e[j] = step
        slope = (innovation(perturbed(x, e)) - innovation(perturbed(x, -e))) / (2 * step)
        assert -slope == pytest.approx(full[j], abs=1e-8), j


def prior() -> np.ndarray:
    P = np.zeros((model.ERRORS, model.ERRORS))
    P[:2, :2] = 1e-5 * np.eye(2)
    P[model.VEL : model.VEL + 3, model.VEL : model.VEL + 3] = 1e-4 * np.eye(3)
    P[model.POS : model.POS + 3, model.POS : model.POS + 3] = 1e-4 * np.eye(3)
    sums = np.zeros(model.SUMS)
    sums[model.S_TIME], sums[model.S_FORCE + 2] = 0.2, -0.2 * G0
    model.propagate(P, sums, model.STEADY)
    return P


def test_an_innovation_beyond_the_gate_makes_velocity_uncertain_and_leaves_the_tilt_alone():
    taken = {}
    for gate in (4.0, 1e30):
        x, P, mat, e = np.zeros(model.NOMINAL), prior(), np.eye(3), np.zeros(model.ERRORS)
        x[3], x[model.N_POS] = 1.0, 0.2
        before = P.copy()
        model.update(x, P, mat, model.STEADY, 1e-5, 1e-5, e, gate)
        taken[gate] = abs(e[model.TILT + 1])
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P[:8, :8]).min() > 0.0
        if gate == 4.0:
            assert P[model.VEL, model.VEL] > 10.0 * before[model.VEL, model.VEL]
            assert P[model.TILT + 1, model.TILT + 1] > 0.9 * before[model.TILT + 1, model.TILT + 1]
    assert taken[4.0] < 0.05 * taken[1e30]


def test_innovations_within_the_gate_are_an_ordinary_update():
    results = []
    for gate in (1e3, 1e30):
        x, P, e = np.zeros(model.NOMINAL), prior(), np.zeros(model.ERRORS)
        x[3], x[model.N_POS] = 1.0, 0.005
        model.update(x, P, np.eye(3), model.STEADY, 1e-5, 1e-5, e, gate)
        results.append((x, P))
    assert np.array_equal(results[0][0], results[1][0])
    assert np.array_equal(results[0][1], results[1][1])


def test_a_covariance_with_a_negative_variance_or_a_value_not_finite_is_unsound():
    x, P = np.zeros(model.NOMINAL), prior()
    assert model.sound(x, P)
    x[5] = np.nan
    assert not model.sound(x, P)
    x[5], P[3, 3] = 0.0, -1e-9
    assert not model.sound(x, P)


def test_what_a_clipped_gyro_missed_is_put_right_about_the_tool_axis():
    x, e = np.zeros(model.NOMINAL), np.zeros(model.ERRORS)
    x[:4] = frames.quat_from_mat(frames.mat_nt(np.radians(50.0), 0.4, 0.7))
    mat = np.zeros((3, 3))
    model.rotation(x, mat)
    P = 1e-8 * np.eye(model.ERRORS)
    axis = mat[:2, 0].copy()
    P[:2, :2] += 0.01 * np.outer(axis, axis)
    P[model.POS : model.POS + 3, model.POS : model.POS + 3] = 1e-4 * np.eye(3)
    sums = np.zeros(model.SUMS)
    sums[model.S_TIME], sums[model.S_FORCE + 2] = 0.2, -0.2 * G0
    model.propagate(P, sums, model.ERRORS)
    x[model.N_POS : model.N_POS + 2] = 0.2 * np.array([axis[1], -axis[0]])
    before = mat.copy()
    model.update(x, P, mat, model.ERRORS, 1e-5, 1e-5, e, 1e30)
    model.rotation(x, mat)
    assert np.degrees(np.hypot(*e[:2])) > 3.0
    # The axis stays where it was, in inclination and in heading.
    assert np.degrees(np.arccos(mat[:, 0] @ before[:, 0])) < 0.1
