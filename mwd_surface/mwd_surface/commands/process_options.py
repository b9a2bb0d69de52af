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
    str | None, typer.Option("--method", help="Gravity extraction: s3, mahony, raw ... (`mwd doctor` lists them).")
]
NorthName = Annotated[
    str | None,
    typer.Option("--north", help="North of the azimuth: magnetic, true or grid.", rich_help_panel=FIELD_PANEL),
]
SensorToBit = Annotated[
    float | None,
    typer.Option(
        "--sensor-to-bit",
        help="Distance of the sonde behind the bit, m; by default that of the recording.",
        rich_help_panel=INPUT_PANEL,
    ),
]
Depths = Annotated[
    str | None,
    typer.Option(
        "--depths",
        help="Table of depths, CSV: time and bit_depth_m, or survey and md_m.",
        metavar="FILE",
        rich_help_panel=INPUT_PANEL,
    ),
]
Accelerometer = Annotated[
    str | None,
    typer.Option(help="Its reading at rest: up (specific force) or down (gravity).", rich_help_panel=INPUT_PANEL),
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(help="Calibration of the IMU and magnetometer, from `mwd calibrate`.", rich_help_panel=INPUT_PANEL),
]
MountOption = Annotated[
    list[str] | None,
    typer.Option(
        "--mount",
        help="Mount of the units in the tool: z-down, x-up ..., nine numbers, a quaternion x,y,z,w, or tf; one unit "
        "as mag=z-down (imu, mag, precision). May be repeated.",
        metavar="[UNIT=]MOUNT",
        rich_help_panel=INPUT_PANEL,
    ),
]
Format = Annotated[
    str | None, typer.Option("--format", "-f", help="Attitude as csv, parquet or mcap.", rich_help_panel=_OUTPUT)
]
Rate = Annotated[
    float | None,
    typer.Option("--rate", help="Largest number of attitude rows per second.", metavar="HZ", rich_help_panel=_OUTPUT),
]
Smooth = Annotated[
    bool,
    typer.Option("--smooth", help="Smooth gravity with later samples. Works offline only.", rich_help_panel=_OUTPUT),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the results of an earlier run in the folder.")]
