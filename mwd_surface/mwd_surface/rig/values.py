# SPDX-License-Identifier: Apache-2.0
"""
Values that the rig interfaces send, in one frozen table, each with its age, sigma and condition.

A value that is not good keeps the last known number and has a reason; no value is ever NaN. Units are SI and rad; each
interface converts to its own units.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.control.status import ControlStatus
from mwd_surface.live.alarms import Alarm
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.latest_values import Freshness, LiveValue, StreamState
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.live.well_state import Angle, WellState
from mwd_surface.rig.derived_values import advice_values, control_values, input_values, log_values, projection
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.rig.value import Condition, RigValue
from mwd_surface.signals.signal import Signal
from mwd_surface.signals.table import FROM_TOOL, OF_SURVEY, TO_RIG, page_fields
from mwd_surface.trajectory.advice import Advice

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
    """
    All values that an interface may send, at the time made_ns, ns since the epoch.

    heartbeat: seconds of a steady clock; stops counting if the node hangs.
    values: value of every name in the signal table.
    surveys: accepted surveys, oldest measurement first.
    alarms: newest first.
    circulating, in_slips: None if the rig does not report this state.
    mode: mode of the toolface in force, GRAVITY or MAGNETIC.
    """

    made_ns: int
    heartbeat: int
    values: Mapping[str, RigValue]
    surveys: tuple[AcceptedSurvey, ...] = ()
    alarms: tuple[Alarm, ...] = ()
    well: str = ""
    wellbore: str = ""
    north: str = ""
    mode: int = GRAVITY
    rotating: bool = False
    active: bool = True
    sonde_link: bool = False
    recording: bool = False
    simulated: bool = False
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
    state : WellState
        State of the well, the same as on the page.
    surveys : sequence of AcceptedSurvey
        Result of `survey.accepted_surveys` for the list in force.
    now_ns : int
        Present time of the node.
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
    if not active:
        values = {k: dataclasses.replace(v, condition=Condition.INACTIVE, reason="inactive") for k, v in values.items()}
    flow = state.rig.flow_rate
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
        circulating=flow.value > 0.0 if flow.state == Freshness.LIVE and flow.value is not None else None,
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
    return RigValue(
        value.value,
        Condition.GOOD if live else Condition.STALE,
        stamp_ns if live and stamp_ns and state.link is None else now_ns - round(age * NANOSECONDS),
        age,
        value.sigma,
        "" if live else value.reason or f"the last came {value.age:.1f} s ago",
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
    )


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
