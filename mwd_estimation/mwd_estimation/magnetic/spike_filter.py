# SPDX-License-Identifier: Apache-2.0
"""
Find spikes of a magnetometer: samples whose field strength is far from the median strength of the preceding samples.

Rotation of the tool does not change the strength, so the running median shows a spike at once. Lasting external
interference changes the median and is accepted after half the samples of the median. The readings of a rotating tool
with a biased magnetometer vary more, and this variation widens the limit.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_MEMORY = 9  # number of samples in the median
_MIN_JUMP = 3e-6  # smallest jump that can be a spike, T
_SPREADS = 8.0  # limit as a multiple of the median absolute deviation from the median
_GAP_NS = 10_000_000_000  # data gap after which the filter restarts, ns


class SpikeState:
    """State of the spike filter."""

    strengths: Annotated[Array, _MEMORY]  #: strengths of the last samples, T, in a ring
    count: int  #: number of stored strengths
    next: int  #: ring index of the next strength
    last_ns: int  #: stamp of the last sample, ns


STATE = dtype_of(SpikeState)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    return np.zeros(1, dtype=STATE)


def run(state: Samples, stamp_ns: Stamps, b_t: Array) -> NDArray[np.bool_]:
    """
    Return a mask of the samples that are not spikes; the first 9 samples after a start or a gap are not checked.

    Parameters
    ----------
    state : ndarray, shape (1,)
        State from `initial`, changed in place; the result does not depend on how the samples are cut into blocks.
    stamp_ns, b_t : ndarray, shapes (n,) and (n, 3)
        Stamps, ns, and field, T; samples that are not finite are not spikes: other checks find them.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    sound = np.ones(len(stamp_ns), dtype=np.bool_)
    _run(state, np.ascontiguousarray(stamp_ns), np.ascontiguousarray(b_t), sound)
    return sound


@compiled
def _median(values: Array, work: Array) -> float:
    """Return the median of an odd number of values; `work` is overwritten."""
    for i in range(len(values)):
        value, k = values[i], i
        while k > 0 and work[k - 1] > value:
            work[k] = work[k - 1]
            k -= 1
        work[k] = value
    return float(work[len(values) // 2])


@compiled
def _run(state: Samples, stamps: Stamps, b_t: Array, sound: NDArray[np.bool_]) -> None:
    s: SpikeState = state[0]
    work, away = np.empty(_MEMORY), np.empty(_MEMORY)
    for i in range(len(stamps)):
        strength = np.sqrt(b_t[i, 0] ** 2 + b_t[i, 1] ** 2 + b_t[i, 2] ** 2)
        if not np.isfinite(strength):
            continue
        if s.count > 0 and not 0 <= stamps[i] - s.last_ns <= _GAP_NS:
            s.count = s.next = 0
        s.last_ns = stamps[i]
        if s.count == _MEMORY:
            usual = _median(s.strengths, work)
            for k in range(_MEMORY):
                away[k] = abs(s.strengths[k] - usual)
            sound[i] = abs(strength - usual) <= max(_MIN_JUMP, _SPREADS * _median(away, work))
        s.strengths[s.next] = strength
        s.next = (s.next + 1) % _MEMORY
        s.count = min(s.count + 1, _MEMORY)
