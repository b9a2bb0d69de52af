# SPDX-License-Identifier: Apache-2.0
"""
Samples of the log channels: means over intervals of the tool's clock; for gamma, also means for each sector.

All data are summed over full seconds. A second is closed when the attitude has reached the end of the next second.
Therefore a sample does not depend on how the streams are cut, if all data arrive at most a second after the attitude of
their time. A count belongs to the second and to the toolface at the middle of its counting interval.

The rate of counts is corrected for dead time, n = m / (1 - m tau), with m the counted rate (G. F. Knoll, Radiation
Detection and Measurement, 4th ed. 2010, equation 4.33). Its sigma is sqrt(N + 1/2) / T / (1 - m tau): the posterior of
a Poisson rate with Jeffreys' prior has the variance (N + 1/2) / T^2, which is not zero when nothing was counted.
"""

from __future__ import annotations

import functools
import math
import operator
from collections import deque
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.log_channels import (
    FLAGS,
    GAMMA,
    INCOMPLETE,
    NO_TOOLFACE,
    ONE_SIDED,
    SATURATED,
    SETTLE_S,
    SOURCES,
    LogChannel,
    LogSample,
)

_LATE_S = round(SETTLE_S)  # time after the end of a second at which it is closed, s
# Largest time between the middle of a count and the attitude row that gives its toolface, ns.
_NEAR_NS = 60_000_000
# Largest 1 sigma of a toolface whose count is added to a sector, rad: half the width of one of eight sectors.
_TOOLFACE_SIGMA = math.pi / 8.0
# Samples that are older than the closed seconds by more than _SET_BACK_S come from a clock that was set back. At most
# _MOST of them are kept until the attitude goes back too.
_SET_BACK_S, _MOST = 3, 10_000
# Smallest live share of the time, 1 - m tau, that is used in the correction; with a smaller live share the rate is a
# lower bound.
_LEAST_ALIVE = 0.05
_CONSTANTS = ("dead_time", "tool_factor", "sensor_to_bit")
_STATED_SIGMA = {"attitude": "sigma_{field}", "temperature": "variance"}


class _Second:
    """Sums of one channel over one second."""

    def __init__(self, second: int, channel: LogChannel) -> None:
        self.second = second
        self.seconds = self.total = self.squares = self.sigmas = 0.0
        self.samples = 0
        self.counts = self.unknown = 0.0
        self.sector_counts = np.zeros(channel.sectors)
        self.sector_seconds = np.zeros(channel.sectors)
        self.constants = (0.0, 1.0, math.nan)


class LogSampler:
    """
    Sampler of the log channels of one tool.

    Parameters
    ----------
    channels : mapping of str to LogChannel
    """

    def __init__(self, channels: Mapping[str, LogChannel]) -> None:
        self._channels = dict(channels)
        self._streams = {SOURCES[channel.source].stream for channel in channels.values()} | {"attitude"}
        #: Running means for telemetry words: the time from which the means are known, ns, and the mean over the last
        #: interval of each channel, by name. The caller must remove the entries that it has used.
        self.running: list[tuple[int, dict[str, LogSample]]] = []
        self.late = 0  #: number of samples that arrived too late and are not used
        self._waiting: dict[str, list[Samples]] = {name: [] for name in self._streams}
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._waiting["attitude"] = []
        self._closed_s: int | None = None
        self._lead_ns = 0
        self._open: dict[str, list[_Second]] = {name: [] for name in self._channels}
        self._last: dict[str, deque[_Second]] = {name: deque() for name in self._channels}

    def push(self, stream: str, samples: Samples) -> None:
        """
        Add samples of a stream, in order of time; call this before `advance` with the attitude of the same time.

        stream: counts, temperature, dynamics or status; samples: dtype `wire.COUNTS`, `wire.TEMPERATURE`,
        `wire.DYNAMICS` or `wire.TOOL_STATUS`. A stream that no channel uses is ignored.
        """
        if stream in self._streams and len(samples):
            self._waiting[stream].append(samples)

    def advance(self, attitude: Samples) -> list[LogSample]:
        """
        Add rows of `wire.ATTITUDE` in order; return the log samples that are now complete.

        If time goes back by more than a second, the samples of the earlier time are completed and the sampler restarts.
        """
        found: list[LogSample] = []
        stamps = attitude["stamp_ns"]
        while len(stamps):
            newest = np.maximum.accumulate(np.maximum(stamps, self._lead_ns))
            back = np.flatnonzero(stamps < newest - NANOSECONDS)
            count = int(back[0]) if len(back) else len(stamps)
            self._waiting["attitude"].append(attitude[:count])
            if count:
                if self._closed_s is None:
                    # Skip the first second: it is incomplete, and contains different samples live and offline.
                    self._closed_s = int(stamps[0]) // NANOSECONDS + 1
                self._lead_ns = int(newest[count - 1])
                found += self._close(self._lead_ns // NANOSECONDS - _LATE_S)
            if len(back):
                found += self.finish()
                self._begin_anew()
            attitude = attitude[count:]
            stamps = attitude["stamp_ns"]
        return found

    def finish(self) -> list[LogSample]:
        """Return the log samples of all remaining data, the last of them incomplete; no data may follow."""
        found = self._close(self._lead_ns // NANOSECONDS + 1)
        for name, open_ in self._open.items():
            if open_:
                found.append(_sample(name, self._channels[name], open_))
                open_.clear()
        return found

    def _close(self, until_s: int) -> list[LogSample]:
        """Close all seconds before `until_s`, s since 1970, and return the log samples that are complete."""
        if self._closed_s is None or until_s <= self._closed_s:
            return []
        rows = {name: _joined(waiting) for name, waiting in self._waiting.items()}
        at = {name: _seconds(name, samples) for name, samples in rows.items() if samples is not None}
        begin = self._closed_s
        seconds: set[int] = set()
        for name, place in at.items():
            late = (place < begin) & (place >= begin - _SET_BACK_S)
            # Do not count late rows of the attitude: they are kept for a second, for the toolface of later pulses.
            self.late += int(late.sum()) if name != "attitude" else 0
            seconds.update(np.unique(place[(place >= begin) & (place < until_s)]).tolist())
        found: list[LogSample] = []
        for second in sorted(seconds):
            found += self._close_second(second, rows, at)
        for name, place in at.items():
            keep = place >= until_s - 1 if name == "attitude" else (place >= until_s) | (place < begin - _SET_BACK_S)
            self._waiting[name] = [rows[name][keep][-_MOST:]] if keep.any() else []  # type: ignore[index]
        self._closed_s = until_s
        return found

    def _close_second(
        self, second: int, rows: Mapping[str, Samples | None], at: Mapping[str, Stamps]
    ) -> list[LogSample]:
        found: list[LogSample] = []
        now: dict[str, LogSample] = {}
        for name, channel in self._channels.items():
            stream = SOURCES[channel.source].stream
            samples = rows[stream][at[stream] == second] if stream in at else None  # type: ignore[index]
            open_, last = self._open[name], self._last[name]
            if open_ and open_[0].second // channel.interval_s != second // channel.interval_s:
                found.append(_sample(name, channel, open_))
                open_.clear()
            if samples is not None and len(samples):
                sums = _sums(second, channel, samples, rows["attitude"])
                if sums.seconds > 0.0:
                    open_.append(sums)
                    last.append(sums)
            while last and last[0].second <= second - channel.interval_s:
                last.popleft()
            if last:
                now[name] = _sample(name, channel, list(last), end_s=second + 1)
        self.running.append(((second + 1 + _LATE_S) * NANOSECONDS, now))
        return found


def rate(counts: Array | float, seconds: Array | float, dead_time: float) -> tuple[Array, Array, Array]:
    """
    Return the rate of events, its 1 sigma, and the share of the time outside the dead time of the detector.

    Rate and sigma are in 1/s; the share is at least 0.05. Each has the shape (...).

    Parameters
    ----------
    counts, seconds : array_like, shape (...)
        Number of counted pulses, and counting time, s; for a time of 0 the rate is NaN.
    dead_time : float
        Dead time after each pulse, s.
    """
    counts, seconds = np.asarray(counts, dtype=float), np.asarray(seconds, dtype=float)
    seen = np.where(seconds > 0.0, seconds, np.nan)
    alive = np.maximum(1.0 - counts / seen * dead_time, _LEAST_ALIVE)
    return counts / seen / alive, np.sqrt(counts + 0.5) / seen / alive, alive


def _sums(second: int, channel: LogChannel, samples: Samples, attitude: Samples | None) -> _Second:
    sums = _Second(second, channel)
    if channel.source == GAMMA:
        _add_counts(sums, channel, samples, attitude)
        return sums
    source = SOURCES[channel.source]
    values = samples[source.field].astype(float)
    known = np.isfinite(values)
    stated = _STATED_SIGMA.get(source.stream, "").format(field=source.field)
    if stated:
        sigma = samples[stated].astype(float)
        sigma = np.sqrt(np.maximum(sigma, 0.0)) if stated == "variance" else sigma
        known &= np.isfinite(sigma)
        sums.sigmas = float(np.mean(sigma[known])) if known.any() else 0.0
    else:
        sums.sigmas = math.nan
    if known.any():
        # Count all samples of a second as one value, because they are not independent.
        sums.seconds, sums.samples = 1.0, 1
        if channel.unit == FLAGS:
            sums.total = float(np.bitwise_or.reduce(values[known].astype(np.int64)))
            return sums
        sums.total = float(np.mean(values[known]))
        sums.squares = sums.total**2
    return sums


def _add_counts(sums: _Second, channel: LogChannel, samples: Samples, attitude: Samples | None) -> None:
    good = (samples["duration"] > 0.0) & np.isfinite(samples["duration"])
    samples = samples[good]
    if not len(samples):
        return
    seconds, counts = samples["duration"], samples["counts"].astype(float)
    sums.seconds, sums.counts = float(seconds.sum()), float(counts.sum())
    sums.constants = tuple(float(samples[name][-1]) for name in _CONSTANTS)  # type: ignore[assignment]
    if not channel.sectors:
        return
    direction = _toolfaces(_middle(samples), attitude) + samples["toolface_offset"]
    known = np.isfinite(direction)
    sums.unknown = float(seconds[~known].sum())
    place = np.floor(direction[known] / math.tau * channel.sectors + 0.5).astype(np.int64) % channel.sectors
    np.add.at(sums.sector_counts, place, counts[known])
    np.add.at(sums.sector_seconds, place, seconds[known])


def _middle(samples: Samples) -> Stamps:
    half = np.where(np.isfinite(samples["duration"]), samples["duration"], 0.0) * (0.5 * NANOSECONDS)
    return np.asarray(samples["stamp_ns"] - np.round(half).astype(np.int64))


def _toolfaces(stamps: Stamps, attitude: Samples | None) -> Array:
    """Return the gravity toolface at stamps, ns, from the nearest attitude rows, rad; NaN where it is unknown."""
    if attitude is None:
        return np.full(len(stamps), np.nan)
    order = np.argsort(attitude["stamp_ns"], kind="stable")
    rows = attitude[order]
    at = rows["stamp_ns"]
    after = np.clip(np.searchsorted(at, stamps), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(at[before] - stamps) <= np.abs(at[after] - stamps), before, after)
    found = rows[nearest]
    good = (found["sigma_gravity_toolface"] < _TOOLFACE_SIGMA) & (np.abs(at[nearest] - stamps) <= _NEAR_NS)
    return np.where(good, found["gravity_toolface"], np.nan)


def _sample(name: str, channel: LogChannel, parts: list[_Second], end_s: int | None = None) -> LogSample:
    """
    Return the log sample of one interval from the sums of its seconds.

    end_s: end of the interval, s since 1970; None: the multiple of the interval length after the first second.
    """
    span = channel.interval_s
    end = end_s if end_s is not None else (parts[0].second // span + 1) * span
    middle_ns = end * NANOSECONDS - span * NANOSECONDS // 2
    seconds = math.fsum(part.seconds for part in parts)
    quality = INCOMPLETE if seconds < 0.5 * span else 0
    if channel.source == GAMMA:
        return _gamma_sample(name, channel, parts, (middle_ns, seconds, quality))
    if channel.unit == FLAGS:
        found = functools.reduce(operator.or_, (int(part.total) for part in parts))
        return LogSample(
            middle_ns, name, FLAGS, seconds, float(span), float(found), 0.0, quality=quality, source=channel.source
        )
    count = sum(part.samples for part in parts)
    mean = math.fsum(part.total for part in parts) / count
    sigma = math.fsum(part.sigmas for part in parts) / count
    if math.isnan(sigma) and count > 1:
        scatter = max(math.fsum(part.squares for part in parts) / count - mean**2, 0.0)
        sigma = math.sqrt(scatter / (count - 1))
    return LogSample(
        middle_ns, name, channel.unit, seconds, float(span), mean, sigma, quality=quality, source=channel.source
    )


def _gamma_sample(name: str, channel: LogChannel, parts: list[_Second], frame: tuple[int, float, int]) -> LogSample:
    middle_ns, seconds, quality = frame
    dead_time, factor, sensor_to_bit = parts[-1].constants
    counts = math.fsum(part.counts for part in parts)
    value, sigma, alive = rate(counts, seconds, dead_time)
    if alive < 0.5:
        quality |= SATURATED
    sectors: tuple[Array, Array, Array] = (np.empty(0), np.empty(0), np.empty(0))
    if channel.sectors:
        durations = sum(part.sector_seconds for part in parts)
        means, sigmas, _ = rate(np.asarray(sum(part.sector_counts for part in parts)), durations, dead_time)
        sectors = (means * factor, sigmas * factor, np.asarray(durations))
        if any(part.unknown for part in parts):
            quality |= NO_TOOLFACE
        if np.count_nonzero(durations) < 0.5 * channel.sectors:
            quality |= ONE_SIDED
    return LogSample(
        middle_ns,
        name,
        channel.unit,
        seconds,
        float(channel.interval_s),
        float(value * factor),
        float(sigma * factor),
        counts=counts,
        sensor_to_bit=sensor_to_bit,
        sectors=tuple(sectors[0].tolist()),
        sigma_sectors=tuple(sectors[1].tolist()),
        sector_durations=tuple(sectors[2].tolist()),
        quality=quality,
        source=channel.source,
    )


def _joined(parts: list[Samples]) -> Samples | None:
    if not parts:
        return None
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _seconds(stream: str, samples: Samples) -> Stamps:
    stamps = _middle(samples) if stream == "counts" else samples["stamp_ns"]
    return np.asarray(stamps // NANOSECONDS)
