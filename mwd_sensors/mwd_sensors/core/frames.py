# SPDX-License-Identifier: Apache-2.0
"""
Frames, angles and rotations. Signs change between conventions in this file only.

Frames and their letters (the name of a vector ends in the letter of its frame, the name of a matrix in two letters):

- ``t`` tool: x down-hole along the axis, z along the scribe line (bend), y completes the right-handed frame.
- ``n`` local level: north, east, down.
- ``e`` local level for ROS (REP-103): east, north, up.

``mat_nt @ v_t`` is in ``n``. Quaternions are Hamilton, scalar last (x, y, z, w), and rotate tool to level.
Inclination is from the vertical, azimuth clockwise from north. The toolface of the scribe line is clockwise looking
down-hole, from the high side (gravity toolface) or from north (magnetic toolface). All angles are in rad.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

TAU = 2.0 * np.pi
# Rotation from north-east-down to east-north-up; the matrix is its own inverse.
MAT_EN: Array = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def wrap_pi(angle: ArrayLike) -> Array:
    """Wrap angles, rad, to [-pi, pi)."""
    return np.asarray((np.asarray(angle, dtype=float) + np.pi) % TAU - np.pi)


def wrap_tau(angle: ArrayLike) -> Array:
    """Wrap angles, rad, to [0, 2 pi)."""
    turned = np.asarray(np.asarray(angle, dtype=float) % TAU)
    # A tiny negative angle rounds up to the modulus itself.
    return np.where(turned >= TAU, 0.0, turned)


def inclination(f_t: ArrayLike) -> Array:
    """
    Return the angle between the hole axis and the vertical from the specific force alone.

    f_t, shape (..., 3): specific force in tool axes, m/s^2 (up at rest). Returns shape (...), rad in [0, pi].
    """
    f_t = np.asarray(f_t, dtype=float)
    # arctan2, not arccos: arccos loses half the digits near vertical.
    return np.asarray(np.arctan2(np.hypot(f_t[..., 1], f_t[..., 2]), -f_t[..., 0]))


def gravity_toolface(f_t: ArrayLike) -> Array:
    """
    Return the angle from the high side to the scribe line, clockwise looking down-hole.

    f_t, shape (..., 3): specific force in tool axes, m/s^2 (up at rest). Returns shape (...), rad in [0, 2 pi).
    The angle has no meaning in a vertical hole, where the cross-axis force is noise: use `magnetic_toolface` there.
    """
    f_t = np.asarray(f_t, dtype=float)
    return wrap_tau(np.arctan2(f_t[..., 1], f_t[..., 2]))


def mat_nt(inclination: ArrayLike, azimuth: ArrayLike, toolface: ArrayLike) -> Array:
    """
    Return the rotation from tool axes to north-east-down.

    Parameters
    ----------
    inclination, azimuth, toolface : array_like, broadcast to shape (...)
        Inclination from the vertical, azimuth from north, toolface from the high side to the scribe line; rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        The rotation: the transpose of S0 eq (2) (docs/references.md) with theta = inclination - 90 deg and phi =
        toolface - 180 deg.
    """
    inc, azi, tf = np.broadcast_arrays(
        np.asarray(inclination, dtype=float), np.asarray(azimuth, dtype=float), np.asarray(toolface, dtype=float)
    )
    s_i, c_i, s_a, c_a, s_t, c_t = np.sin(inc), np.cos(inc), np.sin(azi), np.cos(azi), np.sin(tf), np.cos(tf)
    # The cross axes are the high side and the right side (axis x high side), turned together by the toolface.
    axis = np.stack([s_i * c_a, s_i * s_a, c_i], axis=-1)
    high = np.stack([c_i * c_a, c_i * s_a, -s_i], axis=-1)
    right = np.stack([-s_a, c_a, np.zeros_like(inc)], axis=-1)
    c_t, s_t = c_t[..., None], s_t[..., None]
    return np.stack([axis, s_t * high - c_t * right, c_t * high + s_t * right], axis=-1)


def hole_angles(mat_nt: ArrayLike) -> tuple[Array, Array, Array]:
    """
    Return inclination, azimuth and gravity toolface of a tool-to-NED rotation; the inverse of `mat_nt`.

    mat_nt has shape (..., 3, 3). Returns three arrays of shape (...), rad in [0, pi], [0, 2 pi), [0, 2 pi). In an
    exactly vertical hole azimuth is 0 and toolface is the angle from north, so that `mat_nt` of the three angles still
    reproduces the rotation.
    """
    mat = np.asarray(mat_nt, dtype=float)
    across = np.hypot(mat[..., 0, 0], mat[..., 1, 0])
    inc = np.arctan2(across, mat[..., 2, 0])
    vertical = across < 1e-15
    azi = np.where(vertical, 0.0, np.arctan2(mat[..., 1, 0], mat[..., 0, 0]))
    # At azimuth 0 the right side is east. The high side is north in a hole going down and south in a hole going up.
    tf_vertical = np.arctan2(mat[..., 1, 2], np.copysign(1.0, mat[..., 2, 0]) * mat[..., 0, 2])
    tf = np.where(vertical, tf_vertical, np.arctan2(-mat[..., 2, 1], -mat[..., 2, 2]))
    return np.asarray(inc), wrap_tau(azi), wrap_tau(tf)


def magnetic_toolface(mat_nt: ArrayLike) -> Array:
    """
    Return the angle from north to the scribe line, both projected on the horizontal plane, clockwise from above.

    mat_nt, shape (..., 3, 3), rotates tool axes to NED. Returns shape (...), rad in [0, 2 pi). For near-vertical holes.
    """
    mat = np.asarray(mat_nt, dtype=float)
    return wrap_tau(np.arctan2(mat[..., 1, 2], mat[..., 0, 2]))


def quat_from_rotvec(rotvec: ArrayLike) -> Array:
    """Return the quaternion (x, y, z, w), shape (..., 4), of a rotation vector, rad, shape (..., 3); exact at zero."""
    rotvec = np.asarray(rotvec, dtype=float)
    half = 0.5 * np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * rotvec, np.cos(half)], axis=-1)


def quat_multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Return the Hamilton product of quaternions (x, y, z, w), shape (..., 4), which applies q first, then p."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    pv, pw, qv, qw = p[..., :3], p[..., 3:], q[..., :3], q[..., 3:]
    vector = pw * qv + qw * pv + np.cross(pv, qv)
    return np.concatenate([vector, pw * qw - np.sum(pv * qv, axis=-1, keepdims=True)], axis=-1)


def mat_from_quat(q: ArrayLike) -> Array:
    """Return the rotation matrix, shape (..., 3, 3), of a unit quaternion (x, y, z, w), shape (..., 4)."""
    q = np.asarray(q, dtype=float)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quat_from_mat(mat: ArrayLike) -> Array:
    """
    Return the unit quaternion (x, y, z, w), shape (..., 4), w >= 0, of a rotation matrix, shape (..., 3, 3).

    The largest of the four components is computed first (Shepperd's method), so that no angle loses digits.
    """
    mat = np.ascontiguousarray(mat, dtype=float)
    q = np.empty((*mat.shape[:-2], 4))
    _quaternions(mat.reshape(-1, 3, 3), q.reshape(-1, 4))
    return q


@compiled
def _quaternions(mats: Array, out: Array) -> None:
    """Fill out, shape (n, 4), with the quaternions of rotation matrices, shape (n, 3, 3)."""
    # Four times the products of the quaternion's components: row k is 4 q_k * q.
    products = np.empty((4, 4))
    for n in range(len(mats)):
        mat, q = mats[n], out[n]
        trace = mat[0, 0] + mat[1, 1] + mat[2, 2]
        products[3, 3] = 1.0 + trace
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            products[i, i] = 1.0 + 2.0 * mat[i, i] - trace
            products[i, j] = products[j, i] = mat[i, j] + mat[j, i]
            products[k, 3] = products[3, k] = mat[j, i] - mat[i, j]
        best = 0
        for k in range(1, 4):
            if products[k, k] > products[best, best]:
                best = k
        q[:] = products[best]
        norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        q /= -norm if q[3] < 0.0 else norm


def orientation_et(mat_nt: ArrayLike) -> Array:
    """Return the tool-to-east-north-up quaternion (x, y, z, w; REP-103) of a tool-to-NED matrix, shape (..., 3, 3)."""
    return quat_from_mat(MAT_EN @ np.asarray(mat_nt, dtype=float))
