# SPDX-License-Identifier: Apache-2.0
"""Sag: the angle between survey sensors and hole due to bending of the assembly, and the correction of inclination."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np

from mwd_estimation.assembly.assembly import Assembly
from mwd_estimation.assembly.beam import Beam, Shape, shape
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY

# Longest element, m; elements of half this length change the sag in the tests by less than 0.001 deg.
_ELEMENT = 0.5
# Length for which the last component is assumed to continue above the described components, m. It is much longer than
# the length over which a collar lifts off the low side.
_ABOVE = 60.0
# Inclinations in the table of a correction, deg. Holes with larger inclinations are not drilled; an assembly would
# buckle there under its own weight.
_TABLE_DEG = np.arange(0.0, 122.5, 2.5)


@dataclass(frozen=True)
class SagCorrection:
    """Correction to add to a measured inclination."""

    #: Correction in a horizontal hole, rad, which is multiplied by the sine of the inclination; unused with a table.
    horizontal: float = 0.0
    table: tuple[tuple[float, float], ...] = ()  #: pairs of inclination, rad, increasing, and correction, rad

    def at(self, inclination: float) -> float:
        """Return the correction, rad, at an inclination, rad; outside the table, the correction at the nearest end."""
        if not self.table:
            return self.horizontal * math.sin(inclination)
        inclinations, corrections = zip(*self.table, strict=True)
        return float(np.interp(inclination, inclinations, corrections))


def sag(assembly: Assembly, inclination: float, build: float | None = None) -> float:
    """
    Compute the sag correction for the inclination that the sensors of an assembly measure.

    Parameters
    ----------
    inclination : float
        Inclination of the hole at the sensors, rad.
    build : float, optional
        Build rate of the hole, rad/m; by default the build rate in the description of the assembly.

    Returns
    -------
    float
        Inclination of the hole minus inclination of the sensors, rad.

    Raises
    ------
    ValueError
        If the weight on bit buckles the assembly, or no stable set of contacts with the wall is found.
    """
    at, lies = lie(assembly, inclination, build)
    return float(lies.slope[int(np.argmin(np.abs(at - assembly.sensor_m)))])


def lie(assembly: Assembly, inclination: float, build: float | None = None) -> tuple[Array, Shape]:
    """
    Return the nodes of an assembly in a hole, m from the bit, shape (n,), and their deflection, slope and wall force.

    Arguments and exceptions as in `sag`.
    """
    curvature = math.radians(assembly.build_deg_30m) / 30.0 if build is None else build
    ends = np.cumsum([part.length_m for part in assembly.components])
    above = np.append(ends[:-1], ends[-1] + _ABOVE)
    at, clearance = _nodes(assembly, np.append(ends, above[-1]))
    middle = 0.5 * (at[1:] + at[:-1])
    index = np.searchsorted(above, middle)
    parts = [assembly.components[k] for k in index]
    weight = STANDARD_GRAVITY * np.array([part.buoyed_mass(assembly.mud_kg_m3) for part in parts])
    inclinations = inclination - curvature * (middle - assembly.sensor_m)
    pulling = weight * np.cos(inclinations) * np.diff(at)
    # Off bottom the assembly hangs under its own weight; weight on bit pushes against it.
    tension = np.cumsum(pulling) - 0.5 * pulling - 1e3 * assembly.weight_on_bit_kn
    return at, shape(
        Beam(
            at=at,
            stiffness=np.array([part.stiffness for part in parts]),
            load=weight * np.sin(inclinations),
            tension=tension,
            clearance=clearance,
            curvature=curvature,
        )
    )


@functools.lru_cache(maxsize=8)
def correction_of(assembly: Assembly) -> SagCorrection:
    """Return the sag correction for all inclinations (constant above 120 deg). Raises ValueError like `sag`."""
    return SagCorrection(table=tuple((float(angle), sag(assembly, float(angle))) for angle in np.radians(_TABLE_DEG)))


def _nodes(assembly: Assembly, ends: Array) -> tuple[Array, Array]:
    """Return the nodes, m from the bit, and their clearances, m; ends: upper ends of the components, m from the bit."""
    bodies = np.array([part.od_mm for part in (*assembly.components, assembly.components[-1])])
    starts = np.concatenate([[0.0], ends[:-1]])
    blades = {
        round(float(start) + blade.at_m, 6): blade.od_mm
        for start, part in zip(starts, assembly.components, strict=False)
        for blade in part.blades
    }
    marks = np.unique(np.round([0.0, assembly.sensor_m, *ends, *blades], 6))
    at = np.concatenate(
        [
            [0.0],
            *(
                np.linspace(low, high, math.ceil((high - low) / _ELEMENT) + 1)[1:]
                for low, high in itertools.pairwise(marks)
            ),
        ]
    )
    # At a joint, use the diameter of the wider component, which touches the wall first.
    below, over = np.searchsorted(ends, at - 1e-9), np.searchsorted(ends, at + 1e-9)
    last = len(bodies) - 1
    widest = np.maximum(bodies[np.minimum(below, last)], bodies[np.minimum(over, last)])
    for where, od in blades.items():
        k = int(np.argmin(np.abs(at - where)))
        widest[k] = max(widest[k], od)
    clearance = 0.5e-3 * (assembly.hole_mm - widest)
    # The bit has the diameter of the hole, so it has no clearance.
    clearance[0] = 0.0
    return at, clearance
