"""A survey: one station with when, how and from what it was measured."""

from __future__ import annotations

import dataclasses
import math
import uuid
from collections.abc import Mapping

import numpy as np

from mwd_estimation.core import reason_text
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import azimuth_fusion
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, worse
from mwd_estimation.survey.azimuth_selection import CORRECTED
from mwd_estimation.survey.multi_station_analysis import MSA, Multistation
from mwd_estimation.survey.run_history import StationRun
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import NO_AZIMUTH, MethodAzimuth, Station, StationSettings, station
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import magnetic_toolface, mat_nt, wrap_pi, wrap_tau

GYRO = "gyro"
STATIC, ROTARY = "static", "rotary"
_BY_GYRO_ALONE = ": azimuth by the gyro alone"
# What `fusion` calls the methods that it ranks.
_RANKED = {CORRECTED: "axial", MSA: "multistation"}

# A gyro's choice between azimuths is left to the magnetometer where one lies within the first of its azimuth and all
# others beyond the second: no steel that leaves total and dip in order turns a field so far.
_NEAR, _FAR = math.radians(60.0), math.radians(90.0)

# Refusals of a gyro that a second position, or more time there, lifts.
_ANOTHER_POSITION_LIFTS = frozenset(
    {ReasonCode.GYRO_BIAS_UNKNOWN, ReasonCode.GYRO_BIAS_UNKNOWN_STATIC, ReasonCode.TWO_AZIMUTHS_FIT_GYRO}
)

# Names a survey by its time and readings, so that a replay names it alike whatever its number (RFC 4122, version 5).
_SURVEYS = uuid.UUID("6b0d4f5e-6f0e-5c1b-9a55-3a5d2c1b7e10")


@dataclasses.dataclass(frozen=True)
class Survey:
    """
    One survey as the estimator hands it over.

    Attributes
    ----------
    stamp_ns : int
        Middle of the averaging interval.
    sequence : int
        From 1.
    uuid : str
    requested : bool
        Asked for, not taken by itself.
    duration : float
        s.
    samples : int
        IMU samples averaged.
    station : Station
        Angles, totals, verdict; its azimuth is the fused one.
    weights : mapping of str to float
        Share of each of the station's methods in its azimuth.
    azimuth_reasons : mapping of str to str
        Why a method has no weight; empty where there is nothing to say.
    alarm : str or None
        How gyro and magnetic azimuth disagree; empty where they agree, None where they were not compared.
    left_open : float
        How far apart they are, rad, where the gyro is too uncertain to say which is right, else 0; part of the sigma.
    kind : str
        static, or rotary: taken while the string turned.
    covariance_f, covariance_b : ndarray, shape (3, 3)
        Of the averaged specific force, (m/s^2)^2, and field, T^2: the noise alone.
    rate_t : ndarray, shape (3,)
        Mean angular rate of the precision unit, else of the AHRS, rad/s.
    temperature : float or None
        degC.
    """

    stamp_ns: int
    sequence: int
    uuid: str
    requested: bool
    duration: float
    samples: int
    station: Station
    covariance_f: Array
    covariance_b: Array
    rate_t: Array
    temperature: float | None
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    azimuth_reasons: Mapping[str, str] = dataclasses.field(default_factory=dict)
    alarm: str | None = None
    left_open: float = 0.0
    kind: str = STATIC


def from_average(
    still: StillAverage,
    sequence: int,
    reference: Reference | None,
    settings: StationSettings,
    gyro: Solution | None = None,
    fusing: azimuth_fusion.Settings | None = None,
    *,
    run: StationRun | None = None,
    last_alarm: str = "",
    doubts: tuple[str, ...] = (),
    faults: tuple[str, ...] = (),
) -> tuple[Survey, Multistation | None]:
    """
    Work out the survey of a still interval.

    Parameters
    ----------
    still, sequence, reference, settings
        What was read, the survey's number, and what to work it out by.
    gyro : Solution, optional
        North found with the precision unit, or in words why there is none; None without such a unit.
    fusing : azimuth_fusion.Settings, optional
    run : StationRun, optional
        The stations before it, into which it is taken.
    last_alarm : str
        How gyro and magnetic azimuth disagreed at the last station at which they were compared.
    doubts, faults : tuple of str
        What others saw while it was taken: each makes it doubtful, respectively rejected.

    Returns
    -------
    survey : Survey
    analysis : Multistation or None
        Of the run with it, where one holds.
    """
    b_t = still.mag.mean if still.mag is not None else np.full(3, np.nan)
    covariance_b = still.mag.covariance if still.mag is not None else np.zeros((3, 3))
    covariance_f = still.imu.covariance[3:, 3:]
    rates = still.precision if still.precision is not None else still.imu
    stamp_ns = (still.start_ns + still.end_ns) // 2
    alone = station(
        still.imu.mean[3:],
        b_t,
        reference,
        settings,
        covariance_f=covariance_f,
        covariance_b=covariance_b,
        doubts=doubts,
        faults=faults,
    )
    gyro = chosen_by_field(gyro, alone)
    analysis = None
    together = alone
    # What others doubt or reject is no station to learn from.
    if run is not None and not doubts and not faults:
        together, analysis = run.take(alone, settings)
    aided = 0.0 if analysis is None else float(analysis.by_gyro[-1])
    result = fused(alone, together, gyro, fusing, last_alarm=last_alarm, doubted=bool(doubts or faults), aided=aided)
    if together is not alone and run is not None and result.alarm == "" and gyro is not None and gyro.success:
        run.heard(*gyro_for_run(result.station, gyro))
    return (
        Survey(
            stamp_ns=stamp_ns,
            sequence=sequence,
            uuid=str(uuid.uuid5(_SURVEYS, f"{stamp_ns} {[float(v) for v in still.imu.mean]}")),
            requested=still.requested,
            duration=(still.end_ns - still.start_ns) * 1e-9,
            samples=still.imu.count,
            station=result.station,
            covariance_f=covariance_f,
            covariance_b=covariance_b,
            rate_t=rates.mean[:3],
            temperature=still.temperature,
            weights=result.weights,
            azimuth_reasons=result.reasons,
            alarm=result.alarm,
            left_open=result.left_open,
        ),
        analysis,
    )


def from_rotary(
    turned: StillAverage, sequence: int, reference: Reference | None, settings: StationSettings, rotary_speed: float
) -> Survey:
    """
    Work out the survey of an average taken in axes that do not turn (`rotary_survey`); it has no toolface.

    rotary_speed: rad/s, for the record.
    """
    taken, _ = from_average(turned, sequence, reference, settings)
    one = taken.station
    covariance = one.covariance.copy()
    covariance[2, :] = covariance[:, 2] = 0.0
    covariance[2, 2] = math.pi**2
    how = f"taken while the string turned at {abs(rotary_speed) * 30.0 / math.pi:.0f} r/min: no toolface"
    blind = dataclasses.replace(
        one,
        gravity_toolface=0.0,
        magnetic_toolface=0.0,
        sigma_toolface=math.pi,
        covariance=covariance,
        reasons=(*one.reasons, how),
    )
    return dataclasses.replace(taken, station=blind, kind=ROTARY)


@dataclasses.dataclass(frozen=True)
class Fused:
    """A station with its azimuths weighed: the weight of each method, why one has none, and as `Survey` has them."""

    station: Station
    weights: dict[str, float]
    reasons: dict[str, str]
    alarm: str | None
    left_open: float = 0.0


def fused(
    alone: Station,
    together: Station,
    gyro: Solution | None,
    settings: azimuth_fusion.Settings | None = None,
    *,
    last_alarm: str = "",
    doubted: bool = False,
    aided: float = 0.0,
) -> Fused:
    """
    Weigh the azimuths of a station: raw or corrected, multi-station, gyro.

    The magnetic ones first, by their full covariance: they are of one reading and share all that the most certain of
    them does not know, and the declination. What they give is then held against the gyro, with which they share the
    declination at most. An azimuth whose field failed its check is compared, not averaged; a disagreement with the gyro
    makes the station doubtful at least. A station that nothing but its magnetic azimuth made doubtful is accepted where
    another azimuth carries it.

    Parameters
    ----------
    alone, together : Station
        By itself, and as the stations of the run correct it (the same where they don't).
    gyro : Solution or None
        As `from_average` takes it.
    settings : azimuth_fusion.Settings, optional
    last_alarm : str
        As `from_average` takes it.
    doubted : bool
        Whether the station has doubts of others' making.
    aided : float
        How far the multi-station azimuth follows what the gyro found at the stations before, as `Multistation.by_gyro`.
    """
    aided = min(max(aided, 0.0), 1.0)
    together = _declination_once(together, aided)
    group, reasons = _magnetic(alone, together, aided)
    weighed = azimuth_fusion.fuse(azimuth_fusion.same_sensors(group), settings)
    names = [one.method for one in together.azimuths]
    weights = dict(zip(names, weighed.weights, strict=True))
    reasons = {name: reason or said for (name, reason), said in zip(reasons.items(), weighed.reasons, strict=True)}
    if gyro is None:
        return Fused(_carried_by(together, weighed, weights, "", False, doubted), weights, reasons, None)
    found, shared = _gyro_azimuth(gyro, together)
    base = dataclasses.replace(together, azimuths=(*together.azimuths, found))
    names.append(GYRO)
    if found.refused:
        doubt, remark = azimuth_fusion.unconfirmed(found.refused, last_alarm, _could_witness(gyro, settings))
        base = _carried_by(base, weighed, weights, doubt, False, doubted)
        if remark:
            base = dataclasses.replace(base, reasons=(*base.reasons, remark))
        return Fused(base, {**weights, GYRO: 0.0}, {**reasons, GYRO: found.refused}, None)
    sound = all(not group[k].doubt for k, name in enumerate(together.azimuths) if weights[name.method] > 0.0)
    in_both = {}
    if math.isfinite(weighed.sigma):
        follows = weights.get(MSA, 0.0) * aided
        in_both["declination"] = min((1.0 - follows) * declination_sigma(together), weighed.sigma)
        if follows:
            rest, left = (
                math.sqrt(max(sigma**2 - sum(v * v for v in terms.values()), 0.0))
                for sigma, terms in ((weighed.sigma, in_both), (found.sigma, shared))
            )
            lasting = math.sqrt(gyro.sigma**2 - min(gyro.limit, gyro.sigma) ** 2)
            in_both["gyro"], shared["gyro"] = min(follows * lasting, rest), min(lasting, left)
    magnetic = azimuth_fusion.Candidate(
        weighed.method if weighed.method != "fused" else azimuth_fusion.MAGNETIC,
        weighed.azimuth,
        weighed.sigma,
        shared=in_both,
        doubt="" if sound else next(one.doubt for one in group if one.doubt),
    )
    strict = azimuth_fusion.Settings() if settings is None else settings
    if last_alarm:
        # Steel has been found in this run: no magnetic azimuth outlasts the gyro on the strength of its sigma.
        strict = dataclasses.replace(strict, steel_sigmas=strict.disagreement_sigmas)
    by_gyro = azimuth_fusion.Candidate(GYRO, found.azimuth, found.sigma, azimuth_fusion.GYRO, shared)
    both = azimuth_fusion.fuse([magnetic, by_gyro], strict)
    share = both.weights[0]
    reasons = {
        name: reason or (both.reasons[0] if weights[name] > 0.0 and share == 0.0 else "")
        for name, reason in reasons.items()
    }
    weights = {name: weight * share for name, weight in weights.items()}
    weights[GYRO], reasons[GYRO] = both.weights[1], both.reasons[1]
    compared = all(math.isfinite(c) for c in (magnetic.azimuth, found.azimuth))
    left_open, apart = azimuth_fusion.left_open(magnetic, by_gyro, both, strict), 0.0
    if left_open and compared:
        # Nothing says which is right: the other may be.
        apart = abs(float(wrap_pi(found.azimuth - both.azimuth)))
        both = dataclasses.replace(both, sigma=min(math.hypot(both.sigma, apart), math.pi))
    doubt = both.alarm or left_open
    if not doubt and compared and found.sigma > math.radians(strict.alone_deg):
        doubt = (
            azimuth_fusion.unconfirmed(f"good to {math.degrees(found.sigma):.0f} deg only", last_alarm)[0]
            if last_alarm
            else ""
        )
    station_ = _carried_by(base, both, weights, doubt, weights[GYRO] > 0.0, doubted)
    return Fused(station_, weights, reasons, both.alarm if compared else None, apart)


def chosen_by_field(gyro: Solution | None, alone: Station) -> Solution | None:
    """
    The gyro's answer; of azimuths that fit equally, the one that the magnetometer can tell from the others.

    gyro : as `from_average` takes it; alone: the station by its magnetometer.
    """
    if gyro is None or not gyro.choices or not math.isfinite(alone.azimuth):
        return gyro
    turn = _from_true(alone)
    if turn is None:
        return gyro
    ranked = sorted(gyro.choices, key=lambda one: abs(float(wrap_pi(one[0] - turn - alone.azimuth))))
    away = [abs(float(wrap_pi(azimuth - turn - alone.azimuth))) for azimuth, _ in ranked]
    if away[0] > _NEAR or min(away[1:]) < _FAR:
        return gyro
    return dataclasses.replace(gyro, reason=None, azimuth=ranked[0][0], sigma=ranked[0][1], choices=())


def _from_true(magnetic: Station) -> float | None:
    """What to take off an azimuth from true north for one from the station's, rad; None where that is not known."""
    reference = magnetic.reference
    if magnetic.north == "grid":
        return reference.convergence if reference is not None else None
    if magnetic.north == "magnetic":
        return reference.declination if reference is not None else None
    return 0.0


def _could_witness(gyro: Solution, settings: azimuth_fusion.Settings | None) -> bool:
    """Whether a second position, or time, is all the gyro lacks to judge the azimuth, and the settings care."""
    strict = azimuth_fusion.Settings() if settings is None else settings
    return (
        strict.unwitnessed == DOUBTFUL
        and gyro.reason is not None
        and gyro.reason.code in _ANOTHER_POSITION_LIFTS
        and gyro.limit <= math.radians(strict.alone_deg)
    )


def _declination_once(together: Station, aided: float) -> Station:
    """
    The station with the sigma of a multi-station azimuth that follows the gyro.

    So far as it does, it follows true north: the declination that led from there to magnetic north leads back again.
    The analysis has its error in the gyro's part, the station once more: twice the share too much.
    """
    declination, azimuths = declination_sigma(together), []
    for one in together.azimuths:
        if one.method == MSA and math.isfinite(one.sigma):
            own = one.sigma**2 - 2.0 * aided * declination**2
            one = dataclasses.replace(one, sigma=math.sqrt(max(own, ((1.0 - aided) * declination) ** 2, 1e-12)))
        azimuths.append(one)
    return dataclasses.replace(together, azimuths=tuple(azimuths))


def _magnetic(alone: Station, together: Station, aided: float) -> tuple[list[azimuth_fusion.Candidate], dict[str, str]]:
    """The magnetic azimuths as candidates, and why some of them must not be used."""
    declination = declination_sigma(together)
    candidates, reasons = [], {}
    for one in together.azimuths:
        if one.method == MSA:
            judged, refused, shared = together, one.refused, (1.0 - aided) * declination
        else:
            judged, refused, shared = alone, _not_chosen(one, alone), declination
        reasons[one.method] = refused
        candidates.append(
            azimuth_fusion.Candidate(
                _RANKED.get(one.method, one.method),
                one.azimuth,
                one.sigma,
                shared={"declination": min(shared, one.sigma)} if math.isfinite(one.sigma) else {},
                doubt="" if judged.verdict == ACCEPT else "; ".join(judged.azimuth_doubts or judged.reasons),
                refused=refused,
            )
        )
    return candidates, reasons


def _carried_by(
    base: Station, result: azimuth_fusion.Fused, weights: Mapping[str, float], doubt: str, other: bool, doubted: bool
) -> Station:
    """
    The station with the weighed azimuth as its own.

    doubt: makes it doubtful. other: an azimuth carries it that owes nothing to the magnetometer. doubted: as `fused`.
    """
    verdict, reasons = base.verdict, base.reasons
    only_magnetic = bool(base.azimuth_doubts) and reasons[0] in base.azimuth_doubts and not doubted
    if other and only_magnetic:
        verdict = ACCEPT
        reasons = tuple(text.replace(NO_AZIMUTH, _BY_GYRO_ALONE) for text in reasons)
    if doubt:
        verdict, reasons = worse(verdict, DOUBTFUL), (doubt, *reasons)
    base = dataclasses.replace(base, verdict=verdict, reasons=reasons)
    if not math.isfinite(result.azimuth):
        return base
    carrying = [name for name, weight in weights.items() if weight > 0.0]
    covariance = base.covariance.copy()
    # What ties the magnetic azimuth to inclination and toolface is kept by its share.
    share = sum(weight for name, weight in weights.items() if name != GYRO)
    covariance[1, :] *= share
    covariance[:, 1] *= share
    covariance[1, 1] = min(result.sigma**2 + base.alignment[1, 1], math.pi**2)
    before = base.azimuth if math.isfinite(base.azimuth) else result.azimuth
    turned = float(wrap_pi(result.azimuth - before))
    # Without a magnetic one it follows from the azimuth that there is.
    toolface = float(magnetic_toolface(mat_nt(base.inclination, result.azimuth, base.gravity_toolface)))
    if math.isfinite(base.magnetic_toolface):
        toolface = float(wrap_tau(base.magnetic_toolface + turned))
    return dataclasses.replace(
        base,
        azimuth=result.azimuth,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        magnetic_toolface=toolface,
        method=carrying[0] if len(carrying) == 1 else "fused",
        covariance=covariance,
    )


def declination_sigma(station_: Station) -> float:
    """1 sigma of the declination in azimuths from the station's north, rad."""
    reference = station_.reference
    if reference is None or station_.north == "magnetic":
        return 0.0
    return math.sqrt(reference.declination_variance(_horizontal(reference)))


def _not_chosen(one: MethodAzimuth, magnetic: Station) -> str:
    if one.method == magnetic.method:
        return ""
    return one.refused or f"the {magnetic.method} azimuth of the same reading is used"


def gyro_for_run(station_: Station, gyro: Solution) -> tuple[float, float, float]:
    """
    A gyro's azimuth as `StationRun.heard` takes it.

    White noise errs at each station anew. All else (bias, sensitivity to gravity, scale) is taken to err alike at all,
    and so is the declination that leads from true to magnetic north.
    """
    reference = station_.reference
    if reference is None or reference.declination is None:
        return math.nan, math.nan, 0.0
    declination = math.sqrt(reference.declination_variance(_horizontal(reference)))
    noise = min(gyro.limit, gyro.sigma)
    lasting = math.hypot(math.sqrt(gyro.sigma**2 - noise**2), declination)
    return float(wrap_tau(gyro.azimuth - reference.declination)), noise, lasting


def _horizontal(reference: Reference) -> float:
    return reference.horizontal if reference.has_field else 1e-5


def _gyro_azimuth(gyro: Solution, magnetic: Station) -> tuple[MethodAzimuth, dict[str, float]]:
    """The gyro's azimuth from the station's north, and the terms it shares with the magnetic ones."""
    refused = "" if gyro.reason is None else reason_text.text(gyro.reason)
    if not math.isfinite(gyro.azimuth):
        return MethodAzimuth(GYRO, math.nan, math.nan, refused), {}
    reference, variance, turn = magnetic.reference, 0.0, _from_true(magnetic)
    if magnetic.north == "magnetic" and turn is not None and reference is not None:
        variance = reference.declination_variance(_horizontal(reference))
    if turn is None:
        why = f"the gyro finds true north and what {magnetic.north} north is from there is not known"
        return MethodAzimuth(GYRO, math.nan, math.nan, why), {}
    sigma = min(math.hypot(gyro.sigma, math.sqrt(variance)), math.pi)
    shared = {"declination": -min(math.sqrt(variance), sigma)} if variance else {}
    return MethodAzimuth(GYRO, float(wrap_tau(gyro.azimuth - turn)), sigma, refused), shared
