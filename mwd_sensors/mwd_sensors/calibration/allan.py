# SPDX-License-Identifier: Apache-2.0
"""
Allan deviation: identify white noise, bias instability and random walk of a sensor in a recording at rest.

Sources: IEEE Std 952-1997, annex C; overlapping estimator of Howe, Allan and Barnes (1981).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_sensors.core.arrays import Array

_PER_DECADE = 10  # number of averaging times per decade
# Ratio of the flat part of the Allan deviation to the bias instability B, sqrt(2 ln 2 / pi) (IEEE Std 952, C.1.3).
FLICKER_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)


@dataclasses.dataclass(frozen=True)
class AllanCurve:
    """Allan deviation as a function of averaging time."""

    tau: Array  #: shape (k,); averaging time, s
    deviation: Array  #: shape (k, ...); deviation in the unit of the samples, one column for each axis
    #: Shape (k,); relative 1 sigma of the deviation, which follows from the number of independent averages.
    sigma: Array


@dataclasses.dataclass(frozen=True)
class AllanFigures:
    """Noise figures of one axis, in the unit of the samples."""

    #: Noise density, unit / sqrt(Hz): the deviation at 1 s on the slope of -1/2; 0 if the curve does not have this
    #: slope.
    white: float
    #: `floor`, `floor_tau`: lowest deviation and its averaging time, s.
    floor: float
    floor_tau: float
    instability: float  #: bias instability B: the floor divided by 0.664
    #: Random walk of the bias, unit / sqrt(s): the deviation at 3 s on the slope of +1/2; 0 if the curve does not have
    #: this slope, usually because the record is too short.
    walk: float


def allan(samples: ArrayLike, rate: float) -> AllanCurve:
    """
    Return the overlapping Allan deviation, for averaging times up to a fifth of the record.

    Parameters
    ----------
    samples : array_like, shape (n,) or (n, axes)
        Equally spaced samples of a sensor at rest.
    rate : float
        Sample rate, Hz.

    Raises
    ------
    ValueError
        There are fewer than 20 samples, the rate is not positive, or a sample is not finite.
    """
    x = np.asarray(samples, dtype=float)
    if len(x) < 20:
        raise ValueError(f"samples: {len(x)} are too few for an Allan deviation; at least 20")
    if not rate > 0.0:
        raise ValueError(f"rate must be positive, got {rate!r} Hz")
    if not np.isfinite(x).all():
        raise ValueError("samples: not all are finite; remove the gaps first")
    columns = x.reshape(len(x), -1)
    # Subtract the mean first, so that the running sum keeps its digits.
    total = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns - columns.mean(axis=0), axis=0)])
    longest = len(x) // 5
    count = max(2, math.ceil(math.log10(longest) * _PER_DECADE) + 1)
    lengths = np.unique(np.round(np.logspace(0.0, math.log10(longest), count)).astype(int))
    deviation = np.empty((len(lengths), columns.shape[1]))
    for k, m in enumerate(lengths):
        second = (total[2 * m :] - 2.0 * total[m:-m] + total[: -2 * m]) / m
        deviation[k] = np.sqrt(0.5 * np.mean(second**2, axis=0))
    # IEEE Std 952, C.1.10: relative error 1 / sqrt(2 (n / m - 1)).
    sigma = 1.0 / np.sqrt(2.0 * (len(x) / lengths - 1.0))
    return AllanCurve(lengths / rate, deviation.reshape(len(lengths), *x.shape[1:]), sigma)


def figures(curve: AllanCurve, axis: int | None = None) -> AllanFigures:
    """
    Return the noise figures of a curve; axis is the column, None for a curve of samples with shape (n,).

    White noise is fitted where the slope is near -1/2, up to the averaging time of the floor; random walk where the
    slope is near +1/2, at longer averaging times.
    """
    deviation = curve.deviation if axis is None else curve.deviation[:, axis]
    log_tau, log_dev = np.log(curve.tau), np.log(np.maximum(deviation, 1e-300))
    slope = np.gradient(log_dev, log_tau)
    lowest = int(np.argmin(deviation))
    white_part = (np.abs(slope + 0.5) < 0.1) & (np.arange(len(slope)) <= lowest)
    white = _fitted(log_tau, log_dev, curve.sigma, white_part, -0.5, 0.0)
    rising = (np.abs(slope - 0.5) < 0.15) & (np.arange(len(slope)) > lowest)
    walk = _fitted(log_tau, log_dev, curve.sigma, rising, 0.5, math.log(3.0))
    floor = float(deviation[lowest])
    return AllanFigures(white, floor, float(curve.tau[lowest]), floor / FLICKER_FLOOR, walk)


def _fitted(log_tau: Array, log_dev: Array, sigma: Array, part: NDArray[np.bool_], slope: float, at: float) -> float:
    if not part.any():
        return 0.0
    weight = sigma[part] ** -2
    level = np.average(log_dev[part] - slope * (log_tau[part] - at), weights=weight)
    return float(math.exp(level))
