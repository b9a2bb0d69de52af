# SPDX-License-Identifier: Apache-2.0
"""
The units of signals, once, with what each protocol makes of them.

A signal whose unit is not listed is refused when the signal table is read, so that no protocol can send a number in a
unit that nobody chose.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY

FOOT = 0.3048  # m
POUND_FORCE = 4.4482216152605  # N
GALLON = 3.785411784e-3  # m^3
_DEG = 180.0 / math.pi
_RPM = 30.0 / math.pi


class Scale(NamedTuple):
    """A unit of a protocol: its number is `factor` times the SI number plus `offset`."""

    symbol: str
    factor: float
    offset: float = 0.0

    def of(self, value: float) -> float:
        """The number in this unit, of one in SI."""
        return value * self.factor + self.offset


@dataclasses.dataclass(frozen=True)
class Unit:
    """
    What protocols make of one SI unit.

    Attributes
    ----------
    unece, name : str
        For OPC UA: UNECE common code (OPC 10000-8, section 5.6.3), and the unit in full.
    quantity : str
        Of the DDHub vocabulary.
    modbus, metric, fps : Scale
        Of a register, and of a WITS item in each unit system.
    """

    unece: str
    name: str
    quantity: str
    modbus: Scale
    metric: Scale
    fps: Scale


def _same(unece: str, name: str, quantity: str, scale: Scale) -> Unit:
    """A unit that all protocols but OPC UA convert alike."""
    return Unit(unece, name, quantity, scale, scale, scale)


UNITS: dict[str, Unit] = {
    "1": _same("C62", "one", "ProportionStandardQuantity", Scale("1", 1.0)),
    "rad": _same("C81", "radian", "PlaneAngleDrillingQuantity", Scale("deg", _DEG)),
    "rad/m": Unit(
        "C84",
        "radian per metre",
        "CurvatureDrillingQuantity",
        Scale("deg/30m", 30.0 * _DEG),
        Scale("deg/30m", 30.0 * _DEG),
        Scale("deg/100ft", 100.0 * FOOT * _DEG),
    ),
    "rad/s": _same("2A", "radian per second", "AngularVelocityDrillingQuantity", Scale("rpm", _RPM)),
    "m": Unit("MTR", "metre", "LengthStandardQuantity", Scale("m", 1.0), Scale("m", 1.0), Scale("ft", 1.0 / FOOT)),
    "m/s^2": _same(
        "MSK", "metre per second squared", "AccelerationDrillingQuantity", Scale("g", 1.0 / STANDARD_GRAVITY)
    ),
    "T": _same("D33", "tesla", "EarthMagneticFluxDensityQuantity", Scale("nT", 1e9)),
    "degC": Unit(
        "CEL",
        "degree Celsius",
        "TemperatureDrillingQuantity",
        Scale("degC", 1.0),
        Scale("degC", 1.0),
        Scale("degF", 1.8, 32.0),
    ),
    "s": _same("SEC", "second", "DurationDrillingQuantity", Scale("s", 1.0)),
    "N m": Unit(
        "NU",
        "newton metre",
        "TorqueDrillingQuantity",
        Scale("N m", 1.0),
        Scale("kN m", 1e-3),
        Scale("klbf ft", 1e-3 / (POUND_FORCE * FOOT)),
    ),
    "m^3/s": Unit(
        "MQS",
        "cubic metre per second",
        "VolumetricFlowrateDrillingQuantity",
        Scale("L/min", 60000.0),
        Scale("L/min", 60000.0),
        Scale("gal/min", 60.0 / GALLON),
    ),
}
