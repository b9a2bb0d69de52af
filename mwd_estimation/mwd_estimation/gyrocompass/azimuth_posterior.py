"""
An azimuth on the circle of the latitude: what a Gaussian of the horizontal Earth rate says once its length is known.

The prior of the Earth-rate state is isotropic about zero, hence constant on the circle |horizontal Earth rate| =
We cos(latitude): restricting the filter's Gaussian to the circle is the posterior, however wide, with one mode or two.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi


@dataclasses.dataclass(frozen=True)
class Part:
    """
    One Gaussian of the horizontal Earth rate and of an angle that is added to the azimuth found on the circle.

    Attributes
    ----------
    log_weight : float
        Evidence for it against the other parts.
    earth, S : ndarray, shapes (2,) and (2, 2)
        Mean and covariance of the horizontal Earth rate in the level frame, rad/s.
    cross, own : ndarray, shape (2,), and float
        How the added angle follows the Earth rate, rad per rad/s, and its own variance, rad^2.
    shift : float
        Its mean, rad.
    """

    log_weight: float
    earth: Array
    S: Array
    cross: Array
    own: float
    shift: float


@dataclasses.dataclass(frozen=True)
class OnCircle:
    """
    Azimuth of the level frame (plus the added angle): mean and sigma, rad.

    misfit: squared distance of the first part from the circle, in sigmas; several: the angles that fit alike, where
    there are several.
    """

    mean: float
    sigma: float
    misfit: float
    several: tuple[float, ...]


def part(log_weight: float, earth: Array, P: Array, right: Array, at: slice, shift: float = 0.0) -> Part:
    """Part of a Gaussian with covariance P, whose states `at` are the Earth rate and whose right . x is the angle."""
    S = np.asarray(P[at, at])
    cross: Array = np.asarray(np.linalg.solve(S, P[at] @ right), dtype=float)
    own = max(float(right @ P @ right) - float(cross @ S @ cross), 0.0)
    return Part(log_weight, np.asarray(earth), S, cross, own, shift)


def posterior(parts: Sequence[Part], horizontal: float, expected: float | None = None) -> OnCircle:
    """
    Mean and sigma of the azimuth, given that the horizontal Earth rate has its length.

    Parameters
    ----------
    parts : sequence of Part
        What the data say, weighed by their evidence; the first one is that whose misfit is told.
    horizontal : float
        Earth rate times the cosine of the latitude, rad/s.
    expected : float, optional
        An azimuth, rad, that chooses between several that fit; it doesn't move the answer.
    """
    inverses = [np.linalg.inv(one.S) for one in parts]
    offsets = [float(np.linalg.slogdet(one.S)[1]) - 2.0 * one.log_weight for one in parts]

    north, east = (np.array([one.earth[k] for one in parts])[:, None] for k in (0, 1))
    a, b, c = (np.array([inv[i, j] for inv in inverses])[:, None] for i, j in ((0, 0), (0, 1), (1, 1)))

    def distances(angle: Array) -> Array:
        d_n, d_e = horizontal * np.cos(angle) - north, -horizontal * np.sin(angle) - east
        return np.asarray(a * d_n * d_n + 2.0 * b * d_n * d_e + c * d_e * d_e)

    def costs(angle: Array) -> Array:
        return np.asarray(distances(angle) + np.array(offsets)[:, None])

    def cost(angle: Array) -> Array:
        each = costs(angle)
        least = each.min(axis=0)
        return np.asarray(least - 2.0 * np.log(np.exp(-0.5 * (each - least)).sum(axis=0)))

    modes = _modes(cost)
    best = min(modes, key=lambda mode: mode[1])[0]
    misfit = float(distances(np.array([best]))[0, 0])
    if len(modes) > 1 and expected is not None:
        modes = [min(modes, key=lambda mode: abs(float(wrap_pi(mode[0] - expected))))]
    lone = len(modes) == 1 and expected is not None
    grid = [modes[0][0] + np.linspace(-0.5, 0.5, 361) * math.pi if lone else np.linspace(-1.0, 1.0, 721) * math.pi]
    for mode, _ in modes:
        tangent = horizontal * np.array([-math.sin(mode), -math.cos(mode)])
        for inverse in inverses:
            width = 1.0 / math.sqrt(float(tangent @ inverse @ tangent))
            if width < 0.1:
                # A narrow peak wants points of its own.
                grid.append(mode + np.linspace(-8.0, 8.0, 81) * width)
    angle = np.unique(np.concatenate(grid))
    if lone:
        spacing = np.gradient(angle)
    else:
        angle = np.unique(wrap_pi(angle))
        spacing = 0.5 * ((np.roll(angle, -1) - np.roll(angle, 1)) % (2.0 * math.pi))
    every = costs(angle)
    weight = np.exp(-0.5 * (every - every.min())) * spacing
    weight /= weight.sum()
    d = horizontal * np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
    total = np.stack([angle + (d - one.earth) @ one.cross + one.shift for one in parts])
    mean = math.atan2(float(np.sum(weight * np.sin(total))), float(np.sum(weight * np.cos(total))))
    variance = float(np.sum(weight * wrap_pi(total - mean) ** 2))
    variance += float(weight.sum(axis=1) @ np.array([one.own for one in parts]))
    others = tuple(mode for mode, _ in modes) if len(modes) > 1 else ()
    return OnCircle(mean, min(math.sqrt(variance), math.pi), misfit, others)


def _modes(cost: Callable[[Array], Array]) -> list[tuple[float, float]]:
    """Every angle where the misfit is least nearby and within 25 of the best, with that misfit."""
    grid = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    values = cost(grid)
    low = (values <= np.roll(values, 1)) & (values < np.roll(values, -1))
    found = []
    for angle in grid[low]:
        step = math.radians(1.0)
        for _ in range(5):
            near = angle + np.linspace(-step, step, 41)
            angle = near[np.argmin(cost(near))]
            step /= 12.0
        found.append((float(angle), float(cost(np.array([angle]))[0])))
    best = min(chi2 for _, chi2 in found)
    return [(angle, chi2) for angle, chi2 in found if chi2 < best + 25.0]
