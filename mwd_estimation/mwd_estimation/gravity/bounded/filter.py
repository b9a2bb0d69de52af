"""
Velocity-bounded error-state Kalman filter: gravity from the fact that a sonde in its hole goes nowhere.

Rates carry the attitude, forces carry velocity and position in a level frame of arbitrary heading; what integrates to a
position that runs away is tilt (or an error of a sensor that acts like tilt), what does not is vibration, however
strong. The filter is multiplicative (errors of attitude live in the level frame, heading is left out) and measures one
thing: the position of a point of the tool, `lever` away from the sensor, is zero. How firmly follows from how far the
tool is seen to swing (`gravity_bounded_motion`); the mechanics are `gravity_bounded_model`. Derivation, what is
observable when, and limits: ``docs/gravity_bounded.md``.
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
from mwd_estimation.gravity.bounded import gaps as gap
from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_estimation.gravity.bounded import motion as follow
from mwd_estimation.gravity.bounded import noise as white
from mwd_estimation.gravity.bounded.mechanisation import (
    BIAS,
    DOWN,
    ERRORS,
    LEVER,
    MISSING,
    N_DOWN,
    N_MISSING,
    N_SLOPE,
    N_VEL,
    NOMINAL,
    POS,
    S_TIME,
    S_TURN,
    SCALE,
    SLOPE,
    STEADY,
    SUMS,
    TILT,
    VEL,
    Q,
)  # fmt: skip
from mwd_estimation.gravity.bounded.motion import (
    AGE,
    ALIAS,
    BLOCK,
    BLOCK_TIME,
    BOOST,
    CLIP_TILT,
    CLIPPING,
    CURVE_TIME,
    DIRECTION,
    DRIFT,
    EPOCH,
    KEPT_DOWN,
    KEPT_TILT,
    LAST_A,
    LAST_W,
    LEAN_DOWN,
    LEARNS,
    MEAN,
    MEAN_POWER,
    NON_GRAVITY,
    ROUGH,
    SCALE_ACROSS,
    SCALE_ALONG,
    SCALE_DOWN,
    SETTLED,
    SIGMA_INCLINATION,
    SIGMA_TOOLFACE,
    SLOW_AXIS,
    SLOW_LEAN,
    SLOW_ROUGH,
    STARTED,
    STATISTICS,
    STEADY_ACROSS,
    STEADY_ALONG,
    STRONG,
    SWING_C,
    SWING_X,
    TURNING,
    TURNING_FROM,
    UNSETTLED,
    USUAL,
)  # fmt: skip
from mwd_estimation.gravity.bounded.params import (
    K_ACCEL_RANGE,
    K_BIAS_0,
    K_BIAS_FAST,
    K_BIAS_WALK,
    K_BRIDGE,
    K_CLIP_JERK,
    K_CONING,
    K_DOWN_0,
    K_GRAVITY,
    K_GYRO_NOISE,
    K_GYRO_RANGE,
    K_LEVER_0,
    K_SAMPLED,
    K_SCALE_0,
    K_START,
    K_SWING_MEMORY,
    K_UPDATE,
    Params,
    constants,
)  # fmt: skip
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

__all__ = ["Log", "Params", "State", "initial", "run", "run_logged"]

_LEARNS_FROM = 0.02  # rad^2, variance of tilt from which on lever arm and scale are looked for
_UNTIL_THEN = 0.02  # share of their sigmas until then
_START_TILT, _START_MOST = 0.17, 4.0  # rad, s: a mean of white forces goes on until it is known that well, or so long
_KEPT = 0.05  # rad, added to the sigma of an inclination that is only kept
_JUDGED = 3.0  # s since a start, before which samples are not called aliased
_LIKE_GRAVITY = 0.5  # m/s^2, what the mean force of a few seconds may be longer or shorter than gravity and still be it
_REJECTED, _GAP, _INITIALISING = int(Status.REJECTED), int(Status.GAP), int(Status.INITIALISING)
_CLIPPED, _NEAR_VERTICAL, _ALIASED = int(Status.CLIPPED), int(Status.NEAR_VERTICAL), int(Status.ALIASED)


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
    lean : ndarray, shape (m, 4)
        Power of the innovations over the filter's own time, along the hole and across it (NaN while the gyro clips);
        variances that calibration leaves there, rad^2.
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
    lean: Array
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
            np.zeros((n, 4)),
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
        np.zeros((MISSING - BIAS, MISSING - BIAS)),
    )
    state.stats[DIRECTION : DIRECTION + 3] = np.nan
    _forget(constants(params), state.nominal, state.P, state.stats)
    return state


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
        log.lean, log.north_t, stamps, gyro, accel,
        out.g_t, out.sigma_inclination, out.sigma_toolface, out.non_gravity, out.rotary_speed, out.status,
    )  # fmt: skip
    return out


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
        P[LEVER + j, LEVER + j] = (_UNTIL_THEN * k[K_LEVER_0]) ** 2
    P[SCALE, SCALE] = (_UNTIL_THEN * k[K_SCALE_0]) ** 2
    P[DOWN, DOWN] = k[K_DOWN_0] ** 2
    for j in range(STATISTICS):
        if (j < DIRECTION or j >= DIRECTION + 3) and j != EPOCH:
            st[j] = 0.0
    st[SWING_X] = 0.01
    st[SWING_C] = 0.01
    st[USUAL] = 1.0
    st[ALIAS] = 1.0


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
    for j in range(DRIFT, SWING_X):
        st[j] = 0.0
    for j in range(CLIPPING, USUAL):
        st[j] = 0.0
    # The covariance of a start is what it is; how far it is to be believed has to be seen again.
    st[SCALE_ALONG] = 1.0
    st[SCALE_ACROSS] = 1.0
    st[LEAN_DOWN] = 0.0
    st[SCALE_DOWN] = 0.0
    st[SLOW_LEAN], st[SLOW_LEAN + 1] = 0.0, 0.0
    st[STEADY_ALONG], st[STEADY_ACROSS] = 0.0, 0.0
    st[SETTLED] = 0.0
    st[SLOW_ROUGH] = st[ROUGH]
    st[UNSETTLED] = 1.0
    st[BLOCK_TIME] = 0.0
    for j in range(3):
        st[BLOCK + j] = 0.0
    st[CLIP_TILT] = 0.0
    st[KEPT_TILT] = 0.0
    st[EPOCH] += 1.0


@compiled
def _begin_roll(x: Array, P: Array, s: Array, st: Array, C: Array) -> None:
    """As `_begin` where only the roll is lost: the cross-axis rates tell the inclination all the time."""
    down, tilt = C[2, 0], follow.split_tilt(P, C[0, 0], C[1, 0])
    _begin(x, P, s, st)
    st[KEPT_DOWN], st[KEPT_TILT] = down, tilt
    model.rotation(x, C)


@compiled
def _publish(k: Array, x: Array, P: Array, st: Array, C: Array) -> None:
    """Sigmas as they are until the covariance changes again."""
    floor, aside = follow.floors(k, x, P, st, C)
    along, across = follow.believed(k, st)
    st[SIGMA_INCLINATION], st[SIGMA_TOOLFACE] = follow.sigmas(
        C[0, 0], C[1, 0], P[TILT, TILT], P[TILT, TILT + 1], P[TILT + 1, TILT + 1], along, across,
        floor + along * st[CLIP_TILT], aside,
    )  # fmt: skip


@compiled
def _start(x: Array, P: Array, st: Array, k: Array, dt: float, wx: float, g: Array) -> None:
    """First attitude from the mean force `g` (down, tool axes, unit) and what its scatter says of its error."""
    age = st[AGE]
    mx, my, mz = st[MEAN] / age, st[MEAN + 1] / age, st[MEAN + 2] / age
    scatter = max(0.0, st[MEAN_POWER] / age - (mx * mx + my * my + mz * mz)) / (k[K_GRAVITY] * k[K_GRAVITY])
    turned = 0.5 * age * (math.sqrt(P[BIAS, BIAS]) + math.sqrt(P[SCALE, SCALE]) * abs(wx))
    # A mean that is not one g long holds an acceleration that did not average out, likely across gravity as well.
    off = math.sqrt(mx * mx + my * my + mz * mz) / k[K_GRAVITY] - 1.0
    # Scatter is taken to last for 50 ms, unless neighbours differ as much as samples do: then it is white.
    spread = scatter * 0.05 / age
    rough = st[ROUGH] / (k[K_GRAVITY] * k[K_GRAVITY])
    if 3.0 * rough > 0.5 * scatter * dt:
        spread = min(spread, 1.5 * rough / age)
    tilt = min(spread + 0.06 * 0.06 + off * off + turned * turned, 1.0)
    if st[KEPT_TILT] > 0.0:
        # Two inclinations, that of the mean and the one kept, by their variances.
        sine = max(math.sqrt(g[1] * g[1] + g[2] * g[2]), 1e-9)
        kept = st[KEPT_TILT] / (st[KEPT_TILT] + tilt)
        inclination = kept * math.atan2(sine, g[0]) + (1.0 - kept) * math.acos(min(max(st[KEPT_DOWN], -1.0), 1.0))
        g[0] = math.cos(inclination)
        g[1], g[2] = math.sin(inclination) / sine * g[1], math.sin(inclination) / sine * g[2]
    if g[2] > -0.9999:
        w = math.sqrt(0.5 * (1.0 + g[2]))
        x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = 0.5 * g[1] / w, -0.5 * g[0] / w, 0.0, w
    else:
        x[Q], x[Q + 1], x[Q + 2], x[Q + 3] = 1.0, 0.0, 0.0, 0.0
    speed = 0.25 + scatter * 0.25
    for j in range(2):
        P[TILT + j, TILT + j] = tilt
    if st[KEPT_TILT] > 0.0:
        C = np.empty((3, 3))
        model.rotation(x, C)
        follow.split_tilt(P, C[0, 0], C[1, 0])
        follow.join_tilt(P, C[0, 0], C[1, 0], st[KEPT_TILT] * tilt / (st[KEPT_TILT] + tilt))
        st[KEPT_TILT] = 0.0
    for j in range(3):
        P[VEL + j, VEL + j] = speed
        P[POS + j, POS + j] = 0.01
    st[STRONG] = max(st[STRONG], scatter * k[K_GRAVITY] * k[K_GRAVITY])
    st[STARTED] = 1.0


@compiled
def _run(
    k: Array, gap_ns: int, clock: Stamps, motion: Array, x: Array, P: Array, s: Array, st: Array, kept: Array,
    log_count: Stamps, log_sample: Stamps, log_epoch: Array, log_sums: Array, log_correction: Array, log_before: Array,
    log_after: Array, log_lean: Array, log_north: Array, stamps: Stamps, gyro: Array, accel: Array,
    g_out: Array, inc_out: Array, tf_out: Array, force_out: Array, rotary_out: Array, status_out: NDArray[np.uint32],
) -> None:  # fmt: skip
    C = np.empty((3, 3))
    e = np.zeros(ERRORS)
    g = np.empty(3)
    model.rotation(x, C)
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
            if verdict == track.NEXT and 2e9 * dt > gap_ns and gap.stands_out(st, dt):
                verdict = track.AFTER_GAP
            if verdict != track.NEXT:
                if verdict == track.AFTER_GAP:
                    bits |= _GAP
                if verdict == track.FIRST or not 0.0 < dt < k[K_BRIDGE] or st[STARTED] == 0.0 or st[CLIPPING] != 0.0:
                    _begin(x, P, s, st)
                else:
                    if s[S_TIME] > 0.0:
                        _step_covariance(
                            k, x, P, s, st, C, e, i, log_count, log_sample, log_epoch, log_sums, log_correction,
                            log_before, log_after, log_lean,
                        )  # fmt: skip
                    if gap.bridge(k, x, P, s, st, C, dt, wx, wy, wz) and model.sound(x, P):
                        model.rotation(x, C)
                        _publish(k, x, P, st, C)
                    else:
                        _begin_roll(x, P, s, st, C)
                dt = 0.0
            bits |= _sample(
                k, motion, x, P, s, st, kept, C, e, g, dt, wx, wy, wz, fx, fy, fz, i,
                log_count, log_sample, log_epoch, log_sums, log_correction, log_before, log_after, log_lean,
            )  # fmt: skip
            st[LAST_W], st[LAST_W + 1], st[LAST_W + 2] = wx, wy, wz
        inclination_sigma, toolface_sigma = math.pi, math.pi
        if st[STARTED] > 0.0:
            g[0], g[1], g[2] = C[2, 0], C[2, 1], C[2, 2]
            inclination_sigma, toolface_sigma = st[SIGMA_INCLINATION], st[SIGMA_TOOLFACE]
            across2 = C[0, 0] * C[0, 0] + C[1, 0] * C[1, 0]
            if across2 < math.sin(track.NEAR_VERTICAL_BELOW) ** 2:
                bits |= _NEAR_VERTICAL
        elif st[MEAN_POWER] > 0.0:
            # The mean so far; its axes are those of the first sample of the start.
            mx, my, mz = -st[MEAN], -st[MEAN + 1], -st[MEAN + 2]
            norm = math.sqrt(mx * mx + my * my + mz * mz)
            for j in range(3):
                g[j] = (C[0, j] * mx + C[1, j] * my + C[2, j] * mz) / norm
            if st[KEPT_TILT] > 0.0:
                # Only the roll is sought.
                g[0] = min(max(st[KEPT_DOWN], -1.0), 1.0)
                side = math.sqrt((1.0 - g[0] * g[0]) / max(g[1] * g[1] + g[2] * g[2], 1e-18))
                g[1], g[2] = side * g[1], side * g[2]
                inclination_sigma = math.sqrt(min(st[KEPT_TILT], 1.0)) + _KEPT
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
    log_before: Array, log_after: Array, log_lean: Array,
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
    aliased = st[ALIAS] > 0.5 and st[SETTLED] > _JUDGED and dt > 0.0
    if aliased:
        bits |= _ALIASED
    # Rates may still be means where forces are point samples; only a string that turns for long, whose speed may swing
    # by tens of rad/s, has more to lose by the rectangle than by half a sample of delay.
    if (aliased and st[TURNING] > TURNING_FROM) or (k[K_SAMPLED] > 0.5 and dt > 0.0):
        nx += 0.5 * (lwx - wx) * dt
    # Roughness: spectral density of the forces at the top of the band, were they white.
    da = (fx - st[LAST_A]) ** 2 + (fy - st[LAST_A + 1]) ** 2 + (fz - st[LAST_A + 2]) ** 2
    st[LAST_A], st[LAST_A + 1], st[LAST_A + 2] = fx, fy, fz
    if dt > 0.0:
        share = dt / (min(k[K_SWING_MEMORY], st[AGE] + st[SETTLED]) + dt)
        st[ROUGH] += share * (da / 6.0 * dt - st[ROUGH])

    if st[STARTED] == 0.0:
        st[AGE] += dt
        s[S_TIME] = 0.0
        ax, ay, az = model.mechanise(x, s, C, 0.0, dt, wx, wy, wz, nx, ny, nz, fx, fy, fz)
        step = max(dt, 1e-3)
        st[MEAN] += step * ax
        st[MEAN + 1] += step * ay
        st[MEAN + 2] += step * (az - x[N_DOWN])
        st[MEAN_POWER] += step * (ax * ax + ay * ay + az * az)
        # White forces leave a mean of that long a tilt; while it is large the start goes on.
        vague = st[ROUGH] / (k[K_GRAVITY] * k[K_GRAVITY] * max(st[AGE], 1e-3)) > _START_TILT * _START_TILT
        if dt > 0.0 and st[AGE] >= k[K_START] and not (vague and st[AGE] < _START_MOST):
            mx, my, mz = -st[MEAN], -st[MEAN + 1], -st[MEAN + 2]
            norm = max(math.sqrt(mx * mx + my * my + mz * mz), 1e-9)
            for j in range(3):
                g[j] = (C[0, j] * mx + C[1, j] * my + C[2, j] * mz) / norm
            _start(x, P, st, k, dt, wx, g)
            model.rotation(x, C)
            st[SLOW_AXIS], st[SLOW_AXIS + 1] = C[0, 0], C[1, 0]
            _publish(k, x, P, st, C)
            for j in range(6):
                x[N_VEL + j] = 0.0
            for j in range(SUMS):
                s[j] = 0.0
        st[NON_GRAVITY] = abs(math.sqrt(fx * fx + fy * fy + fz * fz) - k[K_GRAVITY])
        return bits | track.follow_motion(motion, dt, wx, wy, wz, st[NON_GRAVITY])

    ax, ay, az = model.mechanise(x, s, C, k[K_GRAVITY], dt, wx, wy, wz, nx, ny, nz, fx, fy, fz)
    power = ax * ax + ay * ay + az * az
    st[NON_GRAVITY] = math.sqrt(power)
    bits |= track.follow_motion(motion, dt, wx, wy, wz, st[NON_GRAVITY])

    follow.follow_swing(k, x, P, st, C, dt, ax, ay, az)
    follow.follow_shocks(k, P, st, dt, ax, ay, az, power, clip_force)
    follow.follow_rates(k, s, st, dt, wx, wy, wz, clip_cross)
    gap.follow_changes(st, dt, wx, wy, wz)
    if not (clip_x or st[CLIPPING] != 0.0):
        follow.follow_slope(st, dt, wx)
    elif follow.follow_clipping(k, x, P, st, kept, C, dt, wx, clip_x):
        _begin_roll(x, P, s, st, C)
        return bits

    if s[S_TIME] >= k[K_UPDATE] - 1e-6:
        _step_covariance(
            k, x, P, s, st, C, e, i, log_count, log_sample, log_epoch, log_sums, log_correction, log_before, log_after,
            log_lean,
        )  # fmt: skip
        model.rotation(x, C)
        if not model.sound(x, P):
            _forget(k, x, P, st)
            _begin(x, P, s, st)
            model.rotation(x, C)
        elif _attitude_lost(k, st):
            _begin(x, P, s, st)
            model.rotation(x, C)
        else:
            _publish(k, x, P, st, C)
    return bits


@compiled
def _attitude_lost(k: Array, st: Array) -> bool:
    """
    Whether there is half of gravity for seconds where there should be none, and gravity somewhere else.

    A mean force that is not as long as gravity is one of the tool: vibration that point samples fold down to zero.
    """
    level = st[DRIFT] ** 2 + st[DRIFT + 1] ** 2
    size = math.sqrt(level + (st[DRIFT + 2] - k[K_GRAVITY]) ** 2)
    much: bool = level + st[DRIFT + 2] ** 2 > 25.0 + 9.0 * st[ROUGH]
    return much and bool(abs(size - k[K_GRAVITY]) < _LIKE_GRAVITY)


@compiled
def _step_covariance(
    k: Array, x: Array, P: Array, s: Array, st: Array, C: Array, e: Array,
    i: int, log_count: Stamps, log_sample: Stamps, log_epoch: Array, log_sums: Array, log_correction: Array,
    log_before: Array, log_after: Array, log_lean: Array,
) -> None:  # fmt: skip
    """Carry the covariance over the sums, add noise, measure, and empty the sums."""
    size = ERRORS if st[CLIPPING] != 0.0 else STEADY
    T = s[S_TIME]
    swing, density = white.follow_white(k, x, s, st)
    white.leave_out_noise(k, s, density)
    model.propagate(P, s, size)
    turn = k[K_GYRO_NOISE] ** 2 * T + s[S_TURN]
    P[TILT, TILT] += turn
    P[TILT + 1, TILT + 1] += turn
    force, wander, play = follow.noises(k, s, st, swing, density)
    walk = min(k[K_BIAS_WALK] ** 2 * (1.0 + st[BOOST]), k[K_BIAS_FAST] ** 2) * T
    for j in range(3):
        P[VEL + j, VEL + j] += force
        P[POS + j, POS + j] += wander
        P[BIAS + j, BIAS + j] += walk
    P[SCALE, SCALE] += 1e-12 * T
    if st[LEARNS] == 0.0 and P[TILT, TILT] + P[TILT + 1, TILT + 1] < _LEARNS_FROM:
        # Lever arm and scale act in proportion to sines of the attitude: with tens of degrees to find they would be
        # made to fit instead of it, and stay wrong.
        st[LEARNS] = 1.0
        P[SCALE, SCALE] += k[K_SCALE_0] ** 2
        for j in range(3):
            P[LEVER + j, LEVER + j] += k[K_LEVER_0] ** 2
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
    i0, i1, i2, square = model.update(x, P, C, size, play, play, e, follow.jump_gate(k, st))
    if logged:
        for j in range(STEADY):
            log_correction[entry, j] = e[j]
            for m in range(STEADY):
                log_after[entry, j, m] = P[j, m]
        log_count[0] += 1
    for j in range(2):
        st[SLOW_AXIS + j] += T / CURVE_TIME * (C[j, 0] - st[SLOW_AXIS + j])
    along, across = follow.follow_innovations(k, P, st, C, T, turn, i0, i1, i2, square)
    if logged:
        apart = follow.vertical_excess(st)
        share_along, share_across = follow.error_shares(st)
        log_lean[entry, 0], log_lean[entry, 1] = share_along * along + apart, share_across * across + apart
        log_lean[entry, 2], log_lean[entry, 3] = follow.floors(k, x, P, st, C)
    for j in range(SUMS):
        s[j] = 0.0
