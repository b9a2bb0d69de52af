"""
Drilling dynamics in a driller's numbers, from IMU samples and the gravity followed through them.

Rotary speed and stick-slip severity as used in the field (SSI = (max - min) / (2 mean) of the down-hole rotary speed),
vibration as the root mean square of the non-gravity acceleration along and across the axis, peaks, and shocks counted
as separate excursions beyond a threshold, over the last seconds, every so often. Of strapdown-integrated samples these
are averages over the sample interval: what shook faster than half the rate is not in them.

Time is cut at multiples of the period since the epoch, so that any cut of the stream into blocks gives the same bits.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

_NONE = np.iinfo(np.int64).min
# Integer state: open period and its samples, open slot, last stamp, last stamp beyond the threshold and whether the
# last sample was, shocks since the start, status of the last sample.
_PERIOD, _COUNT, _SLOT, _LAST_NS, _SHOCK_NS, _ABOVE, _TOTAL, _STATUS, _INTEGERS = range(9)
# Sums of a period: rate, squares along and across, largest squares along, across and whole, shocks; the open slot.
_RATE, _AXIAL2, _LATERAL2, _AXIAL_TOP, _LATERAL_TOP, _WHOLE_TOP, _SHOCKS, _SLOT_RATE, _SLOT_COUNT, _SUMS = range(10)
# Row of a period that is over: its index, its samples, its slots, then its sums.
_R_INDEX, _R_COUNT, _R_SLOTS, _R_SUMS = 0, 1, 2, 3


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the summary."""

    period_s: float = setting(1.0, "A summary every so often", unit="s", low=0.1, high=60.0)
    window_s: float = setting(10.0, "Time it looks back, in whole periods", unit="s", low=0.1, high=600.0)
    shock_threshold: float = setting(
        25.0 * STANDARD_GRAVITY, "Non-gravity acceleration that counts as a shock", unit="m/s^2", low=1.0, high=1e4
    )
    shock_separation_s: float = setting(0.01, "Excursions closer than this are one shock", unit="s", low=0.0, high=1.0)
    speed_smoothing_s: float = setting(0.05, "Mean over which rotary speed is read", unit="s", low=1e-3, high=1.0)
    least_speed: float = setting(
        0.5, "Slower than this there is no stick-slip to name", unit="rad/s", low=0.0, high=10.0
    )
    gravity: float = setting(STANDARD_GRAVITY, "Magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)


@dataclasses.dataclass
class State:
    """
    Everything that changes; a copy resumes.

    Attributes
    ----------
    counters, sums, speeds : ndarray
        Of the open period; `speeds` holds the mean rotary speed of its slots, rad/s.
    rows, row_speeds : ndarray, shapes (periods of a window, ...)
        The same of the periods that are over, each at its index modulo their number.
    """

    counters: Stamps
    sums: Array
    speeds: Array
    rows: Array
    row_speeds: Array

    def copy(self) -> State:
        """Independent copy."""
        return State(**{name: value.copy() for name, value in vars(self).items()})


def initial(params: Params) -> State:
    """State before the first sample."""
    periods = max(round(params.window_s / params.period_s), 1)
    slots = max(round(params.period_s / params.speed_smoothing_s), 1)
    counters = np.zeros(_INTEGERS, dtype=np.int64)
    counters[[_PERIOD, _LAST_NS, _SHOCK_NS]] = _NONE
    rows = np.zeros((periods, _R_SUMS + _SUMS))
    rows[:, _R_INDEX] = -math.inf
    return State(counters, np.zeros(_SUMS), np.zeros(slots), rows, np.zeros((periods, slots)))


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
    limits = np.array(
        [params.gravity, params.shock_threshold**2, params.shock_separation_s * 1e9 + 1e3, params.least_speed]
    )
    count = _run(
        limits, period_ns, state.counters, state.sums, state.speeds, state.rows, state.row_speeds, stamps, gyro, accel,
        g, bits, out,
    )  # fmt: skip
    return out[:count]


@compiled
def _end_slot(counters: Stamps, sums: Array, speeds: Array) -> None:
    if sums[_SLOT_COUNT] > 0.0:
        speeds[counters[_SLOT]] = sums[_SLOT_RATE] / sums[_SLOT_COUNT]
        sums[_SLOT_RATE] = sums[_SLOT_COUNT] = 0.0


@compiled
def _end_period(counters: Stamps, sums: Array, speeds: Array, rows: Array, row_speeds: Array) -> None:
    """Move the open period to the rows."""
    _end_slot(counters, sums, speeds)
    at = counters[_PERIOD] % len(rows)
    rows[at, _R_INDEX], rows[at, _R_COUNT] = counters[_PERIOD], counters[_COUNT]
    slots = 0
    for k in range(len(speeds)):
        if math.isfinite(speeds[k]):
            row_speeds[at, slots] = speeds[k]
            slots += 1
    rows[at, _R_SLOTS] = slots
    for k in range(_SUMS):
        rows[at, _R_SUMS + k] = sums[k]


@compiled
def _begin_period(counters: Stamps, sums: Array, speeds: Array, period: int) -> None:
    counters[_PERIOD], counters[_COUNT], counters[_SLOT] = period, 0, 0
    for k in range(_SUMS):
        sums[k] = 0.0
    for k in range(len(speeds)):
        speeds[k] = math.nan


@compiled
def _summarise(
    counters: Stamps, rows: Array, row_speeds: Array, period_ns: int, least_speed: float, row: Samples
) -> None:
    """Put the rows of the window that ends with the period now over into one output sample."""
    newest, periods = counters[_PERIOD], len(rows)
    count, held, slots = 0.0, 0, 0
    rate, axial2, lateral2, shocks = 0.0, 0.0, 0.0, 0.0
    axial_top, lateral_top, whole_top = 0.0, 0.0, 0.0
    least, most = math.inf, -math.inf
    for k in range(periods):
        if rows[k, _R_INDEX] <= newest - periods:
            continue
        held += 1
        count += rows[k, _R_COUNT]
        rate += rows[k, _R_SUMS + _RATE]
        axial2 += rows[k, _R_SUMS + _AXIAL2]
        lateral2 += rows[k, _R_SUMS + _LATERAL2]
        shocks += rows[k, _R_SUMS + _SHOCKS]
        axial_top = max(axial_top, rows[k, _R_SUMS + _AXIAL_TOP])
        lateral_top = max(lateral_top, rows[k, _R_SUMS + _LATERAL_TOP])
        whole_top = max(whole_top, rows[k, _R_SUMS + _WHOLE_TOP])
        for s in range(int(rows[k, _R_SLOTS])):
            least, most = min(least, row_speeds[k, s]), max(most, row_speeds[k, s])
            slots += 1
    mean = rate / count
    sticking = 0
    for k in range(periods):
        if rows[k, _R_INDEX] > newest - periods:
            for s in range(int(rows[k, _R_SLOTS])):
                if row_speeds[k, s] * mean < 0.1 * mean * mean:
                    sticking += 1
    turns = abs(mean) >= least_speed
    row["stamp_ns"] = (newest + 1) * period_ns
    row["duration"] = held * period_ns * 1e-9
    row["samples"] = int(count)
    row["rotary_speed"] = mean
    row["rotary_speed_least"] = least
    row["rotary_speed_most"] = most
    row["stick_slip_index"] = (most - least) / (2.0 * abs(mean)) if turns else -1.0
    row["stick_share"] = sticking / slots if turns else -1.0
    row["axial_rms"] = math.sqrt(axial2 / count)
    row["lateral_rms"] = math.sqrt(lateral2 / count)
    row["axial_peak"] = math.sqrt(axial_top)
    row["lateral_peak"] = math.sqrt(lateral_top)
    row["shocks"] = int(shocks)
    row["shock_peak"] = math.sqrt(whole_top)
    row["shocks_total"] = counters[_TOTAL]
    row["status"] = counters[_STATUS]


@compiled
def _run(
    limits: Array, period_ns: int, counters: Stamps, sums: Array, speeds: Array, rows: Array, row_speeds: Array,
    stamps: Stamps, gyro: Array, accel: Array, g: Array, status: NDArray[np.uint32], out: Samples,
) -> int:  # fmt: skip
    gravity, threshold2, separation, least_speed = limits[0], limits[1], limits[2], limits[3]
    slot_ns = period_ns // len(speeds)
    closed = 0
    # Where the open period ends: a division for each sample would cost more than its sums.
    end_ns = (counters[_PERIOD] + 1) * period_ns if counters[_PERIOD] != _NONE else _NONE
    for i in range(len(stamps)):
        stamp, rate = stamps[i], gyro[i, 0]
        # Force is acceleration less gravity (f = a - g down), so that what is not gravity is f + g.
        x, y, z = accel[i, 0] + gravity * g[i, 0], accel[i, 1] + gravity * g[i, 1], accel[i, 2] + gravity * g[i, 2]
        axial2, lateral2 = x * x, y * y + z * z
        if stamp <= counters[_LAST_NS] or not math.isfinite(rate + axial2 + lateral2):
            continue
        if stamp >= end_ns:
            if counters[_PERIOD] != _NONE:
                _end_period(counters, sums, speeds, rows, row_speeds)
                _summarise(counters, rows, row_speeds, period_ns, least_speed, out[closed])
                closed += 1
            _begin_period(counters, sums, speeds, stamp // period_ns)
            end_ns = (counters[_PERIOD] + 1) * period_ns
        counters[_LAST_NS] = stamp
        slot = min((stamp - (end_ns - period_ns)) // slot_ns, len(speeds) - 1)
        if slot != counters[_SLOT]:
            _end_slot(counters, sums, speeds)
            counters[_SLOT] = slot
        counters[_COUNT] += 1
        counters[_STATUS] = status[i]
        whole2 = axial2 + lateral2
        sums[_SLOT_RATE] += rate
        sums[_SLOT_COUNT] += 1.0
        sums[_RATE] += rate
        sums[_AXIAL2] += axial2
        sums[_LATERAL2] += lateral2
        sums[_AXIAL_TOP] = max(sums[_AXIAL_TOP], axial2)
        sums[_LATERAL_TOP] = max(sums[_LATERAL_TOP], lateral2)
        sums[_WHOLE_TOP] = max(sums[_WHOLE_TOP], whole2)
        if whole2 >= threshold2:
            # Two samples in a row beyond it are one shock, however slow the samples.
            far = counters[_SHOCK_NS] == _NONE or stamp - counters[_SHOCK_NS] > separation
            if counters[_ABOVE] == 0 and far:
                sums[_SHOCKS] += 1.0
                counters[_TOTAL] += 1
            counters[_SHOCK_NS], counters[_ABOVE] = stamp, 1
        else:
            counters[_ABOVE] = 0
    return closed
