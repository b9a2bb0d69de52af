# SPDX-License-Identifier: Apache-2.0
"""
A survey while the string turns: gravity and field averaged in axes that do not turn with the string.

The axes are tool axes rotated back about the hole by the toolface, so that z points to the high side: in these axes,
cross-axis errors of the sensors average out. The direction of gravity comes from the gravity method, which vibration
does not bias; its magnitude is the mean force along this direction. Such a survey has no toolface.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.time_bins import Average
from mwd_estimation.core.track import ROTATING_ABOVE
from mwd_estimation.survey.static_survey import Refusal, StillAverage
from mwd_sensors.core.arrays import Array, Samples

# Largest share of the samples in which the string does not turn.
_STOPS = 0.2
_FEWEST = 20  # smallest number of samples for an average


@dataclasses.dataclass(frozen=True)
class Progress:
    """Progress of a survey: elapsed and remaining time, s, number of samples, and state in words."""

    elapsed: float
    remaining: float
    samples: int
    state: str


class RotarySurvey:
    """
    One survey while the string turns.

    Parameters
    ----------
    duration_s : float
        Averaging time.

    Raises
    ------
    ValueError
        If the duration is not finite, or shorter than 5 s.
    """

    def __init__(self, duration_s: float) -> None:
        if not (math.isfinite(duration_s) and duration_s >= 5.0):
            raise ValueError(f"duration: must be at least 5 s, or 0 for the configured one, got {duration_s:g}")
        self.duration = duration_s
        self._begin: int | None = None
        self._last = 0
        self._down: list[Array] = []
        self._along: list[Array] = []
        self._field: list[Array] = []
        self._sigma: list[Array] = []
        self._rates: list[Array] = []
        self._turning = 0
        self._samples = 0

    @property
    def rotary_speed(self) -> float:
        """Mean rate about the axis, rad/s; NaN before the first sample."""
        return float(np.concatenate(self._rates)[:, 0].mean()) if self._rates else math.nan

    def progress(self) -> Progress:
        """Return the progress of the survey."""
        elapsed = (self._last - self._begin) * 1e-9 if self._begin is not None else 0.0
        turns = self._turning >= (1.0 - _STOPS) * self._samples
        words = "averaging" if turns else "the string hardly turns"
        return Progress(elapsed, max(self.duration - elapsed, 0.0), self._samples, words)

    def add(self, samples: Samples, pairs: Samples) -> StillAverage | Refusal | None:
        """
        Add a block of samples, dtype `attitude.sample.SAMPLE`, and the magnetic samples paired with gravity in it.

        Returns
        -------
        StillAverage or Refusal or None
            When the duration is over, the average, or a refusal with the reason; before that None.
        """
        stamps, gyro, accel, down = (samples[name] for name in ("stamp_ns", "gyro", "accel", "down"))
        if self._begin is None:
            self._begin = int(stamps[0])
        end_ns = self._begin + round(self.duration * 1e9)
        known = np.isfinite(down).all(axis=1) & np.isfinite(accel).all(axis=1) & np.isfinite(gyro).all(axis=1)
        use = known & (stamps < end_ns)
        down = down[use]
        self._down.append(_turned_back(down, down))
        self._along.append(-np.einsum("ij,ij->i", accel[use], down))
        self._sigma.append(samples["sigma_inclination"][use])
        self._rates.append(gyro[use])
        self._samples += int(use.sum())
        self._turning += int((np.abs(samples["rotary_speed"][use]) > ROTATING_ABOVE).sum())
        if len(pairs["stamp_ns"]):
            within = pairs["stamp_ns"] < end_ns
            self._field.append(_turned_back(pairs["b_t"][within], pairs["g_t"][within]))
        self._last = int(min(stamps[-1], end_ns))
        return self._ended(end_ns) if stamps[-1] >= end_ns else None

    def _ended(self, end_ns: int) -> StillAverage | Refusal:
        if self._samples < _FEWEST:
            return Refusal(end_ns, Reason(Code.TOO_FEW_WITH_GRAVITY, float(self._samples), float(_FEWEST)))
        if self._turning < (1.0 - _STOPS) * self._samples:
            return Refusal(end_ns, Reason(Code.STRING_DOES_NOT_TURN))
        down, along = np.concatenate(self._down), np.concatenate(self._along)
        mean = down.mean(axis=0)
        mean /= np.linalg.norm(mean)
        size = float(along.mean())
        tilt = float(np.concatenate(self._sigma).mean())
        # The sigma of the direction is that of the gravity method. The variance of the magnitude is divided by the
        # number of seconds and not of samples, because samples are correlated.
        spread = along.var() / max(self.duration, 1.0)
        covariance = (tilt * size) ** 2 * (np.eye(3) - np.outer(mean, mean)) + spread * np.outer(mean, mean)
        rates = np.concatenate(self._rates)
        whole = np.zeros((6, 6))
        whole[:3, :3], whole[3:, 3:] = np.cov(rates.T) / len(rates), covariance
        imu = Average(np.concatenate([rates.mean(axis=0), -size * mean]), whole, self._samples)
        field = np.concatenate(self._field) if self._field else np.zeros((0, 3))
        mag = Average(field.mean(axis=0), np.cov(field.T) / len(field), len(field)) if len(field) >= _FEWEST else None
        begin = self._begin if self._begin is not None else end_ns
        return StillAverage(begin, end_ns, imu, mag, None, None, requested=True)


def _turned_back(vectors: Array, down: Array) -> Array:
    """Return vectors, shape (n, 3), in axes whose z is the high side of gravity's direction `down`, shape (n, 3)."""
    across = np.maximum(np.hypot(down[:, 1], down[:, 2]), 1e-12)
    sine, cosine = -down[:, 1] / across, -down[:, 2] / across
    y, z = vectors[:, 1], vectors[:, 2]
    return np.stack([vectors[:, 0], cosine * y - sine * z, sine * y + cosine * z], axis=1)
