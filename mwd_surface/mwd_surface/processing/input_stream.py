# SPDX-License-Identifier: Apache-2.0
"""
The samples of a recording as the estimator takes them: each once, on one clock, whole, and in SI.

`mwd inspect` and `mwd process` read a recording through the same stream, and refuse it for the same reasons.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.repeated_samples import RepeatedSamples
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_surface.bags.bag_reader import Bag, Block
from mwd_surface.processing.bag_input import (
    FIELDS,
    InputSettings,
    OptionNeededError,
    Topics,
    first_samples,
    in_si,
    unstamped,
    without_gravity,
)
from mwd_surface.processing.half_imu import Joiner, Kind, among_readings

# Width of the bins of time in which the clocks of a sensor and of the recorder are compared, ns.
_BIN_NS = 10 * wire.NANOSECONDS
# Clocks further apart cannot be paired, s; the delay of a message is less.
_APART_S = 1.0
# Messages in a bin that show a clock.
_FEW = 5
# Least time since 1970 of a clock that was set (1989), ns.
CLOCK_SET_NS = 7000 * 86400 * wire.NANOSECONDS
_RAW = "record the driver's raw data (its topic often ends in data_raw), or switch its removal of gravity off"


class Problem(NamedTuple):
    """Why samples cannot be used as they are; option: name and value of the setting that helps, empty: none does."""

    sentence: str
    option: tuple[str, str] | None = None


class InputStream:
    """
    Samples of a recording, block by block.

    Parameters
    ----------
    bag : Bag
    topics : Topics
    given : InputSettings

    Attributes
    ----------
    without_time : frozenset of str
        Topics whose messages carry no time of their own.
    undated : dict of str to int
        Samples left out so far because they carry no time, although others of their topic do.
    problems : list of Problem
        Why the samples taken so far cannot be used, although the first ones could.
    """

    def __init__(self, bag: Bag, topics: Topics, given: InputSettings) -> None:
        self._bag, self._topics, self._given = bag, topics, given
        self.without_time = unstamped(bag, topics)
        self.undated: dict[str, int] = {}
        self.problems: list[Problem] = []
        self._joiner = Joiner(topics.kind) if topics.accelerometer or _in_turns(topics) else None
        self._repeated = {name: RepeatedSamples() for name in topics.all}
        stamped = [name for name in topics.all if name not in self.without_time and name != topics.rig]
        self._empty_mag = topics.mag is not None and _comes_empty(bag, topics.mag)
        self._clocks = _clocks(bag, stamped) if given.stamps == "recording" else {}

    @property
    def repeated(self) -> dict[str, int]:
        """Samples left out so far because the same one had come before, by topic."""
        return {name: one.count for name, one in self._repeated.items() if one.count}

    @property
    def first_log_ns(self) -> int | None:
        """Log time of the first message of the IMU that waits for its other half, ns; None where none does."""
        return self._joiner.first_log_ns if self._joiner is not None else None

    def blocks(self) -> Iterator[Block]:
        """Yield all blocks of the recording."""
        for block in self._bag.blocks(self._topics.all, fields=FIELDS):
            yield self.take(block)
        if rest := self.finish():
            yield rest

    def take(self, block: Block) -> Block:
        """Return the block as the estimator takes it; samples of the IMU may be those of an earlier block."""
        if self._given.stamps == "header" and not self.problems:
            self.problems += _apart(self._topics, block, self.without_time)
        dated = {name: self._dated(name, *part) for name, part in block.items()}
        out: Block = {name: self._timed(name, *self._once(name, *part)) for name, part in dated.items() if len(part[0])}
        if self._empty_mag and self._topics.mag in out:
            log_ns, samples = out[self._topics.mag]
            filled = (samples["magnetic_field"] != 0.0).any(axis=1)
            out[self._topics.mag] = log_ns[filled], samples[filled]
        if self._joiner is not None:
            topics = self._topics
            self._put(out, self._joiner.push(out.pop(topics.imu, None), out.pop(topics.accelerometer or "", None)))
        return self._scaled({name: part for name, part in out.items() if len(part[0])})

    def finish(self) -> Block:
        """Return the samples that wait still."""
        out: Block = {}
        if self._joiner is not None:
            self._put(out, self._joiner.finish())
        return self._scaled(out)

    def _put(self, out: Block, joined: tuple[Stamps, Samples] | None) -> None:
        if joined is not None:
            out[self._topics.imu] = joined

    def _scaled(self, block: Block) -> Block:
        samples = in_si(block, self._topics, self._given)
        return {name: (part[0], samples[name]) for name, part in block.items()}

    def _dated(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """Leave out samples without a time among others that have one, as before a driver's clock is set."""
        if name in self.without_time:
            return log_ns, samples
        dated = (samples["stamp_ns"] != 0) | (log_ns < CLOCK_SET_NS)
        if dated.all():
            return log_ns, samples
        self.undated[name] = self.undated.get(name, 0) + int(np.count_nonzero(~dated))
        return log_ns[dated], samples[dated]

    def _once(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """Leave out samples that came before, as from a second publisher, by the rule of the live estimator."""
        fresh = self._repeated[name].fresh(samples, stamped=name not in self.without_time)
        return (log_ns, samples) if fresh.all() else (log_ns[fresh], samples[fresh])

    def _timed(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """Stamp samples without a time of their own by the recording, and bring others to its clock if asked to."""
        if name in self.without_time:
            samples["stamp_ns"] = log_ns
        elif name in self._clocks:
            at_ns, offset_ns = self._clocks[name]
            base = int(offset_ns[0])
            correction = np.interp(log_ns - at_ns[0], at_ns - at_ns[0], offset_ns - base)
            samples["stamp_ns"] += base + np.rint(correction).astype(np.int64)
        return log_ns, samples


def problems(bag: Bag, topics: Topics, given: InputSettings, place: Place) -> list[Problem]:
    """Return why the samples of a recording cannot be used as they are at a place, by the first of them."""
    found: list[Problem] = []
    accelerometer = topics.accelerometer or topics.imu
    samples = first_samples(bag, accelerometer)
    if topics.kind == Kind.GYRO and topics.accelerometer is None:
        sentence = f"{topics.imu} is the gyro of an IMU alone, and the recording has no topic of its accelerometer"
        return [Problem(f"{sentence}; record both, or name a whole IMU with --imu-topic")]
    if topics.kind in (Kind.IN_TURNS, Kind.SOME_EMPTY):
        samples = samples[(samples["linear_acceleration"] != 0.0).any(axis=1)]
    if without_gravity(samples):
        others = [
            name
            for name, about in bag.topics.items()
            if name != accelerometer and about.type_name == wire.IMU.type_name and about.count
        ]
        raw = [name for name in others if not without_gravity(first_samples(bag, name))]
        sentence = f"{accelerometer}: the driver has taken gravity off the acceleration, which inclination needs"
        option = ("imu_topic", raw[0]) if len(raw) == 1 else None
        found.append(Problem(sentence if option else f"{sentence}; {_RAW}", option))
    if given.stamps == "header":
        found += _clock_problems(bag, topics)
        if not found and place.model and not place.date and not clock_was_set(bag, topics):
            sentence = f"the clock of {topics.imu} was never set, and the field of a model needs the day"
            found.append(Problem(f"{sentence}; the recorder knows it", ("stamps", "recording")))
    return found


def refuse(found: list[Problem]) -> None:
    """Raise ValueError for problems; OptionNeededError where options of `mwd process` help."""
    if not found:
        return
    sentence = "; ".join(one.sentence for one in found)
    options = " ".join(f"--{one.option[0].replace('_', '-')} {one.option[1]}" for one in found if one.option)
    raise OptionNeededError(f"{sentence}; say so with {options}") if options else ValueError(sentence)


def left_out(stream: InputStream) -> list[str]:
    """Return what was left out because it came twice or without a time, in words."""
    return [
        f"{name}: {count} samples came a second time, as of two publishers, and are left out"
        for name, count in stream.repeated.items()
    ] + [
        f"{name}: {count} samples carry no time, although others do, and are left out"
        for name, count in stream.undated.items()
    ]


def _clock_problems(bag: Bag, topics: Topics) -> list[Problem]:
    """Return whether the clocks of the units are apart at the beginning."""
    first: Block = {}
    fields = {layout.type_name: () for layout in (wire.IMU, wire.MAG)}
    for name in _units(topics):
        first |= next(bag.blocks([name], block_messages=1000, fields=fields), {})
    return _apart(topics, first, unstamped(bag, topics))


def _units(topics: Topics) -> list[str]:
    """Return the topics whose samples are paired by time, the IMU first."""
    units = [topics.imu, topics.mag, topics.precision, topics.accelerometer]
    return [name for name in dict.fromkeys(units) if name is not None]


def _apart(topics: Topics, block: Block, without: frozenset[str]) -> list[Problem]:
    """Return whether the clocks of the units are apart in some bin of time of a block."""
    offsets: dict[str, dict[int, float]] = {}
    for name in _units(topics):
        if name not in block:
            continue
        log_ns, samples = block[name]
        offset = np.zeros(len(log_ns)) if name in without else 1e-9 * (log_ns - samples["stamp_ns"])
        numbers = log_ns // _BIN_NS
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        counts = np.diff(starts, append=len(numbers))
        found = zip(numbers[starts].tolist(), np.minimum.reduceat(offset, starts).tolist(), counts, strict=True)
        # The message with the shortest delay in a bin shows the clock; a bin of a few messages may hold only late ones.
        offsets[name] = {number: value for number, value, count in found if count >= min(_FEW, len(numbers))}
    imu = offsets.pop(topics.imu, {})
    for name, found_offsets in offsets.items():
        for number in sorted(imu.keys() & found_offsets.keys()):
            seconds = found_offsets[number] - imu[number]
            if abs(seconds) > _APART_S:
                side = "behind" if seconds > 0 else "ahead of"
                sentence = (
                    f"the clock of {name} is {_duration(abs(seconds))} {side} that of {topics.imu}: their samples "
                    "cannot be paired by these stamps, but by the times of recording"
                )
                return [Problem(sentence, ("stamps", "recording"))]
    return []


def clock_was_set(bag: Bag, topics: Topics) -> bool:
    """Whether the IMU's clock was set, as far as its first samples show, or the recorder's was not either."""
    samples = first_samples(bag, topics.imu)
    unset = len(samples) > 0 and 0 < int(np.median(samples["stamp_ns"])) < CLOCK_SET_NS
    return not unset or bag.start_ns < CLOCK_SET_NS


def _clocks(bag: Bag, names: list[str]) -> dict[str, tuple[Stamps, NDArray[np.int64]]]:
    """
    Return the clock of the recorder less that of each topic, ns, at some log times; in between it changes evenly.

    The message that was on its way the shortest time in each bin shows the clocks, so that bursts do no harm. A clock
    that is set while it records has one course before and another one after.
    """
    layouts = (wire.IMU, wire.MAG, wire.TEMPERATURE)
    courses: dict[str, list[_Course]] = {name: [] for name in names}
    for block in bag.blocks(names, fields={layout.type_name: () for layout in layouts}) if names else ():
        for name, (log_ns, samples) in block.items():
            _follow(courses[name], log_ns, log_ns - samples["stamp_ns"])
    return {name: _knots(_without_delays(found)) for name, found in courses.items() if found}


@dataclasses.dataclass
class _Course:
    """A clock from one setting to the next: log times and offsets, ns, and whether the stamps jumped at its begin."""

    first_ns: int
    last_ns: int
    last_offset: int
    was_set: bool
    count: int = 0
    bins: dict[int, int] = dataclasses.field(default_factory=dict)

    @property
    def least(self) -> int:
        return min(self.bins.values())

    def take(self, log_ns: Stamps, offset: NDArray[np.int64]) -> None:
        """Take messages: their log times and offsets, shape (n,), ns."""
        self.count += len(log_ns)
        self.last_ns, self.last_offset = int(log_ns[-1]), int(offset[-1])
        numbers = log_ns // _BIN_NS
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        for number, least in zip(numbers[starts].tolist(), np.minimum.reduceat(offset, starts).tolist(), strict=True):
            self.bins[number] = min(self.bins.get(number, least), least)


def _follow(courses: list[_Course], log_ns: Stamps, offset: NDArray[np.int64]) -> None:
    """Add messages to the course of a clock; one that differs by more than a delay begins another course."""
    late = np.diff(offset, prepend=courses[-1].last_offset if courses else offset[0])
    logged = np.diff(log_ns, prepend=courses[-1].last_ns if courses else log_ns[0])
    jumps = np.flatnonzero(np.abs(late) > _APART_S * 1e9)
    marks = [*jumps.tolist(), len(offset)]
    begin = 0
    if not courses and marks[0] != 0:
        marks = [0, *marks]
    for mark in marks:
        if mark > begin:
            courses[-1].take(log_ns[begin:mark], offset[begin:mark])
        if mark < len(offset):
            # A late message leaves a gap in the log; a clock that is set moves the stamps.
            moved = abs(int(logged[mark] - late[mark])) > abs(int(logged[mark]))
            courses.append(_Course(int(log_ns[mark]), int(log_ns[mark]), int(offset[mark]), moved))
        begin = mark


def _without_delays(courses: list[_Course]) -> list[_Course]:
    """Leave out what only came late or was logged at no time: a few messages, and delays; join courses that agree."""
    courses = [course for course in courses if course.count >= _FEW] or courses
    kept: list[_Course] = []
    for k, course in enumerate(courses):
        short = course.last_ns - course.first_ns < _BIN_NS and not course.was_set
        after = courses[k + 1].least if k + 1 < len(courses) else None
        if kept and short and course.least > kept[-1].least and (after is None or after < course.least):
            continue
        if kept and abs(course.least - kept[-1].least) < _APART_S * 1e9:
            kept[-1].last_ns = course.last_ns
            for number, least in course.bins.items():
                kept[-1].bins[number] = min(kept[-1].bins.get(number, least), least)
            continue
        kept.append(course)
    return kept


def _knots(courses: list[_Course]) -> tuple[Stamps, NDArray[np.int64]]:
    """Return log times and offsets, ns, that the courses run through."""
    at_ns, offsets = [], []
    for course in courses:
        numbers = sorted(course.bins)
        middles = [min(max(n * _BIN_NS + _BIN_NS // 2, course.first_ns), course.last_ns) for n in numbers]
        at_ns += [course.first_ns, *middles, course.last_ns]
        offsets += [course.bins[numbers[0]], *(course.bins[n] for n in numbers), course.bins[numbers[-1]]]
    return np.array(at_ns, dtype=np.int64), np.array(offsets, dtype=np.int64)


def _comes_empty(bag: Bag, mag: str) -> bool:
    """Whether messages of zeros come among the readings of a magnetometer."""
    block: Block = next(bag.blocks([mag], block_messages=2000, fields={wire.MAG.type_name: ("magnetic_field",)}), {})
    return mag in block and among_readings(~(block[mag][1]["magnetic_field"] != 0.0).any(axis=1))


def _in_turns(topics: Topics) -> bool:
    return topics.kind in (Kind.IN_TURNS, Kind.SOME_EMPTY)


def _duration(seconds: float) -> str:
    """Return a time in words."""
    for unit, size in (("years", 365.25 * 86400.0), ("days", 86400.0), ("h", 3600.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"
