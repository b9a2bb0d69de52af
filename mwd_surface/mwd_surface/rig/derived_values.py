# SPDX-License-Identifier: Apache-2.0
"""Values for the rig that are derived from path, plan, control, advice and inputs, not measured by the tool."""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.unknown import or_none
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import GAMMA, ONE_SIDED, SATURATED, SOURCES
from mwd_surface.control.status import ControlStatus
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.inputs import HAND, SONDE, InputState, InputTable, Role
from mwd_surface.live.latest_values import Freshness
from mwd_surface.live.well_state import WellState
from mwd_surface.rig.value import Condition, RigValue
from mwd_surface.signals.table import FROM_ADVICE, FROM_CONTROL, FROM_LOG, FROM_PLAN
from mwd_surface.trajectory.advice import AdviceMode
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED, TIE_ON

# Age above which a gamma value is stale, s: over mud pulses a value takes up to one minute, or two minutes if a word is
# lost.
_LOG_STALE_S = 120.0
# Quality flags of a gamma sample whose value is not the mean gamma around the hole, with the sentence for the rig.
_DOUBTS = {
    SATURATED: "the detector is saturated: the gamma is higher than this",
    ONE_SIDED: "the detector looked to one side: not the mean around the hole",
}


def projection(state: WellState, now_ns: int) -> dict[str, RigValue]:
    """
    Return the values at the bit that are derived from path and plan, by name.

    The age of a value is the age of the path or of the offset from the plan.
    """
    path, values = state.path, {}
    beyond = path is not None and len(path.kind) > 0 and path.kind[-1] not in (TIE_ON, ASSUMED)
    for name in ("inclination", "azimuth"):
        value = float(getattr(path, name)[-1]) if beyond else None
        values[f"projected_{name}"] = _derived(value, state.age("path"), now_ns)
    for signal in FROM_PLAN:
        values[signal.name] = _derived(getattr(state.offset, signal.field, None), state.age("offset"), now_ns)
    doubt = _doubt(state)
    if doubt is None:
        return values
    good = {name for name, value in values.items() if value.condition == Condition.GOOD}
    # An assumed start of the path does not affect the directions of the hole.
    doubted = {name for name in good if doubt[0] != Condition.DOUBTFUL or not name.startswith("projected_")}
    return {
        k: dataclasses.replace(v, condition=doubt[0], reason=doubt[1]) if k in doubted else v for k, v in values.items()
    }


def _doubt(state: WellState) -> tuple[Condition, str] | None:
    """
    Return condition and reason of values at the bit that are stale or doubtful; None if they are good.

    Values are stale if the bit depth is old, and doubtful if the start of the path is assumed.
    """
    bit = state.rig.bit_depth
    if state.path is not None and state.path.kind[-1] == PROJECTED and bit.state == Freshness.STALE:
        return Condition.STALE, "projected to an old depth of the bit"
    if state.path is not None and state.path.assumed:
        return Condition.DOUBTFUL, f"assumed: {'; '.join(sentences(state.path.assumptions))}"
    return None


def control_values(control: ControlStatus, now_ns: int) -> dict[str, RigValue]:
    """Return the set-points in force and the limits, by name; a set-point is unknown while the driller has control."""
    waiting = RigValue(reason="the driller's" if control.enabled else "control is switched off")
    asked = {signal.name: getattr(control, signal.field) for signal in FROM_CONTROL}
    return {
        name: RigValue(value, Condition.GOOD, now_ns, 0.0) if value is not None and math.isfinite(value) else waiting
        for name, value in asked.items()
    }


def advice_values(state: WellState, now_ns: int) -> dict[str, RigValue]:
    """Return the values of the advice on the next interval, by name, with the age of the advice."""
    advice = state.advice
    slides = advice.mode == AdviceMode.SLIDE
    # Advice to rotate has no toolface, and its slide has no length: the slide ends at the start of the interval.
    bare = {} if slides else {"advised_toolface": math.nan, "advised_slide_to": advice.from_depth}
    table = {signal.name: getattr(advice, signal.field) for signal in FROM_ADVICE} | bare
    age = state.age("advice")
    values = {name: _derived(value, age, now_ns) for name, value in table.items()}
    reason = advice.reason or "no advice"
    values = {
        k: v if v.condition == Condition.GOOD else dataclasses.replace(v, reason=reason) for k, v in values.items()
    }
    face = values["advised_toolface"]
    values["advised_toolface"] = dataclasses.replace(face, sigma=or_none(advice.sigma)) if slides else face
    return values


def rig_input(inputs: InputTable) -> InputState | None:
    """
    Return the state of the rig data source in force, or else of the source with the highest priority that sends.

    The result is None if no source sends. A depth set by hand is not a rig source, even if it takes precedence.
    """
    rig = [row for row in inputs.inputs if row.priority > 0 and row.name != HAND and row.role != Role.SILENT]
    return min(rig, key=lambda row: (row.role != Role.IN_FORCE, row.priority), default=None)


def input_values(state: WellState, now_ns: int) -> dict[str, RigValue]:
    """Return the age of the depth, the difference between the depth sources, and the clock offsets, by name."""
    inputs, since = state.inputs, state.age("inputs") or 0.0
    waiting = {
        "depth_age": "no depth comes in",
        "depth_difference": "only one source of depth",
        "sonde_clock_offset": "nothing came from the sonde yet",
        "rig_clock_offset": "no rig data come in",
    }
    values = {name: RigValue(reason=reason) for name, reason in waiting.items()}
    stamp_ns = now_ns - round(since * NANOSECONDS)
    for name, number in (("depth_age", inputs.depth_age), ("depth_difference", inputs.depth_difference)):
        if math.isfinite(number):
            grown = number + since if name == "depth_age" else number
            values[name] = RigValue(grown, Condition.GOOD, stamp_ns, since)
    clocks = {"sonde_clock_offset": inputs.named(SONDE), "rig_clock_offset": rig_input(inputs)}
    for name, row in clocks.items():
        if row is not None and math.isfinite(row.clock_offset + row.offset_age):
            age = row.offset_age + since
            values[name] = RigValue(row.clock_offset, Condition.GOOD, now_ns - round(age * NANOSECONDS), age)
    return values


def log_values(state: WellState, now_ns: int) -> dict[str, RigValue]:
    """
    Return the newest natural gamma and the depth of its detector, with the age of the measurement.

    A gamma channel is recognized by its unit, which no other kind of log has. If several channels have this unit, the
    channel named `gamma` is used, or else the channel with the newest value.
    """
    unit = SOURCES[GAMMA].unit
    found = [(name == GAMMA, one.stamp_ns, name, one) for name, one in state.newest_logs.items() if one.unit == unit]
    newest = max(found)[-1] if found else None
    if newest is None:
        return {signal.name: RigValue(reason="no natural gamma with a depth yet") for signal in FROM_LOG}
    age = max(0.0, (now_ns - newest.stamp_ns) / NANOSECONDS)
    live = age <= _LOG_STALE_S
    doubt = "; ".join(reason for bit, reason in _DOUBTS.items() if newest.quality & bit)
    values = {}
    for signal in FROM_LOG:
        sigma = newest.sigma if signal.sigma and math.isfinite(newest.sigma) else None
        condition, reason = Condition.GOOD, ""
        if not live:
            condition, reason = Condition.STALE, f"measured {age:.0f} s ago"
        elif doubt and signal.sigma:
            condition, reason = Condition.DOUBTFUL, doubt
        values[signal.name] = RigValue(getattr(newest, signal.field), condition, newest.stamp_ns, age, sigma, reason)
    return values


def _derived(value: float | None, age: float | None, now_ns: int) -> RigValue:
    if value is None or age is None or not math.isfinite(value):
        return RigValue(reason="no survey and plan to compute it from")
    return RigValue(value, Condition.GOOD, now_ns - round(age * NANOSECONDS), age)
