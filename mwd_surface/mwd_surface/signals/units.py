# SPDX-License-Identifier: Apache-2.0
"""
Units of signals, with their conversions for each protocol.

A signal with a unit that is not in `UNITS` is refused when the signal table is read, so that no protocol can send a
number in a wrong unit.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from mwd_sensors.core.constants import STANDARD_GRAVITY

FOOT = 0.3048  # m
POUND_FORCE = 4.4482216152605  # N
GALLON = 3.785411784e-3  # m^3
METRIC, FIELD = "metric", "field"  # systems of display units of a well
PSI = 6894.757293168  # Pa
_DEG = 180.0 / math.pi
_RPM = 30.0 / math.pi


class UnitScale(NamedTuple):
    """Unit of a protocol or file: the number in this unit is `factor` times the SI number plus `offset`."""

    symbol: str
    factor: float
    offset: float = 0.0

    def of(self, value: float) -> float:
        """Return the number in this unit for an SI value."""
        return value * self.factor + self.offset

    def si(self, number: float) -> float:
        """Return the SI value of a number in this unit."""
        return (number - self.offset) / self.factor


DEG_PER_H = UnitScale("deg/h", 3600.0 * _DEG)


@dataclasses.dataclass(frozen=True)
class UnitConversions:
    """Conversions of one SI unit for protocols and files."""

    #: `unece`, `name`: for OPC UA: UNECE common code (OPC 10000-8, section 5.6.3), and full name of the unit.
    unece: str
    name: str
    quantity: str  #: quantity in the DDHub vocabulary
    people: UnitScale  #: metric unit in files and on paper
    #: `modbus`, `metric`, `fps`: unit of a Modbus register, and of a WITS item in each unit system.
    modbus: UnitScale
    metric: UnitScale
    fps: UnitScale
    witsml: str = ""  #: WITSML symbol of `people`; empty if the exported WITSML has no element with this unit
    #: Ends of a column's name in metric and in field units; empty if the unit is the same in both. In field units files
    #: and paper have the unit `fps`.
    endings: tuple[str, str] = ("", "")
    field_witsml: str = ""  #: WITSML symbol in field units

    def shown_in(self, system: str) -> UnitScale:
        """Return the unit of files and printed reports for a well; system: `METRIC` or `FIELD`."""
        return self.fps if system == FIELD and self.endings[1] else self.people

    def key_in(self, key: str, system: str) -> str:
        """Return the name of a column for a system of units; key: name of the column in metric units."""
        metric, field = self.endings
        return key.removesuffix(metric) + field if system == FIELD else key

    def witsml_in(self, system: str) -> str:
        """Return the WITSML symbol of the unit of files for a well; system: `METRIC` or `FIELD`."""
        return self.field_witsml or self.witsml if system == FIELD else self.witsml


def _unit(
    unece: str,
    name: str,
    quantity: str,
    people: UnitScale,
    *,
    register: UnitScale | None = None,
    item: UnitScale | None = None,
    fps: UnitScale | None = None,
    **more: Any,
) -> UnitConversions:
    """
    Return the conversions of a unit.

    The unit of a Modbus register is `people` unless `register` names another. The metric unit
    of a WITS item is the unit of the register unless `item` is given; the fps unit is the metric one unless `fps` is
    given.
    """
    modbus = register or people
    metric = item or modbus
    return UnitConversions(unece, name, quantity, people, modbus, metric, fps or metric, **more)


UNITS: dict[str, UnitConversions] = {
    "1": _unit("C62", "one", "ProportionStandardQuantity", UnitScale("1", 1.0)),
    "rad": _unit("C81", "radian", "PlaneAngleDrillingQuantity", UnitScale("deg", _DEG), witsml="dega"),
    "rad/m": _unit(
        "C84",
        "radian per metre",
        "CurvatureDrillingQuantity",
        UnitScale("deg/30 m", 30.0 * _DEG),
        register=UnitScale("deg/30m", 30.0 * _DEG),
        fps=UnitScale("deg/100ft", 100.0 * FOOT * _DEG),
        witsml="dega/30m",
        endings=("deg_per_30m", "deg_per_100ft"),
        field_witsml="dega/100ft",
    ),
    "rad/s": _unit("2A", "radian per second", "AngularVelocityDrillingQuantity", UnitScale("rpm", _RPM)),
    "m": _unit(
        "MTR",
        "metre",
        "LengthStandardQuantity",
        UnitScale("m", 1.0),
        fps=UnitScale("ft", 1.0 / FOOT),
        witsml="m",
        endings=("_m", "_ft"),
        field_witsml="ft",
    ),
    "m/s": _unit(
        "MTS",
        "metre per second",
        "RateOfPenetrationDrillingQuantity",
        UnitScale("m/h", 3600.0),
        fps=UnitScale("ft/h", 3600.0 / FOOT),
        endings=("_mph", "_ftph"),
    ),
    "m/s^2": _unit(
        "MSK",
        "metre per second squared",
        "AccelerationDrillingQuantity",
        UnitScale("m/s^2", 1.0),
        register=UnitScale("g", 1.0 / STANDARD_GRAVITY),
    ),
    "T": _unit("D33", "tesla", "EarthMagneticFluxDensityQuantity", UnitScale("nT", 1e9)),
    "degC": _unit(
        "CEL",
        "degree Celsius",
        "TemperatureDrillingQuantity",
        UnitScale("degC", 1.0),
        fps=UnitScale("degF", 1.8, 32.0),
        endings=("_degc", "_degf"),
    ),
    # API units are relative to a calibration pit, and UNECE has no code for them; C62 is the code of the unit one.
    "gAPI": _unit("C62", "API unit of natural gamma", "ProportionStandardQuantity", UnitScale("gAPI", 1.0)),
    "s": _unit("SEC", "second", "DurationDrillingQuantity", UnitScale("s", 1.0)),
    "N": _unit(
        "NEW",
        "newton",
        "ForceDrillingQuantity",
        UnitScale("kN", 1e-3),
        item=UnitScale("kdaN", 1e-4),
        fps=UnitScale("klbf", 1e-3 / POUND_FORCE),
        endings=("_kn", "_klbf"),
    ),
    "N m": _unit(
        "NU",
        "newton metre",
        "TorqueDrillingQuantity",
        UnitScale("kN m", 1e-3),
        register=UnitScale("N m", 1.0),
        item=UnitScale("kN m", 1e-3),
        fps=UnitScale("klbf ft", 1e-3 / (POUND_FORCE * FOOT)),
    ),
    "Pa": _unit("PAL", "pascal", "PressureDrillingQuantity", UnitScale("kPa", 1e-3), fps=UnitScale("psi", 1.0 / PSI)),
    "m^3/s": _unit(
        "MQS",
        "cubic metre per second",
        "VolumetricFlowrateDrillingQuantity",
        UnitScale("L/min", 60000.0),
        fps=UnitScale("gal/min", 60.0 / GALLON),
    ),
}
