# SPDX-License-Identifier: Apache-2.0
"""
Whether a tool sends pulses of another width than its configuration says: the usual widths are tried.

A width counts once a word is believed by it, which takes sync and parities.
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

# So much of a recording is tried from a flow-on, s: a survey of 133 s in pulses of 0.8 s takes 332 s in the widest.
_TRIED_S = 900.0


def other_widths(tool: ToolConfiguration) -> list[float]:
    """Usual pulse widths but the tool's own, s, the nearest first."""
    others = [one for one in WIDTHS_S if not math.isclose(one, tool.pulse_width_s)]
    return sorted(others, key=lambda one: abs(math.log(one / tool.pulse_width_s)))


def believed_with(
    tool: ToolConfiguration, width_s: float, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> bool:
    """Whether a word is believed with another pulse width; arrays of shape (n,): s, Pa; strokes of each pump, s."""
    receiver = PulseReceiver(dataclasses.replace(tool, pulse_width_s=width_s))
    for pump, times in strokes.items():
        receiver.strokes(pump, times)
    try:
        got = receiver.push(time_s, pressure_pa)
    except ValueError:
        # The samples are too far apart for such pulses.
        return False
    got.add(receiver.finish())
    return any(word.status == BELIEVED for word in got.words)


def sent_width(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> float | None:
    """Pulse width by which words of a recording are believed, s, arguments as `believed_with`; None: none is."""
    on_s = _longest_flow(time_s, pressure_pa)
    first = (time_s >= on_s) & (time_s < on_s + _TRIED_S)
    tried = time_s[first], pressure_pa[first], strokes
    return next((one for one in other_widths(tool) if believed_with(tool, one, *tried)), None)


def _longest_flow(time_s: Array, pressure_pa: Array) -> float:
    """When the flow came on for the longest, s; the first time where no flow-on is seen."""
    flow = FlowSpans()
    flow.push(time_s, pressure_pa)
    ends = [*(span.start_s for span in flow.spans[1:]), float(time_s[-1])]
    # The last span may last to the end: no flow follows it.
    flows = [(end - span.end_s, span.end_s) for span, end in zip(flow.spans, ends, strict=False)]
    return max((one for one in flows if math.isfinite(one[1])), default=(0.0, float(time_s[0])))[1]


def sentence(tool: ToolConfiguration, width_s: float) -> str:
    """What is said of a pulse width that was found."""
    return (
        f"the tool sends pulses of {width_s:g} s, not of {tool.pulse_width_s:g} s as set here: change pulse_width_s of"
        " the tool configuration"
    )


class OtherWidth:
    """
    Search for another pulse width in the pressure since flow-on: one width a second, however the samples are cut.

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
        Take samples of one second, or of a part of it; the first ones of a second search in what came before it.

        Parameters
        ----------
        time_s, pressure_pa : ndarray, shape (n,)
            Rising times, s, and Pa.
        since_s : float
            When the flow came on, as known before these samples; -inf: it is not, and the sync may have gone by.
        first_s : float
            How long after that the first search begins, s; a second one, for wider pulses, after twice the time.
        """
        second = float(np.floor(time_s[0]))
        if second != self._second:
            self._second = second
            self._search(since_s, first_s)
        if self._due or self._untried:
            self._kept.append((time_s, pressure_pa))

    def end(self) -> None:
        """Search no more until the flow comes on anew: words are heard."""
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
