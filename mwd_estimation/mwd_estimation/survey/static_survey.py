# SPDX-License-Identifier: Apache-2.0
"""
Surveys in still intervals: detect that the tool keeps still, average, and return one average per interval.

Each bin (half a second) is either still or not; a survey needs a sequence of still bins, and the string settles in the
first of them. Bins begin at fixed times, so a replay takes the same survey from the same samples.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.time_bins import Average, Bin, average
from mwd_estimation.survey.survey_settings import LONGEST_S, SHORTEST_S, SurveySettings

BIN_NS = 500_000_000
_BIN_S = BIN_NS * 1e-9
# Largest mean and largest standard deviation of the angular rate, rad/s, and largest standard deviation of the specific
# force, m/s^2, of a still tool; all are multiplied by `SurveySettings.motion`. And largest change of the mean force
# between bins, m/s^2.
MAX_RATE, MAX_FORCE_NOISE, MAX_FORCE_STEP = 0.03, 0.25, 0.1
# Largest change of the mean field between bins, and largest standard deviation of the field in a bin, T, of a still
# tool without a gyro; both are multiplied by `SurveySettings.motion`. A rotation at MAX_RATE in 20 uT across the axis
# causes this change; a change up to _FIELD_SIGMAS times the sigma of the two means is noise. The limit of the standard
# deviation is above the noise of any magnetometer.
MAX_FIELD_STEP, MAX_FIELD_NOISE, _FIELD_SIGMAS = MAX_RATE * _BIN_S * 20e-6, 2e-6, 4.0


@dataclasses.dataclass(frozen=True)
class StillAverage:
    """Mean readings of the sensors while the tool kept still."""

    #: `start_ns`, `end_ns`: start and end of the averaging interval.
    start_ns: int
    end_ns: int
    imu: Average  #: conventional unit; channels: rate x y z, rad/s, specific force x y z, m/s^2
    mag: Average | None  #: field, T; None without usable magnetometer
    precision: Average | None  #: precision unit; channels as in `imu`
    temperature: float | None  #: mean temperature, degC
    requested: bool  #: whether the survey was requested; False for an automatic one
    moved: bool = False  #: whether a motion of the tool ended the interval


@dataclasses.dataclass(frozen=True)
class Refusal:
    """Refusal of a requested survey."""

    stamp_ns: int  #: time of the refusal, ns
    reason: Reason  #: reason why the survey was not taken


@dataclasses.dataclass(frozen=True)
class BinSet:
    """The bins of all streams with the same index; None for a stream without samples."""

    imu: Bin
    mag: Bin | None = None
    precision: Bin | None = None
    temperature: Bin | None = None


class StillSurvey:
    """State machine over bins that returns one average per still interval, and more on request."""

    def __init__(self, settings: SurveySettings) -> None:
        self.settings = settings
        #: For each reason why bins were not still: number of these bins, and the reason of the last one.
        self.hindrances: dict[Code, tuple[int, Reason]] = {}
        self._settles, self._lasts = _bins(settings.settle_s, least=0), _bins(settings.duration_s)
        self.still_bins = 0
        self._run: list[BinSet] = []
        self._taken = False
        self._requested_bins = 0
        self.waits_for: Reason | None = None

    def request(self, duration_s: float = 0.0) -> None:
        """
        Request a survey that starts with the next bin; duration_s: averaging time, 0 for the time of the settings.

        Raises
        ------
        ValueError
            If the duration is negative, not finite, shorter than SHORTEST_S or longer than LONGEST_S.
        """
        if duration_s and not SHORTEST_S <= duration_s <= LONGEST_S:
            rule = f"{SHORTEST_S:g} to {LONGEST_S:g} s, or 0 for the configured one"
            raise ValueError(f"duration: must be {rule}, got {duration_s:g}")
        self._requested_bins = _bins(duration_s or self.settings.duration_s)
        self._run, self.waits_for = [], None

    @property
    def requested(self) -> bool:
        """Whether a requested survey is not complete yet."""
        return self._requested_bins > 0

    @property
    def progress(self) -> float:
        """Progress of the current survey, 0 to 1; 0 while the tool moves, 1 after the survey."""
        if self._taken and not self._requested_bins:
            return 1.0
        share = min(len(self._run) / self._needed(), 1.0)
        return share if self.waits_for is None else min(share, 0.99)

    @property
    def waited_s(self) -> float:
        """Time for which a survey with enough samples has waited for the gyro, s; 0 if no survey waits."""
        return 0.0 if self.waits_for is None else (len(self._run) - self._needed()) * _BIN_S

    @property
    def complete(self) -> bool:
        """Whether an automatic survey has enough samples with the next bin, and may then wait for the gyro."""
        unasked = self.settings.automatic and not self._taken and self._requested_bins == 0
        return unasked and len(self._run) >= self._needed() - 1

    def add(self, bins: BinSet, wait: Reason | None = None) -> StillAverage | Refusal | None:
        """
        Add the next closed bin, in order; return the average that it completes, the refusal that it causes, or None.

        wait: reason for which an automatic survey waits longer and continues to average; None: it does not wait.
        """
        motion = self._motion(bins, self._run[-1] if self._run else None)
        if motion is not None:
            self.hindrances[motion.code] = self.hindrances.get(motion.code, (0, motion))[0] + 1, motion
            refused = Refusal((bins.imu.index + 1) * BIN_NS, motion) if self._requested_bins else None
            held, waited = self._run[self._settles :], self.waits_for
            self.still_bins, self._run, self._taken, self._requested_bins = 0, [], False, 0
            self.waits_for = None
            return refused if waited is None else dataclasses.replace(_averaged(held, False), moved=True)
        self.still_bins += 1
        self._run.append(bins)
        settle = 0 if self._requested_bins else self._settles
        needed = self._needed()
        if self._requested_bins == 0 and (self._taken or not self.settings.automatic):
            self._run = self._run[-1:]
            return None
        if len(self._run) < needed:
            return None
        over = len(self._run) - needed >= _bins(self.settings.wait_for_gyro_s, least=0)
        self.waits_for = None if self._requested_bins or over else wait
        if self.waits_for is not None:
            return None
        requested, self._requested_bins, self._taken = self._requested_bins > 0, 0, True
        chosen, self._run = self._run[settle:], self._run[-1:]
        return _averaged(chosen, requested)

    def finish(self) -> StillAverage | None:
        """End a survey that waits, at the end of the data, and return its average; return None if no survey waits."""
        if self.waits_for is None:
            return None
        held, self.waits_for, self._taken = self._run[self._settles :], None, True
        self._run = self._run[-1:]
        return _averaged(held, False)

    def _needed(self) -> int:
        if self._requested_bins:
            return self._requested_bins
        return self._settles + self._lasts

    def _motion(self, bins: BinSet, before: BinSet | None) -> Reason | None:
        """Return the reason why a bin is not still, with value and limit; None if it is still."""
        imu, last = bins.imu, before.imu if before is not None else None
        if imu.count < 3:
            return Reason(Code.TOO_FEW_SAMPLES, float(imu.count), 3.0)
        if last is not None and imu.index != last.index + 1:
            return Reason(Code.SAMPLES_MISSING)
        # Use Python floats: for six numbers, arrays take ten times as long.
        mean, motion = imu.mean.tolist(), self.settings.motion
        max_rate, max_force_noise = MAX_RATE * motion, MAX_FORCE_NOISE * motion
        rate = max(abs(value) for value in mean[:3])
        if rate > max_rate:
            return Reason(Code.TOOL_TURNS, rate, max_rate)
        variance = [max(value, 0.0) / (imu.count - 1) for value in imu.scatter.diagonal().tolist()]
        rate_noise, force_noise = math.sqrt(max(variance[:3])), math.sqrt(max(variance[3:]))
        if rate_noise > max_rate:
            return Reason(Code.TOOL_MOVES, rate_noise, max_rate)
        if force_noise > max_force_noise:
            return Reason(Code.TOOL_SHAKES, force_noise, max_force_noise)
        if last is not None:
            step = max(abs(now - before) for now, before in zip(mean[3:], last.mean.tolist()[3:], strict=True))
            if step > MAX_FORCE_STEP:
                return Reason(Code.TOOL_SHIFTS, step, MAX_FORCE_STEP, (_BIN_S,))
        if before is not None and rate == rate_noise == 0.0:
            # Without a gyro only the field shows a rotation about the vertical.
            return self._turning_field(bins.mag, before.mag)
        return None

    def _turning_field(self, mag: Bin | None, last: Bin | None) -> Reason | None:
        """Return a reason if the field has turned in the bin or since the last bin; None if not, or if unknown."""
        if mag is None or last is None:
            return None
        most, spread = MAX_FIELD_NOISE * self.settings.motion, math.sqrt(mag.scatter.trace() / max(mag.count - 1, 1))
        if spread > most:
            return Reason(Code.FIELD_TURNS, spread * 1e9, most * 1e9, (_BIN_S,))
        step = float(np.linalg.norm(mag.mean - last.mean))
        noise = math.sqrt(sum(float(one.scatter.trace()) / max(one.count * (one.count - 1), 1) for one in (mag, last)))
        limit = MAX_FIELD_STEP * self.settings.motion
        if step <= max(limit, _FIELD_SIGMAS * noise):
            return None
        return Reason(Code.FIELD_TURNS, step * 1e9, limit * 1e9, (_BIN_S,))


def _bins(seconds: float, least: int = 1) -> int:
    return max(least, round(seconds / _BIN_S))


def _averaged(chosen: list[BinSet], requested: bool) -> StillAverage:
    def of(name: str) -> Average | None:
        found = [b for b in (getattr(bins, name) for bins in chosen) if b is not None]
        # Do not average a stream without samples in part of the interval.
        if len(found) < len(chosen) or sum(b.count for b in found) < 2:
            return None
        return average(found)

    imu = of("imu")
    if imu is None:
        raise ValueError("chosen: the bins hold too few samples to average")
    temperatures = [bins.temperature.mean[0] for bins in chosen if bins.temperature is not None]
    return StillAverage(
        start_ns=chosen[0].imu.index * BIN_NS,
        end_ns=(chosen[-1].imu.index + 1) * BIN_NS,
        imu=imu,
        mag=of("mag"),
        precision=of("precision"),
        temperature=float(np.mean(temperatures)) if temperatures else None,
        requested=requested,
    )
