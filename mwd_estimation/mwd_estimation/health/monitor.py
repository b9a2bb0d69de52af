"""
Health of the sensors from their own samples: what is wrong, with which sensor and axis, and since when.

Samples are judged half second by half second (`signal_checks`), once the magnetic samples of the same time are there.
Windows of three seconds are judged for units, axes and signs (`window_checks`): while these are not known, once a
minute, and whenever gravity, field or dip do not come out as expected. `fault_debounce` makes faults of what they see.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.health import fault_debounce, motion_window, signal_checks
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, OK, UNKNOWN, observe, weigh
from mwd_estimation.health.motion_window import CARRIED, PARTS, Consistency, Expected, Samples, Window
from mwd_estimation.health.sensor_fault import GYRO, FaultCode, SensorFault
from mwd_estimation.health.signal_checks import BIN_NS, Pace, SignalLimits
from mwd_estimation.health.window_checks import BROKEN, CLIPPED, WindowJudge, WindowLimits
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

# Moving windows that are judged in vain, one after the other; from then on one each minute, ns.
_MINUTE_NS, _IN_VAIN = 60_000_000_000, 20
# Turn of a window that may show axes, rad.
_MOVES = 0.5
# A stamp so much before the others begins anew, ns.
_BACK_NS = 1_000_000_000
# Samples that wait at most, where time stands still.
_MOST_WAITING = 16384
# Stamps that do not advance count two for the fault, those that do one against it.
_STAMP_FAULT, _STAMP_MOST = 200, 400
# Intervals that the sample rate is learned from, at least; and how long and short ones are off it.
_LEARN, _LONG, _SHORT = 12, 1.4, 0.7
# Readings count as the end of the range from so close to it.
_AT_RANGE = 0.9995
# The checks of windows, from and to before.
_WINDOW_CODES = int(FaultCode.UNIT), int(FaultCode.REST_RATE)
# Where a call of the kernel stands: at a new sample, behind the check of its stamp, behind a half second.
_NEW, _STAMPED, _CLOSED = 0, 1, 2


@dataclasses.dataclass(frozen=True)
class Params:
    """
    Parameters of the health checks.

    Attributes
    ----------
    watch : bool
        False: no fault is named.
    gyro_range_deg_s, accel_range_g, mag_range_ut : float
        Ends of the ranges; 0: not known, clipping is not seen.
    mag_lag_s : float
        Time that IMU samples wait for magnetic ones of their time; each fault is named later by as much.
    mag_expected : bool
        A magnetometer belongs to the tool: a missing one is a warning.
    """

    watch: bool = True
    gyro_range_deg_s: float = 2000.0
    accel_range_g: float = 16.0
    mag_range_ut: float = 800.0
    mag_lag_s: float = 0.05
    mag_expected: bool = True


class Stream:
    """Where the stream of samples stands: half second, window, pace, and what must not be used."""

    stage: int
    open: int
    bin: int
    first: int
    stop: int
    mag_first: int
    last_ns: int
    newest_ns: int
    stamp_score: int
    period: float
    mag_came: int
    doubt_left: Annotated[Indices, 3]
    doubtful: int
    window: Annotated[Indices, 3]
    window_ns: int
    judged_ns: int
    in_vain: int
    broken: int
    judge: int
    end_ns: int
    unusable: int
    suspect: int


STREAM = dtype_of(Stream)


class Limits(NamedTuple):
    """Limits of all checks of one unit."""

    signal: SignalLimits = SignalLimits()
    consistency: Consistency = Consistency()
    window: WindowLimits = WindowLimits()


LIMITS = Limits()


class _Kernel(NamedTuple):
    """What does not change: limits of the checks and ends of the ranges."""

    signal: SignalLimits
    consistency: Consistency
    ranges: Array
    lag_ns: int
    mag_expected: bool


class _Tables(NamedTuple):
    """All arrays that change: checks, channels, stream (1), carried window (1), its steps."""

    checks: Any
    channels: Any
    stream: Any
    carried: Any
    steps: Any


@dataclasses.dataclass
class State:
    """All that changes; `copy` gives an independent one. `samples`: those not judged yet."""

    tables: _Tables
    expected: Expected
    samples: Samples

    def copy(self) -> State:
        """An independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Step:
    """
    What one block gave.

    Attributes
    ----------
    unusable : ndarray of uint8, shape (n,)
        Bits GYRO, ACCEL, MAG as known at each sample of the block.
    suspect : ndarray of uint8, shape (n,)
        Bits of the sensors that something speaks against at that sample, though it is no fault yet.
    changes : list of SensorFault
        Faults found, narrowed down or cleared, in order.
    places : list of int
        Sample of the block that brought each change.
    """

    unusable: NDArray[np.uint8]
    suspect: NDArray[np.uint8]
    changes: list[SensorFault]
    places: list[int]


def initial(
    params: Params, gravity: float | None = None, total: float | None = None, dip: float | None = None
) -> State:
    """State before the first sample; reference gravity, m/s^2, field, T, and dip, rad, where known."""
    del params
    tables = _Tables(
        fault_debounce.blank(),
        signal_checks.blank(),
        np.zeros(1, dtype=STREAM),
        np.zeros(1, dtype=CARRIED),
        np.zeros(motion_window.ROWS, dtype=motion_window.STEP),
    )
    empty = np.zeros(0, dtype=np.int64)
    nothing = np.zeros((0, 3))
    state = State(tables, Expected(0.0, 0.0, 0.0), Samples(empty, nothing, nothing, empty, nothing))
    set_reference(state, gravity, total, dip)
    return state


def set_reference(state: State, gravity: float | None, total: float | None, dip: float | None) -> None:
    """Judge totals and dip by this from now on; None where unknown. m/s^2, T, rad."""
    state.expected = Expected(
        STANDARD_GRAVITY if gravity is None else float(gravity),
        math.nan if total is None else float(total),
        math.nan if dip is None else float(dip),
    )


def push_mag(state: State, stamp_ns: ArrayLike, b_t: ArrayLike) -> None:
    """
    Take magnetic samples, not only the good ones: shapes (n,) and (n, 3), T. To be pushed before the IMU of their time.

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    field = np.ascontiguousarray(b_t, dtype=np.float64)
    if field.shape != (*stamps.shape, 3) or stamps.ndim != 1:
        raise ValueError(f"b_t: expected shape ({stamps.size}, 3) beside stamps (n,), got {field.shape}")
    held = state.samples
    state.samples = held._replace(mag_ns=_joined(held.mag_ns, stamps), mag=_joined(held.mag, field))


def run(
    params: Params,
    state: State,
    stamp_ns: ArrayLike,
    gyro_t: ArrayLike,
    accel_t: ArrayLike,
    limits: Limits = LIMITS,
) -> Step:
    """
    Take a block of IMU samples of any length; the state changes in place.

    Parameters
    ----------
    params : Params
    state : State
    stamp_ns : array_like of int64, shape (n,)
    gyro_t, accel_t : array_like, shape (n, 3)
        rad/s and m/s^2 as they come, not finite ones too.
    limits : Limits

    Raises
    ------
    ValueError
        Shapes that do not match.
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    gyro, accel = (np.ascontiguousarray(block, dtype=np.float64) for block in (gyro_t, accel_t))
    for name, block in (("gyro_t", gyro), ("accel_t", accel)):
        if block.shape != (*stamps.shape, 3) or stamps.ndim != 1:
            raise ValueError(f"{name}: expected shape ({stamps.size}, 3) beside stamps (n,), got {block.shape}")
    step = Step(np.zeros(len(stamps), dtype=np.uint8), np.zeros(len(stamps), dtype=np.uint8), [], [])
    if not params.watch or not len(stamps):
        return step
    kernel = _kernel(params, limits)
    held, tables = state.samples, state.tables
    at = offset = len(held.stamps)
    samples = Samples(
        _joined(held.stamps, stamps), _joined(held.gyro, gyro), _joined(held.accel, accel), held.mag_ns, held.mag
    )
    while at < len(samples.stamps):
        at = _run(kernel, tables, state.expected, samples, at, offset, step.unusable, step.suspect)
        if at < len(samples.stamps):
            step.changes.extend(_after_bin(state, limits.window))
            step.places.extend([at - offset] * (len(step.changes) - len(step.places)))
    stream = tables.stream[0]
    used, mag_used = int(stream.first), int(stream.mag_first)
    state.samples = Samples(
        samples.stamps[used:].copy(),
        samples.gyro[used:].copy(),
        samples.accel[used:].copy(),
        samples.mag_ns[mag_used:].copy(),
        samples.mag[mag_used:].copy(),
    )
    stream.first, stream.mag_first = 0, 0
    stream.stop -= used
    return step


def _joined(held: NDArray[Any], more: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([held, more]) if len(held) else more


def _kernel(params: Params, limits: Limits) -> _Kernel:
    ranges = _AT_RANGE * np.array(
        [math.radians(params.gyro_range_deg_s), params.accel_range_g * STANDARD_GRAVITY, params.mag_range_ut * 1e-6]
    )
    ranges[ranges == 0.0] = math.inf
    return _Kernel(limits.signal, limits.consistency, ranges, round(params.mag_lag_s * 1e9), params.mag_expected)


def _after_bin(state: State, limits: WindowLimits) -> list[SensorFault]:
    """Faults that changed; judges the window first where that is asked for."""
    tables, stream = state.tables, state.tables.stream[0]
    now = int(stream.end_ns)
    changes = fault_debounce.take_changes(tables.checks, now)
    if stream.judge:
        stream.judge = 0
        steps = tables.steps[: int(tables.carried[0].steps)]
        window = Window(steps, int(stream.window_ns), 1e-9 * (now - int(stream.window_ns)))
        WindowJudge(limits, state.expected, window, stream.window, tables.checks).judge()
        stream.doubtful |= fault_debounce.suspected(tables.checks)
        if tables.carried[0].parts == PARTS:
            if tables.checks[FaultCode.AXES, 0].seen >= AGAINST:
                stream.in_vain = 0
            elif window.path > _MOVES:
                stream.in_vain += 1
            stream.judged_ns = now
            weigh(tables.checks)
            stream.unusable = fault_debounce.unusable(tables.checks)
            changes += fault_debounce.take_changes(tables.checks, now)
        else:
            # What a part of the window shows raises a doubt and does not count for a fault.
            tables.checks["seen"] = fault_debounce.NOTHING
    return changes


def faults(state: State) -> list[SensorFault]:
    """Every fault that stands now."""
    return fault_debounce.standing(state.tables.checks)


def known(state: State) -> dict[str, int]:
    """Whether units, axes and signs are UNKNOWN, OK or a FAULT."""
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
def _judge_stamp(s: Any, checks: Any, stamp: int) -> int:
    """Judge a stamp as it comes: whatever waits for its time needs them to advance."""
    good = stamp > s.newest_ns
    s.newest_ns = stamp
    s.stamp_score = min(max(s.stamp_score + (-1 if good else 2), 0), _STAMP_MOST)
    check = checks[FaultCode.STAMPS, 0]
    bad = s.stamp_score >= _STAMP_FAULT and not good and check.state != FAULT
    if not bad and (s.stamp_score > 0 or check.state == OK):
        return 0
    observe(check, FOR if bad else AGAINST, stamp, 1.0 * s.stamp_score, 1.0 * _STAMP_FAULT)
    return int(weigh(checks))


@compiled
def _pace(s: Any, samples: Samples) -> Pace:
    """Counts of the half second that waits to be judged; learns the rate from the first with enough intervals."""
    if s.period == 0.0 and s.stop - s.first > _LEARN:
        # Not the middle one, as a third of the samples may be lost.
        s.period = 1e-9 * np.sort(np.diff(samples.stamps[s.first : s.stop]))[(s.stop - s.first) // 3]
    steps, long, short = 0, 0, 0
    for i in range(s.first, s.stop):
        interval = samples.stamps[i] - s.last_ns
        if 0 < interval < BIN_NS:
            steps += 1
            long += int(1e-9 * interval > _LONG * s.period)
            short += int(1e-9 * interval < _SHORT * s.period)
        if interval > 0 or interval < -_BACK_NS:
            s.last_ns = samples.stamps[i]
    return Pace(steps, long, short, s.stop - s.first)


@compiled
def _judge_silence(k: _Kernel, s: Any, tables: _Tables, began: int) -> None:
    """Whether magnetic samples come."""
    channels, checks = tables.channels, tables.checks
    if channels[6].n + channels[6].not_finite > 0:
        s.mag_came = 1
        observe(checks[FaultCode.NEVER_CAME, 6], AGAINST, began, 0.0, 0.0)
        observe(checks[FaultCode.SILENT, 6], AGAINST, began, 0.0, 0.0)
    elif k.mag_expected:
        code = FaultCode.SILENT if s.mag_came else FaultCode.NEVER_CAME
        observe(checks[code, 6], FOR, began, 0.0, 0.0)


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
def _due(k: _Kernel, s: Any, tables: _Tables, expected: Expected, full: bool) -> bool:
    """Whether the window is to be judged: it is not as expected, or whole and something of it open."""
    carried, checks = tables.carried[0], tables.checks
    if not motion_window.consistent(k.consistency, expected, carried, 1e-9 * (s.end_ns - s.window_ns)):
        return True
    if not full:
        return False
    for code in range(_WINDOW_CODES[0], _WINDOW_CODES[1]):
        for place in range(7):
            check = checks[code, place]
            if check.votes_for > 0 or check.state == FAULT:
                return True
    if carried.path < _MOVES:
        return bool(s.judged_ns == 0)
    unknown = checks[FaultCode.AXES, 0].state == UNKNOWN or checks[FaultCode.UNIT, 0].state == UNKNOWN
    return bool(unknown and (s.in_vain < _IN_VAIN or s.end_ns - s.judged_ns >= _MINUTE_NS))


@compiled
def _close(k: _Kernel, tables: _Tables, expected: Expected, samples: Samples, broken: bool) -> bool:
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
    pace = _pace(s, samples)
    s.mag_first = used
    for sensor in range(3):
        s.window[sensor] = max(s.window[sensor], _spoils(channels, sensor))
    _judge_silence(k, s, tables, began)
    late = signal_checks.judge_stream(k.signal, checks, channels, pace, s.period, began)
    s.doubtful = signal_checks.judge_bin(k.signal, checks, channels, k.ranges, began)
    if late or checks[FaultCode.STAMPS, 0].state == FAULT:
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
def _finish(tables: _Tables, samples: Samples) -> None:
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
    if s.stamp_score > 0 or checks[FaultCode.STAMPS, 0].state != OK:
        return start
    stop = min(len(samples.stamps), s.first + _MOST_WAITING)
    while i < stop and newest < samples.stamps[i] < until:
        newest = samples.stamps[i]
        i += 1
    s.newest_ns = newest
    return i


@compiled
def _ready(k: _Kernel, s: Any, samples: Samples, i: int) -> bool:
    """Whether sample i closes the half second: its magnetic samples are there, or time has gone back."""
    stamps, end = samples.stamps, (s.bin + 1) * BIN_NS
    if stamps[i] < s.bin * BIN_NS - _BACK_NS or i - s.first >= _MOST_WAITING:
        s.stop = i
        return True
    if stamps[i] < end + k.lag_ns:
        return False
    while s.stop < i and stamps[s.stop] < end:
        s.stop += 1
    return bool(stamps[s.stop] >= end)


@compiled
def _run(
    k: _Kernel, tables: _Tables, expected: Expected, samples: Samples, start: int, offset: int,
    unusable: NDArray[np.uint8], suspect: NDArray[np.uint8],
) -> int:  # fmt: skip
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
            if _judge_stamp(s, tables.checks, stamps[i]):
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
