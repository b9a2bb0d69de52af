# SPDX-License-Identifier: Apache-2.0
"""What the words of a tool mean, by the names that kits use, and their units in SI: tool and surface agree here."""

from __future__ import annotations

import math
from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY


class Meaning(NamedTuple):
    """A measured quantity and its SI unit."""

    quantity: str
    unit: str


INCLINATION, AZIMUTH = "inclination", "magnetic_azimuth"
TOOLFACE, GRAVITY_TOOLFACE, MAGNETIC_TOOLFACE = "toolface", "gravity_toolface", "magnetic_toolface"
G_TOTAL, B_TOTAL, DIP, TEMPERATURE = "g_total", "b_total", "dip", "temperature"
SIGMA_INCLINATION, SIGMA_AZIMUTH = "sigma_inclination", "sigma_azimuth"
CONTINUOUS_INCLINATION, CONTINUOUS_AZIMUTH = "continuous_inclination", "continuous_azimuth"
LATERAL_RMS, AXIAL_RMS, LATERAL_PEAK, AXIAL_PEAK = "lateral_rms", "axial_rms", "lateral_peak", "axial_peak"
DOWNLINK = "downlink"

# By the name in lower case. Azimuths are from magnetic north: a tool knows no other.
MEANINGS = {
    "inc": Meaning(INCLINATION, "rad"),
    "azm": Meaning(AZIMUTH, "rad"),
    "dipa": Meaning(DIP, "rad"),
    "temp": Meaning(TEMPERATURE, "degC"),
    "grav": Meaning(G_TOTAL, "m/s^2"),
    "magf": Meaning(B_TOTAL, "T"),
    "sinc": Meaning(SIGMA_INCLINATION, "rad"),
    "sazm": Meaning(SIGMA_AZIMUTH, "rad"),
    "atfa": Meaning(TOOLFACE, "rad"),
    "gtfa": Meaning(GRAVITY_TOOLFACE, "rad"),
    "mtfa": Meaning(MAGNETIC_TOOLFACE, "rad"),
    "rinc": Meaning(CONTINUOUS_INCLINATION, "rad"),
    "razm": Meaning(CONTINUOUS_AZIMUTH, "rad"),
    "lrms": Meaning(LATERAL_RMS, "m/s^2"),
    "arms": Meaning(AXIAL_RMS, "m/s^2"),
    "lmxg": Meaning(LATERAL_PEAK, "m/s^2"),
    "amxg": Meaning(AXIAL_PEAK, "m/s^2"),
    "dlnk": Meaning(DOWNLINK, ""),
}
TOOLFACES = (TOOLFACE, GRAVITY_TOOLFACE, MAGNETIC_TOOLFACE)
_FACTORS = {"deg": math.pi / 180.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "uT": 1e-6, "nT": 1e-9}
_SI = {"deg": "rad", "g": "m/s^2", "mg": "m/s^2", "uT": "T", "nT": "T"}


def meaning_of(name: str) -> str:
    """Quantity that a word of this name carries; empty where the name is not known."""
    found = MEANINGS.get(name.lower())
    return "" if found is None else found.quantity


def factor(unit: str) -> float:
    """SI value of 1 in the unit of a word; 1 for a unit that people use as it is (degC, V, cps, s)."""
    return _FACTORS.get(unit, 1.0)


def si_unit(unit: str) -> str:
    """SI unit that `factor` leads to."""
    return _SI.get(unit, unit)
