# SPDX-License-Identifier: Apache-2.0
"""Spans without flow, found from the pressure: surveys are taken in them, and a pulse tool is silent."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.resampling import LARGEST

#: Share of the usual pressure below which the pumps count as off; friction in a mud line falls faster than its flow.
OFF = 0.25
_ON = 0.4
_FORGET_S = 3600.0
# Averaging time before the pressure is judged; it makes the result independent of how the samples are cut.
_BLOCK_S = 1.0
SURVEY_S = 10.0  #: time at rest that a survey takes, s; after a longer time at rest the tool sends a new survey
# Lowest standpipe pressure of a drilling rig.
_LEAST_PA = 1.0e6


class NoFlowSpan(NamedTuple):
    """Span without flow, s on the clock of the pressure; the end is inf while the span lasts."""

    start_s: float
    end_s: float


class FlowSpans:
    """Finder of spans without flow in blocks of pressure."""

    def __init__(self) -> None:
        self._cell: float | None = None
        self._sum = self._count = 0.0
        self._usual = 0.0
        self._known = False
        self.spans: list[NoFlowSpan] = []
        self._gaps: list[NoFlowSpan] = []

    def push(self, time_s: Array, pressure_pa: Array) -> None:
        """Add samples, shape (n,): rising times, s, and Pa; values that no gauge can measure are ignored."""
        time, pressure = np.asarray(time_s, dtype=float), np.asarray(pressure_pa, dtype=float)
        finite = np.isfinite(time) & (np.abs(pressure) < LARGEST)
        time, pressure = time[finite], pressure[finite]
        cells = np.floor(time / _BLOCK_S)
        for inside in np.split(np.arange(len(cells)), np.flatnonzero(np.diff(cells)) + 1):
            if not len(inside):
                continue
            cell = float(cells[inside[0]])
            if self._cell is not None and cell != self._cell and self._count:
                self._judge(self._cell * _BLOCK_S, self._sum / self._count)
                self._sum = self._count = 0.0
                unseen = NoFlowSpan((self._cell + 1.0) * _BLOCK_S, cell * _BLOCK_S)
                self._gaps += [unseen] if unseen.end_s - unseen.start_s >= SURVEY_S else []
            self._cell = cell
            self._sum += float(pressure[inside].sum())
            self._count += float(len(inside))

    def switch(self, at_s: float, flowing: bool) -> None:
        """Set the pumps on or off from a time on, s, for links whose samples do not show the flow (voltage)."""
        self._known = True
        off = bool(self.spans) and math.isinf(self.spans[-1].end_s)
        if off and flowing:
            self.spans[-1] = NoFlowSpan(self.spans[-1].start_s, at_s)
        elif not off and not flowing:
            self.spans.append(NoFlowSpan(at_s, math.inf))

    def flowing(self, at_s: float) -> bool | None:
        """Return whether the pumps are on at a time, s; None while the state of the pumps is not known."""
        if not self._known:
            return None
        last = next((span for span in reversed(self.spans) if span.start_s <= at_s), None)
        return last is None or at_s >= last.end_s

    def rested(self, from_s: float, until_s: float) -> bool:
        """
        Return whether a time without flow, or a data gap that may hide one, lies between two times, s.

        Only times and gaps that are long enough for a survey count.
        """
        return any(
            from_s <= span.start_s and span.end_s <= until_s and span.end_s - span.start_s >= SURVEY_S
            for span in (*self.spans, *self._gaps)
        )

    def on_since(self, time_s: float) -> float:
        """Return the end of the last span without flow or data before a time, s (earliest flow-on); -inf if unknown."""
        return max((span.end_s for span in (*self.spans, *self._gaps) if span.end_s <= time_s), default=-math.inf)

    def before(self, time_s: float) -> NoFlowSpan | None:
        """
        Return the last span without flow that ended before a time, s.

        Return None if there is no such span, or if a data gap may hide a later one.
        """
        last = next((span for span in reversed(self.spans) if span.end_s <= time_s), None)
        gap = next((gap for gap in reversed(self._gaps) if gap.end_s <= time_s), None)
        return None if last is None or (gap is not None and gap.end_s > last.start_s) else last

    def _judge(self, at: float, mean: float) -> None:
        # Follow a rising pressure at once and a falling one over an hour, because mud and depth change slowly.
        self._usual = max(mean, self._usual * math.exp(-_BLOCK_S / _FORGET_S), _LEAST_PA)
        if mean > _ON * self._usual or mean < OFF * self._usual:
            self.switch(at, mean > _ON * self._usual)
