# SPDX-License-Identifier: Apache-2.0
"""
Gravity of rejected samples, propagated to their own stamps.

A gravity method ignores a rejected sample and repeats its last estimate, but the tool keeps turning meanwhile. Here
gravity is rotated to the stamp of the rejected sample by the rate of the nearest used sample: forward from the last
one, or backward within the interval that contains a late stamp. The sigmas grow by the possible change of the rate in
that time, estimated from the changes of the last second. The toolface is unknown if the rejected sample is more than a
tenth of a second from the last used one, or if the nearest used sample is clipped.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Annotated

import numpy as np

from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core import ring
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import in_turned_axes
from mwd_sensors.core.records import dtype_of

_REJECTED, _GAP = int(Status.REJECTED), int(Status.GAP)
# Do not propagate from a clipped sample, or from a sample before the first estimate.
_UNSAFE = int(Status.CLIPPED | Status.INITIALISING)
_RING = 512  # number of used samples that are kept: 0.1 s at 5 kHz
_MAX_DISTANCE_NS = 100_000_000  # largest distance from the last used sample, ns
_MEMORY_NS = 1_000_000_000  # averaging time of the usual change of a rate, ns, limited by the samples kept


class RejectedState(ring.Ring):
    """Ring buffer of the last used samples."""

    rows: Annotated[MutableSequence[Sample], _RING]


STATE = dtype_of(RejectedState)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    return np.zeros(1, dtype=STATE)


def run(state: Samples, samples: Samples) -> None:
    """
    Propagate gravity to the stamps of the rejected samples of a block, in place.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State from `initial`, changed in place; the result does not depend on how the samples are cut into blocks.
    samples : ndarray of dtype `sample.SAMPLE`, shape (n,)
        Samples; for rejected samples, `down`, the sigmas, `turned` and `rate_x` are changed in place.
    """
    # If no sample is rejected, store only the last samples, which later blocks may need.
    rejected = (samples["status"] & _REJECTED != 0).any()
    _run(state, samples if rejected else samples[-_RING:])


@compiled
def _keep(s: RejectedState, sample: Sample) -> None:
    """Store a used sample; if it follows a data gap, drop the earlier ones."""
    if sample.status & _GAP != 0:
        s.length = 0
    s.rows[ring.next_place(s)] = sample


@compiled
def _changes(s: RejectedState, near: int) -> tuple[float, float]:
    """
    Return the squared angular accelerations along and across the axis, (rad/s^2)^2; NaN if unknown.

    Each is the larger of the mean square over the last second and the square at the sample with ring index `near`.
    """
    along, across, count = 0.0, 0.0, 0
    seen_along, seen_across = 0.0, 0.0
    newest = s.rows[ring.place(s, 1)]
    for back in range(1, s.length):
        place = ring.place(s, back)
        later, earlier = s.rows[place], s.rows[ring.place(s, back + 1)]
        step = (later.stamp_ns - earlier.stamp_ns) * 1e-9
        inverse = 1.0 / step if step > 0.0 else math.nan
        x = (later.gyro[0] - earlier.gyro[0]) * inverse
        y = (later.gyro[1] - earlier.gyro[1]) * inverse
        z = (later.gyro[2] - earlier.gyro[2]) * inverse
        change_along, change_across = x * x, y * y + z * z
        if math.isfinite(change_along + change_across):
            along, across, count = along + change_along, across + change_across, count + 1
            if place == near:
                seen_along, seen_across = change_along, change_across
        if newest.stamp_ns - earlier.stamp_ns > _MEMORY_NS:
            break
    if count == 0:
        return math.nan, math.nan
    return max(along / count, seen_along), max(across / count, seen_across)


@compiled
def _nearest(s: RejectedState, stamp: int) -> tuple[int, float]:
    """
    Return the ring index of the used sample from which gravity is propagated, and the step before this sample, s.

    The used sample is the first one at or after `stamp`, ns, or the last one if all used samples are earlier.
    """
    back = max(ring.first_from(s, stamp), 1)
    place = ring.place(s, back)
    if back == s.length:
        return place, 0.0
    return place, (s.rows[place].stamp_ns - s.rows[ring.place(s, back + 1)].stamp_ns) * 1e-9


@compiled
def _propagate(s: RejectedState, sample: Sample) -> None:
    """Rotate gravity to the stamp of a rejected sample; if this is impossible, mark its toolface as unknown."""
    sample.rate_x, down = math.nan, sample.down
    if not math.isfinite(down[0] + down[1] + down[2]):
        return
    last = s.rows[ring.place(s, 1)]
    away = sample.stamp_ns - last.stamp_ns
    if s.length > 0 and away == 0:
        sample.rate_x = last.gyro[0]
        return
    sample.turned, sample.sigma_down = math.inf, math.pi
    if s.length == 0 or abs(away) > _MAX_DISTANCE_NS:
        return
    place, before = _nearest(s, sample.stamp_ns)
    along, across = _changes(s, place)
    near = s.rows[place]
    if near.status & _UNSAFE != 0:
        return
    dt = (sample.stamp_ns - near.stamp_ns) * 1e-9
    gx, gy, gz = in_turned_axes(
        near.down[0], near.down[1], near.down[2], near.gyro[0] * dt, near.gyro[1] * dt, near.gyro[2] * dt
    )
    # A rate may be the mean over the interval before its stamp and then holds at the middle of this interval.
    grown = 0.5 * abs(dt) * (before + max(dt, 0.0))
    along, across = math.sqrt(along) * grown, math.sqrt(across) * grown
    size, side = math.sqrt(gx * gx + gy * gy + gz * gz), math.hypot(gy, gz)
    if not (math.isfinite(along + across + size) and side > 0.0):
        return
    sample.rate_x = near.gyro[0]
    down[0], down[1], down[2] = gx / size, gy / size, gz / size
    sample.turned = min(math.hypot(along, across * gx / side), math.pi)
    sample.sigma_inclination = min(math.hypot(sample.sigma_inclination, across), math.pi)
    sample.sigma_toolface = min(math.hypot(sample.sigma_toolface, sample.turned), math.pi)
    sample.sigma_down = max(sample.sigma_inclination, sample.sigma_toolface * side / size)


@compiled
def _run(state: Samples, samples: Samples) -> None:
    s: RejectedState = state[0]
    for i in range(len(samples)):
        if samples[i].status & _REJECTED == 0:
            _keep(s, samples[i])
        else:
            _propagate(s, samples[i])
