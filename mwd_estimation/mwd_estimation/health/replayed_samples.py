# SPDX-License-Identifier: Apache-2.0
"""
Detect samples that were sent before and come again with new stamps, for example if a link sends its buffer twice.

The noise of real sensors never repeats: a row of four samples, 24 numbers, occurs only once. A 64-bit hash is kept of
every eighth row on average. The hash itself selects these rows, so that a repetition is found wherever it begins. If
most selected rows of a half second were kept before, the data of the half second are old. Hash: Fibonacci hashing, D.
E. Knuth, *The Art of Computer Programming* 3, 6.4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING, observe
from mwd_estimation.health.motion_window import Samples
from mwd_sensors.core.compiled import compiled

# Number of samples in a row; and number of hashes kept, which last eleven hours at 100 Hz.
_ROW, _SLOTS = 4, 1 << 19
_ZERO, _ONE, _FACTOR = np.uint64(0), np.uint64(1), np.uint64(0x9E3779B97F4A7C15)
_SHIFT, _CHOSEN, _MASK = np.uint64(29), np.uint64(7), np.uint64(_SLOTS - 1)
# Smallest number and smallest share of old rows in a half second with replayed samples.
_LEAST, _SHARE = 2, 0.5


def blank() -> Any:
    """Return an empty table of hashes, shape (slots,), uint64."""
    return np.zeros(_SLOTS, dtype=np.uint64)


@compiled
def _hash(gyro: Any, accel: Any, i: int) -> Any:
    """Return the hash of the bits of a sample; gyro, accel, shape (n, 3), uint64."""
    found = _ONE
    for c in range(3):
        found = (found ^ gyro[i, c]) * _FACTOR
        found ^= found >> _SHIFT
        found = (found ^ accel[i, c]) * _FACTOR
        found ^= found >> _SHIFT
    return found


@compiled
def judge_replay(kept: Any, checks: Any, samples: Samples, first: int, stop: int, began: int) -> None:
    """
    Check the samples of half a second, and keep the hashes of their rows.

    kept: result of `blank`; first, stop: the samples have the indices `first` to `stop` - 1; began: start of the half
    second, ns.
    """
    gyro, accel = samples.gyro.view(np.uint64), samples.accel.view(np.uint64)
    rows, old, length = 0, 0, 0
    h0, h1, h2, h3 = _ZERO, _ZERO, _ZERO, _ZERO
    # Skip a sample that is repeated with its own stamp: no stage uses it.
    newest = began - 1
    for i in range(first, stop):
        if samples.stamps[i] <= newest:
            continue
        newest = samples.stamps[i]
        h0, h1, h2, h3 = h1, h2, h3, _hash(gyro, accel, i)
        # Skip rows of a sensor that repeats one value: another check finds this fault.
        length = 1 if h3 == h2 else length + 1
        row = ((h0 * _FACTOR ^ h1) * _FACTOR ^ h2) * _FACTOR ^ h3
        if length < _ROW or row & _CHOSEN != _ZERO:
            continue
        slot = (row >> _SHIFT) & _MASK
        rows += 1
        old += int(kept[slot] == row)
        kept[slot] = row
    seen = AGAINST if rows > 0 and old == 0 else NOTHING
    if old >= _LEAST and old > _SHARE * rows:
        seen = FOR
    observe(checks[FaultCode.REPLAYED.value, 0], seen, began, old / max(rows, 1), _SHARE)
