# SPDX-License-Identifier: Apache-2.0
"""
Scale of a pressure gauge: units of pressure, signals such as 4 to 20 mA, and the range that a column's name states.

A gauge sends a pressure, or a current or voltage that rises with the pressure over the range of the gauge. A current
below or above its range signals a failed gauge (NAMUR NE 43).
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array

#: Pressure at the upper end of a signal whose range is not known, such as 20 mA or the full scale of a WAV, Pa. It is
#: far above any rounding.
FULL_SCALE_PA = 1.0e7
_UNITS = {
    "pa": 1.0,
    "kpa": 1e3,
    "mpa": 1e6,
    "mbar": 100.0,
    "bar": 1e5,
    "bars": 1e5,
    "psi": 6894.757293168,
    "ksi": 6_894_757.293168,
    "hpa": 100.0,
    "atm": 101_325.0,
    "at": 98_066.5,
    "kgcm": 98_066.5,
    "kgfcm": 98_066.5,
}
_SIGNALS = {"v": 1.0, "mv": 1e-3, "ma": 1e-3}  # units of signals of a gauge, V or A
# A unit may end with g (gauge) or a (absolute): a decoder uses changes of the pressure only.
PRESSURES = {**{unit + end: factor for unit, factor in _UNITS.items() for end in ("", "g", "a")}, **_SIGNALS}
#: Units to name to a user.
UNITS = (*_UNITS, *_SIGNALS)

_NUMBER = r"(?<![\w,])(?<!\d\.)[+-]?\d+(?:,\d{3}(?!\d))*(?:[.,]\d+)?"
# A range such as "0-350 bar" or "0 bar to 350 bar", or only its upper end, "350 bar": two numbers and a unit.
_RANGE = re.compile(
    rf"(?:({_NUMBER})\s*[a-z]*\s*(?:-|\u2013|\u2026|\.{{2,3}}|~|\bto\b|\bbis\b)\s*)?"
    rf"({_NUMBER})\s*([a-z][a-z0-9/²]*)",
    re.IGNORECASE,
)
_CURRENT = re.compile(r"\b4\s*(?:-|\u2013|to)\s*20\b|\bmA\b")


class GaugeSignal(NamedTuple):
    """
    Scale of a gauge that sends a current or a voltage.

    low, high: ends of its range in `unit`, "ma", "mv" or "v"; low_pa, high_pa: pressures at these ends, Pa, NaN if
    unknown.
    """

    low: float = 4.0
    high: float = 20.0
    unit: str = "ma"
    low_pa: float = math.nan
    high_pa: float = math.nan

    @property
    def limits(self) -> tuple[float, float]:
        """
        Signals outside of which the gauge has failed: 3.6 and 21 mA for 4 to 20 mA (NAMUR NE 43).

        A range that begins at 0 has no lowest signal.
        """
        return (3.6 / 4.0 * self.low if self.low > 0.0 else -math.inf), 21.0 / 20.0 * self.high

    def failed(self, values: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where signals mean a broken wire (too low), and where they mean a failed gauge (too high)."""
        low, high = self.limits
        return values < low, values > high

    def pressure(self, values: Array) -> Array:
        """Return the pressures, Pa, of signals in `unit`; NaN where the gauge has failed."""
        broken, above = self.failed(values)
        share = (values - self.low) / (self.high - self.low)
        return np.where(broken | above, math.nan, self.low_pa + share * (self.high_pa - self.low_pa))


def gauge_signal(name: str) -> GaugeSignal | None:
    """
    Return the scale that the name of a column states, such as "SPP 4-20 mA (0-350 bar)".

    Return None if the name states neither a range of a current or voltage nor "mA".
    """
    name = name.replace("_", " ")
    signal = GaugeSignal() if _CURRENT.search(name) else None
    low_pa = high_pa = math.nan
    for first, last, text in _RANGE.findall(name):
        low, high, unit = _number(first or "0"), _number(last), "".join(filter(str.isalpha, text.lower()))
        if low < high and unit in _SIGNALS and first:
            signal = GaugeSignal(low, high, unit)
        elif low < high and unit in PRESSURES and unit not in _SIGNALS:
            low_pa, high_pa = low * PRESSURES[unit], high * PRESSURES[unit]
    return None if signal is None else signal._replace(low_pa=low_pa, high_pa=high_pa)


def in_pascal(values: Array, unit: str, name: str = "") -> tuple[Array, list[str]]:
    """
    Convert numbers in a unit of `PRESSURES` to pressures, Pa, NaN where there is no pressure; also return notes.

    A current or a voltage is scaled by the range of the gauge that the name states (`gauge_signal`). Without a range, a
    current is scaled to `FULL_SCALE_PA`, and a voltage is returned in V instead of Pa.
    """
    signal = gauge_signal(name)
    if signal is None or signal.unit != unit:
        signal = GaugeSignal(unit=unit)
    if unit == "ma" or math.isfinite(signal.low_pa):
        return _of_signal(values, signal)
    with np.errstate(over="ignore"):
        pressure = values * PRESSURES[unit]
    return np.where(np.isfinite(pressure), pressure, math.nan), []


def _number(text: str) -> float:
    return float(re.sub(r",(?=\d{3}(?!\d))", "", text).replace(",", "."))


def _of_signal(values: Array, signal: GaugeSignal) -> tuple[Array, list[str]]:
    """Return the pressures, Pa, of signals, and notes on the scale and on failures of the gauge."""
    unit = {"v": "V", "mv": "mV", "ma": "mA"}[signal.unit]
    said = f"a signal of {signal.low:g} to {signal.high:g} {unit}"
    if math.isnan(signal.low_pa):
        signal = signal._replace(low_pa=0.0, high_pa=FULL_SCALE_PA)
        note = (
            f"{said}: the range of the gauge is not known, {FULL_SCALE_PA / 1e5:g} bar is assumed at {signal.high:g}"
            f' {unit}; write the range into the name of the column, such as "SPP 4-20 mA (0-350 bar)"'
        )
    else:
        note = f"{said} is read as {signal.low_pa / 1e5:.6g} to {signal.high_pa / 1e5:.6g} bar, as the column is named"
    notes = [note]
    (broken, above), (low, high) = signal.failed(values), signal.limits
    for failed, limit, cause in (
        (broken, f"below {low:.3g} {unit}", "a broken wire"),
        (above, f"above {high:.3g} {unit}", "a failed gauge"),
    ):
        if failed.any():
            notes.append(f"{int(failed.sum())} samples are {limit}, which means {cause}, and count as missing")
    return signal.pressure(values), notes
