# SPDX-License-Identifier: Apache-2.0
"""
Values that the rig interfaces send, in one frozen table, each with its age, sigma and condition.

A value that is not good keeps the last known number and has a reason; no value is ever NaN. Units are SI and rad; each
interface converts to its own units.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence

from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.unknown import or_none
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import GAMMA, ONE_SIDED, SATURATED, SOURCES
from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.control.status import ControlStatus
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.alarms import Alarm
from mwd_surface.live.inputs import HAND, SONDE, InputState, InputTable, Role
from mwd_surface.live.latest_values import Freshness, LiveValue, StreamState
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.live.well_state import Angle, WellState
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.signals.table import (
    FROM_ADVICE,
    FROM_CONTROL,
    FROM_LOG,
    FROM_PLAN,
    FROM_TOOL,
    OF_SURVEY,
    TO_RIG,
    Signal,
    page_fields,
)
from mwd_surface.trajectory.advice import Advice, AdviceMode
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED, TIE_ON


class Condition(enum.Enum):
    """Usability of a value, from best to worst; the value of each member is its text for users."""

    GOOD = "good"
    OVERRIDE = "override"
    DOUBTFUL = "doubtful"
    STALE = "stale"
    WAITING = "waiting"
    FAULT = "fault"
    NO_LINK = "no link"
    INACTIVE = "inactive"

    @property
    def usable(self) -> bool:
        """Whether the number is a current value that may be used."""
        return self in (Condition.GOOD, Condition.OVERRIDE, Condition.DOUBTFUL)


@dataclasses.dataclass(frozen=True)
class RigValue:
    """One value for the rig, with its condition."""

    value: float = 0.0  #: the last known number, or 0, if `condition` is not usable
    condition: Condition = Condition.WAITING
    stamp_ns: int = 0  #: time of the measurement, ns since the epoch, 0 if nothing was measured
    age: float | None = None  #: age of the measurement, s; None if nothing was measured
    sigma: float | None = None  #: 1 sigma in the unit of the value; None if unknown
    reason: str = ""
    #: Time of the measurement by the clock of the well, s; None if it is not known by this clock.
    at: float | None = None
    exact: bool = False  #: whether `stamp_ns` is the stamp of the sample; otherwise it was computed from `at`


# Sentence for the rig about each status flag that the signal table names as a doubt.
_DOUBTS = {
    Status.ROTATING: "the string rotates: the toolface is only a momentary value",
    Status.TOOLFACE_UNSETTLED: "the string has turned lately: it may be sticking",
    Status.MAG_DISTURBED: "the magnetic field is off its reference",
    Status.CORRECTION_REFUSED: "interference cannot be corrected at this attitude",
    Status.UNCORRECTED: "not corrected for interference",
    Status.ALIASED: "vibration aliases into the samples",
    Status.CLIPPED: "a sensor is at its limit",
}


@dataclasses.dataclass(frozen=True)
class RigValues:
    """All values that an interface may send, at the time made_ns, ns since the epoch."""

    made_ns: int
    heartbeat: int  #: seconds of a steady clock; stops counting if the node hangs
    values: Mapping[str, RigValue]  #: value of every name in the signal table
    surveys: tuple[AcceptedSurvey, ...] = ()  #: accepted surveys, oldest measurement first
    alarms: tuple[Alarm, ...] = ()  #: alarms in force, newest first
    well: str = ""
    wellbore: str = ""
    north: str = ""
    mode: int = GRAVITY  #: mode of the toolface in force, GRAVITY or MAGNETIC
    rotating: bool = False
    active: bool = True
    sonde_link: bool = False
    recording: bool = False
    simulated: bool = False
    #: `circulating`, `in_slips`: None if the rig does not report this state.
    circulating: bool | None = None
    in_slips: bool | None = None
    control: ControlStatus = dataclasses.field(default_factory=ControlStatus)
    advice: Advice = dataclasses.field(default_factory=Advice)
    inputs: InputTable = dataclasses.field(default_factory=InputTable)

    @property
    def survey(self) -> AcceptedSurvey | None:
        """Accepted survey with the latest measurement; None before the first accepted survey."""
        return self.surveys[-1] if self.surveys else None

    @property
    def toolface(self) -> RigValue:
        """Toolface in force: gravity or magnetic toolface, by `mode`."""
        return self.values["gravity_toolface" if self.mode == GRAVITY else "magnetic_toolface"]


def rig_values(
    state: WellState,
    surveys: Sequence[AcceptedSurvey],
    *,
    now_ns: int,
    active: bool = True,
    simulated: bool = False,
    previous: RigValues | None = None,
) -> RigValues:
    """
    Return the present values; the result depends on the arguments only.

    Parameters
    ----------
    surveys : sequence of AcceptedSurvey
        Result of `survey.accepted_surveys` for the list in force.
    active, simulated : bool
        Whether the node is active, and whether the tool is simulated.
    previous : RigValues, optional
        Result of the previous call; a toolface that is undefined at present keeps its value from there.
    """
    values = _live_values(state, now_ns)
    for name in ("gravity_toolface", "magnetic_toolface"):
        values[name] = _held(values[name], previous.values[name] if previous else None, now_ns)
    link, ever = _link(state.streams)
    for signal in FROM_TOOL:
        values[signal.name] = _judged(signal, values[signal.name], state.attitude.status, lost=ever and not link)
    values.update(projection(state, now_ns))
    values.update(control_values(state.control, now_ns))
    values.update(advice_values(state, now_ns))
    values.update(input_values(state, now_ns))
    values.update(log_values(state, now_ns))
    values.update(survey_values(surveys[-1] if surveys else None, now_ns))
    if previous is not None:
        values = {name: _same_stamp(v, previous.values[name]) for name, v in values.items()}
    if not active:
        values = {k: dataclasses.replace(v, condition=Condition.INACTIVE, reason="inactive") for k, v in values.items()}
    return RigValues(
        made_ns=now_ns,
        heartbeat=int(state.now),
        values=values,
        surveys=tuple(surveys),
        alarms=state.alarms.rows,
        well=state.well.name,
        wellbore=state.well.wellbore_name,
        north=state.well.north_reference,
        mode=state.toolface.mode,
        rotating=state.toolface.rotating,
        active=active,
        sonde_link=link,
        recording=state.recorder is not None and state.recorder.state == RecorderState.RECORDING,
        simulated=simulated,
        circulating=state.rig.pumps_on,
        in_slips=state.rig.in_slips,
        control=state.control,
        advice=state.advice,
        inputs=state.inputs,
    )


def silenced(values: RigValues, age: float, reason: str) -> RigValues:
    """Return the values marked as unusable, because no new values came for `age` s; the heartbeat does not advance."""
    old = {
        name: dataclasses.replace(
            v,
            condition=v.condition if v.condition == Condition.WAITING else Condition.NO_LINK,
            age=None if v.age is None else v.age + age,
            reason=reason,
        )
        for name, v in values.values.items()
    }
    return dataclasses.replace(values, values=old, active=False, sonde_link=False)


def nothing_yet() -> RigValues:
    """Return the table of values before any data have arrived."""
    return RigValues(0, 0, {signal.name: RigValue() for signal in TO_RIG}, active=False)


def _live_values(state: WellState, now_ns: int) -> dict[str, RigValue]:
    attitude = state.attitude
    in_force = _of_value(state.toolface.angle, state, now_ns, state.toolface.stamp_ns)
    gravity, magnetic = (
        _of_angle(angle, attitude.stamp_ns, state.streams["estimator"], now_ns)
        for angle in (attitude.gravity_toolface, attitude.magnetic_toolface)
    )
    values = {
        "gravity_toolface": in_force if state.toolface.mode == GRAVITY else gravity,
        "magnetic_toolface": magnetic if state.toolface.mode == GRAVITY else in_force,
    }
    sent = {signal.name for signal in TO_RIG}
    for section, part in (("attitude", attitude), ("drilling", state.drilling), ("rig", state.rig)):
        stamp_ns = attitude.stamp_ns if part is attitude else None
        values |= {
            signal.name: _of_value(getattr(part, signal.field), state, now_ns, stamp_ns)
            for signal in page_fields(section).values()
            if signal.name in sent
        }
    return values


def _link(links: Mapping[str, StreamState]) -> tuple[bool, bool]:
    """Return whether data of the sonde arrive now, and whether data have ever arrived."""
    for stream in ("sonde", "estimator"):
        state = links[stream].state
        if state != Freshness.NO_DATA:
            return state == Freshness.LIVE, True
    return False, False


def _of_value(value: LiveValue, state: WellState, now_ns: int, stamp_ns: int | None = None) -> RigValue:
    """
    Return a live value as a rig value, with the age of its measurement.

    stamp_ns: stamp of the sample, used if the sample did not come over a telemetry link.
    """
    age = value.measured_age(state.now)
    if value.value is None or value.age is None or age is None:
        return RigValue(reason=value.reason or "no data yet")
    live = value.state == Freshness.LIVE
    exact = bool(live and stamp_ns and state.link is None)
    return RigValue(
        value.value,
        Condition.GOOD if live else Condition.STALE,
        stamp_ns if exact and stamp_ns else now_ns - round(age * NANOSECONDS),
        age,
        value.sigma,
        "" if live else value.reason or f"the last came {value.age:.1f} s ago",
        value.measured_at,
        exact,
    )


def _of_angle(angle: Angle | None, stamp_ns: int | None, stream: StreamState, now_ns: int) -> RigValue:
    if stamp_ns is None or stream.age is None:
        return RigValue(reason="no data yet")
    if angle is None:
        return RigValue(reason="not defined at this attitude")
    live = stream.state == Freshness.LIVE
    return RigValue(
        angle.value,
        Condition.GOOD if live else Condition.STALE,
        stamp_ns if live else now_ns - round(stream.age * NANOSECONDS),
        stream.age,
        angle.sigma,
        "" if live else f"the last came {stream.age:.1f} s ago",
        stream.at,
        live,
    )


def _same_stamp(value: RigValue, before: RigValue) -> RigValue:
    """
    Return the value with the stamp of the previous value, if both come from one measurement.

    A stamp that is computed from an age differs a little each time, because the clock of the well advances in steps.
    """
    same = not value.exact and value.at is not None and value.at == before.at
    return dataclasses.replace(value, stamp_ns=before.stamp_ns) if same else value


def _held(value: RigValue, before: RigValue | None, now_ns: int) -> RigValue:
    """Return the value; if it is undefined now, return the last defined value (`before`), marked as stale."""
    if value.condition != Condition.WAITING or before is None or before.stamp_ns == 0:
        return value
    age = max(0.0, (now_ns - before.stamp_ns) / NANOSECONDS)
    return dataclasses.replace(before, condition=Condition.STALE, age=age, reason=value.reason)


def _judged(signal: Signal, value: RigValue, status: Status, *, lost: bool) -> RigValue:
    """Return the value with its condition, lowered if the sonde link is lost or the estimator status shows a doubt."""
    if lost:
        return dataclasses.replace(value, condition=Condition.NO_LINK, reason="no data from the sonde")
    if status & Status.SENSOR_FAULT:
        return dataclasses.replace(value, condition=Condition.FAULT, reason="a sensor is judged faulty")
    if value.condition != Condition.GOOD:
        return value
    for bit, reason in _DOUBTS.items():
        # An azimuth aided by the gyro needs no correction for interference.
        aided = bit == Status.UNCORRECTED and status & Status.GYRO_AIDED
        if status & bit and bit.name in signal.doubts and not aided:
            return dataclasses.replace(value, condition=Condition.DOUBTFUL, reason=reason)
    return value


def survey_values(survey: AcceptedSurvey | None, now_ns: int) -> dict[str, RigValue]:
    """Return the survey quantities by name, as values for the rig; now_ns: present time of the node."""
    if survey is None:
        return {signal.name: RigValue(reason="no survey is accepted yet") for signal in OF_SURVEY}
    age = max(0.0, (now_ns - survey.result.stamp_ns) / NANOSECONDS)
    whole = Condition.OVERRIDE if survey.overridden else Condition.GOOD
    if whole == Condition.GOOD and survey.result.verdict != Verdict.ACCEPT:
        whole = Condition.DOUBTFUL
    values = {}
    for signal in OF_SURVEY:
        name, value = signal.name, survey.value(signal.field)
        if value is None or not math.isfinite(value):
            values[name] = RigValue(stamp_ns=0, reason="not known for this survey")
            continue
        sigma = survey.value(f"sigma_{signal.field}") if signal.sigma else None
        condition, reason = whole, "accepted by a person" if survey.overridden else ""
        # A position that is based on an assumption remains doubtful even if a person accepts the survey.
        if signal.field in survey.assumed:
            condition, reason = Condition.DOUBTFUL, f"assumed: {survey.assumption}"
        elif name == "survey_azimuth" and survey.remark and whole == Condition.GOOD:
            condition, reason = Condition.DOUBTFUL, survey.remark
        values[name] = RigValue(value, condition, survey.result.stamp_ns, age, sigma, reason)
    return values


# Values that are derived from path, plan, control, advice, inputs and logs.

# Age above which a gamma value is stale, s: over mud pulses a value takes up to one minute, or two minutes if a word is
# lost.
_LOG_STALE_S = 120.0
# Quality flags of a gamma sample whose value is not the mean gamma around the hole, with the sentence for the rig.
_LOG_DOUBTS = {
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
        values[f"projected_{name}"] = _derived(value, state, "path", now_ns)
    if beyond and not _has_azimuth(state):
        values["projected_azimuth"] = RigValue(reason="the last survey has no azimuth")
    for signal in FROM_PLAN:
        values[signal.name] = _derived(getattr(state.offset, signal.field, None), state, "offset", now_ns)
    doubt = _doubt(state)
    if doubt is None:
        return values
    good = {name for name, value in values.items() if value.condition == Condition.GOOD}
    # An assumed start of the path does not affect the directions of the hole.
    doubted = {name for name in good if doubt[0] != Condition.DOUBTFUL or not name.startswith("projected_")}
    return {
        k: dataclasses.replace(v, condition=doubt[0], reason=doubt[1]) if k in doubted else v for k, v in values.items()
    }


def _has_azimuth(state: WellState) -> bool:
    """Return whether the last survey of the path has an azimuth; if not, the path has that of the station above."""
    path = state.path
    records = () if path is None else state.surveys.records_on(path)
    last = next((one for one in reversed(records) if one is not None), None)
    return path is None or last is None or last.survey.azimuth_from(path.north) is not None


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
    values = {name: _derived(value, state, "advice", now_ns) for name, value in table.items()}
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
    stamp_ns, at = now_ns - round(since * NANOSECONDS), state.change("inputs").at
    for name, number in (("depth_age", inputs.depth_age), ("depth_difference", inputs.depth_difference)):
        if math.isfinite(number):
            grown = number + since if name == "depth_age" else number
            values[name] = RigValue(grown, Condition.GOOD, stamp_ns, since, at=at)
    clocks = {"sonde_clock_offset": inputs.named(SONDE), "rig_clock_offset": rig_input(inputs)}
    for name, row in clocks.items():
        if row is not None and math.isfinite(row.clock_offset + row.offset_age):
            age = row.offset_age + since
            stamp_ns = now_ns - round(age * NANOSECONDS)
            values[name] = RigValue(
                row.clock_offset, Condition.GOOD, stamp_ns, age, at=None if at is None else at - row.offset_age
            )
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
    doubt = "; ".join(reason for bit, reason in _LOG_DOUBTS.items() if newest.quality & bit)
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


def _derived(value: float | None, state: WellState, part: str, now_ns: int) -> RigValue:
    """Return a value of a part of the state, with the time at which the part was set; not known if None or NaN."""
    age = state.age(part)
    if value is None or age is None or not math.isfinite(value):
        return RigValue(reason="no survey and plan to compute it from")
    return RigValue(value, Condition.GOOD, now_ns - round(age * NANOSECONDS), age, at=state.change(part).at)
