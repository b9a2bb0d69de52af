# SPDX-License-Identifier: Apache-2.0
"""
Axial field of a magnetised drill string at the survey sensors, and the non-magnetic length that limits it.

A magnetised piece of steel acts as a pair of poles of opposite sign at its ends; the field of a pole decreases with the
square of the distance. S. J. Grindrod, J. M. Wolff, "Calculation of NMDC length required for various latitudes
developed from field measurements of drill string magnetisation", IADC/SPE 11382 (1983). The signs of the poles are
unknown before they are measured, so the fields of all pieces are added with the signs that make the sum largest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.optimize import brentq, minimize_scalar

from mwd_estimation.assembly.assembly import Assembly, Component

# Usual pole strengths, Wb: collars or pipe above the sensor; steel below the sensor with a motor, with ten metres of
# collars, or with only stabiliser and bit. These are typical values used in the industry, of the same size as published
# field measurements; they were not checked against the tables of the paper.
POLES = {"collars": 900e-6, "motor": 1000e-6, "short collars": 300e-6, "bit": 90e-6}
# Length of a piece below which its pole strength is assumed to be as for stabilisers and bits, m.
_SHORT = 3.0
# Longest non-magnetic collars considered, m.
_LONGEST = 300.0


@dataclass(frozen=True)
class Steel:
    """Magnetised piece of the string on one side of the sensors."""

    near: float  #: distance from the sensors to the nearer end of the piece, m
    length: float  #: length of the piece, m; infinite for the string above the assembly
    pole: float  #: strength of the magnetic pole at each end of the piece, Wb
    name: str = ""

    def __post_init__(self) -> None:
        if not (self.near > 0.0 and self.length > 0.0 and self.pole >= 0.0):
            raise ValueError(
                f"{self.name or 'steel'}: needs a distance and a length above 0 and a pole strength of 0 or more, got "
                f"{self.near:g} m, {self.length:g} m, {self.pole:g} Wb"
            )

    @property
    def field(self) -> float:
        """Axial field at the sensors, T."""
        return self.pole / (4.0 * math.pi) * (1.0 / self.near**2 - 1.0 / (self.near + self.length) ** 2)


def interference(pieces: Sequence[Steel]) -> float:
    """Return the largest possible axial field of the pieces together, T: all fields added with the same sign."""
    return sum(piece.field for piece in pieces)


def pieces_of(assembly: Assembly) -> tuple[Steel, ...]:
    """
    Return the magnetic pieces of an assembly; adjacent magnetic components form one piece with their strongest pole.

    A piece at the upper end of the assembly continues into the string above; if the assembly ends with a non-magnetic
    component, the string above is a piece of its own. A piece without a given pole strength gets the usual one
    (`POLES`). Raises ValueError if the sensors lie in magnetic steel.
    """
    runs: list[tuple[float, list[Component]]] = []
    start, before = 0.0, False
    for part in assembly.components:
        if part.magnetic:
            if not before:
                runs.append((start, []))
            runs[-1][1].append(part)
        before = part.magnetic
        start += part.length_m
    last = assembly.components[-1]
    if not last.magnetic:
        runs.append((assembly.length, []))
    found = []
    for low, parts in runs:
        high = low + sum(part.length_m for part in parts)
        goes_on = high >= assembly.length - 1e-9
        name = " + ".join(part.name for part in parts) or "string above"
        pole = max((part.pole_uwb * 1e-6 for part in parts), default=0.0) or _usual_pole(high - low, goes_on)
        length = math.inf if goes_on else high - low
        if low <= assembly.sensor_m <= (math.inf if goes_on else high):
            raise ValueError(f"sensor_m: {assembly.sensor_m:g} m lies in magnetic steel ({name})")
        found.append(
            Steel(low - assembly.sensor_m if low > assembly.sensor_m else assembly.sensor_m - high, length, pole, name)
        )
    return tuple(found)


def azimuth_error(axial: float, inclination: float, azimuth: float, horizontal: float) -> float:
    """
    Return the error that an axial field causes in an uncorrected azimuth.

    Parameters
    ----------
    axial : float
        Axial field, T, positive downhole.
    inclination, azimuth : float
        Direction of the hole, azimuth from magnetic north, rad.
    horizontal : float
        Horizontal field, T, above 0.

    Returns
    -------
    float
        Measured minus true azimuth, rad in [-pi, pi].
    """
    along = horizontal * math.cos(azimuth) + axial * math.sin(inclination)
    measured = math.atan2(horizontal * math.sin(azimuth), along)
    return math.remainder(measured - azimuth, math.tau)


def largest_interference(limit: float, inclination: float, azimuth: float, horizontal: float) -> float:
    """
    Return the largest axial field, T, whose azimuth error stays within a limit, rad, for both signs of the field.

    Return inf if no axial field causes a larger azimuth error. Other arguments as in `azimuth_error`.
    """

    def worst(axial: float) -> float:
        return max(abs(azimuth_error(sign * axial, inclination, azimuth, horizontal)) for sign in (-1.0, 1.0))

    if not worst(100.0 * horizontal) > limit:
        return math.inf
    return float(brentq(lambda axial: worst(axial) - limit, 0.0, 100.0 * horizontal, xtol=1e-13))


def shortest_collars(above: float, below: float, below_length: float, most: float) -> tuple[float, float]:
    """
    Return the non-magnetic collars of the smallest total length that keep the axial field within a limit.

    Parameters
    ----------
    above, below : float
        Pole strengths of the string above and of the steel below, Wb.
    below_length : float
        Length of the steel below, m.
    most : float
        Largest axial field, T.

    Returns
    -------
    above, below : float
        Lengths of the non-magnetic collars above and below the sensors, m.

    Raises
    ------
    ValueError
        More than 300 m would be needed.
    """

    def field_below(distance: float) -> float:
        return Steel(distance, below_length, below).field

    def length_above(distance: float) -> float:
        left = most - field_below(distance)
        return math.sqrt(above / (4.0 * math.pi * left)) if left > 0.0 else math.inf

    if not field_below(_LONGEST) < most:
        raise ValueError(f"the limit of {most * 1e9:.1f} nT needs more than {_LONGEST:g} m of non-magnetic collars")
    low = 0.0
    if field_below(1e-3) > most:
        low = float(brentq(lambda distance: field_below(distance) - most, 1e-3, _LONGEST))
    found = minimize_scalar(
        lambda distance: distance + min(length_above(distance), 10.0 * _LONGEST),
        bounds=(low, _LONGEST),
        method="bounded",
    )
    distance = float(found.x)
    if length_above(distance) > _LONGEST:
        raise ValueError(f"the limit of {most * 1e9:.1f} nT needs more than {_LONGEST:g} m of non-magnetic collars")
    return length_above(distance), distance


def _usual_pole(length: float, goes_on: bool) -> float:
    if goes_on:
        return POLES["collars"]
    return POLES["bit"] if length <= _SHORT else POLES["short collars"]
