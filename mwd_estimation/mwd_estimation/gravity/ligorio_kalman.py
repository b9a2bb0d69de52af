"""
Linear Kalman extraction of gravity: the framework S3 compares itself with (Ligorio and Sabatini's inclinometer).

Gravity in tool axes is carried by the gyro, the acceleration of the tool is a first-order Gauss-Markov process carried
alike, the accelerometer is their difference plus noise. With noises alike on the three axes the six-state covariance is
three numbers times the unit matrix, which rotation leaves alone, so that the filter is exact and cheap. A gyro
bias is removed by an integral beside the filter. For comparison; derivation and limits: ``docs/gravity_kalman.md``.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import samples as track
from mwd_estimation.core.samples import Track
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.kalman import coning_rotation, in_turned_axes
from mwd_sensors.core.settings import setting

_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_CLIPPED, _NEAR_VERTICAL = int(Status.CLIPPED), int(Status.NEAR_VERTICAL)

# Layout of the real part of the state: gravity (m/s^2), acceleration, last angle, covariances, statistics.
G, ACCELERATION, ANGLE_LAST, PGG, PGA, PAA, AGE, SQUARE, NON_GRAVITY, BIAS, REALS = (
    0, 3, 6, 9, 10, 11, 12, 13, 14, 15, 18
)  # fmt: skip
(
    GRAVITY, GYRO_NOISE, RATE_NOISE, ACCEL_NOISE, MOTION, MEMORY, CONING, START, GYRO_RANGE, ACCEL_RANGE, FLOOR,
    BIAS_GAIN, SETTINGS,
) = range(13)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the linear Kalman extraction."""

    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    gyro_noise: float = setting(0.01, "gyro white noise", unit="rad/s/sqrt(Hz)", low=1e-7, high=1.0)
    rate_noise: float = setting(0.005, "gyro noise per rate", low=0.0, high=0.1)
    accel_noise: float = setting(0.5, "accelerometer noise of a sample", unit="m/s^2", low=1e-4, high=100.0)
    motion: float = setting(10.0, "acceleration of the tool", unit="m/s^2", low=0.01, high=1000.0)
    memory: float = setting(0.05, "correlation time of that acceleration", unit="s", low=1e-3, high=100.0)
    bias_gain: float = setting(
        0.005, "integral gain of the gyro bias beside the filter", unit="1/s^2", low=0.0, high=1.0
    )
    coning: float = setting(
        0.0,
        "share of the 1/12 coning term: 1 for mean rates, 0 where the sensor strapdown-integrates",
        low=0.0,
        high=1.0,
    )
    start: float = setting(0.5, "time over which the estimate counts as starting", unit="s", low=0.0, high=60.0)
    gap: float = setting(0.5, "a longer silence starts the estimate anew", unit="s", low=0.01, high=60.0)
    gyro_range: float = setting(34.9, "rate at which the gyro clips", unit="rad/s", low=0.1, high=200.0)
    accel_range: float = setting(156.9, "force at which the accelerometer clips", unit="m/s^2", low=10.0, high=4000.0)
    sigma_floor: float = setting(0.003, "sigma is not given smaller", unit="rad", low=0.0, high=0.5)


@dataclasses.dataclass
class State:
    """All that changes: common clock and motion, and the filter's reals."""

    clock: Stamps
    motion: Array
    reals: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


def initial(params: Params) -> State:
    """State before the first sample."""
    reals = np.zeros(REALS)
    reals[G : G + 3] = np.nan
    reals[PGG] = (math.pi * params.gravity) ** 2
    reals[SQUARE] = 1.0
    return State(np.zeros(track.CLOCK_SIZE, dtype=np.int64), np.zeros(track.MOTION_SIZE), reals)


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """Follow gravity through a block of samples; arguments and errors as `gravity_bounded.run`."""
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    p = params
    k = np.array(
        [
            p.gravity, p.gyro_noise, p.rate_noise, p.accel_noise, p.motion, p.memory, p.coning, p.start,
            p.gyro_range, p.accel_range, p.sigma_floor, p.bias_gain,
        ]
    )  # fmt: skip
    _run(
        k, round(p.gap * 1e9), state.clock, state.motion, state.reals, stamps, gyro, accel,
        out.g_t, out.sigma_inclination, out.sigma_toolface, out.non_gravity, out.rotary_speed, out.status,
    )  # fmt: skip
    return out


@compiled
def _run(
    k: Array, gap_ns: int, clock: Stamps, motion: Array, s: Array, stamps: Stamps, gyro: Array, accel: Array,
    g_out: Array, inc_out: Array, tf_out: Array, force_out: Array, rotary_out: Array, status_out: NDArray[np.uint32],
) -> None:  # fmt: skip
    for i in range(len(stamps)):
        wx, wy, wz = gyro[i, 0], gyro[i, 1], gyro[i, 2]
        fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
        before = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], wx, wy, wz, fx, fy, fz, gap_ns)
        bits = 0
        norm = math.sqrt(fx * fx + fy * fy + fz * fz)
        if verdict == track.REJECTED or (verdict != track.NEXT and norm == 0.0):
            bits = _REJECTED
        else:
            if max(abs(wx), abs(wy), abs(wz)) >= k[GYRO_RANGE] or max(abs(fx), abs(fy), abs(fz)) >= k[ACCEL_RANGE]:
                bits |= _CLIPPED
            dt = 0.0
            if verdict == track.NEXT:
                dt = 1e-9 * (stamps[i] - before)
            else:
                # The first force is all there is; its error is the tool's acceleration.
                scale = k[GRAVITY] / norm
                s[G], s[G + 1], s[G + 2] = -fx * scale, -fy * scale, -fz * scale
                for c in range(3):
                    s[ACCELERATION + c] = 0.0
                    s[ANGLE_LAST + c] = 0.0
                s[PGG] = (0.5 * k[GRAVITY]) ** 2
                s[PAA] = k[MOTION] * k[MOTION]
                s[PGA] = 0.0
                s[AGE] = 0.0
                if verdict == track.AFTER_GAP:
                    bits |= _GAP
            s[AGE] += dt
            bx, by, bz = (wx + s[BIAS]) * dt, (wy + s[BIAS + 1]) * dt, (wz + s[BIAS + 2]) * dt
            px, py, pz = coning_rotation(s[ANGLE_LAST], s[ANGLE_LAST + 1], s[ANGLE_LAST + 2], bx, by, bz, k[CONING])
            s[ANGLE_LAST], s[ANGLE_LAST + 1], s[ANGLE_LAST + 2] = bx, by, bz
            gx, gy, gz = in_turned_axes(s[G], s[G + 1], s[G + 2], px, py, pz)
            keep = math.exp(-dt / k[MEMORY])
            rate2 = wx * wx + wy * wy + wz * wz
            s[PGG] += k[GRAVITY] ** 2 * (k[GYRO_NOISE] ** 2 + k[RATE_NOISE] ** 2 * rate2) * dt
            s[PGA] *= keep
            s[PAA] = keep * keep * s[PAA] + (1.0 - keep * keep) * k[MOTION] ** 2
            ax, ay, az = in_turned_axes(s[ACCELERATION], s[ACCELERATION + 1], s[ACCELERATION + 2], px, py, pz)
            ax, ay, az = keep * ax, keep * ay, keep * az
            # Integral of the force against carried gravity, as in Mahony's filter: the gyro bias, with its sign turned.
            step = k[BIAS_GAIN] * dt / k[GRAVITY] ** 2
            s[BIAS] -= step * (fy * gz - fz * gy)
            s[BIAS + 1] -= step * (fz * gx - fx * gz)
            s[BIAS + 2] -= step * (fx * gy - fy * gx)
            # Force is acceleration less gravity: H = [-1 1].
            yx, yy, yz = fx - ax + gx, fy - ay + gy, fz - az + gz
            cg, ca = s[PGA] - s[PGG], s[PAA] - s[PGA]
            total = ca - cg + k[ACCEL_NOISE] ** 2
            kg, ka = cg / total, ca / total
            gx, gy, gz = gx + kg * yx, gy + kg * yy, gz + kg * yz
            s[ACCELERATION], s[ACCELERATION + 1], s[ACCELERATION + 2] = ax + ka * yx, ay + ka * yy, az + ka * yz
            s[PGG] -= kg * cg
            s[PGA] -= kg * ca
            s[PAA] -= ka * ca
            scale = k[GRAVITY] / math.sqrt(gx * gx + gy * gy + gz * gz)
            s[G], s[G + 1], s[G + 2] = gx * scale, gy * scale, gz * scale
            s[SQUARE] += min(1.0, dt / 5.0) * ((yx * yx + yy * yy + yz * yz) / (3.0 * total) - s[SQUARE])
            dx, dy, dz = fx + s[G], fy + s[G + 1], fz + s[G + 2]
            s[NON_GRAVITY] = math.sqrt(dx * dx + dy * dy + dz * dz)
            bits |= track.follow_motion(motion, dt, wx, wy, wz, s[NON_GRAVITY])
        if s[AGE] < k[START] or not math.isfinite(s[G]):
            bits |= _INITIALISING
        # Innovations larger or smaller than expected scale the covariance they came from.
        scaled = s[PGG] / k[GRAVITY] ** 2 * min(max(s[SQUARE], 0.1), 100.0)
        sigma = min(math.pi, math.sqrt(scaled + k[FLOOR] ** 2))
        across = math.hypot(s[G + 1], s[G + 2]) / k[GRAVITY]
        if across < math.sin(track.NEAR_VERTICAL_BELOW):
            bits |= _NEAR_VERTICAL
        for c in range(3):
            g_out[i, c] = s[G + c] / k[GRAVITY]
        inc_out[i] = sigma
        tf_out[i] = min(math.pi, sigma / max(across, 1e-3))
        force_out[i] = motion[track.PEAK_FORCE]
        rotary_out[i] = motion[track.ROTARY]
        status_out[i] = bits
