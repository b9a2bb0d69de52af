# SPDX-License-Identifier: Apache-2.0
"""
The state of a well at one moment: one immutable value that the live page shows and the rig interfaces send.

`live_state.LiveState.at` makes it. The page turns its fields into JSON, the rig interfaces turn them into their values.
Numbers are in SI and rad; a number that is unknown is NaN or None, and zero is always a measured zero. Times are s of
one steady clock, except stamps, which are ns since the epoch and come from the measurement.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Array
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.control.status import ControlStatus
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.list_files.remark import Remark
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.latest_values import NO_VALUE, Freshness, LiveValue, StreamState
from mwd_surface.live.link_state import LinkStatus
from mwd_surface.live.strip_history import Row
from mwd_surface.live.toolface import GRAVITY, ToolfaceMode
from mwd_surface.logs.depth_log import Curve, Newest
from mwd_surface.logs.tool_health import ToolHealth
from mwd_surface.surveys.branches import Branch
from mwd_surface.surveys.closure import Closure
from mwd_surface.surveys.deviation import Deviation
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.plan import Offset, Plan
from mwd_surface.trajectory.slide_sheet import Stretch, Yield
from mwd_surface.trajectory.well_path import Definitive

NO_STATUS = Status(0)
# Far below what drills and far above what a sensor reads of standing mud.
LEAST_FLOW = 100e-3 / 60.0  # m^3/s
_LEAST_PRESSURE = 1e6  # Pa


@dataclasses.dataclass(frozen=True)
class Angle:
    """An angle, rad, and its 1 sigma, rad."""

    value: float
    sigma: float


@dataclasses.dataclass(frozen=True)
class AttitudeState:
    """
    Continuous attitude.

    Attributes
    ----------
    inclination, azimuth : LiveValue
        The azimuth is from `north`.
    gravity_toolface, magnetic_toolface : Angle or None
        Of the last sample; None where it does not define them.
    status : Status
        Of the last sample.
    north : North
    stamp_ns : int or None
        Of the last sample; None before the first.
    """

    inclination: LiveValue = NO_VALUE
    azimuth: LiveValue = NO_VALUE
    gravity_toolface: Angle | None = None
    magnetic_toolface: Angle | None = None
    status: Status = NO_STATUS
    north: North = North.UNKNOWN
    stamp_ns: int | None = None


@dataclasses.dataclass(frozen=True)
class DialReading:
    """An earlier toolface on the dial: angle, rad; mode GRAVITY or MAGNETIC; at, s of the steady clock."""

    angle: float
    mode: ToolfaceMode
    at: float
    rotating: bool
    stamp_ns: int


@dataclasses.dataclass(frozen=True)
class Advisory:
    """The toolface to steer at and the deviation allowed, rad; inside: within it, None while the toolface is not."""

    toolface: float
    limit: float
    inside: bool | None


@dataclasses.dataclass(frozen=True)
class ToolfaceState:
    """
    The toolface in force.

    Attributes
    ----------
    angle : LiveValue
    mode : ToolfaceMode
    rotating : bool
    stamp_ns : int or None
        Of the last sample; None before the first.
    measured_ns : int or None
        When the angle was measured: that of the last sample, or over a link of the word it comes from.
    readings : tuple of DialReading
        Oldest first.
    advisory : Advisory or None
    threshold : float or None
        Inclination, rad, below which the mode is MAGNETIC; None while the estimator has not told it.
    """

    angle: LiveValue = NO_VALUE
    mode: ToolfaceMode = GRAVITY
    rotating: bool = False
    stamp_ns: int | None = None
    measured_ns: int | None = None
    readings: tuple[DialReading, ...] = ()
    advisory: Advisory | None = None
    threshold: float | None = None


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
    """Measurements of the rig; in_slips: None where the rig does not report it."""

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
        """Whether mud is pumped, by flow or else by standpipe pressure; None where the rig reports neither."""
        for measured, least in ((self.flow_rate, LEAST_FLOW), (self.pressure, _LEAST_PRESSURE)):
            if measured.state == Freshness.LIVE and measured.value is not None:
                return measured.value > least
        return None


@dataclasses.dataclass(frozen=True)
class ReferenceField:
    """A reference field: T, rad, m/s^2, NaN if unknown; source: where it comes from, in words."""

    total: float = math.nan
    dip: float = math.nan
    declination: float = math.nan
    convergence: float = math.nan
    gravity: float = math.nan
    source: str = ""

    @classmethod
    def of_survey(cls, survey: Survey) -> ReferenceField:
        """Return the reference a survey was judged by."""
        return cls(
            total=survey.b_reference,
            dip=survey.dip_reference,
            declination=survey.declination,
            convergence=survey.convergence,
            gravity=survey.g_reference,
            source=f"as of survey {survey.sequence}",
        )


@dataclasses.dataclass(frozen=True)
class SurveyProgress:
    """
    A survey or north seek under way: elapsed and remaining, s, NaN if unknown; result: how the last one ended.

    waits_for: why a survey that has averaged enough samples is not issued yet; elapsed and remaining then refer to
    that wait.
    """

    active: bool = False
    state: str = ""
    elapsed: float = math.nan
    remaining: float = math.nan
    result: str = ""
    waits_for: str = ""


class DiagnosticLevel(enum.IntEnum):
    """Level of a diagnostic, as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARNING = 1
    ERROR = 2
    STALE = 3


@dataclasses.dataclass(frozen=True)
class NodeDiagnostic:
    """A line of diagnostics of a node."""

    name: str
    level: DiagnosticLevel
    message: str
    remedy: str = ""


@dataclasses.dataclass(frozen=True)
class AlarmState:
    """
    The alarms in force.

    Attributes
    ----------
    rows : tuple of Alarm
        Newest first.
    not_evaluated : tuple of str
        Kinds of alarms that could not be judged, in words.
    epoch : float
        Time since the epoch at which the clock of `WellState.now` was zero, s, by the clock that stamps the alarms; NaN
        if unknown.
    """

    rows: tuple[Alarm, ...] = ()
    not_evaluated: tuple[str, ...] = ()
    epoch: float = math.nan


@dataclasses.dataclass(frozen=True)
class Chart:
    """Rows of a strip chart, oldest or shallowest first, the names of their columns, and its length, s or m."""

    columns: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    length: float = 0.0


@dataclasses.dataclass(frozen=True)
class Change:
    """Number of times that a part of the state was set, and the last time, s of the steady clock."""

    count: int = 0
    at: float | None = None


@dataclasses.dataclass(frozen=True)
class RodCount:
    """Rods in the hole by the tally: their number, the bit depth that they make, m, and the usual length, m."""

    rods: int
    bit_depth: float
    length: float


@dataclasses.dataclass(frozen=True)
class WellState:
    """
    All that is known of a well at `now`; the defaults until something arrives.

    Attributes
    ----------
    now : float
        s of the steady clock.
    streams : mapping of str to StreamState
        The streams by name.
    reference_given : ReferenceField or None
        The field that the estimator or the receiver reports.
    surveys : SurveyList
        The survey list in force.
    path, covariance
        The well path, and the covariance of its first m positions, shape (m, 3, 3), m^2.
    rods : RodCount or None
        The rods in the hole; None where the depth is not counted by rods.
    offset : Offset or None
        Offset of the end of the path from the plan.
    deviation : tuple of Deviation
        Deviation of a mine hole from its plan, ahead of the bit first; as of the last change of the list.
    branches : tuple of Branch
        Branches of a mine hole, in the order in which they were begun.
    closure : Closure or None
        Closure of a mine hole on its surveyed point; None without such a point.
    clearance, clearance_remarks
        Clearance to offset wells from the last survey on, the closest by the rule first, and remarks on what was left
        out or assumed.
    stretches, yields
        The slide sheet, deepest last.
    quill : float or None
        Angle of the quill, rad clockwise looking down-hole from the zero of the rig.
    link : LinkStatus or None
        The telemetry link in use.
    control : ControlStatus
        Who has control of top drive and pumps, what was asked and what the rig does.
    advice : Advice
        How to drill the next interval.
    downlink : DownlinkStatus or None
        The command to the tool.
    inputs : InputTable
        Clocks and ages of the inputs, and which gives the depth.
    recorder : RecorderStatus or None
    diagnostics : tuple of NodeDiagnostic
        Worst first.
    events : tuple of Event
        Newest first.
    well_given : bool
        Whether somebody described the well; False: its description is assumed.
    over_link : bool or None
        Whether a telemetry link stands between tool and surface; None: not known.
    over : bool
        Whether the simulation or replay that makes the data has come to its end.
    history, trend, depth_log : Chart
        Charts over the last minutes, over the last hours (in larger steps), and over the depth of the sensor.
    logs : tuple of Curve
        Log channels over depth, first pass.
    newest_logs : mapping of str to Newest
        Newest value of each log channel.
    tool_health : ToolHealth
        Battery, run time, exposures, self-tests and parts of the tool.
    changes : mapping of str to Change
        How often and when each part was set, by its name (a field of this class). A part that was never set is missing.
    """

    now: float = 0.0
    attitude: AttitudeState = dataclasses.field(default_factory=AttitudeState)
    toolface: ToolfaceState = dataclasses.field(default_factory=ToolfaceState)
    drilling: DrillingState = dataclasses.field(default_factory=DrillingState)
    rig: RigState = dataclasses.field(default_factory=RigState)
    streams: Mapping[str, StreamState] = dataclasses.field(default_factory=dict)
    well: Well = dataclasses.field(default_factory=Well)
    well_given: bool = True
    over_link: bool | None = None
    over: bool = False
    reference_given: ReferenceField | None = None
    surveys: SurveyList = dataclasses.field(default_factory=SurveyList)
    path: Definitive | None = None
    covariance: Array | None = None
    rods: RodCount | None = None
    plan: Plan | None = None
    offset: Offset | None = None
    deviation: tuple[Deviation, ...] = ()
    branches: tuple[Branch, ...] = ()
    closure: Closure | None = None
    clearance: tuple[Clearance, ...] = ()
    clearance_remarks: tuple[Remark, ...] = ()
    stretches: tuple[Stretch, ...] = ()
    yields: tuple[Yield, ...] = ()
    quill: float | None = None
    link: LinkStatus | None = None
    control: ControlStatus = dataclasses.field(default_factory=ControlStatus)
    advice: Advice = dataclasses.field(default_factory=Advice)
    downlink: DownlinkStatus | None = None
    inputs: InputTable = dataclasses.field(default_factory=InputTable)
    survey_progress: SurveyProgress = dataclasses.field(default_factory=SurveyProgress)
    recorder: RecorderStatus | None = None
    diagnostics: tuple[NodeDiagnostic, ...] = ()
    alarms: AlarmState = dataclasses.field(default_factory=AlarmState)
    events: tuple[Event, ...] = ()
    history: Chart = dataclasses.field(default_factory=Chart)
    trend: Chart = dataclasses.field(default_factory=Chart)
    depth_log: Chart = dataclasses.field(default_factory=Chart)
    logs: tuple[Curve, ...] = ()
    newest_logs: Mapping[str, Newest] = dataclasses.field(default_factory=dict)
    tool_health: ToolHealth = dataclasses.field(default_factory=ToolHealth)
    changes: Mapping[str, Change] = dataclasses.field(default_factory=dict)

    @property
    def reference(self) -> ReferenceField:
        """Reference field in force: the one given, else that of the latest survey that has one."""
        if self.reference_given is not None:
            return self.reference_given
        known = (record.survey for record in self.surveys.records if record.survey.has_reference)
        last = max(known, key=lambda survey: survey.stamp_ns, default=None)
        return ReferenceField() if last is None else ReferenceField.of_survey(last)

    @property
    def section_azimuth(self) -> float:
        """Azimuth of the vertical section, rad: of the path, else of the well, else of the plan."""
        if self.path is not None:
            return self.path.section_azimuth
        if self.well.section_azimuth_deg is not None:
            return math.radians(self.well.section_azimuth_deg)
        return 0.0 if self.plan is None else self.plan.section_azimuth

    def change(self, part: str) -> Change:
        """Return how often a part was set, and when."""
        return self.changes.get(part, Change())

    def age(self, part: str) -> float | None:
        """Return the time since a part was last set, s; None before the first."""
        at = self.change(part).at
        return None if at is None else max(0.0, self.now - at)
