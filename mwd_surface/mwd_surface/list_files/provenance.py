# SPDX-License-Identifier: Apache-2.0
"""
Data of the original list in an export of this program: well, tie-on, reference and remarks, as lines next to the table.

Every export contains these lines, and the list reader reads them, so that an exported list has the same position and
the same assumptions as the original list. Each line is "mwd", the name of the part, a colon and JSON.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable
from typing import Any

from mwd_sensors.core import settings
from mwd_sensors.core.input_files import load_json
from mwd_surface.list_files.list_columns import FIGURES
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.station_list import Start

_MARK, _REMARK = "mwd ", "remark"
# A spreadsheet that saves the file again may put quotes and a comment sign in front of a line.
_LINE = re.compile(r'^[\s"#]*mwd (?P<part>well|start|reference|remark): ?(?P<json>.*)$', re.DOTALL)


@dataclasses.dataclass(frozen=True)
class Provenance:
    """Data of the list from which this program made an export."""

    well: dict[str, Any]  #: settings of the well by name, see `surveys.well.Well`
    #: point where the path starts; azimuth from the north of the well. Remarks on the start are in `remarks`.
    start: Start
    #: reference values of the last survey in use, by the names of `list_columns.FIGURES`: T, m/s^2, rad
    reference: dict[str, float]
    remarks: tuple[Remark, ...] = ()  #: every assumption behind the list

    def __post_init__(self) -> None:
        """Raise ValueError for a reference value whose name is unknown."""
        if strange := set(self.reference) - set(FIGURES):
            raise ValueError(f"reference: unknown {', '.join(sorted(strange))}")

    @property
    def confirmed(self) -> frozenset[str]:
        """Words of `list_columns.CONFIRMABLE` that the caller confirmed when the original list was read."""
        return frozenset(word for one in self.remarks if one.kind == RemarkKind.CONFIRMED for word in one.values)

    def lines(self) -> list[str]:
        """Return the lines to write next to the table of stations."""
        table = settings.to_mapping(self)
        parts = [(name, table[name]) for name in ("well", "start", "reference")]
        parts += [(_REMARK, one) for one in table["remarks"]]
        return [f"{_MARK}{part}: {json.dumps(value, separators=(',', ':'))}" for part, value in parts]


def read_provenance(head: Iterable[str], name: str) -> tuple[Provenance | None, list[str]]:
    """
    Return the data of the original list from the lines of a table's head, and the other lines.

    The data are None if this program did not export the table.

    name: name of the file, for messages.

    Raises
    ------
    ListFileError
        A line was changed and cannot be read.
    """
    table: dict[str, Any] = {"remarks": []}
    others = []
    for line in head:
        found = _LINE.match(line)
        if found is None:
            others.append(line)
            continue
        try:
            value = load_json(found["json"])
        except ValueError as error:
            raise ListFileError(_changed(name, found["part"], error)) from error
        if found["part"] == _REMARK:
            table["remarks"].append(value)
        else:
            table[found["part"]] = value
    if len(table) == 1 and not table["remarks"]:
        return None, others
    try:
        made = settings.from_mapping(Provenance, table)
    except ValueError as error:
        raise ListFileError(_changed(name, "...", error)) from error
    return made, others


def _changed(name: str, part: str, error: Exception) -> str:
    return (
        f"{name}: the line '{_MARK}{part}' cannot be read, probably because it was changed after `mwd export`:"
        f" {error}; export the list again, or delete all lines that begin with '{_MARK.strip()}' and read the table"
        " alone"
    )
