# SPDX-License-Identifier: Apache-2.0
"""Attitude as CSV and as Parquet: exact digits, nothing for the unknown, the same bytes in one block or many."""

import csv
import io
import itertools
import math
from contextlib import closing

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.processing import attitude_csv, attitude_parquet

ANGLES = ("inclination", "azimuth", "gravity_toolface")
SIGMAS = tuple(f"sigma_{name}" for name in ANGLES)


def samples(n, seed=1):
    rng = np.random.default_rng(seed)
    attitude, gravity = wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n)
    attitude["stamp_ns"] = gravity["stamp_ns"] = 1_772_344_800_000_000_000 + np.arange(n) * 10_000_000
    for angle, sigma in zip(ANGLES, SIGMAS, strict=True):
        attitude[angle], attitude[sigma] = rng.uniform(0.0, math.pi, n), rng.uniform(0.0, 0.1, n)
    gravity["gravity"] = rng.normal(size=(n, 3)) / 2.0
    attitude["status"], attitude["north"] = rng.choice([0, 2, 66, 65664], n), int(North.TRUE)
    return attitude, gravity


def cells(attitude, gravity):
    return [line.split(",") for line in bytes(attitude_csv.CsvLines()(attitude, gravity)).decode().splitlines()]


def test_numbers_read_back_to_half_of_their_last_digit():
    attitude, gravity = samples(300)
    lines = cells(attitude, gravity)
    assert [int(line[0]) for line in lines] == attitude["stamp_ns"].tolist()
    for column, name in enumerate((*ANGLES, *SIGMAS), 1):
        read = np.array([float(line[column]) for line in lines])
        np.testing.assert_allclose(read, np.degrees(attitude[name]), rtol=0.0, atol=0.51e-6)
    read = np.array([[float(cell) for cell in line[7:10]] for line in lines])
    np.testing.assert_allclose(read, gravity["gravity"], rtol=0.0, atol=0.51e-9)


def test_blocks_give_the_bytes_of_the_whole():
    attitude, gravity = samples(100)
    whole = bytes(attitude_csv.CsvLines()(attitude, gravity))
    cuts = [0, 1, 2, 40, 99, 100]
    pieces = [bytes(attitude_csv.CsvLines()(attitude[a:b], gravity[a:b])) for a, b in itertools.pairwise(cuts)]
    assert b"".join(pieces) == whole
    assert bytes(attitude_csv.CsvLines()(attitude[:0], gravity[:0])) == b""


def test_what_is_unknown_is_an_empty_cell():
    attitude, gravity = samples(2)
    attitude["sigma_azimuth"][0] = np.nan
    for name in ("sigma_inclination", "sigma_gravity_toolface"):
        attitude[name][1] = np.nan
    gravity["sigma"][1] = np.nan
    first, second = cells(attitude, gravity)
    assert (first[2], first[5]) == ("", "")
    assert "" not in (first[1], first[3], first[4])
    assert [second[k] for k in (1, 3, 4, 6, 7, 8, 9)] == [""] * 7


def test_status_is_words_joined_by_bars():
    attitude, gravity = samples(3)
    attitude["status"] = [0, int(Status.STILL), int(Status.STILL | Status.NO_MAG)]
    assert [line[10] for line in cells(attitude, gravity)] == ["", "still", "still|no_mag"]


def test_an_angle_that_rounds_to_the_full_circle_is_north():
    attitude, gravity = samples(1)
    attitude["azimuth"] = attitude["gravity_toolface"] = math.tau - 1e-12
    attitude["inclination"] = math.pi
    line = cells(attitude, gravity)[0]
    assert line[1:4] == ["180.000000", "0.000000", "0.000000"]


@given(
    value=st.floats(-1.0, 1.0), stamp=st.integers(-(2**62) + 1, 2**62), angle=st.floats(0.0, math.tau, exclude_max=True)
)
def test_any_number_reads_back(value, stamp, angle):
    attitude, gravity = samples(1)
    attitude["stamp_ns"], attitude["inclination"], gravity["gravity"][0, 1] = stamp, angle / 2.0, value
    line = cells(attitude, gravity)[0]
    assert line[0] == str(stamp)
    assert abs(float(line[1]) - math.degrees(angle / 2.0)) < 0.51e-6
    assert abs(float(line[8]) - value) < 0.51e-9


def parquet(path, attitude, gravity, block):
    """A Parquet file, written in blocks."""
    with closing(attitude_parquet.ParquetWriter(path)) as writer:
        for k in range(0, len(attitude) + 1, block):
            writer.write(attitude[k : k + block], gravity[k : k + block])
    return pq.ParquetFile(path)


@pytest.mark.slow
def test_parquet_holds_the_cells_of_the_csv(tmp_path):
    attitude, gravity = samples(500)
    for name in SIGMAS:
        attitude[name][::7] = np.nan
    gravity["sigma"][::11] = np.nan
    table = parquet(tmp_path / "a.parquet", attitude, gravity, 125).read()
    text = attitude_csv.HEADER + "\n" + bytes(attitude_csv.CsvLines()(attitude, gravity)).decode()
    assert table.column_names == [*attitude_csv.HEADER.split(","), "north"]
    for line, row in zip(csv.DictReader(io.StringIO(text)), table.to_pylist(), strict=True):
        assert row.pop("north") == "true"
        assert row.pop("status") == line.pop("status")
        assert row.pop("stamp_ns") == int(line.pop("stamp_ns"))
        assert line.keys() == row.keys()
        for name, cell in line.items():
            assert (row[name] is None) == (cell == "")
            assert cell == "" or row[name] == pytest.approx(float(cell), abs=6e-7)


def test_row_groups_of_parquet_are_written_as_they_fill(tmp_path, monkeypatch):
    monkeypatch.setattr(attitude_parquet, "_GROUP_ROWS", 200)
    attitude, gravity = samples(500)
    attitude["status"] = np.where(np.arange(500) < 100, int(Status.STILL), int(Status.ROTATING | Status.NO_MAG))
    file = parquet(tmp_path / "a.parquet", attitude, gravity, 100)
    assert [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)] == [200, 200, 100]
    assert set(file.read().column("status").to_pylist()) == {"still", "rotating|no_mag"}
