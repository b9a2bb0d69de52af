# SPDX-License-Identifier: Apache-2.0
"""
Last value of each live quantity, with sigma, unit, age and freshness, and the state of the streams.

A value is live for two expected periods of its stream, then stale. None is unknown; zero is always a measured zero.
Times are s of one steady clock.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import deque
from collections.abc import Mapping

_WINDOW = 5  # number of whole seconds over which the rate of a stream is counted


class Freshness(enum.StrEnum):
    """Freshness of a value: LIVE up to two periods of its stream, then STALE; NO_DATA before the first value."""

    LIVE = "live"
    STALE = "stale"
    NO_DATA = "no data"


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A live quantity: its unit, and the stream in which it arrives."""

    unit: str
    stream: str


@dataclasses.dataclass(frozen=True)
class LiveValue:
    """The last good value of a quantity."""

    #: `value`, `sigma`: value and 1 sigma in `unit`; value is None before the first value, sigma is None if unknown.
    value: float | None = None
    sigma: float | None = None
    unit: str = ""
    #: `at`, `age`: time of arrival by the steady clock, and time since arrival, s.
    at: float | None = None
    age: float | None = None
    stale_after: float = 0.0  #: age above which the value is stale, s
    state: Freshness = Freshness.NO_DATA
    reason: str = ""  #: reason why the value is withheld; empty if it is not withheld
    #: Time of measurement, s of the same clock: earlier than `at` by the delay from the sensor to the surface. Over a
    #: telemetry link it is the time at which the transmitted word was measured.
    measured_at: float | None = None

    def measured_age(self, now: float) -> float | None:
        """Return the age of the measurement at a time, s; None without a measurement."""
        return None if self.measured_at is None else max(0.0, now - self.measured_at)


#: Value before the first arrival.
NO_VALUE = LiveValue()


@dataclasses.dataclass(frozen=True)
class StreamState:
    """State of a stream: freshness, last arrival and age, s, and rate of its messages, Hz; None if unknown."""

    state: Freshness
    at: float | None
    age: float | None
    stale_after: float
    rate: float | None


@dataclasses.dataclass
class _Stream:
    at: float | None = None
    seconds: deque[list[int]] = dataclasses.field(default_factory=lambda: deque(maxlen=2 * _WINDOW + 2))


class LatestValues:
    """
    Last values by name.

    Parameters
    ----------
    periods : mapping of str to float
        Longest usual time between messages of each stream, s.
    """

    def __init__(self, quantities: Mapping[str, Quantity], periods: Mapping[str, float]) -> None:
        self._quantities = quantities
        self._periods = periods
        self._values = {
            name: LiveValue(unit=one.unit, stale_after=self._stale_after(one.stream))
            for name, one in quantities.items()
        }
        self._streams = {name: _Stream() for name in periods}

    def arrived(self, stream: str, count: int, now: float) -> None:
        """
        Count messages of a stream, for its rate and age.

        Raises
        ------
        ValueError
            The stream is unknown.
        """
        if stream not in self._streams:
            raise ValueError(f"stream: {stream!r} is not one of {', '.join(self._streams)}")
        s = self._streams[stream]
        s.at = now
        second = math.floor(now)
        if s.seconds and s.seconds[-1][0] == second:
            s.seconds[-1][1] += count
        else:
            s.seconds.append([second, count])

    def put(self, name: str, value: float, sigma: float | None, now: float, measured_at: float | None = None) -> None:
        """
        Store a finite value that arrived at `now`, s; a sigma that is not finite is unknown.

        measured_at: time of measurement, s; None: the time of arrival.
        """
        self._values[name] = dataclasses.replace(
            self._values[name],
            value=value,
            sigma=sigma if sigma is not None and math.isfinite(sigma) else None,
            at=now,
            reason="",
            measured_at=now if measured_at is None else measured_at,
        )

    def withhold(self, name: str, why: str) -> bool:
        """Mark the value as not current, with the reason; return True if the reason is new."""
        new = self._values[name].reason != why
        if new:
            self._values[name] = dataclasses.replace(self._values[name], reason=why)
        return new

    def last(self, name: str) -> float | None:
        """Return the last good value, whatever its age; None before the first one."""
        return self._values[name].value

    def updated(self, name: str, now: float) -> float | None:
        """Return the value if it arrived exactly at `now`, else None."""
        latest = self._values[name]
        return latest.value if latest.at == now else None

    def value(self, name: str, now: float) -> LiveValue:
        """Return a quantity's value, age and freshness at `now`."""
        latest = self._values[name]
        age = None if latest.at is None else max(0.0, now - latest.at)
        state = Freshness.STALE if latest.reason else self._freshness(self._quantities[name].stream, age)
        return dataclasses.replace(latest, age=age, state=Freshness.NO_DATA if latest.value is None else state)

    def streams(self, now: float) -> dict[str, StreamState]:
        """Return the state of every stream at `now`, by name."""
        states = {}
        for name, stream in self._streams.items():
            age = None if stream.at is None else max(0.0, now - stream.at)
            states[name] = StreamState(
                state=self._freshness(name, age),
                at=stream.at,
                age=age,
                stale_after=self._stale_after(name),
                rate=_rate(stream, now),
            )
        return states

    def _stale_after(self, stream: str) -> float:
        return 2.0 * self._periods[stream]

    def _freshness(self, stream: str, age: float | None) -> Freshness:
        if age is None:
            return Freshness.NO_DATA
        return Freshness.LIVE if age <= self._stale_after(stream) else Freshness.STALE


def _rate(stream: _Stream, now: float) -> float | None:
    """Return the rate of messages over the last whole seconds, Hz; None before the first whole second."""
    if not stream.seconds:
        return None
    current = math.floor(now)
    # Leave out the first second of a stream, which is not whole, unless it is the only one.
    first = max(stream.seconds[0][0] + (1 if len(stream.seconds) > 1 else 0), current - _WINDOW)
    if current <= first:
        return None
    return sum(count for second, count in stream.seconds if first <= second < current) / (current - first)


# History of a few channels for strip charts: one row per interval of time or depth, in constant memory.

Row = tuple[float | None, ...]


class StripHistory:
    """
    Rows of (end of interval, channel, channel, ...); an interval without data has None instead of the last value.

    Parameters
    ----------
    channels : mapping of str to "mean", "max" or "angle"
        How several values within one interval are combined; "angle" is their mean on the circle, rad in [0, 2 pi).
    seconds, rate : float
        Length of the history, s, and number of rows per second. For a history over depth: m, and rows per metre.

    Raises
    ------
    ValueError
        A combination is unknown, or the history is shorter than one row.
    """

    def __init__(self, channels: Mapping[str, str], seconds: float = 600.0, rate: float = 1.0) -> None:
        for name, how in channels.items():
            if how not in ("mean", "max", "angle"):
                raise ValueError(f"channels: {name}: expected mean, max or angle, got {how!r}")
        if not seconds * rate >= 1.0:
            raise ValueError(f"seconds, rate: their product must be at least one row, got {seconds} s at {rate} Hz")
        self.channels = dict(channels)
        self.interval = 1.0 / rate
        self.length = seconds
        self._rows: deque[Row] = deque(maxlen=round(seconds * rate))
        self._bin: int | None = None
        self._sums: dict[str, tuple[float, int]] = {}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the values in a row."""
        return ("at", *self.channels)

    def add(self, channel: str, value: float, now: float) -> None:
        """Add a value to the interval of `now`, s or m, unless the value is not finite or the interval is closed."""
        self.advance(now)
        if not math.isfinite(value) or self._bin is None or math.floor(now / self.interval) < self._bin:
            return
        total, count = self._sums.get(channel, (0.0, 0))
        if self.channels[channel] == "max":
            self._sums[channel] = (value if count == 0 else max(total, value), count + 1)
        elif self.channels[channel] == "angle" and count:
            # Unwrap the angle to the mean so far, so that 359 and 1 deg give 0.
            mean = total / count
            self._sums[channel] = (total + mean + math.remainder(value - mean, math.tau), count + 1)
        else:
            self._sums[channel] = (total + value, count + 1)

    def advance(self, now: float) -> None:
        """Close the interval that ended before `now`, s or m; append one empty row if further intervals passed."""
        current = math.floor(now / self.interval)
        if self._bin is None:
            self._bin = current
        if current <= self._bin:
            return
        self._rows.append(self._row(self._bin))
        self._sums = {}
        if current > self._bin + 1:
            # One empty row interrupts the line on the chart; more rows are not needed.
            self._rows.append(self._row(self._bin + 1))
        self._bin = current

    def rows(self) -> tuple[Row, ...]:
        """Return the rows of all closed intervals, oldest first."""
        return tuple(self._rows)

    def _row(self, index: int) -> Row:
        values: list[float | None] = [round((index + 1) * self.interval, 3)]
        for name, how in self.channels.items():
            total, count = self._sums.get(name, (0.0, 0))
            value = None if count == 0 else (total if how == "max" else total / count)
            if value is not None and how == "angle":
                value %= math.tau
            values.append(None if value is None else float(f"{value:.5g}"))
        return tuple(values)
