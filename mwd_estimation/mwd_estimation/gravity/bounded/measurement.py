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
from mwd_sensors.core.compiled import compiled, specialised

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
def update(s: BoundedRecord, size: int, noise: float, gate: float) -> None:
    """
    Measure zero displacement along the three tool axes, equation (4); set `correction`, and correct the covariance.

    Also fills the measurement rows, gains, innovations and their variances of `latest`, as if the axes were measured
    one after the other: an innovation is the part that the earlier axes do not predict.

    size: number of errors in use; noise: variance of the white displacement, m^2. An innovation whose square is above
    `gate` times its variance is treated as a velocity that was lost in a shock: the variances of velocity and
    displacement along the axis are increased by its square.
    """
    C, lever, found, share = s.C, s.lever, s.latest, s.share
    _fill_rows(s)
    if size == STEADY:
        _multiply(s, STEADY)
    else:
        _multiply(s, ERRORS)
    for axis in range(3):
        y = lever[axis - 1] if axis > 0 else 0.0
        for j in range(3):
            y -= C[j, axis] * s.pos[j]
        S = noise + _along(s, axis, axis)
        for earlier in range(axis):
            # Covariance of the displacement with an earlier innovation, and the share that this innovation predicts.
            common = _along(s, axis, earlier)
            for first in range(earlier):
                common -= share[axis, first] * share[earlier, first] * found.spread[first]
            share[axis, earlier] = common * share[earlier, earlier]
            S -= share[axis, earlier] * common
            y -= share[axis, earlier] * found.innovation[earlier]
        if y * y > gate * S:
            _lose_velocity(s, axis, y)
            s.since_shock = min(s.since_shock, SHOCK_APART)
            S += y * y
        share[axis, axis] = 1.0 / S
        found.innovation[axis], found.spread[axis] = y, S
        s.white[axis] = y * math.sqrt(share[axis, axis])
    if size == STEADY:
        _reduce(s, STEADY)
    else:
        _reduce(s, ERRORS)


@compiled
def _fill_rows(s: BoundedRecord) -> None:
    """Fill the rows of the measurement matrix H for the three tool axes; elements not mentioned here are always 0."""
    rows = s.latest.measured
    for axis in range(3):
        rows[axis, TILT], rows[axis, TILT + 1] = tilt_sensitivity(s, axis)
        for j in range(3):
            rows[axis, POS + j] = s.C[j, axis]
    rows[1, LEVER] = rows[2, LEVER + 1] = -1.0


@specialised
def _multiply(s: BoundedRecord, size: int) -> None:
    """Set `work` to H P, shape (3, size)."""
    P, PH, h = s.P, s.work, s.latest.measured
    ax, ay, bx, by, cx, cy = h[0, TILT], h[0, TILT + 1], h[1, TILT], h[1, TILT + 1], h[2, TILT], h[2, TILT + 1]
    a0, a1, a2 = h[0, POS], h[0, POS + 1], h[0, POS + 2]
    b0, b1, b2 = h[1, POS], h[1, POS + 1], h[1, POS + 2]
    c0, c1, c2 = h[2, POS], h[2, POS + 1], h[2, POS + 2]
    for j in range(size):
        tx, ty, x, y, z = P[TILT, j], P[TILT + 1, j], P[POS, j], P[POS + 1, j], P[POS + 2, j]
        PH[0, j] = ax * tx + ay * ty + a0 * x + a1 * y + a2 * z
        PH[1, j] = bx * tx + by * ty + b0 * x + b1 * y + b2 * z - P[LEVER, j]
        PH[2, j] = cx * tx + cy * ty + c0 * x + c1 * y + c2 * z - P[LEVER + 1, j]


@compiled
def _along(s: BoundedRecord, axis: int, other: int) -> float:
    """Return the covariance of the displacements along two tool axes by the errors of the state, m^2."""
    h, PH = s.latest.measured, s.work
    found: float = h[axis, TILT] * PH[other, TILT] + h[axis, TILT + 1] * PH[other, TILT + 1]
    for j in range(3):
        found += h[axis, POS + j] * PH[other, POS + j]
    if axis > 0:
        found -= PH[other, LEVER + axis - 1]
    return found


@specialised
def _reduce(s: BoundedRecord, size: int) -> None:
    """Set correction and gains of the three measurements, and reduce the covariance by them."""
    PH, e, gain, share, y = s.work, s.correction, s.latest.gain, s.share, s.latest.innovation
    u, v, w = share[0, 0], share[1, 1], share[2, 2]
    vu, wu, wv = share[1, 0], share[2, 0], share[2, 1]
    y0, y1, y2 = u * y[0], v * y[1], w * y[2]
    root_u, root_v, root_w = math.sqrt(u), math.sqrt(v), math.sqrt(w)
    for j in range(size):
        # Covariances of an error with the three innovations.
        a = PH[0, j]
        b = PH[1, j] - vu * a
        c = PH[2, j] - wu * a - wv * b
        e[j] = a * y0 + b * y1 + c * y2
        if j < STEADY:
            gain[0, j], gain[1, j], gain[2, j] = a * u, b * v, c * w
        # Over the sigmas of the innovations: P decreases by products of these, which are exactly symmetric.
        PH[0, j], PH[1, j], PH[2, j] = a * root_u, b * root_v, c * root_w
    _reduce_four_rows(s, 0, size)
    _reduce_four_rows(s, 4, size)
    _reduce_four_rows(s, 8, size)
    _reduce_four_rows(s, 12, size)
    P = s.P
    for j in range(16, size):
        for m in range(size):
            P[j, m] -= PH[0, j] * PH[0, m] + PH[1, j] * PH[1, m] + PH[2, j] * PH[2, m]


@specialised
def _reduce_four_rows(s: BoundedRecord, j: int, size: int) -> None:
    """Reduce four rows of the covariance, from row j; of loops with a single row LLVM makes no vector instructions."""
    P, PH = s.P, s.work
    a0, a1, a2, a3 = PH[0, j], PH[0, j + 1], PH[0, j + 2], PH[0, j + 3]
    b0, b1, b2, b3 = PH[1, j], PH[1, j + 1], PH[1, j + 2], PH[1, j + 3]
    c0, c1, c2, c3 = PH[2, j], PH[2, j + 1], PH[2, j + 2], PH[2, j + 3]
    for m in range(size):
        a, b, c = PH[0, m], PH[1, m], PH[2, m]
        P[j, m] -= a0 * a + b0 * b + c0 * c
        P[j + 1, m] -= a1 * a + b1 * b + c1 * c
        P[j + 2, m] -= a2 * a + b2 * b + c2 * c
        P[j + 3, m] -= a3 * a + b3 * b + c3 * c


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
def _lose_velocity(s: BoundedRecord, axis: int, y: float) -> None:
    """
    Increase the variances of displacement and velocity along a tool axis, in P and in the product P h'.

    y: 1 sigma of the added displacement, m; the added velocity is y / JUMP_TIME and fully correlated with it. The other
    two axes do not see the displacement.
    """
    P, C, PH, rate = s.P, s.C, s.work[axis], 1.0 / JUMP_TIME
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
