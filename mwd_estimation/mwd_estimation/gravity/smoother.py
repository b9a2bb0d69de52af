# SPDX-License-Identifier: Apache-2.0
"""
Smooth the gravity of the bounded filter with later samples, for logs and reports. Works offline only.

The forward pass is `bounded.filter` itself. The backward pass applies the information of later measurements to earlier
errors; it does not cross a restart of the filter. Tilt between updates is interpolated.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded import information
from mwd_estimation.gravity.bounded.filter import BoundedParams
from mwd_estimation.gravity.bounded.state import INFORMATION, STEADY, TILT, UPDATE
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

AHEAD = 30_000  # smallest number of later samples used to smooth a sample
BLOCK = 3 * AHEAD  # number of samples in one backward pass
_NO_UPDATES = np.zeros(0, UPDATE)


def smooth(params: BoundedParams, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Return the gravity of a whole recording, smoothed with at least AHEAD later samples, if there are that many.

    Parameters and errors as for `bounded.filter.run`. Samples before the first attitude of the filter are not smoothed.
    """
    smoother = Smoother(params)
    return joined([smoother.push(stamp_ns, gyro_t, accel_t), smoother.finish()])


def joined(parts: list[Track]) -> Track:
    """Return the tracks of consecutive blocks as one track."""
    return Track._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


class _Forward(NamedTuple):
    """A block of samples after the forward pass."""

    part: Track  #: gravity of the forward pass
    updates: Any  #: updates within the block, dtype UPDATE
    north_t: Array  #: shape (n, 3); first level axis in tool axes at each sample


class Smoother:
    """
    Smoother of a stream of samples, in constant memory; a sample is returned when enough later samples are known.

    The result does not depend on how the samples are cut into blocks. Settings and errors as for `smooth`.
    """

    def __init__(self, params: BoundedParams) -> None:
        self.params = params
        self._state = bounded.initial(params)
        self._waiting: list[_Forward] = []
        self._count = 0

    @property
    def samples_are(self) -> str:
        """Kind of the samples that the filter detected; see `BoundedState.samples_are`."""
        return self._state.samples_are

    def continued(self) -> Smoother:
        """Return a new smoother for the samples after a pause in the stream; it keeps the detected kind of samples."""
        smoother = Smoother(self.params)
        smoother._state.keep_meaning(self._state)
        return smoother

    def push(
        self, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike, clipped: ArrayLike | None = None
    ) -> Track:
        """
        Accept a block; return the gravity of the samples that now have enough later samples, in order of time.

        Arguments and errors as for `bounded.filter.run`. The result has no samples until more than BLOCK samples wait.
        """
        part, log = bounded.run_logged(self.params, self._state, stamp_ns, gyro_t, accel_t, clipped)
        updates = log.updates[: log.entries[0]].copy()
        updates["sample"] += self._count
        self._waiting.append(_Forward(part, updates, log.north_t))
        self._count += len(part.g_t)
        parts = [Track.empty(0)]
        # Passes overlap: the next pass smooths the end of this one again with more later samples.
        while self._count > BLOCK:
            parts.append(self._smoothed(BLOCK, BLOCK - AHEAD))
        return joined(parts)

    def finish(self) -> Track:
        """Return the gravity of all waiting samples."""
        return self._smoothed(self._count, self._count)

    def _smoothed(self, size: int, done: int) -> Track:
        """Smooth the first `size` waiting samples, and remove and return the first `done` of them."""
        if not self._waiting:
            return Track.empty(0)
        parts, updates, north_t = zip(*self._waiting, strict=True)
        part, update, north = joined(list(parts)), np.concatenate([_NO_UPDATES, *updates]), np.concatenate(north_t)
        smoothed = part.part(slice(done))
        _back(smoothed, update[: np.searchsorted(update["sample"], size)], north)
        # Keep the last update before the remaining samples, because their tilt is interpolated from there.
        first = max(int(np.searchsorted(update["sample"], done, side="right")) - 1, 0)
        stays = update[first:].copy()
        stays["sample"] -= done
        self._waiting = [_Forward(part.part(slice(done, None)), stays, north[done:])]
        self._count -= done
        return smoothed


def _back(part: Track, updates: Any, north_t: Array) -> None:
    """
    Replace directions and sigmas of `part` by smoothed values (equation (12) of the bounded filter).

    updates: structured array of `Update`, shape (m,); the field `sample` is an index in `part`, and may be negative or
    beyond the end of `part`. north_t: first level axis in tool axes at each sample, shape (at least n, 3).
    """
    if len(updates) < 2:
        return
    count = len(updates)
    tilts, before, covariances = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2, 2))
    _smooth_tilts(updates, np.zeros(1, INFORMATION), tilts, before, covariances)
    _apply(part, updates, north_t, (tilts, before, covariances))


@compiled
def _smooth_tilts(updates: Any, later: Any, tilts: Array, before: Array, covariances: Array) -> None:
    """
    Fill the smoothed tilt after and before each update, rad, (m, 2), and the covariance after it, rad^2, (m, 2, 2).

    later: one zero record of `LaterInformation`. The updates are processed backwards. A is the information matrix that
    later measurements add, with their information vector in its last column. With the filter's covariance P after
    update k, the smoothed errors are P A[:, -1] and their covariance is P - P A[:, :-1] P. No inverse is needed:
    Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973).
    """
    A, row = later[0].matrix, np.zeros((2, STEADY + 1))
    for k in range(len(updates) - 1, -1, -1):
        now = updates[k]
        if k + 1 < len(updates):
            ahead = updates[k + 1]
            if now.epoch != ahead.epoch or now.epoch < 0:
                A[:] = 0.0
            else:
                information.carry_over(ahead, ahead.spread, later[0])
        P = now.tilt
        for a in range(2):
            for j in range(STEADY + 1):
                row[a, j] = 0.0
            for i in range(STEADY):
                share = P[a, i]
                for j in range(STEADY + 1):
                    row[a, j] += share * A[i, j]
            tilts[k, a] = row[a, STEADY]
            before[k, a] = row[a, STEADY] + now.correction[a]
        for a in range(2):
            for b in range(2):
                known = 0.0
                for j in range(STEADY):
                    known += row[a, j] * P[b, j]
                covariances[k, a, b] = P[a, TILT + b] - known


def _apply(part: Track, updates: Any, north_t: Array, smoothed: tuple[Array, Array, Array]) -> None:
    """
    Correct each sample by the smoothed tilt, and replace its sigmas.

    The tilt is interpolated between the values after the last update and before the next update.
    """
    tilts, before, covariances = smoothed
    sample, epoch = updates["sample"], updates["epoch"]
    rows = np.arange(max(sample[0], 0), min(sample[-1], len(part.g_t)))
    k = np.searchsorted(sample, rows, side="right") - 1
    same = (epoch[k] == epoch[k + 1]) & (epoch[k] >= 0)
    rows, k = rows[same], k[same]
    share = ((rows - sample[k]) / (sample[k + 1] - sample[k]))[:, None]
    tilt = tilts[k] + share * (before[k + 1] - tilts[k])
    north, down = north_t[rows], part.g_t[rows]
    # East axis: down x north. In level axes rotated by (a, b, 0), down has the components (-b, a, 1).
    east = np.cross(down, north)
    turned = down - tilt[:, 1:] * north + tilt[:, :1] * east
    part.g_t[rows] = turned / np.linalg.norm(turned, axis=1)[:, None]
    P = covariances[k] + share[:, :, None] * (covariances[k + 1] - covariances[k])
    factors, floors = updates["factors"][k], updates["floors"][k]
    # Horizontal projection of the tool axis: a tilt about the horizontal axis across it changes the inclination, a tilt
    # about the projection itself changes the toolface.
    level = np.stack([north[:, 0], east[:, 0]], axis=1)
    sine2 = np.maximum(np.sum(level**2, axis=1), 1e-6)
    along = level / np.sqrt(sine2)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inclination = factors[:, 0] * np.einsum("ni,nij,nj->n", across, P, across) + floors[:, 0]
    toolface = (factors[:, 1] * np.einsum("ni,nij,nj->n", along, P, along) + floors[:, 1]) / sine2
    part.sigma_inclination[rows] = np.minimum(np.sqrt(np.maximum(inclination, 0.0)), math.pi)
    part.sigma_toolface[rows] = np.minimum(np.sqrt(np.maximum(toolface, 0.0)), math.pi)
