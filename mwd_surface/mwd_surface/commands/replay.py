# SPDX-License-Identifier: Apache-2.0
"""`mwd replay`: publish a recording again, for nodes to process as if it were live."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from mwd_surface.commands.node import node_main


def replay(
    context: typer.Context,
    bag: Annotated[Path, typer.Argument(help="Folder of a recording, or its .mcap, .db3 or .bag file.")],
    rate: Annotated[float, typer.Option(help="Speed relative to real time; 0: as fast as possible.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end, until Ctrl-C.")] = False,
    start: Annotated[float, typer.Option(help="Start this many seconds after the first message.")] = 0.0,
    end: Annotated[float | None, typer.Option(help="End this many seconds after the first message.")] = None,
    topic: Annotated[list[str] | None, typer.Option(help="Publish only this topic. May be repeated.")] = None,
    sensors: Annotated[
        bool,
        typer.Option(
            "--sensors", help="Publish only the topics of sonde and rig, so that estimator and surface can run live."
        ),
    ] = False,
    no_clock: Annotated[bool, typer.Option("--no-clock", help="Do not publish /clock.")] = False,
    wait: Annotated[
        float, typer.Option(help="Longest time to wait for subscribers before the first message, s.")
    ] = 3.0,
) -> None:
    """
    Publish the messages of a recording again, with their stamps and in their order, and /clock.

    Remappings and other ROS arguments can follow after --ros-args.

    \b
    Examples:
      mwd replay bags/run_7
      mwd replay bags/run_7 --sensors --rate 5 --start 60 --end 120
      mwd replay bags/run_7 --loop --ros-args -r /well_1/imu/mag:=/well_2/imu/mag
    """
    from mwd_surface.bags.bag_reader import Bag
    from mwd_surface.runs.launch_plan import parameter_words
    from mwd_surface.runs.supervise import die_with_supervisor

    die_with_supervisor(os.environ)
    main = node_main("mwd_surface.nodes.replay")
    from mwd_surface.nodes.replay import ReplaySettings, published_topics

    # Check the options here, to report errors before the middleware starts.
    asked = ReplaySettings(topics=list(topic or ()), sensors_only=sensors, clock_hz=0.0 if no_clock else 1.0)
    with Bag(bag) as opened:
        published_topics(opened, asked)
    if end is not None and end <= start:
        raise ValueError(f"--end {end:g}: must be after --start {start:g}")
    given: dict[str, Any] = {
        "bag": str(bag.resolve()),
        "rate": rate,
        "loop": loop,
        "start_s": start,
        "end_s": end or 0.0,
        "sensors_only": sensors,
        "wait_for_listener_s": wait,
    }
    given |= {"topics": topic} if topic else {}
    given |= {"clock_hz": 0.0} if no_clock else {}
    words = ["replay", "--ros-args", *parameter_words(given), *_extra(context.args)]
    sys.exit(main(words))


def _extra(words: list[str]) -> list[str]:
    return words[1:] if words[:1] == ["--ros-args"] else words
