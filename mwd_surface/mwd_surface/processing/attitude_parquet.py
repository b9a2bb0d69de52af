# SPDX-License-Identifier: Apache-2.0
"""Attitude as Parquet: the columns of the CSV without rounding, and the north reference of the azimuth."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from mwd_estimation.core.north import North
from mwd_estimation.core.status import words
from mwd_sensors.core.arrays import Samples
from mwd_surface.signals.table import ATTITUDE

_DEG = 180.0 / math.pi
_WORDS = pa.dictionary(pa.int32(), pa.string())
SCHEMA = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        *((column.key, pa.float64()) for _, column in ATTITUDE),
        *((f"sigma_{column.key}", pa.float64()) for _, column in ATTITUDE),
        *((f"gravity_{axis}", pa.float64()) for axis in "xyz"),
        ("status", _WORDS),
        ("north", _WORDS),
    ]
)
_FLOATS = [field.name for field in SCHEMA if field.type == pa.float64()]
_GROUP_ROWS = 131_072  # smallest number of rows in a row group, except the last


class ParquetWriter:
    """
    Writer of a Parquet file of the attitude, one row group at a time.

    Unknown values are null. `status` is a text of words joined by bars, as in the CSV.

    Raises
    ------
    OSError
        The file cannot be written; every method may raise this.
    """

    def __init__(self, path: Path) -> None:
        # Only the high bytes of sensor data compress well; a dictionary would only cost time.
        self._file = pq.ParquetWriter(
            path,
            SCHEMA,
            compression="zstd",
            compression_level=1,
            use_dictionary=["status", "north"],
            column_encoding={"stamp_ns": "DELTA_BINARY_PACKED", **dict.fromkeys(_FLOATS, "BYTE_STREAM_SPLIT")},
        )
        self._waiting: list[pa.RecordBatch] = []
        self._rows = 0

    def write(self, attitude: Samples, gravity: Samples) -> None:
        """Write rows of `wire.ATTITUDE` and `wire.GRAVITY` of the same stamps."""
        if not len(attitude):
            return
        columns = [pa.array(np.ascontiguousarray(attitude["stamp_ns"]))]
        for prefix in ("", "sigma_"):
            columns += [
                _nullable(attitude[prefix + signal.field] * _DEG, attitude[f"sigma_{signal.field}"])
                for signal, _ in ATTITUDE
            ]
        columns += [_nullable(gravity["gravity"][:, k], gravity["sigma"]) for k in range(3)]
        columns.append(_named(attitude["status"], words))
        names = {int(north): north.name.lower() for north in North}
        columns.append(_named(attitude["north"], lambda code: names.get(code, "")))
        self._waiting.append(pa.RecordBatch.from_arrays(columns, schema=SCHEMA))
        self._rows += len(attitude)
        if self._rows >= _GROUP_ROWS:
            self._flush()

    def close(self) -> None:
        """Write the pending rows and the end of the file."""
        self._flush()
        self._file.close()

    def _flush(self) -> None:
        if self._rows:
            table = pa.Table.from_batches(self._waiting).unify_dictionaries()
            self._file.write_table(table, row_group_size=self._rows)
            self._waiting, self._rows = [], 0


def _nullable(values: NDArray[np.float64], sigma: NDArray[np.float64]) -> pa.Array:
    unknown = np.isnan(sigma)
    return pa.array(np.ascontiguousarray(values), mask=unknown if unknown.any() else None)


def _named(codes: NDArray[np.uint32], name: Callable[[int], str]) -> pa.Array:
    found, index = np.unique(codes, return_inverse=True)
    return pa.DictionaryArray.from_arrays(
        pa.array(index.astype(np.int32)), pa.array([name(int(code)) for code in found])
    )
