"""
What remains of the estimate while a sensor is faulty: gravity without the faulty one, or none, never a wrong one.

Without usable gyros gravity is the direction of the accelerometer alone, with a sigma by its own unrest; without a
usable accelerometer there is none. When the fault has gone the method starts anew: what it carried is not to be
trusted. A survey averaged over a fault is rejected by name; a failed magnetometer is no reading, and one whose azimuth
the gyro gives does not hang on it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.samples import Track
from mwd_estimation.core.status import Status
from mwd_estimation.gravity import accelerometer_only
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.health.fault_debounce import ACCEL, GYRO, MAG, SENSORS
from mwd_estimation.health.fault_messages import ENDED, Finding
from mwd_estimation.survey.acceptance import DOUBTFUL, REJECT, worse
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.survey import GYRO as GYRO_AZIMUTH
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Array, Stamps

# Kinds of fault that fed no wrong value to the estimate before they were named.
_HARMLESS = ("absent", "invalid")
# Kinds whose evidence shows from when on the values were wrong.
_REPEATS = ("stuck", "dead")
# Such a magnetometer did no harm where the azimuth had had a sound one for so long, ns, and it was in doubt so soon.
_SOUND_NS, _IN_TIME_NS = 10_000_000_000, 1_000_000_000
# Bits of the sensors that an azimuth rests on.
AZIMUTH = ACCEL | MAG
# A doubt rests on what was felt so long before, ns.
_EVIDENCE_NS = 3_000_000_000


class GuardedGravity:
    """
    A gravity method that leaves faulty sensors out.

    Parameters
    ----------
    method : Method
    params : its Params
    accelerometer_only_params : Params of what remains while the gyros are faulty
    """

    def __init__(
        self, method: gravity.Method, params: Any, accelerometer_only_params: accelerometer_only.Params
    ) -> None:
        self._method, self._params = method, params
        self._state = method.initial(params)
        self._raw = accelerometer_only_params
        self._raw_state = accelerometer_only.initial(self._raw)
        self._bits = 0

    def run(self, bits: int, stamps: Stamps, gyro: Array, accel: Array, followed: Track | None = None) -> Track:
        """
        Gravity of samples during which the same sensors are unusable.

        bits : of `health_evidence`; followed : gravity found otherwise, used where all sensors are well.
        """
        unusable, before = bits & (GYRO | ACCEL), self._bits
        self._bits = unusable
        if unusable & ACCEL:
            return _unknown(len(stamps))
        if unusable & GYRO:
            if before != unusable:
                self._raw_state = accelerometer_only.initial(self._raw)
            return accelerometer_only.run(self._raw, self._raw_state, stamps, np.zeros_like(gyro), accel)
        if before:
            self._state = self._method.initial(self._params)
        if followed is not None:
            return followed
        found: Track = self._method.run(self._params, self._state, stamps, gyro, accel)
        return found


def _unknown(n: int) -> Track:
    track = Track.empty(n)
    track.g_t[:] = np.nan
    track.sigma_inclination[:] = track.sigma_toolface[:] = np.pi
    track.non_gravity[:] = track.rotary_speed[:] = 0.0
    track.status[:] = int(Status.INITIALISING)
    return track


def without_faulty(bits: int, gyro: Array) -> Array:
    """Rates for what follows gravity: not a number where the gyros are unusable."""
    return np.full_like(gyro, np.nan) if bits & GYRO else gyro


class Record:
    """Faults and doubts that stand and those that went lately, for surveys whose average reaches back into them."""

    def __init__(self) -> None:
        self._known: dict[int, Finding] = {}
        # Of each sensor: the stamps from which and up to which it was in doubt last.
        self._doubts: dict[int, tuple[int, int]] = {}

    def note(self, change: Finding) -> None:
        """Take a change."""
        self._known[change.check] = change

    def doubt(self, stamps: Stamps, suspect: NDArray[np.uint8]) -> None:
        """Take which sensors are in doubt at these samples."""
        for s in range(3):
            hit = stamps[suspect >> s & 1 != 0]
            if len(hit):
                first, last = self._doubts.get(s, (0, -_EVIDENCE_NS))
                goes_on = hit[0] - last <= _EVIDENCE_NS
                self._doubts[s] = first if goes_on else int(hit[0]), int(hit[-1])

    def misleads(self, changes: Iterable[Finding], fed_ns: int) -> bool:
        """
        Whether a fault was named that has fed wrong values of gravity or field to the azimuth up to now.

        fed_ns : stamp from which on the field was taken in.
        """
        return any(
            not one.cleared_ns
            and one.unusable & AZIMUTH
            and one.kind not in _HARMLESS
            and not self._left_out_in_time(one, fed_ns)
            for one in changes
        )

    def _left_out_in_time(self, fault: Finding, fed_ns: int) -> bool:
        """Whether a magnetometer that had been sound was in doubt, and so left out, as soon as it repeated itself."""
        if fault.unusable != MAG or fault.kind not in _REPEATS or fault.since_ns - fed_ns < _SOUND_NS:
            return False
        first, last = self._doubts.get(SENSORS.index("magnetometer"), (0, 0))
        return first - fault.since_ns < _IN_TIME_NS and last >= fault.since_ns

    def readable(self, still: StillAverage) -> StillAverage:
        """The average without the magnetometer where that was faulty in its time: it is no reading."""
        faulty = any(one.unusable & MAG for one in self._lately(still.start_ns))
        return dataclasses.replace(still, mag=None) if faulty else still

    def _lately(self, begin: int) -> list[Finding]:
        return [one for one in self._known.values() if not one.cleared_ns or one.cleared_ns > begin]

    def judge(self, survey: Survey) -> Survey:
        """The survey, rejected with the reason where a sensor it rests on was faulty in its time, doubtful with it."""
        magnetic = any(share > 0.0 for name, share in survey.weights.items() if name != GYRO_AZIMUTH)
        by_gyro = survey.weights.get(GYRO_AZIMUTH, 0.0) > 0.0 and not magnetic
        rests_on = AZIMUTH & ~MAG if by_gyro else AZIMUTH
        half = round(0.5e9 * survey.duration)
        begin, end = survey.stamp_ns - half, survey.stamp_ns + half
        reasons = tuple(_reason(one, begin) for one in self._lately(begin) if one.unusable & rests_on)
        if reasons:
            return _with(survey, REJECT, reasons)
        # A doubt begins some seconds after what raised it.
        doubts = tuple(
            f"something spoke against the {SENSORS[s]} while this was averaged: take it again"
            for s, (first, last) in sorted(self._doubts.items())
            if last >= begin and first <= end + _EVIDENCE_NS and not (by_gyro and 1 << s == MAG)
        )
        return _with(survey, worse(survey.station.verdict, DOUBTFUL), doubts) if doubts else survey


def _reason(fault: Finding, begin: int) -> str:
    """Why a survey that began at this stamp, ns, is not to be used."""
    if fault.cleared_ns:
        until = f"until {1e-9 * (fault.cleared_ns - begin):.1f} s after this survey began"
        return f"{fault.message.removesuffix(ENDED)}, {until}: take it again"
    return f"{fault.message}; {fault.remedy}" if fault.remedy else fault.message


def _with(survey: Survey, verdict: str, reasons: tuple[str, ...]) -> Survey:
    station = dataclasses.replace(
        survey.station, verdict=verdict, reasons=(*reasons, *survey.station.reasons), azimuth_doubts=()
    )
    return dataclasses.replace(survey, station=station)
