# SPDX-License-Identifier: Apache-2.0
"""
Linear Kalman extraction of gravity (Ligorio and Sabatini's inclinometer), with which paper S3 compares its method.

The states are gravity and acceleration of the tool, in tool axes. The gyro rotates both, and the acceleration is a
first-order Gauss-Markov process. The accelerometer measures acceleration minus gravity plus noise. With equal noise on
the three axes the 6 x 6 covariance consists of 3 x 3 blocks, each a number times the identity matrix. Rotation does not
change such blocks, so the filter is exact and fast. A separate integral correction removes the gyro bias. Derivation
and limits:
``docs/methods/fuzzy_mahony.md``.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import track
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Stamps, Vector
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.kalman import coning_rotation, in_turned_axes
from mwd_sensors.core.records import dtype_of

_INITIALISING = int(Status.INITIALISING)
# Averaging time of the squared innovations, s; smallest and largest factor on the covariance that is computed from
# their average.
_SQUARE_TIME, _SCALE_LEAST, _SCALE_MOST = 5.0, 0.1, 100.0

State = NDArray[np.void]  #: one record with the fields of `LigorioRecord`, shape (1,); a run can continue from a copy


class LigorioParams(NamedTuple):
    """Settings of the linear Kalman extraction."""

    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2
    #: `angle_noise`, `rate_noise`: white noise of the rate with a reserve for all other errors of the gyro,
    #: rad/s/sqrt(Hz), and the part of it that is proportional to the rate, 1/sqrt(Hz). Neither follows from the tool.
    angle_noise: float = 0.01
    rate_noise: float = 0.005
    accel_noise: float = 0.5  #: accelerometer noise of a sample, m/s^2
    #: `motion`, `memory`: 1 sigma of the acceleration of the tool, m/s^2, and its correlation time, s.
    motion: float = 10.0
    memory: float = 0.05
    bias_gain: float = 0.005  #: integral gain of the gyro bias, which is not a state of the filter, 1/s^2
    coning: float = 0.0  #: share of the 1/12 coning term: 1 for mean rates, 0 if the sensor integrates (strapdown)
    start_s: float = 0.5  #: time after a start during which the estimate is marked as initialising, s
    #: `gyro_range`, `accel_range`: rate, rad/s, and force, m/s^2, at which the sensors clip.
    gyro_range: float = math.radians(2000.0)
    accel_range: float = 16.0 * STANDARD_GRAVITY
    sigma_floor: float = 0.003  #: smallest sigma, rad


class LigorioRecord:
    """State of the linear Kalman extraction."""

    #: `clock`, `motion`: common to all methods, kept by `track.admit` and `track.follow_motion`.
    clock: track.TrackClock
    motion: track.TrackMotion
    #: `gravity`, `acceleration`: shape (3,); gravity and acceleration of the tool, tool axes, m/s^2.
    gravity: Annotated[Array, 3]
    acceleration: Annotated[Array, 3]
    last_angle: Annotated[Array, 3]  #: rotation angle of the previous sample, rad
    bias: Annotated[Array, 3]  #: correction of the rates, rad/s
    #: `p_gg`, `p_ga`, `p_aa`: covariances of gravity and acceleration on each axis, (m/s^2)^2.
    p_gg: float
    p_ga: float
    p_aa: float
    age: float  #: time since the start, s
    square: float  #: mean square of the innovations divided by the square expected from the covariance


RECORD = dtype_of(LigorioRecord)


def initial(params: LigorioParams) -> State:
    """Return the state before the first sample, shape (1,), dtype RECORD."""
    state = np.zeros(1, RECORD)
    state["gravity"] = np.nan
    state["p_gg"] = (math.pi * params.gravity) ** 2
    state["square"] = 1.0
    return state


def run(params: LigorioParams, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """Return gravity of each sample of a block; arguments and errors as for `fuzzy_mahony.run`."""
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    _run(params, state[0], stamps, gyro, accel, out)
    return out


@compiled
def _run(p: LigorioParams, s: Any, stamps: Stamps, gyro: Array, accel: Array, out: Track) -> None:
    for i in range(len(stamps)):
        w, f = (gyro[i, 0], gyro[i, 1], gyro[i, 2]), (accel[i, 0], accel[i, 1], accel[i, 2])
        verdict, dt, bits = track.take(s.clock, stamps[i], w, f, track.GAP_NS, p.gyro_range, p.accel_range)
        if verdict != track.REJECTED:
            if verdict != track.NEXT:
                dt = 0.0
                _begin(p, s, f)
            non_gravity = _step(p, s, dt, w, f)
            bits |= track.follow_motion(s.motion, dt, w, non_gravity)
        if s.age < p.start_s or not math.isfinite(s.gravity[0]):
            bits |= _INITIALISING
        # Scale the covariance by the ratio of the measured to the expected mean square of the innovations.
        scaled = s.p_gg / p.gravity**2 * min(max(s.square, _SCALE_LEAST), _SCALE_MOST)
        sigma = min(math.pi, math.sqrt(scaled + p.sigma_floor**2))
        for c in range(3):
            out.g_t[i, c] = s.gravity[c] / p.gravity
        track.write_row(out, i, math.hypot(s.gravity[1], s.gravity[2]) / p.gravity, sigma, s.motion, bits)


@compiled
def _begin(p: LigorioParams, s: Any, f: Vector) -> None:
    """
    Set gravity to minus the first force, scaled to the length of gravity.

    The error of this gravity is the acceleration of the tool in the first sample, which is unknown.
    """
    scale = p.gravity / math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    for c in range(3):
        s.gravity[c] = -f[c] * scale
        s.acceleration[c] = 0.0
        s.last_angle[c] = 0.0
    s.p_gg = (0.5 * p.gravity) ** 2
    s.p_aa = p.motion * p.motion
    s.p_ga = s.age = 0.0


@compiled
def _step(p: LigorioParams, s: Any, dt: float, w: Vector, f: Vector) -> float:
    """Predict over dt, s, and update with one force; return the non-gravity acceleration, m/s^2."""
    s.age += dt
    bx, by, bz = (w[0] + s.bias[0]) * dt, (w[1] + s.bias[1]) * dt, (w[2] + s.bias[2]) * dt
    px, py, pz = coning_rotation(s.last_angle[0], s.last_angle[1], s.last_angle[2], bx, by, bz, p.coning)
    s.last_angle[0], s.last_angle[1], s.last_angle[2] = bx, by, bz
    gx, gy, gz = in_turned_axes(s.gravity[0], s.gravity[1], s.gravity[2], px, py, pz)
    keep = math.exp(-dt / p.memory)
    rate2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    s.p_gg += p.gravity**2 * (p.angle_noise**2 + p.rate_noise**2 * rate2) * dt
    s.p_ga *= keep
    s.p_aa = keep * keep * s.p_aa + (1.0 - keep * keep) * p.motion**2
    ax, ay, az = in_turned_axes(s.acceleration[0], s.acceleration[1], s.acceleration[2], px, py, pz)
    ax, ay, az = keep * ax, keep * ay, keep * az
    # Integrate the cross product of force and propagated gravity, as in Mahony's filter; the result is minus the bias.
    step = p.bias_gain * dt / p.gravity**2
    s.bias[0] -= step * (f[1] * gz - f[2] * gy)
    s.bias[1] -= step * (f[2] * gx - f[0] * gz)
    s.bias[2] -= step * (f[0] * gy - f[1] * gx)
    # Force is acceleration minus gravity: H = [-1 1].
    yx, yy, yz = f[0] - ax + gx, f[1] - ay + gy, f[2] - az + gz
    cg, ca = s.p_ga - s.p_gg, s.p_aa - s.p_ga
    total = ca - cg + p.accel_noise**2
    kg, ka = cg / total, ca / total
    gx, gy, gz = gx + kg * yx, gy + kg * yy, gz + kg * yz
    s.acceleration[0], s.acceleration[1], s.acceleration[2] = ax + ka * yx, ay + ka * yy, az + ka * yz
    s.p_gg -= kg * cg
    s.p_ga -= kg * ca
    s.p_aa -= ka * ca
    # Keep the length of gravity fixed.
    scale = p.gravity / math.sqrt(gx * gx + gy * gy + gz * gz)
    s.gravity[0], s.gravity[1], s.gravity[2] = gx * scale, gy * scale, gz * scale
    s.square += min(1.0, dt / _SQUARE_TIME) * ((yx * yx + yy * yy + yz * yz) / (3.0 * total) - s.square)
    dx, dy, dz = f[0] + s.gravity[0], f[1] + s.gravity[1], f[2] + s.gravity[2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)
