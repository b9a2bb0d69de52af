# SPDX-License-Identifier: Apache-2.0
"""
Settings and state of the gyro-propagated azimuth, as its kernels see them.

Kalman states: azimuth of the hole axis and the azimuth of the last accepted station, both propagated by the gyros;
the slow and the constant error of the magnetic azimuth, each in units of its own sigma; and of the conventional, then
of the precision unit the bias of the y and z gyros, their leakage (the share of the x rate that they read), the drift
about the vertical that g-sensitivity makes, and their lag behind the gravity vector. Derivation:
``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.attitude import time_alignment_state
from mwd_estimation.attitude.block import BinEvent
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core.ring import Ring
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.records import dtype_of


class ErrorOrder(NamedTuple):
    """
    Order of `State.x` and `State.P`: the first place of each quantity; there are STATES.

    BIAS and LEAKAGE hold y and z of unit 0, then of unit 1; DRIFT and LAG one of each unit.
    """

    AZIMUTH: int = 0
    STATION: int = 1
    SLOW_ERROR: int = 2
    CONSTANT_ERROR: int = 3
    BIAS: int = 4
    LEAKAGE: int = 8
    DRIFT: int = 12
    LAG: int = 14


Error = ErrorOrder()
STATES = 16
BINS = 4  # bins whose sums are kept: the open one, those that wait for other streams, and one to spare
# Samples kept for pairing with other streams: 1.6 s at 5 kHz. Most of a state's 1.4 MB, of which the pairing reads
# about a third: the one record of all steps is kept whole.
RING = 8192
NO_BIN = np.iinfo(np.int64).min
_HELD_S = 10.0  # correlation time of an error of the vertical in magnetic azimuths, s


class GyroUnit(NamedTuple):
    """Error model of the y and z gyros of one unit, each 1 sigma."""

    noise: float  #: white noise, rad/sqrt(s)
    bias: float  #: rad/s
    walk: float  #: random walk of the bias, rad/s per sqrt(s)
    leakage: float  #: share of the x rate that y and z read
    drift: float  #: rate about the vertical that g-sensitivity (and an unknown latitude) make, rad/s
    lag: float  #: of the rates behind the gravity vector, s


def gyro_unit(
    noise_deg_rth: float,
    bias_deg_h: float,
    walk_deg_h_rth: float,
    leak_urad: float = 300.0,
    g_sensitivity_deg_h_g: float = 0.5,
    lag_ms: float = 2.0,
) -> GyroUnit:
    """
    Error model of a unit by the figures of its data sheet.

    Noise, deg/sqrt(h), bias, deg/h, its walk, deg/h per sqrt(h), x rate that y and z read, urad, g-sensitivity, each to
    itself, deg/h/g, and lag behind the gravity found, ms.
    """
    return GyroUnit(
        noise=noise_deg_rth * DEG_PER_ROOT_HOUR,
        bias=bias_deg_h * DEG_PER_HOUR,
        walk=walk_deg_h_rth * DEG_PER_HOUR / 60.0,
        leakage=leak_urad * 1e-6,
        # Whatever the toolface, the mean of the sensitivities of y to y and of z to z acts.
        drift=g_sensitivity_deg_h_g * DEG_PER_HOUR * math.sqrt(0.5),
        lag=lag_ms * 1e-3,
    )


class Params(NamedTuple):
    """Settings."""

    #: Conventional unit, then precision unit: an MTi-1 and a tactical MEMS unit.
    units: tuple[GyroUnit, GyroUnit] = (
        gyro_unit(0.42, 400.0, 10.0, 300.0, 3.6, 0.5),
        gyro_unit(0.05, 5.0, 0.3),
    )
    precision_range: float = 0.98 * math.radians(100.0)  #: rate from which on the precision unit clips, rad/s
    bin_ns: int = 500_000_000  #: length of a bin
    #: `earth_north`, `earth_down`: the Earth's rotation, rad/s; 0 where the latitude is not known.
    earth_north: float = 0.0
    earth_down: float = 0.0
    #: Magnetic azimuths over which an error of the vertical repeats itself: those of twice its correlation time.
    held_repeats: float = 2.0 * _HELD_S / (time_alignment_state.Params().interval_ns * 1e-9)
    slow_error_time_s: float = 14400.0  #: time constant of the slow error of the magnetic azimuth
    reset_time_s: float = 60.0  #: after good azimuths were rejected for so long, the filter takes the next one in
    mag_timeout_s: float = 2.0  #: age of the last magnetic azimuth from which on the azimuth is called gyro-aided
    vertical_sin2: float = math.sin(math.radians(3.0)) ** 2  #: squared sine of the inclination without an azimuth
    gap_rate: float = math.radians(0.05)  #: rate at which the axis may turn during a data gap, rad/s, 1 sigma
    tilt_memory_s: float = 5.0  #: correlation time of the error of the gravity direction
    max_sigma: float = math.radians(45.0)  #: an azimuth with a larger sigma is not given, rad


def at_latitude(params: Params, latitude_deg: float | None) -> Params:
    """Settings with the Earth's rotation at a latitude; None: not known, and what it turns counts as drift."""
    if latitude_deg is None:
        drifting = tuple(unit._replace(drift=math.hypot(unit.drift, EARTH_RATE)) for unit in params.units)
        return params._replace(units=(drifting[0], drifting[1]))
    latitude = math.radians(latitude_deg)
    return params._replace(earth_north=EARTH_RATE * math.cos(latitude), earth_down=-EARTH_RATE * math.sin(latitude))


class BinSums:
    """Integrals over a bin of time; d is the unit vector down, across^2 = d_y^2 + d_z^2, w the rate."""

    bin: int  #: index of the bin, NO_BIN where none is held
    turn: float  #: of the axis as the gyros read it, rad
    across: Annotated[Array, 2]  #: of d_y and d_z over across^2, s: what a bias turns
    time: float  #: s
    earth: float  #: of d_x / across, s: what the Earth's northward rotation turns
    noise: float  #: of 1 / across^2, s
    tilt: float  #: of the squared rate that a tilt of the vertical mistakes for azimuth, rad^2/s
    gap: float  #: data gaps, s
    gyro_turn: float  #: `State.gyro_turn` at the end of the bin, rad
    vertical: bool  #: the hole was vertical in the bin
    leakage: Annotated[Array, 2]  #: of w_x d_y and w_x d_z over across^2, rad: what leakage turns
    spin: float  #: of w_x, rad
    rate: Annotated[Array, 2]  #: of w_y and w_z, rad
    lag: float  #: of w_x (w_y d_z - w_z d_y) / across^2, rad/s: what a second of lag turns


class GyroRing(Ring):
    """The last samples whose gravity and rates are known."""

    rows: Annotated[MutableSequence[Sample], RING]


class State:
    """All that changes."""

    #: `last_ns`, `bins_opened`: clock of the samples.
    last_ns: int
    bins_opened: int
    gyro_turn: float  #: turn of the axis as the conventional gyros integrate it, rad
    #: `x`, `P`: Kalman states and covariance.
    x: Annotated[Array, STATES]
    P: Annotated[Array, STATES, STATES]
    have_azimuth: bool  #: a first azimuth exists
    #: `since_used_s`, `since_seen_s`: since the last magnetic azimuth used, and since the last one seen.
    since_used_s: float
    since_seen_s: float
    rejected_s: float  #: for which good magnetic azimuths have been rejected
    #: `innovation_ratio`, `innovation_mean`: last innovation over its sigma, and its running mean over good azimuths.
    innovation_ratio: float
    innovation_mean: float
    #: `rejected`, `disturbed`, `resets`: counts of magnetic azimuths that were gated out, that failed their field
    #: check, and of times the azimuth was reset.
    rejected: int
    disturbed: int
    resets: int
    mag_status: int  #: bits of the last magnetic azimuth
    last_bin: int  #: taken in; NO_BIN before the first
    bin_gyro_turn: float  #: `gyro_turn` at its end, rad
    slow_sigma: float  #: 1 sigma that the state Error.SLOW_ERROR is in units of, rad
    by_gyro_only: bool  #: the azimuth rests on a north seek and the gyros alone
    have_station: bool  #: a station's azimuth is propagated
    station_constant_sigma: float  #: 1 sigma of its error that every magnetic azimuth shares, rad
    station_disagreed: bool  #: the last station did not agree with it
    sums: Annotated[Sequence[BinSums], BINS]  #: of the last bins
    precision_sums: BinSums  #: of the last closed bin, by the precision unit
    recent: GyroRing


class MagneticAzimuth:
    """A magnetic azimuth from the named north, and the interference it was freed of."""

    place: int  #: IMU sample of the block with which it was taken
    stamp_ns: int  #: its own stamp
    azimuth: float  #: rad
    #: `sigma_slow`, `sigma_held`, `sigma_noise`, `sigma_constant`: 1 sigma of the error that stays (the tool's own
    #: field), that stays for a while (the vertical's), that is new in each (noise), and that never changes
    #: (declination), rad.
    sigma_slow: float
    sigma_held: float
    sigma_noise: float
    sigma_constant: float
    usable: bool  #: its field passes the check; else it is never used
    restart: bool  #: earlier rows are withdrawn: the azimuth begins anew
    status: np.uint32  #: bits of `Status`
    #: `interference`, `sigma_interference`: the tool's own field and 1 sigma, T; NaN where it is not known.
    interference: Annotated[Array, 3]
    sigma_interference: Annotated[Array, 3]


class PropagatedAzimuth(NamedTuple):
    """Azimuths propagated to the end of a bin, rad from the named north; nan where there is none."""

    #: `station_azimuth`, `station_sigma`: of the last accepted station, by the gyros alone.
    station_azimuth: float
    station_sigma: float
    station_constant_sigma: float  #: the part of that sigma that every magnetic azimuth shares
    #: `azimuth`, `sigma`: of the samples.
    azimuth: float
    sigma: float


class AzimuthRow:
    """Azimuth of a sample."""

    azimuth: float  #: of the hole axis from the named north, rad in [0, 2 pi); nan where there is none
    #: 1 sigma, rad, at most pi; infinite where none is propagated, because none was ever known or the hole is vertical.
    sigma: float
    #: GYRO_AIDED: propagated by the gyros alone. MAG_DISTURBED: the last magnetic azimuth was not used.
    status: np.uint32


class PrecisionRates(NamedTuple):
    """Rates of the precision unit: stamp_ns, shape (q,), and rate_t, shape (q, 3), rad/s in tool axes."""

    stamp_ns: Stamps
    rate_t: Array


STATE, BIN_SUMS = dtype_of(State), dtype_of(BinSums)
MAGNETIC_AZIMUTH, BIN_EVENT = dtype_of(MagneticAzimuth), dtype_of(BinEvent)
PROPAGATED_AZIMUTH, AZIMUTH_ROW = dtype_of(PropagatedAzimuth), dtype_of(AzimuthRow)


def initial() -> Samples:
    """State before the first sample, shape (1,), dtype STATE; a copy of it resumes."""
    state = np.zeros(1, dtype=STATE)
    state["last_bin"] = NO_BIN
    state["sums"]["bin"] = NO_BIN
    return state
