# SPDX-License-Identifier: Apache-2.0
"""Content of the survey report without its layout: head, certificate, and the sections about the path of the hole."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import budgets, earth
from mwd_sensors.core.input_files import read_file
from mwd_surface.exports.report_plots import ELLIPSE_SIGMAS, plan_view, section_view
from mwd_surface.exports.report_section import DOUBTFUL as DOUBTFUL_TINT
from mwd_surface.exports.report_section import GOOD, REJECT, Drawing, Section, Sheet, table_section
from mwd_surface.exports.report_surveys import (
    azimuths,
    decisions,
    repeated,
    row_mark,
    run_quality,
    slides,
    stations,
    verdicts,
)
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.exports.trajectory_files import summary
from mwd_surface.signals.cells import fixed, plain, typed
from mwd_surface.surveys.leg import MAIN
from mwd_surface.surveys.mine_hole import CONSISTENT, DOUBTFUL, INCONSISTENT, branches, is_ahead
from mwd_surface.surveys.well_position import programme_of
from mwd_surface.trajectory.dense_trajectory import STATION, dense_trajectory
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED
from mwd_surface.uncertainty.programme import ProgrammeError

_DEG = 180.0 / math.pi


def positions(table: SurveyTable) -> Section | None:
    """
    Return the section with latitude, longitude and map coordinates of every station.

    Return None if the location of the wellhead is not given, if azimuths are from magnetic north, if the path is based
    on an assumption, or if the map grid cannot be used there. Map coordinates are those of the well's grid, or else of
    the UTM zone. Distances are multiplied by the scale of the grid at the wellhead; the resulting error is millimetres
    for a well of kilometres.
    """
    well, path = table.surveys.well, table.path
    if well.latitude_deg is None or well.longitude_deg is None or path.assumed or well.north_reference == "magnetic":
        return None
    crs = None if well.grid in ("", "utm") else well.grid
    try:
        head = earth.map_grid(math.radians(well.latitude_deg), math.radians(well.longitude_deg), crs)
    except ValueError:
        return None  # the head of the report gives the reason
    turn = head.convergence if well.north_reference == "true" else 0.0
    north, east = path.positions[:, 0], path.positions[:, 1]
    northing = head.northing + head.scale * (north * math.cos(turn) + east * math.sin(turn))
    easting = head.easting + head.scale * (east * math.cos(turn) - north * math.sin(turn))
    lat, lon = earth.geographic(head.name, easting, northing)
    height = None if well.datum_elevation is None else well.datum_elevation - path.positions[:, 2]
    rows = []
    for k in table.rows:
        record = table.records[k]
        rows.append(
            (
                str(record.survey.sequence) if record is not None else path.kind[k],
                fixed(float(path.md[k]), 2),
                fixed(float(lat[k]) * _DEG, 7),
                fixed(float(lon[k]) * _DEG, 7),
                fixed(float(easting[k]), 2),
                fixed(float(northing[k]), 2),
                "" if height is None else fixed(float(height[k]), 2),
            )
        )
    columns = (
        *(("Survey", ""), ("MD", "m"), ("Latitude", "deg"), ("Longitude", "deg")),
        *(("Easting", "m (grid)"), ("Northing", "m (grid)"), ("Above sea level", "m")),
    )
    legend = f"WGS84; map grid {head.name}."
    return table_section("Place of every station on the map", columns, rows, legend=legend)


def programme(table: SurveyTable) -> Section | None:
    """
    Return the section with the survey programme that gives the position uncertainty.

    None if neither programme nor tool code is set, or if the programme file cannot be used.
    """
    try:
        found = programme_of(table.surveys.well)
    except ProgrammeError:
        return None  # the head of the report gives the reason why there is no position uncertainty
    if found is None:
        return None
    rows = [
        (
            fixed(row.from_m, 2),
            "end" if row.to_m is None else fixed(row.to_m, 2),
            typed(row.code),
            ", ".join(f"{method}: {code}" for method, code in row.methods.items()),
            typed(row.leg) or "every leg",
            row.run if row.run == "all" else typed(row.run),
            row.angles,
        )
        for row in found.intervals
    ]
    columns = (
        *(("From", "m"), ("To", "m"), ("Tool code", ""), ("Tool code by method", "")),
        *(("Leg", ""), ("Run", ""), ("Sigmas from", "")),
    )
    return table_section("Survey programme", columns, rows)


_COLUMNS = (
    ("MD", "m"),
    ("TVD", "m"),
    ("TVD, high density", "m"),
    ("Δ TVD", "m"),
    ("Δ N", "m"),
    ("Δ E", "m"),
)


def high_density(table: SurveyTable) -> Section | None:
    """Return the section with station depths computed from the slide sheet; None if no interval can be computed."""
    found = dense_trajectory(table.path, stretches=table.stretches)
    if not found.has_detail:
        return None
    rows = []
    for k in np.flatnonzero([source == STATION for source in found.source]):
        down, (north, east, apart) = found.positions[k, 2], found.differences[k]
        rows.append(tuple(fixed(float(value), 2) for value in (found.md[k], down - apart, down, apart, north, east)))
    text = (
        "For comparison, not the definitive survey: the dogleg of each interval is assigned to the stretches where the"
        f" string slid according to the slide sheet, instead of an even arc. {summary(found)}."
    )
    return table_section("High-density trajectory", _COLUMNS, rows, text=(text,))


# Titles of the signatures for an oil or gas well, and for a mine hole.
_SIGNATURES = (
    ("Survey engineer", "Directional driller", "Company representative"),
    ("Driller", "Surveyor", "Head of the shift", "Representative of the mine"),
)


@dataclasses.dataclass(frozen=True)
class Content:
    """Content of the report: title, head block, notes, sections, certificate and signature lines."""

    title: str
    header: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    sections: tuple[Section, ...]
    certificate: str
    signatures: tuple[str, ...]

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """Every table, in printed order."""
        return tuple(sheet for section in self.sections for sheet in section.sheets)

    def words(self) -> Iterator[str]:
        """Yield every text of the report, except the texts inside drawings."""
        yield from (
            self.title,
            self.certificate,
            *self.signatures,
            *self.notes,
            *(t for pair in self.header for t in pair),
        )
        for section in self.sections:
            yield from (section.heading, *section.text, *(drawing.caption for drawing in section.drawings))
        for sheet in self.sheets:
            yield from (sheet.heading, sheet.legend, *sheet.titles, *sheet.units, *sheet.marks)
            for row in sheet.rows:
                yield from row


def content(table: SurveyTable) -> Content:
    """Return the report of a table, as texts and printed numbers."""
    well = table.surveys.well
    notes = [*table.left_out, *map(plain, table.remarks)]
    if table.path.kind[-1] == "projected":
        notes.append("The last station is projected to the bit; it was not surveyed.")
    by_hand = [r for r in table.surveys.records if r.in_use and r.survey.verdict != Verdict.ACCEPT]
    if by_hand:
        numbers = ", ".join(str(r.survey.sequence) for r in by_hand)
        notes.append(f"Used by manual decision against the automatic verdict: survey {numbers}.")
    try:
        logo_of(well.logo)
    except (OSError, ValueError) as error:
        notes.append(f"The logo {well.logo} is not printed: {error}")
    made = (make(table) for make in SECTIONS)
    title = f"Hole report {well.name}" if well.angles.points else f"Survey report {well.name}"
    if table.final:
        title = f"Final survey list {well.name}"
    return Content(
        title=plain(title + (f", {well.wellbore}" if well.wellbore else "")),
        header=table.header,
        notes=tuple(notes),
        sections=(*(one for one in made if one is not None), *table.sections),
        certificate=(
            "Certified that this survey was computed by the minimum curvature method from the surveys marked as used,"
            f" from {well.north_reference} north, with the references and corrections stated above."
            + (
                " Its depths and positions are not certified: they are based on the assumption stated."
                if table.path.assumed
                else ""
            )
        ),
        signatures=_SIGNATURES[bool(well.angles.points)],
    )


def logo_of(path: str) -> tuple[bytes, str]:
    """
    Return the bytes of a picture and its MIME type; both are empty for an empty path.

    Raises
    ------
    OSError, ValueError
        The file cannot be read, or is neither PNG nor JPEG.
    """
    if not path:
        return b"", ""
    data = read_file(Path(path).expanduser(), budgets.LOGO)
    for start, kind in ((b"\x89PNG", "image/png"), (b"\xff\xd8", "image/jpeg")):
        if data.startswith(start):
            return data, kind
    raise ValueError("the file is neither PNG nor JPEG")


def printed_logo(path: str) -> tuple[bytes, str]:
    """Return the bytes of a picture and its MIME type; both are empty for an empty path or an unusable file."""
    try:
        return logo_of(path)
    except (OSError, ValueError):
        return b"", ""


def definitive(table: SurveyTable) -> Section:
    """Return the section with the definitive survey."""
    shown = [c for c in table.columns if any(v is not None for v in c.values)]
    rows, marks = [], []
    for k in table.rows:
        record, kind = table.records[k], table.path.kind[k]
        name = str(record.survey.sequence) if record is not None else kind
        rows.append((name, *(c.cell(k, paper=True) for c in shown), "; ".join(record.flags) if record else ""))
        marks.append(kind if kind in (PROJECTED, ASSUMED) else row_mark(record))
    columns = (("Survey", ""), *((c.listed.title, c.unit) for c in shown), ("Flags", ""))
    legend = "Shaded lines: projected or assumed, not surveyed, or used by manual decision." if any(marks) else ""
    return table_section("Definitive survey", columns, rows, marks, legend=legend)


def drawn(table: SurveyTable) -> Section:
    """Return the section with plan view and vertical section, and an explanation of the ellipses."""
    north = table.surveys.well.north_reference
    azimuth = dict(table.header)["Vertical section azimuth"]
    text = f"No position uncertainty: {table.covariance_note}."
    if table.covariance is not None:
        text = (
            f"Ellipses show the position uncertainty of a station at {ELLIPSE_SIGMAS:g} sigma in the plane of the"
            f" drawing: they contain the station with a probability of 86 %; {table.covariance_note}. They do not"
            " include gross errors."
        )
    return Section(
        "Well path",
        (text,),
        drawings=(
            Drawing(f"Plan view, {north} north", lambda: plan_view(table)),
            Drawing(f"Vertical section, azimuth {azimuth}", lambda: section_view(table)),
        ),
    )


def deviation(table: SurveyTable) -> Section | None:
    """
    Return the section with the rod table of a mine hole.

    None without a design, or for a well with inclination from the vertical.
    """
    angles, rows = table.surveys.well.angles, table.deviations
    if not angles.points or not rows:
        return None
    several = len(table.surveys.legs) > 1
    columns = (
        *(
            ("Survey", ""),
            *((("Leg", ""),) if several else ()),
            ("Depth", "m"),
            (angles.heading, "deg"),
            ("Azi", "deg"),
        ),
        *(("Right of design", "m"), ("1σ", "m"), ("Above design", "m"), ("1σ", "m")),
        *(("x, north", "m"), ("y, east", "m"), ("z, up", "m")),
    )
    cells = [
        (
            row.station or ("ahead" if is_ahead(row) else row.kind),
            *((_leg(row.leg),) if several else ()),
            fixed(row.measured_depth, 2),
            fixed(angles.shown(row.inclination) * _DEG, 2),
            fixed(row.azimuth * _DEG, 2, 360.0),
            fixed(row.right, 2),
            fixed(row.sigma_right, 2),
            fixed(row.up, 2),
            fixed(row.sigma_up, 2),
            *(fixed(value, 2) for value in (row.x, row.y, row.z)),
        )
        for row in rows
    ]
    marks = [PROJECTED if is_ahead(row) or row.kind == PROJECTED else "" for row in rows]
    legend = (
        "Across the design, looking along the hole: negative is left of or below the design. Shaded lines were not "
        "surveyed; ahead of the bit the hole is continued straight."
    )
    return table_section("Rod table and deviation from the design", columns, cells, marks, legend=legend)


def branched(table: SurveyTable) -> Section | None:
    """
    Return the section with the branches of a mine hole: depth where each branch leaves its parent, and its end.

    None without branches, or for a well with inclination from the vertical.
    """
    well, found = table.surveys.well, branches(table.surveys)
    if not well.angles.points or not found:
        return None
    columns = (
        *(("Branch", ""), ("Leaves", ""), ("At depth", "m"), (well.angles.heading, "deg"), ("Azi", "deg")),
        *(("x, north", "m"), ("y, east", "m"), ("z, up", "m"), ("Reaches", "m")),
    )
    cells = []
    for one in found:
        north, east, down = one.position
        x, y, z = well.mine.opening
        cells.append(
            (
                _leg(one.name),
                _leg(one.parent),
                fixed(one.measured_depth, 2),
                fixed(well.angles.shown(one.inclination) * _DEG, 2),
                fixed(one.azimuth * _DEG, 2, 360.0),
                *(fixed(value, 2) for value in (x + north, y + east, z - down)),
                fixed(one.end, 2),
            )
        )
    legend = "The path of a branch begins on the path of the leg that it leaves."
    return table_section("Branches", columns, cells, legend=legend)


def closed(table: SurveyTable) -> Section | None:
    """Return the section with the closure of a mine hole on its surveyed point; None if no point is given."""
    found = table.closure
    if found is None:
        return None
    columns = (
        *(("Leg", ""), ("Depth", "m"), ("Right", "m"), ("1σ", "m"), ("Above", "m"), ("1σ", "m"), ("Along", "m")),
        *(("1σ", "m"), ("Distance", "m"), ("Point, 1σ", "m"), ("By chance", "%"), ("Closure", "")),
    )
    numbers = (
        *(found.measured_depth, found.right, found.sigma_right, found.up, found.sigma_up),
        *(found.along, found.sigma_along, found.distance, found.sigma_point),
    )
    cells = (_leg(found.leg), *(fixed(value, 2) for value in numbers), fixed(100.0 * found.probability, 2))
    tint = {CONSISTENT: GOOD, DOUBTFUL: DOUBTFUL_TINT, INCONSISTENT: REJECT}.get(found.verdict)
    legend = (
        "Position of the computed path minus that of the surveyed point, looking along the hole: negative numbers lie "
        "to the left, below, or short of the point. 1σ is that of the path. The closure is consistent if an error of "
        "this size comes by chance in more than one of a hundred holes, and not consistent below one of a thousand."
    )
    return table_section(
        "Closure on the surveyed point",
        columns,
        [(*cells, found.verdict)],
        tints={(0, len(columns) - 1): tint} if tint else {},
        legend=legend,
        text=(f"{found.note}.",) if found.note else (),
    )


def _leg(name: str) -> str:
    """Return the name of a leg; the name of the main leg is a word of the program, and therefore translated."""
    return name if name == MAIN else typed(name)


# Functions that make the sections, in printed order; a function returns None if its section would be empty.
SECTIONS: tuple[Callable[[SurveyTable], Section | None], ...] = (
    deviation,
    branched,
    closed,
    definitive,
    positions,
    drawn,
    programme,
    run_quality,
    repeated,
    stations,
    azimuths,
    verdicts,
    decisions,
    slides,
    high_density,
)
