# SPDX-License-Identifier: Apache-2.0
"""
State of a well as the JSON of the live page: finite numbers, text, lists, and None for unknown.

Numbers stay in SI and rad; the page converts them. The revision of each table changes whenever the table changes, apart
from the ages in it, so that clients are sent only what is new to them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.core.status import words
from mwd_sensors.core import settings as settings_tables
from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.alarms import Alarm, Event, Severity
from mwd_surface.live.latest_values import Freshness, LiveValue, StreamState
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import Chart, ToolfaceState, WellState
from mwd_surface.page.control_table import advice_table, control_table
from mwd_surface.page.downlink_table import downlink_table
from mwd_surface.page.input_table import input_table
from mwd_surface.page.link_table import link_table
from mwd_surface.page.plain import number, numbers
from mwd_surface.page.survey_panel import COLUMNS, path_table, quality_lights, survey_row
from mwd_surface.signals.table import page_fields
from mwd_surface.trajectory.plan import Plan

# Sections that grow row by row: a client is sent only the new rows.
STRIPS = ("history", "trend", "depth_log")
_RECORDER_WORDS = {
    RecorderState.STOPPED: "stopped",
    RecorderState.RECORDING: "recording",
    RecorderState.PAUSED_DISK_FULL: "paused: disk full",
    RecorderState.FAILED: "failed",
}
_TOOLFACE_WORDS = ("gravity", "magnetic")
_LEVEL_WORDS = ("ok", "warning", "error", "stale")
_MAX_NEAR = 3  # number of offset wells shown
_MAX_EVENTS = 200
_MAX_DIAGNOSTICS = 200

Table = dict[str, Any]


class StateJson:
    """
    Tables of the page with their revisions.

    Tables that are expensive to build are kept until the part of the state from which they are made changes.
    revised_from: tables of an earlier state, for example before a recording was rewound; each gets a higher revision.
    """

    def __init__(self, settings: LiveSettings | None = None, revised_from: StateJson | None = None) -> None:
        self._settings = settings or LiveSettings()
        self._signatures: dict[str, Any] = {}
        # Start from the earlier revisions, so that every table counts as new to clients that saw the earlier state.
        self._revisions: dict[str, int] = {} if revised_from is None else dict(revised_from._revisions)
        self._kept: dict[str, Table] = {}
        self._links_at = -math.inf
        self._links_count = 0

    def snapshot(self, state: WellState) -> dict[str, Any]:
        """
        Return the state ready for JSON.

        Returns
        -------
        dict
            now: time of the state. sections: table by name. revisions: by name, a number that changes whenever the
            table does, apart from the ages in it. Single values are {value, sigma, unit, at, measured_at, age,
            stale_after, state, reason}: value is None if there never was one; state is "live", "stale" or "no data"; at
            is the time of arrival, which decides when the value becomes stale; measured_at is the time of measurement;
            both in s of the clock of `now`. Tables have since and age of their last change. Sections history,
            trend and depth_log (STRIPS) are {columns, rows, length}, with the oldest or shallowest row first; the first
            column is s of that clock, or the depth of the sensor, m.
        """
        sections = {**self._streams(state), **self._tables(state)}
        for name in STRIPS:
            chart: Chart = getattr(state, name)
            sections[name] = {"columns": list(chart.columns), "rows": chart.rows, "length": chart.length}
            self._revise(name, chart.rows[-1][0] if chart.rows else None)
        return {"now": number(state.now), "sections": sections, "revisions": dict(self._revisions)}

    def _streams(self, state: WellState) -> dict[str, Table]:
        """Build the tables that contain their own freshness."""
        # Stream counts change all the time; updating them once per second is enough.
        if state.now - self._links_at >= 1.0 or state.now < self._links_at:
            self._links_at = state.now
            self._links_count += 1
        attitude, toolface = state.attitude, state.toolface
        north = "" if attitude.north == North.UNKNOWN else North(attitude.north).name.lower()
        tables = {
            "attitude": {
                **_values("attitude", attitude),
                "status": [word for word in words(attitude.status).split("|") if word],
                "north": north,
                "stamp_ns": attitude.stamp_ns,
            },
            "toolface": _toolface(toolface, north),
            "drilling": _values("drilling", state.drilling),
            "rig": {
                **_values("rig", state.rig),
                "in_slips": state.rig.in_slips,
                "pumps_on": state.rig.pumps_on,
            },
            "links": {name: _link(link) for name, link in state.streams.items()},
            "recorder": _recorder(state),
        }
        freshness = {
            "attitude": (attitude.inclination.state, attitude.azimuth.state),
            "toolface": (toolface.angle.state,),
            "drilling": tuple(value.state for value in vars(state.drilling).values()),
            "rig": tuple(value.state for value in vars(state.rig).values() if isinstance(value, LiveValue)),
            "links": tuple(link.state for link in state.streams.values()),
            "recorder": (tables["recorder"]["fresh"],),
        }
        for name in tables:
            count = self._links_count if name == "links" else state.change(name).count
            self._revise(name, (count, freshness[name]))
        return tables

    def _tables(self, state: WellState) -> dict[str, Table]:
        """Build the tables that change only with new data."""
        north, section, most = state.well.north_reference, _section(state), self._settings.max_rows
        builders: dict[str, tuple[str, Any, Callable[[], Table]]] = {
            "well": ("well", section, lambda: _well(state)),
            "quality": ("records", north, lambda: self._quality(state)),
            "surveys": ("records", north, lambda: self._surveys(state, most)),
            "path": ("path", None, lambda: _path(state, most)),
            "plan": ("plan", section, lambda: _plan(state.plan, section, most)),
            "offset": ("offset", None, lambda: _offset(state)),
            "clearance": ("clearance", None, lambda: _clearance(state)),
            "steering": ("steering", None, lambda: _steering(state, most)),
            "control": ("control", None, lambda: control_table(state.control)),
            "advice": ("advice", None, lambda: advice_table(state.advice)),
            "quill": ("quill", None, lambda: {"angle": number(state.quill)}),
            "link": ("link", None, lambda: link_table(state.link)),
            "downlink": ("downlink", None, lambda: downlink_table(state.downlink)),
            "inputs": ("inputs", None, lambda: input_table(state.inputs)),
            "survey_progress": ("survey_progress", None, lambda: _progress(state)),
            "findings": ("diagnostics", None, lambda: _diagnostics(state)),
            "alarms": ("alarms", None, lambda: _alarms(state)),
            "events": ("events", None, lambda: {"rows": plain_events(state.events[:_MAX_EVENTS])}),
        }
        tables = {}
        for name, (part, more, build) in builders.items():
            if self._revise(name, (state.change(part).count, more)):
                self._kept[name] = build()
            tables[name] = _dated(self._kept[name], state, part)
        return tables

    def _quality(self, state: WellState) -> Table:
        last = max(state.records, key=lambda r: r.survey.stamp_ns, default=None)
        return quality_lights(last, self._settings.limits, North[state.well.north_reference.upper()])

    def _surveys(self, state: WellState, most: int) -> Table:
        north, kept = North[state.well.north_reference.upper()], state.records[-most:]
        rows = [survey_row(record, north, self._settings.limits) for record in kept]
        remarks, left_out = list(sentences(state.remarks)), len(state.records) - len(kept)
        return {"columns": COLUMNS, "rows": rows, "left_out": left_out, "remarks": remarks}

    def _revise(self, name: str, signature: Any) -> bool:
        """Increase the revision of a table if its signature has changed; return whether it has."""
        if name in self._signatures and self._signatures[name] == signature:
            return False
        self._signatures[name] = signature
        self._revisions[name] = self._revisions.get(name, 0) + 1
        return True


def plain_alarms(alarms: Iterable[Alarm]) -> list[Table]:
    """Return alarms as plain tables."""
    return [{**dataclasses.asdict(a), "severity_word": Severity(a.severity).name.lower()} for a in alarms]


def _alarms(state: WellState) -> Table:
    """
    Return the alarms.

    raised_at: time on the steady clock, s; None if the clock of the stamps is unknown. epoch: time since the epoch, s,
    at which the steady clock was zero, or None.
    """
    offset = state.clock_offset
    ages = [None if offset is None else number(a.raised_ns * 1e-9 - offset) for a in state.alarms]
    rows = [{**row, "raised_at": at} for row, at in zip(plain_alarms(state.alarms), ages, strict=True)]
    return {"rows": rows, "not_evaluated": list(state.not_evaluated), "epoch": number(offset)}


def plain_events(events: Iterable[Event]) -> list[Table]:
    """Return events as plain tables."""
    return [{**dataclasses.asdict(e), "severity_word": Severity(e.severity).name.lower()} for e in events]


def _dated(table: Table, state: WellState, part: str) -> Table:
    return {**table, "since": number(state.change(part).at), "age": number(state.age(part))}


def _values(section: str, part: Any) -> Table:
    """Return the live values of a section of the page, by their names in the signal table."""
    return {name: _value(getattr(part, signal.field)) for name, signal in page_fields(section).items()}


def _value(value: LiveValue) -> Table:
    return {
        "value": number(value.value),
        "sigma": number(value.sigma),
        "unit": value.unit,
        "at": number(value.at),
        "measured_at": number(value.measured_at),
        "age": number(value.age),
        "stale_after": value.stale_after,
        "state": value.state,
        "reason": value.reason,
    }


def _link(link: StreamState) -> Table:
    return {
        "state": link.state,
        "at": number(link.at),
        "age": number(link.age),
        "stale_after": link.stale_after,
        "count": link.count,
        "lost": link.lost,
        "rate": number(link.rate),
    }


def _toolface(toolface: ToolfaceState, north: str) -> Table:
    advisory = toolface.advisory
    return {
        "angle": _value(toolface.angle),
        "mode": _TOOLFACE_WORDS[toolface.mode],
        "known": toolface.stamp_ns is not None,
        "rotating": toolface.rotating,
        "stamp_ns": toolface.stamp_ns,
        "measured_ns": toolface.measured_ns,
        "north": north,
        "threshold": number(toolface.threshold),
        "readings": [
            {
                "angle": number(reading.angle),
                "mode": _TOOLFACE_WORDS[reading.mode],
                "at": number(reading.at),
                "rotating": reading.rotating,
                "stamp_ns": reading.stamp_ns,
            }
            for reading in toolface.readings
        ],
        "advisory": advisory
        and {"toolface": number(advisory.toolface), "limit": number(advisory.limit), "inside": advisory.inside},
    }


def _recorder(state: WellState) -> Table:
    status, link = state.recorder, state.streams["recorder"]
    table: Table = {"state": Freshness.NO_DATA}
    if status is not None:
        table = {
            "state": _RECORDER_WORDS[status.state],
            "path": str(status.path or ""),
            "reason": status.reason,
            "messages": status.messages,
            "bytes": status.bytes,
            "dropped": status.dropped,
            "free_bytes": number(status.free_bytes),
            "duration": number(status.duration_s),
        }
    return {**_dated(table, state, "recorder"), "fresh": link.state, "stale_after": link.stale_after}


def _well(state: WellState) -> Table:
    well, reference = state.well, state.reference
    return {
        "name": well.name,
        "wellbore": well.wellbore_name,
        "rig": well.rig,
        "depth_datum": well.depth_datum,
        "north_reference": well.north_reference,
        "section_azimuth": number(_section(state)),
        "sensor_to_bit": number(well.sensor_to_bit),
        "over_link": state.over_link,
        "given": state.well_given,
        "field_total": number(reference.total),
        "field_dip": number(reference.dip),
        "field_declination": number(reference.declination),
        "field_convergence": number(reference.convergence),
        "field_gravity": number(reference.gravity),
        "field_source": reference.source,
    }


def _section(state: WellState) -> float:
    """Return the azimuth of the vertical section, rad: of the path, else of the well, else of the plan."""
    if state.path is not None:
        return state.path.section_azimuth
    if state.well.section_azimuth_deg is not None:
        return math.radians(state.well.section_azimuth_deg)
    return 0.0 if state.plan is None else state.plan.section_azimuth


def _path(state: WellState, most: int) -> Table:
    return path_table(state.path, _section(state), state.covariance, most)


def _plan(plan: Plan | None, section: float, most: int) -> Table:
    if plan is None:
        return {"name": "", "north": [], "east": [], "vertical_depth": [], "vertical_section": []}
    step = max(1, -(-len(plan.md) // most))
    positions = np.vstack([plan.positions[:-1:step], plan.positions[-1:]])
    along = positions[:, 0] * math.cos(section) + positions[:, 1] * math.sin(section)
    return {
        "name": plan.name,
        "north": numbers(positions[:, 0]),
        "east": numbers(positions[:, 1]),
        "vertical_depth": numbers(positions[:, 2]),
        "vertical_section": numbers(along),
    }


def _offset(state: WellState) -> Table:
    if state.offset is None:
        return {"known": False}
    against = state.against_plan
    table = {name: number(against.get(signal.field)) for name, signal in page_fields("offset").items()}
    return {"known": True, "assumed": state.path is not None and state.path.assumed, **table}


def _clearance(state: WellState) -> Table:
    return {
        "rows": [_near(one) for one in state.clearance[:_MAX_NEAR]],
        "remarks": list(sentences(state.clearance_remarks)),
    }


def _near(one: Clearance) -> Table:
    k = one.least
    return {
        "name": one.name,
        "measured_depth": number(one.md[k]),
        "distance": number(one.distance[k]),
        "allowed": number(one.allowed[k]),
        "factor": number(one.factor[k]),
        "toolface": number(one.toolface[k]),
        "level": one.level.name.lower(),
    }


def _steering(state: WellState, most: int) -> Table:
    rows = [{**settings_tables.to_mapping(s), "length": s.length} for s in state.stretches[-most:]]
    yields = [{**settings_tables.to_mapping(y), "motor": y.motor} for y in state.yields[-most:]]
    return {"rows": rows, "yields": yields, "left_out": len(state.stretches) - len(rows)}


def _progress(state: WellState) -> Table:
    progress = state.survey_progress
    return {
        "active": progress.active,
        "state": progress.state,
        "elapsed": number(progress.elapsed),
        "remaining": number(progress.remaining),
        "result": progress.result,
        "waits_for": progress.waits_for,
    }


def _diagnostics(state: WellState) -> Table:
    rows = [
        {"name": d.name, "level": _LEVEL_WORDS[min(max(d.level, 0), 3)], "message": d.message, "remedy": d.remedy}
        for d in state.diagnostics[:_MAX_DIAGNOSTICS]
    ]
    return {"rows": rows}
