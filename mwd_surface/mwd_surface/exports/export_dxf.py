# SPDX-License-Identifier: Apache-2.0
"""
Plan view and vertical section of a hole as a DXF drawing; one drawing unit is a metre in both views.

The plan view has mine coordinates: east to the right, north up. The section lies below the plan view, along the azimuth
of the vertical section: distance from the opening to the right, height up. If the mine coordinates of the opening that
a view needs are not given, the view is drawn relative to the opening, and its title says so. Design, hole, stations and
texts have separate layers. Other legs of a hole with branches are drawn from the depth where they separate from the
exported leg, and the surveyed point as a cross.
"""

from __future__ import annotations

import io
import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed, plain
from mwd_surface.surveys.mine_hole import others
from mwd_surface.trajectory.plan import interpolated
from mwd_surface.trajectory.well_path import ASSUMED

DESIGN, HOLE, BRANCHES, STATIONS, TEXT = "DESIGN", "HOLE", "BRANCHES", "STATIONS", "TEXT"
POINT = "SURVEYED_POINT"
# AutoCAD colour index: green, blue, cyan, red, black or white, magenta.
_COLOURS = {DESIGN: 3, HOLE: 5, BRANCHES: 4, STATIONS: 1, TEXT: 7, POINT: 6}
_METRES = 6  # value of the DXF variable $INSUNITS for metres
_STEP = 10.0  # distance between two points of a drawn line, m


def dxf(table: SurveyTable) -> bytes:
    """Return the drawing as the bytes of a DXF R2010 file; without a plan the drawing has no design."""
    from ezdxf.filemanagement import new

    drawing = new("R2010", setup=True)
    drawing.units = _METRES
    for name, colour in _COLOURS.items():
        drawing.layers.add(name, color=colour, linetype="DASHED" if name == DESIGN else "CONTINUOUS")
    path, space = table.path, drawing.modelspace()
    measured = [k for k in table.rows if path.kind[k] != ASSUMED]
    lines = {HOLE: path.positions[measured]}
    if table.plan is not None:
        lines[DESIGN] = interpolated(table.plan, _STEP).positions
    views = {layer: (_plan(table, points), _section(table, points)) for layer, points in lines.items()}
    parts = [(name, (_plan(table, points), _section(table, points))) for name, points in others(table.surveys, path)]
    drawn = [*views.values(), *(view for _, view in parts)]
    point = _surveyed_point(table)
    if point is not None:
        drawn.append((_plan(table, point), _section(table, point)))
    everything = np.vstack([plan for plan, _ in drawn]), np.vstack([side for _, side in drawn])
    size = max(float(np.ptp(everything[0], axis=0).max()), float(np.ptp(everything[1], axis=0).max()), 1.0)
    height = size / 60.0
    # The section is placed below the plan view, flush with its left edge.
    corner = everything[0].min(axis=0) - [0.0, 6.0 * height] - [everything[1][:, 0].min(), everything[1][:, 1].max()]
    for layer, (plan, side) in views.items():
        for points in (plan, side + corner):
            space.add_lwpolyline([tuple(map(float, point)) for point in points], dxfattribs={"layer": layer})
    for name, (plan, side) in parts:
        for points in (plan, side + corner):
            space.add_lwpolyline([tuple(map(float, one)) for one in points], dxfattribs={"layer": BRANCHES})
            label = space.add_text(plain(name), height=height / 2.0, dxfattribs={"layer": TEXT})
            label.set_placement((float(points[-1, 0]) + height / 2.0, float(points[-1, 1]) - height))
    if point is not None:
        for place in (_plan(table, point)[0], _section(table, point)[0] + corner):
            for arm in ((height / 2.0, height / 2.0), (height / 2.0, -height / 2.0)):
                start, end = (tuple(map(float, place + sign * np.array(arm))) for sign in (-1.0, 1.0))
                space.add_line(start, end, dxfattribs={"layer": POINT})
    for points in (views[HOLE][0], views[HOLE][1] + corner):
        labelled = -math.inf
        for k, point in zip(measured, points, strict=True):
            place = tuple(map(float, point))
            space.add_circle(place, height / 4.0, dxfattribs={"layer": STATIONS})
            if path.md[k] < labelled + 3.0 * height:
                continue
            labelled = float(path.md[k])
            label = space.add_text(f"{fixed(float(path.md[k]), 1)} m", height=height / 2.0, dxfattribs={"layer": TEXT})
            label.set_placement((place[0] + height / 2.0, place[1] + height / 2.0))
    along = fixed(math.degrees(path.section_azimuth), 2, 360.0)
    name = table.surveys.well.wellbore_name + (" (coordinates assumed)" if path.assumed else "")
    opening = table.surveys.well.mine.opening
    from_opening = [", relative to the opening" if np.isnan(one).any() else "" for one in (opening[:2], opening[2])]
    titles = (
        (
            f"{name}: plan, {path.north.name.lower()} north up, 1 unit = 1 m{from_opening[0]}",
            everything[0].max(axis=0)[1],
        ),
        (
            f"{name}: section along azimuth {along} deg, 1 unit = 1 m{from_opening[1]}",
            (everything[1] + corner).max(axis=0)[1],
        ),
    )
    for title, top in titles:
        label = space.add_text(title, height=height, dxfattribs={"layer": TEXT})
        label.set_placement((float(everything[0].min(axis=0)[0]), float(top) + 2.0 * height))
    out = io.StringIO()
    drawing.write(out)
    return out.getvalue().encode()


def _surveyed_point(table: SurveyTable) -> Array | None:
    """Return the surveyed point of the well: north, east, down from the opening, shape (1, 3), m; None if unknown."""
    mine = table.surveys.well.mine
    x, y, z = (value - start for value, start in zip(mine.closure_point, mine.opening, strict=True))
    point = np.array([[x, y, -z]])
    return point if np.isfinite(point).all() else None


def _plan(table: SurveyTable, points: Array) -> Array:
    """Return east and north of positions, shape (n, 2), m, in mine coordinates or relative to the opening."""
    opening = np.array(table.surveys.well.mine.opening[:2])
    return points[:, 1::-1] + (0.0 if np.isnan(opening).any() else opening[::-1])


def _section(table: SurveyTable, points: Array) -> Array:
    """Return distance along the section from the opening, and height, of positions, shape (n, 2), m."""
    azimuth = table.path.section_azimuth
    along = points[:, 0] * math.cos(azimuth) + points[:, 1] * math.sin(azimuth)
    height = table.surveys.well.mine.opening[2]
    return np.column_stack([along, (0.0 if math.isnan(height) else height) - points[:, 2]])
