# SPDX-License-Identifier: Apache-2.0
"""`mwd tools`: comparison of the two tools of a probe, the conventional and the gyro tool, in simulated holes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.commands import terminal
from mwd_surface.commands.scenario import scenario_names


def tools(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENARIO...",
            help="Scenarios: names (see `mwd scenario list`) or YAML files.",
            autocompletion=scenario_names,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV file to write, with all stations.", metavar="CSV")
    ] = None,
    angles: Annotated[
        AngleConvention | None,
        typer.Option(help="Vertical angle of the tables; by default that of each scenario."),
    ] = None,
) -> None:
    """
    Compare the conventional tool of a probe with its gyro tool, station by station, in simulated holes.

    The azimuth of the conventional tool is the uncorrected magnetic azimuth, the azimuth of the gyro tool comes from
    north seeking; both are from true north. A survey is taken at the end of each rest.

    \b
    Examples:
      mwd tools s1_lab s1_field --angles dip_down
      mwd tools s1_field -o tools.csv
    """
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
    from mwd_surface.commands.spoken_console import SpokenTable
    from mwd_surface.runs.tool_comparison import COMPARISON_COLUMNS, compared, comparison_cells
    from mwd_surface.signals.cells import table as csv_table

    lines: list[dict[str, str]] = []
    for name in scenarios:
        story = read(scenario_files.find(name).resolve())
        convention = angles or AngleConvention(story.well.convention)
        with terminal.progress(f"surveying {story.name}"):
            stations = compared(story)
        heading = convention.heading if convention.points else "inclination"
        shown = SpokenTable(title=f"{story.name} (deg, azimuth from true north)", title_justify="left", box=None)
        titles = ("depth m", f"{heading} conv.", "gyro", "true", "azimuth conv.", "gyro", "true", "error conv.", "gyro")
        for title in titles:
            shown.add_column(title, justify="right")
        for station in stations:
            cells = comparison_cells(station, convention)
            shown.add_row(*cells)
            lines.append(dict(zip(COMPARISON_COLUMNS, (story.name, convention.value, *cells), strict=True)))
        terminal.output().print(shown)
    if output is not None:
        terminal.write(output.parent, {output.name: csv_table(COMPARISON_COLUMNS, lines)})
