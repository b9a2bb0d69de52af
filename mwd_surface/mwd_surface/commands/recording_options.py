# SPDX-License-Identifier: Apache-2.0
"""Options for all commands that read a recording; an option has the name of the setting that it sets."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mwd_surface.commands.option_group import OptionGroup
from mwd_surface.commands.reference_options import INPUT_PANEL, given_settings
from mwd_surface.commands.sources import recording_at

if TYPE_CHECKING:
    from mwd_surface.processing.bag_input import InputSettings

Recording = Annotated[
    Path,
    typer.Argument(
        help="Folder of a rosbag2 recording, of a run or of results, or an .mcap, .db3 or .bag file.",
        callback=recording_at,
    ),
]
#: Values of the options for reading a recording, by name of the setting.
Reading = Mapping[str, Any]


def _text(words: str, *names: str) -> Any:
    return Annotated[str | None, typer.Option(*names, help=words, rich_help_panel=INPUT_PANEL)]


def _seconds(words: str, name: str) -> Any:
    return Annotated[float | None, typer.Option(name, help=words, rich_help_panel=INPUT_PANEL)]


_OPTIONS: dict[str, Any] = {
    "imu_topic": _text("Topic of the IMU, or of the gyro if gyro and accelerometer have separate topics."),
    "accel_topic": _text("Topic of the accelerometer, if the topic of the IMU has only the gyro."),
    "mag_topic": _text("Topic of the magnetometer."),
    "gyro_topic": _text("Topic of the high-precision gyro unit."),
    "temperature_topic": _text("Topic of the IMU's temperature."),
    "rig_topic": _text("Topic of the rig data, which give the depths."),
    "accel_unit": _text("Unit of specific force: m/s2, g or mg."),
    "gyro_unit": _text("Unit of angular rate: rad/s or deg/s."),
    "mag_unit": _text("Unit of the field: T, mT, uT, nT, G or mG."),
    "stamps": _text(
        "Times of the samples: header (stamps in the messages), or recording (times of recording) if the sensor clocks "
        "disagree or were not set.",
        "--stamps",
    ),
    "start_s": _seconds("Start this many seconds after the first message.", "--start"),
    "end_s": _seconds("End this many seconds after the first message.", "--end"),
    "partial": Annotated[
        bool | None,
        typer.Option("--partial", help="Use the readable part of a damaged recording.", rich_help_panel=INPUT_PANEL),
    ],
}

#: Options for reading a recording; a command has them as the argument `reading` (see `Reading`).
READING = OptionGroup("reading", dict, _OPTIONS)


def given_names(reading: Reading) -> list[str]:
    """Return the names of the given options, as written on the command line."""
    from mwd_surface.processing.bag_input import option_of

    return [option_of(name) for name, value in reading.items() if value]


def input_settings(reading: Reading, **more: Any) -> InputSettings:
    """
    Return the input settings from the options of a command; more: further settings of the input.

    Raises
    ------
    ValueError
        The end is not later than the start, or a value is not allowed.
    """
    from mwd_surface.processing.bag_input import InputSettings

    start, end = reading["start_s"] or 0.0, reading["end_s"]
    if end is not None and end <= start:
        raise ValueError(f"--end {end:g}: must be after --start {start:g}")
    return given_settings(InputSettings, {**reading, **more})
