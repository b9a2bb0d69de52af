# SPDX-License-Identifier: Apache-2.0
"""One owner of a folder at a time, named to whoever comes second, and free when the owner has ended."""

import os
import subprocess
import sys

import pytest

from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from project import ROOT


def test_a_second_owner_is_refused_with_the_name_of_the_first(tmp_path):
    first = FolderLock(tmp_path / "new", ".lock")
    with pytest.raises(FolderTakenError, match=f"process {os.getpid()} has"):
        FolderLock(tmp_path / "new", ".lock")
    first.free()
    FolderLock(tmp_path / "new", ".lock").free()


def test_a_killed_owner_leaves_the_folder_free(tmp_path):
    words = [sys.executable, ROOT / "mwd_surface" / "test" / "programs" / "own_folder.py", tmp_path]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as owner:
        assert owner.stdout.readline() == b"mine\n"
        with pytest.raises(FolderTakenError) as refused:
            FolderLock(tmp_path, ".lock")
        assert refused.value.owner == str(owner.pid)
        owner.kill()
        owner.wait()
    FolderLock(tmp_path, ".lock").free()


@pytest.mark.fault_case(99)
@pytest.mark.parametrize("gone", ["deleted", "replaced", "renamed"])
def test_a_lock_whose_file_is_deleted_by_hand_still_holds(tmp_path, gone):
    first = FolderLock(tmp_path, ".lock")
    if gone == "renamed":
        (tmp_path / ".lock").rename(tmp_path / "old")
    else:
        (tmp_path / ".lock").unlink()
    if gone == "replaced":
        (tmp_path / ".lock").write_text("")
    with pytest.raises(FolderTakenError, match="process unknown has"):
        FolderLock(tmp_path, ".lock")
    first.free()
    FolderLock(tmp_path, ".lock").free()


@pytest.mark.fault_case(99)
def test_a_lock_that_is_a_link_changes_no_other_file(tmp_path):
    (tmp_path / "other").write_text("content")
    (tmp_path / ".lock").symlink_to(tmp_path / "other")
    with pytest.raises(OSError, match="lock"):
        FolderLock(tmp_path, ".lock")
    assert (tmp_path / "other").read_text() == "content"


def test_a_folder_that_cannot_be_made_is_the_systems_own_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        FolderLock(tmp_path / "file" / "below", ".lock")
