# SPDX-License-Identifier: Apache-2.0
"""Quantities that the words of MWD kits measure, by the names of the words, with SI units, for tool and surface."""

from __future__ import annotations

import math
from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY


class WordMeaning(NamedTuple):
    """Quantity that a word measures, and its SI unit."""

    quantity: str
    unit: str


INCLINATION, AZIMUTH = "inclination", "magnetic_azimuth"
TOOLFACE, GRAVITY_TOOLFACE, MAGNETIC_TOOLFACE = "toolface", "gravity_toolface", "magnetic_toolface"
G_TOTAL, B_TOTAL, DIP, TEMPERATURE = "g_total", "b_total", "dip", "temperature"
SIGMA_INCLINATION, SIGMA_AZIMUTH = "sigma_inclination", "sigma_azimuth"
CONTINUOUS_INCLINATION, CONTINUOUS_AZIMUTH = "continuous_inclination", "continuous_azimuth"
LATERAL_RMS, AXIAL_RMS, LATERAL_PEAK, AXIAL_PEAK = "lateral_rms", "axial_rms", "lateral_peak", "axial_peak"
DOWNLINK = "downlink"

# Key: name of a word in lower case. Azimuths are relative to magnetic north, because a tool has no declination.
MEANINGS = {
    "inc": WordMeaning(INCLINATION, "rad"),
    "azm": WordMeaning(AZIMUTH, "rad"),
    "dipa": WordMeaning(DIP, "rad"),
    "temp": WordMeaning(TEMPERATURE, "degC"),
    "grav": WordMeaning(G_TOTAL, "m/s^2"),
    "magf": WordMeaning(B_TOTAL, "T"),
    "sinc": WordMeaning(SIGMA_INCLINATION, "rad"),
    "sazm": WordMeaning(SIGMA_AZIMUTH, "rad"),
    "atfa": WordMeaning(TOOLFACE, "rad"),
    "gtfa": WordMeaning(GRAVITY_TOOLFACE, "rad"),
    "mtfa": WordMeaning(MAGNETIC_TOOLFACE, "rad"),
    "rinc": WordMeaning(CONTINUOUS_INCLINATION, "rad"),
    "razm": WordMeaning(CONTINUOUS_AZIMUTH, "rad"),
    "lrms": WordMeaning(LATERAL_RMS, "m/s^2"),
    "arms": WordMeaning(AXIAL_RMS, "m/s^2"),
    "lmxg": WordMeaning(LATERAL_PEAK, "m/s^2"),
    "amxg": WordMeaning(AXIAL_PEAK, "m/s^2"),
    "dlnk": WordMeaning(DOWNLINK, ""),
}
TOOLFACES = (TOOLFACE, GRAVITY_TOOLFACE, MAGNETIC_TOOLFACE)
# Units of words with a meaning -> (SI unit, SI value of 1 in the unit). Other units (V, cps, s) are used unchanged.
_UNITS = {
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "m/s^2": ("m/s^2", 1.0),
    "g": ("m/s^2", STANDARD_GRAVITY),
    "mg": ("m/s^2", 1e-3 * STANDARD_GRAVITY),
    "T": ("T", 1.0),
    "mT": ("T", 1e-3),
    "uT": ("T", 1e-6),
    "nT": ("T", 1e-9),
    "G": ("T", 1e-4),
    "mG": ("T", 1e-7),
    "degC": ("degC", 1.0),
    "rpm": ("rad/s", math.pi / 30.0),
    "mV": ("V", 1e-3),
    "mA": ("A", 1e-3),
    "Ah": ("C", 3600.0),
    "h": ("s", 3600.0),
    "": ("", 1.0),
}


def meaning_of(name: str) -> str:
    """Return the quantity of a word with this name, or an empty text if the name is not known."""
    found = MEANINGS.get(name.lower())
    return "" if found is None else found.quantity


def factor(unit: str) -> float:
    """Return the SI value of 1 in the unit of a word; 1 for a unit that is used unchanged (degC, V, cps, s)."""
    return _UNITS.get(unit, ("", 1.0))[1]


def si_unit(unit: str) -> str:
    """Return the SI unit to which `factor` converts values of this unit."""
    return _UNITS.get(unit, (unit, 1.0))[0]


def check_unit(name: str, unit: str) -> None:
    """Raise ValueError for a unit that does not fit the word with this name; the message lists the units that fit."""
    found = MEANINGS.get(name.lower())
    fitting = [one for one, (si, _) in _UNITS.items() if found is not None and si == found.unit]
    if found is not None and unit not in fitting:
        raise ValueError(f"unit: {unit!r} of {name} is not one of {', '.join(fitting) or 'none'}")
