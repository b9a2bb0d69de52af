# SPDX-License-Identifier: Apache-2.0
"""
Variance of the tilt that errors of the accelerometers cause: bias, scale error and misalignment of each axis.

The filter takes the horizontal mean force as zero. These errors therefore tilt its level frame, and no innovation shows
this tilt. Its variance follows from the figures of the tool and from the influence of each error on the level force,
which is averaged over the time in which the filter responds. Rotation needs no rule: the average shows what it removes.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import ACCEL, DOWN, Record
from mwd_sensors.core.compiled import compiled

# s, time in which the tilt reaches 63 % of its response to a constant horizontal force, at rest and while rotating;
# test_accelerometer_errors measures it.
RESPONSE = 1.5
LEAST_PRIOR = 1e-18  # least variance, for sensors that are declared to have no error


@compiled
def begin(s: Record) -> None:
    """Forget the influence of the errors at the attitude before a start."""
    s.accelerometer.age = 0.0
    s.accelerometer.influence[:] = 0.0


@compiled
def follow(p: Params, s: Record) -> None:
    """Follow the influence of the errors over one update."""
    errors, turn2 = s.accelerometer, s.turning**2
    errors.age += s.sums.time
    share = s.sums.time / min(RESPONSE, errors.age)
    for column in range(4):
        # Gravity and the centripetal force of the sensor's circle. Vibration has no mean.
        force = 1.0 if column == 0 else -p.gravity * s.C[2, column - 1]
        if column > 1:
            force -= turn2 * s.lever[column - 2]
        for axis in range(3):
            j = 4 * axis + column
            for a in range(2):
                errors.influence[a, j] += share * (s.C[a, axis] * force - errors.influence[a, j])


@compiled
def variances(p: Params, s: Record, dx: float, dy: float) -> tuple[float, float]:
    """Return the variances of the tilt due to the errors, along the level unit vector d and across it, rad^2."""
    along, across, vertical = 0.0, 0.0, LEAST_PRIOR
    for j in range(ACCEL):
        axis, column = j // 4, j % 4
        if column == 0:
            prior, force = p.accel_bias_sigma**2, 1.0
        else:
            prior = p.accel_scale_sigma**2 if column == axis + 1 else p.accel_misalignment_sigma**2
            force = p.gravity * s.C[2, column - 1]
        nx, ny = s.accelerometer.influence[0, j], s.accelerometer.influence[1, j]
        along += prior * (dx * nx + dy * ny) ** 2
        across += prior * (dx * ny - dy * nx) ** 2
        vertical += prior * (s.C[2, axis] * force) ** 2
    # If the measured gravity differs from that of the place, the errors of all axes are larger than the tool states.
    shown = s.down**2 - s.P[DOWN, DOWN] - p.gravity_sigma**2
    unit = max(1.0, shown / vertical) / p.gravity**2
    return unit * along, unit * across
