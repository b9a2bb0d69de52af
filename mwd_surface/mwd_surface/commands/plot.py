# SPDX-License-Identifier: Apache-2.0
"""`mwd plot`: plot of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_sensors.core.output_files import write_whole
from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import READING, Reading, Recording, input_settings, takes
from mwd_surface.commands.speech import spoken_figure


@takes(READING)
def plot(
    bag: Recording,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write, .png or .svg.")],
    what: Annotated[
        str,
        typer.Option(
            help="What to plot: sensors, rig, truth, attitude, surveys, spectra or allan, separated by commas; or all."
        ),
    ] = "sensors,attitude,surveys",
    topic: Annotated[list[str] | None, typer.Option(help="Plot only this topic. May be repeated.")] = None,
    *,
    reading: Reading,
) -> None:
    """
    Plot a recording: sensors, rig, truth, attitude, surveys, spectra, Allan deviation.

    Sensor data are plotted as `mwd process` reads them: in SI units, each sample once, the two parts of an IMU joined.
    For a long recording the lowest and highest value of each short interval are plotted, so that no spike is lost.

    \b
    Examples:
      mwd plot bags/run_7 -o run_7.png
      mwd plot bags/run_7 -o vibration.svg --what spectra --start 60 --end 120
      mwd plot bags/run_7 -o all.png --what all
      mwd plot bags/two_wells -o well_2.png --topic /well_2/imu/data_raw --topic /well_2/imu/mag
    """
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.plots import bag_plots
    from mwd_surface.plots.plot_data import gather
    from mwd_surface.plots.traces import WHAT

    kind = output.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise ValueError(f"--output {output}: a plot must be .png or .svg")
    words = [word.strip() for word in what.split(",") if word.strip()]
    words = list(WHAT) if words == ["all"] else words
    if not words:
        raise ValueError(f"--what {what!r}: name at least one of {', '.join(WHAT)}")
    given = input_settings(reading)
    with Bag(bag) as opened, terminal.progress(f"reading {bag.name}") as progress:
        data = gather(opened, words, given, topic or (), progress=progress)
        notes = list(dict.fromkeys(opened.notes))
    picture = bag_plots.image(spoken_figure(bag_plots.figure(data, words)), kind)
    output.parent.mkdir(parents=True, exist_ok=True)
    write_whole(output, picture)
    terminal.warn(*notes, *data.remarks)
    drawn = ", ".join(bag_plots.sections(data, words))
    terminal.tell(f"{output}: {drawn} of {data.name}, {data.seconds:.1f} s")
