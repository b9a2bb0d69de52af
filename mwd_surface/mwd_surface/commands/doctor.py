# SPDX-License-Identifier: Apache-2.0
"""`mwd doctor`: what is missing on this machine, or in a file of pressure, and how to get it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mwd_surface.runs.doctor import CheckResult


def doctor(
    file: Annotated[
        Path | None,
        typer.Argument(help="Standpipe pressure (CSV, WAV, recording) to look at instead of this machine."),
    ] = None,
    tool: Annotated[Path | None, typer.Option(help="Tool configuration, YAML, whose words FILE shall give.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Where recordings would go.")] = Path("runs"),
) -> None:
    """
    Say what is missing on this machine, or what a file of standpipe pressure is good for, and how to mend it.

    Ends with status 1 where something is missing that cannot be done without.

    \b
    Examples:
      mwd doctor
      mwd doctor pressure.csv --tool tool.yaml
    """
    import os

    from mwd_surface.commands import terminal
    from mwd_surface.runs.doctor import examine

    console = terminal.output()
    if file is not None:
        from mwd_sensors.telemetry import tool_configuration
        from mwd_surface.receiver import pressure_files
        from mwd_surface.runs.pressure_doctor import examine_pressure

        configuration = tool_configuration.read(tool) if tool is not None else None
        results = examine_pressure(pressure_files.read(file), configuration)
        _show(results)
    else:
        results = examine(os.environ, output)
        _show(results)
    missing = sum(result.level.name == "MISSING" for result in results)
    if file is None and not missing:
        # Imports what may be missing.
        from mwd_estimation.gravity import methods as gravity

        methods = "; ".join(f"{method.name} ({method.doc})" for method in gravity.METHODS.values())
        console.print(f"gravity methods: {methods}", markup=False)
    console.print("everything that is needed is here" if not missing else f"{missing} things are missing")
    raise typer.Exit(1 if missing else 0)


def _show(results: list[CheckResult]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from mwd_surface.commands import terminal
    from mwd_surface.runs.doctor import Level

    marks = {Level.OK: "[green]ok[/]", Level.NOTE: "[yellow]note[/]", Level.MISSING: "[red]missing[/]"}
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("", "what", "how it is"):
        table.add_column(name, overflow="fold")
    for result in results:
        # The remedy stands in a line of its own, which no narrow terminal cuts.
        remedy = f"\n[dim]->[/] {escape(result.remedy)}" if result.remedy else ""
        table.add_row(marks[result.level], result.name, escape(result.state) + remedy)
    terminal.output().print(table, soft_wrap=False)
