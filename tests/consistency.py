# SPDX-License-Identifier: Apache-2.0
"""
Whether errors are as large as the sigmas published for them: the mean normalised error squared in its chi-square band.

Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

__all__ = ["Consistency", "assert_consistent", "consistency", "independent_samples"]

Array = NDArray[np.float64]

_THINNED = 10  # every tenth sample is enough to see how an error that lasts for seconds correlates


class Consistency(NamedTuple):
    """Normalised error squared of a set of runs, the band expected of it, and the degrees of freedom of the band."""

    nees: float
    low: float
    high: float
    freedom: float

    @property
    def inside(self) -> bool:
        """Whether the mean lies in its band."""
        return self.low <= self.nees <= self.high


def independent_samples(runs: Sequence[Array]) -> float:
    """
    Return the number of independent samples in the squares of a normalised error, of one run or of several.

    Squares of a Gaussian series correlate as the square of its autocorrelation r, and the variance of their mean is
    that of n / m independent ones, m = 1 + 2 sum (1 - k / n) r_k^2. The mean is not taken out, and r is that of all
    runs together: a part of the error that stays for a run, as one of calibration, has one value in each run, and only
    the runs together show how large it usually is; one run alone cannot show it.

    An estimate of r from p pairs has the variance (1 - r^2)^2 m / p by chance (M. S. Bartlett, On the theoretical
    specification and sampling properties of autocorrelated time-series, 1946; without memory R. A. Fisher, 1915). Its
    square is too large by as much, which is taken off: the sum is linear in m and is solved for it. It ends where it is
    largest: beyond is chance only (C. J. Geyer, Practical Markov chain Monte Carlo, 1992, section 3.3, of r itself).
    Nothing is taken off where r = 1: of errors that stay whole runs are one sample each.

    Parameters
    ----------
    runs : sequence of ndarray, shapes (n,)
        Error divided by its sigma, in order of time.

    Returns
    -------
    float
        At least one for each run.
    """
    longest = max(len(u) for u in runs)
    power, pairs = np.zeros(longest), np.zeros(longest)
    for u in runs:
        n = len(u)
        power[:n] += np.fft.irfft(np.abs(np.fft.rfft(u, 2 * n)) ** 2, 2 * n)[:n]
        pairs[:n] += np.arange(n, 0, -1)
    if not power[0] > 0.0:
        return float(len(runs))
    r2 = np.minimum((power / pairs * (pairs[0] / power[0])) ** 2, 1.0)
    chance = (1.0 - r2) ** 2 / pairs
    shares = []
    for n in map(len, runs):
        weight = 2.0 * np.arange(n - 1, 0, -1) / n
        memory = (1.0 + np.cumsum(weight * r2[1:n])) / (1.0 + np.cumsum(weight * chance[1:n]))
        shares.append(min(float(np.max(memory, initial=1.0)) / n, 1.0))
    # Every run weighs the same in the mean.
    return len(runs) ** 2 / sum(shares)


def consistency(
    runs: Sequence[tuple[ArrayLike, ArrayLike]], *, correlated: bool = True, confidence: float = 0.95
) -> Consistency:
    """
    Mean normalised error squared of several runs, each run weighing the same, and its chi-square band.

    Parameters
    ----------
    runs : sequence of (error, sigma)
        Arrays that broadcast to one shape, in the same unit; one pair for each run (seed).
    correlated : bool
        Whether the samples of a run follow each other in time, so that they count as fewer independent ones. False for
        independent trials, for instance one error of each seed: then every element is a degree of freedom.
    confidence : float
        Probability of the two-sided band.

    Raises
    ------
    ValueError
        There is no sample, or a sigma is not positive.
    """
    means, series = [], []
    for error, sigma in runs:
        e, s = np.broadcast_arrays(np.asarray(error, dtype=float), np.asarray(sigma, dtype=float))
        if e.size == 0 or not np.all(s > 0.0):
            raise ValueError("runs: a consistency check needs samples, each with a positive sigma")
        u = (e / s).ravel()
        means.append(float(np.mean(u * u)))
        series.append(u[::_THINNED] if correlated and u.size > 20 * _THINNED else u)
    freedom = independent_samples(series) if correlated else float(sum(u.size for u in series))
    low, high = chi2.ppf([0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence], freedom) / freedom
    return Consistency(float(np.mean(means)), float(low), float(high), freedom)


def assert_consistent(
    error: ArrayLike, sigma: ArrayLike, *, correlated: bool = False, confidence: float = 0.999, name: str = "sigma"
) -> None:
    """
    Assert that errors are as large as their sigmas say: neither larger nor smaller than chance explains.

    Parameters
    ----------
    error, sigma : array_like, shape (n,) or (runs, n)
        Errors and their published sigmas, in the same unit. Correlated errors of several runs have a row for each run.
    correlated : bool
        Whether the last axis is time, so that its samples count as fewer independent ones. False: independent trials.
    confidence : float
        Probability that errors which have exactly these sigmas pass.
    name : str
        What is judged, for the message.

    Raises
    ------
    AssertionError
        The mean normalised error squared lies outside its chi-square band.
    ValueError
        There is no sample, or a sigma is not positive.
    """
    e, s = np.broadcast_arrays(np.asarray(error, dtype=float), np.asarray(sigma, dtype=float))
    rows = zip(np.atleast_2d(e), np.atleast_2d(s), strict=True)
    got = consistency(list(rows), correlated=correlated, confidence=confidence)
    assert got.inside, (
        f"{name}: normalised error squared {got.nees:.3f} outside {got.low:.3f} to {got.high:.3f}"
        f" ({got.freedom:.1f} degrees of freedom)"
    )
