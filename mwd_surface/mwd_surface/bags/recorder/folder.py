# SPDX-License-Identifier: Apache-2.0
"""The folder of recordings: its lock, and the names of new recordings."""

from __future__ import annotations

import datetime
import itertools
from pathlib import Path

from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from mwd_surface.bags.recorder.status import RecorderError

LOCK_NAME = ".recorder.lock"


def locked(folder: Path) -> FolderLock:
    """
    Lock a folder for one recorder, creating it where it is missing.

    Raises
    ------
    RecorderError
        It cannot be written, or another recorder uses it.
    """
    try:
        return FolderLock(folder, LOCK_NAME)
    except OSError as error:
        raise RecorderError(f"recordings cannot be written to {folder}: {error.strerror}") from error
    except FolderTakenError as error:
        raise RecorderError(
            f"another recorder (process {error.owner}) writes into {folder}; stop it or choose another folder"
        ) from None


def recording_path(folder: Path, name: str, prefix: str) -> Path:
    """
    Return the path of a new recording: `name`, or where it is empty the prefix and the time of day.

    A name that is taken gets _2, _3 and so on: what starts again after a crash records again, and overwrites nothing.

    Raises
    ------
    RecorderError
        It is no plain name.
    """
    if name and (name != Path(name).name or name.startswith(".") or not name.isprintable()):
        raise RecorderError(f"{name!r} is no plain name for a recording", "give a name without slashes")
    base = name or f"{prefix}_{datetime.datetime.now(datetime.UTC):%Y%m%dT%H%M%SZ}"
    paths = (folder / base if k == 1 else folder / f"{base}_{k}" for k in itertools.count(1))
    return next(path for path in paths if not path.exists())


def recordings_named(folder: Path, name: str) -> list[Path]:
    """Return the recordings of a folder that were given this name, in their order: `name`, `name`_2 and so on."""
    paths = (folder / name if k == 1 else folder / f"{name}_{k}" for k in itertools.count(1))
    return list(itertools.takewhile(Path.exists, paths))
