# SPDX-License-Identifier: Apache-2.0
"""
Elastic beam in a hole: it bends under its weight and an axial force, and the wall of the hole limits its deflection.

The model is an Euler-Bernoulli beam-column of cubic elements in the plane of gravity. Deflection is measured from the
axis of the hole, positive towards the high side; distance is measured from the bit, up-hole. The wall bounds the
deflection of every node. The solution is the minimum of the elastic energy within these bounds (contact without
friction). It is found by a primal-dual active set (M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002),
865-888), or, if that does not converge, by a primal active set (J. Nocedal, S. Wright, Numerical Optimization, 2006,
algorithm 16.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Indices

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
