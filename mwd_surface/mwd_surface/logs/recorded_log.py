# SPDX-License-Identifier: Apache-2.0
"""Log samples of a recording, merged by depth as the surface node merges them live."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mwd_sensors.core import wire
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.logs.depth_log import STEP_M, DepthLog
from mwd_surface.surveys.depth import DepthRules, DepthTrack

TOPICS = ("log", "link/log")
RIG = "rig/state"


def recorded_samples(bag: Bag, well: str = "") -> list[LogSample]:
    """
    Return the log samples that a recording holds, in order of recording.

    Those of the tool itself are preferred to those that a link brought. well: its namespace, if there are several.

    Raises
    ------
    BagError
        The recording has none, or those of several wells and none is named.
    """
    for relative in TOPICS:
        name = topic_of(bag, relative, LogSample.MESSAGE, well)
        if name is not None:
            return [LogSample.from_message(bag.decode(name, data)) for _, _, _, data in bag.messages([name])]
    raise BagError(
        f"{bag.path} has no log samples" + (f" of {well}" if well else ""),
        "use `--compute` to compute them from the counts and the IMU, if it has these",
    )


def merged(
    bag: Bag,
    samples: Iterable[LogSample],
    sensor_to_bit: float,
    *,
    well: str = "",
    rules: DepthRules | None = None,
    step_m: float = STEP_M,
) -> DepthLog:
    """
    Return samples merged by the depths of the rig in a recording.

    sensor_to_bit: distance from the sonde to the bit, m, for channels that do not say where their sensor is.

    Raises
    ------
    BagError
        The recording has no rig data.
    """
    log, track = DepthLog(sensor_to_bit, step_m), DepthTrack(rules)
    for stamp_ns, bit_depth in rig_depths(bag, well):
        if track.update(stamp_ns, bit_depth) and track.latest is not None:
            log.add_depth(*track.latest)
    log.add(samples)
    log.finish()
    return log


def rig_depths(bag: Bag, well: str = "") -> Iterator[tuple[int, float]]:
    """
    Yield stamp, ns, and bit depth, m, of each valid message of the rig, in order of recording.

    Raises
    ------
    BagError
        The recording has no rig data.
    """
    name = topic_of(bag, RIG, wire.RIG_STATE.type_name, well)
    if name is None:
        raise BagError(f"{bag.path} has no depth of the bit, {RIG}", "log samples need it: record the rig's data")
    for _, _, _, data in bag.messages([name]):
        row = wire.RIG_STATE.decode(data)[0]
        if row["valid"] & wire.RIG_VALID["bit_depth"]:
            yield int(row["stamp_ns"]), float(row["bit_depth"])


def topic_of(bag: Bag, relative: str, type_name: str, well: str = "") -> str | None:
    """
    Return the topic of a well by its relative name; None if the recording has no message of it.

    Raises
    ------
    BagError
        Several wells have it, and none is named.
    """
    wanted = f"/{well.strip('/')}/{relative}" if well.strip("/") else f"/{relative}"
    names = [t.name for t in bag.topics.values() if t.type_name == type_name and t.count]
    exact = [name for name in names if "/" + name.strip("/") == wanted]
    found = exact or [name for name in names if ("/" + name.strip("/")).endswith(wanted)]
    # `link/log` ends with /log too.
    found = [name for name in found if relative.startswith("link/") or not name.strip("/").endswith("link/" + relative)]
    if len(found) > 1:
        raise BagError(f"{bag.path} has {relative} of several wells: {', '.join(found)}", "name one with --well")
    return found[0] if found else None
