# SPDX-License-Identifier: Apache-2.0
"""
Streams of a recording's samples as the estimator needs them: each once, on one clock, complete, and in SI.

Every command that works on the sensors of a recording reads the samples through these streams. `mwd inspect` and
`mwd process` refuse a recording for the same reasons.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.repeated_samples import RepeatedSamples
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_surface.bags.bag_reader import Bag, BagError, Block
from mwd_surface.processing.bag_input import (
    FIELDS,
    InputSettings,
    OptionNeededError,
    Topics,
    first_samples,
    in_si,
    option_of,
    unstamped,
    wells,
    without_gravity,
)
from mwd_surface.processing.half_imu import ImuKind, Joiner, among_readings
from mwd_surface.processing.stream_times import PACE

# Width of the time bins in which the clocks of a sensor and of the recorder are compared, ns.
_BIN_NS = 10 * wire.NANOSECONDS
# Largest difference of two clocks, s, at which their samples can be paired; message delays are shorter.
_APART_S = 1.0
# Smallest number of messages from which the offset of a clock can be judged, in a time bin or between two jumps.
_FEW = 5
# Earliest reading of a clock that has been set, ns since the epoch (in 1989).
CLOCK_SET_NS = 7000 * 86400 * wire.NANOSECONDS
_RAW = "record the raw data of the driver (topic often ending in data_raw), or let the driver keep gravity in the data"


class StreamProblem(NamedTuple):
    """Reason why samples cannot be used as they are; `option` is name and value of a setting that helps, or None."""

    sentence: str
    option: tuple[str, str] | None = None


class SampleStream:
    """
    Samples of some topics of a recording, block by block: each once, and on one clock.

    Parameters
    ----------
    names : sequence of str
        Topics, the IMU first if there is one; messages without stamped samples pass unchanged.
    held : str
        Topic whose samples are held back until it is known whether each sample comes twice (`RepeatedSamples`), as in
        live use.

    Raises
    ------
    ValueError
        The times of recording are requested, but a clock runs at another speed than the recorder's (`_clocks`).
    """

    def __init__(self, bag: Bag, names: Sequence[str], given: InputSettings, held: str = "") -> None:
        self.names = list(dict.fromkeys(names))  #: topics, each once
        self._bag, self._given = bag, given
        stamped = [name for name in self.names if bag.topics[name].gives in wire.LAYOUTS]
        #: Topics whose messages carry no time of their own.
        self.without_time = unstamped(bag, stamped) if stamped else frozenset()
        #: By topic: number of samples left out so far because they have no time although other samples have one.
        self.undated: dict[str, int] = {}
        units = [name for name in stamped if bag.topics[name].gives in (wire.IMU.type_name, wire.MAG.type_name)]
        self._repeated = {name: RepeatedSamples(hold=name == held) for name in units}
        self._stamped = set(stamped)
        timed = [name for name in stamped if name not in self.without_time]
        self._clocks = _clocks(bag, timed) if given.stamps == "recording" else {}

    @property
    def repeated(self) -> dict[str, int]:
        """Number of samples left out so far because they were repeated, by topic."""
        return {name: one.count for name, one in self._repeated.items() if one.count}

    @property
    def remarks(self) -> list[str]:
        """Sentences on unusual times of the topics, and on samples left out so far."""
        names = ", ".join(sorted(self.without_time))
        return [
            *([f"{names}: the headers have no time, so the times of recording are used"] if names else []),
            *(
                f"{name}: {_samples(count)} twice, as from two publishers; the copies were left out"
                for name, count in self.repeated.items()
            ),
            *(
                f"{name}: {_samples(count)} without a time, although other samples have one, and were left out"
                for name, count in self.undated.items()
            ),
        ]

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks of the recording, or of the requested part of it."""
        for block in self._bag.blocks(self.names, *asked_span(self._bag, self._given)):
            yield self.take(block)

    def take(self, block: Block) -> Block:
        """Return a block without repeated samples and with the samples on one clock."""
        out = {}
        for name, (log_ns, samples) in block.items():
            if name in self._stamped:
                out[name] = self._timed(name, *self._once(name, *self._dated(name, log_ns, samples)))
            else:
                out[name] = log_ns, samples
        return {name: part for name, part in out.items() if len(part[0])}

    def _dated(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """
        Return log times and samples without the samples with stamp 0, if the topic has other stamps.

        A stamp 0 means that the clock of the driver was not set yet. The samples left out are counted in `undated`.
        """
        if name in self.without_time:
            return log_ns, samples
        dated = (samples["stamp_ns"] != 0) | (log_ns < CLOCK_SET_NS)
        if dated.all():
            return log_ns, samples
        self.undated[name] = self.undated.get(name, 0) + int(np.count_nonzero(~dated))
        return log_ns[dated], samples[dated]

    def _once(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """Return log times and samples without repeated samples, as from a second publisher, as the live estimator."""
        if name not in self._repeated:
            return log_ns, samples
        return self._repeated[name].take(log_ns, samples, stamped=name not in self.without_time)

    def _timed(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """
        Return log times and samples; samples without a time are stamped by the log time.

        Other stamps are converted to the recorder's clock if requested. The samples are changed in place.
        """
        if name in self.without_time:
            samples["stamp_ns"] = log_ns
        elif name in self._clocks:
            at_ns, offset_ns = self._clocks[name]
            base = int(offset_ns[0])
            correction = np.interp(log_ns - at_ns[0], at_ns - at_ns[0], offset_ns - base)
            samples["stamp_ns"] += base + np.rint(correction).astype(np.int64)
        return log_ns, samples


class InputStream(SampleStream):
    """Samples of a recording in the form that the estimator needs: complete, and in SI."""

    def __init__(self, bag: Bag, topics: Topics, given: InputSettings) -> None:
        super().__init__(bag, topics.all, given, topics.imu)
        self.topics = topics
        #: Reasons why the samples read so far cannot be used, although the first samples could.
        self.problems: list[StreamProblem] = []
        self._joiner = Joiner(topics.kind) if topics.accelerometer or _in_turns(topics) else None
        self._empty_mag = topics.mag is not None and _comes_empty(bag, topics.mag)

    @property
    def first_log_ns(self) -> int | None:
        """
        Log time of the first IMU message that waits for its other half or as a possible copy, ns.

        None if no message waits.
        """
        waiting = [self._repeated[self.topics.imu], self._joiner]
        found = [one.first_log_ns for one in waiting if one is not None]
        return min((at for at in found if at is not None), default=None)

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks of the recording, or of the requested part of it."""
        for block in self._bag.blocks(self.names, *asked_span(self._bag, self._given), fields=FIELDS):
            yield self.take(block)
        if rest := self.finish():
            yield rest

    def take(self, block: Block) -> Block:
        """Return the block in the form that the estimator needs; its IMU samples may come from an earlier block."""
        if self._given.stamps == "header" and not self.problems:
            self.problems += _apart(self.topics, block, self.without_time)
        topics, out = self.topics, super().take(block)
        if self._empty_mag and topics.mag in out:
            log_ns, samples = out[topics.mag]
            filled = (samples["magnetic_field"] != 0.0).any(axis=1)
            out[topics.mag] = log_ns[filled], samples[filled]
        if self._joiner is not None:
            joined = self._joiner.push(out.pop(topics.imu, None), out.pop(topics.accelerometer or "", None))
            out |= {topics.imu: joined} if joined is not None else {}
        return in_si({name: part for name, part in out.items() if len(part[0])}, topics, self._given)

    def finish(self) -> Block:
        """Return the IMU samples that still wait."""
        name = self.topics.imu
        out: Block = {}
        held = self._repeated[name].finish()
        if held is not None:
            out[name] = self._timed(name, *held)
        if self._joiner is not None:
            parts = [self._joiner.push(out.pop(name, None)), self._joiner.finish()]
            joined = [part for part in parts if part is not None]
            if joined:
                out[name] = np.concatenate([p[0] for p in joined]), np.concatenate([p[1] for p in joined])
        return in_si(out, self.topics, self._given)


class RecordingStream:
    """
    Topics of a recording, block by block.

    IMU, magnetometer and precision unit of each well have the form that the estimator needs (`InputStream`); all other
    topics have the form of `SampleStream`.

    Parameters
    ----------
    names : sequence of str
        Topics of the recording; one half of an IMU also includes the other half.
    """

    def __init__(self, bag: Bag, names: Sequence[str], given: InputSettings) -> None:
        self._bag, self.given = bag, given
        self._wells = [InputStream(bag, topics, given) for topics in _wells(bag, given)]
        halves = {name: one.topics.imu for one in self._wells if (name := one.topics.accelerometer) is not None}
        #: Resulting topics: the halves of an IMU become one topic, the topic of the gyro.
        self.names = list(dict.fromkeys(halves.get(name, name) for name in names))
        both = [name for name, gyro in halves.items() if gyro in self.names]
        units = {name for well in self._wells for name in _units(well.topics)}
        self._read = [*self.names, *both]
        self._others = SampleStream(bag, [name for name in self._read if name not in units], given)

    @property
    def remarks(self) -> list[str]:
        """Sentences on unusual samples and on samples left out so far, for the topics that are read."""
        found = [text for one in (*self._wells, self._others) for text in one.remarks]
        found += [problem.sentence for well in self._wells for problem in well.problems]
        return [text for text in found if not self._names_another(text)]

    def blocks(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Block]:
        """Yield the blocks logged from `start_ns` (inclusive) to `end_ns` (exclusive)."""
        fields = {name: FIELDS[name] for name in (wire.IMU.type_name, wire.MAG.type_name)}
        for block in self._bag.blocks(self._read, start_ns, end_ns, fields=fields):
            rest = dict(block)
            out: Block = {}
            for well in self._wells:
                mine = {name: rest.pop(name) for name in _units(well.topics) if name in rest}
                out |= well.take(mine)
            yield out | self._others.take(rest)
        for well in self._wells:
            if waiting := well.finish():
                yield waiting

    def _names_another(self, text: str) -> bool:
        """Return whether a remark is about a topic that is not read."""
        return text.startswith("/") and text.partition(":")[0] in self._bag.topics.keys() - set(self._read)


def _samples(count: int) -> str:
    return "1 sample came" if count == 1 else f"{count} samples came"


def _wells(bag: Bag, given: InputSettings) -> list[Topics]:
    """Return the topics of each well; empty if the bag has no IMU, or has several and `given` names no sensor."""
    try:
        return wells(bag, given)
    except BagError:
        if given.imu_topic or given.accel_topic or given.mag_topic or given.gyro_topic:
            raise
        return []


def asked_span(bag: Bag, given: InputSettings) -> tuple[int | None, int | None]:
    """Return the part of a recording to read: log time from (inclusive) and to (exclusive), ns; None: no limit."""
    start = bag.start_ns + round(given.start_s * 1e9) if given.start_s > 0.0 else None
    return start, bag.start_ns + round(given.end_s * 1e9) if math.isfinite(given.end_s) else None


def problems(bag: Bag, topics: Topics, given: InputSettings, place: Place) -> list[StreamProblem]:
    """
    Check the first samples of a recording; return the reasons why its samples cannot be used.

    place : if the field model needs a date that `place` does not give, the clock of the IMU must have been set.
    """
    found: list[StreamProblem] = []
    accelerometer = topics.accelerometer or topics.imu
    samples = first_samples(bag, accelerometer)
    if topics.kind == ImuKind.GYRO and topics.accelerometer is None:
        sentence = f"{topics.imu} has only the gyro of an IMU, and the recording has no topic of the accelerometer"
        return [StreamProblem(f"{sentence}; record both, or choose a complete IMU with --imu-topic")]
    if topics.kind in (ImuKind.IN_TURNS, ImuKind.SOME_EMPTY):
        samples = samples[(samples["linear_acceleration"] != 0.0).any(axis=1)]
    if without_gravity(samples):
        others = [
            name
            for name, about in bag.topics.items()
            if name != accelerometer and about.gives == wire.IMU.type_name and about.count
        ]
        raw = [name for name in others if not without_gravity(first_samples(bag, name))]
        sentence = f"{accelerometer}: the driver has removed gravity from the acceleration, which the inclination needs"
        option = ("imu_topic", raw[0]) if len(raw) == 1 else None
        found.append(StreamProblem(sentence if option else f"{sentence}; {_RAW}", option))
    if given.stamps == "header":
        found += _clock_problems(bag, topics)
        if not found and place.model and not place.date and not clock_was_set(bag, topics):
            sentence = f"the clock of {topics.imu} was never set, and the field model needs the date"
            found.append(StreamProblem(f"{sentence}, which the recorder knows", ("stamps", "recording")))
    return found


def refuse(found: list[StreamProblem]) -> None:
    """Raise ValueError for problems; OptionNeededError if options of the input solve them."""
    if not found:
        return
    sentence = "; ".join(one.sentence for one in found)
    options = " ".join(f"{option_of(one.option[0])} {one.option[1]}" for one in found if one.option)
    raise OptionNeededError(f"{sentence}; use {options}") if options else ValueError(sentence)


def _clock_problems(bag: Bag, topics: Topics) -> list[StreamProblem]:
    """Return a problem if the clocks of the units differ at the beginning of the recording; else an empty list."""
    first: Block = {}
    fields = {layout.type_name: () for layout in (wire.IMU, wire.MAG)}
    for name in _units(topics):
        first |= next(bag.blocks([name], block_messages=1000, fields=fields), {})
    return _apart(topics, first, unstamped(bag, topics.all))


def _units(topics: Topics) -> list[str]:
    """Return the topics whose samples are paired by time, the IMU first."""
    units = [topics.imu, topics.mag, topics.precision, topics.accelerometer]
    return [name for name in dict.fromkeys(units) if name is not None]


def offsets_of_clock(block: Block, name: str, imu: str) -> Array:
    """
    Return the recorder's clock minus the clock of a topic's stamps, for each message of a block, shape (n,), s.

    The drift of the recorder's clock relative to the IMU's clock within the block is subtracted: if a simulation at
    half the speed of real time is recorded, the recorder's clock gains half a second per second. Offsets of different
    topics can then be compared although their messages arrive at different times, for example when one topic has a gap.
    """
    log_ns, samples = block[name]
    seconds = 1e-9 * (log_ns - block[imu][0][0])
    offsets: Array = 1e-9 * (log_ns - samples["stamp_ns"]) - _gain(block, imu) * seconds
    return offsets


def _gain(block: Block, imu: str) -> float:
    """
    Return the drift of the recorder's clock relative to the IMU's clock in a block, s per s.

    The drift is the median over pairs of messages a tenth of the block apart. Messages in bursts, or a clock that is
    set once within the block, do not change the median.
    """
    log_ns, samples = block[imu]
    apart = max(1, len(log_ns) // 10)
    logged = (log_ns[apart:] - log_ns[:-apart]).astype(float)
    stamped = (samples["stamp_ns"][apart:] - samples["stamp_ns"][:-apart]).astype(float)
    passed = logged > 0.0
    return float(np.median(1.0 - stamped[passed] / logged[passed])) if passed.any() else 0.0


def _apart(topics: Topics, block: Block, without: frozenset[str]) -> list[StreamProblem]:
    """Return a problem if the clocks of the units differ in any time bin of a block. without: topics without times."""
    offsets: dict[str, dict[int, float]] = {}
    for name in _units(topics):
        if name not in block or topics.imu not in block:
            continue
        log_ns = block[name][0]
        offset = np.zeros(len(log_ns)) if name in without else offsets_of_clock(block, name, topics.imu)
        numbers = log_ns // _BIN_NS
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        counts = np.diff(starts, append=len(numbers))
        found = zip(numbers[starts].tolist(), np.minimum.reduceat(offset, starts).tolist(), counts, strict=True)
        # The message with the shortest delay in a bin shows the clock; the few messages of a bin may all be late.
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
                return [StreamProblem(sentence, ("stamps", "recording"))]
    return []


def clock_was_set(bag: Bag, topics: Topics) -> bool:
    """
    Return whether the clock of the IMU was set, according to the stamps of its first samples.

    The result is also true if the clock of the recorder was not set.
    """
    samples = first_samples(bag, topics.imu)
    unset = len(samples) > 0 and 0 < int(np.median(samples["stamp_ns"])) < CLOCK_SET_NS
    return not unset or bag.start_ns < CLOCK_SET_NS


def _clocks(bag: Bag, names: list[str]) -> dict[str, tuple[Stamps, NDArray[np.int64]]]:
    """
    Return, by topic, some log times and the recorder's clock minus the topic's clock at these times, ns.

    Between these times, the difference is interpolated linearly. The message with the shortest delay in each time bin
    shows the difference, so that bursts do no harm. If a clock is set during the recording, the difference has one
    course before and another after.

    Raises ValueError if a clock runs at another speed than the recorder's, because the simulation or replay was faster
    or slower than real time. Differences of log times are then not the times between the samples.
    """
    layouts = (wire.IMU, wire.MAG, wire.TEMPERATURE)
    courses: dict[str, list[_Course]] = {name: [] for name in names}
    for block in bag.blocks(names, fields={layout.type_name: () for layout in layouts}) if names else ():
        for name, (log_ns, samples) in block.items():
            _follow(courses[name], log_ns, log_ns - samples["stamp_ns"])
    kept = {name: _without_delays(found) for name, found in courses.items() if found}
    for name, found in kept.items():
        gains = [gain for course in found for gain in course.gains()]
        # Delayed messages change the offset in one or two bins; a run at another speed changes it in every bin.
        if len(gains) > 1 and np.abs(gains).min() > PACE:
            pace = float(np.median(gains))
            raise ValueError(
                f"the stamps of {name} run {1.0 - pace:.2f} times as fast as the times of recording, because the run "
                "was made at another speed than real time: use the stamps (option --stamps header)"
            )
    return {name: _knots(found) for name, found in kept.items()}


@dataclasses.dataclass
class _Course:
    """Recorder's clock minus the clock of a topic (the offset), from one jump of the offset to the next."""

    #: `first_ns`, `last_ns`: first and last log time
    first_ns: int
    last_ns: int
    last_offset: int  #: last offset, ns
    was_set: bool  #: whether the course began because the clock was set, not because messages were delayed
    count: int = 0  #: number of messages
    bins: dict[int, int] = dataclasses.field(default_factory=dict)  #: smallest offset, ns, by number of the time bin

    @property
    def least(self) -> int:
        return min(self.bins.values())

    def gains(self) -> list[float]:
        """Return the change of the offset from each time bin to the next, s per s."""
        numbers = np.array(sorted(self.bins))
        offsets = np.array([self.bins[number] for number in numbers.tolist()], dtype=float)
        found: list[float] = (np.diff(offsets) / (np.diff(numbers) * float(_BIN_NS))).tolist()
        return found

    def take(self, log_ns: Stamps, offset: NDArray[np.int64]) -> None:
        """Add messages by their log times and offsets, shape (n,), ns."""
        self.count += len(log_ns)
        self.last_ns, self.last_offset = int(log_ns[-1]), int(offset[-1])
        numbers = log_ns // _BIN_NS
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        for number, least in zip(numbers[starts].tolist(), np.minimum.reduceat(offset, starts).tolist(), strict=True):
            self.bins[number] = min(self.bins.get(number, least), least)


def _follow(courses: list[_Course], log_ns: Stamps, offset: NDArray[np.int64]) -> None:
    """Add messages to the courses of a clock; a jump of the offset by more than `_APART_S` begins another course."""
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
            # A late message leaves a gap in the log times; setting the clock moves the stamps.
            moved = abs(int(logged[mark] - late[mark])) > abs(int(logged[mark]))
            courses.append(_Course(int(log_ns[mark]), int(log_ns[mark]), int(offset[mark]), moved))
        begin = mark


def _without_delays(courses: list[_Course]) -> list[_Course]:
    """
    Return the courses without those that have few messages or come from a delay; join nearly equal courses.

    If all courses have few messages, none is left out for that. A course comes from a delay if it is short, no set
    clock began it, and its smallest offset is above the offset of the courses before and after.
    """
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
    """Return log times and offsets, ns, of points; between them the offset is interpolated."""
    at_ns, offsets = [], []
    for course in courses:
        numbers = sorted(course.bins)
        middles = [min(max(n * _BIN_NS + _BIN_NS // 2, course.first_ns), course.last_ns) for n in numbers]
        at_ns += [course.first_ns, *middles, course.last_ns]
        offsets += [course.bins[numbers[0]], *(course.bins[n] for n in numbers), course.bins[numbers[-1]]]
    return np.array(at_ns, dtype=np.int64), np.array(offsets, dtype=np.int64)


def _comes_empty(bag: Bag, mag: str) -> bool:
    """Return whether messages of zeros occur among the first 2000 readings of a magnetometer."""
    block: Block = next(bag.blocks([mag], block_messages=2000, fields={wire.MAG.type_name: ("magnetic_field",)}), {})
    return mag in block and among_readings(~(block[mag][1]["magnetic_field"] != 0.0).any(axis=1))


def _in_turns(topics: Topics) -> bool:
    return topics.kind in (ImuKind.IN_TURNS, ImuKind.SOME_EMPTY)


def _duration(seconds: float) -> str:
    """Return a duration, s, as text in s, h, days or years."""
    for unit, size in (("years", 365.25 * 86400.0), ("days", 86400.0), ("h", 3600.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"
