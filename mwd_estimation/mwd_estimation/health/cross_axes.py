"""
Whether y and z of the gyros are what they should be: what the field along the tool's axis says of a turn across it.

Rotation about its own axis leaves the field's component along that axis alone; only a turn across it changes that:
`d(b_x)/dt = w_z b_y - w_y b_z`, linear in the rates, where what a turn does to a length is quadratic. With a 2 x 2
matrix A from measured to true cross rates, b_x over some seconds is a constant, what the magnetometer's own axes leak
into it (of b_y and b_z), what the gyros' biases add (the integrals of b_y and b_z), its own change times the delay of
the magnetometer, and the elements of A times four integrals of rate times field. The first six are estimated within a
prior, the rest must be A = 1; one axis reversed, both exchanged, or exchanged and reversed are held against it.

All four are reflections. A magnetometer that comes very late turns A while the tool rotates, but never reflects it:
what a turned A explains as well is no mistake. Steps of 0.1 s hide turns so fast that a delay of some samples would be
half their period. What turns less than the noise of the magnetometer, or not across the axis, says nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.health import axis_consistency as axes
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

Whole = NDArray[np.int64]

# The mistakes: elements of A by rows, and their mappings of `axis_consistency` with what they weigh there.
_WRONG = np.array(
    [[1.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 1.0, 0.0], [0.0, -1.0, -1.0, 0.0]]
)


def _mapping(elements: Array) -> int:
    matrix = np.eye(3)
    matrix[1:, 1:] = elements.reshape(2, 2)
    return next(k for k, m in enumerate(axes.MAPPINGS) if np.array_equal(m, matrix))


_MAPPINGS = np.array([_mapping(row) for row in _WRONG], dtype=np.int64)
_CONTRIVED = np.array([0, 1, 1, 1, 4], dtype=np.int64)

# The same, turned by so many parts of a circle.
_TURNED = np.array([[c, -s, s, c] for c, s in ((math.cos(a), math.sin(a)) for a in np.arange(1, 12) * math.pi / 6.0)])

# Layout: integrals of rate times field (4) and of the field (2), field of the step before (3), whether there was one,
# steps, broken, the columns of the step: 1, b_y, b_z, two biases, delay, four of A, b_x; the sums of their products.
_P, _J, _LAST, _HAVE, _STEPS, _BROKEN, _ROW, _SUMS = 0, 4, 6, 9, 10, 11, 12, 23
_COLUMNS, _NUISANCE = 11, 6
SIZE = _SUMS + _COLUMNS * _COLUMNS
# 1 sigma of what is not of interest: leaks of the field's axes, rad, biases, rad/s, and delay, s, beside a field of 1;
# and of a step of the field: as these are weighed against it, the least, and the most with which it is judged.
_PRIOR = np.array([math.inf, 0.02, 0.02, 0.01, 0.01, 0.2])
_NOISE, _LEAST_NOISE, _NOISIEST = 4e-4, 2e-4, 1.5e-3
_FEW = 15
# A mistake must explain this much better than right axes, in noise variances, and be no worse than any A but by this
# and that share of how much worse the others are: what a delay of a sample turns A by.
_BETTER, _FITS, _SHARE = 100.0, 20.0, 0.03
_UNSEEN2 = 0.1  # rad^2: turned so far without a magnetic sample the field's direction in the tool is not known


@compiled
def begin(cross: Array) -> None:
    """Open a window."""
    for k in range(SIZE):
        if k < _LAST or k >= _STEPS:
            cross[k] = 0.0


@compiled
def add(cross: Array, sums: Array, seconds: float) -> None:
    """Take a step that `axis_consistency.carry` is about to close, of this length."""
    t_y, t_z = sums[axes.TURN + 1], sums[axes.TURN + 2]
    n = sums[axes.N_FIELD]
    if n > 0.0:
        b_x, b_y, b_z = sums[axes.FIELD] / n, sums[axes.FIELD + 1] / n, sums[axes.FIELD + 2] / n
        cross[_LAST], cross[_LAST + 1], cross[_LAST + 2], cross[_HAVE] = b_x, b_y, b_z, 1.0
        # The turn since the step began as the samples of the field saw it, in the mean.
        m_y, m_z, half = sums[axes.SEEN_TURN] / n, sums[axes.SEEN_TURN + 1] / n, 0.5 * seconds
        at = _ROW
        cross[at], cross[at + 1], cross[at + 2] = 1.0, b_y, b_z
        cross[at + 3], cross[at + 4] = cross[_J] + half * b_z, cross[_J + 1] + half * b_y
        cross[at + 5] = (t_z * b_y - t_y * b_z) / max(seconds, 1e-3)
        cross[at + 6], cross[at + 7] = cross[_P] - m_y * b_z, cross[_P + 1] - m_z * b_z
        cross[at + 8], cross[at + 9] = cross[_P + 2] + m_y * b_y, cross[_P + 3] + m_z * b_y
        cross[at + 10] = b_x
        for i in range(_COLUMNS):
            share = cross[_ROW + i]
            for j in range(_COLUMNS):
                cross[_SUMS + _COLUMNS * i + j] += share * cross[_ROW + j]
        cross[_STEPS] += 1.0
    elif cross[_HAVE] == 0.0 or sums[axes.TURN] ** 2 + t_y * t_y + t_z * t_z > _UNSEEN2:
        cross[_BROKEN] = 1.0
    b_y, b_z = cross[_LAST + 1], cross[_LAST + 2]
    cross[_J] += seconds * b_z
    cross[_J + 1] += seconds * b_y
    cross[_P] -= t_y * b_z
    cross[_P + 1] -= t_z * b_z
    cross[_P + 2] += t_y * b_y
    cross[_P + 3] += t_z * b_y


@compiled
def _eliminate(m: Array, first: int, last: int) -> None:
    """Take the columns from `first` up to `last` out of the normal equations m, upper triangle."""
    for k in range(first, last):
        for i in range(k + 1, _COLUMNS):
            share = m[k, i] / m[k, k]
            for j in range(i, _COLUMNS):
                m[i, j] -= share * m[k, j]


@compiled
def _misfit(left: Array, elements: Array) -> float:
    """Sum of squares that these elements of A leave."""
    total = left[4, 4]
    for i in range(4):
        total -= 2.0 * elements[i] * left[i, 4]
        for j in range(4):
            total += elements[i] * elements[j] * left[min(i, j), max(i, j)]
    return float(total)


@compiled
def judge(cross: Array, rotates: bool, found: Whole) -> int:
    """
    What the window shows of the gyros' cross axes: 1 a mistake, 0 that there is none, -1 nothing.

    rotates : the tool turns about its axis; found, shape (1,): bits of the least contrived mistakes that explain it, as
    mappings of `axis_consistency`.
    """
    found[0] = 0
    n = cross[_STEPS]
    if n < _FEW or cross[_BROKEN] > 0.0:
        return -1
    m = np.zeros((_COLUMNS, _COLUMNS))
    for i in range(_COLUMNS):
        for j in range(i, _COLUMNS):
            m[i, j] = cross[_SUMS + _COLUMNS * i + j]
    last = _COLUMNS - 1
    field2 = (m[last, last] + m[1, 1] + m[2, 2]) / n
    if not field2 > 0.0:
        return -1
    # Everything but the constant is of the field: make that 1.
    scale = 1.0 / math.sqrt(field2)
    for i in range(_COLUMNS):
        for j in range(i, _COLUMNS):
            m[i, j] *= (scale if i > 0 else 1.0) * (scale if j > 0 else 1.0)
    for k in range(1, _NUISANCE):
        m[k, k] += (_NOISE / _PRIOR[k]) ** 2
    _eliminate(m, 0, _NUISANCE)
    left = m[_NUISANCE:, _NUISANCE:].copy()
    for k in range(_NUISANCE, last):
        m[k, k] += 1e-12
    _eliminate(m, _NUISANCE, last)
    free = max(m[last, last], 0.0)
    noise2 = max(free / (n - last), _LEAST_NOISE**2)
    if noise2 > _NOISIEST**2:
        return -1
    misfit, turned = np.zeros(len(_WRONG)), math.inf
    for h in range(len(_WRONG)):
        misfit[h] = _misfit(left, _WRONG[h]) / noise2
    for k in range(len(_TURNED) if rotates else 0):
        turned = min(turned, _misfit(left, _TURNED[k]) / noise2)
    free /= noise2
    lightest, next_best = 9, math.inf
    fits = free + _FITS + _SHARE * (misfit[0] - free)
    for h in range(1, len(_WRONG)):
        next_best = min(next_best, misfit[h])
        better = min(misfit[0] - _BETTER, turned - _FITS)
        if misfit[h] < better and misfit[h] < fits and _CONTRIVED[h] <= lightest:
            if _CONTRIVED[h] < lightest:
                found[0], lightest = 0, _CONTRIVED[h]
            found[0] |= 1 << _MAPPINGS[h]
    if found[0] != 0:
        return 1
    right = misfit[0] + _BETTER < next_best and misfit[0] < free + _FITS + _SHARE * (next_best - free)
    return 0 if right else -1
