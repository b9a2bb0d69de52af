# SPDX-License-Identifier: Apache-2.0
"""The table of the first trajectory in a WITSML document (1.3.1.1, 1.4.1.1, 2.0 or 2.1), found by element names."""

from __future__ import annotations

from typing import Any

from mwd_surface.list_files.grid_file import Row, xml_root
from mwd_surface.list_files.list_columns import (
    ANGLE_UNITS,
    ANGLES,
    ENERGISTICS_ANGLES,
    ENERGISTICS_UNITS,
    LENGTH_UNITS,
    unit_word,
)
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import Cell, is_null
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.table import Table

# Quantity -> element name in lower case; the name begins with a small letter in versions 1.x, with a capital in 2.x.
_TAGS = {"md": "md", "inclination": "incl", "azimuth": "azi", "tvd": "tvd", "north": "dispns", "east": "dispew"}
_PROJECTIONS = ("hold to md", "dls and toolface to md", "extrapolated")


def witsml_table(text: str, name: str) -> Table:
    """
    Return the stations of the first trajectory in a document, in m and rad.

    Raises
    ------
    ListFileError
        The document is not XML, has no trajectory, a station without md or incl, or an unknown unit.
    """
    root = xml_root(text, name)
    trajectories = [one for one in root.iter() if _tag(one) == "trajectory" and _children(one, "trajectorystation")]
    if not trajectories:
        empty = any(_tag(one) == "trajectory" for one in root.iter())
        what = "a WITSML trajectory without stations" if empty else "no trajectory of WITSML 1.3, 1.4, 2.0 or 2.1 in it"
        raise ListFileError(f"{name}, line {root.sourceline}: {what}")
    trajectory = trajectories[0]
    remarks = []
    if len(trajectories) > 1:
        said = f"{name}: the first of {len(trajectories)} trajectories is read"
        remarks.append(Remark(RemarkKind.COLUMN_CHOSEN, said, {"trajectories": float(len(trajectories))}))
    reference = _text(trajectory, "aziref")
    rows, projected = [], 0
    for station in _children(trajectory, "trajectorystation"):
        kind = _text(station, "typetrajstation")
        # A projection to the bit is not a station.
        if kind.lower() in _PROJECTIONS:
            projected += 1
            continue
        at = f"{name}, line {int(station.sourceline or 0)}"
        cells = [_measure(station, what, tag, at) for what, tag in _TAGS.items()]
        tool = _text(station, "typesurveytool") or kind
        row = "tie-on" if kind.lower() == "tie in point" else ""
        rows.append(Row(at, (*cells, tool, _text(station, "dtimstn"), row, _text(station, "statustrajstation"))))
    # The order of the elements of a document has no meaning.
    rows.sort(key=lambda row: float(row.cells[0] or 0.0))
    if projected:
        said = f"{name}: {projected} projections to the bit are left out"
        remarks.append(Remark(RemarkKind.ROWS_LEFT_OUT, said, {"rows": float(projected)}))
    names = (*_TAGS, "tool", "time", "station", "verdict")
    units = ("m", "rad", "rad", "m", "m", "m", "", "", "", "")
    title = _text(trajectory, "name") or _text(trajectory, "title") or name
    head = [f"azimuth reference: {reference}"] if reference else []
    for custom in _children(trajectory, "customdata"):
        # Exports of this program store the provenance of their list in this element.
        head += [str(one.text or "") for one in custom if _tag(one) == "provenance"]
    return Table(title, name, names, units, tuple(rows), tuple(head), tuple(remarks))


def _tag(element: Any) -> str:
    """Return the name of an element in lower case, without its namespace; empty for comments."""
    return str(element.tag).rpartition("}")[2].lower() if isinstance(element.tag, str) else ""


def _children(element: Any, tag: str) -> list[Any]:
    return [child for child in element if _tag(child) == tag]


def _text(element: Any, tag: str) -> str:
    """
    Return the text of the first element of this name inside an element; "" if there is none.

    In a trajectory only the elements before its first station are searched.
    """
    for child in element.iter():
        if child is not element and _tag(child) == tag:
            return " ".join("".join(child.itertext()).split())
        if child is not element and _tag(child) == "trajectorystation" and _tag(element) == "trajectory":
            break
    return ""


def _measure(station: Any, what: str, tag: str, at: str) -> Cell:
    """
    Return a measure of a station in m or rad; empty text if the station has none.

    Raises ListFileError if md or inclination is missing, or if a number or unit is not valid.
    """
    found = _children(station, tag)
    if not found:
        if what in ("md", "inclination"):
            raise ListFileError(f"{at}: a station without {tag}")
        return ""
    # Version 2.1 wraps depths in an element that names their datum.
    element = next((one for one in found[0].iter() if (one.text or "").strip()), found[0])
    text = (element.text or "").strip()
    if is_null(text):
        if text.lower() in ("nan", "inf", "-inf") or not text:
            raise ListFileError(f"{at}: {tag}: expected a finite number, got {text!r}")
        return ""
    uom = element.get("uom") or found[0].get("uom") or ""
    factor = _factor(uom, angle=what in ANGLES)
    if factor is None:
        usual = ("dega", "rad", "gon") if what in ANGLES else ("m", "km", "ft", "ftUS", "in")
        raise ListFileError(
            f"{at}: {what} in {uom!r}, which is not a unit that is understood here; expected {', '.join(usual)} ...,"
            " as in the Energistics unit dictionary"
        )
    try:
        return float(text) * factor
    except ValueError:
        raise ListFileError(f"{at}: {tag}: expected a finite number, got {text!r}") from None


def _factor(uom: str, *, angle: bool) -> float | None:
    """Return the factor of a unit to m or rad; None if it is not a unit of the quantity."""
    if uom.strip() in ENERGISTICS_UNITS:
        return ENERGISTICS_UNITS[uom.strip()] if (uom.strip() in ENERGISTICS_ANGLES) == angle else None
    return (ANGLE_UNITS if angle else LENGTH_UNITS).get(unit_word(uom))
