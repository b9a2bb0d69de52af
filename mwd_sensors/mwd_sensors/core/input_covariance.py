# SPDX-License-Identifier: Apache-2.0
"""
Covariances that come with samples: what they declare absent or clipped, and what cannot be believed.

sensor_msgs (Imu.msg, MagneticField.msg): all zeros mean that the covariance is unknown, -1 in the first element that
the quantity is not provided, whatever numbers stand in its place. The noise of the tool's settings is used, and a
stated one where it is larger (`NoiseWatch`); a stated covariance that is smaller or no covariance at all never makes an
estimate more certain.

A driver whose unit flags clipping says so by the covariance too, which recordings keep and any driver can write: an
axis that was beyond its range within the sample has the sigma `CLIPPED`, wider than any range.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples

# The vectors of a message with their covariances, and a sigma that no sensor of the kind has (rad/s, m/s^2, T).
VECTORS = {
    wire.IMU.type_name: (("angular_velocity", 50.0), ("linear_acceleration", 1000.0)),
    wire.MAG.type_name: (("magnetic_field", 1e-2),),
}
# Sigma of an axis that was clipped, rad/s, m/s^2 and T. Taken as such are half to 1.25 times of it, which a turned unit
# needs, and which holds no power of ten as the variance, the usual stand-in of drivers that know no covariance.
CLIPPED = {"angular_velocity": 20.0, "linear_acceleration": 200.0, "magnetic_field": 2e-3}
_CLIPPED_LEAST, _CLIPPED_MOST = 0.5, 1.25
ABSENT, UNBELIEVABLE, TOO_SMALL = "not provided", "no covariance", "a covariance that is not credible"
# At rest the samples scatter by so much more than stated, before a covariance is not credible: pumps shake a tool at
# rest by ten times the noise of its sensors, a covariance in a wrong unit is off by a thousand and more.
_INCREDIBLE = 100.0
# What stands for a vector that is not provided: nothing measured, and a gyro that says so is a gyro at rest and named
# as stuck, so that stations by gravity and field remain.
_STAND_IN = {"angular_velocity": 0.0}


# Samples that a rate is told from, the first of a stream, and those that a scatter is.
_RATED, _SCATTERED = 16, 64


@dataclasses.dataclass(frozen=True)
class Noise:
    """
    White noise that the covariances of a vector state.

    Attributes
    ----------
    sigma : float
        1 sigma of a sample on its noisiest axis, rad/s, m/s^2 or T; 0: none stated.
    period_s : float
        Time between samples, s.
    """

    sigma: float = 0.0
    period_s: float = 0.0

    @property
    def density(self) -> float:
        """Noise density, in the unit of the vector times sqrt(s): what averages over t leave is density / sqrt(t)."""
        return self.sigma * math.sqrt(self.period_s)


class NoiseWatch:
    """
    The noise that the covariances of each vector state, from the first samples of its stream.

    Later covariances are not followed: the estimate would depend on when they came. `rest` compares them with the
    scatter of samples at rest.

    Attributes
    ----------
    noise : dict of Noise
        By vector, once it is known.
    """

    def __init__(self) -> None:
        self.noise: dict[str, Noise] = {}
        self._resting: dict[str, list[NDArray[np.float64]]] = {}
        self._least: dict[str, float] = {}
        self._stamps: dict[str, list[int]] = {}
        self._sigma: dict[str, float] = {}

    def take(self, samples: Samples, type_name: str) -> None:
        """Take samples of the type in order of time; what stands in `noise` by then stays."""
        for vector, widest in VECTORS.get(type_name, ()):
            stated = f"{vector}_covariance"
            if vector in self.noise or stated not in (samples.dtype.names or ()) or not len(samples):
                continue
            stamps = self._stamps.setdefault(vector, [])
            if not stamps:
                first: NDArray[np.float64] = np.asarray(samples[stated][:1])
                believed = first[0, 0] != -1.0 and bool(_credible(first, widest)[0])
                # What is clipped says nothing of the noise.
                noise = np.where(clipped(samples[:1], vector)[0], 0.0, first[0, ::4])
                self._sigma[vector] = float(np.sqrt(noise.max())) if believed else 0.0
            stamps += samples["stamp_ns"][: _RATED - len(stamps)].tolist()
            if len(stamps) == _RATED:
                self.noise[vector] = Noise(self._sigma[vector], max(1e-9 * float(np.median(np.diff(stamps))), 0.0))

    def rest(self, samples: Samples, type_name: str, still: bool) -> None:
        """Take samples of a tool that rests or does not, for the smallest scatter of each vector."""
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
        """Vectors whose samples scatter at rest by far more than their covariance states: `TOO_SMALL`."""
        return {
            vector: TOO_SMALL
            for vector, scatter in self._least.items()
            if scatter > _INCREDIBLE * self.noise[vector].sigma
        }


class Judged(NamedTuple):
    """Samples without what their covariances declare absent, and by vector why its covariance is not used."""

    samples: Samples
    notes: dict[str, str]


def judge(samples: Samples, type_name: str) -> Judged:
    """
    Take out vectors that are declared absent, and name covariances that are none.

    samples : dtype of the layout, or a part of it; a vector without its covariance passes as it is.
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
            samples[vector][absent] = _STAND_IN.get(vector, np.nan)
            notes[vector] = ABSENT
        else:
            # Nearly every driver states the same in all messages.
            same = bool((covariance == covariance[0]).all())
            credible = _credible_row(covariance[0].tobytes(), widest) if same else _credible(covariance, widest).all()
            if not credible:
                notes[vector] = UNBELIEVABLE
    return Judged(samples, notes)


def not_provided(samples: Samples, vector: str) -> NDArray[np.bool_]:
    """Samples whose covariance declares the vector not provided, shape (n,); none where samples have no covariance."""
    name = f"{vector}_covariance"
    if name not in (samples.dtype.names or ()):
        return np.zeros(len(samples), dtype=np.bool_)
    return np.asarray(np.equal(samples[name][:, 0], -1.0), dtype=np.bool_)


def sentence(topic: str, vector: str, note: str) -> str:
    """Say what is wrong with a vector of a topic, by its note of `judge`, and what is done about it."""
    if note == ABSENT:
        return f"{topic}: {vector} is declared {note}: it is not used"
    return f"{topic}: {vector} comes with {note}: the noise of the tool's settings is used"


def clipped(samples: Samples, vector: str) -> NDArray[np.bool_]:
    """Axes that the covariance says were beyond their range, shape (n, 3); none where samples have no covariance."""
    name = f"{vector}_covariance"
    if name not in (samples.dtype.names or ()):
        return np.zeros((len(samples), 3), dtype=np.bool_)
    variances, own = samples[name][:, ::4], CLIPPED[vector] ** 2
    # Above the lower end, for a covariance of exactly that is somebody's round number.
    found = (variances > _CLIPPED_LEAST**2 * own) & (variances <= _CLIPPED_MOST**2 * own)
    return np.asarray(found, dtype=np.bool_)


def mark_clipped(samples: Samples, vector: str, axes: NDArray[np.bool_]) -> None:
    """Say in the covariance of samples, changed in place, which axes were beyond their range; shape (n, 3)."""
    samples[f"{vector}_covariance"][:, ::4][axes] = CLIPPED[vector] ** 2


@functools.lru_cache(maxsize=64)
def _credible_row(covariance: bytes, widest: float) -> bool:
    """Whether one covariance, the bytes of its nine numbers, is credible; remembered, for it comes with every block."""
    return bool(_credible(np.frombuffer(covariance, dtype=np.float64)[None], widest)[0])


def _credible(covariance: NDArray[np.float64], widest: float) -> NDArray[np.bool_]:
    """Whether each is finite, symmetric, positive semi-definite and of a size a sensor can have; shape (n,)."""
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
