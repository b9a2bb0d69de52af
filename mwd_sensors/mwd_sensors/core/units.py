# SPDX-License-Identifier: Apache-2.0
"""Units of sensor readings: factors to SI, and a check for readings that are not in SI."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.constants import STANDARD_GRAVITY

LPM = 1e-3 / 60.0  #: one litre per minute, m^3/s
RPM = math.pi / 30.0  #: one revolution per minute, rad/s
# Quantity -> unit -> factor to the SI unit. The SI unit is the first unit of each quantity.
FACTORS: dict[str, dict[str, float]] = {
    "acceleration": {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    "field": {"T": 1.0, "mT": 1e-3, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7},
}
# Quantity -> (unit, lowest and highest plausible median magnitude, as numbers in this unit). Vibration can raise the
# specific force to several times gravity but never halve its median; external interference can treble the magnetic
# field.
_RANGES = {
    "acceleration": (("g", 0.3, 5.0), ("mg", 400.0, 5e3), ("m/s2", 5.0, 400.0)),
    "rate": (("deg/s", 60.0, 1e4), ("rad/s", 0.0, 60.0)),
    "field": (("T", 5e-6, 5e-4), ("G", 0.1, 1.5), ("uT", 10.0, 150.0), ("mG", 150.0, 1500.0), ("nT", 1e4, 5e5)),
}
_WORDS = {"acceleration": "specific force", "rate": "angular rate", "field": "magnetic field"}


def factor(quantity: str, unit: str) -> float:
    """
    Return the factor that converts readings to SI.

    Raises
    ------
    ValueError
        The quantity or unit does not exist; the message lists the units that do.
    """
    if quantity not in FACTORS:
        raise ValueError(f"quantity: {quantity!r} is not one of {', '.join(FACTORS)}")
    if unit not in FACTORS[quantity]:
        raise ValueError(f"unit of {_WORDS[quantity]}: {unit!r} is not one of {', '.join(FACTORS[quantity])}")
    return FACTORS[quantity][unit]


def doubt(quantity: str, readings: ArrayLike) -> tuple[str, str] | None:
    """
    Return the problem of readings that are declared as SI but seem to be in another unit, and that unit.

    readings, shape (n, 3), are declared as m/s^2, rad/s or T; rows that are not finite are ignored. Returns None if
    their median magnitude is plausible or no row is finite. Otherwise returns a sentence and the unit in which the
    magnitude would be plausible; the unit is an empty text if the magnitude is plausible in no unit.
    """
    values = np.asarray(readings, dtype=float)
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return None
    with np.errstate(over="ignore"):
        median = float(np.median(np.sqrt((values * values).sum(axis=1))))
    si = next(iter(FACTORS[quantity]))
    for unit, low, high in _RANGES[quantity]:
        if low <= median <= high:
            if unit == si:
                return None
            return f"a {_WORDS[quantity]} of {median:.4g} {si} is not plausible: it looks like {unit}", unit
    return f"a {_WORDS[quantity]} of {median:.4g} {si} is not plausible in any unit", ""
