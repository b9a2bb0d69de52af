# SPDX-License-Identifier: Apache-2.0
"""
Errors that calibration leaves in the six axes of a survey tool, and of how the tool lies in its hole; their covariance.

The defaults are the sensor and alignment terms of the ISCWSA / OWSG tool code for ordinary MWD (A001Mc rev 5.1: ABXY,
ABZ, ASXY, ASZ, MBXY, MBZ, MSXY, MSZ, AMIL, SAGE, XYM1 to XYM4E), the sensors' per axis, so that they propagate
through any attitude and any method alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array


@dataclass(frozen=True)
class SensorErrors:
    """1 sigma of the errors that do not average out within one station."""

    accelerometer_bias_mps2: float = 0.004  #: accelerometer bias of each axis, m/s^2
    accelerometer_scale: float = 0.0005  #: accelerometer scale error of each axis
    magnetometer_bias_nt: float = 70.0  #: magnetometer bias of each axis, nT
    magnetometer_scale: float = 0.0016  #: magnetometer scale error of each axis
    #: Axial field of the drill string above and below, expected with a proper collar, nT.
    axial_interference_nt: float = 220.0
    cross_interference_nt: float = 0.0  #: field of the drill string across the axis, each way, nT
    misalignment_deg: float = 0.1  #: tool axis against hole axis, each way, the same all along (XYM1, XYM2), deg
    #: Hole axis at the station against the mean hole, other at each station (XYM3E, XYM4E), deg.
    course_misalignment_deg: float = 0.3
    #: Turn of the accelerometers against the magnetometers about each axis: not in the code; what a calibration of both
    #: in one fixture leaves, deg.
    mount_deg: float = 0.02
    sag_deg: float = 0.2  #: sag of the assembly in a horizontal hole, uncorrected (SAGE), deg

    def covariance(self, f_t: ArrayLike, b_t: ArrayLike) -> Array:
        """
        Covariance of (f_t, b_t) from bias and scale of every axis, interference left out.

        f_t, b_t, shape (..., 3), m/s^2 and T. Returns shape (..., 6, 6), (m/s^2)^2 and T^2, diagonal.
        """
        f_t, b_t = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
        variance_f = self.accelerometer_bias_mps2**2 + (self.accelerometer_scale * f_t) ** 2
        variance_b = (self.magnetometer_bias_nt * 1e-9) ** 2 + (self.magnetometer_scale * b_t) ** 2
        return np.concatenate([variance_f, variance_b], axis=-1)[..., None] * np.eye(6)

    def alignment(self, inclination: float) -> Array:
        """
        Covariance of (inclination, azimuth, toolface), rad^2, shape (3, 3), as the tool does not lie along the hole.

        inclination: rad. The azimuth term grows as 1 / sin(inclination) towards the vertical, as the angle itself
        loses meaning.
        """
        sine, cosine = abs(math.sin(inclination)), math.cos(inclination)
        same, course, sag = (
            math.radians(angle) for angle in (self.misalignment_deg, self.course_misalignment_deg, self.sag_deg)
        )
        variance_inclination = (same * sine) ** 2 + (course * cosine) ** 2 + (sag * sine**0.25) ** 2
        variance_azimuth = same**2 + (course * cosine / max(sine, 1e-9)) ** 2
        return np.diag([variance_inclination, variance_azimuth, 0.0])
