"""
The azimuth of a station weighed from all its methods: raw or corrected, multi-station, gyro.

First the magnetic azimuths, which rest on one reading, then what they give against the gyro. What each stage gives is
an azimuth, its sigma, weights and reasons; the station carries them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import azimuth_fusion, gyro_evidence
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, worse
from mwd_estimation.survey.azimuth_fusion import Candidate, Fused, Settings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.gyro_evidence import declination_sigma
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_sensors.core.frames import magnetic_toolface, mat_nt, wrap_pi, wrap_tau

GYRO, MULTI_STATION = AzimuthMethod.GYRO, AzimuthMethod.MULTI_STATION


@dataclasses.dataclass(frozen=True)
class WeighedStation:
    """
    A station with its azimuths weighed.

    Attributes
    ----------
    station : Station
        With the weighed azimuth as its own.
    weights : dict of str to float
        Share of each method.
    reasons : dict of str to Reason or None
        Why a method has no weight.
    alarm : tuple of Reason or None
        How gyro and magnetic azimuth disagree; empty where they agree, None where they were not compared.
    left_open : float
        How far apart they are, rad, where the gyro is too uncertain to decide, else 0; part of the sigma.
    """

    station: Station
    weights: dict[str, float]
    reasons: dict[str, Reason | None]
    alarm: tuple[Reason, ...] | None = None
    left_open: float = 0.0


@dataclasses.dataclass(frozen=True)
class _Magnetic:
    """The magnetic azimuths of a station as candidates, and what their fusion gave."""

    group: list[Candidate]
    fused: Fused
    weights: dict[str, float]
    reasons: dict[str, Reason | None]


def weigh(
    alone: Station,
    together: Station,
    gyro: Solution | None,
    settings: Settings | None = None,
    *,
    last_alarm: tuple[Reason, ...] = (),
    aided: float = 0.0,
) -> WeighedStation:
    """
    Weigh the azimuths of a station: raw or corrected, multi-station, gyro.

    The magnetic ones first, by their full covariance: they are of one reading and share all that the most certain of
    them does not know, and the declination. What they give is then compared with the gyro, with which they share the
    declination at most. An azimuth whose field failed its check is compared, not averaged; a disagreement with the gyro
    makes the station doubtful at least. A station that nothing but its magnetic azimuth made doubtful is accepted where
    another azimuth carries it.

    Parameters
    ----------
    alone, together : Station
        By itself, and as the stations of the run correct it (the same where they don't).
    gyro : Solution or None
        North found by the gyro, or why there is none; None without a precision unit.
    settings : azimuth_fusion.Settings, optional
    last_alarm : tuple of Reason
        How gyro and magnetic azimuth disagreed at the last station at which they were compared.
    aided : float
        How far the multi-station azimuth follows what the gyro found at the stations before, as `Multistation.by_gyro`.
    """
    settings = Settings() if settings is None else settings
    aided = min(max(aided, 0.0), 1.0)
    together = _declination_once(together, aided)
    magnetic = _magnetic(alone, together, aided, settings)
    if gyro is None:
        carried = _carried_by(together, magnetic.fused, magnetic.weights, (), by_gyro=False)
        return WeighedStation(carried, magnetic.weights, magnetic.reasons)
    found, shared = gyro_evidence.gyro_azimuth(gyro, together)
    base = dataclasses.replace(together, azimuths=(*together.azimuths, found))
    if found.refused is not None:
        could = gyro_evidence.could_confirm(gyro, settings)
        doubt, remark = gyro_evidence.unconfirmed(found.refused, last_alarm, could)
        doubts = (doubt,) if doubt is not None else ()
        base = _carried_by(base, magnetic.fused, magnetic.weights, doubts, by_gyro=False)
        if remark is not None:
            base = dataclasses.replace(base, reasons=(*base.reasons, remark))
        return WeighedStation(base, {**magnetic.weights, GYRO: 0.0}, {**magnetic.reasons, GYRO: found.refused})
    if last_alarm:
        # External interference has been found in this run: no magnetic azimuth outlasts the gyro by its sigma.
        settings = dataclasses.replace(settings, external_sigmas=settings.disagreement_sigmas)
    field = _field_candidate(together, magnetic, gyro, shared, found, aided)
    return _against_gyro(base, magnetic, field, gyro_evidence.candidate(found, shared), settings, last_alarm)


def _magnetic(alone: Station, together: Station, aided: float, settings: Settings) -> _Magnetic:
    declination = declination_sigma(together)
    group: list[Candidate] = []
    reasons: dict[str, Reason | None] = {}
    for one in together.azimuths:
        if one.method == MULTI_STATION:
            judged, refused, shared = together, one.refused, (1.0 - aided) * declination
        else:
            judged, refused, shared = alone, _not_chosen(one, alone), declination
        reasons[one.method] = refused
        group.append(
            Candidate(
                one.method,
                one.azimuth,
                one.sigma,
                shared={"declination": min(shared, one.sigma)} if math.isfinite(one.sigma) else {},
                doubt=() if judged.verdict == ACCEPT else judged.azimuth_doubts or judged.reasons,
                refused=refused,
            )
        )
    fused = azimuth_fusion.fuse(azimuth_fusion.same_sensors(group), settings)
    names = [one.method for one in together.azimuths]
    weights = {str(name): weight for name, weight in zip(names, fused.weights, strict=True)}
    reasons = {name: own or left_out for (name, own), left_out in zip(reasons.items(), fused.reasons, strict=True)}
    return _Magnetic(group, fused, weights, reasons)


def _not_chosen(one: MethodAzimuth, station: Station) -> Reason | None:
    if one.method == station.method:
        return None
    return one.refused or Reason(Code.AZIMUTH_NOT_CHOSEN, names=(station.method,))


def _declination_once(together: Station, aided: float) -> Station:
    """
    The station with the sigma of a multi-station azimuth that follows the gyro.

    So far as it does, it follows true north: the declination that led from there to magnetic north leads back again.
    The analysis has its error in the gyro's part, the station once more: twice the share too much.
    """
    declination, azimuths = declination_sigma(together), []
    for one in together.azimuths:
        if one.method == MULTI_STATION and math.isfinite(one.sigma):
            own = one.sigma**2 - 2.0 * aided * declination**2
            one = dataclasses.replace(one, sigma=math.sqrt(max(own, ((1.0 - aided) * declination) ** 2, 1e-12)))
        azimuths.append(one)
    return dataclasses.replace(together, azimuths=tuple(azimuths))


def _field_candidate(
    together: Station,
    magnetic: _Magnetic,
    gyro: Solution,
    shared: dict[str, float],
    found: MethodAzimuth,
    aided: float,
) -> Candidate:
    """What the magnetic azimuths give, against the gyro; `shared`, the gyro's terms, gets what both have in common."""
    fused, weights = magnetic.fused, magnetic.weights
    sound = all(not magnetic.group[k].doubt for k, one in enumerate(together.azimuths) if weights[one.method] > 0.0)
    in_both: dict[str, float] = {}
    if math.isfinite(fused.sigma):
        follows = weights.get(MULTI_STATION, 0.0) * aided
        in_both["declination"] = min((1.0 - follows) * declination_sigma(together), fused.sigma)
        if follows:
            rest, left = (
                math.sqrt(max(sigma**2 - sum(v * v for v in terms.values()), 0.0))
                for sigma, terms in ((fused.sigma, in_both), (found.sigma, shared))
            )
            lasting = gyro_evidence.lasting_sigma(gyro)
            in_both["gyro"], shared["gyro"] = min(follows * lasting, rest), min(lasting, left)
    return Candidate(
        fused.method if fused.method != AzimuthMethod.FUSED else azimuth_fusion.MAGNETIC,
        fused.azimuth,
        fused.sigma,
        shared=in_both,
        doubt=() if sound else next(one.doubt for one in magnetic.group if one.doubt),
    )


def _against_gyro(
    base: Station,
    magnetic: _Magnetic,
    field: Candidate,
    gyro: Candidate,
    settings: Settings,
    last_alarm: tuple[Reason, ...],
) -> WeighedStation:
    """The station by what its magnetic azimuths give and the gyro's azimuth together."""
    both = azimuth_fusion.fuse([field, gyro], settings)
    share = both.weights[0]
    reasons = {
        name: reason or (both.reasons[0] if magnetic.weights[name] > 0.0 and share == 0.0 else None)
        for name, reason in magnetic.reasons.items()
    }
    weights = {name: weight * share for name, weight in magnetic.weights.items()}
    weights[GYRO], reasons[GYRO] = both.weights[1], both.reasons[1]
    compared = math.isfinite(field.azimuth) and math.isfinite(gyro.azimuth)
    open_, apart = gyro_evidence.left_open(field, gyro, both, settings), 0.0
    if open_ is not None and compared:
        # Nothing decides which is right: the other may be.
        apart = abs(float(wrap_pi(gyro.azimuth - both.azimuth)))
        both = dataclasses.replace(both, sigma=min(math.hypot(both.sigma, apart), math.pi))
    doubts = both.alarm or ((open_,) if open_ is not None else ())
    most = math.radians(settings.alone_deg)
    if not doubts and compared and gyro.sigma > most and last_alarm:
        coarse = Reason(Code.GYRO_TOO_UNCERTAIN, gyro.sigma, most)
        doubt, _ = gyro_evidence.unconfirmed(coarse, last_alarm)
        doubts = (doubt,) if doubt is not None else ()
    station = _carried_by(base, both, weights, doubts, by_gyro=weights[GYRO] > 0.0)
    return WeighedStation(station, weights, reasons, both.alarm if compared else None, apart)


def _carried_by(
    base: Station, result: Fused, weights: Mapping[str, float], doubts: tuple[Reason, ...], *, by_gyro: bool
) -> Station:
    """
    The station with the weighed azimuth as its own.

    doubts: make it doubtful. by_gyro: an azimuth carries it that owes nothing to the magnetometer.
    """
    verdict, reasons = base.verdict, base.reasons
    if by_gyro and base.azimuth_doubts and reasons[0] in base.azimuth_doubts:
        # Nothing but the magnetic azimuth was in doubt.
        verdict = ACCEPT
        reasons = tuple(_by_gyro_only(one) for one in reasons)
    if doubts:
        verdict, reasons = worse(verdict, DOUBTFUL), (*doubts, *reasons)
    base = dataclasses.replace(base, verdict=verdict, reasons=reasons)
    if not math.isfinite(result.azimuth):
        return base
    carrying = [AzimuthMethod(name) for name, weight in weights.items() if weight > 0.0]
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
        method=carrying[0] if len(carrying) == 1 else AzimuthMethod.FUSED,
        covariance=covariance,
    )


def _by_gyro_only(reason: Reason) -> Reason:
    if reason.code != Code.INCLINATION_ONLY:
        return reason
    return dataclasses.replace(reason, code=Code.AZIMUTH_BY_GYRO_ONLY)
