"""A survey: one station with when, how and from what it was measured."""

from __future__ import annotations

import dataclasses
import uuid

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.reference import Reference
from mwd_estimation.station import Station, StationSettings, station
from mwd_estimation.still_survey import StillAverage

Array = NDArray[np.float64]

# Names a survey by its time and number, so that a replay names it alike (RFC 4122, version 5).
_SURVEYS = uuid.UUID("6b0d4f5e-6f0e-5c1b-9a55-3a5d2c1b7e10")


@dataclasses.dataclass(frozen=True)
class Survey:
    """
    One survey as the estimator hands it over.

    Attributes
    ----------
    stamp_ns : int
        Middle of the averaging interval.
    sequence : int
        From 1.
    uuid : str
    requested : bool
        Asked for, not taken by itself.
    duration : float
        s.
    samples : int
        IMU samples averaged.
    station : Station
        Angles, totals, verdict.
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


def from_average(still: StillAverage, sequence: int, reference: Reference | None, settings: StationSettings) -> Survey:
    """Work out the survey of a still interval."""
    b_t = still.mag.mean if still.mag is not None else np.full(3, np.nan)
    covariance_b = still.mag.covariance if still.mag is not None else np.zeros((3, 3))
    covariance_f = still.imu.covariance[3:, 3:]
    rates = still.precision if still.precision is not None else still.imu
    stamp_ns = (still.start_ns + still.end_ns) // 2
    return Survey(
        stamp_ns=stamp_ns,
        sequence=sequence,
        uuid=str(uuid.uuid5(_SURVEYS, f"{stamp_ns} {sequence}")),
        requested=still.requested,
        duration=(still.end_ns - still.start_ns) * 1e-9,
        samples=still.imu.count,
        station=station(
            still.imu.mean[3:], b_t, reference, settings, covariance_f=covariance_f, covariance_b=covariance_b
        ),
        covariance_f=covariance_f,
        covariance_b=covariance_b,
        rate_t=rates.mean[:3],
        temperature=still.temperature,
    )
