# SPDX-License-Identifier: Apache-2.0
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

from mwd_estimation.core import track
from mwd_estimation.core.status import Status
from mwd_estimation.gyrocompass.static_filter import ROW, STATE, WORK, KernelParams, Row, State, advance
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import hole_angles, wrap_tau

# Geodetic latitude above which the Earth's rotation has no usable horizontal part.
MAX_LATITUDE_DEG = 85.0


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the S1 filter. Noise figures are one sigma and belong to the precision unit."""

    latitude_deg: float = 34.0  #: geodetic latitude, north positive, deg
    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2
    coarse_seconds: float = 20.0  #: duration of the mean that starts the filter, s
    gyro_noise_deg_rth: float = 0.05  #: white noise of the gyros, deg/sqrt(h)
    accel_noise_ug_rthz: float = 30.0  #: white noise of the accelerometers, ug/sqrt(Hz)
    gyro_bias_deg_h: float = 0.1  #: sigma of the gyro bias after calibration, deg/h; it stays in the azimuth's sigma
    accel_bias_ug: float = 100.0  #: sigma of the accelerometer bias after calibration, ug
    gyro_walk_deg_h_rth: float = 0.0  #: random walk of the gyro bias in an hour, deg/h
    sigma_position: float = 0.001  #: sigma of the tool's position about the place where it rests, m
    sigma_velocity: float = 0.001  #: sigma of the tool's velocity, m/s
    gap: float = 0.5  #: a longer data gap starts the filter anew, s
    moved_ratio: float = 5.0  #: mean innovation ratio above which the tool has moved


@dataclasses.dataclass(frozen=True)
class North:
    """Attitude from true north, sample by sample."""

    #: `azimuth`, `inclination`, `toolface`: shape (n,); rad; NaN until the coarse alignment is done.
    azimuth: Array
    inclination: Array
    toolface: Array
    #: `sigma_azimuth`, `sigma_inclination`: shape (n,); one sigma, rad, at most pi.
    sigma_azimuth: Array
    sigma_inclination: Array
    #: shape (n,); mean normalised innovation squared of the zero-motion measurement; 1 when the tool keeps as still as
    #: stated.
    ratio: Array
    #: uint32, shape (n,); bits of `mwd_estimation.core.status.Status`; STILL is absent where `ratio` shows that the
    #: tool has moved.
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
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
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
        gyro_bias=params.gyro_bias_deg_h * DEG_PER_HOUR,
        accel_bias=params.accel_bias_ug * MICRO_G,
        sigma_position=params.sigma_position,
        sigma_velocity=params.sigma_velocity,
        moved_ratio=params.moved_ratio,
    )
