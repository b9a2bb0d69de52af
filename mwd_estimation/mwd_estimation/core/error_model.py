# SPDX-License-Identifier: Apache-2.0
"""
Errors left in the six axes of a survey tool after calibration, its misalignment in the hole, and their covariance.

The defaults are the sensor and alignment terms of the ISCWSA / OWSG tool code for ordinary MWD (A001Mc rev 5.1: ABXY,
ABZ, ASXY, ASZ, MBXY, MBZ, MSXY, MSZ, AMIL, SAGE, XYM1 to XYM4E). The sensor terms are given per axis, so that they
propagate through any attitude and any method.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core.arrays import Array


@dataclass(frozen=True)
class SensorErrors:
    """1 sigma of the errors that are constant within one station, so that averaging does not reduce them."""

    accelerometer_bias_mps2: float = 0.004  #: accelerometer bias of each axis, m/s^2
    accelerometer_scale: float = 0.0005  #: accelerometer scale error of each axis
    magnetometer_bias_nt: float = 70.0  #: magnetometer bias of each axis, nT
    magnetometer_scale: float = 0.0016  #: magnetometer scale error of each axis
    #: Axial magnetic field of the drill string, 1 sigma, if its collars are long enough and non-magnetic, nT.
    axial_interference_nt: float = 220.0
    cross_interference_nt: float = 0.0  #: field of the drill string across the axis, along y and along z, nT
    #: Angle between tool axis and hole axis, in each direction, constant along the hole (XYM1, XYM2), deg.
    misalignment_deg: float = 0.1
    #: Angle between the hole axis at a station and the mean hole axis, random by station (XYM3E, XYM4E), deg.
    course_misalignment_deg: float = 0.3
    #: Rotation of the accelerometers against the magnetometers about each axis, deg. It is not part of the tool code;
    #: it is the rotation that remains after both were calibrated in one fixture.
    mount_deg: float = 0.02
    sag_deg: float = 0.2  #: sag of the assembly in a horizontal hole, if not corrected (SAGE), deg

    def covariance(self, f_t: ArrayLike, b_t: ArrayLike) -> Array:
        """
        Return the covariance of (f_t, b_t) caused by bias and scale errors of every axis, without interference.

        f_t, b_t, shape (..., 3), m/s^2 and T. Returns shape (..., 6, 6), (m/s^2)^2 and T^2, diagonal.
        """
        f_t, b_t = np.asarray(f_t, dtype=float), np.asarray(b_t, dtype=float)
        variance_f = self.accelerometer_bias_mps2**2 + (self.accelerometer_scale * f_t) ** 2
        variance_b = (self.magnetometer_bias_nt * 1e-9) ** 2 + (self.magnetometer_scale * b_t) ** 2
        return np.concatenate([variance_f, variance_b], axis=-1)[..., None] * np.eye(6)

    def alignment(self, inclination: float) -> Array:
        """
        Return the covariance of (inclination, azimuth, toolface) due to misalignment of tool and hole, rad^2, (3, 3).

        inclination: rad. The azimuth term grows as 1 / sin(inclination) towards the vertical, where azimuth itself
        becomes undefined.
        """
        sine, cosine = abs(math.sin(inclination)), math.cos(inclination)
        same, course, sag = (
            math.radians(angle) for angle in (self.misalignment_deg, self.course_misalignment_deg, self.sag_deg)
        )
        variance_inclination = (same * sine) ** 2 + (course * cosine) ** 2 + (sag * sine**0.25) ** 2
        variance_azimuth = same**2 + (course * cosine / max(sine, 1e-9)) ** 2
        return np.diag([variance_inclination, variance_azimuth, 0.0])
