"""
What surveys change in how the magnetic field of the samples is read.

The north in use, the drill-string interference along the axis, and whether a gyro has shown external interference that
turns a field whose total and dip are in order, or left open whether there is any.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.attitude.block import MagneticModelInForce, StationUpdate
from mwd_estimation.attitude.time_alignment_state import FieldModel
from mwd_estimation.core.reference_field import Reference, best_north, north_correction
from mwd_estimation.magnetic import interference_filter
from mwd_estimation.survey.acceptance import ACCEPT
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.multi_station_analysis import Multistation
from mwd_estimation.survey.station import StationSettings
from mwd_estimation.survey.survey import Survey

NORTH_CODES = {"unknown": 0, "magnetic": 1, "true": 2, "grid": 3}


class MagneticFeedback:
    """
    The magnetic model in force, and what it is made from.

    Attributes
    ----------
    in_force : MagneticModelInForce
        A new object where it changes.
    reference : Reference or None
    interference : tuple of float or None
        Axial, and 1 sigma, T, as the last corrected station showed it.
    north : str
        What azimuths count from.
    """

    def __init__(self, settings: StationSettings, reference: Reference | None) -> None:
        self._settings = settings
        self._external, self._left_open = False, 0.0
        self.set_reference(reference)

    def set_reference(self, reference: Reference | None) -> None:
        """Read the field against this from now on; the interference is estimated anew."""
        self.reference = reference
        self.interference: tuple[float, float] | None = None
        self.in_force = self._model()

    def take(self, taken: Survey, analysis: Multistation | None) -> None:
        """Read the field from here on as this survey shows it, or as the stations of its run do together."""
        station = taken.station
        if station.corrected:
            self.interference = (station.interference, station.sigma_interference)
        found = station.by_method(AzimuthMethod.GYRO)
        reference = station.reference
        azimuth = sigma = math.nan
        counts = taken.weights.get(AzimuthMethod.GYRO, 0.0) > 0.0
        if found is not None and counts and reference is not None and reference.has_field:
            north = math.sqrt(reference.declination_variance(reference.horizontal))
            azimuth = found.azimuth - station.north_correction
            sigma = math.hypot(found.sigma, north) if station.north != "magnetic" else found.sigma
        own = None
        if analysis is not None and taken.weights.get(AzimuthMethod.MULTI_STATION, 0.0) > 0.0:
            at = interference_filter.OF_STATIONS
            own = analysis.estimate[at], analysis.covariance[np.ix_(at, at)]
        update, accepted = None, station.verdict == ACCEPT
        if own is not None or math.isfinite(azimuth) or accepted:
            down = -station.f_t / np.linalg.norm(station.f_t)
            axial = (station.interference, station.sigma_interference) if station.corrected else (0.0, 0.0)
            update = StationUpdate(own, down, station.b_t, azimuth, sigma, accepted, axial)
        # Where the gyro was used against the magnetometer, it is until they agree again.
        external = self._external if taken.alarm is None else bool(taken.alarm) and counts
        # Where it was too uncertain to decide, either may be right until they are compared again.
        left_open = self._left_open if taken.alarm is None else taken.left_open
        if station.corrected or update is not None or external != self._external or left_open != self._left_open:
            self._external, self._left_open = external, left_open
            self.in_force = self._model(update)

    def _model(self, update: StationUpdate | None = None) -> MagneticModelInForce:
        reference, settings = self.reference, self._settings
        self.north = best_north(reference) if settings.north == "best" else settings.north
        correction = north_correction(reference, self.north)
        if correction is None:
            self.north, correction = "magnetic", 0.0
        axial, sigma_axial = self.interference or (0.0, settings.errors.axial_interference_nt * 1e-9)
        known = reference is not None and reference.has_field
        variance = 0.0
        if reference is not None and known and self.north != "magnetic":
            variance = reference.declination_variance(reference.horizontal)
        model = FieldModel(
            interference=(axial, 0.0, 0.0),
            sigma_axial=sigma_axial,
            sigma_cross=settings.errors.magnetometer_bias_nt * 1e-9,
            north_correction=correction,
            sigma_north=math.hypot(math.sqrt(variance), self._left_open),
        )
        corrected = self.interference is not None
        return MagneticModelInForce(model, NORTH_CODES[self.north], corrected, update, self._external, self._left_open)
