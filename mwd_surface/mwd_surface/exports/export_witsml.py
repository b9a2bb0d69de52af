# SPDX-License-Identifier: Apache-2.0
"""
The definitive survey as a WITSML 1.4.1.1 trajectory.

The document is valid against the schema. In addition, every number is finite, every station's uid is unique, and
measured depth increases. Raw data follow WITSML: gravity, which points down, instead of specific force; axial is
downhole, transverse 1 and 2 are the tool's y and z. The projection to the bit is a station of type "hold to MD" (or
"DLS and toolface to MD") with a comment.
"""

from __future__ import annotations

import math
import re
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.exports.survey_table import SurveyTable, degrees
from mwd_surface.signals.cells import fixed, plain, utc
from mwd_surface.signals.units import UNITS
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.trajectory.well_path import ASSUMED

NAMESPACE = "http://www.witsml.org/schemas/1series"
_OWN = "urn:mwd:provenance"
_DEG = 180.0 / math.pi
_NAME, _COMMENT, _UID = 64, 4000, 64  # largest numbers of characters in the schema
# Elements of a station in the order of the schema; the elements between these two groups are optional.
STATION = ("md", "tvd", "incl", "azi")
PLACE = ("dispNs", "dispEw", "vertSect", "dls", "rateTurn", "rateBuild")


def witsml(table: SurveyTable) -> str:
    """
    Return the definitive survey as the text of a WITSML document (UTF-8 when encoded).

    Parameters
    ----------
    table : SurveyTable
        Survey to write. Stations that are not deeper than the previous station are omitted, and a comment says why.
    """
    # WITSML defines `incl` as the angle from the vertical.
    table = table.shown(table.display._replace(angles=AngleConvention.INCLINATION))
    well = table.surveys.well
    rows, left_out = _increasing(table)
    md = table.column("md_m")
    used = [table.records[k] for k in rows]
    stamps = [r.survey.stamp_ns for r in used if r is not None and r.survey.stamp_ns > 0]
    reference = next((r.survey for r in reversed(used) if r is not None and r.survey.has_reference), None)
    ids = (_uid(well.name), _uid(well.wellbore_name), _uid(f"{well.wellbore_name}-{table.path.leg}"))
    head = [
        _text("nameWell", well.name, _NAME),
        _text("nameWellbore", well.wellbore_name, _NAME),
        _text("name", f"definitive survey, leg {table.path.leg}", _NAME),
    ]
    if stamps:
        head += [_text("dTimTrajStart", utc(min(stamps))), _text("dTimTrajEnd", utc(max(stamps)))]
    if rows:
        uom = UNITS["m"].witsml_in(table.display.units)
        head += [_measure("mdMn", md.cell(rows[0]), uom), _measure("mdMx", md.cell(rows[-1]), uom)]
    if well.service_company:
        head.append(_text("serviceCompany", well.service_company, _NAME))
    if reference is not None:
        head += _norths(reference, ("magDeclUsed", "gridConUsed"))
    head.append(_measure("aziVertSect", fixed(table.path.section_azimuth * _DEG, 4, 360.0), "dega"))
    # A path based on an assumption is not definitive.
    head += [_text("definitive", _flag(not table.path.assumed)), _text("memory", "false"), _text("finalTraj", "false")]
    head.append(_text("aziRef", f"{well.north_reference} north"))
    seen: set[str] = set()
    stations = [_station(table, k, seen) for k in rows]
    notes = [*table.left_out, *left_out, *table.remarks, f"position uncertainty: {table.covariance_note}"]
    common = _text("dTimCreation", utc(table.made_ns)) + _text("comments", "; ".join(notes), _COMMENT)
    provenance = "".join(
        f'<provenance xmlns="{_OWN}">{escape(line)}</provenance>'
        for line in provenance_of(table.surveys, table.path.leg).lines()
    )
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<trajectorys xmlns="{NAMESPACE}" version="1.4.1.1">',
            f"<trajectory uidWell={quoteattr(ids[0])} uidWellbore={quoteattr(ids[1])} uid={quoteattr(ids[2])}>",
            *head,
            *stations,
            f"<commonData>{common}</commonData>",
            f"<customData>{provenance}</customData>",
            "</trajectory>",
            "</trajectorys>",
            "",
        ]
    )


def _increasing(table: SurveyTable) -> tuple[list[int], list[str]]:
    """Return the indices of the stations that are printed deeper than the previous one, and remarks on the others."""
    md = table.column("md_m")
    rows: list[int] = []
    why = []
    for k in table.rows:
        if rows and float(md.cell(k)) <= float(md.cell(rows[-1])):
            why.append(f"station at {md.cell(k)} {md.unit} omitted: not deeper than the previous station")
        else:
            rows.append(k)
    return rows, why


def _station(table: SurveyTable, k: int, seen: set[str]) -> str:
    record, kind = table.records[k], table.path.kind[k]
    parts = []
    if record is not None and record.survey.stamp_ns > 0:
        parts.append(_text("dTimStn", utc(record.survey.stamp_ns)))
    parts.append(_text("typeTrajStation", _type(table, record, kind)))
    parts.append(_text("calcAlgorithm", "minimum curvature"))
    numbers = {}
    for column in table.columns:
        tag, uom = column.listed.witsml, UNITS[column.signal.unit].witsml_in(table.display.units)
        numbers[tag] = _measure(tag, column.cell(k), uom)
    parts += [numbers[tag] for tag in STATION]
    # An imported station has angles only, no sensor readings.
    measured = record if record is not None and record.survey.has_readings else None
    if measured is not None:
        gravity, magnetic = measured.survey.toolfaces
        for tag, toolface in (("mtf", magnetic), ("gtf", gravity)):
            if toolface is not None:
                parts.append(_measure(tag, fixed(toolface * _DEG, 4, 360.0), "dega"))
    parts += [numbers[tag] for tag in PLACE]
    if table.surveys.well.error_model and record is not None:
        parts.append(_text("modelToolError", table.surveys.well.error_model, _COMMENT))
    if measured is not None:
        parts += _measured(measured.survey, table.surveys.well.geomagnetic_model or measured.survey.reference_source)
    parts.append(_text("statusTrajStation", "open" if table.path.assumed else "position"))
    if measured is not None:
        parts += _groups(measured, table.surveys.well.sensor_to_bit)
    if table.covariance is not None and np.all(np.isfinite(table.covariance[k])):
        parts.append(_covariance(table.covariance[k]))
    note = "; ".join(filter(None, (_note(record, kind), _assumed(table, k))))
    if note:
        parts.append(f"<commonData>{_text('comments', note, _COMMENT)}</commonData>")
    wanted = _uid(record.survey.uuid if record is not None else f"{kind}-{table.path.leg}")
    uid, n = wanted, 1
    while uid in seen:
        n += 1
        uid = f"{wanted[: _UID - 8]}-{n}"
    seen.add(uid)
    return f"<trajectoryStation uid={quoteattr(uid)}>{''.join(parts)}</trajectoryStation>"


def _type(table: SurveyTable, record: SurveyRecord | None, kind: str) -> str:
    if kind == "projected":
        return "hold to MD" if table.surveys.rules.projection == "straight" else "DLS and toolface to MD"
    if record is None:
        return "tie in point"
    if record.tool in ("gyro north seeking", "gyro MWD", "magnetic multi-shot"):
        return record.tool
    if not record.survey.has_readings:
        return "unknown"
    return "gyro MWD" if azimuth_source(record.survey).mostly_gyro else "magnetic MWD"


def _measured(s: Survey, model: str) -> list[str]:
    source = azimuth_source(s)
    parts = [_text("axialMagInterferenceCorUsed", _flag(source.axial_corrected))]
    if source.multi_station is not None:
        parts.append(_text("MSACorUsed", _flag(source.multi_station)))
    parts.append(_measure("gravTotalFieldReference", fixed(s.g_reference, 6), "m/s2"))
    if s.has_reference:
        parts.append(_measure("magTotalFieldReference", fixed(s.b_reference * 1e9, 1), "nT"))
        parts.append(_measure("magDipAngleReference", fixed(s.dip_reference * _DEG, 4), "dega"))
    if plain(model):
        parts.append(_text("magModelUsed", model, _NAME))
    return parts


def _groups(record: SurveyRecord, sensor_to_bit: float | None) -> list[str]:
    s = record.survey
    magnetic = math.isfinite(s.magnetic_field[0])
    axes = ("Axial", "Tran1", "Tran2")
    # Gravity is opposite to the specific force.
    raw = [_measure(f"grav{a}Raw", fixed(-v, 6), "m/s2") for a, v in zip(axes, s.specific_force, strict=True)]
    if magnetic:
        raw += [_measure(f"mag{a}Raw", fixed(v * 1e9, 1), "nT") for a, v in zip(axes, s.magnetic_field, strict=True)]
    used = []
    if math.isfinite(s.axial_interference):
        used.append(_measure("magAxialDrlstrCor", fixed(-s.axial_interference * 1e9, 1), "nT"))
    if s.has_reference:
        used += _norths(s, ("stnMagDeclUsed", "stnGridConUsed"))
    if sensor_to_bit is not None:
        used.append(_measure("dirSensorOffset", fixed(sensor_to_bit, 3), "m"))
    valid = []
    if math.isfinite(s.b_total):
        valid.append(_measure("magTotalFieldCalc", fixed(s.b_total * 1e9, 1), "nT"))
        valid.append(_measure("magDipAngleCalc", fixed(s.dip * _DEG, 4), "dega"))
    valid.append(_measure("gravTotalFieldCalc", fixed(s.g_total, 6), "m/s2"))
    groups = (("rawData", raw), ("corUsed", used), ("valid", valid))
    return [f"<{tag}>{''.join(parts)}</{tag}>" for tag, parts in groups]


def _norths(s: Survey, tags: tuple[str, str]) -> list[str]:
    """Return declination and convergence of a survey as elements with these tags; unknown angles are omitted."""
    pairs = zip(tags, (s.declination, s.convergence), strict=True)
    return [_measure(tag, degrees(angle, 4), "dega") for tag, angle in pairs if math.isfinite(angle)]


def _covariance(cov: Any) -> str:
    pairs = (
        ("varianceNN", 0, 0),
        ("varianceNE", 0, 1),
        ("varianceNVert", 0, 2),
        ("varianceEE", 1, 1),
        ("varianceEVert", 1, 2),
        ("varianceVertVert", 2, 2),
    )
    return f"<matrixCov>{''.join(_measure(tag, fixed(float(cov[i, j]), 6), 'm2') for tag, i, j in pairs)}</matrixCov>"


def _note(record: SurveyRecord | None, kind: str) -> str:
    if kind == "projected":
        return "projected to the bit, not surveyed"
    if record is None:
        return ""
    s, made_of = record.survey, azimuth_source(record.survey).words
    names = ("inclination", "azimuth", "toolface")
    each = ", ".join(f"{name} {word}" for name, word in zip(names, s.verdicts, strict=True))
    notes = [
        f"automatic verdict {Verdict(s.verdict).word} ({each})",
        *([f"azimuth: {made_of}"] if made_of else []),
        *([s.action] if s.action else []),
        *record.flags,
    ]
    if record.operator_name:
        notes.append(f"judged by {record.operator_name}: {record.reason or 'no reason given'}")
    if record.comment:
        notes.append(record.comment)
    return "; ".join(notes)


def _assumed(table: SurveyTable, k: int) -> str:
    """
    Return a note if the position of a station without a survey depends on an assumption; otherwise "".

    At a station with a survey, the flags of the survey contain this note already.
    """
    if table.path.kind[k] == ASSUMED:
        return "assumed, not surveyed"
    return "coordinates assumed" if table.path.assumed and table.records[k] is None else ""


def _text(tag: str, text: str, longest: int = 256) -> str:
    return f"<{tag}>{escape(plain(text)[:longest].strip() or 'unknown')}</{tag}>"


def _flag(value: bool) -> str:
    return "true" if value else "false"


def _measure(tag: str, number: str, uom: str) -> str:
    """Return an element with a number and its unit; an empty text if the number is unknown (empty)."""
    return f'<{tag} uom="{uom}">{number}</{tag}>' if number else ""


def _uid(text: str) -> str:
    return re.sub(r"\s+", "_", plain(text))[:_UID] or "unnamed"
