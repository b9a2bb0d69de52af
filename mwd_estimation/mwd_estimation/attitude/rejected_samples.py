"""
What the row of a sample that was not used says: the attitude at its own stamp, not the last one.

A gravity method leaves a refused sample out and repeats its last estimate; the tool turns on meanwhile. Here gravity is
turned by the rate of the nearest sample used to the stamp of the refused one: on from the last, or back within the
interval in which a stamp that came too late lies. Its sigmas grow by what the rate may have changed in that time, by
how fast rates have changed in the last second. Farther away than a tenth of a second, or from a sample at its limit,
nothing is known of the toolface.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.samples import Track
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import in_turned_axes

_REJECTED, _GAP = int(Status.REJECTED), int(Status.GAP)
# From a sample at its limit, or before there is an estimate, nothing is carried.
_UNSURE = int(Status.CLIPPED | Status.INITIALISING)
_RING = 512  # samples used that are kept: 0.1 s at 5 kHz
_NEAR_NS = 100_000_000  # farther from the last sample used nothing is carried
_MEMORY_NS = 1_000_000_000  # over which the usual change of a rate is taken, as far as the samples kept reach
# Row of the ring: unit vector down, rates, and whether nothing is carried from it.
_G, _W, _UNSAFE, _ROW = 0, 3, 6, 7
_HEAD, _LENGTH = 0, 1


@dataclasses.dataclass
class State:
    """Samples used last."""

    stamps: Stamps
    ring: Array
    place: Stamps

    def copy(self) -> State:
        """Independent copy."""
        return State(*(getattr(self, f.name).copy() for f in dataclasses.fields(self)))


@dataclasses.dataclass(frozen=True)
class Carried:
    """
    What the rows of n samples are written with, all of shape (n,).

    Attributes
    ----------
    rate_x : ndarray
        About the axis, rad/s; of a refused sample that which its row was carried by, NaN where none was.
    sigma_down : ndarray
        Of the direction down, rad; of used samples that of the inclination.
    turned : ndarray
        1 sigma by which a refused sample's toolfaces are less certain, rad; 0 for used ones, infinite where nothing is
        known of it.
    """

    rate_x: Array
    sigma_down: Array
    turned: Array


def initial() -> State:
    """State before the first sample."""
    return State(np.zeros(_RING, dtype=np.int64), np.zeros((_RING, _ROW)), np.zeros(2, dtype=np.int64))


def run(state: State, stamps: Stamps, gyro: Array, track: Track) -> Carried:
    """
    Carry gravity to the stamps of the refused samples of a block; their rows of `track` are changed in place.

    Parameters
    ----------
    state : State
        Changed in place; blocks of any length give the same numbers.
    stamps, gyro : ndarray, shapes (n,) and (n, 3)
        Stamps, ns, and rates in tool axes, rad/s; NaN where they are not to be used.
    track : Track
    """
    n = len(stamps)
    carried = Carried(np.empty(n), np.empty(n), np.empty(n))
    _run(
        state.stamps, state.ring, state.place, stamps, gyro, track.g_t, track.sigma_inclination,
        track.sigma_toolface, track.status, carried.rate_x, carried.sigma_down, carried.turned,
    )  # fmt: skip
    return carried


@compiled
def _keep(
    times: Stamps, ring: Array, place: Stamps, stamp: int, gyro: Array, g_t: Array, i: int, bits: np.int64
) -> None:
    """Take a sample that was used."""
    if bits & _GAP != 0:
        place[_LENGTH] = 0
    head = place[_HEAD]
    for k in range(3):
        ring[head, _G + k], ring[head, _W + k] = g_t[i, k], gyro[i, k]
    ring[head, _UNSAFE] = 1.0 if bits & _UNSURE != 0 else 0.0
    times[head] = stamp
    place[_HEAD] = (head + 1) % _RING
    place[_LENGTH] = min(place[_LENGTH] + 1, _RING)


@compiled
def _changes(times: Stamps, ring: Array, place: Stamps, near: int) -> tuple[float, float]:
    """
    How fast the rates about the axis and across it change, squared, (rad/s^2)^2; not a number where that is unknown.

    That which was just seen at the sample `near`, or the usual, whichever is more.
    """
    along, across, count = 0.0, 0.0, 0
    seen_along, seen_across = 0.0, 0.0
    newest = (place[_HEAD] - 1) % _RING
    later = newest
    for _ in range(place[_LENGTH] - 1):
        earlier = (later - 1) % _RING
        step = (times[later] - times[earlier]) * 1e-9
        inverse = 1.0 / step if step > 0.0 else math.nan
        x = (ring[later, _W] - ring[earlier, _W]) * inverse
        y = (ring[later, _W + 1] - ring[earlier, _W + 1]) * inverse
        z = (ring[later, _W + 2] - ring[earlier, _W + 2]) * inverse
        change_along, change_across = x * x, y * y + z * z
        if math.isfinite(change_along + change_across):
            along, across, count = along + change_along, across + change_across, count + 1
            if later == near:
                seen_along, seen_across = change_along, change_across
        if times[newest] - times[earlier] > _MEMORY_NS:
            break
        later = earlier
    if count == 0:
        return math.nan, math.nan
    return max(along / count, seen_along), max(across / count, seen_across)


@compiled
def _run(
    times: Stamps, ring: Array, place: Stamps, stamps: Stamps, gyro: Array, g_t: Array, sigma_inclination: Array,
    sigma_toolface: Array, status: NDArray[np.uint32], rate_x: Array, sigma_down: Array, turned: Array,
) -> None:  # fmt: skip
    n, refused = len(stamps), False
    for i in range(n):
        turned[i], sigma_down[i], rate_x[i] = 0.0, sigma_inclination[i], gyro[i, 0]
        refused = refused or np.int64(status[i]) & _REJECTED != 0
    # Where all are used, only the last ones are ever looked at again.
    for i in range(0 if refused else max(n - _RING, 0), n):
        stamp, bits = stamps[i], np.int64(status[i])
        if bits & _REJECTED == 0:
            _keep(times, ring, place, stamp, gyro, g_t, i, bits)
            continue
        rate_x[i] = math.nan
        if not math.isfinite(g_t[i, 0] + g_t[i, 1] + g_t[i, 2]):
            continue
        at = (place[_HEAD] - 1) % _RING
        away = stamp - times[at]
        if place[_LENGTH] > 0 and away == 0:
            rate_x[i] = ring[at, _W]
            continue
        turned[i], sigma_down[i] = math.inf, math.pi
        if place[_LENGTH] == 0 or abs(away) > _NEAR_NS:
            continue
        before = 0.0
        for back in range(2, place[_LENGTH] + 1):
            earlier = (place[_HEAD] - back) % _RING
            before = (times[at] - times[earlier]) * 1e-9
            if times[earlier] < stamp:
                break
            at, before = earlier, 0.0
        along, across = _changes(times, ring, place, at)
        near = ring[at]
        if near[_UNSAFE] != 0.0:
            continue
        dt = (stamp - times[at]) * 1e-9
        gx, gy, gz = in_turned_axes(
            near[_G], near[_G + 1], near[_G + 2], near[_W] * dt, near[_W + 1] * dt, near[_W + 2] * dt
        )  # fmt: skip
        # A rate may be the mean of the interval before it: half of that comes on top on the way on.
        grown = 0.5 * abs(dt) * (before + max(dt, 0.0))
        along, across = math.sqrt(along) * grown, math.sqrt(across) * grown
        size, side = math.sqrt(gx * gx + gy * gy + gz * gz), math.hypot(gy, gz)
        if not (math.isfinite(along + across + size) and side > 0.0):
            continue
        rate_x[i] = near[_W]
        g_t[i, 0], g_t[i, 1], g_t[i, 2] = gx / size, gy / size, gz / size
        turned[i] = min(math.hypot(along, across * gx / side), math.pi)
        sigma_inclination[i] = min(math.hypot(sigma_inclination[i], across), math.pi)
        sigma_toolface[i] = min(math.hypot(sigma_toolface[i], turned[i]), math.pi)
        sigma_down[i] = min(math.hypot(sigma_inclination[i], along * side / size), math.pi)
