# SPDX-License-Identifier: Apache-2.0
"""
The 48 mappings that exchange and reverse three axes, and the effect of each on vectors that the gyros propagate.

A mapping P is a signed permutation that turns true components into measured ones: `v_m = P v`. Let the gyros measure
`w_m = G w` with G = s Q^T (Q proper, s = +1 or -1), and another sensor `v_m = V v`. With R_s the attitude integrated
from s w_m, the propagated vector `R v` is `Q R_s Q^T V^T v_m`. The length of its mean depends only on s and on M = Q^T
V^T up to sign, which gives 2 x 24 different cases.
"""

from __future__ import annotations

import itertools

import numpy as np

from mwd_sensors.core.arrays import Array, Indices

GYRO, ACCEL, MAG = 0, 1, 2


def _signed_permutations() -> list[Indices]:
    made = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            one = np.zeros((3, 3), dtype=np.int64)
            one[np.arange(3), list(order)] = signs
            made.append(one)
    return made


def _contrived(m: Indices) -> int:
    """Return how unlikely a mapping is as a mistake: 1 (one axis reversed or two exchanged) to 4 (mixtures)."""
    fixed, flips = int(np.count_nonzero(np.diagonal(m))), int(np.count_nonzero(m < 0))
    if fixed == 3:
        return {1: 1, 3: 2, 2: 3}[flips]
    return {0: 1, 1: 3, 2: 4, 3: 4}[flips] if fixed == 1 else 4


MAPPINGS = _signed_permutations()
"""All 48 signed permutations as matrices, shape (3, 3), the identity first."""

_PROPER = [m for m in MAPPINGS if round(float(np.linalg.det(m))) == 1]
ROTATIONS: Array = np.array(_PROPER, dtype=float)
"""The 24 rotations among `MAPPINGS`, shape (24, 3, 3); with the attitude integrated from +w or from -w, 48 cases."""


def _mistakes() -> tuple[Indices, Indices]:
    """
    Return the mistakes of one sensor, and the rank of each.

    A mistake is a row (sensor, index in MAPPINGS, case in propagated gravity, case in the propagated field). A case is
    an index in ROTATIONS, plus 24 for the attitude integrated from -w.
    """
    index = {m.tobytes(): k for k, m in enumerate(_PROPER)}
    rows, weights = [], []
    for k, m in enumerate(MAPPINGS[1:], start=1):
        sign = round(float(np.linalg.det(m)))
        by_gyro = index[np.ascontiguousarray(sign * m).tobytes()] + (0 if sign > 0 else len(_PROPER))
        by_vector = index[np.ascontiguousarray(sign * m.T).tobytes()]
        rows += [(GYRO, k, by_gyro, by_gyro), (ACCEL, k, by_vector, 0), (MAG, k, 0, by_vector)]
        weight = _contrived(m)
        # A driver that counts rotation positive in the other direction reverses all three gyros: this mistake is as
        # likely as one reversed gyro.
        weights += [1 if weight == 2 else weight, weight, weight]
    return np.array(rows, dtype=np.int64), np.array(weights, dtype=np.int64)


MISTAKES, WEIGHTS = _mistakes()
"""All mistakes of one sensor, shape (141, 4), and their ranks, 1 (most likely) to 4, shape (141,); see `_mistakes`."""


def kind_of(k: int) -> tuple[str, str]:
    """
    Return the kind of mapping k and the letters of the axes that it changes.

    The kind is "swapped", "flipped" or "frame". For all three axes the letters are "all" if flipped, otherwise "xyz".
    """
    m = MAPPINGS[k]
    flipped = "".join(a for n, a in enumerate("xyz") if m[n].sum() < 0)
    moved = "".join(a for n, a in enumerate("xyz") if m[n, n] == 0)
    if not moved:
        if len(flipped) == 2:
            return "frame", flipped
        return "flipped", "all" if len(flipped) == 3 else flipped
    if len(moved) == 2 and not flipped:
        return "swapped", moved
    turned = len(moved) == 2 and len(flipped) == 1 and round(float(np.linalg.det(m))) == 1
    return "frame", moved if turned else "xyz"
