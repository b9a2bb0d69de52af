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

from mwd_estimation.core.north import North
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord


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
    Column("azimuth_deg", "definitive azimuth, clockwise from azimuth_reference"),
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
    Column("azimuth_msa_deg", "azimuth by multi-station analysis of the run; empty if refused or not made"),
    Column("sigma_azimuth_msa_deg", "1 sigma"),
    Column("azimuth_gyro_deg", "azimuth by north seeking of the precision gyro at the station"),
    Column("sigma_azimuth_gyro_deg", "1 sigma"),
    Column("first_azimuth_deg", "azimuth as first decided, with the earlier surveys of the run only"),
    Column("first_sigma_azimuth_deg", "1 sigma"),
    Column("first_verdict", "verdict as first decided", text=True),
    Column("revised_because", "why later surveys changed the azimuth or verdict; empty if they did not", text=True),
    Column("in_use", "yes if the station is part of the path", text=True),
    Column("person", "decision of a person: accepted or rejected; empty if nobody decided", text=True),
    Column("operator", "who decided", text=True),
)
# Additional columns of a table of readings.
OF_TABLES = (
    Column("time", "time as in the table", text=True),
    Column("run", "run as in the table", text=True),
    Column("outlier", "yes if it disagrees with the other stations of the run", text=True),
)
COLUMNS = tuple(column.name for column in OF_STATIONS)
ROW_COLUMNS = (*COLUMNS, *(column.name for column in OF_TABLES))
_METHODS = (AzimuthMethod.RAW, AzimuthMethod.SINGLE_STATION, AzimuthMethod.MULTI_STATION, AzimuthMethod.GYRO)
# Columns of text; the others hold numbers.
TEXTS = frozenset(column.name for column in OF_STATIONS if column.text)


def cells(record: SurveyRecord) -> dict[str, str]:
    """Return one line: column -> text."""
    survey = record.survey
    return {
        **_measured(survey),
        "md_m": number(record.measured_depth, 3),
        "in_use": "yes" if record.in_use else "no",
        **_first(record),
        "person": "" if record.judgement == Judgement.NOT_JUDGED else Judgement(record.judgement).name.lower(),
        "operator": record.operator_name,
    }


def _measured(survey: Survey) -> dict[str, str]:
    """Return the cells of the definitive value."""
    line = {
        "inclination_deg": _degrees(survey.inclination),
        "azimuth_deg": _around(survey.azimuth),
        "azimuth_reference": _north(survey),
        "toolface_deg": _around(survey.gravity_toolface),
        "g_total_mps2": number(survey.g_total, 6),
        "b_total_nt": number(survey.b_total * 1e9, 1),
        "dip_deg": _degrees(survey.dip),
        "verdict": _word(survey.verdict),
        "headline": survey.headline,
        "reasons": "; ".join(survey.reasons),
        "sigma_inclination_deg": _degrees(survey.sigma_inclination),
        "sigma_azimuth_deg": _degrees(survey.sigma_azimuth),
        "sigma_toolface_deg": _degrees(survey.sigma_toolface),
        "magnetic_toolface_deg": _around(survey.magnetic_toolface),
        "azimuth_method": survey.azimuth_method,
        "axial_interference_nt": number(survey.axial_interference * 1e9, 1),
        "sigma_axial_interference_nt": number(survey.sigma_axial_interference * 1e9, 1),
        "g_reference_mps2": number(survey.g_reference, 6),
        "b_reference_nt": number(survey.b_reference * 1e9, 1),
        "dip_reference_deg": _degrees(survey.dip_reference),
        "declination_deg": _degrees(survey.declination),
        "convergence_deg": _degrees(survey.convergence),
        "verdict_inclination": _word(survey.verdict_inclination),
        "verdict_azimuth": _word(survey.verdict_azimuth),
        "verdict_toolface": _word(survey.verdict_toolface),
        "alternatives_deg": " ".join(_around(azimuth) for azimuth in survey.alternatives),
        "alternative_odds": " ".join(number(odds, 4) for odds in survey.alternative_odds),
        "hypotheses": " ".join(
            f"{name} {number(odds, 3)}" for name, odds in zip(survey.hypotheses, survey.hypothesis_odds, strict=True)
        ),
    }
    by_method = {one.method: one for one in survey.azimuths}
    for method in _METHODS:
        found = by_method.get(str(method))
        # A refused multi-station analysis found nothing that is worth comparing.
        if found is not None and method == AzimuthMethod.MULTI_STATION and found.reason:
            found = None
        line[f"azimuth_{method}_deg"] = _around(found.azimuth if found else None)
        line[f"sigma_azimuth_{method}_deg"] = _degrees(found.sigma if found else None)
    return line


def _first(record: SurveyRecord) -> dict[str, str]:
    """Return the cells of the value as first decided, and why later surveys changed it."""
    first = record.as_first_decided
    return {
        "first_azimuth_deg": _around(first.azimuth),
        "first_sigma_azimuth_deg": _degrees(first.sigma_azimuth),
        "first_verdict": _word(first.verdict),
        "revised_because": record.revised_because,
    }


def _north(survey: Survey) -> str:
    return North(survey.north).name.lower() if survey.has_azimuth else ""


def _word(verdict: int) -> str:
    return Verdict(verdict).name.lower()


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
