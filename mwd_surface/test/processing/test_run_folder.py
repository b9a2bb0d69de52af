# SPDX-License-Identifier: Apache-2.0
"""What `mwd process` left is read back alike from CSV and Parquet, and what is no run is reported as such."""

import csv
from contextlib import closing

import numpy as np
import pytest

from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_surface.processing import attitude_csv, attitude_parquet, run_folder

ROWS = 5


def written(folder, kind, rows=ROWS):
    """A run of a few rows, of which the last knows nothing."""
    folder.mkdir()
    attitude, gravity = wire.ATTITUDE.empty(rows), wire.GRAVITY.empty(rows)
    stamps = 1_772_344_800_000_000_000 + np.arange(rows) * 10_000_000
    attitude["stamp_ns"] = gravity["stamp_ns"] = stamps
    for name, degrees in (("inclination", 30.0), ("azimuth", 359.5), ("gravity_toolface", 120.0)):
        attitude[name] = np.radians(degrees)
    for name in ("sigma_inclination", "sigma_azimuth", "sigma_gravity_toolface"):
        attitude[name] = 0.01
    gravity["gravity"] = [0.6, 0.0, 0.8]
    gravity["sigma"] = 0.001
    attitude["status"] = Status.STILL
    if rows:
        for name in ("sigma_inclination", "sigma_azimuth", "sigma_gravity_toolface"):
            attitude[name][-1] = np.nan
        gravity["sigma"][-1] = np.nan
        attitude["status"][-1] = Status.INITIALISING | Status.NO_MAG
    if kind == "parquet":
        with closing(attitude_parquet.ParquetWriter(folder / "attitude.parquet")) as writer:
            writer.write(attitude, gravity)
    else:
        lines = attitude_csv.CsvLines()(attitude, gravity)
        (folder / "attitude.csv").write_bytes(attitude_csv.HEADER.encode() + b"\n" + lines)
    with (folder / "surveys.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("sequence", "verdict"), ("1", "accept"), ("2", "reject")])
    return folder, stamps


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_attitude_comes_back_from_either_kind_of_file(tmp_path, kind):
    folder, stamps = written(tmp_path / "run", kind)
    assert run_folder.is_run(folder)
    assert run_folder.attitude_file(folder) == folder / f"attitude.{kind}"
    (rows,) = run_folder.attitude(folder)
    assert rows["stamp_ns"].tolist() == stamps.tolist()
    assert rows["stamp_ns"].dtype == np.int64
    for name, degrees in zip(run_folder.ANGLES, (30.0, 359.5, 120.0), strict=True):
        assert rows[name][:-1] == pytest.approx(degrees, abs=1e-4)
        assert np.isnan(rows[name][-1])
    assert rows["gravity"].shape == (ROWS, 3)
    assert rows["gravity"][0] == pytest.approx([0.6, 0.0, 0.8], abs=1e-5)
    assert np.isnan(rows["gravity"][-1]).all()
    assert rows["status"][0] == "still"
    assert set(rows["status"][-1].split("|")) == {"initialising", "no_mag"}


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_long_run_comes_in_blocks_in_the_order_of_the_file(tmp_path, kind):
    folder, stamps = written(tmp_path / "run", kind, rows=200_000)
    blocks = [block["stamp_ns"] for block in run_folder.attitude(folder)]
    assert len(blocks) > 1
    assert (np.concatenate(blocks) == stamps).all()


def test_surveys_are_lines_by_column(tmp_path):
    folder, _ = written(tmp_path / "run", "csv")
    assert [line["verdict"] for line in run_folder.surveys(folder)] == ["accept", "reject"]


def test_of_both_kinds_the_parquet_file_is_taken(tmp_path):
    folder, _ = written(tmp_path / "run", "csv")
    other, _ = written(tmp_path / "other", "parquet")
    (other / "attitude.parquet").rename(folder / "attitude.parquet")
    assert run_folder.attitude_file(folder) == folder / "attitude.parquet"


def test_a_folder_without_attitude_or_surveys_is_no_run(tmp_path):
    assert not run_folder.is_run(tmp_path)
    folder, _ = written(tmp_path / "run", "csv")
    (folder / "surveys.csv").unlink()
    assert not run_folder.is_run(folder)
    with pytest.raises(FileNotFoundError):
        run_folder.surveys(folder)
    (folder / "attitude.csv").unlink()
    with pytest.raises(FileNotFoundError, match=r"attitude\.csv or attitude\.parquet"):
        list(run_folder.attitude(folder))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("attitude.csv", b"time,angle\n1,2\n"),
        ("attitude.csv", b""),
        ("attitude.csv", attitude_csv.HEADER.encode() + b"\nnoon" + b",0" * attitude_csv.HEADER.count(",") + b"\n"),
        ("attitude.parquet", b"PAR1 half a file"),
    ],
)
def test_a_file_of_another_kind_is_named(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"{name} is not what `mwd process` writes"):
        list(run_folder.attitude(tmp_path))
