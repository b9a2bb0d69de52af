# SPDX-License-Identifier: Apache-2.0
"""Files written whole: text and bytes, and what is left when the disk refuses."""

from pathlib import Path

import pytest

from mwd_sensors.core.output_files import write_whole


@pytest.mark.parametrize("lasting", [True, False])
def test_a_file_is_made_and_replaced(tmp_path, lasting):
    path = tmp_path / "list.csv"
    write_whole(path, b"first", lasting=lasting)
    write_whole(path, "second °C", lasting=lasting)
    assert path.read_bytes() == "second °C".encode()
    assert list(path.parent.iterdir()) == [path]


def test_a_disk_that_refuses_leaves_the_old_file_and_no_draft(tmp_path, monkeypatch):
    path = tmp_path / "list.csv"
    write_whole(path, "old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, "new")
    assert [(found, found.read_text()) for found in tmp_path.iterdir()] == [(path, "old")]


def test_a_folder_that_is_not_there_is_the_caller_s_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="gone"):
        write_whole(tmp_path / "gone" / "list.csv", "")
