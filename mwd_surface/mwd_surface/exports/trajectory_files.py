# SPDX-License-Identifier: Apache-2.0
"""High-density trajectory as CSV and as LAS 2.0; it is never part of the files of the definitive list."""

from __future__ import annotations

import io

import numpy as np

from mwd_surface.list_files.remark import sentences
from mwd_surface.logs.log_files import as_value
from mwd_surface.signals.cells import table
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.dense_trajectory import ARC, CONTINUOUS, SLIDES, STATION, DenseTrajectory
from mwd_surface.trajectory.well_path import Definitive

# Name in the CSV, mnemonic and unit in the LAS file, decimals.
_COLUMNS = (
    ("md_m", "DEPT", "M", 3),
    ("inclination_deg", "INC", "DEG", 4),
    ("azimuth_deg", "AZI", "DEG", 4),
    ("tvd_m", "TVD", "M", 3),
    ("north_m", "NS", "M", 3),
    ("east_m", "EW", "M", 3),
    ("tvd_minus_minimum_curvature_m", "DTVD", "M", 3),
    ("north_minus_minimum_curvature_m", "DNS", "M", 3),
    ("east_minus_minimum_curvature_m", "DEW", "M", 3),
)
_SOURCES = (STATION, CONTINUOUS, SLIDES, ARC)
_NOTE = "HIGH-DENSITY TRAJECTORY, NOT THE DEFINITIVE SURVEY"


def trajectory_csv(found: DenseTrajectory, path: Definitive) -> str:
    """
    Return the trajectory as text, one line per point.

    path: path of the stations; the column `coordinates` is "assumed" if the path is based on an assumption.
    """
    same = {"azimuth_reference": path.north.name.lower(), "coordinates": "assumed" if path.assumed else ""}
    lines = []
    for row, source in zip(_values(found), found.source, strict=True):
        cells = {name: f"{value:.{decimals}f}" for value, (name, *_, decimals) in zip(row, _COLUMNS, strict=True)}
        lines.append(cells | same | {"source": source})
    return table((*(name for name, *_ in _COLUMNS), "azimuth_reference", "source", "coordinates"), lines)


def trajectory_las(found: DenseTrajectory, surveys: SurveyList) -> str:
    """
    Return the trajectory as the text of a LAS 2.0 file.

    Curve SRC is the source of a point: 0 station, 1 continuous, 2 slide sheet, 3 arc.

    surveys: list of the stations, with its well and remarks.
    """
    import lasio

    file = lasio.LASFile()
    well, provenance = surveys.well, provenance_of(surveys)
    for k, remark in enumerate(sentences(provenance.remarks), start=1):
        file.params.append(lasio.HeaderItem(f"A{k:02d}", value=as_value(remark), descr="REMARK"))
    file.other = "\n".join(provenance.lines())
    file.well["WELL"] = lasio.HeaderItem("WELL", value=well.name or "unnamed", descr="WELL")
    file.params.append(lasio.HeaderItem("KIND", value=_NOTE, descr="CONTENT"))
    file.params.append(lasio.HeaderItem("AZREF", value=well.north_reference, descr="NORTH OF AZIMUTHS AND AXES"))
    values = _values(found)
    for k, (name, mnemonic, unit, _) in enumerate(_COLUMNS):
        file.append_curve(mnemonic, values[:, k], unit=unit, descr=name)
    file.append_curve("SRC", np.array([float(_SOURCES.index(source)) for source in found.source]), descr=str(_SOURCES))
    formats = {k: f"%.{column[3]}f" for k, column in enumerate(_COLUMNS)} | {len(_COLUMNS): "%.0f"}
    text = io.StringIO()
    file.write(text, version=2.0, column_fmt=formats, STEP=0.0)
    return text.getvalue()


def _values(found: DenseTrajectory) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the columns of `_COLUMNS`, one row per point, rounded, without negative zeros and an azimuth of 360."""
    north, east, down = found.positions.T
    d_north, d_east, d_down = found.differences.T
    angles = np.degrees(found.inclination), np.degrees(found.azimuth)
    whole = np.column_stack([found.md, *angles, down, north, east, d_down, d_north, d_east])
    for k, column in enumerate(_COLUMNS):
        whole[:, k] = np.round(whole[:, k], column[3]) + 0.0
    whole[:, 2] = np.where(whole[:, 2] >= 360.0, 0.0, whole[:, 2])
    return whole


def largest_difference(found: DenseTrajectory) -> tuple[float, float, float]:
    """
    Return the largest and the last difference of vertical depth from minimum curvature.

    The result is: measured depth of the largest difference, the largest difference, and the difference at the end, m.
    """
    apart = found.differences[:, 2]
    worst = int(np.argmax(np.abs(apart)))
    return float(found.md[worst]), float(apart[worst]), float(apart[-1])


def summary(found: DenseTrajectory) -> str:
    """Return a sentence on the sources of the trajectory, and on its differences from minimum curvature."""
    between = [source for source in found.source if source != STATION]
    shares = [
        f"{100.0 * between.count(kind) / len(between):.0f} % {kind}"
        for kind in (CONTINUOUS, SLIDES, ARC)
        if kind in between
    ]
    if not shares:
        return "no interval between stations"
    at, worst, last = largest_difference(found)
    return (
        f"{', '.join(shares)}; vertical depth minus minimum curvature: {last:+.2f} m at {found.md[-1]:.1f} m,"
        f" at most {worst:+.2f} m at {at:.1f} m"
    )
