# SPDX-License-Identifier: Apache-2.0
"""
Small compiled steps that the Kalman filters of this project share: covariances, scalar updates, rotations.

Matrices are two-dimensional arrays that a step changes in place; sizes come from the arrays. Covariances are stored
in full (both triangles) and stay exactly symmetric. A rotation vector is axis times angle, rad. Loops are explicit,
because numba computes small matrix products faster that way than with ``@``.
"""

from __future__ import annotations

import math

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Ratios of successive terms in the power series of sin(a) / a and of (1 - cos(a)) / a^2, without sign and a^2.
_S1, _S2, _S3, _S4 = 1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0
_C1, _C2, _C3, _C4 = 1.0 / 24.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0


@compiled
def propagate_covariance(P: Array, phi: Array, work: Array) -> None:
    """
    Propagate a covariance, P <- Phi P Phi', where Phi is the identity matrix except for its first rows.

    Parameters
    ----------
    P : ndarray, shape (n, n)
        Covariance, symmetric; it is exactly symmetric afterwards. The caller adds the process noise.
    phi : ndarray, shape (m, n)
        First m rows of Phi, m <= n; zero elements are skipped.
    work : ndarray, shape (m, n)
        Scratch space.
    """
    moving, states = phi.shape
    for i in range(moving):
        for j in range(states):
            work[i, j] = 0.0
        for m in range(states):
            c = phi[i, m]
            if c != 0.0:
                for j in range(states):
                    work[i, j] += c * P[m, j]
    for i in range(moving):
        for j in range(moving, states):
            P[i, j] = work[i, j]
            P[j, i] = work[i, j]
        for j in range(i + 1):
            total = 0.0
            for m in range(states):
                c = phi[j, m]
                if c != 0.0:
                    total += work[i, m] * c
            P[i, j] = total
            P[j, i] = total


@compiled
def project_covariance(P: Array, h: Array, ph: Array) -> float:
    """
    Return the variance h P h' of a scalar measurement h . x due to the states, and fill ph, shape (n,), with P h'.

    P, shape (n, n), is the covariance. h, shape (n,), is the row of the measurement; zero elements are skipped.
    """
    states = len(h)
    for i in range(states):
        ph[i] = 0.0
    for j in range(states):
        c = h[j]
        if c != 0.0:
            for i in range(states):
                ph[i] += P[i, j] * c
    variance = 0.0
    for j in range(states):
        variance += h[j] * ph[j]
    return variance


@compiled
def scalar_update(P: Array, x: Array, ph: Array, variance: float, innovation: float) -> None:
    """
    Update states and covariance with one scalar measurement, in place; the gain is ph / variance.

    Parameters
    ----------
    P : ndarray, shape (n, n)
        Covariance of the states.
    x : ndarray, shape (n,)
        States, or the accumulated error of an error-state filter.
    ph : ndarray, shape (n,)
        Covariance of states and measurement, P h' (`project_covariance`).
    variance : float
        Variance of the innovation: h P h' plus the variance of the measurement noise.
    innovation : float
        Measured minus predicted value.
    """
    for i in range(len(x)):
        x[i] += ph[i] / variance * innovation
        for j in range(i + 1):
            P[i, j] -= ph[i] * ph[j] / variance
            P[j, i] = P[i, j]


@compiled
def reset_state(P: Array, i: int, variance: float) -> None:
    """Make state i independent of the other states and set its variance, in the covariance P, shape (n, n)."""
    for j in range(P.shape[0]):
        P[i, j] = 0.0
        P[j, i] = 0.0
    P[i, i] = variance


@compiled
def wrap_angle(angle: float) -> float:
    """Wrap an angle, rad, to [-pi, pi): `mwd_sensors.core.frames.wrap_pi` for a scalar in a kernel."""
    wrapped: float = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return wrapped


@compiled
def rotate_left(mat: Array, vx: float, vy: float, vz: float) -> None:
    """Rotate mat <- exp([v x]) mat, shape (3, 3); v is a rotation vector in the axes that mat transforms to."""
    e = _rotation(vx, vy, vz)
    for i in range(3):
        m0, m1, m2 = mat[0, i], mat[1, i], mat[2, i]
        mat[0, i] = e[0] * m0 + e[1] * m1 + e[2] * m2
        mat[1, i] = e[3] * m0 + e[4] * m1 + e[5] * m2
        mat[2, i] = e[6] * m0 + e[7] * m1 + e[8] * m2


@compiled
def rotate_right(mat: Array, vx: float, vy: float, vz: float) -> None:
    """Rotate mat <- mat exp([v x]), shape (3, 3): turn a tool-to-level matrix by the tool's rotation v in tool axes."""
    e = _rotation(vx, vy, vz)
    for i in range(3):
        m0, m1, m2 = mat[i, 0], mat[i, 1], mat[i, 2]
        mat[i, 0] = m0 * e[0] + m1 * e[3] + m2 * e[6]
        mat[i, 1] = m0 * e[1] + m1 * e[4] + m2 * e[7]
        mat[i, 2] = m0 * e[2] + m1 * e[5] + m2 * e[8]


@compiled
def _rotation(vx: float, vy: float, vz: float) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the elements of the rotation matrix exp([v x]) of a rotation vector v, row by row (Rodrigues' formula)."""
    angle2 = vx * vx + vy * vy + vz * vz
    angle = math.sqrt(angle2)
    if angle > 1e-4:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    else:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    return (
        1.0 - b * (vy * vy + vz * vz),
        b * vx * vy - a * vz,
        b * vx * vz + a * vy,
        b * vx * vy + a * vz,
        1.0 - b * (vx * vx + vz * vz),
        b * vy * vz - a * vx,
        b * vx * vz - a * vy,
        b * vy * vz + a * vx,
        1.0 - b * (vx * vx + vy * vy),
    )


@compiled
def in_turned_axes(gx: float, gy: float, gz: float, px: float, py: float, pz: float) -> tuple[float, float, float]:
    """
    Return a vector g, fixed in space, in axes that were turned by the rotation vector p: exp(-[p x]) g.

    Exact (Rodrigues' formula).
    """
    angle2 = px * px + py * py + pz * pz
    if angle2 < 0.01:
        # Power series; the first omitted term is below 1e-17. Faster than sine and cosine, and without cancellation.
        s = 1.0 - angle2 * _S1 * (1.0 - angle2 * _S2 * (1.0 - angle2 * _S3 * (1.0 - angle2 * _S4)))
        c = 0.5 - angle2 * _C1 * (1.0 - angle2 * _C2 * (1.0 - angle2 * _C3 * (1.0 - angle2 * _C4)))
    else:
        angle = math.sqrt(angle2)
        s = math.sin(angle) / angle
        c = (1.0 - math.cos(angle)) / angle2
    ax = gy * pz - gz * py
    ay = gz * px - gx * pz
    az = gx * py - gy * px
    return (
        gx + s * ax + c * (ay * pz - az * py),
        gy + s * ay + c * (az * px - ax * pz),
        gz + s * az + c * (ax * py - ay * px),
    )


@compiled
def coning_rotation(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, share: float
) -> tuple[float, float, float]:
    """
    Return the rotation vector of a sample, rad, with coning correction: b + share/12 a x b (S3 eq 5).

    b is the rotation during this sample (rate times dt), rad, and a the rotation during the previous sample. share is 1
    for mean rates and 0 if the sensor already integrates its rates (strapdown).
    """
    c = share / 12.0
    return bx + c * (ay * bz - az * by), by + c * (az * bx - ax * bz), bz + c * (ax * by - ay * bx)


@compiled
def level_matrix(down: Array, forward: Array, shortest: float, mat: Array) -> None:
    """
    Fill mat with the rotation to a level frame: third axis `down`, first axis the horizontal part of `forward` (TRIAD).

    Parameters
    ----------
    down, forward : ndarray, shape (3,)
        Vectors of any length, in the axes that the matrix transforms from.
    shortest : float
        If the horizontal part of `forward` is shorter than this, its direction is noise and any horizontal axis is
        used.
    mat : ndarray, shape (3, 3)
        Output; its rows are the level axes.
    """
    dx, dy, dz = down[0], down[1], down[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    along = forward[0] * dx + forward[1] * dy + forward[2] * dz
    nx, ny, nz = forward[0] - along * dx, forward[1] - along * dy, forward[2] - along * dz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < shortest:
        nx, ny, nz = (0.0, dz, -dy) if abs(dx) < 0.9 else (-dz, 0.0, dx)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    mat[0, 0], mat[0, 1], mat[0, 2] = nx, ny, nz
    mat[1, 0], mat[1, 1], mat[1, 2] = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    mat[2, 0], mat[2, 1], mat[2, 2] = dx, dy, dz
