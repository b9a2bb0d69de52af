# SPDX-License-Identifier: Apache-2.0
"""Files that others read, possibly while they are written: the old one or the new one is there at every moment."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def write_whole(path: Path, data: bytes | str, *, lasting: bool = True) -> None:
    """
    Write or replace a file by one rename.

    Parameters
    ----------
    path : Path
    data : bytes or str
        Text is written as UTF-8.
    lasting : bool
        Return only when the disk has it, so that a power cut leaves the old or the new file. False for what is
        written again within seconds.

    Raises
    ------
    OSError
        There is no such folder, or the disk refuses; the file that was there is untouched.
    """
    draft = path.with_name(f".{path.name}.writing")
    try:
        with draft.open("wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        draft.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
    if lasting:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """
    Make the disk hold the names in a folder.

    Raises
    ------
    OSError
        It refuses.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
