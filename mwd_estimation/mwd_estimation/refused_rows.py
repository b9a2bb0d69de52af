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

from mwd_estimation.status import Status
from mwd_estimation.track import Array, Stamps, Track, turn
from mwd_sensors.compiled import compiled

_REJECTED, _GAP = int(Status.REJECTED), int(Status.GAP)
# From a sample at its limit, or before there is an estimate, nothing is carried.
_UNSURE = int(Status.CLIPPED | Status.INITIALISING)
_RING = 512  # samples used that are kept: 0.1 s at 5 kHz
_NEAR_NS = 100_000_000  # farther from the last sample used nothing is carried
_MEMORY = 1.0  # s, over which changes of the rate are remembered
# Row of the ring: unit vector down, rates, how fast the rate about the axis and across it changes, squared, (rad/s^2)^2
# (infinite where nothing is carried from it), and the interval before, s.
_G, _W, _ALONG, _ACROSS, _STEP, _ROW = 0, 3, 6, 7, 8, 9
_HEAD, _LENGTH = 0, 1


@dataclasses.dataclass
class State:
    """Samples used of the last tenth of a second, and the mean squares of their rates' changes, (rad/s^2)^2."""

    stamps: Stamps
    ring: Array
    place: Stamps
    changes: Array

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
    return State(
        np.zeros(_RING, dtype=np.int64), np.zeros((_RING, _ROW)), np.zeros(2, dtype=np.int64), np.full(2, np.nan)
    )


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
        state.stamps, state.ring, state.place, state.changes, stamps, gyro, track.g_t, track.sigma_inclination,
        track.sigma_toolface, track.status, carried.rate_x, carried.sigma_down, carried.turned,
    )  # fmt: skip
    return carried


@compiled
def _keep(
    times: Stamps,
    ring: Array,
    place: Stamps,
    changes: Array,
    stamp: int,
    gyro: Array,
    g_t: Array,
    i: int,
    bits: np.int64,
) -> None:
    """Take a sample that was used."""
    if bits & _GAP != 0:
        place[_LENGTH] = 0
    head = place[_HEAD]
    row = ring[head]
    along, across, step = math.nan, math.nan, 0.0
    if place[_LENGTH] > 0:
        before = (head - 1) % _RING
        last = ring[before]
        step = (stamp - times[before]) * 1e-9
        if step > 0.0:
            inverse = 1.0 / step
            x = (gyro[i, 0] - last[_W]) * inverse
            y, z = (gyro[i, 1] - last[_W + 1]) * inverse, (gyro[i, 2] - last[_W + 2]) * inverse
            along, across = x * x, y * y + z * z
            share = step / (_MEMORY + step)
            for k, change in ((0, along), (1, across)):
                if not math.isfinite(changes[k]):
                    changes[k] = change
                elif math.isfinite(change):
                    changes[k] += share * (change - changes[k])
    for k in range(3):
        row[_G + k], row[_W + k] = g_t[i, k], gyro[i, k]
    # That which was just seen, or the usual, whichever is more; not a number where neither is known.
    row[_ALONG] = max(along, changes[0]) if along >= 0.0 else changes[0]
    row[_ACROSS] = max(across, changes[1]) if across >= 0.0 else changes[1]
    if bits & _UNSURE != 0:
        row[_ALONG] = math.inf
    row[_STEP] = step
    times[head] = stamp
    place[_HEAD] = (head + 1) % _RING
    place[_LENGTH] = min(place[_LENGTH] + 1, _RING)


@compiled
def _run(
    times: Stamps, ring: Array, place: Stamps, changes: Array, stamps: Stamps, gyro: Array, g_t: Array,
    sigma_inclination: Array, sigma_toolface: Array, status: NDArray[np.uint32], rate_x: Array, sigma_down: Array,
    turned: Array,
) -> None:  # fmt: skip
    for i in range(len(stamps)):
        stamp, bits = stamps[i], np.int64(status[i])
        turned[i], sigma_down[i], rate_x[i] = 0.0, sigma_inclination[i], gyro[i, 0]
        if bits & _REJECTED == 0:
            _keep(times, ring, place, changes, stamp, gyro, g_t, i, bits)
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
        for back in range(2, place[_LENGTH] + 1):
            earlier = (place[_HEAD] - back) % _RING
            if times[earlier] < stamp:
                break
            at = earlier
        near = ring[at]
        dt = (stamp - times[at]) * 1e-9
        gx, gy, gz = turn(
            near[_G], near[_G + 1], near[_G + 2], near[_W] * dt, near[_W + 1] * dt, near[_W + 2] * dt
        )  # fmt: skip
        # A rate may be the mean of the interval before it: half of that comes on top on the way on.
        grown = 0.5 * abs(dt) * (near[_STEP] + max(dt, 0.0))
        along, across = math.sqrt(near[_ALONG]) * grown, math.sqrt(near[_ACROSS]) * grown
        size, side = math.sqrt(gx * gx + gy * gy + gz * gz), math.hypot(gy, gz)
        if not (math.isfinite(along + across + size) and side > 0.0):
            continue
        rate_x[i] = near[_W]
        g_t[i, 0], g_t[i, 1], g_t[i, 2] = gx / size, gy / size, gz / size
        turned[i] = min(math.hypot(along, across * gx / side), math.pi)
        sigma_inclination[i] = min(math.hypot(sigma_inclination[i], across), math.pi)
        sigma_toolface[i] = min(math.hypot(sigma_toolface[i], turned[i]), math.pi)
        sigma_down[i] = min(math.hypot(sigma_inclination[i], along * side / size), math.pi)
