"""
The magnetic azimuths of one station, raw and freed of axial interference: how far each errs, and which to take.

What a station shows of the drill-string interference decides the sigma of its raw azimuth; what its attitude hides
makes any of its azimuths uncertain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reasons import Reason
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.survey.acceptance import CHI1_LIMIT
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi

# An axial field this many times what is expected, with its own sigma, is no accident.
_SIGNIFICANT = 2.0
# From this many times them on, how far it turns the azimuth is computed, not taken from the slope.
_PLAIN = 3.0
# Odds of a scale ten times the plausible against one of those up to it.
_BEYOND, _BEYOND_ODDS = 10.0, 0.03
# Variance of the corrected over the raw azimuth from which on the correction needs no sign of interference.
_CLEARLY_BETTER = 0.5
# An attitude that leaves unseen as much interference as would turn the azimuth by this many of its sigmas hides it.
_HIDES = 2.0


@dataclass(frozen=True)
class Method:
    """Magnetic azimuth of one method, rad, and covariance (3, 3) of (inclination, it, toolface) by the sensors."""

    name: AzimuthMethod
    azimuth: float
    covariance: Array


def raw(
    f_h: Array,
    b_h: Array,
    jacobian: Array,
    covariance_s: Array,
    expected: float,
    plausible: float,
    correction: axial_correction.AxialCorrection | None,
) -> Method:
    """
    The plain azimuth: axial interference is one of its errors, as expected or as it shows.

    Parameters
    ----------
    f_h, b_h : ndarray, shape (3,)
        Specific force, m/s^2, and field, T, in hole axes.
    jacobian : ndarray, shape (3, 6)
        Slopes of inclination, azimuth and toolface by them.
    covariance_s : ndarray, shape (6, 6)
        Of both, by the sensors.
    expected, plausible : float
        1 sigma of axial interference, T: of a sound string, and the most that is thought of.
    correction : axial_correction.AxialCorrection, optional
        What the station shows of it.
    """
    azimuth, variance, turned = float(magnetic_geometry.raw_azimuth(f_h, b_h)), expected**2, 0.0
    if correction is not None and math.isfinite(float(correction.azimuth)):
        variance = shown_variance(correction, variance, plausible**2)
        turned = turned_variance(correction, azimuth, expected, plausible, variance)
    covariance = covariance_s.copy()
    covariance[3, 3] += variance
    whole = jacobian @ covariance @ jacobian.T
    whole[1, 1] += max(turned - jacobian[1, 3] ** 2 * variance, 0.0)
    return Method(AzimuthMethod.RAW, azimuth, whole)


def turned_variance(
    correction: axial_correction.AxialCorrection, azimuth: float, expected: float, plausible: float, variance: float
) -> float:
    """
    Mean square by which interference turns a raw azimuth, rad^2, where it is no small part of the horizontal field.

    There the slope of the azimuth is too small a measure (zero where the field of the string lies along that of the
    Earth and turns it right round): the distance to the corrected azimuth is taken, weighted by the mean square
    interference over the square of what shows.
    azimuth: the raw one, rad; expected, plausible: 1 sigma, T; variance: as `shown_variance` gives it, T^2.
    """
    shown, sigma = float(correction.interference), math.hypot(expected, float(correction.sigma_interference))
    if plausible <= expected:
        return 0.0
    share, turned = float(correction.share), 0.0
    if abs(shown) > _PLAIN * sigma or (share > 0.0 and abs(shown) > plausible):
        turned = float(wrap_pi(azimuth - correction.azimuth)) ** 2 * min(variance / shown**2, 1.0)
    if share > 0.0:
        turned = (1.0 - share) * turned + share * float(wrap_pi(azimuth - correction.both[1])) ** 2
    return turned


def shown_variance(correction: axial_correction.AxialCorrection, expected: float, plausible: float) -> float:
    """
    Mean square axial interference, T^2, given what the correction shows of it.

    expected, plausible: variances, T^2. The string is as expected, or something is wrong with it and the scale of its
    interference lies anywhere up to the plausible; the estimate and its sigma decide between the scales.
    """
    shown, noise = float(correction.interference), float(correction.sigma_interference) ** 2
    if not math.isfinite(shown + noise) or plausible <= expected:
        return expected
    floor = max(expected, 1e-4 * plausible)
    scales = np.append(floor * (plausible / floor) ** np.linspace(0.0, 1.0, 5), _BEYOND**2 * plausible)
    misfit = shown**2 / (scales + noise)
    evidence = np.exp(-0.5 * (misfit - misfit.min())) / np.sqrt(scales + noise)
    evidence[-1] *= _BEYOND_ODDS
    share = scales / (scales + noise)
    square = (share * shown) ** 2 + share * noise
    # The expected counts in full: what a reference off by its sigma shows by chance is no news of the string.
    square[0] = expected
    return max(float(evidence @ square / evidence.sum()), expected)


def hidden(
    correction: axial_correction.AxialCorrection,
    jacobian: Array,
    covariance_s: Array,
    expected: float,
    plausible: float,
) -> bool:
    """Whether interference that this attitude does not show could turn the azimuth far beyond its sigma; as `raw`."""
    unseen = plausible * float(correction.sigma_interference) / math.hypot(plausible, correction.sigma_interference)
    covariance = covariance_s.copy()
    covariance[3, 3] += expected**2
    sigma = math.sqrt(float(jacobian[1] @ covariance @ jacobian[1]))
    return bool(abs(jacobian[1, 3]) * unseen > _HIDES * sigma)


def corrected(correction: axial_correction.AxialCorrection, jacobian: Array, covariance_s: Array) -> Method:
    """The corrected azimuth: with inclination and toolface it shares the sensors' errors, not the reference's."""
    slopes = jacobian.copy()
    slopes[1] = correction.sensitivity
    covariance = slopes @ covariance_s @ slopes.T
    covariance[1, 1] = float(correction.sigma_azimuth) ** 2
    return Method(AzimuthMethod.SINGLE_STATION, float(correction.azimuth), covariance)


def choose(
    wanted: str,
    methods: list[Method],
    correction: axial_correction.AxialCorrection | None,
    refused: Reason | None,
    expected: float,
    plausible: float,
) -> Method:
    """
    The azimuth that is the station's own.

    wanted: auto, raw or corrected; methods: raw first; refused: why the corrected one must not be used; expected: as
    `raw`; plausible: interference beyond which a refused correction is still the better guess, T.
    """
    plain, freed = methods[0], methods[-1]
    if correction is None or freed is plain or wanted == AzimuthMethod.RAW:
        return plain
    if refused:
        # Too uncertain to be trusted, and still the better of the two where the raw one is far off.
        loose = correction.chi_square <= CHI1_LIMIT and abs(float(correction.interference)) > plausible
        return freed if loose and freed.covariance[1, 1] < _CLEARLY_BETTER * plain.covariance[1, 1] else plain
    if wanted == AzimuthMethod.SINGLE_STATION:
        return freed
    gain = freed.covariance[1, 1] / plain.covariance[1, 1]
    # Where both are about as good the raw one is kept: everyone can check it.
    better = gain < _CLEARLY_BETTER or (gain < 1.0 and shows(correction, expected))
    return freed if better else plain


def shows(correction: axial_correction.AxialCorrection, expected: float) -> bool:
    """Whether there is more axial interference than expected, T, with the estimate's sigma."""
    sigma = math.hypot(expected, float(correction.sigma_interference))
    return abs(float(correction.interference)) > _SIGNIFICANT * sigma
