# SPDX-License-Identifier: Apache-2.0
"""
Samples at a limit of the gauge or its converter, replaced by the most probable pressure beyond the limit.

A clipped sample is a bound: the pressure was at the limit or beyond it. The samples of some seconds are modelled as an
autoregressive process. The clipped samples get the values, at or beyond the limit, that make these seconds most
probable (J. Tobin, Econometrica 26 (1958) 24, for the bound; A. J. E. M. Janssen et al., IEEE Trans. ASSP 34 (1986)
317, for the interpolation). Model and samples are estimated in turn. A limit is a value that occurs often and is hardly
ever exceeded. Lengths that belong to the signal are in s; lengths that belong to the estimate of the model are numbers
of samples. After a gap in the times a new model begins.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_surface.receiver.whitening import prediction_error_filter

# The clipped samples of a block of `_BLOCK_S`, s, are replaced together, after another `_AHEAD_S`, s, because a crest
# needs both of its flanks: without this time the error is three times larger, and with 2 s it is a fifth larger at 10
# Hz. `_EACH`: number of samples before the block that are used for each coefficient of the model. `_MOST`: largest
# number of samples in one estimate, to limit the computing time.
_BLOCK_S, _AHEAD_S, _EACH, _MOST = 5.0, 4.0, 20, 2048
# The order of the model covers a stroke of a pump (`_ORDER_S`, s), up to 80 samples: with 48 at 50 Hz the error of the
# replaced samples is a quarter larger. At a low rate the model still needs two coefficients for each line of the pumps,
# even if the line is aliased: with 16 at 10 Hz the error is a third larger, with 8 at 5 Hz twice as large. `_FLOOR`:
# white noise added to the model, as a share of its variance.
_ORDER_S, _LEAST_ORDER, _MOST_ORDER, _FLOOR = 1.6, 24, 80, 1e-6
# A value counts as a limit if more than `_VISITS` samples have exactly this value, and more than `_EXCEEDED` times as
# many as lie beyond the value. A value that noise reaches repeatedly by chance does no harm: the replaced samples then
# stay near their true pressure.
_VISITS, _EXCEEDED = 8.0, 8.0
# Number of extreme values whose samples are counted, and time constant, s, with which the counts decay: longer than a
# connection of drill pipe, so that the limit is still known after the connection.
_LEVELS, _FORGOTTEN_S = 8, 1800.0
# A limit below this share of the largest value is ignored: it is the reading without pressure, while the pumps are off.
_ZERO = 0.05
# Longest run of samples at a limit, s, that is replaced; a longer run contains no information about the pressure.
_LONGEST_S = 3.0
# An interval between two samples counts as a gap if it is more than this number of times the usual interval.
_GAP = 4.0
# Number of iterations over model and samples, and over the samples that are at their bounds.
_ROUNDS, _BOUNDS = 3, 6


class Declipper:
    """
    Replacement of clipped samples in a stream; only samples from a clipped one to the end of its block are delayed.

    Parameters
    ----------
    spacing : float
        Usual time between samples, s.
    """

    def __init__(self, spacing: float) -> None:
        self._spacing = spacing
        self._order = min(max(math.ceil(_ORDER_S / spacing), _LEAST_ORDER), _MOST_ORDER)
        self._longest = math.ceil(_LONGEST_S / spacing)
        self._history = _EACH * self._order
        share = min(1.0, (_MOST - self._history) * spacing / (_BLOCK_S + _AHEAD_S))
        self._block_s, self._ahead_s = share * _BLOCK_S, share * _AHEAD_S
        # Last returned samples and their sides (see `_mark`); clipped ones among them are estimated again with each
        # block.
        self._before = np.zeros((2, 0))
        self._last_s = -math.inf
        # Times, samples and sides of the samples that are not yet returned.
        self._open = np.zeros((3, 0))
        # Extreme values of both sides, outermost first, with the number of samples at and beyond each value.
        self._levels = np.zeros((2, _LEVELS, 3))
        self._levels[:, :, 0] = -np.inf

    def push(self, time: Array, value: Array) -> tuple[Array, Array]:
        """Add rising times, s, and samples, shape (n,); return the times and samples that are now final."""
        more = np.stack([time, value, np.zeros(len(value))])
        _mark(more[1], self._levels, math.exp(-self._spacing / _FORGOTTEN_S), more[2])
        self._open = np.concatenate([self._open, more], axis=1) if self._open.size else more
        return self._released(False)

    def finish(self) -> tuple[Array, Array]:
        """Return the times, s, and samples that are left at the end."""
        return self._released(True)

    def _released(self, finished: bool) -> tuple[Array, Array]:
        """
        Return and remove the times and samples that are final.

        Final are the samples before a clipped one, and a block from a clipped sample on if the samples after the block
        suffice; all samples if `finished`.
        """
        time, value, sides = self._open
        count, done = len(time), value.copy() if sides.any() else value
        gaps = np.append(np.flatnonzero(np.diff(time, prepend=self._last_s) > _GAP * self._spacing), count)
        clipped = np.append(np.flatnonzero(sides), count)
        begin = 0
        while begin < count:
            if gaps[0] == begin:
                self._before, gaps = np.zeros((2, 0)), gaps[1:]
            after = int(gaps[0])
            end = min(after, int(clipped[np.searchsorted(clipped, begin)]))
            if end == begin:
                stops = np.searchsorted(time, time[begin] + np.cumsum([self._block_s, self._ahead_s]))
                if stops[1] == after == count and not finished:
                    break
                end, known = np.minimum(stops, after).tolist()
                seen, bounds = np.concatenate([self._before, self._open[1:, begin:known]], axis=1)
                replaced = unclipped(seen, _short(bounds, self._longest), self._order)
                done[begin:end] = replaced[len(replaced) - (known - begin) :][: end - begin]
            recent = self._open[1:, max(begin, end - self._history) : end]
            self._before = np.concatenate([self._before, recent], axis=1)[:, -self._history :]
            self._last_s = float(time[end - 1])
            begin = end
        self._open = self._open[:, begin:].copy()
        return time[:begin], done[:begin]


@compiled
def _mark(value: Array, levels: Array, kept: float, sides: Array) -> None:
    """
    Count each sample in `levels` and fill its side: 1 at the upper limit, -1 at the lower, else 0.

    levels: as in `Declipper`; kept: share of the counts that is kept from sample to sample.
    """
    for k in range(len(value)):
        for side in range(2):
            sign = 2.0 * side - 1.0
            x, rows = sign * value[k], levels[side]
            for level in rows:
                level[1] *= kept
                level[2] *= kept
            _count(x, rows)
            largest = max(abs(levels[0, 0, 0]), abs(levels[1, 0, 0]))
            for level in rows:
                if level[1] > max(_VISITS, _EXCEEDED * level[2]):
                    if x == level[0] and abs(x) >= _ZERO * largest:
                        sides[k] = sign
                    break


@compiled
def _count(x: float, rows: Array) -> None:
    """
    Count a sample in the extreme values of one side: at the value that it equals, and beyond the values it exceeds.

    A new value beyond the innermost extreme value replaces the value with the fewest samples.
    """
    fewest, known = 0, False
    for j in range(len(rows)):
        if x > rows[j, 0]:
            rows[j, 2] += 1.0
        elif x == rows[j, 0]:
            rows[j, 1] += 1.0
            known = True
        if rows[j, 1] <= rows[fewest, 1]:
            fewest = j
    if known or x < rows[-1, 0]:
        return
    for j in range(fewest, len(rows) - 1):
        rows[j] = rows[j + 1]
    at = len(rows) - 1
    while at > 0 and rows[at - 1, 0] < x:
        rows[at] = rows[at - 1]
        at -= 1
    rows[at, 0], rows[at, 1], rows[at, 2] = x, 1.0, 0.0


def unclipped(value: Array, sides: Array, order: int) -> Array:
    """
    Return samples in which the clipped ones have their most probable values, shape (n,).

    The samples are returned unchanged if fewer than 4 `order` of them are not clipped, or if the model cannot be
    estimated.

    Parameters
    ----------
    value : ndarray, shape (n,)
    sides : ndarray, shape (n,)
        1 where the true value is the sample or more, -1 where it is the sample or less, else 0.
    order : int
        Highest order of the autoregressive model.
    """
    at = np.flatnonzero(sides)
    out = value.copy()
    if not at.size or len(value) - at.size < 4 * order:
        return out
    for _ in range(_ROUNDS):
        taps, size = prediction_error_filter(out, np.ones(len(value)), order, _FLOOR)
        if size <= 0.0:
            return value.copy()
        out[at] = _most_probable(out, value, sides, at, np.correlate(taps, taps, "full")[len(taps) - 1 :])
    return out


def _short(sides: Array, longest: int) -> Array:
    """Return `sides`, with 0 in place of each run of equal values that is longer than `longest` samples."""
    lengths = np.diff(np.concatenate([[0], np.flatnonzero(np.diff(sides)) + 1, [len(sides)]]))
    return np.where(np.repeat(lengths, lengths) > longest, 0.0, sides)


def _most_probable(out: Array, value: Array, sides: Array, at: Indices, lags: Array) -> Array:
    """
    Return the most probable samples at the places `at`: with the smallest prediction errors and within their bounds.

    out: present estimate of all samples; value: all samples as measured, so that those at `at` are the bounds; lags:
    autocorrelation of the prediction error filter.
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
