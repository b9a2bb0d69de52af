# SPDX-License-Identifier: Apache-2.0
"""
Queue of IMU samples that wait for the next block, or for enough later samples to smooth them.

The estimator must have all other samples of their time before it gets IMU samples; a smoother needs later samples.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from mwd_estimation.core import clip_flags
from mwd_estimation.core.rate_jumps import RateJumps
from mwd_estimation.core.track import Track
from mwd_estimation.gravity import smoother as gravity_smoother
from mwd_estimation.gravity.bounded.filter import Params
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_sensors.core.mount import Mount, MountSettings, resolve

# Samples that follow a longer gap do not change those before it.
_SILENCE_NS = 60 * wire.NANOSECONDS


@dataclasses.dataclass(frozen=True)
class Imu:
    """Samples ready for the estimator, their log times, and their gravity if a smoother followed it."""

    samples: Samples
    log_ns: Stamps
    followed: Track | None


class ImuQueue:
    """
    Queue that holds samples back.

    smooth : settings of the method bounded, for smoothing gravity; None: no smoothing. mount : mount of the units in
    the tool; gravity is smoothed in tool axes.
    """

    def __init__(self, smooth: Params | None = None, mount: Mount | None = None) -> None:
        self._mount = mount or resolve(MountSettings())
        self._smoother = gravity_smoother.Smoother(smooth) if smooth is not None else None
        self._jumps = RateJumps()
        self._new: list[tuple[Samples, Stamps]] = []
        self._old: list[tuple[Samples, Stamps]] = []

    @property
    def samples_are(self) -> str:
        """Meaning of a sample that the smoother has found, see `State.samples_are`."""
        return self._smoother.samples_are if self._smoother is not None else ""

    @property
    def waiting(self) -> bool:
        """Whether any sample waits."""
        return bool(self._old or self._new)

    @property
    def first_log_ns(self) -> int:
        """Log time of the first waiting sample, ns; only valid if a sample waits."""
        return int((self._old or self._new)[0][1][0])

    def add(self, samples: Samples, log_ns: Stamps) -> None:
        """Hold the samples of a block."""
        if len(samples):
            self._new.append((samples, log_ns))

    def done(self) -> Iterator[Imu]:
        """Remove and return the samples that are ready; call this after everything else of their time was pushed."""
        new, self._new = self._new, []
        if self._smoother is None:
            yield from (Imu(samples, log_ns, None) for samples, log_ns in new)
            return
        for samples, log_ns in new:
            last = self._old[-1][1][-1:] if self._old else log_ns[:1]
            silences = np.flatnonzero(np.diff(log_ns, prepend=last) > _SILENCE_NS)
            for k, part in enumerate(zip(np.split(samples, silences), np.split(log_ns, silences), strict=True)):
                if k > 0:
                    yield from self._finished()
                self._old.append(part)
                yield from self._taken([self._push(part[0])])

    def finish(self) -> Iterator[Imu]:
        """Remove and return all waiting samples."""
        yield from self.done()
        yield from self._finished()

    def _push(self, samples: Samples) -> Track:
        smoother = self._smoother
        if smoother is None:
            return Track.empty(0)
        samples = self._mount.imu_in_tool(samples)
        stamps, accel = samples["stamp_ns"], samples["linear_acceleration"]
        # Use the same samples as the estimator.
        gyro = self._jumps.without(stamps, np.ascontiguousarray(samples["angular_velocity"]))
        return smoother.push(stamps, gyro, accel, clip_flags.of(samples))

    def _finished(self) -> Iterator[Imu]:
        if self._smoother is not None and self._old:
            rest = self._smoother.finish()
            self._smoother = self._smoother.continued()
            yield from self._taken([rest])

    def _taken(self, parts: list[Track]) -> Iterator[Imu]:
        followed = gravity_smoother.joined([Track.empty(0), *parts])
        count = len(followed.g_t)
        if not count:
            return
        samples = np.concatenate([samples for samples, _ in self._old])
        log_ns = np.concatenate([log_ns for _, log_ns in self._old])
        self._old = [(samples[count:], log_ns[count:])] if count < len(samples) else []
        yield Imu(samples[:count], log_ns[:count], followed)
