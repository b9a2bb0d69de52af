# SPDX-License-Identifier: Apache-2.0
"""
Totals of a station (gravity, field, dip) compared with the reference: deviations, limits and verdict.

Gravity, field strength and dip are known before the measurement, so a deviation shows an error. Limits are either fixed
(`QualitySettings`) or follow from the uncertainty of the tool at this attitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_estimation.core import chi_square, magnetic_geometry
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference, Slip
from mwd_estimation.core.verdicts import ACCEPT, DOUBTFUL, REJECT, worse
from mwd_estimation.survey.quality_settings import REJECT_FACTOR, QualitySettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import GRAVITY_FARTHEST, STANDARD_GRAVITY

# Chi-square, with three degrees of freedom, above which a station is doubtful, and above which it is rejected; by
# chance it is exceeded once in 100 and once in 1000 stations.
_CHI3_DOUBTFUL, _CHI3_REJECT = chi_square.limit(0.01, 3), chi_square.limit(0.001, 3)
# Smallest decrease of chi-square by a slip (a mistake in the entered reference) that is reported: odds of 3e5, compared
# with one reference in a thousand that has a slip.
_SLIP = 25.0
# Multiples of the sigma of the tool code above which a station is doubtful or rejected.
TOOLCODE_DOUBTFUL, TOOLCODE_REJECT = 2.0, 3.0
# Deviation of the gravity total from local gravity, in sigmas, above which the tool was not calibrated with local
# gravity.
_NOT_LOCAL = 2.0
# Absolute value of the reference dip, rad, above which a dip of the opposite sign can be recognised in the readings.
_FLAT = math.radians(4.0)


@dataclass(frozen=True)
class Deviations:
    """Differences of measured totals from the reference."""

    #: `gravity`, `field`, `dip`: m/s^2, T, rad; NaN if the reference lacks the value.
    gravity: float
    field: float
    dip: float
    covariance: Array  #: shape (3, 3); covariance of the deviations from sensors, expected interference and reference
    standard: bool = False  #: True if gravity is compared with standard gravity, which fits better than local gravity

    @property
    def values(self) -> Array:
        """Deviations of gravity, field and dip, shape (3,)."""
        return np.array([self.gravity, self.field, self.dip])


def deviation_covariance(
    f_t: ArrayLike, b_t: ArrayLike, reference: Reference | None, covariance_s: ArrayLike, axial_sigma: float
) -> Array:
    """
    Return the covariance of the deviations of (total gravity, total field, dip) from the reference, shape (3, 3).

    Parameters
    ----------
    f_t, b_t : array_like, shape (3,)
        Specific force, m/s^2, and field, T.
    reference : Reference or None
        Reference, whose sigmas are added.
    covariance_s : array_like, shape (6, 6)
        Covariance of (f_t, b_t).
    axial_sigma : float
        1 sigma of the axial interference, T.
    """
    f_t, b_t = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
    cov = np.array(covariance_s, dtype=float)
    cov[3, 3] += axial_sigma**2
    jacobian = totals_jacobian(f_t, b_t)
    total = jacobian @ cov @ jacobian.T
    if reference is not None:
        total += np.diag([reference.sigma_gravity**2, reference.sigma_total**2, reference.sigma_dip**2])
    return np.asarray(total)


def totals_jacobian(f_t: ArrayLike, b_t: ArrayLike) -> Array:
    """
    Return the derivatives of (total gravity, total field, dip) with respect to (f_t, b_t).

    f_t, b_t, shape (3,), m/s^2 and T, not parallel. Returns shape (3, 6).
    """
    f_t, b_t = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
    g, b = np.linalg.norm(f_t), np.linalg.norm(b_t)
    up, along = f_t / g, b_t / b
    sine = -float(up @ along)
    cosine = math.sqrt(max(1.0 - sine * sine, 1e-12))
    jacobian = np.zeros((3, 6))
    jacobian[0, :3], jacobian[1, 3:] = up, along
    jacobian[2, :3] = -(along + sine * up) / (g * cosine)
    jacobian[2, 3:] = -(up + sine * along) / (b * cosine)
    return jacobian


def deviations(
    f_h: Array,
    b_h: Array,
    reference: Reference | None,
    covariance_s: Array,
    errors: SensorErrors,
    interference: float,
    has_field: bool,
) -> Deviations:
    """
    Return the deviations of a station's totals from the reference; NaN where the total or the reference is unknown.

    f_h, b_h, shape (3,), m/s^2 and T; covariance_s, shape (6, 6), of both; interference: axial field to subtract, T;
    has_field: whether the field is known. If the deviation from local gravity is above `_NOT_LOCAL` sigmas, it is
    replaced by the result of `_by_standard`.
    """
    g_total = float(np.linalg.norm(f_h))
    delta_g = math.nan
    if reference is not None and reference.gravity is not None:
        delta_g = g_total - reference.gravity
    elif abs(g_total - STANDARD_GRAVITY) > GRAVITY_FARTHEST:
        # Local gravity is unknown, but the measured value does not exist on Earth: compare it with standard gravity.
        delta_g = g_total - STANDARD_GRAVITY
    b_earth = b_h - np.array([interference, 0.0, 0.0])
    across = (errors.cross_interference_nt * 1e-9) ** 2
    covariance_s = covariance_s + np.diag([0.0, 0.0, 0.0, 0.0, across, across])
    covariance = deviation_covariance(
        f_h,
        b_earth if has_field else np.array([1e-5, 2e-5, 3e-5]),
        reference,
        covariance_s,
        errors.axial_interference_nt * 1e-9,
    )
    local = delta_g
    if abs(local) > _NOT_LOCAL * math.sqrt(covariance[0, 0]):
        delta_g = _by_standard(local, g_total - STANDARD_GRAVITY)
    standard = delta_g != local and not math.isnan(local)
    if reference is None or reference.total is None or reference.dip is None or not has_field:
        return Deviations(delta_g, math.nan, math.nan, covariance, standard)
    delta_b = float(np.linalg.norm(b_earth)) - reference.total
    return Deviations(
        delta_g, delta_b, float(magnetic_geometry.dip(f_h, b_earth)) - reference.dip, covariance, standard
    )


def _by_standard(local: float, standard: float) -> float:
    """
    Return the smaller of the deviations from local and from standard gravity; 0 if the reading is between the two.

    The tool may have been calibrated with local or with standard gravity; all its stations then have the same error.
    """
    if local * standard < 0.0:
        return 0.0
    return local if abs(local) <= abs(standard) else standard


def gravity_faults(g_total: float) -> list[Reason]:
    """
    Return the reason that shows a wrong unit of measurement or a dead accelerometer; empty if there is none.

    g_total: total gravity, m/s^2.
    """
    if 9.0 < g_total < 10.6:
        return []
    return [Reason(Code.GRAVITY_IN_G if 0.9 < g_total < 1.1 else Code.GRAVITY_NOT_EARTH, g_total)]


def field_faults(b_total: float, dip: float, reference: Reference | None) -> list[Reason]:
    """
    Return the reasons that show a wrong unit of measurement, a dead magnetometer or a reversed axis; empty if none.

    b_total: total field, T; dip: rad.
    """
    found = []
    if math.isfinite(b_total) and not 1.5e-5 < b_total < 1e-4:
        units = ((1e-9, "nT"), (1e-6, "uT"), (1e-4, "G"), (1e3, "uT, taken as nT"))
        unit = next((unit for factor, unit in units if 2e-5 < b_total * factor < 7e-5), None)
        if unit is None:
            found.append(Reason(Code.FIELD_NOT_EARTH, b_total))
        else:
            found.append(Reason(Code.FIELD_IN_OTHER_UNIT, b_total, names=(unit,)))
    if (
        reference is not None
        and reference.dip is not None
        and abs(reference.dip) > _FLAT
        and abs(dip + reference.dip) < min(0.1, 0.5 * abs(reference.dip))
    ):
        found.append(Reason(Code.DIP_SIGN, dip))
    return found


def reference_slip(f_h: Array, b_h: Array, reference: Reference, covariance: Array) -> Slip | None:
    """
    Return the slip that explains the readings; None if the readings fit the reference, or no slip explains them.

    f_h, b_h, shape (3,), m/s^2 and T; covariance, shape (3, 3): covariance of the deviations from the reference. The
    field is not corrected for interference, because the correction is wrong if the reference is wrong.
    """
    if reference.total is None or reference.dip is None or not reference.slips:
        return None
    measured = np.array([float(np.linalg.norm(b_h)), float(magnetic_geometry.dip(f_h, b_h))])
    weight = np.linalg.inv(covariance[1:, 1:])

    def misfit(total: float, dip: float) -> float:
        apart = measured - np.array([total, dip])
        return float(apart @ weight @ apart)

    best = min(reference.slips, key=lambda slip: misfit(slip.total, slip.dip))
    fit = misfit(best.total, best.dip)
    return best if fit < _CHI3_DOUBTFUL and misfit(reference.total, reference.dip) > fit + _SLIP else None


@dataclass(frozen=True)
class TotalsJudgement:
    """A verdict on the totals, and its reasons."""

    verdict: str
    reasons: tuple[Reason, ...]


def bounds(deviations: Deviations, quality: QualitySettings) -> Array:
    """
    Return the limits of gravity, m/s^2, field, T, and dip, rad, of a good station, shape (3,); NaN: not judged.

    Raises
    ------
    ValueError
        Unknown name of limits.
    """
    fixed = quality.fixed
    found = TOOLCODE_DOUBTFUL * np.sqrt(np.diagonal(deviations.covariance)) if fixed is None else fixed
    return np.where(np.isfinite(deviations.values), found, math.nan)


def judge(deviations: Deviations, quality: QualitySettings) -> TotalsJudgement:
    """
    Return the verdict on the totals.

    Parameters
    ----------
    deviations : Deviations
        Deviations; NaN values are ignored.
    quality : QualitySettings
        Limits. With limits by the tool code: 2 and 3 sigma of each deviation, and chi-square of all together.

    Raises
    ------
    ValueError
        Unknown name of limits.
    """
    doubtful, by_code = bounds(deviations, quality), quality.fixed is None
    values = deviations.values
    reject = (TOOLCODE_REJECT / TOOLCODE_DOUBTFUL if by_code else REJECT_FACTOR) * doubtful
    known = np.isfinite(values)
    verdict, reasons = ACCEPT, []
    codes = (Code.GRAVITY_OFF_STANDARD if deviations.standard else Code.GRAVITY_OFF, Code.FIELD_OFF, Code.DIP_OFF)
    for k in range(3):
        if not known[k] or abs(values[k]) <= doubtful[k]:
            continue
        verdict = worse(verdict, REJECT if abs(values[k]) > reject[k] else DOUBTFUL)
        reasons.append(Reason(codes[k], float(values[k]), float(doubtful[k])))
    if by_code and known.all() and verdict == ACCEPT:
        chi = float(values @ np.linalg.solve(deviations.covariance, values))
        if chi > _CHI3_DOUBTFUL:
            verdict = REJECT if chi > _CHI3_REJECT else DOUBTFUL
            reasons.append(Reason(Code.TOTALS_OFF_TOGETHER, chi, _CHI3_DOUBTFUL))
    return TotalsJudgement(verdict, tuple(reasons))


def against_limits(deviations: Deviations, quality: QualitySettings) -> list[Reason]:
    """Return a reason for each deviation above its limit, and one reason for all deviations within their limits."""
    values = deviations.values
    limit = bounds(deviations, quality)
    gravity = (Code.GRAVITY_WITHIN_STANDARD, Code.GRAVITY_OFF_STANDARD)
    codes = (
        gravity if deviations.standard else (Code.GRAVITY_WITHIN, Code.GRAVITY_OFF),
        (Code.FIELD_WITHIN, Code.FIELD_OFF),
        (Code.DIP_WITHIN, Code.DIP_OFF),
    )
    known = [
        (abs(value) <= most, inside, off, float(value), float(most))
        for (inside, off), value, most in zip(codes, values, limit, strict=True)
        if np.isfinite(value)
    ]
    beyond = [Reason(off, value, most) for fits, _, off, value, most in known if not fits]
    within = tuple(Reason(inside, value, most) for fits, inside, _, value, most in known if fits)
    return beyond + ([Reason(Code.WITHIN_LIMITS, causes=within)] if within else [])
