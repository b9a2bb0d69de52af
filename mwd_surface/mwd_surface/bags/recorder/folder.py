# SPDX-License-Identifier: Apache-2.0
"""The folder of recordings: its lock, and the names of new recordings."""

from __future__ import annotations

import datetime
import itertools
from pathlib import Path

from mwd_sensors.core.foreign_text import unprintable
from mwd_surface.bags.folder_lock import FolderLock, FolderTakenError
from mwd_surface.bags.recorder.status import RecorderError

LOCK_NAME = ".recorder.lock"


def locked(folder: Path) -> FolderLock:
    """
    Lock a folder for one recorder; create the folder if it is missing.

    Raises
    ------
    RecorderError
        The folder cannot be written, or another recorder uses it.
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
    Return the path of a new recording, named `name` or, if `name` is empty, by prefix, date and time (UTC).

    A name in use gets the suffix _2, _3 and so on: a node restarted after a crash records again and overwrites nothing.

    Raises
    ------
    RecorderError
        `name` contains a slash or another character that is not allowed, or begins with a dot.
    """
    if name and (name != Path(name).name or name.startswith(".") or unprintable(name)):
        raise RecorderError(f"{name!r} is not a plain name for a recording", "give a name without slashes")
    base = name or f"{prefix}_{datetime.datetime.now(datetime.UTC):%Y%m%dT%H%M%SZ}"
    paths = (folder / base if k == 1 else folder / f"{base}_{k}" for k in itertools.count(1))
    return next(path for path in paths if not path.exists())


def recordings_named(folder: Path, name: str) -> list[Path]:
    """Return the recordings in a folder that `recording_path` named `name`, `name`_2 and so on, oldest first."""
    paths = (folder / name if k == 1 else folder / f"{name}_{k}" for k in itertools.count(1))
    return list(itertools.takewhile(Path.exists, paths))
