# SPDX-License-Identifier: Apache-2.0
"""Merge of a tool's memory into the log and the surveys of a run, and the improvement of each channel."""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.logs.depth_log import FIRST, Curve, DepthLog, on_grid, shift_between
from mwd_surface.logs.memory_clock import MemoryClock, Rotation
from mwd_surface.logs.recorded_log import RIG, topic_of
from mwd_surface.surveys.depth import DepthReading
from mwd_surface.surveys.survey_list import SurveyList

GRAVITY, SURVEY = "gravity", "survey"
# Longest time between a survey of the run and the same survey in the memory, ns. A survey over a link has the time at
# which the pumps stopped; two stations are minutes apart.
_SAME_NS = 60 * NANOSECONDS
_FROM_MEMORY = "its readings are those of the tool's memory"


@dataclasses.dataclass(frozen=True)
class Improvement:
    """Improvement of one channel by the memory."""

    channel: str
    #: `steps`, `before`, `filled`, `lost`: numbers of depth steps: with a value in the merged log; with a value in the
    #: merged log and in the run's log; with a value from the memory only; with a value in the run's log only
    steps: int
    before: int
    filled: int
    lost: int
    #: `sigma_before`, `sigma_after`: median 1 sigma in the run's log and in the merged log, over the steps with a value
    #: in both; NaN if none
    sigma_before: float
    sigma_after: float
    #: `depth_shift`, `correlation`: depth shift of the memory relative to the run, m, and correlation of the two logs;
    #: NaN if unknown
    depth_shift: float
    correlation: float

    def __str__(self) -> str:
        """Return the numbers of steps, the sigmas and the depth shift for people."""
        lost = f", {self.lost} lost" if self.lost else ""
        sigma = shift = ""
        if not math.isnan(self.sigma_before):
            sigma = f"; median sigma {self.sigma_before:.3g}, now {self.sigma_after:.3g}"
        if not math.isnan(self.depth_shift):
            shift = f"; depth shift {self.depth_shift:+.2f} m"
        filled = f"{self.filled} filled from the memory"
        return f"{self.channel}: {self.before} steps from the run, {filled}{lost}{sigma}{shift}"


def in_run_time(samples: Iterable[LogSample], clock: MemoryClock) -> list[LogSample]:
    """Return samples of the memory with stamps in run time."""
    return [dataclasses.replace(one, stamp_ns=clock.run_ns(one.stamp_ns)) for one in samples]


def combined(run: Iterable[LogSample], memory: Iterable[LogSample]) -> list[LogSample]:
    """
    Return the samples of the memory, and those parts of the samples of the run that the memory does not cover.

    Both have the same pulses of a detector, which must not be counted twice. In gaps of the memory, the data of the run
    are kept. Values and sectors are compared separately, because a link sends them in separate samples.
    """
    memory = list(memory)
    covered = {key: _covered(ends) for key, ends in _intervals(memory).items()}
    kept = []
    for one in run:
        begins, ends = covered.get(_key(one), _NOTHING)
        kept += [_part(one, *part) for part in _uncovered(_ends_ns(one), begins, ends)]
    return kept + memory


def recorded_surveys(bag: Bag) -> list[Survey]:
    """
    Return the surveys in a dump of the memory.

    Raises
    ------
    BagError
        The dump has no surveys.
    """
    name = topic_of(bag, SURVEY, Survey.MESSAGE)
    if name is None:
        raise BagError(f"{bag.path} has no surveys, {SURVEY}", "is it a dump of a memory (`mwd memory dump`)?")
    return [Survey.from_message(bag.decode(name, data)) for _, _, _, data in bag.messages([name])]


def with_surveys(
    listed: SurveyList, surveys: Sequence[Survey], clock: MemoryClock, depth_of: Callable[[int], DepthReading]
) -> tuple[SurveyList, int, int]:
    """
    Return the survey list of a run with the surveys of the memory, and the numbers of revised and of new surveys.

    A survey of the memory becomes the revised value of the run's survey that is nearest in time, if that survey came
    over a link and is within a minute. Without a survey within a minute, the survey of the memory is added to the list.

    Parameters
    ----------
    listed : SurveyList
        List of the run.
    surveys : sequence of Survey
        Surveys of the memory, with stamps of the memory's clock.
    depth_of : callable
        Function that returns the depth of the sensor at a stamp of the run, ns.

    Raises
    ------
    ValueError
        A survey cannot be in a list: a number in it is not finite or out of range.
    """
    revised = added = 0
    free = list(listed.records)
    for one in sorted(surveys, key=lambda survey: survey.stamp_ns):
        moved = dataclasses.replace(one, stamp_ns=clock.run_ns(one.stamp_ns))
        same = min(free, key=lambda record: abs(record.survey.stamp_ns - moved.stamp_ns), default=None)
        if same is None or abs(same.survey.stamp_ns - moved.stamp_ns) > _SAME_NS:
            reading = depth_of(moved.stamp_ns)
            listed = listed.add(moved, reading.measured_depth, reading.depth_age, comment="from the tool's memory")
            added += 1
            continue
        free.remove(same)
        known = same.survey
        if not known.link:
            # The survey did not come over a link, so the run already has its readings in full resolution.
            continue
        revision, headline = same.newest_revision + 1, moved.headline or _FROM_MEMORY
        listed = listed.revise(dataclasses.replace(moved, uuid=known.uuid, revision=revision, headline=headline))
        revised += 1
    return listed, revised, added


_Ends = tuple[int, int]
_Covered = tuple[list[int], list[int]]
_NOTHING: _Covered = ([], [])
# Gaps of a memory and parts of a sample that are shorter than this, ns, are due to rounded stamps and clock errors.
_ROUNDING_NS = NANOSECONDS // 2


def _key(sample: LogSample) -> tuple[str, bool]:
    """Return the channel of a sample, and True if the sample has a value, False if it has sectors only."""
    return sample.channel, math.isfinite(sample.value)


def _ends_ns(sample: LogSample) -> _Ends:
    half = round(0.5 * sample.span * NANOSECONDS)
    return sample.stamp_ns - half, sample.stamp_ns + half


def _intervals(samples: Iterable[LogSample]) -> dict[tuple[str, bool], list[_Ends]]:
    """Return the intervals of each channel, ns, with a value (key: channel, True) and with sectors (channel, False)."""
    found: dict[tuple[str, bool], list[_Ends]] = {}
    for one in samples:
        ends = _ends_ns(one)
        if math.isfinite(one.value):
            found.setdefault((one.channel, True), []).append(ends)
        if any(map(math.isfinite, one.sectors)):
            found.setdefault((one.channel, False), []).append(ends)
    return found


def _covered(intervals: list[_Ends]) -> _Covered:
    """Return the beginnings and the ends of the union of intervals, increasing, ns."""
    begins: list[int] = []
    ends: list[int] = []
    for begin, end in sorted(intervals):
        if ends and begin <= ends[-1] + _ROUNDING_NS:
            ends[-1] = max(ends[-1], end)
        else:
            begins.append(begin)
            ends.append(end)
    return begins, ends


def _uncovered(whole: _Ends, begins: list[int], ends: list[int]) -> list[_Ends]:
    """Return the parts of the interval `whole`, ns, that a union of intervals does not cover; its length may be 0."""
    begin, last = whole
    first = bisect.bisect_left(ends, begin)
    if begin == last:
        return [] if first < len(begins) and begins[first] <= begin else [whole]
    found, at = [], begin
    for k in range(first, bisect.bisect_left(begins, last)):
        found.append((at, begins[k]))
        at = ends[k]
    found.append((at, last))
    least = min(_ROUNDING_NS, last - begin)
    return [part for part in found if part[1] - part[0] >= least]


def _part(sample: LogSample, begin: int, end: int) -> LogSample:
    """Return the part of a sample between two times, ns: the same value, with a share of its time and counts."""
    whole = _ends_ns(sample)
    if (begin, end) == whole:
        return sample
    share = (end - begin) / (whole[1] - whole[0])
    # Only a counting error grows when there are fewer counts.
    grown = 1.0 if math.isnan(sample.counts) else 1.0 / math.sqrt(share)
    return dataclasses.replace(
        sample,
        stamp_ns=(begin + end) // 2,
        span=sample.span * share,
        duration=sample.duration * share,
        sigma=sample.sigma * grown,
        counts=sample.counts * share,
        sigma_sectors=tuple(sigma * grown for sigma in sample.sigma_sectors),
        sector_durations=tuple(seconds * share for seconds in sample.sector_durations),
    )


def improvements(run: DepthLog, merged: DepthLog, memory: DepthLog) -> list[Improvement]:
    """Return the improvement of each channel by the memory, in the first logging pass."""
    found = []
    for name in merged.channels:
        after = merged.curve(name, FIRST)
        before = run.curve(name, FIRST) if name in run.channels else None
        known = np.isfinite(after.value)
        had, lost = np.zeros(len(known), dtype=bool), 0
        sigmas = (np.array([]), np.array([]))
        if before is not None and len(before.depth):
            had, sigmas = _common(before, after, run.step_m)
            lost = int(np.isfinite(before.value).sum() - (had & known).sum())
        shift = correlation = float("nan")
        if before is not None and name in memory.channels:
            shift, correlation = shift_between(before, memory.curve(name, FIRST))
        both = np.isfinite(sigmas[0]) & np.isfinite(sigmas[1])
        found.append(
            Improvement(
                channel=name,
                steps=int(known.sum()),
                before=int((had & known).sum()),
                filled=int((known & ~had).sum()),
                lost=lost,
                sigma_before=float(np.median(sigmas[0][both])) if both.any() else float("nan"),
                sigma_after=float(np.median(sigmas[1][both])) if both.any() else float("nan"),
                depth_shift=shift,
                correlation=correlation,
            )
        )
    return found


def _common(before: Curve, after: Curve, step_m: float) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return whether each step of `after` has a value in `before`, and both sigmas of steps with a value in both."""
    depth, (old, new) = on_grid((before, after), step_m)
    value, sigma = np.full((2, len(depth)), np.nan)
    value[old], sigma[old] = before.value, before.sigma
    had = np.isfinite(value[new])
    both = had & np.isfinite(after.value)
    return had, (sigma[new][both], after.sigma[both])


def rotation_of_rig(bag: Bag, well: str) -> Rotation:
    """
    Return the speed of the top drive in a recording.

    Raises
    ------
    BagError
        The recording has no rig data.
    """
    samples = _samples(bag, RIG, wire.RIG_STATE, well, "the clocks are compared by the rotation in the rig data")
    known = (samples["valid"] & wire.RIG_VALID["rotary_speed"]) != 0
    return _rising(samples["stamp_ns"][known], samples["rotary_speed"][known])


def rotation_of_memory(bag: Bag) -> Rotation:
    """
    Return the speed of the tool in a dump of its memory.

    Raises
    ------
    BagError
        The dump has no gravity samples.
    """
    samples = _samples(bag, GRAVITY, wire.GRAVITY, "", "is it a dump of a memory (`mwd memory dump`)?")
    return _rising(samples["stamp_ns"], samples["rotary_speed"])


def _samples(bag: Bag, topic: str, layout: wire.Layout, well: str, remedy: str) -> Samples:
    """Return the samples of a topic. Raises BagError with the remedy if the recording has none."""
    name = topic_of(bag, topic, layout.type_name, well)
    if name is None:
        raise BagError(f"{bag.path} has no rotation, {topic}", remedy)
    return wire.decode_messages(layout, [data for _, _, _, data in bag.messages([name])])[0]


def _rising(stamps: np.ndarray, speed: np.ndarray) -> Rotation:
    order = np.argsort(stamps, kind="stable")
    stamps, speed = stamps[order], speed[order]
    keep = np.isfinite(speed) & (np.diff(stamps, prepend=stamps[:1] - 1) > 0)
    return Rotation(stamps[keep], speed[keep])
