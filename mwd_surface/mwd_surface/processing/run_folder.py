# SPDX-License-Identifier: Apache-2.0
"""What `mwd process` left in a folder, read back: its surveys, and its attitude in blocks, whatever the file format."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
from numpy.typing import NDArray

ANGLES = ("inclination_deg", "azimuth_deg", "toolface_deg")
GRAVITY = ("gravity_x", "gravity_y", "gravity_z")
_COLUMNS = ("stamp_ns", *ANGLES, *GRAVITY, "status")
_TYPES = {"stamp_ns": pa.int64(), "status": pa.string(), **dict.fromkeys((*ANGLES, *GRAVITY), pa.float64())}

Rows = dict[str, NDArray[Any]]


def is_run(folder: Path) -> bool:
    """Whether this folder holds the results of a run."""
    return (folder / "surveys.csv").is_file() and attitude_file(folder) is not None


def attitude_file(folder: Path) -> Path | None:
    """The attitude of a run: attitude.parquet or attitude.csv."""
    found = (folder / f"attitude.{ending}" for ending in ("parquet", "csv"))
    return next((path for path in found if path.is_file()), None)


def surveys(folder: Path) -> list[dict[str, str]]:
    """
    Lines of surveys.csv, column -> text.

    Raises
    ------
    OSError
        There is none.
    """
    with (folder / "surveys.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def attitude(folder: Path) -> Iterator[Rows]:
    """
    Attitude in blocks, in the order of the file.

    Each block: `stamp_ns`, shape (n,), ns; the angles of `ANGLES`, deg, nan where unknown; `gravity`, shape (n, 3),
    unit vector down, nan where unknown; `status`, shape (n,), words joined by a bar.

    Raises
    ------
    FileNotFoundError
        The folder has no attitude.
    ValueError
        It is none of ours.
    """
    file = attitude_file(folder)
    if file is None:
        raise FileNotFoundError(2, "no attitude.csv or attitude.parquet in it", str(folder))
    try:
        for batch in _batches(file):
            table = {name: batch.column(name) for name in _COLUMNS}
            yield {
                "stamp_ns": table["stamp_ns"].to_numpy(zero_copy_only=False),
                **{name: _floats(table[name]) for name in ANGLES},
                "gravity": np.stack([_floats(table[name]) for name in GRAVITY], axis=1),
                "status": table["status"].to_numpy(zero_copy_only=False),
            }
    except (pa.ArrowInvalid, KeyError) as error:
        raise ValueError(f"{file} is not what `mwd process` writes: {str(error).splitlines()[0]}") from error


def _batches(file: Path) -> Iterator[pa.RecordBatch]:
    if file.suffix == ".parquet":
        with parquet.ParquetFile(file) as opened:
            yield from opened.iter_batches(columns=list(_COLUMNS))
        return
    convert = arrow_csv.ConvertOptions(include_columns=list(_COLUMNS), column_types=_TYPES, strings_can_be_null=False)
    with arrow_csv.open_csv(file, convert_options=convert) as opened:
        yield from opened


def _floats(column: pa.Array) -> NDArray[np.float64]:
    values: NDArray[np.float64] = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return values
