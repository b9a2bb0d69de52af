# SPDX-License-Identifier: Apache-2.0
"""
Merge of log samples by depth: curves at a fixed depth step, each value with its sigma and its counts.

The depth of a sample is the depth of its sensor: bit depth at the time of measurement minus the distance from sensor to
bit. If the sensor moved during a sample, the sample is divided among the depth steps that the sensor passed, in
proportion to the time in each. In addition to the sum of all data, two passes are kept. The first pass has the data
from the time in which the sensor was deeper than ever before. The deepest pass has the data from the time in which the
bit was on bottom. Data of reaming and connections are in the sum of all data only.
"""

from __future__ import annotations

import array
import bisect
import collections
import dataclasses
import heapq
import itertools
import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import FLAGS, LogSample, is_channel_name
from mwd_surface.list_files.list_checks import DEEPEST as DEEPEST_M
from mwd_surface.surveys.depth import DepthJumpRules

FIRST, DEEPEST, ALL = "first", "deepest", "all"
PASSES = (FIRST, DEEPEST, ALL)
STEP_M = 0.1  # default depth step, m
# A sensor or bit within this distance of its deepest depth counts as deepest, m; the pick-up at a connection is larger.
_ON_BOTTOM_M = 0.03
# Longest time between two bit depths over which the depth is interpolated, s.
_BRIDGE_S = 30.0
_CHUNK = 256  # number of depth steps in one array of sums
_STEP_S = 1.0  # approximate length of the parts into which the interval of a sample is cut, s
_DEPTHS_NS = NANOSECONDS  # shortest time between two bit depths that are kept, ns
_LONGEST_S = 3600.0  # longest interval of a sample, s
_MOST_SECTORS, _MOST_CHANNELS = 64, 64  # largest number of sectors of a sample, and largest number of channels
_FARTHEST_M = 100.0  # largest distance of a sensor from the bit, m
_LARGEST = 1e12  # largest absolute value of a sample in its unit; its square and the sums over a well stay finite
_UNIT = re.compile(r"[A-Za-z0-9/^*%.° -]{0,16}")
# A sample that is late by at most _LATE_NS, ns, is placed in order of time: the later samples of its channel are taken
# back and placed again. At most _MOST_KEPT samples of a channel can be taken back: 17 minutes with one each second.
_LATE_NS, _MOST_KEPT = 600 * NANOSECONDS, 1000
_NEVER_NS = -(2**63)  # time before all stamps, ns
_SILENT_NS = 120 * NANOSECONDS  # time without a sample after which a channel has stopped, ns; a link may need a minute
_MOST_LEFT = 8  # largest number of earlier depths to which the depth of the rig may return
_MOST_WAITING = 20_000  # largest number of samples that wait for a depth: half a day with four channels as above


@dataclasses.dataclass(frozen=True)
class Curve:
    """One channel over depth, one row for each step from the shallowest to the deepest."""

    channel: str
    unit: str
    depth: Array  #: shape (n,); middle of each step, m
    #: `value`, `sigma`: shape (n,); mean and its 1 sigma; NaN in a gap
    value: Array
    sigma: Array
    counts: Array  #: shape (n,); pulses of a detector; NaN if not known
    seconds: Array  #: shape (n,); time of measurement, s; 0 in a gap
    samples: Array  #: shape (n,); number of samples that contribute
    #: `sectors`, `sigma_sectors`: shape (n, k); means by direction, the first centred on the high side, clockwise
    #: looking down-hole; k = 0 without sectors
    sectors: Array
    sigma_sectors: Array
    quality: Array  #: shape (n,); bits of mwd_msgs/LogSample of all samples that contribute; NaN in a gap
    #: top and bottom, m, of each interval without a value, from the first to the last value of the channel in the whole
    #: well, even if the curve has only the deepest steps. If the channel stopped, the last gap ends at the depth that
    #: the sensor has reached.
    gaps: tuple[tuple[float, float], ...]


@dataclasses.dataclass(frozen=True)
class Newest:
    """Newest value of a channel: value and 1 sigma in its unit, time, ns, and depth of the sensor at that time, m."""

    value: float
    sigma: float
    stamp_ns: int
    depth: float
    unit: str
    quality: int  #: bits of mwd_msgs/LogSample


class _Sums:
    """
    Sums over the depth steps of one logging pass of a channel.

    The errors of counts are independent from sample to sample, so their variances add up. All other errors (bias,
    rounding, shared pulses of two words) may be the same in each sample, so their sigmas add up: the mean of many
    samples then has the same sigma as one sample.

    A deep hole has many steps. They are records of arrays, `_CHUNK` steps each, so that a step of a channel without
    sectors takes 57 bytes.
    """

    def __init__(self, sectors: int) -> None:
        numbers = [(name, np.float64) for name in ("weight", "total", "variance", "common", "counts")]
        by_sector = [(f"sector_{name}", np.float64, (sectors,)) for name in ("weight", "total", "variance", "common")]
        whole = [("samples", np.int64), ("quality", np.int64), ("seen", np.bool_)]
        self._none = np.zeros(_CHUNK, dtype=[*numbers, *by_sector, *whole])
        self._chunks: dict[int, Samples] = {}

    def add(self, index: int, sample: LogSample, share: float) -> Samples:
        """
        Add a sample to a step; return the sums that the step had before, for `restore`.

        share: part of the sample in this step, 0 to 1. Call this once for each step of a sample.
        """
        number, place = divmod(index, _CHUNK)
        if number not in self._chunks:
            self._chunks[number] = self._none.copy()
        before = self._chunks[number][place : place + 1].copy()
        step = self._chunks[number][place]
        step["seen"] = True
        # A value without a duration, from a word of a link, has the weight of one second.
        weight = share * (sample.duration or 1.0)
        counted = math.isfinite(sample.counts)
        if math.isfinite(sample.value):
            step["weight"] += weight
            step["total"] += weight * sample.value
            if counted:
                step["variance"] += (weight * sample.sigma) ** 2
            else:
                step["common"] += weight * sample.sigma
            step["counts"] += share * sample.counts
            step["samples"] += 1
            step["quality"] |= sample.quality
        if sample.sectors and len(sample.sectors) == len(step["sector_weight"]):
            seen = np.array(sample.sector_durations) * share
            known = seen > 0.0
            step["sector_weight"][known] += seen[known]
            step["sector_total"][known] += seen[known] * np.array(sample.sectors)[known]
            errors = seen[known] * np.array(sample.sigma_sectors)[known]
            if counted:
                step["sector_variance"][known] += errors**2
            else:
                step["sector_common"][known] += errors
        return before

    def restore(self, index: int, before: Samples) -> None:
        """Restore the sums of a step from before a sample; without another sample the step is left out again."""
        number, place = divmod(index, _CHUNK)
        self._chunks[number][place : place + 1] = before
        if not self._chunks[number]["seen"].any():
            del self._chunks[number]

    def steps(self, most: int | None = None) -> tuple[int, Samples]:
        """
        Return the index of the first step, and the sums of all steps from the first to the deepest.

        most: largest number of steps; the shallowest steps are left out. None: all steps.
        """
        if not self._chunks:
            return 0, self._none[:0]
        numbers = sorted(self._chunks)
        first = numbers[0] * _CHUNK + int(np.argmax(self._chunks[numbers[0]]["seen"]))
        end = (numbers[-1] + 1) * _CHUNK - int(np.argmax(self._chunks[numbers[-1]]["seen"][::-1]))
        first = first if most is None else max(first, end - most)
        begin = first // _CHUNK
        sums = np.concatenate([self._chunks.get(number, self._none) for number in range(begin, numbers[-1] + 1)])
        return first, sums[first - begin * _CHUNK : end - begin * _CHUNK]

    def filled(self) -> Array:
        """Return the indices of the steps that have a value, in increasing order."""
        parts = [number * _CHUNK + np.flatnonzero(self._chunks[number]["samples"]) for number in sorted(self._chunks)]
        return np.concatenate([np.zeros(0), *parts])


@dataclasses.dataclass
class _ChannelState:
    """State of a channel, apart from its sums."""

    deepest: float = -math.inf  #: deepest depth of the sensor, m
    offset: float = 0.0  #: distance of the sensor from the bit, m
    newest: Newest | None = None  #: value that was last placed into the log
    newest_ns: int = _NEVER_NS  #: newest stamp, ns
    unplaced: int = 0  #: number of samples without a depth


class _RecentSample(NamedTuple):
    """A placed sample, the state of its channel before it, and the sums of each step, by pass and index, before it."""

    sample: LogSample
    state: _ChannelState
    sums: list[tuple[str, int, Samples]]


class _DepthChannel:
    """
    One channel: its state, its sums by logging pass, and its recent samples, which a late sample may follow.

    recent: samples that can be taken back, in order of time. final_ns: stamp of the newest sample that cannot, ns.
    """

    def __init__(self, sample: LogSample) -> None:
        self.unit, self.sectors = sample.unit, len(sample.sectors)
        self.state = _ChannelState()
        self.passes = {name: _Sums(self.sectors) for name in PASSES}
        self.recent: collections.deque[_RecentSample] = collections.deque()
        self.final_ns = _NEVER_NS

    def take_back(self, after_ns: int) -> list[LogSample]:
        """Take back the samples after a time, ns; return them, the newest first."""
        taken = []
        while self.recent and self.recent[-1].sample.stamp_ns > after_ns:
            sample, self.state, sums = self.recent.pop()
            for name, index, before in reversed(sums):
                self.passes[name].restore(index, before)
            taken.append(sample)
        return taken

    def make_final(self, before_ns: int) -> None:
        """Make the samples final that begin before a time, ns, and the oldest ones if there are too many."""
        while self.recent and (len(self.recent) > _MOST_KEPT or _begin_ns(self.recent[0].sample) < before_ns):
            self.final_ns = self.recent.popleft().sample.stamp_ns


class _DepthBeforeJump(NamedTuple):
    """State before a jump of the depth that no string can make."""

    stamp_ns: int  #: time of the last bit depth
    bit_depth: float  #: depth of the bit at `stamp_ns`, m
    bottom: float  #: bottom of the hole at `stamp_ns`, m

    def reaches(self, rules: DepthJumpRules, stamp_ns: int, bit_depth: float) -> bool:
        """Return whether a string can move from this depth to another one, m, by a time, ns."""
        seconds = abs(stamp_ns - self.stamp_ns) / NANOSECONDS
        return abs(bit_depth - self.bit_depth) <= rules.slack + rules.fastest * seconds


class DepthLog:
    """
    Log samples of one well, merged by depth.

    Parameters
    ----------
    sensor_to_bit : float
        Distance from the sonde to the bit, m, for samples without a sensor distance of their own.
    step_m : float
        Depth step.
    history : int or None
        Number of bit depths that are kept, one per second; None keeps all. After the first depths were dropped, a late
        sample from the time of these depths is placed as it arrives.
    rules : DepthJumpRules, optional
        Steps of the depth that a string can make.

    Raises
    ------
    ValueError
        The step is not positive.
    """

    def __init__(
        self,
        sensor_to_bit: float = 0.0,
        step_m: float = STEP_M,
        history: int | None = None,
        rules: DepthJumpRules | None = None,
    ) -> None:
        if not step_m > 0.0:
            raise ValueError(f"step_m: must be above 0 m, got {step_m!r}")
        self._rules = rules or DepthJumpRules()
        self.sensor_to_bit, self.step_m = sensor_to_bit, step_m
        self.version = 0  #: increases with every change
        self._history = history
        # Depth of the bit over time, and the deepest depth so far.
        self._stamps = array.array("q")
        self._bits = array.array("d")
        self._bottoms = array.array("d")
        self._bottom = -math.inf
        # States before the jumps of the depth, oldest first; the depth may return to one of them.
        self._left: collections.deque[_DepthBeforeJump] = collections.deque(maxlen=_MOST_LEFT)
        #: Number of samples and depths left out because they contradict themselves or the limits of a log, by reason.
        self.unusable: dict[str, int] = {}
        self._units: dict[str, str] = {}
        #: Number of samples placed after later samples of their channel; they may be in the wrong logging pass.
        self.disordered = 0
        self._waiting: list[tuple[int, int, LogSample]] = []  # heap, ordered by end of the sample, ns, and by arrival
        self._arrivals = itertools.count()
        self._channels: dict[str, _DepthChannel] = {}

    @property
    def unplaced(self) -> dict[str, int]:
        """Number of samples without a depth, by channel: no bit depth is within half a minute of their time."""
        return {name: found.state.unplaced for name, found in self._channels.items() if found.state.unplaced}

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, sorted."""
        return tuple(sorted(self._channels))

    def newest(self) -> dict[str, Newest]:
        """Return the newest value of each channel that has a depth."""
        return {name: found.state.newest for name, found in self._channels.items() if found.state.newest is not None}

    def add_depth(self, stamp_ns: int, bit_depth: float) -> None:
        """
        Add a depth of the bit, m, in order of time.

        One depth per second is kept. An unknown depth (NaN) is left out. An impossible depth is left out and counted. A
        depth that is older than the last one by a second or more removes the later depths: a person has corrected the
        depth, or the rig's clock was set back (`DepthTrack` confirms this).
        """
        if math.isnan(bit_depth):
            return
        if not -_FARTHEST_M <= bit_depth <= DEEPEST_M:
            self._refuse(f"the bit depth is outside {-_FARTHEST_M:.0f} to {DEEPEST_M:.0f} m")
            return
        if self._stamps and self._stamps[-1] - stamp_ns >= _DEPTHS_NS:
            at = bisect.bisect_left(self._stamps, stamp_ns)
            for column in (self._stamps, self._bits, self._bottoms):
                del column[at:]
            self._bottom = self._bottoms[-1] if at else -math.inf
            while self._left and self._left[-1].stamp_ns >= stamp_ns:
                self._left.pop()
            # Make all samples so far final: those at the removed depths could not be assigned to a depth again.
            for channel in self._channels.values():
                channel.make_final(channel.state.newest_ns + 1)
        self._adjust_bottom(stamp_ns, bit_depth)
        self._bottom = max(self._bottom, bit_depth)
        if not self._stamps or stamp_ns - self._stamps[-1] >= _DEPTHS_NS:
            self._stamps.append(stamp_ns)
            self._bits.append(bit_depth)
            self._bottoms.append(self._bottom)
        if self._history is not None and len(self._stamps) > self._history:
            for column in (self._stamps, self._bits, self._bottoms):
                del column[: max(1, self._history // 4)]
            for channel in self._channels.values():
                channel.make_final(self._stamps[0])

    def _adjust_bottom(self, stamp_ns: int, bit_depth: float) -> None:
        """
        Adjust the bottom of the hole if a new bit depth, m, is farther away than a string can move in the time.

        If the depth returns to where it was before an earlier jump, the depths between both jumps were wrong, and the
        bottom before the earlier jump is restored. Otherwise the zero of the depths has changed, and the bottom is
        shifted by the same amount as the bit depth.
        """
        if not self._stamps:
            return
        here = _DepthBeforeJump(self._stamps[-1], self._bits[-1], self._bottom)
        if here.reaches(self._rules, stamp_ns, bit_depth):
            return
        step = bit_depth - here.bit_depth
        for k in reversed(range(len(self._left))):
            left = self._left[k]
            near = abs(bit_depth - left.bit_depth) < 0.5 * abs(step)
            if near and left.reaches(self._rules, stamp_ns, bit_depth):
                self._bottom = left.bottom
                while len(self._left) > k:
                    self._left.pop()
                return
        self._left.append(here)
        self._bottom += step

    def add(self, samples: Iterable[LogSample]) -> list[LogSample]:
        """Add samples, and return the valid ones; a sample that ends after the newest bit depth waits for a depth."""
        valid = []
        for sample in samples:
            reason = self._fault(sample)
            if reason:
                self._refuse(reason)
            else:
                valid.append(sample)
                self._units.setdefault(sample.channel, sample.unit)
                heapq.heappush(self._waiting, (_end_ns(sample), next(self._arrivals), sample))
        self.advance()
        while len(self._waiting) > _MOST_WAITING:
            heapq.heappop(self._waiting)
            self._refuse(f"no bit depth arrived while {_MOST_WAITING} samples waited for a depth")
        return valid

    def _refuse(self, reason: str) -> None:
        self.unusable[reason] = self.unusable.get(reason, 0) + 1

    def _fault(self, sample: LogSample) -> str:
        """Return why a sample, which may come from any program, exceeds the limits of a log; empty if it does not."""
        if not is_channel_name(sample.channel):
            return "the name of the channel does not consist of letters, digits and underscores"
        if sample.channel not in self._units and len(self._units) >= _MOST_CHANNELS:
            return f"there are more than {_MOST_CHANNELS} channels"
        if _UNIT.fullmatch(sample.unit) is None:
            return "the unit is not a symbol of at most 16 characters"
        if self._units.get(sample.channel, sample.unit) != sample.unit:
            return "the unit differs from the unit of the first sample of the channel"
        return next((reason for reason, kept in _LIMITS.items() if not kept(sample)), "")

    def advance(self) -> None:
        """Place the samples whose depth is known now."""
        reached = self._stamps[-1] if self._stamps else -(2**63)
        ready = []
        while self._waiting and self._waiting[0][0] <= reached:
            ready.append(heapq.heappop(self._waiting)[-1])
        if ready:
            self._place_in_order(ready)

    def finish(self) -> None:
        """Place the samples that still wait, because no depth follows."""
        ready, self._waiting = [one for *_, one in sorted(self._waiting)], []
        self._place_in_order(ready)

    def _place_in_order(self, samples: Sequence[LogSample]) -> None:
        """Place samples in order of time, also before samples of their channel that were placed earlier."""
        of_channel: dict[str, list[LogSample]] = {}
        for sample in sorted(filter(_has_value, samples), key=_order):
            of_channel.setdefault(sample.channel, []).append(sample)
        for name, arrived in of_channel.items():
            if name not in self._channels:
                self._channels[name] = _DepthChannel(arrived[0])
            channel = self._channels[name]
            # A sample that is later than this comes from a clock that was set back: place it as it arrives.
            oldest_ns = max(channel.final_ns, channel.state.newest_ns - _LATE_NS)
            late = [sample for sample in arrived if sample.stamp_ns < oldest_ns]
            in_order = arrived[len(late) :]
            if in_order:
                in_order = sorted([*reversed(channel.take_back(in_order[0].stamp_ns)), *in_order], key=_order)
            if late:
                self.disordered += len(late)
                for sample in late:
                    self._place(channel, sample)
                channel.recent.clear()
                channel.final_ns = channel.state.newest_ns
            elif not channel.recent and channel.final_ns == _NEVER_NS:
                # The first sample in time determines the number of sectors.
                channel = self._channels[name] = _DepthChannel(in_order[0])
            for sample in in_order:
                self._place(channel, sample)
            channel.make_final(channel.state.newest_ns - _LATE_NS)
        self.version += bool(samples)

    def _place(self, channel: _DepthChannel, sample: LogSample) -> None:
        before = channel.state
        state = channel.state = dataclasses.replace(before, newest_ns=max(before.newest_ns, sample.stamp_ns))
        offset = self.sensor_to_bit if math.isnan(sample.sensor_to_bit) else sample.sensor_to_bit
        state.offset = offset
        count = max(1, round(sample.span / _STEP_S))
        begin_ns, step_ns = _begin_ns(sample), sample.span * NANOSECONDS / count
        shares: dict[tuple[str, int], int] = {}
        for k in range(count):
            at = self._bit(begin_ns + round((k + 0.5) * step_ns))
            if at is None:
                continue
            bit, bottom = at
            depth = bit - offset
            passes = [ALL]
            # A deepest depth below the bottom of the hole was wrong.
            if depth >= min(state.deepest, bottom - offset) - _ON_BOTTOM_M:
                passes.append(FIRST)
            if bit >= bottom - _ON_BOTTOM_M:
                passes.append(DEEPEST)
            state.deepest = max(state.deepest, depth)
            index = math.floor(depth / self.step_m + 1e-9)
            for which in passes:
                shares[which, index] = shares.get((which, index), 0) + 1
        middle = self._bit(sample.stamp_ns)
        if middle is not None and math.isfinite(sample.value):
            state.newest = Newest(
                sample.value, sample.sigma, sample.stamp_ns, middle[0] - offset, sample.unit, sample.quality
            )
        sums = [
            (which, index, channel.passes[which].add(index, sample, steps / count))
            for (which, index), steps in shares.items()
        ]
        state.unplaced += not sums
        channel.recent.append(_RecentSample(sample, before, sums))

    def _bit(self, stamp_ns: int) -> tuple[float, float] | None:
        """
        Return the depth of the bit at a stamp, ns, by interpolation, and its deepest depth so far, m.

        Return None if the depths before and after are more than `_BRIDGE_S` apart, or if the stamp is farther than
        `_BRIDGE_S` before the first or after the last depth.
        """
        after = bisect.bisect_left(self._stamps, stamp_ns)
        if after == 0 or after == len(self._stamps):
            near = 0 if after == 0 else after - 1
            if not self._stamps or abs(self._stamps[near] - stamp_ns) > _BRIDGE_S * NANOSECONDS:
                return None
            return self._bits[near], self._bottoms[near]
        before = after - 1
        apart = self._stamps[after] - self._stamps[before]
        if apart > _BRIDGE_S * NANOSECONDS:
            return None
        part = (stamp_ns - self._stamps[before]) / apart
        bit = self._bits[before] + (self._bits[after] - self._bits[before]) * part
        return bit, max(self._bottoms[before], bit)

    def curve(self, channel: str, which: str = FIRST, most: int | None = None) -> Curve:
        """
        Return a channel over depth.

        which: logging pass, one of `PASSES`. most: number of the deepest steps to return; None returns all.

        Raises
        ------
        ValueError
            There is no sample of this channel, or no such logging pass.
        """
        if channel not in self._channels:
            raise ValueError(f"channel: no sample of {channel!r}; there are {', '.join(self._channels) or 'none'}")
        if which not in PASSES:
            raise ValueError(f"which: must be one of {', '.join(PASSES)}, got {which!r}")
        found = self._channels[channel]
        first, sums = found.passes[which].steps(most)
        spread, known = sums["sector_weight"], sums["samples"] > 0
        with np.errstate(invalid="ignore", divide="ignore"):
            return Curve(
                channel=channel,
                unit=found.unit,
                depth=(first + np.arange(len(sums), dtype=np.float64) + 0.5) * self.step_m,
                value=sums["total"] / sums["weight"],
                sigma=np.sqrt(sums["variance"] + sums["common"] ** 2) / sums["weight"],
                counts=np.where(known, sums["counts"], math.nan),
                seconds=sums["weight"].copy(),
                samples=sums["samples"].astype(float),
                sectors=sums["sector_total"] / spread,
                sigma_sectors=np.sqrt(sums["sector_variance"] + sums["sector_common"] ** 2) / spread,
                quality=np.where(known, sums["quality"], math.nan),
                gaps=self._gaps(found, which),
            )

    def _gaps(self, channel: _DepthChannel, which: str) -> tuple[tuple[float, float], ...]:
        """Return the intervals of depth without a value, m; if the channel stopped, also the interval below its end."""
        filled = channel.passes[which].filled()
        if not len(filled):
            return ()
        before = np.flatnonzero(np.diff(filled) > 1.0)
        gaps = [(float(filled[k] + 1.0) * self.step_m, float(filled[k + 1]) * self.step_m) for k in before]
        last, reached = float(filled[-1] + 1.0) * self.step_m, self._bottom - channel.state.offset
        silent_ns = self._stamps[-1] - channel.state.newest_ns
        if silent_ns > _SILENT_NS and reached - last > self.step_m:
            gaps.append((last, reached))
        return tuple(gaps)

    def curves(self, which: str = FIRST, most: int | None = None) -> tuple[Curve, ...]:
        """Return the curves of all channels; arguments and exceptions as in `curve`."""
        return tuple(self.curve(name, which, most) for name in self.channels)


def on_grid(curves: Sequence[Curve], step_m: float) -> tuple[Array, tuple[Array, ...]]:
    """
    Return a common depth axis for curves with the same depth step, m.

    Returns
    -------
    depth : ndarray, shape (n,)
        Middle of each step, m, from the shallowest to the deepest step of all curves.
    rows : tuple of ndarray of int64, shape (m,)
        For each curve that has steps: index in `depth` of each of its values. Curves without steps are left out.
    """
    curves = [one for one in curves if len(one.depth)]
    if not curves:
        return np.empty(0), ()
    first = [round(one.depth[0] / step_m - 0.5) for one in curves]
    low = min(first)
    high = max(begin + len(one.depth) for begin, one in zip(first, curves, strict=True))
    rows = tuple(begin - low + np.arange(len(one.depth)) for begin, one in zip(first, curves, strict=True))
    return (np.arange(low, high) + 0.5) * step_m, rows


_LARGEST_SHIFT_M = 5.0  # largest shift between two curves that is tried, m


def shift_between(reference: Curve, other: Curve) -> tuple[float, float]:
    """
    Return the depth shift between two curves by cross-correlation.

    Parameters
    ----------
    reference, other : Curve
        Curves with the same depth step.

    Returns
    -------
    shift, correlation : float
        Distance to add to the depths of `other`, m, and the correlation at that shift, -1 to 1; both NaN if at no
        shift ten steps have a value in both curves, or if one of the curves is constant there.

    Raises
    ------
    ValueError
        The depth steps differ.
    """
    if len(reference.depth) < 2 or len(other.depth) < 2:
        return math.nan, math.nan
    step = reference.depth[1] - reference.depth[0]
    if abs(other.depth[1] - other.depth[0] - step) > 1e-9:
        raise ValueError("other: both logs must have the same depth step")
    depth, (at, place) = on_grid((reference, other), step)
    most = min(round(_LARGEST_SHIFT_M / step), len(depth) - 1)
    one, two = np.full((2, len(depth)), np.nan)
    one[at], two[place] = reference.value, other.value
    scores = np.full(2 * most + 1, np.nan)
    for k in range(-most, most + 1):
        a, b = (one[k:], two[: len(two) - k]) if k >= 0 else (one[:k], two[-k:])
        both = np.isfinite(a) & np.isfinite(b)
        if both.sum() >= 10 and np.std(a[both]) > 0.0 and np.std(b[both]) > 0.0:
            scores[k + most] = np.corrcoef(a[both], b[both])[0, 1]
    if np.isnan(scores).all():
        return math.nan, math.nan
    # Prefer the smallest of several equally good shifts; a periodic log has such shifts.
    best = int(np.nanargmax(scores - 1e-9 * np.abs(np.arange(-most, most + 1))))
    part = 0.0
    if 0 < best < 2 * most and np.isfinite(scores[best - 1 : best + 2]).all():
        # Vertex of the parabola through the three best scores.
        left, top, right = scores[best - 1 : best + 2]
        bend = left - 2.0 * top + right
        part = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float((best - most + part) * step), float(scores[best])


def _within(value: float, low: float, high: float) -> bool:
    """Return whether a number is unknown or between two limits."""
    return math.isnan(value) or low <= value <= high


def _small(value: float) -> bool:
    """Return whether a value is unknown, out of the range of its sensor (infinite), or of a plausible size."""
    return math.isinf(value) or _within(value, -_LARGEST, _LARGEST)


def _even(sample: LogSample) -> bool:
    return len(sample.sectors) == len(sample.sigma_sectors) == len(sample.sector_durations) <= _MOST_SECTORS


# Checks of a sample; the key is the reason for refusing a sample that fails the check.
_LIMITS: dict[str, Callable[[LogSample], bool]] = {
    f"the distance from sensor to bit is outside 0 to {_FARTHEST_M:.0f} m": lambda one: _within(
        one.sensor_to_bit, 0.0, _FARTHEST_M
    ),
    f"the interval or time of measurement is outside 0 to {_LONGEST_S:.0f} s": lambda one: (
        0.0 <= one.span <= _LONGEST_S
        and 0.0 <= one.duration <= _LONGEST_S
        and all(0.0 <= seconds <= _LONGEST_S for seconds in one.sector_durations)
    ),
    f"the numbers of sectors differ, or are above {_MOST_SECTORS}": _even,
    f"a value is above {_LARGEST:g}, which no sensor measures": lambda one: all(map(_small, (one.value, *one.sectors))),
    f"a sigma or count is negative, or above {_LARGEST:g}": lambda one: all(
        _within(number, 0.0, _LARGEST) for number in (one.sigma, one.counts, *one.sigma_sectors)
    ),
}


def _has_value(sample: LogSample) -> bool:
    return sample.unit != FLAGS and any(map(math.isfinite, (sample.value, *sample.sectors)))


def _end_ns(sample: LogSample) -> int:
    return sample.stamp_ns + round(0.5 * sample.span * NANOSECONDS)


def _begin_ns(sample: LogSample) -> int:
    return _end_ns(sample) - round(sample.span * NANOSECONDS)


def _order(sample: LogSample) -> tuple[int, str]:
    return sample.stamp_ns, sample.channel
