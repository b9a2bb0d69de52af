# SPDX-License-Identifier: Apache-2.0
"""Merge of a tool's memory into the log of a run: clock, gaps filled, and what was improved."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.logs.depth_log import FIRST, Curve, DepthLog, on_grid, shift_between
from mwd_surface.logs.memory_clock import MemoryClock, Rotation
from mwd_surface.logs.recorded_log import RIG, topic_of

GRAVITY = "gravity"


@dataclasses.dataclass(frozen=True)
class Improvement:
    """
    What the memory adds to one channel.

    Attributes
    ----------
    channel : str
    steps, before, filled : int
        Depth steps of the merged log, those that the run had, and those that the memory fills.
    sigma_before, sigma_after : float
        Median 1 sigma of the steps that both have; NaN if none.
    depth_shift, correlation : float
        Depth shift of the memory against the run, m, and their correlation; NaN if unknown.
    """

    channel: str
    steps: int
    before: int
    filled: int
    sigma_before: float
    sigma_after: float
    depth_shift: float
    correlation: float


def in_run_time(samples: Iterable[LogSample], clock: MemoryClock) -> list[LogSample]:
    """Return samples of the memory with the stamps of the run."""
    return [dataclasses.replace(one, stamp_ns=clock.run_ns(one.stamp_ns)) for one in samples]


def combined(run: Iterable[LogSample], memory: Iterable[LogSample], begin_ns: int, end_ns: int) -> list[LogSample]:
    """
    Return the samples of the memory, and those of the run of the channels and times that the memory does not have.

    begin_ns, end_ns : run time of the first and last data of the memory.
    """
    memory = list(memory)
    channels = {one.channel for one in memory}
    # The memory counted the same pulses as the words of the run: both together would count them twice.
    kept = [one for one in run if one.channel not in channels or not begin_ns <= one.stamp_ns <= end_ns]
    return kept + memory


def improvements(run: DepthLog, merged: DepthLog, memory: DepthLog) -> list[Improvement]:
    """Return what the memory adds to each channel, first pass."""
    found = []
    for name in merged.channels:
        after = merged.curve(name, FIRST)
        before = run.curve(name, FIRST) if name in run.channels else None
        known = np.isfinite(after.value)
        had = np.zeros(len(known), dtype=bool)
        sigmas = (np.array([]), np.array([]))
        if before is not None and len(before.depth):
            had, sigmas = _common(before, after, run.step_m)
        shift = correlation = float("nan")
        if before is not None and name in memory.channels:
            shift, correlation = shift_between(before, memory.curve(name, FIRST))
        both = np.isfinite(sigmas[0]) & np.isfinite(sigmas[1])
        found.append(
            Improvement(
                channel=name,
                steps=int(known.sum()),
                before=int(had.sum()),
                filled=int((known & ~had).sum()),
                sigma_before=float(np.median(sigmas[0][both])) if both.any() else float("nan"),
                sigma_after=float(np.median(sigmas[1][both])) if both.any() else float("nan"),
                depth_shift=shift,
                correlation=correlation,
            )
        )
    return found


def _common(before: Curve, after: Curve, step_m: float) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return which steps of `after` have a value before, and the sigmas of the steps that both have."""
    depth, (old, new) = on_grid((before, after), step_m)
    value, sigma = np.full((2, len(depth)), np.nan)
    value[old], sigma[old] = before.value, before.sigma
    had = np.isfinite(value[new])
    both = had & np.isfinite(after.value)
    return had, (sigma[new][both], after.sigma[both])


def rotation_of_rig(bag: Bag, well: str = "") -> Rotation:
    """
    Return the speed of the top drive in a recording.

    Raises
    ------
    BagError
        It has none.
    """
    name = topic_of(bag, RIG, wire.RIG_STATE.type_name, well)
    if name is None:
        raise BagError(f"{bag.path} has no rig data, {RIG}", "the clocks are compared by the rotation that it has")
    samples, _ = wire.decode_messages(wire.RIG_STATE, [data for _, _, _, data in bag.messages([name])])
    known = (samples["valid"] & wire.RIG_VALID["rotary_speed"]) != 0
    return _rising(samples["stamp_ns"][known], samples["rotary_speed"][known])


def rotation_of_memory(bag: Bag, well: str = "") -> Rotation:
    """
    Return the speed of the tool in a dump of its memory.

    Raises
    ------
    BagError
        It has none.
    """
    name = topic_of(bag, GRAVITY, wire.GRAVITY.type_name, well)
    if name is None:
        raise BagError(f"{bag.path} has no rotary speed, {GRAVITY}", "is it a dump of a memory (`mwd memory dump`)?")
    samples, _ = wire.decode_messages(wire.GRAVITY, [data for _, _, _, data in bag.messages([name])])
    return _rising(samples["stamp_ns"], samples["rotary_speed"])


def _rising(stamps: np.ndarray, speed: np.ndarray) -> Rotation:
    order = np.argsort(stamps, kind="stable")
    stamps, speed = stamps[order], speed[order]
    keep = np.isfinite(speed) & (np.diff(stamps, prepend=stamps[:1] - 1) > 0)
    return Rotation(stamps[keep], speed[keep])
