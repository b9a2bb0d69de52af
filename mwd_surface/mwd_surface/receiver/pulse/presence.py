# SPDX-License-Identifier: Apache-2.0
"""Whether a transmission is there: by the evidence for pulses of its last stretches."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

# Log likelihood ratio that a sync and the words behind it have at least: noise has it with a probability below
# exp(-18) at each of ten thousand places an hour. Pumps that start can look like a sync, but not like words behind it.
_LEAST_EVIDENCE = 18.0
# Packets by which it is judged whether there are pulses: those of some 30 bits. Behind a clear sync the first may be
# disturbed, and a tool that faded sends on: it is given up once so many packets had none, or a new sync was found.
_JUDGED_PACKETS, _DISTURBED_PACKETS, _FADED_PACKETS = 10, 25, 60
# Share of the evidence that pulses would have below which stretches hold none, or those of a tool that began anew.
_FAINT = 0.3
NO_WORDS = "no words behind the sync: it was noise, or the sequence is another one"
FADED = "no pulses any more: flow off, too weak, or the tool began anew"


class Evidence(NamedTuple):
    """
    Log likelihood ratio of the pulses of a stretch to none; its packets and words.

    expected: what the ratio is in the mean, if there are pulses as before, in the noise that is there now.
    """

    evidence: float
    expected: float
    packets: int
    words: int


class Presence:
    """
    What the stretches of one transmission say of it.

    Parameters
    ----------
    score : float
        Of its sync.
    """

    def __init__(self, score: float) -> None:
        self._score = score
        self._usual: deque[float] = deque(maxlen=24)
        self._recent: list[Evidence] = []
        self.faint = False

    @property
    def confirmed(self) -> bool:
        """Whether there were words behind the sync."""
        return bool(self._usual)

    @property
    def usual(self) -> float:
        """Usual evidence of a packet."""
        return float(np.median(self._usual)) if self._usual else 0.0

    @property
    def faint_words(self) -> int:
        """Words before the last stretch that had no pulses, as it shows only now."""
        return sum(one.words for one in self._recent[:-1])

    def judge(self, stretch: Evidence, whole: bool, waiting: bool) -> str:
        """
        Take a stretch; the reason why the transmission has ended, empty: it has not.

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
        # Noise that grows, as behind stalls, leaves less to expect; what noise alone may have is no pulse even so.
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
        # A pass of one or two words has fewer packets than are judged together, and their share of the evidence.
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
        """Last stretches with the packets that are judged together."""
        packets = 0
        for k in range(len(self._recent) - 1, -1, -1):
            packets += self._recent[k].packets
            if packets >= _JUDGED_PACKETS:
                return self._recent[k:]
        return self._recent
