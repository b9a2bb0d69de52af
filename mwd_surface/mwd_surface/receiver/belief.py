# SPDX-License-Identifier: Apache-2.0
"""
How far a decoded word is to be believed: its probability, tempered by what the parities of its neighbours teach.

An estimated channel makes probabilities too sharp. Raising likelihoods to the power 1 / T flattens them; how probable
each T is, follows from how often parities hold where they should. T without bound stands for a wrong table, a wrong
pulse width or no tool: then parities hold half the time and no word is believed.
Source: C. Guo et al., On Calibration of Modern Neural Networks, 2017 (temperature); parities in place of labels.
"""

from __future__ import annotations

import copy
import dataclasses
from collections import deque

import numpy as np

from mwd_sensors.core.arrays import Array

# The first is what estimates cost: words with the truth known are likeliest at 1 to 1.2 in white noise and in simulated
# wells where one word of fifty is lost, at 1.3 where it is one of ten. The second is for stalls and gaps, likeliest at
# 2.7. Mixtures of temperatures from 1 to 1.5 explain the words no better than the first alone, and believe fewer.
TEMPERATURES = (1.15, 2.5)
# Before any parity is seen; the last is for a temperature without bound.
_PRIOR = (0.92, 0.02, 0.06)
# The last one of a tool whose words have no parity.
_UNSEEN = 0.002
# A transmission of a tool whose parities held: how much of the prior it begins with, the rest as the last one ended.
# Another sequence, a second tool or a false sync remain possible.
_ANEW = 0.25
_REMEMBERED = 32  # words with parity
SURVEY_LEVEL, TOOLFACE_LEVEL = 0.99, 0.95
# Least probability of a parity that float arithmetic tells from 0, at each temperature: surest to fail at the lowest.
_LEAST = tuple(1e-15 ** (1.0 / temperature) for temperature in TEMPERATURES)


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One value of a word: code without parity, its probability at each temperature."""

    code: int
    probability: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class Soft:
    """
    A word before it is judged.

    Attributes
    ----------
    candidates : tuple of Candidate
    holds : tuple of float or None
        Probability that its parity holds, at each temperature, parity not being used; None for a word without.
    """

    candidates: tuple[Candidate, ...]
    holds: tuple[float, ...] | None


@dataclasses.dataclass(frozen=True)
class Judged:
    """Most probable code, its confidence, and the next ones with theirs."""

    code: int
    confidence: float
    alternatives: tuple[tuple[int, float], ...]


class Temper:
    """
    What the last parities say of the temperature.

    Parameters
    ----------
    parity : bool
        Whether the tool sends words with parity: without any, nothing tells a wrong table, and it is left to whoever
        wrote the table.
    """

    def __init__(self, parity: bool = True) -> None:
        self._seen: deque[tuple[float, ...]] = deque(maxlen=_REMEMBERED)
        self._first = np.array(_PRIOR if parity else (*_PRIOR[:-1], _UNSEEN))
        self._prior = self._first

    def following(self) -> Temper:
        """
        Return what is believed before the next transmission by the same configuration.

        As far as the parities so far have shown that the configuration is right, they count for the next transmission
        too; parities that failed do not: a false sync says nothing of the next one.
        """
        weights = self.weights()
        bounded = np.append(weights[:-1], 0.0) / weights[:-1].sum()
        proven = max(1.0 - weights[-1] / self._first[-1], 0.0) * (1.0 - _ANEW)
        after = copy.copy(self)
        after._seen = deque(maxlen=_REMEMBERED)
        after._prior = (1.0 - proven) * self._first + proven * bounded
        return after

    def learn(self, words: list[Soft]) -> None:
        """Take the parities of more words."""
        self._seen.extend(word.holds for word in words if word.holds is not None)

    def weights(self) -> Array:
        """Probability of each temperature, and of one without bound; shape (3,)."""
        logs = np.log(self._prior)
        for holds in self._seen:
            # A likelihood is never surer than one slip in a hundred words: one odd word proves little.
            logs = logs + np.log([*(0.01 + 0.98 * p for p in holds), 0.5])
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum())

    @property
    def failing(self) -> float:
        """Probability that parities mean nothing: wrong table, wrong pulse width, no tool."""
        return float(self.weights()[-1])

    def judge(self, word: Soft) -> Judged:
        """Confidence of a word's values."""
        weights = self.weights()[:-1]
        if word.holds is not None:
            # Noise changes from word to word: a parity that would rather fail says so of its own word first. Whether
            # parities mean anything is a question to all of them, already answered.
            own = weights * np.maximum(word.holds, _LEAST)
            weights = own * (weights.sum() / own.sum())
        found = sorted(
            ((float(np.dot(weights, one.probability)), one.code) for one in word.candidates),
            key=lambda row: (-row[0], row[1]),
        )
        best = found[0]
        return Judged(best[1], best[0], tuple((code, p) for p, code in found[1:4]))
