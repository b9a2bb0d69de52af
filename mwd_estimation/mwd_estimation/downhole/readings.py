# SPDX-License-Identifier: Apache-2.0
"""Newest measurement of each quantity that a telemetry word may carry, in SI, with its sigma and stamp."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import NORTHS, Reference, north_correction
from mwd_estimation.core.status import Status
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry import meanings

_NORTH = {int(north): north.name.lower() for north in North}
# Field of the attitude for each quantity, and whether its angle counts from north.
_ATTITUDE = {
    meanings.CONTINUOUS_INCLINATION: ("inclination", False),
    meanings.CONTINUOUS_AZIMUTH: ("azimuth", True),
    meanings.GRAVITY_TOOLFACE: ("gravity_toolface", False),
    meanings.MAGNETIC_TOOLFACE: ("magnetic_toolface", True),
}


class StampedValue(NamedTuple):
    """Value and 1 sigma, SI, NaN if unknown; and stamp of the measurement, ns."""

    value: float
    sigma: float
    stamp_ns: int


Readings = dict[str, StampedValue]


def to_magnetic(north: str, reference: Reference | None) -> float | None:
    """
    Return the angle from magnetic north to the named north, rad; None if unknown.

    Added to an azimuth from the named north, it gives the magnetic azimuth. By convention a tool transmits azimuths
    from magnetic north; the surface adds declination and convergence.
    """
    correction = north_correction(reference, north) if north in NORTHS else None
    return None if correction is None else -correction


def of_attitude(row: Samples, reference: Reference | None) -> Readings:
    """Return the readings of one sample of `wire.ATTITUDE`, without those that are unknown."""
    stamp, status = int(row["stamp_ns"]), int(row["status"])
    found: Readings = {}
    turn = to_magnetic(_NORTH.get(int(row["north"]), ""), reference)
    for quantity, (field, by_azimuth) in _ATTITUDE.items():
        value, sigma = float(row[field]), float(row[f"sigma_{field}"])
        if math.isfinite(sigma) and not by_azimuth:
            found[quantity] = StampedValue(value, sigma, stamp)
        elif math.isfinite(sigma) and turn is not None:
            found[quantity] = StampedValue((value + turn) % math.tau, sigma, stamp)
    # Near vertical there is no high side, so the toolface is measured from magnetic north.
    automatic = meanings.MAGNETIC_TOOLFACE if status & Status.NEAR_VERTICAL else meanings.GRAVITY_TOOLFACE
    if automatic in found:
        found[meanings.TOOLFACE] = found[automatic]
    return found


def of_dynamics(row: Samples) -> Readings:
    """Return the readings of one summary of `wire.DYNAMICS`."""
    stamp = int(row["stamp_ns"])
    fields = {
        meanings.LATERAL_RMS: "lateral_rms",
        meanings.AXIAL_RMS: "axial_rms",
        meanings.LATERAL_PEAK: "lateral_peak",
        meanings.AXIAL_PEAK: "axial_peak",
    }
    return {quantity: StampedValue(float(row[field]), math.nan, stamp) for quantity, field in fields.items()}


def of_survey(survey: DecidedSurvey) -> Readings:
    """
    Return the readings of a survey taken at rest, without quantities whose value is unknown (None or NaN).

    The azimuth refers to magnetic north and is left out if the angle to magnetic north is unknown. If the azimuth was
    corrected for the axial field of the string, dip and total field are also without this field.
    """
    station, stamp = survey.station, survey.stamp_ns
    variance = np.asarray(station.covariance, dtype=float)
    found: Readings = {}

    def put(quantity: str, value: float | None, sigma: float) -> None:
        if value is not None and math.isfinite(value):
            found[quantity] = StampedValue(float(value), sigma, stamp)

    sigma_inclination = math.sqrt(max(float(variance[0, 0]), 0.0))
    put(meanings.INCLINATION, station.inclination, sigma_inclination)
    put(meanings.SIGMA_INCLINATION, sigma_inclination, math.nan)
    turn = to_magnetic(station.north, station.reference)
    if turn is not None and math.isfinite(station.azimuth):
        sigma_azimuth = math.sqrt(max(float(variance[1, 1]), 0.0))
        put(meanings.AZIMUTH, (station.azimuth + turn) % math.tau, sigma_azimuth)
        put(meanings.SIGMA_AZIMUTH, sigma_azimuth, math.nan)
    put(meanings.G_TOTAL, station.g_total, math.nan)
    # Use the field from which the azimuth was computed, without the axial field of the drill string.
    axial = station.interference if station.corrected and math.isfinite(station.interference) else 0.0
    b_t = np.asarray(station.b_t, dtype=float) - np.array([axial, 0.0, 0.0])
    put(meanings.DIP, float(magnetic_geometry.dip(station.f_t, b_t)), math.nan)
    put(meanings.B_TOTAL, float(np.linalg.norm(b_t)), math.nan)
    put(meanings.TEMPERATURE, survey.average.temperature, math.nan)
    return found
