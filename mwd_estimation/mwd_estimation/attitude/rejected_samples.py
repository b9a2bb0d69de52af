# SPDX-License-Identifier: Apache-2.0
"""
Attitude of samples that the gravity method rejected: at their own stamp, not at that of the last sample used.

A gravity method leaves a rejected sample out and repeats its last estimate; the tool turns on meanwhile. Here gravity
is turned by the rate of the nearest sample used to the stamp of the rejected one: on from the last, or back within the
interval in which a stamp that came too late lies. Its sigmas grow by what the rate may have changed in that time, by
how fast rates have changed in the last second. Farther away than a tenth of a second, or from a sample at the limit of
its sensor, nothing is known of the toolface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from mwd_estimation.core import ring
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import in_turned_axes
from mwd_sensors.core.records import dtype_of

_REJECTED, _GAP = int(Status.REJECTED), int(Status.GAP)
# From a sample at the limit of its sensor, or before there is an estimate, nothing is propagated.
_UNSAFE = int(Status.CLIPPED | Status.INITIALISING)
_RING = 512  # samples used that are kept: 0.1 s at 5 kHz
_MAX_DISTANCE_NS = 100_000_000  # farther from the last sample used nothing is propagated
_MEMORY_NS = 1_000_000_000  # over which the usual change of a rate is taken, as far as the samples kept reach


class UsedSample:
    """A sample that was used: stamp, unit vector down, rate, rad/s, and whether nothing may be propagated from it."""

    stamp_ns: int
    down: Annotated[Array, 3]
    rate: Annotated[Array, 3]
    unsafe: bool


class State:
    """The samples used last, in a ring."""

    head: int
    length: int
    ring: Annotated[Sequence[UsedSample], _RING]


class PropagatedRow:
    """What the row of a sample is written with."""

    rate_x: float  #: about the axis, rad/s; of a rejected sample that by which it was propagated, nan where none was
    sigma_down: float  #: of the direction down, rad; of a used sample that of the inclination
    #: 1 sigma by which the toolfaces of a rejected sample are less certain, rad; 0 for a used one, infinite where
    #: nothing is known of it.
    turned: float


STATE, PROPAGATED_ROW = dtype_of(State), dtype_of(PropagatedRow)


def initial() -> Samples:
    """State before the first sample, shape (1,), dtype STATE; a copy of it resumes."""
    return np.zeros(1, dtype=STATE)


def run(state: Samples, stamps: Stamps, gyro: Array, track: Track) -> Samples:
    """
    Propagate gravity to the stamps of the rejected samples of a block; their rows of `track` are changed in place.

    Parameters
    ----------
    state : ndarray, shape (1,)
        From `initial`; changed in place. Blocks of any length give the same numbers.
    stamps, gyro : ndarray, shapes (n,) and (n, 3)
        Stamps, ns, and rates in tool axes, rad/s; nan where they are not to be used.
    track : Track

    Returns
    -------
    ndarray of dtype PROPAGATED_ROW, shape (n,)
    """
    rows = np.zeros(len(stamps), dtype=PROPAGATED_ROW)
    _run(state[0], stamps, gyro, track, rows)
    return rows


@compiled
def _keep(s: State, stamp: int, rate: Array, track: Track, i: int) -> None:
    """Take a sample that was used."""
    status = np.int64(track.status[i])
    if status & _GAP != 0:
        s.length = 0
    kept = s.ring[s.head]
    for k in range(3):
        kept.down[k], kept.rate[k] = track.g_t[i, k], rate[k]
    kept.unsafe = status & _UNSAFE != 0
    kept.stamp_ns = stamp
    s.head = ring.next_head(s.ring, s.head)
    s.length = min(s.length + 1, _RING)


@compiled
def _changes(s: State, near: int) -> tuple[float, float]:
    """
    How fast the rates about the axis and across it change, squared, (rad/s^2)^2; nan where that is unknown.

    That which was just seen at the sample at ring place `near`, or the usual, whichever is more.
    """
    along, across, count = 0.0, 0.0, 0
    seen_along, seen_across = 0.0, 0.0
    newest = ring.place(s.ring, s.head, 1)
    place = newest
    for _ in range(s.length - 1):
        before = ring.place(s.ring, place, 1)
        later, earlier = s.ring[place], s.ring[before]
        step = (later.stamp_ns - earlier.stamp_ns) * 1e-9
        inverse = 1.0 / step if step > 0.0 else math.nan
        x = (later.rate[0] - earlier.rate[0]) * inverse
        y = (later.rate[1] - earlier.rate[1]) * inverse
        z = (later.rate[2] - earlier.rate[2]) * inverse
        change_along, change_across = x * x, y * y + z * z
        if math.isfinite(change_along + change_across):
            along, across, count = along + change_along, across + change_across, count + 1
            if place == near:
                seen_along, seen_across = change_along, change_across
        if s.ring[newest].stamp_ns - earlier.stamp_ns > _MEMORY_NS:
            break
        place = before
    if count == 0:
        return math.nan, math.nan
    return max(along / count, seen_along), max(across / count, seen_across)


@compiled
def _nearest(s: State, stamp: int) -> tuple[int, float]:
    """Ring place of the sample to propagate from: the last, or the next after the stamp; s to the one before it."""
    back = max(ring.first_from(s.ring, s.head, s.length, stamp), 1)
    place = ring.place(s.ring, s.head, back)
    if back == s.length:
        return place, 0.0
    return place, (s.ring[place].stamp_ns - s.ring[ring.place(s.ring, s.head, back + 1)].stamp_ns) * 1e-9


@compiled
def _propagate(s: State, stamp: int, track: Track, i: int, row: PropagatedRow) -> None:
    """Turn gravity to the stamp of a rejected sample, as far as that is known."""
    row.rate_x = math.nan
    if not math.isfinite(track.g_t[i, 0] + track.g_t[i, 1] + track.g_t[i, 2]):
        return
    last = s.ring[ring.place(s.ring, s.head, 1)]
    away = stamp - last.stamp_ns
    if s.length > 0 and away == 0:
        row.rate_x = last.rate[0]
        return
    row.turned, row.sigma_down = math.inf, math.pi
    if s.length == 0 or abs(away) > _MAX_DISTANCE_NS:
        return
    place, before = _nearest(s, stamp)
    along, across = _changes(s, place)
    near = s.ring[place]
    if near.unsafe:
        return
    dt = (stamp - near.stamp_ns) * 1e-9
    gx, gy, gz = in_turned_axes(
        near.down[0], near.down[1], near.down[2], near.rate[0] * dt, near.rate[1] * dt, near.rate[2] * dt
    )
    # A rate may be the mean of the interval before it: half of that comes on top on the way on.
    grown = 0.5 * abs(dt) * (before + max(dt, 0.0))
    along, across = math.sqrt(along) * grown, math.sqrt(across) * grown
    size, side = math.sqrt(gx * gx + gy * gy + gz * gz), math.hypot(gy, gz)
    if not (math.isfinite(along + across + size) and side > 0.0):
        return
    row.rate_x = near.rate[0]
    track.g_t[i, 0], track.g_t[i, 1], track.g_t[i, 2] = gx / size, gy / size, gz / size
    row.turned = min(math.hypot(along, across * gx / side), math.pi)
    track.sigma_inclination[i] = min(math.hypot(track.sigma_inclination[i], across), math.pi)
    track.sigma_toolface[i] = min(math.hypot(track.sigma_toolface[i], row.turned), math.pi)
    row.sigma_down = min(math.hypot(track.sigma_inclination[i], along * side / size), math.pi)


@compiled
def _run(s: State, stamps: Stamps, gyro: Array, track: Track, rows: Samples) -> None:
    n, rejected = len(stamps), False
    for i in range(n):
        row = rows[i]
        row.turned, row.sigma_down, row.rate_x = 0.0, track.sigma_inclination[i], gyro[i, 0]
        rejected = rejected or np.int64(track.status[i]) & _REJECTED != 0
    # Where all are used, only the last ones are ever looked at again.
    for i in range(0 if rejected else max(n - _RING, 0), n):
        if np.int64(track.status[i]) & _REJECTED == 0:
            _keep(s, stamps[i], gyro[i], track, i)
        else:
            _propagate(s, stamps[i], track, i, rows[i])
