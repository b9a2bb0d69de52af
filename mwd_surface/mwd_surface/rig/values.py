"""
What rig control is told, in one frozen table: every value with its age, sigma and whether it may be acted upon.

A controller needs the truth about age more than speed. A value that is not good keeps the last number known and says
why; none is ever NaN. Units are SI and rad; each interface turns them into its own at its own edge.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.live.toolface import GRAVITY, MAGNETIC
from mwd_surface.live.values import LIVE, NO_DATA
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.surveys.survey_record import Verdict


class Condition(enum.Enum):
    """Whether a value may be acted upon, from best to worst; the words people read."""

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
        """True where the number is a current one."""
        return self in (Condition.GOOD, Condition.OVERRIDE, Condition.DOUBTFUL)


@dataclasses.dataclass(frozen=True)
class RigValue:
    """
    One value. stamp_ns: of the measurement, 0 where there never was one; age, s, None then; sigma: 1 sigma or None.

    Where `condition` is not usable `value` is the last one known, or 0.
    """

    value: float = 0.0
    condition: Condition = Condition.WAITING
    stamp_ns: int = 0
    age: float | None = None
    sigma: float | None = None
    reason: str = ""


# Live quantities: unit, and the words for people.
LIVE_QUANTITIES: dict[str, tuple[str, str]] = {
    "inclination": ("rad", "continuous inclination from the vertical"),
    "azimuth": ("rad", "continuous azimuth"),
    "gravity_toolface": ("rad", "toolface from the high side"),
    "magnetic_toolface": ("rad", "toolface from north"),
    "rotary_speed": ("rad/s", "rotary speed down-hole"),
    "vibration": ("m/s^2", "acceleration other than gravity"),
    "temperature": ("degC", "temperature of the tool"),
    "axial_interference": ("T", "axial field of the string"),
    "bit_depth": ("m", "measured depth of the bit"),
    "hole_depth": ("m", "measured depth of the hole"),
    "projected_inclination": ("rad", "inclination projected to the bit"),
    "projected_azimuth": ("rad", "azimuth projected to the bit"),
    "plan_distance": ("m", "distance from the plan"),
    "plan_up": ("m", "above the plan, across it"),
    "plan_right": ("m", "right of the plan, across it"),
    "plan_toolface": ("rad", "toolface that steers back to the plan"),
    "target_dogleg": ("rad/m", "dogleg severity of the arc that hits the target"),
}
SURVEY_QUANTITIES: dict[str, tuple[str, str]] = {
    "survey_inclination": ("rad", "inclination of the last accepted survey"),
    "survey_azimuth": ("rad", "azimuth of the last accepted survey, from the north of the well"),
    "survey_depth": ("m", "measured depth of the last accepted survey"),
    "survey_vertical_depth": ("m", "vertical depth of the last accepted survey"),
    "survey_north": ("m", "north of the last accepted survey"),
    "survey_east": ("m", "east of the last accepted survey"),
    "survey_dogleg": ("rad/m", "dogleg severity above the last accepted survey"),
    "survey_gravity": ("m/s^2", "total gravity of the last accepted survey"),
    "survey_field": ("T", "total field of the last accepted survey"),
    "survey_dip": ("rad", "dip of the field of the last accepted survey"),
    "survey_sigma_inclination": ("rad", "1 sigma of its inclination"),
    "survey_sigma_azimuth": ("rad", "1 sigma of its azimuth"),
    "survey_interference": ("T", "axial interference of the last accepted survey"),
}
QUANTITIES = {**LIVE_QUANTITIES, **SURVEY_QUANTITIES}

# What the tool itself says, and which silences and faults of it therefore concern.
_FROM_TOOL = (
    "inclination", "azimuth", "gravity_toolface", "magnetic_toolface", "rotary_speed", "vibration", "temperature",
    "axial_interference",
)  # fmt: skip
_SECTIONS = {
    "inclination": "attitude",
    "azimuth": "attitude",
    "rotary_speed": "drilling",
    "vibration": "drilling",
    "temperature": "drilling",
    "axial_interference": "drilling",
    "bit_depth": "rig",
    "hole_depth": "rig",
}
_OFFSETS = {
    "plan_distance": "distance",
    "plan_up": "up",
    "plan_right": "right",
    "plan_toolface": "toolface",
    "target_dogleg": "dogleg_to_target",
}
# Words of the estimator's status, what they throw doubt on, and how to say it.
_DOUBTS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("rotating", ("gravity_toolface", "magnetic_toolface"), "the string turns: the toolface is a snapshot"),
    ("mag_disturbed", ("azimuth", "magnetic_toolface"), "the field is off its reference"),
    ("correction_refused", ("azimuth",), "interference cannot be corrected at this attitude"),
    ("uncorrected", ("azimuth",), "not corrected for interference"),
    ("aliased", ("inclination", "gravity_toolface"), "the samples look point-sampled under vibration"),
    ("clipped", ("inclination", "gravity_toolface", "rotary_speed"), "a sensor is at its limit"),
)
_TOOLFACES = {"gravity_toolface": GRAVITY, "magnetic_toolface": MAGNETIC}


@dataclasses.dataclass(frozen=True)
class RigValues:
    """
    Everything an interface may tell, as of made_ns.

    heartbeat: seconds of a steady clock, so that a watcher sees it stand still. values: of every name in
    `QUANTITIES`. surveys: the accepted ones, oldest measurement first. circulating, in_slips: None where the rig does
    not say. mode: of the toolface in force, GRAVITY or MAGNETIC.
    """

    made_ns: int
    heartbeat: int
    values: Mapping[str, RigValue]
    surveys: tuple[AcceptedSurvey, ...] = ()
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

    @property
    def survey(self) -> AcceptedSurvey | None:
        """The accepted survey of the latest measurement; None before the first."""
        return self.surveys[-1] if self.surveys else None

    @property
    def toolface(self) -> RigValue:
        """The toolface in force."""
        return self.values["gravity_toolface" if self.mode == GRAVITY else "magnetic_toolface"]


def rig_values(
    snapshot: Mapping[str, Any],
    surveys: Sequence[AcceptedSurvey],
    attitude: Samples | None,
    *,
    now_ns: int,
    active: bool = True,
    simulated: bool = False,
    previous: RigValues | None = None,
) -> RigValues:
    """
    The table of a moment; nothing but the arguments enters it.

    Parameters
    ----------
    snapshot : mapping
        Of `LiveState.snapshot`, so that rig and page cannot say different things.
    surveys : sequence of AcceptedSurvey
        `rig_survey.accepted_surveys` of the list in force.
    attitude : samples, optional
        The last attitude, `wire.ATTITUDE`, shape (1,): the page shows one toolface, machines get both.
    now_ns : int
        Time of the node, ns.
    active, simulated : bool
        Whether the node is active, and whether the tool is a simulation.
    previous : RigValues, optional
        The table before: a toolface that is not defined just now keeps its last value from it.
    """
    sections = snapshot["sections"]
    words = tuple(sections["attitude"]["status"])
    link, heard = _link(sections["links"])
    mode = MAGNETIC if sections["toolface"]["mode"] == "magnetic" else GRAVITY
    values: dict[str, RigValue] = {}
    for name, section in _SECTIONS.items():
        stamp = sections["attitude"]["stamp_ns"] if section == "attitude" else None
        values[name] = _of_cell(sections[section][name], now_ns, stamp)
    for name, kind in _TOOLFACES.items():
        if kind == mode:
            value = _of_cell(sections["toolface"]["angle"], now_ns, sections["toolface"]["stamp_ns"])
        else:
            value = _of_attitude(attitude, name, sections["links"]["estimator"], now_ns)
        values[name] = _held(value, previous.values[name] if previous else None, now_ns)
    for name in _FROM_TOOL:
        values[name] = _judged(name, values[name], words, link, heard)
    values.update(_projection(sections, now_ns))
    values.update(_of_survey(surveys[-1] if surveys else None, now_ns))
    if not active:
        values = {k: dataclasses.replace(v, condition=Condition.INACTIVE, reason="inactive") for k, v in values.items()}
    flow, slips = sections["rig"]["flow_rate"], sections["rig"]["in_slips"]
    return RigValues(
        made_ns=now_ns,
        heartbeat=int(snapshot["now"]),
        values=values,
        surveys=tuple(surveys),
        well=sections["well"]["name"],
        wellbore=sections["well"]["wellbore"],
        north=sections["well"]["north_reference"],
        mode=mode,
        rotating=bool(sections["toolface"]["rotating"]),
        active=active,
        sonde_link=link,
        recording=sections["recorder"]["state"] == "recording",
        simulated=simulated,
        circulating=flow["value"] > 0.0 if flow["state"] == LIVE else None,
        in_slips=slips,
    )


def silenced(values: RigValues, age: float, reason: str) -> RigValues:
    """The table when nothing new came for so long, s: nothing in it may be acted upon any more; heartbeat stands."""
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


def nothing_yet(now_ns: int = 0) -> RigValues:
    """The table before anything is known."""
    return RigValues(now_ns, 0, {name: RigValue() for name in QUANTITIES}, active=False)


def _link(links: Mapping[str, Any]) -> tuple[bool, bool]:
    """Whether the sonde is heard now, and whether it ever was."""
    for stream in ("sonde", "estimator"):
        state = links[stream]["state"]
        if state != NO_DATA:
            return state == LIVE, True
    return False, False


def _of_cell(cell: Mapping[str, Any], now_ns: int, stamp_ns: int | None = None) -> RigValue:
    if cell["value"] is None:
        return RigValue(reason=cell["reason"] or "none came yet")
    age = float(cell["age"])
    live = cell["state"] == LIVE
    stamp = stamp_ns if live and stamp_ns else now_ns - round(age * NANOSECONDS)
    reason = "" if live else cell["reason"] or f"the last came {age:.1f} s ago"
    return RigValue(
        float(cell["value"]), Condition.GOOD if live else Condition.STALE, stamp, age, cell["sigma"], reason
    )


def _of_attitude(attitude: Samples | None, name: str, stream: Mapping[str, Any], now_ns: int) -> RigValue:
    if attitude is None or len(attitude) == 0 or stream["age"] is None:
        return RigValue(reason="none came yet")
    last = attitude[-1]
    value, sigma = float(last[name]), float(last["sigma_" + name])
    if not (math.isfinite(value) and math.isfinite(sigma) and sigma >= 0.0):
        return RigValue(reason="not defined at this attitude")
    age, fresh = float(stream["age"]), stream["state"] == LIVE
    return RigValue(
        value % math.tau,
        Condition.GOOD if fresh else Condition.STALE,
        int(last["stamp_ns"]) if fresh else now_ns - round(age * NANOSECONDS),
        age,
        sigma,
        "" if fresh else f"the last came {age:.1f} s ago",
    )


def _held(value: RigValue, before: RigValue | None, now_ns: int) -> RigValue:
    """The value, or what it was the last time it was defined."""
    if value.condition != Condition.WAITING or before is None or before.stamp_ns == 0:
        return value
    age = max(0.0, (now_ns - before.stamp_ns) / NANOSECONDS)
    return dataclasses.replace(before, condition=Condition.STALE, age=age, reason=value.reason)


def _judged(name: str, value: RigValue, words: tuple[str, ...], link: bool, heard: bool) -> RigValue:
    if heard and not link:
        return dataclasses.replace(value, condition=Condition.NO_LINK, reason="nothing comes from the sonde")
    if "sensor_fault" in words:
        return dataclasses.replace(value, condition=Condition.FAULT, reason="a sensor is judged faulty")
    if value.condition != Condition.GOOD:
        return value
    for word, names, reason in _DOUBTS:
        aided = word == "uncorrected" and "gyro_aided" in words
        if word in words and name in names and not aided:
            return dataclasses.replace(value, condition=Condition.DOUBTFUL, reason=reason)
    return value


def _projection(sections: Mapping[str, Any], now_ns: int) -> dict[str, RigValue]:
    """What follows from path and plan; as old as the path itself."""
    path, offset = sections["path"], sections["offset"]
    values = {}
    for name, column in (("projected_inclination", "inclination"), ("projected_azimuth", "azimuth")):
        known = path["kind"] and path["kind"][-1] != "tie-on" and path[column][-1] is not None
        values[name] = _derived(path[column][-1] if known else None, path["age"], now_ns)
    for name, key in _OFFSETS.items():
        values[name] = _derived(offset[key] if offset["known"] else None, offset["age"], now_ns)
    return values


def _derived(value: float | None, age: float | None, now_ns: int) -> RigValue:
    if value is None or age is None:
        return RigValue(reason="no survey and plan to compute it from")
    return RigValue(float(value), Condition.GOOD, now_ns - round(age * NANOSECONDS), float(age))


def _of_survey(survey: AcceptedSurvey | None, now_ns: int) -> dict[str, RigValue]:
    if survey is None:
        return {name: RigValue(reason="no survey is accepted yet") for name in SURVEY_QUANTITIES}
    numbers: dict[str, tuple[float | None, float | None]] = {
        "survey_inclination": (survey.inclination, survey.sigma_inclination),
        "survey_azimuth": (survey.azimuth, survey.sigma_azimuth),
        "survey_depth": (survey.measured_depth, None),
        "survey_vertical_depth": (survey.vertical_depth, None),
        "survey_north": (survey.position_north, None),
        "survey_east": (survey.position_east, None),
        "survey_dogleg": (survey.dogleg_severity, None),
        "survey_gravity": (survey.g_total, None),
        "survey_field": (survey.b_total, None),
        "survey_dip": (survey.dip, None),
        "survey_sigma_inclination": (survey.sigma_inclination, None),
        "survey_sigma_azimuth": (survey.sigma_azimuth, None),
        "survey_interference": (survey.axial_interference, None),
    }
    age = max(0.0, (now_ns - survey.stamp_ns) / NANOSECONDS)
    whole = Condition.OVERRIDE if survey.overridden else Condition.GOOD
    if whole == Condition.GOOD and survey.verdict != Verdict.ACCEPT:
        whole = Condition.DOUBTFUL
    values = {}
    for name, (value, sigma) in numbers.items():
        if value is None or not math.isfinite(value):
            values[name] = RigValue(stamp_ns=0, reason="not known of this survey")
            continue
        condition, reason = whole, "in use on a person's word" if survey.overridden else ""
        if name == "survey_azimuth" and survey.remark and whole == Condition.GOOD:
            condition, reason = Condition.DOUBTFUL, survey.remark
        values[name] = RigValue(value, condition, survey.stamp_ns, age, sigma, reason)
    return values
