"""
One azimuth from several: magnetic (raw, corrected, multi-station) and gyro, weighed by their full covariance.

Azimuths that agree within their covariance are combined with the least-variance weights that are not negative; ones
that do not agree are never averaged: a rule that can be told to a driller chooses, and the disagreement is an alarm.
The rule and its reasons: ``docs/fusion.md``.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau
from mwd_sensors.core.settings import setting

MAGNETIC, GYRO = "magnetic", "gyro"
# Within the magnetic family a method that removes more interference goes before one that removes less.
RANK = {"raw": 0, "axial": 1, "multistation": 2}


@dataclasses.dataclass(frozen=True)
class Settings:
    """When azimuths disagree, and which are not worth weighing."""

    disagreement_sigmas: float = setting(
        3.0, "azimuths farther apart than so many sigmas of their difference disagree", low=1.0, high=10.0
    )
    steel_sigmas: float = setting(
        4.0,
        "beyond so many a multi-station azimuth that disagrees with a gyro gives way to it; others do at once",
        low=1.0,
        high=10.0,
    )
    widest_deg: float = setting(45.0, "an azimuth less certain than this is left out", unit="deg", low=1.0, high=90.0)
    open_sigmas: float = setting(
        1.5, "A gyro too uncertain to contradict, but so far away, makes a station doubtful", low=0.5, high=20.0
    )
    open_deg: float = setting(8.0, "As long as it is also farther away than this", unit="deg", low=0.0, high=180.0)
    alone_deg: float = setting(
        4.0, "A station that the gyro carries alone is doubtful with a larger sigma", unit="deg", low=0.1, high=180.0
    )
    unwitnessed: str = setting(
        "doubtful",
        "Verdict at best of a magnetic azimuth that the gyro could witness after half a turn of the tool",
        choices=("doubtful", "accept"),
    )


@dataclasses.dataclass(frozen=True)
class Candidate:
    """
    Azimuth of one method.

    Attributes
    ----------
    method : str
        raw, axial, multistation, gyro, or any other name.
    azimuth, sigma : float
        From the same north as all others, and its whole one sigma, rad.
    family : str
        MAGNETIC or GYRO: what it hangs on.
    shared : mapping of str to float
        Named error terms it has in common with others, each its signed one-sigma effect on this azimuth, rad
        (``{"declination": 0.004}``). The covariance of two candidates is the sum of products of terms of one name.
    doubt : str
        Why its own check failed (total field, dip), in words; empty where it passed.
    refused : str
        Why it must not be used; empty where it may.
    """

    method: str
    azimuth: float
    sigma: float
    family: str = MAGNETIC
    shared: Mapping[str, float] = dataclasses.field(default_factory=dict)
    doubt: str = ""
    refused: str = ""


@dataclasses.dataclass(frozen=True)
class Fused:
    """
    What the fusion made of its candidates.

    Attributes
    ----------
    azimuth, sigma : float
        Rad; NaN where nothing could be used.
    method : str
        "fused", the name of the one method used, or "none".
    weights : tuple of float
        Share of each candidate, in their order, 0 to 1, sum 1 (or all 0).
    reasons : tuple of str
        Per candidate: why it has no weight; empty where it has.
    alarm : str
        The disagreement, or the failed check of the only azimuth there is, in words; empty when all is well.
    chi_square : float
        Of the azimuths used against their weighted mean; 0 for a single one.
    covariance : ndarray, shape (n, n)
        Of all candidates, rad^2; NaN rows for those that gave no number.
    """

    azimuth: float
    sigma: float
    method: str
    weights: tuple[float, ...]
    reasons: tuple[str, ...]
    alarm: str
    chi_square: float
    covariance: Array


def covariance(candidates: Sequence[Candidate]) -> Array:
    """
    Covariance of the azimuths, rad^2, shape (n, n): own variances, and products of the terms shared by name.

    Raises
    ------
    ValueError
        A candidate whose shared terms are larger than its whole sigma.
    """
    n = len(candidates)
    V = np.zeros((n, n))
    for i, a in enumerate(candidates):
        own = sum(value * value for value in a.shared.values())
        if math.isfinite(a.sigma) and own > a.sigma * a.sigma * (1.0 + 1e-9):
            raise ValueError(
                f"shared: the terms of {a.method!r} make {math.sqrt(own):.3g} rad, more than its sigma {a.sigma:.3g}"
            )
        V[i, i] = a.sigma * a.sigma
        for j, b in enumerate(candidates[:i]):
            V[i, j] = V[j, i] = sum(value * b.shared[name] for name, value in a.shared.items() if name in b.shared)
    return V


def same_sensors(candidates: Sequence[Candidate], name: str = "magnetometer") -> list[Candidate]:
    """
    The same candidates, said to share all that the most certain of them does not know.

    For methods that work on one and the same reading (raw, axial): a second one is no second opinion. Terms already
    shared by name stay; candidates without a number stay as they are.
    """
    rest = [
        math.sqrt(max(c.sigma**2 - sum(v * v for v in c.shared.values()), 0.0))
        for c in candidates
        if math.isfinite(c.sigma) and not c.refused
    ]
    least = min(rest, default=0.0)
    return [
        c if not math.isfinite(c.sigma) or c.refused else dataclasses.replace(c, shared={**c.shared, name: least})
        for c in candidates
    ]


def least_variance(V: Array) -> tuple[Array, float]:
    """
    Weights, none negative and of sum one, that make w' V w least, and that variance.

    V, shape (n, n), n up to about ten. All sets of active weights are tried: exact, and indifferent to a singular V.
    Negative weights, which strong correlation asks for, would make the answer hang on the correlation being right.
    """
    n = len(V)
    best, least = np.zeros(n), math.inf
    for size in range(1, n + 1):
        for active in itertools.combinations(range(n), size):
            at = np.array(active)
            block = V[np.ix_(at, at)]
            bordered = np.block([[block, np.ones((size, 1))], [np.ones((1, size)), np.zeros((1, 1))]])
            try:
                w = np.linalg.solve(bordered, np.append(np.zeros(size), 1.0))[:size]
            except np.linalg.LinAlgError:
                continue
            variance = float(w @ block @ w)
            if (w >= -1e-12).all() and variance < least * (1.0 - 1e-9):
                best, least = np.zeros(n), variance
                best[at] = np.maximum(w, 0.0)
    return best / best.sum(), least


def fuse(candidates: Sequence[Candidate], settings: Settings | None = None) -> Fused:
    """
    Combine azimuths that agree; choose, and raise the alarm, where they do not.

    Parameters
    ----------
    candidates : sequence of Candidate
        All from the same north.
    settings : Settings, optional

    Returns
    -------
    Fused

    Raises
    ------
    ValueError
        As `covariance`.
    """
    settings = Settings() if settings is None else settings
    V = covariance(candidates)
    reasons = [_left_out(c, settings) for c in candidates]
    alarms: list[str] = []
    use = [i for i, reason in enumerate(reasons) if not reason]
    sound = [i for i in use if not candidates[i].doubt]
    if sound and len(sound) < len(use):
        # A failed field check says that sigma no longer covers the error: such an azimuth is compared, not weighed.
        reference = min(sound, key=lambda i: candidates[i].sigma)
        for i in use:
            if candidates[i].doubt:
                apart, ratio = _apart(candidates, V, i, reference)
                reasons[i] = f"its check failed: {candidates[i].doubt}"
                if ratio > settings.disagreement_sigmas:
                    text = (
                        f"{candidates[i].method} azimuth is {math.degrees(apart):+.1f} deg ({ratio:.1f} sigma) from "
                        f"{candidates[reference].method} and {reasons[i]}; {candidates[reference].method} is used"
                    )
                    reasons[i] = text
                    alarms.append(text)
        use = sound
    elif use and not sound:
        alarms.append("; ".join(f"{candidates[i].method}: its check failed: {candidates[i].doubt}" for i in use))
    use, widening = _settle(candidates, V, use, reasons, alarms, settings)
    weights = np.zeros(len(candidates))
    if not use:
        return Fused(math.nan, math.nan, "none", tuple(weights), tuple(reasons), "; ".join(alarms), 0.0, V)
    at = np.array(use)
    weights[at], variance = least_variance(V[np.ix_(at, at)])
    # Differences from one of them, wrapped: the mean of 359 and 1 is 0.
    start = candidates[min(use, key=lambda i: candidates[i].sigma)].azimuth
    apart_all = np.array([float(wrap_pi(candidates[i].azimuth - start)) for i in use])
    shift = float(weights[at] @ apart_all)
    residual = apart_all - shift
    chi_square = float(residual @ np.linalg.pinv(V[np.ix_(at, at)], hermitian=True) @ residual) if len(use) > 1 else 0.0
    for i in use:
        if weights[i] == 0.0:
            reasons[i] = "agrees, but adds nothing to the more certain one it shares its errors with"
    carried = [i for i in use if weights[i] > 0.0]
    method = candidates[carried[0]].method if len(carried) == 1 else "fused"
    sigma = min(math.hypot(math.sqrt(variance), widening), math.pi)
    return Fused(
        float(wrap_tau(start + shift)),
        sigma,
        method,
        tuple(float(w) for w in weights),
        tuple(reasons),
        "; ".join(alarms),
        chi_square,
        V,
    )


def _left_out(c: Candidate, settings: Settings) -> str:
    if c.refused:
        return c.refused
    if not (math.isfinite(c.azimuth) and math.isfinite(c.sigma) and c.sigma > 0.0):
        return "no azimuth"
    if c.sigma > math.radians(settings.widest_deg):
        return f"not certain enough: {math.degrees(c.sigma):.0f} deg"
    return ""


def _apart(candidates: Sequence[Candidate], V: Array, i: int, j: int) -> tuple[float, float]:
    """Difference of two azimuths, rad, wrapped, and the same in sigmas of a difference."""
    apart = float(wrap_pi(candidates[i].azimuth - candidates[j].azimuth))
    variance = max(V[i, i] + V[j, j] - 2.0 * V[i, j], 1e-4 * min(V[i, i], V[j, j]))
    return apart, abs(apart) / math.sqrt(variance)


def _settle(
    candidates: Sequence[Candidate],
    V: Array,
    use: list[int],
    reasons: list[str],
    alarms: list[str],
    settings: Settings,
) -> tuple[list[int], float]:
    """
    Drop azimuths until the rest agree; returns those kept and by how much sigma must be widened, rad.

    Of the pair farthest apart in sigmas one goes. Magnetic against gyro: the magnetic one, for steel can turn the field
    and leave its total and dip in order, and nothing turns the rotation of the Earth; one that fits the other stations
    of the run has more to say for itself than a gyro three sigma off, as one in four hundred is by chance, and goes
    later. Both magnetic: the one that removes less interference. Else the less certain one, and since nothing but its
    sigma speaks for the other, the difference is added to the sigma that is published.
    """
    use, widening = list(use), 0.0
    while len(use) > 1:
        pairs = [(*_apart(candidates, V, i, j), i, j) for i, j in itertools.combinations(use, 2)]
        apart, ratio, i, j = max(pairs, key=lambda pair: pair[1])
        if ratio <= settings.disagreement_sigmas:
            break
        a, b = candidates[i], candidates[j]
        ranked = a.family == b.family == MAGNETIC and RANK.get(a.method, -1) != RANK.get(b.method, -1)
        by_run = any(c.family == MAGNETIC and c.method == "multistation" for c in (a, b))
        if a.family != b.family and (ratio > settings.steel_sigmas or not by_run):
            lose, keep = (i, j) if a.family == MAGNETIC else (j, i)
            why = "because steel can turn the field without changing its total or dip"
        elif ranked:
            lose, keep = (i, j) if RANK.get(a.method, -1) < RANK.get(b.method, -1) else (j, i)
            why = "because it removes more interference"
        else:
            lose, keep = (i, j) if a.sigma > b.sigma else (j, i)
            why = "the more certain, its sigma widened by the difference: no check says which is wrong"
            widening = max(widening, abs(apart))
        sign = apart if lose == i else -apart
        text = (
            f"{candidates[lose].method} azimuth is {math.degrees(sign):+.1f} deg ({ratio:.1f} sigma) from "
            f"{candidates[keep].method}; {candidates[keep].method} is used, {why}"
        )
        reasons[lose] = text
        alarms.append(text)
        use.remove(lose)
    return use, widening


def left_open(magnetic: Candidate, gyro: Candidate, result: Fused, settings: Settings) -> str:
    """
    What a gyro that is not certain enough leaves open of a station, in words; empty where nothing.

    It is no alarm: one sound station in eight is 1.5 sigma away. But steel that turns the field by tens of
    degrees and keeps its total and dip shows in nothing else.
    """
    if result.alarm or not math.isfinite(gyro.azimuth) or gyro.refused:
        return ""
    if not math.isfinite(magnetic.azimuth):
        if gyro.sigma <= math.radians(settings.alone_deg):
            return ""
        return (
            f"azimuth by the gyro alone, good to {math.degrees(gyro.sigma):.1f} deg, limit {settings.alone_deg:.1f} deg"
            ": let the tool rest longer, or turn it between two rests"
        )
    apart = float(wrap_pi(gyro.azimuth - magnetic.azimuth))
    ratio = abs(apart) / math.hypot(gyro.sigma, magnetic.sigma)
    if ratio <= settings.open_sigmas or abs(apart) <= math.radians(settings.open_deg):
        return ""
    return (
        f"{GYRO} azimuth is {math.degrees(apart):+.1f} deg ({ratio:.1f} sigma) from {magnetic.method}, not certain"
        " enough to say which is right: let the tool rest longer, or turn it between two rests, and survey again"
    )


def unconfirmed(missing: str, last_alarm: str, could: bool = False) -> tuple[str, str]:
    """
    What a station is worth whose magnetic azimuth the gyro has not confirmed: a doubt and a remark, either may be "".

    Steel that turns the field and leaves total and dip in order shows in nothing but a gyro. Where the gyro has said at
    the last station that there is such steel, an azimuth it has not seen is doubtful; where it has said nothing yet, or
    agreed, the station is worth what its own checks make of it, and says that it was not compared. Where half a
    turn is all the gyro lacks to speak, that is a doubt too: it costs minutes, and nothing else on board knows.

    Parameters
    ----------
    missing : str
        Why there is no gyro azimuth here, in words; empty where there is one, or no gyro in the tool.
    last_alarm : str
        `Fused.alarm` of the last station at which both were compared; empty where they agreed or none was compared.
    could : bool
        Whether a second position would make the gyro certain enough.
    """
    if not missing:
        return "", ""
    if last_alarm:
        doubt = f"magnetic azimuth not confirmed by the gyro ({missing}); at the last station compared: {last_alarm}"
        return doubt + "; let the tool rest and survey again", ""
    text = f"magnetic azimuth not compared with the gyro: {missing}"
    return (text, "") if could else ("", text)
