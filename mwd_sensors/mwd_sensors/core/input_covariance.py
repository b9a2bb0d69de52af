"""
Covariances that come with samples: what they declare absent, and what cannot be believed.

sensor_msgs (Imu.msg, MagneticField.msg): all zeros mean that the covariance is unknown, -1 in the first element that
the quantity is not provided, whatever numbers stand in its place. The noise of the tool's settings is used; a stated
covariance that is smaller or no covariance at all never makes an estimate more certain.
"""

from __future__ import annotations

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
ABSENT, UNBELIEVABLE = "not provided", "no covariance"
# What stands for a vector that is not provided: nothing measured, and a gyro that says so is a gyro at rest and named
# as stuck, so that stations by gravity and field remain.
_STAND_IN = {"angular_velocity": 0.0}


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
        covariance: NDArray[np.float64] = np.asarray(samples[stated])
        if not covariance.any():
            continue
        absent: NDArray[np.bool_] = np.equal(covariance[:, 0], -1.0)
        if absent.any():
            samples = samples.copy()
            samples[vector][absent] = _STAND_IN.get(vector, np.nan)
            notes[vector] = ABSENT
        elif not bool(_credible(np.asarray(covariance), widest).all()):
            notes[vector] = UNBELIEVABLE
    return Judged(samples, notes)


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
