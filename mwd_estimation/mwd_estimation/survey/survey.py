# SPDX-License-Identifier: Apache-2.0
"""A survey: one station with when, how and from what it was measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from mwd_estimation.survey.station_record import Station
from mwd_sensors.core.arrays import Array

STATIC, ROTARY = "static", "rotary"


@dataclasses.dataclass(frozen=True)
class Survey:
    """One survey as the estimator gives it: complete, nothing is changed in it afterwards."""

    stamp_ns: int  #: middle of the averaging interval
    sequence: int  #: from 1
    uuid: str
    requested: bool  #: asked for, not taken automatically
    duration: float  #: s
    samples: int  #: IMU samples averaged
    station: Station  #: angles, totals, verdict; its azimuth is the fused one
    #: `covariance_f`, `covariance_b`: shape (3, 3); of the averaged specific force, (m/s^2)^2, and field, T^2: the
    #: noise alone.
    covariance_f: Array
    covariance_b: Array
    rate_t: Array  #: shape (3,); mean angular rate of the precision unit, else of the AHRS, rad/s
    temperature: float | None  #: degC
    #: Share of each of the station's methods in its azimuth.
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    kind: str = STATIC  #: static, or rotary: taken while the string turned
    status: int = 0  #: bits of `core.status.Status` at the end of the averaging interval
    revision: int = 0  #: 0: as first published; else how often the run's later stations have changed it
    withdrawn: bool = False  #: a sensor that it rests on turned out to have been faulty already when it was taken

    @property
    def end_ns(self) -> int:
        """End of the averaging interval."""
        return self.stamp_ns + round(0.5e9 * self.duration)
