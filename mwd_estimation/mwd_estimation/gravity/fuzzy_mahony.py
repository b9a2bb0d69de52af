# SPDX-License-Identifier: Apache-2.0
"""
Method of paper S3: gravity while drilling by a rotation-vector recursion, a PI correction and a fuzzy gain.

The recursion (S3 eq 5, with the sign in the exponent as eq 1 requires) propagates the last filtered gravity by the raw
gyro. The difference of the propagated gravity from the accelerometer drives a proportional-integral correction of the
rates (S3 figure 4, Mahony's filter with one vector). The proportional gain depends on non-gravity acceleration and
rotary speed (fuzzy table 1 of S3). Derivation, limits and observability: ``docs/methods/fuzzy_mahony.md``.
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

# Change of k_p, 1/s, by S3 table 1 and eq (12). Rows: rotary speed small, medium, large; columns: non-gravity
# acceleration small, medium, large.
RULES: Array = np.array([[0.06, 0.03, -0.03], [0.0, 0.0, -0.03], [0.0, -0.03, -0.06]])
WINDOW_MOST = 512  # largest value of `MahonyParams.window`
RPM = 60.0 / (2.0 * math.pi)  # r/min in one rad/s
# Assumed correlation time of the disturbance during a start, s.
_ALIKE = 0.03
# Smallest bandwidth of the low-pass of the error signal, 1/s; and bandwidth of the low-pass of the squared error, as a
# share of the bandwidth of the low-pass of the error signal.
_SLOWEST, _SQUARE_SHARE = 0.02, 0.3

_INITIALISING = int(Status.INITIALISING)

State = NDArray[np.void]  #: one record with the fields of `MahonyRecord`, shape (1,); a run can continue from a copy


class MahonyParams(NamedTuple):
    """Settings of the method of paper S3; with `fuzzy` False the method is the plain PI filter (Mahony)."""

    #: `k_p`, `k_i`: base proportional gain, 1/s, and integral gain, 1/s^2; k_i = 0 does not estimate the gyro bias.
    k_p: float = 0.15
    k_i: float = 0.003
    k_p_least: float = 0.01  #: smallest proportional gain that the fuzzy table can set, 1/s
    fuzzy: bool = True  #: whether the fuzzy table changes the proportional gain
    window: int = 20  #: number of samples whose largest non-gravity acceleration enters the table, at most WINDOW_MOST
    coning: float = 0.0  #: share of the 1/12 coning term: 1 for mean rates, 0 if the sensor integrates (strapdown)
    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2
    start_s: float = 2.0  #: averaging time of the first estimate, in gyro axes, s
    #: `gyro_range`, `accel_range`: rate, rad/s, and force, m/s^2, at which the sensors clip.
    gyro_range: float = math.radians(2000.0)
    accel_range: float = 16.0 * STANDARD_GRAVITY
    sigma_floor: float = 0.003  #: smallest sigma, rad


class MahonyRecord:
    """State of the filter of paper S3."""

    #: `clock`, `motion`: common to all methods, kept by `track.admit` and `track.follow_motion`.
    clock: track.TrackClock
    motion: track.TrackMotion
    down: Annotated[Array, 3]  #: unit vector down, tool axes
    integral: Annotated[Array, 3]  #: integral correction of the rates, rad/s
    last_angle: Annotated[Array, 3]  #: rotation angle of the previous sample, rad
    #: `mean`, `mean_power`: integrals over a start, s. `mean` integrates minus the force divided by gravity, rotated by
    #: the gyro; `mean_power` integrates the squared difference between this vector and `down`.
    mean: Annotated[Array, 3]
    mean_power: float
    #: `slow_error`, `slow_power`: error signal (cross product of measured and propagated direction, rad), low-passed at
    #: the bandwidth of the filter, and its mean square per axis, rad^2.
    slow_error: Annotated[Array, 3]
    slow_power: float
    start_power: float  #: remaining mean square error of the start, rad^2
    #: `age`, `non_gravity`, `sigma`: time since the start, s; magnitude of the non-gravity acceleration, m/s^2; 1 sigma
    #: of the direction, rad.
    age: float
    non_gravity: float
    sigma: float
    #: `ring`, `ring_at`: non-gravity acceleration of the last samples, m/s^2, and the index for the next sample.
    ring: Annotated[Array, WINDOW_MOST]
    ring_at: int


RECORD = dtype_of(MahonyRecord)


def initial(params: MahonyParams) -> State:  # noqa: ARG001  (every method has this signature)
    """Return the state before the first sample, shape (1,), dtype RECORD."""
    state = np.zeros(1, RECORD)
    state["down"] = np.nan
    state["sigma"] = math.pi
    return state


def run(params: MahonyParams, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Return gravity of each sample of a block.

    Parameters
    ----------
    state : State
        State of the filter, changed in place; the result does not depend on how the samples are cut into blocks.
    stamp_ns : array_like of int64, shape (n,)
        Stamps.
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, in tool axes.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    _run(params, state[0], stamps, gyro, accel, out)
    return out


@compiled
def membership(value: float, low: float, middle: float, high: float) -> tuple[float, float, float]:
    """
    Return the triangular memberships (small, medium, large) of a value, S3 figure 3 a, b.

    They are (1, 0, 0) up to `low`, (0, 1, 0) at `middle`, and (0, 0, 1) from `high` on.
    """
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
def fuzzy_step(non_gravity: float, rotary_rpm: float) -> float:
    """
    Return the change of k_p, 1/s, by S3 table 1 and eq (13): minimum for AND, centroid of the active rules.

    non_gravity is in m/s^2 (eq 9 divides by g0, but the ranges of eq 12 do not), rotary_rpm in r/min.
    """
    v = membership(non_gravity, 0.0, 25.0, 50.0)
    r = membership(abs(rotary_rpm), 0.0, 100.0, 200.0)
    top = 0.0
    bottom = 0.0
    for i in range(3):
        for j in range(3):
            weight = min(r[i], v[j])
            top += weight * RULES[i, j]
            bottom += weight
    return top / bottom


@compiled
def _run(p: MahonyParams, s: Any, stamps: Stamps, gyro: Array, accel: Array, out: Track) -> None:
    for i in range(len(stamps)):
        w, f = (gyro[i, 0], gyro[i, 1], gyro[i, 2]), (accel[i, 0], accel[i, 1], accel[i, 2])
        verdict, dt, bits = track.take(s.clock, stamps[i], w, f, track.GAP_NS, p.gyro_range, p.accel_range)
        if verdict == track.REJECTED:
            if s.age < p.start_s or not s.clock.started:
                bits |= _INITIALISING
        else:
            u = (-f[0] / p.gravity, -f[1] / p.gravity, -f[2] / p.gravity)
            if verdict != track.NEXT:
                dt = 0.0
                _begin(p, s)
            bx, by, bz = w[0] * dt, w[1] * dt, w[2] * dt
            turn = coning_rotation(s.last_angle[0], s.last_angle[1], s.last_angle[2], bx, by, bz, p.coning)
            s.last_angle[0], s.last_angle[1], s.last_angle[2] = bx, by, bz
            s.age += dt
            if s.age < p.start_s or dt == 0.0:
                bits |= _INITIALISING
                _average(p, s, dt, u, turn)
            else:
                _correct(p, s, dt, w, u, turn)
            bits |= track.follow_motion(s.motion, dt, w, s.non_gravity)
            s.sigma = min(math.pi, math.sqrt(s.slow_power + s.start_power + p.sigma_floor * p.sigma_floor))
        for c in range(3):
            out.g_t[i, c] = s.down[c]
        track.write_row(out, i, math.hypot(s.down[1], s.down[2]), s.sigma, s.motion, bits)


@compiled
def _begin(p: MahonyParams, s: Any) -> None:
    """Begin the average of a start; keep the integral correction (minus the gyro bias) from before a data gap."""
    for c in range(3):
        s.last_angle[c] = s.mean[c] = s.slow_error[c] = 0.0
    s.age = s.slow_power = s.mean_power = 0.0
    for c in range(p.window):
        s.ring[c] = 0.0


@compiled
def _average(p: MahonyParams, s: Any, dt: float, u: Vector, turn: tuple[float, float, float]) -> None:
    """
    Average the force, rotated by the gyro, so that vibration averages out and rotation has no effect.

    dt, u, turn: as in `_correct`.
    """
    mx, my, mz = in_turned_axes(s.mean[0], s.mean[1], s.mean[2], turn[0], turn[1], turn[2])
    step = max(dt, 1e-3)
    mx += u[0] * step
    my += u[1] * step
    mz += u[2] * step
    s.mean[0], s.mean[1], s.mean[2] = mx, my, mz
    norm = math.sqrt(mx * mx + my * my + mz * mz)
    if norm > 0.0:
        s.down[0], s.down[1], s.down[2] = mx / norm, my / norm, mz / norm
    ex, ey, ez = u[0] - s.down[0], u[1] - s.down[1], u[2] - s.down[2]
    # Variance of the mean, for a disturbance that is correlated over `_ALIKE`.
    s.mean_power += step * (ex * ex + ey * ey + ez * ez)
    total = s.age + 1e-3
    s.start_power = s.mean_power / total * _ALIKE / (total + _ALIKE)
    s.non_gravity = p.gravity * math.sqrt(ex * ex + ey * ey + ez * ez)


@compiled
def _proportional_gain(p: MahonyParams, s: Any) -> float:
    """Return the present gain k_p, 1/s; the ring must already contain the non-gravity acceleration of the sample."""
    if not p.fuzzy:
        return p.k_p
    most = 0.0
    for c in range(p.window):
        most = max(most, s.ring[c])
    return max(p.k_p_least, p.k_p + fuzzy_step(most, s.motion.rotary_speed * RPM))


@compiled
def _correct(p: MahonyParams, s: Any, dt: float, w: Vector, u: Vector, turn: tuple[float, float, float]) -> None:
    """
    Propagate gravity by the raw gyro, and correct it by its difference from the accelerometer (S3 figure 4).

    dt: s; w: rate, rad/s; u: minus the force over gravity; turn: rotation vector of the sample, rad.
    """
    px, py, pz = turn
    hx, hy, hz = in_turned_axes(s.down[0], s.down[1], s.down[2], px, py, pz)
    ex, ey, ez = u[1] * hz - u[2] * hy, u[2] * hx - u[0] * hz, u[0] * hy - u[1] * hx
    dx, dy, dz = u[0] - hx, u[1] - hy, u[2] - hz
    s.non_gravity = p.gravity * math.sqrt(dx * dx + dy * dy + dz * dz)
    s.ring[s.ring_at] = s.non_gravity
    s.ring_at = (s.ring_at + 1) % p.window
    k_p = _proportional_gain(p, s)
    # Soon after a start, use the gain 1 / age, with which all samples have the same weight, like in a mean.
    gain = max(k_p, 1.0 / s.age) if k_p > 0.0 else 0.0
    s.integral[0] += p.k_i * ex * dt
    s.integral[1] += p.k_i * ey * dt
    s.integral[2] += p.k_i * ez * dt
    cx = w[0] + gain * ex + s.integral[0]
    cy = w[1] + gain * ey + s.integral[1]
    cz = w[2] + gain * ez + s.integral[2]
    ox, oy, oz = px + (cx - w[0]) * dt, py + (cy - w[1]) * dt, pz + (cz - w[2]) * dt
    gx, gy, gz = in_turned_axes(s.down[0], s.down[1], s.down[2], ox, oy, oz)
    norm = math.sqrt(gx * gx + gy * gy + gz * gz)
    s.down[0], s.down[1], s.down[2] = gx / norm, gy / norm, gz / norm
    # The error signal, low-passed at the bandwidth of the correction, is the error that remains.
    e = s.slow_error
    qx, qy, qz = in_turned_axes(e[0], e[1], e[2], px, py, pz)
    share = min(1.0, max(gain, _SLOWEST) * dt)
    e[0] = qx + share * (ex - qx)
    e[1] = qy + share * (ey - qy)
    e[2] = qz + share * (ez - qz)
    power = 0.5 * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    s.slow_power += _SQUARE_SHARE * share * (power - s.slow_power)
    # The error of the start decays as fast as the gain corrects it.
    s.start_power *= math.exp(-2.0 * gain * dt)
