# SPDX-License-Identifier: Apache-2.0
"""
Field acceptance criteria: verdict on a survey station by its totals against the reference.

Gravity, field strength and dip are known beforehand; a station that does not measure them is wrong somewhere. Limits
are either fixed (two sets in common use) or follow from the tool's own uncertainty at this attitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

ACCEPT, DOUBTFUL, REJECT = "accept", "doubtful", "reject"
# Of one quantity: this attitude does not define it.
NOT_DETERMINED = "not_determined"
# Chi-square of three degrees of freedom exceeded by chance once in 100 and once in 1000.
_CHI3_DOUBTFUL, _CHI3_REJECT = 11.34, 16.27
# Chi-square of one degree of freedom exceeded by chance once in 1000.
CHI1_LIMIT = 10.83


@dataclass(frozen=True)
class Limits:
    """Fixed limits on the deviations from the reference; beyond `reject_factor` times a limit a station is rejected."""

    name: str
    gravity: float
    field: float
    dip: float
    reject_factor: float = 1.5


LIMITS = {
    # One service company's defaults: 2.5 mG, 300 nT, 0.45 deg.
    "service": Limits("service", 2.5e-3 * STANDARD_GRAVITY, 300e-9, math.radians(0.45)),
    # Rule of thumb of the ISCWSA e-book: 300 nT, 0.25 deg; it names none for gravity.
    "iscwsa": Limits("iscwsa", 2.5e-3 * STANDARD_GRAVITY, 300e-9, math.radians(0.25)),
}
# A single-station correction whose azimuth is less certain is refused, and one nearer to vertical, rad.
_LEAST_CERTAIN = math.radians(3.0)
NEAR_VERTICAL = math.radians(1.0)
# Beyond these many sigma of the tool code a station is doubtful, rejected.
TOOLCODE_DOUBTFUL, TOOLCODE_REJECT = 2.0, 3.0


def _described(limits: Limits) -> str:
    """Name of fixed limits and the figures in use: 2.5 mG, 300 nT, .45 deg."""
    gravity, field, dip = limits.gravity / STANDARD_GRAVITY * 1e3, limits.field * 1e9, math.degrees(limits.dip)
    return f"{limits.name} ({gravity:g} mG, {field:g} nT, {dip:g} deg)"


@dataclass(frozen=True)
class QualitySettings:
    """When a survey is accepted or doubtful; the same for the tool's own surveys and those of a telemetry link."""

    limits: str = setting(
        "toolcode",
        "Limits on total gravity, total field and dip: toolcode (from the errors of the tool at this attitude), "
        + ", ".join(_described(limits) for limits in LIMITS.values())
        + ".",
        choices=("toolcode", *LIMITS),
    )
    far_deg: float = setting(
        10.0,
        "Error of the azimuth that the well must not have. Lowering it accepts only more certain azimuths: a sigma of "
        "some third of it.",
        unit="deg",
        low=0.1,
        high=90.0,
        expert=True,
    )
    far_probability: float = setting(
        0.007,
        "An azimuth is doubtful that is farther off than far_deg with a larger probability. Raising it accepts more "
        "stations beside interference, and more of them are far off.",
        low=0.0001,
        high=0.5,
        expert=True,
    )


@dataclass(frozen=True)
class Deviations:
    """
    Measured minus reference.

    Attributes
    ----------
    gravity, field, dip : float
        m/s^2, T, rad; nan where the reference has none.
    covariance : ndarray, shape (3, 3)
        Of the three, from sensors, interference expected and reference.
    standard : bool
        Gravity is compared with standard gravity, which it fits better than that of the place.
    """

    gravity: float
    field: float
    dip: float
    covariance: Array
    standard: bool = False


@dataclass(frozen=True)
class Judgement:
    """A verdict and the reasons that made it."""

    verdict: str
    reasons: tuple[Reason, ...]


def bounds(deviations: Deviations, limits: str) -> Array:
    """
    Deviation of gravity, field and dip beyond which a station is doubtful, shape (3,): m/s^2, T, rad; nan: not judged.

    Raises
    ------
    ValueError
        Unknown name of limits.
    """
    if limits == "toolcode":
        found = TOOLCODE_DOUBTFUL * np.sqrt(np.diagonal(deviations.covariance))
    elif limits in LIMITS:
        fixed = LIMITS[limits]
        found = np.array([fixed.gravity, fixed.field, fixed.dip])
    else:
        raise ValueError(f"limits: {limits!r} is not one of {', '.join(LIMITS)}, toolcode")
    known = np.isfinite([deviations.gravity, deviations.field, deviations.dip])
    return np.where(known, found, math.nan)


def judge(deviations: Deviations, limits: str) -> Judgement:
    """
    Verdict of the totals alone.

    Parameters
    ----------
    deviations : Deviations
        nan deviations are not judged.
    limits : str
        A name in `LIMITS`, or "toolcode" for limits of 2 and 3 sigma of the covariance, and of chi-square of all
        together.

    Raises
    ------
    ValueError
        Unknown name.
    """
    doubtful = bounds(deviations, limits)
    values = np.array([deviations.gravity, deviations.field, deviations.dip])
    if limits == "toolcode":
        reject = TOOLCODE_REJECT * np.sqrt(np.diagonal(deviations.covariance))
    else:
        reject = LIMITS[limits].reject_factor * doubtful
    known = np.isfinite(values)
    verdict, reasons = ACCEPT, []
    codes = (Code.GRAVITY_OFF_STANDARD if deviations.standard else Code.GRAVITY_OFF, Code.FIELD_OFF, Code.DIP_OFF)
    for k in range(3):
        if not known[k] or abs(values[k]) <= doubtful[k]:
            continue
        verdict = worse(verdict, REJECT if abs(values[k]) > reject[k] else DOUBTFUL)
        reasons.append(Reason(codes[k], float(values[k]), float(doubtful[k])))
    if limits == "toolcode" and known.all() and verdict == ACCEPT:
        chi = float(values @ np.linalg.solve(deviations.covariance, values))
        if chi > _CHI3_DOUBTFUL:
            verdict = REJECT if chi > _CHI3_REJECT else DOUBTFUL
            reasons.append(Reason(Code.TOTALS_OFF_TOGETHER, chi, _CHI3_DOUBTFUL))
    return Judgement(verdict, tuple(reasons))


def totals(deviations: Deviations, limits: str) -> list[Reason]:
    """Every deviation that is known, against its limit; those beyond it by themselves, the others in one reason."""
    values = np.array([deviations.gravity, deviations.field, deviations.dip])
    limit = bounds(deviations, limits)
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


def correction_refusal(correction: AxialCorrection, inclination: float) -> Reason | None:
    """
    Why an axial correction of one station must not be used; None where it may.

    correction: of one station (arrays of shape ()); inclination in rad.
    """
    from_vertical = min(inclination, math.pi - inclination)
    if not from_vertical >= NEAR_VERTICAL:
        return Reason(Code.CORRECTION_NEAR_VERTICAL, from_vertical, NEAR_VERTICAL)
    if correction.chi_square > CHI1_LIMIT:
        return Reason(Code.CROSS_AXIAL_MISFIT, float(correction.chi_square), CHI1_LIMIT)
    if correction.mirror:
        first, second = (float(angle) for angle in correction.both)
        return Reason(Code.TWO_AZIMUTHS_FIT_FIELD, values=(first, second))
    sigma = float(correction.sigma_azimuth)
    if not sigma <= _LEAST_CERTAIN:
        from_horizontal = abs(0.5 * math.pi - inclination)
        from_east_west = abs(math.asin(min(1.0, abs(math.cos(float(correction.azimuth))))))
        return Reason(Code.CORRECTION_UNCERTAIN, sigma, _LEAST_CERTAIN, (from_horizontal, from_east_west))
    return None


def worse(a: str, b: str) -> str:
    """The graver of two verdicts; one that says something goes before one of a quantity that is not determined."""
    order = (NOT_DETERMINED, ACCEPT, DOUBTFUL, REJECT)
    return order[max(order.index(a), order.index(b))]
