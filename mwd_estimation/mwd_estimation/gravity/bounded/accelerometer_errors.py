# SPDX-License-Identifier: Apache-2.0
"""
Variance of the tilt that errors of the accelerometers cause: bias, scale error and misalignment of each axis.

The filter assumes that the horizontal mean force is zero. These errors therefore tilt its level frame, and no
innovation shows this tilt. Its variance follows from the sigmas in the settings of the tool and from the influence of
each error on the horizontal force, averaged over the response time of the filter. Errors that rotation averages out
have a small mean influence.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import DOWN, BoundedRecord
from mwd_sensors.core.compiled import compiled

# Time in which the tilt reaches 63 % of its response to a constant horizontal force, at rest and while rotating, s;
# measured by test_accelerometer_errors.
RESPONSE = 1.5
LEAST_PRIOR = 1e-18  # smallest prior variance, for sensors whose settings state no error


@compiled
def begin(s: BoundedRecord) -> None:
    """Discard the influence of the errors when the filter restarts, because it belongs to an earlier attitude."""
    s.accelerometer.age = 0.0
    s.accelerometer.influence[:] = 0.0


@compiled
def follow(p: BoundedParams, s: BoundedRecord) -> None:
    """Update the mean influence of each error on the level force with the interval of one update."""
    errors, turn2 = s.accelerometer, s.turning**2
    errors.age += s.sums.time
    share = s.sums.time / min(RESPONSE, errors.age)
    for column in range(4):
        # Use gravity and the centripetal force of the sensor's circle; the mean of vibration is zero.
        force = 1.0 if column == 0 else -p.gravity * s.C[2, column - 1]
        if column > 1:
            force -= turn2 * s.lever[column - 2]
        for axis in range(3):
            j = 4 * axis + column
            for a in range(2):
                errors.influence[a, j] += share * (s.C[a, axis] * force - errors.influence[a, j])


@compiled
def variances(p: BoundedParams, s: BoundedRecord, dx: float, dy: float) -> tuple[float, float]:
    """Return the variances of the tilt from the errors, along the level unit vector (dx, dy) and across it, rad^2."""
    bias2, scale2, misalignment2 = p.accel_bias_sigma**2, p.accel_scale_sigma**2, p.accel_misalignment_sigma**2
    along, across, vertical = 0.0, 0.0, LEAST_PRIOR
    for axis in range(3):
        along_axis, across_axis, vertical_axis = 0.0, 0.0, 0.0
        for column in range(4):
            prior, force = bias2, 1.0
            if column > 0:
                prior = scale2 if column == axis + 1 else misalignment2
                force = p.gravity * s.C[2, column - 1]
            nx, ny = s.accelerometer.influence[0, 4 * axis + column], s.accelerometer.influence[1, 4 * axis + column]
            along_axis += prior * (dx * nx + dy * ny) ** 2
            across_axis += prior * (dx * ny - dy * nx) ** 2
            vertical_axis += prior * force * force
        along += along_axis
        across += across_axis
        vertical += s.C[2, axis] ** 2 * vertical_axis
    # If the measured gravity differs from local gravity by more than the sigmas allow, scale the errors of all axes up.
    shown = s.down**2 - s.P[DOWN, DOWN] - p.gravity_sigma**2
    unit = max(1.0, shown / vertical) / p.gravity**2
    return unit * along, unit * across
