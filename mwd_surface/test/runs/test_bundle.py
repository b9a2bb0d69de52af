# SPDX-License-Identifier: Apache-2.0
"""The zip for a bug report: what is in it, and what must not be."""

import zipfile

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs import bundle

START = 1_772_344_800_000_000_000
LATCHED = [{"history": "keep_last", "depth": 1, "reliability": "reliable", "durability": "transient_local"}]


@pytest.fixture
def run(tmp_path):
    """Folder of a run: ten minutes of recording, logs that name a token, settings."""
    folder = tmp_path / "run"
    (folder / "logs").mkdir(parents=True)
    (folder / "page_token").write_text("s3cret-word\n")
    (folder / "logs" / "surface.log").write_text("begin\nopened with s3cret-word\npage.token = other-word\nend\n")
    (folder / "config.yaml").write_text("survey:\n  duration_s: 8.0\n")
    samples = wire.IMU.empty(600)
    samples["stamp_ns"] = START + np.arange(600) * wire.NANOSECONDS
    rig = wire.RIG_STATE.empty(1)
    rig["stamp_ns"] = START
    with BagWriter(folder / "bags" / "one") as bag:
        imu = bag.topic("/imu/data_raw", wire.IMU.type_name)
        bag.write_rows(imu, wire.IMU.encode(samples, "x"), samples["stamp_ns"])
        table = bag.topic("/rig/state", wire.RIG_STATE.type_name, LATCHED)
        bag.write_rows(table, wire.RIG_STATE.encode(rig, "x"), rig["stamp_ns"])
        bag.add_metadata("parameters/surface", {"page.token": "other-word", "well.name": "7"})
    return folder


def test_the_bundle_has_versions_logs_settings_and_the_end_of_the_recording(run, tmp_path):
    target = tmp_path / "bundle.zip"
    made = bundle.write(run, target, 2.0, "mwd 1", {"ROS_DOMAIN_ID": "7", "HOME": "/home/me"})
    with zipfile.ZipFile(target) as packed:
        names = packed.namelist()
        packed.extractall(tmp_path / "out")
    assert made.names == names
    assert {"versions.txt", "doctor.txt", "environment.txt", "run/logs/surface.log", "run/config.yaml"} <= set(names)
    assert (tmp_path / "out" / "environment.txt").read_text() == "ROS_DOMAIN_ID=7\n"
    with Bag(tmp_path / "out" / "recording") as bag:
        assert bag.topics["/imu/data_raw"].count == 121
        # The latched table of before is there too.
        assert bag.topics["/rig/state"].count == 1
        assert bag.metadata()["parameters/surface"] == {"well.name": "7"}


def test_a_file_that_goes_while_it_is_packed_is_named_and_the_rest_is_there(run, tmp_path, monkeypatch):
    (run / "logs" / "going.log").write_text("soon gone\n")
    opened = bundle.Path.open

    def opening(path, *args, **keywords):
        if path.name == "going.log":
            path.unlink()
        return opened(path, *args, **keywords)

    monkeypatch.setattr(bundle.Path, "open", opening)
    made = bundle.write(run, tmp_path / "bundle.zip", 2.0, "mwd 1", {})
    assert "run/logs/surface.log" in made.names
    assert "run/logs/going.log" not in made.names
    (remark,) = made.remarks
    assert "going.log is not in the bundle" in remark


def test_a_log_is_cut_between_lines(run, tmp_path, monkeypatch):
    monkeypatch.setattr(bundle, "_LOG_BYTES", len("other-word\nend\n"))
    target = tmp_path / "bundle.zip"
    bundle.write(run, target, 0.0, "mwd 1", {})
    with zipfile.ZipFile(target) as packed:
        assert packed.read("run/logs/surface.log") == b"end\n"


def test_nothing_secret_goes_into_it(run, tmp_path):
    target = tmp_path / "bundle.zip"
    bundle.write(run, target, 0.0, "mwd 1", {"MWD_PAGE_TOKEN": "third-word", "ROS_NOTE": "third-word"})
    with zipfile.ZipFile(target) as packed:
        everything = b"".join(packed.read(name) for name in packed.namelist()).decode()
        assert not any("token" in name for name in packed.namelist())
    for word in ("s3cret-word", "other-word", "third-word"):
        assert word not in everything
    assert "ROS_NOTE=***" in everything


def test_a_folder_that_is_not_there_is_named_and_one_without_recording_packed(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such run"):
        bundle.write(tmp_path / "none", tmp_path / "a.zip", 1.0, "", {})
    (tmp_path / "empty").mkdir()
    assert bundle.write(tmp_path / "empty", tmp_path / "a.zip", 1.0, "", {}).recording is None
