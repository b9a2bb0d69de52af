"""
Gravity after the fact: Rauch-Tung-Striebel smoothing of the bounded filter, for logs and reports.

The forward pass is `gravity_bounded` itself; the backward pass carries what later measurements said of the errors back
over each start of the filter. Tilt between updates is interpolated. Never live: every value uses the whole log.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import samples as track
from mwd_estimation.core.samples import Track
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_estimation.gravity.bounded.filter import Log, Params
from mwd_estimation.gravity.bounded.mechanisation import BIAS, DOWN, POS, SCALE, STEADY, TILT, VEL
from mwd_estimation.gravity.bounded.motion import sigmas
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

SCALE_SPAN = 20.0  # s, over which the innovations say how far the covariance is to be believed
BLOCK = 60_000  # samples of one forward and backward pass; later ones are seen that far ahead, and half again


def smooth(params: Params, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Gravity of a whole recording, each sample from all samples before it and a long stretch after it.

    Parameters and errors as `gravity_bounded.run`. Returns a Track; before the filter's first start nothing changes.
    """
    smoother = Smoother(params)
    return joined([smoother.push(stamp_ns, gyro_t, accel_t), smoother.finish()])


def joined(parts: list[Track]) -> Track:
    """Tracks one after another as one."""
    return Track(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in dataclasses.fields(Track)))


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

    def push(self, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
        """Take a block; gravity of the samples that are done, which follow on those handed out before."""
        stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
        self._stamps = np.concatenate([self._stamps, stamps])
        self._gyro = np.concatenate([self._gyro, gyro])
        self._accel = np.concatenate([self._accel, accel])
        parts = [Track.empty(0)]
        # Blocks overlap by half, so that the end of each is smoothed by the next; the state goes on from its middle.
        while len(self._stamps) > BLOCK:
            parts.append(self._block(BLOCK, BLOCK // 2))
        return joined(parts)

    def finish(self) -> Track:
        """Gravity of the samples that wait."""
        return self._block(len(self._stamps), len(self._stamps))

    def _block(self, size: int, keep: int) -> Track:
        stamps, gyro, accel = self._stamps, self._gyro, self._accel
        part, log = bounded.run_logged(self.params, self._state.copy(), stamps[:size], gyro[:size], accel[:size])
        _back(part, log, self.params.sigma_reserve)
        bounded.run(self.params, self._state, stamps[:keep], gyro[:keep], accel[:keep])
        self._stamps, self._gyro, self._accel = stamps[keep:], gyro[keep:], accel[keep:]
        return Track(*(getattr(part, f.name)[:keep] for f in dataclasses.fields(Track)))


def transition(sums: Array) -> Array:
    """Transition of the steady errors over one update, shape (STEADY, STEADY), from its sums (as `propagate`)."""
    T = sums[model.S_TIME]
    force = 0.5 * sums[model.S_FORCE : model.S_FORCE + 3]
    half, tilt = np.eye(STEADY), np.eye(STEADY)
    speed = np.eye(STEADY)
    speed[POS : POS + 3, VEL : VEL + 3] = 0.5 * T * np.eye(3)
    half[VEL, TILT + 1], half[VEL + 1, TILT] = force[2], -force[2]
    half[VEL + 2, TILT], half[VEL + 2, TILT + 1], half[VEL + 2, DOWN] = force[1], -force[0], 0.5 * T
    half = half @ speed
    tilt[TILT : TILT + 2, BIAS : BIAS + 3] = -sums[model.S_BIAS : model.S_BIAS + 6].reshape(2, 3)
    tilt[TILT : TILT + 2, SCALE] = -sums[model.S_SCALE : model.S_SCALE + 2]
    return np.asarray(half @ tilt @ half)


def _back(part: Track, log: Log, reserve: float) -> None:
    """Backward pass over one block; directions and sigmas of `part` are replaced in place."""
    count = int(log.count[0])
    if count < 2:
        return
    error, P = np.zeros(STEADY), log.after[count - 1].copy()
    tilts, covariances = np.zeros((count, 2)), np.zeros((count, 2, 2))
    before = np.zeros((count, 2))
    covariances[-1] = P[:2, :2]
    for k in range(count - 2, -1, -1):
        if log.epoch[k] != log.epoch[k + 1] or log.epoch[k] < 0.0:
            error, P = np.zeros(STEADY), log.after[k].copy()
            before[k + 1] = 0.0
        else:
            F = transition(log.sums[k + 1])
            # Scaled to unit variances: errors of 1e-9 and of 1 stand side by side in P.
            scale = np.sqrt(np.diag(log.before[k + 1]))
            scaled = log.before[k + 1] / np.outer(scale, scale)
            gain = np.linalg.solve(scaled, (F @ log.after[k]) / scale[:, None]).T / scale
            ahead = error + log.correction[k + 1]
            before[k + 1] = ahead[:2]
            error = gain @ ahead
            P = log.after[k] + gain @ (P - log.before[k + 1]) @ gain.T
            P = 0.5 * (P + P.T)
        tilts[k], covariances[k] = error[:2], P[:2, :2]
    _apply(
        part.g_t, part.sigma_inclination, part.sigma_toolface, log.north_t, log.sample[:count], log.epoch[:count],
        tilts, before, covariances, reserve * _believed(log.lean[:count, :2], log.sums[:count, model.S_TIME]),
        log.lean[:count, 2:],
    )  # fmt: skip


def _believed(lean: Array, seconds: Array) -> Array:
    """Power of the innovations about each update, before and after it: by how much the covariance is wrong there."""
    known = np.isfinite(lean)
    power, weight = np.where(known, lean, 0.0) * seconds[:, None], known * seconds[:, None]
    width = max(1, round(0.5 * SCALE_SPAN / max(float(np.median(seconds)), 1e-6)))

    def about(values: Array) -> Array:
        total = np.concatenate([np.zeros((1, 2)), np.cumsum(values, axis=0)])
        at = np.arange(len(values))
        return np.asarray(total[np.minimum(at + width, len(values))] - total[np.maximum(at - width, 0)])

    held = about(weight)
    return np.asarray(np.where(held > 0.0, about(power) / np.where(held > 0.0, held, 1.0), 1.0))


@compiled
def _apply(
    g: Array, sigma_inclination: Array, sigma_toolface: Array, north: Array, sample: Stamps, epoch: Array,
    tilts: Array, before: Array, covariances: Array, believed: Array, floors: Array,
) -> None:  # fmt: skip
    """Turn each sample by the tilt interpolated from the update behind it to just before the update ahead."""
    for k in range(len(sample) - 1):
        if epoch[k] != epoch[k + 1] or epoch[k] < 0.0:
            continue
        span = sample[k + 1] - sample[k]
        for i in range(sample[k], sample[k + 1]):
            share = (i - sample[k]) / span
            a = tilts[k, 0] + share * (before[k + 1, 0] - tilts[k, 0])
            b = tilts[k, 1] + share * (before[k + 1, 1] - tilts[k, 1])
            nx, ny, nz = north[i, 0], north[i, 1], north[i, 2]
            gx, gy, gz = g[i, 0], g[i, 1], g[i, 2]
            # East axis: down x north. The level axes turned by (a, b, 0) see down at (-b, a, 1).
            ex, ey, ez = gy * nz - gz * ny, gz * nx - gx * nz, gx * ny - gy * nx
            gx, gy, gz = gx - b * nx + a * ex, gy - b * ny + a * ey, gz - b * nz + a * ez
            norm = math.sqrt(gx * gx + gy * gy + gz * gz)
            g[i, 0], g[i, 1], g[i, 2] = gx / norm, gy / norm, gz / norm
            p00 = covariances[k, 0, 0] + share * (covariances[k + 1, 0, 0] - covariances[k, 0, 0])
            p01 = covariances[k, 0, 1] + share * (covariances[k + 1, 0, 1] - covariances[k, 0, 1])
            p11 = covariances[k, 1, 1] + share * (covariances[k + 1, 1, 1] - covariances[k, 1, 1])
            sigma_inclination[i], sigma_toolface[i] = sigmas(
                nx, ex, p00, p01, p11, believed[k, 0], believed[k, 1], floors[k, 0], floors[k, 1]
            )
