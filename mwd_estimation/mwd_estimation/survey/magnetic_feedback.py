# SPDX-License-Identifier: Apache-2.0
"""
Changes that surveys make to the field model of the samples.

The field model contains the north in use and the field of the string from the stations. If the last station was
doubtful, the samples after it are flagged, or their sigma includes the possible error of the station.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.attitude.block import MagneticModelInForce, StationUpdate
from mwd_estimation.attitude.time_alignment import FieldModel
from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import Reference, best_north, north_correction
from mwd_estimation.core.verdicts import ACCEPT, NOT_DETERMINED
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.posterior.field_model import UT, Shared
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi

# _LIKELY: probability of an external field above which the magnetic azimuths of the samples are not used until a
# station is accepted. _LEADS: probability of an external field above which a station's interference is not used.
_LIKELY, _LEADS = 0.2, 0.5


class MagneticFeedback:
    """The present field model, and the data from which it is made."""

    def __init__(self, settings: StationSettings, reference: Reference | None) -> None:
        self._settings = settings
        self._external, self._left_open = False, 0.0
        self.set_reference(reference)

    def set_reference(self, reference: Reference | None) -> None:
        """Use this reference from now on, and discard the interference."""
        self.reference = reference
        #: Axial interference and 1 sigma, T, from the last corrected station.
        self.interference: tuple[float, float] | None = None
        self.in_force = self._model()  #: present field model; a change creates a new object

    def take(self, taken: DecidedSurvey, shared: tuple[Array, Array] | None) -> None:
        """
        Update the field model with a survey.

        shared : mean and covariance of the errors that the stations share (`RunModel.shared`); None if unknown.
        """
        station = taken.station
        accepted, outside = station.verdicts.azimuth == ACCEPT, _outside(station)
        magnetic = bool(station.hypotheses)
        # An accepted azimuth may come from the gyro in a disturbed field; then do not use the station's field.
        azimuth_ok = accepted and not outside > _LEADS
        if magnetic and azimuth_ok:
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
        if shared is not None and magnetic and azimuth_ok and reference is not None:
            own = _of_samples(*shared, reference)
        update = None
        if own is not None or math.isfinite(azimuth) or (accepted and magnetic):
            down = -station.f_t / np.linalg.norm(station.f_t)
            axial = self.interference or (0.0, 0.0)
            update = StationUpdate(own, down, station.b_t, azimuth, sigma, azimuth_ok, axial)
        external, left_open = self._external, self._left_open
        if magnetic and station.verdicts.azimuth != NOT_DETERMINED:
            external = not azimuth_ok and outside > _LIKELY
            left_open = 0.0 if accepted else _open(station)
        if magnetic or update is not None:
            self._external, self._left_open = external, left_open
            self.in_force = self._model(update)

    def _model(self, update: StationUpdate | None = None) -> MagneticModelInForce:
        reference, settings = self.reference, self._settings
        #: North of the azimuths: magnetic, true or grid.
        self.north = best_north(reference) if settings.north == "best" else settings.north
        correction = north_correction(reference, self.north)
        if correction is None:
            self.north, correction = "magnetic", 0.0
        axial, sigma_axial = self.interference or (0.0, settings.axial_sigma(reference))
        known = reference is not None and reference.has_field
        variance = 0.0
        if reference is not None and known and self.north != "magnetic":
            variance = reference.declination_variance(reference.horizontal)
        model = FieldModel(
            interference=(axial, 0.0, 0.0),
            sigma_axial=sigma_axial,
            sigma_cross=math.hypot(settings.errors.magnetometer_bias_nt, settings.errors.cross_interference_nt) * 1e-9,
            north_correction=correction,
            sigma_north=math.hypot(math.sqrt(variance), self._left_open),
        )
        corrected = self.interference is not None
        return MagneticModelInForce(
            model, int(North[self.north.upper()]), corrected, update, self._external, self._left_open
        )


def _outside(station: Station) -> float:
    """Return the probability of a field from outside the string at a station."""
    return dict(station.hypotheses).get(str(Hypothesis.EXTERNAL), 0.0)


def _open(station: Station) -> float:
    """Return the possible error of a doubted station's azimuth, rad, from its sigma and the other azimuths that fit."""
    square = station.sigma_azimuth**2
    square += sum(odds * float(wrap_pi(azimuth - station.azimuth)) ** 2 for azimuth, odds in station.alternatives)
    return min(math.sqrt(square), math.pi)


def _of_samples(mean: Array, covariance: Array, reference: Reference) -> tuple[Array, Array]:
    """
    Return mean, shape (8,), and covariance, shape (8, 8), of the states of the interference filter.

    The states are bias, T, and scale error of x, y and z, and errors of the reference H and V, T. mean, covariance:
    those of the shared errors (`RunModel.shared`).
    """
    to = np.zeros((8, Shared.SIZE))
    for k in range(3):
        to[k, Shared.FIELD_BIAS + k] = UT
        to[3 + k, Shared.FIELD_SCALE + k] = 1.0
    total = math.hypot(reference.horizontal, reference.vertical)
    cosine, sine = reference.horizontal / total, reference.vertical / total
    to[6, Shared.TOTAL], to[6, Shared.DIP] = cosine * UT, -reference.vertical
    to[7, Shared.TOTAL], to[7, Shared.DIP] = sine * UT, reference.horizontal
    to[6, Shared.OUTSIDE] = to[7, Shared.OUTSIDE + 2] = UT
    return to @ mean, to @ covariance @ to.T
