# SPDX-License-Identifier: Apache-2.0
"""Section of the report with the place of every station on the map, and that of the survey programme."""

from __future__ import annotations

import math

from mwd_sensors.core import earth
from mwd_surface.exports.report_section import Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed, typed
from mwd_surface.surveys.well_position import programme_of
from mwd_surface.uncertainty.programme import ProgrammeError

_DEG = 180.0 / math.pi


def positions(table: SurveyTable) -> Section | None:
    """
    Return latitude, longitude and map coordinates of every station.

    None if the place of the wellhead is not given, or the path has magnetic north or rests on an assumption. Map
    coordinates are those of the well's grid, else of the UTM zone. Offsets are scaled by the scale of the grid at the
    wellhead; the error of this is millimetres for a well of kilometres.
    """
    well, path = table.surveys.well, table.path
    if well.latitude_deg is None or well.longitude_deg is None or path.assumed or well.north_reference == "magnetic":
        return None
    crs = None if well.grid in ("", "utm") else well.grid
    try:
        head = earth.map_grid(math.radians(well.latitude_deg), math.radians(well.longitude_deg), crs)
    except ValueError:
        return None  # the head of the report says why there is no map grid
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
    sheet = sheet_of("Place of every station on the map", columns, rows, legend=legend)
    return Section(sheet.heading, sheets=(sheet,))


def programme(table: SurveyTable) -> Section | None:
    """Return the survey programme, whose tool codes give the position uncertainty; None if there is none."""
    try:
        found = programme_of(table.surveys.well)
    except ProgrammeError:
        return None  # the head of the report says why there is no position uncertainty
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
    sheet = sheet_of("Survey programme", columns, rows)
    return Section(sheet.heading, sheets=(sheet,))
