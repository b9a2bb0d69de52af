# SPDX-License-Identifier: Apache-2.0
"""`mwd clearance`: distance to offset wells by the separation rule of the ISCWSA."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.export import Bit, LegName
from mwd_surface.commands.shared_options import PlanSet, read_plan_option
from mwd_surface.commands.sources import survey_list_at
from mwd_surface.commands.speech import spoken_figure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mwd_surface.clearance.clearance import Clearance
    from mwd_surface.surveys.survey_list import SurveyList


def clearance(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEYS", help="Folder written by `mwd path` or `mwd run`, a surveys.json file, or a recording."
        ),
    ],
    offsets: Annotated[Path, typer.Option(help="YAML file of the offset wells, described above.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    programme: Annotated[
        Path | None,
        typer.Option(help="YAML file of the survey programme of the well: tool codes by depth interval."),
    ] = None,
    code: Annotated[
        str | None, typer.Option(help="ISCWSA tool code of all surveys of the well, e.g. MWD+SRGM.")
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(help="Planned path. The well is extended along this path by ahead_m of the --offsets file."),
    ] = None,
    plan_set: PlanSet = None,
    leg: LegName = None,
    bit_depth: Bit = None,
) -> None:
    """
    Compare a well with its offset wells: separation factor, distance, directions.

    Writes DIR/clearance.csv, and DIR/ladder.png, DIR/travelling_cylinder.png and DIR/plan_view.png. The YAML file of
    the offset wells has a list, wells, in which each well has name, file, north_m and east_m of its wellhead,
    hole_diameter_m, and code or programme; the file also has the factors of the separation rule (rule), and
    hole_diameter_m and ahead_m (the length of plan to check) of the well itself. The command ends with status 1 if a
    factor at the bit or ahead of it is below the level that stops drilling, or if a well of the file could not be
    compared.

    \b
    Examples:
      mwd path list.csv -o a1 --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd clearance a1 --offsets wells.yaml -o a1/clearance --programme programme.yaml
      mwd clearance out/run_7 --offsets wells.yaml -o out/near --plan plan.csv
    """
    from mwd_surface.clearance.clearance import ClearanceLevel
    from mwd_surface.clearance.offset_wells import read_offset_wells, well_clearance
    from mwd_surface.exports.csv_tables import clearance_csv
    from mwd_surface.list_files.list_file import is_list
    from mwd_surface.list_files.remark import sentences
    from mwd_surface.plots.clearance_plots import ladder, plan_view, travelling_cylinder
    from mwd_surface.plots.drawing import png

    if is_list(source):
        raise ValueError(f"{source} is a list of stations: first run mwd path {source} -o DIR, then give DIR")
    surveys, remarks = survey_list_at(source)
    surveys = _with_model(surveys, programme, code)
    planned = read_plan_option(plan, plan_set, surveys.well)
    near = well_clearance(surveys, read_offset_wells(offsets), planned, bit_depth, leg)
    terminal.warn(*dict.fromkeys((*remarks, *sentences(near.remarks))))
    if not near.found:
        raise ValueError(f"--offsets {offsets}: none of the wells can be compared")
    files: dict[str, str | bytes] = {"clearance.csv": clearance_csv(near.found)}
    figures = {
        "ladder": ladder(near.found),
        "travelling_cylinder": travelling_cylinder(near.found),
        "plan_view": plan_view(near),
    }
    for name, figure in figures.items():
        figure.suptitle(surveys.well.name, fontsize=11)
        files[f"{name}.png"] = png(spoken_figure(figure))
    _show(near.found)
    for one in near.ahead()[:1]:
        terminal.tell(f"ahead of the last survey at {near.surveyed:.1f} m: {one.sentence()}")
    terminal.write(output, files)
    if near.level == ClearanceLevel.STOP or near.refused:
        raise typer.Exit(1)


def _with_model(surveys: SurveyList, programme: Path | None, code: str | None) -> SurveyList:
    if programme is not None and code is not None:
        raise ValueError("--programme and --code: give only one of them; a programme contains the codes")
    well = surveys.well
    if programme is not None:
        well = dataclasses.replace(well, programme=str(programme.resolve()))
    elif code is not None:
        well = dataclasses.replace(well, error_model=code, programme="")
    return surveys.configured(well, surveys.rules)


def _show(found: Sequence[Clearance]) -> None:
    names = ("offset well", "depth m", "offset depth m", "distance m", "allowed m", "factor", "toolface deg", "level")
    table = terminal.table(names, left=("offset well",))
    for other in found:
        at = other.least
        table.add_row(
            other.name,
            f"{other.md[at]:.1f}",
            f"{other.offset_md[at]:.1f}",
            f"{other.distance[at]:.2f}",
            f"{other.allowed[at]:.2f}",
            f"{other.factor[at]:.2f}",
            f"{math.degrees(other.toolface[at]):.0f}",
            other.level.name.lower(),
        )
    terminal.output().print(table)
