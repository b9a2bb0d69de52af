# SPDX-License-Identifier: Apache-2.0
"""A lock that admits one process at a time to a folder; the system releases it however the owner ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path


class FolderTakenError(Exception):
    """Another process holds the folder; `owner` names its process number."""

    def __init__(self, folder: Path, owner: str) -> None:
        super().__init__(f"process {owner} has {folder}")
        self.owner = owner


class FolderLock:
    """
    Lock of a folder, held until `free` is called; a missing folder is created.

    Raises
    ------
    OSError
        The folder cannot be created or written.
    FolderTakenError
        Another process, or another object of this process, holds the lock.
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
            # The process number is for the message to the next process; the lock itself needs no content.
            os.ftruncate(self._handle, 0)
            os.pwrite(self._handle, str(os.getpid()).encode(), 0)

    def free(self) -> None:
        """Release the folder; further calls do nothing."""
        os.close(self._handle)
