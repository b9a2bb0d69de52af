# SPDX-License-Identifier: Apache-2.0
"""
Rotate gravity and field of a window by the gyros to its start, under every exchange and reversal of axes.

Vectors that are rotated to the axes at the start of the window are called carried. Carried gravity and the carried
field of the Earth are constant. If axes of one sensor are exchanged, reversed or turned, the carried vectors spread and
their mean becomes shorter. If the motion cannot distinguish some mappings (a tool at rest, or rotating about one axis
only), several of them explain the same data. `window_checks` evaluates the means.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_estimation.core.axis_mappings import ROTATIONS
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import rotate_right


@compiled
def attitudes(turns: Array, scale: float) -> Array:
    """
    Return the attitude before each step relative to the first, as rotation matrices, shape (n, 3, 3).

    turns, shape (n, 3): rotation in each step; scale: factor from its unit to rad.
    """
    mats = np.zeros((len(turns), 3, 3))
    mat = np.eye(3)
    for i in range(len(turns)):
        mats[i] = mat
        rotate_right(mat, scale * turns[i, 0], scale * turns[i, 1], scale * turns[i, 2])
    return mats


class Window:
    """
    Carried vectors of a window in each of the 48 cases of exchanged and reversed axes (`axis_mappings`).

    Attributes
    ----------
    force, field : ndarray, shape (48,)
        Squared length of the mean carried force and field in each case, in the squared units of the sensors.
    force_deg, field_deg : float
        Squared length of the mean carried force and field if the gyros send deg/s.
    force_fixed, field_fixed : float
        Squared length of the mean force and field in tool axes.
    force2, field2 : float
        Mean squared length of force and field.
    forces, fields : int
        Number of samples of force and field.
    product : ndarray, shape (3, 3)
        Mean of force component i times field component j.
    part_force : ndarray, shape (parts, 48, 3)
        Mean carried force of each half second in each case.
    mean_force : ndarray, shape (3,)
        Mean force in tool axes.
    push : float
        Largest magnitude of the mean force of a half second along an axis of the tool, in the unit of the sensor.
    path : float
        Total rotation angle according to the gyros, rad.
    turn : ndarray, shape (3,)
        Sum of the rotations about each axis, rad.
    began_ns : int
        Start of the window.
    seconds : float
        Length of the window, s.
    """

    def __init__(self, steps: Any, began_ns: int, seconds: float) -> None:
        turn = np.ascontiguousarray(steps["turn"])
        force, field, counts = steps["force"], steps["field"], steps["fields"]
        self.began_ns, self.seconds = began_ns, seconds
        self.forces, self.fields = int(steps["forces"].sum()), int(counts.sum())
        self.force2 = float(steps["force2"].sum() / max(self.forces, 1))
        self.field2 = float(steps["field2"].sum() / max(self.fields, 1))
        self.path, self.turn = float(np.sqrt((turn**2).sum(axis=1)).sum()), turn.sum(axis=0)
        starts = np.flatnonzero(np.diff(steps["part"], prepend=-1))
        part_forces = np.add.reduceat(steps["forces"], starts)
        by_part, in_all = [], []
        for sign in (1.0, -1.0):
            mats = attitudes(turn, sign)
            carried = np.add.reduceat(np.einsum("nab,nj->nabj", mats, force), starts)
            by_part.append(np.einsum("wbj,pabj->pwa", ROTATIONS, carried))
            in_all.append(np.einsum("wbj,abj->wa", ROTATIONS, np.einsum("nab,nj->abj", mats, field)))
        sums = np.concatenate(by_part, axis=1)
        self.part_force = sums / np.maximum(part_forces, 1)[:, None, None]
        self.whole_parts = bool((part_forces > 0).all())
        n, m = max(self.forces, 1), max(self.fields, 1)
        self.force = ((sums.sum(axis=0) / n) ** 2).sum(axis=1)
        self.field = ((np.concatenate(in_all) / m) ** 2).sum(axis=1)
        as_deg = attitudes(turn, math.radians(1.0))
        self.force_deg = float(((np.einsum("nab,nb->a", as_deg, force) / n) ** 2).sum())
        self.field_deg = float(((np.einsum("nab,nb->a", as_deg, field) / m) ** 2).sum())
        tool_means = np.add.reduceat(force, starts) / np.maximum(part_forces, 1)[:, None]
        self.push = float(np.abs(tool_means).max())
        self.mean_force = force.sum(axis=0) / n
        self.force_fixed = float((self.mean_force**2).sum())
        self.field_fixed = float(((field.sum(axis=0) / m) ** 2).sum())
        both = (counts > 0) & (steps["forces"] > 0)
        product = np.einsum("ni,nj->ij", force[both], field[both] / counts[both, None])
        self.product = product / max(int(steps["forces"][both].sum()), 1)

    def noise(self, case: int) -> float:
        """
        Return 1 sigma of the mean carried force of a case along one axis, from the scatter of the half seconds.

        The result is infinite for fewer than two half seconds, or if one of them has no force.
        """
        parts = self.part_force[:, case]
        if len(parts) < 2 or not self.whole_parts:
            return math.inf
        return math.sqrt(float(parts.var(axis=0).sum()) / (3.0 * (len(parts) - 1)))
