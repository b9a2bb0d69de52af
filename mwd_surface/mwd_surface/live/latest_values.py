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
    """
    The last good value of a quantity.

    Attributes
    ----------
    value, sigma : float or None
        Value and 1 sigma in `unit`; value is None before the first value, sigma is None if unknown.
    at, age : float or None
        Time of arrival by the steady clock, and time since arrival, s.
    stale_after : float
        Age above which the value is stale, s.
    reason : str
        Reason why the value is withheld; empty if it is not withheld.
    measured_at : float or None
        Time of measurement, s of the same clock: earlier than `at` by the delay from the sensor to the surface. Over a
        telemetry link it is the time at which the transmitted word was measured.
    """

    value: float | None = None
    sigma: float | None = None
    unit: str = ""
    at: float | None = None
    age: float | None = None
    stale_after: float = 0.0
    state: Freshness = Freshness.NO_DATA
    reason: str = ""
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
