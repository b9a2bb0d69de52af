# SPDX-License-Identifier: Apache-2.0
"""
Definitive survey as printed: one set of numbers, rounded once, for every export and report.

Display units: m, deg, deg/30 m, nT. An unknown value is an empty cell, never a placeholder. A station with a number
that is not finite is omitted, and the table reports it.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import earth
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.unknown import or_none
from mwd_surface.exports.report_section import Section
from mwd_surface.list_files.remark import RemarkKind, sentences
from mwd_surface.signals.cells import Typed, fixed, plain, typed, utc
from mwd_surface.signals.table import AS_STORED, LISTED, SURVEY, Display, Listed, Signal
from mwd_surface.signals.units import METRIC, UNITS
from mwd_surface.surveys.imported_list import TOOL_CODES
from mwd_surface.surveys.leg import MAIN
from mwd_surface.surveys.mine_hole import Closure, Deviation, closure, deviations
from mwd_surface.surveys.survey_csv import beside_path
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.surveys.well_position import uncertain
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import DrilledStretch
from mwd_surface.trajectory.well_path import ASSUMED, Definitive

_DEG = 180.0 / math.pi
_FEW = 12  # largest count of numbers listed in a sentence


@dataclasses.dataclass(frozen=True)
class TableColumn:
    """
    One column of numbers: its signal, its place in files, and one value per station, None if unknown.

    The values have the units and the angle convention of `SurveyTable.display`.
    """

    signal: Signal
    listed: Listed
    values: tuple[float | None, ...]
    units: str = METRIC

    @property
    def key(self) -> str:
        """Name of the column in files."""
        return self.listed.key

    @property
    def unit(self) -> str:
        """Symbol of the unit of the column."""
        return UNITS[self.signal.unit].shown_in(self.units).symbol

    def cell(self, k: int, paper: bool = False) -> str:
        """Return the number of a station as printed in files or on paper; empty if unknown."""
        return fixed(self.values[k], self.listed.shown if paper else self.listed.decimals, self.signal.wrap)


@dataclasses.dataclass(frozen=True)
class SurveyTable:
    """All data that an export prints."""

    #: `surveys`, `path`: source of the table
    surveys: SurveyList
    path: Definitive
    records: tuple[SurveyRecord | None, ...]  #: survey record of each station, None for tie-ons and the projection
    columns: tuple[TableColumn, ...]  #: numbers of the stations, in the units of `display`
    header: tuple[tuple[str, str], ...]  #: labels and values of the head block
    covariance: Array | None  #: covariances of the positions of the stations, shape (n, 3, 3), m^2, or None
    covariance_note: str  #: name of the error model, or the reason why the covariance is unknown
    plan: Plan | None
    left_out: tuple[str, ...]  #: sentences about stations and surveys that could not be printed
    made_ns: int  #: time when the table was requested, ns since the epoch
    stretches: tuple[DrilledStretch, ...] = ()  #: the slide sheet
    sections: tuple[Section, ...] = ()  #: further sections of the report, with data that are not part of the list
    display: Display = AS_STORED
    final: bool = False  #: whether this is the final list of a well

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about the assumptions of path, list and plan."""
        planned = self.plan.remarks if self.plan is not None else ()
        return sentences((*self.path.assumptions, *self.surveys.remarks, *planned))

    @property
    def deviations(self) -> tuple[Deviation, ...]:
        """Deviation from the plan at every station, at the bit and ahead of the bit; empty without a plan."""
        return deviations(self.surveys, self.path)

    @property
    def closure(self) -> Closure | None:
        """Closure of the path on the surveyed point of the well; None if no point is given."""
        return closure(self.surveys, self.path)

    @property
    def rows(self) -> range:
        """Indices of the stations."""
        return range(len(self.records))

    def shown(self, display: Display) -> SurveyTable:
        """Return the table with its columns in other units, or in another angle convention."""
        columns = _columns(self.path, self.covariance, self.plan, display)
        return dataclasses.replace(self, columns=columns, display=display)

    def column(self, key: str) -> TableColumn:
        """Return the column with a name of the signal table; raise KeyError if there is no such column."""
        for column in self.columns:
            if column.signal.listed is not None and column.signal.listed.key == key:
                return column
        raise KeyError(key)


def survey_table(
    surveys: SurveyList,
    made_ns: int,
    *,
    leg: str | None = None,
    bit_depth: float | None = None,
    software: str = "",
    stretches: Sequence[DrilledStretch] = (),
    sections: Sequence[Section] = (),
) -> SurveyTable:
    """
    Return the printed table of one leg; with a plan in the list, also distance from and direction to the plan.

    Parameters
    ----------
    made_ns : int
        Time of the report, ns since the epoch.
    leg : str, optional
        Leg to print; by default the current leg.
    bit_depth : float, optional
        Depth to which the last row is projected, m; if omitted, `sensor_to_bit` below the last survey.
    software : str
        Name and version for the head block.
    stretches : sequence of DrilledStretch
        Slide sheet, for reports.
    sections : sequence of Section
        Further sections of the report.

    Raises
    ------
    ValueError
        The leg does not exist, or the bit depth is not finite.
    """
    path = surveys.definitive(leg)
    if bit_depth is None and path.kind[-1] == "survey" and surveys.well.sensor_offset > 0.0:
        bit_depth = float(path.md[-1]) + surveys.well.sensor_offset
    if bit_depth is not None:
        path = surveys.definitive(leg, bit_depth)
    table = table_of(surveys, path, made_ns, software, stretches)
    return dataclasses.replace(table, sections=tuple(sections))


def table_of(
    surveys: SurveyList,
    path: Definitive,
    made_ns: int,
    software: str = "",
    stretches: Sequence[DrilledStretch] = (),
) -> SurveyTable:
    """Return the printed table of a path of the list, with its plan; see `survey_table`."""
    plan = surveys.plan
    path, left_out = _finite(path)
    left_out += _without_depth(surveys)
    records = surveys.records_on(path)
    used = [r.survey for r in records if r is not None]
    reference = next((s for s in reversed(used) if s.has_reference), None)
    known = uncertain(surveys, path)
    covariance, note = known.covariance, known.note
    display = Display(angles=surveys.well.angles)
    columns = _columns(path, covariance, plan, display)
    header = _header(surveys, path, reference, made_ns, note, plan, software)
    return SurveyTable(
        surveys,
        path,
        records,
        columns,
        header,
        covariance,
        note,
        plan,
        left_out,
        made_ns,
        tuple(stretches),
        display=display,
    )


def _columns(
    path: Definitive, covariance: Array | None, plan: Plan | None, display: Display
) -> tuple[TableColumn, ...]:
    """Return the columns of the signal table whose source is available."""
    stations = range(len(path.md))
    sources: dict[str, Sequence[Any]] = {
        SURVEY: [{s.field: getattr(path, s.field)[k] for s, _ in LISTED if s.source == SURVEY} for k in stations],
        **beside_path(path, covariance, plan),
    }
    return tuple(
        TableColumn(
            signal,
            signal.column_for_people(listed, display),
            tuple(_people(signal, one.get(signal.field), display) for one in sources[signal.source]),
            display.units,
        )
        for signal, listed in LISTED
        if signal.source in sources
    )


def _people(signal: Signal, value: float | None, display: Display) -> float | None:
    return None if value is None else signal.for_people(float(value), display)


def _without_depth(surveys: SurveyList) -> tuple[str, ...]:
    """Return a sentence about the surveys without a depth, with the remedy, if there are any."""
    without = [r for r in surveys.records if math.isnan(r.measured_depth) and r.judgement != Judgement.REJECTED]
    if not without:
        return ()
    numbers = ", ".join(str(r.survey.sequence) for r in without[:_FEW]) + (" ..." if len(without) > _FEW else "")
    remedy = "set it in the list, or give a table of depths to `mwd process --depths`"
    return (f"survey without measured depth not exported: {numbers}; {remedy}",)


def _finite(path: Definitive) -> tuple[Definitive, tuple[str, ...]]:
    numbers = np.column_stack([getattr(path, signal.field) for signal, _ in LISTED if signal.source == SURVEY])
    good = np.all(np.isfinite(numbers), axis=1)
    if np.all(good):
        return path, ()
    why = tuple(
        f"station {k} ({path.kind[k]}"
        + (f" {path.sequence[k]}" if path.sequence[k] else "")
        + ") omitted: a number in it is not finite"
        for k in np.flatnonzero(~good)
    )
    arrays = {
        f.name: getattr(path, f.name)[good]
        for f in dataclasses.fields(path)
        if isinstance(getattr(path, f.name), np.ndarray)
    }
    kept = [k for k in range(good.size) if good[k]]
    kind, sequence = tuple(path.kind[k] for k in kept), tuple(path.sequence[k] for k in kept)
    return dataclasses.replace(path, **arrays, kind=kind, sequence=sequence), why


def _header(
    surveys: SurveyList,
    path: Definitive,
    reference: Survey | None,
    made_ns: int,
    covariance_note: str,
    plan: Plan | None,
    software: str,
) -> tuple[tuple[str, str], ...]:
    well = surveys.well
    north = well.north_reference
    unknown, not_given = "not available", "not given"
    g_reference = reference.g_reference if reference is not None else math.nan
    assumed_north = any(one.kind == RemarkKind.NORTH_ASSUMED for one in path.assumptions)
    section = "as set" if well.section_azimuth_deg is not None else "towards the last survey"
    if plan is not None and math.isclose(path.section_azimuth, plan.section_azimuth):
        section = "along the plan"
    own = [r for r in surveys.records if r.leg == path.leg]
    lines = [
        ("Well", typed(well.name)),
        ("Wellbore", typed(well.wellbore_name)),
        ("Company", typed(well.company)),
        ("Field", typed(well.field)),
        ("Rig", typed(well.rig)),
        *_mine_head(well, plan),
        ("Survey company", typed(well.service_company)),
        ("Job number", typed(well.job_number)),
        ("Revision", typed(well.revision)),
        *_placed(well),
        ("Depth datum", typed(well.depth_datum) or not_given),
        ("Datum elevation", _metres(well.datum_elevation, " above mean sea level") or not_given),
        ("Azimuth reference", f"{north} north" + (", assumed" if assumed_north else "")),
        ("Hole angle", well.angles.meaning if well.angles.points else ""),
        ("Declination", _degrees(reference.declination if reference else None) or unknown),
        ("Grid convergence", _degrees(reference.convergence if reference else None) or "no grid given"),
        ("Total azimuth correction", _degrees(_correction(reference, north)) or unknown),
        ("Geomagnetic model", well.geomagnetic_model or (reference.reference_source if reference else "") or unknown),
        ("Reference total field", f"{fixed(reference.b_reference * 1e9, 0)} nT" if reference else unknown),
        ("Reference dip", f"{fixed(reference.dip_reference * _DEG, 3)} deg" if reference else unknown),
        ("Reference gravity", f"{fixed(g_reference, 5)} m/s2" if math.isfinite(g_reference) else unknown),
        ("Position uncertainty", covariance_note),
        ("Vertical section azimuth", f"{fixed(path.section_azimuth * _DEG, 2, 360.0)} deg, {section}"),
        ("Sensor to bit", _metres(well.sensor_to_bit) or "not given: depths are those of the bit"),
        ("Leg", path.leg if path.leg == MAIN else typed(path.leg)),
        ("Tie-on", _tied(surveys, path)),
        ("Coordinates", "assumed: " + "; ".join(sentences(path.assumptions)) if path.assumed else ""),
        ("Tools", _tools(own) or unknown),
        ("Telemetry", _telemetry([r.survey for r in own if r.in_use])),
        ("Method", "minimum curvature"),
        ("Plan", typed(plan.name) if plan is not None else "none"),
        ("Surveys", _counted(own)),
        ("Report made", utc(made_ns)),
        ("Software", software),
    ]
    return tuple((label, value if isinstance(value, Typed) else plain(value)) for label, value in lines if value)


def _mine_head(well: Well, plan: Plan | None) -> tuple[tuple[str, str], ...]:
    """Return labels and values of the head block that only a mine hole has."""
    mine = well.mine
    given = (mine.opening_x, mine.opening_y, mine.opening_z)
    opening = ", ".join(
        f"{name} {fixed(value, 3)} m" for name, value in zip("xyz", given, strict=True) if value is not None
    )
    design = ""
    if plan is not None and well.angles.points:
        angle = well.angles.shown(float(plan.inclination[0]))
        design = f"azimuth {fixed(float(plan.azimuth[0]) * _DEG, 2, 360.0)} deg, dip {fixed(angle * _DEG, 2)} deg"
    return (
        ("Mine", typed(mine.name)),
        ("Working face", typed(mine.working_face)),
        ("Drill site", typed(mine.drill_site)),
        ("Opening, mine coordinates", opening),
        ("Design at the opening", design),
        ("Probe", typed(mine.probe)),
        ("Probe calibrated", typed(mine.calibration_date)),
    )


def _tools(own: Sequence[SurveyRecord]) -> str:
    """Return the names of the tools of a leg: names of WITSML, or marked as typed by people (not translated)."""
    tools = sorted({r.tool for r in own if r.tool})
    text = ", ".join(tools)
    return text if all(tool.lower() in TOOL_CODES for tool in tools) else typed(text)


def _counted(own: Sequence[SurveyRecord]) -> str:
    used, by_hand = sum(1 for r in own if r.in_use), sum(1 for r in own if r.judgement)
    return f"{used} surveys in use of {len(own)}; {by_hand} judged by a person"


def _telemetry(used: Sequence[Survey]) -> str:
    """
    Return the number of surveys in use from each telemetry link or other source, as text.

    The text is empty if no survey came over a link.
    """
    if not any(one.link for one in used):
        return ""
    ways = Counter(one.link or ("tool's own topics" if one.has_readings else "imported list") for one in used)
    return ", ".join(f"{way}: {count} of {len(used)}" for way, count in sorted(ways.items()))


def _placed(well: Well) -> tuple[tuple[str, str], ...]:
    known = well.latitude_deg is not None and well.longitude_deg is not None
    place = f"{fixed(well.latitude_deg, 6)} deg, {fixed(well.longitude_deg, 6)} deg" if known else "not given"
    return ("Latitude, longitude (WGS84)", place), ("Map grid", _map_grid(well))


def _tied(surveys: SurveyList, path: Definitive) -> str:
    """Return the tie-on of the leg of a path as text; "not given" if the tie-on was assumed."""
    t, angles = surveys.find_leg(path.leg).tie_on, surveys.well.angles
    if path.kind[0] == ASSUMED:
        return "not given"
    angle = fixed(angles.shown(t.inclination) * _DEG, 2)
    return (
        f"{t.source}, {fixed(t.measured_depth, 2)} m MD, {angles.heading} {angle} deg,"
        f" Azi {fixed(t.azimuth * _DEG, 2, 360.0)} deg"
    )


def _correction(reference: Survey | None, north: str) -> float | None:
    """Return the angle that was added to magnetic azimuths to refer them to `north`, rad; None if unknown."""
    if north == "magnetic":
        return 0.0
    if reference is None:
        return None
    return or_none(reference.declination - (0.0 if north == "true" else reference.convergence))


def degrees(angle: float | None, decimals: int) -> str:
    """Return an angle, rad, in degrees with the given number of decimals; empty for None."""
    return "" if angle is None else fixed(angle * _DEG, decimals)


def _degrees(angle: float | None) -> str:
    text = degrees(angle, 3)
    return f"{text} deg" if text else ""


def _metres(length: float | None, words: str = "") -> str:
    return "" if length is None else f"{fixed(length, 2)} m{words}"


def _map_grid(well: Well) -> str:
    """Return grid, coordinates of the wellhead, convergence and scale as text; empty if no grid is configured."""
    if not well.grid:
        return ""
    if well.latitude_deg is None or well.longitude_deg is None:
        return f"{well.grid}: needs the latitude and longitude of the wellhead"
    crs = None if well.grid == "utm" else well.grid
    try:
        at = earth.map_grid(math.radians(well.latitude_deg), math.radians(well.longitude_deg), crs)
    except ValueError as error:
        return str(error)
    return (
        f"{at.name}: wellhead at {fixed(at.easting, 2)} m E, {fixed(at.northing, 2)} m N; convergence"
        f" {fixed(at.convergence * _DEG, 4)} deg, scale {at.scale:.6f}"
    )
