# SPDX-License-Identifier: Apache-2.0
"""
Stations as CSV: angles, totals and verdict of each, with the data that a person needs to check them by hand.

A table of readings (`mwd survey`) and a recording (`mwd process`) give the same columns. Unknown values are empty
cells; reasons are joined by semicolons.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reason_text import text as text_of
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.station import Station
from mwd_surface.list_files.six_axis_table import TableStation


class Column(NamedTuple):
    """A column of the table, with its unit at the end of the name; text: it holds words or several numbers."""

    name: str
    meaning: str
    text: bool = False

    @property
    def unit(self) -> str:
        """Unit as people write it; empty if there is none."""
        return UNITS.get(self.name.rpartition("_")[2], "")


UNITS = {"m": "m", "deg": "deg", "mps2": "m/s²", "nt": "nT"}
OF_STATIONS = (
    Column("md_m", "measured depth of the sensor; empty if unknown"),
    Column("inclination_deg", "angle from the vertical"),
    Column("azimuth_deg", "best azimuth, clockwise from azimuth_reference"),
    Column("azimuth_reference", "north of all azimuths of the row: magnetic, true or grid", text=True),
    Column("toolface_deg", "gravity toolface, from the high side"),
    Column("g_total_mps2", "measured total gravity"),
    Column("b_total_nt", "measured total field"),
    Column("dip_deg", "dip of the measured field, below the horizontal"),
    Column("verdict", "verdict of the station: accept, doubtful or reject", text=True),
    Column("reasons", "reasons of the verdict, each with value and limit, joined by semicolons", text=True),
    Column("sigma_inclination_deg", "1 sigma"),
    Column("sigma_azimuth_deg", "1 sigma"),
    Column("sigma_toolface_deg", "1 sigma"),
    Column("magnetic_toolface_deg", "toolface from azimuth_reference"),
    Column(
        "azimuth_method",
        "fused: posterior of all sensors; gyro: no magnetic field; raw: no reference; none",
        text=True,
    ),
    Column("azimuth_raw_deg", "azimuth from the field as measured"),
    Column("sigma_azimuth_raw_deg", "1 sigma"),
    Column("azimuth_corrected_deg", "azimuth by single-station correction of axial interference"),
    Column("sigma_azimuth_corrected_deg", "1 sigma"),
    Column("axial_interference_nt", "field of the string along the axis, positive downhole"),
    Column("sigma_axial_interference_nt", "1 sigma"),
    Column("g_reference_mps2", "reference gravity"),
    Column("b_reference_nt", "total field of the reference"),
    Column("dip_reference_deg", "dip of the reference"),
    Column("declination_deg", "declination of the reference, east positive; magnetic plus declination is true azimuth"),
    Column("convergence_deg", "grid convergence; true minus convergence is grid azimuth"),
    Column("headline", "main reason to act; empty if accepted", text=True),
    Column("verdict_inclination", "accept, doubtful or reject", text=True),
    Column("verdict_azimuth", "as verdict_inclination; not determined if the attitude defines no azimuth", text=True),
    Column("verdict_toolface", "as verdict_azimuth", text=True),
    Column(
        "alternatives_deg", "other azimuths that fit the readings, most likely first, separated by spaces", text=True
    ),
    Column("alternative_odds", "probability of each", text=True),
    Column("hypotheses", "possible disturbances of the readings, each with its probability", text=True),
)
# Additional columns of a table of readings: the first value of each row, computed with the rows before it in its run.
OF_TABLES = (
    Column("time", "time as in the table", text=True),
    Column("run", "run as in the table", text=True),
    Column("revised", "yes if later stations changed the verdict or azimuth", text=True),
    Column("outlier", "yes if it disagrees with the other stations of the run", text=True),
    Column("first_azimuth_deg", "azimuth computed only with the earlier rows of its run"),
    Column("first_sigma_azimuth_deg", "1 sigma"),
    Column("first_verdict", "verdict computed only with the earlier rows", text=True),
    Column("azimuth_msa_deg", "azimuth by multi-station analysis of the run; empty if refused or with few stations"),
    Column("sigma_azimuth_msa_deg", "1 sigma"),
)
COLUMNS = tuple(column.name for column in OF_STATIONS)
ROW_COLUMNS = (*COLUMNS, *(column.name for column in OF_TABLES))
# Columns of text; the others hold numbers.
TEXTS = frozenset(column.name for column in OF_STATIONS if column.text)


def cells(station: Station, measured_depth: float = math.nan) -> dict[str, str]:
    """Return one line: column -> text. measured_depth, m; NaN if unknown."""
    reference = station.reference or Reference()
    line = {
        "md_m": number(measured_depth, 3),
        "inclination_deg": _degrees(station.inclination),
        "azimuth_deg": _around(station.azimuth),
        "azimuth_reference": station.north if math.isfinite(station.azimuth) else "",
        "toolface_deg": _around(station.gravity_toolface),
        "g_total_mps2": number(station.g_total, 6),
        "b_total_nt": number(station.b_total * 1e9, 1),
        "dip_deg": _degrees(station.dip),
        "verdict": station.verdict,
        "headline": text_of(station.headline) if station.headline is not None else "",
        "reasons": joined(station.reasons),
        "sigma_inclination_deg": _degrees(station.sigma_inclination),
        "sigma_azimuth_deg": _degrees(station.sigma_azimuth) if math.isfinite(station.azimuth) else "",
        "sigma_toolface_deg": _degrees(station.sigma_toolface),
        "magnetic_toolface_deg": _around(station.magnetic_toolface),
        "azimuth_method": station.method,
        "axial_interference_nt": number(station.interference * 1e9, 1),
        "sigma_axial_interference_nt": number(station.sigma_interference * 1e9, 1),
        "g_reference_mps2": number(reference.gravity, 6),
        "b_reference_nt": number(None if reference.total is None else reference.total * 1e9, 1),
        "dip_reference_deg": _degrees(reference.dip),
        "declination_deg": _degrees(reference.declination),
        "convergence_deg": _degrees(reference.convergence),
        "verdict_inclination": station.verdicts.inclination,
        "verdict_azimuth": station.verdicts.azimuth,
        "verdict_toolface": station.verdicts.toolface,
        "alternatives_deg": " ".join(_around(azimuth) for azimuth, _ in station.alternatives),
        "alternative_odds": " ".join(number(odds, 4) for _, odds in station.alternatives),
        "hypotheses": " ".join(f"{name} {number(odds, 3)}" for name, odds in station.hypotheses),
    }
    return line | _of_method(station, AzimuthMethod.RAW) | _of_method(station, AzimuthMethod.SINGLE_STATION)


def _of_method(station: Station, method: AzimuthMethod) -> dict[str, str]:
    """Return the azimuth of one method and its sigma; empty if the method was not tried."""
    found = station.by_method(method)
    return {
        f"azimuth_{method}_deg": _around(found.azimuth if found else None),
        f"sigma_azimuth_{method}_deg": _degrees(found.sigma if found else None),
    }


def row_cells(row: TableStation) -> dict[str, str]:
    """Return one line of a table of readings: column -> text."""
    line = {**cells(row.station, row.md), "time": row.time, "run": row.run}
    if row.first is None:
        return line
    known = math.isfinite(row.first.azimuth)
    return line | {
        "revised": "yes" if row.revised else "no",
        "outlier": "yes" if row.outlier else "no",
        "first_azimuth_deg": _around(row.first.azimuth),
        "first_sigma_azimuth_deg": _degrees(row.first.sigma_azimuth) if known else "",
        "first_verdict": row.first.verdict,
        **_multi_station(row.station),
    }


def _multi_station(station: Station) -> dict[str, str]:
    """Return the azimuth by multi-station analysis; empty if it was refused."""
    found = station.by_method(AzimuthMethod.MULTI_STATION)
    return {} if found is None or found.refused is not None else _of_method(station, AzimuthMethod.MULTI_STATION)


def text(columns: Sequence[str], lines: Iterable[Mapping[str, Any]]) -> str:
    """Return the table with its header; missing keys of a line become empty cells."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def number(value: float | None, decimals: int) -> str:
    """Return fixed-point text; empty if unknown (None, NaN, infinite)."""
    if value is None or not math.isfinite(value):
        return ""
    # Adding 0.0 avoids "-0".
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _degrees(value: float | None) -> str:
    return number(None if value is None else math.degrees(value), 4)


def _around(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return ""
    # Do not write 359.99999 as 360.0000.
    return number(round(math.degrees(value) % 360.0, 4) % 360.0, 4)
