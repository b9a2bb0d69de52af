# SPDX-License-Identifier: Apache-2.0
"""
Blind search for the pulse width and the sync of a tool: the likelihood of its syncs on a fine scale of widths.

A sync scores the Bayes factor of its pulses against noise, as in the receiver, so scores of different widths and
patterns in the same pressure are comparable. The words after the best syncs then decide.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import Sync, ToolConfiguration
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver
from mwd_surface.receiver.words import Reception

# Number of widths returned for each sync, and smallest difference of their logarithms. Several widths are needed,
# because the pulses of words may resemble the sync of another width and score higher than the true sync.
_PEAKS, _APART = 4, 0.05
_BEFORE_S = 60.0  # time before a sync whose pressure is used for the noise model, s
USUAL_SYNCS = (Sync(), Sync((0, 5, 15, 20, 30), 40), Sync((0, 4, 8, 12, 16), 24), Sync((0, 6, 12, 18, 24), 32))
# Shortest and longest width that is tried, s, and ratio of each width to the next smaller one. A width that is wrong by
# half of this step, 1 %, moves the last pulse of a sync by 0.3 TU.
_SHORTEST_S, _LONGEST_S, _RATIO = 0.2, 2.0, 1.02
# Number of widths tried on each side of the best width, ratio of each to the next smaller one, and how much lower than
# the best a score may be. The score is flat within some percent of the width, because the response of the channel is
# free; the estimated width is the weighted mean of the widths with such scores.
_FINE, _FINE_RATIO, _LOWER = 8, 1.004, 8.0


class Guess(NamedTuple):
    """A tool configuration with a width and sync that fit, its best score, and the time of that sync, s."""

    tool: ToolConfiguration
    score: float
    at_s: float


class _Syncs(PulseReceiver):
    """Receiver that only searches syncs."""

    def __init__(self, tool: ToolConfiguration) -> None:
        super().__init__(tool)
        self.best = Guess(tool, -math.inf, math.nan)

    def _advance(self, done: Reception) -> None:  # noqa: ARG002 (there are no words)
        while self._searchable:
            for found, position in self._found():
                if found.score > self.best.score:
                    self.best = self.best._replace(score=found.score, at_s=self._grid.seconds(position))


def guesses(
    tool: ToolConfiguration,
    time_s: Array,
    pressure_pa: Array,
    syncs: Sequence[Sync],
    progress: Callable[[float], None] = lambda _share: None,
) -> list[Guess]:
    """
    Return configurations of other widths and syncs, the most probable first.

    time_s, pressure_pa, shape (n,): rising times, s, and Pa; progress: called with the share that is done.
    """
    count = math.ceil(math.log(_LONGEST_S / _SHORTEST_S) / math.log(_RATIO))
    widths = [_SHORTEST_S * _RATIO**k for k in range(count + 1)]
    found = []
    for number, sync in enumerate(syncs):
        coarse = []
        for k, width in enumerate(widths):
            coarse.append(_best(tool, sync, width, time_s, pressure_pa))
            progress((number + (k + 1) / len(widths)) / len(syncs))
        found += [_refined(one, time_s, pressure_pa) for one in _peaks(coarse)]
    return sorted(found, key=lambda one: -one.score)


def _peaks(guesses_of_sync: Sequence[Guess]) -> list[Guess]:
    """Return the guesses with the highest scores whose widths differ, the best first."""
    peaks: list[Guess] = []
    for one in sorted(guesses_of_sync, key=lambda guess: -guess.score):
        others = (abs(math.log(one.tool.pulse_width_s / peak.tool.pulse_width_s)) for peak in peaks)
        if math.isfinite(one.score) and len(peaks) < _PEAKS and min(others, default=math.inf) > _APART:
            peaks.append(one)
    return peaks


def _refined(top: Guess, time_s: Array, pressure_pa: Array) -> Guess:
    """Return a guess with its width estimated from the scores of its neighbours in the pressure around its sync."""
    middle = top.tool.pulse_width_s
    near = (time_s > top.at_s - _BEFORE_S) & (time_s < top.at_s + 60.0 * middle)
    widths = middle * _FINE_RATIO ** np.arange(-_FINE, _FINE + 1.0)
    scores = np.array([_best(top.tool, top.tool.sync, one, time_s[near], pressure_pa[near]).score for one in widths])
    if not math.isfinite(scores.max()):
        # The noise before the sync is not the same in the pressure around it, so that no width has a sync there.
        return top
    weights = np.maximum(scores - (scores.max() - _LOWER), 0.0)
    width = float(weights @ widths / weights.sum())
    return top._replace(tool=dataclasses.replace(top.tool, pulse_width_s=width))


def _best(tool: ToolConfiguration, sync: Sync, width_s: float, time_s: Array, pressure_pa: Array) -> Guess:
    """Return the guess with the best sync for a width; its score is -inf without a sync, or with too few samples."""
    guess = dataclasses.replace(tool, pulse_width_s=width_s, sync=sync)
    search = _Syncs(guess)
    try:
        search.push(time_s, pressure_pa)
    except ValueError:
        return search.best
    search.finish()
    return search.best
