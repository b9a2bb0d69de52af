# SPDX-License-Identifier: Apache-2.0
"""Recorded input of a link: its samples and the strokes of the pumps, on one clock."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mwd_sensors.core import gauge_burst
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.receiver.lone_stamps import lone

_FLUID = "sensor_msgs/msg/FluidPressure"


class RecordedLink(NamedTuple):
    """Times, s, and samples, shape (n,); strokes of each pump, s; description of time 0."""

    time_s: Array
    value: Array
    strokes: dict[int, Array]
    origin: str


def read(path: Path, link: str, topic: str = "") -> RecordedLink:
    """
    Return the recorded samples of a link.

    Time 0 is the first sample, as it was for the live receiver; for FluidPressure it is the whole second in which the
    recording begins. A recording without samples gives empty arrays.

    Parameters
    ----------
    link : str
        mud_pulse, em, coil or serial.
    topic : str
        Name of the topic or its end; empty selects the usual topic.

    Raises
    ------
    BagError
        The path is not a recording, or has no such topic.
    """
    usual, kind = gauge_burst.TOPICS[link]
    with Bag(path) as bag:
        suffix = topic or usual.rpartition("/")[2]
        if link == "mud_pulse" and not any(one.type_name == kind for one in bag.topics.values()):
            return _fluid_pressure(bag, suffix)
        name = bag.find_topic(kind, suffix)
        bursts = [gauge_burst.decode(data, kind) for _, _, _, data in bag.messages([name])]
        if not bursts:
            return RecordedLink(np.zeros(0), np.zeros(0), {}, "an empty recording")
        begins = np.array([(one[0] - bursts[0][0]) / NANOSECONDS for one in bursts])
        bursts = [one for one, wrong in zip(bursts, lone(begins), strict=True) if not wrong]
        origin = bursts[0][0]
        times = [(start - origin) / NANOSECONDS + period * np.arange(len(values)) for start, period, values in bursts]
        strokes = _strokes(bag, name, origin) if link == "mud_pulse" else {}
    values = np.concatenate([one[2] for one in bursts])
    return RecordedLink(np.concatenate(times), values, strokes, f"{origin / NANOSECONDS:.3f} s Unix time")


def topics_of(bag: Bag) -> list[str]:
    """Return the topics from which `read` can take the samples of a link: one for each link that was recorded."""
    kinds = {**gauge_burst.TOPICS, "gauge": (gauge_burst.TOPICS["mud_pulse"][0], _FLUID)}
    found = {}
    for link, (usual, kind) in kinds.items():
        with contextlib.suppress(BagError):
            found[link] = bag.find_topic(kind, usual.rpartition("/")[2])
    if "mud_pulse" in found:
        found.pop("gauge", None)
    return list(found.values())


def _strokes(bag: Bag, pressure_topic: str, origin: int) -> dict[int, Array]:
    """
    Return the stroke times of each pump, s after `origin`, ns, from the topic `strokes` next to a pressure topic.

    The dict is empty if there is no such topic.
    """
    name = pressure_topic.rpartition("/")[0] + "/strokes"
    if name not in bag.topics or bag.topics[name].type_name != gauge_burst.STROKES:
        return {}
    found: dict[int, list[float]] = {}
    for _, _, _, data in bag.messages([name]):
        message = bag.decode(name, data)
        for pump, at in zip(message.pump, message.stamp, strict=True):
            found.setdefault(int(pump), []).append((at.sec * NANOSECONDS + at.nanosec - origin) / NANOSECONDS)
    return {pump: np.array(times) for pump, times in found.items()}


def _fluid_pressure(bag: Bag, suffix: str) -> RecordedLink:
    name = bag.find_topic(_FLUID, suffix)
    start = bag.start_ns // NANOSECONDS
    rows = []
    for _, _, _, data in bag.messages([name]):
        message = bag.decode(name, data)
        stamp = message.header.stamp
        rows.append((stamp.sec - start + stamp.nanosec * 1e-9, message.fluid_pressure))
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return RecordedLink(table[:, 0], table[:, 1], {}, f"{start} s of Unix time")
