# SPDX-License-Identifier: Apache-2.0
"""
Mechanisation of the bounded filter: propagate attitude, velocity and position, and collect the sums for an update.

Errors of attitude, velocity and position are in a level frame of arbitrary heading, sensor errors in tool axes. Each
sample propagates the nominal values and is added to the sums; the covariance is propagated once per update
(`propagate`).
Equation numbers, here and in the other modules of this folder, are those of ``docs/methods/bounded_gravity_filter.md``.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import (
    ASKEW,
    BIAS,
    DOWN,
    ERRORS,
    MISSING,
    POS,
    SCALE,
    SLOPE,
    STEADY,
    TILT,
    VEL,
    BoundedRecord,
    UpdateSums,
)
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled, specialised
from mwd_sensors.core.constants import STANDARD_GRAVITY


@compiled
def set_matrix(s: BoundedRecord) -> None:
    """Set the rotation matrix C from tool to level axes from the quaternion."""
    a, b, c, d = s.q[0], s.q[1], s.q[2], s.q[3]
    s.C[0, 0], s.C[0, 1], s.C[0, 2] = 1 - 2 * (b * b + c * c), 2 * (a * b - c * d), 2 * (a * c + b * d)
    s.C[1, 0], s.C[1, 1], s.C[1, 2] = 2 * (a * b + c * d), 1 - 2 * (a * a + c * c), 2 * (b * c - a * d)
    s.C[2, 0], s.C[2, 1], s.C[2, 2] = 2 * (a * c - b * d), 2 * (b * c + a * d), 1 - 2 * (a * a + b * b)


@compiled
def rotate(s: BoundedRecord, px: float, py: float, pz: float) -> None:
    """Rotate the attitude by a rotation vector in tool axes, rad: q <- q * exp(p)."""
    angle2 = px * px + py * py + pz * pz
    if angle2 < 1.0:
        # Power series of the cosine of half the angle, and of its sine over the angle. They are exact to rounding, and
        # faster than the functions.
        x = 0.25 * angle2
        c = 1 / 40320 - x * (1 / 3628800 - x * (1 / 479001600 - x * (1 / 87178291200)))
        c = 1.0 - x * (1 / 2 - x * (1 / 24 - x * (1 / 720 - x * c)))
        h = 1 / 362880 - x * (1 / 39916800 - x * (1 / 6227020800 - x * (1 / 1307674368000)))
        h = 0.5 - 0.5 * x * (1 / 6 - x * (1 / 120 - x * (1 / 5040 - x * h)))
    else:
        angle = math.sqrt(angle2)
        c = math.cos(0.5 * angle)
        h = math.sin(0.5 * angle) / angle
    px, py, pz = h * px, h * py, h * pz
    qx, qy, qz, qw = s.q[0], s.q[1], s.q[2], s.q[3]
    # Each correction (`measurement.correct`) restores the unit norm, which rounding changes.
    s.q[0] = qw * px + qx * c + qy * pz - qz * py
    s.q[1] = qw * py - qx * pz + qy * c + qz * px
    s.q[2] = qw * pz + qx * py - qy * px + qz * c
    s.q[3] = qw * c - qx * px - qy * py - qz * pz
    set_matrix(s)


@compiled
def mechanise(p: BoundedParams, s: BoundedRecord, dt: float, w: Vector, f: Vector) -> float:
    """
    Propagate nominal values and sums by one sample (equations (1) and (2)); return the squared acceleration, (m/s^2)^2.

    dt: time since the last sample, s; w, f: measured rate, rad/s, and specific force, m/s^2, of this interval.
    """
    scaled = w[0] - s.bias[0] + s.missing
    wx = scaled * (1.0 - s.scale)
    wy, wz = w[1] - s.bias[1] - s.askew[0] * scaled, w[2] - s.bias[2] - s.askew[1] * scaled
    px, py, pz = wx * dt, wy * dt, wz * dt
    coning, sampled = s.meaning.coning, s.meaning.sampled
    if coning > 0.0:
        c = coning / 12.0 * dt * dt
        px += c * (s.last_w[1] * w[2] - s.last_w[2] * w[1])
        py += c * (s.last_w[2] * w[0] - s.last_w[0] * w[2])
        pz += c * (s.last_w[0] * w[1] - s.last_w[1] * w[0])
    if sampled:
        px += 0.5 * (s.last_w[0] - w[0]) * dt
    rotate(s, px, py, pz)
    s.turn += px
    # Rotate a mean force to the end of the interval, less the rotation that the unit has already applied: an
    # integrating unit rotates the force by its measured rate, an averaging unit does not. The mean over a rotation of 2
    # h is shorter by the factor sin(h) / h.
    h = 0.0 if sampled else 0.5 * dt * ((w[0] if coning == 0.0 else 0.0) - wx)
    keep = 1.0 - h * h / 3.0
    fy, fz = keep * f[1] - h * f[2], keep * f[2] + h * f[1]
    C, sums = s.C, s.sums
    ax = C[0, 0] * f[0] + C[0, 1] * fy + C[0, 2] * fz
    ay = C[1, 0] * f[0] + C[1, 1] * fy + C[1, 2] * fz
    az = C[2, 0] * f[0] + C[2, 1] * fy + C[2, 2] * fz
    sums.force[0] += ax * dt
    sums.force[1] += ay * dt
    sums.force[2] += az * dt
    az += p.gravity + s.down
    sums.time += dt
    sums.position[0] += (sums.velocity[0] + 0.5 * ax * dt) * dt
    sums.position[1] += (sums.velocity[1] + 0.5 * ay * dt) * dt
    sums.position[2] += (sums.velocity[2] + 0.5 * az * dt) * dt
    sums.velocity[0] += ax * dt
    sums.velocity[1] += ay * dt
    sums.velocity[2] += az * dt
    turn = scaled * dt
    for a in range(2):
        for j in range(3):
            sums.bias[a, j] += C[a, j] * dt
        sums.scale[a] += C[a, 0] * turn
        for j in range(2):
            sums.askew[a, j] += C[a, 1 + j] * turn
    power: float = ax * ax + ay * ay + az * az
    return power


@compiled
def clear_sums(sums: UpdateSums) -> None:
    """Clear the sums for the next update."""
    sums.time = sums.turn = sums.jump = 0.0
    for j in range(3):
        sums.force[j] = sums.velocity[j] = sums.position[j] = 0.0
    for a in range(2):
        sums.scale[a] = sums.askew[a, 0] = sums.askew[a, 1] = 0.0
        for j in range(3):
            sums.bias[a, j] = 0.0


@compiled
def move(s: BoundedRecord) -> None:
    """Move velocity and position to the end of the interval of the sums."""
    for j in range(3):
        s.pos[j] += s.vel[j] * s.sums.time + s.sums.position[j]
        s.vel[j] += s.sums.velocity[j]


@compiled
def turn_heading(s: BoundedRecord) -> None:
    """
    Apply P <- F P F' for the rotation of the level frame while the x gyro clips; call this before `move`.

    An error of the missing rate rotates the tool about its axis and thereby its heading. The heading is free and has no
    error state. Instead the level frame rotates relative to velocity and displacement of the circling sensor: velocity'
    = velocity - turn [down x mean velocity], and the same for the displacement.
    """
    T = s.sums.time
    vx, vy = s.vel[0] + s.sums.position[0] / T, s.vel[1] + s.sums.position[1] / T
    circle = (vx, vy, s.pos[0] + 0.5 * T * vx, s.pos[1] + 0.5 * T * vy)
    _turn_columns(s.P, T, s.C[2, 0], circle)
    _turn_columns(s.P.T, T, s.C[2, 0], circle)


@compiled
def _turn_columns(P: Array, T: float, upright: float, circle: tuple[float, float, float, float]) -> None:
    """
    Apply P <- F P for the rotation of the level frame over T, s.

    upright: vertical component of the tool axis; circle: mean velocity, m/s, and displacement, m, along level x and y.
    """
    vx, vy, x, y = circle
    for j in range(ERRORS):
        turn = upright * T * (P[MISSING, j] + 0.5 * T * P[SLOPE, j])
        P[VEL, j] += turn * vy
        P[VEL + 1, j] -= turn * vx
        P[POS, j] += turn * y
        P[POS + 1, j] -= turn * x


@compiled
def propagate(s: BoundedRecord, size: int) -> None:
    """
    Propagate the first `size` errors, P <- F P F', over the interval of the sums (equation (3)); the caller adds noise.

    P is exactly symmetric afterwards, so that rounding errors do not grow. size: STEADY, or ERRORS while the x gyro
    clips.

    tilt' = tilt - int(C) bias - int(C e_x w_x) scale - int(C e_yz w_x) askew;
    velocity' = velocity + [mean of both tilts x] force + T down;
    position' = position + T velocity + half a step of the change of velocity due to the first half of these terms.
    """
    P, sums = s.P, s.sums
    if size > STEADY:
        carry_columns(P, sums, ERRORS, True)
        carry_columns(P.T, sums, ERRORS, True)
        symmetrise(P, ERRORS)
        return
    carry_columns(P, sums, STEADY, False)
    # F changes only tilt, velocity and position, which come before BIAS. Their covariances with the other errors are
    # already F P, and the covariances of the other errors stay.
    for j in range(BIAS, STEADY):
        for m in range(BIAS):
            P[j, m] = P[m, j]
    # F P F' = (F (F P)')', and the covariance of tilt, velocity and position is symmetric.
    for j in range(1, BIAS):
        for m in range(j):
            P[j, m], P[m, j] = P[m, j], P[j, m]
    carry_columns(P, sums, BIAS, False)
    symmetrise(P, BIAS)


@specialised
def symmetrise(P: Array, size: int) -> None:
    """Make the first `size` rows of a covariance exactly symmetric."""
    for j in range(1, size):
        for m in range(j):
            P[m, j] = P[j, m]


@specialised
def carry_columns(P: Array, sums: UpdateSums, columns: int, clipped: bool) -> None:
    """
    Apply P <- F P to the first `columns` columns of P, which has STEADY or ERRORS rows.

    clipped: whether the x gyro clips; then F includes the errors MISSING and SLOPE.
    """
    T = sums.time
    h = 0.5 * T
    fx, fy, fz = 0.5 * sums.force[0], 0.5 * sums.force[1], 0.5 * sums.force[2]
    b, c = sums.bias, sums.scale
    b00, b01, b02, b10, b11, b12 = b[0, 0], b[0, 1], b[0, 2], b[1, 0], b[1, 1], b[1, 2]
    c0, c1 = c[0], c[1]
    k00, k01, k10, k11 = sums.askew[0, 0], sums.askew[0, 1], sums.askew[1, 0], sums.askew[1, 1]
    if not clipped:
        # The mean of vibration is zero, so use only gravity for the effect of a tilt over the interval.
        fx, fy, fz = 0.0, 0.0, -h * STANDARD_GRAVITY
    for j in range(columns):
        x, y = P[TILT, j], P[TILT + 1, j]
        nx = x - b00 * P[BIAS, j] - b01 * P[BIAS + 1, j] - b02 * P[BIAS + 2, j] - c0 * P[SCALE, j]
        nx -= k00 * P[ASKEW, j] + k01 * P[ASKEW + 1, j]
        ny = y - b10 * P[BIAS, j] - b11 * P[BIAS + 1, j] - b12 * P[BIAS + 2, j] - c1 * P[SCALE, j]
        ny -= k10 * P[ASKEW, j] + k11 * P[ASKEW + 1, j]
        if clipped:
            turned = P[MISSING, j] + h * P[SLOPE, j]
            nx += b00 * turned
            ny += b10 * turned
            P[MISSING, j] += T * P[SLOPE, j]
        down = T * P[DOWN, j]
        P[POS, j] += T * (P[VEL, j] + 0.5 * fz * y)
        P[POS + 1, j] += T * (P[VEL + 1, j] - 0.5 * fz * x)
        P[POS + 2, j] += T * (P[VEL + 2, j] + 0.5 * (fy * x - fx * y) + 0.25 * down)
        P[VEL, j] += fz * (y + ny)
        P[VEL + 1, j] -= fz * (x + nx)
        P[VEL + 2, j] += fy * (x + nx) - fx * (y + ny) + down
        P[TILT, j], P[TILT + 1, j] = nx, ny
