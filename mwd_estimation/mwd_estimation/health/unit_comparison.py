# SPDX-License-Identifier: Apache-2.0
"""
Health of the precision unit, from its own samples and those of the conventional unit on the same tool.

Two units on one tool measure the same vectors; `axis_comparison` finds differences. Only a third sensor can show which
unit is wrong. At first a fault names both units. It names the precision unit alone if the axes differ and the tool has
moved for some seconds without an observation against the conventional unit. If gravity at rest shows that the
conventional gyros have drifted (`rest_check`), differences no longer count against the precision unit. With too little
motion the state of the precision unit stays unknown, except for a rate at rest that is much higher than the Earth's.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from mwd_estimation.core import input_gate
from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, FaultCode, FaultUnit, SensorFault
from mwd_estimation.health import fault_debounce, signal_checks
from mwd_estimation.health.axis_comparison import (
    AT_ONE_END,
    SUMS,
    WINDOW,
    axes_of,
    compare,
    interpolated,
    mapping_of,
)
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, observe, suspected, weigh
from mwd_estimation.health.signal_checks import BIN_NS, SignalLimits
from mwd_sensors.core.arrays import Array, Indices, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import EARTH_RATE
from mwd_sensors.core.records import dtype_of

# _MOVED_BINS: number of half seconds of motion after which the conventional unit would be doubtful if its axes were
# wrong. _REST_BINS: number of half seconds at rest before a rate is checked. _STEADY_BINS: number of half seconds in
# which a rate that is too high must be steady. _STEADY: largest variation of a steady rate, as a share of the rate.
# _SAMPLES: smallest number of samples in a half second for a mean rate.
_MOVED_BINS, _REST_BINS, _STEADY_BINS, _STEADY, _SAMPLES = 12, 4, 6, 1.0, 10
# A rate at rest is too high if it is above the sum of _BIASES times the bias sigma, twice the Earth rate, and _PULLED,
# rad/s. _PULLED is the rate of a string that is pulled steadily through a bend of 10 deg in 30 m at 1 m/s; all other
# sensors then show a tool at rest.
_BIASES, _PULLED = 40.0, math.radians(10.0 / 30.0)
# Number of half seconds without a difference after which an earlier difference is forgotten.
_FORGOTTEN_BINS = 120
# Bits of the mappings that leave x unchanged.
_ACROSS = sum(1 << k for k, m in enumerate(MAPPINGS) if m[0, 0] == 1)


class UnitState:
    """Results of the comparison of the two units that are kept from earlier half seconds."""

    most_at_rest: float  #: largest rate across the tool at rest of a healthy gyro, rad/s
    still: int  #: number of half seconds in a row at rest
    #: `resting`, `rested`: mean rates across the tool in the last half seconds at rest, rad/s, newest last, and number
    #: of these half seconds.
    resting: Annotated[Array, _STEADY_BINS, 2]
    rested: int
    #: Bit of the mapping found for the axes of the gyro and of the accelerometer; 0 if the axes are right.
    wrong: Annotated[Indices, 2]
    differ: int  #: number of half seconds in motion since the axes of a sensor became wrong
    agree: Annotated[
        Indices, 2
    ]  #: number of half seconds since gyro and accelerometer last differed from the other unit


UNIT_STATE = dtype_of(UnitState)


class UnitRecords(NamedTuple):
    """Records of one precision unit."""

    checks: Any  #: checks of `fault_debounce`
    channels: Any  #: channels of `signal_checks`; the third sensor is the accelerometer of the conventional unit
    sums: Any  #: sums of dtype SUMS, shape (WINDOW, 6), newest half second last
    state: Any  #: record of dtype UNIT_STATE
    refused: Any  #: readings refused by the gate, dtype of `input_gate.REFUSED`


@compiled
def _judge_samples(unit: UnitRecords, limits: signal_checks.SignalLimits, began: int, still: bool) -> int:
    """
    Check the samples of the precision unit without comparison; return the bits of doubtful sensors.

    still: whether the tool is at rest.
    """
    checks, channels = unit.checks, unit.channels
    signal_checks.summarise(channels)
    doubtful: int = signal_checks.judge_bin(limits, checks, channels, np.full(3, math.inf), began)
    # Ignore the third sensor: it is the conventional accelerometer, which `monitor` checks.
    for code in range(len(checks)):
        for place in range(6, 9):
            checks[code, place].seen = NOTHING
    constant = 0
    for k in range(3):
        constant += int(channels[k].constant_bins > 0)
    for k in range(3):
        if not still and constant < 3 and channels[k].constant_bins > 0:
            # An x gyro at the end of its range is constant too, so it counts as stuck.
            observe(checks[FaultCode.STUCK.value, k], FOR, began, channels[k].last, 0.0)
    return doubtful


@compiled
def _judge_axes(unit: UnitRecords, began: int, s: int, sound: bool) -> None:
    """
    Compare the axes of sensor s (0 gyro, 1 accelerometer) with those of the conventional unit; record the observations.

    began: start of the half second, ns; sound: whether the conventional unit can be used.
    """
    checks, wrong = unit.checks, unit.state.wrong
    found, scaled, strange = axes_of(unit.sums, s)
    out_of_use = checks[FaultCode.DEAD.value, 3 * s].state == FAULT
    for k in range(3):
        if s == 0:
            at_end = found[k] == AT_ONE_END and not scaled
            observe(checks[FaultCode.SATURATED.value, k], FOR if at_end else AGAINST, began, 1.0, 0.9)
        out_of_use = out_of_use or checks[FaultCode.STUCK.value, 3 * s + k].state == FAULT
    if out_of_use:
        return
    known, right, shown = 0, True, 0
    mismatch, check = checks[FaultCode.MISMATCH.value, 3 * s], checks[FaultCode.UNIT.value, 3 * s]
    for k in range(3):
        known += int(found[k] >= 0)
        right = right and (found[k] < 0 or found[k] == 2 * k)
        # Agreement of the x axis does not end a mismatch: north seeking uses the other two axes.
        shown += int(found[k] >= 0 and (k > 0 or mismatch.state != FAULT))
    if known or scaled:
        observe(check, FOR if scaled else AGAINST, began, 0.0, 0.0)
        check.seen_which[0] = 1
    if known and check.state != FAULT:
        mapping = 0 if right else mapping_of(found)
        strange = strange or not (right or mapping > 0)
        if mapping or known > 1 or not wrong[s]:
            wrong[s] = 1 << mapping if mapping else 0
    # A mismatch ends if the y or z axes of both units agree, if the conventional unit is faulty, or if no difference
    # was found for _FORGOTTEN_BINS bins.
    unit.state.agree[s] = 0 if strange else unit.state.agree[s] + 1
    over = shown or not sound or unit.state.agree[s] > _FORGOTTEN_BINS
    observe(mismatch, FOR if strange else (AGAINST if over else NOTHING), began, 0.0, 0.0)


@compiled
def _judge_wrong(unit: UnitRecords, began: int, still: bool, sound: bool) -> None:
    """
    Record whether axes are wrong, and whether the precision unit alone or either unit is accused.

    still: whether the tool is at rest; sound: whether the conventional unit can be used.
    """
    state, check = unit.state, unit.checks[FaultCode.AXES.value, 0]
    proved = check.state == FAULT and not check.which[2]
    wrong = bool(state.wrong[0] or state.wrong[1])
    across = bool(state.wrong[0] & _ACROSS) and not state.wrong[1]
    state.differ = state.differ + int(not still) if wrong else 0
    proved = proved or (state.differ > _MOVED_BINS and not across)
    observe(check, FOR if wrong else (NOTHING if proved and not sound else AGAINST), began, 0.0, 0.0)
    check.seen_which[0], check.seen_which[1], check.seen_which[2] = state.wrong[0], state.wrong[1], int(not proved)


@compiled
def _judge_rest(unit: UnitRecords, began: int, still: bool, values: Array) -> None:
    """Check the rate across the tool if it is at rest (`still`); values: samples of the half second, shape (n, 6)."""
    state, usable, mean = unit.state, 0, np.zeros(2)
    state.still = state.still + 1 if still else 0
    state.rested = state.rested if still else 0
    for i in range(len(values)):
        if np.isfinite(values[i]).all():
            usable += 1
            mean += values[i, 1:3]
    if state.still <= _REST_BINS or usable < _SAMPLES:
        return
    # Check only the rates across the axis: a string may turn slowly about its axis while it unwinds, but never across
    # it.
    mean /= usable
    across, limit, spread = max(abs(mean[0]), abs(mean[1])), state.most_at_rest, 0.0
    state.resting[:-1] = state.resting[1:].copy()
    state.resting[-1] = mean
    state.rested = min(state.rested + 1, _STEADY_BINS)
    for c in range(2):
        spread = max(spread, np.ptp(state.resting[_STEADY_BINS - state.rested :, c]))
    if across > limit and (state.rested < _STEADY_BINS or spread > _STEADY * across):
        # A rate that is not steady is not a fault: a tool that is coming to rest still turns, but slower and slower.
        return
    observe(unit.checks[FaultCode.REST_RATE.value, 0], FOR if across > limit else AGAINST, began, across, limit)


# Code and place of the checks that concern the whole unit or need a second unit: one observation raises a doubt.
_OF_THE_UNIT = (
    (FaultCode.STAMPS.value, 0),
    (FaultCode.MISMATCH.value, 0),
    (FaultCode.MISMATCH.value, 3),
    (FaultCode.REST_RATE.value, 0),
)


@compiled
def _judge(
    unit: UnitRecords, limits: signal_checks.SignalLimits, began: int, still: bool, samples: Any, beside: Any
) -> tuple[bool, bool]:
    """
    Check a half second of the unit and count the observations.

    samples, beside: stamps, ns, and values of the precision unit in the half second, and of the conventional unit
    around it. Returns whether the unit is suspect, and whether a fault has begun or ended.
    """
    (stamps, values), (beside_ns, own), checks = samples, beside, unit.checks
    unit.sums[:-1] = unit.sums[1:].copy()
    unit.sums[-1] = np.zeros(6, dtype=SUMS)
    compare(values, interpolated(stamps, beside_ns, own), unit.channels, unit.sums[-1])
    for s in range(2):
        sizes = input_gate.sizes_of(unit.refused, input_gate.PRECISION_GYRO + s, began, began + BIN_NS)
        signal_checks.judge_refused(checks, unit.channels, s, sizes, math.nan, began)
    doubtful = _judge_samples(unit, limits, began, still)
    # If the conventional unit cannot be used, discard the earlier differences between the units.
    finite, back, own_in_bin = 0, 0, 0
    for i in range(len(beside_ns)):
        if began <= beside_ns[i] < began + BIN_NS:
            own_in_bin += 1
            finite += int(np.isfinite(own[i, :3]).all())
    sound = 2 * finite > own_in_bin
    if not sound:
        unit.sums[:-1] = np.zeros((WINDOW - 1, 6), dtype=SUMS)
        unit.state.wrong[:] = 0
    observe(checks[FaultCode.SILENT.value, 6], AGAINST if len(stamps) else FOR, began, 0.0, 0.0)
    for i in range(1, len(stamps)):
        back += int(stamps[i] <= stamps[i - 1])
    # Between the shares 1/10 and 1/3 record no observation, so that uneven delays do not make the fault come and go.
    disorder = FOR if 3 * back > len(stamps) else (AGAINST if 10 * back <= len(stamps) else NOTHING)
    observe(checks[FaultCode.STAMPS.value, 0], disorder, began, back, 0.0)
    for s in range(2):
        _judge_axes(unit, began, s, sound)
    _judge_wrong(unit, began, still, sound)
    _judge_rest(unit, began, still, values)
    suspect = (suspected(checks) | doubtful) & (GYRO | ACCEL) != 0
    for code, place in _OF_THE_UNIT:
        suspect = suspect or checks[code, place].seen == FOR
    return suspect, weigh(checks) > 0


class PrecisionHealth:
    """Health of one precision unit, half second by half second; bias: 1 sigma of its gyro bias, rad/s."""

    def __init__(self, bias: float) -> None:
        self.active = False
        self.suspect = False
        #: Existing faults.
        self.faults: list[SensorFault] = []
        state = np.zeros(1, dtype=UNIT_STATE)
        state["most_at_rest"] = 2.0 * EARTH_RATE + _BIASES * bias + _PULLED
        sums = np.zeros((WINDOW, 6), dtype=SUMS)
        self._records = UnitRecords(
            fault_debounce.blank(), signal_checks.blank(), sums, state[0], np.zeros(0, dtype=input_gate.REFUSED)
        )
        self._limits = SignalLimits()
        # Samples of the conventional unit, in pieces as they arrive: without a precision unit they are never joined.
        self._beside: list[tuple[Stamps, Array]] = []

    def beside(self, stamps: Stamps, values: Array) -> None:
        """Accept samples of the conventional unit, shape (n, 6), rad/s and m/s^2; NaN if it cannot be used."""
        self._beside.append((stamps, values))

    def take_refused(self, refused: Samples) -> None:
        """Accept refused readings, dtype of `input_gate.REFUSED`, before the half second of their time is checked."""
        self._records = self._records._replace(refused=input_gate.kept(self._records.refused, refused))

    def judge(self, end_ns: int, still: bool, samples: tuple[Stamps, Array]) -> list[SensorFault]:
        """
        Check the half second up to `end_ns`, ns; return the faults that began or ended (none before the first sample).

        still is True if the conventional unit finds the tool at rest; samples are stamps, ns, shape (n,), and values,
        shape (n, 6).
        """
        self.active = self.active or len(samples[0]) > 0
        if not self.active:
            # Keep the last piece that began before the next half second, because interpolation needs its last sample.
            while len(self._beside) > 1 and self._beside[1][0][0] < end_ns:
                del self._beside[0]
            return []
        if len(self._records.refused):
            later = self._records.refused["stamp_ns"] >= end_ns - BIN_NS
            self._records = self._records._replace(refused=self._records.refused[later])
        of_bin = samples[0], np.ascontiguousarray(samples[1])
        beside = self._take_beside(end_ns)
        self.suspect, changed = _judge(self._records, self._limits, end_ns - BIN_NS, bool(still), of_bin, beside)
        if not changed:
            return []
        checks = self._records.checks
        self.faults = [self._named(one) for one in fault_debounce.standing(checks, FaultUnit.PRECISION)]
        return [self._named(one) for one in fault_debounce.take_changes(checks, end_ns, FaultUnit.PRECISION)]

    @property
    def refusal(self) -> Reason | None:
        """Reason why the gyros of the precision unit cannot be used now, or None."""
        stands = [one for one in self.faults if one.unusable]
        if stands:
            return Reason(ReasonCode.PRECISION_UNIT_FAULT, fault=stands[0])
        return Reason(ReasonCode.PRECISION_UNIT_SUSPECT) if self.suspect else None

    def _take_beside(self, end_ns: int) -> tuple[Stamps, Array]:
        """
        Return stamps, ns, and values of the conventional samples up to the first one at or after `end_ns`, ns.

        Keep the last sample before `end_ns` and all later ones for the next half second.
        """
        beside_ns, beside = self._beside[0]
        if len(self._beside) > 1:
            beside_ns = np.concatenate([part[0] for part in self._beside])
            beside = np.concatenate([part[1] for part in self._beside])
        end = int(np.searchsorted(beside_ns, end_ns))
        kept = max(end - 1, 0)
        self._beside = [(beside_ns[kept:], beside[kept:])]
        return beside_ns[: end + 1], beside[: end + 1]

    def _named(self, fault: SensorFault) -> SensorFault:
        """Return the fault, with unit EITHER if the fault is a mismatch or its unit is not proved."""
        if fault.code == FaultCode.MISMATCH:
            return dataclasses.replace(fault, unit=FaultUnit.EITHER)
        if not fault.mappings[2]:
            return fault
        return dataclasses.replace(fault, unit=FaultUnit.EITHER, which=(*fault.mappings[:2], 0))
