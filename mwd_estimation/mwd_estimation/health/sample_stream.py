# SPDX-License-Identifier: Apache-2.0
"""
The kernel of the health checks: samples are judged half second by half second, windows of motion when it is due.

A half second is judged once the magnetic samples of its time are there. `run` stops where a fault has changed or the
window is to be judged in full, which `monitor` does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.sensor_fault import GYRO, FaultCode
from mwd_estimation.health import fault_debounce, motion_window, signal_checks
from mwd_estimation.health.fault_debounce import FAULT, OK, UNKNOWN, weigh
from mwd_estimation.health.motion_window import PARTS, Consistency, Expected, Samples
from mwd_estimation.health.replayed_samples import judge_replay
from mwd_estimation.health.signal_checks import BIN_NS, SignalLimits
from mwd_estimation.health.stream_checks import BACK_NS, judge_silence, judge_stamp, judge_stream
from mwd_estimation.health.window_checks import BROKEN, CLIPPED
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Turn of a window that may show axes, rad.
MOVES = 0.5
# Moving windows that are judged while something is not known; from then on one each minute, ns.
_MINUTE_NS, _IN_VAIN = 60_000_000_000, 3
# Samples that wait at most, where time stands still.
_MOST_WAITING = 16384
# The checks of windows, from and to before.
_WINDOW_CODES = (*range(FaultCode.UNIT, FaultCode.REST_RATE), int(FaultCode.MOUNT))
# Where a call of the kernel stands: at a new sample, behind the check of its stamp, behind a half second.
_NEW, _STAMPED, _CLOSED = 0, 1, 2


class Kernel(NamedTuple):
    """What does not change: limits of the checks and ends of the ranges."""

    signal: SignalLimits
    consistency: Consistency
    ranges: Array
    lag_ns: int
    mag_expected: bool


class Tables(NamedTuple):
    """All arrays that change: checks, channels, stream (1), carried window (1), its steps, hashes of old samples."""

    checks: Any
    channels: Any
    stream: Any
    carried: Any
    steps: Any
    kept: Any


@compiled
def _spoils(channels: Any, sensor: int) -> int:
    """Whether samples of a sensor in this half second are whole, at the end of the range, or missing or constant."""
    found = 0
    for c in range(3 * sensor, 3 * sensor + 3):
        row = channels[c]
        if row.not_finite > 0.01 * (row.n + row.not_finite) or (row.n >= 3 and row.repeats >= row.n):
            found = max(found, BROKEN)
        elif row.at_limit > 0.01 * row.n:
            found = max(found, CLIPPED)
    return found


@compiled
def _due(k: Kernel, s: Any, tables: Tables, expected: Expected, full: bool) -> bool:
    """Whether the window is to be judged: it is not as expected, or whole and something of it open."""
    carried, checks = tables.carried[0], tables.checks
    if not motion_window.consistent(k.consistency, expected, carried, 1e-9 * (s.end_ns - s.window_ns)):
        return True
    if not full:
        return False
    for code in _WINDOW_CODES:
        for place in range(7):
            check = checks[code, place]
            if check.votes_for > 0 or check.state == FAULT:
                return True
    if carried.path < MOVES:
        return bool(s.judged_ns == 0)
    unknown = checks[FaultCode.AXES.value, 0].state == UNKNOWN or checks[FaultCode.UNIT.value, 0].state == UNKNOWN
    unknown = (
        unknown or max(checks[FaultCode.SIGN.value, 3].state, checks[FaultCode.POINTS_UP.value, 3].state) == UNKNOWN
    )
    return bool(unknown and (s.in_vain < _IN_VAIN or s.end_ns - s.judged_ns >= _MINUTE_NS))


@compiled
def _close(k: Kernel, tables: Tables, expected: Expected, samples: Samples, broken: bool) -> bool:
    """Judge the half second that waits; True where its window is to be judged too, or a fault has changed."""
    s, channels, checks, carried = tables.stream[0], tables.channels, tables.checks, tables.carried[0]
    began = s.bin * BIN_NS
    s.end_ns, s.broken = began + BIN_NS, int(broken)
    if carried.parts == 0:
        s.window_ns = began
    used = motion_window.add(carried, tables.steps, samples, s.first, s.stop, s.mag_first, s.last_ns)
    for c in range(3):
        signal_checks.count(channels[c], samples.gyro, c, s.first, s.stop, k.ranges[0])
        signal_checks.count(channels[3 + c], samples.accel, c, s.first, s.stop, k.ranges[1])
        signal_checks.count(channels[6 + c], samples.mag, c, s.mag_first, used, k.ranges[2])
    s.mag_first = used
    for sensor in range(3):
        s.window[sensor] = max(s.window[sensor], _spoils(channels, sensor))
    judge_silence(k.mag_expected, s, checks, channels, began)
    judge_replay(tables.kept, checks, samples, s.first, s.stop, began)
    late = judge_stream(k.signal, checks, channels, s, samples, began)
    s.doubtful = signal_checks.judge_bin(k.signal, checks, channels, k.ranges, began)
    if late or checks[FaultCode.STAMPS.value, 0].state == FAULT:
        s.doubtful |= GYRO
    changes = weigh(checks)
    if changes:
        s.unusable = fault_debounce.unusable(checks)
    full = carried.parts == PARTS
    s.judge = int(not broken and _due(k, s, tables, expected, full))
    if s.judge and s.window[1] == BROKEN and s.window[2] == BROKEN:
        s.judge = 0
    return changes > 0 or s.judge == 1


@compiled
def _finish(tables: Tables, samples: Samples) -> None:
    """Open the next half second, and the next window behind a whole one."""
    s, carried = tables.stream[0], tables.carried[0]
    s.suspect = fault_debounce.doubt(s.doubt_left, s.doubtful) & ~s.unusable
    if s.broken or carried.parts == PARTS:
        motion_window.begin(carried)
        s.window[:] = 0
    s.first = s.stop
    s.bin = samples.stamps[s.first] // BIN_NS


@compiled
def _plain(s: Any, checks: Any, samples: Samples, start: int, until: int) -> int:
    """First sample from `start` on whose stamp does not advance, or is not before `until`, ns, or is looked at."""
    i, newest = start, s.newest_ns
    if s.stamp_score > 0 or checks[FaultCode.STAMPS.value, 0].state != OK:
        return start
    stop = min(len(samples.stamps), s.first + _MOST_WAITING)
    while i < stop and newest < samples.stamps[i] < until:
        newest = samples.stamps[i]
        i += 1
    s.newest_ns = newest
    return i


@compiled
def _ready(k: Kernel, s: Any, samples: Samples, i: int) -> bool:
    """Whether sample i closes the half second: its magnetic samples are there, or time has gone back."""
    stamps, end = samples.stamps, (s.bin + 1) * BIN_NS
    if stamps[i] < s.bin * BIN_NS - BACK_NS or i - s.first >= _MOST_WAITING:
        s.stop = i
        return True
    if stamps[i] < end + k.lag_ns:
        return False
    while s.stop < i and stamps[s.stop] < end:
        s.stop += 1
    return bool(stamps[s.stop] >= end)


@compiled
def run(
    k: Kernel,
    tables: Tables,
    expected: Expected,
    samples: Samples,
    start: int,
    offset: int,
    unusable: NDArray[np.uint8],
    suspect: NDArray[np.uint8],
) -> int:
    """Take samples from `start` on; stops at one that closed a half second which needs `_after_bin`."""
    s, stamps = tables.stream[0], samples.stamps
    if not s.open:
        s.open, s.last_ns, s.newest_ns = 1, stamps[0], stamps[0] - 1
        s.bin = stamps[0] // BIN_NS
        motion_window.begin(tables.carried[0])
    i = start
    while i < len(stamps):
        if s.stage == _CLOSED:
            _finish(tables, samples)
            s.stage = _STAMPED
        elif s.stage == _NEW:
            plain = _plain(s, tables.checks, samples, i, (s.bin + 1) * BIN_NS + k.lag_ns)
            unusable[i - offset : plain - offset] = s.unusable
            suspect[i - offset : plain - offset] = s.suspect
            i = plain
            if i == len(stamps):
                break
            s.stage = _STAMPED
            if judge_stamp(s, tables.checks, stamps[i]):
                s.end_ns = stamps[i]
                return i
        while _ready(k, s, samples, i):
            broken = stamps[s.stop] // BIN_NS != s.bin + 1
            if _close(k, tables, expected, samples, broken):
                s.stage = _CLOSED
                return i
            _finish(tables, samples)
        unusable[i - offset], suspect[i - offset] = s.unusable, s.suspect
        s.stage = _NEW
        i += 1
    return i
