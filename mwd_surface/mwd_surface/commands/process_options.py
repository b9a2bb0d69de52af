# SPDX-License-Identifier: Apache-2.0
"""Options of `mwd process`, named as the settings they set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands.reference_options import FIELD_PANEL

_INPUT, _OUTPUT = "Input", "Output"

Recording = Annotated[Path, typer.Argument(help="Folder of a rosbag2 recording, or its .mcap, .db3 or .bag file.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results; made if need be.")]
Method = Annotated[
    str | None, typer.Option("--method", help="Gravity extraction: s3, mahony, raw ... (`mwd doctor` lists them).")
]
NorthName = Annotated[
    str | None,
    typer.Option("--north", help="North of the azimuth: magnetic, true or grid.", rich_help_panel=FIELD_PANEL),
]
ImuTopic = Annotated[str | None, typer.Option(help="Topic of the IMU.", rich_help_panel=_INPUT)]
MagTopic = Annotated[str | None, typer.Option(help="Topic of the magnetometer.", rich_help_panel=_INPUT)]
GyroTopic = Annotated[str | None, typer.Option(help="Topic of the precision unit.", rich_help_panel=_INPUT)]
TemperatureTopic = Annotated[str | None, typer.Option(help="Topic of the IMU's temperature.", rich_help_panel=_INPUT)]
RigTopic = Annotated[str | None, typer.Option(help="Topic of the rig state, for depths.", rich_help_panel=_INPUT)]
AccelUnit = Annotated[str | None, typer.Option(help="m/s2, g or mg.", rich_help_panel=_INPUT)]
GyroUnit = Annotated[str | None, typer.Option(help="rad/s or deg/s.", rich_help_panel=_INPUT)]
MagUnit = Annotated[str | None, typer.Option(help="T, mT, uT, nT, G or mG.", rich_help_panel=_INPUT)]
Stamps = Annotated[
    str | None,
    typer.Option(
        "--stamps",
        help="Times of the samples: header, or recording where clocks of sensors disagree or were not set.",
        rich_help_panel=_INPUT,
    ),
]
Start = Annotated[
    float | None,
    typer.Option("--start", help="Begin this many seconds after the first message.", rich_help_panel=_INPUT),
]
End = Annotated[
    float | None, typer.Option("--end", help="End this many seconds after the first message.", rich_help_panel=_INPUT)
]
SensorToBit = Annotated[
    float | None,
    typer.Option(
        "--sensor-to-bit", help="Sonde behind the bit, m; else as the recording says.", rich_help_panel=_INPUT
    ),
]
Depths = Annotated[
    str | None,
    typer.Option(
        "--depths",
        help="Table of depths, CSV: time and bit_depth_m, or survey and md_m.",
        metavar="FILE",
        rich_help_panel=_INPUT,
    ),
]
Accelerometer = Annotated[
    str | None,
    typer.Option(help="What it reads at rest: up (specific force) or down (gravity).", rich_help_panel=_INPUT),
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(help="Calibration of the IMU and magnetometer, from `mwd calibrate`.", rich_help_panel=_INPUT),
]
MountOption = Annotated[
    list[str] | None,
    typer.Option(
        "--mount",
        help="How the units sit in the tool: z-down, x-up ..., nine numbers, a quaternion x,y,z,w, or tf; of one unit "
        "as mag=z-down (imu, mag, precision). May be repeated.",
        metavar="[UNIT=]MOUNT",
        rich_help_panel=_INPUT,
    ),
]
Format = Annotated[
    str | None, typer.Option("--format", "-f", help="Attitude as csv, parquet or mcap.", rich_help_panel=_OUTPUT)
]
Rate = Annotated[
    float | None,
    typer.Option("--rate", help="At most so many rows of attitude a second.", metavar="HZ", rich_help_panel=_OUTPUT),
]
Smooth = Annotated[
    bool,
    typer.Option("--smooth", help="Gravity from what came after each sample too: never live.", rich_help_panel=_OUTPUT),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the results of a run that are in the folder.")]
Partial = Annotated[
    bool, typer.Option("--partial", help="Use what can be read of a damaged bag.", rich_help_panel=_INPUT)
]
