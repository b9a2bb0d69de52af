# SPDX-License-Identifier: Apache-2.0
"""
Result of a run for one station: density of the azimuth, probable disturbances, and the influence of the gyro on both.

An azimuth known from the station above is weighed here, after the run: it never enters what the run learns.
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

# Another sensor contradicts a gyro if the probability that the gyro is wrong rises by more than this factor.
_CONTRADICTED = 2.0
# Azimuth propagated from the station above: 1 sigma added to it, rad, and probability of any other azimuth.
_CONTINUITY, _BROKEN = math.radians(5.0), 0.05
# A gyro with a larger share than this makes the azimuth.
_MOSTLY = 0.5
# Azimuths contradict each other if they differ by more than this number of sigma and by more than this angle, rad.
_APART, _NEAR = 3.0, math.radians(1.0)


@dataclasses.dataclass(frozen=True)
class GyroParts:
    """Density of an azimuth where a gyro is right, and where its bias stepped or it is wrong."""

    #: `right`, `doubted`: shape (n,); per rad, with their probabilities.
    right: Array
    doubted: Array
    #: `before`, `shown`: probability of a doubted gyro before this station, and the share of it that follows from the
    #: run itself.
    before: float
    shown: float

    def weighed(self, angles: Array, known: Array | float = 1.0) -> Array:
        """
        Return the sum of both densities, weighted by an azimuth known from elsewhere (per rad).

        The known azimuth changes only the weights, because both azimuths share errors, so it must not narrow a density.
        """
        width = circle.widths(angles)
        of_right, of_doubted = float(width @ self.right), float(width @ self.doubted)
        if not (of_right > 0.0 and of_doubted > 0.0):
            return self.right + self.doubted
        odds = float(width @ (self.doubted * known)) / max(float(width @ (self.right * known)), 1e-300)
        # If nothing contradicts the gyro, only the faults that the run itself has shown count.
        if odds <= _CONTRADICTED * self.before * (1.0 + odds):
            odds *= self.shown
        return np.asarray(self.right / of_right + odds * self.doubted / of_doubted)


@dataclasses.dataclass(frozen=True)
class Finding:
    """A station's azimuth as a density, and what may disturb it."""

    #: `angles`, `density`: shape (n,); from the station's north, rad; per rad, of any size.
    angles: Array
    density: Array
    hypotheses: dict[Hypothesis, float]  #: probabilities, sum 1; empty without a field
    nominal: float  #: 1 sigma of a sound tool by itself at this attitude, rad
    misfit: float = 0.0  #: least chi-square of the field under the widest hypothesis
    by_gyro: float = 0.0  #: share of the gyro in what is known of the azimuth, 0 to 1
    #: Probability that the gyro is wrong at this station although the run had not shown it before.
    gyro_wrong: float = 0.0
    of_gyro: GyroParts | None = None  #: what the density is made of where a gyro gave an azimuth here
    gyro_agreed: bool = False  #: whether a gyro agreed with the magnetometer at an earlier station of the run
    #: How far this azimuth is from a propagated one that contradicts it: rad, and in sigmas.
    broken: tuple[float, float] | None = None
    #: Field of the string along the axis and 1 sigma, T; nan where nothing is known of it.
    axial: tuple[float, float] = (math.nan, math.nan)
    mount: float = 0.0  #: 1 sigma of the inclination, rad, by accelerometers that may be turned in their mount
    repeats: int | None = None  #: number in the run, from 1, of an earlier station with these very readings

    @functools.cached_property
    def circle(self) -> circle.Circle:
        """The density as people read it."""
        return circle.read(self.angles, self.density)

    def beyond(self, width: float, alignment: float) -> float:
        """Return the probability that the azimuth is off by more than `width`, rad; alignment: its 1 sigma, rad."""
        return circle.beyond(self.angles, self.density, self.circle.mean, width, alignment)

    def continued(self, azimuth: float, sigma: float, shared: float = 0.0) -> Finding:
        """
        Return the finding with the azimuth propagated from the station above, which chooses a mode or contradicts.

        azimuth, sigma : from the same north, rad; shared : variance that both azimuths have in common, rad^2.
        """
        density = self.density
        if self.of_gyro is not None:
            if not self.gyro_agreed:
                # The station above may lie in the same field, so it cannot decide between gyro and magnetometer.
                return self
            density = self.of_gyro.weighed(self.angles, _known(self.angles, azimuth, sigma))
        density = density * _known(self.angles, azimuth, math.hypot(_CONTINUITY, sigma))
        found = circle.read(self.angles, density)
        off = float(wrap_pi(found.mean - azimuth))
        apart = abs(off) / math.sqrt(max(sigma**2 + found.sigma**2 - 2.0 * shared, 1e-4 * sigma**2))
        # Where the gyro found north here, the station above was wrong, unless a gyro has confirmed that station.
        trusted = self.by_gyro < _MOSTLY or self.gyro_agreed
        broken = (off, apart) if apart > _APART and abs(off) > _NEAR and trusted else None
        # Where an earlier gyro azimuth bore the magnetometer out, two that agree show which of the three is wrong.
        wrong = self.gyro_wrong if broken else 0.0
        return dataclasses.replace(self, density=density, broken=broken, gyro_wrong=wrong)


def _known(angles: Array, azimuth: float, sigma: float) -> Array:
    """Return the density of an azimuth known to a sigma, rad, with a small share for all other azimuths."""
    near = np.exp(-0.5 * (wrap_pi(angles - azimuth) / sigma) ** 2) / (sigma * math.sqrt(math.tau))
    return np.asarray((1.0 - _BROKEN) * near + _BROKEN / math.tau)


def gyro_share(angles: Array, mass: Array, magnetic: Array | None) -> float:
    """Return the share of the gyro in the azimuth; magnetic: density by the magnetometer alone (None: no reading)."""
    if magnetic is None:
        return 1.0
    width = circle.widths(angles)
    whole, alone = circle.read(angles, mass / width), circle.read(angles, magnetic / width)
    if abs(float(wrap_pi(whole.mean - alone.mean))) > _APART * math.hypot(whole.sigma, alone.sigma):
        return 1.0
    return min(max(1.0 - (whole.sigma / alone.sigma) ** 2, 0.0), 1.0)
