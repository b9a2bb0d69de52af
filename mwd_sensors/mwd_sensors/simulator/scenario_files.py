# SPDX-License-Identifier: Apache-2.0
"""Where the scenarios that come with the project lie, and finding one by its name."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mwd_sensors.core.settings import SettingsError, unknown_key

_SHARE = Path("share", "mwd_sensors", "scenarios")
# <root>/mwd_sensors/mwd_sensors/scenario_files.py: in a checkout they lie in <root>/bags.
_SOURCES = Path(__file__).resolve().parents[3] / "bags" / "scenarios"


def folder() -> Path:
    """
    Folder of the scenarios: of the source tree around us, whose edits count at once, else where they are installed.

    Raises
    ------
    SettingsError
        There is none.
    """
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    installed = [Path(prefix) / _SHARE for prefix in prefixes if prefix]
    for place in (_SOURCES, *installed):
        if place.is_dir():
            return place
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
