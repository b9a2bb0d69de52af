"""
Single values as they came last, with sigma, unit, age and whether they still count; and the streams they come with.

A value counts for two expected periods of its stream. None is "no data"; zero is only ever a measured zero. Times are s
of one steady clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from mwd_surface.page.plain import number

LIVE, STALE, NO_DATA = "live", "stale", "no data"


@dataclasses.dataclass
class _Value:
    value: float | None = None
    sigma: float | None = None
    at: float | None = None
    withheld: str = ""


@dataclasses.dataclass
class _Stream:
    count: int = 0
    lost: int = 0
    at: float | None = None
    seconds: deque[list[int]] = dataclasses.field(default_factory=lambda: deque(maxlen=12))


class LiveValues:
    """
    Values by name.

    Parameters
    ----------
    values : mapping
        Name to unit and stream.
    periods : mapping
        Of each stream the longest usual time between messages, s.
    """

    def __init__(self, values: Mapping[str, tuple[str, str]], periods: Mapping[str, float]) -> None:
        self._about = values
        self._periods = periods
        self._values = {name: _Value() for name in values}
        self._streams = {name: _Stream() for name in periods}

    def arrived(self, stream: str, count: int, now: float, lost: int = 0) -> None:
        """
        Messages of a stream arrived: for rate, age and losses.

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

    def put(self, name: str, value: float, sigma: float | None, now: float) -> None:
        """The value is this now."""
        v = self._values[name]
        v.value, v.sigma, v.at, v.withheld = value, sigma, now, ""

    def withhold(self, name: str, why: str) -> bool:
        """The value no longer counts, for a reason; True where that is news."""
        news = self._values[name].withheld != why
        self._values[name].withheld = why
        return news

    def last(self, name: str) -> float | None:
        """The last good value, whatever its age."""
        return self._values[name].value

    def updated(self, name: str, now: float) -> float | None:
        """The value, where it came at this very time; else None."""
        v = self._values[name]
        return v.value if v.at == now else None

    def stale_after(self, stream: str) -> float:
        """Age from which a value of the stream no longer counts, s."""
        return 2.0 * self._periods[stream]

    def freshness(self, stream: str, age: float | None) -> str:
        """LIVE, STALE or NO_DATA by the age of what a stream brought; None: it never brought anything."""
        return NO_DATA if age is None else LIVE if age <= self.stale_after(stream) else STALE

    def cell(self, name: str, now: float) -> dict[str, Any]:
        """One value as the page takes it."""
        v = self._values[name]
        unit, stream = self._about[name]
        age = None if v.at is None else max(0.0, now - v.at)
        fresh = self.freshness(stream, age) if not v.withheld else STALE
        return {
            "value": number(v.value),
            "sigma": number(v.sigma),
            "unit": unit,
            "at": number(v.at),
            "age": number(age),
            "stale_after": self.stale_after(stream),
            "state": NO_DATA if v.value is None else fresh,
            "reason": v.withheld,
        }

    def links(self, now: float) -> dict[str, dict[str, Any]]:
        """Every stream as the page takes it."""
        rows = {}
        for name, stream in self._streams.items():
            age = None if stream.at is None else max(0.0, now - stream.at)
            rows[name] = {
                "state": self.freshness(name, age),
                "at": number(stream.at),
                "age": number(age),
                "stale_after": self.stale_after(name),
                "count": stream.count,
                "lost": stream.lost,
                "rate": _rate(stream, now),
            }
        return rows


def _rate(stream: _Stream, now: float) -> float | None:
    """Messages per second over the last whole seconds; None before there is one."""
    current = math.floor(now)
    whole = [(second, count) for second, count in stream.seconds if current - 6 < second < current]
    if not stream.seconds:
        return None
    first = max(stream.seconds[0][0] + (1 if len(stream.seconds) > 1 else 0), current - 5)
    return number(sum(c for s, c in whole if s >= first) / (current - first)) if current > first else None
