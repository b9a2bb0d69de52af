# SPDX-License-Identifier: Apache-2.0
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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core.sensor_fault import FaultCode, SensorFault
from mwd_estimation.core.track import AT_RANGE
from mwd_estimation.health import fault_debounce, motion_window, replayed_samples, sample_stream, signal_checks
from mwd_estimation.health.carried_vectors import Window
from mwd_estimation.health.fault_debounce import weigh
from mwd_estimation.health.motion_window import CARRIED, PARTS, Consistency, Expected, Samples
from mwd_estimation.health.sample_stream import Kernel, Tables
from mwd_estimation.health.signal_checks import SignalLimits
from mwd_estimation.health.stream_checks import STREAM
from mwd_estimation.health.window_checks import WindowJudge, WindowLimits
from mwd_sensors.core.constants import STANDARD_GRAVITY


@dataclasses.dataclass(frozen=True)
class Params:
    """Parameters of the health checks."""

    watch: bool = True  #: false: no fault is named
    #: `gyro_range_deg_s`, `accel_range_g`, `mag_range_ut`: ends of the ranges; 0: not known, clipping is not seen.
    gyro_range_deg_s: float = 2000.0
    accel_range_g: float = 16.0
    mag_range_ut: float = 800.0
    #: Time that IMU samples wait for magnetic ones of their time; each fault is named later by as much.
    mag_lag_s: float = 0.05
    mag_expected: bool = True  #: a magnetometer belongs to the tool: a missing one is a warning


class HealthLimits(NamedTuple):
    """Limits of all checks of one unit."""

    signal: SignalLimits = SignalLimits()
    consistency: Consistency = Consistency()
    window: WindowLimits = WindowLimits()


LIMITS = HealthLimits()


@dataclasses.dataclass
class State:
    """All that changes; `copy` gives an independent one. `samples`: those not judged yet."""

    tables: Tables
    expected: Expected
    samples: Samples

    def copy(self) -> State:
        """Make an independent copy."""
        return copy.deepcopy(self)


@dataclasses.dataclass(frozen=True)
class Step:
    """What one block gave."""

    unusable: NDArray[np.uint8]  #: uint8, shape (n,); bits GYRO, ACCEL, MAG as known at each sample of the block
    #: uint8, shape (n,); bits of the sensors that something speaks against at that sample, though it is no fault yet.
    suspect: NDArray[np.uint8]
    changes: list[SensorFault]  #: faults found, narrowed down or cleared, in order
    places: list[int]  #: sample of the block that brought each change


def initial(
    params: Params, gravity: float | None = None, total: float | None = None, dip: float | None = None
) -> State:
    """State before the first sample; reference gravity, m/s^2, field, T, and dip, rad, where known."""
    del params
    tables = Tables(
        fault_debounce.blank(),
        signal_checks.blank(),
        np.zeros(1, dtype=STREAM),
        np.zeros(1, dtype=CARRIED),
        np.zeros(motion_window.ROWS, dtype=motion_window.STEP),
        replayed_samples.blank(),
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
    limits: HealthLimits = LIMITS,
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
    limits : HealthLimits

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
    constants = _constants(params, limits)
    held, tables = state.samples, state.tables
    at = offset = len(held.stamps)
    samples = Samples(
        _joined(held.stamps, stamps), _joined(held.gyro, gyro), _joined(held.accel, accel), held.mag_ns, held.mag
    )
    while at < len(samples.stamps):
        at = sample_stream.run(constants, tables, state.expected, samples, at, offset, step.unusable, step.suspect)
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


def _constants(params: Params, limits: HealthLimits) -> Kernel:
    ranges = AT_RANGE * np.array(
        [math.radians(params.gyro_range_deg_s), params.accel_range_g * STANDARD_GRAVITY, params.mag_range_ut * 1e-6]
    )
    ranges[ranges == 0.0] = math.inf
    return Kernel(limits.signal, limits.consistency, ranges, round(params.mag_lag_s * 1e9), params.mag_expected)


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
            stream.in_vain += int(window.path > sample_stream.MOVES)
            stream.judged_ns = now
            weigh(tables.checks)
            stream.unusable = fault_debounce.unusable(tables.checks)
            changes += fault_debounce.take_changes(tables.checks, now)
        else:
            # What a part of the window shows raises a doubt and does not count for a fault.
            tables.checks["seen"] = fault_debounce.NOTHING
    return changes


def shift_mag(state: State, late_ns: int) -> None:
    """Correct the stamps of magnetic samples that wait: they are late by so much, ns."""
    state.samples = state.samples._replace(mag_ns=state.samples.mag_ns - late_ns)


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
