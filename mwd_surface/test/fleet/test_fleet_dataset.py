# SPDX-License-Identifier: Apache-2.0
"""The data set of a fleet: whole files, named by content, nothing twice."""

import pyarrow.parquet as parquet
import pytest

from mwd_surface.fleet import fleet_dataset


def row(key, bag="a", outcome=fleet_dataset.DONE):
    return {"key": key, "bag": bag, "outcome": outcome, "surveys": 1}


def survey(key):
    return {"key": key, "bag": "a", "well": "", "sequence": 1, "azimuth_deg": None}


@pytest.mark.parametrize("times", [1, 2])
def test_rows_come_back_as_they_were_written_once_or_again(tmp_path, times):
    for _ in range(times):
        fleet_dataset.write(tmp_path, "k", {"bags": [row("k")], "surveys": [survey("k"), survey("k")]})
    assert fleet_dataset.finished(tmp_path, "k")["surveys"] == 1
    assert parquet.read_table(tmp_path / "bags").num_rows == 1
    assert parquet.read_table(tmp_path / "surveys").column("azimuth_deg").to_pylist() == [None, None]
    assert parquet.read_table(tmp_path / "attitude").num_rows == 0
    assert not list(tmp_path.rglob("*.unfinished"))


def test_a_failed_or_damaged_result_is_not_finished(tmp_path):
    assert fleet_dataset.finished(tmp_path, "k") is None
    fleet_dataset.write(tmp_path, "k", {"bags": [row("k", outcome=fleet_dataset.FAILED)]})
    assert fleet_dataset.finished(tmp_path, "k") is None
    (tmp_path / "bags" / "k.parquet").write_bytes(b"PAR1 half a file")
    assert fleet_dataset.finished(tmp_path, "k") is None


def test_tidying_takes_what_was_left_half_done_or_is_of_earlier_bytes(tmp_path):
    for key, bag in (("old", "a"), ("new", "a"), ("other", "b")):
        fleet_dataset.write(tmp_path, key, {"bags": [row(key, bag)], "surveys": [survey(key)]})
    (tmp_path / "bags" / ".x.unfinished").write_bytes(b"")
    # Cut off before its row in `bags` was written.
    fleet_dataset.write(tmp_path, "cut", {"bags": [row("cut")], "surveys": [survey("cut")]})
    (tmp_path / "bags" / "cut.parquet").unlink()
    fleet_dataset.tidy(tmp_path, {"a": "new"})
    assert sorted(parquet.read_table(tmp_path / "bags").column("key").to_pylist()) == ["new", "other"]
    assert sorted(parquet.read_table(tmp_path / "surveys").column("key").to_pylist()) == ["new", "other"]
    assert not list(tmp_path.rglob("*.unfinished"))


def test_the_key_changes_with_bytes_settings_and_version_only(tmp_path):
    bag = tmp_path / "one"
    bag.mkdir()
    (bag / "one.mcap").write_bytes(b"abc")
    (bag / "metadata.yaml").write_text("name: one")
    before = fleet_dataset.key_of(bag, "s", "1")
    moved = bag.rename(tmp_path / "two")
    (moved / "metadata.yaml").write_text("name: two")
    assert fleet_dataset.key_of(moved, "s", "1") == before
    assert fleet_dataset.key_of(moved, "t", "1") != before
    assert fleet_dataset.key_of(moved, "s", "2") != before
    (moved / "one.mcap").write_bytes(b"abd")
    assert fleet_dataset.key_of(moved, "s", "1") != before
