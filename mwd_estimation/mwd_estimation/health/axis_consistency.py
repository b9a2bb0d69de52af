"""
Whether the axes of three sensors belong together, judged from motion alone.

Seen from axes carried along by the gyros, gravity and the Earth's field stand still. Axes exchanged, reversed or turned
on one sensor break that: the vectors smear out. All 48 ways to exchange and reverse three axes are tried at once, at
the price of two integrated attitudes: turning a sensor's axes turns the attitude integrated from it in the same way,
so that one sum of products, `sum R v^T`, holds the answer for every way. What a motion cannot tell apart (a tool that
stands, or turns about one axis only) comes out as several ways that explain the same data.

A signed permutation P maps true to measured components, `v' = P v`. With gyros `w' = G w` and vectors `v' = V v`, and
G = s Q^T (Q proper, s = +1 or -1), the carried vector is `R v = Q R_s Q^T V^T v'`, where R_s is the attitude integrated
from s w'. Its mean's length depends on s and M = Q^T V^T up to sign: 2 x 24 ways.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

Whole = NDArray[np.int64]

DEG = math.radians(1.0)
WAYS = 48
STEP_ANGLE2 = 0.2  # rad^2: turned this far, the sums of a step are carried into the window's axes
STEP_NS = 100_000_000
# Layout of the sums: attitudes of +w, -w, w/57.3 (scalar first); turn, force, field and counts of the step; then the
# window's.
_Q, TURN, _F, _NF, FIELD, N_FIELD = 0, 12, 15, 18, 19, 22
_TF, _TB, _DF, _DB, _C, _F2, _B2, _WF, _WB, _WC, _PATH = 23, 77, 131, 134, 137, 146, 147, 148, 149, 150, 151
_RF, _RB, _RATE = 152, 155, 158
# Of the step: sum over the samples of the field of what had been turned about y and z by then.
SEEN_TURN = 161
# Parts of the window: how many, and the carried force and its count at the end of each.
PARTS = 6
_PARTS, _PART = 163, 164
SIZE = _PART + 55 * PARTS

GYRO, ACCEL, MAG = 0, 1, 2


def _signed_permutations() -> list[NDArray[np.int64]]:
    """All 48 as matrices, shape (3, 3), the identity first."""
    made = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            one = np.zeros((3, 3), dtype=np.int64)
            one[np.arange(3), list(order)] = signs
            made.append(one)
    return made


def _table() -> tuple[Whole, Whole, Whole, list[NDArray[np.int64]]]:
    """
    Ways (48, 7: s, column and sign of each row of M) and what each mistake of one sensor would look like.

    Mistakes, shape (m, 4): sensor, index into the mappings, way seen in gravity, way seen in the field; and their
    weights, shape (m,): how contrived each is.
    """
    mappings = _signed_permutations()
    proper = [m for m in mappings if round(float(np.linalg.det(m))) == 1]
    ways = np.zeros((WAYS, 7), dtype=np.int64)
    index: dict[tuple[int, bytes], int] = {}
    for half, sign in enumerate((1, -1)):
        for k, m in enumerate(proper):
            row = 24 * half + k
            columns = np.argmax(np.abs(m), axis=1)
            ways[row] = [sign, *columns, *m[np.arange(3), columns]]
            index[sign, m.tobytes()] = row
    mistakes, weights = [], []
    for k, m in enumerate(mappings):
        if k == 0:
            continue
        sign = round(float(np.linalg.det(m)))
        by_gyro = index[sign, np.ascontiguousarray(sign * m).tobytes()]
        by_vector = index[1, np.ascontiguousarray(sign * m.T).tobytes()]
        fixed, flips = int(np.count_nonzero(np.diagonal(m))), int(np.count_nonzero(m < 0))
        if fixed == 3:
            weight = {1: 1, 3: 2, 2: 3}[flips]
        elif fixed == 1:
            weight = {0: 1, 1: 3, 2: 4, 3: 4}[flips]
        else:
            weight = 4
        mistakes += [(GYRO, k, by_gyro, by_gyro), (ACCEL, k, by_vector, 0), (MAG, k, 0, by_vector)]
        weights += [weight] * 3
    return ways, np.array(mistakes, dtype=np.int64), np.array(weights, dtype=np.int64), mappings


TABLE_WAYS, MISTAKES, WEIGHTS, MAPPINGS = _table()


@compiled
def begin(sums: Array) -> None:
    """Open a window: attitudes to nothing turned, sums to zero."""
    for k in range(SIZE):
        sums[k] = 0.0
    sums[_Q] = sums[_Q + 4] = sums[_Q + 8] = 1.0


@compiled
def add_rate(sums: Array, dt: float, x: float, y: float, z: float) -> float:
    """Add a rate, rad/s, over dt, s; return the square of the turn since the last `carry`, rad^2."""
    sums[TURN] += x * dt
    sums[TURN + 1] += y * dt
    sums[TURN + 2] += z * dt
    return float(sums[TURN] ** 2 + sums[TURN + 1] ** 2 + sums[TURN + 2] ** 2)


@compiled
def add_force(sums: Array, x: float, y: float, z: float) -> None:
    """Add a specific force, in the accelerometer's unit."""
    sums[_F] += x
    sums[_F + 1] += y
    sums[_F + 2] += z
    sums[_NF] += 1.0
    sums[_F2] += x * x + y * y + z * z


@compiled
def add_field(sums: Array, x: float, y: float, z: float) -> None:
    """Add a magnetic field, in the magnetometer's unit."""
    sums[FIELD] += x
    sums[FIELD + 1] += y
    sums[FIELD + 2] += z
    sums[N_FIELD] += 1.0
    sums[SEEN_TURN] += sums[TURN + 1]
    sums[SEEN_TURN + 1] += sums[TURN + 2]
    sums[_B2] += x * x + y * y + z * z


@compiled
def carry(sums: Array) -> None:
    """Carry the step's sums into the window's axes and turn these on by the step's turn."""
    nf, nb = sums[_NF], sums[N_FIELD]
    for half in range(2):
        w, x, y, z = sums[4 * half], sums[4 * half + 1], sums[4 * half + 2], sums[4 * half + 3]
        r00, r01, r02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        r10, r11, r12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        r20, r21, r22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        for part in range(2 if nb > 0.0 else 1):
            source, target = (_F, _TF) if part == 0 else (FIELD, _TB)
            for j in range(3):
                v = sums[source + j]
                at = target + 27 * half + 9 * j
                sums[at] += r00 * v
                sums[at + 1] += r01 * v
                sums[at + 2] += r02 * v
                sums[at + 3] += r10 * v
                sums[at + 4] += r11 * v
                sums[at + 5] += r12 * v
                sums[at + 6] += r20 * v
                sums[at + 7] += r21 * v
                sums[at + 8] += r22 * v
    w, x, y, z = sums[8], sums[9], sums[10], sums[11]
    for part in range(2):
        source, target = (_F, _DF) if part == 0 else (FIELD, _DB)
        a, b, c = sums[source], sums[source + 1], sums[source + 2]
        t0, t1, t2 = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        sums[target] += a + w * t0 + y * t2 - z * t1
        sums[target + 1] += b + w * t1 + z * t0 - x * t2
        sums[target + 2] += c + w * t2 + x * t1 - y * t0
    if nf > 0.0 and nb > 0.0:
        for i in range(3):
            for j in range(3):
                sums[_C + 3 * i + j] += sums[_F + i] * sums[FIELD + j] / nb
        sums[_WC] += nf
    tx, ty, tz = sums[TURN], sums[TURN + 1], sums[TURN + 2]
    for k in range(3):
        sums[_RF + k] += sums[_F + k]
        sums[_RB + k] += sums[FIELD + k]
        sums[_RATE + k] += sums[TURN + k]
    angle2 = tx * tx + ty * ty + tz * tz
    sums[_PATH] += math.sqrt(angle2)
    for which in range(3):
        scale = 1.0 if which == 0 else (-1.0 if which == 1 else DEG)
        a2 = 0.25 * angle2 * scale * scale
        if a2 < 0.1:
            sine = 1.0 - a2 / 6.0 * (1.0 - a2 / 20.0 * (1.0 - a2 / 42.0))
            cosine = 1.0 - 0.5 * a2 * (1.0 - a2 / 12.0 * (1.0 - a2 / 30.0 * (1.0 - a2 / 56.0)))
        else:
            a = math.sqrt(a2)
            sine, cosine = math.sin(a) / a, math.cos(a)
        p, q, r = 0.5 * scale * sine * tx, 0.5 * scale * sine * ty, 0.5 * scale * sine * tz
        at = 4 * which
        w, x, y, z = sums[at], sums[at + 1], sums[at + 2], sums[at + 3]
        sums[at] = w * cosine - x * p - y * q - z * r
        sums[at + 1] = w * p + x * cosine + y * r - z * q
        sums[at + 2] = w * q - x * r + y * cosine + z * p
        sums[at + 3] = w * r + x * q - y * p + z * cosine
    for k in range(TURN, N_FIELD + 1):
        if k == _NF:
            sums[_WF] += nf
        elif k == N_FIELD:
            sums[_WB] += nb
        sums[k] = 0.0
    sums[SEEN_TURN] = sums[SEEN_TURN + 1] = 0.0


@compiled
def lengths(ways: Whole, sums: Array, field: bool, out: Array) -> int:
    """
    Squared length of the mean carried vector for each of the 48 ways, into out, shape (50,), in the sensor's unit.

    Behind them: [48] for gyros read as deg/s, [49] for a vector that is fixed in the tool. Returns the samples.
    """
    count = sums[_WB] if field else sums[_WF]
    start = _TB if field else _TF
    for k in range(50):
        out[k] = 0.0
    if count < 1.0:
        return 0
    for k in range(48):
        base = start + (0 if ways[k, 0] > 0 else 27)
        for a in range(3):
            total = 0.0
            for b in range(3):
                total += ways[k, 4 + b] * sums[base + 9 * ways[k, 1 + b] + 3 * a + b]
            out[k] += (total / count) ** 2
    for a in range(3):
        out[48] += (sums[(_DB if field else _DF) + a] / count) ** 2
        out[49] += (sums[(_RB if field else _RF) + a] / count) ** 2
    return int(count)


@compiled
def mark(sums: Array) -> None:
    """Mark the end of a part of the window: what its parts differ by is noise."""
    part = int(sums[_PARTS])
    if part < PARTS:
        for k in range(54):
            sums[_PART + 55 * part + k] = sums[_TF + k]
        sums[_PART + 55 * part + 54] = sums[_WF]
        sums[_PARTS] += 1.0


@compiled
def force_noise(ways: Whole, sums: Array, k: int) -> float:
    """
    1 sigma of the mean force carried along by way k, along one axis, in the accelerometer's unit; inf: not known.

    From what the means of the marked parts of the window differ by: what pushes for some seconds is noise too.
    """
    parts = int(sums[_PARTS])
    if parts < 2:
        return math.inf
    base = 0 if ways[k, 0] > 0 else 27
    square = 0.0
    for a in range(3):
        total, total2, before, count = 0.0, 0.0, 0.0, 0.0
        for part in range(parts):
            start = _PART + 55 * part
            there = 0.0
            for b in range(3):
                there += ways[k, 4 + b] * sums[start + base + 9 * ways[k, 1 + b] + 3 * a + b]
            n = sums[start + 54] - count
            if n < 1.0:
                return math.inf
            mean = (there - before) / n
            before, count = there, sums[start + 54]
            total += mean
            total2 += mean * mean
        square += max(total2 - total * total / parts, 0.0)
    return math.sqrt(square / (3.0 * (parts - 1) * parts))


@compiled
def mean_square(sums: Array, field: bool) -> float:
    """Mean squared magnitude of the vector in the window, in the sensor's unit squared."""
    count = sums[_WB] if field else sums[_WF]
    return float(sums[_B2 if field else _F2] / max(count, 1.0))


@compiled
def product(sums: Array, i: int, j: int) -> float:
    """Mean of force component i times field component j over the window; 0 without both."""
    return float(sums[_C + 3 * i + j] / max(sums[_WC], 1.0))


@compiled
def path(sums: Array) -> float:
    """Angle turned through in the window as the gyros tell it, rad."""
    return float(sums[_PATH])


@compiled
def turned(sums: Array, axis: int) -> float:
    """Sum of the turns about one axis, rad."""
    return float(sums[_RATE + axis])


@compiled
def mean_force(sums: Array, axis: int) -> float:
    """Mean specific force along one axis of the tool, in the sensor's unit."""
    return float(sums[_RF + axis] / max(sums[_WF], 1.0))
