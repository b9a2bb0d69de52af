# SPDX-License-Identifier: Apache-2.0
"""`mwd bag info` and `mwd recover`: contents of a recording, and repair of a damaged recording."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

import typer

from mwd_surface.commands import terminal

bag = typer.Typer(no_args_is_help=True, help="Inspect and repair recordings.")


@bag.command()
def info(
    path: Annotated[Path, typer.Argument(metavar="BAG", help="Folder of a recording, or an .mcap, .db3 or .bag file.")],
) -> None:
    """
    Show topics, types, counts, rates and defects of a recording.

    \b
    Example:
      mwd bag info bags/run_7
    """
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.bags.mcap.writer import is_being_written

    with Bag(path) as opened:
        start = datetime.datetime.fromtimestamp(opened.start_ns * 1e-9, tz=datetime.UTC)
        terminal.tell(f"{path}: {opened.message_count} messages, {opened.size_bytes / 1e6:.1f} MB")
        about = f"from {start:%Y-%m-%d %H:%M:%S} UTC, {opened.duration_s:.1f} s; rates are means over this time"
        terminal.tell(about)
        topics = sorted([*opened.topics.values(), *opened.unreadable.values()], key=lambda one: one.name)
        longest = max(len(topic.name) for topic in topics)
        kinds = max(len(topic.type_name) for topic in topics)
        for topic in topics:
            rate = (topic.count - 1) / opened.duration_s if topic.count > 1 and opened.duration_s > 0.0 else 0.0
            often = f"{rate:9.1f} Hz" if rate else ""
            line = f"  {topic.name:<{longest}}  {topic.type_name:<{kinds}}  {topic.count:>9}{often}"
            terminal.tell(line.rstrip())
        for attachment in opened.attachments():
            terminal.tell(f"attached: {attachment.name} ({len(attachment.data)} bytes)")
        terminal.warn(*opened.notes)
        if is_being_written(opened.path):
            terminal.remark(f"{path} is being recorded")
        elif not opened.complete:
            raise ValueError(f"{path} is cut off or damaged; `mwd recover {path}` repairs it")


def recover(
    path: Annotated[Path, typer.Argument(metavar="BAG", help="Folder of a recording, or one of its files.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Recording to write: a new .mcap file for an .mcap file, a new folder for a .db3 or .bag file; not "
            "for a folder of .mcap files. By default .recovered is added to the name of the original.",
        ),
    ] = None,
) -> None:
    """
    Save every intact message of a recording that was cut off or damaged; the original is kept.

    In a folder of MCAP files, the repaired file gets the name of the damaged file, and the damaged file is renamed to
    end in .damaged. Otherwise the messages are saved to a new recording next to the original.

    \b
    Examples:
      mwd recover bags/run_7
      mwd recover run_7_0.mcap -o saved.mcap
      mwd recover old.bag -o saved
    """
    from mwd_surface.bags import salvage

    if not path.exists():
        raise FileNotFoundError(2, "recording not found", str(path))
    reports = salvage.recover(path, output)
    for report in reports:
        terminal.tell(report.sentence())
        terminal.warn(*report.notes)
        if report.target is not None:
            terminal.tell(f"written: {report.target}")
    if not any(report.messages for report in reports):
        raise ValueError(f"{path}: nothing could be saved")


bag.command("recover")(recover)
