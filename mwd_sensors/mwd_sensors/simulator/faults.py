# SPDX-License-Identifier: Apache-2.0
"""
Faults of sensors and of the connection, named as in PX4's failure injection.

PX4 words: ok: normal. off: nothing is published; one axis that is off reads zero with the covariance "not reported".
stuck: the last value is repeated. garbage: random numbers over the whole range. wrong: plausible but false values
(scaled and shifted). slow: a tenth of the rate. delayed: old values. intermittent: messages come and go.

Further words: a tool that was assembled wrongly (MOUNTING: axes swapped, flipped or turned, or another unit) and faulty
electronics (nan, saturated, repeated stamps). The connection (`MessageFaults`) can lose, duplicate and reorder samples,
and the clock can jump.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Indices, Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

PX4 = ("ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
# Axes of the sensor exchanged (xy, yz, xz), reversed, or turned by 90 deg about an axis; or another unit (`_UNITS`).
MOUNTING = ("swapped", "flipped", "turned", "in_g", "in_deg_s", "in_ut", "in_mt", "in_gauss", "in_nt")
ELECTRONICS = ("nan", "saturated", "repeated_stamps")
WORDS = (*PX4, *MOUNTING, *ELECTRONICS)
# Component -> (topic, field).
COMPONENTS = {
    "gyro": ("imu/data_raw", "angular_velocity"),
    "accel": ("imu/data_raw", "linear_acceleration"),
    "mag": ("imu/mag", "magnetic_field"),
    "precision_gyro": ("gyro/data_raw", "angular_velocity"),
    "precision_accel": ("gyro/data_raw", "linear_acceleration"),
    "temperature": ("imu/temperature", "temperature"),
}
AXES = ("all", "x", "y", "z", "xy", "yz", "xz")
# Faults that affect whole messages and not single axes.
_OF_MESSAGES = ("slow", "delayed", "intermittent", "repeated_stamps")
# Word -> (field that the fault applies to, factor on the SI value).
_UNITS = {
    "in_g": ("linear_acceleration", 1.0 / STANDARD_GRAVITY),
    "in_deg_s": ("angular_velocity", math.degrees(1.0)),
    "in_ut": ("magnetic_field", 1e6),
    "in_mt": ("magnetic_field", 1e3),
    "in_gauss": ("magnetic_field", 1e4),
    "in_nt": ("magnetic_field", 1e9),
}
# Largest magnitude of the random values of `garbage`, rad/s, m/s^2, T and degC.
_GARBAGE = {
    "angular_velocity": 35.0,
    "linear_acceleration": 160.0,
    "magnetic_field": 8e-4,
    "temperature": 200.0,
}
# Readings of a saturated sensor, the limits of usual ranges: 2000 deg/s, 16 g, 800 uT, 125 degC.
_LIMIT = {
    "angular_velocity": math.radians(2000.0),
    "linear_acceleration": 16.0 * STANDARD_GRAVITY,
    "magnetic_field": 8e-4,
    "temperature": 125.0,
}
# Scale factor and shift of `wrong`; shift in rad/s, m/s^2, T and degC.
_WRONG = {
    "angular_velocity": (1.05, 0.05),
    "linear_acceleration": (1.02, 0.2),
    "magnetic_field": (1.03, 2e-6),
    "temperature": (1.0, 30.0),
}


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault of one component."""

    component: str = setting(doc="Component that fails.", choices=tuple(COMPONENTS))
    fault: str = setting(doc="Kind of failure.", choices=WORDS)
    axis: str = setting("all", "Axis that fails.", choices=AXES)
    start_s: float = setting(0.0, "Time of the run at which the fault begins.", low=0.0, high=1e9)
    seconds: float = setting(1e9, "Duration of the fault.", unit="s", low=0.0, high=1e9)
    delay_s: float = setting(0.5, "Age of the values of a delayed sensor.", low=0.0, high=30.0)


@dataclasses.dataclass(frozen=True)
class MessageFaults:
    """Losses and other faults of the messages between sensor and log."""

    loss: float = setting(0.0, "Share of the samples that are lost.", low=0.0, high=1.0)
    burst_every_s: float = setting(0.0, "Mean time between bursts of loss. 0: no bursts.", low=0.0, high=1e6)
    burst_s: float = setting(0.5, "Duration of a burst of loss.", low=0.0, high=600.0)
    duplicates: float = setting(0.0, "Share of the samples that are sent twice.", low=0.0, high=1.0)
    reorder: float = setting(0.0, "Share of the samples that change places with the next sample.", low=0.0, high=1.0)
    clock_jump_at_s: float = setting(0.0, "Time of the run at which the sonde's clock jumps.", low=0.0, high=1e9)
    clock_jump_s: float = setting(
        0.0, "Size of the jump of the sonde's clock, forward if positive. 0: no jump.", low=-1e9, high=1e9
    )


def check(fault: Fault) -> None:
    """Raise ValueError if the fault does not fit its component, or needs other axes; the message says why."""
    if fault.axis != "all" and fault.component == "temperature":
        raise ValueError(f"the temperature sensor has no axes: axis must be 'all', not {fault.axis!r}")
    if fault.axis != "all" and fault.fault in _OF_MESSAGES:
        raise ValueError(f"fault {fault.fault!r} concerns whole messages: axis must be 'all', not {fault.axis!r}")
    if fault.component == "temperature" and fault.fault in MOUNTING:
        raise ValueError(f"fault {fault.fault!r}: a temperature sensor has no axes and no other unit")
    field = COMPONENTS[fault.component][1]
    if fault.fault in _UNITS and _UNITS[fault.fault][0] != field:
        fitting = [word for word, (its_field, _) in _UNITS.items() if its_field == field]
        raise ValueError(
            f"fault {fault.fault!r} is not a unit of component {fault.component!r}; use {', '.join(fitting)}"
        )
    if fault.fault in _UNITS and fault.axis != "all":
        raise ValueError(f"fault {fault.fault!r} concerns all axes: axis must be 'all', not {fault.axis!r}")
    if (fault.fault == "swapped") != (len(fault.axis) == 2):
        raise ValueError(f"fault {fault.fault!r}: two axes (xy, yz, xz) go with 'swapped' and only with it")
    if fault.fault == "turned" and fault.axis == "all":
        raise ValueError("fault 'turned': axis must be x, y or z: the axis of the turn")


@dataclasses.dataclass
class FaultState:
    """Faults of a simulation, their random numbers, and the earlier values that stuck and delayed sensors repeat."""

    faults: list[Fault]
    rngs: dict[str, np.random.Generator]
    held: dict[tuple[str, str], NDArray[np.float64]] = dataclasses.field(default_factory=dict)
    seen: dict[str, int] = dataclasses.field(default_factory=dict)
    past: dict[tuple[str, str], NDArray[np.float64]] = dataclasses.field(default_factory=dict)


def start(faults: Iterable[Fault], rng: np.random.Generator) -> FaultState:
    """Return the state of the faults at time zero; each topic has a random stream of its own."""
    topics = sorted({topic for topic, _ in COMPONENTS.values()})
    return FaultState(list(faults), dict(zip(topics, rng.spawn(len(topics)), strict=True)))


def spoil(
    state: FaultState, topic: str, samples: Samples, t: NDArray[np.float64]
) -> tuple[Samples, NDArray[np.float64]]:
    """
    Apply the faults in force to the samples of one topic; return the published samples and their times.

    t, shape (n,), is the simulation time of each sample, s. The result does not depend on the length of the blocks.
    """
    count = state.seen.get(topic, 0)
    state.seen[topic] = count + len(samples)
    if not state.faults:
        return samples, t
    keep = np.ones(len(samples), dtype=bool)
    index = count + np.arange(len(samples))
    copied = False
    for fault in state.faults:
        its_topic, field = COMPONENTS[fault.component]
        if its_topic != topic or fault.fault == "ok":
            continue
        hit = (t >= fault.start_s) & (t < fault.start_s + fault.seconds)
        remember = fault.fault in ("stuck", "delayed", "repeated_stamps")
        if not hit.any() and not remember:
            continue
        if not copied:
            samples, copied = samples.copy(), True
        values = samples[field].reshape(len(samples), -1)
        if _stops(fault, field):
            keep &= ~hit | _published(fault, t, index)
        else:
            _change(state, fault, samples, values, t, hit)
        samples[field] = values.reshape(samples[field].shape)
    return (samples, t) if keep.all() else (samples[keep], t[keep])


def _stops(fault: Fault, field: str) -> bool:
    """Return whether a fault suppresses whole messages instead of changing their values."""
    if fault.fault == "off":
        return fault.axis == "all" and field not in ("angular_velocity", "linear_acceleration")
    return fault.fault in ("slow", "intermittent")


def _published(fault: Fault, t: NDArray[np.float64], index: Indices) -> NDArray[np.bool_]:
    """Return which messages are published in spite of a fault that suppresses messages, shape (n,)."""
    if fault.fault == "slow":
        return np.asarray(index % 10 == 0)
    if fault.fault == "intermittent":
        # Messages come for about half a second and stop for about half a second, irregularly.
        return np.asarray(np.sin(2.0 * math.pi * t) + np.sin(2.0 * math.pi * 0.37 * t) > 0.0)
    return np.zeros(len(t), dtype=bool)


def _change(
    state: FaultState,
    fault: Fault,
    samples: Samples,
    values: NDArray[np.float64],
    t: NDArray[np.float64],
    hit: NDArray[np.bool_],
) -> None:
    """Change values, shape (n, axes), and for some faults stamps and covariances, of the samples in `hit`."""
    topic, field = COMPONENTS[fault.component]
    at = "xyz".find(fault.axis[0])
    axes = slice(at, at + 1) if len(fault.axis) == 1 else slice(None)
    if fault.fault == "off":
        values[hit, axes] = 0.0
        samples[field + "_covariance"][hit, 0] = -1.0
    elif fault.fault == "stuck":
        _stick(state, fault, values, axes, hit)
    elif fault.fault == "garbage":
        draw = state.rngs[topic].uniform(-1.0, 1.0, size=values[hit, axes].shape)
        values[hit, axes] = _GARBAGE[field] * draw
    elif fault.fault == "wrong":
        factor, shift = _WRONG[field]
        values[hit, axes] = factor * values[hit, axes] + shift
    elif fault.fault in MOUNTING:
        values[hit] = values[hit] @ mounting(fault).T
    elif fault.fault == "nan":
        values[hit, axes] = math.nan
    elif fault.fault == "saturated":
        values[hit, axes] = np.copysign(_LIMIT[field], values[hit, axes])
    elif fault.fault == "repeated_stamps":
        _repeat(state, fault, samples, hit)
    else:
        _delay(state, fault, values, t, hit)


def mounting(fault: Fault) -> NDArray[np.float64]:
    """Return the matrix of a fault of MOUNTING, shape (3, 3): reported = matrix @ true."""
    matrix = np.eye(3)
    at = "xyz".find(fault.axis[0])
    if fault.fault == "swapped":
        pair = ["xyz".index(axis) for axis in fault.axis]
        matrix[pair] = matrix[pair[::-1]]
    elif fault.fault == "flipped":
        matrix *= -1.0 if fault.axis == "all" else np.where(np.arange(3) == at, -1.0, 1.0)[:, None]
    elif fault.fault == "turned":
        # Turn by 90 deg, right-handed: for axis x, y turns to z and z to -y; other axes cyclically.
        first, second = (at + 1) % 3, (at + 2) % 3
        matrix[first, first] = matrix[second, second] = 0.0
        matrix[second, first], matrix[first, second] = 1.0, -1.0
    else:
        matrix *= _UNITS[fault.fault][1]
    return matrix


def _repeat(state: FaultState, fault: Fault, samples: Samples, hit: NDArray[np.bool_]) -> None:
    """Give the second of each two samples in `hit` the stamp of the first, so that every stamp occurs twice."""
    key = (fault.component, f"stamp{fault.start_s}")
    for k in range(len(samples)):
        held = state.held.get(key)
        if hit[k] and held is not None:
            samples["stamp_ns"][k] = np.int64(held[0]) * 1_000_000_000 + np.int64(held[1])
            del state.held[key]
        elif hit[k]:
            # Seconds and nanoseconds are stored separately, because a double cannot hold a whole stamp.
            state.held[key] = np.array(divmod(int(samples["stamp_ns"][k]), 1_000_000_000), dtype=np.float64)


def _stick(state: FaultState, fault: Fault, values: NDArray[np.float64], axes: slice, hit: NDArray[np.bool_]) -> None:
    key = (fault.component, f"{fault.axis}{fault.start_s}")
    for k in range(len(values)):
        if hit[k] and key in state.held:
            values[k, axes] = state.held[key]
        elif not hit[k] or key not in state.held:
            state.held[key] = values[k, axes].copy()


def _delay(
    state: FaultState, fault: Fault, values: NDArray[np.float64], t: NDArray[np.float64], hit: NDArray[np.bool_]
) -> None:
    key = (fault.component, f"{fault.start_s}")
    fresh = np.column_stack([t, values])
    past = np.vstack([state.past[key], fresh]) if key in state.past else fresh
    # Use the newest sample that is older than the delay; before such a sample exists, use the oldest sample.
    rows = np.searchsorted(past[:, 0], t - fault.delay_s + 1e-9, side="right") - 1
    values[hit] = past[np.maximum(rows, 0)][hit, 1:]
    state.past[key] = past[past[:, 0] > t[-1] - fault.delay_s - 1.0] if len(t) else past


@dataclasses.dataclass
class LinkState:
    """State of the connection of one topic."""

    link: MessageFaults
    rng: np.random.Generator
    burst_start: float = math.inf  #: simulation time of the present or next interval without messages, s
    waiting: Samples | None = None  #: message that the next message will overtake; None if there is none


def start_link(link: MessageFaults, rng: np.random.Generator) -> LinkState:
    """Return the state of one topic's connection at time zero."""
    first = float(rng.exponential(link.burst_every_s)) if link.burst_every_s else math.inf
    return LinkState(link, rng, first)


def carry(state: LinkState, samples: Samples, t: NDArray[np.float64]) -> tuple[Samples, NDArray[np.float64]]:
    """
    Apply the connection to samples: lose, duplicate or reorder them; return the arriving samples and their times.

    t, shape (n,), is the simulation time, s. Random numbers are drawn per sample, so that the result does not depend on
    the length of the blocks.
    """
    link = state.link
    if not (link.loss or link.burst_every_s or link.duplicates or link.reorder):
        return samples, t
    out: list[Samples] = []
    when: list[float] = []
    for k in range(len(samples)):
        one = samples[k : k + 1]
        fate = state.rng.random(3)
        while t[k] >= state.burst_start + link.burst_s:
            state.burst_start += link.burst_s + float(state.rng.exponential(link.burst_every_s))
        if fate[0] < link.loss or t[k] >= state.burst_start:
            continue
        if state.waiting is None and fate[2] < link.reorder:
            state.waiting = one
            continue
        arrived = [one, one] if fate[1] < link.duplicates else [one]
        if state.waiting is not None:
            arrived.append(state.waiting)
            state.waiting = None
        out.extend(arrived)
        when.extend([float(t[k])] * len(arrived))
    return (np.concatenate(out) if out else samples[:0]), np.array(when)


def jumped(link: MessageFaults, stamp_ns: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return stamps, ns, shape (n,), with the jump of the clock added; t, shape (n,), is the simulation time, s."""
    if not link.clock_jump_s:
        return stamp_ns
    jump = np.int64(round(link.clock_jump_s * 1e9))
    return np.where(t >= link.clock_jump_at_s, stamp_ns + jump, stamp_ns)
