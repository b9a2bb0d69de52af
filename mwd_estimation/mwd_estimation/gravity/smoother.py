# SPDX-License-Identifier: Apache-2.0
"""
Gravity after the fact: Rauch-Tung-Striebel smoothing of the bounded filter, for logs and reports.

The forward pass is `bounded.filter` itself; the backward pass carries what later measurements show of the errors back
over each start of the filter. Tilt between updates is interpolated. Never live: every value uses the whole log.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import clip_flags, track
from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded.filter import Log, Params
from mwd_estimation.gravity.bounded.state import ASKEW, BIAS, DOWN, POS, SCALE, STEADY, TILT, VEL
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import STANDARD_GRAVITY

BLOCK = 60_000  # samples of one forward and backward pass; later ones are seen that far ahead, and half again


def smooth(params: Params, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Gravity of a whole recording, each sample from all samples before it and a long stretch after it.

    Parameters and errors as `bounded.filter.run`. Returns a Track; before the filter's first start nothing changes.
    """
    smoother = Smoother(params)
    return joined([smoother.push(stamp_ns, gyro_t, accel_t), smoother.finish()])


def joined(parts: list[Track]) -> Track:
    """Tracks one after another as one."""
    return Track._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


class Smoother:
    """
    `smooth` in constant memory: samples in, and out again with their gravity as soon as enough after them was seen.

    Blocks of any length give the same numbers. Settings and errors as `smooth`.
    """

    def __init__(self, params: Params) -> None:
        self.params = params
        self._state = bounded.initial(params)
        self._stamps: Stamps = np.zeros(0, dtype=np.int64)
        self._gyro: Array = np.zeros((0, 3))
        self._accel: Array = np.zeros((0, 3))
        self._clipped: NDArray[np.uint8] = np.zeros(0, dtype=np.uint8)

    def push(
        self, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike, clipped: ArrayLike | None = None
    ) -> Track:
        """Take a block; gravity of the samples that are done, which follow on those handed out before."""
        stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
        self._stamps = np.concatenate([self._stamps, stamps])
        self._gyro = np.concatenate([self._gyro, gyro])
        self._accel = np.concatenate([self._accel, accel])
        self._clipped = np.concatenate([self._clipped, clip_flags.given(clipped, len(stamps))])
        parts = [Track.empty(0)]
        # Blocks overlap by half, so that the end of each is smoothed by the next; the state goes on from its middle.
        while len(self._stamps) > BLOCK:
            parts.append(self._block(BLOCK, BLOCK // 2))
        return joined(parts)

    def finish(self) -> Track:
        """Gravity of the samples that wait."""
        return self._block(len(self._stamps), len(self._stamps))

    def _block(self, size: int, keep: int) -> Track:
        samples = self._stamps, self._gyro, self._accel, self._clipped
        part, log = bounded.run_logged(self.params, self._state.copy(), *(one[:size] for one in samples))
        _back(part, log)
        bounded.run(self.params, self._state, *(one[:keep] for one in samples))
        self._stamps, self._gyro = self._stamps[keep:], self._gyro[keep:]
        self._accel, self._clipped = self._accel[keep:], self._clipped[keep:]
        return part.part(slice(keep))


def transition(sums: Any) -> Array:
    """Transition of the steady errors over one update, shape (STEADY, STEADY), from its sums, equation (3)."""
    T = float(sums["time"])
    F = np.eye(STEADY)
    F[TILT : TILT + 2, BIAS : BIAS + 3] = -sums["bias"]
    F[TILT : TILT + 2, SCALE] = -sums["scale"]
    F[TILT : TILT + 2, ASKEW : ASKEW + 2] = -sums["askew"]
    both = np.eye(STEADY)[TILT : TILT + 2] + F[TILT : TILT + 2]
    # As `mechanisation.propagate`: gravity acts through the mean of the tilts before and after.
    pull = -0.5 * STANDARD_GRAVITY * T
    F[VEL] += pull * both[1]
    F[VEL + 1] -= pull * both[0]
    F[VEL + 2, DOWN] += T
    F[POS : POS + 3, VEL : VEL + 3] = T * np.eye(3)
    F[POS, TILT + 1] += 0.5 * T * pull
    F[POS + 1, TILT] -= 0.5 * T * pull
    F[POS + 2, DOWN] += 0.25 * T * T
    return F


def _back(part: Track, log: Log) -> None:
    """Backward pass over one block, equation (12) of the filter's page: replaces directions and sigmas of `part`."""
    count = int(log.entries[0])
    if count < 2:
        return
    updates = log.updates[:count]
    epoch = updates["epoch"]
    tilts, before, covariances = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2, 2))
    error, P = np.zeros(STEADY), updates["after"][-1].copy()
    covariances[-1] = P[:2, :2]
    for k in range(count - 2, -1, -1):
        after, ahead = updates["after"][k], updates["before"][k + 1]
        if epoch[k] != epoch[k + 1] or epoch[k] < 0:
            error, P = np.zeros(STEADY), after.copy()
        else:
            F = transition(updates["sums"][k + 1])
            # Scaled to unit variances: errors of 1e-9 and of 1 stand side by side in P.
            unit = np.sqrt(np.diag(ahead))
            gain = np.linalg.solve(ahead / np.outer(unit, unit), (F @ after) / unit[:, None]).T / unit
            found = error + updates["correction"][k + 1]
            before[k + 1] = found[:2]
            error = gain @ found
            P = after + gain @ (P - ahead) @ gain.T
            P = 0.5 * (P + P.T)
        tilts[k], covariances[k] = error[:2], P[:2, :2]
    _apply(part, log, tilts, before, covariances)


def _apply(part: Track, log: Log, tilts: Array, before: Array, covariances: Array) -> None:
    """Turn each sample by the tilt interpolated from the update behind it to just before the update ahead."""
    updates = log.updates[: len(tilts)]
    sample, epoch = updates["sample"], updates["epoch"]
    rows = np.arange(sample[0], sample[-1])
    k = np.searchsorted(sample, rows, side="right") - 1
    same = (epoch[k] == epoch[k + 1]) & (epoch[k] >= 0)
    rows, k = rows[same], k[same]
    share = ((rows - sample[k]) / (sample[k + 1] - sample[k]))[:, None]
    tilt = tilts[k] + share * (before[k + 1] - tilts[k])
    north, down = log.north_t[rows], part.g_t[rows]
    # East axis: down x north. The level axes turned by (a, b, 0) see down at (-b, a, 1).
    east = np.cross(down, north)
    turned = down - tilt[:, 1:] * north + tilt[:, :1] * east
    part.g_t[rows] = turned / np.linalg.norm(turned, axis=1)[:, None]
    P = covariances[k] + share[:, :, None] * (covariances[k + 1] - covariances[k])
    factors, floors = updates["factors"][k], updates["floors"][k]
    # The tool axis, level: the tilt about the axis across it changes inclination, the one about itself the toolface.
    level = np.stack([north[:, 0], east[:, 0]], axis=1)
    sine2 = np.maximum(np.sum(level**2, axis=1), 1e-6)
    along = level / np.sqrt(sine2)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inclination = factors[:, 0] * np.einsum("ni,nij,nj->n", across, P, across) + floors[:, 0]
    toolface = (factors[:, 1] * np.einsum("ni,nij,nj->n", along, P, along) + floors[:, 1]) / sine2
    part.sigma_inclination[rows] = np.minimum(np.sqrt(np.maximum(inclination, 0.0)), math.pi)
    part.sigma_toolface[rows] = np.minimum(np.sqrt(np.maximum(toolface, 0.0)), math.pi)
