# SPDX-License-Identifier: Apache-2.0
"""
Predict the reading of a magnetometer at an azimuth, and its change by each error that stations share.

Gravity gives the direction down. For each azimuth A of the hole axis from true north, the reference then gives the
field b(A) that the tool should read (S0, eqs 12-21, written with unit vectors):

    b(A) = H n(A - declination) + V down,   n(a) = cos(a) level - sin(a) right

with `level` the horizontal direction of the hole axis and `right` = down x level. The residual, the reading minus b(A),
is linear in every error that lasts: bias, scale and interference of the magnetometers in tool axes, errors of the
accelerometers (they turn the axes of b(A)), errors of total and dip of the reference, and an external field along
north, east and down. States are in units of their own nominal sigma; fields are in uT, to keep the numbers near 1.

A is the azimuth if the declination of the reference has no error. Such an error adds to the azimuth and does not change
the residual at A; see the module `declination`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.compiled import compiled

UT = 1e-6


class SharedErrors(NamedTuple):
    """First index of each group of shared errors in the state; groups of three are x, y, z of the tool by default."""

    FIELD_BIAS: int = 0  #: bias of the magnetometers, with the field of the string
    FIELD_SCALE: int = 3  #: scale of the magnetometers
    FORCE_BIAS: int = 6  #: bias of the accelerometers
    FORCE_SCALE: int = 9  #: scale of the accelerometers
    MOUNT: int = 12  #: rotation of the accelerometers relative to the magnetometers
    TOTAL: int = 15  #: total field of the reference
    DIP: int = 16  #: dip of the reference
    DECLINATION: int = 17  #: declination of the reference
    OUTSIDE: int = 18  #: external field: north, east, down
    FIELD_RATE: int = 21  #: change of the string's field along the axis in an hour
    GYRO: int = 22  #: error of the gyro azimuth that is the same at all stations
    SIZE: int = 23


Shared = SharedErrors()
SIZE = Shared.SIZE
# Change of the string's field along the axis in an hour, because the string shakes in the Earth's field while it
# drills: 1 sigma as a share of the field (`test_run_filter.py`). The benchmark's rows "remanence growing" show whether
# it is large enough.
_RATE_SHARE = 0.08
# Smallest inclination, rad, with which the axes of a station are computed; a hole nearer to the vertical is treated as
# if it had this inclination.
_UPRIGHT = 1e-3
# Nominal sigmas, 1 sigma of each component, nT, that neither the tool code nor the reference states: external field on
# a quiet day; error of the field at a single station in addition to the noise.
_QUIET_NT, _STATION_NT = 25.0, 15.0
# Parts of the reference's sigmas that change from station to station (MFIR, MDIR, DECR and DBHR of OWSG A003Mc rev
# 5.1): nT, deg, deg; and the part of the declination that is inversely proportional to the horizontal field, deg nT.
TOTAL_NT, DIP_DEG, _DECLINATION_DEG, DECLINATION_DEGNT = 60.0, 0.08, 0.1, 3000.0


# A station as a record for the kernels. axes: level, right and down, unit vectors in tool axes. sine (at least that of
# `_UPRIGHT`), cosine: of the inclination. field, force: readings, uT and m/s^2. horizontal, vertical: components of the
# reference field, uT. declination: angle from the north of the azimuths to magnetic north, rad. noise, force_noise:
# covariance of the errors of this station alone, uT^2 and (m/s^2)^2. gyro, gyro_other: the two gyro azimuths that fit
# equally well, rad (the same value if there is only one; nan without a gyro). gyro_lasting: 1 sigma of the lasting
# error of the gyro azimuth, rad. gyro_variance: variance of its other errors, rad^2.
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

# One record of `GEOMETRY`.
Row = Any

# The fields of a record without a gyro.
NO_GYRO = {"gyro": math.nan, "gyro_other": math.nan, "gyro_lasting": 0.0, "gyro_variance": 0.0}


def level_axes(f_h: Array) -> tuple[Array, tuple[float, float]]:
    """Return axes level, right, down, shape (3, 3), and sine and cosine of inclination; f_h, m/s^2, hole axes."""
    down = -f_h / np.linalg.norm(f_h)
    along = np.array([1.0, 0.0, 0.0]) - down[0] * down
    if np.linalg.norm(along) < _UPRIGHT * _UPRIGHT:
        along = np.array([0.0, 0.0, 1.0]) - down[2] * down
    level = along / np.linalg.norm(along)
    sine = math.hypot(float(down[1]), float(down[2]))
    return np.stack([level, np.cross(down, level), down]), (max(sine, _UPRIGHT), float(down[0]))


def geometry(f_h: Array, b_h: Array, covariance: Array, reference: Reference | None, declination: float) -> Samples:
    """
    Return one record of `GEOMETRY` without a gyro.

    Parameters
    ----------
    f_h, b_h : ndarray, shape (3,)
        Specific force, m/s^2, and field, T, in hole axes; the field is not used if a component is NaN.
    covariance : ndarray, shape (6, 6)
        Covariance of the noise of f_h and b_h, (m/s^2)^2 and T^2.
    reference : Reference or None
        Reference; without a reference field the reading does not depend on the azimuth.
    declination : float
        Angle of magnetic north from the north of the azimuths, rad.
    """
    row = np.zeros(1, GEOMETRY)
    one = row[0]
    one["axes"], (one["sine"], one["cosine"]) = level_axes(f_h)
    one["force"], one["force_noise"] = f_h, covariance[:3, :3]
    for name, value in NO_GYRO.items():
        one[name] = value
    if reference is not None and reference.has_field and np.isfinite(b_h).all():
        one["has_field"], one["field"] = True, b_h / UT
        one["horizontal"], one["vertical"] = reference.horizontal / UT, reference.vertical / UT
        one["declination"] = declination
        one["noise"] = covariance[3:, 3:] / UT**2 + (_STATION_NT * 1e-3) ** 2 * np.eye(3)
    return row


@dataclasses.dataclass(frozen=True)
class Sigmas:
    """Nominal 1 sigma values of the errors of a run, which are the units of the states."""

    shared: Array  #: shape (23,); sigma of each state of `SharedErrors`; fields in uT, forces in m/s^2, angles in rad
    #: shape (3,); sigmas of the part of total, dip and declination that differs from station to station, in units of
    #: the shared sigmas.
    own: Array
    #: shape (3,); change of total, dip and declination by a field of 1 uT along the Earth's field, across it in the
    #: meridian, and towards east: uT, rad, rad. Zero without a reference.
    by_ut: Array


# Largest share of the variance of the reference that can differ from station to station.
_MOST_OWN = 0.5


def nominal_sigmas(sensors: SensorErrors, reference: Reference | None, magnetic: bool) -> Sigmas:
    """Return the nominal sigmas; magnetic: whether azimuths are from magnetic north and need no declination."""
    sigma, own, by_ut = np.zeros(SIZE), np.zeros(3), np.zeros(3)
    along, across = sensors.axial_interference_nt, sensors.cross_interference_nt
    string = np.hypot(sensors.magnetometer_bias_nt, [along, across, across]) * 1e-3
    sigma[Shared.FIELD_BIAS : Shared.FIELD_BIAS + 3] = string
    sigma[Shared.FIELD_SCALE : Shared.FIELD_SCALE + 3] = sensors.magnetometer_scale
    sigma[Shared.FORCE_BIAS : Shared.FORCE_BIAS + 3] = sensors.accelerometer_bias_mps2
    sigma[Shared.FORCE_SCALE : Shared.FORCE_SCALE + 3] = sensors.accelerometer_scale
    sigma[Shared.MOUNT : Shared.MOUNT + 3] = math.radians(sensors.mount_deg)
    if reference is not None:
        field = math.radians(DECLINATION_DEGNT * 1e-3) / (reference.horizontal / UT)
        declination = math.hypot(math.radians(_DECLINATION_DEG), field)
        whole = np.array([reference.sigma_total / UT, reference.sigma_dip, 0.0])
        whole[2] = 0.0 if magnetic else math.sqrt(reference.declination_variance(reference.horizontal))
        station = np.array([TOTAL_NT * 1e-3, math.radians(DIP_DEG), declination])
        station = np.minimum(station, math.sqrt(_MOST_OWN) * whole)
        sigma[Shared.TOTAL : Shared.OUTSIDE] = np.sqrt(whole**2 - station**2)
        total = math.hypot(reference.horizontal, reference.vertical)
        by_ut = np.array([1.0, UT / total, 0.0 if magnetic else UT / reference.horizontal])
        own = np.divide(station, sigma[Shared.TOTAL : Shared.OUTSIDE], out=own, where=whole > 0.0)
    sigma[Shared.OUTSIDE : Shared.OUTSIDE + 3] = _QUIET_NT * 1e-3
    sigma[Shared.FIELD_RATE] = _RATE_SHARE * string[0]
    sigma[Shared.GYRO] = 1.0
    return Sigmas(sigma, own, by_ut)


@compiled
def predicted(angle: float, one: Row, sigma: Array, residual: Array, slopes: Array, turns: Array) -> None:
    """
    Compute the residual at one azimuth, and its slopes by the shared errors.

    angle : azimuth for an exact declination, rad; one: a record of `GEOMETRY`; sigma, shape (23,), as `nominal_sigmas`.
    Filled: residual, shape (3,), uT; slopes, shape (3, 23), uT per nominal sigma; turns, shape (3, 3), slopes by the
    specific force, uT per m/s^2.
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
        north_m = cos_m * level - sin_m * right
        slopes[i, Shared.TOTAL] = (b_l * level + b_r * right + b_d * down) / total * sigma[Shared.TOTAL]
        slopes[i, Shared.DIP] = (horizontal * down - vertical * north_m) * sigma[Shared.DIP]
        slopes[i, Shared.OUTSIDE] = (cos_a * level - sin_a * right) * sigma[Shared.OUTSIDE]
        slopes[i, Shared.OUTSIDE + 1] = (sin_a * level + cos_a * right) * sigma[Shared.OUTSIDE + 1]
        slopes[i, Shared.OUTSIDE + 2] = down * sigma[Shared.OUTSIDE + 2]
        for j in range(3):
            slopes[i, Shared.FIELD_BIAS + j] = sigma[Shared.FIELD_BIAS + j] if i == j else 0.0
            slopes[i, Shared.FIELD_SCALE + j] = field[i] * sigma[Shared.FIELD_SCALE + j] if i == j else 0.0
    for j in range(3):
        # An error of the force along axis j turns the axes of b(A) by w = -b e1 + a e2 - b cot(I) down.
        a, b = axes[0, j] / g, axes[1, j] / g
        w_l, w_r, w_d = -b, a, -b * one.cosine / one.sine
        t_l, t_r, t_d = w_r * b_d - w_d * b_r, w_d * b_l - w_l * b_d, w_l * b_r - w_r * b_l
        for i in range(3):
            turns[i, j] = t_l * axes[0, i] + t_r * axes[1, i] + t_d * axes[2, i]
            slopes[i, Shared.FORCE_BIAS + j] = turns[i, j] * sigma[Shared.FORCE_BIAS + j]
            slopes[i, Shared.FORCE_SCALE + j] = turns[i, j] * force[j] * sigma[Shared.FORCE_SCALE + j]
    for i in range(3):
        # The error of the force by a rotated mount is the rotation x the force.
        slopes[i, Shared.MOUNT] = (turns[i, 2] * force[1] - turns[i, 1] * force[2]) * sigma[Shared.MOUNT]
        slopes[i, Shared.MOUNT + 1] = (turns[i, 0] * force[2] - turns[i, 2] * force[0]) * sigma[Shared.MOUNT + 1]
        slopes[i, Shared.MOUNT + 2] = (turns[i, 1] * force[0] - turns[i, 0] * force[1]) * sigma[Shared.MOUNT + 2]
        slopes[i, Shared.DECLINATION] = slopes[i, Shared.FIELD_RATE] = slopes[i, Shared.GYRO] = 0.0


def basis(angle: Array) -> Array:
    """Return 1, cosine and sine of angles, rad, shape (..., 3); residual and slopes are linear in them."""
    found = np.ones((*angle.shape, 3))
    found[..., 1], found[..., 2] = np.cos(angle), np.sin(angle)
    return found


_AT = np.arange(3.0) * math.tau / 3.0
_TO_BASIS = np.linalg.inv(basis(_AT))


@compiled
def expansion(one: Row, sigma: Array) -> tuple[Array, Array, Array]:
    """
    Return residual, slopes and slopes by the force as factors of `basis`: shapes (3, 4), (3, 4, 23) and (3, 4, 3).

    one: a record of `GEOMETRY`. Index 3 of the second axis is the gyro azimuth; its residual is 0 here, because
    `evidence.gyro_residual` computes it. The gyro measures the azimuth, so its residual contains the error of the
    declination.
    """
    residual, slopes, turns = np.zeros((3, 4)), np.zeros((3, 4, SIZE)), np.zeros((3, 4, 3))
    if one.has_field:
        at = np.zeros(3), np.zeros((3, SIZE)), np.zeros((3, 3))
        for k in range(3):
            predicted(_AT[k], one, sigma, at[0], at[1], at[2])
            for m in range(3):
                residual[m, :3] += _TO_BASIS[m, k] * at[0]
                slopes[m, :3] += _TO_BASIS[m, k] * at[1]
                turns[m, :3] += _TO_BASIS[m, k] * at[2]
    slopes[0, 3, Shared.GYRO] = one.gyro_lasting
    if one.has_field and math.isfinite(one.gyro):
        slopes[0, 3, Shared.DECLINATION] = sigma[Shared.DECLINATION]
    return residual, slopes, turns
