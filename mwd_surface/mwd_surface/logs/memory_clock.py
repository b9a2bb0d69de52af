# SPDX-License-Identifier: Apache-2.0
"""
Offset and drift of the clock of a tool's memory relative to the clock of the run, from the recorded rotation.

The run has the speed of the top drive, the memory has the speed of the tool. The lag with the largest correlation of
the two is a first offset of the clocks, which may have any size. The offset is then refined to a fraction of a sample
at each start and stop of the rotation. A straight line through the refined offsets gives offset, drift and sigmas.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy import signal

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import NANOSECONDS

_COARSE_S = 0.5  # grid of the first search, s
_SMOOTH_S = 2.0  # length of the mean over both rotations before the refinement, s
_SPAN_S = 40.0  # length of the window around a change of the rotation in which the offset is refined, s
_LEAST_S = 4.0  # shortest time with data before and after a change, s
_FINE_S, _REACH_S = 0.02, 2.0  # step and largest correction of the refinement, s
# Lowest correlation of a match, and smallest difference from the correlation of any other match.
_LEAST_CORRELATION, _LEAST_LEAD = 0.85, 0.02
_APART_S = 20.0  # smallest distance of another match from the best offset, s
# Largest drift, s/s. Crystal clocks drift far less, so a larger drift means a wrong match.
_MOST_DRIFT = 2e-4


class ClockError(ValueError):
    """Raised if the clocks cannot be compared; the message gives the reason and the remedy."""


@dataclasses.dataclass(frozen=True)
class MemoryClock:
    """Clock of the memory: memory time is run time plus an offset that grows by the drift."""

    reference_ns: int  #: run time at which `offset_s` holds
    #: `offset_s`, `sigma_offset_s`: memory minus run at that time, and 1 sigma
    offset_s: float
    sigma_offset_s: float
    #: `drift`, `sigma_drift`: growth of the offset, s/s, and 1 sigma; both NaN with fewer than three changes of the
    #: rotation, because the scatter of the offsets is then unknown
    drift: float
    sigma_drift: float
    correlation: float  #: correlation of the rotary speeds of run and memory at the first offset
    changes: int  #: number of starts and stops of the rotation that were used

    def run_ns(self, memory_ns: int) -> int:
        """Return the time by the clock of the run for a stamp of the memory, ns."""
        ahead = memory_ns - self.reference_ns - round(self.offset_s * NANOSECONDS)
        drift = 0.0 if math.isnan(self.drift) else self.drift
        return self.reference_ns + round(ahead / (1.0 + drift))

    def __str__(self) -> str:
        """Return offset and drift with their sigmas, number of changes and correlation, as text for people."""
        drift = "drift not known (it needs three starts or stops)"
        if not math.isnan(self.drift):
            drift = f"drift {self.drift * 1e6:+.0f} ± {self.sigma_drift * 1e6:.0f} ppm"
        return (
            f"{self.offset_s:+.3f} ± {self.sigma_offset_s:.3f} s, {drift}, from {self.changes} starts and stops of the "
            f"rotation (correlation {self.correlation:.3f})"
        )


@dataclasses.dataclass(frozen=True)
class Rotation:
    """Rotary speed over time: increasing stamps, ns, and speed, rad/s, both of shape (n,)."""

    stamp_ns: Array
    speed: Array


def memory_clock(run: Rotation, memory: Rotation) -> MemoryClock:
    """
    Return offset and drift of the clock of a memory relative to the clock of the run.

    Raises
    ------
    ClockError
        There is no common rotation, or several offsets fit equally well.
    """
    for what, one in (("run", run), ("memory", memory)):
        if len(one.speed) < 2 or not np.ptp(one.speed) > 0.5:
            raise ClockError(f"the rotation does not change in the {what}, so the two clocks cannot be compared")
    origin = int(run.stamp_ns[0])
    run_s = (run.stamp_ns - origin) / NANOSECONDS
    memory_origin = int(memory.stamp_ns[0])
    memory_s = (memory.stamp_ns - memory_origin) / NANOSECONDS
    lag, correlation = _coarse(run_s, np.abs(run.speed), memory_s, np.abs(memory.speed))
    # lag: memory time minus run time, each counted from its own first stamp.
    changes = _refined(run_s, np.abs(run.speed), memory_s, np.abs(memory.speed), lag)
    if not changes:
        raise ClockError("no start or stop of the rotation is in both recordings, so the two clocks cannot be compared")
    at, offset = np.array(changes).T
    middle, mean = float(at.mean()), float(offset.mean())
    drift = sigma_drift = math.nan
    sigma = _FINE_S
    if len(at) >= 3 and np.ptp(at) > 0.0:
        spread = float(np.sum((at - middle) ** 2))
        drift = float(np.sum((at - middle) * (offset - mean)) / spread)
        scatter = float(np.sqrt(np.sum((offset - mean - drift * (at - middle)) ** 2) / (len(at) - 2)))
        # The scatter is at least a tenth of the step of the refinement; a few offsets may agree better by chance.
        scatter = math.hypot(scatter, 0.1 * _FINE_S)
        sigma, sigma_drift = scatter / math.sqrt(len(at)), scatter / math.sqrt(spread)
        if abs(drift) - 3.0 * sigma_drift > _MOST_DRIFT:
            raise ClockError(
                f"the clocks would drift by {drift * 1e6:.0f} ppm, more than the clock of any tool: check that both "
                "recordings are of the same run"
            )
    return MemoryClock(
        reference_ns=origin + round(middle * NANOSECONDS),
        offset_s=mean + (memory_origin - origin) / NANOSECONDS,
        sigma_offset_s=sigma,
        drift=drift,
        sigma_drift=sigma_drift,
        correlation=correlation,
        changes=len(at),
    )


def _coarse(run_s: Array, run: Array, memory_s: Array, memory: Array) -> tuple[float, float]:
    """
    Return the lag with the best correlation, s, and this correlation; half of the shorter series must overlap.

    Raises ClockError if the correlation is low, or if another lag has nearly the same correlation.
    """
    one = np.interp(np.arange(0.0, run_s[-1], _COARSE_S), run_s, run)
    two = np.interp(np.arange(0.0, memory_s[-1], _COARSE_S), memory_s, memory)

    def sums(a: Array, b: Array) -> Array:
        return np.asarray(signal.correlate(b, a, mode="full", method="fft"))

    ones, twos = np.ones_like(one), np.ones_like(two)
    count = np.maximum(np.round(sums(ones, twos)), 1.0)
    mean_1, mean_2 = sums(one, twos) / count, sums(ones, two) / count
    spread_1 = np.maximum(sums(one**2, twos) / count - mean_1**2, 0.0)
    spread_2 = np.maximum(sums(ones, two**2) / count - mean_2**2, 0.0)
    common = sums(one, two) / count - mean_1 * mean_2
    enough = (count >= 0.5 * min(len(one), len(two))) & (spread_1 > 1e-3) & (spread_2 > 1e-3)
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.where(enough, common / np.sqrt(spread_1 * spread_2), -1.0)
    best = int(np.argmax(score))
    others = np.abs(np.arange(len(score)) - best) * _COARSE_S > _APART_S
    second = float(score[others].max()) if others.any() else -1.0
    if score[best] < _LEAST_CORRELATION:
        raise ClockError(
            f"the rotations of run and memory do not agree (correlation {score[best]:.2f}): check that both "
            "recordings are of the same run"
        )
    if score[best] - second < _LEAST_LEAD:
        raise ClockError(
            "the rotation repeats itself, so that several offsets of the clocks fit equally well: give a longer part"
        )
    return (best - (len(one) - 1)) * _COARSE_S, float(score[best])


def _refined(run_s: Array, run: Array, memory_s: Array, memory: Array, lag: float) -> list[tuple[float, float]]:
    """
    Return the time of the run and the offset of the memory clock, s, at each start and stop of the rotation.

    A start or stop is left out if both recordings do not cover it, or if the offset there is far from `lag`, s.
    """
    found: list[tuple[float, float]] = []
    of_run, of_memory = _smoothed(run_s, run), _smoothed(memory_s, memory)
    room = _REACH_S + 0.5 * _SMOOTH_S
    covered = (run_s + lag - room >= memory_s[0]) & (run_s + lag + room <= memory_s[-1])
    covered &= (run_s >= run_s[0] + room) & (run_s <= run_s[-1] - room)
    turning = run > 0.5 * np.percentile(run, 90)
    edges = run_s[np.flatnonzero(np.diff(turning.astype(int))) + 1]
    for edge in edges[np.diff(np.concatenate([[-math.inf], edges])) > _SPAN_S]:
        part = covered & (np.abs(run_s - edge) <= 0.5 * _SPAN_S)
        at, value = run_s[part], of_run(run_s[part])
        # Both recordings must contain the change, and at least `_LEAST_S` before and after it.
        if len(at) < 10 or min(edge - at[0], at[-1] - edge) < _LEAST_S:
            continue
        shifts = np.arange(-_REACH_S, _REACH_S + 0.5 * _FINE_S, _FINE_S)
        costs = [float(np.mean((value - of_memory(at + lag + shift)) ** 2)) for shift in shifts]
        best = int(np.argmin(costs))
        if best in (0, len(costs) - 1):
            continue
        left, low, right = costs[best - 1 : best + 2]
        bend = left - 2.0 * low + right
        part_of = 0.5 * (left - right) / bend if bend > 0.0 else 0.0
        found.append((float(edge), lag + float(shifts[best]) + part_of * _FINE_S))
    return found


def _smoothed(time_s: Array, value: Array) -> Callable[[Array], Array]:
    """
    Return a function for the mean of a series over `_SMOOTH_S` around given times, s.

    Interpolated values without this mean have less noise midway between samples than at samples, so the best shift
    would be biased towards midway.
    """
    steps = 0.5 * (value[1:] + value[:-1]) * np.diff(time_s)
    area, half = np.concatenate([[0.0], np.cumsum(steps)]), 0.5 * _SMOOTH_S

    def mean(at: Array) -> Array:
        return np.asarray((np.interp(at + half, time_s, area) - np.interp(at - half, time_s, area)) / _SMOOTH_S)

    return mean
