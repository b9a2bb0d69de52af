# SPDX-License-Identifier: Apache-2.0
"""`mwd scenario list` and `mwd simulate`: the scenarios there are, and a recording of one without any middleware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

scenario = typer.Typer(no_args_is_help=True, help="Scenarios of the simulated sonde.", rich_markup_mode="rich")


@scenario.command("list")
def list_() -> None:
    """
    The scenarios that come with the project.

    \b
    Example:
      mwd scenario list
    """
    from rich.table import Table

    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
    from mwd_surface.commands import terminal

    table = Table()
    table.add_column("name", no_wrap=True)
    table.add_column("what it shows")
    for name, path in scenario_files.names().items():
        table.add_row(name, read(path).about)
    terminal.output().print(table, soft_wrap=False)


def scenario_names(begin: str) -> list[str]:
    """Names of scenarios with this begin, for the completion of a command line."""
    from mwd_sensors.simulator import scenario_files

    return [name for name in scenario_files.names() if name.startswith(begin)]


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO", help="Name (`mwd scenario list`) or YAML file.", autocompletion=scenario_names
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the bag; must not exist.")],
    seed: Annotated[int | None, typer.Option(help="Replaces the scenario's seed.")] = None,
    namespace: Annotated[str, typer.Option(help="Namespace of the topics, such as /well_2.")] = "",
) -> None:
    """
    Record a simulated run, as fast as the machine allows and without any middleware.

    The same scenario and seed give the same samples, byte for byte.

    \b
    Examples:
      mwd simulate default -o bags/default
      mwd simulate my_well.yaml -o bags/my_well --seed 7
    """
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
    from mwd_surface.commands import terminal
    from mwd_surface.runs.simulate import record

    changes: dict[str, Any] = {} if seed is None else {"seed": seed}
    path = scenario_files.find(scenario)
    run = read(path, changes)
    with terminal.progress(f"simulating {run.name}") as progress:
        count, seconds = record(run, output, namespace, path.read_bytes(), progress)
    terminal.output().print(f"{output}: {count} messages, {seconds:.1f} s of {run.name}", markup=False)
