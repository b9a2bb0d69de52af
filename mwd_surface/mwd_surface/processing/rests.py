# SPDX-License-Identifier: Apache-2.0
"""
Count of the intervals in which a tool rests long enough for a survey, and detection of a gyro in a wrong unit.

The accelerometers alone also show intervals at rest. The gyro may be in another unit if the accelerometers are at rest,
the gyro shows turning or noise, gravity does not follow this turning, and no axis of the gyro has most of the noise, as
the axis of a turning string has. If a gyro in deg/s is read in rad/s, its rate and noise are 57 times too large.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.survey.static_survey import BIN_NS, MAX_FORCE_NOISE, MAX_FORCE_STEP, MAX_RATE
from mwd_estimation.survey.survey_settings import SurveySettings
from mwd_sensors.core.arrays import Array, Samples
from mwd_surface.processing.input_stream import StreamProblem

_DEG = math.pi / 180.0
# Smallest ratio of the noise of the quietest to the noisiest axis of a gyro in a wrong unit; a turning string has most
# of the noise along its axis, so that the ratio is smaller.
_ALIKE = 0.4
_FEW = 3  # smallest number of samples in half a second that can be judged, as for a survey


class Rests:
    """
    Counter of the intervals at rest, block by block, with the limits of a survey.

    settings : settings of static surveys.
    """

    def __init__(self, settings: SurveySettings) -> None:
        self._settings = settings
        self._needed_s = settings.settle_s + settings.duration_s
        self._count = self._half_seconds = self._sampled = 0
        self.longest_s = 0.0  #: longest interval at rest, s
        #: Longest interval in which the accelerometers show rest, and the gyro would show rest if its unit were deg/s.
        self.hidden_s = 0.0
        self._still_s = self._hiding_s = 0.0
        self._before = np.full(3, np.nan)
        self._open = np.empty(0, dtype=np.int64), np.empty((0, 6))

    def take(self, samples: Samples) -> None:
        """Add samples of the IMU in SI."""
        stamps = np.concatenate([self._open[0], samples["stamp_ns"]])
        values = np.hstack([samples["angular_velocity"], samples["linear_acceleration"]])
        values = np.concatenate([self._open[1], values])
        bins = stamps // BIN_NS
        starts = np.flatnonzero(np.diff(bins, prepend=bins[:1] - 1))
        self._open = stamps[starts[-1] :], values[starts[-1] :]
        if len(starts) < 2:
            return
        # Leave out the last half second, whose samples may not be complete.
        counts, values = np.diff(starts), values[: starts[-1]]
        mean = np.add.reduceat(values, starts[:-1]) / counts[:, None]
        away = values - np.repeat(mean, counts, axis=0)
        noise = np.sqrt(np.add.reduceat(away * away, starts[:-1]) / counts[:, None])
        follows = np.diff(bins[starts[:-1]], prepend=bins[0] - 1) == 1
        self._half_seconds += len(counts)
        self._sampled += int(np.count_nonzero(counts >= _FEW))
        for k in range(len(counts)):
            self._close(mean[k], noise[k], bool(follows[k]) and counts[k] >= _FEW)

    @property
    def count(self) -> int | None:
        """Number of intervals long enough for a survey; None if most half seconds have too few samples to judge."""
        return self._count if 2 * self._sampled > self._half_seconds else None

    def problems(self, imu: str, gyro_unit: str) -> list[StreamProblem]:
        """
        Return a problem if no interval at rest is long enough, but one would be if the gyro unit were deg/s.

        gyro_unit : unit in which the gyro was read; the result is empty unless it is rad/s.
        """
        if self.count or self.hidden_s < self._needed_s or gyro_unit != "rad/s":
            return []
        sentence = (
            f"{imu}: the accelerometers show rest for {self.hidden_s:.0f} s, but the gyro shows rotation or noise, "
            "as if values in deg/s were read as rad/s"
        )
        return [StreamProblem(sentence, ("gyro_unit", "deg/s"))]

    def _close(self, mean: Array, noise: Array, follows: bool) -> None:
        """
        Judge half a second.

        mean, noise, shape (6,) : mean and standard deviation of rate, rad/s, and specific force, m/s2.
        follows : whether the half second has enough samples and directly follows the previous half second.
        """
        limit, speed = MAX_RATE * self._settings.motion, float(np.linalg.norm(mean[:3]))
        quiet = follows and bool(noise[3:].max() <= MAX_FORCE_NOISE * self._settings.motion) and math.isfinite(speed)
        steady = quiet and not bool(np.abs(mean[3:] - self._before).max() > MAX_FORCE_STEP)
        self._before = mean[3:]
        turning, shaking = speed > limit, bool(noise[:3].max() > limit)
        if quiet and not turning and not shaking:
            before = self._still_s
            self._still_s += BIN_NS * 1e-9
            self.longest_s = max(self.longest_s, self._still_s)
            self._count += int(before < self._needed_s <= self._still_s)
        else:
            self._still_s = 0.0
        down = mean[3:] / max(float(np.linalg.norm(mean[3:])), 1e-9)
        across = float(np.linalg.norm(np.cross(mean[:3], down)))
        contradicted = across > limit or (shaking and bool(noise[:3].min() > _ALIKE * noise[:3].max()))
        in_degrees = speed * _DEG <= limit and bool(noise[:3].max() * _DEG <= limit)
        self._hiding_s = self._hiding_s + BIN_NS * 1e-9 if steady and contradicted and in_degrees else 0.0
        self.hidden_s = max(self.hidden_s, self._hiding_s)
