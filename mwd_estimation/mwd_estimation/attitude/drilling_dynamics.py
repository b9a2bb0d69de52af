# SPDX-License-Identifier: Apache-2.0
"""
Drilling dynamics in the numbers of the field, from IMU samples and the gravity followed through them.

Rotary speed and stick-slip severity as used in the field (SSI = (max - min) / (2 mean) of the down-hole rotary speed),
vibration as the root mean square of the non-gravity acceleration along and across the axis, peaks, and shocks counted
as separate excursions beyond a threshold, over the last seconds, every so often. Of strapdown-integrated samples these
are averages over the sample interval: what shook faster than half the rate is not in them.

Time is cut at multiples of the period since the epoch, so that any cut of the stream into blocks gives the same bits.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

_NONE = np.iinfo(np.int64).min


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the summary."""

    period_s: float = 1.0  #: a summary every so often, s
    window_s: float = 10.0  #: time it looks back, in whole periods, s
    shock_threshold: float = 25.0 * STANDARD_GRAVITY  #: non-gravity acceleration that counts as a shock, m/s^2
    shock_separation_s: float = 0.01  #: excursions closer than this are one shock, s
    speed_smoothing_s: float = 0.05  #: mean over which rotary speed is read, s
    least_speed: float = 0.5  #: slower than this there is no stick-slip to name, rad/s
    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2


class KernelParams(NamedTuple):
    """Settings in SI units; `shock_separation_ns` holds a microsecond for stamps that are not even."""

    period_ns: int
    gravity: float
    shock_threshold2: float
    shock_separation_ns: float
    min_speed: float


class Period:
    """Sums over a period."""

    index: int  #: of the period, its start over its length
    #: `samples`, `slots`: in it, and slots of rotary speed that had any.
    samples: int
    slots: int
    rate: float  #: rad/s
    #: `axial2`, `lateral2`: squared non-gravity acceleration, (m/s^2)^2.
    axial2: float
    lateral2: float
    #: `axial_peak2`, `lateral_peak2`, `whole_peak2`: their largest, and that of the whole.
    axial_peak2: float
    lateral_peak2: float
    whole_peak2: float
    shocks: int  #: that began in it


class Now:
    """The open period and what is remembered of the last sample."""

    open: Period  #: sums; its index is _NONE before the first sample
    #: `slot`, `slot_rate`, `slot_samples`: slot of the rotary speed that is open, and its sums, rad/s.
    slot: int
    slot_rate: float
    slot_samples: float
    #: `last_ns`, `shock_ns`: stamps of the last sample, and of the last beyond the threshold; _NONE before the first.
    last_ns: int
    shock_ns: int
    above: bool  #: the last sample was beyond the threshold
    shocks_total: int  #: since the start
    status: int  #: bits of the last sample


NOW, PERIOD = dtype_of(Now), dtype_of(Period)


class State(NamedTuple):
    """All that changes; a copy resumes."""

    now: Samples  #: dtype NOW, shape (1,)
    #: shape (slots,); mean rotary speed of the slots of the open period, rad/s; nan where a slot had no sample.
    speeds: Array
    #: `periods`, `period_speeds`: dtype PERIOD, shape (periods,), and ndarray, shape (periods, slots); the periods of a
    #: window that are over, each at its index modulo their number, and their speeds.
    periods: Samples
    period_speeds: Array

    def copy(self) -> State:
        """Independent copy."""
        return State(self.now.copy(), self.speeds.copy(), self.periods.copy(), self.period_speeds.copy())


class _Block(NamedTuple):
    """Arguments of `run`."""

    stamp_ns: Stamps
    gyro_t: Array
    accel_t: Array
    g_t: Array
    status: NDArray[np.uint32]


def initial(params: Params) -> State:
    """State before the first sample."""
    periods = max(round(params.window_s / params.period_s), 1)
    slots = max(round(params.period_s / params.speed_smoothing_s), 1)
    state = State(np.zeros(1, NOW), np.zeros(slots), np.zeros(periods, PERIOD), np.zeros((periods, slots)))
    state.periods["index"] = _NONE
    state.now[0].open.index = state.now[0].last_ns = state.now[0].shock_ns = _NONE
    return state


def run(
    params: Params,
    state: State,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    accel_t: ArrayLike,
    g_t: ArrayLike,
    status: ArrayLike,
) -> Samples:
    """
    Take in a block of samples.

    Parameters
    ----------
    params : Params
    state : State
        Changed in place.
    stamp_ns : array_like of int64, shape (n,)
        Samples whose stamp does not advance are left out.
    gyro_t, accel_t : array_like, shape (n, 3)
        Angular rate, rad/s, and specific force (up at rest), m/s^2, in tool axes; not finite: left out.
    g_t : array_like, shape (n, 3)
        Unit vector down in tool axes, as a gravity method gives it; NaN before it has one.
    status : array_like of uint32, shape (n,)
        Attitude bits.

    Returns
    -------
    ndarray of dtype `wire.DYNAMICS`
        One summary for each period that is over, stamped with its end: index and share of sticking are -1 where the
        tool does not turn.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    gyro, accel, g = (np.ascontiguousarray(block, dtype=float) for block in (gyro_t, accel_t, g_t))
    bits = np.ascontiguousarray(status, dtype=np.uint32)
    for name, block in (("gyro_t", gyro), ("accel_t", accel), ("g_t", g)):
        if block.shape != (*stamps.shape, 3) or stamps.ndim != 1:
            raise ValueError(f"{name}: expected shape ({stamps.size}, 3) beside stamps (n,), got {block.shape}")
    if bits.shape != stamps.shape:
        raise ValueError(f"status: expected shape {stamps.shape}, got {bits.shape}")
    period_ns = round(params.period_s * 1e9)
    span = int(stamps.max() - stamps.min()) if len(stamps) else 0
    out = wire.DYNAMICS.empty(min(len(stamps), span // period_ns + 2))
    limits = KernelParams(
        period_ns=period_ns,
        gravity=params.gravity,
        shock_threshold2=params.shock_threshold**2,
        shock_separation_ns=params.shock_separation_s * 1e9 + 1e3,
        min_speed=params.least_speed,
    )
    count = _run(limits, state, _Block(stamps, gyro, accel, g, bits), out)
    return out[:count]


@compiled
def _end_slot(s: State) -> None:
    now = s.now[0]
    if now.slot_samples > 0.0:
        s.speeds[now.slot] = now.slot_rate / now.slot_samples
        now.slot_rate = now.slot_samples = 0.0


@compiled
def _end_period(s: State) -> None:
    """Move the open period to those of the window."""
    _end_slot(s)
    now = s.now[0]
    at = now.open.index % len(s.periods)
    slots = 0
    for k in range(len(s.speeds)):
        if math.isfinite(s.speeds[k]):
            s.period_speeds[at, slots] = s.speeds[k]
            slots += 1
    now.open.slots = slots
    s.periods[at] = now.open


@compiled
def _begin_period(s: State, index: int) -> None:
    now = s.now[0]
    p = now.open
    p.index, p.samples, p.slots, p.shocks, now.slot = index, 0, 0, 0, 0
    p.rate = p.axial2 = p.lateral2 = p.axial_peak2 = p.lateral_peak2 = p.whole_peak2 = 0.0
    now.slot_rate = now.slot_samples = 0.0
    for k in range(len(s.speeds)):
        s.speeds[k] = math.nan


@compiled
def _speeds(s: State, mean: float) -> tuple[float, float, float]:
    """Least and largest rotary speed of the window, rad/s, and the share of its slots below a tenth of the mean."""
    oldest = s.now[0].open.index - len(s.periods)
    least, most, slots, sticking = math.inf, -math.inf, 0, 0
    for k in range(len(s.periods)):
        if s.periods[k].index > oldest:
            for i in range(s.periods[k].slots):
                speed = s.period_speeds[k, i]
                least, most, slots = min(least, speed), max(most, speed), slots + 1
                if speed * mean < 0.1 * mean * mean:
                    sticking += 1
    return least, most, sticking / slots


@compiled
def _summarise(p: KernelParams, s: State, row: Samples) -> None:
    """Put the window that ends with the period now over into one output sample."""
    now = s.now[0]
    count, periods, shocks = 0, 0, 0
    rate, axial2, lateral2, axial_peak2, lateral_peak2, whole_peak2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(s.periods)):
        one = s.periods[k]
        if one.index > now.open.index - len(s.periods):
            periods, count, shocks = periods + 1, count + one.samples, shocks + one.shocks
            rate += one.rate
            axial2 += one.axial2
            lateral2 += one.lateral2
            axial_peak2 = max(axial_peak2, one.axial_peak2)
            lateral_peak2 = max(lateral_peak2, one.lateral_peak2)
            whole_peak2 = max(whole_peak2, one.whole_peak2)
    mean = rate / count
    least, most, sticking = _speeds(s, mean)
    turns = abs(mean) >= p.min_speed
    row["stamp_ns"] = (now.open.index + 1) * p.period_ns
    row["duration"] = periods * p.period_ns * 1e-9
    row["samples"] = count
    row["rotary_speed"] = mean
    row["rotary_speed_least"] = least
    row["rotary_speed_most"] = most
    row["stick_slip_index"] = (most - least) / (2.0 * abs(mean)) if turns else -1.0
    row["stick_share"] = sticking if turns else -1.0
    row["axial_rms"] = math.sqrt(axial2 / count)
    row["lateral_rms"] = math.sqrt(lateral2 / count)
    row["axial_peak"] = math.sqrt(axial_peak2)
    row["lateral_peak"] = math.sqrt(lateral_peak2)
    row["shocks"] = shocks
    row["shock_peak"] = math.sqrt(whole_peak2)
    row["shocks_total"] = now.shocks_total
    row["status"] = now.status


@compiled
def _count_shock(p: KernelParams, now: Now, stamp: int, whole2: float) -> None:
    """Count an excursion beyond the threshold once; two samples in a row are one shock, however slow the samples."""
    if whole2 < p.shock_threshold2:
        now.above = False
        return
    far = now.shock_ns == _NONE or stamp - now.shock_ns > p.shock_separation_ns
    if not now.above and far:
        now.open.shocks += 1
        now.shocks_total += 1
    now.shock_ns, now.above = stamp, True


@compiled
def _add(now: Now, rate: float, axial2: float, lateral2: float) -> None:
    """Add a sample to the open period."""
    p, whole2 = now.open, axial2 + lateral2
    p.samples += 1
    now.slot_rate += rate
    now.slot_samples += 1.0
    p.rate += rate
    p.axial2 += axial2
    p.lateral2 += lateral2
    p.axial_peak2 = max(p.axial_peak2, axial2)
    p.lateral_peak2 = max(p.lateral_peak2, lateral2)
    p.whole_peak2 = max(p.whole_peak2, whole2)


@compiled
def _run(p: KernelParams, s: State, block: _Block, out: Samples) -> int:
    """Arguments as in `run`; fills `out` and returns how many periods closed."""
    now, slot_ns, closed = s.now[0], p.period_ns // len(s.speeds), 0
    # Where the open period ends: a division for each sample would cost more than its sums.
    end_ns = (now.open.index + 1) * p.period_ns if now.open.index != _NONE else _NONE
    for i in range(len(block.stamp_ns)):
        stamp, rate = block.stamp_ns[i], block.gyro_t[i, 0]
        # Force is acceleration less gravity (f = a - g down), so that what is not gravity is f + g.
        x = block.accel_t[i, 0] + p.gravity * block.g_t[i, 0]
        y = block.accel_t[i, 1] + p.gravity * block.g_t[i, 1]
        z = block.accel_t[i, 2] + p.gravity * block.g_t[i, 2]
        axial2, lateral2 = x * x, y * y + z * z
        if stamp <= now.last_ns or not math.isfinite(rate + axial2 + lateral2):
            continue
        if stamp >= end_ns:
            if now.open.index != _NONE:
                _end_period(s)
                _summarise(p, s, out[closed])
                closed += 1
            _begin_period(s, stamp // p.period_ns)
            end_ns = (now.open.index + 1) * p.period_ns
        now.last_ns, now.status = stamp, block.status[i]
        slot = min((stamp - (end_ns - p.period_ns)) // slot_ns, len(s.speeds) - 1)
        if slot != now.slot:
            _end_slot(s)
            now.slot = slot
        _add(now, rate, axial2, lateral2)
        _count_shock(p, now, stamp, axial2 + lateral2)
    return closed
