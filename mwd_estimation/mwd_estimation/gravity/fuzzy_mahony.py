"""
S3: gravity while drilling from a rotation-vector recursion, a PI correction and a fuzzy proportional gain.

The recursion (S3 eq 5, sign in the exponent as eq 1 demands) carries the filtered gravity of the last sample by the
raw gyro; what the accelerometer says against it drives a proportional-integral correction of the rates (S3 figure 4,
Mahony's filter with one vector); the proportional gain follows non-gravity acceleration and rotary speed by the fuzzy
table 1. Derivation, limits and what is observable when: ``docs/gravity_s3.md``.
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

# S3 table 1 and eq (12): rows rotary speed S, M, L; columns non-gravity acceleration S, M, L; steps of the output.
RULES: Array = np.array([[0.06, 0.03, -0.03], [0.0, 0.0, -0.03], [0.0, -0.03, -0.06]])
WINDOW_MOST = 512
RPM = 60.0 / (2.0 * math.pi)

_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_CLIPPED, _NEAR_VERTICAL = int(Status.CLIPPED), int(Status.NEAR_VERTICAL)

# Layout of the real part of the state.
G, INTEGRAL, ANGLE_LAST, MEAN, SLOW = 0, 3, 6, 9, 12
AGE, SLOW_POWER, START_POWER, MEAN_POWER, NON_GRAVITY, SIGMA, REALS = 15, 16, 17, 18, 19, 20, 21
# Layout of the settings handed to the kernel.
K_P, K_I, K_LEAST, CONING, FUZZY, GRAVITY, START, GYRO_RANGE, ACCEL_RANGE, FLOOR, SETTINGS = range(11)


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the S3 method; `fuzzy` off makes it the plain PI filter."""

    k_p: float = setting(0.15, "base proportional gain", unit="1/s", low=0.0, high=10.0)
    k_i: float = setting(0.003, "integral gain, 0 leaves the gyro bias alone", unit="1/s^2", low=0.0, high=1.0)
    k_p_least: float = setting(0.01, "the fuzzy table lowers the gain no further", unit="1/s", low=0.0, high=10.0)
    fuzzy: bool = setting(True, "let the fuzzy table move k_p")
    window: int = setting(
        20, "samples whose largest non-gravity feeds the table", unit="samples", low=1, high=WINDOW_MOST
    )
    coning: float = setting(
        0.0,
        "share of the 1/12 coning term: 1 for rate samples, 0 where the sensor strapdown-integrates",
        low=0.0,
        high=1.0,
    )
    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    start_time: float = setting(2.0, "mean in gyro axes that makes the first estimate", unit="s", low=0.0, high=60.0)
    gap: float = setting(0.5, "a longer silence starts the estimate anew", unit="s", low=0.01, high=60.0)
    gyro_range: float = setting(34.9, "rate at which the gyro clips", unit="rad/s", low=0.1, high=200.0)
    accel_range: float = setting(156.9, "force at which the accelerometer clips", unit="m/s^2", low=10.0, high=4000.0)
    sigma_floor: float = setting(0.003, "sigma is not given smaller", unit="rad", low=0.0, high=0.5)


@dataclasses.dataclass(frozen=True)
class MahonyParams(Params):
    """Settings of the same filter with fixed gains."""

    fuzzy: bool = setting(False, "let the fuzzy table move k_p")


@dataclasses.dataclass
class State:
    """All that changes: common clock and motion, the filter's reals, and the ring of non-gravity samples."""

    clock: Stamps
    motion: Array
    reals: Array
    ring: Array
    ring_at: NDArray[np.int64]

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


def initial(params: Params) -> State:
    """State before the first sample."""
    reals = np.zeros(REALS)
    reals[G : G + 3] = np.nan
    reals[SIGMA] = math.pi
    return State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64),
        np.zeros(track.MOTION_SIZE),
        reals,
        np.zeros(params.window),
        np.zeros(1, dtype=np.int64),
    )


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Follow gravity through a block of samples.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, in tool axes.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    k = np.zeros(SETTINGS)
    k[K_P], k[K_I], k[K_LEAST], k[CONING] = params.k_p, params.k_i, params.k_p_least, params.coning
    k[FUZZY], k[GRAVITY], k[START] = float(params.fuzzy), params.gravity, params.start_time
    k[GYRO_RANGE], k[ACCEL_RANGE] = params.gyro_range, params.accel_range
    k[FLOOR] = params.sigma_floor
    _run(
        k, round(params.gap * 1e9), state.clock, state.motion, state.reals, state.ring, state.ring_at, RULES,
        stamps, gyro, accel,
        out.g_t, out.sigma_inclination, out.sigma_toolface, out.non_gravity, out.rotary_speed, out.status,
    )  # fmt: skip
    return out


@compiled
def membership(value: float, low: float, middle: float, high: float) -> tuple[float, float, float]:
    """Triangular memberships small, medium, large (S3 figure 3 a, b); beyond the ends the shoulder stays at one."""
    if value <= low:
        return 1.0, 0.0, 0.0
    if value >= high:
        return 0.0, 0.0, 1.0
    if value <= middle:
        m = (value - low) / (middle - low)
        return 1.0 - m, m, 0.0
    m = (value - middle) / (high - middle)
    return 0.0, 1.0 - m, m


@compiled
def fuzzy_step(non_gravity: float, rotary_rpm: float, rules: Array) -> float:
    """
    Change of k_p, 1/s, by S3 table 1 and eq (13): minimum for AND, centroid of the (up to four) fired rules.

    non_gravity in m/s^2 (not in g: eq 9 divides by g0 but the universe of eq 12 does not), rotary_rpm in r/min.
    """
    v = membership(non_gravity, 0.0, 25.0, 50.0)
    r = membership(abs(rotary_rpm), 0.0, 100.0, 200.0)
    top = 0.0
    bottom = 0.0
    for i in range(3):
        for j in range(3):
            weight = min(r[i], v[j])
            top += weight * rules[i, j]
            bottom += weight
    return top / bottom


@compiled
def _run(
    k: Array,
    gap_ns: int,
    clock: Stamps,
    motion: Array,
    s: Array,
    ring: Array,
    ring_at: Stamps,
    rules: Array,
    stamps: Stamps,
    gyro: Array,
    accel: Array,
    g_out: Array,
    inc_out: Array,
    tf_out: Array,
    force_out: Array,
    rotary_out: Array,
    status_out: NDArray[np.uint32],
) -> None:
    window = len(ring)
    for i in range(len(stamps)):
        wx, wy, wz = gyro[i, 0], gyro[i, 1], gyro[i, 2]
        fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
        before = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], wx, wy, wz, fx, fy, fz, gap_ns)
        bits = 0
        if verdict == track.REJECTED:
            bits = _REJECTED
            if s[AGE] < k[START] or clock[track.HAVE_LAST] == 0:
                bits |= _INITIALISING
        else:
            if max(abs(wx), abs(wy), abs(wz)) >= k[GYRO_RANGE] or max(abs(fx), abs(fy), abs(fz)) >= k[ACCEL_RANGE]:
                bits |= _CLIPPED
            ux, uy, uz = -fx / k[GRAVITY], -fy / k[GRAVITY], -fz / k[GRAVITY]
            if verdict == track.NEXT:
                dt = 1e-9 * (stamps[i] - before)
            else:
                # The mean that starts the estimate begins anew; the integral, a gyro bias, outlives a gap.
                dt = 0.0
                for c in range(3):
                    s[ANGLE_LAST + c] = 0.0
                    s[MEAN + c] = 0.0
                    s[SLOW + c] = 0.0
                s[AGE] = 0.0
                s[SLOW_POWER] = 0.0
                s[MEAN_POWER] = 0.0
                for c in range(window):
                    ring[c] = 0.0
                if verdict == track.AFTER_GAP:
                    bits |= _GAP
            bx, by, bz = wx * dt, wy * dt, wz * dt
            px, py, pz = coning_rotation(s[ANGLE_LAST], s[ANGLE_LAST + 1], s[ANGLE_LAST + 2], bx, by, bz, k[CONING])
            s[ANGLE_LAST], s[ANGLE_LAST + 1], s[ANGLE_LAST + 2] = bx, by, bz
            s[AGE] += dt
            if s[AGE] < k[START] or dt == 0.0:
                # Mean force in axes that the gyro carries along: vibration averages out, rotation does not matter.
                bits |= _INITIALISING
                mx, my, mz = in_turned_axes(s[MEAN], s[MEAN + 1], s[MEAN + 2], px, py, pz)
                step = max(dt, 1e-3)
                mx += ux * step
                my += uy * step
                mz += uz * step
                s[MEAN], s[MEAN + 1], s[MEAN + 2] = mx, my, mz
                norm = math.sqrt(mx * mx + my * my + mz * mz)
                if norm > 0.0:
                    s[G], s[G + 1], s[G + 2] = mx / norm, my / norm, mz / norm
                ex, ey, ez = ux - s[G], uy - s[G + 1], uz - s[G + 2]
                # Variance of the mean, as if the disturbance stayed alike for 0.03 s.
                s[MEAN_POWER] += step * (ex * ex + ey * ey + ez * ez)
                total = s[AGE] + 1e-3
                s[START_POWER] = s[MEAN_POWER] / total * 0.03 / (total + 0.03)
                s[NON_GRAVITY] = k[GRAVITY] * math.sqrt(ex * ex + ey * ey + ez * ez)
            else:
                # Figure 4: the last filtered gravity carried by the raw gyro, and its error against the accelerometer.
                hx, hy, hz = in_turned_axes(s[G], s[G + 1], s[G + 2], px, py, pz)
                ex, ey, ez = uy * hz - uz * hy, uz * hx - ux * hz, ux * hy - uy * hx
                dx, dy, dz = ux - hx, uy - hy, uz - hz
                s[NON_GRAVITY] = k[GRAVITY] * math.sqrt(dx * dx + dy * dy + dz * dz)
                ring[ring_at[0]] = s[NON_GRAVITY]
                ring_at[0] = (ring_at[0] + 1) % window
                k_p = k[K_P]
                if k[FUZZY] > 0.0:
                    most = 0.0
                    for c in range(window):
                        most = max(most, ring[c])
                    k_p = max(k[K_LEAST], k_p + fuzzy_step(most, motion[track.ROTARY] * RPM, rules))
                # A young estimate weighs all samples alike, as a mean does.
                gain = max(k_p, 1.0 / s[AGE]) if k_p > 0.0 else 0.0
                s[INTEGRAL] += k[K_I] * ex * dt
                s[INTEGRAL + 1] += k[K_I] * ey * dt
                s[INTEGRAL + 2] += k[K_I] * ez * dt
                cx = wx + gain * ex + s[INTEGRAL]
                cy = wy + gain * ey + s[INTEGRAL + 1]
                cz = wz + gain * ez + s[INTEGRAL + 2]
                ox, oy, oz = px + (cx - wx) * dt, py + (cy - wy) * dt, pz + (cz - wz) * dt
                gx, gy, gz = in_turned_axes(s[G], s[G + 1], s[G + 2], ox, oy, oz)
                norm = math.sqrt(gx * gx + gy * gy + gz * gz)
                s[G], s[G + 1], s[G + 2] = gx / norm, gy / norm, gz / norm
                # What the correction still has to do, seen at its own bandwidth, is the error it has not removed.
                qx, qy, qz = in_turned_axes(s[SLOW], s[SLOW + 1], s[SLOW + 2], px, py, pz)
                share = min(1.0, max(gain, 0.02) * dt)
                s[SLOW] = qx + share * (ex - qx)
                s[SLOW + 1] = qy + share * (ey - qy)
                s[SLOW + 2] = qz + share * (ez - qz)
                power = 0.5 * (s[SLOW] * s[SLOW] + s[SLOW + 1] * s[SLOW + 1] + s[SLOW + 2] * s[SLOW + 2])
                s[SLOW_POWER] += 0.3 * share * (power - s[SLOW_POWER])
                # The error of the start is forgotten as fast as the gain corrects it.
                s[START_POWER] *= math.exp(-2.0 * gain * dt)
            bits |= track.follow_motion(motion, dt, wx, wy, wz, s[NON_GRAVITY])
            s[SIGMA] = min(math.pi, math.sqrt(s[SLOW_POWER] + s[START_POWER] + k[FLOOR] * k[FLOOR]))
        across = math.hypot(s[G + 1], s[G + 2])
        if across < math.sin(track.NEAR_VERTICAL_BELOW):
            bits |= _NEAR_VERTICAL
        for c in range(3):
            g_out[i, c] = s[G + c]
        inc_out[i] = s[SIGMA]
        tf_out[i] = min(math.pi, s[SIGMA] / max(across, 1e-3))
        force_out[i] = motion[track.PEAK_FORCE]
        rotary_out[i] = motion[track.ROTARY]
        status_out[i] = bits
