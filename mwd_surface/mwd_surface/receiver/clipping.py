# SPDX-License-Identifier: Apache-2.0
"""
Samples at a limit of the gauge or its converter, replaced by the most probable pressure beyond the limit.

A clipped sample is a bound: the pressure was at the limit or beyond it. The samples of a block follow an autoregressive
model, and the clipped ones are those that make the block most probable without crossing the bound back (J. Tobin,
Econometrica 26 (1958) 24, for the bound; A. J. E. M. Janssen et al., IEEE Trans. ASSP 34 (1986) 317, for the
interpolation). Model and samples are estimated in turn. The blocks depend on the positions of the samples only.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.whitening import prediction_error_filter

# Samples of a block, and samples before it that belong to its model: 20 s and 10 s at 50 Hz.
_BLOCK, _BEFORE = 1024, 512
# The order covers a stroke of a pump: with 48 the error of the replaced samples is a quarter larger than with 80.
_ORDER, _FLOOR = 80, 1e-6
# A limit is known after this number of samples at it. A highest sample that noise reaches by chance does no harm,
# because the pressure there is near it.
_VISITS = 8
# A limit at less than this share of the largest value is the zero of a gauge while the pumps are off.
_ZERO = 0.05
# A longer run at a limit holds no sample of the pressure; it stays as it is.
_LONGEST = 150
# Rounds of model and samples, and of bounds that hold.
_ROUNDS, _BOUNDS = 3, 6


class Declipper:
    """Replacement of clipped samples in a stream; only samples from a clipped one to the end of its block are late."""

    def __init__(self) -> None:
        self._before = np.zeros(0)
        self._open = np.zeros((2, 0))
        self._sides = np.zeros(0)
        # Lowest and highest value, and how many samples have had it.
        self._limits = np.array([np.inf, 0.0, -np.inf, 0.0])

    def push(self, time: Array, value: Array) -> tuple[Array, Array]:
        """Add rising times, s, and samples, shape (n,); return those that are complete."""
        sides = np.empty(len(value))
        _mark(value, self._limits, sides)
        if not self._sides.size and not sides.any():
            self._before = np.concatenate([self._before, value[-_BEFORE:]])[-_BEFORE:]
            return time, value
        self._open = np.concatenate([self._open, np.stack([time, value])], axis=1)
        self._sides = np.concatenate([self._sides, sides])
        return self._released(_BLOCK)

    def finish(self) -> tuple[Array, Array]:
        """Return the samples that are left."""
        return self._released(0)

    def _released(self, block: int) -> tuple[Array, Array]:
        """Return what is complete: samples before a clipped one, and blocks of this length from a clipped one on."""
        count = self._open.shape[1]
        clipped = np.append(np.flatnonzero(self._sides), count)
        begin = 0
        while begin < count:
            first = int(clipped[np.searchsorted(clipped, begin)])
            if first == begin:
                if count - begin < block:
                    break
                first = min(begin + _BLOCK, count)
                self._replace(begin, first)
            self._before = np.concatenate([self._before, self._open[1, max(begin, first - _BEFORE) : first]])[-_BEFORE:]
            begin = first
        done, self._open, self._sides = self._open[:, :begin], self._open[:, begin:].copy(), self._sides[begin:].copy()
        return done[0], done[1]

    def _replace(self, begin: int, end: int) -> None:
        """Replace the clipped samples of a block."""
        start = len(self._before)
        value = np.concatenate([self._before, self._open[1, begin:end]])
        sides = np.concatenate([np.zeros(start), self._sides[begin:end]])
        self._open[1, begin:end] = unclipped(value, sides)[start:]


@compiled
def _mark(value: Array, limits: Array, sides: Array) -> None:
    """Fill the side of each sample: 1 at the upper limit, -1 at the lower, else 0; limits: as in `Declipper`."""
    for k in range(len(value)):
        sides[k] = 0.0
        for side in range(2):
            sign = 2.0 * side - 1.0
            if sign * value[k] > sign * limits[2 * side]:
                limits[2 * side], limits[2 * side + 1] = value[k], 0.0
            if value[k] == limits[2 * side]:
                limits[2 * side + 1] += 1.0
                zero = abs(value[k]) < _ZERO * max(abs(limits[0]), abs(limits[2]))
                if limits[2 * side + 1] > _VISITS and not zero:
                    sides[k] = sign


def unclipped(value: Array, sides: Array) -> Array:
    """
    Return samples in which the clipped ones have their most probable values.

    Parameters
    ----------
    value : ndarray, shape (n,)
    sides : ndarray, shape (n,)
        1 where the true value is the sample or more, -1 where it is the sample or less, else 0.
    """
    at = np.flatnonzero(_short(sides))
    out = value.copy()
    if not at.size or len(value) - at.size < 4 * _ORDER:
        return out
    taps, ones = np.empty(_ORDER + 2), np.ones(len(value))
    for _ in range(_ROUNDS):
        if prediction_error_filter(out, ones, _ORDER, _FLOOR, taps) <= 0.0:
            return value.copy()
        out[at] = _most_probable(out, value, sides, at, np.correlate(taps, taps, "full")[len(taps) - 1 :])
    return out


def _short(sides: Array) -> Array:
    """Return the sides without those of long runs."""
    ends = np.flatnonzero(np.diff(sides)) + 1
    out = sides.copy()
    for run in np.split(np.arange(len(sides)), ends):
        if len(run) > _LONGEST:
            out[run] = 0.0
    return out


def _most_probable(out: Array, value: Array, sides: Array, at: Indices, lags: Array) -> Array:
    """
    Return the samples at some places that make the prediction errors smallest within their bounds.

    out: all samples; value: the limits at those places; lags: autocorrelation of the prediction error filter.
    """
    free = np.ones(at.size, dtype=bool)
    best: Array = value[at].copy()
    kernel = np.concatenate([lags[:0:-1], lags])
    reach = len(lags) - 1
    for _ in range(_BOUNDS):
        rest = out.copy()
        rest[at] = best
        unknown = at[free]
        rest[unknown] = value[unknown]
        padded = np.pad(rest, reach, mode="edge")
        pull = np.convolve(padded, kernel, "valid")[unknown]
        # Only samples within reach of each other have a common prediction error.
        width = int((np.searchsorted(unknown, unknown + reach, side="right") - np.arange(unknown.size)).max())
        band = np.zeros((width, unknown.size))
        for k in range(len(band)):
            apart = unknown[k:] - unknown[: unknown.size - k]
            band[k, : apart.size] = np.where(apart <= reach, lags[np.minimum(apart, reach)], 0.0)
        band[0] *= 1.0 + 1e-9
        try:
            step = linalg.solveh_banded(band, -pull, lower=True, check_finite=False)
        except linalg.LinAlgError:
            # A signal without noise is predicted to the last digit, and the equations are singular.
            break
        best[free] = value[unknown] + step
        crossed = free & (sides[at] * (best - value[at]) < 0.0)
        best[crossed] = value[at[crossed]]
        free &= ~crossed
        if not crossed.any() or not free.any():
            break
    return best
