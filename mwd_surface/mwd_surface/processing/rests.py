# SPDX-License-Identifier: Apache-2.0
"""Intervals in which a tool stands, from its samples: how many are long enough for a survey."""

from __future__ import annotations

import itertools

import numpy as np

from mwd_estimation.survey.static_survey import MAX_FORCE_NOISE, MAX_RATE
from mwd_estimation.survey.survey_settings import SurveySettings
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Stamps

_BIN_NS = wire.NANOSECONDS // 2


class Rests:
    """
    Counts the intervals at rest, taken block by block, by the limits of a survey.

    settings : of surveys in still intervals.

    Attributes
    ----------
    count : int
        Intervals of at least the settling and averaging time.
    longest_s : float
        Longest interval.
    """

    def __init__(self, settings: SurveySettings) -> None:
        self._settings = settings
        self.count = 0
        self.longest_s = 0.0
        self._still_s = 0.0
        self._rest: tuple[Stamps, Array] = np.empty(0, dtype=np.int64), np.empty((0, 6))

    def take(self, stamp_ns: Stamps, gyro: Array, accel: Array) -> None:
        """Take samples: shapes (n,), ns, and (n, 3), rad/s and m/s^2."""
        stamps = np.concatenate([self._rest[0], stamp_ns])
        values = np.concatenate([self._rest[1], np.hstack([gyro, accel])])
        bins = stamps // _BIN_NS
        starts = np.flatnonzero(np.diff(bins, prepend=bins[:1] - 1))
        for start, stop in itertools.pairwise(starts):
            self._close(values[start:stop])
        self._rest = stamps[starts[-1] :], values[starts[-1] :]

    def _close(self, values: Array) -> None:
        """Judge half a second."""
        limit = self._settings
        max_rate = MAX_RATE * limit.motion
        mean, noise = values.mean(axis=0), values.std(axis=0)
        turns = np.linalg.norm(mean[:3]) > max_rate or noise[:3].max() > max_rate
        if turns or noise[3:].max() > MAX_FORCE_NOISE * limit.motion or not np.isfinite(mean).all():
            self._still_s = 0.0
            return
        before, needed = self._still_s, limit.settle_s + limit.duration_s
        self._still_s += _BIN_NS * 1e-9
        self.longest_s = max(self.longest_s, self._still_s)
        self.count += int(before < needed <= self._still_s)
