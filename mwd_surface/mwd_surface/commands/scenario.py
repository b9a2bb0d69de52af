# SPDX-License-Identifier: Apache-2.0
"""`mwd scenario list` and `mwd simulate`: list the scenarios, and record a scenario without any middleware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mwd_surface.commands import terminal

Seed = Annotated[int | None, typer.Option(help="Seed of the random numbers; by default the seed of the scenario.")]
scenario = typer.Typer(no_args_is_help=True, help="Scenarios of the simulated sonde.")


@scenario.command("list")
def list_() -> None:
    """
    List the scenarios included with the project.

    \b
    Example:
      mwd scenario list
    """
    from mwd_sensors.simulator import scenario_files
    from mwd_sensors.simulator.scenario import read
    from mwd_surface.commands.spoken_console import SpokenTable

    table = SpokenTable()
    table.add_column("name", no_wrap=True)
    table.add_column("description")
    for name, path in scenario_files.names().items():
        table.add_row(name, read(path).about)
    terminal.output().print(table, soft_wrap=False)


def scenario_names(begin: str) -> list[str]:
    """Return the names of scenarios with this beginning, for command line completion."""
    from mwd_sensors.simulator import scenario_files

    return [name for name in scenario_files.names() if name.startswith(begin)]


def simulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="Scenario: a name (see `mwd scenario list`) or a YAML file.",
            autocompletion=scenario_names,
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the recording; must not exist yet.")],
    seed: Seed = None,
    namespace: Annotated[str, typer.Option(help="Namespace of the topics, for example /well_2.")] = "",
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
    from mwd_surface.runs.simulate import record

    changes: dict[str, Any] = {} if seed is None else {"seed": seed}
    path = scenario_files.find(scenario)
    run = read(path, changes)
    with terminal.progress(f"simulating {run.name}") as progress:
        count, seconds = record(run, output, namespace, path.read_bytes(), progress)
    terminal.tell(f"{output}: {count} messages, {seconds:.1f} s of {run.name}")
