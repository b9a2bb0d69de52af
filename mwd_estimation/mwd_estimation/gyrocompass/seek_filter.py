# SPDX-License-Identifier: Apache-2.0
"""
Compiled filter of `north_seek`: 37 error states of a tool that lies in its hole, still or rotating.

The attitude is integrated in a level frame of unknown heading. For each sample only attitude, velocity and the
integrals of the Jacobian are computed. Each block of 0.1 s ends with a Kalman step (`measure`): the tool has gained no
velocity, and the hole axis and, at rest, the roll are unchanged. The scatter of axis and roll from block to block is
estimated and used as the noise of these measurements. States and limits: ``docs/methods/gyrocompass.md``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import clip_flags, track
from mwd_estimation.gyrocompass.seek_state import Error, KernelParams, SeekPhase, SeekState, SeekSums, SeekWork
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR, STANDARD_GRAVITY
from mwd_sensors.core.kalman import (
    level_matrix,
    project_covariance,
    propagate_covariance,
    reset_state,
    rotate_left,
    rotate_right,
    scalar_update,
)

# Number of blocks for the initial estimate of the scatter of the hole axis.
_SETTLE_BLOCKS = 10
# Largest chi-square of a direction that is used; and number of ignored directions in a row after which the axis has
# moved.
_GATE, _MOVED_BLOCKS = 25.0, 5
# Start sigma of a direction relative to its reference, rad, and smallest noise of a direction, rad.
_DIRECTION, _LEAST_DIRECTION = 0.05, 1e-6
# 1 sigma of the velocity of a tool that lies in its hole, m/s; and rate about the axis below which it is at rest,
# rad/s.
LYING_VELOCITY, _STILL_RATE = 0.005, 0.05
# The weight of a block in the scatter is 1 / (_SCATTER_BLOCKS + n), with n the number of blocks so far, but at most
# _SCATTER_MOST, which is longer than a sway of the string.
_SCATTER_BLOCKS, _SCATTER_MOST = 10.0, 120.0
# Factor on the variance of a sway, and largest scatter without a sway, rad. A string sways to one side for many blocks,
# so its scatter does not average out like white noise. A sway with variance v and period p over a time T of n blocks
# causes as much drift of the axis as white noise with the variance v 12 p^2 n / (2 pi T)^2, which is 20 v for 20 s in a
# minute. Noise alone scatters by less than 0.001 deg.
_SWAYS, _NO_SWAY = 20.0, math.radians(0.003)
# Growth of the scatter of the axis in the first _SCATTER_MOST blocks at rest after which a seek begins again. Without
# it, of 120 seeks in a string that sways by 0.05 deg, one is beyond 3 sigma, and 59 instead of 5 are refused.
_SWAYS_MORE = 4.0
# Number of blocks at rest in a row after which the roll becomes a reference.
_REST_BLOCKS = 2


@compiled
def measure(s: SeekState, work: SeekWork) -> None:
    """
    Perform the Kalman step of a block with velocity zero and unchanged hole axis and roll.

    While settling, only the velocity is used; the roll is used only at rest.
    """
    for j in range(Error.SIZE):
        work.error[j] = 0.0
    for i in range(2):
        _clear(work.h)
        work.h[Error.VELOCITY + i] = 1.0
        innovation, spread = _look(s.P, work, -s.velocity[i])
        scalar_update(s.P, work.error, work.ph, spread + LYING_VELOCITY**2, innovation)
    if s.phase == SeekPhase.SETTLING:
        _settle(s)
    else:
        t = s.sums.time
        share = 1.0 / (_SCATTER_BLOCKS + min(float(s.seen), _SCATTER_MOST))
        s.seen += 1
        _hold_axis(s, work, share)
        quiet = abs(s.sums.turn) < _STILL_RATE * t
        if quiet and s.still_run >= _REST_BLOCKS:
            _hold_roll(s, work, share)
        s.still_run = s.still_run + 1 if quiet else 0
        if quiet:
            s.still_time += t
        else:
            s.turn_time += t
        s.elapsed += t
        # `force` is without the bias estimated so far. Add that bias, so that `down_force` is the sum of the readings.
        s.down_force += s.sums.force[2]
        for j in range(3):
            s.down_force += s.sums.mat[2, j] * s.force_bias[j]
            s.down_axes[j] += s.sums.mat[2, j]
    _correct(s, work.error)


@compiled
def sways(s: SeekState) -> bool:
    """
    Return whether a tool that has only rested scatters much more than when its seek began, 12 s earlier.

    A slow sway looks like a drift of the axis as long as its scatter is not known.
    """
    judged = s.phase == SeekPhase.SEEKING and s.seen == int(_SCATTER_MOST)
    if not judged or s.turn_time > 0.0 or s.moved > 0 or s.refused_blocks > 0:
        return False
    return bool(
        s.scatter[0] > _SWAYS_MORE * max(s.first_scatter[0], _NO_SWAY**2)
        or s.scatter[1] > _SWAYS_MORE * max(s.first_scatter[1], _NO_SWAY**2)
    )


@compiled
def frame(axis: Array) -> tuple[float, float, float, float, float]:
    """
    Return the unit vectors to the high side and to the right side of an axis, in the level frame.

    axis, shape (3,). Returns the three components of the high side and the two horizontal components of the right side.
    """
    hx, hy, hz = axis[0], axis[1], axis[2]
    across = math.sqrt(hx * hx + hy * hy)
    if across < 1e-6:
        return -math.copysign(1.0, hz), 0.0, 0.0, 0.0, 1.0
    rx, ry = -hy / across, hx / across
    return ry * hz, -rx * hz, rx * hy - ry * hx, rx, ry


@compiled
def _clear(h: Array) -> None:
    for j in range(len(h)):
        h[j] = 0.0


@compiled
def _look(P: Array, work: SeekWork, y: float) -> tuple[float, float]:
    """
    Return the innovation of a measurement y = h . error after the corrections so far, and its variance from P.

    The innovation is y - h . `work.error`, with the row h in `work.h`; `work.ph` is filled with P h.
    """
    for j in range(Error.SIZE):
        c = work.h[j]
        if c != 0.0:
            y -= c * work.error[j]
    return y, project_covariance(P, work.h, work.ph)


@compiled
def _hold(s: SeekState, work: SeekWork, which: int, y: float, share: float) -> bool:
    """
    Update with the change y, rad, of an angle that should not change; return False if it is beyond the gate.

    which: index of the angle in `SeekState.scatter`, from which the noise follows; share: weight of this block in the
    scatter.
    """
    innovation, spread = _look(s.P, work, y)
    r2 = max(_LEAST_DIRECTION**2, s.scatter[which], _SWAYS * (s.scatter[which] - _NO_SWAY**2))
    ok = innovation * innovation < _GATE * (spread + r2)
    # The scatter is the excess of the squared innovation over its predicted variance; it must not be negative.
    seen = max(min(innovation * innovation, _GATE * (spread + r2)) - spread, 0.0)
    s.scatter[which] += share * (seen - s.scatter[which])
    if ok:
        scalar_update(s.P, work.error, work.ph, spread + r2, innovation)
    return bool(ok)


@compiled
def _settle(s: SeekState) -> None:
    """Add a block to the initial estimate of the scatter of the hole axis; after `_SETTLE_BLOCKS`, begin to seek."""
    ax, ay, az = s.mat[0, 0], s.mat[1, 0], s.mat[2, 0]
    s.settled += 1
    if s.settled == 1:
        s.axis_reference[0], s.axis_reference[1], s.axis_reference[2] = ax, ay, az
    else:
        hx, hy, hz, rx, ry = frame(s.axis_reference)
        px, py, pz = ax - s.last_axis[0], ay - s.last_axis[1], az - s.last_axis[2]
        s.axis_difference2[0] += (px * hx + py * hy + pz * hz) ** 2
        s.axis_difference2[1] += (px * rx + py * ry) ** 2
    s.last_axis[0], s.last_axis[1], s.last_axis[2] = ax, ay, az
    if s.settled > _SETTLE_BLOCKS:
        s.phase = SeekPhase.SEEKING
        for j in range(2):
            # A restarted seek keeps the scatter of the earlier blocks as a lower limit.
            s.scatter[j] = max(0.5 * s.axis_difference2[j] / _SETTLE_BLOCKS, s.scatter[j])
            s.first_scatter[j] = s.scatter[j]
        s.scatter[2] = max(s.scatter[0], s.scatter[1])
        s.axis_reference[0], s.axis_reference[1], s.axis_reference[2] = ax, ay, az


@compiled
def _hold_axis(s: SeekState, work: SeekWork, share: float) -> None:
    """
    Update with the hole axis, which does not move except for a wobble once and twice per turn of the scribe line.

    If the axis is beyond the gate in `_MOVED_BLOCKS` blocks in a row, it has moved. share: as in `_hold`.
    """
    mat, reference, h = s.mat, s.axis_reference, work.h
    ax, ay, az, zx, zy, zz = mat[0, 0], mat[1, 0], mat[2, 0], mat[0, 2], mat[1, 2], mat[2, 2]
    hx, hy, hz, rx, ry = frame(reference)
    up, side = zx * hx + zy * hy + zz * hz, zx * rx + zy * ry
    ok = True
    for i in range(2):
        ux, uy, uz = (hx, hy, hz) if i == 0 else (rx, ry, 0.0)
        _clear(h)
        # -(phi x a).u = -phi.(a x u)
        h[0], h[1], h[2] = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
        h[Error.AXIS + i] = 1.0
        wobble = Error.WOBBLE + 4 * i
        h[wobble] = up
        h[wobble + 1] = side
        h[wobble + 2] = up * up - side * side
        h[wobble + 3] = 2.0 * up * side
        y = (ax - reference[0]) * ux + (ay - reference[1]) * uy + (az - reference[2]) * uz - s.axis[i]
        for j in range(4):
            y -= h[wobble + j] * s.wobble[4 * i + j]
        ok = _hold(s, work, i, y, share) and ok
    s.refused_blocks = 0 if ok else s.refused_blocks + 1
    if s.refused_blocks >= _MOVED_BLOCKS:
        # The axis has moved: let its direction be estimated again.
        s.refused_blocks = 0
        s.moved += 1
        for j in range(2):
            s.P[Error.AXIS + j, Error.AXIS + j] += _DIRECTION**2


@compiled
def _hold_roll(s: SeekState, work: SeekWork, share: float) -> None:
    """
    Update the filter by the roll of a tool at rest, which stays as at the start of the interval at rest.

    share: as in `_hold`.
    """
    mat, a, k, h = s.mat, s.axis_reference, s.roll_reference, work.h
    zx, zy, zz = mat[0, 2], mat[1, 2], mat[2, 2]
    if s.still_run == _REST_BLOCKS:
        k[0], k[1], k[2] = zx, zy, zz
        s.roll = 0.0
        work.error[Error.ROLL] = 0.0
        reset_state(s.P, Error.ROLL, _DIRECTION**2)
        s.positions += 1
        return
    ux, uy, uz = a[1] * k[2] - a[2] * k[1], a[2] * k[0] - a[0] * k[2], a[0] * k[1] - a[1] * k[0]
    _clear(h)
    h[0], h[1], h[2] = uy * zz - uz * zy, uz * zx - ux * zz, ux * zy - uy * zx
    h[Error.ROLL] = 1.0
    y = (zx - k[0]) * ux + (zy - k[1]) * uy + (zz - k[2]) * uz - s.roll
    if not _hold(s, work, 2, y, share):
        s.still_run = 0


@compiled
def _correct(s: SeekState, error: Array) -> None:
    """Apply an estimated error, shape (37,), to the estimate."""
    rotate_left(s.mat, error[0], error[1], error[2])
    for j in range(2):
        s.velocity[j] += error[Error.VELOCITY + j]
        s.leak[j] += error[Error.LEAK + j]
        s.axis[j] += error[Error.AXIS + j]
    for j in range(3):
        s.earth_rate[j] += error[Error.EARTH_RATE + j]
        s.gyro_bias[j] += error[Error.GYRO_BIAS + j]
        s.force_bias[j] += error[Error.FORCE_BIAS + j]
        s.bias_ramp[j] += error[Error.BIAS_RAMP + j]
    for j in range(4):
        s.g_sensitivity[j] += error[Error.G_SENSITIVITY + j]
    for j in range(8):
        s.wobble[j] += error[Error.WOBBLE + j]
    s.scale_x += error[Error.SCALE_X]
    s.lag += error[Error.LAG]
    s.roll += error[Error.ROLL]
    s.lead += error[Error.LEAD]


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
# Start sigmas: tilt, rad; velocity, m/s; wobble once and twice per turn, rad. The last number is the start variance of
# the heading, rad^2; the level frame defines the heading.
_TILT, _VELOCITY, _WOBBLE_1, _WOBBLE_2, _HEADING_VARIANCE = 0.03, 0.1, 0.02, 0.01, 1e-18
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
