# SPDX-License-Identifier: Apache-2.0
"""
Interpret the covariances in sensor messages: absent vectors, clipped axes, values that are not credible.

In sensor_msgs (Imu.msg, MagneticField.msg) a covariance of zeros means "unknown", and -1 in its first element means
that the quantity is not provided and its values must be ignored. The estimator uses the noise from the tool's settings,
or the stated noise where that is larger (`NoiseWatch`). A smaller stated covariance, or one that is not credible, never
makes an estimate more certain.

A driver whose unit reports clipping also marks it in the covariance, because recordings keep covariances and any driver
can write them: an axis that was outside its range during the sample has the sigma `CLIPPED`, which is larger than any
range.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples

# Vectors of each message type. The number is the largest credible sigma, and the largest credible reading, of one axis
# of the vector, rad/s, m/s^2 or T.
VECTORS = {
    wire.IMU.type_name: (("angular_velocity", 50.0), ("linear_acceleration", 1000.0)),
    wire.MAG.type_name: (("magnetic_field", 1e-2),),
}
# Sigma of a clipped axis, rad/s, m/s^2 and T. Sigmas from 0.5 to 1.25 times this value count as clipped, because a
# turned unit spreads the variance over its axes. No variance in that range is a power of ten, which drivers often
# write for an unknown covariance.
CLIPPED = {"angular_velocity": 20.0, "linear_acceleration": 200.0, "magnetic_field": 2e-3}
_CLIPPED_LEAST, _CLIPPED_MOST = 0.5, 1.25
ABSENT, UNBELIEVABLE, TOO_SMALL = "not provided", "no covariance", "a covariance that is not credible"
# A covariance is not credible if the scatter of samples at rest is larger than this factor times its sigma. Pumps shake
# a tool at rest by ten times the noise of its sensors; a sigma in a wrong unit is too small by a thousand or more.
_INCREDIBLE = 100.0

# Number of samples at the start of a stream from which the sample period is measured; number of samples at rest from
# which a scatter is computed.
_RATED, _SCATTERED = 16, 64


@dataclasses.dataclass(frozen=True)
class StatedNoise:
    """White noise of a vector as its covariances state it."""

    sigma: float = 0.0  #: 1 sigma of a sample on its noisiest axis, rad/s, m/s^2 or T; 0 if no noise is stated
    period_s: float = 0.0  #: time between samples

    @property
    def density(self) -> float:
        """
        Noise density, in the unit of the vector times sqrt(s).

        An average over t seconds has the sigma density / sqrt(t).
        """
        return self.sigma * math.sqrt(self.period_s)


class NoiseWatch:
    """
    White noise of each vector, as stated by the covariance of the first sample of its stream.

    Later covariances are ignored; otherwise the estimate would depend on their time of arrival. `rest` collects the
    scatter of samples at rest, with which `not_credible` compares the stated noise.

    Parameters
    ----------
    known : mapping of StatedNoise, optional
        Noise of each vector that earlier messages stated, by name of the vector.
    """

    def __init__(self, known: Mapping[str, StatedNoise] | None = None) -> None:
        #: Noise by vector, present once `_RATED` samples have arrived; sigma 0 if the first covariance is absent or not
        #: credible.
        self.noise: dict[str, StatedNoise] = dict(known or {})
        #: Stamp of the sample with which the noise of a vector became known, ns since 1970, by vector.
        self.known_ns: dict[str, int] = {}
        self._resting: dict[str, list[NDArray[np.float64]]] = {}
        self._least: dict[str, float] = {}
        self._stamps: dict[str, list[int]] = {}
        self._sigma: dict[str, float] = {}

    def take(self, samples: Samples, type_name: str) -> None:
        """Accept samples of one message type in order of time; each entry of `noise` is set once and then kept."""
        for vector, widest in VECTORS.get(type_name, ()):
            stated = f"{vector}_covariance"
            if vector in self.noise or stated not in (samples.dtype.names or ()) or not len(samples):
                continue
            stamps = self._stamps.setdefault(vector, [])
            if not stamps:
                first: NDArray[np.float64] = np.asarray(samples[stated][:1])
                believed = first[0, 0] != -1.0 and bool(_credible(first, widest)[0])
                # The variance of a clipped axis is a mark, not the noise.
                noise = np.where(clipped(samples[:1], vector)[0], 0.0, first[0, ::4])
                self._sigma[vector] = float(np.sqrt(noise.max())) if believed else 0.0
            stamps += samples["stamp_ns"][: _RATED - len(stamps)].tolist()
            if len(stamps) == _RATED:
                self.noise[vector] = StatedNoise(
                    self._sigma[vector], max(1e-9 * float(np.median(np.diff(stamps))), 0.0)
                )
                self.known_ns[vector] = stamps[-1]

    def rest(self, samples: Samples, type_name: str, still: bool) -> None:
        """
        Compute the scatter of each vector from `_SCATTERED` or more samples at rest, and keep the smallest scatter.

        Vectors without a stated noise are skipped, and so are readings outside the credible range. still: whether the
        tool is at rest. If not, the samples collected so far for a scatter are discarded.
        """
        for vector, widest in VECTORS.get(type_name, ()):
            if not still:
                self._resting.pop(vector, None)
            elif vector in self.noise and self.noise[vector].sigma > 0.0 and len(samples):
                held = self._resting.setdefault(vector, [])
                readings: NDArray[np.float64] = np.asarray(samples[vector], dtype=np.float64)
                held.append(readings[(np.abs(readings) < widest).all(axis=1)])
                if sum(map(len, held)) >= _SCATTERED:
                    steps = np.diff(np.concatenate(self._resting.pop(vector)), axis=0)
                    scatter = float(np.median(np.sqrt((steps**2).mean(axis=0) / 2.0)))
                    self._least[vector] = min(self._least.get(vector, math.inf), scatter)

    @property
    def not_credible(self) -> dict[str, str]:
        """Vectors whose scatter at rest is above `_INCREDIBLE` times their stated sigma, with the note `TOO_SMALL`."""
        return {
            vector: TOO_SMALL
            for vector, scatter in self._least.items()
            if scatter > _INCREDIBLE * self.noise[vector].sigma
        }


class JudgedNoise(NamedTuple):
    """Samples in which absent vectors are NaN, and by vector the note (`ABSENT` or `UNBELIEVABLE`), if there is one."""

    samples: Samples
    notes: dict[str, str]


def judge(samples: Samples, type_name: str) -> JudgedNoise:
    """
    Replace vectors that are declared absent by NaN, in a copy, and note covariances that are not credible.

    samples has all or some fields of the message's layout. A vector without a covariance field, or with covariances of
    zeros (unknown), is returned unchanged and without a note.
    """
    notes: dict[str, str] = {}
    names = samples.dtype.names or ()
    for vector, widest in VECTORS.get(type_name, ()):
        stated = f"{vector}_covariance"
        if vector not in names or stated not in names or not len(samples):
            continue
        covariance: NDArray[np.float64] = np.asarray(samples[stated], dtype=np.float64)
        if not covariance.any():
            continue
        absent = not_provided(samples, vector)
        if absent.any():
            samples = samples.copy()
            samples[vector][absent] = np.nan
            notes[vector] = ABSENT
        else:
            # Nearly every driver states the same covariance in all messages.
            same = bool((covariance == covariance[0]).all())
            credible = _credible_row(covariance[0].tobytes(), widest) if same else _credible(covariance, widest).all()
            if not credible:
                notes[vector] = UNBELIEVABLE
    return JudgedNoise(samples, notes)


def not_provided(samples: Samples, vector: str) -> NDArray[np.bool_]:
    """Return which samples declare the vector not provided, shape (n,); all False without a covariance field."""
    name = f"{vector}_covariance"
    if name not in (samples.dtype.names or ()):
        return np.zeros(len(samples), dtype=np.bool_)
    return np.asarray(np.equal(samples[name][:, 0], -1.0), dtype=np.bool_)


def sentence(topic: str, vector: str, note: str) -> str:
    """Return a sentence for users: topic, vector, the problem (`note`, one of the notes of `judge`), consequence."""
    if note == ABSENT:
        return f"{topic}: {vector} is declared {note}: it is not used"
    return f"{topic}: {vector} comes with {note}: the noise of the tool's settings is used"


def clipped(samples: Samples, vector: str) -> NDArray[np.bool_]:
    """Return which axes the covariance marks as clipped, shape (n, 3); all False without a covariance field."""
    name = f"{vector}_covariance"
    if name not in (samples.dtype.names or ()):
        return np.zeros((len(samples), 3), dtype=np.bool_)
    variances, own = samples[name][:, ::4], CLIPPED[vector] ** 2
    # Exclude the lower limit itself: it is a power of ten, which a driver often writes for an unknown covariance.
    found = (variances > _CLIPPED_LEAST**2 * own) & (variances <= _CLIPPED_MOST**2 * own)
    return np.asarray(found, dtype=np.bool_)


def mark_clipped(samples: Samples, vector: str, axes: NDArray[np.bool_]) -> None:
    """Mark clipped axes, shape (n, 3), in the covariance of samples, in place."""
    samples[f"{vector}_covariance"][:, ::4][axes] = CLIPPED[vector] ** 2


@functools.lru_cache(maxsize=64)
def _credible_row(covariance: bytes, widest: float) -> bool:
    """
    Return whether one covariance (the bytes of its nine numbers) is credible; cached, because most streams repeat it.

    widest is the largest credible sigma.
    """
    return bool(_credible(np.frombuffer(covariance, dtype=np.float64)[None], widest)[0])


def _credible(covariance: NDArray[np.float64], widest: float) -> NDArray[np.bool_]:
    """
    Return which covariances, shape (n, 9), are credible, shape (n,); widest is the largest credible sigma.

    A credible covariance is finite, symmetric and positive semi-definite, and no variance is above widest^2.
    """
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(covariance).all(axis=1))
    matrices = np.where(finite[:, None], covariance, 0.0).reshape(-1, 3, 3)
    diagonal = np.einsum("nii->ni", matrices)
    scale = np.maximum(np.abs(diagonal).max(axis=1), np.finfo(float).tiny)
    symmetric = (np.abs(matrices - matrices.swapaxes(1, 2)).max(axis=(1, 2))) <= 1e-9 * scale
    with np.errstate(over="ignore"):
        bounded = diagonal.max(axis=1) <= widest**2
    matrices = np.where(np.asarray(bounded)[:, None, None], matrices, 0.0)
    positive = np.linalg.eigvalsh(matrices)[:, 0] >= -1e-9 * scale
    whole: NDArray[np.bool_] = finite & symmetric & bounded & positive
    return whole
