"""
One azimuth from several: magnetic (raw, corrected, multi-station) and gyro, weighed by their full covariance.

Azimuths that agree within their covariance are combined with the least-variance weights that are not negative; ones
that do not agree are never averaged: a rule chooses, and the disagreement is an alarm. The rule and why it is so:
``docs/methods/azimuth_fusion.md``.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau
from mwd_sensors.core.settings import setting

# Families: what an azimuth rests on.
MAGNETIC, GYRO = "magnetic", "gyro"
# Within the magnetic family a method that removes more interference goes before one that removes less.
RANK: dict[str, int] = {AzimuthMethod.RAW: 0, AzimuthMethod.SINGLE_STATION: 1, AzimuthMethod.MULTI_STATION: 2}


@dataclasses.dataclass(frozen=True)
class Settings:
    """When azimuths disagree, and which are not worth weighing."""

    disagreement_sigmas: float = setting(
        3.0,
        "Two azimuths disagree when they are farther apart than so many sigma of their difference. Raising it hides "
        "interference, lowering it raises false alarms.",
        low=1.0,
        high=10.0,
    )
    external_sigmas: float = setting(
        4.0,
        "Beyond so many sigma a multi-station azimuth gives way to the gyro; other magnetic azimuths do at "
        "`disagreement_sigmas`. Raising it trusts the run longer against a gyro.",
        low=1.0,
        high=10.0,
    )
    widest_deg: float = setting(
        45.0, "An azimuth with a larger sigma is neither weighed nor compared.", unit="deg", low=1.0, high=90.0
    )
    open_sigmas: float = setting(
        1.5,
        "A gyro too uncertain to contradict makes the station doubtful when it is so many sigma away. Raising it "
        "accepts more surveys beside interference that keeps total field and dip.",
        low=0.5,
        high=20.0,
    )
    open_deg: float = setting(
        8.0, "Smaller differences from such a gyro do not make the station doubtful.", unit="deg", low=0.0, high=180.0
    )
    alone_deg: float = setting(
        4.0,
        "A station whose azimuth is the gyro's alone is doubtful with a larger sigma.",
        unit="deg",
        low=0.1,
        high=180.0,
    )
    unconfirmed: str = setting(
        "doubtful",
        "Best verdict of a magnetic azimuth that the gyro could confirm after half a turn of the tool.",
        choices=("doubtful", "accept"),
    )


@dataclasses.dataclass(frozen=True)
class Candidate:
    """
    Azimuth of one method.

    Attributes
    ----------
    method : str
        An `AzimuthMethod`, or another name for a mean of several.
    azimuth, sigma : float
        From the same north as all others, and its whole one sigma, rad.
    family : str
        MAGNETIC or GYRO: what it rests on.
    shared : mapping of str to float
        Named error terms it has in common with others, each its signed one-sigma effect on this azimuth, rad
        (``{"declination": 0.004}``). The covariance of two candidates is the sum of products of terms of one name.
    doubt : tuple of Reason
        Why its own check failed (total field, dip); empty where it passed.
    refused : Reason or None
        Why it must not be used; None where it may.
    """

    method: str
    azimuth: float
    sigma: float
    family: str = MAGNETIC
    shared: Mapping[str, float] = dataclasses.field(default_factory=dict)
    doubt: tuple[Reason, ...] = ()
    refused: Reason | None = None


@dataclasses.dataclass(frozen=True)
class Fused:
    """
    One azimuth from its candidates.

    Attributes
    ----------
    azimuth, sigma : float
        Rad; NaN where nothing could be used.
    method : str
        "fused", the name of the one method used, or "none".
    weights : tuple of float
        Share of each candidate, in their order, 0 to 1, sum 1 (or all 0).
    reasons : tuple of Reason or None
        Per candidate: why it has no weight; None where it has.
    alarm : tuple of Reason
        The disagreements, or the failed check of the only azimuth there is; empty when all is well.
    chi_square : float
        Of the azimuths used against their weighted mean; 0 for a single one.
    covariance : ndarray, shape (n, n)
        Of all candidates, rad^2; NaN rows for those that gave no number.
    """

    azimuth: float
    sigma: float
    method: str
    weights: tuple[float, ...]
    reasons: tuple[Reason | None, ...]
    alarm: tuple[Reason, ...]
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
    The same candidates with a shared error: all that the most certain of them does not know.

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
    alarms: list[Reason] = []
    use = _sound(candidates, V, reasons, alarms, settings)
    use, widening = _settle(candidates, V, use, reasons, alarms, settings)
    weights = np.zeros(len(candidates))
    if not use:
        none = AzimuthMethod.NONE
        return Fused(math.nan, math.nan, none, tuple(weights), tuple(reasons), tuple(alarms), 0.0, V)
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
            reasons[i] = Reason(Code.AZIMUTH_ADDS_NOTHING)
    weighing = [i for i in use if weights[i] > 0.0]
    return Fused(
        float(wrap_tau(start + shift)),
        min(math.hypot(math.sqrt(variance), widening), math.pi),
        candidates[weighing[0]].method if len(weighing) == 1 else AzimuthMethod.FUSED,
        tuple(float(w) for w in weights),
        tuple(reasons),
        tuple(alarms),
        chi_square,
        V,
    )


def _sound(
    candidates: Sequence[Candidate],
    V: Array,
    reasons: list[Reason | None],
    alarms: list[Reason],
    settings: Settings,
) -> list[int]:
    """
    The candidates to weigh: those whose own check passed, else all.

    After a failed field check sigma no longer covers the error: such an azimuth is compared, not weighed.
    """
    use = [i for i, reason in enumerate(reasons) if reason is None]
    sound = [i for i in use if not candidates[i].doubt]
    if not sound:
        alarms += [
            Reason(Code.ONLY_AZIMUTH_CHECK_FAILED, names=(candidates[i].method,), causes=candidates[i].doubt)
            for i in use
        ]
        return use
    reference = min(sound, key=lambda i: candidates[i].sigma)
    for i in use:
        doubt = candidates[i].doubt
        if not doubt:
            continue
        apart, ratio = _apart(candidates, V, i, reference)
        why = Reason(Code.CHECK_FAILED, causes=doubt)
        if ratio > settings.disagreement_sigmas:
            names = (candidates[i].method, candidates[reference].method)
            why = Reason(Code.DISAGREES_CHECK_FAILED, apart, values=(ratio,), names=names, causes=doubt)
            alarms.append(why)
        reasons[i] = why
    return sound


def _left_out(c: Candidate, settings: Settings) -> Reason | None:
    if c.refused is not None:
        return c.refused
    if not (math.isfinite(c.azimuth) and math.isfinite(c.sigma) and c.sigma > 0.0):
        return Reason(Code.NO_AZIMUTH)
    widest = math.radians(settings.widest_deg)
    if c.sigma > widest:
        return Reason(Code.AZIMUTH_UNCERTAIN, c.sigma, widest)
    return None


def _apart(candidates: Sequence[Candidate], V: Array, i: int, j: int) -> tuple[float, float]:
    """Difference of two azimuths, rad, wrapped, and the same in sigmas of a difference."""
    apart = float(wrap_pi(candidates[i].azimuth - candidates[j].azimuth))
    variance = max(V[i, i] + V[j, j] - 2.0 * V[i, j], 1e-4 * min(V[i, i], V[j, j]))
    return apart, abs(apart) / math.sqrt(variance)


def _settle(
    candidates: Sequence[Candidate],
    V: Array,
    use: list[int],
    reasons: list[Reason | None],
    alarms: list[Reason],
    settings: Settings,
) -> tuple[list[int], float]:
    """
    Drop azimuths until the rest agree; returns those kept and by how much sigma must be widened, rad.

    Of the pair farthest apart in sigmas one goes. Magnetic against gyro: the magnetic one, for external interference
    can turn the field and leave its total and dip in order, and nothing turns the rotation of the Earth; one that fits
    the other stations of the run is better supported than a gyro three sigma off, as one in four hundred is by chance,
    and goes later. Both magnetic: the one that removes less interference. Else the less certain one, and since nothing
    but its sigma speaks for the other, the difference is added to the sigma that is published.
    """
    use, widening = list(use), 0.0
    while len(use) > 1:
        pairs = [(*_apart(candidates, V, i, j), i, j) for i, j in itertools.combinations(use, 2)]
        apart, ratio, i, j = max(pairs, key=lambda pair: pair[1])
        if ratio <= settings.disagreement_sigmas:
            break
        a, b = candidates[i], candidates[j]
        ranked = a.family == b.family == MAGNETIC and RANK.get(a.method, -1) != RANK.get(b.method, -1)
        by_run = any(c.family == MAGNETIC and c.method == AzimuthMethod.MULTI_STATION for c in (a, b))
        if a.family != b.family and (ratio > settings.external_sigmas or not by_run):
            lose, keep = (i, j) if a.family == MAGNETIC else (j, i)
            code = Code.DISAGREES_EXTERNAL_INTERFERENCE
        elif ranked:
            lose, keep = (i, j) if RANK.get(a.method, -1) < RANK.get(b.method, -1) else (j, i)
            code = Code.DISAGREES_LESS_CORRECTED
        else:
            lose, keep = (i, j) if a.sigma > b.sigma else (j, i)
            code = Code.DISAGREES_LESS_CERTAIN
            widening = max(widening, abs(apart))
        sign = apart if lose == i else -apart
        names = (candidates[lose].method, candidates[keep].method)
        why = Reason(code, sign, settings.disagreement_sigmas, (ratio,), names)
        reasons[lose] = why
        alarms.append(why)
        use.remove(lose)
    return use, widening
