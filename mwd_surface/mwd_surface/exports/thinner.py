"""Fewer rows of a fast stream: the first of each equal interval of time since the epoch, wherever blocks end."""

from __future__ import annotations

import numpy as np

from mwd_sensors import wire


class Thinner:
    """
    Picks rows of streams that share their stamps.

    rate_hz : at most so many rows a second; 0 keeps every row.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else 0
        self._last = -1

    def __call__(self, *streams: wire.Samples) -> tuple[wire.Samples, ...]:
        """The rows picked of a block; every stream has the stamps of the first."""
        if self._period_ns <= 0 or not len(streams[0]):
            return streams
        intervals = streams[0]["stamp_ns"] // self._period_ns
        picked = np.diff(intervals, prepend=self._last) != 0
        self._last = int(intervals[-1])
        return tuple(stream[picked] for stream in streams)
