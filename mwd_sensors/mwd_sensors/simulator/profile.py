# SPDX-License-Identifier: Apache-2.0
"""
Piecewise polynomials of time with exact derivatives, for depth, toolface and envelopes.

The schedule of a rig is a sequence of constant rates with smooth changes in between. As polynomials, value, rate and
acceleration agree exactly, however long the run is.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled


@dataclasses.dataclass(frozen=True)
class Profile:
    """
    Piecewise polynomial of time.

    Attributes
    ----------
    starts : ndarray, shape (m,)
        Start of each piece, s, ascending; the last piece has no end.
    terms : ndarray, shape (m, 7)
        Coefficients, in rising powers, of the time since the start of the piece.
    """

    starts: Array
    terms: Array

    def __call__(self, t: Array) -> Array:
        """Return value, rate and acceleration, shape (3, n), at ascending times t, s, shape (n,)."""
        out = np.empty((3, len(t)))
        evaluate(self.starts, self.terms, t, out)
        return out

    @property
    def end(self) -> float:
        """Start of the last piece, s."""
        return float(self.starts[-1])


class ProfileBuilder:
    """Builds a `Profile` by adding one piece after the other, from a value and a rate at time 0."""

    def __init__(self, value: float = 0.0, rate: float = 0.0) -> None:
        self.time = 0.0
        self.value = value
        self.rate = rate
        self._starts: list[float] = []
        self._terms: list[list[float]] = []

    def hold(self, seconds: float) -> None:
        """Keep the present rate for a time, s."""
        if seconds > 0.0:
            self._add(seconds, [self.value, self.rate, 0.0, 0.0, 0.0, 0.0, 0.0])

    def to_rate(self, rate: float, seconds: float) -> None:
        """Change the rate to another one within a time, s; rate, slope and curvature stay continuous."""
        change, s = rate - self.rate, seconds
        if change == 0.0 or s <= 0.0:
            self.hold(seconds)
            self.rate = rate
            return
        # Integral of rate + change (10 u^3 - 15 u^4 + 6 u^5), u = t / s.
        self._add(s, [self.value, self.rate, 0.0, 0.0, 2.5 * change / s**3, -3.0 * change / s**4, change / s**5])
        self.rate = rate

    def to_value(self, value: float, seconds: float) -> None:
        """Change the value to another one within a time, s, starting and ending at rest."""
        change, s = value - self.value, seconds
        if change == 0.0:
            self.rate = 0.0
            self.hold(seconds)
            return
        self._add(s, [self.value, 0.0, 0.0, 10.0 * change / s**3, -15.0 * change / s**4, 6.0 * change / s**5, 0.0])
        self.value, self.rate = value, 0.0

    def follow(self, other: ProfileBuilder, factor: float = 1.0) -> None:
        """Append the last change of another profile times a factor, starting at the present value."""
        _, *changes = other._terms[-1]
        self._add(other.time - other._starts[-1], [self.value, *(factor * term for term in changes)])
        self.rate = factor * other.rate

    def build(self) -> Profile:
        """Return the finished profile, which continues at its last rate."""
        starts = [*self._starts, self.time]
        terms = [*self._terms, [self.value, self.rate, 0.0, 0.0, 0.0, 0.0, 0.0]]
        return Profile(np.array(starts), np.array(terms))

    def _add(self, seconds: float, terms: list[float]) -> None:
        self._starts.append(self.time)
        self._terms.append(terms)
        self.time += seconds
        # Not sum(): from Python 3.12 on it compensates rounding, and a different last bit would give a different run.
        value = 0.0
        for term in reversed(terms):
            value = value * seconds + term
        self.value = value


@compiled
def evaluate(starts: Array, terms: Array, t: Array, out: Array) -> None:
    """Fill out, shape (3, n), with value, rate and acceleration of a profile at ascending t, s, shape (n,)."""
    low, high = 0, len(starts) - 1
    while low < high:
        middle = (low + high + 1) // 2
        if starts[middle] <= t[0]:
            low = middle
        else:
            high = middle - 1
    piece = low
    for k in range(len(t)):
        while piece + 1 < len(starts) and starts[piece + 1] <= t[k]:
            piece += 1
        u = t[k] - starts[piece]
        value = terms[piece, 6]
        rate = 0.0
        half_acceleration = 0.0
        for power in range(5, -1, -1):
            half_acceleration = half_acceleration * u + rate
            rate = rate * u + value
            value = value * u + terms[piece, power]
        out[0, k] = value
        out[1, k] = rate
        out[2, k] = 2.0 * half_acceleration
