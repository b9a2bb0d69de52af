# SPDX-License-Identifier: Apache-2.0
"""Test signals of a dual-unit sonde that keeps still or turns: exact kinematics, then the errors named."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR, MICRO_G
from mwd_sensors.core.frames import mat_nt


@dataclasses.dataclass(frozen=True)
class Motion:
    """What an errorless sonde measures: stamps (n,), rates (n, 3), forces (n, 3), and its true attitude."""

    stamp_ns: NDArray[np.int64]
    gyro_t: Array
    accel_t: Array
    azimuth: Array
    inclination: Array


def motion(
    seconds: float,
    latitude: float,
    inclination: float | Callable[[Array], Array],
    azimuth: float | Callable[[Array], Array],
    roll: Callable[[Array], Array],
    rate: float = 100.0,
    lag: float = 0.0,
) -> Motion:
    """
    Rates strapdown-integrated over each interval and forces at its middle, with normal gravity at the latitude.

    Angles in rad, as numbers or functions of time, s. lag: delay of the cross-axis gyros, s.
    """

    def mats(t: Array) -> Array:
        inc = inclination(t) if callable(inclination) else np.full(len(t), inclination)
        azi = azimuth(t) if callable(azimuth) else np.full(len(t), azimuth)
        level = Rotation.from_matrix(mat_nt(inc, azi, roll(t)))
        return Rotation.from_rotvec(t[:, None] * earth.earth_rate_n(latitude)) * level, inc, azi  # type: ignore[return-value]

    def rates(t: Array) -> Array:
        turned = mats(t)[0]  # type: ignore[index]
        return (turned[:-1].inv() * turned[1:]).as_rotvec() * rate

    n = round(seconds * rate)
    t = np.arange(n + 1) / rate
    gyro = rates(t)
    if lag:
        gyro[:, 1:] = rates(t - lag)[:, 1:]
    middle = 0.5 * (t[1:] + t[:-1])
    inc = inclination(middle) if callable(inclination) else np.full(n, inclination)
    azi = azimuth(middle) if callable(azimuth) else np.full(n, azimuth)
    accel = -earth.gravity(latitude, 0.0) * mat_nt(inc, azi, roll(middle))[:, 2, :]
    end_inc = inclination(t[1:]) if callable(inclination) else inc
    end_azi = azimuth(t[1:]) if callable(azimuth) else azi
    return Motion(np.rint(t[1:] * 1e9).astype(np.int64) + 10**9, gyro, accel, end_azi, end_inc)


def measured(
    clean: Motion,
    rng: np.random.Generator,
    noise_deg_rth: float = 0.0,
    noise_x_deg_rth: float | None = None,
    accel_noise_ug: float = 0.0,
    bias: Array | None = None,
    accel_bias: Array | None = None,
    accel_scale: float = 0.0,
    scale_x: float = 0.0,
    leak: Array | None = None,
    g_sensitivity: Array | None = None,
) -> tuple[Array, Array]:
    """
    Rates and forces with errors: white noises, biases (rad/s, m/s^2), scales, x leakage (2,), g-sensitivity (2, 2).

    g_sensitivity: rad/s per m/s^2 of the y and z gyro to the y and z force.
    """
    n = len(clean.stamp_ns)
    rate = 1e9 / float(clean.stamp_ns[1] - clean.stamp_ns[0])
    white = rng.standard_normal((n, 3)) * math.sqrt(rate) * noise_deg_rth * DEG_PER_ROOT_HOUR
    if noise_x_deg_rth is not None:
        white[:, 0] = rng.standard_normal(n) * math.sqrt(rate) * noise_x_deg_rth * DEG_PER_ROOT_HOUR
    gyro = clean.gyro_t + white
    accel = (1.0 + accel_scale) * clean.accel_t + rng.standard_normal((n, 3)) * math.sqrt(
        rate
    ) * accel_noise_ug * MICRO_G
    if bias is not None:
        gyro += bias
    if accel_bias is not None:
        accel += accel_bias
    if leak is not None:
        gyro[:, 1:] += clean.gyro_t[:, :1] * leak
    if g_sensitivity is not None:
        gyro[:, 1:] += clean.accel_t[:, 1:] @ g_sensitivity.T
    gyro[:, 0] += scale_x * clean.gyro_t[:, 0]
    return gyro, accel


def still(t: Array) -> Array:
    """Toolface 0.4 rad at all times."""
    return np.full(np.shape(t), 0.4)


def steady(rpm: float) -> Callable[[Array], Array]:
    """Roll of a tool that turns at a steady speed."""
    return lambda t: 0.4 + rpm * math.tau / 60.0 * np.asarray(t)
