# SPDX-License-Identifier: Apache-2.0
"""
Probability that a decoded word is right, and that the receiver and the tool use the same configuration.

With a wrong word table, a wrong pulse width or no tool at all, a parity holds by chance half the time and pulses lie
between the windows of the table, or two in one window. No word can be trusted then. A table can also be right up to one
word and wrong after it, because that word has another length. A second tool may send, and fall silent later. The
probability of these cases is estimated from parities, pulses and the sizes of the syncs, by a Markov chain over the
words (L. R. Rabiner, Proc. IEEE 77 (1989) 257); the true words are not needed.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array

# Prior probabilities that the table is wrong from the first word on, and that a second tool of the same kind starts
# together with the first.
_FAILING, _SECOND_TOOL = 0.05, 0.01
# Factor on the priors above after a transmission with a right table and a single tool. The factor is not smaller,
# because another sequence, a second tool or a false sync remain possible.
_ANEW = 0.25
# _BECOMES_WRONG: probability, per word, that the table becomes wrong, because the word is longer or shorter than in the
# table or a second tool begins; also that a second tool falls silent. _BECOMES_RIGHT: probability, per word, that a
# wrong table becomes right again, for example after a disturbance of several words.
_BECOMES_WRONG, _BECOMES_RIGHT = 0.002, 0.02
# States of the Markov chain: right table and single tool, wrong table, two tools. Each row of `_CHANGES` holds the
# transition probabilities from one state.
_RIGHT, _WRONG, _TWO = range(3)
_CHANGES = np.array(
    [
        [1.0 - _BECOMES_WRONG, _BECOMES_WRONG, 0.0],
        [_BECOMES_RIGHT, 1.0 - _BECOMES_RIGHT, 0.0],
        [_BECOMES_WRONG, 0.0, 1.0 - _BECOMES_WRONG],
    ]
)
# Smallest confidence at which a word of a survey, or of a toolface sequence, is accepted.
SURVEY_LEVEL, TOOLFACE_LEVEL = 0.99, 0.95
# Probability that a word does not fit although the table is right. With it, a single odd word does not decide.
_SLIP = 0.01
# Largest log likelihood ratio of the pulses of one word in favour of the table. The ratio is small, because the pulses
# also lie in the windows of a table that is wrong in another way, for example in its parities.
_MOST_FIT = 0.5


# _SYNC_SIZES: range of the pulse size of a sync from two tools, relative to one tool; evenly distributed, because the
# distance of the second tool is unknown. _SIZE_CHANGES: relative change of the pulse size of a single tool, 1 sigma,
# because the well changes.
_SYNC_SIZES, _SIZE_CHANGES = (1.25, 2.25), 0.07
# Largest log likelihood ratio for a second tool from the size of a sync; the parities of the words can outweigh it.
_MOST_SECOND = 8.0


class Candidate(NamedTuple):
    """A possible value of a word: its code without parity, and its probability if the configuration is right."""

    code: int
    probability: float


@dataclasses.dataclass(frozen=True)
class Soft:
    """A decoded word before the probability of a wrong configuration is applied."""

    candidates: tuple[Candidate, ...]
    #: Probability that the parity of the word holds, computed without using the parity; None for a word without parity.
    holds: float | None
    #: Log likelihood ratio of two cases: one pulse in each window of the table, or one or two pulses anywhere. NaN if
    #: unknown.
    fits: float = math.nan


@dataclasses.dataclass(frozen=True)
class Judged:
    """The most probable code, its confidence, and the next most probable codes with their confidences."""

    code: int
    confidence: float
    alternatives: tuple[tuple[int, float], ...]


class Doubt:
    """
    Probabilities that the table is wrong, and that two tools send, updated with each decoded word and each sync.

    Parameters
    ----------
    share : float, optional
        Share of the prior probabilities with which the doubt begins.
    """

    def __init__(self, share: float = 1.0) -> None:
        wrong, two = share * _FAILING, share * _SECOND_TOOL
        self._chances = np.array([1.0 - wrong - two, wrong, two])

    @property
    def failing(self) -> float:
        """Probability that the last word is meaningless: wrong table or pulse width, no tool, or a second tool."""
        return float(self._chances[_WRONG] + self._chances[_TWO])

    @property
    def two_tools(self) -> float:
        """Probability that a second tool sends, which is a part of `failing`."""
        return float(self._chances[_TWO])

    def following(self) -> Doubt:
        """
        Return the doubt with which the next transmission by the same configuration begins.

        Parities that held lower the prior of the next transmission. Parities that failed do not raise it, because the
        next sync may be right after a false one.
        """
        return Doubt(_ANEW + (1.0 - _ANEW) * min(self.failing / (_FAILING + _SECOND_TOOL), 1.0))

    def hear_sync(self, size: float, sigma: float) -> None:
        """
        Add the evidence of a sync for or against a second tool that starts with it.

        Parameters
        ----------
        size, sigma : float
            Size of the pulses of the sync relative to those of the words after it, and its 1 sigma; infinite if it is
            unknown.
        """
        ratio = min(_sync_evidence(size, sigma), _MOST_SECOND)
        chances = self._chances.copy()
        # A sync of the usual size excludes the second tool. Otherwise the small probability of a second tool would
        # grow with each word of a wrong parity, because its pulses also lie in the windows.
        chances[_TWO] = max(chances[_TWO], _SECOND_TOOL * chances[_RIGHT]) * math.exp(ratio) if ratio >= 0.0 else 0.0
        self._chances = chances / chances.sum()

    def learn(self, words: list[Soft]) -> list[float]:
        """
        Add decoded words; return the probability of each that it has a meaning and that its pulses fit.

        Later words change the probability of earlier words: a word between words that do not fit is not trusted.
        """
        likelihoods = [_likelihoods(word) for word in words]
        forward = []
        for one in likelihoods:
            chances = (self._chances @ _CHANGES) * one
            self._chances = chances / chances.sum()
            forward.append(self._chances)
        trusted, later = [], np.ones(len(_CHANGES))
        for word, chances, one in zip(reversed(words), reversed(forward), reversed(likelihoods), strict=True):
            fits = 1.0 if math.isnan(word.fits) else _probability(word.fits + math.log(1.0 / _SLIP - 1.0))
            trusted.append(float(chances[_RIGHT] * later[_RIGHT] / (chances @ later)) * fits)
            later = _CHANGES @ (one * later)
            later /= later.sum()
        return trusted[::-1]


def _sync_evidence(size: float, sigma: float) -> float:
    """Return the log likelihood ratio of a second tool by the size of a sync; arguments as in `Doubt.hear_sync`."""
    if not (math.isfinite(size) and math.isfinite(sigma)):
        return 0.0
    spread = math.sqrt(2.0 * (sigma**2 + _SIZE_CHANGES**2))
    low, high = (math.erf((size - edge) / spread) for edge in _SYNC_SIZES)
    two = max(0.5 * (low - high) / (_SYNC_SIZES[1] - _SYNC_SIZES[0]), 1e-300)
    return math.log(two) + ((size - 1.0) / spread) ** 2 + math.log(spread * math.sqrt(math.pi))


def _probability(odds: float) -> float:
    """Return the probability for natural logarithmic odds, which are clipped to +-500."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -500.0), 500.0)))


def _likelihoods(word: Soft) -> Array:
    """
    Return the likelihood of a word for a right table, a wrong table and two tools, shape (3,).

    The likelihoods are divided by the likelihood for a wrong table.
    """
    parity = 0.0 if word.holds is None else math.log((_SLIP + (1.0 - 2.0 * _SLIP) * word.holds) / 0.5)
    fits = 0.0 if math.isnan(word.fits) else min(word.fits, _MOST_FIT)
    # Pulses of two tools that start together also lie in the windows, but their parities hold only by chance.
    right, two = ((1.0 - _SLIP) * math.exp(one + fits) + _SLIP for one in (parity, 0.0))
    return np.array([right, 1.0, two])


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
