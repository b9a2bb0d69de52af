"""
The stations of one run so far, and what they show together of each new one (multi-station analysis as it goes).

Where a gyro found north at earlier stations and agreed with the magnetometer, the analysis holds that too: it shows
what the field cannot, such as axial interference along one horizontal east-west attitude. The new station's own gyro
azimuth is left out of it, so that the two can still be held against each other.

A station counts where it was read at rest and its field is the Earth's with something beside it; whether it fits the
others is decided by the analysis. With few stations, or attitudes that do not show the errors, the method is named with
the reason why it gives nothing.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey import multi_station_analysis
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.multi_station_analysis import GyroAzimuths, Multistation, MultistationSettings
from mwd_estimation.survey.station import MethodAzimuth, Station, StationSettings
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

# A station whose gravity is further off was not at rest, m/s^2.
_AT_REST = 0.05
# A field further off the reference, as a share of it, is no reading of the Earth's.
_EARTH = 0.3


@dataclasses.dataclass(frozen=True)
class Params:
    """When the stations of a run are analysed together, and how."""

    enabled: bool = setting(True, "Analyse the stations of the run together with each new one")
    least: int = setting(4, "Fewest stations from which a correction is computed", low=2, high=100)
    most: int = setting(60, "The last so many stations count", low=4, high=1000)
    analysis: MultistationSettings = setting(MultistationSettings, "The analysis")


class StationRun:
    """Stations of one tool in one assembly, in the order they were taken."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self._stations: list[Station] = []
        # Of each: azimuth of a gyro from magnetic north, what of its sigma is the station's own, and what all share.
        self._gyro: list[tuple[float, float, float]] = []

    def add_gyro(self, azimuth: float, own: float, common: float) -> None:
        """
        Add the azimuth of a gyro at the station taken last, where it agrees with the magnetometer.

        Azimuth from magnetic north, rad; 1 sigma of what errs at each station anew, and of what errs alike at all.
        """
        if self._gyro:
            self._gyro[-1] = azimuth, own, common

    def take(self, station: Station, settings: StationSettings) -> tuple[Station, Multistation | None]:
        """
        Take a new station in.

        Parameters
        ----------
        station : Station
            By itself, magnetic.
        settings : StationSettings
            It was made with.

        Returns
        -------
        station : Station
            With the method MULTI_STATION: from its corrected readings where the analysis holds, else as it was and
            with the reason for the refusal. As it was, where it is no station to analyse.
        analysis : Multistation or None
            None where there was none, or it was refused.
        """
        reference = station.reference
        if not self.params.enabled or reference is None or not _usable(station, reference):
            return station, None
        self._stations = [*self._stations, station][-self.params.most :]
        self._gyro = [*self._gyro, (math.nan, math.nan, 0.0)][-self.params.most :]
        n = len(self._stations)
        if n < self.params.least:
            why = Reason(Code.TOO_FEW_STATIONS, float(n), float(self.params.least))
            refused = MethodAzimuth(AzimuthMethod.MULTI_STATION, math.nan, math.nan, why)
            return dataclasses.replace(station, azimuths=(*station.azimuths, refused)), None
        f_t, b_t = np.array([s.f_t for s in self._stations]), np.array([s.b_t for s in self._stations])
        azimuth, own, common = np.array(self._gyro).T
        gyro = GyroAzimuths(azimuth, own, common) if np.isfinite(azimuth).any() else None
        analysis = multi_station_analysis.analyse(f_t, b_t, reference, settings.errors, self.params.analysis, gyro)
        corrected = multi_station_analysis.corrected_station(station, n - 1, analysis, settings)
        return corrected, None if analysis.refused is not None else analysis


def _usable(station: Station, reference: Reference) -> bool:
    if not (reference.has_field and np.isfinite(station.f_t).all() and np.isfinite(station.b_t).all()):
        return False
    gravity = STANDARD_GRAVITY if reference.gravity is None else reference.gravity
    total = math.hypot(reference.horizontal, reference.vertical)
    return abs(station.g_total - gravity) < _AT_REST and abs(station.b_total - total) < _EARTH * total
