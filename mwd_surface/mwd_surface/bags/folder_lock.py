# SPDX-License-Identifier: Apache-2.0
"""One process at a time in a folder: a lock that the system frees when its owner ends, however it ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path


class FolderTakenError(Exception):
    """Another process has the folder; `owner` is its number in words."""

    def __init__(self, folder: Path, owner: str) -> None:
        super().__init__(f"process {owner} has {folder}")
        self.owner = owner


class FolderLock:
    """
    The lock of a folder, held until `free`; the folder is made where it is missing.

    Raises
    ------
    OSError
        The folder cannot be made or written.
    FolderTakenError
        Another process, or another object of this one, holds it.
    """

    def __init__(self, folder: Path, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._handle = os.open(folder / name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            owner = os.pread(self._handle, 32, 0).decode(errors="replace").strip()
            os.close(self._handle)
            raise FolderTakenError(folder, owner or "unknown") from None
        with contextlib.suppress(OSError):
            # Only a courtesy to whoever comes next; the lock itself needs no content.
            os.ftruncate(self._handle, 0)
            os.pwrite(self._handle, str(os.getpid()).encode(), 0)

    def free(self) -> None:
        """Give the folder free; once."""
        os.close(self._handle)
