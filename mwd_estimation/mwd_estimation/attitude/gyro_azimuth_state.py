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

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
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


CONVENTIONAL, PRECISION = 0, 1
BINS = 4  # bins whose sums are kept: the open one, those that wait for other streams, and one to spare
RING = 8192  # samples kept for pairing with other streams: 1.5 s at 5 kHz; a power of two
NO_BIN = np.iinfo(np.int64).min


class GyroUnit(NamedTuple):
    """Error model of the y and z gyros of one unit, each 1 sigma."""

    noise: float  #: white noise, rad/sqrt(s)
    bias: float  #: rad/s
    walk: float  #: random walk of the bias, rad/s per sqrt(s)
    leakage: float  #: share of the x rate that y and z read
    drift: float  #: rate about the vertical that g-sensitivity (and an unknown latitude) make, rad/s
    lag: float  #: of the rates behind the gravity vector, s


class KernelParams(NamedTuple):
    """Settings in SI units."""

    bin_ns: int  #: length of a bin
    #: `earth_north`, `earth_down`: the Earth's rotation, rad/s; 0 where the latitude is not known.
    earth_north: float
    earth_down: float
    held_repeats: float  #: magnetic azimuths over which an error of the vertical repeats itself
    slow_error_time_s: float  #: time constant of the slow error of the magnetic azimuth
    reset_time_s: float  #: after good azimuths were rejected for so long, the filter takes the next one in
    mag_timeout_s: float  #: age of the last magnetic azimuth from which on the azimuth is called gyro-aided
    vertical_sin2: float  #: squared sine of the inclination below which there is no azimuth
    gap_rate: float  #: rate at which the axis may turn during a data gap, rad/s, 1 sigma
    tilt_memory_s: float  #: correlation time of the error of the gravity direction
    max_sigma: float  #: an azimuth with a larger sigma is not given, rad
    precision_range: float  #: range of the precision unit, rad/s
    units: tuple[GyroUnit, GyroUnit]  #: conventional, then precision


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


class RingSample:
    """A sample kept for pairing: stamp, unit vector down, `State.gyro_turn` and rate about the axis, rad/s."""

    stamp_ns: int
    down: Annotated[Array, 3]
    gyro_turn: float
    spin_rate: float


class State:
    """All that changes."""

    #: `last_ns`, `ring_head`, `ring_length`, `bins_opened`: clock of the samples.
    last_ns: int
    ring_head: int
    ring_length: int
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
    ring: Annotated[Sequence[RingSample], RING]  #: the last samples


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
    #: `interference`, `sigma_interference`: the tool's own field and 1 sigma, T; -1 where it is not known.
    interference: Annotated[Array, 3]
    sigma_interference: Annotated[Array, 3]


class BinStep:
    """A bin that closes within a block, and the azimuths that were found at its end, rad from the named north."""

    place: int  #: sample of the block from which on the step holds, rising
    bin: int  #: index of the bin
    #: `seek_azimuth`, `seek_sigma`: of a north seek, which owes nothing to the magnetometer; nan where there is none.
    seek_azimuth: float
    seek_sigma: float
    #: `station_azimuth`, `station_sigma`: of an accepted station, propagated to the next one; nan where there is none.
    station_azimuth: float
    station_sigma: float
    station_constant_sigma: float  #: the part of its sigma that every magnetic azimuth shares
    station_by_gyro: bool  #: a gyro found north there


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


class GyroSample(NamedTuple):
    """One sample of the conventional unit, by its numbers, as `time_alignment_state.Gravity`."""

    stamp_ns: int
    #: `w_x`, `w_y`, `w_z`: angular rate in tool axes, rad/s.
    w_x: float
    w_y: float
    w_z: float
    #: `d_x`, `d_y`, `d_z`: unit vector down in tool axes.
    d_x: float
    d_y: float
    d_z: float
    sigma_tilt: float  #: its 1 sigma, rad


class GyroBlock(NamedTuple):
    """Samples of the conventional unit, n of them."""

    stamp_ns: Stamps  #: int64, shape (n,)
    gyro_t: Array  #: shape (n, 3); angular rate, rad/s, in tool axes; x counts only for its leakage into y and z
    g_t: Array  #: shape (n, 3); unit vector down in tool axes; nan before a gravity method has one
    sigma_tilt: Array  #: shape (n,); its 1 sigma, rad


class PrecisionRates(NamedTuple):
    """Rates of the precision unit: stamp_ns, shape (q,), and rate_t, shape (q, 3), rad/s in tool axes."""

    stamp_ns: Stamps
    rate_t: Array


STATE, BIN_SUMS = dtype_of(State), dtype_of(BinSums)
MAGNETIC_AZIMUTH, BIN_STEP = dtype_of(MagneticAzimuth), dtype_of(BinStep)
PROPAGATED_AZIMUTH, AZIMUTH_ROW = dtype_of(PropagatedAzimuth), dtype_of(AzimuthRow)


def initial() -> Samples:
    """State before the first sample, shape (1,), dtype STATE; a copy of it resumes."""
    state = np.zeros(1, dtype=STATE)
    state["last_bin"] = NO_BIN
    state["sums"]["bin"] = NO_BIN
    return state
