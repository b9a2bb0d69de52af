# SPDX-License-Identifier: Apache-2.0
"""`mwd path`: path of a survey list of any origin, and comparison of two lists of one hole."""

from __future__ import annotations

import dataclasses
import enum
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_surface import __version__
from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    LIST,
    PLACE,
    Changes,
    Convergence,
    Declination,
    GivenPlace,
    assigned,
    numbers_in,
    takes,
)
from mwd_surface.commands.sources import survey_list_at
from mwd_surface.commands.speech import spoken_figure
from mwd_surface.commands.table_reference import GivenReference, table_reference, table_settings

if TYPE_CHECKING:
    from mwd_surface.exports.survey_table import SurveyTable
    from mwd_surface.list_files.list_settings import ListSettings
    from mwd_surface.surveys.leg import TieOn
    from mwd_surface.surveys.survey_list import SurveyList
    from mwd_surface.trajectory.list_comparison import PathDifference

_LIST = "List"
# Day for the field model if the list has no times: the first day of the model.
_USUAL_DAY = "2025-01-01"


class Values(enum.StrEnum):
    """Choice between the definitive values of the surveys of a run and the values as first decided."""

    DEFINITIVE = "definitive"
    FIRST = "first"


@takes(PLACE, LIST)
def path(
    source: Annotated[
        Path, typer.Argument(metavar="LIST", help="File with a list of stations, or the folder of a run.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    against: Annotated[Path | None, typer.Option(help="Another list of the same hole, such as a gyro survey.")] = None,
    code: Annotated[
        str | None, typer.Option(help="ISCWSA tool code of the error model, e.g. MWD+SRGM or GYRO-NS.")
    ] = None,
    programme: Annotated[
        Path | None,
        typer.Option(help="YAML file of the survey programme: tool codes by depth interval, instead of --code."),
    ] = None,
    against_code: Annotated[str | None, typer.Option(help="ISCWSA tool code of the list of --against.")] = None,
    against_set: Annotated[
        list[str] | None,
        typer.Option(
            help="How to read the list of --against: an option of panel List, e.g. length_unit=ft. May be repeated.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    tie_on: Annotated[
        str | None,
        typer.Option(
            help="Tie-on, the start of the path: MD,INC,AZI or MD,INC,AZI,TVD,NORTH,EAST in m and deg.",
            rich_help_panel=_LIST,
            metavar="...",
        ),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Also use stations whose verdict is not accept.", rich_help_panel=_LIST)
    ] = False,
    values: Annotated[
        Values,
        typer.Option(
            help="Values to use from the list of a run: as revised last (definitive), or as first decided (first).",
            rich_help_panel=_LIST,
        ),
    ] = Values.DEFINITIVE,
    declination: Declination = None,
    convergence: Convergence = None,
    changes: Changes = None,
    *,
    place: GivenPlace,
    listed: ListSettings,
) -> None:
    """
    Compute the path of a survey list by minimum curvature, with its position uncertainty.

    Writes DIR/path.csv and DIR/surveys.json, which `mwd report DIR` and `mwd export DIR` read. Reads tables and .xlsx,
    LAS 2 and 3, WITSML 1.3 to 2.1, P7/17 and Petrel .dev, recognised by the content of the file. Columns, units and
    north are found by their names ("MD (usft)", azi_grid ...) and in the head of the list. An error message quotes each
    word that was not recognised, and every assumption is a remark in path, report and exports. A list that contradicts
    itself is refused with the likely cause. The position uncertainty needs a place (--lat, --lon) or a field (--field).
    With --against, DIR/comparison.csv and DIR/comparison.png are also written.

    \b
    Examples:
      mwd path gyro.csv -o gyro --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd path list.las -o out --columns md=TDEP,inclination=DEV,azimuth=HAZI --north grid
      mwd path trace.dev -o out --wellhead 6478300,431200
      mwd path boreholes.xlsx -o out --dip up
      mwd path out/run_7 -o compared --against gyro.xml --against-code GYRO-NS
    """
    options = locals()  # must be the first statement, while the options are the only local variables

    from mwd_surface.exports.csv_tables import path_csv
    from mwd_surface.list_files.list_error import ListFileError
    from mwd_surface.list_files.list_settings import asked
    from mwd_surface.surveys.survey_store import encoded
    from mwd_surface.uncertainty.programme import read_programme

    surveys = _surveys(source, options, listed, code)
    if programme is not None:
        read_programme(programme)
        well = dataclasses.replace(surveys.well, programme=str(programme.resolve()))
        surveys = surveys.configured(well, surveys.rules)
    table = _table(surveys)
    files: dict[str, str | bytes] = {"path.csv": path_csv(table)}
    stored = output / "surveys.json"
    if not _is_source(source, stored):
        files[stored.name] = encoded(surveys)
    _show(table)
    if against is not None:
        # Do not use the options for reading LIST for the list of --against.
        others = {**options, "tie_on": None, "every": every}
        try:
            other = _surveys(against, others, assigned(against_set, "--against-set"), against_code, surveys)
        except ListFileError as error:
            raise asked(error, "--against-set {}={}") from error
        files |= _compared(table, other, (source.stem, against.stem))
    terminal.write(output, files)


def _surveys(
    source: Path, options: dict[str, Any], said: ListSettings, code: str | None, beside: SurveyList | None = None
) -> SurveyList:
    """
    Return the survey list of a source, read with the options of the command; print remarks about the list as warnings.

    said: settings for reading the list. beside: another list of the same hole, whose location and field are used if
    neither this list nor the options give a field. Raises ValueError if options for a list are given with a run.
    """
    from mwd_surface.list_files.list_file import is_list
    from mwd_surface.uncertainty.error_terms import check_tool_code

    if is_list(source):
        surveys, remarks = _imported(source, options, said, beside)
    else:
        wrong = [name for name, value in vars(said).items() if value]
        wrong += [name for name in ("tie_on", "every") if options[name] and beside is None]
        if wrong:
            raise ValueError(
                f"--{wrong[0].replace('_', '-')}: is not used for {source}, because the list of a run states this; "
                "omit it"
            )
        surveys, remarks = survey_list_at(source)
        if options["values"] == Values.FIRST and beside is None:
            surveys = surveys.as_first_decided()
    terminal.warn(*remarks)
    if code is not None:
        check_tool_code(code)
        surveys = surveys.configured(dataclasses.replace(surveys.well, error_model=code), surveys.rules)
    return surveys


def _imported(
    source: Path, options: dict[str, Any], said: ListSettings, beside: SurveyList | None
) -> tuple[SurveyList, tuple[str, ...]]:
    from mwd_surface.list_files.list_file import read_list
    from mwd_surface.list_files.remark import sentences
    from mwd_surface.surveys.imported_list import reference_in, survey_list, well_of
    from mwd_surface.surveys.well import Well

    stations = read_list(source, said.given())
    settings = table_settings(None, options["changes"], options["place"])
    known = GivenReference.of(options["place"].field, options["declination"], options["convergence"])
    reference, remarks = table_reference(settings, known, stations.time, _USUAL_DAY)
    if reference is None and beside is not None:
        reference, well = reference_in(beside), dataclasses.replace(beside.well, name=source.stem)
    else:
        north = "true" if beside is None else beside.well.north_reference
        well = well_of(stations) or Well(name=source.stem, north_reference=north)
        if reference is not None:
            well = dataclasses.replace(well, geomagnetic_model=reference.source)
        if settings.place.lat_deg is not None:
            well = dataclasses.replace(well, latitude_deg=settings.place.lat_deg, longitude_deg=settings.place.lon_deg)
    tie_on = options["tie_on"]
    surveys = survey_list(
        stations,
        well,
        tie_on=None if tie_on is None else _tie_on(tie_on),
        reference=reference,
        every=options["every"],
    )
    return surveys, (*remarks, *sentences((*surveys.remarks, *surveys.definitive().assumptions)))


def _tie_on(text: str) -> TieOn:
    from mwd_surface.surveys.leg import TieOn

    numbers = numbers_in(text)
    if len(numbers) not in (3, 6):
        raise ValueError(f"--tie-on {text}: expected MD,INC,AZI or MD,INC,AZI,TVD,NORTH,EAST in m and deg")
    md, inclination, azimuth = numbers[:3]
    down, north, east = numbers[3:] or (None, None, None)
    return TieOn.given(md, math.radians(inclination), math.radians(azimuth % 360.0), (north, east, down))


def _table(surveys: SurveyList) -> SurveyTable:
    from mwd_surface.exports.survey_table import survey_table

    table = survey_table(surveys, surveys.changed_ns, software=f"mwd {__version__}")
    terminal.warn(*table.left_out)
    if table.covariance is None:
        remedy = "; give --lat and --lon, or --field" if "reference field" in table.covariance_note else ""
        terminal.warn(f"no position uncertainty: {table.covariance_note}{remedy}")
    return table


def _is_source(source: Path, stored: Path) -> bool:
    """Return whether the file to write, `stored`, is the list that was read."""
    return stored.is_file() and any(
        candidate.is_file() and candidate.samefile(stored) for candidate in (source, source / stored.name)
    )


def _compared(table: SurveyTable, other: SurveyList, names: tuple[str, str]) -> dict[str, str | bytes]:
    """
    Compare a path with the path of another list, print the differences, and return the files to write, by name.

    The azimuths of the other list are first referred to the north of the path.

    names : names of the two lists.

    Raises ValueError if declination or convergence for this is unknown.
    """
    from mwd_surface.exports.csv_tables import comparison_csv
    from mwd_surface.plots.drawing import png
    from mwd_surface.plots.path_plots import figure_of
    from mwd_surface.trajectory.list_comparison import difference

    well = dataclasses.replace(other.well, north_reference=table.surveys.well.north_reference)
    try:
        turned = other.configured(well, other.rules)
    except ValueError as error:
        raise ValueError(
            f"--against: {error}; give --convergence, and --declination where one list is from magnetic north"
        ) from error
    second = _table(turned)
    found = difference(table.path, second.path, (table.covariance, second.covariance))
    _show_difference(found, names)
    return {"comparison.csv": comparison_csv(found), "comparison.png": png(spoken_figure(figure_of(found, *names)))}


def _show(table: SurveyTable) -> None:
    path, last = table.path, len(table.records) - 1
    n, e, down = path.positions[last]
    lines = (
        ("stations", f"{len(table.records)}, to {path.md[last]:.2f} m ({path.kind[last]})"),
        ("end", f"{down:.2f} m TVD, {n:+.2f} m north, {e:+.2f} m east"),
        ("azimuth", f"from {path.north.name.lower()} north"),
        ("sigmas", table.covariance_note),
    )
    terminal.facts(lines)


def _show_difference(found: PathDifference, names: tuple[str, str]) -> None:
    import numpy as np

    columns = ("depth m", "inclination deg", "azimuth deg", "north m", "east m", "down m", "sigmas")
    table = terminal.table(columns, title=f"{names[0]} minus {names[1]}")
    # Print only some of the stations; the file has all of them.
    for k in np.unique(np.linspace(0, found.md.size - 1, 12).astype(int)):
        sigmas = found.sigmas[k]
        table.add_row(
            f"{found.md[k]:.1f}",
            *(f"{math.degrees(v):+.2f}" if math.isfinite(v) else "-" for v in found.turn[k]),
            *(f"{v:+.2f}" for v in found.position[k]),
            f"{sigmas:.1f}" if math.isfinite(sigmas) else "-",
        )
    terminal.output().print(table)
