# SPDX-License-Identifier: Apache-2.0
"""
Pairing of inertial data that arrive in halves: gyro and accelerometer on two topics, or alternating on one topic.

Drivers write a vector that a message does not carry as zeros, as NaN, or with a covariance that begins with -1
(REP-145). A specific force of exactly zero is not a measurement. The accelerometer is interpolated to the times of the
gyro, so that equal times give exactly the numbers of a complete message. The times are those of the sensors
(`core.stream_clock`): samples that share a stamp are apart.
"""

from __future__ import annotations

from enum import StrEnum, unique

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.stream_clock import StreamClock
from mwd_sensors.core import input_covariance
from mwd_sensors.core.arrays import Samples, Stamps

_GYRO, _ACCEL = "angular_velocity", "linear_acceleration"
# Smallest share of messages without a vector if the topic is one half of an IMU, and if its messages alternate.
_HALF, _IN_TURNS = 0.98, 0.05
# Smallest number of changes between the two kinds of alternating messages; a failing sensor changes only once.
_CHANGES = 8
# Longest gap of the accelerometer that is interpolated: the larger of a number of its intervals and a time, ns.
_INTERVALS, _SHORTEST_NS = 5, 100_000_000
_RATED = 16  # number of first intervals whose median is the interval of the accelerometer


@unique
class ImuKind(StrEnum):
    """
    Vectors that the messages of an IMU topic carry.

    IN_TURNS : some messages carry only the rate, others only the specific force.
    SOME_EMPTY : some messages carry both vectors, others none.
    """

    WHOLE = "whole"
    GYRO = "gyro"
    ACCELEROMETER = "accelerometer"
    IN_TURNS = "in turns"
    SOME_EMPTY = "some empty"


def kind_of(samples: Samples) -> ImuKind:
    """Return the kind of an IMU topic, by the vectors in some of its samples, which must have covariance fields."""
    no_gyro, no_accel = _without(samples, _GYRO), _without(samples, _ACCEL)
    if not len(samples) or (no_gyro & no_accel).all():
        return ImuKind.WHOLE
    if no_accel.mean() >= _HALF and no_gyro.mean() < _HALF:
        return ImuKind.GYRO
    # Zero rates may come from a gyro at rest: only rates that are declared absent, or always NaN, show that the topic
    # has no gyro.
    if no_gyro.all() and not no_accel.any() and _stated_absent(samples, _GYRO):
        return ImuKind.ACCELEROMETER
    if among_readings(no_accel):
        return ImuKind.IN_TURNS if (no_accel & ~no_gyro).any() else ImuKind.SOME_EMPTY
    return ImuKind.WHOLE


def among_readings(empty: NDArray[np.bool_]) -> bool:
    """
    Return whether empty messages recur among others; the messages of a failed sensor stay empty.

    empty, shape (n,) : whether each message in order lacks the vector.
    """
    if not len(empty):
        return False
    changes = int(np.count_nonzero(empty[1:] != empty[:-1]))
    return _IN_TURNS <= float(empty.mean()) < _HALF and changes >= _CHANGES


def is_accelerometer(samples: Samples) -> bool:
    """
    Return whether all messages carry a specific force and no message carries a rate.

    The topic may be one half of an IMU, or a complete IMU with a failed gyro.
    """
    return len(samples) > 0 and bool(_without(samples, _GYRO).all() and not _without(samples, _ACCEL).any())


class Joiner:
    """
    Joiner of the halves of an IMU, block by block; the samples do not depend on how the data are divided into blocks.

    Parameters
    ----------
    kind : ImuKind
        Kind of the gyro's topic. If the topic has both halves, the half of each message is known from its values.
    """

    def __init__(self, kind: ImuKind) -> None:
        self._kind = kind
        self._gyro_clock, self._accel_clock = StreamClock(), StreamClock()
        # Log times, samples and times of the waiting gyro messages, and times of the accelerometer, ns.
        self._gyro: list[tuple[Stamps, Samples, Stamps]] = []
        self._accel_ns = np.empty(0, dtype=np.int64)
        self._accel = np.empty((0, 3))
        self._covariance = np.zeros(9)
        self._interval = 0

    @property
    def first_log_ns(self) -> int | None:
        """Log time of the first gyro message that waits for the accelerometer, ns; None if no message waits."""
        return int(self._gyro[0][0][0]) if self._gyro else None

    def push(
        self, gyro: tuple[Stamps, Samples] | None, accel: tuple[Stamps, Samples] | None = None
    ) -> tuple[Stamps, Samples] | None:
        """Accept (log_ns, samples) of a block and return the samples that are complete; None if no sample is."""
        if self._kind in (ImuKind.IN_TURNS, ImuKind.SOME_EMPTY) and gyro is not None:
            log_ns, samples = gyro
            no_accel = _without(samples, _ACCEL)
            # If every message has both halves or none, a rate of zero is a measurement, not a missing half.
            has_gyro = ~_without(samples, _GYRO) if self._kind == ImuKind.IN_TURNS else ~no_accel
            accel = log_ns[~no_accel], samples[~no_accel]
            gyro = log_ns[has_gyro], samples[has_gyro]
        if gyro is not None and len(gyro[0]):
            self._gyro.append((*gyro, self._gyro_clock.times(np.ascontiguousarray(gyro[1]["stamp_ns"]))))
        if accel is not None and len(accel[0]):
            self._take_accel(accel[1])
        return self._joined(int(self._accel_ns[-1]) if len(self._accel_ns) else None)

    def finish(self) -> tuple[Stamps, Samples] | None:
        """
        Return the remaining gyro samples with the specific force, NaN where the accelerometer has no samples.

        None if no gyro sample waits, or if the accelerometer never had a sample.
        """
        return self._joined(2**62)

    def _take_accel(self, samples: Samples) -> None:
        new = self._accel_clock.times(np.ascontiguousarray(samples["stamp_ns"]))
        order = np.argsort(new, kind="stable")
        later = order[new[order] > (self._accel_ns[-1] if len(self._accel_ns) else -(2**62))]
        self._accel_ns = np.concatenate([self._accel_ns, new[later]])
        self._accel = np.concatenate([self._accel, samples[_ACCEL][later]])
        self._covariance = samples[f"{_ACCEL}_covariance"][-1]
        if not self._interval and len(self._accel_ns) > _RATED:
            self._interval = int(np.median(np.diff(self._accel_ns[: _RATED + 1])))

    def _joined(self, until_ns: int | None) -> tuple[Stamps, Samples] | None:
        """
        Remove the gyro samples up to the time `until_ns`, ns, and return them with interpolated specific force.

        Returns log times, ns, and samples; None if there are no such samples, or no accelerometer samples yet.
        """
        if not self._gyro or until_ns is None or not len(self._accel_ns):
            return None
        log_ns = np.concatenate([part[0] for part in self._gyro])
        samples = np.concatenate([part[1] for part in self._gyro])
        times = np.concatenate([part[2] for part in self._gyro])
        ready = int(np.searchsorted(np.maximum.accumulate(times), until_ns, "right"))
        self._gyro = [(log_ns[ready:], samples[ready:], times[ready:])] if ready < len(samples) else []
        if not ready:
            return None
        log_ns, samples = log_ns[:ready], samples[:ready].copy()
        stamps, known = times[:ready], self._accel_ns
        after = np.searchsorted(known, stamps).clip(max=len(known) - 1)
        before = np.where(known[after] == stamps, after, np.maximum(after - 1, 0))
        origin = int(known[0])
        for axis in range(3):
            samples[_ACCEL][:, axis] = np.interp(stamps - origin, known - origin, self._accel[:, axis])
        # Outside the accelerometer's time range, and in its gaps, there is no measurement.
        limit = max(_INTERVALS * self._interval, _SHORTEST_NS)
        outside = (stamps < known[before] - limit) | (stamps > known[after] + limit)
        samples[_ACCEL][outside | (known[after] - known[before] > limit)] = np.nan
        samples[f"{_ACCEL}_covariance"] = self._covariance
        # Clear the mark "not measured" in the covariance: the joined sample has both vectors.
        for vector in (_GYRO, _ACCEL):
            column = samples[f"{vector}_covariance"]
            column[column[:, 0] == -1.0] = 0.0
        first = max(int(np.searchsorted(known, stamps.max(), "right")) - 2, 0)
        self._accel_ns, self._accel = known[first:], self._accel[first:]
        return log_ns, samples


def _without(samples: Samples, vector: str) -> NDArray[np.bool_]:
    """Return whether each message lacks a vector, shape (n,): it is zero, not finite, or marked as not provided."""
    values = samples[vector]
    empty = (values == 0.0).all(axis=1) | ~np.isfinite(values).any(axis=1)
    return np.asarray(empty | input_covariance.not_provided(samples, vector))


def _stated_absent(samples: Samples, vector: str) -> bool:
    return bool(input_covariance.not_provided(samples, vector).all() or np.isnan(samples[vector]).all())
