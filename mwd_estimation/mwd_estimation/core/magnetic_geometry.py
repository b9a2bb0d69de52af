# SPDX-License-Identifier: Apache-2.0
"""
Angles between gravity and the magnetic field, from one pair of readings in tool axes.

Source S0 (accelerometer and magnetometer attitude). The symbols of S0 mean, in the terms of this module: theta =
inclination - 90 deg, phi = toolface - 180 deg, G = -f_t, psi = magnetic azimuth.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.frames import wrap_tau


def dip(f_t: ArrayLike, b_t: ArrayLike) -> Array:
    """
    Return the angle of the field below the horizontal.

    f_t, b_t, shape (..., 3): specific force, m/s^2, and field, T, in the same axes. Returns shape (...), rad in
    [-pi/2, pi/2].
    """
    f_t, b_t = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
    f_x, f_y, f_z = f_t[..., 0], f_t[..., 1], f_t[..., 2]
    b_x, b_y, b_z = b_t[..., 0], b_t[..., 1], b_t[..., 2]
    across = np.sqrt((f_y * b_z - f_z * b_y) ** 2 + (f_z * b_x - f_x * b_z) ** 2 + (f_x * b_y - f_y * b_x) ** 2)
    return np.asarray(np.arctan2(-(f_x * b_x + f_y * b_y + f_z * b_z), across))


def raw_azimuth(f_t: ArrayLike, b_t: ArrayLike) -> Array:
    """
    Return the magnetic azimuth of the hole axis without any correction (S0 eq 10, with G = -f_t).

    f_t, b_t, shape (..., 3): specific force, m/s^2, and field, T, in tool axes. Returns shape (...), rad in [0, 2 pi).
    Undefined in a vertical hole and where the field is vertical.
    """
    g_t = -np.asarray(f_t, dtype=float)
    b_t = np.asarray(b_t, dtype=float)
    g_x, g_y, g_z = g_t[..., 0], g_t[..., 1], g_t[..., 2]
    b_x, b_y, b_z = b_t[..., 0], b_t[..., 1], b_t[..., 2]
    g = np.sqrt(g_x * g_x + g_y * g_y + g_z * g_z)
    east = g * (b_z * g_y - b_y * g_z)
    north = b_x * (g_y * g_y + g_z * g_z) - g_x * (b_y * g_y + b_z * g_z)
    return wrap_tau(np.arctan2(east, north))


@compiled
def raw_azimuth_sample(f_x: float, f_y: float, f_z: float, b_x: float, b_y: float, b_z: float) -> float:
    """Return the magnetic azimuth of one sample, rad in [0, 2 pi): `raw_azimuth` for compiled loops (S0 eq 10)."""
    g = math.sqrt(f_x * f_x + f_y * f_y + f_z * f_z)
    east = g * (b_y * f_z - b_z * f_y)
    north = b_x * (f_y * f_y + f_z * f_z) - f_x * (b_y * f_y + b_z * f_z)
    azimuth = math.atan2(east, north)
    return azimuth + 2.0 * math.pi if azimuth < 0.0 else azimuth


def angle_jacobian(f_t: ArrayLike, b_t: ArrayLike) -> Array:
    """
    Return the derivatives of (inclination, raw magnetic azimuth, gravity toolface) with respect to (f_t, b_t).

    f_t, b_t, shape (..., 3), m/s^2 and T. Returns shape (..., 3, 6), rad per m/s^2 and rad per T. The derivatives of
    azimuth and toolface grow as 1 / sin(inclination) towards the vertical. The field must not be vertical.
    """
    f_t, b_t = np.broadcast_arrays(np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float))
    g = np.linalg.norm(f_t, axis=-1)
    # Tilt an exactly vertical hole by 1e-7 rad, so that all slopes are large but finite.
    upright = np.hypot(f_t[..., 1], f_t[..., 2]) < 1e-7 * g
    f_t = np.where(upright[..., None], f_t + 1e-7 * g[..., None] * np.array([0.0, 0.0, 1.0]), f_t)
    down = -f_t / g[..., None]
    across = np.hypot(f_t[..., 1], f_t[..., 2])
    s, c = f_t[..., 1] / across, f_t[..., 2] / across
    jac = np.zeros((*g.shape, 3, 6))
    jac[..., 0, 0] = across / g**2
    jac[..., 0, 1] = -f_t[..., 0] * s / g**2
    jac[..., 0, 2] = -f_t[..., 0] * c / g**2
    jac[..., 2, 1] = c / across
    jac[..., 2, 2] = -s / across
    along = np.sum(b_t * down, axis=-1)
    east = down[..., 1] * b_t[..., 2] - down[..., 2] * b_t[..., 1]
    north = b_t[..., 0] - along * down[..., 0]
    east_b = np.stack([np.zeros_like(g), -down[..., 2], down[..., 1]], axis=-1)
    east_d = np.stack([np.zeros_like(g), b_t[..., 2], -b_t[..., 1]], axis=-1)
    axis = np.array([1.0, 0.0, 0.0])
    north_b = axis - down[..., :1] * down
    north_d = -b_t * down[..., :1] - along[..., None] * axis
    square = (north**2 + east**2)[..., None]
    azimuth_b = (north[..., None] * east_b - east[..., None] * north_b) / square
    azimuth_d = (north[..., None] * east_d - east[..., None] * north_d) / square
    # Scaling f does not change the direction of the vertical, so the component along f has no effect.
    azimuth_f = -(azimuth_d - np.sum(azimuth_d * down, axis=-1, keepdims=True) * down) / g[..., None]
    jac[..., 1, :3], jac[..., 1, 3:] = azimuth_f, azimuth_b
    return jac
