# SPDX-License-Identifier: Apache-2.0
"""Options for reading a survey list: single options for the list of a command, NAME=VALUE for the plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_sensors.core import settings
from mwd_sensors.core.settings import SettingsError, unknown_key
from mwd_surface.commands.option_group import OptionGroup

if TYPE_CHECKING:
    from mwd_surface.list_files.list_settings import ListSettings
    from mwd_surface.surveys.well import Well
    from mwd_surface.trajectory.plan import Plan


def _option(words: str, *names: str, **more: Any) -> Any:
    return Annotated[str | None, typer.Option(*names, help=words, rich_help_panel="List", **more)]


# Command-line options for the fields of `ListSettings`, by field name.
_OPTIONS: dict[str, Any] = {
    "columns": _option(
        "Columns of the list by quantity, if not recognised, e.g. md=DEPTH,inclination=DEV,azimuth=HAZI."
    ),
    "length_unit": _option("Unit of lengths if the list does not give it: m, ft or ftus."),
    "angle_unit": _option("Unit of angles if the list does not give it: deg, rad or grad."),
    "north": _option("North of the azimuths if the list does not state it: magnetic, true or grid.", "--north"),
    "decimal": _option("Decimal mark, point or comma, if numbers like 1,000 are ambiguous."),
    "dip": _option("Direction of positive angles from the horizontal: down or up."),
    "wellhead": _option(
        "Northing and easting of the wellhead in the map coordinates of the list, m.", metavar="NORTHING,EASTING"
    ),
    "confirm": Annotated[
        list[str] | None,
        typer.Option(
            help="Accept values of this kind that look wrong: dogleg, wellhead or depth. May be repeated.",
            rich_help_panel="List",
        ),
    ],
}
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
    from mwd_surface.list_files.list_settings import ListSettings

    words = {name: value if isinstance(value, str) else ",".join(value) for name, value in given.items() if value}
    try:
        return settings.changed(ListSettings(), {n: v if n == "columns" else v.lower() for n, v in words.items()})
    except settings.SettingsError as error:
        raise settings.SettingsError(f"{option}{error}") from error


#: Options for reading a survey list; a command has them as the argument `listed`, of the type `ListSettings`.
LIST = OptionGroup("listed", list_settings, _OPTIONS)


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
        if name not in _OPTIONS:
            raise SettingsError(unknown_key(name, _OPTIONS, option))
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
    from mwd_surface.list_files.list_settings import asked
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
