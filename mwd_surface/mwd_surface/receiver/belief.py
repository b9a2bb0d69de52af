# SPDX-License-Identifier: Apache-2.0
"""
How far a decoded word is to be believed: its probability, and what parities say of the tool configuration.

By a wrong table, a wrong pulse width or without a tool, parities hold half the time; then no word is believed. How
probable that is, follows from how often they hold. No truth is needed.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import deque

# Probability that parities mean nothing, before any is seen.
_FAILING = 0.06
# The same of a tool whose words have no parity.
_UNSEEN = 0.002
# A transmission of a tool whose parities held: how much of the prior it begins with, the rest as the last one ended.
# Another sequence, a second tool or a false sync remain possible.
_ANEW = 0.25
_REMEMBERED = 32  # words with parity
SURVEY_LEVEL, TOOLFACE_LEVEL = 0.99, 0.95
# A likelihood is never surer than one slip in a hundred words: one odd word proves little.
_SLIP = 0.01


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One value of a word: code without parity, and its probability if parities mean anything."""

    code: int
    probability: float


@dataclasses.dataclass(frozen=True)
class Soft:
    """
    A word before it is judged.

    Attributes
    ----------
    candidates : tuple of Candidate
    holds : float or None
        Probability that its parity holds, parity not being used; None for a word without.
    """

    candidates: tuple[Candidate, ...]
    holds: float | None


@dataclasses.dataclass(frozen=True)
class Judged:
    """Most probable code, its confidence, and the next ones with theirs."""

    code: int
    confidence: float
    alternatives: tuple[tuple[int, float], ...]


class Doubt:
    """
    What the last parities say of the tool configuration.

    Parameters
    ----------
    parity : bool
        Whether the tool sends words with parity: without any, nothing tells a wrong table, and it is left to whoever
        wrote the table.
    """

    def __init__(self, parity: bool = True) -> None:
        self._seen: deque[float] = deque(maxlen=_REMEMBERED)
        self._first = _FAILING if parity else _UNSEEN
        self._prior = self._first

    def following(self) -> Doubt:
        """
        Return what is believed before the next transmission by the same configuration.

        As far as the parities so far have shown that the configuration is right, they count for the next transmission
        too; parities that failed do not: a false sync says nothing of the next one.
        """
        proven = max(1.0 - self.failing / self._first, 0.0) * (1.0 - _ANEW)
        after = copy.copy(self)
        after._seen = deque(maxlen=_REMEMBERED)
        after._prior = (1.0 - proven) * self._first
        return after

    def learn(self, words: list[Soft]) -> None:
        """Take the parities of more words."""
        self._seen.extend(word.holds for word in words if word.holds is not None)

    @property
    def failing(self) -> float:
        """Probability that parities mean nothing: wrong table, wrong pulse width, no tool."""
        odds = math.log(1.0 / self._prior - 1.0)
        for holds in self._seen:
            odds += math.log((_SLIP + (1.0 - 2.0 * _SLIP) * holds) / 0.5)
        return 1.0 / (1.0 + math.exp(odds))

    def judge(self, word: Soft) -> Judged:
        """Confidence of a word's values."""
        meant = 1.0 - self.failing
        found = sorted(
            ((meant * one.probability, one.code) for one in word.candidates), key=lambda row: (-row[0], row[1])
        )
        best = found[0]
        return Judged(best[1], best[0], tuple((code, p) for p, code in found[1:4]))
