# SPDX-License-Identifier: Apache-2.0
"""
Find the pulse width of a tool if it differs from the configuration, and for an unknown tool its sync and parity.

A file is searched on a fine scale of widths (`sync_search`), the live pressure with one of the usual widths per second.
A width is accepted when a word is believed with it, which requires a sync and parities.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import Sync, ToolConfiguration
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.pulse import sync_search
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.pulse.pulse_widths import WIDTHS_S
from mwd_surface.receiver.words import BELIEVED, ReceivedWord, Reception

# Duration of pressure that is tried after flow-on, s: a survey of 133 s with 0.8 s pulses takes 332 s with 2 s pulses.
_TRIED_S = 900.0
# Duration of pressure that is kept before flow-on, s, so that the receiver can detect flow-on.
_BEFORE_S = 20.0
# Lowest score of a sync whose words are tried. If a hundred widths are tried on an hour of noise, one of them reaches
# this score in about one case of ten.
_LEAST_SCORE = 14.0
# Widths relative to the estimated one that are tried; the clock of the receiver follows half a percent.
_NEAR = (1.0, 1.006, 0.994)
# Share of the words that must be believed for a guess to end the search. With a wrong parity a few words of a hundred
# may be believed.
_CLEAR = 0.5
_SAME = 0.01  # largest relative difference between an estimated width and the same configured width


def other_widths(tool: ToolConfiguration) -> list[float]:
    """Return the usual pulse widths other than the tool's own, s, nearest first."""
    others = [one for one in WIDTHS_S if not math.isclose(one, tool.pulse_width_s)]
    return sorted(others, key=lambda one: abs(math.log(one / tool.pulse_width_s)))


def believed_with(
    tool: ToolConfiguration, width_s: float, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> bool:
    """Return whether any word is believed if the pulse width is `width_s`; other arguments as in `sent_tool`."""
    tool = dataclasses.replace(tool, pulse_width_s=width_s)
    return any(word.status == BELIEVED for word in received_with(tool, time_s, pressure_pa, strokes).words)


def received_with(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array]
) -> Reception:
    """Return the words decoded with a configuration; empty if the samples are too far apart for its pulses."""
    receiver = PulseReceiver(tool)
    for pump, times in strokes.items():
        receiver.strokes(pump, times)
    try:
        got = receiver.push(time_s, pressure_pa)
    except ValueError:
        return Reception()
    got.add(receiver.finish())
    return got


def sent_width(
    tool: ToolConfiguration,
    time_s: Array,
    pressure_pa: Array,
    strokes: Mapping[int, Array],
    progress: Callable[[float], None] = lambda _share: None,
) -> float | None:
    """
    Return the pulse width of the tool, s, if it differs from the configured width; else None.

    Arguments as in `sent_tool`.
    """
    found = sent_tool(tool, time_s, pressure_pa, strokes, (tool.sync,), progress=progress)
    if found is None or abs(found.pulse_width_s / tool.pulse_width_s - 1.0) < _SAME:
        return None
    return found.pulse_width_s


def sent_tool(
    tool: ToolConfiguration,
    time_s: Array,
    pressure_pa: Array,
    strokes: Mapping[int, Array],
    syncs: Sequence[Sync],
    parities: Sequence[str] = (),
    progress: Callable[[float], None] = lambda _share: None,
) -> ToolConfiguration | None:
    """
    Return the configuration whose width, sync and parity give most believed words; None without believed words.

    Parameters
    ----------
    tool : ToolConfiguration
        Tool configuration; its sequences are used.
    time_s, pressure_pa : ndarray, shape (n,)
    syncs : sequence of Sync
        Syncs to try.
    parities : sequence of str
        Parities to try; by default the parity of the tool.
    progress : callable
        Called with the share of the search that is done.
    """
    on_s = _longest_flow(time_s, pressure_pa)
    first = (time_s >= on_s - _BEFORE_S) & (time_s < on_s + _TRIED_S)
    time_s, pressure_pa = time_s[first], pressure_pa[first]
    best, most = None, 0
    for guess in sync_search.guesses(tool, time_s, pressure_pa, syncs, progress):
        if guess.score < _LEAST_SCORE:
            break
        sent = 0
        for parity, share in itertools.product(parities or (tool.parity,), _NEAR):
            one = dataclasses.replace(guess.tool, pulse_width_s=guess.tool.pulse_width_s * share, parity=parity)
            got = received_with(one, time_s, pressure_pa, strokes)
            believed = sum(word.status == BELIEVED for word in got.words)
            sent = max(sent, len(got.words))
            if believed > most:
                most, clock = believed, got.frames[-1].clock_error
                best = dataclasses.replace(one, pulse_width_s=one.pulse_width_s * (1.0 + clock))
        # A later guess has a lower score, so it is tried only if this one does not explain the words.
        if most > _CLEAR * sent:
            break
    return best


def unread_flow(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, words: Sequence[ReceivedWord]
) -> tuple[float, float] | None:
    """
    Return begin and end, s, of the longest flow without a believed word that was long enough for a survey.

    Return None if each flow of this length has a believed word. words: words decoded from the pressure; other arguments
    as in `sent_tool`.
    """
    needed_s = tool.transmit_delay_s + tool.head_s + tool.seconds(tool.surveys[0])
    believed = [word.start_s for word in words if word.status == BELIEVED]
    unread = [
        (begin, end)
        for begin, end in _flows(time_s, pressure_pa)
        if end - begin > needed_s and not any(begin <= at < end for at in believed)
    ]
    return max(unread, key=lambda one: one[1] - one[0], default=None)


def during(flow: tuple[float, float], time_s: Array) -> Array:
    """Return which samples belong to a flow, from before its begin on; flow: begin and end, s."""
    return np.asarray((time_s >= flow[0] - _BEFORE_S) & (time_s < flow[1]))


def _flows(time_s: Array, pressure_pa: Array) -> list[tuple[float, float]]:
    """Return begin and end, s, of each flow whose begin the pressure shows."""
    flow = FlowSpans()
    flow.push(time_s, pressure_pa)
    ends = [*(span.start_s for span in flow.spans[1:]), float(time_s[-1])]
    # If the last span without flow has not ended, its end is inf, and no flow follows it.
    return [(one.end_s, end) for one, end in zip(flow.spans, ends, strict=False) if math.isfinite(one.end_s)]


def _longest_flow(time_s: Array, pressure_pa: Array) -> float:
    """Return when the longest flow began, s; the first time if no flow-on is seen."""
    longest = max(_flows(time_s, pressure_pa), key=lambda one: one[1] - one[0], default=(float(time_s[0]),))
    return longest[0]


def sentence(tool: ToolConfiguration, width_s: float) -> str:
    """Return the message for a pulse width that was found."""
    return (
        f"the tool sends pulses of {width_s:.3g} s, not of {tool.pulse_width_s:g} s as set here: change pulse_width_s"
        " of the tool configuration"
    )


class OtherWidth:
    """Search for another pulse width in the pressure since flow-on, one width per second of samples."""

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool = tool
        self._second = self._since_s = -math.inf
        self._due: list[float] = []
        self._untried: list[float] = []
        self._kept: list[tuple[Array, Array]] = []
        self.found_s: float | None = None  #: pulse width that the tool sends

    def push(self, time_s: Array, pressure_pa: Array, since_s: float, first_s: float) -> None:
        """
        Add samples of one second or of a part of it. The first call in a second searches those before this second.

        Parameters
        ----------
        time_s, pressure_pa : ndarray, shape (n,)
            Rising times, s, and Pa.
        since_s : float
            Time of flow-on as known before these samples; -inf if unknown: the sync may then have been missed.
        first_s : float
            Delay of the first search after flow-on; a second search, for wider pulses, follows after twice this
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
