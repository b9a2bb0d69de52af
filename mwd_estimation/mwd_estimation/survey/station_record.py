# SPDX-License-Identifier: Apache-2.0
"""A survey station as data: angles, totals, azimuth by each method, and a verdict with reasons."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.verdicts import ACCEPT, REJECT
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.totals import Deviations
from mwd_sensors.core.arrays import Array


@dataclass(frozen=True)
class MethodAzimuth:
    """
    Azimuth of one method from the station's north, and 1 sigma, rad; and reason if refused, else None.

    Sigma does not include the misalignment of the tool in the hole, which is the same for all methods (`alignment` of
    the station). A refused azimuth and its sigma are for information only.
    """

    method: AzimuthMethod
    azimuth: float
    sigma: float
    refused: Reason | None = None


@dataclass(frozen=True)
class Verdicts:
    """
    Verdict of each quantity by itself: accept, doubtful, reject or not_determined.

    A quantity is not determined where this attitude does not define it, such as the azimuth of a vertical hole.
    """

    inclination: str
    azimuth: str
    toolface: str


def _unknown() -> Array:
    return np.full((3, 3), math.nan)


@dataclass(frozen=True)
class Station:
    """A survey station; angles in rad, totals in SI; NaN if a reading or the reference is missing."""

    #: `f_t`, `b_t`: shape (3,); mean specific force, m/s^2, and field, T, in tool axes.
    f_t: Array = field(repr=False)
    b_t: Array = field(repr=False)
    reference: Reference | None  #: reference with which the station was checked and corrected
    #: `inclination`, `sigma_inclination`: inclination from the vertical, and 1 sigma.
    inclination: float = math.nan
    sigma_inclination: float = math.nan
    #: `gravity_toolface`, `magnetic_toolface`, `sigma_toolface`: toolface from the high side, toolface from `north`,
    #: and 1 sigma of the gravity toolface.
    gravity_toolface: float = math.nan
    magnetic_toolface: float = math.nan
    sigma_toolface: float = math.nan
    #: `g_total`, `b_total`, `dip`: measured total gravity, m/s^2, total field, T, and dip, rad, without correction.
    g_total: float = math.nan
    b_total: float = math.nan
    dip: float = math.nan
    #: `azimuth`, `sigma_azimuth`: azimuth from `north`, and 1 sigma; sigma is pi if the azimuth is unknown.
    azimuth: float = math.nan
    sigma_azimuth: float = math.nan
    north: str = "magnetic"  #: magnetic, true or grid
    north_correction: float = 0.0  #: angle added to the magnetic azimuth, rad
    method: AzimuthMethod = AzimuthMethod.NONE  #: method of the azimuth
    corrected: bool = False  #: whether the field of the string that the run found was removed from the azimuth
    azimuths: tuple[MethodAzimuth, ...] = ()  #: azimuths of all methods
    #: `interference`, `sigma_interference`: axial field that is not the Earth's, and 1 sigma, T.
    interference: float = math.nan
    sigma_interference: float = math.nan
    #: shape (3, 3); covariance of (inclination, azimuth, gravity toolface), rad^2, with all errors.
    covariance: Array = field(default_factory=_unknown, repr=False)
    #: shape (3, 3); covariance from the misalignment of the tool in the hole, rad^2; contained in `covariance`.
    alignment: Array = field(default_factory=_unknown, repr=False)
    #: Differences of the totals from the reference; for a corrected azimuth without the interference.
    deviations: Deviations = field(
        default_factory=lambda: Deviations(math.nan, math.nan, math.nan, _unknown()), repr=False
    )
    #: Largest deviations of gravity, m/s^2, field, T, and dip, rad, of a station that is not doubtful; NaN: no limit.
    limits: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    verdict: str = REJECT  #: accept, doubtful or reject
    quantities: Verdicts | None = None  #: verdict of each quantity; None: all have the verdict of the station
    reasons: tuple[Reason, ...] = ()  #: reasons of the verdict; those of an accepted station list the totals
    #: Other azimuths that fit the readings, from the named north, rad, and their probabilities.
    alternatives: tuple[tuple[float, float], ...] = ()
    #: Names of the possible disturbances and their probabilities; empty if they were not computed.
    hypotheses: tuple[tuple[str, float], ...] = ()

    @property
    def verdicts(self) -> Verdicts:
        """Verdict of each quantity."""
        return self.quantities or Verdicts(self.verdict, self.verdict, self.verdict)

    @property
    def headline(self) -> Reason | None:
        """Main reason to act; None for an accepted station."""
        return self.reasons[0] if self.reasons and self.verdict != ACCEPT else None

    def by_method(self, method: str) -> MethodAzimuth | None:
        """Return the azimuth of one method; None if it was not computed."""
        return next((azimuth for azimuth in self.azimuths if azimuth.method == method), None)
