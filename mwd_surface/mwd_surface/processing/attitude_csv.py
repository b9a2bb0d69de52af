# SPDX-License-Identifier: Apache-2.0
"""
Attitude as CSV text, a million rows per second: fixed-point numbers written digit by digit, identical on every machine.

Angles have six decimals of a degree, gravity nine decimals; an unknown value is an empty cell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.status import words
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.compiled import compiled
from mwd_surface.signals.table import ATTITUDE

_ANGLES = tuple(column.key for _, column in ATTITUDE)
HEADER = ",".join(
    ("stamp_ns", *_ANGLES, *(f"sigma_{key}" for key in _ANGLES), "gravity_x", "gravity_y", "gravity_z", "status")
)
_DEG = 180.0 / math.pi
# Number of steps of the last decimal in 1 deg, and in a gravity component of 1.
_ANGLE_UNIT, _GRAVITY_UNIT = 10**6, 10**9
_TURN = 360 * _ANGLE_UNIT
# Largest length of a row without the status words: stamp with sign, angles and sigmas, three components, commas,
# newline.
_ROW_BYTES = 21 + 2 * len(_ANGLES) * 13 + 3 * 14 + 2
# ASCII codes of the digits of the numbers 0 to 9999, so that each division yields four digits.
_DIGITS = 48 + (np.arange(10000)[:, None] // np.array([1000, 100, 10, 1]) % 10).astype(np.uint8)


class CsvLines:
    """Formatter of CSV lines, block by block; the buffer is reused, so that a result is valid until the next call."""

    def __init__(self) -> None:
        self._buffer = np.empty(0, dtype=np.uint8)

    def __call__(self, attitude: Samples, gravity: Samples) -> memoryview:
        """
        Return the lines of n samples, without the header.

        Parameters
        ----------
        attitude, gravity : samples of `wire.ATTITUDE` and `wire.GRAVITY`, shape (n,)
            Samples of the same stamps. A NaN sigma means that the value is unknown.

        Raises
        ------
        ValueError
            `attitude` and `gravity` differ in length.
        """
        n = len(attitude)
        if len(gravity) != n:
            raise ValueError(f"gravity: expected {n} samples as attitude has, got {len(gravity)}")
        if n == 0:
            return memoryview(b"")
        status, index = _status_index(np.ascontiguousarray(attitude["status"]))
        texts = [words(int(mask)).encode() for mask in status]
        starts = np.cumsum([0, *(len(text) for text in texts)])
        text = np.frombuffer(b"".join(texts) or b"\0", dtype=np.uint8)
        room = n * (_ROW_BYTES + max(len(one) for one in texts))
        if len(self._buffer) < room:
            self._buffer = np.empty(room, dtype=np.uint8)
        fields = [signal.field for signal, _ in ATTITUDE]
        angles = np.column_stack([attitude[name] for name in (*fields, *(f"sigma_{one}" for one in fields))])
        wraps = np.array([*(signal.circle for signal, _ in ATTITUDE), *(False for _ in ATTITUDE)])
        end = _write(self._buffer, attitude["stamp_ns"], angles, wraps, gravity, index, text, starts)
        return memoryview(self._buffer)[:end]  # type: ignore[arg-type]


def _status_index(status: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Return the distinct status masks and the index of the mask of each row."""
    # The status rarely changes: search for distinct masks only in the rows where the mask changes.
    starts = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
    masks, which = np.unique(status[starts], return_inverse=True)
    return masks, np.repeat(which, np.diff(np.append(starts, len(status)))).astype(np.int64)


@compiled
def _four(buffer: NDArray[np.uint8], at: int, value: int) -> None:
    """Write the four digits of a number below 10 000, with leading zeros."""
    for k in range(4):
        buffer[at + k] = _DIGITS[value, k]


@compiled
def _whole(buffer: NDArray[np.uint8], at: int, value: int) -> int:
    """Write a non-negative integer; return the position after it."""
    groups, rest = 0, value
    while rest >= 10000:
        rest //= 10000
        groups += 1
    skip = 3 if rest < 10 else 2 if rest < 100 else 1 if rest < 1000 else 0
    for k in range(skip, 4):
        buffer[at + k - skip] = _DIGITS[rest, k]
    at += 4 - skip
    for k in range(groups - 1, -1, -1):
        rest = value // 10000
        _four(buffer, at + 4 * k, value - 10000 * rest)
        value = rest
    return at + 4 * groups


@compiled
def _angle(buffer: NDArray[np.uint8], at: int, value: float, known: bool, wraps: bool) -> int:
    """
    Write a comma and, if `known`, an angle, rad, in degrees with six decimals; return the position after it.

    If `wraps`, 360 deg becomes 0.
    """
    buffer[at] = 44
    if not known:
        return at + 1
    units = math.floor(value * _DEG * _ANGLE_UNIT + 0.5)
    if wraps and units == _TURN:
        units = 0
    at += 1
    if units < 0:
        buffer[at] = 45
        at += 1
        units = -units
    whole = units // _ANGLE_UNIT
    units -= whole * _ANGLE_UNIT
    at = _whole(buffer, at, whole)
    buffer[at] = 46
    high = units // 10000
    buffer[at + 1], buffer[at + 2] = _DIGITS[high, 2], _DIGITS[high, 3]
    _four(buffer, at + 3, units - 10000 * high)
    return at + 7


@compiled
def _component(buffer: NDArray[np.uint8], at: int, value: float) -> int:
    """Write a comma and a component of a unit vector with nine decimals; return the position after it."""
    buffer[at] = 44
    at += 1
    units = math.floor(value * _GRAVITY_UNIT + 0.5)
    if units < 0:
        buffer[at] = 45
        at += 1
        units = -units
    whole = units // _GRAVITY_UNIT
    units -= whole * _GRAVITY_UNIT
    at = _whole(buffer, at, whole)
    buffer[at] = 46
    high = units // 10000
    first = high // 10000
    buffer[at + 1] = 48 + first
    _four(buffer, at + 2, high - 10000 * first)
    _four(buffer, at + 6, units - 10000 * high)
    return at + 10


@compiled
def _write(
    buffer: NDArray[np.uint8],
    stamps: NDArray[np.int64],
    angles: NDArray[np.float64],
    wraps: NDArray[np.bool_],
    gravity: Samples,
    index: NDArray[np.int64],
    text: NDArray[np.uint8],
    starts: NDArray[np.int64],
) -> int:
    at, count = 0, angles.shape[1] // 2
    for i in range(len(stamps)):
        down, stamp = gravity[i], stamps[i]
        if stamp < 0:
            buffer[at] = 45  # minus sign
            at += 1
            stamp = -stamp
        at = _whole(buffer, at, stamp)
        # The sigmas follow the angles, in the same order.
        for j in range(angles.shape[1]):
            at = _angle(buffer, at, angles[i, j], not math.isnan(angles[i, count + j % count]), wraps[j])
        known = not math.isnan(down["sigma"])
        vector = down["gravity"]
        for c in range(3):
            if known:
                at = _component(buffer, at, vector[c])
            else:
                buffer[at] = 44
                at += 1
        buffer[at] = 44
        at += 1
        for j in range(starts[index[i]], starts[index[i] + 1]):
            buffer[at] = text[j]
            at += 1
        buffer[at] = 10
        at += 1
    return at
