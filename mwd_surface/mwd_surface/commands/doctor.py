"""`mwd doctor`: what is missing on this machine and how to get it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def doctor(
    output: Annotated[Path, typer.Option("--output", "-o", help="Where recordings would go.")] = Path("runs"),
) -> None:
    """
    Say what is missing on this machine and how to get it.

    Ends with status 1 where something is missing that the graph cannot do without.

    \b
    Example:
      mwd doctor
    """
    import os

    from rich.markup import escape
    from rich.table import Table

    from mwd_estimation.gravity import methods as gravity
    from mwd_surface.commands import terminal
    from mwd_surface.runs.doctor import Level, examine

    marks = {Level.OK: "[green]ok[/]", Level.NOTE: "[yellow]note[/]", Level.MISSING: "[red]missing[/]"}
    results = examine(os.environ, output)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("", "what", "how it is"):
        table.add_column(name, overflow="fold")
    for result in results:
        # The remedy stands in a line of its own, which no narrow terminal cuts.
        remedy = f"\n[dim]->[/] {escape(result.remedy)}" if result.remedy else ""
        table.add_row(marks[result.level], result.name, escape(result.state) + remedy)
    console = terminal.output()
    console.print(table, soft_wrap=False)
    methods = "; ".join(f"{method.name} ({method.doc})" for method in gravity.METHODS.values())
    console.print(f"gravity methods: {methods}", markup=False)
    missing = sum(result.level == Level.MISSING for result in results)
    console.print("everything that is needed is here" if not missing else f"{missing} things are missing")
    raise typer.Exit(1 if missing else 0)
