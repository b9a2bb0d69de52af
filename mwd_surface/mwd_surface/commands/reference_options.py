# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share: where the reference field comes from, and how the estimator is set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

if TYPE_CHECKING:
    from mwd_estimation.settings.estimator import EstimatorSettings

S = TypeVar("S")

FIELD_PANEL = "Reference field"
SETTINGS_PANEL = "Settings"

Lat = Annotated[float | None, typer.Option("--lat", help="Latitude, deg, north positive.", rich_help_panel=FIELD_PANEL)]
Lon = Annotated[float | None, typer.Option("--lon", help="Longitude, deg, east positive.", rich_help_panel=FIELD_PANEL)]
Date = Annotated[
    str | None,
    typer.Option("--date", help="Day of the field, YYYY-MM-DD.", rich_help_panel=FIELD_PANEL, metavar="DAY"),
]
Field = Annotated[
    str | None,
    typer.Option(
        "--field",
        help="A field that is known: nT,dip[,declination] in deg.",
        rich_help_panel=FIELD_PANEL,
        metavar="B,D,D",
    ),
]
Declination = Annotated[
    float | None, typer.Option(help="Magnetic from true north, deg, east positive.", rich_help_panel=FIELD_PANEL)
]
Convergence = Annotated[
    float | None, typer.Option(help="Grid from true north, deg, east positive.", rich_help_panel=FIELD_PANEL)
]
Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        help="YAML of settings: a config.yaml of `mwd process`, or the estimator's ROS parameter file.",
        rich_help_panel=SETTINGS_PANEL,
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="One setting, e.g. survey.duration_s=12. May be repeated.",
        rich_help_panel=SETTINGS_PANEL,
        metavar="NAME=VALUE",
    ),
]


Tool = Annotated[
    str | None,
    typer.Option(
        "--tool",
        help="What the conventional unit can do: a tool file, or the name of a grade of the simulator.",
        rich_help_panel=SETTINGS_PANEL,
        metavar="FILE",
    ),
]
Precision = Annotated[
    str | None,
    typer.Option(
        "--precision", help="As --tool, of the high-precision unit.", rich_help_panel=SETTINGS_PANEL, metavar="FILE"
    ),
]


def tool_changes(tool: str | None, precision: str | None) -> dict[str, Any]:
    """
    Settings `tool.*` by tool files or by names of the simulator's grades; empty where none was given.

    Raises
    ------
    SettingsError
        No such file or grade (the near misses are named), or a name in it that no tool has.
    OSError
        The file cannot be read.
    """
    from mwd_estimation.settings.tool import PrecisionUnit
    from mwd_estimation.settings.tool import Tool as ToolSettings
    from mwd_estimation.settings.tool_file import from_file

    changes = {} if tool is None else _flat(from_file(_tool_path(tool), ToolSettings), "tool.")
    if precision is not None:
        changes |= _flat(from_file(_tool_path(precision), PrecisionUnit), "tool.precision.")
    return changes


def mount_changes(given: Sequence[str] | None, accelerometer: str | None = None) -> dict[str, Any]:
    """
    Settings `tool.mount.*` of --mount, of every unit or of one as UNIT=MOUNT, and of --accelerometer.

    Raises
    ------
    ValueError
        A unit that is none.
    """
    changes: dict[str, Any] = {} if accelerometer is None else {"tool.mount.accelerometer": accelerometer}
    for text in given or ():
        unit, equals, mount = text.rpartition("=")
        units = (unit.strip(),) if equals else ("imu", "mag", "precision")
        if not set(units) <= {"imu", "mag", "precision"}:
            raise ValueError(f"--mount {text}: {unit!r} is no unit; write imu, mag or precision before the equals sign")
        changes |= {f"tool.mount.{name}": mount.strip() for name in units}
    return changes


def _flat(table: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return flat


def _tool_path(name: str) -> Path:
    """Path of a tool file; a plain name is a grade that comes with the simulator."""
    import importlib.resources

    from mwd_sensors.core.settings import SettingsError, unknown_key

    if Path(name).suffix or Path(name).exists():
        return Path(name)
    folder = Path(str(importlib.resources.files("mwd_sensors"))) / "simulator" / "grades"
    grades = sorted(path.stem for path in folder.glob("*.yaml"))
    if name not in grades:
        raise SettingsError(unknown_key(name, grades, "--tool").replace("no such setting", "no such file or grade"))
    return folder / f"{name}.yaml"


def placed_settings(
    config: Path | None,
    changes: Sequence[str] | None,
    place: Mapping[str, Any],
    method: str | None = None,
    north: str | None = None,
    tool: Mapping[str, Any] | None = None,
    start: EstimatorSettings | None = None,
) -> EstimatorSettings:
    """
    Settings of the estimator by the options of a command.

    `place` is what `place_changes` gives, `tool` what `tool_changes` gives, `start` the settings that hold where
    neither file nor option says otherwise.

    Raises
    ------
    SettingsError
        As `estimator_settings`.
    """
    named = dict(place)
    if named and "survey.north" not in {**named, **assignments(changes)} and config is None and start is None:
        # A place or a declination says where true north is, not which grid is meant.
        named["survey.north"] = "true"
    if method is not None:
        named["gravity.method"] = method
    if north is not None:
        named["survey.north"] = north
    return estimator_settings(config, {**named, **(tool or {})}, changes, start)


def estimator_settings(
    config: Path | None,
    named: Mapping[str, Any],
    changes: Sequence[str] | None,
    start: EstimatorSettings | None = None,
) -> EstimatorSettings:
    """
    Settings of the estimator: the file's, else `start`, then those of options of their own, then those of --set.

    Raises
    ------
    SettingsError
        An unknown name (with its near misses) or a value that is not allowed.
    """
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_sensors.core import settings
    from mwd_surface.processing.run_config import estimator_config

    begin = estimator_config(config) if config else start or EstimatorSettings()
    return settings.changed(begin, {**named, **assignments(changes)})


def assignments(changes: Sequence[str] | None) -> dict[str, Any]:
    """
    NAME=VALUE texts as a table; values are read as YAML, whole numbers where a fraction is meant are taken.

    Raises
    ------
    SettingsError
        A text without an equals sign or a value that YAML cannot read.
    """
    import datetime

    import yaml

    from mwd_sensors.core.input_files import load_yaml
    from mwd_sensors.core.settings import SettingsError

    table = {}
    for change in changes or []:
        name, equals, value = change.partition("=")
        if not equals or not name.strip():
            raise SettingsError(f"--set {change}: write it as NAME=VALUE, for example --set survey.duration_s=12")
        try:
            read = load_yaml(value)
        except yaml.YAMLError as error:
            raise SettingsError(f"--set {change}: the value cannot be read: {str(error).splitlines()[0]}") from error
        # A day is text to every setting, and a date to YAML.
        table[name.strip()] = value.strip() if isinstance(read, datetime.date) else read
    return table


def field_figures(text: str) -> tuple[float, float, float | None]:
    """
    Strength in nT, dip and declination in deg of --field; the declination is None where it is left out.

    Raises
    ------
    ValueError
        Not two or three numbers.
    """
    parts = text.split(",")
    try:
        figures = [float(part) for part in parts]
    except ValueError:
        figures = []
    if len(figures) not in (2, 3):
        raise ValueError(f"--field {text}: expected nT,dip,declination, for example --field 50200,71.6,-2.2")
    return figures[0], figures[1], figures[2] if len(figures) == 3 else None


def place_changes(
    lat: float | None, lon: float | None, date: str | None, field: str | None, declination: float | None = None
) -> dict[str, Any]:
    """
    The settings `place.*` that the options mean; empty where none was given.

    Raises
    ------
    ValueError
        Half a place, a date without one, or both a place and a field.
    """
    if (lat is None) != (lon is None):
        raise ValueError("--lat and --lon: give both, or neither")
    if lat is not None and field is not None:
        raise ValueError("--field and --lat/--lon: give one of them; a field that is known needs no model")
    if date is not None and lat is None:
        raise ValueError("--date: means nothing without --lat and --lon")
    if lat is not None:
        changes: dict[str, Any] = {"place.field": "model", "place.lat_deg": lat, "place.lon_deg": lon}
        return changes | ({"place.date": date} if date is not None else {})
    if field is not None:
        total, dip, given = field_figures(field)
        changes = {"place.field": "fixed", "place.total_nt": total, "place.dip_deg": dip}
        known = given if given is not None else declination
        # Without a declination nobody knows where true north is.
        return changes | ({"survey.north": "magnetic"} if known is None else {"place.declination_deg": known})
    return {}


def recording_changes(lat: float | None, lon: float | None, date: str | None, field: str | None) -> dict[str, Any]:
    """
    As `place_changes`, of a recording: a gyro needs no more than the latitude, which may stand alone or beside a field.

    Raises
    ------
    ValueError
        A longitude or a date without what gives it a meaning; figures of a field that cannot be read.
    """
    if lat is None or (lon is not None and field is None):
        return place_changes(lat, lon, date, field)
    if date is not None:
        raise ValueError("--date: means nothing without both --lat and --lon, or beside --field")
    return place_changes(None, None, None, field) | {"place.lat_deg": lat}


def given_settings(kind: type[S], options: Mapping[str, Any]) -> S:
    """Return settings of a kind from the options of the same names; an option that is None keeps the default."""
    import dataclasses

    from mwd_sensors.core import settings

    names = (field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]
    return settings.from_mapping(kind, {name: options[name] for name in names if options.get(name) is not None})
