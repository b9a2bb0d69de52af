# SPDX-License-Identifier: Apache-2.0
"""
Consistency between surveys: repeated words are combined, and erased words are decided by earlier surveys.

A tool that sends a survey again sends the same codes, so the probabilities of both receptions are multiplied, unless
the tool has rested long enough to take a new survey, which in a straight hole may differ in a single word. Gravity,
field and dip hardly change from station to station, inclination and azimuth change by some degrees; this acts like an
additional error-correcting code. A word decided this way is marked and not reported as believed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import SURVEY_LEVEL
from mwd_surface.receiver.words import BELIEVED, BY_CONSISTENCY, ERASED, ReceivedWord

# 1 sigma of the change from one survey to the next, SI (degC, V): noise and position for the first three, one stand of
# curved hole for the angles.
_CHANGE = {
    "Grav": 0.002 * STANDARD_GRAVITY,
    "MagF": 0.5e-6,
    "DipA": math.radians(0.4),
    "Inc": math.radians(3.0),
    "Azm": math.radians(6.0),
    "Temp": 5.0,
    "BatV": 1.0,
}
# Gravity before the first survey: 0.9976 to 1.0027 g on earth (normal gravity, WGS 84).
_AT_FIRST = {"Grav": (STANDARD_GRAVITY, 0.004 * STANDARD_GRAVITY)}
# Probability that a word is unrelated to the previous survey: disturbed field, new well, or failed tool.
_FREE = 0.05
# Log odds above which two receptions count as one survey sent twice.
_LEAST_ODDS = math.log(20.0)
_LONG_BITS = 10  # smallest number of bits of a long word
# Probability that a word has the same code in two different surveys: for a long word, and for a short word, which
# changes slowly.
_ALIKE_LONG, _ALIKE_SHORT = 0.2, 0.7
_SLIP = 1e-4  # likelihood of receptions that no listed code explains
_EULER = 0.5772  # Euler's constant: the sum of 1/d up to n, minus log(n)


@dataclasses.dataclass(frozen=True)
class _Codes:
    """Probabilities of the codes of a word: some are listed, the remainder is spread evenly over all others."""

    listed: dict[int, float]
    count: int

    @property
    def rest(self) -> float:
        """Probability of each code that is not listed."""
        left = max(1.0 - sum(self.listed.values()), 0.0)
        return left / max(self.count - len(self.listed), 1)

    def of(self, code: int) -> float:
        """Return the probability of a code."""
        return self.listed.get(code, self.rest)

    def times(self, other: _Codes) -> tuple[_Codes, float]:
        """Combine two independent receptions; return the posterior and the probability that both have the same code."""
        codes = {**self.listed, **other.listed}
        both = {code: self.of(code) * other.of(code) for code in codes}
        total = sum(both.values()) + self.rest * other.rest * max(self.count - len(both), 0)
        return _Codes({code: p / max(total, 1e-300) for code, p in both.items()}, self.count), total

    def sent_again(self, other: _Codes, alike: float) -> float:
        """
        Compare two explanations of a word in two surveys: one code was sent twice, or the surveys are unrelated.

        Returns the likelihood ratio of the first explanation to the second. A share `alike` of different surveys has
        equal codes. The others differ by a number of steps whose logarithm is uniform, because not even the size of the
        change is known. A word with no information gives a ratio of 1.
        """
        same = self.count * self.times(other)[1]
        scale = self.count / (2.0 * (math.log(self.count / 2.0) + _EULER))
        pairs = [(a, b, p * q) for a, p in self.listed.items() for b, q in other.listed.items()]
        near = sum(p * scale / min(abs(a - b), self.count - abs(a - b)) for a, b, p in pairs if a != b)
        apart = near + 1.0 - sum(p for _, _, p in pairs)
        return (same + _SLIP) / (alike * same + (1.0 - alike) * apart + _SLIP)


class SurveyMemory:
    """
    Earlier surveys, by which erased words of the next survey are decided.

    Parameters
    ----------
    rested : callable
        Returns whether the pumps were off long enough for a survey between two times, s.
    """

    def __init__(self, tool: ToolConfiguration, rested: Callable[[float, float], bool]) -> None:
        self._tool, self._rested = tool, rested
        self._last_s = -math.inf
        self._last: dict[str, _Codes] = {}
        self._values: dict[str, float] = {}

    def settle(self, words: list[ReceivedWord]) -> list[ReceivedWord]:
        """
        Return the final words of one pass of a sequence; words of a toolface sequence are returned unchanged.

        Repeated words, within the survey or from the previous survey, get the combined posterior of all receptions. A
        word that is still erased is decided where earlier surveys make one of its codes probable enough.
        """
        if not words or words[0].kind != "survey":
            return words
        bits = self._bits(words)
        codes: dict[str, _Codes] = {}
        for word in words:
            one = _codes_of(word, bits[word.index])
            known = codes.get(word.name)
            codes[word.name] = one if known is None or known.count != one.count else known.times(one)[0]
        if not self._rested(self._last_s, words[0].start_s) and self._sent_again(codes):
            codes = {
                name: one.times(self._last[name])[0] if self._comparable(name, one) else one
                for name, one in codes.items()
            }
        settled = [self._chosen(self._shown(word, codes[word.name], bits[word.index])) for word in words]
        self._last, self._last_s = codes, words[0].start_s
        for word in settled:
            if word.status == BELIEVED:
                self._values[word.name] = word.value
        return settled

    def _bits(self, words: list[ReceivedWord]) -> dict[int, int]:
        """Return the number of bits of each word, by its index in the sequence."""
        for items in self._tool.surveys:
            if all(word.index < len(items) and items[word.index].name == word.name for word in words):
                return {word.index: items[word.index].bits for word in words}
        return {word.index: self._tool.table[word.name].bits for word in words}

    def _comparable(self, name: str, one: _Codes) -> bool:
        return name in self._last and self._last[name].count == one.count

    def _sent_again(self, codes: dict[str, _Codes]) -> bool:
        """Return whether the last survey was sent again; a new survey would have other codes."""
        odds = 0.0
        for name, one in codes.items():
            if self._comparable(name, one):
                alike = _ALIKE_LONG if one.count >= 1 << _LONG_BITS else _ALIKE_SHORT
                odds += math.log(one.sent_again(self._last[name], alike))
        return odds > _LEAST_ODDS

    def _shown(self, word: ReceivedWord, codes: _Codes, bits: int) -> ReceivedWord:
        """Return the word with the combined probabilities of all its receptions."""
        rows = sorted(codes.listed.items(), key=lambda row: (-row[1], row[0]))
        code, confidence = rows[0]
        table = self._tool.table[word.name]
        known = confidence >= SURVEY_LEVEL and code != table.missing(bits)
        return dataclasses.replace(
            word,
            raw=code,
            value=table.value(code, bits),
            confidence=confidence,
            status=BELIEVED if known else ERASED,
            alternatives=tuple(rows[1:4]),
        )

    def _chosen(self, word: ReceivedWord) -> ReceivedWord:
        """Return an erased word decided by consistency with earlier surveys, or else the word unchanged."""
        expected = self._expected(word.name)
        if word.status != ERASED or expected is None:
            return word
        table = self._tool.table[word.name]
        bits = self._bits([word])[word.index]
        codes = _codes_of(word, bits)
        middle, sigma = expected
        free = _FREE / codes.count
        step = table.step(bits)

        def prior(code: int) -> float:
            if code == table.missing(bits):
                return free
            off = table.value(code, bits) - middle
            if table.circular:
                off = math.remainder(off, table.high - table.low)
            density = math.exp(-0.5 * (off / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
            return (1.0 - _FREE) * density * step + free

        weights = {code: p * prior(code) for code, p in codes.listed.items()}
        # The unlisted codes each have the probability `rest`, and their priors add up to at most one.
        total = sum(weights.values()) + codes.rest
        code = max(weights, key=lambda one: (weights[one], -one))
        if weights[code] < SURVEY_LEVEL * total or code == table.missing(bits):
            return word
        others = tuple((other, p) for other, p in codes.listed.items() if other != code)
        return dataclasses.replace(
            word,
            raw=code,
            value=table.value(code, bits),
            confidence=weights[code] / total,
            status=BY_CONSISTENCY,
            alternatives=others[:3],
        )

    def _expected(self, name: str) -> tuple[float, float] | None:
        """Return the value expected from earlier surveys and its sigma, in the unit of the word; None if unknown."""
        if name not in _CHANGE:
            return None
        factor = meanings.factor(self._tool.table[name].unit)
        if name in self._values:
            return self._values[name], _CHANGE[name] / factor
        if name not in _AT_FIRST:
            return None
        middle, sigma = _AT_FIRST[name]
        return middle / factor, sigma / factor


def _codes_of(word: ReceivedWord, bits: int) -> _Codes:
    return _Codes({word.raw: word.confidence, **dict(word.alternatives)}, 1 << bits)
