"""
What the driller's page shows: the last good value of everything, with sigma, unit, age and whether it still counts.

Messages go in as they come, `snapshot` gives plain tables ready for JSON: finite numbers, text, lists, None. None is
"no data"; zero is only ever a measured zero. Numbers are SI and rad; the page converts them.

No clock here: every call takes `now`, s, of one steady clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mwd_estimation.status import Status, words
from mwd_sensors import settings as settings_tables
from mwd_sensors.frames import Array
from mwd_sensors.settings import setting
from mwd_sensors.wire import Samples
from mwd_surface.page.alarms import Alarm, Event, plain_alarms, plain_events
from mwd_surface.page.live_values import LIVE, NO_DATA, LiveValues
from mwd_surface.page.plain import number, numbers
from mwd_surface.page.strip_history import StripHistory
from mwd_surface.page.survey_panel import NORTH_WORDS, Limits, field_of, path_table, quality_lights, survey_row
from mwd_surface.page.toolface import ToolfaceReading, ToolfaceSelector, ToolfaceSettings
from mwd_surface.surveys.plan import Offset, Plan
from mwd_surface.surveys.survey_record import North, SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive

RECORDER_WORDS = ("stopped", "recording", "paused: disk full", "failed")
TOOLFACE_WORDS = ("gravity", "magnetic")
LEVEL_WORDS = ("ok", "warning", "error", "stale")

# Every single value: its unit and the stream it comes with.
_VALUES = {
    "inclination": ("rad", "estimator"),
    "azimuth": ("rad", "estimator"),
    "toolface": ("rad", "estimator"),
    "vibration": ("m/s^2", "estimator"),
    "rotary_speed": ("rad/s", "estimator"),
    "gravity_sigma": ("rad", "estimator"),
    "stick_slip": ("", "dynamics"),
    "axial_vibration": ("m/s^2", "dynamics"),
    "lateral_vibration": ("m/s^2", "dynamics"),
    "shocks": ("", "dynamics"),
    "shock_peak": ("m/s^2", "dynamics"),
    "rotary_least": ("rad/s", "dynamics"),
    "rotary_most": ("rad/s", "dynamics"),
    "temperature": ("degC", "temperature"),
    "total_field": ("T", "magnetometer"),
    "axial_interference": ("T", "interference"),
    "cross_axial_interference": ("T", "interference"),
    "field_deviation": ("T", "interference"),
    "dip_deviation": ("rad", "interference"),
    "bit_depth": ("m", "rig"),
    "hole_depth": ("m", "rig"),
    "block_position": ("m", "rig"),
    "hookload": ("N", "rig"),
    "weight_on_bit": ("N", "rig"),
    "torque": ("N m", "rig"),
    "rig_rotary_speed": ("rad/s", "rig"),
    "flow_rate": ("m^3/s", "rig"),
    "pressure": ("Pa", "rig"),
    "rate_of_penetration": ("m/s", "rig"),
}
# Bits of RigState.valid and the fields they vouch for, in order from 1.
_RIG_FIELDS = (
    "bit_depth", "hole_depth", "block_position", "hookload", "weight_on_bit", "torque", "rotary_speed", "flow_rate",
    "pressure", "rate_of_penetration",
)  # fmt: skip
_RIG_SLIPS = 1024
_DRILLING = (
    "vibration", "rotary_speed", "stick_slip", "axial_vibration", "lateral_vibration", "shocks", "shock_peak",
    "rotary_least", "rotary_most", "temperature", "total_field", "axial_interference", "cross_axial_interference",
    "field_deviation", "dip_deviation",
)  # fmt: skip
_RIG = tuple(name for name, (_, stream) in _VALUES.items() if stream == "rig")
_HISTORY = {
    "vibration": "max",
    "rotary_speed": "mean",
    "stick_slip": "max",
    "axial_vibration": "max",
    "lateral_vibration": "max",
    "shocks": "max",
    "temperature": "mean",
    "total_field": "mean",
    "axial_interference": "mean",
    "inclination": "mean",
    "doubt": "max",
}
# The same over the depth of the sensor while hole is made.
_LOGGED = {
    "inclination": "mean",
    "vibration": "max",
    "rotary_speed": "mean",
    "stick_slip": "max",
    "shocks": "max",
    "doubt": "max",
}
_STREAMS = ("sonde", "estimator", "magnetometer", "temperature", "interference", "dynamics", "rig", "recorder")
_NO_PLAN: dict[str, Any] = {"name": "", "north": [], "east": [], "vertical_depth": [], "vertical_section": []}
# What makes a stretch of the tracks doubtful (1) or bad (2).
_DOUBTFUL = Status.CLIPPED | Status.ALIASED | Status.MAG_DISTURBED | Status.NO_MAG | Status.REJECTED
_BAD = Status.SENSOR_FAULT | Status.INITIALISING
# What the status says about a value that is withheld.
_WHY = (
    (Status.SENSOR_FAULT, "a sensor is judged faulty"),
    (Status.INITIALISING, "the estimator is still settling"),
    (Status.NEAR_VERTICAL, "not defined this near to vertical"),
    (Status.NO_MAG, "no usable magnetometer"),
)


@dataclasses.dataclass(frozen=True)
class LiveSettings:
    """How often what is expected, and how much is kept for the page. A value is stale after two expected periods."""

    estimator_period: float = setting(0.5, "longest usual time between attitudes", unit="s", low=0.05)
    dynamics_period: float = setting(1.0, "time between summaries of drilling dynamics", unit="s", low=0.05)
    rig_period: float = setting(1.0, "time between rig data", unit="s", low=0.05)
    temperature_period: float = setting(1.0, "time between temperatures", unit="s", low=0.05)
    magnetometer_period: float = setting(0.5, "time between fields", unit="s", low=0.05)
    interference_period: float = setting(1.0, "time between interference estimates", unit="s", low=0.05)
    recorder_period: float = setting(1.0, "time between recorder reports", unit="s", low=0.05)
    sonde_period: float = setting(0.5, "longest usual time between raw samples", unit="s", low=0.05)
    withheld_sigma_deg: float = setting(
        45.0, "an angle less certain than this is not shown", unit="deg", low=1.0, high=180.0
    )
    readings: int = setting(12, "last toolfaces on the dial", low=1, high=60)
    reading_spacing: float = setting(1.0, "shortest time between two of them", unit="s", low=0.0)
    history_seconds: float = setting(600.0, "length of the strip charts", unit="s", low=10.0, high=7200.0)
    history_rate: float = setting(1.0, "points of the strip charts per second", unit="Hz", low=0.1, high=5.0)
    log_step: float = setting(0.5, "depth of one point of the depth tracks", unit="m", low=0.05, high=10.0)
    log_length: float = setting(600.0, "length of the depth tracks", unit="m", low=10.0, high=5000.0)
    max_rows: int = setting(1000, "survey rows and path stations sent to the page", low=10, high=10000)
    toolface: ToolfaceSettings = setting(ToolfaceSettings)
    limits: Limits = setting(Limits)


class LiveState:
    """
    Everything the page shows.

    Methods `on_...` take what arrived; angles and times as in the messages. What is not finite is left out and, for
    single values, does not count as an update. `snapshot` may be called at any rate; it costs little when little
    changed. Not thread-safe: call it all from one thread; what a snapshot returns may be read from any.
    """

    def __init__(self, settings: LiveSettings | None = None) -> None:
        self.settings = settings or LiveSettings()
        self.toolface_reading: ToolfaceReading | None = None
        self._selector = ToolfaceSelector(self.settings.toolface)
        periods = {name: float(getattr(self.settings, f"{name}_period")) for name in _STREAMS}
        self._values = LiveValues(_VALUES, periods)
        self._readings: deque[dict[str, Any]] = deque(maxlen=self.settings.readings)
        self._history = StripHistory(_HISTORY, self.settings.history_seconds, self.settings.history_rate)
        self._log = StripHistory(_LOGGED, self.settings.log_length, 1.0 / self.settings.log_step)
        self._log_depth: float | None = None
        self._plain: dict[str, dict[str, Any]] = {
            "well": _well(Well()),
            "quality": quality_lights(None, self.settings.limits),
            "surveys": {"rows": [], "left_out": 0},
            "path": path_table(None, 0.0, None, self.settings.max_rows),
            "plan": _NO_PLAN,
            "offset": {"known": False},
            "steering": {"rows": [], "yields": [], "left_out": 0},
            "quill": {"angle": None},
            "survey_progress": {"active": False, "state": "", "elapsed": None, "remaining": None, "result": ""},
            "recorder": {"state": NO_DATA},
            "telemetry": {"known": False},
            "findings": {"rows": []},
            "alarms": {"rows": []},
            "events": {"rows": []},
        }
        self._since: dict[str, float] = {}
        self._attitude: dict[str, Any] = {"status": [], "north": "", "stamp_ns": None}
        self._advisory: tuple[float, float] | None = None
        self._in_slips: bool | None = None
        self._links: dict[str, Any] = {}
        self._links_at = -math.inf
        self._well = Well()
        self._field: Mapping[str, float | str] | None = None
        self._survey_field: Mapping[str, float | str] = {}
        self._counts: dict[str, int] = {}
        self._signatures: dict[str, Any] = {}
        self._revisions: dict[str, int] = {}

    # Single values.

    def on_stream(self, stream: str, count: int, now: float, lost: int = 0) -> None:
        """
        Messages of a stream arrived: for rate, age and losses.

        Raises
        ------
        ValueError
            No such stream.
        """
        self._values.arrived(stream, count, now, lost)

    def on_attitude(self, samples: Samples, now: float) -> None:
        """Attitudes arrived, `wire.ATTITUDE`, oldest first; also picks the toolface (`toolface_reading`)."""
        if len(samples) == 0:
            return
        self.on_stream("estimator", len(samples), now)
        last = samples[-1]
        status, north = int(last["status"]), int(last["north"])
        why = next((text for bit, text in _WHY if status & bit), "the estimator gives no sigma")
        for name in ("inclination", "azimuth"):
            self._angle(name, float(last[name]), float(last["sigma_" + name]), why, now)
        inclination = self._values.updated("inclination", now)
        if inclination is not None:
            self._chart("inclination", inclination, now)
        every = int(np.bitwise_or.reduce(samples["status"]))
        self._chart("doubt", 2.0 if every & _BAD else 1.0 if every & _DOUBTFUL else 0.0, now)
        text = [word for word in words(status).split("|") if word]
        self._attitude = {
            "status": text,
            "north": NORTH_WORDS[north] if north < len(NORTH_WORDS) else "",
            "stamp_ns": int(last["stamp_ns"]),
        }
        self._touch("attitude")
        speed = self._values.last("rotary_speed")
        reading = self._selector.update(samples, 0.0 if speed is None else speed)
        if reading is not None:
            self.on_toolface(reading, now, why)

    def on_toolface(self, reading: ToolfaceReading, now: float, why: str = "not available") -> None:
        """A toolface to steer by, where it does not come from `on_attitude`. `why`: said where it has no sigma."""
        self.toolface_reading = reading
        self._angle("toolface", reading.angle, reading.sigma, why, now)
        self._touch("toolface")
        value = self._values.updated("toolface", now)
        if value is None:
            return
        # Two readings need not be exactly one spacing apart to be the next ones.
        if self._readings and now - self._readings[-1]["at"] < self.settings.reading_spacing * 0.95:
            return
        self._readings.append(
            {
                "angle": number(value),
                "mode": TOOLFACE_WORDS[reading.mode],
                "at": number(now),
                "rotating": reading.rotating,
                "stamp_ns": reading.stamp_ns,
            }
        )

    def on_gravity(self, samples: Samples, now: float) -> None:
        """Gravity arrived, `wire.GRAVITY`: vibration (the largest of the block) and rotary speed of the tool."""
        known = samples[samples["sigma"] >= 0.0]
        if len(known) == 0:
            return
        self._put("vibration", float(np.max(known["non_gravity"])), None, now)
        self._put("rotary_speed", float(known["rotary_speed"][-1]), None, now)
        self._put("gravity_sigma", float(known["sigma"][-1]), None, now)

    def on_dynamics(self, samples: Samples, now: float) -> None:
        """Summaries of drilling dynamics arrived, `wire.DYNAMICS`; the last is shown."""
        if len(samples) == 0:
            return
        self.on_stream("dynamics", len(samples), now)
        last = samples[-1]
        if last["stick_slip_index"] >= 0.0:
            self._put("stick_slip", float(last["stick_slip_index"]), None, now)
        else:
            self._withhold("stick_slip", "not turning")
        for name, field in (
            ("axial_vibration", "axial_rms"),
            ("lateral_vibration", "lateral_rms"),
            ("shocks", "shocks"),
            ("shock_peak", "shock_peak"),
            ("rotary_least", "rotary_speed_least"),
            ("rotary_most", "rotary_speed_most"),
        ):
            self._put(name, float(last[field]), None, now)

    def on_temperature(self, samples: Samples, now: float) -> None:
        """Temperatures of the sonde arrived, `wire.TEMPERATURE`; a variance of 0 means unknown."""
        if len(samples) == 0:
            return
        self.on_stream("sonde", len(samples), now)
        self.on_stream("temperature", len(samples), now)
        last = samples[-1]
        variance = float(last["variance"])
        self._put("temperature", float(last["temperature"]), math.sqrt(variance) if variance > 0.0 else None, now)

    def on_magnetic_field(self, samples: Samples, now: float) -> None:
        """Fields arrived, `wire.MAG`: the mean of their totals is shown."""
        if len(samples) == 0:
            return
        self.on_stream("sonde", len(samples), now)
        self.on_stream("magnetometer", len(samples), now)
        totals = np.linalg.norm(samples["magnetic_field"], axis=1)
        self._put("total_field", float(np.mean(totals)), None, now)

    def on_interference(self, samples: Samples, now: float) -> None:
        """Interference estimates arrived, `wire.INTERFERENCE`."""
        if len(samples) == 0:
            return
        self.on_stream("interference", len(samples), now)
        last = samples[-1]
        axial, sigma = float(last["axial"]), float(last["sigma_axial"])
        across = np.asarray(last["cross_axial"], dtype=float)
        sigma_across = np.asarray(last["sigma_cross_axial"], dtype=float)
        self._put_known("axial_interference", axial, sigma, now)
        self._put_known("cross_axial_interference", float(np.hypot(*across)), float(np.min(sigma_across)), now)
        observable = sigma >= 0.0 or bool(np.any(sigma_across >= 0.0))
        if observable or last["total_residual"] != 0.0 or last["dip_residual"] != 0.0:
            self._put("field_deviation", float(last["total_residual"]), None, now)
            self._put("dip_deviation", float(last["dip_residual"]), None, now)

    def on_rig_state(self, samples: Samples, now: float) -> None:
        """Rig data arrived, `wire.RIG_STATE`; only what its `valid` vouches for is taken."""
        if len(samples) == 0:
            return
        self.on_stream("rig", len(samples), now)
        last = samples[-1]
        valid = int(last["valid"])
        for k, field in enumerate(_RIG_FIELDS):
            if valid & (1 << k):
                self._put("rig_rotary_speed" if field == "rotary_speed" else field, float(last[field]), None, now)
        self._in_slips = bool(last["in_slips"]) if valid & _RIG_SLIPS else None

    def on_log_depth(self, depth: float | None) -> None:
        """Depth of the sensor, m, while hole is made: what comes next belongs there. None: nothing is drilled."""
        self._log_depth = depth if depth is not None and math.isfinite(depth) and depth >= 0.0 else None
        if self._log_depth is not None:
            self._log.advance(self._log_depth)

    def on_quill(self, angle: float, now: float) -> None:
        """Where the quill stands, rad clockwise looking down-hole from where the rig counts."""
        if math.isfinite(angle):
            self._store("quill", {"angle": number(angle % math.tau)}, now)

    # Tables and states.

    def on_well(self, well: Well, now: float, field: Mapping[str, float | str] | None = None) -> None:
        """
        The well, and the reference field in force where there is one.

        field: any of total (T), dip, declination, convergence (rad), gravity (m/s^2) and source (text). Without it the
        reference of the last survey is shown.
        """
        self._well, self._field = well, field
        self._store("well", {**_well(well), **_reference(field or self._survey_field)}, now)

    def on_records(self, records: Iterable[SurveyRecord | Mapping[str, Any]], now: float) -> None:
        """
        The survey list changed; all its records, in order.

        Raises
        ------
        ValueError
            A plain record does not have the shape of a SurveyRecord.
        """
        whole = [
            r if isinstance(r, SurveyRecord) else settings_tables.from_mapping(SurveyRecord, r, "record")
            for r in records
        ]
        north = North[self._well.north_reference.upper()]
        kept = whole[-self.settings.max_rows :]
        self._store("surveys", {"rows": [survey_row(r, north) for r in kept], "left_out": len(whole) - len(kept)}, now)
        last = max(whole, key=lambda r: r.survey.stamp_ns, default=None)
        self._store("quality", quality_lights(last, self.settings.limits), now)
        if last is not None and last.survey.has_reference:
            self._survey_field = field_of(last.survey)
            self.on_well(self._well, now, self._field)

    def on_trajectory(self, path: Definitive, now: float, covariance: Array | None = None) -> None:
        """The well path changed. covariance, shape (m, 3, 3): of its first m positions, m^2, for the ellipses."""
        self._store("path", path_table(path, path.section_azimuth, covariance, self.settings.max_rows), now)

    def on_plan(self, plan: Plan | None, now: float) -> None:
        """The planned path, dense enough to draw (`plan.interpolated`); None: there is none."""
        if plan is None:
            self._store("plan", _NO_PLAN, now)
            return
        step = max(1, -(-len(plan.md) // self.settings.max_rows))
        positions = np.vstack([plan.positions[:-1:step], plan.positions[-1:]])
        section = math.radians(self._well.section_azimuth_deg)
        along = positions[:, 0] * math.cos(section) + positions[:, 1] * math.sin(section)
        table = {
            "name": plan.name,
            "north": numbers(positions[:, 0]),
            "east": numbers(positions[:, 1]),
            "vertical_depth": numbers(positions[:, 2]),
            "vertical_section": numbers(along),
        }
        self._store("plan", table, now)

    def on_offset(self, offset: Offset | None, now: float, dogleg_to_target: float | None = None) -> None:
        """Where the end of the well is from the plan; dogleg_to_target: rad/m of the arc that hits the target."""
        if offset is None:
            self._store("offset", {"known": False}, now)
            return
        table: dict[str, Any] = {key: number(value) for key, value in dataclasses.asdict(offset).items()}
        self._store("offset", {"known": True, **table, "dogleg_to_target": number(dogleg_to_target)}, now)

    def on_advisory(self, toolface: float | None, limit: float, now: float) -> None:
        """Toolface wanted and what it may be off, rad; None: no advice."""
        good = toolface is not None and math.isfinite(toolface) and math.isfinite(limit)
        self._advisory = (float(toolface) % math.tau, abs(float(limit))) if good and toolface is not None else None
        self._since["advisory"] = now
        self._touch("toolface")

    def on_steering(self, rows: Sequence[Mapping[str, Any]], yields: Sequence[Mapping[str, Any]], now: float) -> None:
        """What was slid and rotated, deepest last, and what the slides gave, as plain tables."""
        kept = list(rows)[-self.settings.max_rows :]
        table = {"rows": kept, "yields": list(yields)[-self.settings.max_rows :], "left_out": len(rows) - len(kept)}
        if table != self._plain["steering"]:
            self._store("steering", table, now)

    def on_survey_progress(
        self, active: bool, now: float, elapsed: float = 0.0, remaining: float = 0.0, state: str = "", result: str = ""
    ) -> None:
        """A survey or north seek is being taken (s elapsed and to go, state in words), or ended with a result."""
        table = {
            "active": active,
            "state": state,
            "elapsed": number(elapsed) if active else None,
            "remaining": number(remaining) if active else None,
            "result": result,
        }
        self._store("survey_progress", table, now)

    def on_recorder(self, status: Any, now: float) -> None:
        """What the recorder does: a mapping or object with the fields of RecorderStatus."""
        self.on_stream("recorder", 1, now)
        state = int(_field(status, "state", 0))
        table = {
            "state": RECORDER_WORDS[state] if 0 <= state < len(RECORDER_WORDS) else NO_DATA,
            "path": str(_field(status, "path", "")),
            "reason": str(_field(status, "reason", "")),
            **{k: int(_field(status, k, 0)) for k in ("messages", "bytes", "dropped", "free_bytes")},
            "duration": number(_field(status, "duration", 0.0)),
        }
        self._store("recorder", table, now)

    def on_telemetry(self, received: int, lost: int, now: float, confidence: float | None = None) -> None:
        """Packets of the link from down-hole since start, and the decoder's confidence, 0 to 1, where it has one."""
        total = received + lost
        table = {
            "known": True,
            "received": received,
            "lost": lost,
            "share": number(received / total) if total > 0 else None,
            "confidence": number(confidence),
        }
        self._store("telemetry", table, now)

    def on_diagnostics(self, findings: Iterable[Any], now: float) -> None:
        """
        Findings of all nodes as of now: mappings or objects with name, level (0 to 3, or one byte), message, remedy.
        """
        rows = []
        for finding in findings:
            level = _field(finding, "level", 0)
            number = level[0] if isinstance(level, (bytes, bytearray)) else int(level)
            rows.append(
                {
                    "name": str(_field(finding, "name", "")),
                    "level": LEVEL_WORDS[min(max(number, 0), 3)],
                    "message": str(_field(finding, "message", "")),
                    "remedy": str(_field(finding, "remedy", "")),
                }
            )
        rows.sort(key=lambda row: (-LEVEL_WORDS.index(row["level"]), row["name"]))
        table = {"rows": rows[:200]}
        if table != {"rows": self._plain["findings"]["rows"]}:
            self._store("findings", table, now)

    def on_alarms(self, alarms: Sequence[Alarm], events: Sequence[Event], now: float) -> None:
        """Alarms and events, newest first (`AlarmBook.alarms`, `.events`)."""
        self._store("alarms", {"rows": plain_alarms(alarms)}, now)
        self._store("events", {"rows": plain_events(events[:200])}, now)

    # Out.

    def snapshot(self, now: float) -> dict[str, Any]:
        """
        All of it, ready for JSON.

        Returns
        -------
        dict
            now: as given. sections: name to table. revisions: name to a number that changes whenever the table does,
            apart from the ages in it. Single values are {value, sigma, unit, at, age, stale_after, state, reason}:
            value None while there never was one, state "live", "stale" or "no data", at in s of the clock of `now`.
            Tables carry since and age of their last change. Sections history and depth_log are {columns, rows}, oldest
            and shallowest row first; the first column is s of that clock, or m of depth of the sensor.
        """
        self._history.advance(now)
        sections: dict[str, Any] = {}
        builders: dict[str, Callable[[float], tuple[dict[str, Any], Iterable[str]]]] = {
            "attitude": self._build_attitude,
            "toolface": self._build_toolface,
            "drilling": lambda at: self._cells(_DRILLING, at),
            "rig": self._build_rig,
            "recorder": self._build_recorder,
            "links": self._build_links,
        }
        for name, build in builders.items():
            # Growing old is news too.
            sections[name], states = build(now)
            self._revise(name, (self._counts.get(name, 0), tuple(states)))
        for name, table in self._plain.items():
            if name not in sections:
                sections[name] = self._dated(name, table, now)
                self._revise(name, self._counts.get(name, 0))
        for name, strip in (("history", self._history), ("depth_log", self._log)):
            rows = strip.rows()
            sections[name] = {"columns": list(strip.columns), "rows": rows}
            self._revise(name, rows[-1][0] if rows else None)
        return {"now": number(now), "sections": sections, "revisions": dict(self._revisions)}

    def _cells(self, names: Iterable[str], now: float) -> tuple[dict[str, Any], list[str]]:
        cells = {name: self._values.cell(name, now) for name in names}
        return cells, [cell["state"] for cell in cells.values()]

    def _build_attitude(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cells, states = self._cells(("inclination", "azimuth"), now)
        return {**cells, **self._attitude}, states

    def _build_toolface(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cell, reading = self._values.cell("toolface", now), self.toolface_reading
        advisory = None
        if self._advisory is not None:
            target, limit = self._advisory
            inside = None
            if cell["state"] == LIVE:
                inside = abs(math.remainder(cell["value"] - target, math.tau)) <= limit
            advisory = {"toolface": number(target), "limit": number(limit), "inside": inside}
        table = {
            "angle": cell,
            "mode": TOOLFACE_WORDS[self._selector.mode if reading is None else reading.mode],
            "known": reading is not None,
            "rotating": bool(reading and reading.rotating),
            "stamp_ns": None if reading is None else reading.stamp_ns,
            "north": self._attitude["north"],
            "threshold_deg": self.settings.toolface.magnetic_below_deg,
            "hysteresis_deg": self.settings.toolface.hysteresis_deg,
            "readings": list(self._readings),
            "advisory": advisory,
        }
        return table, [cell["state"]]

    def _build_rig(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cells, states = self._cells(_RIG, now)
        return {**cells, "in_slips": self._in_slips}, states

    def _build_recorder(self, now: float) -> tuple[dict[str, Any], list[str]]:
        table = self._dated("recorder", self._plain["recorder"], now)
        fresh = self._values.freshness("recorder", table["age"])
        return {**table, "fresh": fresh, "stale_after": self._values.stale_after("recorder")}, [fresh]

    def _build_links(self, now: float) -> tuple[dict[str, Any], list[str]]:
        rows = self._values.links(now)
        # The counts run all the time; once a second is enough for people.
        if now - self._links_at >= 1.0 or now < self._links_at:
            self._links_at = now
            self._touch("links")
        return rows, [row["state"] for row in rows.values()]

    def _angle(self, name: str, value: float, sigma: float, why: str, now: float) -> None:
        if not (math.isfinite(value) and math.isfinite(sigma) and sigma >= 0.0):
            self._withhold(name, why)
        elif math.degrees(sigma) > self.settings.withheld_sigma_deg:
            self._withhold(name, f"sigma {math.degrees(sigma):.0f} deg" if "sigma" in why else why)
        else:
            self._put(name, value, sigma, now)

    def _put_known(self, name: str, value: float, sigma: float, now: float) -> None:
        if sigma >= 0.0:
            self._put(name, value, sigma, now)
        else:
            self._withhold(name, "not observable yet")

    def _put(self, name: str, value: float, sigma: float | None, now: float) -> None:
        if not math.isfinite(value):
            return
        self._values.put(name, value, sigma, now)
        self._touch(_SECTION_OF[name])
        if name != "inclination":
            self._chart(name, value, now)

    def _chart(self, name: str, value: float, now: float) -> None:
        if name in _HISTORY:
            self._history.add(name, value, now)
        if name in _LOGGED and self._log_depth is not None:
            self._log.add(name, value, self._log_depth)

    def _withhold(self, name: str, why: str) -> None:
        if self._values.withhold(name, why):
            self._touch(_SECTION_OF[name])

    def _store(self, section: str, table: dict[str, Any], now: float) -> None:
        self._plain[section] = table
        self._since[section] = now
        self._touch(section)

    def _dated(self, section: str, table: dict[str, Any], now: float) -> dict[str, Any]:
        since = self._since.get(section)
        return {**table, "since": number(since), "age": None if since is None else number(max(0.0, now - since))}

    def _touch(self, section: str) -> None:
        self._counts[section] = self._counts.get(section, 0) + 1

    def _revise(self, section: str, signature: Any) -> None:
        if section not in self._revisions or self._signatures[section] != signature:
            self._signatures[section] = signature
            self._revisions[section] = self._revisions.get(section, 0) + 1


_SECTION_OF = {
    name: "rig" if stream == "rig" else "attitude" if name in ("inclination", "azimuth") else "drilling"
    for name, (_, stream) in _VALUES.items()
} | {"toolface": "toolface"}


def _field(source: Any, name: str, default: Any) -> Any:
    return source.get(name, default) if isinstance(source, Mapping) else getattr(source, name, default)


def _well(well: Well) -> dict[str, Any]:
    return {
        "name": well.name,
        "wellbore": well.wellbore_name,
        "rig": well.rig,
        "depth_datum": well.depth_datum,
        "north_reference": well.north_reference,
        "section_azimuth": number(math.radians(well.section_azimuth_deg)),
        "sensor_to_bit": number(well.sensor_to_bit),
        **_reference({}),
    }


def _reference(field: Mapping[str, float | str]) -> dict[str, Any]:
    numbers = {key: number(field.get(key)) for key in ("total", "dip", "declination", "convergence", "gravity")}
    return {f"field_{key}": value for key, value in numbers.items()} | {"field_source": str(field.get("source", ""))}
