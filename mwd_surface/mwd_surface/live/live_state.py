"""
What the driller's page shows: the last good value of everything, with sigma, unit, age and whether it still counts.

Messages go in as they come, `snapshot` gives plain tables ready for JSON: finite numbers, text, lists, None. None is
"no data"; zero is only ever a measured zero. Numbers are SI and rad; the page converts them.

No clock here: every call takes `now`, s, of one steady clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mwd_sensors.core import settings as settings_tables
from mwd_sensors.core.arrays import Array
from mwd_surface.live.alarms import Alarm, Event, plain_alarms, plain_events
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.streams import LiveStreams
from mwd_surface.live.values import NO_DATA
from mwd_surface.page.plain import number, numbers
from mwd_surface.page.survey_panel import field_of, path_table, quality_lights, survey_row
from mwd_surface.surveys.plan import Offset, Plan
from mwd_surface.surveys.survey_record import North, SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_path import Definitive

RECORDER_WORDS = ("stopped", "recording", "paused: disk full", "failed")
LEVEL_WORDS = ("ok", "warning", "error", "stale")
_NO_PLAN: dict[str, Any] = {"name": "", "north": [], "east": [], "vertical_depth": [], "vertical_section": []}


class LiveState(LiveStreams):
    """
    Everything the page shows.

    Methods `on_...` take what arrived; angles and times as in the messages. What is not finite is left out and, for
    single values, does not count as an update. `snapshot` may be called at any rate; it costs little when little
    changed. Not thread-safe: call it all from one thread; what a snapshot returns may be read from any.
    """

    def __init__(self, settings: LiveSettings | None = None) -> None:
        super().__init__(settings)
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
            "findings": {"rows": []},
            "alarms": {"rows": []},
            "events": {"rows": []},
        }
        self._since: dict[str, float] = {}
        self._well = Well()
        self._field: Mapping[str, float | str] | None = None
        self._survey_field: Mapping[str, float | str] = {}
        self._signatures: dict[str, Any] = {}
        self._revisions: dict[str, int] = {}

    def on_quill(self, angle: float, now: float) -> None:
        """Where the quill stands, rad clockwise looking down-hole from where the rig counts."""
        if math.isfinite(angle):
            self._store("quill", {"angle": number(angle % math.tau)}, now)

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
        sections: dict[str, Any] = {}
        built = {**self.stream_sections(now), "recorder": self._build_recorder(now)}
        for name, (table, states) in built.items():
            sections[name] = table
            # Growing old is news too.
            self._revise(name, (self._counts.get(name, 0), tuple(states)))
        for name, table in self._plain.items():
            if name not in sections:
                sections[name] = self._dated(name, table, now)
                self._revise(name, self._counts.get(name, 0))
        for name, strip in self.strips(now).items():
            rows = strip.rows()
            sections[name] = {"columns": list(strip.columns), "rows": rows}
            self._revise(name, rows[-1][0] if rows else None)
        return {"now": number(now), "sections": sections, "revisions": dict(self._revisions)}

    def _build_recorder(self, now: float) -> tuple[dict[str, Any], list[str]]:
        table = self._dated("recorder", self._plain["recorder"], now)
        fresh = self._values.freshness("recorder", table["age"])
        return {**table, "fresh": fresh, "stale_after": self._values.stale_after("recorder")}, [fresh]

    def _store(self, section: str, table: dict[str, Any], now: float) -> None:
        self._plain[section] = table
        self._since[section] = now
        self._touch(section)

    def _dated(self, section: str, table: dict[str, Any], now: float) -> dict[str, Any]:
        since = self._since.get(section)
        return {**table, "since": number(since), "age": None if since is None else number(max(0.0, now - since))}

    def _revise(self, section: str, signature: Any) -> None:
        if section not in self._revisions or self._signatures[section] != signature:
            self._signatures[section] = signature
            self._revisions[section] = self._revisions.get(section, 0) + 1


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
