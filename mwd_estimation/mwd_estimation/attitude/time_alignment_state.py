# SPDX-License-Identifier: Apache-2.0
"""Settings, state and results of the time alignment of magnetic samples with gravity, as records for its kernels."""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core.ring import Ring
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.records import dtype_of

RING = 1024  # number of gravity samples kept for pairing: 0.2 s at 5 kHz


class TimeAlignmentParams(NamedTuple):
    """Settings of the time alignment."""

    mag_lag_ns: int = 20_000_000  #: delay after which a magnetic sample is paired with gravity, ns
    mag_timeout_ns: int = 2_000_000_000  #: age of the last magnetic sample above which the azimuth is NaN, ns
    #: Interval, ns, in which one magnetic sample is selected to update the interference filter and the azimuth.
    interval_ns: int = 200_000_000
    smoothing_s: float = 1.0  #: time constant of the smoothing of azimuth and magnetic toolface, s
    #: `vertical_enter`, `vertical_leave`: angle of the axis from the vertical below which azimuth and high side become
    #: undefined, and above which they are defined again, rad.
    vertical_enter: float = math.radians(3.0)
    vertical_leave: float = math.radians(4.0)
    latency_s: float = 0.0  #: age of a measurement at its stamp, s; the x gyro propagates both toolfaces over this time


class FieldModel(NamedTuple):
    """Interference, north and their sigmas for the evaluation of magnetic samples; they change only at surveys."""

    interference: tuple[float, float, float]  #: interference, which is subtracted from the field, tool axes, T
    #: `sigma_axial`, `sigma_cross`: 1 sigma of the remaining interference along and across the axis, T.
    sigma_axial: float
    sigma_cross: float
    north_correction: float = 0.0  #: added to the magnetic azimuth to give the named north, rad
    sigma_north: float = 0.0  #: 1 sigma of the north correction, rad


class GravityRing(Ring):
    """Ring buffer of the last samples with known gravity."""

    rows: Annotated[MutableSequence[Sample], RING]


class TimeAlignmentState:
    """State of the time alignment."""

    recent: GravityRing  #: last samples with known gravity
    last_ns: int  #: stamp of the last sample with known gravity, ns
    turn: float  #: rotation about the tool axis since the start, rad
    near_vertical: bool  #: whether the hole is near vertical, with hysteresis
    #: `have_mag`, `mag_ns`: whether a magnetic sample has been used, and the stamp of the last one used, ns.
    have_mag: bool
    mag_ns: int
    restart: bool  #: whether the next magnetic sample replaces the smoothed values
    last_interval: int  #: index of the interval in which a magnetic sample was last selected
    #: `azimuth_vector`, `toolface_vector`: smoothed cosine and sine of azimuth, and of magnetic toolface minus
    #: rotation.
    azimuth_vector: Annotated[Array, 2]
    toolface_vector: Annotated[Array, 2]
    #: `azimuth`, `toolface`: angles of `azimuth_vector` and `toolface_vector`, rad.
    azimuth: float
    toolface: float
    tilt: float  #: smoothed 1 sigma of the direction down, rad
    #: `total`, `dip`, `horizontal`, `vertical`: strength, T, dip, rad, horizontal and vertical field, T, of the last
    #: magnetic sample.
    total: float
    dip: float
    horizontal: float
    vertical: float


class AttitudeRow:
    """
    Attitude of a sample.

    Angles and sigmas are in rad; `azimuth` and `magnetic_toolface` are NaN with a sigma of pi if unknown. `total`, T,
    and `dip`, rad, belong to the last magnetic sample used, however old this sample is; they are NaN before the first
    magnetic sample. `status` has the bits NO_MAG and NEAR_VERTICAL of `Status`.
    """

    inclination: float
    azimuth: float
    gravity_toolface: float
    magnetic_toolface: float
    sigma_azimuth: float
    sigma_magnetic_toolface: float
    total: float
    dip: float
    status: np.uint32


class Pair:
    """A selected magnetic sample with gravity at its own stamp."""

    place: int  #: index of the IMU sample at which the magnetic sample was used, in the samples given to the kernel
    stamp_ns: int  #: stamp of the magnetic sample, ns
    #: `g_t`, `b_t`: unit vector down, and the measured field, T.
    g_t: Annotated[Array, 3]
    b_t: Annotated[Array, 3]
    sigma_tilt: float  #: 1 sigma of the direction down, rad
    #: `azimuth`, `sigma`: azimuth from the north of the field model, rad, and 1 sigma, rad.
    azimuth: float
    sigma: float


class MagBlock(NamedTuple):
    """Waiting magnetic samples in order of their stamps: stamp_ns, shape (m,), and b_t, T, shape (m, 3)."""

    stamp_ns: Stamps
    b_t: Array


STATE, ATTITUDE_ROW, PAIR = dtype_of(TimeAlignmentState), dtype_of(AttitudeRow), dtype_of(Pair)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    state = np.zeros(1, dtype=STATE)
    state["last_interval"] = -1
    return state
