# SPDX-License-Identifier: Apache-2.0
"""
Test whether a tool sends pulses of another width than its configuration says, by trying the usual widths.

A width is accepted once a word is believed with it, which needs a sync and parities.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.pulse.pulse_widths import WIDTHS_S
from mwd_surface.receiver.words import BELIEVED

# Length of recording that is tried from flow-on, s: a survey of 133 s with 0.8 s pulses takes 332 s with the widest.
_TRIED_S = 900.0


def other_widths(tool: ToolConfiguration) -> list[float]:
    """Return the usual pulse widths other than the tool's own, s, nearest first."""
    others = [one for one in WIDTHS_S if not math.isclose(one, tool.pulse_width_s)]
    return sorted(others, key=lambda one: abs(math.log(one / tool.pulse_width_s)))


def believed_with(
    tool: ToolConfiguration, width_s: float, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> bool:
    """Return whether a word is believed with this pulse width; arrays, shape (n,): s and Pa; strokes per pump, s."""
    receiver = PulseReceiver(dataclasses.replace(tool, pulse_width_s=width_s))
    for pump, times in strokes.items():
        receiver.strokes(pump, times)
    try:
        got = receiver.push(time_s, pressure_pa)
    except ValueError:
        # The samples are too far apart for pulses of this width.
        return False
    got.add(receiver.finish())
    return any(word.status == BELIEVED for word in got.words)


def sent_width(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> float | None:
    """Return the pulse width with which words are believed, s, or None; arguments as in `believed_with`."""
    on_s = _longest_flow(time_s, pressure_pa)
    first = (time_s >= on_s) & (time_s < on_s + _TRIED_S)
    tried = time_s[first], pressure_pa[first], strokes
    return next((one for one in other_widths(tool) if believed_with(tool, one, *tried)), None)


def _longest_flow(time_s: Array, pressure_pa: Array) -> float:
    """Return when the longest flow began, s; the first time if no flow-on is seen."""
    flow = FlowSpans()
    flow.push(time_s, pressure_pa)
    ends = [*(span.start_s for span in flow.spans[1:]), float(time_s[-1])]
    # The last span without flow may last to the end, with no flow after it.
    flows = [(end - span.end_s, span.end_s) for span, end in zip(flow.spans, ends, strict=False)]
    return max((one for one in flows if math.isfinite(one[1])), default=(0.0, float(time_s[0])))[1]


def sentence(tool: ToolConfiguration, width_s: float) -> str:
    """Return the message for a pulse width that was found."""
    return (
        f"the tool sends pulses of {width_s:g} s, not of {tool.pulse_width_s:g} s as set here: change pulse_width_s of"
        " the tool configuration"
    )


class OtherWidth:
    """
    Search for another pulse width in the pressure since flow-on, one width per second of samples.

    Parameters
    ----------
    tool : ToolConfiguration

    Attributes
    ----------
    found_s : float or None
        Pulse width that the tool sends, s.
    """

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool = tool
        self._second = self._since_s = -math.inf
        self._due: list[float] = []
        self._untried: list[float] = []
        self._kept: list[tuple[Array, Array]] = []
        self.found_s: float | None = None

    def push(self, time_s: Array, pressure_pa: Array, since_s: float, first_s: float) -> None:
        """
        Add samples of one second or of a part of it. The first call in a second searches the samples before it.

        Parameters
        ----------
        time_s, pressure_pa : ndarray, shape (n,)
            Rising times, s, and Pa.
        since_s : float
            Time of flow-on as known before these samples, s; -inf if unknown, and the sync may have been missed.
        first_s : float
            Delay of the first search after flow-on, s; a second search, for wider pulses, follows after twice this
            time.
        """
        second = float(np.floor(time_s[0]))
        if second != self._second:
            self._second = second
            self._search(since_s, first_s)
        if self._due or self._untried:
            self._kept.append((time_s, pressure_pa))

    def end(self) -> None:
        """Stop searching until the next flow-on, because words are being received."""
        self._due, self._untried, self._kept, self.found_s = [], [], [], None

    def _search(self, since_s: float, first_s: float) -> None:
        if since_s != self._since_s:
            self.end()
            self._since_s, self._due = since_s, [since_s + first_s, since_s + 2.0 * first_s]
        if self._due and self._second >= self._due[0]:
            self._due.pop(0)
            self._untried = other_widths(self._tool)
        if not (self._untried and self._kept):
            return
        width = self._untried.pop(0)
        time, pressure = (np.concatenate(rows) for rows in zip(*self._kept, strict=True))
        if believed_with(self._tool, width, time, pressure, {}):
            self.end()
            self.found_s = width
