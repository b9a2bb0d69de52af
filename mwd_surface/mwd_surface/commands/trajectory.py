# SPDX-License-Identifier: Apache-2.0
"""`mwd trajectory`: path between the stations, from continuous measurements or the slide sheet."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import LIST, assigned, takes
from mwd_surface.commands.sources import survey_list_at
from mwd_surface.commands.speech import spoken_figure

if TYPE_CHECKING:
    from mwd_surface.list_files.list_settings import ListSettings
    from mwd_surface.surveys.survey_list import SurveyList
    from mwd_surface.trajectory.dense_trajectory import Continuous


@takes(LIST)
def trajectory(
    source: Annotated[
        Path, typer.Argument(metavar="LIST", help="Folder of a run, its surveys.json, or a list as in `mwd path`.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")],
    continuous: Annotated[
        Path | None, typer.Option(help="Table of continuous measured depth, inclination and azimuth, CSV or LAS.")
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(help="Recording from which `mwd process` made LIST, with the depths of the rig.")
    ] = None,
    slides: Annotated[
        Path | None, typer.Option(help="File of the slide sheet; by default slides.jsonl in the folder of the list.")
    ] = None,
    step: Annotated[float, typer.Option(help="Distance between the points of the path, m.")] = 1.0,
    continuous_set: Annotated[
        list[str] | None,
        typer.Option(
            help="How to read the continuous table: an option of panel List, e.g. length_unit=ft. May be repeated.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    *,
    listed: ListSettings,
) -> None:
    """
    Compute the path between the survey stations from continuous inclination and azimuth, or from the slide sheet.

    Writes DIR/trajectory.csv and DIR/trajectory.las with the differences from minimum curvature, and
    DIR/trajectory.png. The definitive list is not changed.

    \b
    Examples:
      mwd trajectory out/well_1 -o dense
      mwd trajectory processed --recording bags/run_7 -o dense
      mwd trajectory list.csv --continuous continuous.las -o dense --step 0.5
    """
    from mwd_surface.exports.trajectory_files import summary, trajectory_csv, trajectory_las
    from mwd_surface.list_files.list_file import is_list
    from mwd_surface.list_files.list_settings import ListSettings
    from mwd_surface.plots.drawing import png
    from mwd_surface.plots.path_plots import trajectory_plot
    from mwd_surface.surveys.survey_source import stretches_of
    from mwd_surface.trajectory.dense_trajectory import dense_trajectory
    from mwd_surface.trajectory.slide_sheet import read_stretches

    if continuous is not None and recording is not None:
        raise ValueError("--continuous and --recording: give only one of them")
    if listed != ListSettings() and not is_list(source):
        raise ValueError(f"{source} is the list of a run, which needs no options of panel List; omit them")
    surveys, remarks = survey_list_at(source, listed.given())
    if slides is not None and not slides.is_file():
        raise ValueError(f"--slides {slides}: file not found")
    stretches = read_stretches(slides)[0] if slides is not None else stretches_of(source)[0]
    given = (
        _of_recording(source, surveys, recording)
        if continuous is None
        else _of_table(continuous, assigned(continuous_set, "--continuous-set"))
    )
    if given is None and not stretches:
        raise ValueError(f"{source} has no slide sheet: give --slides, --continuous or --recording")
    path = surveys.definitive()
    found = dense_trajectory(path, given, stretches, step)
    terminal.warn(*remarks, *found.remarks)
    if not found.has_detail:
        terminal.warn("there are no data between the stations: every interval is computed as a circular arc")
    terminal.tell(summary(found))
    files: dict[str, str | bytes] = {
        "trajectory.csv": trajectory_csv(found, path),
        "trajectory.las": trajectory_las(found, surveys),
        "trajectory.png": png(spoken_figure(trajectory_plot(found))),
    }
    terminal.write(output, files)


def _of_table(table: Path, said: ListSettings) -> Continuous:
    """Return the continuous measurements of a table, read with the settings `said`; ListFileError if it is refused."""
    from mwd_surface.list_files.list_error import ListFileError
    from mwd_surface.list_files.list_file import read_list
    from mwd_surface.list_files.list_settings import asked
    from mwd_surface.trajectory.dense_trajectory import Continuous

    # Confirm doglegs, because samples are so close together that their noise looks like large doglegs.
    said = dataclasses.replace(said, confirm=f"{said.confirm},dogleg")
    try:
        read = read_list(table, said.given())
    except ListFileError as error:
        raise asked(error, "--continuous-set {}={}") from error
    return Continuous(read.md, read.inclination, read.azimuth)


def _of_recording(source: Path, surveys: SurveyList, recording: Path | None) -> Continuous | None:
    """
    Return the continuous measurements of a processed recording; None if no recording is given.

    Raises ValueError if the folder of `source` has no results of `mwd process`.
    """
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.processing import run_folder
    from mwd_surface.processing.continuous_log import continuous_log

    if recording is None:
        return None
    folder = source if source.is_dir() else source.parent
    if not run_folder.is_run(folder):
        raise ValueError(f"--recording: {folder} is not a folder of `mwd process` with the attitude")
    with Bag(recording) as bag:
        return continuous_log(folder, bag, surveys.well.sensor_offset)
