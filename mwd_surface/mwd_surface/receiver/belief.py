# SPDX-License-Identifier: Apache-2.0
"""
Probability that a decoded word is right, and that the tool configuration is the one the tool uses.

With a wrong word table, a wrong pulse width or no tool at all, a parity holds by chance half the time and pulses lie
between the windows of the table. No word can be trusted then. The probability of this case is estimated from the
parities that hold and the pulses that lie in their windows; the true words are not needed.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import deque

# Prior probability that parities hold only by chance.
_FAILING = 0.06
# Share of the prior with which the next transmission begins when the parities of the last one held. It is not smaller
# because another sequence, a second tool or a false sync remain possible.
_ANEW = 0.25
_REMEMBERED = 32  # number of last words whose parities are used
SURVEY_LEVEL, TOOLFACE_LEVEL = 0.99, 0.95
# Bound on the likelihood of one word, so that one odd word in a hundred does not decide.
_SLIP = 0.01


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A possible value of a word: its code without parity, and its probability if the configuration is right."""

    code: int
    probability: float


@dataclasses.dataclass(frozen=True)
class Soft:
    """
    A decoded word before the probability of a wrong configuration is applied.

    Attributes
    ----------
    candidates : tuple of Candidate
    holds : float or None
        Probability that the parity of the word holds, computed without using the parity; None for a word without
        parity.
    fits : float
        Log likelihood ratio of two cases: the table is right, or its windows hold pulses only by chance.
    """

    candidates: tuple[Candidate, ...]
    holds: float | None
    fits: float = 0.0


@dataclasses.dataclass(frozen=True)
class Judged:
    """The most probable code, its confidence, and the next most probable codes with their confidences."""

    code: int
    confidence: float
    alternatives: tuple[tuple[int, float], ...]


class Doubt:
    """Probability of a wrong tool configuration, estimated from the last words: their parities and their pulses."""

    def __init__(self) -> None:
        self._seen: deque[float] = deque(maxlen=_REMEMBERED)
        self._prior = _FAILING

    def following(self) -> Doubt:
        """
        Return the doubt with which the next transmission by the same configuration begins.

        Parities that held lower the prior of the next transmission. Parities that failed do not raise it, because one
        false sync says nothing about the next.
        """
        proven = max(1.0 - self.failing / _FAILING, 0.0) * (1.0 - _ANEW)
        after = copy.copy(self)
        after._seen = deque(maxlen=_REMEMBERED)
        after._prior = (1.0 - proven) * _FAILING
        return after

    def learn(self, words: list[Soft]) -> None:
        """Add the parities and the pulses of more words."""
        self._seen.extend(
            math.log((_SLIP + (1.0 - 2.0 * _SLIP) * (0.5 if word.holds is None else word.holds)) / 0.5)
            + max(word.fits, math.log(_SLIP))
            for word in words
            if word.holds is not None or word.fits
        )

    @property
    def failing(self) -> float:
        """Probability that the parities hold only by chance: wrong table, wrong pulse width, or no tool."""
        odds = math.log(1.0 / self._prior - 1.0) + sum(self._seen)
        return 1.0 / (1.0 + math.exp(min(odds, 500.0)))

    def judge(self, word: Soft) -> Judged:
        """Return the most probable code of a word with its confidence, and up to three alternatives."""
        meant = 1.0 - self.failing
        found = sorted(
            ((meant * one.probability, one.code) for one in word.candidates), key=lambda row: (-row[0], row[1])
        )
        best = found[0]
        return Judged(best[1], best[0], tuple((code, p) for p, code in found[1:4]))
