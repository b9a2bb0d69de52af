"""
Spikes of a magnetometer: samples whose strength jumps away from those just before them, and comes back.

Turning the tool does not change the strength, so a running median of it tells a spike at once, without delay. Steel
that stays moves the median: after half the memory its samples count. What a turning tool with a biased magnetometer
shows is wider than that and widens the limit with it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

_MEMORY = 9  # samples whose median is compared with
_LEAST = 3e-6  # T, a smaller jump is never a spike
_SPREADS = 8.0  # of the median distance from the median
_GAP_NS = 10_000_000_000  # after a longer silence it begins anew


@dataclasses.dataclass
class State:
    """Strengths of the last samples, T, how many there are and where the next goes; stamp of the last."""

    strengths: Array
    counters: Stamps

    def copy(self) -> State:
        """Independent copy."""
        return State(self.strengths.copy(), self.counters.copy())


def initial() -> State:
    """State before the first sample."""
    return State(np.zeros(_MEMORY), np.zeros(3, dtype=np.int64))


def run(state: State, stamp_ns: Stamps, b_t: Array) -> NDArray[np.bool_]:
    """
    Which samples are no spikes.

    Parameters
    ----------
    state : State
        Changed in place; blocks of any length give the same answer.
    stamp_ns, b_t : ndarray, shapes (n,) and (n, 3)
        T, finite or not; a sample that is not finite is left to others and not remembered.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    sound = np.ones(len(stamp_ns), dtype=np.bool_)
    _run(state.strengths, state.counters, np.ascontiguousarray(stamp_ns), np.ascontiguousarray(b_t), sound)
    return sound


@compiled
def _median(values: Array, count: int, work: Array) -> float:
    """Of the first `count`, an odd number; `work` is written to."""
    for i in range(count):
        value, k = values[i], i
        while k > 0 and work[k - 1] > value:
            work[k] = work[k - 1]
            k -= 1
        work[k] = value
    return float(work[count // 2])


@compiled
def _run(strengths: Array, counters: Stamps, stamps: Stamps, b_t: Array, sound: NDArray[np.bool_]) -> None:
    work, away = np.empty(_MEMORY), np.empty(_MEMORY)
    for i in range(len(stamps)):
        strength = np.sqrt(b_t[i, 0] ** 2 + b_t[i, 1] ** 2 + b_t[i, 2] ** 2)
        if not np.isfinite(strength):
            continue
        if counters[0] > 0 and not 0 <= stamps[i] - counters[2] <= _GAP_NS:
            counters[0] = counters[1] = 0
        counters[2] = stamps[i]
        if counters[0] == _MEMORY:
            usual = _median(strengths, _MEMORY, work)
            for k in range(_MEMORY):
                away[k] = abs(strengths[k] - usual)
            sound[i] = abs(strength - usual) <= max(_LEAST, _SPREADS * _median(away, _MEMORY, work))
        strengths[counters[1]] = strength
        counters[1] = (counters[1] + 1) % _MEMORY
        counters[0] = min(counters[0] + 1, _MEMORY)
