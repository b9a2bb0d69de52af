# SPDX-License-Identifier: Apache-2.0
"""Results of a run appear complete or not at all, and are no one else's files."""

import numpy as np
import pytest

from mwd_estimation.pipeline.output import Output
from mwd_sensors.core import wire
from mwd_sensors.core.settings import SettingsError, from_mapping
from mwd_surface.processing import run_folder, run_output
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.run_output import OutputSettings, destination, drafts

START = 1_772_344_800_000_000_000


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_what_was_written_appears_when_the_block_ends_with_the_mode_of_any_new_folder(tmp_path):
    out = tmp_path / "deep" / "out"
    with drafts(out) as draft:
        (draft / "a.csv").write_text("1")
        assert not out.exists()
    assert (out / "a.csv").read_text() == "1"
    assert names(tmp_path / "deep") == ["out"]
    (tmp_path / "usual").mkdir()
    assert out.stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_after_an_error_there_is_nothing_new_and_all_that_was_there(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.csv").write_text("old")

    def interrupted():
        with drafts(tmp_path / "out") as draft:
            (draft / "a.csv").write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "a.csv").read_text() == "old"


def test_older_results_are_replaced_and_other_files_left_alone(tmp_path):
    (tmp_path / "out" / "merged").mkdir(parents=True)
    (tmp_path / "out" / "merged" / "old.mcap").write_text("old")
    (tmp_path / "out" / "a.csv").write_text("old")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    with drafts(tmp_path / "out") as draft:
        (draft / "a.csv").write_text("new")
        (draft / "merged").mkdir()
        (draft / "merged" / "new.mcap").write_text("new")
    assert (tmp_path / "out" / "a.csv").read_text() == "new"
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert names(tmp_path / "out" / "merged") == ["new.mcap"]


def test_a_file_in_the_place_of_the_folder_is_not_touched(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(NotADirectoryError, match="a file, not a folder"), drafts(tmp_path / "out"):
        pass
    assert (tmp_path / "out").read_text() == "mine"
    assert names(tmp_path) == ["out"]


def test_a_format_that_is_not_written_is_refused():
    with pytest.raises(SettingsError, match="one of csv, parquet, mcap"):
        from_mapping(OutputSettings, {"format": "xlsx"})


@pytest.mark.parametrize(("format_", "expected"), [("csv", "attitude.csv"), ("parquet", "attitude.parquet")])
def test_attitude_goes_into_the_file_of_its_format_at_the_rate_asked_for(tmp_path, format_, expected):
    with destination(tmp_path, None, OutputSettings(format=format_, rate_hz=10.0), InputSettings()) as (sink, merger):
        for block in range(3):
            attitude, gravity = wire.ATTITUDE.empty(100), wire.GRAVITY.empty(100)
            attitude["stamp_ns"] = gravity["stamp_ns"] = START + (np.arange(100) + 100 * block) * 10_000_000
            sink(Output(attitude, gravity, wire.INTERFERENCE.empty(0), []))
    assert merger is None
    assert names(tmp_path) == [expected]
    stamps = np.concatenate([rows["stamp_ns"] for rows in run_folder.attitude(tmp_path)])
    assert stamps.tolist() == [START + k * 100_000_000 for k in range(30)]


def test_a_folder_never_holds_the_results_of_two_runs(tmp_path):
    out = tmp_path / "out"
    for names in (("attitude.parquet", "surveys.csv"), ("attitude.csv", "config.yaml")):
        with run_output.drafts(out) as draft:
            for name in names:
                (draft / name).write_text(name)
    assert sorted(path.name for path in out.iterdir()) == ["attitude.csv", "config.yaml"]
