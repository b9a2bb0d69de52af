# SPDX-License-Identifier: Apache-2.0
"""Find the intervals at rest in a tumble run and average the readings in them."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array, Indices

MIN_POSES = 12


@dataclasses.dataclass(frozen=True)
class Rests:
    """
    Mean readings over intervals at rest.

    Attributes
    ----------
    first, last : ndarray, shape (m,)
        Index of the first sample of each rest, and index after its last sample.
    gyro, accel, mag : ndarray, shape (m, 3)
        Mean readings, rad/s, m/s^2, T; mag is NaN if there is no magnetometer.
    celsius : ndarray, shape (m,)
        Mean temperature, degC.
    """

    first: Indices
    last: Indices
    gyro: Array
    accel: Array
    mag: Array
    celsius: Array


def rests(
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | None,
    celsius: ArrayLike,
    rate: float,
    seconds: float = 2.0,
    quiet_rate: float = 0.02,
    quiet_force: float = 0.15,
) -> Rests:
    """
    Find the intervals at rest in a tumble run.

    Parameters
    ----------
    gyro, accel, mag : array_like, shape (n, 3)
        Readings in rad/s, m/s^2, T (or None), all at the same rate.
    celsius : array_like, shape (n,)
        Temperature, degC.
    rate : float
        Sample rate, Hz.
    seconds : float
        Duration of the shortest rest, s.
    quiet_rate, quiet_force : float
        Largest range of the readings within half a second at rest, rad/s and m/s^2.

    Raises
    ------
    ValueError
        There are fewer than `MIN_POSES` rests, too few for a calibration.
    """
    w, f = np.asarray(gyro, dtype=float), np.asarray(accel, dtype=float)
    t = np.asarray(celsius, dtype=float)
    b = np.full_like(f, np.nan) if mag is None else np.asarray(mag, dtype=float)
    window = max(2, round(0.5 * rate))
    count = len(f) // window
    shape = (count, window, 3)
    spans = [np.ptp(x[: count * window].reshape(shape), axis=1).max(axis=1) for x in (w, f)]
    # A steady rotation is quiet too; at rest the specific force of neighbouring windows must also agree.
    mean_f = f[: count * window].reshape(shape).mean(axis=1)
    drift = np.linalg.norm(np.diff(mean_f, axis=0, prepend=mean_f[:1]), axis=1)
    drift = np.maximum(drift, np.append(drift[1:], 0.0))
    quiet = (spans[0] < quiet_rate) & (spans[1] < quiet_force) & (drift < 0.5 * quiet_force)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    pairs = [(a * window, z * window) for a, z in edges.reshape(-1, 2) if (z - a) * window >= seconds * rate]
    if len(pairs) < MIN_POSES:
        raise ValueError(
            f"only {len(pairs)} rests of {seconds:g} s were found; a tumble needs at least {MIN_POSES} attitudes"
        )
    means = [np.array([x[a:z].mean(axis=0) for a, z in pairs]) for x in (w, f, b, t)]
    first, last = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True))
    return Rests(first, last, means[0], means[1], means[2], means[3])
