# SPDX-License-Identifier: Apache-2.0
"""
Natural gamma detector of the sonde: from the rock around the hole to counted pulses.

The rock is a table of layers. The detector is behind a shield with a window: most rays come from the direction of the
window, some through the shield. It receives rays from a short length of the hole and from a certain depth into the
rock. A radioactive bed above the hole therefore raises the counts while the window is up, long before the hole enters
the bed. The pulses are a Poisson process; after each counted pulse the detector is dead for a while (non-paralysable,
G. F. Knoll, Radiation Detection and Measurement, 4th ed. 2010, section 4.VII).
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.motion import WellPath

_PERIOD_S = 0.04  # counting interval, s, in which the tool turns by 29 deg at 120 r/min
_DIRECTIONS = 24  # number of directions around the hole over which the rock is averaged
# Distances into the rock, as multiples of `reach_m`, over which the rock is averaged: the medians of the three thirds
# of an exponential distribution.
_REACHES = tuple(-math.log(1.0 - share) for share in (1.0 / 6.0, 0.5, 5.0 / 6.0))


@dataclasses.dataclass(frozen=True)
class Gamma:
    """Gamma detector and the rock around the hole."""

    formation: tuple[tuple[float, float], ...] = setting(
        ((0.0, 60.0),),
        "Layers of rock. Each row has the depth of the top, m, and the natural gamma, gAPI; the first layer also "
        "applies above its top.",
    )
    by: str = setting(
        "tvd",
        "Depth by which the layers are given. tvd: true vertical depth, so the layers are horizontal. md: measured "
        "depth along the hole.",
        choices=("tvd", "md"),
    )
    sensor_to_bit_m: float = setting(15.0, "Distance along the hole from the detector to the bit.", low=0.0, high=100.0)
    tool_factor: float = setting(
        1.5,
        "API units of one count per second. Raising it lowers the count rate, so the log becomes noisier.",
        low=1e-3,
        high=1e3,
    )
    dead_time_us: float = setting(
        20.0,
        "Dead time of the detector after each counted pulse. Raising it loses more counts in radioactive rock.",
        unit="us",
        low=0.0,
        high=1e5,
    )
    window_deg: float = setting(
        0.0, "Angle from the scribe line to the detector's window, clockwise looking down-hole.", low=-360.0, high=360.0
    )
    leak: float = setting(
        0.1,
        "Sensitivity of the shielded side as a share of the sensitivity of the window. 1: no shield, so the log does "
        "not "
        "depend on the toolface.",
        low=0.0,
        high=1.0,
    )
    hole_radius_m: float = setting(0.108, "Radius of the hole.", low=0.01, high=1.0)
    reach_m: float = setting(
        0.12,
        "Distance into the rock over which the sensitivity falls to 1/e. Raising it smooths the log at layer "
        "boundaries.",
        low=0.01,
        high=2.0,
    )
    half_length_m: float = setting(
        0.15,
        "Half of the length of hole over which the detector averages. Raising it smooths the log.",
        low=0.0,
        high=2.0,
    )

    def __post_init__(self) -> None:
        """Raise ValueError if layers are missing, depths do not rise, or the gamma of a layer is not valid."""
        if not self.formation:
            raise ValueError("formation: at least one layer is needed")
        if any(b[0] <= a[0] for a, b in itertools.pairwise(self.formation)):
            raise ValueError(f"formation: the depths of the tops must rise, got {[row[0] for row in self.formation]}")
        if any(not 0.0 <= api <= 5000.0 for _, api in self.formation):
            raise ValueError("formation: natural gamma must be within 0 and 5000 gAPI")


class GammaDetector:
    """
    Simulated gamma detector in a hole.

    Parameters
    ----------
    path : WellPath
        The hole.
    rng : Generator
        Random numbers for the pulses.
    """

    def __init__(self, settings: Gamma, path: WellPath, rng: np.random.Generator) -> None:
        self.settings, self._path, self._rng = settings, path, rng
        self._tops, self._api = np.array(settings.formation, dtype=float).T
        self._alive_s = -math.inf
        self._before = np.empty(0)

    def expected(self, md: ArrayLike, direction: ArrayLike) -> Array:
        """
        Return the natural gamma of the rock weighted by the detector's sensitivity, gAPI, without noise; shape (n,).

        Parameters
        ----------
        md : array_like, shape (n,)
            Measured depth of the detector, m.
        direction : array_like, shape (n,)
            Angle of the window from the high side, clockwise looking down-hole, rad; not used if rock is given by depth
            "md".
        """
        item = self.settings
        md, direction = np.broadcast_arrays(np.asarray(md, dtype=float), np.asarray(direction, dtype=float))
        along = item.half_length_m * np.array([-2.0, 0.0, 2.0]) / 3.0
        if item.by == "md":
            return np.asarray(self._rock(md[:, None] + along).mean(axis=1))
        tvd, cos_inc = _vertical(self._path, md)
        sin_inc = np.sqrt(np.maximum(1.0 - cos_inc**2, 0.0))
        around = math.tau / _DIRECTIONS * (np.arange(_DIRECTIONS) + 0.5)
        reach = item.hole_radius_m + item.reach_m * np.array(_REACHES)
        # Vertical component of each direction around the hole: the high side rises by the sine of the inclination.
        up = sin_inc[:, None] * np.cos(around)
        depth = tvd[:, None, None, None] - up[:, :, None, None] * reach[:, None]
        rock = self._rock(depth + cos_inc[:, None, None, None] * along).mean(axis=(2, 3))
        return np.asarray((rock * _sensitivity(around - direction[:, None], item.leak)).mean(axis=1))

    def samples(
        self, index: Stamps, stamps: Stamps, toolface: Array, bit: Array, rate_hz: int
    ) -> tuple[Samples, Array]:
        """
        Return the counts of the counting intervals that end within n outputs of the sonde.

        Parameters
        ----------
        index, stamps : ndarray of int64, shape (n,)
            Number of each output since the start of the simulation, and its stamp, ns. Call this method for all
            outputs in order.
        toolface : ndarray, shape (n,)
            Gravity toolface, rad.
        bit : ndarray, shape (n,)
            Measured depth of the bit, m.
        rate_hz : int
            Outputs per second.

        Returns
        -------
        samples : ndarray of dtype `wire.COUNTS`
        picked : ndarray of bool, shape (n,)
            True for the outputs at which a counting interval ends.
        """
        item, every = self.settings, max(1, round(_PERIOD_S * rate_hz))
        half = every // 2
        before = self._before if len(self._before) else np.full(half, toolface[0])
        angles = np.concatenate([before, toolface])
        self._before = angles[len(angles) - half :] if half else before
        picked = index % every == 0
        duration = every / rate_hz
        middle = angles[: len(toolface)][picked] + math.radians(item.window_deg)
        rates = self.expected(bit[picked] - item.sensor_to_bit_m, middle) / item.tool_factor
        samples = wire.COUNTS.empty(int(picked.sum()))
        samples["stamp_ns"], samples["duration"] = stamps[picked], duration
        ends = index[picked] / rate_hz
        samples["counts"] = [self._count(end - duration, duration, rate) for end, rate in zip(ends, rates, strict=True)]
        samples["dead_time"], samples["tool_factor"] = item.dead_time_us * 1e-6, item.tool_factor
        samples["toolface_offset"], samples["sensor_to_bit"] = math.radians(item.window_deg), item.sensor_to_bit_m
        return samples, picked

    def _count(self, begin_s: float, duration_s: float, rate: float) -> int:
        """Return the number of pulses counted in an interval; call this method for consecutive intervals."""
        arrivals = np.sort(begin_s + duration_s * self._rng.random(self._rng.poisson(rate * duration_s)))
        counted, dead_s = 0, self.settings.dead_time_us * 1e-6
        for at in arrivals.tolist():
            if at >= self._alive_s:
                counted += 1
                self._alive_s = at + dead_s
        return counted

    def _rock(self, depth: Array) -> Array:
        at = np.searchsorted(self._tops, depth, side="right") - 1
        return np.asarray(self._api[np.maximum(at, 0)])


def _sensitivity(angle: Array, leak: float) -> Array:
    """Return the detector's sensitivity to rays at an angle from the window, rad; its mean over the circle is 1."""
    lobe = (0.5 + 0.5 * np.cos(angle)) ** 2
    # The mean of `lobe` over all angles is 3/8.
    return np.asarray((leak + (1.0 - leak) * lobe) / (leak + (1.0 - leak) * 0.375))


def _vertical(path: WellPath, md: Array) -> tuple[Array, Array]:
    """Return true vertical depth, m, and cosine of the inclination at measured depths of a hole, shape (n,)."""
    at = np.clip(np.searchsorted(path.md, md, side="right") - 1, 0, len(path.md) - 1)
    length, curvature = md - path.md[at], path.curvature[at]
    turn = curvature * length
    tangent, normal = path.tangent[at, 2], path.normal[at, 2]
    forward = length * np.sinc(turn / np.pi)
    aside = 0.5 * curvature * length**2 * np.sinc(0.5 * turn / np.pi) ** 2
    return path.position[at, 2] + forward * tangent + aside * normal, np.cos(turn) * tangent + np.sin(turn) * normal
