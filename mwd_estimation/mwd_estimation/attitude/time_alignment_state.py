# SPDX-License-Identifier: Apache-2.0
"""Settings, state and rows of the time alignment of magnetic samples with gravity, as its kernels see them."""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core.ring import Ring
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.records import dtype_of

RING = 1024  # samples of gravity kept for pairing: 0.2 s at 5 kHz


class Params(NamedTuple):
    """How magnetic samples become a continuous azimuth."""

    mag_lag_ns: int = 20_000_000  #: delay after which a magnetic sample is paired with gravity
    mag_timeout_ns: int = 2_000_000_000  #: age of the magnetic field beyond which there is no azimuth
    #: Interval in which one magnetic sample updates the interference filter and the azimuth.
    interval_ns: int = 200_000_000
    smoothing_s: float = 1.0  #: time constant of azimuth and magnetic toolface
    #: `vertical_enter`, `vertical_leave`: inclination below which azimuth and high side are undefined, and above which
    #: they are defined again, rad.
    vertical_enter: float = math.radians(3.0)
    vertical_leave: float = math.radians(4.0)
    latency_s: float = 0.0  #: age of a reading at its stamp, over which both toolfaces are propagated by the x gyro


class FieldModel(NamedTuple):
    """What the magnetic samples are to be read with; it changes at surveys, not at samples."""

    interference: tuple[float, float, float]  #: field in tool axes that is not the Earth's, T, taken off before use
    #: `sigma_axial`, `sigma_cross`: 1 sigma of what is left of it along and across the axis, T.
    sigma_axial: float
    sigma_cross: float
    north_correction: float = 0.0  #: added to the magnetic azimuth to give the named north, rad
    sigma_north: float = 0.0  #: its 1 sigma, rad


class GravityRing(Ring):
    """The last samples whose gravity is known."""

    rows: Annotated[MutableSequence[Sample], RING]


class State:
    """All that changes."""

    recent: GravityRing
    last_ns: int  #: stamp of the last of these
    turn: float  #: about the tool axis since the start, rad
    near_vertical: bool  #: the hole is near vertical, with hysteresis
    #: `have_mag`, `mag_ns`: whether a magnetic sample has been taken in, and the stamp of the last.
    have_mag: bool
    mag_ns: int
    restart: bool  #: the next magnetic sample counts whole
    last_interval: int  #: in which one was handed on last
    #: `azimuth_vector`, `toolface_vector`: smoothed cosine and sine of azimuth, and of magnetic toolface less turn.
    azimuth_vector: Annotated[Array, 2]
    toolface_vector: Annotated[Array, 2]
    #: `azimuth`, `toolface`: their angles, rad.
    azimuth: float
    toolface: float
    #: `total`, `dip`, `horizontal`, `vertical`: of the last magnetic sample: strength T, dip rad, field across and
    #: along the vertical, T.
    total: float
    dip: float
    horizontal: float
    vertical: float


class AttitudeRow:
    """
    Attitude of a sample.

    Angles in rad, nan where not available (`azimuth`, `magnetic_toolface`) and then with a sigma of pi; `total` T and
    `dip` rad of the last magnetic sample used, however old, nan before the first; `status` the bits this module adds.
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
    """A magnetic sample handed on, with gravity at its own stamp."""

    place: int  #: IMU sample of the block with which it was taken
    stamp_ns: int  #: its own stamp
    #: `g_t`, `b_t`: unit vector down, and the field as read, T.
    g_t: Annotated[Array, 3]
    b_t: Annotated[Array, 3]
    sigma_tilt: float  #: 1 sigma of the direction down, rad
    #: `azimuth`, `sigma`: by the field model, from its north, and 1 sigma, rad.
    azimuth: float
    sigma: float


class MagBlock(NamedTuple):
    """Magnetic samples that wait, in order of their stamps: stamp_ns, shape (m,), and b_t, shape (m, 3), T."""

    stamp_ns: Stamps
    b_t: Array


STATE, ATTITUDE_ROW, PAIR = dtype_of(State), dtype_of(AttitudeRow), dtype_of(Pair)


def initial() -> Samples:
    """State before the first sample, shape (1,), dtype STATE; a copy of it resumes."""
    state = np.zeros(1, dtype=STATE)
    state["last_interval"] = -1
    return state
