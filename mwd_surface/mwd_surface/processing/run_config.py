# SPDX-License-Identifier: Apache-2.0
"""config.yaml and input.yaml of a run: settings in force and how the input was read, for reading back and reuse."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import yaml

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import day_of
from mwd_sensors.core import settings as settings_of
from mwd_sensors.core.input_files import read_yaml
from mwd_surface.processing.bag_input import InputSettings, Topics
from mwd_surface.processing.half_imu import ImuKind
from mwd_surface.processing.run_output import CONFIG, INPUT, OutputSettings
from mwd_surface.surveys.recorded_settings import kept


def config_text(estimator: EstimatorSettings, given: InputSettings, wanted: OutputSettings, topics: Topics) -> str:
    """Return config.yaml: every setting in force, for --config; comments state the topics and options of the run."""
    head = ["# Settings in force; use them again with: mwd process BAG --config config.yaml"]
    head += [f"# {name}: {value}" for name, value in vars(topics).items() if value and value != ImuKind.WHOLE]
    for used, default in ((given, InputSettings()), (wanted, OutputSettings())):
        head += [
            f"# {field.name}: {getattr(used, field.name)}"
            for field in dataclasses.fields(used)
            if not field.name.endswith("_topic") and getattr(used, field.name) != getattr(default, field.name)
        ]
    body: str = yaml.safe_dump(settings_of.to_mapping(estimator), sort_keys=False)
    return "\n".join(head) + "\n" + body


def input_text(bag: Path, given: InputSettings, *, calibrated: bool) -> str:
    """Return input.yaml: the recording, how it was read, and whether a calibration was applied to it."""
    usual = settings_of.to_mapping(InputSettings())
    changed = {name: value for name, value in settings_of.to_mapping(given).items() if value != usual[name]}
    if given.depths:
        changed["depths"] = str(Path(given.depths).resolve())
    table = {"recording": str(bag.resolve()), "calibrated": calibrated, "input": changed}
    text: str = yaml.safe_dump(table, sort_keys=False)
    return text


@dataclasses.dataclass(frozen=True)
class _InputFile:
    """Table of input.yaml."""

    recording: str = settings_of.setting(doc="recording that was read")
    calibrated: bool = settings_of.setting(doc="whether a calibration was applied to it")
    input: InputSettings = settings_of.setting(InputSettings)


@dataclasses.dataclass(frozen=True)
class ProcessedInput:
    """Recording and settings from which `mwd process` computed the results in a folder."""

    recording: Path
    calibrated: bool  #: whether a calibration was applied to the recording
    given: InputSettings  #: settings of the input
    estimator: EstimatorSettings
    remarks: tuple[str, ...] = ()  #: sentences about settings that this version cannot use


def processed_input(folder: Path) -> ProcessedInput | None:
    """
    Return the recording and the settings of the results in a folder; None if the folder holds no results.

    Raises
    ------
    SettingsError
        A settings file in the folder is not valid.
    OSError
        A file cannot be read.
    """
    if not (folder / INPUT).is_file():
        return None
    table = settings_of.from_mapping(_InputFile, read_yaml(folder / INPUT), str(folder / INPUT))
    remarks: list[str] = []
    written = {name: value for name, value in _dotted(read_config(folder / CONFIG)).items() if value != {}}
    estimator = kept(EstimatorSettings(), written, remarks, "results")
    return ProcessedInput(Path(table.recording), table.calibrated, table.input, estimator, tuple(remarks))


def estimator_config(path: Path) -> EstimatorSettings:
    """
    Return the estimator's settings in a YAML file.

    Raises
    ------
    SettingsError
        The file is not YAML, is not a table of settings, names an unknown setting, or has a day that does not exist.
    OSError
        The file cannot be read.
    """
    try:
        found = settings_of.from_mapping(EstimatorSettings, read_config(path))
        day_of(found.place)
    except ValueError as error:
        raise settings_of.SettingsError(f"{path}: {error}") from error
    return found


def read_config(path: Path) -> dict[str, Any]:
    """
    Return the settings in a YAML file, in the form of config.yaml or of a ROS parameter file for the estimator node.

    The settings are nested tables, empty for an empty file. Of a parameter file, the first node with parameters is
    used.

    Raises
    ------
    SettingsError
        The file is not YAML, is not a table, or gives a name both a value and a table.
    OSError
        The file cannot be read.
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


def _dotted(table: dict[str, Any], block: str = "") -> dict[str, Any]:
    """Return nested tables as one table with dotted names; an empty table stays as a value."""
    out: dict[str, Any] = {}
    for name, value in table.items():
        inner = value and isinstance(value, dict)
        out |= _dotted(value, f"{block}{name}.") if inner else {f"{block}{name}": value}
    return out


def _nested(table: dict[str, Any]) -> dict[str, Any]:
    """
    Return a table with dotted names, as in ROS parameter files, as nested tables.

    Raises SettingsError if a name is both a value and a table.
    """
    out: dict[str, Any] = {}
    for name, value in _dotted(table).items():
        *parents, leaf = name.split(".")
        place = out
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise settings_of.SettingsError(f"{name}: {parent} is not a table, but {place!r}")
        if place.get(leaf):
            raise settings_of.SettingsError(f"{name}: is a table of settings, but also given as {value!r}")
        place[leaf] = value
    return out
