# SPDX-License-Identifier: Apache-2.0
"""
Gyro azimuth of a station: seek north while the tool is still, and while it is turned to a second position.

The seek uses the samples of the precision unit, bin by bin, from the time at which the string has settled. A quiet
rotation about the axis is part of the seek, because the second position shows the gyro bias. Vibration, a rotation that
takes too long, or a moved axis ends the seek. The gyro errors found in a seek are used in the seek of the next station.
The solution of a seek states whether the azimuth may be used.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core import clip_flags
from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.time_bins import Bin
from mwd_estimation.gyrocompass import gyro_errors, north_seek, static_ekf
from mwd_estimation.gyrocompass.gyro_errors import GyroErrors
from mwd_estimation.gyrocompass.seek_filter import GAP_NS
from mwd_estimation.gyrocompass.seek_refusal import WORST_SIGMA, gyro_clipped, polar, too_short, vertical_hole
from mwd_estimation.gyrocompass.seek_state import S1, SeekParams, SeekState, white_noise, with_noise
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.frames import mat_nt

_ACCEL_X = 3  # channel of the axial force in a bin of the conventional unit
# 1 sigma of the azimuth, rad, below which an automatic survey does not wait longer.
_ENOUGH_SIGMA = math.radians(0.7)
# Largest standard deviation and largest change of the axial force during a rotation that does not end the seek, m/s^2;
# and largest change of the axial force at rest without a move of the hole axis, m/s^2.
_MAX_SHAKE, _MAX_AXIS_STEP = 0.25, 0.03
# Smallest share of the sigma that comes from noise at which a longer seek is useful; noise also limits the accuracy of
# a bias.
_BY_NOISE = 0.1
# Interval at which `pending` computes a solution, s: one solution costs as much as thousands of samples.
_PENDING_EVERY_S = 2.5
# Number of bins at rest from which the gyros' white noise is measured.
_REST_BINS = 8


@dataclasses.dataclass(frozen=True)
class _Found:
    """State of a seek in the last bin in which the tool was still."""

    state: SeekState  #: state of the filter
    errors: GyroErrors | None  #: gyro errors known at the start of the seek
    taught: SeekState | None  #: final state of the last seek from which gyro errors were estimated
    last_ns: int  #: stamp of the last sample, ns


class GyroStation:
    """
    North seeks of one tool, station after station, from its bins in order.

    Parameters
    ----------
    unit : SeekParams
        Figures of the precision unit, and the place.
    """

    def __init__(self, unit: SeekParams) -> None:
        self.unit = unit
        self.params = None if math.isnan(unit.latitude_deg) else with_noise(unit)
        self._has_samples = False
        self._refusal: Reason | None = None
        self._seek: NorthSeek | StaticSeek | None = None
        self._axis = math.nan
        self._began_ns = 0
        self._turned_s = 0.0
        self._found: _Found | None = None
        self._taught: SeekState | None = None
        self._last_ns: int | None = None
        self._rest: list[tuple[Stamps, Array]] = []
        # Duration of the seek at which `pending` last computed a solution, s, and the result of `pending`.
        self._waited: tuple[float, Reason | None] = (-math.inf, None)

    def refuse(self, reason: Reason | None, forget: bool) -> None:
        """
        Refuse azimuths from now on for a reason; None allows them again.

        forget: whether the samples so far were already wrong and must be discarded.
        """
        self._refusal = reason
        if forget:
            self._seek = self._found = None
            self._rest = []

    def add(self, imu: Bin, bin_s: float, settled: bool, still: bool, samples: UnitSamples) -> None:
        """
        Process one bin.

        Parameters
        ----------
        imu : Bin
            Rates and forces of the conventional unit in this bin.
        bin_s : float
            Length of the bin.
        settled, still : bool
            Whether the string has settled, and whether the tool is still in this bin.
        samples : UnitSamples
            Samples of the precision unit in this bin.
        """
        stamps, values = samples.stamps, samples.values
        self._has_samples = self._has_samples or len(stamps) > 0
        if self.params is None:
            return
        if len(stamps):
            if self._last_ns is not None and stamps[0] - self._last_ns > GAP_NS:
                # The unit may have been switched off in between, so its earlier data no longer apply.
                self._seek = self._found = None
            self._last_ns = int(stamps[-1])
        if self._seek is not None and not self._continues(self._seek, imu, bin_s, still):
            self._seek = None
        if self._seek is None:
            # Measure the noise of the unit from samples while the string settles.
            self._rest = [*self._rest, (stamps, values)][-_REST_BINS:] if still else []
            if still and settled:
                self._began_ns = int(stamps[0]) if len(stamps) else self._last_ns or 0
                self._seek = self._begin(self._began_ns)
                self._axis, self._turned_s = float(imu.mean[_ACCEL_X]), 0.0
        if self._seek is not None and len(stamps):
            self._seek.run(samples)
            if still and isinstance(self._seek, NorthSeek) and self._seek.elapsed >= self.params.shortest:
                self._found = _Found(self._seek.state.copy(), self._seek.errors, self._taught, int(stamps[-1]))

    def _begin(self, first_ns: int) -> NorthSeek | StaticSeek:
        self._waited = (-math.inf, None)
        noise = white_noise(
            np.concatenate([stamps for stamps, _ in self._rest]),
            np.concatenate([values[:, :3] for _, values in self._rest]),
        )
        self.params = with_noise(self.unit, noise)
        if self.unit.method == S1:
            return StaticSeek(self.params)
        found = self._found
        if found is None:
            self._taught = None
            return NorthSeek(self.params)
        if north_seek.teaches(self.params, found.state, found.taught):
            self._taught = found.state
            learnt = north_seek.learnt(self.params, found.state, found.errors)
            errors = gyro_errors.between_stations(learnt, self.params)
        else:
            self._taught = found.taught
            errors = north_seek.errors_now(self.params, found.state, found.errors)
        return NorthSeek(self.params, gyro_errors.after(errors, self.params, (first_ns - found.last_ns) * 1e-9))

    def _continues(self, seek: NorthSeek | StaticSeek, imu: Bin, bin_s: float, still: bool) -> bool:
        if still:
            return not seek.moved and abs(imu.mean[_ACCEL_X] - self._axis) <= _MAX_AXIS_STEP
        self._turned_s += bin_s
        shake = math.sqrt(imu.scatter[_ACCEL_X, _ACCEL_X] / max(imu.count - 1, 1))
        away = abs(imu.mean[_ACCEL_X] - self._axis)
        quiet = shake <= _MAX_SHAKE and away <= _MAX_SHAKE
        return seek.turns and quiet and self._turned_s <= self.unit.longest_turn_s

    def solution(self) -> Solution | None:
        """Return the azimuth so far, or the reason not to use it; None before the first precision sample."""
        if not self._has_samples:
            return None
        if self._refusal is not None:
            # Keep the beginning of the seek, because surveys before and after a refusal may belong to the same seek.
            return Solution(self._refusal, self.unit.method, began_ns=None if self._seek is None else self._began_ns)
        if self.params is None:
            return Solution(Reason(ReasonCode.LATITUDE_UNKNOWN), self.unit.method)
        if self._seek is None:
            return Solution(Reason(ReasonCode.TOOL_NOT_STILL), self.unit.method)
        return dataclasses.replace(self._seek.solution(), began_ns=self._began_ns)

    def pending(self) -> Reason | None:
        """
        Return the reason why an automatic survey should wait longer while the tool is still, or None.

        The reason is that the gyro azimuth is not known yet, or that its sigma would become smaller. After the shortest
        seek, the result is computed again only every 2.5 s of the seek.
        """
        if not self._has_samples or self.params is None or self._seek is None or self._refusal is not None:
            return None
        if polar(self.params.latitude_deg) is not None:
            return None
        elapsed = self._seek.elapsed
        if elapsed < self.params.shortest:
            return too_short(elapsed, self.params.shortest)
        if elapsed >= self._waited[0] + _PENDING_EVERY_S:
            self._waited = elapsed, self._still_better(self._seek.solution())
        return self._waited[1]

    def _still_better(self, found: Solution) -> Reason | None:
        enough = _ENOUGH_SIGMA
        if math.isfinite(found.sigma) and found.sigma > enough and found.limit > _BY_NOISE * found.sigma:
            return Reason(ReasonCode.SEEK_IMPROVES, found.sigma, enough, (found.elapsed,))
        return None


# Methods of seeking north at a station: the seek with all its states, and the filter of paper S1 (`static_ekf`). The
# latter assumes that the tool does not move and that the gyro bias is small after calibration; a rotation of the tool
# ends its seek.


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
