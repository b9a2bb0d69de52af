# SPDX-License-Identifier: Apache-2.0
"""Chi-square distribution, without scipy, whose import would take a fifth of the start time of an estimator."""

from __future__ import annotations

import math


def exceeded(value: float, freedom: int) -> float:
    """Return the probability that chi-square exceeds a value (Abramowitz and Stegun 1964, 26.4.4 and 26.4.5)."""
    half = 0.5 * value
    odd = freedom % 2
    probability = math.erfc(math.sqrt(half)) if odd else 0.0
    term = math.exp(-half) * (2.0 * math.sqrt(half / math.pi) if odd else 1.0)
    for k in range(1, freedom // 2 + 1):
        probability += term
        term *= half / (k + 0.5 * odd)
    return probability


def limit(probability: float, freedom: int) -> float:
    """Return the value that chi-square exceeds with this probability; inverse of `exceeded`."""
    low, high = 0.0, 1.0
    while exceeded(high, freedom) > probability:
        high *= 2.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if exceeded(middle, freedom) > probability else (low, middle)
    return high
