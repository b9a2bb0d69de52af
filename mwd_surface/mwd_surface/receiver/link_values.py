# SPDX-License-Identifier: Apache-2.0
"""Values of believed words in SI, by what they mean."""

from __future__ import annotations

import dataclasses

from mwd_sensors.telemetry import meanings
from mwd_surface.receiver.words import ReceivedWord


@dataclasses.dataclass(frozen=True)
class LinkValue:
    """Value and 1 sigma, SI, of a word; code; begin and end on air, s on the clock of the samples; odds of the code."""

    value: float
    sigma: float
    raw: int
    start_s: float
    end_s: float
    confidence: float = 1.0


def believed(words: list[ReceivedWord]) -> dict[str, LinkValue]:
    """Newest believed word of each meaning."""
    found = {}
    for word in words:
        quantity = meanings.meaning_of(word.name)
        if quantity and word.usable:
            found[quantity] = value_of(word)
    return found


def value_of(word: ReceivedWord) -> LinkValue:
    """Value of a word in SI."""
    factor = meanings.factor(word.unit)
    return LinkValue(word.value * factor, word.sigma * factor, word.raw, word.start_s, word.end_s, word.confidence)
