# SPDX-License-Identifier: Apache-2.0
"""A CSV file of any dialect as columns of text; an error names its line."""

from __future__ import annotations

import csv
from pathlib import Path

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import read_text

_SEPARATORS = ",;\t|"


def read_table(path: Path) -> dict[str, list[str]]:
    """
    Columns of a CSV file by the names in its first line.

    Comma, semicolon, tab or bar separate, whichever the first line has most of; empty lines and lines that begin with #
    are left out.

    Raises
    ------
    ValueError
        It is empty, has no data line, a name twice, or a line with more cells than names.
    OSError
        It cannot be read.
    """
    try:
        lines = read_text(path, budgets.LIST).splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file: byte {error.start} is not UTF-8") from error
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not numbered:
        raise ValueError(f"{path} is empty: expected a line of column names and a line for each station")
    separator = max(_SEPARATORS, key=numbered[0][1].count)
    try:
        rows = list(csv.reader((line for _, line in numbered), delimiter=separator, strict=True))
    except csv.Error as error:
        raise ValueError(f"{path} is not CSV: {error}") from error
    names = [name.strip() for name in rows[0]]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: column {', '.join(twice)} is there twice")
    if len(rows) == 1:
        raise ValueError(f"{path} has column names but no station")
    table: dict[str, list[str]] = {name: [] for name in names}
    for (number, _), row in zip(numbered[1:], rows[1:], strict=False):
        if len(row) > len(names) and any(cell.strip() for cell in row[len(names) :]):
            raise ValueError(f"{path}, line {number}: {len(row)} cells, but {len(names)} columns have names")
        for k, name in enumerate(names):
            table[name].append(row[k].strip() if k < len(row) else "")
    return table
