"""Where the scenarios that come with the project lie, and finding one by its name."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mwd_sensors.settings import SettingsError, unknown_key

_SHARE = Path("share", "mwd_sensors", "scenarios")


def folder() -> Path:
    """
    Installed folder of the scenarios.

    Raises
    ------
    SettingsError
        The package is not installed where ROS or this Python would look.
    """
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in prefixes:
        if prefix and (Path(prefix) / _SHARE).is_dir():
            return Path(prefix) / _SHARE
    raise SettingsError("scenario: the scenarios of mwd_sensors are not installed; give the path of a YAML file")


def names() -> dict[str, Path]:
    """Name -> file of every scenario that comes with the project; those of the benchmark as ``bench/NAME``."""
    root = folder()
    return {str(path.relative_to(root).with_suffix("")): path for path in sorted(root.rglob("*.yaml"))}


def find(name: str) -> Path:
    """
    File of a scenario given by path or by name.

    Raises
    ------
    SettingsError
        Neither a file nor a known name; the message names the near misses.
    """
    if Path(name).is_file():
        return Path(name)
    known = names()
    if name not in known:
        raise SettingsError(unknown_key(name, known, "").replace("no such setting", "no such scenario or file"))
    return known[name]
