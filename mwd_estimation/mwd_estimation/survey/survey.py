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
    """
    One survey as the estimator gives it: complete, nothing is changed in it afterwards.

    Attributes
    ----------
    stamp_ns : int
        Middle of the averaging interval.
    sequence : int
        From 1.
    uuid : str
    requested : bool
        Asked for, not taken automatically.
    duration : float
        s.
    samples : int
        IMU samples averaged.
    station : Station
        Angles, totals, verdict; its azimuth is the fused one.
    weights : mapping of str to float
        Share of each of the station's methods in its azimuth.
    kind : str
        static, or rotary: taken while the string turned.
    revision : int
        0: as first published; else how often the run's later stations have changed it.
    status : int
        Bits of `core.status.Status` at the end of the averaging interval.
    covariance_f, covariance_b : ndarray, shape (3, 3)
        Of the averaged specific force, (m/s^2)^2, and field, T^2: the noise alone.
    rate_t : ndarray, shape (3,)
        Mean angular rate of the precision unit, else of the AHRS, rad/s.
    temperature : float or None
        degC.
    """

    stamp_ns: int
    sequence: int
    uuid: str
    requested: bool
    duration: float
    samples: int
    station: Station
    covariance_f: Array
    covariance_b: Array
    rate_t: Array
    temperature: float | None
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    kind: str = STATIC
    status: int = 0
    revision: int = 0

    @property
    def end_ns(self) -> int:
        """End of the averaging interval."""
        return self.stamp_ns + round(0.5e9 * self.duration)
