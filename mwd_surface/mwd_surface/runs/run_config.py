# SPDX-License-Identifier: Apache-2.0
"""config.yaml of a run: every setting in force, written so that it can be read back and used again."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import yaml

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings as settings_of
from mwd_sensors.core.input_files import read_yaml
from mwd_surface.runs.bag_input import InputSettings, Topics
from mwd_surface.runs.run_output import OutputSettings


def config_text(estimator: EstimatorSettings, given: InputSettings, wanted: OutputSettings, topics: Topics) -> str:
    """config.yaml: every setting in force, ready for --config; what was read and how stands in comments."""
    head = ["# Settings in force; use them again with: mwd process BAG --config config.yaml"]
    head += [f"# {name}: {value}" for name, value in dataclasses.asdict(topics).items() if value]
    for used, default in ((given, InputSettings()), (wanted, OutputSettings())):
        head += [
            f"# {field.name}: {getattr(used, field.name)}"
            for field in dataclasses.fields(used)
            if not field.name.endswith("_topic") and getattr(used, field.name) != getattr(default, field.name)
        ]
    body: str = yaml.safe_dump(settings_of.to_mapping(estimator), sort_keys=False)
    return "\n".join(head) + "\n" + body


def read_config(path: Path) -> dict[str, Any]:
    """
    Settings of a YAML file: as config.yaml has them, or as a ROS parameter file gives them to the estimator node.

    Raises
    ------
    SettingsError
        It is not YAML, or not a table.
    OSError
        It cannot be read.
    """
    table = read_yaml(path)
    if table is None:
        return {}
    if isinstance(table, dict):
        for node in table.values():
            if isinstance(node, dict) and isinstance(node.get("ros__parameters"), dict):
                return _nested(node["ros__parameters"])
        return _nested(table)
    raise settings_of.SettingsError(f"{path}: expected a table of settings, got {table!r}")


def _nested(table: dict[str, Any]) -> dict[str, Any]:
    """Dotted names, as ROS writes them, as tables in tables."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        *parents, leaf = str(key).split(".")
        place = out
        for parent in parents:
            place = place.setdefault(parent, {})
        place[leaf] = _nested(value) if isinstance(value, dict) else value
    return out
