# SPDX-License-Identifier: Apache-2.0
"""`mwd doctor`: check of this machine or of a pressure file, with remedies."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal

if TYPE_CHECKING:
    from mwd_surface.runs.doctor import CheckResult


def doctor(
    file: Annotated[
        Path | None,
        typer.Argument(help="Standpipe pressure (CSV, WAV or recording) to check instead of this machine."),
    ] = None,
    tool: Annotated[
        Path | None, typer.Option(help="YAML file of the configuration of the tool whose signal is in FILE.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for recordings; its free disk space is checked.")
    ] = Path("runs"),
    gauge: Annotated[int, typer.Option(help="Pressure gauge to read, if FILE has two: 1 or 2.")] = 1,
    topic: Annotated[str, typer.Option(help="Topic of the pressure, if a recording has several.")] = "",
    columns: Annotated[str, typer.Option(help="Columns of FILE by name or number, as in `mwd decode`.")] = "",
) -> None:
    """
    Check this machine, or a file of standpipe pressure, and suggest remedies.

    The command ends with status 1 if something essential is missing.

    \b
    Examples:
      mwd doctor
      mwd doctor pressure.csv --tool tool.yaml
    """
    from mwd_surface.runs.doctor import examine

    if file is not None:
        from mwd_sensors.telemetry import tool_configuration
        from mwd_surface.receiver import pressure_files
        from mwd_surface.runs.pressure_doctor import examine_pressure

        configuration = tool_configuration.read(tool) if tool is not None else None
        link = "mud_pulse" if configuration is None else configuration.link
        if configuration is not None and configuration.code == "serial":
            raise ValueError("--tool: a tool on a serial line sends bytes, not a pressure; check them with mwd decode")
        results = examine_pressure(pressure_files.read(file, gauge, topic, link, columns), configuration)
        _show(results)
    else:
        results = examine(os.environ, output)
        _show(results)
    missing = sum(result.level.name == "MISSING" for result in results)
    if file is None and not missing:
        # Import here, because these imports fail if a package is missing.
        from mwd_estimation.gravity import methods as gravity

        methods = "; ".join(f"{method.name} ({method.doc})" for method in gravity.METHODS.values())
        terminal.tell(f"gravity methods: {methods}")
    present = "everything needed is present" if file is None else "no check of the file failed"
    terminal.tell(present if not missing else f"{missing} things are missing")
    raise typer.Exit(1 if missing else 0)


def _show(results: list[CheckResult]) -> None:
    from rich.markup import escape

    from mwd_surface.commands.spoken_console import SpokenTable
    from mwd_surface.runs.doctor import CheckLevel

    marks = {CheckLevel.OK: "[green]ok[/]", CheckLevel.NOTE: "[yellow]note[/]", CheckLevel.MISSING: "[red]missing[/]"}
    table = SpokenTable(box=None, padding=(0, 2, 0, 0))
    for name in ("", "check", "state"):
        table.add_column(name, overflow="fold")
    for result in results:
        # Print the remedy on a line of its own, which a narrow terminal does not cut.
        remedy = f"\n[dim]->[/] {escape(result.remedy)}" if result.remedy else ""
        table.add_row(marks[result.level], result.name, escape(result.state) + remedy)
    terminal.output().print(table, soft_wrap=False)
