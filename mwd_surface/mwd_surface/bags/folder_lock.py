# SPDX-License-Identifier: Apache-2.0
"""A lock that admits one process at a time to a folder; the operating system releases it when the process ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path


class FolderTakenError(Exception):
    """Raised if another process holds the lock of a folder; `owner` is its process number."""

    def __init__(self, folder: Path, owner: str) -> None:
        super().__init__(f"process {owner} has {folder}")
        self.owner = owner


class FolderLock:
    """
    Lock of a folder, held until `free` is called; a missing folder is created.

    name : name of the lock file in the folder.

    Raises
    ------
    OSError
        The folder cannot be created or written.
    FolderTakenError
        Another process, or another object of this process, holds the lock.
    """

    def __init__(self, folder: Path, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._handles: list[int] = []
        try:
            # Lock the folder too, because somebody may delete the lock file while the lock is held. Some network file
            # systems cannot lock folders; then only the file is locked.
            self._lock(os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC), needed=False)
            # Do not follow a link: the process number would replace the content of the file it leads to.
            file = os.open(folder / name, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            self._lock(file, needed=True)
        except BlockingIOError:
            self.free()
            raise FolderTakenError(folder, _owner(folder / name)) from None
        except OSError:
            self.free()
            raise
        with contextlib.suppress(OSError):
            # Write the process number for the error of other processes; the lock itself needs no content.
            os.ftruncate(file, 0)
            os.pwrite(file, str(os.getpid()).encode(), 0)

    def _lock(self, handle: int, *, needed: bool) -> None:
        self._handles.append(handle)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            if needed:
                raise

    def free(self) -> None:
        """Release the lock; further calls do nothing."""
        while self._handles:
            os.close(self._handles.pop())


def _owner(path: Path) -> str:
    """Return the process number in the file of a lock, or "unknown" if the file is missing or empty."""
    try:
        with path.open("rb") as file:
            return file.read(32).decode(errors="replace").strip() or "unknown"
    except OSError:
        return "unknown"
