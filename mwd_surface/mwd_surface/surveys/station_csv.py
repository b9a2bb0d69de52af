# SPDX-License-Identifier: Apache-2.0
"""
Stations as CSV: angles, totals and verdict of each, with what a person needs to check it by hand.

The same columns come from a table of readings (`mwd survey`) and from a recording (`mwd process`). What is unknown is
an empty cell; reasons are joined by a semicolon.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reason_text import text as text_of
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.six_axis_table import TableStation
from mwd_estimation.survey.station import Station

COLUMNS = (
    "md_m",
    "inclination_deg",
    "azimuth_deg",
    "azimuth_reference",
    "toolface_deg",
    "g_total_mps2",
    "b_total_nt",
    "dip_deg",
    "verdict",
    "reasons",
    "sigma_inclination_deg",
    "sigma_azimuth_deg",
    "sigma_toolface_deg",
    "magnetic_toolface_deg",
    "azimuth_method",
    "azimuth_raw_deg",
    "sigma_azimuth_raw_deg",
    "azimuth_corrected_deg",
    "sigma_azimuth_corrected_deg",
    "axial_interference_nt",
    "sigma_axial_interference_nt",
    "g_reference_mps2",
    "b_reference_nt",
    "dip_reference_deg",
    "declination_deg",
    "convergence_deg",
    "headline",
    "verdict_inclination",
    "verdict_azimuth",
    "verdict_toolface",
    "alternatives_deg",
    "alternative_odds",
    "hypotheses",
)
# What a table of readings has beside: the value each row had first, with the rows before it in its run.
ROW_COLUMNS = (
    *COLUMNS,
    "time",
    "run",
    "revised",
    "outlier",
    "first_azimuth_deg",
    "first_sigma_azimuth_deg",
    "first_verdict",
)
# Columns of words; the others hold numbers.
TEXTS = frozenset(
    name
    for name in COLUMNS
    if name.startswith(("azimuth_reference", "azimuth_method", "verdict", "reasons", "headline", "altern", "hypoth"))
)


def cells(station: Station, measured_depth: float = math.nan) -> dict[str, str]:
    """One line: column -> text. measured_depth, m; nan where unknown."""
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
    for method in (AzimuthMethod.RAW, AzimuthMethod.SINGLE_STATION):
        found = station.by_method(method)
        line[f"azimuth_{method}_deg"] = _around(found.azimuth if found else None)
        line[f"sigma_azimuth_{method}_deg"] = _degrees(found.sigma if found else None)
    return line


def row_cells(row: TableStation) -> dict[str, str]:
    """One line of a table of readings: column -> text."""
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
    }


def text(columns: Sequence[str], lines: Iterable[Mapping[str, Any]]) -> str:
    """The table with its header; a line lacks what it doesn't know."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def number(value: float | None, decimals: int) -> str:
    """Fixed-point text; empty for what is unknown (None, nan, infinite)."""
    if value is None or not math.isfinite(value):
        return ""
    # Without a minus before zero.
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _degrees(value: float | None) -> str:
    return number(None if value is None else math.degrees(value), 4)


def _around(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return ""
    # 359.99999 must not become 360.0000.
    return number(round(math.degrees(value) % 360.0, 4) % 360.0, 4)
