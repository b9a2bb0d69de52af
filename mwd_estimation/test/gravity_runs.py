# SPDX-License-Identifier: Apache-2.0
"""Samples of simulated and recorded tools with their true down, tracks of the bounded filter, and their errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_sensors.core import frames
from mwd_sensors.core.arrays import Array, Stamps
from project import REFERENCE_DATA
from simulated_sonde import simulated

PARAMS = bounded.BoundedParams()


class Drilled(NamedTuple):
    """Stamps, ns, rates, rad/s, forces, m/s^2, and true down, a unit vector, each in tool axes."""

    stamps: Stamps
    gyro: Array
    accel: Array
    down: Array

    def part(self, rows: Any) -> Drilled:
        """Return these rows."""
        return Drilled(*(column[rows] for column in self))

    def after(self, seconds: float) -> Array:
        """Return which samples come later than this time after the first, s."""
        return self.stamps - self.stamps[0] > seconds * 1e9


def sensed(case: str, seconds: float = np.inf, **changes: Any) -> tuple[Array, Array]:
    """Return the IMU's samples, dtype of `wire.IMU`, and true down, of a benchmark case with changes."""
    samples, _ = simulated(f"bench/{case}", seconds, **changes)
    imu, truth = samples["imu/data_raw"], samples["truth"]
    return imu, truth["gravity"][np.searchsorted(truth["stamp_ns"], imu["stamp_ns"])]


def drilled(case: str, seconds: float = np.inf, **changes: Any) -> Drilled:
    """Return the samples of a benchmark case with changes."""
    imu, down = sensed(case, seconds, **changes)
    return Drilled(imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"], down)


def recorded(name: str = "*") -> Iterator[tuple[Drilled, Array]]:
    """Yield the BROAD trials of this name with optical truth, and which of their samples to score."""
    for file in sorted((REFERENCE_DATA / "broad").glob(f"{name}.npz")):
        with np.load(file) as trial:
            w, x, y, z = trial["quat"].astype(float).T
            down = -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)
            stamps = np.round(np.arange(len(down)) * 1e9 / float(trial["fs"])).astype(np.int64)
            yield Drilled(stamps, trial["gyr"], trial["acc"], down), trial["movement"] & np.isfinite(down[:, 0])


def followed(data: Drilled, params: bounded.BoundedParams = PARAMS, flags: Array | None = None) -> Track:
    """Return the track of the bounded filter, begun with the first sample."""
    return bounded.run(params, bounded.initial(params), data.stamps, data.gyro, data.accel, flags)


def error_deg(track: Track, down: Array) -> Array:
    """Return the angle between the estimated and the true down, deg."""
    cross = np.linalg.norm(np.cross(track.g_t, down), axis=1)
    return np.degrees(np.arctan2(cross, np.sum(track.g_t * down, axis=1)))


def inclination_error(track: Track, down: Array) -> Array:
    """Return the error of the inclination, rad."""
    return track.inclination - np.arctan2(np.hypot(down[:, 1], down[:, 2]), down[:, 0])


def toolface_error(track: Track, down: Array) -> Array:
    """Return the error of the gravity toolface, rad."""
    found, true = (np.arctan2(-g[:, 1], -g[:, 2]) for g in (track.g_t, down))
    return frames.wrap_pi(found - true)


def rms(x: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))
