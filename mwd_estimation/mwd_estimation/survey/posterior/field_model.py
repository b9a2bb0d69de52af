# SPDX-License-Identifier: Apache-2.0
"""
What a magnetometer reads at an azimuth, and how each error that stations share changes that reading.

Gravity gives the direction down; for each azimuth A of the hole axis from true north the field that the tool should
read then follows from the reference (the geometry is that of S0, eqs 12-21, written with unit vectors):

    b(A) = H n(A - declination) + V down,   n(a) = cos(a) level - sin(a) right

with `level` the hole axis laid level and `right` = down x level. The residual, the reading less b(A), is linear in
every error that lasts: bias, scale and interference in tool axes, what the accelerometers' errors do to the axes that
b(A) is laid along, the reference's total, dip and declination, and a field from outside in north, east and down.
States are in units of their own nominal sigma; fields are in uT, which keeps the numbers near one.
"""

from __future__ import annotations

import dataclasses
import math
from enum import IntEnum
from typing import Any

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.compiled import compiled

UT = 1e-6


class Shared(IntEnum):
    """Where the errors that stations share begin in the state; each group is x, y, z of the tool or as it says."""

    FIELD_BIAS = 0  # of the magnetometers, and the string's field
    FIELD_SCALE = 3
    FORCE_BIAS = 6
    FORCE_SCALE = 9
    MOUNT = 12  # turn of the accelerometers against the magnetometers
    TOTAL = 15  # of the reference
    DIP = 16
    DECLINATION = 17
    OUTSIDE = 18  # field from outside, north, east, down
    GYRO = 21  # what the gyro gets wrong alike at all stations
    SIZE = 22


_BIAS, _SCALE, _FORCE, _STRETCH, _MOUNT = 0, 3, 6, 9, 12
_TOTAL, _DIP, _DECLINATION, _OUTSIDE = 15, 16, 17, 18
SIZE = int(Shared.SIZE)
# The level direction of a hole nearer to the vertical than this, rad, is taken as if it were so far from it.
_UPRIGHT = 1e-3


@dataclasses.dataclass(frozen=True)
class FieldErrors:
    """Nominal sigmas that are not those of the tool code or the reference."""

    quiet_nt: float = 25.0  #: field from outside on a quiet day, each component, nT
    #: What of the reference's sigmas changes from station to station (MFIR, MDIR, DECR and DBHR of OWSG A003Mc rev
    #: 5.1): nT, deg, deg, and what of the declination grows with a weak horizontal field, times that field, deg nT.
    total_nt: float = 60.0
    dip_deg: float = 0.08
    declination_deg: float = 0.1
    declination_degnt: float = 3000.0
    station_nt: float = 15.0  #: error of each component that is a station's own, beside its noise, nT


# A station laid out for the kernels. Axes: level, right and down, unit vectors in tool axes. Sine (at least that of
# `_UPRIGHT`) and cosine of the inclination. Field and earth (horizontal, down), uT; force, m/s^2; declination of
# magnetic north from the north that azimuths count from, rad; noise of reading and force that is the station's own,
# uT^2 and (m/s^2)^2; azimuth of a gyro, rad (nan: none), and the other
# that fits it as well (or the same), 1 sigma of what lasts in it and variance of the rest.
GEOMETRY = np.dtype(
    [
        ("axes", "f8", (3, 3)),
        ("sine", "f8"),
        ("cosine", "f8"),
        ("field", "f8", 3),
        ("force", "f8", 3),
        ("horizontal", "f8"),
        ("vertical", "f8"),
        ("declination", "f8"),
        ("noise", "f8", (3, 3)),
        ("force_noise", "f8", (3, 3)),
        ("gyro", "f8"),
        ("gyro_other", "f8"),
        ("gyro_lasting", "f8"),
        ("gyro_variance", "f8"),
        ("has_field", "?"),
    ]
)

# One record of it.
Row = Any


def level_axes(f_h: Array) -> tuple[Array, tuple[float, float]]:
    """Level, right and down, shape (3, 3), and sine and cosine of the inclination; f_h, m/s^2, in hole axes."""
    down = -f_h / np.linalg.norm(f_h)
    along = np.array([1.0, 0.0, 0.0]) - down[0] * down
    if np.linalg.norm(along) < _UPRIGHT * _UPRIGHT:
        along = np.array([0.0, 0.0, 1.0]) - down[2] * down
    level = along / np.linalg.norm(along)
    sine = math.hypot(float(down[1]), float(down[2]))
    return np.stack([level, np.cross(down, level), down]), (max(sine, _UPRIGHT), float(down[0]))


def geometry(
    f_h: Array, b_h: Array, covariance: Array, reference: Reference | None, declination: float, errors: FieldErrors
) -> Samples:
    """
    One record of `GEOMETRY` without a gyro.

    Parameters
    ----------
    f_h, b_h : ndarray, shape (3,)
        Specific force, m/s^2, and field, T, in hole axes; a nan of the field: none.
    covariance : ndarray, shape (6, 6)
        Noise of both, (m/s^2)^2 and T^2.
    reference : Reference or None
        Without a field the reading says nothing of the azimuth.
    declination : float
        Of magnetic north from the north that azimuths count from, rad.
    errors : FieldErrors
    """
    row = np.zeros(1, GEOMETRY)
    one = row[0]
    one["axes"], (one["sine"], one["cosine"]) = level_axes(f_h)
    one["force"], one["force_noise"], one["gyro"] = f_h, covariance[:3, :3], math.nan
    if reference is not None and reference.has_field and np.isfinite(b_h).all():
        one["has_field"], one["field"] = True, b_h / UT
        one["horizontal"], one["vertical"] = reference.horizontal / UT, reference.vertical / UT
        one["declination"] = declination
        one["noise"] = covariance[3:, 3:] / UT**2 + (errors.station_nt * 1e-3) ** 2 * np.eye(3)
    return row


@dataclasses.dataclass(frozen=True)
class Sigmas:
    """Nominal sigmas of a run."""

    shared: Array  #: shape (22,); of each state: uT, plain, m/s^2, plain, rad, uT, rad, rad, uT, and one for the gyro
    own: Array  #: shape (3,); of total, dip and declination of a station alone, in units of the shared ones


# Most of a reference's variance that can be a station's own.
_MOST_OWN = 0.5


def nominal_sigmas(sensors: SensorErrors, reference: Reference | None, errors: FieldErrors, magnetic: bool) -> Sigmas:
    """Nominal sigmas; magnetic: azimuths count from magnetic north, which the declination does not change."""
    sigma, own = np.zeros(SIZE), np.zeros(3)
    bias = sensors.magnetometer_bias_nt * 1e-3
    sigma[_BIAS : _BIAS + 3] = math.hypot(bias, sensors.axial_interference_nt * 1e-3), bias, bias
    sigma[_SCALE : _SCALE + 3] = sensors.magnetometer_scale
    sigma[_FORCE : _FORCE + 3] = sensors.accelerometer_bias_mps2
    sigma[_STRETCH : _STRETCH + 3] = sensors.accelerometer_scale
    sigma[_MOUNT : _MOUNT + 3] = math.radians(sensors.mount_deg)
    if reference is not None:
        field = math.radians(errors.declination_degnt * 1e-3) / (reference.horizontal / UT)
        declination = math.hypot(math.radians(errors.declination_deg), field)
        whole = np.array([reference.sigma_total / UT, reference.sigma_dip, 0.0])
        whole[2] = 0.0 if magnetic else math.sqrt(reference.declination_variance(reference.horizontal))
        station = np.array([errors.total_nt * 1e-3, math.radians(errors.dip_deg), declination])
        station = np.minimum(station, math.sqrt(_MOST_OWN) * whole)
        sigma[_TOTAL:_OUTSIDE] = np.sqrt(whole**2 - station**2)
        own = np.divide(station, sigma[_TOTAL:_OUTSIDE], out=own, where=whole > 0.0)
    sigma[_OUTSIDE : _OUTSIDE + 3] = errors.quiet_nt * 1e-3
    sigma[SIZE - 1] = 1.0
    return Sigmas(sigma, own)


@compiled
def predicted(angle: float, one: Row, sigma: Array, residual: Array, slopes: Array, turns: Array) -> None:
    """
    Residual and its slopes by the shared errors at one azimuth.

    angle : azimuth, rad; one: a record of `GEOMETRY`; sigma, shape (22,), as `nominal_sigmas`. Filled: residual, shape
    (3,), uT; slopes, shape (3, 22), uT per nominal sigma; turns, shape (3, 3), slopes by the specific force, uT per
    m/s^2.
    """
    axes, field, force = one.axes, one.field, one.force
    horizontal, vertical = one.horizontal, one.vertical
    magnetic = angle - one.declination
    cos_m, sin_m = math.cos(magnetic), math.sin(magnetic)
    cos_a, sin_a = math.cos(angle), math.sin(angle)
    total = math.sqrt(horizontal * horizontal + vertical * vertical)
    g = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    # Components of b(A) along level, right and down.
    b_l, b_r, b_d = horizontal * cos_m, -horizontal * sin_m, vertical
    for i in range(3):
        level, right, down = axes[0, i], axes[1, i], axes[2, i]
        residual[i] = field[i] - (b_l * level + b_r * right + b_d * down)
        north_m, east_m = cos_m * level - sin_m * right, sin_m * level + cos_m * right
        slopes[i, _TOTAL] = (b_l * level + b_r * right + b_d * down) / total * sigma[_TOTAL]
        slopes[i, _DIP] = (horizontal * down - vertical * north_m) * sigma[_DIP]
        slopes[i, _DECLINATION] = horizontal * east_m * sigma[_DECLINATION]
        slopes[i, _OUTSIDE] = (cos_a * level - sin_a * right) * sigma[_OUTSIDE]
        slopes[i, _OUTSIDE + 1] = (sin_a * level + cos_a * right) * sigma[_OUTSIDE + 1]
        slopes[i, _OUTSIDE + 2] = down * sigma[_OUTSIDE + 2]
        for j in range(3):
            slopes[i, _BIAS + j] = sigma[_BIAS + j] if i == j else 0.0
            slopes[i, _SCALE + j] = field[i] * sigma[_SCALE + j] if i == j else 0.0
    for j in range(3):
        # An error of the force along axis j turns the axes of b(A) by w = -b e1 + a e2 - b cot(I) down.
        a, b = axes[0, j] / g, axes[1, j] / g
        w_l, w_r, w_d = -b, a, -b * one.cosine / one.sine
        t_l, t_r, t_d = w_r * b_d - w_d * b_r, w_d * b_l - w_l * b_d, w_l * b_r - w_r * b_l
        for i in range(3):
            turns[i, j] = t_l * axes[0, i] + t_r * axes[1, i] + t_d * axes[2, i]
            slopes[i, _FORCE + j] = turns[i, j] * sigma[_FORCE + j]
            slopes[i, _STRETCH + j] = turns[i, j] * force[j] * sigma[_STRETCH + j]
    for i in range(3):
        # A turned mount errs by its turn x force.
        slopes[i, _MOUNT] = (turns[i, 2] * force[1] - turns[i, 1] * force[2]) * sigma[_MOUNT]
        slopes[i, _MOUNT + 1] = (turns[i, 0] * force[2] - turns[i, 2] * force[0]) * sigma[_MOUNT + 1]
        slopes[i, _MOUNT + 2] = (turns[i, 1] * force[0] - turns[i, 0] * force[1]) * sigma[_MOUNT + 2]
        slopes[i, SIZE - 1] = 0.0


def basis(angle: Array) -> Array:
    """1, cosine and sine of angles, rad: residual and slopes are linear in them. Shape (..., 3)."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


_AT = np.arange(3.0) * math.tau / 3.0
_TO_BASIS = np.linalg.inv(basis(_AT))


def expansion(one: Row, sigma: Array) -> tuple[Array, Array, Array]:
    """
    Residual, slopes and slopes by the force as factors of `basis`: shapes (3, 4), (3, 4, 22) and (3, 4, 3).

    one: a record of `GEOMETRY`. The fourth row is the gyro's azimuth less A, without the angle itself.
    """
    residual, slopes, turns = np.zeros((3, 4)), np.zeros((3, 4, SIZE)), np.zeros((3, 4, 3))
    if one["has_field"]:
        at = np.zeros((3, 3)), np.zeros((3, 3, SIZE)), np.zeros((3, 3, 3))
        for k, angle in enumerate(_AT):
            predicted(angle, one, sigma, at[0][k], at[1][k], at[2][k])
        for whole, part in zip((residual, slopes, turns), at, strict=True):
            whole[:, :3] = np.tensordot(_TO_BASIS, part, axes=1)
    slopes[0, 3, SIZE - 1] = one["gyro_lasting"]
    return residual, slopes, turns
