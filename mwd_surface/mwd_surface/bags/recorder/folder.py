"""The folder of recordings: its lock, and the names of new recordings."""

from __future__ import annotations

import datetime
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

    Raises
    ------
    RecorderError
        The name is taken or no plain name.
    """
    if name:
        if name != Path(name).name or name.startswith("."):
            raise RecorderError(f"{name!r} is no plain name for a recording")
        path = folder / name
        if path.exists():
            raise RecorderError(f"{path} exists already; choose another name")
        return path
    now = datetime.datetime.now(datetime.UTC)
    base = f"{prefix}_{now:%Y%m%dT%H%M%SZ}"
    names = [base, *(f"{base}_{k}" for k in range(2, 1000))]
    return next(folder / one for one in names if not (folder / one).exists())
