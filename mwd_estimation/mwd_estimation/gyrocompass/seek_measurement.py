# SPDX-License-Identifier: Apache-2.0
"""
Measurements at the end of a block of a north seek: constraints on a tool that lies in its hole.

The tool gains no velocity; the hole axis does not move; if the tool does not rotate, its roll does not change. The
scatter of axis and roll from block to block is estimated and used as the noise of the last two measurements.
"""

from __future__ import annotations

import math

from mwd_estimation.gyrocompass.seek_state import Error, SeekPhase, SeekState, SeekWork
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import project_covariance, reset_state, rotate_left, scalar_update

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
