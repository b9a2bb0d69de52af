"""
Velocity-bounded error-state Kalman filter: gravity from the fact that a sonde in its hole goes nowhere.

Rates carry the attitude, forces carry velocity and position in a level frame of arbitrary heading; what integrates to a
position that runs away is tilt (or an error of a sensor that acts like tilt), what does not is vibration, however
strong. The filter is multiplicative (errors of attitude live in the level frame, heading is left out) and measures one
thing: the position of a point of the tool, `lever` away from the sensor, is zero. How firmly follows from how far the
tool is seen to swing. Derivation, what is observable when, and limits: ``docs/gravity_bounded.md``.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation import track
from mwd_estimation.status import Status
from mwd_estimation.track import Array, Stamps, Track
from mwd_sensors.compiled import compiled
from mwd_sensors.settings import setting

_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_CLIPPED, _NEAR_VERTICAL, _ALIASED = int(Status.CLIPPED), int(Status.NEAR_VERTICAL), int(Status.ALIASED)

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
# Followed statistics and flags.
(
    AGE, STARTED, MEAN, MEAN_POWER, LAST_W, SLOW_A, SWING_V, SWING_P, SWING_X, SWING_C, ROUGH, LAST_A, STRONG, DRIFT,
    INNOVATION, BOOST, CLIPPING, RATE_SLOPE, PERIOD, NON_GRAVITY, ALIAS, DIRECTION, SLOW_ARM, SWING_Z, SETTLED,
    CLIP_TIME, SQUARE, EPOCH, TURNING, LEAST_SHARE,
    RATE_CURVE, STATISTICS,
) = (
    0, 1, 2, 5, 6, 9, 12, 15, 18, 19, 20, 21, 24, 25, 28, 30, 31, 32, 33, 34, 35, 36, 39, 42, 43, 44, 45, 46,
    47, 48, 49, 50,
)  # fmt: skip

(
    K_GRAVITY, K_START, K_UPDATE, K_GYRO_NOISE, K_RATE_NOISE, K_ROTARY_NOISE, K_BIAS_WALK, K_BIAS_FAST,
    K_ACCEL_NOISE, K_ANCHOR, K_PLAY, K_SWING_TIME, K_SWING_MEMORY, K_ANCHOR_SWING, K_PLAY_SWING,
    K_ALIAS_NOISE, K_SHOCK_AT, K_SHOCK_NOISE, K_GYRO_RANGE, K_ACCEL_RANGE,
    K_CLIP_JERK, K_CLIP_SLOPE, K_BIAS_0, K_SCALE_0, K_LEVER_0, K_DOWN_0, K_FLOOR, K_CONING,
    K_CLIP_TURN, K_LEAN_TIME, K_LEAN_GAIN, K_LEAN_FROM, K_CLIP_BRIDGE, K_CLIP_CURVE, K_LOST, SETTINGS,
) = range(36)  # fmt: skip
RESERVE, RESERVE_LEAST, RESERVE_MOST = 10.0, 0.1, 4.0
SLOPE_LAG, CURVE_LAG = 0.03, 0.1  # s, low-passes of the slope of the x rate and of its curvature
TURNING_FROM = 3.0  # rad/s, mean rate about the axis from which aliased rates are integrated by the trapezoid


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the bounded filter; none needs to be touched for a new tool, all may be."""

    gravity: float = setting(track.STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    start: float = setting(0.3, "mean in gyro axes that makes the first estimate", unit="s", low=0.02, high=10.0)
    gap: float = setting(0.25, "a longer silence starts the attitude anew", unit="s", low=0.01, high=10.0)
    update: float = setting(0.04, "time between updates of the covariance", unit="s", low=0.001, high=0.2)
    coning: float = setting(
        0.0,
        "share of the 1/12 coning term: 1 for mean rates, 0 where the sensor strapdown-integrates",
        low=0.0,
        high=1.0,
    )
    gyro_noise: float = setting(0.00071, "gyro white noise with reserve", unit="rad/s/sqrt(Hz)", low=1e-7, high=0.1)
    rate_noise: float = setting(0.0012, "noise per rate across the axis (scale, misalignment)", low=0.0, high=0.1)
    rotary_noise: float = setting(0.0001, "noise per rate about the axis (its scale is a state)", low=0.0, high=0.1)
    bias_walk: float = setting(0.00013, "random walk of the gyro bias", unit="rad/s/sqrt(s)", low=0.0, high=0.01)
    bias_fast: float = setting(
        0.00045,
        "largest random walk while the innovations lean one way (warming up)",
        unit="rad/s/sqrt(s)",
        low=0.0,
        high=0.1,
    )
    lean_time: float = setting(
        12.0, "time over which innovations that lean one way are averaged", unit="s", low=0.5, high=60.0
    )
    lean_from: float = setting(
        1.5, "lean, as a multiple of what white innovations leave, that speeds the walk", low=1.0, high=100.0
    )
    lean_gain: float = setting(330.0, "growth of the walk's variance per lean beyond that", low=0.0, high=1e6)
    accel_noise: float = setting(
        0.014, "accelerometer white noise with reserve", unit="m/s^2/sqrt(Hz)", low=1e-5, high=1.0
    )
    anchor: float = setting(0.001, "least wander of the point the tool hangs at", unit="m/sqrt(s)", low=1e-5, high=10.0)
    play: float = setting(0.0038, "least play about that point", unit="m", low=1e-5, high=10.0)
    swing_time: float = setting(
        0.7, "time constant of the high-pass that shows the swing", unit="s", low=0.1, high=20.0
    )
    swing_memory: float = setting(2.1, "time over which the swing is averaged", unit="s", low=0.1, high=60.0)
    anchor_swing: float = setting(2.7, "wander per swing", unit="1/sqrt(s)", low=0.0, high=100.0)
    play_swing: float = setting(0.1, "play per swing", low=0.0, high=100.0)
    alias_noise: float = setting(
        0.4, "share of the white force noise that swing and roughness agree on", low=0.0, high=100.0
    )
    alias_share: float = setting(
        0.13, "swing that white forces of unit density leave", unit="s^1.5", low=0.0, high=10.0
    )
    shock_at: float = setting(2.2, "a force that many times the usual may hide clipping", low=1.0, high=100.0)
    shock_noise: float = setting(2.0, "velocity lost in such a sample per velocity shown", low=0.0, high=100.0)
    gyro_range: float = setting(34.9, "rate at which the gyro clips", unit="rad/s", low=0.1, high=200.0)
    accel_range: float = setting(156.9, "force at which the accelerometer clips", unit="m/s^2", low=10.0, high=4000.0)
    clip_jerk: float = setting(
        200.0, "random walk of the slope of a clipped rate", unit="rad/s^2/sqrt(s)", low=0.0, high=1e4
    )
    clip_slope: float = setting(15.0, "error of that slope when clipping begins", unit="rad/s^2", low=0.0, high=1e4)
    clip_turn: float = setting(5.0, "rate lost while a cross-axis gyro clips", unit="rad/s", low=0.0, high=100.0)
    clip_bridge: float = setting(
        4.0,
        "longest clipping of the x gyro that is bridged; after a longer one roll starts anew",
        unit="s",
        low=0.0,
        high=10.0,
    )
    clip_curve: float = setting(
        75.0, "usual curvature of a rate that clips, a fifth of it the least", unit="rad/s^3", low=0.0, high=1e4
    )
    lost: float = setting(
        3.0, "missing rate at the end of clipping that shows roll astray", unit="rad/s", low=0.01, high=100.0
    )
    bias_sigma: float = setting(0.005, "gyro bias at switch-on", unit="rad/s", low=1e-6, high=0.2)
    scale_sigma: float = setting(0.005, "scale error of the x gyro at switch-on", low=1e-6, high=0.2)
    lever_sigma: float = setting(0.1, "lever arm of the sensor from the point that stays", unit="m", low=1e-4, high=5.0)
    down_sigma: float = setting(
        0.05, "error of gravity's magnitude as the sensor shows it", unit="m/s^2", low=1e-6, high=1.0
    )
    calibration_sigma: float = setting(
        0.0005, "tilt that calibration errors of the accelerometer leave", unit="rad", low=0.0, high=0.5
    )


@dataclasses.dataclass
class State:
    """All that changes: clock, motion, nominal values, covariance, sums since an update, statistics, what is kept."""

    clock: Stamps
    motion: Array
    nominal: Array
    P: Array
    sums: Array
    stats: Array
    kept: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass
class Log:
    """
    Trace of a block for the smoother: one entry per update of the covariance, one row per sample.

    Attributes
    ----------
    count : ndarray of int64, shape (1,)
        Entries written.
    sample, epoch : ndarray, shape (m,)
        Sample at which the update was made; number of the start it belongs to.
    sums, correction, before, after : ndarray, shape (m, ...)
        Sums of the transition, errors put in, covariance before and after the measurement.
    north_t : ndarray, shape (n, 3)
        First level axis in tool axes.
    """

    count: NDArray[np.int64]
    sample: NDArray[np.int64]
    epoch: Array
    sums: Array
    correction: Array
    before: Array
    after: Array
    north_t: Array

    @classmethod
    def room(cls, n: int) -> Log:
        """Room for n samples, each of which may end in an update."""
        return cls(
            np.zeros(1, dtype=np.int64),
            np.zeros(n, dtype=np.int64),
            np.zeros(n),
            np.zeros((n, SUMS)),
            np.zeros((n, STEADY)),
            np.empty((n, STEADY, STEADY)),
            np.empty((n, STEADY, STEADY)),
            np.zeros((n, 3)),
        )


def initial(params: Params) -> State:
    """State before the first sample."""
    state = State(
        np.zeros(track.CLOCK_SIZE, dtype=np.int64),
        np.zeros(track.MOTION_SIZE),
        np.zeros(NOMINAL),
        np.zeros((ERRORS, ERRORS)),
        np.zeros(SUMS),
        np.zeros(STATISTICS),
        np.zeros((MISSING - BIAS + 1, MISSING - BIAS)),
    )
    state.stats[DIRECTION : DIRECTION + 3] = np.nan
    _forget(constants(params), state.nominal, state.P, state.stats)
    return state


def constants(params: Params) -> Array:
    """Settings as the kernel takes them, in the order of the K_ names."""
    p = params
    return np.array(
        [
            p.gravity, p.start, p.update, p.gyro_noise, p.rate_noise, p.rotary_noise, p.bias_walk, p.bias_fast,
            p.accel_noise, p.anchor, p.play, p.swing_time, p.swing_memory, p.anchor_swing, p.play_swing,
            p.alias_noise, p.shock_at, p.shock_noise, p.gyro_range, p.accel_range,
            p.clip_jerk, p.clip_slope, p.bias_sigma, p.scale_sigma, p.lever_sigma, p.down_sigma,
            p.calibration_sigma, p.coning, p.clip_turn, p.lean_time, p.lean_gain, p.lean_from,
            p.clip_bridge, p.clip_curve, p.lost,
        ]
    )  # fmt: skip


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
    return _follow(params, state, stamps, gyro, accel, Log.room(0))


def run_logged(
    params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike
) -> tuple[Track, Log]:
    """As `run`, and all that a smoother needs to go back over the block."""
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    log = Log.room(len(stamps))
    return _follow(params, state, stamps, gyro, accel, log), log


def _follow(params: Params, state: State, stamps: Stamps, gyro: Array, accel: Array, log: Log) -> Track:
    out = Track.empty(len(stamps))
    _run(
        constants(params), round(params.gap * 1e9), state.clock, state.motion, state.nominal, state.P, state.sums,
        state.stats, state.kept, log.count, log.sample, log.epoch, log.sums, log.correction, log.before, log.after,
        log.north_t, stamps, gyro, accel,
        out.g_t, out.sigma_inclination, out.sigma_toolface, out.non_gravity, out.rotary_speed, out.status,
    )  # fmt: skip
    return out


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
    # Tilt enters through the axis the position is measured along.
    ux, uy, uz = C[0, axis], C[1, axis], C[2, axis]
    dx, dy, dz = x[N_POS], x[N_POS + 1], x[N_POS + 2]
    h[0] = uy * dz - uz * dy
    h[1] = uz * dx - ux * dz
    h[2], h[3], h[4] = ux, uy, uz
    along: float = x[N_LEVER + axis] - (ux * dx + uy * dy + uz * dz)
    return along


@compiled
def update(
    x: Array, P: Array, C: Array, size: int, r_axis: float, r_cross: float, e: Array
) -> tuple[float, float, float]:
    """Three scalar updates along the tool axes; returns the whitened innovation, level x and y, and its mean square."""
    h = np.empty(5)
    PH = np.empty(ERRORS)
    for j in range(size):
        e[j] = 0.0
    i0, i1, square = 0.0, 0.0, 0.0
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
        white = y / math.sqrt(S)
        i0 += C[0, axis] * white
        i1 += C[1, axis] * white
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
    correct(x, e, size)
    return i0, i1, square


@compiled
def correct(x: Array, e: Array, size: int) -> None:
    """Put the errors e into the nominal values: exp(tilt) from the left, the rest by adding."""
    a, b = 0.5 * e[TILT], 0.5 * e[TILT + 1]
    qx, qy, qz, qw = x[Q], x[Q + 1], x[Q + 2], x[Q + 3]
    ax, ay, az, aw = qx + a * qw + b * qz, qy + b * qw - a * qz, qz + a * qy - b * qx, qw - a * qx - b * qy
    unit = 1.0 / math.sqrt(ax * ax + ay * ay + az * az + aw * aw)
    x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = unit * ax, unit * ay, unit * az, unit * aw
    for j in range(VEL, size):
        x[N_VEL + j - VEL] += e[j]


@compiled
def _forget(k: Array, x: Array, P: Array, st: Array) -> None:
    """All that was learnt is gone: values, covariance and statistics as before the first sample."""
    for j in range(NOMINAL):
        x[j] = 0.0
    x[Q + 3] = 1.0
    for j in range(ERRORS):
        for m in range(ERRORS):
            P[j, m] = 0.0
    for j in range(3):
        P[BIAS + j, BIAS + j] = k[K_BIAS_0] ** 2
        P[LEVER + j, LEVER + j] = k[K_LEVER_0] ** 2
    P[SCALE, SCALE] = k[K_SCALE_0] ** 2
    P[DOWN, DOWN] = k[K_DOWN_0] ** 2
    for j in range(STATISTICS):
        if (j < DIRECTION or j >= DIRECTION + 3) and j != EPOCH:
            st[j] = 0.0
    st[SWING_X] = 0.01
    st[SWING_C] = 0.01
    st[SQUARE] = 1.0


@compiled
def _begin(x: Array, P: Array, s: Array, st: Array) -> None:
    """Attitude, velocity and position unknown again; what was learnt of the sensors stays, uncorrelated with them."""
    for j in range(BIAS):
        for m in range(ERRORS):
            P[j, m] = 0.0
            P[m, j] = 0.0
    for j in range(MISSING, ERRORS):
        for m in range(ERRORS):
            P[j, m] = 0.0
            P[m, j] = 0.0
    for j in range(6):
        x[N_VEL + j] = 0.0
    x[N_MISSING] = 0.0
    x[N_SLOPE] = 0.0
    x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = 0.0, 0.0, 0.0, 1.0
    for j in range(SUMS):
        s[j] = 0.0
    for j in range(AGE, LAST_W):
        st[j] = 0.0
    for j in range(SLOW_A, SWING_X):
        st[j] = 0.0
    for j in range(DRIFT, RATE_SLOPE + 1):
        st[j] = 0.0
    st[SETTLED] = 0.0
    st[EPOCH] += 1.0


@compiled
def _start(x: Array, P: Array, st: Array, k: Array, wx: float, g: Array) -> None:
    """First attitude from the mean force `g` (down, tool axes, unit) and what its scatter says of its error."""
    if g[2] > -0.9999:
        w = math.sqrt(0.5 * (1.0 + g[2]))
        x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = 0.5 * g[1] / w, -0.5 * g[0] / w, 0.0, w
    else:
        x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = 1.0, 0.0, 0.0, 0.0
    age = st[AGE]
    mx, my, mz = st[MEAN] / age, st[MEAN + 1] / age, st[MEAN + 2] / age
    scatter = max(0.0, st[MEAN_POWER] / age - (mx * mx + my * my + mz * mz)) / (k[K_GRAVITY] * k[K_GRAVITY])
    turned = 0.5 * age * (math.sqrt(P[BIAS, BIAS]) + math.sqrt(P[SCALE, SCALE]) * abs(wx))
    # A mean that is not one g long holds an acceleration that did not average out, likely across gravity as well.
    off = math.sqrt(mx * mx + my * my + mz * mz) / k[K_GRAVITY] - 1.0
    tilt = scatter * 0.05 / age + 0.06 * 0.06 + off * off + turned * turned
    speed = 0.25 + scatter * 0.25
    for j in range(2):
        P[TILT + j, TILT + j] = min(tilt, 1.0)
    for j in range(3):
        P[VEL + j, VEL + j] = speed
        P[POS + j, POS + j] = 0.01
    st[STRONG] = max(st[STRONG], scatter * k[K_GRAVITY] * k[K_GRAVITY])
    st[STARTED] = 1.0


@compiled
def _run(
    k: Array, gap_ns: int, clock: Stamps, motion: Array, x: Array, P: Array, s: Array, st: Array, kept: Array,
    log_count: Stamps, log_sample: Stamps, log_epoch: Array, log_sums: Array, log_correction: Array, log_before: Array,
    log_after: Array, log_north: Array, stamps: Stamps, gyro: Array, accel: Array,
    g_out: Array, inc_out: Array, tf_out: Array, force_out: Array, rotary_out: Array, status_out: NDArray[np.uint32],
) -> None:  # fmt: skip
    C = np.empty((3, 3))
    e = np.zeros(ERRORS)
    g = np.empty(3)
    rotation(x, C)
    for i in range(len(stamps)):
        wx, wy, wz = gyro[i, 0], gyro[i, 1], gyro[i, 2]
        fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
        before = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], wx, wy, wz, fx, fy, fz, gap_ns)
        bits = 0
        if verdict == track.REJECTED:
            bits = _REJECTED
        else:
            dt = 1e-9 * (stamps[i] - before)
            if verdict != track.NEXT:
                dt = 0.0
                _begin(x, P, s, st)
                if verdict == track.AFTER_GAP:
                    bits |= _GAP
            bits |= _sample(
                k, motion, x, P, s, st, kept, C, e, g, dt, wx, wy, wz, fx, fy, fz, i,
                log_count, log_sample, log_epoch, log_sums, log_correction, log_before, log_after,
            )  # fmt: skip
            st[LAST_W], st[LAST_W + 1], st[LAST_W + 2] = wx, wy, wz
        inclination_sigma, toolface_sigma = math.pi, math.pi
        if st[STARTED] > 0.0:
            g[0], g[1], g[2] = C[2, 0], C[2, 1], C[2, 2]
            ax, ay = C[0, 0], C[1, 0]
            across2 = ax * ax + ay * ay
            floor = k[K_FLOOR] * k[K_FLOOR]
            # The noises have reserve, as the tool's motion is not white; small innovations show how much.
            # The factor and its limits are empirical (docs): innovations see far more of the play than of the tilt.
            most = RESERVE_MOST if st[ALIAS] > 0.5 else 1.0
            reserve = min(max(RESERVE * st[SQUARE], RESERVE_LEAST), most)
            if reserve < 1.0:
                # Only the least noises have reserve; those that follow the swing are as large as it is.
                reserve = 1.0 - st[LEAST_SHARE] * (1.0 - reserve)
            p00, p01, p11 = reserve * P[TILT, TILT], reserve * P[TILT, TILT + 1], reserve * P[TILT + 1, TILT + 1]
            if across2 > 1e-6:
                vi = (p00 * ay * ay - 2.0 * p01 * ax * ay + p11 * ax * ax) / across2
                vt = (p00 * ax * ax + 2.0 * p01 * ax * ay + p11 * ay * ay) / across2
            else:
                vi = vt = 0.5 * (p00 + p11)
            inclination_sigma = min(math.pi, math.sqrt(max(vi, 0.0) + floor))
            toolface_sigma = min(math.pi, math.sqrt((max(vt, 0.0) + floor) / max(across2, 1e-6)))
            if across2 < math.sin(track.NEAR_VERTICAL_BELOW) ** 2:
                bits |= _NEAR_VERTICAL
        elif st[MEAN_POWER] > 0.0:
            # The mean so far; its axes are those of the first sample of the start.
            mx, my, mz = -st[MEAN], -st[MEAN + 1], -st[MEAN + 2]
            norm = math.sqrt(mx * mx + my * my + mz * mz)
            for j in range(3):
                g[j] = (C[0, j] * mx + C[1, j] * my + C[2, j] * mz) / norm
            bits |= _INITIALISING
        else:
            for j in range(3):
                g[j] = st[DIRECTION + j]
            bits |= _INITIALISING
        for j in range(3):
            st[DIRECTION + j] = g[j]
            g_out[i, j] = g[j]
        inc_out[i] = inclination_sigma
        if len(log_north) > 0:
            for j in range(3):
                log_north[i, j] = C[0, j]
        tf_out[i] = toolface_sigma
        force_out[i] = motion[track.PEAK_FORCE]
        rotary_out[i] = motion[track.ROTARY]
        status_out[i] = bits


@compiled
def _sample(
    k: Array, motion: Array, x: Array, P: Array, s: Array, st: Array, kept: Array, C: Array, e: Array, g: Array,
    dt: float, wx: float, wy: float, wz: float, fx: float, fy: float, fz: float,
    i: int, log_count: Stamps, log_sample: Stamps, log_epoch: Array, log_sums: Array, log_correction: Array,
    log_before: Array, log_after: Array,
) -> int:  # fmt: skip
    """One admitted sample; returns its status bits. C is left at the attitude of the sample."""
    bits = 0
    lwx, lwy, lwz = st[LAST_W], st[LAST_W + 1], st[LAST_W + 2]
    clip_force = max(abs(fx), abs(fy), abs(fz)) >= k[K_ACCEL_RANGE]
    clip_cross = max(abs(wy), abs(wz)) >= k[K_GYRO_RANGE]
    clip_x = abs(wx) >= k[K_GYRO_RANGE]
    if clip_force or clip_cross or clip_x:
        bits |= _CLIPPED
    # Small-angle additions to the rotation vector: coning term, and the trapezoid of point samples.
    c = k[K_CONING] / 12.0 * dt * dt
    nx, ny, nz = c * (lwy * wz - lwz * wy), c * (lwz * wx - lwx * wz), c * (lwx * wy - lwy * wx)
    st[TURNING] += dt / (10.0 + dt) * (abs(wx) - st[TURNING])
    if st[ALIAS] > 0.5 and dt > 0.0:
        # Rates may still be means where forces are point samples; only a string that turns for long, whose speed may
        # swing by tens of rad/s, has more to lose by the rectangle than by half a sample of delay.
        if st[TURNING] > TURNING_FROM:
            nx += 0.5 * (lwx - wx) * dt
        bits |= _ALIASED
    # Roughness: spectral density of the forces at the top of the band, were they white.
    da = (fx - st[LAST_A]) ** 2 + (fy - st[LAST_A + 1]) ** 2 + (fz - st[LAST_A + 2]) ** 2
    st[LAST_A], st[LAST_A + 1], st[LAST_A + 2] = fx, fy, fz
    share = dt / (k[K_SWING_MEMORY] + dt)
    st[ROUGH] += share * (da / 6.0 * dt - st[ROUGH])

    if st[STARTED] == 0.0:
        st[AGE] += dt
        s[S_TIME] = 0.0
        ax, ay, az = mechanise(x, s, C, 0.0, dt, wx, wy, wz, nx, ny, nz, fx, fy, fz)
        step = max(dt, 1e-3)
        st[MEAN] += step * ax
        st[MEAN + 1] += step * ay
        st[MEAN + 2] += step * (az - x[N_DOWN])
        st[MEAN_POWER] += step * (ax * ax + ay * ay + az * az)
        if dt > 0.0 and st[AGE] >= k[K_START]:
            mx, my, mz = -st[MEAN], -st[MEAN + 1], -st[MEAN + 2]
            norm = max(math.sqrt(mx * mx + my * my + mz * mz), 1e-9)
            for j in range(3):
                g[j] = (C[0, j] * mx + C[1, j] * my + C[2, j] * mz) / norm
            _start(x, P, st, k, wx, g)
            rotation(x, C)
            for j in range(6):
                x[N_VEL + j] = 0.0
            for j in range(SUMS):
                s[j] = 0.0
        st[NON_GRAVITY] = abs(math.sqrt(fx * fx + fy * fy + fz * fz) - k[K_GRAVITY])
        return bits | track.follow_motion(motion, dt, wx, wy, wz, st[NON_GRAVITY])

    ax, ay, az = mechanise(x, s, C, k[K_GRAVITY], dt, wx, wy, wz, nx, ny, nz, fx, fy, fz)
    power = ax * ax + ay * ay + az * az
    st[NON_GRAVITY] = math.sqrt(power)
    bits |= track.follow_motion(motion, dt, wx, wy, wz, st[NON_GRAVITY])

    # A stretch much longer than usual (lost samples): how rates and forces went on meanwhile is known roughly.
    if st[PERIOD] > 0.0 and dt > 1.6 * st[PERIOD]:
        rate = abs(wx - lwx) + abs(wy - lwy) + abs(wz - lwz) + 0.05
        s[S_TURN] += (0.5 * rate * dt) ** 2
        s[S_JUMP] += st[STRONG] * dt * dt
    st[PERIOD] = dt if st[PERIOD] == 0.0 else st[PERIOD] + 0.05 * (dt - st[PERIOD])

    # Swing: position after two high-passed integrations, along the axis and across it.
    share = dt / (k[K_SWING_TIME] + dt)
    for j in range(3):
        a = ax if j == 0 else (ay if j == 1 else az)
        st[SLOW_A + j] += share * (a - st[SLOW_A + j])
        st[SWING_V + j] += dt * (a - st[SLOW_A + j] - st[SWING_V + j] / k[K_SWING_TIME])
        st[SWING_P + j] += dt * (st[SWING_V + j] - st[SWING_P + j] / k[K_SWING_TIME])
        st[DRIFT + j] += dt / 3.0 * (a - st[DRIFT + j])
    along, whole, upright = 0.0, 0.0, 0.0
    for j in range(3):
        # The sensor circles with its lever arm; what counts is the swing of the point that stays.
        arm = C[j, 0] * x[N_LEVER] + C[j, 1] * x[N_LEVER + 1] + C[j, 2] * x[N_LEVER + 2]
        st[SLOW_ARM + j] += share * (arm - st[SLOW_ARM + j])
        d = st[SWING_P + j] - arm + st[SLOW_ARM + j]
        along += C[j, 0] * d
        whole += d * d
        upright = d
    st[SWING_Z] += dt / (3.0 * k[K_SWING_MEMORY] + dt) * (upright * upright - st[SWING_Z])
    # Tilt not yet found swings the position as well; the tool's own swing is learnt when tilt is known.
    if st[CLIPPING] == 0.0 and P[TILT, TILT] + P[TILT + 1, TILT + 1] < 0.0025:
        share = dt / (k[K_SWING_MEMORY] + dt)
        st[SWING_X] += share * (along * along - st[SWING_X])
        st[SWING_C] += share * (0.5 * max(whole - along * along, 0.0) - st[SWING_C])
    # A force far above the usual may be a shock whose tip was cut off before the sensor averaged it.
    if (power > k[K_SHOCK_AT] ** 2 * st[STRONG] + 100.0 and st[STRONG] > 0.0) or clip_force:
        s[S_JUMP] += k[K_SHOCK_NOISE] ** 2 * power * dt * dt
    st[STRONG] += min(1.0, dt / 0.3) * (min(power, 1e4) - st[STRONG])

    s[S_TURN] += (k[K_RATE_NOISE] ** 2 * (wy * wy + wz * wz) + k[K_ROTARY_NOISE] ** 2 * wx * wx) * dt
    if clip_cross:
        s[S_TURN] += (k[K_CLIP_TURN] * dt) ** 2
    _follow_clipping(k, x, P, s, st, kept, dt, wx, lwx, clip_x)
    if st[STARTED] == 0.0:
        rotation(x, C)
        return bits

    if s[S_TIME] >= k[K_UPDATE] - 1e-6:
        _step_covariance(
            k, x, P, s, st, C, e, i, log_count, log_sample, log_epoch, log_sums, log_correction, log_before, log_after
        )
        rotation(x, C)
        if not _sound(x, P):
            _forget(k, x, P, st)
            _begin(x, P, s, st)
            rotation(x, C)
        elif st[DRIFT] ** 2 + st[DRIFT + 1] ** 2 + st[DRIFT + 2] ** 2 > 25.0 + 9.0 * st[ROUGH]:
            # Half of gravity for seconds where there should be none: the attitude is lost.
            _begin(x, P, s, st)
            rotation(x, C)
    return bits


@compiled
def _sound(x: Array, P: Array) -> bool:
    """True while variances are positive and all is finite."""
    total = 0.0
    for j in range(NOMINAL):
        total += x[j]
    least = 0.0
    for j in range(ERRORS):
        total += P[j, j]
        least = min(least, P[j, j])
    return math.isfinite(total) and least >= 0.0


@compiled
def _follow_clipping(
    k: Array, x: Array, P: Array, s: Array, st: Array, kept: Array, dt: float, wx: float, lwx: float, clip_x: bool
) -> None:
    """
    While the x gyro clips, what it misses is a state that starts with the slope the rate had.

    What was learnt of the sensors is set aside meanwhile, lest a roll gone astray spoil it.
    """
    if clip_x:
        if st[CLIPPING] == 0.0:
            x[N_MISSING] = 0.0
            # The low-passed slope is late by its time constant.
            x[N_SLOPE] = st[RATE_SLOPE] + SLOPE_LAG * st[RATE_CURVE]
            P[SLOPE, SLOPE] = k[K_CLIP_SLOPE] ** 2
            for j in range(MISSING - BIAS):
                kept[MISSING - BIAS, j] = x[N_BIAS + j]
                for m in range(MISSING - BIAS):
                    kept[j, m] = P[BIAS + j, BIAS + m]
        st[CLIPPING] = 1.0 if wx > 0.0 else -1.0
        # It bends back as it did before; a rate that was not yet bending must, sooner or later.
        bend = max(-st[CLIPPING] * st[RATE_CURVE], 0.2 * k[K_CLIP_CURVE])
        # A string that swings about its mean speed bends in proportion to the distance from it.
        bend *= 1.0 + abs(x[N_MISSING]) / max(abs(wx) - st[TURNING], 0.1 * abs(wx))
        x[N_SLOPE] -= st[CLIPPING] * bend * dt
        x[N_MISSING] += x[N_SLOPE] * dt
        st[CLIP_TIME] += dt
        if x[N_MISSING] * wx < 0.0:
            x[N_MISSING] = 0.0
    elif st[CLIPPING] != 0.0:
        # When the gyro is back nothing is missing: if the state says otherwise it went astray, and roll with it.
        astray = abs(x[N_MISSING]) > k[K_LOST]
        x[N_MISSING] = 0.0
        x[N_SLOPE] = 0.0
        for j in range(ERRORS):
            for m in range(BIAS, ERRORS):
                P[j, m] = 0.0
                P[m, j] = 0.0
        for j in range(MISSING - BIAS):
            x[N_BIAS + j] = kept[MISSING - BIAS, j]
            for m in range(MISSING - BIAS):
                P[BIAS + j, BIAS + m] = kept[j, m]
        st[CLIPPING] = 0.0
        st[RATE_SLOPE] = 0.0
        st[RATE_CURVE] = 0.0
        if astray or st[CLIP_TIME] > k[K_CLIP_BRIDGE] or P[TILT, TILT] + P[TILT + 1, TILT + 1] > 9.0:
            _begin(x, P, s, st)
        st[CLIP_TIME] = 0.0
    elif dt > 0.0:
        late = st[RATE_SLOPE]
        st[RATE_SLOPE] += dt / (SLOPE_LAG + dt) * ((wx - lwx) / dt - late)
        st[RATE_CURVE] += dt / (CURVE_LAG + dt) * ((st[RATE_SLOPE] - late) / dt - st[RATE_CURVE])


@compiled
def _step_covariance(
    k: Array, x: Array, P: Array, s: Array, st: Array, C: Array, e: Array,
    i: int, log_count: Stamps, log_sample: Stamps, log_epoch: Array, log_sums: Array, log_correction: Array,
    log_before: Array, log_after: Array,
) -> None:  # fmt: skip
    """Carry the covariance over the sums, add noise, measure, and empty the sums."""
    size = ERRORS if st[CLIPPING] != 0.0 else STEADY
    T = s[S_TIME]
    propagate(P, s, size)
    turn = k[K_GYRO_NOISE] ** 2 * T + s[S_TURN]
    P[TILT, TILT] += turn
    P[TILT + 1, TILT + 1] += turn
    # As much of the swing as roughness can explain is white (aliased) force; the rest is motion.
    swing = max(st[SWING_X], st[SWING_C])
    # White force of density one leaves the variance time^3 / 16 after the high-pass and the two leaky integrations.
    explained = k[K_SWING_TIME] ** 3 / 16.0 * st[ROUGH]
    # The vertical shows it: tilt errors, which swing too, do not reach it to first order.
    # Until the high-pass has settled nothing is known, and all roughness is taken for white.
    unsettled = math.exp(-st[SETTLED] / k[K_SWING_TIME])
    st[SETTLED] += T
    white = max(min(st[SWING_Z], explained), unsettled * explained)
    motion = max(swing - white, 0.0)
    force = (k[K_ACCEL_NOISE] ** 2 + k[K_ALIAS_NOISE] ** 2 * white * 16.0 / k[K_SWING_TIME] ** 3) * T + s[S_JUMP] / 3.0
    wander = (k[K_ANCHOR] ** 2 + k[K_ANCHOR_SWING] ** 2 * motion) * T
    play = k[K_PLAY] ** 2 + k[K_PLAY_SWING] ** 2 * motion
    st[LEAST_SHARE] = k[K_PLAY] ** 2 / play
    walk = min(k[K_BIAS_WALK] ** 2 * (1.0 + st[BOOST]), k[K_BIAS_FAST] ** 2) * T
    for j in range(3):
        P[VEL + j, VEL + j] += force
        P[POS + j, POS + j] += wander
        P[BIAS + j, BIAS + j] += walk
    P[SCALE, SCALE] += 1e-12 * T
    P[DOWN, DOWN] += 1e-8 * T
    if size == ERRORS:
        P[SLOPE, SLOPE] += k[K_CLIP_JERK] ** 2 * T
    logged = len(log_sample) > 0
    entry = log_count[0]
    if logged:
        log_sample[entry] = i
        log_epoch[entry] = st[EPOCH] if size == STEADY else -1.0
        for j in range(SUMS):
            log_sums[entry, j] = s[j]
        for j in range(STEADY):
            for m in range(STEADY):
                log_before[entry, j, m] = P[j, m]
    i0, i1, square = update(x, P, C, size, play, play, e)
    if logged:
        for j in range(STEADY):
            log_correction[entry, j] = e[j]
            for m in range(STEADY):
                log_after[entry, j, m] = P[j, m]
        log_count[0] += 1
    # Innovations that lean one way for long are a bias on the move; white ones leave this mean at T / time.
    st[SQUARE] += T / 10.0 * (square - st[SQUARE])
    share = T / k[K_LEAN_TIME]
    st[INNOVATION] += share * (i0 - st[INNOVATION])
    st[INNOVATION + 1] += share * (i1 - st[INNOVATION + 1])
    lean = (st[INNOVATION] ** 2 + st[INNOVATION + 1] ** 2) / share
    st[BOOST] = k[K_LEAN_GAIN] * max(0.0, lean - k[K_LEAN_FROM])
    aliased = 0.25 * explained < st[SWING_Z] < 4.0 * explained and st[ROUGH] > 0.02
    st[ALIAS] += T / 3.0 * ((1.0 if aliased else 0.0) - st[ALIAS])
    for j in range(SUMS):
        s[j] = 0.0
