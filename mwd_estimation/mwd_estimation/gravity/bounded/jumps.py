# SPDX-License-Identifier: Apache-2.0
"""
Jumps of the gyro bias and of the velocity, found from the innovations of the last seconds.

The filter assumes that biases walk slowly and that the string stays in place. Three events contradict this: the bias of
a gyro steps (after a blow, or a fault of its supply); the string starts or stops to move along the hole within seconds;
or the velocity changes without a measured force (a knock clips the accelerometers, or point samples alias vibration to
a slow force). Until the event is known, the filter takes it for a tilt. A jump is a hypothesis about one time in the
last seconds. Its probability follows from the innovations since then (Willsky and Jones, A generalized likelihood ratio
approach to the detection and estimation of jumps in linear systems, IEEE Trans. Autom. Control 21, 1976). The
information that innovations carry about an error at each earlier time comes from one backward pass (de Jong and Penzer,
Diagnosing shocks in time series, J. Am. Stat. Assoc. 93, 1998). If one kind of jump is much more probable than the
others and than no jump, the filter corrects the errors that the jump has caused since, and adds the covariance of the
estimate. Before that, the tilt that a jump has caused, times the probability of the jump, belongs to the variance of
the tilt, equation (22).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import ring
from mwd_estimation.gravity.bounded import information, measurement, mechanisation
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import (
    BIAS,
    DOWN,
    ERRORS,
    STEADY,
    TILT,
    VEL,
    BoundedRecord,
    JumpSize,
    forget_density,
    forget_innovations,
)
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# 1 sigma of a step of the gyro bias, rad/s (1 deg/s). It is of the order of the largest rate across gravity at rest
# that `health.rest_check` accepts (0.012 rad/s for the default gyro).
BIAS_STEP = 0.017
# Mean time between jumps of each kind, s: 100 h, so that even one step in a run is rare. The time is the same for all
# kinds: a change of the string's speed is soon certain with any prior, and a small knock is not more probable than a
# step.
EVERY = 3.6e5
# Smallest value of `BoundedRecord.surprise`, a sum of the squares of three normal variables, at which the search runs.
# Without a jump, one of 22 values is larger. The search takes the time of 500 samples at 100 Hz, which is most of the
# time of the filter if the limit is below 5. With a limit of 10, fewer steps are found while the tool rotates.
SURPRISING = 8.0
# Averaging time of the innovations, s; averaging time of their spectral density, s; and smallest density that is used.
# The density is 0.005 to 0.02 in rotation and while sliding, so that a larger limit hides a step of the bias.
SLOW_TIME, DENSITY_TIME, LEAST_DENSITY = 0.5, 10.0, 0.005
# Kinds of jumps: a bias steps; the string starts or stops along its hole; the accelerometers miss a part of the
# velocity; the string begins to accelerate along its hole.
STEP, TRAVEL, KNOCK, RAMP, KINDS = 0, 1, 2, 3, 4
RAMP_TIME = 1.0  # usual time in which a string reaches its speed, s
# A jump is accepted if the logarithm of its odds exceeds the logarithm of the odds of each competing jump by more than
# this. Jumps of the velocity do not compete with each other, because travel along the hole is a special knock.
SURE = 5.0
LEAST_CHANCE = 1e-3  # smallest probability of a jump that is not accepted yet at which it adds a variance
# Point samples of vibration near a multiple of the sampling rate show a slow force of the size of the vibration. Its
# usual duration, s: a sweep of 1 Hz/s passes the rate within a second.
BEAT = 0.5
# Smallest number of updates (1.2 s) between a step of the bias and its acceptance. A string that starts needs up to a
# second to reach its speed, and until then its acceleration looks like the tilt that a wrong gyro bias causes.
AFTER_STEP = 40
LEAST_AFTER = 8  # smallest number of updates between a jump and its detection: a quarter of a second
APART = 4  # updates between two searches


@compiled
def follow_innovation(s: BoundedRecord, axis: int, white: float) -> None:
    """
    Update the spectral density of the innovations along a tool axis with a new innovation.

    The assumed noises are larger than the real noises, and motion is not white: heave repeats an error for a second. An
    innovation is therefore weighted by the density at low frequencies, which is 1 if the covariance is right.

    white: the new innovation divided by its sigma.
    """
    T, found = s.sums.time, s.innovations
    found.slow[axis] += T / (SLOW_TIME + T) * (white - found.slow[axis])
    density = (2.0 * SLOW_TIME / T + 1.0) * found.slow[axis] ** 2
    usual = found.density[axis]
    # Limit the growth of the density, so that a jump that is not found yet raises it only slowly.
    found.density[axis] += T / DENSITY_TIME * (min(density, 9.0 * usual) - usual)
    s.surprise = (s.surprise if axis > 0 else 0.0) + density / max(usual, LEAST_DENSITY)


@compiled
def follow(p: BoundedParams, s: BoundedRecord) -> bool:
    """
    Search for a jump, at most after every fourth update; if one is found, apply it and return True.

    While a jump is possible but not certain, set `BoundedRecord.doubt`.
    """
    if s.surprise < SURPRISING or s.recent.length < LEAST_AFTER:
        s.doubt[:] = 0.0
        return False
    if s.recent.head % APART != 0:
        return False
    odds, since = _search(p, s)
    s.doubt[:] = 0.0
    kind, at = _certain(s, odds, since)
    if at > 0:
        _apply(p, s, kind, at)
        return True
    for kind in range(KINDS):
        # Only kinds of jumps for which the filter corrects its state once they are certain: for the errors of the other
        # kinds, equation (20) already adds a variance.
        if kind == STEP or (s.meaning.sampled and kind != RAMP):
            chance = _chance(odds, kind)
            if since[kind] > 0 and chance > LEAST_CHANCE:
                _doubt(p, s, kind, since[kind], chance)
    return False


@compiled
def _search(p: BoundedParams, s: BoundedRecord) -> tuple[Array, NDArray[np.int64]]:
    """
    Return the most probable jump of each kind, shapes (KINDS,) each.

    The first array holds the logarithm of the odds of the jump against no jump, at least 0; the second one holds the
    number of updates since the jump, 0 if no jump has odds above 1.
    """
    s.later.matrix[:] = 0.0
    odds, at, squares = np.zeros(KINDS), np.zeros(KINDS, dtype=np.int64), 0.0
    step, travel, knock, ramp = _moves(p, s, STEP), _moves(p, s, TRAVEL), _moves(p, s, KNOCK), _moves(p, s, RAMP)
    moves = (step, travel, knock, ramp)
    rows = (_moved(step), _moved(travel), _moved(knock), _moved(ramp))
    for back in range(1, s.recent.length + 1):
        row = s.recent.rows[ring.place(s.recent, back)]
        if row.epoch != s.epoch:
            break
        for axis in range(3):
            row.evidence[axis] = row.spread[axis] * max(s.innovations.density[axis], LEAST_DENSITY)
            squares += row.innovation[axis] ** 2 / row.evidence[axis]
        information.carry_over(row, row.evidence, s.later)
        if back < LEAST_AFTER:
            continue
        rare = math.log(EVERY / row.sums.time)
        for kind in range(KINDS):
            gain, occam = _explain(s.later.matrix, moves[kind], rows[kind], s.jump)
            # Large squares that the jump leaves unexplained show that all innovations are larger than usual.
            unexplained = max((squares - gain) / (3.0 * back), 1.0)
            logarithm = 0.5 * (gain / unexplained - occam) - rare
            if logarithm > odds[kind]:
                odds[kind], at[kind] = logarithm, back
    return odds, at


@compiled
def _certain(s: BoundedRecord, odds: Array, at: NDArray[np.int64]) -> tuple[int, int]:
    """
    Return the kind of the jump to apply, and the number of updates since the jump; 0 updates: no jump is certain.

    odds, at: results of `_search`.
    """
    moved = TRAVEL if odds[TRAVEL] >= odds[KNOCK] else KNOCK
    # RAMP (the string accelerates) only competes with a step of the bias: it leaves no error in the state to correct.
    # Integrated samples miss a velocity only where they clip, which `clipping` follows.
    if s.meaning.sampled and odds[moved] >= odds[STEP] + SURE:
        return moved, at[moved]
    certain = odds[STEP] >= max(odds[moved], odds[RAMP]) + SURE and at[STEP] >= AFTER_STEP
    return STEP, at[STEP] if certain else 0


@compiled
def _chance(odds: Array, kind: int) -> float:
    """Return the probability of a kind of jump, from the logarithms of the odds of all kinds against no jump."""
    total = math.exp(-odds[kind])
    for other in range(KINDS):
        if odds[other] > 0.0:
            total += math.exp(min(odds[other] - odds[kind], 100.0))
    return 1.0 / total


@compiled
def _doubt(p: BoundedParams, s: BoundedRecord, kind: int, at: int, chance: float) -> None:
    """Add the variance of the tilt due to a jump `at` updates ago with the probability `chance`, equation (22)."""
    moves, _ = _effect(p, s, kind, at)
    jump, covariance = s.jump.estimate, s.jump.covariance
    for i in range(2):
        for j in range(2):
            for a in range(3):
                for b in range(3):
                    square = covariance[a, b] + jump[a] * jump[b]
                    s.doubt[i, j] += chance * moves[TILT + i, a] * square * moves[TILT + j, b]


@compiled
def _moves(p: BoundedParams, s: BoundedRecord, kind: int) -> Array:
    """
    Return the change of each error by a jump of 1 sigma, for up to three directions, shape (STEADY, 3).

    kind: STEP, TRAVEL, KNOCK or RAMP.
    """
    moves = np.zeros((STEADY, 3))
    missed = p.axial_speed + (BEAT * math.sqrt(s.power) if s.meaning.sampled else 0.0)
    for j in range(3):
        if kind == STEP:
            moves[BIAS + j, j] = BIAS_STEP
        elif kind == KNOCK:
            moves[VEL + j, j] = missed
        else:
            moves[VEL + j, 0] = p.axial_speed * s.C[j, 0]
    if kind == RAMP:
        # To the filter, a constant acceleration is a tilt and an error of the vertical force.
        force = p.axial_speed / RAMP_TIME
        moves[TILT, 1], moves[TILT + 1, 1] = force / p.gravity * s.C[1, 0], -force / p.gravity * s.C[0, 0]
        moves[DOWN, 1] = force * s.C[2, 0]
    return moves


@compiled
def _moved(moves: Array) -> NDArray[np.int64]:
    """Return the indices of the errors that a jump changes; moves: result of `_moves`."""
    rows, count = np.zeros(STEADY, dtype=np.int64), 0
    for i in range(STEADY):
        if moves[i, 0] != 0.0 or moves[i, 1] != 0.0 or moves[i, 2] != 0.0:
            rows[count] = i
            count += 1
    return rows[:count]


@compiled
def _explain(A: Array, moves: Array, rows: NDArray[np.int64], found: JumpSize) -> tuple[float, float]:
    """
    Estimate the size of a jump, in prior sigmas, from the information A about the errors at the time of the jump.

    moves, rows: results of `_moves` and `_moved`. Fills `found`. Returns the part of the sum of squared innovations
    that the jump explains, and the log determinant of the information about the size (prior: 0).
    """
    known, vector, size, covariance = found.known, found.vector, found.estimate, found.covariance
    for a in range(3):
        vector[a] = size[a] = 0.0
        for b in range(3):
            known[a, b] = 1.0 if a == b else 0.0
    for i in rows:
        x, y, z = 0.0, 0.0, 0.0
        for j in rows:
            x += A[i, j] * moves[j, 0]
            y += A[i, j] * moves[j, 1]
            z += A[i, j] * moves[j, 2]
        for a in range(3):
            vector[a] += moves[i, a] * A[i, STEADY]
            known[a, 0] += moves[i, a] * x
            known[a, 1] += moves[i, a] * y
            known[a, 2] += moves[i, a] * z
    determinant, gain = _invert(known, covariance), 0.0
    for a in range(3):
        for b in range(3):
            size[a] += covariance[a, b] * vector[b]
        gain += size[a] * vector[a]
    return gain, math.log(max(determinant, 1.0))


@compiled
def _invert(M: Array, inverse: Array) -> float:
    """Set `inverse` to the inverse of a positive definite matrix M, shape (3, 3); return the determinant of M."""
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            inverse[j, i] = M[a, c] * M[b, d] - M[a, d] * M[b, c]
    determinant: float = M[0, 0] * inverse[0, 0] + M[0, 1] * inverse[1, 0] + M[0, 2] * inverse[2, 0]
    unit = 1.0 / determinant
    for i in range(3):
        for j in range(3):
            inverse[i, j] *= unit
    return determinant


@compiled
def _effect(p: BoundedParams, s: BoundedRecord, kind: int, at: int) -> tuple[Array, float]:
    """
    Estimate the size of a jump `at` updates ago (`jump`), with the variances that the filter assumes.

    Returns the present change of each error by a jump of 1 sigma, shape (STEADY, 3), and the time since the jump, s.
    """
    s.later.matrix[:] = 0.0
    for back in range(1, at + 1):
        row = s.recent.rows[ring.place(s.recent, back)]
        information.carry_over(row, row.spread, s.later)
    moves, since = _moves(p, s, kind), 0.0
    _explain(s.later.matrix, moves, _moved(moves), s.jump)
    for back in range(at, 0, -1):
        row = s.recent.rows[ring.place(s.recent, back)]
        since += row.sums.time
        mechanisation.carry_columns(moves, row.sums, 3, False)
        for axis in range(3):
            for a in range(3):
                seen = 0.0
                for i in range(STEADY):
                    seen += row.measured[axis, i] * moves[i, a]
                for i in range(STEADY):
                    moves[i, a] -= row.gain[axis, i] * seen
    return moves, since


@compiled
def _apply(p: BoundedParams, s: BoundedRecord, kind: int, at: int) -> None:
    """Correct the state for a jump of a kind `at` updates ago."""
    moves, since = _effect(p, s, kind, at)
    jump, covariance = s.jump.estimate, s.jump.covariance
    for i in range(ERRORS):
        s.correction[i] = 0.0
    for i in range(STEADY):
        for a in range(3):
            s.correction[i] += moves[i, a] * jump[a]
            for j in range(STEADY):
                for b in range(3):
                    s.P[i, j] += moves[i, a] * covariance[a, b] * moves[j, b]
    mechanisation.symmetrise(s.P, STEADY)
    measurement.correct(s, STEADY)
    if kind == STEP:
        for i in range(3):
            for a in range(3):
                for b in range(3):
                    s.stepped[i] += moves[BIAS + i, a] * covariance[a, b] * moves[BIAS + i, b]
        s.gyro_step = since
        forget_density(s)
    else:
        forget_innovations(s)
