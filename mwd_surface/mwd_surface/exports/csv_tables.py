# SPDX-License-Identifier: Apache-2.0
"""
Tables as CSV: surveys with a head block, path, deviation from the design, clearances, forecast, comparison of surveys.

Lines of the head block start with #. One line of column names with units and the rows follow. Numbers have a decimal
point in every locale, unknown numbers are empty. The columns of surveys and paths have the names of all tables
(`signals/table.csv`, `surveys.survey_csv`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.signals.cells import fixed, plain
from mwd_surface.signals.cells import table as csv_table
from mwd_surface.signals.table import LISTED
from mwd_surface.surveys import survey_csv
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.surveys.mine_hole import is_ahead
from mwd_surface.trajectory.well_path import PROJECTED
from mwd_surface.uncertainty.position_covariance import ellipse

if TYPE_CHECKING:
    from mwd_surface.clearance.clearance import Clearance
    from mwd_surface.exports.survey_table import SurveyTable
    from mwd_surface.surveys.survey_list import SurveyList
    from mwd_surface.trajectory.list_comparison import PathDifference
    from mwd_surface.uncertainty.forecast import Forecast

#: Columns of a table, and the text of the cell of each at an index of the object that the table shows.
Columns = Mapping[str, Callable[[Any, int], str]]


def _degrees(angle: float, decimals: int, wrap: float = 0.0) -> str:
    return fixed(math.degrees(angle), decimals, wrap)


def _rows(columns: Columns, points: Iterable[tuple[Any, int]]) -> str:
    """Return a table with one row for each object and index."""
    return csv_table(tuple(columns), ({name: cell(*point) for name, cell in columns.items()} for point in points))


def definitive_csv(table: SurveyTable) -> str:
    """
    Return the definitive survey: head block, column names, one line per station; the projection to the bit is last.

    The column `station` gives the kind of station: tie-on, assumed (assumed tie-on, because none was given), survey,
    projected. The column `coordinates` is "assumed" if depths and positions are based on an assumption; the head block
    names the assumption.

    Text is UTF-8 when encoded; lines end with a newline.
    """
    notes = (*table.left_out, *map(plain, table.remarks), *provenance_of(table.surveys, table.path.leg).lines())
    lines = []
    for k in table.rows:
        record = table.records[k]
        known = (
            {"leg": table.path.leg} if record is None else survey_csv.cells(record, table.surveys.north, table.display)
        )
        lines.append({**known, **{column.key: column.cell(k) for column in table.columns}, **_station(table, k)})
    return _head(table.header, notes) + survey_csv.text(lines, display=table.display)


def raw_csv_of(table: SurveyTable) -> str:
    """Return all surveys of the list of a table below its head block, with the table's sentences as comments."""
    # The raw list has no row for the tie-on. Its surveys form one path only if all surveys in use belong to one leg.
    legs = {r.leg for r in table.surveys.records if r.in_use}
    provenance = provenance_of(table.surveys, legs.pop() if len(legs) == 1 else None, whole=False)
    return raw_csv(table.surveys, table.header, (*table.left_out, *table.remarks, *provenance.lines()))


def raw_csv(surveys: SurveyList, header: Iterable[tuple[str, str]] = (), notes: Iterable[str] = ()) -> str:
    """
    Return all surveys of the list in order of number, in use or not; azimuths are from each survey's own north.

    header, notes: labels and values of the head block, and comment lines below this block.
    """
    lines = survey_csv.list_cells(surveys, surveys.well.display)
    return _head(header, map(plain, notes)) + survey_csv.text(lines, display=surveys.well.display)


def _head(header: Iterable[tuple[str, str]], notes: Iterable[str]) -> str:
    return "".join(f"# {line}\n" for line in (*(f"{label}: {value}" for label, value in header), *notes))


def _station(table: SurveyTable, k: int) -> dict[str, str]:
    """Return the words about a station of a path by column: north of its azimuth, kind, whether it is assumed."""
    path = table.path
    coordinates = "assumed" if path.assumed else ""
    return {"azimuth_reference": path.north.name.lower(), "station": path.kind[k], "coordinates": coordinates}


_DECIMALS = 10  # decimals of every number of path.csv
_ELLIPSE = ("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg")
_WORDS = ("azimuth_reference", "station", "sequence", "tool", "coordinates")


def path_csv(table: SurveyTable) -> str:
    """
    Return path.csv: one line per station with ten decimals, from the tie-on down; the projection to the bit last.

    Sigmas and the horizontal error ellipse (half axes, azimuth of the major axis) are at 1 sigma, empty if unknown.
    """
    lines: list[dict[str, Any]] = []
    for k in table.rows:
        record = table.records[k]
        numbers = {one.key: fixed(one.values[k], _DECIMALS, one.signal.wrap) for one in table.columns}
        source = {"sequence": record.survey.sequence, "tool": record.tool} if record is not None else {}
        lines.append(numbers | _ellipse(table, k) | source | _station(table, k))
    listed = (signal.column_for_people(column, table.display) for signal, column in LISTED)
    return csv_table((*(column.key for column in listed), *_ELLIPSE, *_WORDS), lines)


def _ellipse(table: SurveyTable, k: int) -> dict[str, str]:
    """Return half axes and azimuth of a station's horizontal ellipse as texts, by column; empty if unknown."""
    if table.covariance is None or not np.all(np.isfinite(table.covariance[k])):
        return {}
    flat = ellipse(table.covariance[k][:2, :2], sigmas=1.0)
    values = (flat.major, flat.minor, math.degrees(flat.angle))
    return {name: fixed(float(value), _DECIMALS) for name, value in zip(_ELLIPSE, values, strict=True)}


_DEVIATIONS = {
    "right_of_design_m": "right",
    "sigma_right_m": "sigma_right",
    "above_design_m": "up",
    "sigma_above_m": "sigma_up",
    "to_design_m": "distance",
    "mine_x_m": "x",
    "mine_y_m": "y",
    "mine_z_m": "z",
}


def deviation_csv(table: SurveyTable) -> str:
    """
    Return the deviations from the designed hole at every station, at the bit, and along the projected hole ahead.

    Left and below are negative; x north, y east and z up are mine coordinates. A mine coordinate is empty on an axis on
    which the opening of the hole is not given. The vertical angle has the convention of the well. Rows at the bit and
    ahead of it are projected. Without a design there are no rows, but a comment.
    """
    rows, path = table.deviations, table.path
    angles = table.surveys.well.angles
    names = (
        *("survey", "station", "leg", "ahead", "md_m", angles.column, "azimuth_deg", "azimuth_reference"),
        *(*_DEVIATIONS, "coordinates"),
    )
    lines = [
        {
            "survey": row.station,
            "station": PROJECTED if is_ahead(row) else row.kind,
            "leg": row.leg,
            "ahead": "yes" if is_ahead(row) else "no",
            "md_m": fixed(row.measured_depth, 3),
            angles.column: _degrees(angles.shown(row.inclination), 4),
            "azimuth_deg": _degrees(row.azimuth, 4, 360.0),
            "azimuth_reference": path.north.name.lower(),
            **{name: fixed(getattr(row, field), 3) for name, field in _DEVIATIONS.items()},
            "coordinates": "assumed" if path.assumed else "",
        }
        for row in rows
    ]
    head = "" if rows else "# no row: the list has no survey or no design; give the design with --plan\n"
    return head + csv_table(names, lines)


_CLEARANCE: Columns = {
    "offset_well": lambda other, _k: other.name,
    "md_m": lambda other, k: fixed(float(other.md[k]), 2),
    "offset_md_m": lambda other, k: fixed(float(other.offset_md[k]), 2),
    "distance_m": lambda other, k: fixed(float(other.distance[k]), 3),
    "allowed_distance_m": lambda other, k: fixed(float(other.allowed[k]), 3),
    "separation_factor": lambda other, k: fixed(float(other.factor[k]), 4),
    "level": lambda other, k: other.rule.level(float(other.factor[k])).name.lower(),
    "toolface_deg": lambda other, k: _degrees(other.toolface[k], 1, 360.0),
    "bearing_deg": lambda other, k: _degrees(other.bearing[k], 1, 360.0),
}


def clearance_csv(found: Sequence[Clearance]) -> str:
    """
    Return clearances, one line per point of the well and offset well.

    The offset well with the smallest separation factor comes first.
    """
    return _rows(_CLEARANCE, ((other, k) for other in found for k in range(other.md.size)))


_FORECAST: Columns = {
    "md_m": lambda found, k: fixed(float(found.md[k]), 2),
    "inclination_deg": lambda found, k: _degrees(found.inclination[k], 3),
    "azimuth_deg": lambda found, k: _degrees(found.azimuth[k], 3, 360.0),
    "azimuth_true_deg": lambda found, k: _degrees(found.true_azimuth[k], 3, 360.0),
    "sigma_inclination_deg": lambda found, k: _degrees(found.sigma_inclination[k], 4),
    "sigma_azimuth_deg": lambda found, k: _degrees(found.sigma_azimuth[k], 4),
    "sigma_azimuth_corrected_deg": lambda found, k: _degrees(found.sigma_corrected[k], 4),
    "limit_gravity_mg": lambda found, k: fixed(float(found.limits[k, 0]) / (1e-3 * STANDARD_GRAVITY), 3),
    "limit_field_nt": lambda found, k: fixed(float(found.limits[k, 1]) * 1e9, 1),
    "limit_dip_deg": lambda found, k: _degrees(found.limits[k, 2], 3),
    "accepted": lambda found, k: fixed(float(found.accepted[k]), 2),
    "correction_no_go": lambda found, k: "yes" if found.no_go[k] else "no",
}


def forecast_csv(found: Forecast) -> str:
    """Return a forecast of surveys, one line per station of the plan."""
    return _rows(_FORECAST, ((found, k) for k in range(found.md.size)))


_COMPARISON: Columns = {
    "md_m": lambda found, k: fixed(float(found.md[k]), 6),
    "inclination_deg": lambda found, k: _degrees(found.inclination[k, 0], 6),
    "other_inclination_deg": lambda found, k: _degrees(found.inclination[k, 1], 6),
    "difference_inclination_deg": lambda found, k: _degrees(found.turn[k, 0], 6),
    "azimuth_deg": lambda found, k: _degrees(found.azimuth[k, 0], 6),
    "other_azimuth_deg": lambda found, k: _degrees(found.azimuth[k, 1], 6),
    "difference_azimuth_deg": lambda found, k: _degrees(found.turn[k, 1], 6),
    "difference_north_m": lambda found, k: fixed(float(found.position[k, 0]), 6),
    "difference_east_m": lambda found, k: fixed(float(found.position[k, 1]), 6),
    "difference_tvd_m": lambda found, k: fixed(float(found.position[k, 2]), 6),
    "distance_m": lambda found, k: fixed(float(found.distance[k]), 6),
    "sigma_difference_north_m": lambda found, k: fixed(float(found.sigma[k, 0]), 6),
    "sigma_difference_east_m": lambda found, k: fixed(float(found.sigma[k, 1]), 6),
    "sigma_difference_tvd_m": lambda found, k: fixed(float(found.sigma[k, 2]), 6),
    "distance_sigmas": lambda found, k: fixed(float(found.sigmas[k]), 6),
}


def comparison_csv(found: PathDifference) -> str:
    """
    Return comparison.csv: the first list minus the second list, at the stations of the first list.

    Unknown sigmas are empty.
    """
    return _rows(_COMPARISON, ((found, k) for k in range(found.md.size)))
