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
_ANGLE_DECIMALS, _GRAVITY_DECIMALS = 6, 9
# Number of steps of the last decimal in 1 deg, and in a gravity component of 1.
_ANGLE_UNIT, _GRAVITY_UNIT = 10**_ANGLE_DECIMALS, 10**_GRAVITY_DECIMALS
_TURN = 360 * _ANGLE_UNIT
# Largest length of a row without the status words: stamp with sign, angles and sigmas, three components, commas,
# newline.
_ROW_BYTES = 21 + 2 * len(_ANGLES) * 13 + 3 * 14 + 2
# ASCII codes.
_COMMA, _MINUS, _POINT, _ZERO, _NEWLINE = 44, 45, 46, 48, 10


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
def _number(buffer: NDArray[np.uint8], at: int, units: int, decimals: int) -> int:
    """Write a number, given in units of its last decimal; return the position after it."""
    if units < 0:
        buffer[at] = _MINUS
        at += 1
        units = -units
    digits, power, rest = decimals + 1, 10**decimals, units // 10
    while rest >= power:
        digits += 1
        power *= 10
    end = at + digits + (1 if decimals > 0 else 0)
    point = end - 1 - decimals if decimals > 0 else -1
    for k in range(end - 1, at - 1, -1):
        if k == point:
            buffer[k] = _POINT
        else:
            rest = units // 10
            buffer[k] = _ZERO + units - 10 * rest
            units = rest
    return end


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
        at = _number(buffer, at, stamps[i], 0)
        # The sigmas follow the angles, in the same order.
        for j in range(angles.shape[1]):
            buffer[at] = _COMMA
            at += 1
            if not math.isnan(angles[i, count + j % count]):
                units = math.floor(angles[i, j] * _DEG * _ANGLE_UNIT + 0.5)
                at = _number(buffer, at, 0 if wraps[j] and units == _TURN else units, _ANGLE_DECIMALS)
        known, vector = not math.isnan(gravity[i]["sigma"]), gravity[i]["gravity"]
        for c in range(3):
            buffer[at] = _COMMA
            at += 1
            if known:
                at = _number(buffer, at, math.floor(vector[c] * _GRAVITY_UNIT + 0.5), _GRAVITY_DECIMALS)
        buffer[at] = _COMMA
        at += 1
        for j in range(starts[index[i]], starts[index[i] + 1]):
            buffer[at] = text[j]
            at += 1
        buffer[at] = _NEWLINE
        at += 1
    return at
