# SPDX-License-Identifier: Apache-2.0
"""
When the noise that covariances state counts, and the samples from which the estimate then begins again.

A stated noise is known only after the first samples of a stream (`NoiseWatch`). It counts from a stamp, not from the
block in which it became known: thus live and afterwards the estimate begins again with the same sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mwd_estimation.core.track import Track
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.input_covariance import VECTORS, Noise, NoiseWatch

# An estimate that is younger than this begins again with its first sample, ns: too young for a survey to be lost or
# taken twice. An older one begins with the next sample.
_YOUNG_NS = 2_000_000_000
# Largest number of samples that are kept of each stream: those of a unit of 10 kHz, also while its time stands still.
_MOST = 20_000
_ALL = sum(len(vectors) for vectors in VECTORS.values())
_MAG = "magnetic_field"


class KeptSamples(NamedTuple):
    """Samples with which an estimate begins again: of the conventional unit with their gravity, and of the others."""

    imu: list[tuple[Samples, Track | None]]
    beside: list[tuple[str, Samples]]


class NoiseOnset:
    """
    Stated noise of the conventional unit and the magnetometer, and the samples that a new estimate needs again.

    known: noise that counts from the first sample on, by vector; mag_delay_ns: a magnetic sample is there so long after
    its stamp.
    """

    def __init__(self, known: Mapping[str, Noise], mag_delay_ns: int) -> None:
        self._watch, self._delay_ns = NoiseWatch(known), mag_delay_ns
        self._counting = set(known)
        self.forget()

    def forget(self) -> None:
        """Forget the samples that were kept: the estimate begins anew for another reason."""
        self._begun_ns: int | None = None
        # Samples of other streams are used from this stamp on, ns.
        self._from_ns = np.iinfo(np.int64).min
        self._imu: list[tuple[Samples, Track | None]] = []
        self._beside: dict[str, Samples] = {}

    def take_mag(self, samples: Samples) -> None:
        """Read what the covariances of samples of the magnetometer state."""
        self._watch.take(samples, wire.MAG.type_name)

    def take_imu(self, samples: Samples) -> None:
        """Read what the covariances of samples of the conventional unit state."""
        self._watch.take(samples, wire.IMU.type_name)

    def next_change(self, samples: Samples) -> tuple[int, Mapping[str, Noise] | None]:
        """
        Return how many of these samples of the conventional unit precede the next change of the noise.

        Also return the noise that counts after them, by vector; None if nothing changes within the samples.
        """
        known_ns = {
            vector: ns + (self._delay_ns if vector == _MAG else 0)
            for vector, ns in self._watch.known_ns.items()
            if vector not in self._counting
        }
        due_ns = min(known_ns.values(), default=np.iinfo(np.int64).max)
        later = np.flatnonzero(samples["stamp_ns"] > due_ns)
        if not len(later):
            return len(samples), None
        counting = self._counting | {vector for vector, ns in known_ns.items() if ns == due_ns}
        return int(later[0]), {vector: self._watch.noise[vector] for vector in counting}

    def keep_imu(self, samples: Samples, followed: Track | None) -> None:
        """Keep estimated samples of the conventional unit while the estimate is young and noise may still change."""
        if len(samples) and len(self._counting) < _ALL:
            last_ns = int(samples["stamp_ns"][-1])
            self._begun_ns = int(samples["stamp_ns"][0]) if self._begun_ns is None else self._begun_ns
            count = sum(len(part) for part, _ in self._imu) + len(samples)
            if last_ns - self._begun_ns <= _YOUNG_NS and count <= _MOST:
                self._imu.append((samples, followed))
            else:
                self._imu = []
                self._beside = {name: part[part["stamp_ns"] > last_ns] for name, part in self._beside.items()}

    def keep_beside(self, name: str, samples: Samples) -> Samples:
        """Keep samples of another stream for the same time, and return those that the present estimate uses."""
        used = samples[samples["stamp_ns"] > self._from_ns]
        if len(self._counting) < _ALL:
            self._beside[name] = np.concatenate([self._beside.get(name, used[:0]), used])[-_MOST:]
        return used

    def count(self, noise: Mapping[str, Noise]) -> None:
        """Record that this noise, by vector, counts from now on."""
        self._counting = set(noise)

    def begin_again(self, last_ns: int) -> KeptSamples:
        """Return the samples that were kept, for an estimate that begins again after this stamp, ns."""
        kept = KeptSamples(list(self._imu), list(self._beside.items()))
        if not self._imu:
            self._begun_ns, self._from_ns = None, last_ns
        if len(self._counting) == _ALL:
            self._imu, self._beside = [], {}
        return kept
