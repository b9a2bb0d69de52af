"""`mwd clearance`: distance to offset wells by the separation rule of the ISCWSA."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mwd_surface.surveys.clearance import Clearance
    from mwd_surface.surveys.survey_list import SurveyList
    from mwd_surface.surveys.uncertain_well import UncertainWell

_RULE = "Separation rule"


def clearance(
    source: Annotated[
        Path, typer.Argument(metavar="SURVEYS", help="Folder of `mwd path` or of a run, its surveys.json, a recording.")
    ],
    offsets: Annotated[Path, typer.Option("--offsets", help="YAML of the offset wells.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; made if need be.")],
    programme: Annotated[
        Path | None, typer.Option("--programme", help="YAML of the survey programme of the well.")
    ] = None,
    code: Annotated[str | None, typer.Option("--code", help="Tool code of the whole well.")] = None,
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Planned path: the well is continued along it, --ahead metres.")
    ] = None,
    ahead: Annotated[float, typer.Option(help="How far ahead along the plan, m.")] = 1000.0,
    leg: Annotated[str | None, typer.Option("--leg", help="Leg other than the current one.")] = None,
    hole_diameter: Annotated[
        float, typer.Option(help="Diameter of the hole that is drilled, m.", rich_help_panel=_RULE)
    ] = 0.31,
    k: Annotated[float | None, typer.Option("--k", help="Factor on the combined sigma.", rich_help_panel=_RULE)] = None,
    surface_margin: Annotated[
        float | None, typer.Option(help="Distance always kept, m.", rich_help_panel=_RULE)
    ] = None,
    projection_sigma: Annotated[
        float | None, typer.Option(help="1 sigma of the projection ahead, m.", rich_help_panel=_RULE)
    ] = None,
    warning: Annotated[float | None, typer.Option(help="Separation factor that warns.", rich_help_panel=_RULE)] = None,
    stop: Annotated[
        float | None, typer.Option(help="Separation factor that stops drilling.", rich_help_panel=_RULE)
    ] = None,
) -> None:
    """
    Compare a well with its offset wells: separation factor, distance, directions.

    Writes DIR/clearance.csv, DIR/ladder.png and DIR/travelling_cylinder.png. The offset wells stand in a YAML file:
    wells, each with name, file, north_m and east_m of its wellhead, hole_diameter_m, and code or programme. Ends with
    status 1 where a factor is below the level that stops drilling.

    \b
    Examples:
      mwd path list.csv -o a1 --lat 58.44 --lon 1.88 --date 2026-03-01
      mwd clearance a1 --offsets wells.yaml -o a1/clearance --programme programme.yaml
      mwd clearance out/run_7 --offsets wells.yaml -o out/near --plan plan.csv --ahead 500
    """
    from mwd_sensors.core import settings
    from mwd_surface.bags.bag_metadata import write_atomically
    from mwd_surface.commands import terminal
    from mwd_surface.exports.clearance_csv import clearance_csv
    from mwd_surface.plots.clearance_plots import ladder, png, travelling_cylinder
    from mwd_surface.surveys.clearance import ClearanceRule, Level
    from mwd_surface.surveys.offset_wells import clearances, read_offset_wells
    from mwd_surface.surveys.survey_source import surveys_of

    given = {
        "k": k,
        "surface_margin_m": surface_margin,
        "projection_sigma_m": projection_sigma,
        "warning_factor": warning,
        "stop_factor": stop,
    }
    rule = settings.changed(ClearanceRule(), {name: value for name, value in given.items() if value is not None})
    surveys, remarks = surveys_of(source)
    well = _well(_with_model(surveys, programme, code), leg, plan, ahead, 0.5 * hole_diameter)
    found, refused = clearances(well, read_offset_wells(offsets), rule)
    for remark in (*remarks, *refused):
        terminal.warn(remark)
    if not found:
        raise ValueError(f"--offsets {offsets}: none of the wells can be compared")
    files = {
        "clearance.csv": clearance_csv(found).encode(),
        "ladder.png": png(ladder(found)),
        "travelling_cylinder.png": png(travelling_cylinder(found)),
    }
    output.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_atomically(output / name, data)
    _show(found)
    terminal.output().print(f"written: {', '.join(str(output / name) for name in files)}", markup=False)
    if found[0].level == Level.STOP:
        raise typer.Exit(1)


def _with_model(surveys: SurveyList, programme: Path | None, code: str | None) -> SurveyList:
    import dataclasses

    if programme is not None and code is not None:
        raise ValueError("--programme and --code: give one of them; a programme names the codes")
    well = surveys.well
    if programme is not None:
        well = dataclasses.replace(well, programme=str(programme.resolve()))
    elif code is not None:
        well = dataclasses.replace(well, error_model=code, programme="")
    return surveys.configured(well, surveys.rules)


def _well(surveys: SurveyList, leg: str | None, plan: Path | None, ahead: float, radius: float) -> UncertainWell:
    from mwd_surface.surveys.plan_file import read_plan
    from mwd_surface.surveys.well_position import continued, uncertain_well

    path = surveys.definitive(leg)
    if surveys.well.sensor_to_bit > 0.0 and path.kind[-1] == "survey":
        path = surveys.definitive(leg, float(path.md[-1]) + surveys.well.sensor_to_bit)
    if plan is not None:
        planned = read_plan(plan)
        if planned.north not in ("", surveys.well.north_reference):
            raise ValueError(
                f"--plan {plan}: azimuths from {planned.north} north, those of the well from "
                f"{surveys.well.north_reference} north"
            )
        path = continued(path, planned, ahead)
    records = [surveys.find(number) if number else None for number in path.sequence]
    try:
        return uncertain_well(surveys, path, records, radius)
    except ValueError as error:
        raise ValueError(f"the position of the well has no uncertainty: {error}") from error


def _show(found: Sequence[Clearance]) -> None:
    import math

    from rich.table import Table

    from mwd_surface.commands import terminal

    table = Table(box=None, header_style="dim")
    table.add_column("offset well")
    for name in ("depth m", "its depth m", "distance m", "allowed m", "factor", "toolface deg", "level"):
        table.add_column(name, justify="right")
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
