# SPDX-License-Identifier: Apache-2.0
"""`mwd memory`: recording in the memory of a tool, and its merge into the log and the surveys of a run."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Annotated

import typer

from mwd_sensors.core.output_files import write_whole
from mwd_surface.commands import terminal
from mwd_surface.commands.log import check_log_options

memory = typer.Typer(
    help="Use the data in the tool's memory: fill the gaps of the real-time log, and revise the surveys.",
    no_args_is_help=True,
)


@memory.command()
def dump(
    recording: Annotated[Path, typer.Argument(help="Recording of the sensors, such as `mwd simulate` writes.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the dump to write.")],
    tool: Annotated[
        Path | None, typer.Option(help="YAML file of the tool configuration with the log channels.")
    ] = None,
    interval: Annotated[int, typer.Option(help="Time between two log samples, s.", min=1, max=60)] = 2,
    clock_offset: Annotated[
        float, typer.Option(help="Error of the tool's clock at the start, s; positive: fast.")
    ] = 0.0,
    clock_drift: Annotated[
        float, typer.Option(help="Drift of the tool's clock, ppm; positive: the clock gains time.")
    ] = 0.0,
) -> None:
    """
    Simulate a dump of a tool's memory: log channels at a higher rate, rotation and surveys, by the tool's own clock.

    \b
    Examples:
      mwd memory dump runs/sensors -o dump --clock-offset 40 --clock-drift 30
      mwd memory dump runs/sensors -o dump --tool tool.yaml --interval 1
    """
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.processing import log_estimate
    from mwd_surface.processing.log_estimate import channels_of
    from mwd_surface.surveys.recorded_settings import recorded_settings

    clock = log_estimate.DumpClock(clock_offset, clock_drift * 1e-6)
    with Bag(recording) as bag:
        recorded = recorded_settings(bag)
        channels = channels_of(tool)
        samples, taken = log_estimate.dump_memory(bag, output, channels, clock, interval_s=interval, recorded=recorded)
    terminal.tell(f"{output}: {samples} log samples, one every {interval} s, and {taken} surveys")


@memory.command()
def merge(
    run: Annotated[Path, typer.Argument(help="Recording of the run, with rig data and the real-time log.")],
    memory: Annotated[Path, typer.Argument(help="Dump of the tool's memory.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Log to write: .las, .csv, .parquet or .xml (WITSML).")
    ],
    which: Annotated[str, typer.Option("--pass", help="first, deepest or all, as for `mwd log`.")] = "first",
    step: Annotated[float, typer.Option(help="Depth step, m.", min=0.01, max=10.0)] = 0.1,
    well: Annotated[str, typer.Option(help="Namespace of the well, if the run has several.")] = "",
    surveys: Annotated[
        Path | None,
        typer.Option(help="JSON file to write, with the survey list of the run revised from the memory."),
    ] = None,
) -> None:
    """
    Merge a dump of a tool's memory into the log of a run: fill its gaps, and print the improvements.

    Offset and drift of the tool's clock are found from the rotation that rig and tool have both recorded. Where the
    memory has samples of a channel, they replace the samples of the run; where the memory has a gap, the samples of
    the run remain.

    With --surveys, a survey that was received over the telemetry link is revised with the readings in the memory, and a
    survey that was never received is added; `mwd report` and `mwd export` read the file.

    \b
    Examples:
      mwd memory merge runs/gamma dump -o gamma.las
      mwd memory merge runs/gamma dump -o gamma.csv --step 0.2 --surveys surveys.json
    """
    from mwd_surface.bags.bag_reader import Bag, BagError
    from mwd_surface.logs import memory_merge
    from mwd_surface.logs.log_files import FORMATS, gap_lines
    from mwd_surface.logs.memory_clock import memory_clock
    from mwd_surface.logs.recorded_log import recorded_samples
    from mwd_surface.runs.player import recorded_book, recorded_surface
    from mwd_surface.surveys.recorded_settings import recorded_settings
    from mwd_surface.surveys.survey_source import surveys_of
    from mwd_surface.surveys.survey_store import encoded
    from mwd_surface.surveys.well import Well

    check_log_options(output, which)
    with Bag(run) as bag, Bag(memory) as dumped:
        described = recorded_settings(bag).well(Well())
        clock = memory_clock(memory_merge.rotation_of_rig(bag, well), memory_merge.rotation_of_memory(dumped))
        of_memory = memory_merge.in_run_time(recorded_samples(dumped), clock)
        try:
            of_run = recorded_samples(bag, well, recorded_surface(bag).link.source)
        except BagError:
            of_run = []
        together = memory_merge.combined(of_run, of_memory)
        book = recorded_book(bag, well, step)
        logs = [copy.deepcopy(book.logs) for _ in range(3)]
        for log, part in zip(logs, (of_run, together, of_memory), strict=True):
            log.add(part)
            log.finish()
        of_tool = memory_merge.recorded_surveys(dumped) if surveys is not None else []
    output.parent.mkdir(parents=True, exist_ok=True)
    write_whole(output, FORMATS[output.suffix.lower()](logs[1], which, described))
    terminal.tell(f"clock of the tool's memory: {clock}")
    for one in memory_merge.improvements(logs[0], logs[1], logs[2]):
        terminal.tell(str(one))
    if surveys is not None:
        listed, _ = surveys_of(run)
        offset = listed.well.sensor_offset
        listed, revised, added = memory_merge.with_surveys(
            listed, of_tool, clock, lambda stamp_ns: book.depth.sensor_depth(stamp_ns, offset)
        )
        surveys.parent.mkdir(parents=True, exist_ok=True)
        write_whole(surveys, encoded(listed))
        terminal.tell(f"written: {surveys} ({revised} surveys revised from the tool's memory, {added} added)")
    terminal.warn(*gap_lines(logs[1], which))
    channels = ", ".join(logs[1].channels)
    terminal.tell(f"written: {output} ({channels}; {which} pass, depth steps of {step:g} m)")
