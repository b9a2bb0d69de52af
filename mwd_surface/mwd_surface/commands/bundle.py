# SPDX-License-Identifier: Apache-2.0
"""`mwd bundle`: zip file for a bug report."""

from __future__ import annotations

import datetime
import os
from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.version import version_lines


def bundle(
    folder: Annotated[Path, typer.Argument(metavar="RUN|BAG", help="Folder of a run or a well, or a recording.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Zip file to write; by default mwd_bundle_TIME.zip.")
    ] = None,
    minutes: Annotated[
        float, typer.Option(help="Minutes to include from the end of the newest recording; 0: none.")
    ] = 5.0,
) -> None:
    """
    Pack the data for a bug report: versions, checks of the machine, settings, logs, surveys, last minutes recorded.

    Secrets are not included: tokens, passwords and the name of your home folder are left out.

    \b
    Example:
      mwd bundle out/20260301_060000_well_1
    """
    from mwd_surface.runs.bundle import write

    if minutes < 0.0:
        raise ValueError(f"--minutes {minutes:g}: must be 0 or more")
    target = output or Path(f"mwd_bundle_{datetime.datetime.now(tz=datetime.UTC):%Y%m%d_%H%M%S}.zip")
    with terminal.waiting("packing"):
        packed = write(folder, target.resolve(), minutes, "\n".join(version_lines()), os.environ)
    terminal.warn(*packed.remarks)
    what = f"; contains the end of {packed.recording}" if packed.recording is not None and not packed.remarks else ""
    size = target.stat().st_size / 1e6
    terminal.tell(f"{target}: {len(packed.names)} files, {size:.1f} MB{what}")
    terminal.tell("check the file before you send it: a recording contains data of the well")
