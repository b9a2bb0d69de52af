# SPDX-License-Identifier: Apache-2.0
"""Decision whether pulses are present behind a sync, from the evidence of its last stretches."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

# Least log likelihood ratio of a sync with the words after it. Noise reaches it with a probability below exp(-18) at
# each of ten thousand places per hour. Starting pumps can look like a sync, but not like the words after it.
_LEAST_EVIDENCE = 18.0
# Number of packets that are judged together (about 30 bits), and number of packets without words after which a sync is
# rejected as noise.
_JUDGED_PACKETS, _NO_WORDS_PACKETS = 10, 40
# Share of the expected evidence below which stretches hold no pulses.
_FAINT = 0.3


class Evidence(NamedTuple):
    """
    Log likelihood ratio of the pulses of a stretch against no pulses, with its numbers of packets and words.

    expected: mean of the ratio if the usual pulses were present in the noise of this stretch.
    """

    evidence: float
    expected: float
    packets: int
    words: int


class Presence:
    """
    Decision whether pulses are present, for one hypothesis, from the evidence of its stretches.

    Parameters
    ----------
    score : float
        Score of the sync.

    Attributes
    ----------
    confirmed : bool
        Whether words were found after the sync.
    faint : bool
        Whether the last stretches hold no pulses: a disturbance, an interruption, or the tool is silent.
    packets : int
        Number of packets so far.
    """

    def __init__(self, score: float) -> None:
        self._score = score
        self._usual: deque[float] = deque(maxlen=24)
        self._recent: list[Evidence] = []
        self._total = 0.0
        self.packets = 0
        self.confirmed = self.faint = False

    @property
    def usual(self) -> float:
        """Median evidence per packet so far."""
        return float(np.median(self._usual)) if self._usual else 0.0

    @property
    def hopeless(self) -> bool:
        """Whether the sync was noise: no words came after it."""
        return not self.confirmed and (self.packets >= _NO_WORDS_PACKETS or self._total < -_LEAST_EVIDENCE)

    @property
    def faint_words(self) -> int:
        """Words before the last stretch that are now seen to have had no pulses."""
        return sum(one.words for one in self._recent[:-1])

    def judge(self, stretch: Evidence) -> None:
        """Add a stretch, which may confirm the sync, or show that there are no pulses at present."""
        self._recent.append(stretch)
        self.packets += stretch.packets
        self._total += stretch.evidence
        if not self.confirmed:
            # The sync counts at most as much as the words, so a clear sync without words is never confirmed.
            self.confirmed = min(self._score, self._total) + self._total >= _LEAST_EVIDENCE
            if self.confirmed:
                self._accept(self._total / self.packets)
            return
        last = self._last()
        packets = sum(one.packets for one in last)
        if packets < _JUDGED_PACKETS:
            return
        evidence = sum(one.evidence for one in last)
        was = self.faint
        # Growing noise, as after stalls, lowers the expected evidence; but evidence that noise alone can reach is never
        # a pulse.
        noise = _LEAST_EVIDENCE * packets / _JUDGED_PACKETS
        expected = max(_FAINT * sum(one.expected for one in last), noise)
        self.faint = evidence <= min(_FAINT * self.usual * packets, expected)
        if not self.faint:
            self._accept(evidence / packets)
        elif not was:
            self._recent = last

    def _accept(self, each: float) -> None:
        self._usual.append(each)
        while sum(one.packets for one in self._recent) >= _JUDGED_PACKETS:
            del self._recent[0]

    def _last(self) -> list[Evidence]:
        """Return the last stretches with enough packets to be judged together."""
        packets = 0
        for k in range(len(self._recent) - 1, -1, -1):
            packets += self._recent[k].packets
            if packets >= _JUDGED_PACKETS:
                return self._recent[k:]
        return self._recent
