# SPDX-License-Identifier: Apache-2.0
"""
The samples of a recording as the estimator takes them: each once, on one clock, whole, and in SI.

`mwd inspect` and `mwd process` read a recording through the same stream, and refuse it for the same reasons.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_surface.bags.bag_reader import Bag, Block
from mwd_surface.bags.message_parts import one_array
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

# Samples that a repeated one may come behind.
_REMEMBERED = 4096
# Width of the bins of time in which the clocks of a sensor and of the recorder are compared, ns.
_BIN_NS = 10 * wire.NANOSECONDS
# Clocks further apart cannot be paired, s; the delay of a message is less.
_APART_S = 1.0
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
    repeated : dict of str to int
        Samples left out so far because the same one had come before, by topic.
    """

    def __init__(self, bag: Bag, topics: Topics, given: InputSettings) -> None:
        self._bag, self._topics, self._given = bag, topics, given
        self.without_time = unstamped(bag, topics)
        self.repeated: dict[str, int] = {}
        self._joiner = Joiner(topics.kind) if topics.accelerometer or _in_turns(topics) else None
        self._last: dict[str, Samples] = {}
        self._newest: dict[str, int] = {}
        stamped = [name for name in topics.all if name not in self.without_time and name != topics.rig]
        self._empty_mag = topics.mag is not None and _comes_empty(bag, topics.mag)
        self._clocks = _clocks(bag, stamped) if given.stamps == "recording" else {}

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
        out: Block = {name: self._timed(name, *self._once(name, *part)) for name, part in block.items()}
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

    def _once(self, name: str, log_ns: Stamps, samples: Samples) -> tuple[Stamps, Samples]:
        """Leave out samples that came before with the same time and numbers, as from a second publisher."""
        stamps = samples["stamp_ns"]
        newest = self._newest.get(name, -(2**62))
        self._newest[name] = max(newest, int(stamps.max()))
        before = self._last.get(name, samples[:0])
        both = one_array([before, samples])
        # A copy: the samples are changed in place later.
        self._last[name] = both[-_REMEMBERED:].copy()
        advance = bool((stamps[1:] > stamps[:-1]).all()) and int(stamps[0]) > newest
        if advance or name in self.without_time:
            return log_ns, samples
        rows = both.view(np.dtype((np.void, both.dtype.itemsize)))
        _, first = np.unique(rows, return_index=True)
        keep = np.zeros(len(both), dtype=np.bool_)
        keep[first] = True
        keep = keep[len(before) :]
        if not keep.all():
            self.repeated[name] = self.repeated.get(name, 0) + int(np.count_nonzero(~keep))
        return log_ns[keep], samples[keep]

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


def problems(bag: Bag, topics: Topics, given: InputSettings) -> list[Problem]:
    """Return why the samples of a recording cannot be used as they are, by the first of them."""
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
    return found


def refuse(found: list[Problem]) -> None:
    """Raise ValueError for problems; OptionNeededError where options of `mwd process` help."""
    if not found:
        return
    sentence = "; ".join(one.sentence for one in found)
    options = " ".join(f"--{one.option[0].replace('_', '-')} {one.option[1]}" for one in found if one.option)
    raise OptionNeededError(f"{sentence}; say so with {options}") if options else ValueError(sentence)


def repetitions(stream: InputStream) -> list[str]:
    """Return what was left out because it came twice, in words."""
    return [
        f"{name}: {count} samples came a second time, as of two publishers, and are left out"
        for name, count in stream.repeated.items()
    ]


def _clock_problems(bag: Bag, topics: Topics) -> list[Problem]:
    """Return whether the clocks of the units are apart."""
    without = unstamped(bag, topics)
    units = [topics.imu, topics.mag, topics.precision, topics.accelerometer]
    names = [name for name in dict.fromkeys(units) if name is not None]
    fields = {layout.type_name: () for layout in (wire.IMU, wire.MAG)}
    offsets: dict[str, float] = {}
    for name in names:
        for block in bag.blocks([name], block_messages=1000, fields=fields):
            log_ns, samples = block[name]
            offsets[name] = 0.0 if name in without else 1e-9 * float((log_ns - samples["stamp_ns"]).min())
            break
    if topics.imu not in offsets:
        return []
    apart = {name: offset - offsets[topics.imu] for name, offset in offsets.items() if name != topics.imu}
    wrong = {name: seconds for name, seconds in apart.items() if abs(seconds) > _APART_S}
    return [
        Problem(
            f"the clock of {name} is {_duration(abs(seconds))} {'behind' if seconds > 0 else 'ahead of'} that of "
            f"{topics.imu}: their samples cannot be paired; the times of the recording can",
            ("stamps", "recording"),
        )
        for name, seconds in list(wrong.items())[:1]
    ]


def clock_was_set(bag: Bag, topics: Topics) -> bool:
    """Whether the IMU's clock was set, as far as its first samples show, or the recorder's was not either."""
    samples = first_samples(bag, topics.imu)
    unset = len(samples) > 0 and 0 < int(np.median(samples["stamp_ns"])) < CLOCK_SET_NS
    return not unset or bag.start_ns < CLOCK_SET_NS


def _clocks(bag: Bag, names: list[str]) -> dict[str, tuple[Stamps, NDArray[np.int64]]]:
    """
    Return the clock of the recorder less that of each topic, ns, at some log times.

    The message that was on its way the shortest time in each bin shows the clocks, so that bursts do no harm.
    """
    layouts = (wire.IMU, wire.MAG, wire.TEMPERATURE)
    least: dict[str, dict[int, int]] = {name: {} for name in names}
    for block in bag.blocks(names, fields={layout.type_name: () for layout in layouts}) if names else ():
        for name, (log_ns, samples) in block.items():
            bins = log_ns // _BIN_NS
            for number in np.unique(bins).tolist():
                offset = int((log_ns - samples["stamp_ns"])[bins == number].min())
                least[name][number] = min(least[name].get(number, offset), offset)
    return {
        name: (
            np.array([(number * _BIN_NS) + _BIN_NS // 2 for number in sorted(found)], dtype=np.int64),
            np.array([found[number] for number in sorted(found)], dtype=np.int64),
        )
        for name, found in least.items()
        if found
    }


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
