# SPDX-License-Identifier: Apache-2.0
"""Find by name the scenarios that come with the project."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mwd_sensors.core.settings import SettingsError, unknown_key

_SHARE = Path("share", "mwd_sensors", "scenarios")
# In a checkout the scenarios are in <root>/bags, and this file is in <root>/mwd_sensors/mwd_sensors/simulator.
_SOURCES = Path(__file__).resolve().parents[3] / "bags" / "scenarios"


def folder() -> Path:
    """
    Return the folder of the scenarios: the folder in the source tree if it exists, else the installed folder.

    Raises
    ------
    SettingsError
        Neither folder exists.
    """
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    installed = [Path(prefix) / _SHARE for prefix in prefixes if prefix]
    for place in (_SOURCES, *installed):
        if place.is_dir():
            return place
    raise SettingsError("scenario: the scenarios of mwd_sensors are not installed; give the path of a YAML file")


def names() -> dict[str, Path]:
    """Return name -> file of every scenario that comes with the project; benchmark scenarios are ``bench/NAME``."""
    root = folder()
    return {str(path.relative_to(root).with_suffix("")): path for path in sorted(root.rglob("*.yaml"))}


def find(name: str) -> Path:
    """
    Return the file of a scenario that is given by path or by name.

    Raises
    ------
    SettingsError
        `name` is neither a file nor a known scenario; the message suggests similar names.
    """
    if Path(name).is_file():
        return Path(name)
    known = names()
    if name not in known:
        raise SettingsError(unknown_key(name, known, "").replace("no such setting", "no such scenario or file"))
    return known[name]
