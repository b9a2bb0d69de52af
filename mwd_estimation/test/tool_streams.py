# SPDX-License-Identifier: Apache-2.0
"""Samples of the IMU and the magnetometer of a tool at given attitudes, as messages carry them."""

import math

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire

START = 1_700_000_000 * 10**9
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.0, convergence=0.0, gravity=9.81, source="test")


def earth_field(total=5e-5, dip=1.1, declination=0.0):
    """Return the field of the Earth, T, in north, east and down."""
    north, east = math.cos(declination), math.sin(declination)
    return total * np.array([math.cos(dip) * north, math.cos(dip) * east, math.sin(dip)])


def streams(mat, rng, *, rate=0.0, field_n=None, gravity=9.81, start_ns=START):
    """
    Return samples of the IMU and the magnetometer, 100 a second, with the noise of a common unit.

    mat: attitudes, shape (n, 3, 3); rate: about the tool's axis, rad/s; field_n: T, `earth_field` if it is left out.
    """
    n = len(mat)
    imu, mag = wire.IMU.empty(n), wire.MAG.empty(n)
    imu["stamp_ns"] = mag["stamp_ns"] = start_ns + 10**7 * np.arange(n)
    imu["angular_velocity"] = 1e-3 * rng.normal(size=(n, 3))
    imu["angular_velocity"][:, 0] += rate
    imu["linear_acceleration"] = seen(mat, [0.0, 0.0, -gravity]) + 5e-3 * rng.normal(size=(n, 3))
    field_n = earth_field() if field_n is None else field_n
    mag["magnetic_field"] = seen(mat, field_n) + 5e-8 * rng.normal(size=(n, 3))
    return imu, mag


def seen(mat, vector_n):
    """Return a vector in north, east and down as a tool sees it at these attitudes, shape (n, 3)."""
    return np.einsum("kji,j->ki", mat, vector_n)


def place_of(reference, lat_deg=38.0):
    """Return a place whose fixed field is that of a reference."""
    return Place(
        field="fixed",
        total_nt=reference.total * 1e9,
        dip_deg=math.degrees(reference.dip),
        declination_deg=math.degrees(reference.declination),
        lat_deg=lat_deg,
    )
