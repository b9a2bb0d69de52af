"""
Verdict on a survey station: what the totals say against the reference, in a driller's words.

Gravity, field strength and dip are known beforehand; a station that does not measure them is wrong somewhere. Limits
are either fixed (two sets in common use) or follow from the tool's own uncertainty at this attitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mwd_estimation.magnetic.axial_correction import AxialCorrection
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

ACCEPT, DOUBTFUL, REJECT = "accept", "doubtful", "reject"
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
# Beyond these many sigma of the tool code a station is doubtful, rejected.
TOOLCODE_DOUBTFUL, TOOLCODE_REJECT = 2.0, 3.0


@dataclass(frozen=True)
class QualitySettings:
    """What a station may deviate before it is doubtful or rejected."""

    limits: str = setting(
        "toolcode",
        "Limits on total gravity, total field and dip: by the errors stated, at this attitude, or fixed",
        choices=("toolcode", *LIMITS),
    )
    max_correction_sigma_deg: float = setting(
        3.0, "An axial correction whose azimuth is less certain than this is refused", unit="deg", low=0.1, high=90.0
    )
    min_azimuth_inclination_deg: float = setting(
        1.0, "Nearer to vertical than this the azimuth is not corrected", unit="deg", low=0.0, high=20.0
    )
    min_horizontal_field_nt: float = setting(
        5000.0, "With less horizontal field a magnetic azimuth is doubtful", unit="nT", low=0.0, high=50000.0
    )


@dataclass(frozen=True)
class Deviations:
    """
    Measured minus reference.

    Attributes
    ----------
    gravity, field, dip : float
        m/s^2, T, rad; nan where the reference does not say.
    covariance : ndarray, shape (3, 3)
        Of the three, from sensors, interference expected and reference.
    standard : bool
        Gravity is held against standard gravity, which it fits better than that of the place.
    """

    gravity: float
    field: float
    dip: float
    covariance: Array
    standard: bool = False


@dataclass(frozen=True)
class Judgement:
    """A verdict and its reasons; reasons that do not touch the verdict are remarks and stand last."""

    verdict: str
    reasons: tuple[str, ...]


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
    for k in range(3):
        if not known[k] or abs(values[k]) <= doubtful[k]:
            continue
        verdict = worse(verdict, REJECT if abs(values[k]) > reject[k] else DOUBTFUL)
        off = f"{_words(k, values[k])} off {_against(deviations, k)}"
        reasons.append(f"{_NAMES[k]} {off}, limit {_limit(k, doubtful[k])}{_CAUSES[k]}")
    if limits == "toolcode" and known.all() and verdict == ACCEPT:
        chi = float(values @ np.linalg.solve(deviations.covariance, values))
        if chi > _CHI3_DOUBTFUL:
            verdict = REJECT if chi > _CHI3_REJECT else DOUBTFUL
            reasons.append(
                "total gravity, total field and dip together do not fit: "
                f"chi-square {chi:.1f}, limit {_CHI3_DOUBTFUL:.1f}"
            )
    return Judgement(verdict, tuple(reasons))


def within(deviations: Deviations, limits: str) -> str:
    """One remark of an accepted station: every deviation known, against its limit."""
    values = np.array([deviations.gravity, deviations.field, deviations.dip])
    limit = bounds(deviations, limits)
    parts = [
        f"{_NAMES[k]} {_words(k, values[k])} (limit {_limit(k, limit[k])})" for k in range(3) if np.isfinite(values[k])
    ]
    if deviations.standard:
        parts[0] += f" off {_against(deviations, 0)}"
    return "within limits: " + ", ".join(parts) if parts else ""


def correction_refusal(correction: AxialCorrection, inclination: float, settings: QualitySettings) -> str:
    """
    Why an axial correction of one station must not be used; empty where it may.

    correction: of one station (arrays of shape ()); inclination in rad.
    """
    from_vertical = min(inclination, math.pi - inclination)
    if not from_vertical >= math.radians(settings.min_azimuth_inclination_deg):
        return (
            f"hole only {math.degrees(from_vertical):.2f} deg from vertical: axial interference hardly "
            "turns the azimuth there and the toolface is too loose to correct it"
        )
    if correction.chi_square > CHI1_LIMIT:
        return (
            f"across-axis field does not fit the reference (chi-square {float(correction.chi_square):.0f}, limit "
            f"{CHI1_LIMIT:.1f}): the disturbance is not axial (casing, nearby well, hot spot in the collar) "
            "or the reference is not this place's"
        )
    if correction.mirror:
        both = " and ".join(f"{math.degrees(float(angle)):.1f}" for angle in correction.both)
        return (
            f"two azimuths, {both} deg from magnetic north, fit the readings without the axial magnetometer: "
            "horizontal hole, take a gyro"
        )
    sigma = float(correction.sigma_azimuth)
    if not sigma <= math.radians(settings.max_correction_sigma_deg):
        from_horizontal = abs(0.5 * math.pi - inclination)
        from_east_west = abs(math.asin(min(1.0, abs(math.cos(float(correction.azimuth))))))
        return (
            f"hole {math.degrees(from_horizontal):.0f} deg from horizontal and "
            f"{math.degrees(from_east_west):.0f} deg from magnetic east-west: corrected azimuth good only to "
            f"{math.degrees(sigma):.1f} deg, limit {settings.max_correction_sigma_deg:.1f} deg; "
            "use multi-station correction or a gyro"
        )
    return ""


def worse(a: str, b: str) -> str:
    """The graver of two verdicts."""
    order = (ACCEPT, DOUBTFUL, REJECT)
    return order[max(order.index(a), order.index(b))]


def _against(deviations: Deviations, k: int) -> str:
    return "standard gravity (nearer than the place's)" if k == 0 and deviations.standard else "the reference"


_NAMES = ("total gravity", "total field", "dip")
_CAUSES = (
    ": tool moving, or an accelerometer off",
    ": steel near the tool, or a magnetometer off",
    ": magnetic interference (casing or another well near), or a sensor off",
)


def _words(k: int, value: float) -> str:
    return (f"{value / STANDARD_GRAVITY * 1e3:+.1f} mG", f"{value * 1e9:+.0f} nT", f"{math.degrees(value):+.2f} deg")[k]


def _limit(k: int, value: float) -> str:
    return (f"{value / STANDARD_GRAVITY * 1e3:.1f} mG", f"{value * 1e9:.0f} nT", f"{math.degrees(value):.2f} deg")[k]
