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
    Azimuth of one method, rad from the station's north, 1 sigma, and why it was refused (None where it was not).

    Sigma is that of the tool's axis: how the tool lies in the hole errs alike for every method and is the station's
    `alignment`. A refused azimuth is still given with its sigma: it is to be looked at, not to be used.
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
    """A survey station; angles in rad, totals in SI, nan where a reading or the reference is missing."""

    #: `f_t`, `b_t`: shape (3,); the readings.
    f_t: Array = field(repr=False)
    b_t: Array = field(repr=False)
    reference: Reference | None  #: what it was judged and corrected by
    #: `inclination`, `sigma_inclination`: from the vertical.
    inclination: float = math.nan
    sigma_inclination: float = math.nan
    #: `gravity_toolface`, `magnetic_toolface`, `sigma_toolface`: from high side, from the named north, and 1 sigma of
    #: the first.
    gravity_toolface: float = math.nan
    magnetic_toolface: float = math.nan
    sigma_toolface: float = math.nan
    #: `g_total`, `b_total`, `dip`: as measured: m/s^2, T, rad. No correction is in them.
    g_total: float = math.nan
    b_total: float = math.nan
    dip: float = math.nan
    #: `azimuth`, `sigma_azimuth`: the one chosen, from the named north; sigma is pi where nothing is known.
    azimuth: float = math.nan
    sigma_azimuth: float = math.nan
    north: str = "magnetic"  #: magnetic, true or grid
    north_correction: float = 0.0  #: added to the magnetic azimuth, rad
    method: AzimuthMethod = AzimuthMethod.NONE  #: which azimuth was chosen
    corrected: bool = False  #: whether the azimuth is freed of what the run shows of the string's field
    azimuths: tuple[MethodAzimuth, ...] = ()  #: every method tried
    #: `interference`, `sigma_interference`: axial field not of the Earth, T.
    interference: float = math.nan
    sigma_interference: float = math.nan
    #: shape (3, 3); of (inclination, chosen azimuth, gravity toolface), rad^2, all errors included.
    covariance: Array = field(default_factory=_unknown, repr=False)
    #: shape (3, 3); the part of it that is common to all methods: tool against hole.
    alignment: Array = field(default_factory=_unknown, repr=False)
    #: Totals against the reference; for a corrected azimuth with the interference taken off.
    deviations: Deviations = field(
        default_factory=lambda: Deviations(math.nan, math.nan, math.nan, _unknown()), repr=False
    )
    #: Deviation of gravity, field and dip beyond which the verdict is doubtful, m/s^2, T, rad; nan: not judged.
    limits: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    verdict: str = REJECT  #: accept, doubtful or reject
    quantities: Verdicts | None = None  #: verdict of each quantity; None: that of the station for each
    reasons: tuple[Reason, ...] = ()  #: those of an accepted station are the totals within their limits
    #: Other azimuths that fit the readings, from the named north, rad, and their probabilities.
    alternatives: tuple[tuple[float, float], ...] = ()
    #: What may disturb the readings, and its probability; empty: not judged.
    hypotheses: tuple[tuple[str, float], ...] = ()

    @property
    def verdicts(self) -> Verdicts:
        """Verdict of each quantity."""
        return self.quantities or Verdicts(self.verdict, self.verdict, self.verdict)

    @property
    def headline(self) -> Reason | None:
        """The one reason to act on; None of an accepted station."""
        return self.reasons[0] if self.reasons and self.verdict != ACCEPT else None

    def by_method(self, method: str) -> MethodAzimuth | None:
        """Return the azimuth of one method, None if it was not tried."""
        return next((azimuth for azimuth in self.azimuths if azimuth.method == method), None)
