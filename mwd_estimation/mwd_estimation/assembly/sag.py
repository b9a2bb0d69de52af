# SPDX-License-Identifier: Apache-2.0
"""Sag: the angle between survey sensors and hole due to bending of the assembly, and the correction of inclination."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from mwd_estimation.assembly.assembly import Assembly
from mwd_sensors.core.arrays import Array, Indices
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
    """Return the nodes of the beam, m from the bit, and their clearances, m; ends: upper ends of the components, m."""
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


# Elastic beam in a hole. It bends under its weight and an axial force, and the wall of the hole limits its deflection.
#
# The model is an Euler-Bernoulli beam-column of cubic elements in the plane of gravity. Deflection is measured from the
# axis of the hole, positive towards the high side; distance is measured from the bit, up-hole. The wall bounds the
# deflection of every node. The solution is the minimum of the elastic energy within these bounds (contact without
# friction). It is found by a primal-dual active set (M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002),
# 865-888), or, if that does not converge, by a primal active set (J. Nocedal, S. Wright, Numerical Optimization, 2006,
# algorithm 16.3).


_MOST_STEPS = 60  # largest number of iterations of the primal-dual active set


@dataclass(frozen=True)
class Beam:
    """A beam divided into n elements."""

    at: Array  #: shape (n + 1,); distance of the nodes from the bit, m, increasing from 0
    stiffness: Array  #: shape (n,); bending stiffness of the elements, N m^2
    load: Array  #: shape (n,); weight per metre across the hole, towards the low side, N/m
    tension: Array  #: shape (n,); axial force, N; negative for compression
    clearance: Array  #: shape (n + 1,); largest possible distance of each node from the axis of the hole, m
    curvature: float = 0.0  #: curvature of the hole in the plane of gravity, rad/m; positive if the hole builds


@dataclass(frozen=True)
class Shape:
    """
    Shape of a beam: deflection, m, slope against the axis of the hole, rad, and force of the wall on the beam, N.

    Each has the shape (n + 1,), one value per node; deflection and force are positive towards the high side.
    """

    deflection: Array
    slope: Array
    contact: Array


def shape(beam: Beam) -> Shape:
    """
    Compute deflection, slope and wall force of a beam in its hole.

    The beam can rotate freely at the bit, and is parallel to the hole at its upper end.

    Raises
    ------
    ValueError
        If the axial force buckles the beam, or no stable set of contacts with the wall is found.
    """
    bending, axial, load = _assembled(beam)
    bounds = np.full(len(load), np.inf)
    bounds[::2] = beam.clearance
    # The upper end is parallel to the hole.
    bounds[-1] = 0.0
    # Without the axial force a minimum always exists. Start from its contacts, because they prevent most buckling.
    start, side = _bounded(bending, load, bounds, np.zeros(len(load), dtype=int))
    try:
        found, _ = _bounded(bending + axial, load, bounds, side) if axial.any() else (start, side)
    except LinAlgError as error:
        raise ValueError("the axial force buckles the assembly between its contacts: lower weight_on_bit_kn") from error
    force = (bending + axial) @ found - load
    return Shape(found[::2], found[1::2], force[::2])


def _bounded(matrix: Array, load: Array, bounds: Array, side: Indices) -> tuple[Array, Indices]:
    """
    Return the deflections and slopes with the smallest energy between -bounds and bounds, and the contacts.

    matrix, load: stiffness matrix and load of the nodes. All arrays have one row per deflection and per slope of the
    nodes. The contact of a row is -1 or 1 if the row is at the lower or upper bound, else 0. side: initial guess of the
    contacts. Raises LinAlgError if the energy has no minimum, or no stable set of contacts is found.
    """
    limited = np.isfinite(bounds)
    rigid = bounds <= 0.0
    weight = np.diagonal(matrix)
    start = side = np.where(rigid, 1, side)
    for _ in range(_MOST_STEPS):
        fixed = side != 0
        found = np.where(fixed, side * np.where(limited, bounds, 0.0), 0.0)
        try:
            found = np.where(fixed, found, _solved(matrix, load - matrix @ found, fixed))
        except LinAlgError:
            # Too many contacts were released at once, so that a compressed component buckles.
            break
        over = np.where(fixed, load - matrix @ found, 0.0) / weight + found
        new = np.where(limited & (over > bounds), 1, np.where(limited & (over < -bounds), -1, 0))
        new[rigid] = 1
        if (new == side).all():
            return found, side
        side = new
    # In rare cases the method alternates between two sets of contacts.
    return _one_by_one(matrix, load, bounds, start)


def _one_by_one(matrix: Array, load: Array, bounds: Array, side: Indices) -> tuple[Array, Indices]:
    """
    Return the results of `_bounded`, found by a primal active set, which changes one contact at a time.

    Raises LinAlgError as `_bounded` does.
    """
    side, reach = side.copy(), np.where(np.isfinite(bounds), bounds, 0.0)
    found = np.where(side != 0, side * reach, 0.0)
    for _ in range(20 * len(load)):
        fixed = side != 0
        step = _solved(matrix, load - matrix @ found, fixed)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step == 0.0, np.inf, (np.sign(step) * bounds - found) / step)
        first = int(np.argmin(room))
        if room[first] < 1.0:
            found = found + max(room[first], 0.0) * step
            side[first] = int(np.sign(step[first]))
            found[first] = side[first] * bounds[first]
            continue
        found = found + step
        pulled = np.where(bounds > 0.0, side * (matrix @ found - load), 0.0)
        worst = int(np.argmax(pulled))
        if pulled[worst] <= 1e-9 * np.abs(load).max():
            return found, side
        side[worst] = 0
    raise LinAlgError("no stable set of contacts between assembly and hole was found")


def _solved(matrix: Array, load: Array, fixed: NDArray[np.bool_]) -> Array:
    """
    Return the solution of matrix x = load in the rows that are not fixed, and 0 in the fixed rows.

    The matrix is symmetric, with three diagonals above the main diagonal. Raises LinAlgError if it is not positive
    definite.
    """
    band = np.zeros((4, len(load)))
    for k in range(4):
        band[3 - k, k:] = np.where(fixed[k:] | fixed[: len(load) - k], 0.0, np.diagonal(matrix, k))
    band[3, fixed] = 1.0
    return np.asarray(scipy.linalg.solveh_banded(band, np.where(fixed, 0.0, load)))


def _assembled(beam: Beam) -> tuple[Array, Array, Array]:
    """
    Return the matrices of bending and axial force, (2n + 2, 2n + 2), and the load, (2n + 2,).

    The rows are the deflection and the slope of each node in turn.
    """
    count = len(beam.at)
    stiffness, tightness = np.zeros((2 * count, 2 * count)), np.zeros((2 * count, 2 * count))
    load = np.zeros(2 * count)
    for k, length in enumerate(np.diff(beam.at)):
        part = slice(2 * k, 2 * k + 4)
        bending = np.array(
            [
                [12.0, 6.0 * length, -12.0, 6.0 * length],
                [6.0 * length, 4.0 * length**2, -6.0 * length, 2.0 * length**2],
                [-12.0, -6.0 * length, 12.0, -6.0 * length],
                [6.0 * length, 2.0 * length**2, -6.0 * length, 4.0 * length**2],
            ]
        )
        axial = np.array(
            [
                [36.0, 3.0 * length, -36.0, 3.0 * length],
                [3.0 * length, 4.0 * length**2, -3.0 * length, -(length**2)],
                [-36.0, -3.0 * length, 36.0, -3.0 * length],
                [3.0 * length, -(length**2), -3.0 * length, 4.0 * length**2],
            ]
        )
        stiffness[part, part] += beam.stiffness[k] / length**3 * bending
        tightness[part, part] += beam.tension[k] / (30.0 * length) * axial
        weight = -beam.load[k] * length * np.array([0.5, length / 12.0, 0.5, -length / 12.0])
        # A straight beam resists the curvature of the hole with this moment; an axial force in a curve pulls sideways.
        moment = beam.stiffness[k] * beam.curvature * np.array([0.0, 1.0, 0.0, -1.0])
        pull = beam.tension[k] * beam.curvature * length * np.array([0.5, length / 12.0, 0.5, -length / 12.0])
        load[part] += weight + moment + pull
    return stiffness, tightness, load
