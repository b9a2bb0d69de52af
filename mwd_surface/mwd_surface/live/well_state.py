# SPDX-License-Identifier: Apache-2.0
"""
State of a well at one time: one immutable value that the live page shows and the rig interfaces send.

`live_state.LiveState.at` returns it. The page converts its fields to JSON, the rig interfaces to their values. Numbers
are in SI and rad; an unknown number is NaN or None, and zero is always a measured zero. Times are s of one steady
clock, except stamps, which are ns since the epoch and come from the measurement.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import REFERENCE_FIELDS, Survey
from mwd_sensors.core.arrays import Array
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.control.status import ControlStatus
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.list_files.remark import Remark
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.latest_values import NO_VALUE, Freshness, LiveValue, Row, StreamState
from mwd_surface.live.link_state import LinkStatus
from mwd_surface.live.toolface import GRAVITY, ToolfaceMode
from mwd_surface.logs.depth_log import Curve, Newest
from mwd_surface.logs.tool_health import ToolHealth
from mwd_surface.surveys.mine_hole import Branch, Closure, Deviation
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.plan import Offset, Plan
from mwd_surface.trajectory.slide_sheet import DrilledStretch, Yield
from mwd_surface.trajectory.well_path import Definitive

NO_STATUS = Status(0)
# Flow, m^3/s, and pressure, Pa, above which the pumps count as on: far below drilling, far above readings of mud at
# rest.
LEAST_FLOW = 100e-3 / 60.0
_LEAST_PRESSURE = 1e6


@dataclasses.dataclass(frozen=True)
class Angle:
    """An angle, rad, and its 1 sigma, rad."""

    value: float
    sigma: float


@dataclasses.dataclass(frozen=True)
class AttitudeState:
    """Present attitude of the tool."""

    #: `inclination`, `azimuth`: inclination from the vertical, and azimuth from `north`, rad.
    inclination: LiveValue = NO_VALUE
    azimuth: LiveValue = NO_VALUE
    #: `gravity_toolface`, `magnetic_toolface`: toolfaces of the last sample; None if the sample does not define them.
    gravity_toolface: Angle | None = None
    magnetic_toolface: Angle | None = None
    status: Status = NO_STATUS  #: status of the last sample
    north: North = North.UNKNOWN
    stamp_ns: int | None = None  #: stamp of the last sample; None before the first sample


@dataclasses.dataclass(frozen=True)
class DialReading:
    """A toolface on the dial: angle, rad; mode GRAVITY or MAGNETIC; time of arrival, s of the steady clock."""

    angle: float
    mode: ToolfaceMode
    at: float
    rotating: bool
    stamp_ns: int


@dataclasses.dataclass(frozen=True)
class Advisory:
    """Advised toolface and its limit, rad."""

    toolface: float
    limit: float
    inside: bool | None  #: whether the live toolface is within the limit; None if unknown


@dataclasses.dataclass(frozen=True)
class ToolfaceState:
    """The toolface in force."""

    angle: LiveValue = NO_VALUE
    mode: ToolfaceMode = GRAVITY
    rotating: bool = False
    stamp_ns: int | None = None  #: stamp of the last sample; None before the first sample
    #: Stamp of the measurement: the stamp of the last sample, or over a link the stamp at which the word was measured.
    measured_ns: int | None = None
    readings: tuple[DialReading, ...] = ()  #: toolfaces on the dial, oldest first
    advisory: Advisory | None = None
    threshold: float | None = None  #: inclination, rad, below which the mode is MAGNETIC; None if unknown


@dataclasses.dataclass(frozen=True)
class DrillingState:
    """Drilling dynamics, temperature and interference; units as in the signal table."""

    vibration: LiveValue = NO_VALUE
    rotary_speed: LiveValue = NO_VALUE
    stick_slip: LiveValue = NO_VALUE
    axial_vibration: LiveValue = NO_VALUE
    lateral_vibration: LiveValue = NO_VALUE
    shocks: LiveValue = NO_VALUE
    shock_peak: LiveValue = NO_VALUE
    rotary_least: LiveValue = NO_VALUE
    rotary_most: LiveValue = NO_VALUE
    temperature: LiveValue = NO_VALUE
    total_field: LiveValue = NO_VALUE
    axial_interference: LiveValue = NO_VALUE
    cross_axial_interference: LiveValue = NO_VALUE
    field_deviation: LiveValue = NO_VALUE
    dip_deviation: LiveValue = NO_VALUE


@dataclasses.dataclass(frozen=True)
class RigState:
    """Measurements of the rig; in_slips is None if the rig does not report slips."""

    bit_depth: LiveValue = NO_VALUE
    hole_depth: LiveValue = NO_VALUE
    block_position: LiveValue = NO_VALUE
    hookload: LiveValue = NO_VALUE
    weight_on_bit: LiveValue = NO_VALUE
    torque: LiveValue = NO_VALUE
    rotary_speed: LiveValue = NO_VALUE
    flow_rate: LiveValue = NO_VALUE
    pressure: LiveValue = NO_VALUE
    rate_of_penetration: LiveValue = NO_VALUE
    in_slips: bool | None = None

    @property
    def pumps_on(self) -> bool | None:
        """Whether the pumps are on, from the flow or, without it, the standpipe pressure; None without either."""
        for measured, least in ((self.flow_rate, LEAST_FLOW), (self.pressure, _LEAST_PRESSURE)):
            if measured.state == Freshness.LIVE and measured.value is not None:
                return measured.value > least
        return None


@dataclasses.dataclass(frozen=True)
class ReferenceFieldState:
    """Reference field and gravity, T, rad and m/s^2, NaN if unknown."""

    total: float = math.nan
    dip: float = math.nan
    declination: float = math.nan
    convergence: float = math.nan
    gravity: float = math.nan
    source: str = ""  #: origin of the values, in words

    @classmethod
    def of_survey(cls, survey: Survey) -> ReferenceFieldState:
        """Return the reference field with which a survey was judged."""
        values = {name: getattr(survey, field) for name, field in REFERENCE_FIELDS.items()}
        return cls(**values, source=f"as of survey {survey.sequence}")


@dataclasses.dataclass(frozen=True)
class SurveyProgress:
    """Progress of a survey or north seek."""

    active: bool = False
    state: str = ""
    #: `elapsed`, `remaining`: s; NaN if unknown.
    elapsed: float = math.nan
    remaining: float = math.nan
    result: str = ""  #: outcome of the last survey
    #: Reason why a survey that has averaged enough samples is not issued yet; `elapsed` and `remaining` are then the
    #: times of this wait.
    waits_for: str = ""


class DiagnosticLevel(enum.IntEnum):
    """Level of a diagnostic, as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARNING = 1
    ERROR = 2
    STALE = 3


@dataclasses.dataclass(frozen=True)
class NodeDiagnostic:
    """One entry of a node's diagnostics."""

    name: str
    level: DiagnosticLevel
    message: str
    remedy: str = ""


@dataclasses.dataclass(frozen=True)
class AlarmState:
    """The alarms in force."""

    rows: tuple[Alarm, ...] = ()  #: alarms, newest first
    not_evaluated: tuple[str, ...] = ()  #: kinds of alarms that could not be evaluated, in words
    #: Time since the epoch at which the clock of `WellState.now` was zero, s, by the clock that stamps the alarms; NaN
    #: if unknown.
    epoch: float = math.nan


@dataclasses.dataclass(frozen=True)
class Chart:
    """Strip chart: names of the columns, rows (oldest or shallowest first), and length of the chart, s or m."""

    columns: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    length: float = 0.0


@dataclasses.dataclass(frozen=True)
class Change:
    """Number of times that a part of the state was set, and the last time at which it was set, s (steady clock)."""

    count: int = 0
    at: float | None = None


@dataclasses.dataclass(frozen=True)
class RodCount:
    """Rods in the hole by the tally: number of rods, bit depth computed from them, m, and usual rod length, m."""

    rods: int
    bit_depth: float
    length: float


@dataclasses.dataclass(frozen=True)
class WellState:
    """State of a well at `now`; fields keep their defaults until data arrive."""

    now: float = 0.0  #: time of this state, s of the steady clock
    attitude: AttitudeState = dataclasses.field(default_factory=AttitudeState)
    toolface: ToolfaceState = dataclasses.field(default_factory=ToolfaceState)
    drilling: DrillingState = dataclasses.field(default_factory=DrillingState)
    rig: RigState = dataclasses.field(default_factory=RigState)
    streams: Mapping[str, StreamState] = dataclasses.field(default_factory=dict)  #: state of each stream by name
    well: Well = dataclasses.field(default_factory=Well)
    well_given: bool = True  #: whether the well was described by a person; False if the description is assumed
    over_link: bool | None = None  #: whether the tool is received over a telemetry link; None if unknown
    over: bool = False  #: whether the simulation or replay that makes the data has come to its end
    reference_given: ReferenceFieldState | None = None  #: the field that the estimator or the receiver reports
    surveys: SurveyList = dataclasses.field(default_factory=SurveyList)  #: the survey list in force
    #: `path`, `covariance`: the well path, and the covariance of its first m positions, shape (m, 3, 3), m^2.
    path: Definitive | None = None
    covariance: Array | None = None
    rods: RodCount | None = None  #: rods in the hole; None if the depth is not counted by rods
    plan: Plan | None = None
    offset: Offset | None = None  #: offset of the end of the path from the plan
    #: Deviation of a mine hole from its plan, deepest first; computed at the last change of the list.
    deviation: tuple[Deviation, ...] = ()
    branches: tuple[Branch, ...] = ()  #: branches of a mine hole, in the order in which they were begun
    closure: Closure | None = None  #: closure of a mine hole on its surveyed point; None without such a point
    #: `clearance`, `clearance_remarks`: clearance to offset wells from the last survey on, the closest by the rule
    #: first; and remarks on omitted wells and assumptions.
    clearance: tuple[Clearance, ...] = ()
    clearance_remarks: tuple[Remark, ...] = ()
    #: `stretches`, `yields`: intervals of the slide sheet, deepest last, and the yields of the slides between stations.
    stretches: tuple[DrilledStretch, ...] = ()
    yields: tuple[Yield, ...] = ()
    quill: float | None = None  #: angle of the quill, rad clockwise looking down-hole from the zero of the rig
    link: LinkStatus | None = None  #: the telemetry link in use
    #: Holder of the control of top drive and pumps, commands, and actual values of the rig.
    control: ControlStatus = dataclasses.field(default_factory=ControlStatus)
    advice: Advice = dataclasses.field(default_factory=Advice)  #: advice for drilling the next interval
    downlink: DownlinkStatus | None = None  #: state of the downlink command to the tool
    #: Clock offsets and ages of the inputs, and the source of the depth.
    inputs: InputTable = dataclasses.field(default_factory=InputTable)
    survey_progress: SurveyProgress = dataclasses.field(default_factory=SurveyProgress)
    recorder: RecorderStatus | None = None
    diagnostics: tuple[NodeDiagnostic, ...] = ()  #: diagnostics of the nodes, worst first
    alarms: AlarmState = dataclasses.field(default_factory=AlarmState)
    events: tuple[Event, ...] = ()  #: events of the log, newest first
    #: `history`, `trend`, `depth_log`: charts over the last minutes, over the last hours (in larger steps), and over
    #: the depth of the sensor.
    history: Chart = dataclasses.field(default_factory=Chart)
    trend: Chart = dataclasses.field(default_factory=Chart)
    depth_log: Chart = dataclasses.field(default_factory=Chart)
    logs: tuple[Curve, ...] = ()  #: log channels over depth, first pass
    newest_logs: Mapping[str, Newest] = dataclasses.field(default_factory=dict)  #: newest value of each log channel
    #: Battery, run time, exposures, self-tests and parts of the tool.
    tool_health: ToolHealth = dataclasses.field(default_factory=ToolHealth)
    #: Number of times that each part was set, and the last time at which it was set, by name of the part (a field of
    #: this class). A part that was never set is missing.
    changes: Mapping[str, Change] = dataclasses.field(default_factory=dict)

    @property
    def reference(self) -> ReferenceFieldState:
        """Reference field in force: `reference_given`, else the reference of the latest survey that has a reference."""
        if self.reference_given is not None:
            return self.reference_given
        known = (record.survey for record in self.surveys.records if record.survey.has_reference)
        last = max(known, key=lambda survey: survey.stamp_ns, default=None)
        return ReferenceFieldState() if last is None else ReferenceFieldState.of_survey(last)

    @property
    def section_azimuth(self) -> float:
        """Azimuth of the vertical section, rad: from the path, else from the well's settings, else from the plan."""
        if self.path is not None:
            return self.path.section_azimuth
        if self.well.section_azimuth_deg is not None:
            return math.radians(self.well.section_azimuth_deg)
        return 0.0 if self.plan is None else self.plan.section_azimuth

    def change(self, part: str) -> Change:
        """Return the number of times that a part was set, and the last time at which it was set."""
        return self.changes.get(part, Change())

    def age(self, part: str) -> float | None:
        """Return the time since a part was last set, s; None if it was never set."""
        at = self.change(part).at
        return None if at is None else max(0.0, self.now - at)
