# SPDX-License-Identifier: Apache-2.0
"""
Gyro azimuth of a station: north sought while the tool keeps still, and while it is turned to a second position there.

The seek runs on the precision unit's own samples, bin by bin, from the moment the string has settled. A quiet turn
about the axis goes into it, because the second position is what shows the gyro's bias; shaking, a turn that takes too
long or an axis that lies elsewhere end it. What it found of the instrument goes into the seek of the next station.
Its solution states whether the azimuth found may be used.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.clip_flags import UnitSamples
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.time_bins import Bin
from mwd_estimation.gyrocompass import gyro_errors, north_seek
from mwd_estimation.gyrocompass.gyro_errors import GyroErrors
from mwd_estimation.gyrocompass.methods import NorthSeek, StaticSeek
from mwd_estimation.gyrocompass.seek_filter import GAP_NS
from mwd_estimation.gyrocompass.seek_params import S1, SeekParams, at_place, white_noise
from mwd_estimation.gyrocompass.seek_refusal import polar, too_short
from mwd_estimation.gyrocompass.seek_state import State
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core.arrays import Array, Stamps

_ACCEL_X = 3
# Sigma, rad, of which an automatic survey waits for no better one.
_ENOUGH_SIGMA = math.radians(0.7)
# Standard deviation of the axial force, m/s^2, above which a turn ends the seek, and its change at rest above which the
# hole axis lies elsewhere.
_MAX_SHAKE, _MAX_AXIS_STEP = 0.25, 0.03
# Waiting helps while the noise alone makes this share of sigma: it also hides how well a bias fits the latitude.
_BY_NOISE = 0.1
# How often `pending` computes a solution: one costs as much as thousands of samples.
_PENDING_EVERY_S = 2.5
# Bins at rest whose samples give the gyros' white noise.
_REST_BINS = 8


@dataclasses.dataclass(frozen=True)
class _Found:
    """A seek as it was in the last still bin."""

    state: State
    errors: GyroErrors | None  #: known of the gyros when it began
    taught: State | None  #: the seek of which they were learnt last
    last_ns: int


class GyroStation:
    """
    North seeks of one tool, station after station, from its bins in order.

    Parameters
    ----------
    unit : SeekParams
        The precision unit; latitude and gravity are set here.
    latitude_deg : float or None
        None: unknown, and there is no seek.
    gravity : float or None
        Local, m/s^2.
    """

    def __init__(self, unit: SeekParams, latitude_deg: float | None, gravity: float | None) -> None:
        self.unit = unit
        self.params = None if latitude_deg is None else at_place(unit, latitude_deg, gravity)
        self._has_samples = False
        self._refusal: Reason | None = None
        self._gravity = gravity
        self._seek: NorthSeek | StaticSeek | None = None
        self._axis = math.nan
        self._began_ns = 0
        self._turned_s = 0.0
        self._found: _Found | None = None
        self._taught: State | None = None
        self._last_ns: int | None = None
        self._rest: list[tuple[Stamps, Array]] = []
        # Time of the seek, s, at which `pending` was computed last, and its result.
        self._waited: tuple[float, Reason | None] = (-math.inf, None)

    def refuse(self, reason: Reason | None, forget: bool) -> None:
        """
        Give no azimuth from now on, for this reason; None: give azimuths again.

        forget: the samples so far were wrong already, and those to come are not added.
        """
        self._refusal = reason
        if forget:
            self._seek = self._found = None
            self._rest = []

    def add(self, imu: Bin, bin_s: float, settled: bool, still: bool, samples: UnitSamples) -> None:
        """
        Take one bin.

        Parameters
        ----------
        imu : Bin
            Rates and forces of the conventional unit.
        bin_s : float
            Its length, s.
        settled, still : bool
            Whether the string has settled, and whether the tool keeps still in this bin.
        samples : UnitSamples
            Of the precision unit in this bin.
        """
        stamps, values = samples.stamps, samples.values
        self._has_samples = self._has_samples or len(stamps) > 0
        if self.params is None:
            return
        if len(stamps):
            if self._last_ns is not None and stamps[0] - self._last_ns > GAP_NS:
                # The unit may have been switched off meanwhile: nothing it has shown holds any more.
                self._seek = self._found = None
            self._last_ns = int(stamps[-1])
        if self._seek is not None and not self._continues(self._seek, imu, bin_s, still):
            self._seek = None
        if self._seek is None:
            # The samples while the string settles show the unit's noise.
            self._rest = [*self._rest, (stamps, values)][-_REST_BINS:] if still else []
            if still and settled:
                self._began_ns = int(stamps[0]) if len(stamps) else self._last_ns or 0
                self._seek = self._begin(self.params, self._began_ns)
                self._axis, self._turned_s = float(imu.mean[_ACCEL_X]), 0.0
        if self._seek is not None and len(stamps):
            self._seek.run(samples)
            if still and isinstance(self._seek, NorthSeek) and self._seek.elapsed >= self.params.shortest:
                self._found = _Found(self._seek.state.copy(), self._seek.errors, self._taught, int(stamps[-1]))

    def _begin(self, params: SeekParams, first_ns: int) -> NorthSeek | StaticSeek:
        self._waited = (-math.inf, None)
        noise = white_noise(
            np.concatenate([stamps for stamps, _ in self._rest]),
            np.concatenate([values[:, :3] for _, values in self._rest]),
        )
        self.params = at_place(self.unit, params.latitude_deg, self._gravity, noise)
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
        """North so far, or why there is none; None where there is no precision unit."""
        if not self._has_samples:
            return None
        if self._refusal is not None:
            # Surveys before and after a refusal may be of one seek.
            return Solution(self._refusal, self.unit.method, began_ns=None if self._seek is None else self._began_ns)
        if self.params is None:
            return Solution(Reason(ReasonCode.LATITUDE_UNKNOWN), self.unit.method)
        if self._seek is None:
            return Solution(Reason(ReasonCode.TOOL_NOT_STILL), self.unit.method)
        return dataclasses.replace(self._seek.solution(), began_ns=self._began_ns)

    def pending(self) -> Reason | None:
        """
        Reason to wait longer while the tool keeps still; None where waiting brings nothing more.

        An automatic survey that is taken before then has no gyro azimuth, or one that gets better by waiting.
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
