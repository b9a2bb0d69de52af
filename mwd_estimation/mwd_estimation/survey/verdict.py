# SPDX-License-Identifier: Apache-2.0
"""
Verdict of a station, computed in this order: posterior, sigma, limits, verdicts, main reason.

Each quantity has its own verdict. The verdict on the inclination follows from gravity. The verdict on the azimuth
follows from its posterior: the probability of a large error, other azimuths that fit, and the most probable
disturbance. The values and limits of the totals (`totals`) are listed after the reasons, for information.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import STORM, Reference
from mwd_estimation.core.verdicts import ACCEPT, DOUBTFUL, NOT_DETERMINED, REJECT, worse
from mwd_estimation.survey import totals
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import NEAR_VERTICAL, Measured, StationReadings
from mwd_estimation.survey.posterior.circle import Circle
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.station_record import Station, Verdicts
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.frames import magnetic_toolface, mat_nt

# Probability of a disturbance or of a wrong gyro above which the azimuth is doubtful.
_DISTURBED = 0.5
# Disturbances that change the direction of the field across the tool axis, so that the magnetic toolface is wrong too.
_ACROSS = (Hypothesis.CROSS_AXIAL, Hypothesis.EXTERNAL, Hypothesis.SENSOR)
# An attitude determines the azimuth if `QualitySettings.far_deg` is at least this many sigma of a healthy tool.
_DETERMINED = 6.0
# Largest error of the direction of the hole, rad, from an azimuth that is not determined: sigma of the azimuth, and at
# least `QualitySettings.far_deg`, times the sine of the inclination. Near the vertical the error is smaller, and the
# station is accepted for its inclination. A larger error has its cause in the field, for example near a magnetic pole.
_DIRECTION = math.radians(3.0)
# Largest 1 sigma, rad, that accelerometers turned in their mount may add to an inclination that is not doubtful.
_TURNED = math.radians(0.3)
# Chi-square, with three degrees of freedom, above which no disturbance explains the field; by chance once in 10 000.
_UNEXPLAINED = 21.1
# 1 sigma of the gravity toolface, rad, above which (near the vertical) it is not determined.
_HIGH_SIDE = math.radians(3.0)
# Smallest correction of sag that is mentioned, rad.
_LEAST_SAG = math.radians(0.005)
# Smallest field that may be the Earth's, even with a disturbance, T.
_NO_READING = 3e-6
# Smallest probability of a hypothesis that is mentioned.
_NAMED = 0.02


class _Findings:
    """Verdict on one quantity so far, with its reasons."""

    def __init__(self) -> None:
        self.verdict = ACCEPT
        self.reasons: list[tuple[str, Reason]] = []

    def add(self, verdict: str, *reasons: Reason) -> None:
        for reason in reasons:
            self.verdict = worse(self.verdict, verdict)
            self.reasons.append((verdict, reason))


def judged(
    measured: Measured, finding: Finding | None, settings: StationSettings, faults: tuple[Reason, ...] = ()
) -> Station:
    """
    Return the station with its azimuth and verdicts.

    Parameters
    ----------
    finding : Finding or None
        Finding of the run; None if no sensor measures the azimuth.
    faults : tuple of Reason
        Faults of the readings; each rejects the station.
    """
    readings, station = measured.readings, measured.station
    if readings is None:
        return replace(station, reasons=(*station.reasons, *faults, *_of_external_field(station.reference)))
    # The posterior: azimuth and sigma of its chief mode.
    if finding is not None:
        station = _as_found(station, finding)
    # Totals with their limits of deviation.
    station = _against_limits(station, readings, settings)
    # The verdicts.
    level = _of_inclination(station, finding, settings)
    azimuth = _of_azimuth(station, measured, readings, finding, settings)
    # A dip with the wrong sign may come from flipped accelerometers as well as from flipped magnetometers, so doubt the
    # inclination too, unless a slip of the reference explains the dip.
    codes = {reason.code for _, reason in azimuth.reasons}
    if Code.REFERENCE_SLIP not in codes:
        level.add(DOUBTFUL, *(reason for _, reason in azimuth.reasons if reason.code is Code.DIP_SIGN))
    if finding is not None and azimuth.verdict != ACCEPT:
        station = _widened(station, finding.circle)
    for quantity in (level, azimuth):
        quantity.add(REJECT, *faults)
    # The main reason first, then the others.
    return _finished(station, readings, level, azimuth, finding, settings)


def _as_found(station: Station, finding: Finding) -> Station:
    """Return the station with the azimuth of its posterior, and the inclination error of a turned mount."""
    found = finding.circle
    covariance = station.covariance.copy()
    covariance[0, 0] += finding.mount**2
    own = math.hypot(found.sigma, math.sqrt(float(station.alignment[1, 1])))
    # Keep the measured covariance between azimuth and the other angles, scaled down if the new sigma is smaller.
    tied = min(own / math.sqrt(covariance[1, 1]), 1.0) if covariance[1, 1] > 0.0 else 0.0
    covariance[1, :] *= tied
    covariance[:, 1] *= tied
    covariance[1, 1] = min(own, math.pi) ** 2
    magnetic = bool(finding.hypotheses)
    toolface = float(magnetic_toolface(mat_nt(station.inclination, found.mean, station.gravity_toolface)))
    return replace(
        station,
        azimuth=found.mean,
        sigma_azimuth=math.sqrt(covariance[1, 1]),
        sigma_inclination=math.sqrt(covariance[0, 0]),
        magnetic_toolface=toolface,
        covariance=covariance,
        method=AzimuthMethod.FUSED if magnetic else AzimuthMethod.GYRO,
        corrected=magnetic,
        interference=finding.axial[0],
        sigma_interference=finding.axial[1],
        alternatives=found.alternatives,
        hypotheses=tuple((str(name), odds) for name, odds in finding.hypotheses.items()),
    )


def _against_limits(station: Station, readings: StationReadings, settings: StationSettings) -> Station:
    """Return the station with the deviations of its totals from the reference, and their limits."""
    # Near the vertical the field of the string does not turn the azimuth: use the totals of the readings.
    upright = math.sin(readings.inclination) < math.sin(NEAR_VERTICAL)
    taken_off = station.interference if station.corrected and not upright else 0.0
    apart = totals.deviations(
        readings.f_h, readings.b_h, station.reference, readings.covariance, settings.errors, taken_off,
        readings.has_field,
    )  # fmt: skip
    gravity, field, dip = totals.bounds(apart, settings.quality).tolist()
    return replace(station, deviations=apart, limits=(gravity, field, dip))


def _widened(station: Station, found: Circle) -> Station:
    """Return a doubtful station with the standard deviation of the whole main mode as the sigma of its azimuth."""
    covariance = station.covariance.copy()
    covariance[1, 1] = min(math.hypot(found.spread, math.sqrt(float(station.alignment[1, 1]))), math.pi) ** 2
    return replace(station, covariance=covariance, sigma_azimuth=math.sqrt(covariance[1, 1]))


def _of_inclination(station: Station, finding: Finding | None, settings: StationSettings) -> _Findings:
    """Return the verdict on the inclination, from gravity and from the possible turn of the accelerometers."""
    level, apart = _Findings(), station.deviations
    level.add(REJECT, *totals.gravity_faults(station.g_total))
    gravity = replace(apart, field=math.nan, dip=math.nan)
    judgement = totals.judge(gravity, settings.quality)
    level.add(judgement.verdict, *judgement.reasons)
    if finding is not None and finding.mount > _TURNED:
        level.add(DOUBTFUL, Reason(Code.MOUNT_MAY_BE_TURNED, finding.mount))
    return level


def _of_azimuth(
    station: Station, measured: Measured, readings: StationReadings, finding: Finding | None, settings: StationSettings
) -> _Findings:
    """Return the verdict on the azimuth, from field, reference and posterior."""
    azimuth = _Findings()
    azimuth.add(DOUBTFUL, *measured.reasons)
    if readings.has_field:
        b_earth = readings.b_h - np.array([station.interference if station.corrected else 0.0, 0.0, 0.0])
        # Use the uncorrected field if it is too small: a reading in another unit, minus a large interference estimate,
        # might look like the Earth's field.
        total = readings.b_total if readings.b_total < _NO_READING else float(np.linalg.norm(b_earth))
        azimuth.add(REJECT, *totals.field_faults(total, station.dip, station.reference))
        azimuth.add(DOUBTFUL, *_of_slip(station, readings))
    if not readings.has_field and (finding is None or finding.by_gyro == 0.0):
        what = Code.NO_HORIZONTAL_FIELD if np.isfinite(readings.b_t).all() else Code.NO_MAGNETOMETER
        azimuth.add(REJECT, Reason(Code.INCLINATION_ONLY, causes=(Reason(what),)))
    elif finding is None:
        azimuth.add(DOUBTFUL, Reason(Code.NO_REFERENCE_FIELD, names=(station.north,)))
    else:
        if finding.hypotheses:
            _judge_field(azimuth, station, finding, settings)
        if finding.repeats is not None:
            azimuth.add(DOUBTFUL, Reason(Code.READINGS_REPEATED, float(finding.repeats)))
        _judge_posterior(azimuth, station, finding, settings)
    return azimuth


def _of_slip(station: Station, readings: StationReadings) -> list[Reason]:
    """Return a reason if the readings show a slip (a mistake in the entered reference); empty if not."""
    reference, covariance = station.reference, station.deviations.covariance
    if reference is None or not np.isfinite(covariance).all():
        return []
    slip = totals.reference_slip(readings.f_h, readings.b_h, reference, covariance)
    if slip is None:
        return []
    total = float(np.linalg.norm(readings.b_h))
    return [Reason(Code.REFERENCE_SLIP, values=(total, station.dip), names=(slip.words,))]


def _judge_posterior(azimuth: _Findings, station: Station, finding: Finding, settings: StationSettings) -> None:
    """Add reasons if an azimuth error above the tolerance is too probable, or if sensors contradict each other."""
    far, quality, found = math.radians(settings.quality.far_deg), settings.quality, finding.circle
    alignment = math.sqrt(float(station.alignment[1, 1]))
    risk, sound = finding.beyond(far, alignment), math.hypot(finding.nominal, alignment)
    if risk > quality.far_probability and _DETERMINED * sound > far:
        # Even a healthy tool cannot determine the azimuth at this attitude, so the large sigma does not show a
        # disturbance. Judge the total field and the dip only if there is another reason against the azimuth, or if the
        # field across the tool is probably disturbed, so that the magnetic toolface is wrong too.
        across = sum(finding.hypotheses.get(kind, 0.0) for kind in _ACROSS)
        if azimuth.verdict != ACCEPT or across > _DISTURBED:
            _judge_totals(azimuth, station, settings)
        if azimuth.verdict == ACCEPT:
            error = max(min(station.sigma_azimuth, 1.0), far)
            if error * math.sin(station.inclination) < _DIRECTION:
                azimuth.verdict = NOT_DETERMINED
            else:
                azimuth.add(DOUBTFUL, Reason(Code.UNCERTAIN_FOR_ANY_TOOL, station.sigma_azimuth, sound))
        return
    if finding.broken is not None:
        azimuth.add(DOUBTFUL, Reason(Code.PROPAGATED_DISAGREES, finding.broken[0], values=(finding.broken[1],)))
    elif finding.gyro_wrong > _DISTURBED:
        azimuth.add(DOUBTFUL, Reason(Code.GYRO_DISAGREES, finding.gyro_wrong))
    if risk > quality.far_probability and found.alternatives:
        others = tuple(value for pair in found.alternatives for value in pair)
        azimuth.add(DOUBTFUL, Reason(Code.AZIMUTHS_FIT, found.mean, found.share, others))
    elif risk > quality.far_probability:
        azimuth.add(DOUBTFUL, _why_uncertain(finding, risk, far))


def _judge_field(azimuth: _Findings, station: Station, finding: Finding, settings: StationSettings) -> None:
    """Add the reasons from the field to doubt or reject the azimuth."""
    if finding.misfit > _UNEXPLAINED:
        azimuth.add(REJECT, Reason(Code.FIELD_UNEXPLAINED, finding.misfit, _UNEXPLAINED))
    odds = finding.hypotheses
    if odds[Hypothesis.EXTERNAL] > _DISTURBED and finding.by_gyro < _DISTURBED:
        azimuth.add(DOUBTFUL, Reason(Code.EXTERNAL_FIELD, odds[Hypothesis.EXTERNAL]))
    if odds[Hypothesis.PLACE] > _DISTURBED:
        azimuth.add(DOUBTFUL, Reason(Code.FIELD_OF_ANOTHER_PLACE, odds[Hypothesis.PLACE]))
    if odds[Hypothesis.SENSOR] > _DISTURBED:
        azimuth.add(DOUBTFUL, Reason(Code.SENSOR_DEFECT, odds[Hypothesis.SENSOR]))
    if settings.quality.limits != "toolcode":
        _judge_totals(azimuth, station, settings)


def _judge_totals(azimuth: _Findings, station: Station, settings: StationSettings) -> None:
    """Add the reasons from field and dip outside their limits."""
    judgement = totals.judge(replace(station.deviations, gravity=math.nan), settings.quality)
    azimuth.add(judgement.verdict, *judgement.reasons)


def _why_uncertain(finding: Finding, risk: float, far: float) -> Reason:
    """
    Return the reason for an uncertain azimuth; the reason depends on the most probable disturbance.

    risk: probability of an azimuth error above `far`, rad.
    """
    odds = {name: value for name, value in finding.hypotheses.items() if name is not Hypothesis.CLEAN}
    if not odds:
        return Reason(Code.GYRO_ONLY_UNCERTAIN, risk, far)
    first = max(odds, key=lambda name: odds[name])
    code = {
        Hypothesis.CROSS_AXIAL: Code.UNCERTAIN_COLLAR,
        Hypothesis.EXTERNAL: Code.UNCERTAIN_EXTERNAL,
        Hypothesis.REFERENCE: Code.UNCERTAIN_REFERENCE,
        Hypothesis.PLACE: Code.UNCERTAIN_REFERENCE,
        Hypothesis.SHIELDING: Code.UNCERTAIN_SENSOR,
        Hypothesis.SCALE: Code.UNCERTAIN_SENSOR,
        Hypothesis.SENSOR: Code.UNCERTAIN_SENSOR,
    }.get(first, Code.UNCERTAIN_STRING)
    return Reason(code, risk, far)


def _finished(
    station: Station,
    readings: StationReadings,
    level: _Findings,
    azimuth: _Findings,
    finding: Finding | None,
    settings: StationSettings,
) -> Station:
    """Return the station with its verdicts; wrong columns and a wrong reference, which cause the rest, come first."""
    upright = station.sigma_toolface > _HIGH_SIDE
    quantities = Verdicts(level.verdict, azimuth.verdict, NOT_DETERMINED if upright else level.verdict)
    verdict = level.verdict if azimuth.verdict == NOT_DETERMINED else worse(level.verdict, azimuth.verdict)
    causes = (Code.WIRING, Code.REFERENCE_SLIP, Code.DIP_SIGN, Code.FIELD_OF_ANOTHER_PLACE)
    order = {code: place for place, code in enumerate(causes)}
    made = sorted(
        [*level.reasons, *azimuth.reasons],
        key=lambda pair: (order.get(pair[1].code, len(causes)), pair[0] != REJECT),
    )
    reasons = list(dict.fromkeys(reason for _, reason in made))
    remarks: list[Reason] = []
    sag = station.inclination - readings.inclination
    if abs(sag) >= _LEAST_SAG:
        remarks.append(Reason(Code.SAG_CORRECTED, sag))
    if azimuth.verdict == NOT_DETERMINED:
        remarks.append(Reason(Code.AZIMUTH_NOT_DETERMINED, station.sigma_azimuth))
    if finding is not None and finding.hypotheses:
        named = sorted(finding.hypotheses.items(), key=lambda pair: -pair[1])
        likely = [(str(name), odds) for name, odds in named if odds >= _NAMED]
        names, values = tuple(name for name, _ in likely), tuple(odds for _, odds in likely)
        remarks.append(Reason(Code.HYPOTHESES, values=values, names=names))
    beside = totals.against_limits(station.deviations, settings.quality)
    remarks += [total for total in beside if total not in reasons]
    remarks += _of_external_field(station.reference)
    return replace(station, quantities=quantities, verdict=verdict, reasons=(*reasons, *remarks))


def _of_external_field(reference: Reference | None) -> list[Reason]:
    """Return the reasons that concern the external field, if the reference uses an observatory."""
    if reference is None or not reference.observatory:
        return []
    external, names = reference.external, (reference.observatory,)
    if external is None:
        return [Reason(Code.EXTERNAL_FIELD_UNKNOWN, names=names)]
    return [Reason(Code.MAGNETIC_STORM, external.strength, STORM, names=names)] if external.is_storm else []


def with_faults(station: Station, verdict: str, reasons: tuple[Reason, ...], *, inclination: bool) -> Station:
    """Return the station with verdict and reasons of sensor faults; inclination: whether they affect inclination."""
    of = station.verdicts
    quantities = Verdicts(
        worse(of.inclination, verdict) if inclination else of.inclination,
        worse(of.azimuth, verdict),
        worse(of.toolface, verdict) if inclination else of.toolface,
    )
    whole = worse(station.verdict, verdict)
    return replace(station, verdict=whole, quantities=quantities, reasons=(*reasons, *station.reasons))


def without_toolface(station: Station, rotary_speed: float) -> Station:
    """Return the station of a rotary survey: without toolface, with the rotary speed, rad/s, among its reasons."""
    covariance = station.covariance.copy()
    covariance[2, :] = covariance[:, 2] = math.nan
    return replace(
        station,
        gravity_toolface=math.nan,
        magnetic_toolface=math.nan,
        sigma_toolface=math.nan,
        covariance=covariance,
        quantities=replace(station.verdicts, toolface=NOT_DETERMINED),
        reasons=(*station.reasons, Reason(Code.STRING_ROTATED, abs(rotary_speed))),
    )
