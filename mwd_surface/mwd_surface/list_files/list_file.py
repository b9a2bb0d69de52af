# SPDX-License-Identifier: Apache-2.0
"""
Reading a list of stations from a table, a spreadsheet, LAS, WITSML or P7/17, recognised by the content of the file.

Survey lists, gyro surveys, planned paths and offset wells are all read here, by the same rules. A file that breaks a
rule raises `ListFileError` with the line at fault and the expected content; a list is never read in part. Every
assumption becomes a remark of the list.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.list_files import list_columns, number_cells
from mwd_surface.list_files.column_values import LOCAL, MAP, ColumnValues
from mwd_surface.list_files.exchange_formats import is_las, is_p7, las_table, p7_table, witsml_table
from mwd_surface.list_files.grid_file import is_html, is_spreadsheet, is_spreadsheet_xml
from mwd_surface.list_files.list_checks import (
    check_depths,
    check_doglegs,
    check_exchange,
    check_positions,
    fits,
    turn_between,
)
from mwd_surface.list_files.list_columns import (
    ANGLES,
    FIGURES,
    NEEDED,
    NORTHS,
    TEXTS,
    Given,
    ListColumn,
    ListColumns,
    points,
)
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_head import Head, read_head
from mwd_surface.list_files.list_rows import QUOTED, refuse_surplus_numbers, station_rows
from mwd_surface.list_files.map_coordinates import offsets_from_wellhead
from mwd_surface.list_files.moments import dated
from mwd_surface.list_files.provenance import Provenance, read_provenance
from mwd_surface.list_files.remark import Remark, RemarkKind, distinct
from mwd_surface.list_files.station_list import WITHOUT_POSITION, Start, StationList, carried
from mwd_surface.list_files.table import Table, read_bytes, table_of, text_of

# Values of the column "station" in exports of this program, for rows that are not surveys
_START_ROWS = ("tie-on", "assumed")
# Words of columns that say whether a station may be used; an empty cell says nothing.
_USABLE = number_cells.words_of(
    "accept|accepted|ok|okay|good|pass|passed|yes|y|true|valid|used|in use|approved|definitive|final|open|position|"
    "reject|survey|"
)
_DOUBTFUL = number_cells.words_of("doubtful|suspect|suspicious|questionable|poor")
_UNUSABLE = number_cells.words_of(
    "rejected|bad|fail|failed|no|n|false|invalid|unused|not used|do not use|not accepted|excluded|omitted|not ok|nok"
)
_UPWARDS = 3  # smallest number of stations in a list that may be written from the bottom up
_NUMBERED = {"1": "yes", "0": "no"}  # for columns such as "use"; in a quality flag, 1 and 0 have no usual meaning
# Distance between wellhead and first station at which a convergence of 3 deg moves the station by half a metre, m.
_OFFSET = 10.0
# First bytes of recordings, which are not lists.
_OTHERS = (b"\x89MCAP0", b"SQLite format 3\x00", b"#ROSBAG")


@dataclasses.dataclass(frozen=True)
class _ListedStation:
    """One station of the file: its place, its numbers in m and rad, and its texts."""

    at: str
    numbers: dict[str, float]
    texts: dict[str, str]


def _verdict(row: _ListedStation) -> str:
    """Return the verdict of a station; "accept" if an export of this program marks the station as in use."""
    if row.texts.get("in_use", "").lower() == "yes" or row.texts.get("station") in (*_START_ROWS, "survey"):
        return "accept"
    word = row.texts.get("verdict", "").lower()
    return "doubtful" if word in _DOUBTFUL else word if word in ("", "reject") else "accept"


def is_list(path: Path) -> bool:
    """Return whether a file may be a list of stations: not a recording, and not a survey list of this program."""
    if not path.is_file() or path.suffix == ".json":
        return False
    with path.open("rb") as file:
        start = file.read(64)
    return not start.startswith(_OTHERS) and not start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def read_list(path: str | Path, given: Given | None = None) -> StationList:
    """
    Return the stations of a file, recognised by its content as WITSML, LAS, P7/17, a spreadsheet or a table.

    Raises
    ------
    ListFileError
        The file is missing, unreadable, too large, or not a list of stations; see the module.
    """
    path = Path(path)
    return list_of(read_bytes(path), path.name, given)


def list_of(data: bytes, name: str = "list", given: Given | None = None) -> StationList:
    """Return the stations in the bytes of a file; name: name of the list in messages. Errors as `read_list`."""
    given = given or Given()
    return _stations(_table(data, name, given), given)


def _table(data: bytes, name: str, given: Given) -> Table:
    """Return the table in a file, whose kind is recognised by its content; errors as `read_list`."""
    if not is_spreadsheet(data):
        text = text_of(data, name)
        start = text.lstrip("\ufeff \t\r\n")
        if start.startswith("<") and not (is_html(text) or is_spreadsheet_xml(text)):
            if given.length_unit or given.angle_unit:
                raise ListFileError(f"{name}: a WITSML document names the unit of each number; leave the unit out")
            return witsml_table(text, name)
        if is_las(start):
            return las_table(text, name)
        if is_p7(start):
            return p7_table(text, name)
        if re.search(r"\bP7/2000\b", start[:5000]) and re.search(r"(?m)^H\d{4}", start[:5000]):
            raise ListFileError(
                f"{name} is UKOOA P7/2000, whose records are not read; export the list as IOGP P7/17, WITSML, LAS or"
                " CSV"
            )

    def is_header(names: Sequence[str]) -> int:
        found = list_columns.find(names, given)
        # Repeated quantities and names that are not recognised lower the score: such a row is probably one of two rows
        # of names.
        again = sum(len({(one.north, one.unit) for one in columns}) < len(columns) for columns in found.of.values())
        units = sum(bool(one.unit) for columns in found.of.values() for one in columns)
        return 0 if found.missing else max(1, 3 * len(found.of) + units - 2 * again - len(found.unread))

    return table_of(data, name, is_header, _are_units)


def _are_units(cells: Sequence[str]) -> int:
    """
    Return 1 if the cells may be a row of units below the column names; else 0.

    Such a row has no number. It has a unit, datum or north, or it has a word in each cell.
    """
    if any(number_cells.looks_like_number(cell) for cell in cells):
        return 0
    words = [cell.strip().strip("()[]") for cell in cells if cell.strip().strip("()[]-")]
    named = any(list_columns.unit_word(word) or list_columns.is_datum_or_north(word) for word in words)
    return bool(words) and int(named or len(words) == len(cells))


def _stations(table: Table, given: Given) -> StationList:
    """Return the list in a table, read by the rules of this module."""
    provenance, lines = read_provenance(table.head, table.name)
    # The head of this program's exports is for people. The provenance lines already state angles and wellhead.
    head = Head() if provenance is not None else read_head(lines)
    columns = list_columns.find(table.names, given, table.units)
    if head.horizontal and "inclination" in columns.of:
        turned = tuple(dataclasses.replace(one, quantity="dip") for one in columns.of["inclination"])
        of = {what: found for what, found in columns.of.items() if what != "inclination"}
        columns = ListColumns({**of, "dip": turned}, columns.unread)
    if columns.missing:
        raise ListFileError(_missing(table, columns))
    reader = _ListReader(table, columns, head, given, provenance)
    stations = reader.stations()
    return reader.list_of(stations)


def _missing(table: Table, columns: ListColumns) -> str:
    unread = [repr(one.name) for one in columns.unread]
    strange = f"; columns that were not recognised: {', '.join(unread)}" if unread else ""
    return (
        f"{table.at}: no column for {', '.join(columns.missing)}{strange}; expected a header such as"
        " md_m,inclination_deg,azimuth_deg; say which columns they are with"
        f" --columns {','.join(f'{what}=NAME' for what in columns.missing)}; got"
        f" {', '.join(name for name in table.names if name)}"
    )


def _definitive(what: str, found: tuple[ListColumn, ...]) -> tuple[ListColumn, ...]:
    """
    Return the columns of a quantity without those of single methods, if a column has the plain name.

    Lists of this program have a column of the definitive azimuth, "azimuth_deg", and one for each method, such as
    "azimuth_gyro_deg"; the same holds for the sigma of the azimuth. Columns that name a north stay.
    """
    plain = f"{what}_deg"
    if all(one.name != plain for one in found):
        return found
    return tuple(one for one in found if one.name == plain or one.north)


class _ListReader:
    """
    Reader of one list: its table, the meaning of its columns and head, and the remarks so far.

    Parameters
    ----------
    table, columns, head, given
        Table, columns and head of the file; `given` replaces statements of the file.
    provenance
        Data of the original list, if the table is an export of this program.
    """

    def __init__(
        self, table: Table, columns: ListColumns, head: Head, given: Given, provenance: Provenance | None = None
    ) -> None:
        confirmed = () if provenance is None else provenance.confirmed
        given = dataclasses.replace(given, confirm=(*given.confirm, *confirmed))
        self.table, self.head, self.given, self.provenance = table, head, given, provenance
        self.name = table.name
        self.of = {what: _definitive(what, found) for what, found in columns.of.items()}
        self.remarks: list[Remark] = [*(() if provenance is None else provenance.remarks), *table.remarks]
        for one in columns.unread:
            text = f"{self.name}: column {one.name!r} was not recognised and is not read"
            self._say(RemarkKind.COLUMN_NOT_READ, text)
        needed = [self.of[what][0].number for what in ("md", "inclination", "dip", "azimuth") if what in self.of]
        self.rows, left_out = station_rows(self.name, table.rows, needed)
        self.remarks += left_out
        refuse_surplus_numbers(self.rows, len(table.names))
        self.values = ColumnValues(table, self.rows, self.of, head, given, self.remarks)
        self.columns = self._chosen()

    def _say(self, kind: RemarkKind, text: str, **values: float) -> None:
        self.remarks.append(Remark(kind, text, values))

    def _chosen(self) -> dict[str, ListColumn]:
        """
        Return one column for each quantity.

        Several columns of one quantity must agree, otherwise ListFileError is raised. Azimuths from several norths are
        allowed; the column of one north is chosen.
        """
        chosen = {what: found[0] for what, found in self.of.items()}
        for what, found in self.of.items():
            if len(found) < 2:
                continue
            if what == "azimuth":
                chosen[what] = self._azimuth_column(found)
            elif what not in TEXTS:
                self._same(what, found)
        return chosen

    def _azimuth_column(self, found: Sequence[ListColumn]) -> ListColumn:
        norths = {one.north for one in found}
        named = [one for one in found if one.north]
        if len(norths) == 1:
            self._same("azimuth", found)
            return found[0]
        for wanted in (self.given.north, self.head.north, "grid", "true", "magnetic"):
            match = next((one for one in named if one.north == wanted), None)
            if wanted and match is not None:
                others = ", ".join(repr(one.name) for one in found if one is not match)
                text = f"{self.name}: azimuths are from {wanted} north, column {match.name!r}; {others} is not read"
                self._say(RemarkKind.COLUMN_CHOSEN, text)
                return match
        return found[0]

    def _same(self, what: str, found: Sequence[ListColumn]) -> None:
        """Raise ListFileError if the columns of a quantity differ; columns whose unit is unknown are not compared."""
        values = []
        for one in found:
            try:
                values.append(self.values.si(one))
            except ListFileError:
                return
        apart = max(float(np.nanmax(np.abs(values[0] - other), initial=0.0)) for other in values[1:])
        tolerance = (
            math.radians(0.02) if what in ANGLES else 0.02 + 1e-4 * float(np.nanmax(np.abs(values[0]), initial=0.0))
        )
        if apart > tolerance:
            names = " and ".join(repr(one.name) for one in found)
            raise ListFileError(
                f"{self.table.at}: columns {names} could both be the {what}, and they differ; choose one"
                f" with --columns {what}=NAME"
            )

    # Conversion of rows to stations.

    def stations(self) -> list[_ListedStation]:
        """
        Return the rows as stations in m and rad, in order of depth.

        Rows without depth or inclination, projections and surveys that were not in use are left out. Raises
        ListFileError if no station remains, or if a number, unit, angle or order of depths is not valid.
        """
        angle = "inclination" if "inclination" in self.columns else "dip"
        values = {}
        for what, column in self.columns.items():
            if what not in TEXTS:
                values[what] = self.values.si(column, needed=what in ("md", angle, "azimuth"))
        self._refuse_radians(values, angle)
        self._name_nulls()
        texts = {what: self.values.cells(column) for what, column in self.columns.items() if what in TEXTS}
        found, empty, unused, strange = [], [], 0, set[tuple[str, str]]()
        for k, row in enumerate(self.rows):
            said = {what: str(cells[k]).strip() for what, cells in texts.items()}
            numbers = {what: float(v[k]) for what, v in values.items() if math.isfinite(v[k])}
            if said.get("station") == "projected":
                # Exports of this program end with a projection to the bit, which is not a station.
                continue
            use, quality = said.get("in_use", "").lower(), said.get("verdict", "").lower()
            if quality == "reject" and self.columns["verdict"].name.lower() != "verdict":
                # Rejected stations are used only from exports of this program, which name the column "verdict".
                quality = "rejected"
            words = {"in_use": _NUMBERED.get(use, use), "verdict": quality}
            if _UNUSABLE & {*words.values()}:
                unused += 1
                continue
            strange |= {(what, word) for what, word in words.items() if word not in _USABLE | _DOUBTFUL}
            if "md" not in numbers or angle not in numbers:
                empty.append(row)
                continue
            found.append(_ListedStation(row.at, numbers, said))
        if empty:
            shown = ", ".join(one.at.rpartition(", ")[2] for one in empty[:QUOTED])
            text = f"{self.name}: {len(empty)} rows without depth or inclination are left out: {shown}"
            self._say(RemarkKind.ROWS_LEFT_OUT, text, rows=float(len(empty)))
        if unused:
            text = f"{self.name}: {unused} surveys that were not in use are left out"
            self._say(RemarkKind.ROWS_LEFT_OUT, text, rows=float(unused))
        self._name_strange(strange)
        if not found:
            if unused:
                raise ListFileError(f"{self.name}: none of its {unused} surveys is in use")
            raise ListFileError(f"{self.name}: the list has no station")
        if angle == "dip":
            found = self._from_horizontal(found)
        return self._increasing(self._downwards(self._of_one_leg(found)))

    def _name_strange(self, strange: set[tuple[str, str]]) -> None:
        """Add a remark for each column with words, given by quantity, that neither accept nor reject a station."""
        for what in sorted({what for what, _ in strange}):
            quoted = ", ".join(repr(word) for _, word in sorted(one for one in strange if one[0] == what)[:QUOTED])
            text = (
                f"{self.name}: column {self.columns[what].name!r} has words that were not recognised ({quoted}); the"
                " stations with these words are used"
            )
            self._say(RemarkKind.COLUMN_NOT_READ, text)

    def _downwards(self, found: list[_ListedStation]) -> list[_ListedStation]:
        """Return the stations from top to bottom; reverse a list that is written from the bottom up."""
        depths = [one.numbers["md"] for one in found]
        if len(found) < _UPWARDS or not all(a > b for a, b in itertools.pairwise(depths)):
            return found
        self._say(
            RemarkKind.ROWS_REORDERED,
            f"{self.name}: the stations are listed from the bottom up; their order is reversed",
        )
        return found[::-1]

    def _of_one_leg(self, found: list[_ListedStation]) -> list[_ListedStation]:
        """
        Return the stations, sorted by depth if the list is a raw log that this program exported.

        A raw log lists surveys in the order in which they were taken. Raises ListFileError if it has several legs.
        """
        holes = sorted({one.texts.get("leg", "") for one in found} - {""})
        if len(holes) > 1 and not {"in_use", "station"} & set(self.columns):
            raise ListFileError(
                f"{self.name}: column {self.columns['leg'].name!r} names {len(holes)} holes"
                f" ({', '.join(holes[:QUOTED])}), which are not one path; write a list for each hole"
            )
        definitive = any(one.texts.get("station") in _START_ROWS for one in found)
        if self.provenance is None or "in_use" not in self.columns or definitive:
            return found
        legs = sorted({one.texts.get("leg", "") for one in found})
        if len(legs) > 1:
            raise ListFileError(
                f"{self.name}: it has surveys of the legs {', '.join(legs)}, which are not one path; read the"
                " definitive list of one leg instead: mwd export -f csv --leg NAME"
            )
        return sorted(found, key=lambda one: one.numbers["md"])

    def _name_nulls(self) -> None:
        """Add a remark that quotes the null values that were read as missing."""
        cells = [str(c) for what, one in self.columns.items() if what not in TEXTS for c in self.values.cells(one)]
        nulls = [c.strip() for c in cells if number_cells.is_null(c) and any(s.isalnum() for s in c)]
        if nulls:
            quoted = ", ".join(map(repr, sorted(set(nulls))[:QUOTED]))
            text = f"{self.name}: {len(nulls)} cells have a null value ({quoted}) and are read as no value"
            self._say(RemarkKind.NULL_VALUES, text, cells=float(len(nulls)))

    def _refuse_radians(self, values: dict[str, Array], angle: str) -> None:
        """Raise ListFileError if angles have no stated unit and are all small enough to be radians."""
        columns = [self.columns[what] for what in (angle, "azimuth")]
        if (
            self.given.angle_unit
            or self.head.angle_unit
            or any(one.unit or self.values.cell_unit(one) for one in columns)
        ):
            return
        inc, azi = (np.degrees(values[what]) for what in (angle, "azimuth"))
        azi = azi[np.isfinite(azi) & (np.abs(azi) > 0.0)]
        if azi.size < 3 or inc.size < 3 or not np.any(np.abs(inc) > 0.0):
            return
        small = bool(np.nanmax(np.abs(inc)) <= math.pi and np.max(np.abs(azi)) <= math.tau)
        if small and np.any(azi % 1.0 > 0.0) and np.any(inc % 1.0 > 0.0):
            raise ListFileError(
                f"{self.table.at}: no angle of the list is larger than {np.max(np.abs(azi)):.4g}, and no unit is named:"
                " they may be radians; set the unit with --angle-unit rad or --angle-unit deg"
            )

    def _from_horizontal(self, found: list[_ListedStation]) -> list[_ListedStation]:
        """
        Return the stations with inclinations computed from their angles from the horizontal.

        The sign of the angles comes from, in this order: the caller, the vertical depths, the list, the convention of
        the well. Raises ListFileError if none of these gives the sign, if the caller contradicts the vertical depths,
        or for angles above 90 deg.
        """
        column = self.columns["dip"]
        dips = np.array([one.numbers["dip"] for one in found])
        if np.any(np.abs(dips) > math.pi / 2.0 + 1e-9):
            raise ListFileError(
                f"{self.table.at}: column {column.name!r}: an angle from the horizontal is within 90 deg"
            )
        md = np.array([one.numbers["md"] for one in found])
        down = np.array([one.numbers.get("tvd", math.nan) for one in found])
        ways = {"down": math.pi / 2.0 - dips, "up": math.pi / 2.0 + dips}
        stated, chosen, fitting = points(column.name) or self.head.dip, self.given.dip, ""
        if np.isfinite(down).sum() > 1 and np.all(np.diff(md) > 0.0):
            positions = np.column_stack([np.full_like(md, math.nan)] * 2 + [down])
            good = [name for name, inc in ways.items() if fits((md, inc, np.zeros_like(md)), positions)]
            fitting = good[0] if len(good) == 1 else ""
        if chosen and fitting not in ("", chosen):
            raise ListFileError(
                f"{self.table.at}: column {column.name!r} was to be read with positive angles {chosen}, but the"
                f" vertical depths of the list fit positive angles {fitting}; leave out --dip, or check the depths"
            )
        way, why = chosen, "as set by the user"
        if not way:
            way, why = fitting, "as its vertical depths show"
            if stated not in ("", fitting):
                why = f"as its vertical depths show, although the list states {stated}"
        if not way:
            way, why = stated, "as the list says"
        if not way:
            way, why = self.given.usual_dip, "like those of the well"
        if not way:
            raise ListFileError(
                f"{self.table.at}: column {column.name!r} has angles from the horizontal, from"
                f" {math.degrees(dips.min()):g} to {math.degrees(dips.max()):g} deg, and the list does not say whether"
                " positive ones point down or up; set it with --dip down or --dip up. If they are inclinations from the"
                f" vertical, read them with --columns inclination={column.name}"
            )
        text = (
            f"{self.name}: column {column.name!r} has angles from the horizontal, positive {way} {why}; converted to"
            " inclinations from the vertical"
        )
        if self.provenance is None or (fitting and stated not in ("", fitting)):
            self._say(RemarkKind.DIP_CONVERTED, text, first=float(dips[0]))
        return [
            dataclasses.replace(one, numbers={**one.numbers, "inclination": float(inc)})
            for one, inc in zip(found, ways[way], strict=True)
        ]

    def _increasing(self, rows: list[_ListedStation]) -> list[_ListedStation]:
        """
        Return the stations with each repeated station once.

        Raises ListFileError if an angle is out of range, or if a depth does not increase.
        """
        kept: list[_ListedStation] = []
        for row in rows:
            md, inclination, azimuth = (row.numbers.get(what, math.nan) for what in NEEDED)
            if not -1e-9 <= inclination <= math.pi + 1e-9:
                shown = math.degrees(inclination)
                raise ListFileError(
                    f"{row.at}: inclination {shown:g} deg is outside 0 to 180; is it in degrees, from the vertical?"
                )
            if not (math.isnan(azimuth) or -math.pi - 1e-9 <= azimuth <= math.tau + 1e-9):
                raise ListFileError(f"{row.at}: azimuth {math.degrees(azimuth):g} deg is outside -180 to 360")
            above = kept[-1] if kept else None
            if above is not None and md <= above.numbers["md"]:
                if all(above.numbers.get(what) == row.numbers.get(what) for what in NEEDED):
                    text = f"{row.at}: this station is a repetition of the one above, and is used once"
                    self._say(RemarkKind.STATION_REPEATED, text, measured_depth=md)
                    continue
                raise ListFileError(
                    f"{row.at}: measured depth {md:g} m does not increase after {above.numbers['md']:g} m; correct the"
                    " depth, leave one of the two rows out, or write a list for each hole"
                )
            kept.append(row)
        return kept

    # Checks of the stations, and the resulting list.

    def list_of(self, rows: list[_ListedStation]) -> StationList:
        """Return the list of stations; raise ListFileError if depths, doglegs, north or positions fail a check."""

        def column(what: str) -> Array:
            return np.array([row.numbers.get(what, math.nan) for row in rows])

        start = self._start(rows)
        if start is not None and len(rows) > 1 and rows[0].texts.get("station") in _START_ROWS:
            rows = rows[1:]
        at = [row.at for row in rows]
        md = column("md")
        self._checked(check_depths(md, at, self.given))
        north = self._north(rows)
        azimuth = column("azimuth") % math.tau
        if self.provenance is not None:
            azimuth, north = self._in_own_north(azimuth, north, column)
        inclination = np.clip(column("inclination"), 0.0, math.pi)
        self._without_azimuth(md, inclination, azimuth)
        angles = md, inclination, carried(azimuth)
        self._checked(check_doglegs(angles, at, self.given))
        horizontal = self._horizontal(md, column)
        positions = np.column_stack([*horizontal, column("tvd")])
        if self.named_map and north in ("true", "magnetic"):
            positions = self._in_axes(angles, positions, north)
        known = positions if not np.isnan(azimuth).any() else positions * np.array([math.nan, math.nan, 1.0])
        check_positions(self.name, angles, known, at)
        chosen = {"inclination", "azimuth"} <= set(self.given.columns)
        if self.provenance is None and not chosen and not np.isnan(azimuth).any():
            self.remarks += check_exchange(self.name, angles, positions)
        return StationList(
            name=self.name,
            north=north,
            md=md,
            inclination=inclination,
            azimuth=azimuth,
            positions=positions,
            sigma_inclination=column("sigma_inclination"),
            sigma_azimuth=column("sigma_azimuth"),
            tool=tuple(row.texts.get("tool", "") for row in rows),
            time=tuple(dated(*([row.texts.get(what, "") for row in rows] for what in ("date", "time")))),
            verdict=tuple(_verdict(row) for row in rows),
            figures={what: self._figure(what, column(what)) for what in FIGURES},
            remarks=distinct(self.remarks),
            start=start,
            well={} if self.provenance is None else self.provenance.well,
        )

    def _checked(self, confirmed: Iterable[Remark]) -> None:
        """Add remarks on confirmed values, except those that the provenance of an export already contains."""
        known = frozenset() if self.provenance is None else self.provenance.confirmed
        self.remarks += [one for one in confirmed if not known & set(one.values)]

    def _start(self, rows: Sequence[_ListedStation]) -> Start | None:
        """Return the start of the path of an export of this program; None if the list does not state it."""
        if self.provenance is not None:
            return self.provenance.start
        first = rows[0]
        if first.texts.get("coordinates") != "assumed" or first.texts.get("station", "tie-on") not in _START_ROWS:
            return None
        text = f'{self.name}: the coordinates depend on an assumption: the column "coordinates" begins with "assumed"'
        remark = Remark(RemarkKind.TIE_ON_ASSUMED, text, {"measured_depth": first.numbers["md"]})
        md, inclination, azimuth = (first.numbers.get(what, 0.0) for what in NEEDED)
        north, east = (first.numbers.get(what, 0.0) for what in LOCAL)
        position = north, east, first.numbers.get("tvd", md)
        return Start(md, inclination, azimuth, position, WITHOUT_POSITION, (remark,))

    def _in_own_north(self, azimuth: Array, north: str, column: Callable[[str], Array]) -> tuple[Array, str]:
        """
        Return azimuths and their north; in an export of this program, converted to the north of the exported well.

        An azimuth is nan if the declination or convergence for the conversion is missing.
        """
        own = str(self.provenance.well.get("north_reference", "")) if self.provenance is not None else ""
        if not own or self.given.north or north in ("", own):
            return azimuth, self.given.north or own or north
        to_true = {"true": np.zeros_like(azimuth), "magnetic": column("declination"), "grid": column("convergence")}
        return (azimuth + to_true[north] - to_true[own]) % math.tau, own

    def _figure(self, what: str, values: Array) -> Array:
        """Return a reference value per station; if the table has none, the value in the provenance or the head."""
        known = self.head.to_north if self.provenance is None else self.provenance.reference
        return values if np.isfinite(values).any() or what not in known else np.full_like(values, known[what])

    def _north(self, rows: Sequence[_ListedStation]) -> str:
        """
        Return the north of the azimuths, as stated by the caller, the rows, the column or the head; "" if not stated.

        Raises ListFileError if statements of the file contradict each other or are not recognised.
        """
        if self.given.north:
            stated = {list_columns.north_of(row.texts.get("azimuth_reference", "")) for row in rows}
            stated = (stated | {self.columns["azimuth"].north}) - {""} or {self.head.north} - {""}
            if stated - {self.given.north}:
                words = " and ".join(sorted(stated))
                text = (
                    f"{self.name}: it states {words} north for its azimuths; {self.given.north} north is used, as set "
                    "by the user"
                )
                self._say(RemarkKind.OVERRIDDEN, text)
            return self.given.north
        said = {row.texts.get("azimuth_reference", "") for row in rows} - {""}
        norths = {list_columns.north_of(word) for word in said}
        if "" in norths:
            strange = next(word for word in sorted(said) if not list_columns.north_of(word))
            raise ListFileError(
                f"{self.name}: the north of the azimuths, {strange!r}, was not recognised; set it with --north"
            )
        if len(norths) > 1:
            words = " and ".join(sorted(norths))
            raise ListFileError(
                f"{self.name}: one list has azimuths from {words} north; export the list with one north"
            )
        column = self.columns["azimuth"]
        if column.strange and not (column.north or norths or self.given.angle_unit):
            raise ListFileError(
                f"{self.table.at}: {column.strange!r} in the name of column {column.name!r} was recognised neither as"
                " a unit nor as a north; set them with --north and --angle-unit"
            )
        own = norths.pop() if norths else column.north
        if not own and self.head.strange_north:
            raise ListFileError(
                f"{self.name}: its head gives the north of the azimuths as {self.head.strange_north!r}, which was not"
                f" recognised; set it with --north to one of {', '.join(NORTHS)}"
            )
        if own and self.head.north and own != self.head.north and len(self.of["azimuth"]) == 1:
            raise ListFileError(
                f"{self.table.at}: column {column.name!r} has azimuths from {own} north, the head of the list says"
                f" {self.head.north}; set the right one with --north"
            )
        return own or self.head.north

    def _without_azimuth(self, md: Array, inclination: Array, azimuth: Array) -> None:
        missing = np.flatnonzero(np.isnan(azimuth))
        if missing.size:
            deep = missing[np.argmax(inclination[missing])]
            text = (
                f"{self.name}: {missing.size} stations have no azimuth, the first at {md[missing[0]]:.2f} m; the"
                f" largest inclination among them is {math.degrees(inclination[deep]):.2f} deg"
            )
            self._say(RemarkKind.AZIMUTH_MISSING, text, stations=float(missing.size))

    @property
    def named_map(self) -> bool:
        """Whether north and east are map coordinates, by their column names or because the head gives a wellhead."""
        return "map_north" in self.columns or self.head.wellhead is not None

    def _horizontal(self, md: Array, column: Callable[[str], Array]) -> tuple[Array, Array]:
        """
        Return north and east from the wellhead, m, shape (n,) each; nan if one of the two columns is missing.

        The wellhead is subtracted from map coordinates. Raises ListFileError if the wellhead is needed but unknown, or
        if offsets and map coordinates in the list contradict each other.
        """
        local = all(what in self.columns for what in LOCAL)
        charted = all(what in self.columns for what in MAP)
        if not local and not charted:
            return column("north"), column("east")
        if self.provenance is not None:
            return column("north"), column("east")
        names = LOCAL if local else MAP
        pair = np.column_stack([column(names[0]), column(names[1])])
        inclination = float(column("inclination")[0])
        shifted, remarks = offsets_from_wellhead(
            self.name, md, pair, inclination, self.given, self.head.wellhead, charted=not local
        )
        self.remarks += remarks
        if local and charted:
            # Use the offsets; the map coordinates in the same list give the position of the wellhead.
            charts = np.column_stack([column(MAP[0]), column(MAP[1])])
            beside, more = offsets_from_wellhead(
                self.name, md, charts, inclination, self.given, self.head.wellhead, charted=True
            )
            if not any(one.kind == RemarkKind.MAP_SHIFTED for one in remarks):
                self.remarks += more
            apart = float(np.nanmax(np.hypot(*(beside - shifted).T), initial=0.0))
            if apart > 2.0 + 0.002 * float(md[-1]):
                raise ListFileError(
                    f"{self.table.at}: north and east of the list and its map coordinates are {apart:.1f} m apart from"
                    " each other; leave one pair out with --columns map_north=,map_east="
                )
        return shifted[:, 0], shifted[:, 1]

    def _in_axes(self, angles: tuple[Array, Array, Array], positions: Array, north: str) -> Array:
        """
        Return positions whose map coordinates are rotated from grid north to the north of the azimuths.

        They are returned unchanged if they fit the path of the angles already, if the rotation that fits best is above
        6 deg, or if they do not fit after it.
        """
        offset = float(np.hypot(*positions[0, :2]))
        if fits(angles, positions):
            if offset > _OFFSET:
                text = (
                    f"{self.name}: its azimuths are from {north} north and its map coordinates along a grid; its first "
                    f"station, {offset:.0f} m from the wellhead, is not corrected for the convergence, which the list "
                    "does not state: export the list with azimuths from grid north"
                )
                self._say(RemarkKind.NORTH_ASSUMED, text, distance=offset)
            return positions
        turn = turn_between(angles, positions)
        md, inc, azi = angles
        if abs(turn) > math.radians(6.0) or not fits((md, inc, azi + turn), positions):
            return positions
        text = (
            f"{self.name}: its azimuths are from {north} north, but its north and east columns are rotated by"
            f" {math.degrees(turn):+.2f} deg from that north, like the axes of a grid: these columns are rotated back"
        )
        self._say(RemarkKind.MAP_TURNED, text, turn=float(turn))
        level = (positions[:, 0] + 1j * positions[:, 1]) * np.exp(-1j * turn)
        return np.column_stack([level.real, level.imag, positions[:, 2]])
