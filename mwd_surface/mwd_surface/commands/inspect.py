# SPDX-License-Identifier: Apache-2.0
"""`mwd inspect`: contents of a recording, missing data for each result, and the command to process it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mwd_surface.commands import terminal
from mwd_surface.commands.shared_options import (
    PLACE,
    READING,
    GivenPlace,
    Mount,
    Reading,
    Recording,
    input_settings,
    mount_changes,
    placed_settings,
    recording_changes,
    takes,
)

if TYPE_CHECKING:
    from mwd_surface.bags.topic_info import TopicInfo


@takes(PLACE, READING)
def inspect(
    bag: Recording,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Output folder to write into the printed command.")
    ] = Path("out"),
    mount: Mount = None,
    *,
    place: GivenPlace,
    reading: Reading,
) -> None:
    """
    Inspect a recording: topics, rates, units, signs, mount, gaps, clocks, and missing data for each result.

    Prints the `mwd process` command for the recording, and the `mwd decode` command if the recording has the signal of
    a telemetry link. If you give the place (--lat, --lon), the signs and axes of the magnetometer are also found.

    \b
    Examples:
      mwd inspect bags/run_7
      mwd inspect other.bag --lat 58.44 --lon 1.88
    """
    from mwd_surface.bags.bag_reader import Bag, BagError
    from mwd_surface.processing.inspection import figures
    from mwd_surface.processing.inspection import inspect as look_through
    from mwd_surface.receiver import recorded_link
    from mwd_surface.surveys.recorded_settings import recorded_settings

    with Bag(bag) as opened, terminal.progress(f"reading {bag.name}") as progress:
        recorded = recorded_settings(opened)
        estimator = placed_settings(
            None, None, recording_changes(*place), tool=mount_changes(mount), start=recorded.estimator
        )
        own = recorded.estimator if recorded.source else None
        links = recorded_link.topics_of(opened)
        tool = str(bag / "tool.yaml") if (bag / "tool.yaml").is_file() else "TOOL.yaml"
        decoding = shlex.join(["mwd", "decode", str(bag), "--tool", tool, "-o", str(output)]) if links else ""
        try:
            found = look_through(opened, input_settings(reading), estimator, output, progress, own)
        except BagError as error:
            if not links:
                raise
            terminal.facts([("telemetry", ", ".join(links)), ("no survey", error.sentence)], 14)
            terminal.tell(f"\n{decoding}")
            return
        others = [t for t in opened.topics.values() if t.count and t.name not in (*found.topics.all, *links)]
        notes, complete = list(opened.notes), opened.complete
    topics = found.topics
    names = {
        "IMU" if topics.accelerometer is None else "gyro": topics.imu,
        "accelerometer": topics.accelerometer,
        "magnetometer": topics.mag,
        "precision unit": topics.precision,
        "temperature": topics.temperature,
        "rig": topics.rig,
    }
    lines = []
    for what, name in names.items():
        if name is not None and name in found.times and found.times[name].count:
            frame = found.frames.get(name, "")
            lines.append((what, f"{name}: {figures(found.times[name])}" + (f", frame {frame}" if frame else "")))
    words = {"accel_unit": "specific force", "gyro_unit": "angular rate", "mag_unit": "field"}
    read = words if found.topics.mag is not None else ("accel_unit", "gyro_unit")
    lines += [
        ("units", ", ".join(f"{words[name]} in {unit}" for name, unit in found.units.items() if name in read)),
        ("mount", found.mount),
        (
            "turning",
            f"{found.turns_about} in axes of the IMU"
            if found.turns_about
            else "the tool never turns in this recording, so its axes were not checked",
        ),
        ("at rest", _rests(found.rests, found.rest_s)),
        ("surveys", _verdicts(found.surveys)),
        ("settings", recorded.source or "none in the recording"),
    ]
    if links:
        lines.append(("telemetry", f"{', '.join(links)}: `{decoding}` decodes the words that the surface received"))
    if others:
        lines.append(("not used", _not_used(others)))
    lines += [("missing", f"for {result}: {need}") for result, need in found.missing]
    terminal.facts(lines, 14)
    terminal.warn(*notes, *found.remarks)
    if not complete:
        terminal.warn(f"the recording is cut off or damaged; `mwd recover {bag}` repairs it")
    if found.refusal:
        raise ValueError(f"`mwd process` cannot process {bag}: {found.refusal}")
    terminal.tell(f"\n{found.command}")


def _rests(count: int | None, longest_s: float) -> str:
    """Return a text on the number of intervals at rest long enough for a survey, and on the longest interval, s."""
    if count is None:
        return "not known, because there are fewer than the 3 samples in each half second that a survey needs"
    return f"{count} times long enough for a survey, longest {longest_s:.0f} s"


def _not_used(topics: list[TopicInfo]) -> str:
    """Return a text on topics that are not used: the names of foreign topics, and the number of topics of mwd_msgs."""
    foreign = [f"{topic.name} ({topic.type_name})" for topic in topics if not topic.type_name.startswith("mwd_msgs/")]
    own = len(topics) - len(foreign)
    return ", ".join([*foreign, *([f"{own} of this program's own topics (see `mwd bag info`)"] if own else [])])


def _verdicts(surveys: list[str]) -> str:
    """Return the number of surveys with each verdict, as text."""
    counts = {verdict: surveys.count(verdict) for verdict in dict.fromkeys(surveys)}
    return f"{len(surveys)}: " + ", ".join(f"{n} {verdict}" for verdict, n in counts.items()) if surveys else "none"
