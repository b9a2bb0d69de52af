# SPDX-License-Identifier: Apache-2.0
"""`mwd export` and `mwd report`: surveys as files for other programs and people, from a run or a recording."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_sensors.core import settings
from mwd_surface import __version__
from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    READING,
    PlanSet,
    Reading,
    assignments,
    given_names,
    input_settings,
    read_plan_option,
    takes,
)
from mwd_surface.commands.sources import estimated, recording_at, survey_list_at
from mwd_surface.exports.export import FORMATS, export_file, safe_name

if TYPE_CHECKING:
    from mwd_surface.exports.survey_table import SurveyTable

Source = Annotated[
    Path, typer.Argument(metavar="SURVEYS", help="Folder of a run or well, a surveys.json file, or a recording.")
]
PlanFile = Annotated[
    Path | None, typer.Option("--plan", help="File of the planned path; adds the distances from the plan.")
]
LegName = Annotated[str | None, typer.Option("--leg", help="Leg of the well to use; by default the current leg.")]
Bit = Annotated[
    float | None,
    typer.Option(
        "--bit-depth", help="Measured depth of the bit, m; the path is extended from the last survey to this depth."
    ),
]
WellChanges = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Fact about the well that replaces the one in the list, e.g. well.rig='Rig 7'. May be repeated.",
        metavar="NAME=VALUE",
    ),
]


@takes(READING)
def export(
    source: Source,
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            "-f",
            help=f"Format: {', '.join(FORMATS)} or timeseries; by default the format of the file name of -o, else csv.",
        ),
    ] = "",
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write, or folder for a file named after the well.")
    ] = Path(),
    plan: PlanFile = None,
    plan_set: PlanSet = None,
    leg: LegName = None,
    bit_depth: Bit = None,
    changes: WellChanges = None,
    well: Annotated[
        str, typer.Option(help="Namespace of the well, if a recording has several (timeseries only).")
    ] = "",
    *,
    reading: Reading,
) -> None:
    """
    Write the surveys of a run or a recording for other programs and people.

    csv, las and witsml contain the definitive survey; raw_csv contains every survey with its six axes. All formats show
    the same rounded numbers. Files are written completely or not at all. timeseries has one row per second of a
    recording, with depth, rig data, and attitude with sigmas, as .csv or .parquet. A recording without attitude is
    processed first, with the settings in the recording. The input options are only for timeseries.

    \b
    Examples:
      mwd export out/run_7 -f las -o files
      mwd export out/run_7 -o survey.csv
      mwd export bags/run_7 -f timeseries -o run_7.csv
      mwd export bags/run_7 -f witsml -o trajectory.xml --set well.name=Alpha-1 --set well.section_azimuth_deg=75
    """
    if kind == "timeseries" or (not kind and output.suffix == ".parquet"):
        _time_series(source, output, well, reading)
        return
    if names := given_names(reading):
        raise ValueError(f"{names[0]}: works only with -f timeseries; `mwd process` computes surveys from a recording")
    endings = {made.ending: name for name, made in reversed(FORMATS.items())}
    ending = output.suffix.lower() if not output.is_dir() else ""
    chosen = kind or endings.get(ending, "csv")
    folder, name = (output, "")
    if ending in endings:
        if chosen in FORMATS and FORMATS[chosen].ending != ending:
            raise ValueError(f"--output {output}: {chosen} is written as {FORMATS[chosen].ending}")
        folder, name = output.parent, output.name
    is_report = chosen in FORMATS and FORMATS[chosen].is_report
    table = _table(source, (plan, plan_set), leg, bit_depth, changes, with_logs=is_report)
    path = export_file(table, chosen, folder, name)
    terminal.tell(f"written: {path}")


def report(
    source: Source,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the HTML file and the PDF.")] = Path(),
    plan: PlanFile = None,
    plan_set: PlanSet = None,
    leg: LegName = None,
    bit_depth: Bit = None,
    changes: WellChanges = None,
) -> None:
    """
    Write the survey report as an HTML file and a PDF: head block, tables, plots, quality control, slide sheet.

    Only the folder of a run has a slide sheet; the report of a recording has none.

    \b
    Examples:
      mwd report out/run_7 -o reports
      mwd report out/run_7 -o reports --plan plan.csv --set well.company="Open Drilling"
    """
    table = _table(source, (plan, plan_set), leg, bit_depth, changes, with_logs=True)
    for kind in ("html", "pdf"):
        path = export_file(table, kind, output)
        terminal.tell(f"written: {path}")


def _time_series(source: Path, output: Path, well: str, reading: Reading) -> None:
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.exports import time_series
    from mwd_surface.processing.bag_input import InputSettings, refuse_damaged, worth_saying
    from mwd_surface.processing.run_config import processed_input

    path = output if output.suffix and not output.is_dir() else output / f"{safe_name(source.stem, 'timeseries')}.csv"
    given, read = input_settings(reading), processed_input(source)
    with contextlib.ExitStack() as held:
        opened = held.enter_context(Bag(recording_at(source)))
        notes = worth_saying(opened)
        refuse_damaged(opened, given)
        if not time_series.has_attitude(opened, well) and time_series.has_imu(opened, given):
            opened = held.enter_context(estimated(opened, given, read))
            given = InputSettings(rig_topic=given.rig_topic)
        progress = held.enter_context(terminal.progress(f"reading {source.name}"))
        written = time_series.write(opened, path, well, given, progress)
        notes += written.remarks
    if written.late:
        notes.append(f"{written.late} samples were left out because they came more than half a minute late")
    terminal.warn(*notes)
    terminal.tell(f"written: {path} ({written.rows} rows of {', '.join(written.topics)})")


def _table(
    source: Path,
    plan: tuple[Path | None, list[str] | None],
    leg: str | None,
    bit_depth: float | None,
    changes: list[str] | None,
    *,
    with_logs: bool,
) -> SurveyTable:
    """
    Return the table of surveys that is exported or reported, with everything that a report needs.

    plan: file of the plan, and settings for reading this file. with_logs: whether to add logs and health of the tool,
    for which a recording is played from its beginning to its end. Raises ValueError if the list has no survey, or if
    `changes` has other settings than well.*.
    """
    from mwd_surface.exports.report_clearance import clearance_sections
    from mwd_surface.exports.report_logs import health_section, log_section
    from mwd_surface.exports.survey_table import survey_table
    from mwd_surface.runs.player import run_logs
    from mwd_surface.surveys.survey_source import stretches_of

    surveys, notes = survey_list_at(source)
    given = assignments(changes)
    if given:
        strange = [name for name in given if not name.startswith("well.")]
        if strange:
            raise ValueError(f"--set {strange[0]}: only well.* can be set here, for example --set well.rig='Rig 7'")
        well = settings.changed(surveys.well, {name.removeprefix("well."): v for name, v in given.items()})
        surveys = surveys.configured(well, surveys.rules)
    stretches, unread = stretches_of(source)
    terminal.warn(*notes, *unread)
    if not surveys.records:
        raise ValueError(f"{source}: the list has no survey")
    planned = read_plan_option(*plan, surveys.well)
    if planned is not None:
        surveys = surveys.along(planned)
    sections, remarks = clearance_sections(surveys, surveys.plan, bit_depth, leg)
    terminal.warn(*remarks)
    found = run_logs(source, surveys.well.sensor_offset) if with_logs else None
    if found is not None:
        made = (health_section(found[1], surveys.well.display), log_section(found[0].curves(), surveys.well.display))
        sections = (*sections, *(one for one in made if one is not None))
    table = survey_table(
        surveys,
        time.time_ns(),
        leg=leg,
        bit_depth=bit_depth,
        software=f"mwd {__version__}",
        stretches=stretches,
        sections=sections,
    )
    terminal.warn(*table.left_out)
    return table
