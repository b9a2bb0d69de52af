"""
The methods a station may seek north with, behind one face: the best one, and S1's own.

S1's filter knows a tool that keeps still and a gyro whose bias calibration has made small; a turn ends it.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from mwd_estimation.gyrocompass import seek as north_seek
from mwd_estimation.gyrocompass import seek_filter, static_ekf
from mwd_estimation.gyrocompass.seek import Solution
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.frames import mat_nt

SEEK, S1 = "seek", "s1"


class Seeker(Protocol):
    """A seek under way: samples in, what was found so far out."""

    @property
    def turns(self) -> bool:
        """Whether a turn about the tool's axis may go into it."""

    @property
    def elapsed(self) -> float:
        """s of data used."""

    @property
    def moved(self) -> bool:
        """Whether the hole axis lay elsewhere meanwhile."""

    def run(self, stamp_ns: Stamps, values: Array) -> None:
        """Take stamps, ns, and rates, rad/s, and forces, m/s^2, shape (n, 6)."""

    def solution(self) -> Solution:
        """North so far, or why there is none."""


class BestSeek:
    """`north_seek`; `earlier`, with the seconds since, is a seek whose knowledge of the instrument is carried on."""

    turns = True

    def __init__(self, params: north_seek.Params, earlier: tuple[north_seek.State, float] | None = None) -> None:
        self.params = params
        self.state = north_seek.initial() if earlier is None else north_seek.carried_on(params, *earlier)

    @property
    def elapsed(self) -> float:
        """s of data used."""
        return float(self.state.memory[seek_filter.ELAPSED])

    @property
    def moved(self) -> bool:
        """Whether the hole axis lay elsewhere meanwhile."""
        return bool(self.state.memory[seek_filter.MOVED] > 0.0)

    def run(self, stamp_ns: Stamps, values: Array) -> None:
        """Take samples, as `Seeker.run`."""
        north_seek.run(self.params, self.state, stamp_ns, values[:, :3], values[:, 3:])

    def solution(self) -> Solution:
        """North so far, or why there is none."""
        return north_seek.solution(self.params, self.state)


class S1Seek:
    """S1's fifteen states with the settings that it shares with `north_seek`."""

    turns = False

    def __init__(self, params: north_seek.Params) -> None:
        self.params = params
        self._s1 = static_ekf.Params(
            # Near the pole it isn't run; the refusal is `solution`'s.
            latitude_deg=float(np.clip(params.latitude_deg, -85.0, 85.0)),
            gravity=params.gravity,
            coarse_seconds=0.5 * params.shortest,
            gyro_noise_deg_rth=params.gyro_noise_deg_rth,
            accel_noise_ug_rthz=params.accel_noise_ug_rthz,
            gyro_bias_deg_h=params.gyro_bias_deg_h,
            accel_bias_ug=params.accel_bias_ug,
            gyro_walk_deg_h_rth=params.gyro_walk_deg_h_rth,
        )
        self._state = static_ekf.initial(self._s1)
        self._last: static_ekf.North | None = None
        self._first_ns: int | None = None
        self._last_ns = 0

    @property
    def elapsed(self) -> float:
        """s of data used."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    @property
    def moved(self) -> bool:
        """Whether the tool has moved, by the filter's own test."""
        return self._last is not None and bool(self._last.ratio[-1] > self._s1.moved_ratio)

    def run(self, stamp_ns: Stamps, values: Array) -> None:
        """Take samples, as `Seeker.run`."""
        if len(stamp_ns) == 0 or abs(self.params.latitude_deg) > 85.0:
            return
        self._last = static_ekf.run(self._s1, self._state, stamp_ns, values[:, :3], values[:, 3:])
        self._first_ns = int(stamp_ns[0]) if self._first_ns is None else self._first_ns
        self._last_ns = int(stamp_ns[-1])

    def solution(self) -> Solution:
        """North so far, or why there is none."""
        params, last = self.params, self._last
        nothing = (math.nan,) * 4
        azimuth = sigma = inclination = toolface = math.nan
        if last is not None:
            azimuth, sigma = float(last.azimuth[-1]), float(last.sigma_azimuth[-1])
            inclination, toolface = float(last.inclination[-1]), float(last.toolface[-1])
        horizontal = EARTH_RATE * math.cos(math.radians(params.latitude_deg))
        noise = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR
        limit = min(noise / (horizontal * math.sqrt(max(self.elapsed, 1e-3))), math.pi)
        reason = self._refusal(azimuth, sigma, inclination)
        scribe = mat_nt(inclination, azimuth, toolface)[:, 2]
        return Solution(
            not reason, reason, S1, azimuth, sigma, inclination, math.atan2(scribe[1], scribe[0]), self.elapsed,
            limit, nothing, nothing, nothing[:3], nothing[:3],
        )  # fmt: skip

    def _refusal(self, azimuth: float, sigma: float, inclination: float) -> str:
        params = self.params
        if abs(params.latitude_deg) > 85.0:
            return north_seek.polar(params)
        if self.elapsed < params.shortest or not math.isfinite(azimuth):
            return f"too short: {self.elapsed:.0f} s of {params.shortest:.0f} s"
        if self.moved:
            return "the tool moved: keep off bottom and in one place"
        if math.sin(inclination) < math.sin(math.radians(3.0)):
            return f"inclination {math.degrees(inclination):.1f} deg: a vertical hole has no azimuth"
        if math.degrees(sigma) > params.worst_sigma_deg:
            return (
                f"the gyro bias is known only to {params.gyro_bias_deg_h:.2g} deg/h, which leaves the azimuth "
                f"uncertain by {math.degrees(sigma):.0f} deg: S1's filter does not take a second position"
            )
        return ""
