# SPDX-License-Identifier: Apache-2.0
"""Chi-square distribution. It replaces `scipy.stats.chi2`, whose import takes a fifth of the start time of a node."""

from __future__ import annotations

import math


def exceeded(value: float, freedom: int) -> float:
    """
    Return the probability that chi-square with `freedom` degrees of freedom exceeds a value.

    Source: Abramowitz and Stegun 1964, 26.4.4 and 26.4.5.
    """
    half, odd = 0.5 * value, 0.5 * (freedom % 2)
    if half <= 0.0:
        return 1.0
    # Each part as an exponential of logarithms: a product would underflow with more than 1400 degrees of freedom.
    logarithms = ((k + odd) * math.log(half) - half - math.lgamma(k + odd + 1.0) for k in range(freedom // 2))
    return (math.erfc(math.sqrt(half)) if odd else 0.0) + math.fsum(map(math.exp, logarithms))


def limit(probability: float, freedom: int) -> float:
    """Return the value that chi-square with `freedom` degrees of freedom exceeds with this probability."""
    low, high = 0.0, 1.0
    while exceeded(high, freedom) > probability:
        high *= 2.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if exceeded(middle, freedom) > probability else (low, middle)
    return high
