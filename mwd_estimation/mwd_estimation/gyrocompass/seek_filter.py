# SPDX-License-Identifier: Apache-2.0
"""
Compiled filter of `north_seek`: 37 error states of a tool that lies in its hole, still or rotating.

The attitude is integrated in a level frame of unknown heading. For each sample only attitude, velocity and the
integrals of the Jacobian are computed. Each block of 0.1 s ends with a Kalman step (`seek_measurement`): the tool has
gained no velocity, and the hole axis and, at rest, the roll are unchanged. States and limits:
``docs/methods/gyrocompass.md``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import clip_flags, track
from mwd_estimation.gyrocompass.seek_measurement import LYING_VELOCITY, measure, sways
from mwd_estimation.gyrocompass.seek_state import Error, KernelParams, SeekPhase, SeekState, SeekSums, SeekWork
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR, STANDARD_GRAVITY
from mwd_sensors.core.kalman import level_matrix, propagate_covariance, rotate_left, rotate_right

_GYRO_FLAGS, _ACCEL_FLAG = clip_flags.AXIAL_GYRO | clip_flags.CROSS_GYRO, clip_flags.ACCEL
# A data gap longer than this restarts the seek, ns.
GAP_NS = 1_000_000_000
# Duration of the mean force that starts the filter, and time between two Kalman steps, s.
LEVEL_S, _BLOCK_S = 2.0, 0.1
# Random walk of the direction of the hole axis, rad/sqrt(s).
_AXIS_WALK = 0.0005 * DEG_PER_ROOT_HOUR
# Rotation after which a block ends, rad, a tenth of a turn: mean and two harmonics of the wobble need more than five
# blocks per turn.
_BLOCK_TURN = 0.64
# If the horizontal component of the unit vector along the mean tool axis is below this, the tool counts as vertical,
# and any heading is used.
_VERTICAL = 1e-3
# Start sigmas: tilt, rad; velocity, m/s; hole axis and roll relative to their references, rad; wobble once and twice
# per turn, rad. The last number is the start variance of the heading, rad^2; the level frame defines the heading.
_TILT, _VELOCITY, _DIRECTION, _WOBBLE_1, _WOBBLE_2, _HEADING_VARIANCE = 0.03, 0.1, 0.05, 0.02, 0.01, 1e-18
# Start sigma of the Earth rate, as a multiple of the horizontal Earth rate. It is large and equal in all horizontal
# directions, so that no azimuth is preferred, and large in the vertical, so that the data can contradict the latitude.
_EARTH_RATES = 3.0


@compiled
def sample(s: SeekState, half: Array, dt: float, w: Array, f: Array) -> None:
    """
    Propagate attitude and velocity by one sample, and add the sample to the integrals of the block, in place.

    half, shape (3, 3): filled with the attitude in the middle of the sample; dt: s; w, f, shape (3,): measured rate,
    rad/s, and force, m/s^2.
    """
    b, g, mat, sums = s.gyro_bias, s.g_sensitivity, s.mat, s.sums
    wx = (w[0] - b[0]) / (1.0 + s.scale_x)
    wy = w[1] - b[1] - s.leak[0] * wx - (g[0] + g[2]) * f[1] - (g[3] + g[1]) * f[2]
    wz = w[2] - b[2] - s.leak[1] * wx - (g[3] - g[1]) * f[1] - (g[0] - g[2]) * f[2]
    # The delayed y and z gyros measured at an earlier roll: rotate their rates by the roll since then.
    late = wx * s.lag
    c_late, s_late = math.cos(late), math.sin(late)
    wy, wz = c_late * wy + s_late * wz, c_late * wz - s_late * wy
    fx, gy, gz = f[0] - s.force_bias[0], f[1] - s.force_bias[1], f[2] - s.force_bias[2]
    # The accelerometer measured at a later roll than the x gyro: rotate the force back by this roll.
    ahead = wx * s.lead
    c, q = math.cos(ahead), math.sin(ahead)
    fy, fz = c * gy - q * gz, c * gz + q * gy
    en, ee, ed = s.earth_rate[0], s.earth_rate[1], s.earth_rate[2]
    rotate_left(mat, -dt * en, -dt * ee, -dt * ed)
    rotate_right(mat, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    for i in range(3):
        for j in range(3):
            half[i, j] = mat[i, j]
    rotate_right(mat, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    # Earth rate across the tool in tool axes; an error of the lag rotates it.
    ey = half[0, 1] * en + half[1, 1] * ee + half[2, 1] * ed
    ez = half[0, 2] * en + half[1, 2] * ee + half[2, 2] * ed
    sums.time += dt
    for i in range(3):
        a, u, v = half[i, 0], half[i, 1], half[i, 2]
        sums.mat[i, 0] += a * dt
        sums.mat[i, 1] += u * dt
        sums.mat[i, 2] += v * dt
        sums.scale[i] += a * wx * dt
        sums.lag[i] += (v * ey - u * ez) * wx * dt
        sums.force[i] += (a * fx + u * fy + v * fz) * dt
        # Errors of the y and z gyros are turned by the lag like their rates.
        u, v = c_late * u - s_late * v, s_late * u + c_late * v
        sums.bias[i, 0] += u * dt
        sums.bias[i, 1] += v * dt
        sums.leak[i, 0] += u * wx * dt
        sums.leak[i, 1] += v * wx * dt
        sums.g_sensitivity[i, 0] += (u * f[1] + v * f[2]) * dt
        sums.g_sensitivity[i, 1] += (u * f[2] - v * f[1]) * dt
        sums.g_sensitivity[i, 2] += (u * f[1] - v * f[2]) * dt
        sums.g_sensitivity[i, 3] += (u * f[2] + v * f[1]) * dt
    for i in range(2):
        sums.lead[i] += (half[i, 2] * fy - half[i, 1] * fz) * wx * dt
        s.velocity[i] += (half[i, 0] * fx + half[i, 1] * fy + half[i, 2] * fz) * dt
    sums.turn += wx * dt


@compiled
def _lose(p: KernelParams, s: SeekState, dt: float, w: Array, f: Array, flags: int) -> None:
    """
    Count a sample in which a gyro clipped, and add variance for the part that clipping gyros or accelerometers lose.

    A clipping gyro may lose a rate as large as its range, a clipping accelerometer as much velocity as it measured, as
    in `mwd_estimation.gravity.bounded`.
    """
    if flags & _GYRO_FLAGS or abs(w[1]) > p.gyro_range or abs(w[2]) > p.gyro_range:
        s.clipped += 1
        s.sums.lost_turn += (p.gyro_range * dt) ** 2
    if flags & _ACCEL_FLAG:
        shown = math.sqrt(f[0] ** 2 + f[1] ** 2 + f[2] ** 2) - STANDARD_GRAVITY
        s.sums.lost_velocity += (shown * dt) ** 2


@compiled
def transition(s: SeekState, phi: Array) -> None:
    """
    Fill the transition matrix of the block.

    phi, shape (5, 37): derivatives of attitude and velocity errors after the block with respect to all errors before.
    """
    sums = s.sums
    t = sums.time
    en, ee, ed = s.earth_rate[0] * t, s.earth_rate[1] * t, s.earth_rate[2] * t
    for i in range(5):
        for j in range(Error.SIZE):
            phi[i, j] = 0.0
        phi[i, i] = 1.0
    phi[0, 1], phi[0, 2], phi[1, 0], phi[1, 2], phi[2, 0], phi[2, 1] = ed, -ee, -ed, en, ee, -en
    for i in range(3):
        phi[i, Error.EARTH_RATE + i] = -t
        phi[i, Error.GYRO_BIAS] = -sums.mat[i, 0]
        phi[i, Error.SCALE_X] = -sums.scale[i]
        phi[i, Error.LAG] = -sums.lag[i]
        for j in range(2):
            phi[i, Error.GYRO_BIAS + 1 + j] = -sums.bias[i, j]
            phi[i, Error.LEAK + j] = -sums.leak[i, j]
        for j in range(4):
            phi[i, Error.G_SENSITIVITY + j] = -sums.g_sensitivity[i, j]
    # Velocity error: attitude error (mean of before and after) x force, minus the force bias.
    fx, fy, fz = sums.force[0], sums.force[1], sums.force[2]
    for j in range(Error.SIZE):
        m0 = 0.5 * (phi[0, j] + (1.0 if j == 0 else 0.0))
        m1 = 0.5 * (phi[1, j] + (1.0 if j == 1 else 0.0))
        m2 = 0.5 * (phi[2, j] + (1.0 if j == 2 else 0.0))
        phi[3, j] += m1 * fz - m2 * fy
        phi[4, j] += m2 * fx - m0 * fz
    for i in range(2):
        phi[3 + i, Error.LEAD] += sums.lead[i]
        for j in range(3):
            phi[3 + i, Error.FORCE_BIAS + j] -= sums.mat[i, j]


@compiled
def _predict(p: KernelParams, s: SeekState, work: SeekWork) -> None:
    P, t, mat = s.P, s.sums.time, s.sums.mat
    propagate_covariance(P, work.phi, work.rows)
    # White noise: isotropic with the density of y and z, plus the excess of the x gyro along the tool axis.
    n2, extra = p.gyro_noise**2 * t + s.sums.lost_turn, (p.gyro_x_noise**2 - p.gyro_noise**2) / t
    for i in range(3):
        P[i, i] += n2
        for j in range(3):
            P[i, j] += extra * mat[i, 0] * mat[j, 0]
        P[Error.GYRO_BIAS + i, Error.GYRO_BIAS + i] += p.bias_walk**2 * t
        _drift(s, i, t)
    for i in range(2):
        P[Error.VELOCITY + i, Error.VELOCITY + i] += p.accel_noise**2 * t + s.sums.lost_velocity
        P[Error.AXIS + i, Error.AXIS + i] += _AXIS_WALK**2 * t


@compiled
def _drift(s: SeekState, i: int, t: float) -> None:
    """Propagate the bias of gyro i by its ramp over a block of t seconds, in the estimate and in the covariance."""
    P, bias, ramp = s.P, Error.GYRO_BIAS + i, Error.BIAS_RAMP + i
    s.gyro_bias[i] += s.bias_ramp[i] * t
    for j in range(Error.SIZE):
        P[bias, j] += t * P[ramp, j]
    for j in range(Error.SIZE):
        P[j, bias] += t * P[j, ramp]


@compiled
def _begin(p: KernelParams, s: SeekState, work: SeekWork) -> None:
    """Set the level frame by the mean force, with the tool axis in the direction of its x axis; set the covariance."""
    level, mat, sums = work.level, s.mat, s.sums
    for i in range(3):
        work.down[i], work.forward[i] = -sums.force[i], sums.mat[i, 0]
    level_matrix(work.down, work.forward, _VERTICAL * sums.time, level)
    for j in range(3):
        u, v, w = mat[0, j], mat[1, j], mat[2, j]
        for i in range(3):
            mat[i, j] = level[i, 0] * u + level[i, 1] * v + level[i, 2] * w
    # The heading of the frame is arbitrary, so start with a horizontal Earth rate of zero and a large sigma.
    s.earth_rate[0] = s.earth_rate[1] = 0.0
    s.earth_rate[2] = p.down
    s.roll = 0.0
    P = s.P
    for i in range(Error.SIZE):
        for j in range(Error.SIZE):
            P[i, j] = 0.0
    for j in range(8):
        s.wobble[j] = 0.0
        P[Error.WOBBLE + j, Error.WOBBLE + j] = (_WOBBLE_1 if j % 4 < 2 else _WOBBLE_2) ** 2
    for j in range(2):
        s.velocity[j] = s.axis[j] = 0.0
        P[Error.ATTITUDE + j, Error.ATTITUDE + j] = _TILT**2
        P[Error.VELOCITY + j, Error.VELOCITY + j] = _VELOCITY**2 + LYING_VELOCITY**2
        P[Error.AXIS + j, Error.AXIS + j] = _DIRECTION**2
    for j in range(3):
        P[Error.EARTH_RATE + j, Error.EARTH_RATE + j] = (_EARTH_RATES * p.horizontal) ** 2
    P[Error.ATTITUDE + 2, Error.ATTITUDE + 2] = _HEADING_VARIANCE
    P[Error.ROLL, Error.ROLL] = _DIRECTION**2
    _begin_instrument(p, s)


@compiled
def _begin_instrument(p: KernelParams, s: SeekState) -> None:
    """Set the errors of the instrument to the values and sigmas of the parameters."""
    P = s.P
    s.scale_x, s.lag, s.lead = 0.0, p.lag, p.lead
    for j in range(4):
        s.g_sensitivity[j] = p.g_calibration[j]
        at = Error.G_SENSITIVITY + j
        P[at, at] = p.g_sensitivity**2
    for j in range(2):
        s.leak[j] = 0.0
        P[Error.LEAK + j, Error.LEAK + j] = p.leak**2
    P[Error.SCALE_X, Error.SCALE_X] = p.scale_x**2
    P[Error.LAG, Error.LAG] = p.lag_sigma**2
    P[Error.LEAD, Error.LEAD] = p.lead_sigma**2
    for j in range(3):
        s.gyro_bias[j] = s.force_bias[j] = s.bias_ramp[j] = 0.0
        P[Error.FORCE_BIAS + j, Error.FORCE_BIAS + j] = p.accel_bias**2
        P[Error.GYRO_BIAS + j, Error.GYRO_BIAS + j] = p.start_bias[j] ** 2
        P[Error.BIAS_RAMP + j, Error.BIAS_RAMP + j] = p.bias_ramp**2


@compiled
def clear(sums: SeekSums) -> None:
    """Clear the sums for a new block."""
    sums.time = sums.turn = sums.lost_turn = sums.lost_velocity = 0.0
    for i in range(3):
        sums.force[i] = sums.scale[i] = sums.lag[i] = 0.0
        for j in range(3):
            sums.mat[i, j] = 0.0
        for j in range(2):
            sums.bias[i, j] = sums.leak[i, j] = 0.0
        for j in range(4):
            sums.g_sensitivity[i, j] = 0.0
    for j in range(2):
        sums.lead[j] = 0.0


@compiled
def reset(s: SeekState) -> None:
    """Begin the seek again, after a data gap or because the tool sways; keep the clock and the scatter."""
    clear(s.sums)
    for i in range(3):
        s.gyro_bias[i] = s.force_bias[i] = s.bias_ramp[i] = s.earth_rate[i] = s.down_axes[i] = 0.0
        for j in range(3):
            s.mat[i, j] = 1.0 if i == j else 0.0
    for i in range(2):
        s.velocity[i] = s.leak[i] = s.axis_difference2[i] = 0.0
    for i in range(4):
        s.g_sensitivity[i] = 0.0
    s.scale_x = s.lag = s.lead = 0.0
    s.phase = SeekPhase.LEVELLING
    s.settled = s.seen = s.still_run = s.positions = s.refused_blocks = s.moved = s.samples = s.clipped = 0
    s.level_time = s.elapsed = s.still_time = s.turn_time = s.down_force = 0.0


@compiled
def advance(
    p: KernelParams, s: SeekState, work: SeekWork, stamps: Stamps, gyro: Array, accel: Array, clipped: NDArray[np.uint8]
) -> None:
    """
    Process samples as in `north_seek.run`: call `sample` for each, with a Kalman step at the end of each block.

    The seek begins anew after a gap, or if the tool sways. A sample whose stamp is refused is left out.
    """
    for i in range(len(stamps)):
        w, f = gyro[i], accel[i]
        last = s.clock.last_ns
        verdict = track.admit(s.clock, stamps[i], w, f, GAP_NS)
        s.samples += 1
        if verdict == track.REJECTED or verdict == track.FIRST:
            continue
        if verdict == track.AFTER_GAP:
            reset(s)
            # The tool may have moved differently during the gap, so forget the scatter.
            for j in range(3):
                s.scatter[j] = 0.0
            continue
        dt = (stamps[i] - last) * 1e-9
        _lose(p, s, dt, w, f, clipped[i])
        sample(s, work.half, dt, w, f)
        if s.phase == SeekPhase.LEVELLING:
            s.level_time += dt
            if s.level_time < LEVEL_S - 1e-9:
                continue
            _begin(p, s, work)
            s.phase = SeekPhase.SETTLING
        elif s.sums.time >= _BLOCK_S - 1e-9 or abs(s.sums.turn) > _BLOCK_TURN:
            transition(s, work.phi)
            _predict(p, s, work)
            measure(s, work)
            if sways(s):
                reset(s)
        else:
            continue
        clear(s.sums)
