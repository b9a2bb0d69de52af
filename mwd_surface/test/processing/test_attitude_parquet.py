# SPDX-License-Identifier: Apache-2.0
"""Attitude as Parquet against the CSV of the same samples."""

import csv
import io
import math
from contextlib import closing

import numpy as np
import pyarrow.parquet as pq
import pytest

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.processing import attitude_csv, attitude_parquet


def _samples(n=500):
    rng = np.random.default_rng(1)
    attitude, gravity = wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n)
    attitude["stamp_ns"] = gravity["stamp_ns"] = 1_700_000_000 * 10**9 + np.arange(n) * 10**6
    for name, top in (("inclination", math.pi), ("azimuth", 6.28), ("gravity_toolface", 6.28)):
        attitude[name] = rng.uniform(0.0, top, n)
        attitude[f"sigma_{name}"] = np.where(np.arange(n) % 7 == 0, np.nan, rng.uniform(0.0, 0.1, n))
    gravity["gravity"] = rng.normal(size=(n, 3))
    gravity["sigma"] = np.where(np.arange(n) % 11 == 0, np.nan, 0.01)
    attitude["status"] = np.where(np.arange(n) < 100, int(Status.STILL), int(Status.ROTATING | Status.NO_MAG))
    attitude["north"] = 2
    return attitude, gravity


@pytest.mark.slow
def test_parquet_holds_the_cells_of_the_csv(tmp_path):
    attitude, gravity = _samples()
    with closing(attitude_parquet.ParquetWriter(tmp_path / "a.parquet")) as writer:
        for k in range(0, 500, 120):
            writer.write(attitude[k : k + 120], gravity[k : k + 120])
        writer.write(attitude[:0], gravity[:0])
    table = pq.read_table(tmp_path / "a.parquet")
    text = attitude_csv.HEADER + "\n" + bytes(attitude_csv.CsvLines()(attitude, gravity)).decode()
    lines = list(csv.DictReader(io.StringIO(text)))
    assert table.column_names == [*attitude_csv.HEADER.split(","), "north"]
    for line, row in zip(lines, table.to_pylist(), strict=True):
        assert row.pop("north") == "true"
        assert row.pop("status") == line.pop("status")
        assert row.pop("stamp_ns") == int(line.pop("stamp_ns"))
        for name, cell in line.items():
            assert (row[name] is None) == (cell == "")
            if cell:
                assert row[name] == pytest.approx(float(cell), abs=6e-7)


def test_row_groups_are_written_as_they_fill(tmp_path, monkeypatch):
    monkeypatch.setattr(attitude_parquet, "_GROUP_ROWS", 200)
    attitude, gravity = _samples()
    with closing(attitude_parquet.ParquetWriter(tmp_path / "a.parquet")) as writer:
        for k in range(0, 500, 100):
            writer.write(attitude[k : k + 100], gravity[k : k + 100])
    file = pq.ParquetFile(tmp_path / "a.parquet")
    assert [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)] == [200, 200, 100]
    assert set(file.read().column("status").to_pylist()) == {"still", "rotating|no_mag"}
