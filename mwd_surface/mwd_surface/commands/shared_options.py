# SPDX-License-Identifier: Apache-2.0
"""
Options shared by several commands: reference field, settings of the estimator, and how to read recordings and lists.

A command gets the values of a group of options as one argument. An option for reading a recording has the name of the
setting that it sets. The list of a command has single options, the plan has NAME=VALUE.
"""

from __future__ import annotations

import dataclasses
import datetime
import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

import typer

from mwd_sensors.core import settings
from mwd_sensors.core.settings import SettingsError, unknown_key
from mwd_surface.commands.sources import recording_at
from mwd_surface.list_files.list_settings import ListSettings, asked

if TYPE_CHECKING:
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.processing.bag_input import InputSettings
    from mwd_surface.surveys.well import Well
    from mwd_surface.trajectory.plan import Plan

S = TypeVar("S")

FIELD_PANEL = "Reference field"
INPUT_PANEL = "Input"
SETTINGS_PANEL = "Settings"


class OptionGroup(NamedTuple):
    """Group of options."""

    argument: str  #: name of the argument with which a command gets the group
    make: Callable[..., Any]  #: function that returns this argument from the values of all options by name
    options: Mapping[str, Any]  #: by name of the option, its annotation for typer; without a default, an option is None


def takes(*groups: OptionGroup) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the options of groups to a command, after the command's own options."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        for group in groups:
            # The type of a group is imported only for the type checker.
            del command.__annotations__[group.argument]
        own = inspect.signature(command, eval_str=True)
        arguments = {group.argument for group in groups}
        kept = [parameter for parameter in own.parameters.values() if parameter.name not in arguments]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for group in groups
            for name, annotation in group.options.items()
        ]

        @functools.wraps(command)
        def called(*arguments: Any, **given: Any) -> None:
            made = {
                group.argument: group.make(**{name: given.pop(name, None) for name in group.options})
                for group in groups
            }
            command(*arguments, **given, **made)

        # typer makes the options of the command line from the signature and the annotations.
        called.__signature__ = own.replace(parameters=[*kept, *added])  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in (*kept, *added)}
        return called

    return decorated


class GivenPlace(NamedTuple):
    """Place or field of the options: latitude and longitude, deg, day, and texts; None if not given."""

    lat: float | None
    lon: float | None
    date: str | None
    field: str | None


def _field(words: str, *, kind: Any = float | None, **more: Any) -> Any:
    return Annotated[kind, typer.Option(help=words, rich_help_panel=FIELD_PANEL, **more)]


#: Options for the source of the reference field; a command has them as the argument `place`.
PLACE = OptionGroup(
    "place",
    GivenPlace,
    {
        "lat": _field("Latitude, deg, north positive."),
        "lon": _field("Longitude, deg, east positive."),
        "date": _field(
            "Day for the field model, YYYY-MM-DD; by default the day of the data.", kind=str | None, metavar="DAY"
        ),
        "field": _field(
            "Known magnetic field: total in nT, dip and optionally declination in deg, e.g. 50360,71.63,-2.2.",
            kind=str | None,
            metavar="B,D,D",
        ),
    },
)
Declination = Annotated[
    float | None,
    typer.Option(
        help="Declination: angle from true to magnetic north, deg, east positive.", rich_help_panel=FIELD_PANEL
    ),
]
Convergence = Annotated[
    float | None,
    typer.Option(
        help="Grid convergence: angle from true to grid north, deg, east positive.", rich_help_panel=FIELD_PANEL
    ),
]
Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        help="YAML file of settings: a config.yaml of `mwd process`, or a ROS parameter file of the estimator.",
        rich_help_panel=SETTINGS_PANEL,
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change one parameter of the estimator, e.g. survey.duration_s=12. May be repeated.",
        rich_help_panel=SETTINGS_PANEL,
        metavar="NAME=VALUE",
    ),
]


Tool = Annotated[
    str | None,
    typer.Option(
        "--tool",
        help="YAML file with the sensor errors of the conventional (AHRS) unit, or a grade of the simulator.",
        rich_help_panel=SETTINGS_PANEL,
        metavar="FILE",
    ),
]
Precision = Annotated[
    str | None,
    typer.Option(
        "--precision", help="Like --tool, for the high-precision unit.", rich_help_panel=SETTINGS_PANEL, metavar="FILE"
    ),
]
Mount = Annotated[
    list[str] | None,
    typer.Option(
        "--mount",
        help="Orientation of the units in the tool: the axis that points down-hole or up-hole (z-down, x-up ...), nine "
        "numbers (matrix from unit to tool axes), a quaternion x,y,z,w, or tf (static transforms). For one unit: "
        "imu=, mag= or precision= before it. May be repeated.",
        metavar="[UNIT=]MOUNT",
        rich_help_panel=INPUT_PANEL,
    ),
]


def tool_changes(tool: str | None, precision: str | None) -> dict[str, Any]:
    """
    Return settings `tool.*` from tool files or names of simulator grades; empty if no option was given.

    Raises
    ------
    SettingsError
        A file or grade does not exist (similar names are listed), or a file has an unknown name.
    OSError
        The file cannot be read.
    """
    from mwd_estimation.settings.tool import PrecisionUnit
    from mwd_estimation.settings.tool import Tool as ToolSettings
    from mwd_estimation.settings.tool_file import from_file

    changes = {} if tool is None else flattened(from_file(_tool_path(tool), ToolSettings), "tool.")
    if precision is not None:
        changes |= flattened(from_file(_tool_path(precision), PrecisionUnit), "tool.precision.")
    return changes


def mount_changes(given: Sequence[str] | None, accelerometer: str | None = None) -> dict[str, Any]:
    """
    Return settings `tool.mount.*` from --mount (MOUNT for every unit, or UNIT=MOUNT for one) and --accelerometer.

    Raises
    ------
    ValueError
        The unit of a mount is unknown.
    """
    changes: dict[str, Any] = {} if accelerometer is None else {"tool.mount.accelerometer": accelerometer}
    for text in given or ():
        unit, equals, mount = text.rpartition("=")
        units = (unit.strip(),) if equals else ("imu", "mag", "precision")
        if not set(units) <= {"imu", "mag", "precision"}:
            raise ValueError(
                f"--mount {text}: unknown unit {unit!r}; write imu, mag or precision before the equals sign"
            )
        changes |= {f"tool.mount.{name}": mount.strip() for name in units}
    return changes


def flattened(table: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested tables in one table, by their names joined by dots after the prefix."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        flat |= flattened(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat


def _tool_path(name: str) -> Path:
    """
    Return the path of a tool file; a plain name is a grade included with the simulator.

    Raises SettingsError if there is neither such a file nor such a grade.
    """
    import importlib.resources

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
    Return settings of the estimator from the options of a command.

    place, tool: results of `place_changes` and `tool_changes`. start: settings that apply where neither file nor option
    sets a value. Azimuths are from true north if `place` has values and neither option, file nor `start` sets a north.

    Raises
    ------
    SettingsError
        A name is unknown or a value is not allowed, as in `estimator_settings`.
    """
    named = dict(place)
    if named and "survey.north" not in {**named, **assignments(changes)} and config is None and start is None:
        # A place or a declination defines true north, but not a grid.
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
    Return settings of the estimator: from the file or `start`, changed by named options, then by --set.

    Raises
    ------
    SettingsError
        A name is unknown (similar names are listed), or a value is not allowed.
    """
    from mwd_estimation.settings.estimator import EstimatorSettings

    begin = start or EstimatorSettings()
    if config:
        # Import this module only if there is a file, because it imports the readers of recordings.
        from mwd_surface.processing.run_config import estimator_config

        begin = estimator_config(config)
    return settings.changed(begin, {**named, **assignments(changes)})


def assignments(changes: Sequence[str] | None) -> dict[str, Any]:
    """
    Return NAME=VALUE texts as a dict; values are read as YAML.

    Raises
    ------
    SettingsError
        A text has no equals sign, or YAML cannot read a value.
    """
    import yaml

    from mwd_sensors.core.input_files import load_yaml

    table = {}
    for change in changes or []:
        name, equals, value = change.partition("=")
        if not equals or not name.strip():
            raise SettingsError(f"--set {change}: write it as NAME=VALUE, for example --set survey.duration_s=12")
        try:
            read = load_yaml(value)
        except yaml.YAMLError as error:
            raise SettingsError(f"--set {change}: the value cannot be read: {str(error).splitlines()[0]}") from error
        # YAML reads a day as a date object, but settings need a text.
        table[name.strip()] = value.strip() if isinstance(read, datetime.date) else read
    return table


def numbers_in(text: str, separator: str = ",") -> list[float]:
    """Return the finite numbers in a text, separated by commas or another separator; empty if a part is not one."""
    try:
        numbers = [float(part) for part in text.split(separator)]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def field_figures(text: str) -> tuple[float, float, float | None]:
    """
    Return strength, nT, dip, deg, and declination, deg, from --field; the declination is None if it is omitted.

    Raises
    ------
    ValueError
        The text does not have two or three numbers.
    """
    figures = numbers_in(text)
    if len(figures) not in (2, 3):
        raise ValueError(f"--field {text}: expected nT,dip,declination, for example --field 50200,71.6,-2.2")
    return figures[0], figures[1], figures[2] if len(figures) == 3 else None


def place_changes(
    lat: float | None, lon: float | None, date: str | None, field: str | None, declination: float | None = None
) -> dict[str, Any]:
    """
    Return the settings `place.*` from the options; empty if neither place nor field was given.

    A field without a declination also sets `survey.north` to magnetic.

    Raises
    ------
    ValueError
        Only one of latitude and longitude is given, a date is given without both, both place and field are given, or
        the field cannot be read.
    """
    if (lat is None) != (lon is None):
        raise ValueError("--lat and --lon: give both, or neither")
    if lat is not None and field is not None:
        raise ValueError("--field and --lat/--lon: give only one of them; a known field needs no model")
    if date is not None and lat is None:
        raise ValueError("--date: has no effect without --lat and --lon")
    if lat is not None:
        changes: dict[str, Any] = {"place.field": "model", "place.lat_deg": lat, "place.lon_deg": lon}
        return changes | ({"place.date": date} if date is not None else {})
    if field is not None:
        total, dip, given = field_figures(field)
        changes = {"place.field": "fixed", "place.total_nt": total, "place.dip_deg": dip}
        known = given if given is not None else declination
        # Without a declination, true north is unknown: refer azimuths to magnetic north.
        return changes | ({"survey.north": "magnetic"} if known is None else {"place.declination_deg": known})
    return {}


def recording_changes(lat: float | None, lon: float | None, date: str | None, field: str | None) -> dict[str, Any]:
    """
    Return the settings `place.*` for a recording.

    Unlike in `place_changes`, the latitude may also be given alone, which is enough for the gyro azimuth, or with a
    field.

    Raises
    ------
    ValueError
        A longitude or a date has no effect without other options, or the field cannot be read.
    """
    if lat is None or (lon is not None and field is None):
        return place_changes(lat, lon, date, field)
    if date is not None:
        raise ValueError("--date: has no effect without both --lat and --lon, or with --field")
    return place_changes(None, None, None, field) | {"place.lat_deg": lat}


def given_settings(kind: type[S], options: Mapping[str, Any]) -> S:
    """Return settings of a class from the options with the same names; an option that is None keeps the default."""
    names = (field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]
    return settings.from_mapping(kind, {name: options[name] for name in names if options.get(name) is not None})


Recording = Annotated[
    Path,
    typer.Argument(
        help="Folder of a rosbag2 recording, of a run or of results, or an .mcap, .db3 or .bag file.",
        callback=recording_at,
    ),
]
#: Values of the options for reading a recording, by name of the setting.
Reading = Mapping[str, Any]


def _input(words: str, *names: str, kind: Any = str | None) -> Any:
    return Annotated[kind, typer.Option(*names, help=words, rich_help_panel=INPUT_PANEL)]


_INPUT_OPTIONS: dict[str, Any] = {
    "imu_topic": _input("Topic of the IMU, or of the gyro if gyro and accelerometer have separate topics."),
    "accel_topic": _input("Topic of the accelerometer, if the topic of the IMU has only the gyro."),
    "mag_topic": _input("Topic of the magnetometer."),
    "gyro_topic": _input("Topic of the high-precision gyro unit."),
    "temperature_topic": _input("Topic of the IMU's temperature."),
    "rig_topic": _input("Topic of the rig data, which give the depths."),
    "accel_unit": _input("Unit of specific force: m/s2, g or mg."),
    "gyro_unit": _input("Unit of angular rate: rad/s or deg/s."),
    "mag_unit": _input("Unit of the field: T, mT, uT, nT, G or mG."),
    "stamps": _input(
        "Times of the samples: header (stamps in the messages), or recording (times of recording) if the sensor clocks "
        "disagree or were not set.",
        "--stamps",
    ),
    "start_s": _input("Start this many seconds after the first message.", "--start", kind=float | None),
    "end_s": _input("End this many seconds after the first message.", "--end", kind=float | None),
    "partial": _input("Use the readable part of a damaged recording.", "--partial", kind=bool | None),
}

#: Options for reading a recording; a command has them as the argument `reading` (see `Reading`).
READING = OptionGroup("reading", dict, _INPUT_OPTIONS)


def given_names(reading: Reading) -> list[str]:
    """Return the names of the given options, as written on the command line."""
    from mwd_surface.processing.bag_input import option_of

    return [option_of(name) for name, value in reading.items() if value]


def input_settings(reading: Reading, **more: Any) -> InputSettings:
    """
    Return the input settings from the options of a command; more: further settings of the input.

    Raises
    ------
    ValueError
        The end is not later than the start, or a value is not allowed.
    """
    from mwd_surface.processing.bag_input import InputSettings

    start, end = reading["start_s"] or 0.0, reading["end_s"]
    if end is not None and end <= start:
        raise ValueError(f"--end {end:g}: must be after --start {start:g}")
    return given_settings(InputSettings, {**reading, **more})


PlanSet = Annotated[
    list[str] | None,
    typer.Option(
        "--plan-set",
        help="How to read the plan, with the options of `mwd path`, e.g. confirm=dogleg, north=grid or"
        " wellhead=6478300,431200. May be repeated.",
        metavar="NAME=VALUE",
    ),
]


def list_settings(option: str = "--", **given: Any) -> ListSettings:
    """
    Return the settings of a list from options by name; an option that is None is not set.

    option: prefix of the name of a setting on the command line, for messages.

    Raises
    ------
    SettingsError
        An option has an unknown word.
    """
    words = {name: value if isinstance(value, str) else ",".join(value) for name, value in given.items() if value}
    try:
        return settings.changed(ListSettings(), {n: v if n == "columns" else v.lower() for n, v in words.items()})
    except settings.SettingsError as error:
        raise settings.SettingsError(f"{option}{error}") from error


def _list_option(field: dataclasses.Field[str]) -> Any:
    """Return the option for a field of `ListSettings`; one that takes several words may be repeated."""
    kind = list[str] | None if field.name == "confirm" else str | None
    option = typer.Option(f"--{field.name.replace('_', '-')}", help=settings.rule_of(field).doc, rich_help_panel="List")
    return Annotated[kind, option]


#: Options for reading a survey list; a command has them as the argument `listed`, of the type `ListSettings`.
LIST = OptionGroup(
    "listed", list_settings, {field.name: _list_option(field) for field in dataclasses.fields(ListSettings)}
)


def assigned(changes: Sequence[str] | None, option: str) -> ListSettings:
    """
    Return the settings of a list from NAME=VALUE texts; `confirm` can be given several times.

    option: name of the option that has these texts, for messages.

    Raises
    ------
    SettingsError
        A text has no equals sign, or a name or word is unknown.
    """
    table: dict[str, Any] = {}
    for change in changes or ():
        name, equals, value = change.partition("=")
        name = name.strip().replace("-", "_")
        if not equals:
            raise SettingsError(f"{option} {change}: write it as NAME=VALUE, for example {option} confirm=dogleg")
        if name not in LIST.options:
            raise SettingsError(unknown_key(name, LIST.options, option))
        table[name] = [*table.get(name, ()), value] if name == "confirm" else value
    return list_settings(f"{option} ", **table)


def read_plan_option(path: Path | None, changes: Sequence[str] | None, well: Well | None = None) -> Plan | None:
    """
    Return the plan of --plan, read with the settings of --plan-set; None if --plan is not given.

    well: well whose north the azimuths must have, and whose angle convention gives the sign of dips; None: any north.

    Raises
    ------
    ListFileError
        The plan cannot be read, as in `read_plan`; the message names options of --plan-set.
    ValueError
        --plan-set is given without --plan, or has an unknown name or word (SettingsError).
    """
    from mwd_surface.list_files.list_error import ListFileError
    from mwd_surface.trajectory.plan import read_plan

    given = assigned(changes, "--plan-set").given().with_dip(well.angles.points if well is not None else "")
    if path is None:
        if changes:
            raise ValueError("--plan-set: has no effect without --plan")
        return None
    try:
        return read_plan(path, well.north_reference if well is not None else "", given)
    except ListFileError as error:
        raise asked(error, "--plan-set {}={}") from error
