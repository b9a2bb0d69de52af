# SPDX-License-Identifier: Apache-2.0
"""
A sample of the conventional unit with the gravity followed through it, as every step of the attitude reads it.

Kernels that are called for each sample are given its record, not the columns of the block: numba counts the references
of an array at each call, which costs more than most calls do.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.records import dtype_of


class Sample:
    """A sample; `down` and the sigmas of a rejected one are propagated to its stamp by `rejected_samples`."""

    stamp_ns: int
    #: `gyro`, `accel`: rate, rad/s, nan where the gyros are unusable, and specific force, m/s^2, in tool axes.
    gyro: Annotated[Array, 3]
    accel: Annotated[Array, 3]
    down: Annotated[Array, 3]  #: unit vector down in tool axes, nan while unknown
    #: `sigma_inclination`, `sigma_toolface`, `non_gravity`, `rotary_speed`: as in `core.track.Track`.
    sigma_inclination: float
    sigma_toolface: float
    non_gravity: float
    rotary_speed: float
    #: `status`, `suspect`: bits of `Status`; sensors in doubt, bits of `core.sensor_fault`.
    status: int
    suspect: int
    rate_x: float  #: about the axis, rad/s; of a rejected sample that by which it was propagated, nan where none was
    sigma_down: float  #: of the direction down, rad; of a used sample that of the inclination
    #: 1 sigma by which the toolfaces of a rejected sample are less certain, rad; 0 for a used one, infinite where
    #: nothing is known of it.
    turned: float
    #: `turn`, `gyro_turn`: of the string about its axis since the start, by `time_alignment`, and of that axis itself,
    #: by `azimuth_rate`, rad.
    turn: float
    gyro_turn: float


SAMPLE = dtype_of(Sample)


def samples_of(stamps: Stamps, gyro: Array, accel: Array, track: Track, suspect: NDArray[np.uint8]) -> Samples:
    """
    Samples of a block, dtype SAMPLE, shape (n,).

    stamps, gyro, accel, suspect: shapes (n,), (n, 3), (n, 3) and (n,); units as of `Sample`. track: gravity of them.
    """
    samples = np.zeros(len(stamps), dtype=SAMPLE)
    samples["stamp_ns"], samples["gyro"], samples["accel"], samples["suspect"] = stamps, gyro, accel, suspect
    samples["down"] = track.g_t
    for name in ("sigma_inclination", "sigma_toolface", "non_gravity", "rotary_speed", "status"):
        samples[name] = getattr(track, name)
    samples["rate_x"], samples["sigma_down"] = gyro[:, 0], track.sigma_inclination
    return samples
