# SPDX-License-Identifier: Apache-2.0
"""`mwd log`: log channels of a recording over depth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mwd_sensors.core.output_files import write_whole
from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import READING, Reading, Recording, input_settings, takes


def check_log_options(output: Path, which: str) -> None:
    """Raise ValueError if a log cannot have this file name, or has no such pass."""
    from mwd_surface.logs.depth_log import PASSES
    from mwd_surface.logs.log_files import FORMATS

    if output.suffix.lower() not in FORMATS:
        raise ValueError(f"--output {output}: a log must be {', '.join(FORMATS)}")
    if which not in PASSES:
        raise ValueError(f"--pass {which}: must be one of {', '.join(PASSES)}")


@takes(READING)
def log(
    recording: Recording,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write: .las, .csv, .parquet or .xml (WITSML).")
    ],
    which: Annotated[
        str,
        typer.Option(
            "--pass",
            help="Data to use. first: data measured while the sensor was deeper than ever before; deepest: data "
            "measured while the bit was on bottom; all: all data, including reaming.",
        ),
    ] = "first",
    step: Annotated[float, typer.Option(help="Depth step, m.", min=0.01, max=10.0)] = 0.1,
    well: Annotated[str, typer.Option(help="Namespace of the well, if the recording has several.")] = "",
    compute: Annotated[
        bool,
        typer.Option(
            "--compute", help="Compute the log from pulse counts and IMU, even if the recording has log samples."
        ),
    ] = False,
    tool: Annotated[
        Path | None,
        typer.Option(help="YAML file of the tool configuration with the log channels, for --compute."),
    ] = None,
    *,
    reading: Reading,
) -> None:
    """
    Write gamma and other log channels over depth: LAS 2.0, CSV, Parquet or WITSML.

    Each depth step has the mean, its 1 sigma, the duration of the measurement and the counts; gamma also has its
    sectors, the first centred on the high side. Depth steps without data stay empty; a warning lists them.

    \b
    Examples:
      mwd log runs/gamma_landing -o gamma.las
      mwd log runs/gamma_landing -o gamma.csv --pass all --step 0.5
      mwd log recording -o gamma.parquet --compute --tool tool.yaml
    """
    from mwd_estimation.settings.estimator import EstimatorSettings
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.logs.log_files import FORMATS, gap_lines
    from mwd_surface.logs.recorded_log import recorded_samples
    from mwd_surface.processing.log_estimate import channels_of, computed_samples
    from mwd_surface.runs.player import recorded_depths, recorded_surface
    from mwd_surface.surveys.recorded_settings import recorded_settings
    from mwd_surface.surveys.well import Well

    check_log_options(output, which)
    with Bag(recording) as bag:
        recorded = recorded_settings(bag)
        described = recorded.well(Well())
        if compute:
            given = input_settings(reading)
            settings = recorded.estimator or EstimatorSettings()
            samples = computed_samples(bag, settings, given, channels_of(tool), recorded)
        else:
            samples = recorded_samples(bag, well, recorded_surface(bag).link.source)
        found = recorded_depths(bag, well, step)
        found.add(samples)
        found.finish()
    output.parent.mkdir(parents=True, exist_ok=True)
    write_whole(output, FORMATS[output.suffix.lower()](found, which, described))
    terminal.warn(*gap_lines(found, which))
    for name, count in found.unplaced.items():
        terminal.warn(f"{name}: {count} samples have no depth: the rig sent no bit depth within 30 s of them")
    for reason, count in found.unusable.items():
        terminal.warn(f"{count} samples or depths are left out: {reason}")
    if found.disordered:
        terminal.warn(
            f"{found.disordered} samples came after samples with a later time, and were placed in the order of arrival"
        )
    names = ", ".join(found.channels) or "no channel"
    terminal.tell(f"written: {output} ({names}; {which} pass, depth steps of {step:g} m)")
