"""
S1: true north from the Earth's rotation with a 15-state error-state Kalman filter and a tool that has not moved.

Position, velocity, attitude, gyro bias and accelerometer bias; strapdown mechanisation in north-east-down with the
Earth rate of a known latitude; the only measurement is z = [I6 0] x: position and velocity are still zero (S1 section
2.2). A coarse alignment on the mean rate and force starts it. Derivation, what is observable and limits:
``docs/methods/gyrocompass.md``; the estimator that does better with the same data: `mwd_estimation.gyrocompass.seek`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import samples as track
from mwd_estimation.core.status import Status
from mwd_estimation.gyrocompass.static_filter import ROW, STATE, WORK, KernelParams, Row, State, advance
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import hole_angles, wrap_tau
from mwd_sensors.core.settings import setting

# Geodetic latitude above which the Earth's rotation has no usable horizontal part.
MAX_LATITUDE_DEG = 85.0


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the S1 filter. Noise figures are one sigma and belong to the precision unit."""

    latitude_deg: float = setting(34.0, "Geodetic latitude, north positive.", unit="deg", low=-90.0, high=90.0)
    gravity: float = setting(STANDARD_GRAVITY, "Magnitude of local gravity.", unit="m/s^2", low=9.0, high=10.5)
    coarse_seconds: float = setting(20.0, "Duration of the mean that starts the filter.", unit="s", low=0.1, high=600.0)
    gyro_noise_deg_rth: float = setting(0.05, "White noise of the gyros.", unit="deg/sqrt(h)", low=1e-5, high=10.0)
    accel_noise_ug_rthz: float = setting(
        30.0, "White noise of the accelerometers.", unit="ug/sqrt(Hz)", low=0.01, high=1e4
    )
    gyro_bias_deg_h: float = setting(
        0.1,
        "Sigma of the gyro bias after calibration; it stays in the azimuth's sigma.",
        unit="deg/h",
        low=0.0,
        high=1e5,
    )
    accel_bias_ug: float = setting(
        100.0, "Sigma of the accelerometer bias after calibration.", unit="ug", low=0.0, high=1e5
    )
    gyro_walk_deg_h_rth: float = setting(
        0.0, "Random walk of the gyro bias in an hour.", unit="deg/h", low=0.0, high=1e4
    )
    accel_walk_ug_rth: float = setting(
        0.0, "Random walk of the accelerometer bias in an hour.", unit="ug", low=0.0, high=1e5
    )
    sigma_position: float = setting(
        0.001, "Sigma of the tool's position about the place where it rests.", unit="m", low=1e-6, high=10.0
    )
    sigma_velocity: float = setting(0.001, "Sigma of the tool's velocity.", unit="m/s", low=1e-6, high=10.0)
    gap: float = setting(0.5, "A longer data gap starts the filter anew.", unit="s", low=0.01, high=60.0)
    moved_ratio: float = setting(5.0, "Mean innovation ratio above which the tool has moved.", low=1.0, high=1e3)


@dataclasses.dataclass(frozen=True)
class North:
    """
    Attitude from true north, sample by sample.

    Attributes
    ----------
    azimuth, inclination, toolface : ndarray, shape (n,)
        Rad; NaN until the coarse alignment is done.
    sigma_azimuth, sigma_inclination : ndarray, shape (n,)
        One sigma, rad, at most pi.
    ratio : ndarray, shape (n,)
        Mean normalised innovation squared of the zero-motion measurement; 1 when the tool keeps as still as stated.
    status : ndarray of uint32, shape (n,)
        Bits of `mwd_estimation.core.status.Status`; STILL is absent where `ratio` shows that the tool has moved.
    """

    azimuth: Array
    inclination: Array
    toolface: Array
    sigma_azimuth: Array
    sigma_inclination: Array
    ratio: Array
    status: NDArray[np.uint32]


def initial(params: Params) -> State:
    """
    State before the first sample.

    Raises
    ------
    ValueError
        A latitude above 85 deg, where the Earth's rotation has no usable horizontal part.
    """
    if abs(params.latitude_deg) > MAX_LATITUDE_DEG:
        raise ValueError(
            f"latitude_deg: {params.latitude_deg:g} deg is too near the pole: the Earth's rotation points along the "
            f"vertical there and a gyro cannot find north above {MAX_LATITUDE_DEG:g} deg"
        )
    return cast(State, np.zeros(1, STATE)[0])


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> North:
    """
    Seek north through a block of samples of a tool that keeps still.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, of the precision unit in tool axes.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    out = np.zeros(len(stamps), ROW)
    advance(kernel_params(params), state, np.zeros(1, WORK)[0], stamps, gyro, accel, cast(Sequence[Row], out))
    inclination, azimuth, toolface = hole_angles(out["mat"])
    unknown = (out["status"] & Status.INITIALISING) != 0
    for angle in (inclination, azimuth, toolface):
        angle[unknown] = np.nan
    return North(
        wrap_tau(azimuth),
        inclination,
        toolface,
        out["sigma_azimuth"].copy(),
        out["sigma_inclination"].copy(),
        out["ratio"].copy(),
        out["status"].astype(np.uint32),
    )


def kernel_params(params: Params) -> KernelParams:
    """Parameters in SI."""
    latitude = math.radians(params.latitude_deg)
    return KernelParams(
        gap_ns=round(params.gap * 1e9),
        north=EARTH_RATE * math.cos(latitude),
        down=-EARTH_RATE * math.sin(latitude),
        gravity=params.gravity,
        coarse_seconds=params.coarse_seconds,
        gyro_noise=params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR,
        accel_noise=params.accel_noise_ug_rthz * MICRO_G,
        gyro_walk=params.gyro_walk_deg_h_rth * DEG_PER_HOUR / 60.0,
        accel_walk=params.accel_walk_ug_rth * MICRO_G / 60.0,
        gyro_bias=params.gyro_bias_deg_h * DEG_PER_HOUR,
        accel_bias=params.accel_bias_ug * MICRO_G,
        sigma_position=params.sigma_position,
        sigma_velocity=params.sigma_velocity,
        moved_ratio=params.moved_ratio,
    )
