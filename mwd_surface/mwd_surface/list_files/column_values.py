# SPDX-License-Identifier: Apache-2.0
"""
Conversion of the columns of a list to values in SI units.

The decimal mark of a column is found from its cells, else from the other columns, else from the range of the quantity;
its unit from its name, else from its cells, the head of the list, or the other columns. What the caller states replaces
what the file states. If none of these decides, `ListFileError` says what the caller has to state. Every assumption
becomes a remark.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.list_files import list_columns, number_cells
from mwd_surface.list_files.grid_file import Row
from mwd_surface.list_files.list_columns import ANGLES, FIGURES, Given, ListColumn
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_head import Head
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.table import Table

LOCAL = ("north", "east")  #: quantities of offsets from the wellhead
MAP = ("map_north", "map_east")  #: quantities of map coordinates
_GERMAN = re.compile("neigung|richtung|teufe|tiefe|bohrloch|inklination", re.IGNORECASE)


class ColumnValues:
    """
    Reader of the numbers of one list.

    Parameters
    ----------
    table, head, given
        Table and head of the file, and the statements of the caller (`given`).
    rows
        Rows of the table that may be stations.
    of
        Columns of the list by quantity.
    remarks
        Remarks of the list; assumptions are added to it.
    """

    def __init__(
        self,
        table: Table,
        rows: Sequence[Row],
        of: Mapping[str, Sequence[ListColumn]],
        head: Head,
        given: Given,
        remarks: list[Remark],
    ) -> None:
        self.table, self.rows, self.of, self.head, self.given, self.remarks = table, rows, of, head, given, remarks
        self.name = table.name
        self.german = any(_GERMAN.search(name) for name in table.names)

    def _say(self, kind: RemarkKind, text: str) -> None:
        self.remarks.append(Remark(kind, text))

    def cells(self, column: ListColumn) -> list[number_cells.Cell]:
        """Return the cells of a column, one for each row; "" if the row is too short."""
        return [row.cells[column.number] if column.number < len(row.cells) else "" for row in self.rows]

    def si(self, column: ListColumn, *, needed: bool = False) -> Array:
        """
        Return the numbers of a column in m or rad, shape (n,); nan for an empty cell or a null value.

        Raises ListFileError for a cell that is not a number, for a row without a cell of a needed column, if a length
        has no unit, and if a unit or the decimal mark is not clear.
        """
        return self._numbers(column, needed=needed) * self._factor(column)

    def _mark(self, column: ListColumn) -> str:
        """
        Return the decimal mark of a column, from its cells, the other columns, and the range of the quantity.

        The mark is "" if no cell needs one. Raises ListFileError if the marks contradict each other or remain unclear.
        """
        if self.given.decimal:
            return {"point": ".", "comma": ","}[self.given.decimal]
        cells = self.cells(column)
        own = number_cells.marks(cells)
        if len(own) > 1:
            pair = [next(c for c in cells if number_cells.marks([c]) == {mark}) for mark in sorted(own)]
            raise ListFileError(
                f"{self.table.at}: column {column.name!r} has numbers with a decimal comma and with a decimal point,"
                f" such as {pair[0]!r} and {pair[1]!r}; set the decimal mark with --decimal point or comma"
            )
        if own:
            return own.pop()
        unclear = number_cells.ambiguous(cells)
        if not unclear:
            return ""
        return self._decided(column, unclear)

    def _decided(self, column: ListColumn, unclear: Sequence[str]) -> str:
        """
        Return the decimal mark of a column whose numbers, such as 1,000, allow both readings.

        Raises ListFileError if nothing in the list decides.
        """
        mark = "," if "," in unclear[0] else "."
        other = "." if mark == "," else ","
        if column.quantity in ANGLES:
            # The mark does not separate thousands, because an angle has less than a thousand degrees.
            return mark
        shown: set[str] = set()
        for found in self.of.values():
            for one in found:
                cells = self.cells(one)
                shown |= number_cells.marks(cells)
                if one.quantity in ANGLES:
                    shown |= {"," if "," in text else "." for text in number_cells.ambiguous(cells)}
        if len(shown) == 1:
            return shown.pop()
        if column.quantity == "md":
            rising = [m for m in (mark, other) if self._rises(column, m)]
            if len(rising) == 1:
                return rising[0]
        if mark == ".":
            plain = [c for c in self.cells(column) if not number_cells.is_null(c) and c not in unclear]
            if plain and column.quantity == "md":
                self._say(
                    RemarkKind.NUMBERS_ASSUMED,
                    f"{self.name}: {unclear[0]!r} in column {column.name!r} is read with a decimal point",
                )
            return "."
        raise ListFileError(
            f"{self.table.at}: {unclear[0]!r} in column {column.name!r} may be"
            f" {number_cells.value(unclear[0], mark):g} or {number_cells.value(unclear[0], other):g}, and nothing in"
            " the list decides; set the decimal mark with --decimal point or --decimal comma"
        )

    def _rises(self, column: ListColumn, mark: str) -> bool:
        values = []
        for cell in self.cells(column):
            found = None if number_cells.is_null(cell) else number_cells.split(cell)
            if found is not None:
                try:
                    values.append(number_cells.value(found[0], mark))
                except ValueError:
                    return False
        return bool(np.all(np.diff(values) >= 0.0))

    def _numbers(self, column: ListColumn, *, needed: bool) -> Array:
        """Return the numbers of a column as written, shape (n,); otherwise as `si`."""
        mark = self._mark(column)
        numbers = np.full(len(self.rows), math.nan)
        for k, (row, cell) in enumerate(zip(self.rows, self.cells(column), strict=True)):
            if column.number >= len(row.cells) and needed:
                raise ListFileError(
                    f"{row.at}: {len(row.cells)} fields, the header names {column.quantity} as number"
                    f" {column.number + 1}"
                )
            if number_cells.is_null(cell):
                continue
            numbers[k] = self._number(cell, mark, column, row.at)
        return numbers

    def _number(self, cell: number_cells.Cell, mark: str, column: ListColumn, at: str) -> float:
        if column.quantity in ANGLES:
            angle = number_cells.angle(str(cell), bearing=column.quantity == "azimuth")
            if math.isfinite(angle):
                # Degrees with minutes, and quadrant bearings, are in degrees, whatever unit the column states.
                return angle * list_columns.ANGLE_UNITS["deg"] / self._factor(column)
        number, words = number_cells.split(cell) or ("", "")
        try:
            value = number_cells.value(number, mark or number_cells.decimal_mark(number))
        except ValueError:
            value = math.nan
        if words.lower() in ("s", "w"):
            value = -value
        if not math.isfinite(value) or (words and not self._unit_in_cell(words, column)):
            shown = str(cell) if len(str(cell)) < 60 else f"{str(cell)[:57]}..."
            raise ListFileError(f"{at}: {column.quantity}: expected a finite number, got {shown!r}")
        return value

    def _unit_in_cell(self, words: str, column: ListColumn) -> bool:
        """Return whether the words after a number are the unit of its column, or a compass direction."""
        if column.quantity in (*LOCAL, *MAP) and words.lower() in ("n", "s", "e", "w"):
            return True
        unit = list_columns.unit_word(words)
        known = list_columns.ANGLE_UNITS if column.quantity in ANGLES else list_columns.LENGTH_UNITS
        if unit not in known:
            return False
        stated = column.unit or ("deg" if column.quantity in ANGLES else self.head.length_unit)
        return not stated or known.get(stated) == known[unit]

    def _factor(self, column: ListColumn) -> float:
        """
        Return the factor to SI units; if the column states no unit, the unit in its cells or in the head is used.

        Raises ListFileError if a length has no unit, or if a unit is not recognised.
        """
        otherwise = ""
        if not (column.unit or column.strange or column.quantity in FIGURES or self._given_unit(column)):
            angle = column.quantity in ANGLES
            otherwise = self.cell_unit(column) or (self.head.angle_unit if angle else self._length_unit(column))
        if self.german and (column.unit or otherwise) == "grad" and not self.given.angle_unit:
            # The German word Grad means degrees; elsewhere grads are 400 to the circle.
            column = dataclasses.replace(column, unit="deg")
            text = f"{self.name}: 'Grad' in a list with German names is read as degrees; --angle-unit sets another unit"
            self._say(RemarkKind.UNIT_ASSUMED, text)
        given = (
            self.given if self._given_unit(column) else dataclasses.replace(self.given, length_unit="", angle_unit="")
        )
        factor = list_columns.factor(column, self.table.at, given, otherwise)
        known = {**list_columns.LENGTH_UNITS, **list_columns.ANGLE_UNITS}
        if column.unit and self._given_unit(column) and known[column.unit] != factor:
            text = (
                f"{self.name}: column {column.name!r} states {column.unit!r}; {self._given_unit(column)} is used, as"
                " set by the user"
            )
            self._say(RemarkKind.OVERRIDDEN, text)
        if column.strange and column.unit:
            text = f"{self.name}: {column.strange!r} in the name of column {column.name!r} was not recognised"
            self._say(RemarkKind.COLUMN_NOT_READ, text)
        return factor

    def _given_unit(self, column: ListColumn) -> str:
        """Return the unit that the caller states; "" for coordinates whose unit the head states."""
        if column.quantity in ANGLES:
            return self.given.angle_unit
        return "" if column.quantity in (*LOCAL, *MAP) and self.head.map_unit else self.given.length_unit

    def cell_unit(self, column: ListColumn) -> str:
        """Return the unit that the first cell with a unit states; "" if none does."""
        for cell in self.cells(column):
            found = None if number_cells.is_null(cell) else number_cells.split(cell)
            if found is not None and found[1]:
                return list_columns.unit_word(found[1])
        return ""

    def _length_unit(self, column: ListColumn) -> str:
        """
        Return the unit for a column of lengths whose name and cells have no unit.

        The unit comes from, in this order: the head, the other lengths of the list, the elevation of the datum or the
        coordinates in the head. The result is "" if none of these has a unit. Raises ListFileError if the head states
        a unit that is not recognised.
        """
        if self.head.strange_unit:
            raise ListFileError(
                f"{self.name}: the head gives depths in {self.head.strange_unit!r}, which was not recognised; set"
                " the unit with --length-unit"
            )
        mapped = column.quantity in (*LOCAL, *MAP)
        if mapped and self.head.map_unit:
            return self.head.map_unit
        if self.head.length_unit:
            return self.head.length_unit
        said = {one.unit for found in self.of.values() for one in found if one.unit in list_columns.LENGTH_UNITS}
        if len({list_columns.LENGTH_UNITS[unit] for unit in said}) == 1:
            unit = said.pop()
            self._assumed_unit(unit, "like the other lengths of the list")
            return unit
        hint = self.head.hinted_unit or self.head.map_unit
        if hint:
            what = "the elevation of the depth datum" if self.head.hinted_unit else "the coordinates"
            self._assumed_unit(hint, f"like {what} in its head")
        return hint

    def _assumed_unit(self, unit: str, why: str) -> None:
        text = f"{self.name}: a length without unit is read in {unit}, {why}"
        self._say(RemarkKind.UNIT_ASSUMED, text)
