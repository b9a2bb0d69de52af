# SPDX-License-Identifier: Apache-2.0
"""Times of one topic of a recording: rate, gaps, shared stamps, stamps that go back, and offset from the recorder."""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps

# Shortest gap: the larger of a number of intervals and a time, s.
_INTERVALS, _SHORTEST_S = 5.0, 0.1
# _RATED: number of steps in a window, whose longest step is the interval between bursts.
# _BURSTS: the samples come in bursts if the interval between bursts is above this multiple of the median step; a step
# above this multiple of the interval between bursts is a gap.
_RATED, _BURSTS = 64, 3.0
# Offset, s, and drift, s/s, of a clock from the recorder's clock above which there is a remark.
_OFFSET_S, _DRIFT = 1.0, 1e-4
# A drift above PACE, s/s, shows that the run was made at another speed than real time. Smaller drifts are reported only
# for recordings longer than _LONG_S, s.
_LONG_S, PACE = 60.0, 0.05
_FEW = 10  # smallest number of blocks for a drift


class StreamTimes:
    """Times of the samples of a topic, read block by block."""

    def __init__(self) -> None:
        #: Number of samples, gaps, samples with the stamp of the sample before them, and stamps that go back.
        self.count = self.gaps = self.shared = self.backwards = 0
        self.first_ns = self.last_ns = 0  #: first and last stamp; 0 before any sample
        #: Length of the longest gap, and time from the first sample to the beginning of this gap.
        self.longest_gap_s = self.gap_at_s = 0.0
        # Interval between samples, between stamps, and between bursts of stamps, s.
        self._interval_s = self._step_s = self._burst_s = math.nan
        self._offsets: list[tuple[int, float]] = []

    def take(self, stamp_ns: Stamps, log_ns: Stamps) -> None:
        """Add samples by their stamps and log times, shape (n,), ns."""
        if not len(stamp_ns):
            return
        begin = self.last_ns if self.count else int(stamp_ns[0])
        self.first_ns = self.first_ns if self.count else begin
        steps = np.diff(stamp_ns, prepend=begin) * 1e-9
        forward = steps[1:] if self.count == 0 else steps
        self.backwards += int(np.count_nonzero(forward < 0.0))
        self.shared += int(np.count_nonzero(forward == 0.0))
        advances = forward > 0.0
        if math.isnan(self._step_s) and advances.any():
            self._step_s, self._burst_s = _intervals(forward[advances])
            self._interval_s = self._step_s * np.count_nonzero(advances) / np.count_nonzero(forward >= 0.0)
        limit = max(_INTERVALS * self._step_s, _BURSTS * self._burst_s, _SHORTEST_S)
        # A clock that is set forward during the recording also counts as a gap.
        long = np.flatnonzero(steps > limit)
        self.gaps += len(long)
        if len(long) and steps[long].max() > self.longest_gap_s:
            k = int(long[np.argmax(steps[long])])
            self.longest_gap_s = float(steps[k])
            self.gap_at_s = (int(stamp_ns[k]) - self.first_ns) * 1e-9 - self.longest_gap_s
        self.count += len(stamp_ns)
        self.last_ns = int(stamp_ns[-1])
        # The messages with the shortest delay show the difference of the clocks.
        self._offsets.append((int(log_ns[-1]), float((log_ns - stamp_ns).min()) * 1e-9))

    @property
    def rate(self) -> float:
        """Number of samples per second, from the first samples; nan for a single sample."""
        return 1.0 / self._interval_s if self._interval_s > 0.0 else math.nan

    @property
    def bursts(self) -> bool:
        """Whether stamps come in bursts, like those of messages stamped on arrival."""
        return self._burst_s > _BURSTS * self._step_s

    @property
    def offset_s(self) -> float:
        """Clock of the recorder minus clock of the stamps, s; nan before any sample."""
        return min((offset for _, offset in self._offsets), default=math.nan)

    @property
    def drift(self) -> float:
        """
        Rate of change of `offset_s`, s/s; nan if there are too few blocks, or a recording is too short to judge.

        Steps of the offset, for example when a clock is set during the recording, are not part of the drift.
        """
        if len(self._offsets) < _FEW:
            return math.nan
        at = np.array([log_ns - self._offsets[0][0] for log_ns, _ in self._offsets]) * 1e-9
        steps = np.diff([offset for _, offset in self._offsets], prepend=self._offsets[0][1])
        usual = np.median(steps[1:])
        steps[1:] = np.where(np.abs(steps[1:] - usual) < _OFFSET_S, steps[1:], usual)
        slope = float(np.polyfit(at, np.cumsum(steps), 1)[0]) if at[-1] > 0.0 else math.nan
        return slope if at[-1] > _LONG_S or abs(slope) > PACE else math.nan

    def remarks(self, regular: bool = True) -> list[str]:
        """
        Return sentences on anything unusual.

        `regular` means that the topic has a constant rate, so that gaps and bursts are unusual.
        """
        found = []
        if self.gaps and regular:
            often = "a gap" if self.gaps == 1 else f"{self.gaps} gaps, the longest"
            found.append(f"{often} of {self.longest_gap_s:.2f} s, {self.gap_at_s:.1f} s after the start")
        if self.bursts and regular:
            each = round(self._burst_s / self._interval_s)
            found.append(
                f"samples are stamped in bursts of {each} every {self._burst_s:.3g} s, as if stamped on arrival; stamp "
                "each sample when it is measured"
            )
        if self.shared == 1:
            found.append("a sample has the stamp of the sample before it")
        elif self.shared:
            found.append(
                f"{self.shared} of {self.count} samples have the stamp of the sample before them, as from a coarse "
                "clock or a batch with one stamp; their times are estimated; stamp each sample when it is measured"
            )
        if self.backwards:
            found.append("a stamp goes back" if self.backwards == 1 else f"{self.backwards} stamps go back")
        if abs(self.drift) > PACE:
            # A simulation or a replay at another speed: the difference of the clocks grows, and has no meaning.
            found.append(
                f"its clock runs {1.0 - self.drift:.2f} times as fast as the clock of the recorder, because the run "
                "was made at another speed than real time"
            )
            return found
        if abs(self.offset_s) > _OFFSET_S:
            side = "behind" if self.offset_s > 0 else "ahead of"
            found.append(f"its clock is {abs(self.offset_s):.1f} s {side} the clock of the recorder")
        if abs(self.drift) > _DRIFT:
            found.append(f"its clock drifts from the clock of the recorder by {1e6 * self.drift:+.0f} us per second")
        return found


def _intervals(steps: Array) -> tuple[float, float]:
    """
    Return the interval between samples and the usual interval between bursts, s, from the first steps, shape (n,).

    The interval between bursts is the median of the longest steps in windows of at most `_RATED` steps. If it is at
    most `_BURSTS` times the median step, the stream is regular, and the interval is the median step, because some
    samples may be lost. Otherwise the samples come in bursts, and the interval is the mean step, without gaps.
    """
    count = min(_RATED, len(steps))
    rows = np.lib.stride_tricks.sliding_window_view(steps, count)[:: max(count // 2, 1)]
    usual, longest = float(np.median(steps)), float(np.median(rows.max(axis=1)))
    if longest <= _BURSTS * usual:
        return usual, longest
    return float(steps[steps < _BURSTS * longest].mean()), longest
