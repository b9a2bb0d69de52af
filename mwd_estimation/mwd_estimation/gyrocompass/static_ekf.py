# SPDX-License-Identifier: Apache-2.0
"""
S1: true north from the Earth's rotation by a 15-state error-state Kalman filter and a tool that does not move.

The states are position, velocity, attitude, gyro bias and accelerometer bias. Strapdown mechanisation in
north-east-down uses the Earth rate of a known latitude. The only measurement is z = [I6 0] x: position and velocity are
zero (S1 section 2.2). A coarse alignment from the mean rate and force starts the filter. The figures of the unit are
those of `SeekParams`. Derivation, observability and limits: ``docs/methods/gyrocompass.md``. The method
`mwd_estimation.gyrocompass.north_seek` gives better results from the same data.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import track
from mwd_estimation.gyrocompass.seek_state import KernelParams, SeekParams, kernel_params
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.frames import hole_angles, wrap_tau
from mwd_sensors.core.kalman import (
    level_matrix,
    propagate_covariance,
    reset_state,
    rotate_left,
    rotate_right,
    scalar_update,
)
from mwd_sensors.core.records import dtype_of

# 1 sigma of the position of the tool about its resting point, m, and of its velocity, m/s.
_SIGMA_POSITION, _SIGMA_VELOCITY = 0.001, 0.001
# A data gap longer than this restarts the filter, ns.
_GAP_NS = 500_000_000
MOVED_RATIO = 5.0
"""Mean ratio of squared innovation to its variance above which the tool has moved."""


class StaticErrors(NamedTuple):
    """
    Index of the first axis of each quantity in the error state (S1; true minus estimate); SIZE: number of entries.

    POSITION, VELOCITY and ATTITUDE are in NED, m, m/s and rad; biases are in tool axes, rad/s and m/s^2.
    """

    POSITION: int = 0
    VELOCITY: int = 3
    ATTITUDE: int = 6
    GYRO_BIAS: int = 9
    ACCEL_BIAS: int = 12
    SIZE: int = 15


Error = StaticErrors()


class StaticState:
    """State of the static alignment filter (paper S1)."""

    clock: track.TrackClock  #: clock for `mwd_estimation.core.track.admit`
    aligned: bool  #: whether the coarse alignment is done
    #: `mean_time`, `rate`, `force`: float, shape (3,), shape (3,); duration of the coarse alignment, s, and integrals
    #: of rate, rad, and force, m/s.
    mean_time: float
    rate: Annotated[Array, 3]
    force: Annotated[Array, 3]
    ratio: float  #: ratio of squared innovation to its variance, averaged over a second
    #: `position`, `velocity`, `gyro_bias`, `accel_bias`: shape (3,); estimates, m and m/s in NED, rad/s and m/s^2 in
    #: tool axes.
    position: Annotated[Array, 3]
    velocity: Annotated[Array, 3]
    #: `mat`, `mat_coarse`: shape (3, 3); rotation from tool axes to NED now, and at the coarse alignment. Every
    #: transition uses `mat_coarse`, because the tool does not move. With `mat`, the unobservable combination of azimuth
    #: and east gyro bias would change with each correction, and sigma would become too small.
    mat: Annotated[Array, 3, 3]
    mat_coarse: Annotated[Array, 3, 3]
    gyro_bias: Annotated[Array, 3]
    accel_bias: Annotated[Array, 3]
    P: Annotated[Array, 15, 15]  #: covariance of the error, in the order of `Error`

    if TYPE_CHECKING:

        def copy(self) -> StaticState:
            """Return an independent copy, like every numpy record."""
            ...


class StaticWork:
    """Scratch space of the Kalman step: rows of the transition, their product with P, error, and product P h'."""

    phi: Annotated[Array, 9, 15]
    rows: Annotated[Array, 9, 15]
    error: Annotated[Array, 15]
    ph: Annotated[Array, 15]


STATE, WORK = dtype_of(StaticState), dtype_of(StaticWork)


class StaticNorth(NamedTuple):
    """Attitude from true north; NaN, with sigmas of pi, until the coarse alignment is done."""

    #: `azimuth`, `sigma`: azimuth of the hole axis and 1 sigma, rad, at most pi.
    azimuth: float
    sigma: float
    #: `inclination`, `toolface`: angles, rad.
    inclination: float
    toolface: float


def initial() -> StaticState:
    """Return the state before the first sample, a record of dtype STATE."""
    return cast(StaticState, np.zeros(1, STATE)[0])


def run(params: SeekParams, state: StaticState, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> None:
    """
    Process a block of samples of a tool that does not move; call `north` for the azimuth at any time.

    Parameters
    ----------
    params : SeekParams
        Parameters; the first half of `shortest` is the coarse alignment.
    state : StaticState
        State of the filter, changed in place; the result does not depend on how the samples are cut into blocks.
    stamp_ns : array_like of int64, shape (n,)
        Stamps.
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, of the precision unit in tool axes.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    _advance(kernel_params(params), state, np.zeros(1, WORK)[0], stamps, gyro, accel)


def north(state: StaticState) -> StaticNorth:
    """Return the attitude after the samples so far."""
    if not state.aligned:
        return StaticNorth(math.nan, math.pi, math.nan, math.nan)
    inclination, azimuth, toolface = hole_angles(state.mat)
    # The hole axis is the first column; attitude errors change its azimuth with the variance H P H'.
    P, (an, ae, ad) = state.P, state.mat[:, 0]
    n, e, d = Error.ATTITUDE, Error.ATTITUDE + 1, Error.ATTITUDE + 2
    across2 = an * an + ae * ae
    sigma = math.pi
    if across2 >= 1e-12:
        hn, he = -an * ad / across2, -ae * ad / across2
        variance = hn * hn * P[n, n] + he * he * P[e, e] + P[d, d]
        variance += 2.0 * (hn * he * P[n, e] + hn * P[n, d] + he * P[e, d])
        sigma = min(math.pi, math.sqrt(variance))
    return StaticNorth(float(wrap_tau(azimuth)), sigma, float(inclination), float(toolface))


@compiled
def propagate(p: KernelParams, s: StaticState, dt: float, w: Array, f: Array) -> None:
    """
    Propagate the estimate by one sample, in place.

    dt: s; w, f, shape (3,): mean rate, rad/s, and force, m/s^2.
    """
    mat, v = s.mat, s.velocity
    ax, ay, az = f[0] - s.accel_bias[0], f[1] - s.accel_bias[1], f[2] - s.accel_bias[2]
    vn, ve, vd = v[0], v[1], v[2]
    for i in range(3):
        s.position[i] += v[i] * dt
    # v' = C f + g - 2 w_ie x v; transport rate and gravity gradient are zero for a tool that does not move.
    v[0] += dt * (mat[0, 0] * ax + mat[0, 1] * ay + mat[0, 2] * az + 2.0 * p.down * ve)
    v[1] += dt * (mat[1, 0] * ax + mat[1, 1] * ay + mat[1, 2] * az - 2.0 * (p.down * vn - p.horizontal * vd))
    v[2] += dt * (mat[2, 0] * ax + mat[2, 1] * ay + mat[2, 2] * az + p.gravity - 2.0 * p.horizontal * ve)
    b = s.gyro_bias
    rotate_right(mat, dt * (w[0] - b[0]), dt * (w[1] - b[1]), dt * (w[2] - b[2]))
    rotate_left(mat, -dt * p.horizontal, 0.0, -dt * p.down)


@compiled
def transition(p: KernelParams, mat: Array, dt: float, ax: float, ay: float, az: float, phi: Array) -> None:
    """
    Fill phi, shape (9, 15), with the rows of Phi = I + F T of the error state (S1) that are not identity.

    mat: rotation from tool axes to NED; dt: s; ax, ay, az: force without bias, m/s^2.
    """
    north, down = p.horizontal, p.down
    fn = mat[0, 0] * ax + mat[0, 1] * ay + mat[0, 2] * az
    fe = mat[1, 0] * ax + mat[1, 1] * ay + mat[1, 2] * az
    fd = mat[2, 0] * ax + mat[2, 1] * ay + mat[2, 2] * az
    for i in range(9):
        for j in range(Error.SIZE):
            phi[i, j] = 0.0
        phi[i, i] = 1.0
    for i in range(3):
        phi[i, Error.VELOCITY + i] = dt
        for j in range(3):
            phi[Error.VELOCITY + i, Error.ACCEL_BIAS + j] = -dt * mat[i, j]
            phi[Error.ATTITUDE + i, Error.GYRO_BIAS + j] = -dt * mat[i, j]
    # Rows v' and phi' of velocity and attitude error: -2 w_ie x v, attitude error x force, -w_ie x attitude error.
    v, a = Error.VELOCITY, Error.ATTITUDE
    phi[v, v + 1], phi[v + 1, v], phi[v + 1, v + 2] = 2.0 * dt * down, -2.0 * dt * down, 2.0 * dt * north
    phi[v + 2, v + 1] = -2.0 * dt * north
    phi[v, a + 1], phi[v, a + 2] = dt * fd, -dt * fe
    phi[v + 1, a], phi[v + 1, a + 2] = -dt * fd, dt * fn
    phi[v + 2, a], phi[v + 2, a + 1] = dt * fe, -dt * fn
    phi[a, a + 1], phi[a + 1, a], phi[a + 1, a + 2], phi[a + 2, a + 1] = dt * down, -dt * down, dt * north, -dt * north


@compiled
def _predict(p: KernelParams, P: Array, dt: float, w: StaticWork) -> None:
    propagate_covariance(P, w.phi, w.rows)
    for i in range(3):
        P[Error.VELOCITY + i, Error.VELOCITY + i] += p.accel_noise**2 * dt
        P[Error.ATTITUDE + i, Error.ATTITUDE + i] += p.gyro_noise**2 * dt
        P[Error.GYRO_BIAS + i, Error.GYRO_BIAS + i] += p.bias_walk**2 * dt


@compiled
def _correct(s: StaticState, error: Array) -> None:
    """Apply an estimated error, shape (15,), to the estimate."""
    rotate_left(s.mat, error[Error.ATTITUDE], error[Error.ATTITUDE + 1], error[Error.ATTITUDE + 2])
    for j in range(3):
        s.position[j] += error[Error.POSITION + j]
        s.velocity[j] += error[Error.VELOCITY + j]
        s.gyro_bias[j] += error[Error.GYRO_BIAS + j]
        s.accel_bias[j] += error[Error.ACCEL_BIAS + j]


@compiled
def _not_moved(s: StaticState, w: StaticWork) -> float:
    """
    Measure position and velocity as zero, because the tool stays in place, and correct the state.

    The six measurements are scalar updates. Returns the mean of the squared innovations, each divided by its variance.
    """
    error, ph = w.error, w.ph
    for j in range(Error.SIZE):
        error[j] = 0.0
    ratio = 0.0
    for m in range(6):
        known = s.position[m] if m < 3 else s.velocity[m - 3]
        r = _SIGMA_POSITION if m < 3 else _SIGMA_VELOCITY
        for j in range(Error.SIZE):
            ph[j] = s.P[j, m]
        variance = ph[m] + r * r
        innovation = -known - error[m]
        ratio += innovation * innovation / variance
        scalar_update(s.P, error, ph, variance, innovation)
    _correct(s, error)
    return ratio / 6.0


@compiled
def _align(p: KernelParams, s: StaticState) -> None:
    """
    Align coarsely: down from the mean force, north from the horizontal part of the mean rate.

    The start covariance is the linear map of both biases and both noises. Thus the azimuth error is correlated from the
    start with the gyro bias that causes it, and the data of the alignment are not used twice.
    """
    t, P, mat = s.mean_time, s.P, s.mat
    for i in range(3):
        s.force[i] = -s.force[i]
        s.rate[i] /= t
        s.position[i] = s.velocity[i] = s.gyro_bias[i] = s.accel_bias[i] = 0.0
    # Without any horizontal rate the gyro is dead: use any north; the innovations then show the fault.
    level_matrix(s.force, s.rate, 1e-12, mat)
    for i in range(3):
        for j in range(3):
            s.mat_coarse[i, j] = mat[i, j]
    for i in range(Error.SIZE):
        reset_state(P, i, 0.0)
    va, vg = p.accel_bias**2, p.gyro_bias**2
    for i in range(3):
        P[Error.GYRO_BIAS + i, Error.GYRO_BIAS + i] = vg
        P[Error.ACCEL_BIAS + i, Error.ACCEL_BIAS + i] = va
    # Attitude error as a sum over causes: rows of the map for accelerometer (north, east) and gyro (east) errors.
    noise_a, noise_g = p.accel_noise**2 / t, p.gyro_noise**2 / t
    azimuth = Error.ATTITUDE + 2
    for j in range(3):
        a_n, a_e = mat[0, j], mat[1, j]
        tilt_n, tilt_e = a_e / p.gravity, -a_n / p.gravity
        turn_a, turn_g = tilt_n * p.down / p.horizontal, a_e / p.horizontal
        cause = (tilt_n, tilt_e, turn_a)
        for r in range(3):
            P[Error.ATTITUDE + r, Error.ACCEL_BIAS + j] += cause[r] * va
            P[Error.ACCEL_BIAS + j, Error.ATTITUDE + r] += cause[r] * va
            for c in range(3):
                P[Error.ATTITUDE + r, Error.ATTITUDE + c] += cause[r] * cause[c] * (va + noise_a)
        P[azimuth, Error.GYRO_BIAS + j] += turn_g * vg
        P[Error.GYRO_BIAS + j, azimuth] += turn_g * vg
        P[azimuth, azimuth] += turn_g * turn_g * (vg + noise_g)
    for i in range(3):
        # At the alignment the tool defines the origin and is at rest within its stated motion.
        P[i, i] = _SIGMA_POSITION**2
        P[Error.VELOCITY + i, Error.VELOCITY + i] = _SIGMA_VELOCITY**2
    s.aligned, s.ratio = True, 1.0


@compiled
def _take(p: KernelParams, s: StaticState, work: StaticWork, dt: float, w: Array, f: Array) -> None:
    """Process one sample, in the coarse alignment or as one step of the filter."""
    if not s.aligned:
        s.mean_time += dt
        for j in range(3):
            s.rate[j] += w[j] * dt
            s.force[j] += f[j] * dt
        if s.mean_time >= p.coarse_seconds - 1e-9:
            _align(p, s)
        return
    # Use gravity instead of the measured force in the transition: the noise of the force would act like a motion that
    # makes the azimuth observable.
    g, down = -p.gravity, s.mat_coarse[2]
    transition(p, s.mat_coarse, dt, g * down[0], g * down[1], g * down[2], work.phi)
    propagate(p, s, dt, w, f)
    _predict(p, s.P, dt, work)
    s.ratio += min(1.0, dt) * (_not_moved(s, work) - s.ratio)


@compiled
def _advance(p: KernelParams, s: StaticState, work: StaticWork, stamps: Stamps, gyro: Array, accel: Array) -> None:
    """Process samples as in `run`."""
    for i in range(len(stamps)):
        w, f = gyro[i], accel[i]
        last = s.clock.last_ns
        verdict = track.admit(s.clock, stamps[i], w, f, _GAP_NS)
        if verdict == track.NEXT:
            _take(p, s, work, (stamps[i] - last) * 1e-9, w, f)
        elif verdict != track.REJECTED:
            s.aligned, s.mean_time, s.ratio = False, 0.0, 0.0
            for j in range(3):
                s.rate[j] = s.force[j] = 0.0
