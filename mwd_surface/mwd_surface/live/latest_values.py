# SPDX-License-Identifier: Apache-2.0
"""
The last value of each live quantity, with sigma, unit, age and freshness, and the streams that bring them.

A value is live for two expected periods of its stream, then stale. None is unknown; zero is only ever a measured zero.
Times are s of one steady clock.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import deque
from collections.abc import Mapping

_WINDOW = 5  # whole seconds over which the rate of a stream is counted


class Freshness(enum.StrEnum):
    """Whether a value is current: LIVE up to two periods of its stream, then STALE; NO_DATA before the first."""

    LIVE = "live"
    STALE = "stale"
    NO_DATA = "no data"


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A live quantity: its unit, and the stream that brings it."""

    unit: str
    stream: str


@dataclasses.dataclass(frozen=True)
class LiveValue:
    """
    The last good value of a quantity.

    Attributes
    ----------
    value, sigma : float or None
        In `unit`; value None before the first one, sigma None where it is not known.
    unit : str
    at, age : float or None
        Arrival on the steady clock, and time since, s.
    stale_after : float
        Age from which it is stale, s.
    state : Freshness
    reason : str
        Why a value is withheld; empty where it is not.
    measured_at : float or None
        When it was measured, s of the same clock: before `at` by the way from the sensor to here. Over a telemetry link
        that of the word it comes from.
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
        """Age of the measurement at a time, s; None where there never was one."""
        return None if self.measured_at is None else max(0.0, now - self.measured_at)


#: A value that never arrived.
NO_VALUE = LiveValue()


@dataclasses.dataclass(frozen=True)
class StreamState:
    """A stream: freshness, last arrival and age, s, messages received and lost, messages per second or None."""

    state: Freshness
    at: float | None
    age: float | None
    stale_after: float
    count: int
    lost: int
    rate: float | None


@dataclasses.dataclass
class _Latest:
    value: float | None = None
    sigma: float | None = None
    at: float | None = None
    withheld: str = ""
    measured_at: float | None = None


@dataclasses.dataclass
class _Stream:
    count: int = 0
    lost: int = 0
    at: float | None = None
    seconds: deque[list[int]] = dataclasses.field(default_factory=lambda: deque(maxlen=2 * _WINDOW + 2))


class LatestValues:
    """
    Last values by name.

    Parameters
    ----------
    quantities : mapping of str to Quantity
    periods : mapping of str to float
        Of each stream the longest usual time between messages, s.
    """

    def __init__(self, quantities: Mapping[str, Quantity], periods: Mapping[str, float]) -> None:
        self._quantities = quantities
        self._periods = periods
        self._values = {name: _Latest() for name in quantities}
        self._streams = {name: _Stream() for name in periods}

    def arrived(self, stream: str, count: int, now: float, lost: int = 0) -> None:
        """
        Count messages of a stream, for its rate, age and losses.

        Raises
        ------
        ValueError
            No such stream.
        """
        if stream not in self._streams:
            raise ValueError(f"stream: {stream!r} is not one of {', '.join(self._streams)}")
        s = self._streams[stream]
        s.count, s.lost, s.at = s.count + count, s.lost + lost, now
        second = math.floor(now)
        if s.seconds and s.seconds[-1][0] == second:
            s.seconds[-1][1] += count
        else:
            s.seconds.append([second, count])

    def put(self, name: str, value: float, sigma: float | None, now: float, measured_at: float | None = None) -> None:
        """Store a finite value; a sigma that is not finite is unknown. measured_at: s; None: when it came."""
        latest = self._values[name]
        latest.measured_at = now if measured_at is None else measured_at
        latest.value, latest.at, latest.withheld = value, now, ""
        latest.sigma = sigma if sigma is not None and math.isfinite(sigma) else None

    def withhold(self, name: str, why: str) -> bool:
        """Mark the value as not current, with the reason; return True where the reason is new."""
        new = self._values[name].withheld != why
        self._values[name].withheld = why
        return new

    def last(self, name: str) -> float | None:
        """Return the last good value, whatever its age."""
        return self._values[name].value

    def updated(self, name: str, now: float) -> float | None:
        """Return the value where it arrived exactly at `now`, else None."""
        latest = self._values[name]
        return latest.value if latest.at == now else None

    def value(self, name: str, now: float) -> LiveValue:
        """Return one value as of `now`."""
        latest, quantity = self._values[name], self._quantities[name]
        age = None if latest.at is None else max(0.0, now - latest.at)
        state = Freshness.STALE if latest.withheld else self._freshness(quantity.stream, age)
        return LiveValue(
            value=latest.value,
            sigma=latest.sigma,
            unit=quantity.unit,
            at=latest.at,
            age=age,
            stale_after=self._stale_after(quantity.stream),
            state=Freshness.NO_DATA if latest.value is None else state,
            reason=latest.withheld,
            measured_at=latest.measured_at,
        )

    def streams(self, now: float) -> dict[str, StreamState]:
        """Return every stream as of `now`."""
        states = {}
        for name, stream in self._streams.items():
            age = None if stream.at is None else max(0.0, now - stream.at)
            states[name] = StreamState(
                state=self._freshness(name, age),
                at=stream.at,
                age=age,
                stale_after=self._stale_after(name),
                count=stream.count,
                lost=stream.lost,
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
    """Messages per second over the last whole seconds; None before there is one."""
    if not stream.seconds:
        return None
    current = math.floor(now)
    # The first second of a stream is counted only where it is the only one: it is not whole.
    first = max(stream.seconds[0][0] + (1 if len(stream.seconds) > 1 else 0), current - _WINDOW)
    if current <= first:
        return None
    return sum(count for second, count in stream.seconds if first <= second < current) / (current - first)
