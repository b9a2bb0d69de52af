# SPDX-License-Identifier: Apache-2.0
"""
Resampling onto an even grid from samples of any rate, jitter and gaps; every bit is the same however samples are cut.

Clipped samples are first replaced (`clipping`). A single sample far from its neighbours (an electrical spike) is
replaced by a value interpolated from the neighbours, because the filter would spread the spike. Each value of the grid
is the mean of the samples around it, weighted by a low-pass kernel and by the time that each sample represents. Samples
much denser than the grid are averaged in bins first. The grid starts at the first stamp.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.clipping import Declipper

# Half width of the kernel and its cut-off, in steps of the grid. With 8 steps per TU, 0.2 / step is 1.6 / TU; a pulse
# of 2 TU has 2 % of its energy above this frequency.
_HALF_STEPS = 10.0
_CUT_OFF = 0.2
# _SPIKE: smallest deviation of a spike from the interpolation, in usual deviations. _SPIKE_SHARES: range of the
# opposite deviation of its neighbours, as a share of the spike; their interpolation contains two thirds of the spike.
# The neighbours of a steep pulse deviate in the direction of the pulse.
_SPIKE, _SPIKE_SHARES = 8.0, (0.4, 0.9)
# Number of samples over which the usual deviation is averaged, and largest deviation that enters the average, in usual
# deviations.
_SCALE_SAMPLES, _MOST_GROWTH = 64.0, 8.0
_AROUND = 3  # samples on either side that are examined
LARGEST = 1e9  # largest valid value: Pa, or V for an antenna
# Ratio of the input rate to the grid's above which samples are averaged in bins.
_MOST_OVERSAMPLED = 6.0


@compiled
def _kernel(u: float) -> float:
    """Return the windowed sinc at u steps from its middle."""
    if abs(u) >= _HALF_STEPS:
        return 0.0
    a = 2.0 * math.pi * _CUT_OFF * u
    sinc = 1.0 if a == 0.0 else math.sin(a) / a
    c = math.cos(0.5 * math.pi * u / _HALF_STEPS)
    return sinc * c * c


@compiled
def _average(time: Array, value: Array, at: Array, step: float, gap: float, out: Array, known: Array) -> None:
    """
    Fill the values of the grid at times `at`, s, and 1 where a value is known.

    Both are 0 where samples cover less than half of the kernel, or where the nearest sample is farther than `gap`, s.
    """
    first = 0
    half = _HALF_STEPS * step
    for k in range(len(at)):
        while first < len(time) and time[first] < at[k] - half:
            first += 1
        total = weight = 0.0
        nearest = half
        j = max(first, 1)
        while j < len(time) - 1 and time[j] <= at[k] + half:
            span = 0.5 * min(time[j + 1] - time[j], gap) + 0.5 * min(time[j] - time[j - 1], gap)
            c = _kernel((time[j] - at[k]) / step) * span
            total += c * value[j]
            weight += c
            nearest = min(nearest, abs(time[j] - at[k]))
            j += 1
        # The area of the kernel is 1 / (2 cut-off) steps.
        enough = weight > 0.25 * step / _CUT_OFF and nearest <= gap
        known[k] = 1.0 if enough else 0.0
        out[k] = total / weight if enough else 0.0


class Resampler:
    """
    Converter from a stream of samples to an even grid.

    Parameters
    ----------
    step : float
        Step of the grid, s.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        self._time = np.zeros(0)
        self._value = np.zeros(0)
        self._made = 0
        self._spacing = 0.0
        self._bin = 0.0
        # Times and values until the spacing is known; an array, because the first block may be a whole file.
        self._early = np.zeros((2, 0))
        self._bin_sum = np.zeros(4)
        self._raw = np.zeros((2, 0))
        self._last = -math.inf
        self._scale = np.zeros(1)
        self._declipper: Declipper | None = None
        self.origin: float | None = None

    @property
    def spacing(self) -> float:
        """Median time between the first samples, s; 0 until there are enough samples."""
        return self._spacing

    def push(self, time: Array, value: Array) -> tuple[Array, Array]:
        """
        Add samples and return the values of the grid that they complete.

        Parameters
        ----------
        time, value : ndarray, shape (n,)
            Rising times, s, and samples. Samples with a time that does not rise, or with a value that is not finite or
            beyond any gauge, are dropped.

        Returns
        -------
        ndarray, shape (m,)
            Values of the grid; 0 in a gap.
        ndarray, shape (m,)
            1 where a value is known, 0 in a gap.
        """
        self._resample(np.asarray(time, dtype=float), np.asarray(value, dtype=float))
        if self._spacing == 0.0 or len(self._time) < 3:
            return np.zeros(0), np.zeros(0)
        return self._until(self._time[-2] - _HALF_STEPS * self._step)

    def finish(self) -> tuple[Array, Array]:
        """Return the values of the grid that `push` has not returned, up to the end of the samples, as `push` does."""
        if self._spacing == 0.0 and self._early.shape[1] > 2:
            self._begin()
        if self._declipper is not None:
            self._binned(*self._declipper.finish())
        self._add(*self._raw[:, self._ready :])
        if len(self._time) < 3:
            return np.zeros(0), np.zeros(0)
        return self._until(self._time[-2])

    def _until(self, end: float) -> tuple[Array, Array]:
        origin = self.origin or 0.0
        count = max(math.floor((end - origin) / self._step) + 1 - self._made, 0)
        at: Array = origin + (self._made + np.arange(count, dtype=np.float64)) * self._step
        out, known = np.zeros(count), np.zeros(count)
        if count:
            gap = max(4.0 * max(self._spacing, self._bin), self._step)
            _average(self._time, self._value, at, self._step, gap, out, known)
            self._made += count
            # Keep two more samples than the next value needs: their spacing is part of its weights.
            keep = max(int(np.searchsorted(self._time, at[-1] - _HALF_STEPS * self._step)) - 2, 0)
            self._time, self._value = self._time[keep:], self._value[keep:]
        return out, known

    def _resample(self, time: Array, value: Array) -> None:
        # Drop values that no gauge can measure: their squares would reduce the precision of the values around them.
        good = (np.abs(value) < LARGEST) & np.isfinite(time)
        highest = np.maximum.accumulate(np.append(self._last, np.where(good, time, -math.inf)))
        good &= time > highest[:-1]
        self._last = float(highest[-1])
        if self._declipper is not None:
            self._binned(*self._declipper.push(time[good], value[good]))
            return
        self._early = np.concatenate([self._early, np.stack([time[good], value[good]])], axis=1)
        if self._early.shape[1] >= 64:
            self._begin()

    def _begin(self) -> None:
        (time, value), self._early = self._early, np.zeros((2, 0))
        self._spacing = float(np.median(np.diff(time[:64])))
        self._bin = self._step / 4.0 if self._spacing * _MOST_OVERSAMPLED < self._step else 0.0
        self.origin = float(time[0])
        self._declipper = Declipper(self._spacing)
        self._binned(*self._declipper.push(time, value))

    def _binned(self, time: Array, value: Array) -> None:
        self._raw = np.concatenate([self._raw, np.stack([time, value])], axis=1)
        if self._raw.shape[1] > 2 * _AROUND:
            despiked = self._raw[1].copy()
            _despike(self._raw[1], self._scale, despiked)
            begin = self._ready
            self._add(self._raw[0, begin:-_AROUND], despiked[begin:-_AROUND])
            self._raw = self._raw[:, -2 * _AROUND :]

    @property
    def _ready(self) -> int:
        """Index of the first sample not yet resampled; the very first ones have no neighbours and are not despiked."""
        return 0 if len(self._time) == 0 and self._bin_sum[2] == 0.0 else _AROUND

    def _add(self, time: Array, value: Array) -> None:
        if self._bin > 0.0 and len(time):
            time, value = self._means(time, value)
        self._time, self._value = np.concatenate([self._time, time]), np.concatenate([self._value, value])

    def _means(self, time: Array, value: Array) -> tuple[Array, Array]:
        """Return mean time and value of each complete bin; the sums of the open bin are carried on."""
        out_time, out_value = np.zeros(len(time) + 1), np.zeros(len(time) + 1)
        made = _bin_means(time, value, (self.origin or 0.0, self._bin), self._bin_sum, out_time, out_value)
        return out_time[:made], out_value[:made]


@compiled
def _despike(value: Array, scale: Array, out: Array) -> None:
    """
    Replace spikes by the cubic through their four neighbours.

    Parameters
    ----------
    value : ndarray, shape (n,)
        Samples; the first and last three only serve as neighbours.
    scale : ndarray, shape (1,)
        Usual deviation of a sample from the cubic through its neighbours, updated here.
    out : ndarray, shape (n,)
        Samples, changed where there is a spike.
    """
    for j in range(_AROUND, len(value) - _AROUND):
        off = _deviation(value, j)
        usual = max(scale[0], 1e-6 * abs(value[j - 1]))
        if abs(off) > _SPIKE * usual:
            before, after = -_deviation(value, j - 1) / off, -_deviation(value, j + 1) / off
            low, high = _SPIKE_SHARES
            if low < before < high and low < after < high:
                out[j] = value[j] - off
        scale[0] += (min(abs(off), _MOST_GROWTH * usual) - scale[0]) / _SCALE_SAMPLES


@compiled
def _deviation(value: Array, j: int) -> float:
    """Return the deviation of a sample from the cubic through its four neighbours."""
    return float(value[j] - (4.0 * (value[j - 1] + value[j + 1]) - value[j - 2] - value[j + 2]) / 6.0)


@compiled
def _bin_means(
    time: Array, value: Array, bins: tuple[float, float], carried: Array, out_time: Array, out_value: Array
) -> int:
    """Fill the means of complete bins, return their number; carried: sums, count and index of the open bin."""
    origin, width = bins
    made = 0
    for k in range(len(time)):
        at = math.floor((time[k] - origin) / width)
        if at != carried[3] and carried[2] > 0.0:
            out_time[made] = carried[0] / carried[2]
            out_value[made] = carried[1] / carried[2]
            made += 1
            carried[:3] = 0.0
        carried[3] = at
        carried[0] += time[k]
        carried[1] += value[k]
        carried[2] += 1.0
    return made


@compiled
def interpolate(grid: Array, first: float, spacing: float, out: Array) -> None:
    """
    Interpolate an even grid by a polynomial through six neighbours (Lagrange).

    Parameters
    ----------
    grid : ndarray, shape (n,)
    first, spacing : float
        Position of the first value wanted, and the distance between values, in steps of the grid.
    out : ndarray, shape (m,)
        Interpolated values; beyond the ends of the grid the end value is used.
    """
    for k in range(len(out)):
        at = first + k * spacing
        base = math.floor(at)
        u = at - base
        a, b, c, d, e, f = u + 2.0, u + 1.0, u, u - 1.0, u - 2.0, u - 3.0
        weights = (
            -b * c * d * e * f / 120.0,
            a * c * d * e * f / 24.0,
            -a * b * d * e * f / 12.0,
            a * b * c * e * f / 12.0,
            -a * b * c * d * f / 24.0,
            a * b * c * d * e / 120.0,
        )
        total = 0.0
        for j in range(6):
            total += weights[j] * grid[min(max(base - 2 + j, 0), len(grid) - 1)]
        out[k] = total
