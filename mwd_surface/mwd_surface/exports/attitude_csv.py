"""
Attitude as CSV text, a million rows a second: fixed-point numbers written digit by digit, the same bytes everywhere.

Angles have six decimals of a degree, gravity nine decimals; what is unknown is an empty cell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.status import words
from mwd_sensors import wire
from mwd_sensors.compiled import compiled

Array = NDArray[np.float64]

HEADER = (
    "stamp_ns,inclination_deg,azimuth_deg,toolface_deg,sigma_inclination_deg,sigma_azimuth_deg,sigma_toolface_deg,"
    "gravity_x,gravity_y,gravity_z,status"
)
_DEG = 180.0 / math.pi
# Numbers are counted in these parts of a degree and of one: six and nine decimals.
_ANGLE_UNIT, _GRAVITY_UNIT = 10**6, 10**9
_TURN = 360 * _ANGLE_UNIT
# Stamp with sign, six angles, three components, commas and the end of the line; words come on top.
_ROW_BYTES = 21 + 6 * 13 + 3 * 14 + 2
# An unknown number.
_NONE = -(2**62)
# The digits of 0 to 9999: a division gives four of them.
_DIGITS = 48 + (np.arange(10000)[:, None] // np.array([1000, 100, 10, 1]) % 10).astype(np.uint8)


def rows(attitude: wire.Samples, gravity: wire.Samples) -> bytes:
    """
    Lines of n samples, without the header.

    Parameters
    ----------
    attitude, gravity : samples of `wire.ATTITUDE` and `wire.GRAVITY`, shape (n,)
        Of the same stamps. A negative sigma says that its value is unknown.

    Raises
    ------
    ValueError
        The two are not of the same length.
    """
    n = len(attitude)
    if len(gravity) != n:
        raise ValueError(f"gravity: expected {n} samples as attitude has, got {len(gravity)}")
    if n == 0:
        return b""
    cells = np.empty((n, 9), dtype=np.int64)
    for k, (name, sigma) in enumerate(
        (
            ("inclination", "sigma_inclination"),
            ("azimuth", "sigma_azimuth"),
            ("gravity_toolface", "sigma_gravity_toolface"),
        )
    ):
        value, one_sigma = np.ascontiguousarray(attitude[name]), np.ascontiguousarray(attitude[sigma])
        known = one_sigma >= 0.0
        cells[:, k] = _fixed(value * _DEG, _ANGLE_UNIT, known)
        cells[:, 3 + k] = _fixed(one_sigma * _DEG, _ANGLE_UNIT, known)
        if k > 0:
            # What rounds up to the full circle is north again.
            cells[:, k][cells[:, k] == _TURN] = 0
    known = np.ascontiguousarray(gravity["sigma"]) >= 0.0
    cells[:, 6:] = _fixed(gravity["gravity"], _GRAVITY_UNIT, known[:, None])
    status, index = _status_index(np.ascontiguousarray(attitude["status"]))
    texts = [words(int(mask)).encode() for mask in status]
    starts = np.cumsum([0, *(len(text) for text in texts)])
    text = np.frombuffer(b"".join(texts) or b"\0", dtype=np.uint8)
    longest = max(len(one) for one in texts)
    buffer = np.empty(n * (_ROW_BYTES + longest), dtype=np.uint8)
    end = _write(buffer, np.ascontiguousarray(attitude["stamp_ns"]), cells, index, text, starts)
    return buffer[:end].tobytes()


def _fixed(value: Array, unit: int, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    return np.where(known, np.floor(np.where(known, value, 0.0) * unit + 0.5), _NONE).astype(np.int64)


def _status_index(status: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Masks that occur, and which of them each row has."""
    # Status changes seldom: look only at the places where it does.
    starts = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
    masks, which = np.unique(status[starts], return_inverse=True)
    return masks, np.repeat(which, np.diff(np.append(starts, len(status)))).astype(np.int64)


@compiled
def _four(buffer: NDArray[np.uint8], at: int, value: int) -> None:
    """Four digits of a number below 10 000, with leading zeros."""
    for k in range(4):
        buffer[at + k] = _DIGITS[value, k]


@compiled
def _whole(buffer: NDArray[np.uint8], at: int, value: int) -> int:
    """A whole number that is not negative; returns the place after it."""
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
def _write(
    buffer: NDArray[np.uint8],
    stamps: NDArray[np.int64],
    cells: NDArray[np.int64],
    index: NDArray[np.int64],
    text: NDArray[np.uint8],
    starts: NDArray[np.int64],
) -> int:
    at = 0
    for i in range(len(stamps)):
        value = stamps[i]
        if value < 0:
            buffer[at] = 45  # minus
            at += 1
            value = -value
        at = _whole(buffer, at, value)
        for k in range(9):
            buffer[at] = 44  # comma
            at += 1
            value = cells[i, k]
            if value == _NONE:
                continue
            if value < 0:
                buffer[at] = 45
                at += 1
                value = -value
            unit = _ANGLE_UNIT if k < 6 else _GRAVITY_UNIT
            whole = value // unit
            value -= whole * unit
            at = _whole(buffer, at, whole)
            buffer[at] = 46  # point
            high, low = value // 10000, value % 10000
            if k < 6:
                buffer[at + 1], buffer[at + 2] = _DIGITS[high, 2], _DIGITS[high, 3]
                _four(buffer, at + 3, low)
                at += 7
            else:
                first, middle = high // 10000, high % 10000
                buffer[at + 1] = 48 + first
                _four(buffer, at + 2, middle)
                _four(buffer, at + 6, low)
                at += 10
        buffer[at] = 44
        at += 1
        for j in range(starts[index[i]], starts[index[i] + 1]):
            buffer[at] = text[j]
            at += 1
        buffer[at] = 10
        at += 1
    return at
