# SPDX-License-Identifier: Apache-2.0
"""Options of `mwd process`; an option has the name of the setting that it sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands.recording_options import INPUT_PANEL
from mwd_surface.commands.reference_options import FIELD_PANEL

_OUTPUT = "Output"

Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; created if missing.")]
Method = Annotated[
    str | None,
    typer.Option(
        "--method",
        help="Method that estimates gravity (see `mwd doctor`); by default the method in the recording, else bounded.",
    ),
]
NorthName = Annotated[
    str | None,
    typer.Option(
        "--north",
        help="North of the azimuths: magnetic, true, grid, or best (grid if known, else true, else magnetic).",
        rich_help_panel=FIELD_PANEL,
    ),
]
SensorToBit = Annotated[
    float | None,
    typer.Option(
        "--sensor-to-bit",
        help="Distance of the sonde behind the bit, m; by default the distance in the recording, else 0.",
        rich_help_panel=INPUT_PANEL,
    ),
]
Depths = Annotated[
    str | None,
    typer.Option(
        "--depths",
        help="CSV table of depths, with columns time and bit_depth_m, or survey and md_m; by default the rig's depths.",
        metavar="FILE",
        rich_help_panel=INPUT_PANEL,
    ),
]
Accelerometer = Annotated[
    str | None,
    typer.Option(
        help="Direction in which the accelerometer reads at rest: up (specific force) or down (gravity).",
        rich_help_panel=INPUT_PANEL,
    ),
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(help="YAML file from `mwd calibrate`, to correct IMU and magnetometer.", rich_help_panel=INPUT_PANEL),
]
MountOption = Annotated[
    list[str] | None,
    typer.Option(
        "--mount",
        help="Orientation of the units in the tool: the axis that points down-hole or up-hole (z-down, x-up ...), nine "
        "numbers (matrix from unit to tool axes), a quaternion x,y,z,w, or tf (static transforms). For one unit: "
        "imu=, mag= or precision= before it. May be repeated.",
        metavar="[UNIT=]MOUNT",
        rich_help_panel=INPUT_PANEL,
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format", "-f", help="Format of the attitude: csv (default), parquet or mcap.", rich_help_panel=_OUTPUT
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        "--rate",
        help="Largest number of attitude rows per second, Hz; by default one row for every IMU message.",
        metavar="HZ",
        rich_help_panel=_OUTPUT,
    ),
]
Smooth = Annotated[
    bool,
    typer.Option(
        "--smooth", help="Also use later samples to estimate gravity (method bounded only).", rich_help_panel=_OUTPUT
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the results of an earlier run in the folder.")]
