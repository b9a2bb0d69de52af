# SPDX-License-Identifier: Apache-2.0
"""
Health of the sensors from their own samples: fault, sensor, axis and beginning.

Samples are evaluated in half seconds (`signal_checks`), when the magnetic samples of the same time have arrived.
Windows of three seconds are evaluated for units of measurement, axes and signs (`window_checks`) if these are not known
yet (then once a minute), and whenever gravity, field or dip are not as expected. `fault_debounce` turns the
observations into faults. The compiled kernel stops when a fault has changed or a window must be evaluated, because
uncompiled code does both.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import input_gate
from mwd_estimation.core.sensor_fault import GYRO, FaultCode, SensorFault
from mwd_estimation.core.time_jumps import BACK_NS
from mwd_estimation.core.track import AT_RANGE, sample_arrays
from mwd_estimation.health import fault_debounce, motion_window, rest_check, signal_checks, stream_checks
from mwd_estimation.health.fault_debounce import FAULT, OK, UNKNOWN, weigh
from mwd_estimation.health.motion_window import PARTS, Consistency, ExpectedField, Samples
from mwd_estimation.health.signal_checks import BIN_NS, SignalLimits
from mwd_estimation.health.stream_checks import STREAM, judge_replay, judge_silence, judge_stamp, judge_stream
from mwd_estimation.health.window_checks import BROKEN, CLIPPED, Window, WindowJudge, WindowLimits
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Smallest rotation in a window, rad, that can show the axes.
_MOVES = 0.5
# While units, axes or signs are unknown, the first _IN_VAIN windows with motion are evaluated at once, and then one
# window in each _MINUTE_NS.
_MINUTE_NS, _IN_VAIN = 60_000_000_000, 3
# Largest number of waiting samples; it is reached if the stamps do not advance.
_MOST_WAITING = 16384
# Codes of the checks that a window evaluates.
_WINDOW_CODES = (*range(FaultCode.UNIT, FaultCode.REST_RATE), int(FaultCode.MOUNT), int(FaultCode.ADRIFT))
# Position at which the kernel stopped: at a new sample, after the check of a stamp, or after a half second was closed.
_NEW, _STAMPED, _CLOSED = 0, 1, 2


class MonitorParams(NamedTuple):
    """Parameters of the health checks of the conventional unit and the magnetometer."""

    signal: SignalLimits = SignalLimits()
    consistency: Consistency = Consistency()
    window: WindowLimits = WindowLimits()
    #: `gyro_range`, `accel_range`, `mag_range`: ends of the ranges, rad/s, m/s^2 and T; infinite if unknown, then
    #: clipping is not detected.
    gyro_range: float = math.radians(2000.0)
    accel_range: float = 16.0 * STANDARD_GRAVITY
    mag_range: float = 800.0 * 1e-6
    #: Time that IMU samples wait for magnetic samples of the same time, ns; it delays the report of every fault.
    mag_lag_ns: int = 50_000_000
    rest_rate: float = 0.012  #: largest rate across gravity at rest, rad/s: six sigma of the bias of an MTi-1
    mag_expected: bool = True  #: True if the tool has a magnetometer, so that a missing one is a fault


class Tables(NamedTuple):
    """
    Arrays that the kernels change.

    checks: see `fault_debounce`; channels: see `signal_checks`; stream: dtype STREAM, shape (1,); steps: steps of the
    window, see `motion_window`; kept: hashes of old samples, see `stream_checks`; refused: refused readings of the
    waiting samples and later ones, dtype of `input_gate.REFUSED`.
    """

    checks: Any
    channels: Any
    stream: Any
    steps: Any
    kept: Any
    refused: Any


@dataclasses.dataclass
class MonitorState:
    """State of the monitor, with the samples that have not been evaluated yet."""

    tables: Tables
    expected: ExpectedField
    samples: Samples

    def copy(self) -> MonitorState:
        """Return an independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Step:
    """Health of the sensors at each of n samples of a block, and the faults that changed."""

    unusable: NDArray[np.uint8]  #: uint8, shape (n,); bits GYRO, ACCEL, MAG of the unusable sensors at each sample
    #: uint8, shape (n,); bits of the sensors that are doubtful at each sample, but not faulty yet.
    suspect: NDArray[np.uint8]
    changes: list[SensorFault]  #: faults that were found, narrowed down or ended, in order
    places: list[int]  #: index of the sample in the block at which each change occurred


def initial(gravity: float | None = None, total: float | None = None, dip: float | None = None) -> MonitorState:
    """
    Return the state before the first sample.

    gravity, total, dip: reference gravity, m/s^2, total field, T, and dip, rad; None if unknown.
    """
    tables = Tables(
        fault_debounce.blank(),
        signal_checks.blank(),
        np.zeros(1, dtype=STREAM),
        np.zeros(motion_window.ROWS, dtype=motion_window.STEP),
        stream_checks.blank_hashes(),
        np.zeros(0, dtype=input_gate.REFUSED),
    )
    empty = np.zeros(0, dtype=np.int64)
    nothing = np.zeros((0, 3))
    state = MonitorState(tables, ExpectedField(0.0, 0.0, 0.0), Samples(empty, nothing, nothing, empty, nothing))
    set_reference(state, gravity, total, dip)
    return state


def set_reference(state: MonitorState, gravity: float | None, total: float | None, dip: float | None) -> None:
    """Use this gravity, m/s^2, total field, T, and dip, rad, as references from now on; None if unknown."""
    state.expected = ExpectedField(
        STANDARD_GRAVITY if gravity is None else float(gravity),
        math.nan if total is None else float(total),
        math.nan if dip is None else float(dip),
    )


def push_mag(state: MonitorState, stamp_ns: ArrayLike, b_t: ArrayLike) -> None:
    """
    Accept all magnetic samples, even wrong ones; call this before the IMU samples of the same time.

    stamp_ns, shape (n,), in ns; b_t, shape (n, 3), in T.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    field = np.ascontiguousarray(b_t, dtype=np.float64)
    if field.shape != (*stamps.shape, 3) or stamps.ndim != 1:
        raise ValueError(f"b_t: expected shape ({stamps.size}, 3), one row for each stamp, got {field.shape}")
    held = state.samples
    state.samples = held._replace(mag_ns=_joined(held.mag_ns, stamps), mag=_joined(held.mag, field))


def push_refused(state: MonitorState, refused: NDArray[Any]) -> None:
    """Accept refused readings, dtype of `input_gate.REFUSED`, before the IMU samples of the same time."""
    state.tables = state.tables._replace(refused=input_gate.kept(state.tables.refused, refused))


def run(params: MonitorParams, state: MonitorState, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Step:
    """
    Return the health for each sample of a block of any length; the state changes in place.

    stamp_ns, shape (n,), in ns; gyro_t and accel_t, shape (n, 3), in rad/s and m/s^2, unfiltered and possibly not
    finite.

    Raises
    ------
    ValueError
        If the shapes do not match.
    """
    stamps, gyro, accel = sample_arrays(stamp_ns, gyro_t, accel_t)
    step = Step(np.zeros(len(stamps), dtype=np.uint8), np.zeros(len(stamps), dtype=np.uint8), [], [])
    if not len(stamps):
        return step
    held, tables = state.samples, state.tables
    at = offset = len(held.stamps)
    samples = Samples(
        _joined(held.stamps, stamps), _joined(held.gyro, gyro), _joined(held.accel, accel), held.mag_ns, held.mag
    )
    while at < len(samples.stamps):
        at = _run(params, tables, state.expected, samples, at, offset, step.unusable, step.suspect)
        if at < len(samples.stamps):
            step.changes.extend(_after_bin(state, params.window))
            step.places.extend([at - offset] * (len(step.changes) - len(step.places)))
    stream = tables.stream
    used, mag_used = int(stream["first"][0]), int(stream["mag_first"][0])
    state.samples = Samples(
        samples.stamps[used:].copy(),
        samples.gyro[used:].copy(),
        samples.accel[used:].copy(),
        samples.mag_ns[mag_used:].copy(),
        samples.mag[mag_used:].copy(),
    )
    stream["first"] = stream["mag_first"] = 0
    stream["stop"] -= used
    if len(tables.refused):
        later = tables.refused["stamp_ns"] >= int(stream["bin"][0]) * BIN_NS
        state.tables = tables._replace(refused=tables.refused[later])
    return step


def _joined(held: NDArray[Any], more: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([held, more]) if len(held) else more


def _after_bin(state: MonitorState, limits: WindowLimits) -> list[SensorFault]:
    """Evaluate the window if the kernel has requested this; return the faults that changed."""
    tables, stream = state.tables, state.tables.stream[0]
    now = int(stream.end_ns)
    changes = fault_debounce.take_changes(tables.checks, now)
    if stream.judge:
        stream.judge = 0
        window = Window(tables.steps[: int(stream.steps)], int(stream.window_ns), 1e-9 * (now - int(stream.window_ns)))
        WindowJudge(limits, state.expected, window, stream.window, tables.checks).judge()
        stream.doubtful |= fault_debounce.suspected(tables.checks)
        if stream.parts == PARTS:
            stream.in_vain += int(window.path > _MOVES)
            stream.judged_ns = now
            weigh(tables.checks)
            stream.unusable = fault_debounce.unusable(tables.checks)
            changes += fault_debounce.take_changes(tables.checks, now)
        else:
            # Part of a window can only raise a doubt; it does not count for a fault.
            tables.checks["seen"] = fault_debounce.NOTHING
    return changes


def shift_mag(state: MonitorState, late_ns: int) -> None:
    """Subtract late_ns from the stamps of waiting magnetic samples and refused magnetic readings."""
    state.samples = state.samples._replace(mag_ns=state.samples.mag_ns - late_ns)
    refused = state.tables.refused
    refused["stamp_ns"][refused["sensor"] == input_gate.MAG] -= late_ns


def faults(state: MonitorState) -> list[SensorFault]:
    """Return all existing faults."""
    return fault_debounce.standing(state.tables.checks)


def known(state: MonitorState) -> dict[str, int]:
    """Return the state of the checks of units of measurement, axes and signs by name: UNKNOWN, OK or FAULT."""
    condition = state.tables.checks["state"]
    signs = [int(condition[code, 3]) for code in (FaultCode.SIGN, FaultCode.POINTS_UP)]
    return {
        "gyro unit": int(condition[FaultCode.UNIT, 0]),
        "accelerometer unit": int(condition[FaultCode.UNIT, 3]),
        "magnetometer unit": int(condition[FaultCode.UNIT, 6]),
        "axes": int(condition[FaultCode.AXES, 0]),
        "signs of accelerometer and magnetometer": max(signs),
    }


@compiled
def _spoils(channels: Any, sensor: int) -> int:
    """Return the state of a sensor's samples in this half second: WHOLE (0), CLIPPED or BROKEN of `window_checks`."""
    found = 0
    for c in range(3 * sensor, 3 * sensor + 3):
        row = channels[c]
        if row.not_finite > 0.01 * (row.n + row.not_finite) or (row.n >= 3 and row.repeats >= row.n):
            found = max(found, BROKEN)
        elif row.at_limit > 0.01 * row.n:
            found = max(found, CLIPPED)
    return found


@compiled
def _due(k: MonitorParams, s: Any, tables: Tables, expected: ExpectedField, full: bool) -> bool:
    """
    Return whether the window must be evaluated.

    A window must be evaluated if gravity, field or dip are not as expected. A full window must also be evaluated while
    a fault exists or is possible, or while axes, units of measurement or signs are unknown.
    """
    carried, checks = motion_window.carry(tables.steps[: s.steps]), tables.checks
    if not motion_window.consistent(k.consistency, expected, carried, 1e-9 * (s.end_ns - s.window_ns)):
        return True
    if not full:
        return False
    for code in _WINDOW_CODES:
        for place in range(0, 7, 3):
            check = checks[code, place]
            if check.votes_for > 0 or check.state == FAULT:
                return True
    if carried.path < _MOVES:
        return bool(s.judged_ns == 0)
    unknown = checks[FaultCode.AXES.value, 0].state == UNKNOWN or checks[FaultCode.UNIT.value, 0].state == UNKNOWN
    unknown = (
        unknown or max(checks[FaultCode.SIGN.value, 3].state, checks[FaultCode.POINTS_UP.value, 3].state) == UNKNOWN
    )
    return bool(unknown and (s.in_vain < _IN_VAIN or s.end_ns - s.judged_ns >= _MINUTE_NS))


@compiled
def _close(k: MonitorParams, tables: Tables, expected: ExpectedField, samples: Samples, broken: bool) -> bool:
    """
    Evaluate the half second that ended; return True if the window must be evaluated too or a fault has changed.

    broken: whether there is a data gap after the half second.
    """
    s, channels, checks = tables.stream[0], tables.channels, tables.checks
    began = s.bin * BIN_NS
    s.end_ns, s.broken = began + BIN_NS, int(broken)
    if s.parts == 0:
        s.window_ns = began
    mag_first = s.mag_first
    motion_window.add(s, tables.steps, samples)
    ranges = AT_RANGE * np.array([k.gyro_range, k.accel_range, k.mag_range])
    for c in range(3):
        signal_checks.count(channels[c], samples.gyro, c, s.first, s.stop, ranges[0])
        signal_checks.count(channels[3 + c], samples.accel, c, s.first, s.stop, ranges[1])
        signal_checks.count(channels[6 + c], samples.mag, c, mag_first, s.mag_first, ranges[2])
    for sensor in range(3):
        s.window[sensor] = max(s.window[sensor], _spoils(channels, sensor))
    for sensor in range(3):
        sizes = input_gate.sizes_of(tables.refused, sensor, began, began + BIN_NS)
        signal_checks.judge_refused(checks, channels, sensor, sizes, expected.total, began)
    judge_silence(k.mag_expected, s, checks, channels, began)
    judge_replay(tables.kept, checks, samples, s.first, s.stop, began)
    late = judge_stream(k.signal, checks, channels, s, samples, began)
    signal_checks.summarise(channels)
    rest_check.judge_rest(k.rest_rate, k.signal.shakes, s, checks, channels, began)
    s.doubtful = signal_checks.judge_bin(k.signal, checks, channels, ranges, began)
    if late or checks[FaultCode.STAMPS.value, 0].state == FAULT:
        s.doubtful |= GYRO
    changes = weigh(checks)
    if changes:
        s.unusable = fault_debounce.unusable(checks)
    full = s.parts == PARTS
    s.judge = int(not broken and _due(k, s, tables, expected, full))
    if s.judge and s.window[1] == BROKEN and s.window[2] == BROKEN:
        s.judge = 0
    return changes > 0 or s.judge == 1


@compiled
def _finish(tables: Tables, samples: Samples) -> None:
    """Open the next half second; open the next window too if the last window is full or ends at a data gap."""
    s = tables.stream[0]
    s.suspect = fault_debounce.doubt(s.doubt_left, s.doubtful) & ~s.unusable
    if s.broken or s.parts == PARTS:
        s.steps = s.parts = 0
        s.window[:] = 0
    s.first = s.stop
    s.bin = samples.stamps[s.first] // BIN_NS


@compiled
def _plain(s: Any, checks: Any, samples: Samples, start: int, until: int) -> int:
    """
    Return the index of the first sample from `start` on that needs a check; update the newest stamp.

    This is a sample at or after `until`, ns, or a sample whose stamp must be checked.
    """
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
def _ready(k: MonitorParams, s: Any, samples: Samples, i: int) -> bool:
    """
    Return whether sample i closes the half second; set `stop` to the first sample after it.

    The half second closes when its magnetic samples have arrived, time went back, or too many samples wait.
    """
    stamps, end = samples.stamps, (s.bin + 1) * BIN_NS
    if stamps[i] < s.bin * BIN_NS - BACK_NS or i - s.first >= _MOST_WAITING:
        s.stop = i
        return True
    if stamps[i] < end + k.mag_lag_ns:
        return False
    while s.stop < i and stamps[s.stop] < end:
        s.stop += 1
    return bool(stamps[s.stop] >= end)


@compiled
def _run(
    k: MonitorParams,
    tables: Tables,
    expected: ExpectedField,
    samples: Samples,
    start: int,
    offset: int,
    unusable: NDArray[np.uint8],
    suspect: NDArray[np.uint8],
) -> int:
    """
    Process samples from `start` on; return the index of the sample at which `_after_bin` must be called.

    Return the number of samples if there is no such sample. offset: index of the first sample of the block among the
    waiting samples; unusable, suspect, shape (n,): filled for the samples of the block, as in `Step`.
    """
    s, stamps = tables.stream[0], samples.stamps
    if not s.open:
        s.open, s.last_ns, s.newest_ns = 1, stamps[0], stamps[0] - 1
        s.bin = stamps[0] // BIN_NS
    i = start
    while i < len(stamps):
        if s.stage == _CLOSED:
            _finish(tables, samples)
            s.stage = _STAMPED
        elif s.stage == _NEW:
            plain = _plain(s, tables.checks, samples, i, (s.bin + 1) * BIN_NS + k.mag_lag_ns)
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
