# SPDX-License-Identifier: Apache-2.0
"""Write files that others may read at any moment: a reader finds the old file or the new one, never a part."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def write_whole(path: Path, data: bytes | str, *, lasting: bool = True) -> None:
    """
    Write or replace a file with a single rename.

    Parameters
    ----------
    data : bytes or str
        Text is written as UTF-8.
    lasting : bool
        Return only when the disk has stored the file, so that a power cut leaves the old or the new file. Use False for
        files that are written again within seconds.

    Raises
    ------
    OSError
        The folder does not exist or the disk cannot store the file. `path` is then the old file or, if only the sync of
        the folder failed, the new file.
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
    Store the file names of a folder on the disk (fsync), so that they survive a power cut.

    Raises
    ------
    OSError
        The folder cannot be opened or synced.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
