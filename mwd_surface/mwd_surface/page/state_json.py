# SPDX-License-Identifier: Apache-2.0
"""
State of a well as the JSON of the live page: finite numbers, text, lists, and None for unknown.

Most sections are the parts of `WellState` under their own names, with the fields of each part. Numbers stay in SI and
rad; the page converts them. The revision of each section changes whenever the section changes, apart from its ages, so
that a client is sent only the changed sections.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import ROTARY, Survey, Verdict
from mwd_sensors.core.arrays import Array
from mwd_surface.bags.recorder.status import RecorderState, RecorderStatus
from mwd_surface.clearance.clearance import Clearance
from mwd_surface.control.set_point import Mode
from mwd_surface.control.status import ControlState
from mwd_surface.list_files.remark import sentences
from mwd_surface.live.inputs import Role
from mwd_surface.live.link_state import LinkHealth
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.well_state import Chart, WellState
from mwd_surface.logs.depth_log import Curve
from mwd_surface.signals.table import LISTED, Signal, page_fields
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.station_quality import totals
from mwd_surface.surveys.survey_csv import Line
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.well_path import Definitive
from mwd_surface.uncertainty.position_covariance import ellipse, in_section

# Values as JSON: a record becomes a table of its fields, an unknown number becomes null. A new field of a record
# therefore reaches the page without code here.

# Members of enumerations that the page shows by a word other than their name.
_WORDS: Mapping[type[enum.Enum], Mapping[Any, str]] = {
    North: {North.UNKNOWN: ""},
    RecorderState: {RecorderState.PAUSED_DISK_FULL: "paused: disk full"},
    Mode: {
        Mode.HOLD: "hold the string",
        Mode.ORIENT: "turn by an angle",
        Mode.RELEASE: "the driller's",
    },
    ControlState: {
        ControlState.IDLE: "driller",
        ControlState.PENDING: "asked for",
        ControlState.GRANTED: "controller",
    },
    LinkHealth: {LinkHealth.NO_INPUT: "no pressure"},
    Role: {Role.NO_DEPTH: "", Role.STANDBY: "stands by"},
}


def number(value: Any) -> float | None:
    """Return a number rounded to ten digits; None if it is None, NaN or infinite."""
    if value is None:
        return None
    value = float(value)
    return float(f"{value:.10g}") if math.isfinite(value) else None


def numbers(values: Iterable[Any]) -> list[float | None]:
    """Return each value rounded to ten digits; None for a value that is None, NaN or infinite."""
    return [number(v) for v in values]


def plain(value: Any) -> Any:
    """
    Return a value as JSON data.

    Numbers are rounded to ten digits; NaN and infinity become None. A record becomes a table of its fields and
    properties, a member of an enumeration its word, a set of status bits the list of their words.
    """
    if isinstance(value, enum.Enum):
        return word(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return number(value)
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    return {name: plain(getattr(value, name)) for name in _names(type(value))}


def word(member: enum.Enum) -> str | list[str]:
    """Return the page's word for a member of an enumeration, or a list of words for a set of status bits."""
    if isinstance(member, str):
        return str(member)
    if isinstance(member, enum.Flag):
        return [str(bit.name).lower() for bit in member]
    return _WORDS.get(type(member), {}).get(member, str(member.name).lower().replace("_", " "))


def _names_of(record: type) -> tuple[str, ...]:
    """
    Return the names of the fields and properties of a record.

    Raises TypeError if the type is not a record, so that there is no JSON for it.
    """
    members = [name for base in record.__mro__ for name, one in vars(base).items() if isinstance(one, property)]
    return (*(field.name for field in dataclasses.fields(record)), *members)


_names: Callable[[type], tuple[str, ...]] = functools.cache(_names_of)


# Log channels.

_GAPS = 3  # number of deepest gaps that the page lists
_HELD = 40  # largest number of depth steps for which the value of a sector is held


def log_table(curves: Sequence[Curve]) -> dict[str, Any]:
    """
    Return the dict {"channels": tables}, with one table for each curve that has depth steps.

    rows: depth, m, value, sigma, time of measurement, s, and quality, bits of LogSample; sectors: values of each row,
    from the high side clockwise; held: result of `held_steps`; gaps: top and bottom of the deepest gaps, m; gap_count:
    number of all gaps. Values are in the unit of the channel.
    """
    return {"channels": [_channel(curve) for curve in curves if len(curve.depth)]}


def _channel(curve: Curve) -> dict[str, Any]:
    columns = (curve.depth, curve.value, curve.sigma, curve.seconds, curve.quality)
    return {
        "name": curve.channel,
        "unit": curve.unit,
        "step": number(float(np.diff(curve.depth[:2]).sum())),
        "rows": [[_short(value) for value in row] for row in zip(*columns, strict=True)],
        "sectors": [[_short(value) for value in row] for row in curve.sectors],
        "held": held_steps(curve.sectors),
        "gaps": [[_short(edge) for edge in gap] for gap in curve.gaps[-_GAPS:]],
        "gap_count": len(curve.gaps),
    }


def held_steps(sectors: Array) -> list[int]:
    """
    Return, for each sector, the largest number of depth steps for which the image holds a value of the sector.

    Over a link the sectors arrive in turn, so a sector has values only at some depths. The image shows each value,
    marked as held, until the next value of the sector. A distance between two values above 1.5 times the median
    distance, or above `_HELD` steps, is a gap.

    Parameters
    ----------
    sectors : ndarray, shape (n, k)
        Values by direction, NaN where there is none.
    """
    found = []
    for column in np.isfinite(sectors).T:
        apart = np.diff(np.flatnonzero(column))
        found.append(min(_HELD, int(1.5 * np.median(apart))) if len(apart) else 0)
    return found


def _short(value: float) -> float | None:
    return number(float(f"{value:.7g}"))


# Survey table, quality lights of the last survey, and the well path with ellipses.

_ON_PATH = {signal.name for signal, _ in LISTED}
_ROW = page_fields("surveys")
# Kind of number on the page (units.js) for each unit used in files.
_KINDS = {
    "m": "length",
    "deg": "angle",
    "deg/30 m": "dogleg",
    "m/s^2": "gravity",
    "nT": "field",
    "deg/h": "slow_rate",
    "rpm": "rotation",
    "degC": "temperature",
    "s": "seconds",
    "1": "index",
}


def _kind(signal: Signal) -> str:
    """Return the kind of number of a signal on the page, such as "length"; "inclination" may be shown as a dip."""
    return "inclination" if signal.is_inclination else _KINDS[signal.listed_scale.symbol]


#: Columns of the survey table, in order: field of a row, title, kind of number, and smallest screen on which the column
#: is shown (0: any, 1: tablet, 2: wide).
COLUMNS = [
    {"field": name, "title": signal.listed.title, "kind": _kind(signal), "width": shown.width}
    for shown, name, signal in sorted((one.shown, name, one) for name, one in _ROW.items() if one.shown is not None)
    if signal.listed is not None
]


def survey_row(record: SurveyRecord, north: North) -> dict[str, Any]:
    """Return one row of the survey table; the azimuth is from `north` if possible, else from the survey's own north."""
    s, line = record.survey, Line(record, north)
    word, by = _verdict(record)
    return {
        "sequence": s.sequence,
        "stamp_ns": s.stamp_ns,
        "kind": "rotary" if s.kind == ROTARY else "static",
        **{name: number(line.value(signal.record)) for name, signal in _ROW.items()},
        "azimuth_north": line.north_word,
        "method": azimuth_source(s).words or s.azimuth_method,
        "automatic": Verdict(s.verdict).word,
        "verdicts": list(s.verdicts),
        "headline": s.action,
        "first": _other_value(record.replaced, line.north),
        "revised": _other_value(record.proposal, line.north),
        "alternatives": _alternatives(s, line.north),
        "totals": _lights(s),
        "disturbances": [[words, number(odds)] for words, odds in s.disturbances],
        "verdict": word,
        "accepted_by": by,
        "in_use": record.in_use,
        "assumed": record.assumed,
        "reasons": list(s.reasons),
        "judged_reason": record.reason,
        "flags": list(record.flags),
        "comment": record.comment,
        "leg": record.leg,
        "tool": record.tool,
    }


def _other_value(survey: Survey | None, north: North) -> dict[str, Any] | None:
    """Return azimuth, its sigma and the verdict of a replaced or proposed revision of a survey; None without one."""
    if survey is None:
        return None
    return {
        "azimuth": number(survey.azimuth_from(north)),
        "sigma_azimuth": number(survey.sigma_azimuth),
        "verdict": Verdict(survey.verdict).word,
    }


def _alternatives(s: Survey, north: North) -> list[list[float | None]]:
    return [[number(other), number(odds)] for other, odds in s.alternatives_from(north)]


def _verdict(record: SurveyRecord) -> tuple[str, str]:
    """Return the verdict in force, and the name of the person who gave it, or "automatic"."""
    if record.judgement == Judgement.ACCEPTED:
        return "accepted", record.operator_name
    if record.judgement == Judgement.REJECTED:
        return "rejected", record.operator_name
    if record.in_use:
        return "accepted", "automatic"
    automatic = Verdict(record.survey.verdict)
    return {Verdict.ACCEPT: "waiting", Verdict.DOUBTFUL: "doubtful", Verdict.REJECT: "rejected"}[automatic], "automatic"


def _lights(s: Survey) -> list[dict[str, Any]]:
    # The page shows the judged value, not the value as read.
    return [{name: one for name, one in plain(total).items() if name != "read"} for total in totals(s)]


def quality_lights(record: SurveyRecord, north: North = North.UNKNOWN) -> dict[str, Any]:
    """
    Return the quality of a survey: verdicts, totals, and alternative azimuths.

    north: north of the azimuths, if possible.
    """
    s = record.survey
    line = Line(record, north)
    return {
        "lights": _lights(s),
        "verdict": Verdict(s.verdict).name.lower(),
        "verdicts": list(s.verdicts),
        "headline": s.action,
        "azimuth": number(line.azimuth),
        "alternatives": _alternatives(s, line.north),
        "reasons": [text for text in dict.fromkeys((*s.reasons, *record.flags)) if text],
        "sequence": s.sequence,
        "stamp_ns": s.stamp_ns,
    }


def path_table(path: Definitive | None, section: float, covariance: Array | None, most: int) -> dict[str, Any]:
    """
    Return the well path as columns for the page.

    section: azimuth of the vertical section, rad. covariance, shape (m, 3, 3): covariance of the first m positions,
    m^2, for the ellipses. most: number of stations to keep, counted from the last.
    """
    columns = {name: signal.field for name, signal in page_fields("path").items() if signal.name in _ON_PATH}
    if path is None:
        return {
            **{name: [] for name in columns},
            "kind": [],
            "assumptions": [],
            "north_reference": "",
            "ellipses": [],
            "left_out": 0,
        }
    first = max(0, len(path.md) - most)
    return {
        **{name: numbers(getattr(path, field)[first:]) for name, field in columns.items()},
        "kind": list(path.kind[first:]),
        "assumptions": list(sentences(path.assumptions)),
        "north_reference": path.north.name.lower(),
        "section_azimuth": number(section),
        "ellipses": [] if covariance is None else _ellipses(np.asarray(covariance, dtype=float), first, section),
        "left_out": first,
    }


def _ellipses(covariance: Array, first: int, section: float) -> list[dict[str, Any]]:
    """Return two-sigma ellipses of up to ten stations: in the map (north, east) and in the section (along, down)."""
    rows = []
    stations = range(first, len(covariance))
    for k in list(stations)[:: max(1, -(-len(stations) // 10))]:
        whole = covariance[k]
        if not np.all(np.isfinite(whole)):
            continue
        plan, side = ellipse(whole[:2, :2]), ellipse(in_section(whole, section))
        rows.append(
            {
                "station": k - first,
                "plan": [number(plan.major), number(plan.minor), number(plan.angle)],
                "section": [number(side.major), number(side.minor), number(side.angle)],
            }
        )
    return rows


# Sections of the page, with their revisions.

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
    """A section that is kept until it changes."""

    #: Names of the parts of the state from which the section is made; the time of change of the first one is `since`.
    parts: tuple[str, ...]
    more: Any  #: any other value on which the section depends
    build: Callable[[], Table | None]  #: function that makes the section


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
        return quality_lights(last, North[state.well.north_reference.upper()])

    def _surveys(self, state: WellState, most: int) -> Table:
        records, north = state.surveys.records, North[state.well.north_reference.upper()]
        rows = [survey_row(record, north) for record in records[-most:]]
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
    """Return a part of the state as a section: a sequence as rows, a number as value, else fields; None stays None."""
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
    k, shown = one.least, ("distance", "allowed", "factor", "toolface")
    return {
        "name": one.name,
        "measured_depth": number(one.md[k]),
        **{name: number(getattr(one, name)[k]) for name in shown},
        "level": plain(one.level),
    }


def _steering(state: WellState, most: int) -> Table:
    rows = state.stretches[-most:]
    return {
        "rows": plain(rows),
        "yields": plain(state.yields[-most:]),
        "left_out": len(state.stretches) - len(rows),
    }
