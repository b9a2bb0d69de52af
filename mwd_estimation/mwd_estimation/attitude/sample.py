# SPDX-License-Identifier: Apache-2.0
"""
Sample of the conventional unit with its gravity, as used by every step of the continuous attitude.

A kernel that is called once per sample gets a record and not the columns of the block: for an array argument, numba
counts references at each call, which costs more than most of these kernels.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.records import dtype_of


class Sample:
    """One sample; for a rejected sample, `rejected_samples` propagates `down` and the sigmas to its stamp."""

    stamp_ns: int  #: time at which it was measured (`core.stream_clock`), ns
    sent_ns: int  #: stamp of its message, ns
    #: `gyro`, `accel`: rate, rad/s, NaN if the gyros are unusable, and specific force, m/s^2, in tool axes.
    gyro: Annotated[Array, 3]
    accel: Annotated[Array, 3]
    down: Annotated[Array, 3]  #: unit vector down in tool axes; NaN while unknown
    #: `sigma_inclination`, `sigma_toolface`, `non_gravity`, `rotary_speed`: as in `core.track.Track`.
    sigma_inclination: float
    sigma_toolface: float
    non_gravity: float
    rotary_speed: float
    gyro_step: float  #: time since a revealed step of the gyro bias, s, as in `core.track.Track`
    #: `status`, `suspect`: bits of `Status`; and suspect sensors, as bits of `core.sensor_fault`.
    status: int
    suspect: int
    #: Rate about the axis, rad/s. For a rejected sample: the rate by which gravity was propagated to its stamp, NaN if
    #: gravity was not propagated.
    rate_x: float
    sigma_down: float  #: 1 sigma of the direction down, rad: the larger of the sigmas along and across the tilt
    #: 1 sigma added to the toolfaces of a rejected sample, rad: 0 for a used sample, infinite if the toolfaces are
    #: unknown.
    turned: float
    #: `turn`, `gyro_turn`: rotation about the tool axis since the start, from `time_alignment`, and azimuth rotation of
    #: the tool axis, from `gyro_azimuth`, rad.
    turn: float
    gyro_turn: float


SAMPLE = dtype_of(Sample)


def samples_of(
    time: tuple[Stamps, Stamps], gyro: Array, accel: Array, track: Track, suspect: NDArray[np.uint8]
) -> Samples:
    """
    Return the samples of a block, dtype SAMPLE, shape (n,).

    time: stamps of the messages, and times at which the samples were measured, ns, shape (n,) each; gyro, accel and
    suspect have shapes (n, 3), (n, 3) and (n,), with units as in `Sample`; track: gravity of these samples.
    """
    samples = np.zeros(len(gyro), dtype=SAMPLE)
    samples["sent_ns"], samples["stamp_ns"] = time
    samples["gyro"], samples["accel"], samples["suspect"] = gyro, accel, suspect
    samples["down"] = track.g_t
    for name in ("sigma_inclination", "sigma_toolface", "non_gravity", "rotary_speed", "status", "gyro_step"):
        samples[name] = getattr(track, name)
    samples["rate_x"] = gyro[:, 0]
    across = track.sigma_toolface * np.hypot(track.g_t[:, 1], track.g_t[:, 2])
    samples["sigma_down"] = np.fmax(track.sigma_inclination, across)
    return samples
