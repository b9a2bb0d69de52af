# SPDX-License-Identifier: Apache-2.0
"""
Words: convert a measured value to an integer of some bits and back, with the sigma that rounding adds.

A word that wraps (a direction) has 2^bits steps around the circle. Any other word reaches both ends of its range with
2^bits - 1 steps. The value of a code is the middle of its step, so the rounding error is step / sqrt(12) (uniform). If
the highest code means that the tool has no measurement, there is one step less.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.settings import setting

MAX_BITS = 24


@dataclasses.dataclass(frozen=True)
class Word:
    """Coding of one measured value as a word; low, high and sigma are in the word's unit, as users write them."""

    bits: int = setting(0, "Number of bits of the word; 0 if the sequences state it (NAME:BITS).", low=0, high=MAX_BITS)
    low: float = setting(0.0, "Value that the code 0 stands for.")
    high: float = setting(
        1.0,
        "Value that the highest code stands for; for a word that wraps, the value that equals low, such as 360 deg.",
    )
    unit: str = setting("", "Unit of low and high.")
    wraps: bool | None = setting(
        None,
        "Whether the value wraps: low and high are then the same direction, such as 0 and 360 deg. By default it wraps "
        "if its unit is deg and high is 360 above low.",
    )
    logarithmic: bool = setting(False, "Whether steps are equal ratios instead of equal differences (used for sigmas).")
    sigma: float = setting(
        0.0,
        "1 sigma of the tool's own measurement, in the unit of the word. It is added to the rounding error; 0 if "
        "unknown.",
        low=0.0,
    )
    reserved: bool = setting(
        False, "Whether the highest code means that the tool has no measurement; `missing_code` sets it for all words."
    )

    def __post_init__(self) -> None:
        """
        Check the range.

        Raises ValueError if `high` is not above `low`, `low` of a logarithmic word is not above 0, or the word has a
        single bit.
        """
        if not self.high > self.low:
            raise ValueError(f"high: must be above low ({self.low:g}), got {self.high:g}")
        if self.logarithmic and not self.low > 0.0:
            raise ValueError(f"low: must be above 0 for a logarithmic word, got {self.low:g}")
        if self.bits == 1:
            raise ValueError("bits: no pulse code can send a single bit; use 2 or more")

    @property
    def circular(self) -> bool:
        """Whether the value is a direction, which wraps."""
        return self.unit == "deg" and self.high - self.low == 360.0 if self.wraps is None else self.wraps

    def missing(self, bits: int = 0) -> int | None:
        """Return the code that means "no measurement"; None if the word has no such code. `bits` as in `sigma_of`."""
        return (1 << (bits or self.bits)) - 1 if self.reserved else None

    def codes(self, bits: int = 0) -> int:
        """Return the number of codes that represent values; `bits` as in `sigma_of`."""
        return (1 << (bits or self.bits)) - self.reserved

    def step(self, bits: int = 0) -> float:
        """
        Return the distance between neighbouring codes, in the unit of the word; bits = 0 uses the word's own length.

        For a logarithmic word the result is the largest distance, at the upper end.
        """
        count = self.codes(bits)
        if self.logarithmic:
            return float(self.high - self.low * (self.high / self.low) ** ((count - 2) / (count - 1)))
        return (self.high - self.low) / (count if self.circular else count - 1)

    def code(self, value: float, bits: int = 0) -> int:
        """
        Return the nearest code of a value; `bits` as in `sigma_of`.

        A value outside the range gets the code of the nearer end; the value of a circular word wraps instead.

        Raises
        ------
        ValueError
            The value is not finite.
        """
        if not math.isfinite(value):
            raise ValueError(f"value: must be a finite number, got {value!r}")
        count = self.codes(bits)
        if self.logarithmic:
            part = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
            return min(math.floor(part * (count - 1) + 0.5), count - 1)
        nearest = math.floor((value - self.low) / self.step(bits) + 0.5)
        return nearest % count if self.circular else min(max(nearest, 0), count - 1)

    def value(self, code: int, bits: int = 0) -> float:
        """
        Return the value of a code, in the unit of the word; NaN for the code that means "no measurement".

        Raises
        ------
        ValueError
            The code does not fit into the bits.
        """
        count = self.codes(bits)
        if not 0 <= code < 1 << (bits or self.bits):
            raise ValueError(f"code: {code} does not fit {bits or self.bits} bits")
        if code == self.missing(bits):
            return math.nan
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** (code / (count - 1)))
        return self.low + code * self.step(bits)

    def sigma_of(self, bits: int = 0) -> float:
        """
        Return 1 sigma of a correctly received word, in the unit of the word: sqrt(sensor^2 + step^2 / 12).

        bits: number of bits of the word; 0 uses `Word.bits`.
        """
        return math.sqrt(self.sigma**2 + self.step(bits) ** 2 / 12.0)


# Words that kits commonly send, by the names in their configurations; `words` of a tool configuration replaces them.
COMMON = {
    "Inc": Word(12, 0.0, 180.0, "deg"),
    "Azm": Word(12, 0.0, 360.0, "deg"),
    "DipA": Word(12, -90.0, 90.0, "deg"),
    "Grav": Word(12, 0.0, 2.0, "g"),
    "MagF": Word(12, 0.0, 100.0, "uT"),
    "Temp": Word(8, -25.0, 230.0, "degC"),
    "BatV": Word(8, 0.0, 51.0, "V"),
    "Gama": Word(8, 0.0, 510.0, "cps"),
    "aTFA": Word(6, 0.0, 360.0, "deg"),
    "gTFA": Word(6, 0.0, 360.0, "deg"),
    "mTFA": Word(6, 0.0, 360.0, "deg"),
    "RINC": Word(11, 0.0, 180.0, "deg"),
    "RAZM": Word(11, 0.0, 360.0, "deg"),
    "LRMS": Word(11, 0.0, 204.7, "g"),
    "ARMS": Word(11, 0.0, 204.7, "g"),
    "LMxG": Word(11, 0.0, 2047.0, "g"),
    "AMxG": Word(11, 0.0, 2047.0, "g"),
    # Words of this project's own tool: the sigmas of its survey.
    "sInc": Word(4, 0.01, 10.0, "deg", logarithmic=True),
    "sAzm": Word(4, 0.01, 180.0, "deg", logarithmic=True),
    # Last command received by downlink: counter, command and argument.
    "DLnk": Word(10, 0.0, 1023.0, ""),
}
