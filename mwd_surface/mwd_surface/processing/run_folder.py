# SPDX-License-Identifier: Apache-2.0
"""Reading the results of `mwd process` from a folder: its surveys, and its attitude in blocks, in any file format."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
from numpy.typing import NDArray

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import check_lines, check_regular, read_text

ANGLES = ("inclination_deg", "azimuth_deg", "toolface_deg")
GRAVITY = ("gravity_x", "gravity_y", "gravity_z")
_COLUMNS = ("stamp_ns", *ANGLES, *GRAVITY, "status")
_TYPES = {"stamp_ns": pa.int64(), "status": pa.string(), **dict.fromkeys((*ANGLES, *GRAVITY), pa.float64())}

# Size of a row in memory, bytes: 8 for each column.
_ROW_BYTES = 8 * len(_COLUMNS)

Rows = dict[str, NDArray[Any]]


def is_run(folder: Path) -> bool:
    """Return whether the folder holds the results of a run."""
    return (folder / "surveys.csv").is_file() and attitude_file(folder) is not None


def attitude_file(folder: Path) -> Path | None:
    """Return the attitude file of a run: attitude.parquet, else attitude.csv; None if the folder has neither."""
    found = (folder / f"attitude.{ending}" for ending in ("parquet", "csv"))
    return next((path for path in found if path.is_file()), None)


def surveys(folder: Path) -> list[dict[str, str]]:
    """
    Return the lines of surveys.csv, each as a table of column to text.

    Raises
    ------
    OSError
        The file does not exist or cannot be read.
    ValueError
        The file is not UTF-8 or exceeds its budget.
    """
    text = read_text(folder / "surveys.csv", budgets.LIST)
    check_lines(text, budgets.LIST)
    return list(csv.DictReader(io.StringIO(text, newline="")))


def attitude(folder: Path) -> Iterator[Rows]:
    """
    Yield the attitude in blocks, in the order of the file.

    Each block: `stamp_ns`, shape (n,), ns; the angles of `ANGLES`, deg, nan if unknown; `gravity`, shape (n, 3), unit
    vector down, nan if unknown; `status`, shape (n,), words joined by a bar.

    Raises
    ------
    FileNotFoundError
        The folder has no attitude.
    ValueError
        The file was not written by `mwd process`, or exceeds its budget.
    """
    file = attitude_file(folder)
    if file is None:
        raise FileNotFoundError(2, "the folder has no attitude.csv or attitude.parquet", str(folder))
    try:
        for batch in _batches(file):
            table = {name: batch.column(name) for name in _COLUMNS}
            yield {
                "stamp_ns": table["stamp_ns"].to_numpy(zero_copy_only=False),
                **{name: _floats(table[name]) for name in ANGLES},
                "gravity": np.stack([_floats(table[name]) for name in GRAVITY], axis=1),
                "status": table["status"].to_numpy(zero_copy_only=False),
            }
    except budgets.BudgetError as error:
        raise budgets.BudgetError(f"{file} {error}") from error
    except (pa.ArrowInvalid, pa.ArrowMemoryError, KeyError) as error:
        raise ValueError(f"{file} is not what `mwd process` writes: {str(error).splitlines()[0]}") from error


def _batches(file: Path) -> Iterator[pa.RecordBatch]:
    size = check_regular(file, budgets.RUN)
    if file.suffix == ".parquet":
        with parquet.ParquetFile(file) as opened:
            about = opened.metadata
            budgets.RUN.check("records", about.num_rows)
            groups = range(about.num_row_groups)
            budgets.RUN.check_ratio(size, sum(about.row_group(k).total_byte_size for k in groups))
            # Repeated equal values pack any number of rows into a few bytes: check the size of the rows in memory too.
            budgets.RUN.check_ratio(size, about.num_rows * _ROW_BYTES)
            yield from opened.iter_batches(columns=list(_COLUMNS))
        return
    convert = arrow_csv.ConvertOptions(include_columns=list(_COLUMNS), column_types=_TYPES, strings_can_be_null=False)
    with arrow_csv.open_csv(file, convert_options=convert) as opened:
        yield from opened


def _floats(column: pa.Array) -> NDArray[np.float64]:
    values: NDArray[np.float64] = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return values
