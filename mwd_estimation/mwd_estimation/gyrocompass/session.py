"""
North sought because somebody asked: for a set time, with progress, in whatever the tool does meanwhile.

Bins of time go in as they close. While the string turns faster than the precision unit's x axis follows, the
conventional unit's stands in for it, with its own figures.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.gyrocompass import seek as north_seek
from mwd_estimation.gyrocompass.seek import Solution
from mwd_estimation.gyrocompass.station import GyroSettings, params_of, white_noise
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.settings import setting

# Bins that tell the unit's noise, and the rate below which a tool rests, rad/s.
_NOISE_BINS = 8
_AT_REST = 0.05
MODES = ("still", "two_position", "rotating")


@dataclasses.dataclass(frozen=True)
class Params:
    """How long north is sought on request, and the conventional unit's x gyro, one sigma each."""

    duration_s: float = setting(120.0, "Time where the request names none", unit="s", low=10.0, high=86400.0)
    x_noise_deg_rth: float = setting(0.42, "White noise", unit="deg/sqrt(h)", low=1e-5, high=100.0)
    x_bias_deg_h: float = setting(400.0, "Bias not known to better than", unit="deg/h", low=0.0, high=1e5)
    x_scale_ppm: float = setting(5000.0, "Scale not known to better than", unit="ppm", low=0.0, high=1e5)


@dataclasses.dataclass(frozen=True)
class Progress:
    """How far a seek is: s, s, rad from true north and 1 sigma (nan: not yet), and in words."""

    elapsed: float
    remaining: float
    azimuth: float
    sigma: float
    state: str


class NorthRun:
    """
    One seek.

    Parameters
    ----------
    params : Params
    gyro : GyroSettings
    latitude_deg : float
    gravity : float or None
        Local, m/s^2.
    duration_s : float
        0: as configured.
    mode : str
        One of `MODES`, or empty: by what the tool does.

    Raises
    ------
    ValueError
        Another mode, a duration that is negative, not finite or too short for an answer.
    """

    def __init__(
        self,
        params: Params,
        gyro: GyroSettings,
        latitude_deg: float,
        gravity: float | None,
        duration_s: float,
        mode: str,
    ) -> None:
        if mode and mode not in MODES:
            raise ValueError(f"mode: must be {', '.join(MODES)}, or empty; got {mode!r}")
        if not (math.isfinite(duration_s) and (duration_s == 0.0 or duration_s >= gyro.shortest_s)):
            raise ValueError(f"duration: must be 0 or at least {gyro.shortest_s:g} s, got {duration_s:g}")
        self.duration = duration_s or params.duration_s
        self.elapsed = 0.0
        self._unit = params
        self._gyro, self._latitude, self._gravity, self._mode = gyro, latitude_deg, gravity, mode or "auto"
        self._params = dataclasses.replace(params_of(gyro, latitude_deg, gravity), mode=self._mode)
        # The first bins wait until they have told the unit's noise.
        self._first: list[tuple[tuple[Stamps, Array], tuple[Stamps, Array]]] | None = []
        self._range = math.radians(gyro.range_dps)
        self._state = north_seek.initial()
        self._heard = False

    @property
    def done(self) -> bool:
        """Whether the time is over."""
        return self.elapsed >= self.duration

    def add(self, seconds: float, precision: tuple[Stamps, Array], ahrs: tuple[Stamps, Array]) -> None:
        """
        Take one bin.

        Parameters
        ----------
        seconds : float
            Its length.
        precision : (stamps (n,), values (n, 6))
            Rates, rad/s, and forces, m/s^2, of the precision unit.
        ahrs : (stamps (m,), rates (m, 3))
            Of the conventional unit, rad/s.
        """
        self.elapsed += seconds
        if not len(precision[0]):
            return
        self._heard = True
        if self._first is None:
            self._take(precision, ahrs)
            return
        self._first.append((precision, ahrs))
        if len(self._first) == _NOISE_BINS:
            self._params = dataclasses.replace(self._params_now(self._first), mode=self._mode)
            for one in self._first:
                self._take(*one)
            self._first = None

    def _params_now(self, first: list[tuple[tuple[Stamps, Array], tuple[Stamps, Array]]]) -> north_seek.Params:
        """Settings of the seek with the noise that the tool shows at rest, or with the x gyro that can follow it."""
        stamps = np.concatenate([precision[0] for precision, _ in first])
        rates = np.concatenate([precision[1][:, :3] for precision, _ in first])
        x_rates = np.concatenate([*(ahrs[1][:, 0] for _, ahrs in first), rates[:, 0]])
        fastest = float(np.nanmax(np.abs(x_rates)))
        noise = white_noise(stamps, rates) if fastest < _AT_REST else None
        params = params_of(self._gyro, self._latitude, self._gravity, noise)
        if fastest <= 0.9 * self._range:
            return params
        return dataclasses.replace(
            params,
            gyro_x_noise_deg_rth=self._unit.x_noise_deg_rth,
            gyro_x_bias_deg_h=self._unit.x_bias_deg_h,
            scale_x_ppm=self._unit.x_scale_ppm,
        )

    def _take(self, precision: tuple[Stamps, Array], ahrs: tuple[Stamps, Array]) -> None:
        stamps, values = precision
        rates = values[:, :3]
        if len(ahrs[0]):
            rates = north_seek.dual_unit(stamps, rates, *ahrs, self._range)
        north_seek.run(self._params, self._state, stamps, rates, values[:, 3:])

    def progress(self) -> Progress:
        """How far it is."""
        found = self.solution()
        left = max(self.duration - self.elapsed, 0.0)
        known = math.isfinite(found.azimuth) and math.isfinite(found.sigma)
        azimuth, sigma = (found.azimuth, found.sigma) if known else (math.nan, math.nan)
        words = f"seeking, {found.method}" if found.success else found.reason
        return Progress(self.elapsed, left, azimuth, sigma, words)

    def solution(self) -> Solution:
        """What was found so far."""
        found = north_seek.solution(self._params, self._state)
        if self._heard:
            return found
        return dataclasses.replace(
            found, success=False, reason="nothing is heard of the precision unit (gyro/data_raw)"
        )
