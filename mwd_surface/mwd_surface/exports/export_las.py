# SPDX-License-Identifier: Apache-2.0
"""
The definitive survey as a LAS 2.0 file: measured depth as index, null -999.25.

The file has the same printed numbers as every other export; columns without any known value are omitted.
"""

from __future__ import annotations

import datetime as dt
import io

import numpy as np

from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.arrays import Array
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.list_files.remark import sentences
from mwd_surface.logs.log_files import as_value, las_of
from mwd_surface.surveys.azimuth_source import AzimuthSource, azimuth_source
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED, SURVEY, TIE_ON

# Number of each verdict in the Survey message, by its word.
_VERDICTS = {verdict.word: int(verdict) for verdict in Verdict}
_VERDICT_WORDS = ", ".join(f"{number} {word}" for word, number in _VERDICTS.items())


def las(table: SurveyTable) -> str:
    """
    Return the definitive survey as the text of a LAS file (UTF-8 when encoded).

    VINC, VAZI and VTF are the automatic verdicts of inclination, azimuth and toolface; GYSH and AXCO give the
    composition of the azimuth. KIND is the kind of station: 0 tie-on, 1 survey, 2 projected to the bit, 3 assumed
    tie-on, because none was given. The last curve, ASMD, is 1 if depths and positions are based on an assumption.
    """
    from lasio import HeaderItem

    file = las_of(table.surveys.well)
    moment = dt.datetime.fromtimestamp(table.made_ns // 10**9, tz=dt.UTC)
    file.well["DATE"] = HeaderItem("DATE", value=f"{moment:%Y-%m-%d}", descr="DATE OF THE FILE, UTC")
    for k, (label, value) in enumerate(table.header, start=1):
        file.params.append(HeaderItem(f"H{k:02d}", value=as_value(value), descr=as_value(label)))
    for k, why in enumerate(table.left_out, start=1):
        file.params.append(HeaderItem(f"X{k:02d}", value=as_value(why), descr="LEFT OUT"))
    assumptions = sentences(table.path.assumptions)
    for k, remark in enumerate(table.remarks, start=1):
        # A remark about assumed stations, which have 1 in the curve ASMD, gets the description ASSUMED.
        descr = "ASSUMED" if remark in assumptions else "REMARK"
        file.params.append(HeaderItem(f"A{k:02d}", value=as_value(remark), descr=descr))
    file.other = "\n".join(provenance_of(table.surveys, table.path.leg).lines())
    formats: dict[int, str] = {}
    for column in table.columns:
        if all(v is None for v in column.values):
            continue
        printed = [column.cell(k) for k in table.rows]
        formats[len(formats)] = f"%.{column.listed.decimals}f"
        data = np.array([float(p) if p else np.nan for p in printed])
        unit = column.unit.replace(" ", "").upper()
        file.append_curve(column.listed.las, data, unit=unit, descr=column.listed.title.replace("σ", "sigma"))
    for place, (mnemonic, what) in enumerate((("VINC", "inclination"), ("VAZI", "azimuth"), ("VTF", "toolface"))):
        given = [r.survey.verdicts[place] if r is not None else "" for r in table.records]
        formats[len(formats)] = "%.0f"
        data = np.array([float(_VERDICTS[word]) if word else np.nan for word in given])
        file.append_curve(mnemonic, data, descr=f"verdict {what}, {_VERDICT_WORDS}")
    for mnemonic, decimals, descr, data in _azimuth_sources(table):
        formats[len(formats)] = f"%.{decimals}f"
        file.append_curve(mnemonic, data, descr=descr)
    kinds = {TIE_ON: 0.0, SURVEY: 1.0, PROJECTED: 2.0, ASSUMED: 3.0}
    words = ", ".join(f"{number:.0f} {kind}" for kind, number in kinds.items())
    formats[len(formats)] = "%.0f"
    file.append_curve("KIND", np.array([kinds[k] for k in table.path.kind]), descr=words)
    formats[len(formats)] = "%.0f"
    flag = np.full(len(table.records), float(table.path.assumed))
    file.append_curve("ASMD", flag, descr="depths and positions, 0 measured, 1 assumed")
    text = io.StringIO()
    depth = table.column("md_m")
    # A step of 0 means in LAS that the depths are unevenly spaced.
    file.write(
        text,
        version=2.0,
        column_fmt=formats,
        STRT=float(depth.cell(0)),
        STOP=float(depth.cell(len(table.records) - 1)),
        STEP=0.0,
        header_width=40,
    )
    return text.getvalue()


def _azimuth_sources(table: SurveyTable) -> list[tuple[str, int, str, Array]]:
    """Return the curves of the azimuths' composition: mnemonic, decimals, description, values (n,), NaN if unknown."""
    sources = [AzimuthSource(known=False) if r is None else azimuth_source(r.survey) for r in table.records]
    known = np.array([one.known for one in sources], dtype=bool)
    shares = np.array([one.gyro_share for one in sources])
    axial = np.array([float(one.axial_corrected) for one in sources])
    return [
        ("GYSH", 3, "share of the gyro in the azimuth, 0 to 1", np.where(known, shares, np.nan)),
        ("AXCO", 0, "axial interference corrected, 0 no, 1 yes", np.where(known, axial, np.nan)),
    ]
