# SPDX-License-Identifier: Apache-2.0
"""
Sensor faults during the averaging interval of a survey.

A survey is rejected if one of its sensors was faulty during its interval; the reason names the fault. Readings of a
failed magnetometer are not used, and a survey whose azimuth comes from the gyro does not depend on the magnetometer.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, MAG, SENSORS, FaultCode, FaultUnit, SensorFault
from mwd_estimation.core.verdicts import DOUBTFUL, REJECT
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.verdict import with_faults
from mwd_sensors.core.arrays import Stamps

# Codes of faults that put no wrong values into the estimate before they are found.
_HARMLESS = (FaultCode.NEVER_CAME, FaultCode.SILENT, FaultCode.INVALID)
# Codes of faults whose beginning is known exactly.
_REPEATS = (FaultCode.STUCK, FaultCode.DEAD)
# A magnetometer that repeats its values did not contaminate the azimuth if it had been used in good condition for
# _SOUND_NS, ns, and was in doubt within _IN_TIME_NS, ns, after the fault began.
_SOUND_NS, _IN_TIME_NS = 10_000_000_000, 1_000_000_000
# Bits of the sensors from which a magnetic azimuth is computed.
AZIMUTH = ACCEL | MAG
# Longest time between the samples that cause a doubt and the beginning of the doubt, ns; and longest averaging interval
# that can be requested, ns.
_EVIDENCE_NS, _KEPT_NS = 3_000_000_000, 3_600_000_000_000


class Accusation(NamedTuple):
    """Evidence against the sensors that a survey uses."""

    verdict: str  #: DOUBTFUL or REJECT
    reasons: tuple[Reason, ...]
    inclination: bool  #: whether the evidence concerns inclination and toolface in addition to the azimuth

    def judge(self, survey: DecidedSurvey) -> DecidedSurvey:
        """Return the survey with the worse of its verdict and the verdict of the accusation, and with the reasons."""
        station = with_faults(survey.station, self.verdict, self.reasons, inclination=self.inclination)
        return dataclasses.replace(survey, station=station)


class FaultHistory:
    """Faults and doubts of the sensors, present and past, for surveys whose averaging interval contains them."""

    def __init__(self) -> None:
        self._known: dict[int, SensorFault] = {}
        # The intervals in which each sensor was in doubt: first and last stamp, in order.
        self._doubts: dict[int, list[tuple[int, int]]] = {}

    def note(self, change: SensorFault) -> None:
        """Record the beginning, change or end of a fault."""
        self._known[change.check] = change

    def doubt(self, stamps: Stamps, suspect: NDArray[np.uint8]) -> None:
        """
        Record doubts and keep them for `_KEPT_NS`; doubts at most `_EVIDENCE_NS` apart count as one.

        stamps: ns, shape (n,); suspect, shape (n,): bits of the sensors in doubt at each sample.
        """
        for s in range(3):
            hit = stamps[suspect >> s & 1 != 0]
            if not len(hit):
                continue
            times = self._doubts.get(s, [])
            for part in np.split(hit, np.flatnonzero(np.diff(hit) > _EVIDENCE_NS) + 1):
                first, last = int(part[0]), int(part[-1])
                if times and first - times[-1][1] <= _EVIDENCE_NS:
                    first = times.pop()[0]
                times.append((first, last))
            self._doubts[s] = [one for one in times if last - one[1] <= _KEPT_NS]

    def contaminates(self, changes: Iterable[SensorFault], fed_ns: int) -> bool:
        """
        Return whether the changes contain a fault due to which the azimuth has used wrong gravity, field or rates.

        fed_ns : stamp from which the field was used.
        """
        return any(
            not one.cleared_ns
            and one.unusable & (AZIMUTH | GYRO)
            and one.code not in _HARMLESS
            and not self._left_out_in_time(one, fed_ns)
            for one in changes
        )

    def _left_out_in_time(self, fault: SensorFault, fed_ns: int) -> bool:
        """
        Return whether a magnetometer, good before, was in doubt (and thus unused) soon after it began to repeat values.

        Soon means within `_IN_TIME_NS`; good means used for at least `_SOUND_NS` before. fed_ns: as in `contaminates`.
        """
        if fault.unusable != MAG or fault.code not in _REPEATS or fault.since_ns - fed_ns < _SOUND_NS:
            return False
        first, last = self._doubts.get(SENSORS.index("magnetometer"), [(0, 0)])[-1]
        return first - fault.since_ns < _IN_TIME_NS and last >= fault.since_ns

    def readable(self, still: StillAverage) -> StillAverage:
        """Return the average, without the magnetometer if it was faulty at a time after the average began."""
        faulty = any(one.unusable & MAG for one in self._lately(still.start_ns))
        return dataclasses.replace(still, mag=None) if faulty else still

    def _lately(self, begin: int) -> list[SensorFault]:
        return [one for one in self._known.values() if not one.cleared_ns or one.cleared_ns > begin]

    def judge(self, survey: DecidedSurvey) -> DecidedSurvey:
        """
        Return the survey, rejected if one of its sensors was faulty in its interval, or doubtful if one was in doubt.

        Doubts after the interval are ignored, because the cut of the samples into blocks decides which of them are
        already known.
        """
        against = self.against(survey, 0)
        return survey if against is None else against.judge(survey)

    def against(self, survey: DecidedSurvey, evidence_ns: int = _EVIDENCE_NS) -> Accusation | None:
        """
        Return the evidence so far against the sensors that a survey uses; None if there is none.

        evidence_ns: time after the end of the survey; doubts that begin in this time are used too.
        """
        rests_on, begin, end = _rests_on(survey), survey.average.start_ns, survey.end_ns
        by_gyro = rests_on == ACCEL
        faults = [(one.unusable, _reason(one, begin)) for one in self._lately(begin) if one.unusable & rests_on]
        # Use doubts that begin some time after the survey: a doubt begins up to some seconds after its cause.
        doubts = [
            (1 << s, Reason(Code.SENSOR_SUSPECT, names=(SENSORS[s],)))
            for s, times in sorted(self._doubts.items())
            if any(last >= begin and first <= end + evidence_ns for first, last in times)
            and not (by_gyro and 1 << s == MAG)
        ]
        # If the accelerometers of the two units have different axes, either may be wrong until the string turns.
        doubts += [
            (ACCEL, Reason(Code.SENSOR_FAULT, fault=one))
            for one in self._lately(begin)
            if one.unit == FaultUnit.EITHER and one.code == FaultCode.AXES and one.mappings[1]
        ]
        verdict, found = (REJECT, faults) if faults else (DOUBTFUL, doubts)
        return _accusation(verdict, found)

    @property
    def standing(self) -> tuple[SensorFault, ...]:
        """Present faults."""
        return tuple(one for one in self._known.values() if not one.cleared_ns)


def withdrawn(survey: DecidedSurvey, standing: Iterable[SensorFault]) -> DecidedSurvey:
    """
    Return a survey, rejected and marked as withdrawn if a present fault already existed in its interval.

    A survey that was already rejected for this fault stays unchanged. standing: present faults.
    """
    rests_on, begin, end = _rests_on(survey), survey.average.start_ns, survey.end_ns
    found = [
        (one.unusable, Reason(Code.SENSOR_FAULT, fault=one))
        for one in standing
        if one.unusable & rests_on and one.lasted_in(begin, end)
    ]
    known = {one.fault.check for one in survey.station.reasons if one.fault is not None}
    new = [(bits, reason) for bits, reason in found if reason.fault is not None and reason.fault.check not in known]
    against = _accusation(REJECT, new)
    if against is None:
        return survey
    return dataclasses.replace(against.judge(survey), withdrawn=True)


def _accusation(verdict: str, found: Sequence[tuple[int, Reason]]) -> Accusation | None:
    """Return the accusation from pairs of sensor bits and reason; None without pairs."""
    level = any(bits & ~MAG for bits, _ in found)
    return Accusation(verdict, tuple(reason for _, reason in found), level) if found else None


def _rests_on(survey: DecidedSurvey) -> int:
    """Return the bits of the sensors that a survey uses; an azimuth from the gyro alone uses no magnetometer."""
    magnetic = any(share > 0.0 for name, share in survey.weights.items() if name != AzimuthMethod.GYRO)
    by_gyro = survey.weights.get(AzimuthMethod.GYRO, 0.0) > 0.0 and not magnetic
    return ACCEL if by_gyro else AZIMUTH


def _reason(fault: SensorFault, begin: int) -> Reason:
    """Return the reason to reject a survey that began at this stamp, ns."""
    if fault.cleared_ns:
        until = 1e-9 * (fault.cleared_ns - begin)
        return Reason(Code.SENSOR_FAULT_ENDED, until, fault=dataclasses.replace(fault, cleared_ns=0))
    return Reason(Code.SENSOR_FAULT, fault=fault)
