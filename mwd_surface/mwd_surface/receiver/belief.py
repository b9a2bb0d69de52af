# SPDX-License-Identifier: Apache-2.0
"""
Probability that a decoded word is right, and that the tool configuration is the one the tool uses.

With a wrong word table, a wrong pulse width or no tool at all, a parity holds by chance half the time and pulses lie
between the windows of the table, or two in one window. No word can be trusted then. A table can also be right up to one
word and wrong after it, because that word has another length. The probability of both cases is estimated from parities
and pulses, by a Markov chain over the words (L. R. Rabiner, Proc. IEEE 77 (1989) 257); the true words are not needed.
"""

from __future__ import annotations

import dataclasses
import math

# Prior probability that the table is wrong from the first word on.
_FAILING = 0.06
# Prior of a wrong table for a transmission after one with a right table, as a share of `_FAILING`. The share is not
# smaller, because another sequence, a second tool or a false sync remain possible.
_ANEW = 0.25
# Probability that the table becomes wrong at a word, because that word is longer or shorter than in the table, or that
# a second tool begins; and that a wrong table becomes right again, for example after a disturbance of several words.
_BECOMES_WRONG, _BECOMES_RIGHT = 0.002, 0.02
# Lowest confidence with which a word of a survey and a word of a toolface sequence are believed.
SURVEY_LEVEL, TOOLFACE_LEVEL = 0.99, 0.95
# Probability that a word does not fit although the table is right, so that one odd word in a hundred does not decide.
_SLIP = 0.01
# Largest log likelihood ratio of the pulses of one word in favour of the table. It is small, because the pulses lie in
# the windows also if the table is wrong in another way, for example in its parities.
_MOST_FIT = 0.5


# Probability that a second tool of the same kind starts together with the first. The sizes of the pulses of their syncs
# together, relative to those of one tool, are evenly distributed: the second tool is nearer or farther. The pulses of a
# single tool change their size by this share (1 sigma), because the well changes.
_SECOND_TOOL, _SYNC_SIZES, _SIZE_CHANGES = 0.01, (1.25, 2.25), 0.07
# Greatest log likelihood ratio for a second tool by the size of the sync: the parities can speak against it.
_MOST_SECOND = 8.0


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
    holds : float or None
        Probability that the parity of the word holds, computed without using the parity; None for a word without
        parity.
    fits : float
        Log likelihood ratio of two cases: one pulse in each window of the table, or one or two pulses anywhere. NaN if
        the code has no windows with gaps between them.
    """

    candidates: tuple[Candidate, ...]
    holds: float | None
    fits: float = math.nan


@dataclasses.dataclass(frozen=True)
class Judged:
    """The most probable code, its confidence, and the next most probable codes with their confidences."""

    code: int
    confidence: float
    alternatives: tuple[tuple[int, float], ...]


class Doubt:
    """Probability that the table is wrong, updated with the parities and the pulses of each decoded word."""

    def __init__(self, prior: float = _FAILING) -> None:
        self._odds = math.log(1.0 / prior - 1.0)

    def following(self) -> Doubt:
        """
        Return the doubt with which the next transmission by the same configuration begins.

        Parities that held lower the prior of the next transmission. Parities that failed do not raise it, because the
        next sync may be right after a false one.
        """
        return Doubt(_FAILING * (_ANEW + (1.0 - _ANEW) * min(self.failing / _FAILING, 1.0)))

    @property
    def failing(self) -> float:
        """Probability that the table is wrong at the last word: another table, another pulse width, or no tool."""
        return 1.0 - _probability(self._odds)

    def learn(self, words: list[Soft]) -> list[float]:
        """
        Add decoded words; return the probability of each that the table is right at this word and that its pulses fit.

        Later words count for earlier ones, too: a word between words whose pulses do not fit is not trusted.
        """
        forward = []
        evidence = [_evidence(word) for word in words]
        for one in evidence:
            right = _probability(self._odds)
            right = right * (1.0 - _BECOMES_WRONG) + (1.0 - right) * _BECOMES_RIGHT
            self._odds = math.log(right / (1.0 - right)) + one
            forward.append(self._odds)
        trusted, later = [], 0.0
        for word, odds, one in zip(reversed(words), reversed(forward), reversed(evidence), strict=True):
            fits = 1.0 if math.isnan(word.fits) else _probability(word.fits + math.log(1.0 / _SLIP - 1.0))
            trusted.append(_probability(odds + later) * fits)
            ahead = math.exp(one + later)
            stays, turns = 1.0 - _BECOMES_WRONG, 1.0 - _BECOMES_RIGHT
            later = math.log((stays * ahead + _BECOMES_WRONG) / (_BECOMES_RIGHT * ahead + turns))
        return trusted[::-1]


def second_tool(size: float, sigma: float, words: list[Soft]) -> float:
    """
    Return the probability that a second tool sends at the same time; 0 if `sigma` is not finite.

    Parameters
    ----------
    size, sigma : float
        Size of the pulses of the sync relative to those of the words, and its 1 sigma.
    words : list of Soft
        Words after the sync: parities that hold are evidence for a single tool.
    """
    if not math.isfinite(sigma):
        return 0.0
    spread = math.sqrt(2.0 * (sigma**2 + _SIZE_CHANGES**2))
    low, high = (math.erf((size - edge) / spread) for edge in _SYNC_SIZES)
    two = max(0.5 * (low - high) / (_SYNC_SIZES[1] - _SYNC_SIZES[0]), 1e-300)
    ratio = math.log(two) + ((size - 1.0) / spread) ** 2 + math.log(spread * math.sqrt(math.pi))
    parities = sum(_evidence(dataclasses.replace(word, fits=math.nan)) for word in words)
    # A single tool has the right table, or a wrong one, whose parities say nothing.
    single = math.log(math.exp(parities) + _FAILING)
    return _probability(min(ratio, _MOST_SECOND) - single - math.log(1.0 / _SECOND_TOOL - 1.0))


def _probability(odds: float) -> float:
    """Return the probability for natural logarithmic odds, which are clipped to +-500."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -500.0), 500.0)))


def _evidence(word: Soft) -> float:
    """Return the log likelihood ratio of a word for a right table against a wrong table."""
    parity = 0.0 if word.holds is None else math.log((_SLIP + (1.0 - 2.0 * _SLIP) * word.holds) / 0.5)
    fits = 0.0 if math.isnan(word.fits) else min(word.fits, _MOST_FIT)
    return math.log((1.0 - _SLIP) * math.exp(parity + fits) + _SLIP)


def judge(word: Soft, trusted: float) -> Judged:
    """
    Return the most probable code of a word with its confidence, and up to three alternatives.

    trusted: probability from `Doubt.learn`.
    """
    found = sorted(
        ((trusted * one.probability, one.code) for one in word.candidates), key=lambda row: (-row[0], row[1])
    )
    best = found[0]
    return Judged(best[1], best[0], tuple((code, p) for p, code in found[1:4]))
