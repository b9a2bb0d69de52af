# SPDX-License-Identifier: Apache-2.0
"""
Data set of a fleet: folders `bags/`, `surveys/` and `attitude/` with Parquet files.

Each recording has one file in each folder. The file name (key) is the hash of the recording's bytes, the settings and
this project's version. A file appears completely or not at all, and the file in `bags/` is written last, when the other
files of the recording are complete. An interrupted run therefore continues where it stopped, and no result is in the
data set twice. polars, duckdb and pandas read each folder as one table.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as parquet

from mwd_sensors.core.input_files import open_regular
from mwd_surface.fleet.attitude_statistics import SHARES
from mwd_surface.signals.table import SURVEY_TABLE

TABLES = ("attitude", "surveys", "bags")
DONE, FAILED = "done", "failed"
_CHUNK = 1 << 20  # bytes that are read at a time
_TYPES = {"Double": pa.float64(), "Int64": pa.int64(), "Boolean": pa.bool_(), "String": pa.string()}
# First columns of every table, which identify the recording.
_WHERE = [("key", pa.string()), ("bag", pa.string()), ("well", pa.string())]
# Columns of the table `attitude` with real numbers.
_ATTITUDE = (
    *("inclination_deg", "inclination_lowest_deg", "inclination_highest_deg", "sigma_inclination_deg"),
    *("azimuth_deg", "sigma_azimuth_deg", "rotary_speed_rpm", "non_gravity_mps2", *SHARES.values()),
)
SCHEMAS = {
    "bags": pa.schema(
        [
            ("key", pa.string()),
            ("bag", pa.string()),
            ("outcome", pa.string()),
            ("reason", pa.string()),
            ("bytes", pa.int64()),
            ("wells", pa.int32()),
            ("samples", pa.int64()),
            ("seconds", pa.float64()),
            ("start_ns", pa.int64()),
            ("end_ns", pa.int64()),
            ("samples_rejected", pa.int64()),
            ("gaps", pa.int64()),
            ("samples_without_gravity", pa.int64()),
            ("samples_without_azimuth", pa.int64()),
            ("inclination_lowest_deg", pa.float64()),
            ("inclination_highest_deg", pa.float64()),
            ("surveys", pa.int32()),
            ("surveys_accepted", pa.int32()),
            ("surveys_doubtful", pa.int32()),
            ("surveys_rejected", pa.int32()),
            ("method", pa.string()),
            ("reference", pa.string()),
            ("north", pa.string()),
            ("warnings", pa.list_(pa.string())),
            ("version", pa.string()),
            ("worker", pa.string()),
            ("elapsed_s", pa.float64()),
        ]
    ),
    "surveys": pa.schema([*_WHERE, *((listed.key, _TYPES[signal.type]) for signal, listed in SURVEY_TABLE)]),
    "attitude": pa.schema(
        [*_WHERE, ("start_ns", pa.int64()), ("samples", pa.int64()), *((name, pa.float64()) for name in _ATTITUDE)]
    ),
}


def key_of(path: Path, settings: str, version: str) -> str:
    """
    Return the key of a recording's results: a hash of its bytes, of settings and of version, but not of its path.

    Raises
    ------
    OSError
        The recording cannot be read.
    """
    total = hashlib.sha256()
    for text in (version, settings):
        total.update(text.encode() + b"\0")
    files = sorted(one for one in path.iterdir() if one.is_file()) if path.is_dir() else [path]
    for file in files:
        # Skip metadata.yaml, which repeats the content of the other files, with names that change if a folder moves.
        if file.name == "metadata.yaml" and len(files) > 1:
            continue
        total.update(file.stat().st_size.to_bytes(8, "little"))
        with os.fdopen(open_regular(file), "rb") as opened:
            while chunk := opened.read(_CHUNK):
                total.update(chunk)
    return total.hexdigest()[:32]


def write(folder: Path, key: str, tables: Mapping[str, list[dict[str, Any]]]) -> None:
    """
    Write the rows of one recording, by table; the table `bags` must be given and is written last.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    for name in TABLES:
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        # Use a unique name for each writer, because two tasks may process the same recording.
        draft = place / f".{key}.{uuid.uuid4().hex}.unfinished"
        table = pa.Table.from_pylist(tables.get(name, []), schema=SCHEMAS[name])
        try:
            parquet.write_table(table, draft, compression="zstd")
            draft.replace(place / f"{key}.parquet")
        finally:
            draft.unlink(missing_ok=True)


def finished(folder: Path, key: str) -> dict[str, Any] | None:
    """Return the row of a recording in table `bags`; None if there is no readable row, or the processing failed."""
    file = folder / "bags" / f"{key}.parquet"
    if not file.is_file():
        return None
    try:
        (row,) = parquet.ParquetFile(file).read().to_pylist()
    except (pa.ArrowException, ValueError):
        # The file is damaged, so process the recording again.
        return None
    found: dict[str, Any] = row
    return found if found["outcome"] == DONE else None


def tidy(folder: Path, keys: Mapping[str, str]) -> int:
    """
    Delete unfinished files, results without a row in `bags`, and earlier results of the given recordings.

    keys: present key of each recording, by its path. Return the number of deleted files.
    """
    going: list[Path] = []
    for name in TABLES:
        going += (folder / name).glob(".*.unfinished")
    for file in (folder / "bags").glob("*.parquet"):
        row = parquet.ParquetFile(file).read(["key", "bag"]).to_pylist()[0]
        if keys.get(row["bag"], row["key"]) != row["key"] and row["key"] not in keys.values():
            going.append(file)
    kept = {file.name for file in (folder / "bags").glob("*.parquet")} - {file.name for file in going}
    for name in TABLES[:-1]:
        going += (file for file in (folder / name).glob("*.parquet") if file.name not in kept)
    for file in going:
        file.unlink(missing_ok=True)
    return len(going)
