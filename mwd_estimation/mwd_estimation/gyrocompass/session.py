# SPDX-License-Identifier: Apache-2.0
"""
North seek on request: it runs for a set time and reports progress; the tool may rest or rotate.

Bins of time are processed as they close. If the string rotates faster than the range of the precision unit's x gyro,
the x gyro of the conventional unit is used instead, with the figures of the conventional unit.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_filter import LEVEL_S
from mwd_estimation.gyrocompass.seek_state import SeekParams, white_noise, with_noise
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.arrays import Array, Stamps

# Number of bins from which the white noise of the unit is measured.
_NOISE_BINS = 8
# Time added to a requested duration for settling after levelling, and for the first and last bin of a seek, s.
_SETTLING_S = 2.0
MODES = ("still", "two_position", "rotating")


@dataclasses.dataclass(frozen=True)
class SessionParams:
    """Duration of a north seek on request, and figures of the conventional unit's x gyro, 1 sigma each."""

    duration_s: float = 120.0  #: duration of a seek if the request gives none, s
    #: White noise of the conventional unit's x gyro, used on a string that rotates fast, deg/sqrt(h).
    x_noise_deg_rth: float = 0.42
    x_bias_deg_h: float = 400.0  #: bias of the conventional unit's x gyro, deg/h
    x_scale_ppm: float = 5000.0  #: scale error of the conventional unit's x gyro, ppm


class NorthSession:
    """
    One north seek on request.

    Parameters
    ----------
    unit : SeekParams
        Figures of the precision unit, and the place.
    duration_s : float
        Duration; 0: the duration of `params`. A seek that begins again lasts longer, up to twice the duration.
    mode : str
        One of `MODES`, or empty to accept any motion.

    Raises
    ------
    ValueError
        If the mode is unknown, or the duration is negative, not finite or too short for a result.
    """

    def __init__(
        self,
        params: SessionParams,
        unit: SeekParams,
        duration_s: float,
        mode: str,
    ) -> None:
        if mode and mode not in MODES:
            raise ValueError(f"mode: must be {', '.join(MODES)}, or empty; got {mode!r}")
        if not (math.isfinite(duration_s) and (duration_s == 0.0 or duration_s >= unit.shortest)):
            raise ValueError(f"duration: must be 0 or at least {unit.shortest:g} s, got {duration_s:g}")
        # Levelling and settling do not count for the shortest seek.
        self.duration = max(duration_s or params.duration_s, unit.shortest + LEVEL_S + _SETTLING_S)
        self._longest = 2.0 * self.duration
        self.elapsed = 0.0
        self._conventional = params
        self._unit, self._mode = unit, mode or "auto"
        self._params = dataclasses.replace(with_noise(unit), mode=self._mode)
        # The first bins are kept until the unit's noise has been measured from them.
        self._first: list[tuple[UnitSamples, tuple[Stamps, Array]]] | None = []
        self._range = math.radians(unit.gyro_range_dps)
        self._state = north_seek.initial()
        self._has_samples = False

    @property
    def remaining(self) -> float:
        """Remaining time of the seek, s."""
        return max(self.duration - self.elapsed, 0.0)

    @property
    def done(self) -> bool:
        """Whether the duration of the seek is over."""
        return self.elapsed >= self.duration

    def add(self, seconds: float, precision: UnitSamples, ahrs: tuple[Stamps, Array]) -> None:
        """
        Process one bin.

        Parameters
        ----------
        seconds : float
            Length of the bin, s.
        precision : UnitSamples
            Samples of the precision unit.
        ahrs : (stamps (m,), rates (m, 3))
            Stamps and rates of the conventional unit, rad/s.
        """
        self.elapsed += seconds
        if not len(precision.stamps):
            return
        self._has_samples = True
        if self._first is None:
            self._take(precision, ahrs)
            return
        self._first.append((precision, ahrs))
        if len(self._first) == _NOISE_BINS:
            self._params = dataclasses.replace(self._params_now(self._first), mode=self._mode)
            for one in self._first:
                self._take(*one)
            self._first = None

    def _params_now(self, first: list[tuple[UnitSamples, tuple[Stamps, Array]]]) -> SeekParams:
        """
        Return the parameters with the noise measured in the first bins.

        If the string rotates too fast for the precision x gyro, they have the figures of the conventional x gyro.
        """
        stamps = np.concatenate([precision.stamps for precision, _ in first])
        rates = np.concatenate([precision.values[:, :3] for precision, _ in first])
        x_rates = np.concatenate([*(ahrs[1][:, 0] for _, ahrs in first), rates[:, 0]])
        params = with_noise(self._unit, white_noise(stamps, rates))
        if float(np.nanmax(np.abs(x_rates))) <= 0.9 * self._range:
            return params
        return dataclasses.replace(
            params,
            gyro_x_noise_deg_rth=self._conventional.x_noise_deg_rth,
            gyro_x_bias_deg_h=self._conventional.x_bias_deg_h,
            scale_x_ppm=self._conventional.x_scale_ppm,
        )

    def _take(self, precision: UnitSamples, ahrs: tuple[Stamps, Array]) -> None:
        stamps, values, clipped = precision
        rates = values[:, :3]
        if len(ahrs[0]):
            rates = north_seek.dual_unit(stamps, rates, *ahrs, self._range, clipped)
            clipped = None if clipped is None else clipped & ~np.uint8(clip_flags.AXIAL_GYRO)
        before = float(self._state.elapsed)
        north_seek.run(self._params, self._state, stamps, rates, values[:, 3:], clipped)
        if self._state.elapsed < before:
            # The seek has begun again: extend its duration by the time that was lost.
            self.duration = min(self.duration + before + LEVEL_S + _SETTLING_S, self._longest)

    def solution(self) -> Solution:
        """Return the azimuth so far, or the reason why it must not be used."""
        found = north_seek.solution(self._params, self._state)
        if self._has_samples:
            return found
        return dataclasses.replace(found, reason=Reason(ReasonCode.NO_PRECISION_UNIT))
