# SPDX-License-Identifier: Apache-2.0
"""
Errors of the accelerometers: their prior is what the tool states, and the gravity that they show narrows it.

The filter takes the horizontal mean force as zero. Bias, scale error and misalignment therefore tilt its level frame,
and no innovation shows this tilt. The vertical force, whose error the filter estimates, is the only evidence: gravity
at the place is known. At one attitude it shows one combination of the errors; other toolfaces and inclinations show
others. A slow Kalman filter of the errors collects this evidence. Rotation needs no rule: it averages the influence of
the errors on the level force, which is carried as it is.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import ACCEL, DOWN, DOWN_WALK, GRAVITY, Record, accelerometer_prior
from mwd_sensors.core.compiled import compiled

EVERY = 1.0  # s, time between two uses of the vertical force
# Correlation time of the biases, s. Temperature changes them; after hours they are what the tool states again.
BIAS_TIME = 10800.0
# Weight of the stated figures in the scale of the errors, in degrees of freedom: a unit can be better or worse than the
# figures of its kind.
STATED = 1.0
LEAST_SHARE = 1e-4  # least share of new information in what is known about the vertical force
LEAST_PRIOR = 1e-18  # least variance, for sensors that are declared to have no error


@compiled
def begin(s: Record) -> None:
    """Forget the influence of the errors at the attitude before a start."""
    errors = s.accelerometer
    errors.age = 0.0
    errors.tilt[:] = 0.0
    errors.down, errors.variance, errors.since = s.down, s.P[DOWN, DOWN], 0.0
    errors.influence[:] = 0.0


@compiled
def follow(p: Params, s: Record, own: float) -> None:
    """Follow the influence of the errors over one update; own: time constant of the tilt, s. Use it once a second."""
    errors, T = s.accelerometer, s.sums.time
    errors.age += T
    # The tilt follows the level force with the time constant of the filter; the vertical force is used by itself.
    level, vertical = T / min(own, errors.age), T / (errors.since + T)
    turn2 = s.turning**2
    for column in range(4):
        # Gravity and the centripetal force of the sensor's circle. Vibration has no mean.
        force = 1.0 if column == 0 else -p.gravity * s.C[2, column - 1]
        if column > 1:
            force -= turn2 * s.lever[column - 2]
        for axis in range(3):
            j = 4 * axis + column
            for a in range(3):
                share = vertical if a == 2 else level
                errors.influence[a, j] += share * (s.C[a, axis] * force - errors.influence[a, j])
    errors.since += T
    if errors.since >= EVERY and s.clipping.sign == 0.0:
        _use(p, s)
        errors.since = 0.0
    for a in range(2):
        shown = 0.0
        for j in range(ACCEL):
            shown += errors.influence[a, j] * errors.mean[j]
        errors.tilt[a] = shown / p.gravity


@compiled
def _use(p: Params, s: Record) -> None:
    """Update the errors with the vertical force since the last use."""
    errors, P = s.accelerometer, s.accelerometer.P
    keep = math.exp(-errors.since / BIAS_TIME)
    for j in range(0, ACCEL, 4):
        errors.mean[j] *= keep
        for m in range(GRAVITY + 1):
            P[j, m] *= keep
            P[m, j] *= keep
        P[j, j] += (1.0 - keep * keep) * accelerometer_prior(p, j)
    # What the filter has learnt about the vertical force since then: its estimate and variance if nothing had been
    # known before.
    before, after = 1.0 / (errors.variance + DOWN_WALK**2 * errors.since), 1.0 / s.P[DOWN, DOWN]
    new, down = after - before, s.down * after - errors.down * before
    errors.down, errors.variance = s.down, s.P[DOWN, DOWN]
    if new < LEAST_SHARE * after:
        return
    # down = gravity - vertical force of the errors
    found = s.innovations
    S, y = max(1.0, found.along.power, found.across.power) / new, down / new - errors.mean[GRAVITY]
    for j in range(ACCEL):
        y += errors.influence[2, j] * errors.mean[j]
    for j in range(GRAVITY + 1):
        product = P[j, GRAVITY]
        for m in range(ACCEL):
            product -= P[j, m] * errors.influence[2, m]
        errors.work[j] = product
    S += errors.work[GRAVITY]
    for j in range(ACCEL):
        S -= errors.influence[2, j] * errors.work[j]
    for j in range(GRAVITY + 1):
        errors.mean[j] += errors.work[j] / S * y
        for m in range(j + 1):
            P[j, m] -= errors.work[j] * errors.work[m] / S
            P[m, j] = P[j, m]
    # Errors that were learnt, over their stated sigmas, show the scale of those that were not.
    gravity2 = max(p.gravity_sigma**2, LEAST_PRIOR)
    squares, learnt, vertical2 = 0.0, 0.0, 0.0
    for j in range(ACCEL):
        prior = max(accelerometer_prior(p, j), LEAST_PRIOR)
        squares += errors.mean[j] ** 2 / prior
        learnt += max(1.0 - P[j, j] / prior, 0.0)
        vertical2 += prior * errors.influence[2, j] ** 2
    # Gravity beyond its sigma is an error of the accelerometers as well. They explain the vertical force z alone if
    # their variance grows to z^2, while the estimate gave them only their share of z.
    surplus = (errors.mean[GRAVITY] ** 2 + P[GRAVITY, GRAVITY]) / gravity2 - 1.0
    squares += max(surplus, 0.0) * (2.0 + gravity2 / max(vertical2, LEAST_PRIOR))
    errors.scale = (STATED + squares) / (STATED + learnt)


@compiled
def variances(p: Params, s: Record, dx: float, dy: float) -> tuple[float, float]:
    """Return the mean squares of the tilt due to the errors, along the level unit vector d and across it, rad^2."""
    errors, along, across = s.accelerometer, 0.0, 0.0
    for j in range(ACCEL):
        nx, ny = errors.influence[0, j], errors.influence[1, j]
        aj, cj = dx * nx + dy * ny, dx * ny - dy * nx
        a, c = 0.0, 0.0
        for m in range(j):
            nx, ny = errors.influence[0, m], errors.influence[1, m]
            a += errors.P[j, m] * (dx * nx + dy * ny)
            c += errors.P[j, m] * (dx * ny - dy * nx)
        along += aj * (2.0 * a + errors.P[j, j] * aj)
        across += cj * (2.0 * c + errors.P[j, j] * cj)
    # Gravity is not corrected, because motion can look like an error; what the errors tilt is in sigma.
    unit, tilt = errors.scale / p.gravity**2, errors.tilt
    return unit * along + (dx * tilt[0] + dy * tilt[1]) ** 2, unit * across + (dx * tilt[1] - dy * tilt[0]) ** 2
