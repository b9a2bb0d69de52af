# SPDX-License-Identifier: Apache-2.0
"""Decision whether a transmission is present, from the evidence for pulses in its last stretches."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

# Least log likelihood ratio of a sync with the words after it. Noise reaches it with a probability below exp(-18) at
# each of ten thousand places per hour. Starting pumps can look like a sync, but not like the words after it.
_LEAST_EVIDENCE = 18.0
# Number of packets that are judged together (some 30 bits); number to wait for after a clear sync, whose first packets
# may be disturbed; number without pulses after which a faded tool, which may still be sending, is given up.
_JUDGED_PACKETS, _DISTURBED_PACKETS, _FADED_PACKETS = 10, 25, 60
# Share of the expected evidence below which stretches hold no pulses, or pulses of a tool that began anew.
_FAINT = 0.3
NO_WORDS = "no words behind the sync: it was noise, or the sequence is another one"
FADED = "no pulses any more: flow off, too weak, or the tool began anew"


class Evidence(NamedTuple):
    """
    Log likelihood ratio of the pulses of a stretch against no pulses, with its numbers of packets and words.

    expected: mean of the ratio if pulses as before were present in the present noise.
    """

    evidence: float
    expected: float
    packets: int
    words: int


class Presence:
    """
    Judge of one transmission, from the evidence of its stretches.

    Parameters
    ----------
    score : float
        Score of the sync.
    """

    def __init__(self, score: float) -> None:
        self._score = score
        self._usual: deque[float] = deque(maxlen=24)
        self._recent: list[Evidence] = []
        self.faint = False

    @property
    def confirmed(self) -> bool:
        """Whether words were found after the sync."""
        return bool(self._usual)

    @property
    def usual(self) -> float:
        """Median evidence per packet so far."""
        return float(np.median(self._usual)) if self._usual else 0.0

    @property
    def faint_words(self) -> int:
        """Words before the last stretch that are now seen to have had no pulses."""
        return sum(one.words for one in self._recent[:-1])

    def judge(self, stretch: Evidence, whole: bool, waiting: bool) -> str:
        """
        Add a stretch; return why the transmission has ended, or an empty string if it goes on.

        Parameters
        ----------
        stretch : Evidence
        whole : bool
            Whether the stretch completes a pass.
        waiting : bool
            Whether another sync was found.
        """
        self._recent.append(stretch)
        last = self._last()
        packets = sum(one.packets for one in last)
        if packets < _JUDGED_PACKETS and (self.confirmed or not whole):
            return ""
        evidence = sum(one.evidence for one in last)
        if not self.confirmed:
            return self._first(whole)
        faded = not self.faint
        # Growing noise, as after stalls, lowers the expected evidence; but evidence that noise alone can reach is never
        # a pulse.
        noise = _LEAST_EVIDENCE * packets / _JUDGED_PACKETS
        expected = max(_FAINT * sum(one.expected for one in last), noise)
        self.faint = evidence <= min(_FAINT * self.usual * packets, expected)
        if not self.faint:
            self._accept(evidence / packets)
            return ""
        self._recent = last if faded else self._recent
        ended = waiting or sum(one.packets for one in self._recent) >= _FADED_PACKETS
        return FADED if ended else ""

    def _first(self, whole: bool) -> str:
        evidence, packets = (sum(one[k] for one in self._recent) for k in (0, 2))
        # A pass of one or two words has fewer packets than are judged together; require the same share of the evidence.
        least = _LEAST_EVIDENCE * min(packets / _JUDGED_PACKETS, 1.0)
        if min(self._score, evidence) + evidence >= least:
            self._accept(evidence / packets)
            return ""
        disturbed = self._score >= _LEAST_EVIDENCE and packets < _DISTURBED_PACKETS and not whole
        return "" if disturbed else NO_WORDS

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
