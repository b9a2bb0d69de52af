# SPDX-License-Identifier: Apache-2.0
"""`mwd rig`: the interfaces to the rig of a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mwd_surface.rig.status import RigStatus

rig = typer.Typer(help="Interfaces to the rig: WITS, OPC UA, Modbus, WITSML.", no_args_is_help=True)


@rig.command()
def status(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(help="Folder of a run or a well; by default out/ here and ~/mwd_data.", show_default=False),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For programs: one JSON list.")] = False,
) -> None:
    """
    Show the rig interfaces of running graphs: state and address, peers, rates, drops, last values.

    Ends with status 1 where none runs.

    \b
    Examples:
      mwd rig status
      mwd rig status ~/mwd_data/well_1 --json
    """
    import dataclasses
    import json
    import time

    from mwd_surface.commands import terminal
    from mwd_surface.rig.status import RigStatusError, read_status, status_files, status_lines

    places = folders or [Path("out"), Path("~/mwd_data").expanduser()]
    now, console = time.time(), terminal.output()
    running: list[tuple[Path, RigStatus]] = []
    gone: list[tuple[Path, RigStatus]] = []
    for path in status_files(places):
        try:
            found = read_status(path)
        except (OSError, RigStatusError) as error:
            terminal.warn(str(error))
            continue
        (running if found.alive(now) else gone).append((path, found))
    if as_json:
        table = [{"folder": str(path.parent), **dataclasses.asdict(found)} for path, found in running]
        typer.echo(json.dumps(table))
    else:
        for path, found in running:
            console.print(f"{found.well} ({path.parent})", markup=False)
            for line in status_lines(found.interfaces, found.written):
                console.print(f"  {line}", markup=False)
        for path, found in gone:
            age = now - found.written
            terminal.warn(
                f"{found.well} ({path.parent}) last reported {age:.0f} s ago: its surface hangs or was killed"
            )
        if not running:
            where = ", ".join(str(place) for place in places)
            console.print(f"no graph runs whose folder is below {where}", markup=False)
            console.print("start one with `mwd run`, or name the folder of its surface node", markup=False)
    raise typer.Exit(0 if running else 1)


@rig.command("manifest")
def print_manifest() -> None:
    """
    Print the D-WIS manifest of all signals, as a blackboard is sent it.

    \b
    Examples:
      mwd rig manifest > manifest.json
    """
    import json

    from mwd_surface.rig.blackboard.manifest import manifest

    typer.echo(json.dumps(manifest(), indent=2))
