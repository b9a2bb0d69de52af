# SPDX-License-Identifier: Apache-2.0
"""
Calibration of a unit's triads, and its form as plain numbers for YAML or JSON.

Model of one triad, with warm = temperature - reference temperature:
reading = (1 + scale_per_c * warm) * (inverse(matrix) @ truth) + bias + bias_per_c * warm.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array


@dataclasses.dataclass(frozen=True)
class TriadCalibration:
    """Correction of one triad."""

    #: Shape (3, 3); the corrected vector is matrix @ ((reading - bias - bias_per_c * warm) / (1 + scale_per_c * warm)),
    #: where warm is the temperature minus reference_c.
    matrix: Array
    #: `bias`, `bias_per_c`: shape (3,); bias, SI, and its slope, SI/degC.
    bias: Array
    bias_per_c: Array
    #: Shape (3,); slope of the scale, 1/degC; zero, like bias_per_c, if the run was made at one temperature.
    scale_per_c: Array
    #: `sigma_matrix`, `sigma_bias`, `sigma_bias_per_c`, `sigma_scale_per_c`: 1 sigma of each parameter, from the
    #: scatter of the residuals.
    sigma_matrix: Array
    sigma_bias: Array
    sigma_bias_per_c: Array
    sigma_scale_per_c: Array
    reference_c: float  #: reference temperature, degC
    #: `before`, `after`: root mean square of the residuals without and with the correction. On a stand these are errors
    #: of the vector, SI. Without a stand they are errors of the strength, SI; for gyros, errors of the direction of
    #: gravity, rad.
    before: float
    after: float
    poses: int  #: number of intervals at rest that were used; for gyros, number of rotations between them

    def __call__(self, reading: ArrayLike, celsius: ArrayLike) -> Array:
        """Return corrected vectors, shape (..., 3), of readings (..., 3) at temperatures (...), degC."""
        warm = np.asarray(celsius, dtype=float)[..., None] - self.reference_c
        free = np.asarray(reading, dtype=float) - self.bias - self.bias_per_c * warm
        return np.asarray(np.einsum("ij,...j->...i", self.matrix, free / (1.0 + self.scale_per_c * warm)))


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Corrections of a whole unit; a triad that was not measured is None."""

    gyro: TriadCalibration
    accelerometer: TriadCalibration
    magnetometer: TriadCalibration | None


def as_table(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as plain numbers for YAML or JSON; `from_table` reads it back exactly."""
    triads = {field.name: getattr(calibration, field.name) for field in dataclasses.fields(calibration)}
    return {
        name: {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in vars(triad).items()}
        for name, triad in triads.items()
        if triad is not None
    }


def from_table(table: Mapping[str, Any]) -> Calibration:
    """
    Return the calibration in a mapping of the form of `as_table`; the magnetometer may be missing.

    Raises
    ------
    ValueError
        A triad is unknown, gyro or accelerometer is missing, a number is missing, has a wrong shape or is not finite,
        or a matrix is far from the identity.
    """
    read: dict[str, TriadCalibration] = {}
    for name, triad in table.items():
        if name not in _TRIADS:
            raise ValueError(f"calibration: no triad {name!r}; known: {', '.join(_TRIADS)}")
        figures = {}
        for key, shape in _SHAPES.items():
            try:
                figures[key] = np.array(triad[key], dtype=float)
            except (KeyError, TypeError, ValueError) as error:
                raise ValueError(f"calibration: {name}.{key} is missing or not a number") from error
            if figures[key].shape != shape or not np.isfinite(figures[key]).all():
                raise ValueError(f"calibration: {name}.{key} must be finite and of shape {shape}")
        if np.abs(figures["matrix"] - np.eye(3)).max() > 0.5:
            raise ValueError(f"calibration: {name}.matrix is far from the identity; is it in other units?")
        plain: dict[str, Any] = {key: value if value.ndim else float(value) for key, value in figures.items()}
        read[name] = TriadCalibration(**plain | {"poses": int(figures["poses"])})
    for name in ("gyro", "accelerometer"):
        if name not in read:
            raise ValueError(f"calibration: {name} is missing")
    return Calibration(read["gyro"], read["accelerometer"], read.get("magnetometer"))


_TRIADS = ("gyro", "accelerometer", "magnetometer")
_SHAPES: dict[str, tuple[int, ...]] = {
    "matrix": (3, 3),
    "bias": (3,),
    "bias_per_c": (3,),
    "scale_per_c": (3,),
    "sigma_matrix": (3, 3),
    "sigma_bias": (3,),
    "sigma_bias_per_c": (3,),
    "sigma_scale_per_c": (3,),
    "reference_c": (),
    "before": (),
    "after": (),
    "poses": (),
}
