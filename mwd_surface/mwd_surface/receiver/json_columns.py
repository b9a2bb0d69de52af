# SPDX-License-Identifier: Apache-2.0
"""
Columns of samples in JSON: a document, or an object or list in each line (JSON lines, the log of a message broker).

A sample is an object with its quantities by name, or a list of values. The samples may be in a list inside an object;
the other values of the object then hold for all of them. An object may also hold lists with a value for each sample.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import load_json, read_file

_START = re.compile(r'[\ufeff\x1e\s]*[\[{]\s*(?:["{}\[\]]|-?\d)')
# Names of objects that only contain the quantities; these names do not become part of the name of a quantity.
_HOLDERS = frozenset(
    ["data", "values", "fields", "payload", "tags", "sample", "samples", "measurements", "body", "message"]
)
_LONGEST_LINE = 1_000_000  # largest number of characters of a line


def is_json(text: str) -> bool:
    """Return whether a text begins like a JSON object or list that may hold samples."""
    return _START.match(text) is not None


def read(path: Path, encoding: str) -> tuple[dict[str, list[str]], int]:
    """
    Return the columns of a file as text by name, and the number of lines that are not JSON.

    Columns without a name are numbered from 1; a sample that lacks a quantity has an empty cell.

    Raises
    ------
    ValueError
        The file has no samples, or more than `budgets.PRESSURE_JSON` allows (BudgetError).
    OSError
        The file cannot be read.
    """
    columns: dict[str, list[str]] = {}
    count = unreadable = 0
    try:
        for value in _values(path, encoding):
            if value is None:
                unreadable += 1
                continue
            for row in _rows(value, ()):
                for name, cell in row.items():
                    column = columns.setdefault(name, [])
                    column += [""] * (count - len(column))
                    column.append(cell)
                count += 1
                budgets.PRESSURE_JSON.check("columns", len(columns))
                # Count the cells of the complete table, including empty ones: samples may lack some quantities.
                budgets.PRESSURE_JSON.check("records", count * max(len(columns), 1))
    except BudgetError as error:
        raise BudgetError(f"{path}: {error}") from error
    if not columns:
        raise ValueError(
            f"{path}: begins as JSON, but has no samples; write an object with time and pressure in each line"
        )
    for column in columns.values():
        column += [""] * (count - len(column))
    return columns, unreadable


def cells_of(line: str) -> list[dict[str, str]]:
    """Return the samples of one line as cells by name; an empty list if the line is not JSON."""
    value = _loaded(line)
    return [] if value is None else list(_rows(value, ()))


def _values(path: Path, encoding: str) -> Iterator[Any]:
    """Yield the JSON value of each line, None if it is not JSON; of a file with one document, only this value."""
    with path.open(encoding=encoding, errors="replace") as file:
        first = _loaded(file.readline(_LONGEST_LINE))
    if first is None and path.stat().st_size <= budgets.PRESSURE_JSON.size:
        # A list that lacks its end, as after a power failure, is not a document and is read by lines.
        with contextlib.suppress(ValueError):
            text = read_file(path, budgets.PRESSURE_JSON).decode(encoding, errors="replace")
            yield load_json(text.lstrip("\ufeff"), budgets.PRESSURE_JSON)
            return
    with path.open(encoding=encoding, errors="replace") as file:
        while line := file.readline(budgets.PRESSURE_JSON.size + 1):
            budgets.PRESSURE_JSON.check("size", len(line))
            if line.strip(" \t\r\n\x1e\ufeff[],\x00"):
                yield _loaded(line)


def _loaded(line: str) -> Any:
    """
    Return the JSON object or list in a line, which may be an item of a list over several lines.

    Return None if the line has no JSON object or list.
    """
    text = line.strip(" \t\r\n\x1e\ufeff,\x00")
    for one in (text, text.lstrip("[").strip(), text.rstrip("]").strip()):
        try:
            # `load_json` measures the nesting, which takes longer than reading a usual line: call it only for a line
            # with many brackets.
            flat = one.count("[") + one.count("{") <= (budgets.PRESSURE_JSON.nesting or 0)
            value = json.loads(one) if flat else load_json(one, budgets.PRESSURE_JSON)
        except (ValueError, RecursionError):
            continue
        return value if isinstance(value, (dict, list)) else None
    return None


def _rows(value: Any, names: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield the samples in a JSON value as cells by name; names: names of the cells, if the value is a plain list."""
    if isinstance(value, list) and not any(isinstance(one, (dict, list)) for one in value):
        yield {(names[k] if k < len(names) else str(k + 1)): _cell(one) for k, one in enumerate(value)}
    elif isinstance(value, list):
        for one in value:
            yield from _rows(one, names)
    elif isinstance(value, dict):
        lists = {name: one for name, one in value.items() if isinstance(one, list) and one}
        shared = dict(_flat({name: one for name, one in value.items() if name not in lists}, ""))
        inside = [one for one in lists.values() if isinstance(one[0], (dict, list))]
        heads = [one for one in lists.values() if all(isinstance(name, str) for name in one)]
        for row in _inside(inside[0], heads) if inside else _side_by_side(lists):
            yield {**shared, **row}


def _inside(samples: list[Any], heads: list[list[str]]) -> Iterator[dict[str, str]]:
    """Yield the samples of a list inside an object; the first list of `heads` in the same object names the values."""
    yield from _rows(samples, heads[0] if heads else ())


def _side_by_side(lists: dict[str, list[Any]]) -> Iterator[dict[str, str]]:
    """Yield the samples of an object that has one list per quantity; one empty sample if it has no lists."""
    count = max((len(one) for one in lists.values()), default=0)
    for k in range(count):
        yield {name: _cell(one[k]) for name, one in lists.items() if k < len(one)}
    if not lists:
        yield {}


def _flat(value: dict[str, Any], above: str) -> Iterator[tuple[str, str]]:
    """
    Yield name and cell of each quantity of an object and of the objects inside it, with dots between the names.

    Lists are left out, and so are the names of objects that only hold the quantities (`_HOLDERS`).
    """
    for name, one in value.items():
        whole = name if not above else f"{above}.{name}"
        if isinstance(one, dict):
            yield from _flat(one, above if name.lower() in _HOLDERS else whole)
        elif not isinstance(one, list):
            yield whole, _cell(one)


def _cell(value: Any) -> str:
    """Return a value as the text of a cell; empty for null and for a number that is not finite."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    return value if isinstance(value, str) else str(value)
