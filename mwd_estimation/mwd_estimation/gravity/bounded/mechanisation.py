"""
The bounded filter's Kalman mechanics: what it carries, how that moves, and how a position measures it.

Errors live in the level frame (attitude) and in the tool (sensors); the nominal values are carried sample by sample,
the covariance update by update over sums. Derivation: ``docs/gravity_bounded.md``.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Error states: tilt (level x, y), velocity, position (level), gyro bias (tool), scale of the x gyro, lever arm (tool),
# vertical acceleration error, and while the x gyro clips: missing rate, its slope.
TILT, VEL, POS, BIAS, SCALE, LEVER, DOWN, MISSING, SLOPE, ERRORS = 0, 2, 5, 8, 11, 12, 15, 16, 17, 18
STEADY = 16  # errors that are always carried
# Nominal values: quaternion tool to level (x, y, z, w), then as the errors.
Q, N_VEL, N_POS, N_BIAS, N_SCALE, N_LEVER, N_DOWN, N_MISSING, N_SLOPE, NOMINAL = (
    0, 4, 7, 10, 13, 14, 17, 18, 19, 20
)  # fmt: skip
# Sums over the samples since the last update: time, columns of the transition, noise.
S_TIME, S_BIAS, S_SCALE, S_FORCE, S_TURN, S_JUMP, SUMS = 0, 1, 7, 9, 12, 13, 14
JUMP_TIME = 0.06  # s, a velocity lost in a shock shows in the position after about that long


@compiled
def rotation(x: Array, C: Array) -> None:
    """Matrix C, tool to level, of the quaternion in the nominal values."""
    a, b, c, d = x[Q], x[Q + 1], x[Q + 2], x[Q + 3]
    C[0, 0], C[0, 1], C[0, 2] = 1 - 2 * (b * b + c * c), 2 * (a * b - c * d), 2 * (a * c + b * d)
    C[1, 0], C[1, 1], C[1, 2] = 2 * (a * b + c * d), 1 - 2 * (a * a + c * c), 2 * (b * c - a * d)
    C[2, 0], C[2, 1], C[2, 2] = 2 * (a * c - b * d), 2 * (b * c + a * d), 1 - 2 * (a * a + b * b)


@compiled
def mechanise(
    x: Array, s: Array, C: Array, gravity: float, dt: float,
    wx: float, wy: float, wz: float, nx: float, ny: float, nz: float, fx: float, fy: float, fz: float,
) -> tuple[float, float, float]:  # fmt: skip
    """
    Carry the nominal values and the sums by one sample; returns the acceleration in the level frame, m/s^2.

    w: measured rate, rad/s; n: rotation vector to add to w dt (coning, half-sample shift), rad; f: measured force.
    The force is taken to be in the axes at the end of the interval.
    """
    scaled = wx - x[N_BIAS]
    wx = scaled * (1.0 - x[N_SCALE]) + x[N_MISSING]
    wy -= x[N_BIAS + 1]
    wz -= x[N_BIAS + 2]
    px, py, pz = wx * dt + nx, wy * dt + ny, wz * dt + nz
    angle2 = px * px + py * py + pz * pz
    if angle2 < 1e-4:
        c = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
        h = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0
    else:
        angle = math.sqrt(angle2)
        c = math.cos(0.5 * angle)
        h = math.sin(0.5 * angle) / angle
    px, py, pz = h * px, h * py, h * pz
    qx, qy, qz, qw = x[Q], x[Q + 1], x[Q + 2], x[Q + 3]
    ax = qw * px + qx * c + qy * pz - qz * py
    ay = qw * py - qx * pz + qy * c + qz * px
    az = qw * pz + qx * py - qy * px + qz * c
    aw = qw * c - qx * px - qy * py - qz * pz
    # One Newton step holds the unit norm: the product of two unit quaternions is off by rounding only.
    unit = 1.5 - 0.5 * (ax * ax + ay * ay + az * az + aw * aw)
    x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = unit * ax, unit * ay, unit * az, unit * aw
    rotation(x, C)
    ux = C[0, 0] * fx + C[0, 1] * fy + C[0, 2] * fz
    uy = C[1, 0] * fx + C[1, 1] * fy + C[1, 2] * fz
    uz = C[2, 0] * fx + C[2, 1] * fy + C[2, 2] * fz
    ax, ay, az = ux, uy, uz + gravity + x[N_DOWN]
    for j in range(3):
        a = ax if j == 0 else (ay if j == 1 else az)
        x[N_POS + j] += (x[N_VEL + j] + 0.5 * a * dt) * dt
        x[N_VEL + j] += a * dt
    for a_ in range(2):
        for j in range(3):
            s[S_BIAS + 3 * a_ + j] += C[a_, j] * dt
        s[S_SCALE + a_] += C[a_, 0] * scaled * dt
    s[S_FORCE] += ux * dt
    s[S_FORCE + 1] += uy * dt
    s[S_FORCE + 2] += uz * dt
    s[S_TIME] += dt
    return ax, ay, az


@compiled
def propagate(P: Array, s: Array, size: int) -> None:
    """
    P <- F P F' over the sums since the last update; noise is added by the caller.

    F in three exact shears: half of the position and velocity rows, the tilt rows, the other half, so that a tilt that
    grows within the interval acts with its mean.
    """
    T = s[S_TIME]
    h = 0.5 * T
    fx, fy, fz = 0.5 * s[S_FORCE], 0.5 * s[S_FORCE + 1], 0.5 * s[S_FORCE + 2]
    b00, b01, b02 = s[S_BIAS], s[S_BIAS + 1], s[S_BIAS + 2]
    b10, b11, b12 = s[S_BIAS + 3], s[S_BIAS + 4], s[S_BIAS + 5]
    c0, c1 = s[S_SCALE], s[S_SCALE + 1]
    clipped = size == ERRORS
    for half in range(2):
        for j in range(size):
            for a in range(3):
                P[POS + a, j] += h * P[VEL + a, j]
            P[VEL, j] += fz * P[TILT + 1, j]
            P[VEL + 1, j] += -fz * P[TILT, j]
            P[VEL + 2, j] += fy * P[TILT, j] - fx * P[TILT + 1, j] + h * P[DOWN, j]
        for j in range(size):
            for a in range(3):
                P[j, POS + a] += h * P[j, VEL + a]
            P[j, VEL] += fz * P[j, TILT + 1]
            P[j, VEL + 1] += -fz * P[j, TILT]
            P[j, VEL + 2] += fy * P[j, TILT] - fx * P[j, TILT + 1] + h * P[j, DOWN]
        if half == 0:
            for j in range(size):
                P[TILT, j] -= b00 * P[BIAS, j] + b01 * P[BIAS + 1, j] + b02 * P[BIAS + 2, j] + c0 * P[SCALE, j]
                P[TILT + 1, j] -= b10 * P[BIAS, j] + b11 * P[BIAS + 1, j] + b12 * P[BIAS + 2, j] + c1 * P[SCALE, j]
                if clipped:
                    P[TILT, j] += b00 * (P[MISSING, j] + h * P[SLOPE, j])
                    P[TILT + 1, j] += b10 * (P[MISSING, j] + h * P[SLOPE, j])
                    P[MISSING, j] += T * P[SLOPE, j]
            for j in range(size):
                P[j, TILT] -= b00 * P[j, BIAS] + b01 * P[j, BIAS + 1] + b02 * P[j, BIAS + 2] + c0 * P[j, SCALE]
                P[j, TILT + 1] -= b10 * P[j, BIAS] + b11 * P[j, BIAS + 1] + b12 * P[j, BIAS + 2] + c1 * P[j, SCALE]
                if clipped:
                    P[j, TILT] += b00 * (P[j, MISSING] + h * P[j, SLOPE])
                    P[j, TILT + 1] += b10 * (P[j, MISSING] + h * P[j, SLOPE])
                    P[j, MISSING] += T * P[j, SLOPE]


@compiled
def measurement(x: Array, C: Array, axis: int, h: Array) -> float:
    """
    Innovation of "the point is at zero" along a tool axis, m, and its row h on (tilt x, tilt y, position x, y, z).

    The row has one more entry, -1 on the lever arm along that axis.
    """
    # Tilt enters through the axis the position is measured along, times the position there truly is: the lever arm, not
    # the position as it is carried, whose noise would count as knowledge of the tilt.
    if axis == 0:
        lx, ly, lz = 0.0, -x[N_LEVER + 2], x[N_LEVER + 1]
    elif axis == 1:
        lx, ly, lz = x[N_LEVER + 2], 0.0, -x[N_LEVER]
    else:
        lx, ly, lz = -x[N_LEVER + 1], x[N_LEVER], 0.0
    h[0] = C[0, 0] * lx + C[0, 1] * ly + C[0, 2] * lz
    h[1] = C[1, 0] * lx + C[1, 1] * ly + C[1, 2] * lz
    ux, uy, uz = C[0, axis], C[1, axis], C[2, axis]
    dx, dy, dz = x[N_POS], x[N_POS + 1], x[N_POS + 2]
    h[2], h[3], h[4] = ux, uy, uz
    along: float = x[N_LEVER + axis] - (ux * dx + uy * dy + uz * dz)
    return along


@compiled
def update(
    x: Array, P: Array, C: Array, size: int, r_axis: float, r_cross: float, e: Array, gate: float
) -> tuple[float, float, float, float]:
    """
    Three scalar updates along the tool axes; returns the whitened innovation (level x, y, down) and its mean square.

    An innovation whose square is more than `gate` times its variance is taken for a velocity lost meanwhile: velocity
    and position along that axis become as uncertain as it is large, so that tilt hardly answers to it.
    """
    h = np.empty(5)
    PH = np.empty(ERRORS)
    for j in range(size):
        e[j] = 0.0
    i0, i1, i2, square = 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        y = measurement(x, C, axis, h)
        for j in range(size):
            PH[j] = (
                h[0] * P[j, TILT] + h[1] * P[j, TILT + 1]
                + h[2] * P[j, POS] + h[3] * P[j, POS + 1] + h[4] * P[j, POS + 2] - P[j, LEVER + axis]
            )  # fmt: skip
        S = (
            (r_axis if axis == 0 else r_cross)
            + h[0] * PH[TILT] + h[1] * PH[TILT + 1]
            + h[2] * PH[POS] + h[3] * PH[POS + 1] + h[4] * PH[POS + 2] - PH[LEVER + axis]
        )  # fmt: skip
        y -= (
            h[0] * e[TILT] + h[1] * e[TILT + 1]
            + h[2] * e[POS] + h[3] * e[POS + 1] + h[4] * e[POS + 2] - e[LEVER + axis]
        )  # fmt: skip
        if y * y > gate * S:
            speed = y / JUMP_TIME
            for j in range(3):
                for m in range(3):
                    both = C[j, axis] * C[m, axis]
                    P[POS + j, POS + m] += y * y * both
                    P[POS + j, VEL + m] += y * speed * both
                    P[VEL + j, POS + m] += y * speed * both
                    P[VEL + j, VEL + m] += speed * speed * both
                PH[POS + j] += y * y * C[j, axis]
                PH[VEL + j] += y * speed * C[j, axis]
            S += y * y
        white = y / math.sqrt(S)
        i0 += C[0, axis] * white
        i1 += C[1, axis] * white
        i2 += C[2, axis] * white
        square += white * white / 3.0
        inverse = 1.0 / S
        for j in range(size):
            gain = PH[j] * inverse
            e[j] += gain * y
            for m in range(j + 1):
                P[j, m] -= gain * PH[m]
        for j in range(size):
            for m in range(j):
                P[m, j] = P[j, m]
    # What a clipped gyro missed was about the tool axis: the heading, which is free, turns with it.
    yaw = 0.0
    if size == ERRORS:
        yaw = (e[TILT] * C[0, 0] + e[TILT + 1] * C[1, 0]) * C[2, 0] / max(C[0, 0] ** 2 + C[1, 0] ** 2, 0.01)
    correct(x, e, size, yaw)
    return i0, i1, i2, square


@compiled
def correct(x: Array, e: Array, size: int, yaw: float) -> None:
    """Put the errors e into the nominal values: exp(tilt and change of heading) from the left, the rest by adding."""
    a, b, c = 0.5 * e[TILT], 0.5 * e[TILT + 1], 0.5 * yaw
    qx, qy, qz, qw = x[Q], x[Q + 1], x[Q + 2], x[Q + 3]
    ax = qx + a * qw + b * qz - c * qy
    ay = qy + b * qw + c * qx - a * qz
    az = qz + c * qw + a * qy - b * qx
    aw = qw - a * qx - b * qy - c * qz
    unit = 1.0 / math.sqrt(ax * ax + ay * ay + az * az + aw * aw)
    x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = unit * ax, unit * ay, unit * az, unit * aw
    for j in range(VEL, size):
        x[N_VEL + j - VEL] += e[j]


@compiled
def sound(x: Array, P: Array) -> bool:
    """True while variances are positive and all is finite."""
    total = 0.0
    for j in range(NOMINAL):
        total += x[j]
    least = 0.0
    for j in range(ERRORS):
        total += P[j, j]
        least = min(least, P[j, j])
    return math.isfinite(total) and least >= 0.0
