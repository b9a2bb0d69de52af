# SPDX-License-Identifier: Apache-2.0
"""
State of a well as the JSON of the live page: finite numbers, text, lists, and None for unknown.

Most sections are the parts of `WellState` under their own names, with the fields of each part. Numbers stay in SI and
rad; the page converts them. The revision of each section changes whenever the section changes, apart from its ages, so
that a client is sent only the changed sections.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core.north import North
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import Chart, WellState
from mwd_surface.page.log_table import log_table
from mwd_surface.page.plain import number, numbers, plain
from mwd_surface.page.survey_panel import COLUMNS, path_table, quality_lights, survey_row
from mwd_surface.trajectory.plan import Plan

# Sections that grow row by row: a client is sent only the new rows.
STRIPS = ("history", "trend", "depth_log")
# Sections with values of samples: they hold the freshness and the age of each value, so they are made anew each time.
_MEASURED = ("attitude", "toolface", "drilling", "rig")
# Parts of the state that are sections with the same fields. If the part is a sequence, the section has its first rows.
_PARTS = (
    *("offset", "rods", "deviation", "branches", "closure", "quill", "link", "control", "advice", "downlink", "inputs"),
    *("survey_progress", "tool_health"),
    *("diagnostics", "alarms", "events"),
)
_MAX_NEAR = 3  # number of offset wells shown
_MAX_ROWS = 200  # number of diagnostics and of events shown

Table = dict[str, Any]


class _View(NamedTuple):
    """
    A section that is kept until it changes.

    parts: names of the parts of the state from which the section is made; the time of change of the first part is
    `since`. more: any other value on which the section depends. build: function that makes the section.
    """

    parts: tuple[str, ...]
    more: Any
    build: Callable[[], Table | None]


class StateJson:
    """
    Sections of the page with their revisions.

    A section is kept until one of the parts of the state from which it is made changes. revised_from: sections of an
    earlier state, for example before a recording was rewound; the revisions continue above the revisions of these
    sections.
    """

    def __init__(self, settings: LiveSettings | None = None, revised_from: StateJson | None = None) -> None:
        self._settings = settings or LiveSettings()
        self._signatures: dict[str, Any] = {}
        # Start from the earlier revisions, so that every section counts as new to clients that saw the earlier state.
        self._revisions: dict[str, int] = {} if revised_from is None else dict(revised_from._revisions)
        self._kept: dict[str, Table | None] = {}
        self._counted_at = -math.inf
        self._counted = 0

    def snapshot(self, state: WellState) -> dict[str, Any]:
        """
        Return the state ready for JSON.

        Returns
        -------
        dict
            now: time of the state, s. sections: table by name, None before data arrive. revisions: by name, a number
            that changes whenever the section changes, apart from its ages. Single values are the fields of `LiveValue`:
            at is the time of arrival, which decides when the value becomes stale; measured_at is the time of
            measurement; both in s of the clock of `now`. Other sections have since, the time at which they were last
            set. Sections history, trend and depth_log (STRIPS) are {columns, rows, length}, with the oldest or
            shallowest row first; the first column is s of that clock, or the depth of the sensor, m.
        """
        sections: dict[str, Table | None] = dict(self._measured(state))
        for name, view in self._views(state).items():
            if self._revise(name, ([state.change(part).count for part in view.parts], view.more)):
                self._kept[name] = view.build()
            table = self._kept[name]
            sections[name] = table and {**table, "since": number(state.change(view.parts[0]).at)}
        for name in STRIPS:
            chart: Chart = getattr(state, name)
            sections[name] = {"columns": list(chart.columns), "rows": chart.rows, "length": chart.length}
            self._revise(name, chart.rows[-1][0] if chart.rows else None)
        return {"now": number(state.now), "sections": sections, "revisions": dict(self._revisions)}

    def _measured(self, state: WellState) -> Iterator[tuple[str, Table]]:
        """Yield name and table of each section whose entries come from samples; an entry may be fresh or stale."""
        # Stream counts change all the time; updating them once per second is enough.
        if state.now - self._counted_at >= 1.0 or state.now < self._counted_at:
            self._counted_at = state.now
            self._counted += 1
        for name in (*_MEASURED, "streams"):
            table = plain(getattr(state, name))
            fresh = [one["state"] for one in table.values() if isinstance(one, dict) and "state" in one]
            count = self._counted if name == "streams" else state.change(name).count
            # The section of the toolface contains the advised toolface, so new advice changes this section too.
            self._revise(name, (count, fresh, state.change("advice").count if name == "toolface" else 0))
            yield name, table

    def _views(self, state: WellState) -> dict[str, _View]:
        """Return, by name, the definitions of the sections that change only with new data."""
        section, north, most = state.section_azimuth, state.well.north_reference, self._settings.max_rows
        whole = ("surveys",)
        return {
            "well": _View(
                ("well", "well_given", "over_link", "over", "reference_given", "surveys"), section, lambda: _well(state)
            ),
            "quality": _View(whole, north, lambda: self._quality(state)),
            "surveys": _View(whole, north, lambda: self._surveys(state, most)),
            "path": _View(
                ("path", "covariance"), None, lambda: path_table(state.path, section, state.covariance, most)
            ),
            "plan": _View(("plan",), section, lambda: _plan(state.plan, section, most)),
            "clearance": _View(("clearance",), None, lambda: _clearance(state)),
            "recorder": _View(("recorder",), None, lambda: _sent(state.recorder)),
            "logs": _View(("logs",), None, lambda: log_table(state.logs)),
            "steering": _View(("stretches",), None, lambda: _steering(state, most)),
            **{name: _View((name,), None, functools.partial(_part, getattr(state, name))) for name in _PARTS},
        }

    def _quality(self, state: WellState) -> Table | None:
        last = max(state.surveys.records, key=lambda r: r.survey.stamp_ns, default=None)
        if last is None:
            return None
        return quality_lights(last, self._settings.limits, North[state.well.north_reference.upper()])

    def _surveys(self, state: WellState, most: int) -> Table:
        records, north = state.surveys.records, North[state.well.north_reference.upper()]
        rows = [survey_row(record, north, self._settings.limits) for record in records[-most:]]
        remarks = list(sentences(state.surveys.remarks))
        return {"columns": COLUMNS, "rows": rows, "left_out": len(records) - len(rows), "remarks": remarks}

    def _revise(self, name: str, signature: Any) -> bool:
        """Increase the revision of a section if its signature has changed; return whether it has."""
        if name in self._signatures and self._signatures[name] == signature:
            return False
        self._signatures[name] = signature
        self._revisions[name] = self._revisions.get(name, 0) + 1
        return True


def _part(part: Any) -> Table | None:
    """Return a part of the state as a section: rows of a sequence, value of a number, fields; None stays None."""
    if isinstance(part, tuple):
        return {"rows": plain(part[:_MAX_ROWS])}
    table: Table | None = {"value": number(part)} if isinstance(part, float) else plain(part)
    return table


def _sent(status: RecorderStatus | None) -> Table | None:
    """Return the fields of the recorder's message, without the fields that are not recorded; None without a status."""
    return None if status is None else {name: plain(getattr(status, name)) for name in status.sent()}


def _well(state: WellState) -> Table:
    shown = ("name", "wellbore_name", "rig", "depth_datum", "north_reference", "sensor_to_bit", "convention")
    return {
        **{name: plain(getattr(state.well, name)) for name in shown},
        "section_azimuth": number(state.section_azimuth),
        "over_link": state.over_link,
        "over": state.over,
        "given": state.well_given,
        "field": plain(state.reference),
    }


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
        "level": plain(one.level),
    }


def _steering(state: WellState, most: int) -> Table:
    rows = state.stretches[-most:]
    return {
        "rows": plain(rows),
        "yields": plain(state.yields[-most:]),
        "left_out": len(state.stretches) - len(rows),
    }
