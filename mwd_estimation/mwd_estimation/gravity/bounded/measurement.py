# SPDX-License-Identifier: Apache-2.0
"""
Measurement of the bounded filter: the point of the tool that moves least has zero displacement along every axis.

This point is called the resting point; the position of the sensor relative to it is `lever`. Equation numbers are those
of ``docs/methods/bounded_gravity_filter.md``. A tilt, or a sensor error that acts like tilt, integrates to a
displacement that grows without limit; the displacement from vibration stays limited.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded.mechanisation import set_matrix
from mwd_estimation.gravity.bounded.state import (
    ASKEW,
    BIAS,
    DOWN,
    ERRORS,
    LEVER,
    MISSING,
    POS,
    SCALE,
    SLOPE,
    STEADY,
    TILT,
    VEL,
    BoundedRecord,
)
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

SHOCK_APART = 0.1  # smallest time between two shocks that are counted separately, s
JUMP_TIME = 0.06  # time after which a velocity lost in a shock is visible as a displacement, s


@compiled
def hole_direction(s: BoundedRecord) -> tuple[float, float]:
    """Return the horizontal unit vector along the hole, in level axes x and y; (1, 0) for a vertical tool."""
    dx, dy = s.C[0, 0], s.C[1, 0]
    norm = math.sqrt(dx * dx + dy * dy)
    if norm < 1e-9:
        return 1.0, 0.0
    return dx / norm, dy / norm


@compiled
def update(s: BoundedRecord, size: int, axis: int, noise: float, gate: float) -> float:
    """
    Update with one scalar measurement along a tool axis, equation (4); return the whitened innovation.

    The correction of the errors is added to `correction`. size: number of errors in use; noise: variance of the white
    displacement, m^2. An innovation whose square is above `gate` times its variance is treated as a velocity that was
    lost in a shock: the variances of velocity and displacement along the axis are increased by its square.
    """
    P, C, e, PH, lever = s.P, s.C, s.correction, s.work, LEVER + axis - 1
    hx, hy = tilt_sensitivity(s, axis)
    ux, uy, uz = C[0, axis], C[1, axis], C[2, axis]
    arm = s.lever[axis - 1] + e[lever] if axis > 0 else 0.0
    y = arm - hx * e[TILT] - hy * e[TILT + 1]
    y -= ux * (s.pos[0] + e[POS]) + uy * (s.pos[1] + e[POS + 1]) + uz * (s.pos[2] + e[POS + 2])
    for j in range(size):
        turned = hx * P[TILT, j] + hy * P[TILT + 1, j]
        PH[j] = turned + ux * P[POS, j] + uy * P[POS + 1, j] + uz * P[POS + 2, j]
        if axis > 0:
            PH[j] -= P[lever, j]
    S = noise + hx * PH[TILT] + hy * PH[TILT + 1]
    S += ux * PH[POS] + uy * PH[POS + 1] + uz * PH[POS + 2]
    if axis > 0:
        S -= PH[lever]
    if y * y > gate * S:
        _lose_velocity(s, axis, y)
        s.since_shock = min(s.since_shock, SHOCK_APART)
        S += y * y
    inverse = 1.0 / S
    for j in range(size):
        gain = PH[j] * inverse
        e[j] += gain * y
        for m in range(size):
            P[j, m] -= gain * PH[m]
    s.innovation, s.spread = y, S
    whitened: float = y / math.sqrt(S)
    return whitened


@compiled
def tilt_sensitivity(s: BoundedRecord, axis: int) -> tuple[float, float]:
    """
    Return the sensitivity of the displacement along a tool axis to the two tilts, m.

    A tilt moves the sensor by the lever arm between the sensor and the resting point. The estimated position must not
    be used instead, because its noise would count as information about the tilt.
    """
    C, lx, ly, lz = s.C, 0.0, 0.0, 0.0
    if axis == 0:
        ly, lz = -s.lever[1], s.lever[0]
    else:
        lx = s.lever[1] if axis == 1 else -s.lever[0]
    hx: float = C[0, 0] * lx + C[0, 1] * ly + C[0, 2] * lz
    hy: float = C[1, 0] * lx + C[1, 1] * ly + C[1, 2] * lz
    return hx, hy


@compiled
def log_measured(s: BoundedRecord, axis: int, measured: Array, gain: Array) -> None:
    """Fill the row of H and the gain of the last measurement, along a tool axis; each has shape (STEADY,)."""
    inverse = 1.0 / s.spread
    for j in range(STEADY):
        measured[j] = 0.0
        gain[j] = s.work[j] * inverse
    measured[TILT], measured[TILT + 1] = tilt_sensitivity(s, axis)
    for j in range(3):
        measured[POS + j] = s.C[j, axis]
    if axis > 0:
        measured[LEVER + axis - 1] = -1.0


@compiled
def symmetrise(P: Array, size: int) -> None:
    """Make the first `size` rows of a covariance exactly symmetric, so that rounding errors do not grow."""
    for j in range(size):
        for m in range(j):
            P[m, j] = P[j, m]


@compiled
def _lose_velocity(s: BoundedRecord, axis: int, y: float) -> None:
    """
    Increase the variances of displacement and velocity along a tool axis, in P and in the product P h'.

    y: 1 sigma of the added displacement, m; the added velocity is y / JUMP_TIME and fully correlated with it.
    """
    P, C, PH, rate = s.P, s.C, s.work, 1.0 / JUMP_TIME
    for j in range(3):
        for m in range(3):
            both = C[j, axis] * C[m, axis] * y * y
            P[POS + j, POS + m] += both
            P[POS + j, VEL + m] += both * rate
            P[VEL + j, POS + m] += both * rate
            P[VEL + j, VEL + m] += both * rate * rate
        PH[POS + j] += y * y * C[j, axis]
        PH[VEL + j] += y * y * rate * C[j, axis]


@compiled
def correct(s: BoundedRecord, size: int) -> None:
    """Apply the correction to the nominal values: to the attitude by exp() from the left, to the others by addition."""
    C, e, yaw = s.C, s.correction, 0.0
    if s.clipping.seen:
        # A clipped gyro loses rotation about the tool axis, which also changes the free heading. Correct the heading
        # together with the tilt: a correction about the level axis alone would add half its square to the inclination.
        yaw = (e[TILT] * C[0, 0] + e[TILT + 1] * C[1, 0]) * C[2, 0] / max(C[0, 0] ** 2 + C[1, 0] ** 2, 0.01)
    a, b, c = 0.5 * e[TILT], 0.5 * e[TILT + 1], 0.5 * yaw
    qx, qy, qz, qw = s.q[0], s.q[1], s.q[2], s.q[3]
    ax = qx + a * qw + b * qz - c * qy
    ay = qy + b * qw + c * qx - a * qz
    az = qz + c * qw + a * qy - b * qx
    aw = qw - a * qx - b * qy - c * qz
    unit = 1.0 / math.sqrt(ax * ax + ay * ay + az * az + aw * aw)
    s.q[0], s.q[1], s.q[2], s.q[3] = unit * ax, unit * ay, unit * az, unit * aw
    s.down += e[DOWN]
    for j in range(3):
        s.vel[j] += e[VEL + j]
        s.pos[j] += e[POS + j]
        s.bias[j] += e[BIAS + j]
    if s.clipping.seen:
        # Rotate velocity and position with the heading.
        cosine, sine = math.cos(yaw), math.sin(yaw)
        for v in (s.vel, s.pos):
            v[0], v[1] = cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1]
    for j in range(2):
        s.askew[j] += e[ASKEW + j]
        s.lever[j] += e[LEVER + j]
    s.scale += e[SCALE]
    if size == ERRORS:
        s.missing += e[MISSING]
        s.slope += e[SLOPE]
    set_matrix(s)


@compiled
def sound(s: BoundedRecord) -> bool:
    """Return whether all values are finite and no variance is negative."""
    total = s.q[0] + s.q[1] + s.q[2] + s.q[3] + s.scale + s.missing + s.slope + s.down + s.lever[0] + s.lever[1]
    total += s.askew[0] + s.askew[1]
    for j in range(3):
        total += s.vel[j] + s.pos[j] + s.bias[j]
    least = 0.0
    for j in range(ERRORS):
        total += s.P[j, j]
        least = min(least, s.P[j, j])
    return math.isfinite(total) and least >= 0.0
