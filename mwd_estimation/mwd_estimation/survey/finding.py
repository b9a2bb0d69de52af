# SPDX-License-Identifier: Apache-2.0
"""
Result of a run for one station: density of the azimuth, probable disturbances, and influence of the gyro on both.

An azimuth propagated from the station above is combined with this result, and never changes the model of the run.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from mwd_estimation.survey.posterior import circle
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi

# A known azimuth contradicts a gyro if it multiplies the probability of a wrong gyro by more than this factor.
_CONTRADICTED = 2.0
# Azimuth propagated from the station above: 1 sigma added to it, rad, and probability of any other azimuth.
_CONTINUITY, _BROKEN = math.radians(5.0), 0.05
# Share of the gyro above which the azimuth counts as a gyro azimuth.
_MOSTLY = 0.5
# Azimuths contradict each other if they differ by more than this number of sigmas and by more than this angle, rad.
_APART, _NEAR = 3.0, math.radians(1.0)


@dataclasses.dataclass(frozen=True)
class GyroParts:
    """Density of the azimuth in two parts: for a right gyro, and for a doubted gyro (bias stepped, or wrong)."""

    #: `right`, `doubted`: shape (n,); densities, per rad, each times the probability of its case.
    right: Array
    doubted: Array
    #: `before`, `shown`: probability of a doubted gyro before this station, and the share of this probability that
    #: follows from earlier stations of the run.
    before: float
    shown: float

    def weighed(self, angles: Array, known: Array | float = 1.0) -> Array:
        """
        Return the sum of two densities, shape (n,), not normalised, weighted by their agreement with a known azimuth.

        angles: shape (n,), rad; known: density of the known azimuth, per rad. The known azimuth changes only the
        weights: it must not narrow the densities, because both azimuths have errors in common.
        """
        width = circle.widths(angles)
        of_right, of_doubted = float(width @ self.right), float(width @ self.doubted)
        if not (of_right > 0.0 and of_doubted > 0.0):
            return self.right + self.doubted
        odds = float(width @ (self.doubted * known)) / max(float(width @ (self.right * known)), 1e-300)
        # If the known azimuth does not contradict the gyro, use only the doubt from earlier stations of the run.
        if odds <= _CONTRADICTED * self.before * (1.0 + odds):
            odds *= self.shown
        return np.asarray(self.right / of_right + odds * self.doubted / of_doubted)


@dataclasses.dataclass(frozen=True)
class Finding:
    """Azimuth of a station as a density, and probabilities of disturbances."""

    #: `angles`, `density`: shape (n,); angles from the station's north, rad; density, per rad, not normalised.
    angles: Array
    density: Array
    hypotheses: dict[Hypothesis, float]  #: probability of each disturbance, with the sum 1; empty without a field
    nominal: float  #: 1 sigma of the azimuth of a healthy tool, from this station alone, at this attitude, rad
    misfit: float = 0.0  #: smallest chi-square of the field under the widest hypothesis
    by_gyro: float = 0.0  #: share of the gyro in the information on the azimuth, 0 to 1
    #: Probability that the gyro is wrong at this station although earlier stations did not show this.
    gyro_wrong: float = 0.0
    of_gyro: GyroParts | None = None  #: densities for a right and a doubted gyro; None without a gyro azimuth
    gyro_agreed: bool = False  #: whether a gyro agreed with the magnetometer at an earlier station of the run
    #: Difference of this azimuth from a propagated azimuth that contradicts it, rad, and in sigmas; None: no
    #: contradiction.
    broken: tuple[float, float] | None = None
    #: Field of the string along the axis and 1 sigma, T; NaN if unknown.
    axial: tuple[float, float] = (math.nan, math.nan)
    mount: float = 0.0  #: 1 sigma of the inclination from accelerometers that may be turned in their mount, rad
    repeats: int | None = None  #: number in the run, from 1, of an earlier station with identical readings

    @functools.cached_property
    def circle(self) -> circle.Circle:
        """Mean, sigma, other modes and shares of the density."""
        return circle.read(self.angles, self.density)

    def beyond(self, width: float, alignment: float) -> float:
        """Return the probability of an azimuth error above `width`, rad; alignment: 1 sigma of misalignment, rad."""
        return circle.beyond(self.angles, self.density, self.circle.mean, width, alignment)

    def continued(self, azimuth: float, sigma: float, shared: float = 0.0) -> Finding:
        """
        Return the finding combined with the azimuth propagated from the station above.

        The propagated azimuth selects a mode of the density, or contradicts it (`broken`). If the station has a gyro
        azimuth and the gyro has not agreed with the magnetometer before, the finding is returned unchanged. azimuth,
        sigma : from the same north, rad; shared : variance that both azimuths have in common, rad^2.
        """
        density = self.density
        if self.of_gyro is not None:
            if not self.gyro_agreed:
                # The station above may be in the same disturbed field, so it cannot decide between gyro and
                # magnetometer.
                return self
            density = self.of_gyro.weighed(self.angles, _known(self.angles, azimuth, sigma))
        density = density * _known(self.angles, azimuth, math.hypot(_CONTINUITY, sigma))
        found = circle.read(self.angles, density)
        off = float(wrap_pi(found.mean - azimuth))
        apart = abs(off) / math.sqrt(max(sigma**2 + found.sigma**2 - 2.0 * shared, 1e-4 * sigma**2))
        # If the gyro determined this azimuth, the station above was wrong, unless a gyro agreed with the magnetometer.
        trusted = self.by_gyro < _MOSTLY or self.gyro_agreed
        broken = (off, apart) if apart > _APART and abs(off) > _NEAR and trusted else None
        # There are three azimuths: gyro, magnetometer and station above. If gyro and magnetometer have agreed before,
        # the two azimuths that agree show which one is wrong.
        wrong = self.gyro_wrong if broken else 0.0
        return dataclasses.replace(self, density=density, broken=broken, gyro_wrong=wrong)

    def near(self, azimuth: float, sigma: float) -> Finding:
        """
        Return the finding with the azimuth of a neighbouring station of the same hole as prior.

        azimuth: from the same north, rad; sigma: its 1 sigma at this station, with the possible turn between, rad.
        """
        return dataclasses.replace(self, density=self.density * _known(self.angles, azimuth, sigma))


def _known(angles: Array, azimuth: float, sigma: float) -> Array:
    """Return the density at angles, per rad, of an azimuth with 1 sigma, rad, plus a small uniform density."""
    near = np.exp(-0.5 * (wrap_pi(angles - azimuth) / sigma) ** 2) / (sigma * math.sqrt(math.tau))
    return np.asarray((1.0 - _BROKEN) * near + _BROKEN / math.tau)


def gyro_share(angles: Array, mass: Array, magnetic: Array | None) -> float:
    """
    Return the share of the gyro in the azimuth, 0 to 1.

    The share is 1 without a magnetometer, or if the magnetic azimuth contradicts the azimuth from both sensors.

    mass, shape (n,): probability of each angle from both sensors.
    magnetic, shape (n,): probability of each angle from the magnetometer alone; None if it has no reading.
    """
    if magnetic is None:
        return 1.0
    width = circle.widths(angles)
    whole, alone = circle.read(angles, mass / width), circle.read(angles, magnetic / width)
    if abs(float(wrap_pi(whole.mean - alone.mean))) > _APART * math.hypot(whole.sigma, alone.sigma):
        return 1.0
    return min(max(1.0 - (whole.sigma / alone.sigma) ** 2, 0.0), 1.0)
