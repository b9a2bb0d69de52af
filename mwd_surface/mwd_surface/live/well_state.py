# SPDX-License-Identifier: Apache-2.0
"""
The state of a well at one moment, typed: what the live page shows and what the rig interfaces send.

`live_state.LiveState.at` makes it. The page turns it into its JSON, the rig into its values. Numbers are SI and rad,
finite; None means unknown, and zero is only ever a measured zero. Times are s of one steady clock, except stamps, which
are ns since the epoch and come from the measurement.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.unknown import or_none
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.control.status import ControlStatus
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.list_files.remark import Remark
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.latest_values import Freshness, LiveValue, StreamState
from mwd_surface.live.link_state import LinkStatus
from mwd_surface.live.strip_history import Row
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.plan import Offset, Plan
from mwd_surface.trajectory.slide_sheet import Stretch, Yield
from mwd_surface.trajectory.well_path import Definitive

NO_STATUS = Status(0)
# Far below what drills and far above what a sensor reads of standing mud.
_LEAST_FLOW = 100e-3 / 60.0  # m^3/s
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

    inclination: LiveValue
    azimuth: LiveValue
    gravity_toolface: Angle | None = None
    magnetic_toolface: Angle | None = None
    status: Status = NO_STATUS
    north: North = North.UNKNOWN
    stamp_ns: int | None = None


@dataclasses.dataclass(frozen=True)
class DialReading:
    """An earlier toolface on the dial: angle, rad; mode GRAVITY or MAGNETIC; at, s of the steady clock."""

    angle: float
    mode: int
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
    mode : int
        GRAVITY or MAGNETIC.
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

    angle: LiveValue
    mode: int = GRAVITY
    rotating: bool = False
    stamp_ns: int | None = None
    measured_ns: int | None = None
    readings: tuple[DialReading, ...] = ()
    advisory: Advisory | None = None
    threshold: float | None = None


@dataclasses.dataclass(frozen=True)
class DrillingState:
    """Drilling dynamics, temperature and interference; units as in the signal table."""

    vibration: LiveValue
    rotary_speed: LiveValue
    stick_slip: LiveValue
    axial_vibration: LiveValue
    lateral_vibration: LiveValue
    shocks: LiveValue
    shock_peak: LiveValue
    rotary_least: LiveValue
    rotary_most: LiveValue
    temperature: LiveValue
    total_field: LiveValue
    axial_interference: LiveValue
    cross_axial_interference: LiveValue
    field_deviation: LiveValue
    dip_deviation: LiveValue


@dataclasses.dataclass(frozen=True)
class RigState:
    """Measurements of the rig; in_slips: None where the rig does not report it."""

    bit_depth: LiveValue
    hole_depth: LiveValue
    block_position: LiveValue
    hookload: LiveValue
    weight_on_bit: LiveValue
    torque: LiveValue
    rotary_speed: LiveValue
    flow_rate: LiveValue
    pressure: LiveValue
    rate_of_penetration: LiveValue
    in_slips: bool | None = None

    @property
    def pumps_on(self) -> bool | None:
        """Whether mud is pumped, by flow or else by standpipe pressure; None where the rig reports neither."""
        for measured, least in ((self.flow_rate, _LEAST_FLOW), (self.pressure, _LEAST_PRESSURE)):
            if measured.state == Freshness.LIVE and measured.value is not None:
                return measured.value > least
        return None


@dataclasses.dataclass(frozen=True)
class ReferenceField:
    """The reference field in force: T, rad, m/s^2; source: where it comes from, in words."""

    total: float | None = None
    dip: float | None = None
    declination: float | None = None
    convergence: float | None = None
    gravity: float | None = None
    source: str = ""

    @classmethod
    def of_survey(cls, survey: Survey) -> ReferenceField:
        """Return the reference a survey was judged by."""
        return cls(
            total=or_none(survey.b_reference),
            dip=or_none(survey.dip_reference),
            declination=or_none(survey.declination),
            convergence=or_none(survey.convergence),
            gravity=or_none(survey.g_reference),
            source=f"as of survey {survey.sequence}",
        )


@dataclasses.dataclass(frozen=True)
class SurveyProgress:
    """
    A survey or north seek under way: elapsed and remaining, s; result: how the last one ended.

    waits_for: why a survey that has averaged enough is not given yet; elapsed and remaining are then of that wait.
    """

    active: bool = False
    state: str = ""
    elapsed: float | None = None
    remaining: float | None = None
    result: str = ""
    waits_for: str = ""


@dataclasses.dataclass(frozen=True)
class NodeDiagnostic:
    """A line of diagnostics of a node; level: 0 ok, 1 warning, 2 error, 3 stale."""

    name: str
    level: int
    message: str
    remedy: str = ""


@dataclasses.dataclass(frozen=True)
class Chart:
    """Rows of a strip chart, oldest or shallowest first, the names of their columns, and its length, s or m."""

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    length: float


@dataclasses.dataclass(frozen=True)
class Change:
    """How often a part of the state changed, and when it last did, s of the steady clock."""

    count: int = 0
    at: float | None = None


@dataclasses.dataclass(frozen=True)
class WellState:
    """
    All that is known of a well at `now`.

    Attributes
    ----------
    now : float
        s of the steady clock.
    streams : mapping of str to StreamState
        The streams by name.
    records, remarks
        The survey list, in its order, and the remarks behind it.
    path, covariance
        The well path, and the covariance of its first m positions, shape (m, 3, 3), m^2.
    offset : Offset or None
        From the plan to the end of the path.
    dogleg_to_target : float or None
        Of the arc that hits the target, rad/m.
    clearance, clearance_remarks
        To offset wells from the last survey on, the nearest by the rule first; what it left out and assumed.
    stretches, yields
        The slide sheet, deepest last.
    quill : float or None
        Angle of the quill, rad clockwise looking down-hole from the zero of the rig.
    control : ControlStatus
        Who has control of top drive and pumps, what was asked and what the rig does.
    advice : Advice
        How to drill the next interval.
    inputs : InputTable
        Clocks and ages of the inputs, and which gives the depth.
    recorder : RecorderStatus or None
    diagnostics : tuple of NodeDiagnostic
        Worst first.
    alarms, events
        Newest first.
    not_evaluated : tuple of str
        Kinds of alarms that could not be judged, in words.
    well_given : bool
        Whether somebody described the well; False: its description is assumed.
    over_link : bool or None
        Whether a telemetry link stands between tool and surface; None: not known.
    clock_offset : float or None
        Time since the epoch minus `now` when the alarms came, s: turns their stamps into ages.
    history, trend, depth_log : Chart
        Charts over the last minutes, over the last hours (in larger steps), and over the depth of the sensor.
    changes : mapping of str to Change
        By the name of the part (a field of this class); a part that never changed is missing.
    """

    now: float
    attitude: AttitudeState
    toolface: ToolfaceState
    drilling: DrillingState
    rig: RigState
    streams: Mapping[str, StreamState]
    well: Well
    reference: ReferenceField
    records: tuple[SurveyRecord, ...]
    remarks: tuple[Remark, ...]
    path: Definitive | None
    covariance: Array | None
    plan: Plan | None
    offset: Offset | None
    dogleg_to_target: float | None
    clearance: tuple[Clearance, ...]
    clearance_remarks: tuple[Remark, ...]
    stretches: tuple[Stretch, ...]
    yields: tuple[Yield, ...]
    quill: float | None
    survey_progress: SurveyProgress
    recorder: RecorderStatus | None
    diagnostics: tuple[NodeDiagnostic, ...]
    alarms: tuple[Alarm, ...]
    events: tuple[Event, ...]
    clock_offset: float | None
    history: Chart
    trend: Chart
    depth_log: Chart
    changes: Mapping[str, Change]
    link: LinkStatus | None = None
    control: ControlStatus = dataclasses.field(default_factory=ControlStatus)
    advice: Advice = dataclasses.field(default_factory=Advice)
    downlink: DownlinkStatus | None = None
    inputs: InputTable = dataclasses.field(default_factory=InputTable)
    not_evaluated: tuple[str, ...] = ()
    over_link: bool | None = None
    well_given: bool = True

    @property
    def against_plan(self) -> dict[str, float | None]:
        """Fields of the offset from the plan, and the dogleg severity to the target; empty where there is none."""
        return {} if self.offset is None else {**vars(self.offset), "dogleg_to_target": self.dogleg_to_target}

    def change(self, part: str) -> Change:
        """Return how often a part changed, and when."""
        return self.changes.get(part, Change())

    def age(self, part: str) -> float | None:
        """Return the time since the last change of a part, s; None before the first."""
        at = self.change(part).at
        return None if at is None else max(0.0, self.now - at)
