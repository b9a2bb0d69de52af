# SPDX-License-Identifier: Apache-2.0
"""
Drilling dynamics from IMU samples and their gravity, in the quantities that are usual in drilling.

The quantities are rotary speed and stick-slip severity (SSI = (max - min) / (2 mean) of the down-hole rotary speed),
rms vibration along and across the axis without gravity, peaks, and the number of shocks, which are separate excursions
above a threshold. A summary is computed every second over the last ten seconds. If the unit sends strapdown-integrated
samples, a sample is the average over its interval, and vibration above half the sample rate is not included.

Summaries end at full seconds since 1970, so that the result does not depend on how the stream is cut into blocks.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

PERIOD_NS, PERIODS = 1_000_000_000, 10  # interval between summaries, ns; and number of these intervals in a summary
SLOT_NS = 50_000_000  # averaging time of the rotary speed, ns
_PER_PERIOD = PERIOD_NS // SLOT_NS
SLOTS = PERIODS * _PER_PERIOD
# Excursions closer than this count as one shock, ns; one microsecond is added for uneven stamps.
_SEPARATION_NS = 10_001_000
_LEAST_SPEED = 0.5  # smallest mean rotary speed for a stick-slip index, rad/s
_NONE = np.iinfo(np.int64).min


class DynamicsParams(NamedTuple):
    """Settings of the summary of drilling dynamics."""

    shock_threshold: float = 25.0 * STANDARD_GRAVITY  #: non-gravity acceleration that counts as a shock, m/s^2
    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2


class Slot:
    """Sums over one slot: the averaging time of the rotary speed, `SLOT_NS`."""

    index: int  #: start of the slot divided by its length; _NONE for an empty slot
    samples: int  #: number of samples
    rate: float  #: sum of the rates about the axis, rad/s
    #: `axial2`, `lateral2`: sums of the squared non-gravity acceleration, (m/s^2)^2.
    axial2: float
    lateral2: float
    #: `axial_peak2`, `lateral_peak2`, `whole_peak2`: largest squared non-gravity acceleration along the axis, across
    #: the axis, and of the vector, (m/s^2)^2.
    axial_peak2: float
    lateral_peak2: float
    whole_peak2: float
    shocks: int  #: number of shocks that began in the slot


class DynamicsState:
    """State of the summary of drilling dynamics."""

    index: int  #: index of the open slot; _NONE before the first
    slots: Annotated[MutableSequence[Slot], SLOTS]  #: last slots, each stored at its index modulo SLOTS
    #: `last_ns`, `shock_ns`: stamp of the last sample, and of the last sample above the shock threshold; _NONE
    #: before the first.
    last_ns: int
    shock_ns: int
    above: bool  #: whether the last sample was above the threshold
    shocks_total: int  #: number of shocks since the start
    status: int  #: status bits of the last sample


STATE = dtype_of(DynamicsState)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    state = np.zeros(1, dtype=STATE)
    state["index"] = state["slots"]["index"] = state["last_ns"] = state["shock_ns"] = _NONE
    return state


def run(params: DynamicsParams, state: Samples, samples: Samples, attitude: Samples) -> Samples:
    """
    Process a block of n samples.

    Parameters
    ----------
    state : ndarray, shape (1,)
        From `initial`; changed in place.
    samples : ndarray of dtype `sample.SAMPLE`, shape (n,)
        Samples; those whose stamp does not advance, or whose rate, force or gravity is not finite, are ignored.
    attitude : ndarray of dtype `wire.ATTITUDE`, shape (n,)
        Attitude of these samples; only the status is used.

    Returns
    -------
    ndarray of dtype `wire.DYNAMICS`
        One summary for each period with samples, stamped with the end of the period, once a later sample has come.
        Stick-slip index and share of sticking are NaN if the mean rotary speed is below 0.5 rad/s.
    """
    stamps = samples["stamp_ns"]
    span = int(stamps.max() - stamps.min()) if len(stamps) else 0
    out = wire.DYNAMICS.empty(min(len(stamps), span // PERIOD_NS + 2))
    count = _run(params, state, samples, attitude, out)
    return out[:count]


@compiled
def _open(s: DynamicsState, index: int) -> None:
    """Clear the sums of a new slot, and make this slot the open one; index: start of the slot divided by its length."""
    slot, s.index = s.slots[index % SLOTS], index
    slot.index, slot.samples, slot.shocks = index, 0, 0
    slot.rate = slot.axial2 = slot.lateral2 = slot.axial_peak2 = slot.lateral_peak2 = slot.whole_peak2 = 0.0


@compiled
def _sticking(s: DynamicsState, first: int, mean: float) -> float:
    """Return the share, 0 to 1, of the slots from index `first` on with a speed below a tenth of `mean`, rad/s."""
    slots, sticking = 0, 0
    for slot in s.slots:
        if slot.index >= first:
            slots += 1
            sticking += int(slot.rate / slot.samples * mean < 0.1 * mean * mean)
    return sticking / slots


@compiled
def _summarise(s: DynamicsState, row: Samples) -> None:
    """Write the summary of the last PERIODS periods to one output sample; the period of the open slot is the last."""
    periods, count, shocks, least, most = 0, 0, 0, math.inf, -math.inf
    rate, axial2, lateral2, axial_peak2, lateral_peak2, whole_peak2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    end = s.index // _PER_PERIOD + 1
    first, period = (end - PERIODS) * _PER_PERIOD, _NONE
    for one in s.slots:
        if one.index >= first:
            # Count the periods with samples: the slots of one period are next to each other.
            periods += int(one.index // _PER_PERIOD != period)
            period = one.index // _PER_PERIOD
            count, shocks = count + one.samples, shocks + one.shocks
            speed = one.rate / one.samples
            least, most = min(least, speed), max(most, speed)
            rate += one.rate
            axial2 += one.axial2
            lateral2 += one.lateral2
            axial_peak2 = max(axial_peak2, one.axial_peak2)
            lateral_peak2 = max(lateral_peak2, one.lateral_peak2)
            whole_peak2 = max(whole_peak2, one.whole_peak2)
    mean = rate / count
    turns = abs(mean) >= _LEAST_SPEED
    row["stamp_ns"] = end * PERIOD_NS
    row["duration"] = periods * PERIOD_NS * 1e-9
    row["samples"] = count
    row["rotary_speed"] = mean
    row["rotary_speed_least"] = least
    row["rotary_speed_most"] = most
    row["stick_slip_index"] = (most - least) / (2.0 * abs(mean)) if turns else math.nan
    row["stick_share"] = _sticking(s, first, mean) if turns else math.nan
    row["axial_rms"] = math.sqrt(axial2 / count)
    row["lateral_rms"] = math.sqrt(lateral2 / count)
    row["axial_peak"] = math.sqrt(axial_peak2)
    row["lateral_peak"] = math.sqrt(lateral_peak2)
    row["shocks"] = shocks
    row["shock_peak"] = math.sqrt(whole_peak2)
    row["shocks_total"] = s.shocks_total
    row["status"] = s.status


@compiled
def _count_shock(p: DynamicsParams, s: DynamicsState, stamp: int, whole2: float) -> None:
    """
    Count each excursion above the shock threshold once, at any sample rate.

    An excursion that begins at most 10 ms after the last sample above the threshold belongs to the same shock. stamp:
    ns; whole2: squared magnitude of the non-gravity acceleration, (m/s^2)^2.
    """
    if whole2 < p.shock_threshold * p.shock_threshold:
        s.above = False
        return
    far = s.shock_ns == _NONE or stamp - s.shock_ns > _SEPARATION_NS
    if not s.above and far:
        s.slots[s.index % SLOTS].shocks += 1
        s.shocks_total += 1
    s.shock_ns, s.above = stamp, True


@compiled
def _add(slot: Slot, rate: float, axial2: float, lateral2: float) -> None:
    """Add a sample to a slot; rate: x rate, rad/s; axial2, lateral2: squared accelerations, (m/s^2)^2."""
    slot.samples += 1
    slot.rate += rate
    slot.axial2 += axial2
    slot.lateral2 += lateral2
    slot.axial_peak2 = max(slot.axial_peak2, axial2)
    slot.lateral_peak2 = max(slot.lateral_peak2, lateral2)
    slot.whole_peak2 = max(slot.whole_peak2, axial2 + lateral2)


@compiled
def _run(p: DynamicsParams, state: Samples, samples: Samples, attitude: Samples, out: Samples) -> int:
    """Fill `out` with the summaries of closed periods and return their number; arguments as in `run`."""
    s: DynamicsState = state[0]
    closed = 0
    # End of the open slot, ns, computed once a slot: a division for each sample would cost more than its sums.
    end_ns = (s.index + 1) * SLOT_NS if s.index != _NONE else _NONE
    for i in range(len(samples)):
        sample = samples[i]
        stamp, rate = sample.stamp_ns, sample.gyro[0]
        # Force is acceleration minus gravity (f = a - g down), so the non-gravity acceleration is f + g down.
        x = sample.accel[0] + p.gravity * sample.down[0]
        y = sample.accel[1] + p.gravity * sample.down[1]
        z = sample.accel[2] + p.gravity * sample.down[2]
        axial2, lateral2 = x * x, y * y + z * z
        if stamp <= s.last_ns or not math.isfinite(rate + axial2 + lateral2):
            continue
        if stamp >= end_ns:
            index = stamp // SLOT_NS
            if s.index != _NONE and index // _PER_PERIOD > s.index // _PER_PERIOD:
                _summarise(s, out[closed])
                closed += 1
            _open(s, index)
            end_ns = (index + 1) * SLOT_NS
        s.last_ns, s.status = stamp, attitude[i].status
        _add(s.slots[s.index % SLOTS], rate, axial2, lateral2)
        _count_shock(p, s, stamp, axial2 + lateral2)
    return closed
