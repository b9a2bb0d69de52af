# SPDX-License-Identifier: Apache-2.0
"""
Columns of a table of pressures: which quantity and unit a name means, and the columns and marks that a user states.

The names are those of any usual data system of a rig, in several languages. A historian names the quantity of each
value in a column of tags.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from mwd_surface.list_files.number_cells import Cell, decimal_mark, looks_like_number, split
from mwd_surface.receiver import table_times
from mwd_surface.receiver.gauge_scale import PRESSURES, gauge_signal

_SAID = ("date", "time", "pressure", "pump", "rate", "decimal", "tag", "value")
_DECIMAL_MARKS = {"comma": ",", "point": "."}
TIME = re.compile(
    r"^(?:rig |local |utc |gps |unix |elapsed |sample |log |server |source |measurement |measuring |test )?"
    r"(?:time ?stamp|time|ts|t|datetime|date ?/? ?time|epoch|stamp|clock|elapsed|etim|zeit\w*|uhrzeit|datum/uhrzeit|"
    r"tiempo|hora|temps|heure|horodatage|tid|tempo|时间|时刻|время)\b|^(?:seconds|hh? mm(?: ss)?)$"
)
DATE = re.compile(
    r"^(?:date|day|日期|datum|fecha|dato|data|дата)\b|^(?:y{2,4}[/ ]mm[/ ]dd|[dm]{2}[/ ][dm]{2}[/ ]y{2,4})$"
)
# Names of the pressure that the tool modulates, of any pressure, and of pressures of other places.
_STANDPIPE = re.compile(r"stand ?pipe|\bspp|standrohr|立压|立管")
_PRESSURE = re.compile(r"press|druck|presion|presión|trykk|泵压|давл|voltage|\bvolts?\b|\bp\b|\bcurrent\b|\bloop\b")
_ELSEWHERE = re.compile(
    r"diff|annul|casing|choke|hydrostatic|downhole|bottom ?hole|\bbh|\bkill|cement|boost|\bmax|\bmin\b|hydraulic"
)
_AVERAGED = re.compile(r"\bavg\b|\baverage|\bmean\b|\bsmooth|\bfiltered\b")
PUMP = re.compile(r"^(?:pump|pump no|pump number|泵)\b")
QUALITY = re.compile(r"^(?:quality|qual|status|state|qualität)\b")
# Column names in a table that has a separate row for each value of each measured quantity (tag).
TAG = re.compile(
    r"^(?:tag|point|channel|sensor|signal|mnemonic|parameter|variable|metric|measurement|item|node|curve|topic|name|id|messstelle|kanal|canal|etiqueta|标签|测点|位号)"
    r"(?: ?(?:name|id|no|number|path))?$"
)
VALUE = re.compile(
    r"^(?:data |process |raw |average |avg )?(?:value|values|val|reading|result|wert|valor|valeur|verdi|值|数值)$"
)
UNIT = re.compile(r"^(?:unit|units|uom|eu|eng(?:ineering)? units?|einheit|unidad|unité|单位)$")
_MARKS = re.compile(r"[^\w./%]+|_")
GROUPED = r"^[+-]?\d{1,3}(?:[.,'’   ]\d{3})+(?:[.,]\d*)?$"
_HIGHEST = 3.0e8  # pressure that no rig exceeds, Pa


@dataclasses.dataclass(frozen=True)
class NamedColumn:
    """One column: its place in a row, its name, and its unit ("" if it has none)."""

    number: int
    name: str
    unit: str


def columns_of(text: str) -> dict[str, str]:
    """
    Parse the columns that a user states, such as "time=Zeit,pressure_bar=SPP" or "time_s=1,pressure_bar=2".

    Returns the name or number of the column of each quantity, by quantity with unit.

    Raises
    ------
    ValueError
        A part has no "=", its quantity does not exist, or its decimal mark is not comma or point.
    """
    pairs = {}
    for part in filter(None, text.split(",")):
        quantity, equals, column = part.partition("=")
        quantity = quantity.strip().lower()
        if not equals or quantity.partition("_")[0] not in _SAID:
            raise ValueError(
                f"--columns {part}: write time=NAME, date=NAME or pressure_bar=NAME, where a number counts columns from"
                " 1; tag=NAME and value=NAME for rows of several tags, of which pressure_bar names one; rate_hz=50 for"
                " rows without times; decimal=comma or decimal=point"
            )
        pairs[quantity] = column.strip()
        if quantity.startswith("decimal"):
            if quantity != "decimal" or pairs[quantity].lower() not in _DECIMAL_MARKS:
                raise ValueError(
                    f"--columns {part}: the decimal mark is not known; write decimal=comma or decimal=point"
                )
            pairs[quantity] = pairs[quantity].lower()
    return pairs


class LiveColumns(NamedTuple):
    """
    Places of time and pressure in a line, from 0, and their units; the unit of the time is "" if unknown.

    name: name of the column of pressure, "" if unknown; it may state the range of the gauge.
    """

    time: int | None
    time_unit: str
    pressure: int
    unit: str
    name: str = ""


def live_columns(names: Sequence[str], columns: Mapping[str, str]) -> LiveColumns | None:
    """
    Return the columns of lines that arrive one by one; None if neither the caller nor the names state them.

    Parameters
    ----------
    names : sequence of str
        Cells of a first line; empty until this line has arrived.
    columns : mapping of str
        See `columns_of`.

    Raises
    ------
    ValueError
        A unit is not known, or the number of a column is 0.
    """
    places: dict[str, tuple[int, str]] = {}
    words = [words_of(name, "") for name in names]
    for quantity in ("time", "pressure"):
        said = next(((key, name) for key, name in columns.items() if key.partition("_")[0] == quantity), None)
        if said is not None:
            key, name = said
            unit = key.partition("_")[2]
            if unit not in (table_times.UNITS if quantity == "time" else PRESSURES) and (unit or quantity != "time"):
                raise ValueError(
                    f"--columns {key}={name}: the unit is not known; write for example pressure_bar={name}"
                )
            if name.isdecimal() and name not in names:
                if int(name) < 1:
                    raise ValueError(f"--columns {key}={name}: columns are counted from 1")
                places[quantity] = int(name) - 1, unit
            elif name in names:
                places[quantity] = list(names).index(name), unit
        elif not columns:
            fits = TIME.match if quantity == "time" else means_pressure
            found = [(k, unit) for k, (text, unit) in enumerate(words) if fits(text)]
            places |= {quantity: found[0]} if found else {}
    place, unit = places.get("pressure", (-1, ""))
    if place < 0 or unit not in PRESSURES:
        return None
    time, time_unit = places.get("time", (None, ""))
    return LiveColumns(time, time_unit, place, unit, names[place] if place < len(names) else "")


def untagged(row: Mapping[str, str]) -> dict[str, str]:
    """Return a row; if it holds one value of one tag (tag, value, unit), the value gets a column named by the tag."""
    tag, value, unit = (
        next((name for name in row if pattern.match(last_part(words_of(name, "")[0]))), "")
        for pattern in (TAG, VALUE, UNIT)
    )
    if not (tag and value):
        return dict(row)
    rest = {name: cell for name, cell in row.items() if name not in (tag, value, unit)}
    return {**rest, row[tag] + (f" [{row[unit]}]" if row.get(unit) else ""): row[value]}


def mark_of(cells: Iterable[str], others: Iterable[Cell], unit: str, said: str) -> str:
    """
    Return the decimal mark of a column of text.

    It is the mark that the caller states, else the mark in the numbers of the column or of the table, else the only
    mark with which no pressure is impossibly high.

    Parameters
    ----------
    cells, others : iterable of str
        Cells of the column, and of the whole table.
    unit : str
        Unit of the column.
    said : str
        "comma" or "point" as the caller states; "" if not stated.

    Raises
    ------
    ValueError
        The decimal mark is ambiguous: 203,812 may be 203.812 or 203 812.
    """
    if said:
        return _DECIMAL_MARKS[said]
    own = [one[0] for cell in cells if (one := split(cell)) is not None]
    votes = [decimal_mark(number) for number in own]
    if any(votes):
        return max(",.", key=votes.count)
    grouped = next((number for number in own if re.match(GROUPED, number)), "")
    if not grouped:
        return "."
    seen = [decimal_mark(one[0]) for cell in others if (one := split(cell)) is not None]
    if any(seen):
        return max(",.", key=seen.count)
    # Largest pressure if the mark separates thousands.
    size = max(float(re.sub(r"\D", "", number) or 0.0) for number in own) * PRESSURES.get(unit, 1.0)
    if size > _HIGHEST:
        return "," if "," in grouped else "."
    raise ValueError(
        f"{grouped} may be {grouped.replace(',', '.')} or {re.sub(r'[.,]', '', grouped)}; add decimal=comma or"
        " decimal=point to --columns"
    )


def pressures_of(columns: Sequence[tuple[NamedColumn, str]]) -> list[NamedColumn]:
    """
    Return the pressure columns, standpipe pressure first and averages last, which have no pulses.

    columns: columns with the words of their names. If no name means a pressure, all columns with a unit of pressure
    are returned.
    """
    rows = [(one, words) for one, words in columns if not _ELSEWHERE.search(words)]
    rows.sort(key=lambda row: bool(_AVERAGED.search(row[1])))
    named = [one for one, words in rows if _STANDPIPE.search(words)]
    named += [one for one, words in rows if one not in named and _PRESSURE.search(words)]
    if named:
        # If some columns have a unit of pressure, columns without it are flags or counters.
        return [one for one in named if one.unit in PRESSURES] or named
    return [one for one, _ in rows if one.unit in PRESSURES]


def means_pressure(words: str) -> bool:
    """Return whether the words of a name mean a pressure."""
    return bool(_STANDPIPE.search(words) or _PRESSURE.search(words))


def last_part(words: str) -> str:
    """Return the part of a name after its last dot; dots join the names of nested objects."""
    return words.rpartition(".")[2]


def words_of(name: str, unit: str) -> tuple[str, str]:
    """Return the words of a name in lower case without its unit, and the unit ("" if there is none)."""
    brackets = re.findall(r"[(\[{]([^)\]}]*)[)\]}]?", name)
    words = " ".join(_MARKS.sub(" ", re.sub(r"[(\[{][^)\]}]*[)\]}]?", " ", name)).lower().split())
    own = [unit_of(one) for one in (unit, *brackets) if unit_of(one)]
    if (signal := gauge_signal(name)) is not None:
        # A unit of pressure next to that of the signal belongs to the range of the gauge.
        own = [signal.unit]
    # The unit may be the last word, or follow the name and a dot as in LAS.
    first, _, last = words.replace(".", " ").rpartition(" ")
    if not own and first and (last in table_times.UNITS or last in PRESSURES):
        own, words = [last], words[: len(first)]
    return words, own[0] if own else ""


def unit_of(text: str) -> str:
    """Return the unit, of `PRESSURES` or `table_times.UNITS`, that a text such as "(bar)" means; "" without a unit."""
    word = "".join(c for c in text.lower() if c.isalpha())
    return word if word in table_times.UNITS or word in PRESSURES else ""


def is_header(names: Sequence[str]) -> int:
    """Return the number of quantities of a table of pressures that texts name; 0 if they do not name its columns."""
    found = [words_of(str(name), "") for name in names]
    tagged = all(any(pattern.match(words) for words, _ in found) for pattern in (TAG, VALUE))
    times = [any(pattern.match(words) for pattern in (TIME, DATE, PUMP)) for words, _ in found]
    pressures = [means_pressure(words) or unit in PRESSURES for words, unit in found]
    quantities = sum(times) + (tagged or any(p and not t for p, t in zip(pressures, times, strict=True)))
    return quantities if quantities > 1 and not any(looks_like_number(name) for name in names) else 0


def are_units(cells: Sequence[str]) -> int:
    """Return 1 if the cells below the names are units, else 0."""
    words = [str(cell).strip("()[] ") for cell in cells]
    return int(any(unit_of(word) for word in words) and not any(looks_like_number(word) for word in words))
