# SPDX-License-Identifier: Apache-2.0
"""
Methods of seeking north at a station: the seek with all its states, and the filter of paper S1 (`static_ekf`).

`static_ekf` assumes that the tool does not move and that the gyro bias is small after calibration; a rotation of the
tool ends its seek.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.gyrocompass import north_seek, static_ekf
from mwd_estimation.gyrocompass.gyro_errors import GyroErrors
from mwd_estimation.gyrocompass.seek_params import S1, SeekParams
from mwd_estimation.gyrocompass.seek_refusal import WORST_SIGMA, gyro_clipped, polar, too_short, vertical_hole
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.frames import mat_nt


class NorthSeek:
    """
    North seek with the filter of `north_seek`.

    errors: gyro errors that an earlier seek has found; None in the first seek.
    """

    #: Whether a rotation about the tool's axis may be part of the seek.
    turns = True

    def __init__(self, params: SeekParams, errors: GyroErrors | None = None) -> None:
        self.params, self.errors = params, errors
        self.state = north_seek.initial()

    @property
    def elapsed(self) -> float:
        """Duration of the used data, s."""
        return float(self.state.elapsed)

    @property
    def moved(self) -> bool:
        """Whether the hole axis moved during the seek."""
        return bool(self.state.moved > 0)

    def run(self, samples: UnitSamples) -> None:
        """Process samples of the precision unit."""
        stamps, values, clipped = samples
        north_seek.run(self.params, self.state, stamps, values[:, :3], values[:, 3:], clipped)

    def solution(self) -> Solution:
        """Return the azimuth so far, or the reason why it must not be used."""
        return north_seek.solution(self.params, self.state, self.errors)


class StaticSeek:
    """North seek with the filter `static_ekf`, which has 15 states; it shares its parameters with `north_seek`."""

    turns = False

    def __init__(self, params: SeekParams) -> None:
        self.params = params
        self._state = static_ekf.initial()
        self._first_ns: int | None = None
        self._last_ns = 0
        self._samples = self._clipped = 0

    @property
    def elapsed(self) -> float:
        """Duration of the used data, s."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    @property
    def moved(self) -> bool:
        """Whether the tool has moved, because the squared innovations are too large for their variances."""
        return bool(self._state.ratio > static_ekf.MOVED_RATIO)

    def run(self, samples: UnitSamples) -> None:
        """Process samples of the precision unit, and count those in which a gyro clipped; do nothing near a pole."""
        stamp_ns, values, clipped = samples
        if len(stamp_ns) == 0 or polar(self.params.latitude_deg) is not None:
            return
        flags = clip_flags.given(clipped, len(stamp_ns))
        self._clipped += int(np.count_nonzero(flags & ~np.uint8(clip_flags.ACCEL)))
        self._samples += len(stamp_ns)
        static_ekf.run(self.params, self._state, stamp_ns, values[:, :3], values[:, 3:])
        self._first_ns = int(stamp_ns[0]) if self._first_ns is None else self._first_ns
        self._last_ns = int(stamp_ns[-1])

    def solution(self) -> Solution:
        """Return the azimuth so far, or the reason why it must not be used."""
        params, found = self.params, static_ekf.north(self._state)
        horizontal = EARTH_RATE * math.cos(math.radians(params.latitude_deg))
        noise = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR
        limit = min(noise / (horizontal * math.sqrt(max(self.elapsed, 1e-3))), math.pi)
        reason = self._refusal(found)
        scribe = mat_nt(found.inclination, found.azimuth, found.toolface)[:, 2]
        scribe_azimuth = math.atan2(scribe[1], scribe[0])
        return Solution(reason, S1, found.azimuth, found.sigma, found.inclination, scribe_azimuth, self.elapsed, limit)

    def _refusal(self, found: static_ekf.StaticNorth) -> Reason | None:
        params = self.params
        pole = polar(params.latitude_deg)
        if pole is not None:
            return pole
        clipped = gyro_clipped(params, self._clipped, self._samples)
        if clipped is not None:
            return clipped
        if self.elapsed < params.shortest or not math.isfinite(found.azimuth):
            return too_short(self.elapsed, params.shortest)
        if self.moved:
            return Reason(ReasonCode.TOOL_MOVED, float(self._state.ratio), static_ekf.MOVED_RATIO)
        vertical = vertical_hole(found.inclination)
        if vertical is not None:
            return vertical
        if found.sigma > WORST_SIGMA:
            bias = params.gyro_bias_deg_h * DEG_PER_HOUR
            return Reason(ReasonCode.GYRO_BIAS_UNKNOWN_STATIC, found.sigma, WORST_SIGMA, (bias,))
        return None
