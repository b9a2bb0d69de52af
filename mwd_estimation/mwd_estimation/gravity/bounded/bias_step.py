# SPDX-License-Identifier: Apache-2.0
"""
Steps of the bias of gyros and accelerometers, found from the innovations of the last seconds.

The filter assumes that biases walk slowly. A gyro whose bias steps (by a blow, or a fault of its supply) tilts the
vertical for as long as the filter believes the walk. A step is a hypothesis about one time in the last seconds. Its
probability follows from the innovations since then (Willsky and Jones, A generalized likelihood ratio approach to the
detection and estimation of jumps in linear systems, IEEE Trans. Autom. Control 21, 1976). The information that
innovations carry about an error at each earlier time comes from one backward pass (de Jong and Penzer, Diagnosing
shocks in time series, J. Am. Stat. Assoc. 93, 1998). Other jumps explain innovations as well: a string that starts
along its hole, and a knock that clips the accelerometers. If a step is much more probable than these and than no
jump, the filter corrects the errors that the step has caused since, and adds the covariance of the estimate.

An accelerometer whose bias steps shows a force, constant in tool axes, that the gyros and the velocity do not explain.
This step is subtracted, so that the attitude goes on as the gyros carry it, but sigma contains the whole step: nobody
knows whether the bias was wrong before or afterwards.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core import ring
from mwd_estimation.gravity.bounded import information, measurement, mechanisation
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import (
    BIAS,
    ERRORS,
    POS,
    STEADY,
    VEL,
    Record,
    Sums,
    Update,
    forget_density,
)
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Sigma of a step of the gyro bias, rad/s: 1 deg/s, with which a gyro at rest is still in use (`health.rest_check`).
BIAS_STEP = 0.017
FORCE_STEP = 0.2  # m/s^2, sigma of a step of the accelerometer bias, 20 mg
# Mean time between jumps of each kind, s: 100 h, so that even one step in a run is rare. The time is the same for all
# kinds, because a string whose speed changes is soon certain, and a small knock is not more probable than a step.
EVERY = 3.6e5
SURPRISE_TIME = 0.3  # s, memory of `Record.surprise`
# The search runs if the recent sum of squared innovations over their variances is at least this. A jump can only be
# more probable than no jump if the sum since the jump is above twice the logarithm of the prior odds against it, which
# is 20 to 34.
SURPRISING = 10.0
# Averaging times of the innovations and of their density, s, and the least density.
SLOW_TIME, DENSITY_TIME, LEAST_DENSITY = 0.5, 10.0, 0.1
# Kinds of jumps: the bias of the gyros or that of the accelerometers steps; the string starts or stops along its hole;
# a knock that clips the accelerometers leaves an error of the velocity.
STEP, FORCE, TRAVEL, KNOCK, KINDS = 0, 1, 2, 3, 4
SURE = 5.0  # a step is accepted if the logarithm of its odds exceeds that of every other jump by this
# Updates after which a step of the bias is accepted at the earliest, 1.2 s. A string that starts needs up to a second
# to reach its speed, and until then its acceleration looks like the tilt that a wrong gyro bias causes.
AFTER_STEP = 40
AFTER_AXIAL = 2 * AFTER_STEP  # the same for a step of the accelerometers mainly along the axis, as a string accelerates
LEAST_AFTER = 8  # least number of updates after a jump before it can be found: a quarter of a second
APART = 4  # updates between two searches


@compiled
def follow_innovation(s: Record, axis: int, white: float) -> None:
    """
    Follow the density of the innovations along a tool axis; white: one of them over its sigma.

    The assumed noises are larger than the real ones, and motion is not white: heave repeats an error for a second. An
    innovation is therefore weighted by the density at low frequencies, which is 1 if the covariance is right.
    """
    T, found = s.sums.time, s.innovations
    found.slow[axis] += T / (SLOW_TIME + T) * (white - found.slow[axis])
    density = (2.0 * SLOW_TIME / T + 1.0) * found.slow[axis] ** 2
    usual = found.density[axis]
    # Limit the growth, so that a jump that is not found yet does not raise the density.
    found.density[axis] += T / DENSITY_TIME * (min(density, 9.0 * usual) - usual)
    s.surprise += white * white / max(usual, LEAST_DENSITY) - min(T / SURPRISE_TIME, 1.0) / 3.0 * s.surprise


@compiled
def follow(p: Params, s: Record) -> bool:
    """Search for a step, at most after every fourth update; if one is found, apply it and return True."""
    if s.surprise < SURPRISING or s.recent.length < LEAST_AFTER or s.recent.head % APART != 0:
        return False
    kind, at = _search(p, s)
    if at > 0:
        _apply(p, s, kind, at)
    return at > 0


@compiled
def _search(p: Params, s: Record) -> tuple[int, int]:
    """Return the kind of a step of a bias, STEP or FORCE, and the number of updates since then; 0 if none was found."""
    A, B, w = np.zeros((STEADY, STEADY + 1)), np.zeros((STEADY, STEADY + 1)), np.zeros(STEADY + 1)
    X, D = np.zeros((STEADY, 3)), np.zeros((3, 4))
    odds, at, squares, least = np.zeros(KINDS), np.zeros(KINDS, dtype=np.int64), 0.0, AFTER_STEP
    for back in range(1, s.recent.length + 1):
        row = s.recent.rows[ring.place(s.recent, back)]
        if row.epoch != s.epoch:
            break
        for axis in range(3):
            row.evidence[axis] = row.spread[axis] * max(s.innovations.density[axis], LEAST_DENSITY)
            squares += row.innovation[axis] ** 2 / row.evidence[axis]
        information.carry_over(row, row.evidence, A, B, w)
        _carry_force(row, A, X, D)
        if back < LEAST_AFTER:
            continue
        for kind in range(KINDS):
            size, _, gain, occam = _explain(D if kind == FORCE else _about(A, _moves(p, s, kind)))
            # Large squares that the jump leaves unexplained show that all innovations are larger than usual.
            unexplained = max((squares - gain) / (3.0 * back), 1.0)
            found = 0.5 * (gain / unexplained - occam) - math.log(EVERY / row.sums.time)
            if found > odds[kind]:
                odds[kind], at[kind] = found, back
                if kind == FORCE:
                    least = AFTER_AXIAL if size[0] ** 2 > size[1] ** 2 + size[2] ** 2 else AFTER_STEP
    kind = STEP if odds[STEP] > odds[FORCE] else FORCE
    certain = odds[kind] >= max(odds[STEP + FORCE - kind], odds[TRAVEL], odds[KNOCK]) + SURE
    return kind, (at[kind] if certain and at[kind] >= (least if kind == FORCE else AFTER_STEP) else 0)


@compiled
def _of_force(sums: Sums) -> Array:
    """Return the errors that one sigma of force that the sensor adds along each tool axis causes, (STEADY, 3)."""
    T, turned, G = sums.time, sums.bias, np.zeros((STEADY, 3))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        G[VEL, a], G[VEL + 1, a] = -FORCE_STEP * turned[0, a], -FORCE_STEP * turned[1, a]
        G[VEL + 2, a] = -FORCE_STEP * (turned[0, b] * turned[1, c] - turned[0, c] * turned[1, b]) / T
        for j in range(3):
            G[POS + j, a] = 0.5 * T * G[VEL + j, a]
    return G


@compiled
def _carry_force(row: Update, A: Array, X: Array, D: Array) -> None:
    """
    Carry information about a constant error of the force in tool axes, in sigmas, back over an update.

    A is the information about the errors before the interval of the update (`information.carry_over`). X, shape
    (STEADY, 3), is the information that the errors and the force share; D, shape (3, 4), that about the force, with the
    information vector in the last column.
    """
    T = row.sums.time
    for axis in range(2, -1, -1):
        for a in range(3):
            share = 0.0
            for i in range(STEADY):
                share += row.gain[axis, i] * X[i, a]
            for i in range(STEADY):
                X[i, a] -= row.measured[axis, i] * share
    information.carry_back(row.sums, X)
    # At the beginning of the interval, the effect is the same velocity and the opposite displacement.
    G, about = _of_force(row.sums), np.zeros((STEADY, 3))
    for a in range(3):
        for j in range(3):
            G[POS + j, a] -= T * G[VEL + j, a]
        for i in range(STEADY):
            for j in range(VEL, POS + 3):
                about[i, a] += A[i, j] * G[j, a]
    for a in range(3):
        for i in range(VEL, POS + 3):
            D[a, 3] += G[i, a] * A[i, STEADY]
            for b in range(3):
                D[a, b] += G[i, a] * (X[i, b] + about[i, b]) + X[i, a] * G[i, b]
    for a in range(3):
        for i in range(STEADY):
            X[i, a] += about[i, a]


@compiled
def _moves(p: Params, s: Record, kind: int) -> Array:
    """Return by how much a jump of 1 sigma changes each error, for up to three directions, shape (STEADY, 3)."""
    moves = np.zeros((STEADY, 3))
    for j in range(3):
        if kind == STEP:
            moves[BIAS + j, j] = BIAS_STEP
        elif kind == KNOCK:
            moves[VEL + j, j] = p.axial_speed
        else:
            moves[VEL + j, 0] = p.axial_speed * s.C[j, 0]
    return moves


@compiled
def _about(A: Array, moves: Array) -> Array:
    """Return the information about a jump of the errors, in sigmas, with its vector in the last column, (3, 4)."""
    found = np.zeros((3, 4))
    for a in range(3):
        for i in range(STEADY):
            if moves[i, a] != 0.0:
                found[a, 3] += moves[i, a] * A[i, STEADY]
                for b in range(3):
                    for j in range(STEADY):
                        found[a, b] += moves[i, a] * A[i, j] * moves[j, b]
    return found


@compiled
def _explain(about: Array) -> tuple[Array, Array, float, float]:
    """
    Estimate the size of a jump, in sigmas, from the information about it, shape (3, 4), and its prior.

    Returns size, shape (3,), its covariance, how much of the squared innovations it explains, and twice the logarithm
    of the factor by which the data narrow its size.
    """
    known = about[:, :3].copy()
    for a in range(3):
        known[a, a] += 1.0
    spread, determinant = _inverse(known)
    size, gain = np.zeros(3), 0.0
    for a in range(3):
        for b in range(3):
            size[a] += spread[a, b] * about[b, 3]
        gain += size[a] * about[a, 3]
    return size, spread, gain, math.log(max(determinant, 1.0))


@compiled
def _inverse(M: Array) -> tuple[Array, float]:
    """Return inverse and determinant of a positive definite matrix, shape (3, 3)."""
    found = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            found[j, i] = M[a, c] * M[b, d] - M[a, d] * M[b, c]
    determinant = M[0, 0] * found[0, 0] + M[0, 1] * found[1, 0] + M[0, 2] * found[2, 0]
    return found / determinant, determinant


@compiled
def _apply(p: Params, s: Record, kind: int, at: int) -> None:
    """Correct the state for a step `at` updates ago, estimated with the variances that the filter assumes."""
    A, B, w = np.zeros((STEADY, STEADY + 1)), np.zeros((STEADY, STEADY + 1)), np.zeros(STEADY + 1)
    X, D = np.zeros((STEADY, 3)), np.zeros((3, 4))
    for back in range(1, at + 1):
        row = s.recent.rows[ring.place(s.recent, back)]
        information.carry_over(row, row.spread, A, B, w)
        _carry_force(row, A, X, D)
    moves, since = (np.zeros((STEADY, 3)) if kind == FORCE else _moves(p, s, STEP)), 0.0
    jump, covariance, _, _ = _explain(D if kind == FORCE else _about(A, moves))
    for back in range(at, 0, -1):
        row = s.recent.rows[ring.place(s.recent, back)]
        since += row.sums.time
        mechanisation.carry_columns(moves, row.sums, 3, False)
        if kind == FORCE:
            moves += _of_force(row.sums)
        for axis in range(3):
            for a in range(3):
                seen = 0.0
                for i in range(STEADY):
                    seen += row.measured[axis, i] * moves[i, a]
                for i in range(STEADY):
                    moves[i, a] -= row.gain[axis, i] * seen
    for i in range(ERRORS):
        s.correction[i] = 0.0
    for i in range(STEADY):
        for a in range(3):
            s.correction[i] += moves[i, a] * jump[a]
            for j in range(STEADY):
                for b in range(3):
                    s.P[i, j] += moves[i, a] * covariance[a, b] * moves[j, b]
    measurement.symmetrise(s.P, STEADY)
    measurement.correct(s, STEADY)
    if kind == FORCE:
        for a in range(3):
            s.force_step[a] += FORCE_STEP * jump[a]
            s.force_spread[a] += FORCE_STEP**2 * covariance[a, a]
    else:
        s.gyro_step = since
    forget_density(s)


@compiled
def forces_stepped(s: Record) -> bool:
    """Return whether steps of the accelerometer bias, which have not stepped back, are larger than 5 mg together."""
    return bool(s.force_step[0] ** 2 + s.force_step[1] ** 2 + s.force_step[2] ** 2 > (0.25 * FORCE_STEP) ** 2)
