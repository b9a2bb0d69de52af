# SPDX-License-Identifier: Apache-2.0
"""
Settings and state of the gyro-propagated azimuth, in the form that its kernels use.

The first two Kalman states are the azimuth of the hole axis and the azimuth of the last accepted station, both
propagated by the gyros. The next two are the slow and the constant error of the magnetic azimuth, each in units of its
own sigma. The other states exist for the conventional unit and for the precision unit: bias of the y and z gyros,
leakage (share of the x rate that the y and z gyros read), drift about the vertical due to g-sensitivity, and time lag
of the gyros relative to the gravity vector. Derivation: ``docs/methods/continuous_attitude.md``.
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


class GyroAzimuthErrors(NamedTuple):
    """
    Index of the first entry of each quantity in x and P of `GyroAzimuthState`; there are STATES entries.

    BIAS and LEAKAGE have y and z of unit 0, then of unit 1; DRIFT and LAG have one entry for each unit.
    """

    AZIMUTH: int = 0
    STATION: int = 1
    SLOW_ERROR: int = 2
    CONSTANT_ERROR: int = 3
    BIAS: int = 4
    LEAKAGE: int = 8
    DRIFT: int = 12
    LAG: int = 14


Error = GyroAzimuthErrors()
STATES = 16
BINS = 4  # bins whose sums are kept: the open one, those waiting for other streams, and one spare
# Number of samples kept for pairing with other streams: 1.6 s at 5 kHz. They take most of the 1.4 MB of a state.
# Pairing reads only a third of each record, but one record type for all steps is simpler.
RING = 8192
NO_BIN = np.iinfo(np.int64).min
_HELD_S = 10.0  # correlation time of an error of the vertical in magnetic azimuths, s


class GyroUnit(NamedTuple):
    """Error model of the y and z gyros of one unit, each 1 sigma."""

    noise: float  #: white noise, rad/sqrt(s)
    bias: float  #: bias of each axis, rad/s
    walk: float  #: random walk of the bias, rad/s per sqrt(s)
    leakage: float  #: share of the x rate that y and z read
    drift: float  #: rate about the vertical due to g-sensitivity (and an unknown latitude), rad/s
    lag: float  #: lag of the rates behind the gravity vector, s


def gyro_unit(
    noise_deg_rth: float,
    bias_deg_h: float,
    walk_deg_h_rth: float,
    leak_urad: float = 300.0,
    g_sensitivity_deg_h_g: float = 0.5,
    lag_ms: float = 2.0,
) -> GyroUnit:
    """
    Return the error model of a unit from the figures of its data sheet.

    The arguments are noise, deg/sqrt(h); bias, deg/h; random walk of the bias, deg/h per sqrt(h); share of the x rate
    that y and z read, urad; g-sensitivity of each axis to itself, deg/h/g; and lag behind the estimated gravity, ms.
    """
    return GyroUnit(
        noise=noise_deg_rth * DEG_PER_ROOT_HOUR,
        bias=bias_deg_h * DEG_PER_HOUR,
        walk=walk_deg_h_rth * DEG_PER_HOUR / 60.0,
        leakage=leak_urad * 1e-6,
        # The drift about the vertical is the mean of the sensitivities of y and of z, weighted by the toolface.
        drift=g_sensitivity_deg_h_g * DEG_PER_HOUR * math.sqrt(0.5),
        lag=lag_ms * 1e-3,
    )


class GyroAzimuthParams(NamedTuple):
    """Settings of the gyro-propagated azimuth."""

    #: Conventional unit, then precision unit; the defaults are an MTi-1 and a tactical MEMS unit.
    units: tuple[GyroUnit, GyroUnit] = (
        gyro_unit(0.42, 400.0, 10.0, 300.0, 3.6, 0.5),
        gyro_unit(0.05, 5.0, 0.3),
    )
    precision_range: float = 0.98 * math.radians(100.0)  #: rate above which the precision unit clips, rad/s
    bin_ns: int = 500_000_000  #: length of a bin, ns
    #: `earth_north`, `earth_down`: components of the Earth's rotation, rad/s; 0 if the latitude is not known.
    earth_north: float = 0.0
    earth_down: float = 0.0
    #: Number of magnetic azimuths that share the error of the vertical: those within twice its correlation time.
    held_repeats: float = 2.0 * _HELD_S / (time_alignment_state.TimeAlignmentParams().interval_ns * 1e-9)
    slow_error_time_s: float = 14400.0  #: time constant of the slow error of the magnetic azimuth, s
    reset_time_s: float = 60.0  #: time of rejecting good magnetic azimuths after which the next one is accepted, s
    mag_timeout_s: float = 2.0  #: age of the last magnetic azimuth above which the azimuth is called gyro-aided, s
    vertical_sin2: float = math.sin(math.radians(3.0)) ** 2  #: squared sine of the smallest inclination with an azimuth
    gap_rate: float = math.radians(0.05)  #: 1 sigma of the rate at which the axis turns during a data gap, rad/s
    tilt_memory_s: float = 5.0  #: correlation time of the error of the gravity direction, s
    max_sigma: float = math.radians(45.0)  #: an azimuth with a larger sigma is not published, rad


def at_latitude(params: GyroAzimuthParams, latitude_deg: float | None) -> GyroAzimuthParams:
    """Return the settings with the Earth's rotation at a latitude, deg; None: the rotation counts as drift."""
    if latitude_deg is None:
        drifting = tuple(unit._replace(drift=math.hypot(unit.drift, EARTH_RATE)) for unit in params.units)
        return params._replace(units=(drifting[0], drifting[1]))
    latitude = math.radians(latitude_deg)
    return params._replace(earth_north=EARTH_RATE * math.cos(latitude), earth_down=-EARTH_RATE * math.sin(latitude))


class BinSums:
    """Integrals over a bin of time; d: unit vector down; across^2 = d_y^2 + d_z^2; w: rate, rad/s; tool axes."""

    bin: int  #: index of the bin; NO_BIN if empty
    turn: float  #: change of the azimuth of the axis according to the gyros, rad
    across: Annotated[Array, 2]  #: integral of d_y and d_z over across^2, s: rotation per bias
    time: float  #: time covered by samples, without data gaps, s
    earth: float  #: integral of d_x / across, s: rotation per northward Earth rate
    noise: float  #: integral of 1 / across^2, s
    tilt: float  #: integral of the squared error of the azimuth rate from 1 sigma of tilt of the vertical, rad^2/s
    gap: float  #: duration of data gaps, s
    gyro_turn: float  #: `GyroAzimuthState.gyro_turn` at the end of the bin, rad
    vertical: bool  #: whether a sample of the bin was nearer to the vertical than `vertical_sin2` allows
    leakage: Annotated[Array, 2]  #: integral of w_x d_y and w_x d_z over across^2, rad: rotation per leakage
    spin: float  #: integral of w_x, rad
    rate: Annotated[Array, 2]  #: integral of w_y and w_z, rad
    gyro_step: float  #: time since a step of the gyro bias that the bin has revealed, s; 0 if there was none
    lag: float  #: integral of w_x (w_y d_z - w_z d_y) / across^2, rad/s: rotation per second of lag


class GyroRing(Ring):
    """Ring buffer of the last samples with known gravity and rates."""

    rows: Annotated[MutableSequence[Sample], RING]


class GyroAzimuthState:
    """State of the gyro-propagated azimuth."""

    #: `last_ns`, `bins_opened`: stamp of the last sample, ns, and number of bins opened since the start.
    last_ns: int
    bins_opened: int
    gyro_turn: float  #: change of the azimuth of the axis since the start, from the conventional gyros, rad
    #: `x`, `P`: Kalman states and covariance.
    x: Annotated[Array, STATES]
    P: Annotated[Array, STATES, STATES]
    have_azimuth: bool  #: whether the filter has an azimuth
    #: `since_used_s`, `since_seen_s`: time since the last magnetic azimuth used, and since the last one received.
    since_used_s: float
    since_seen_s: float
    rejected_s: float  #: time for which good magnetic azimuths have been rejected, s
    #: True after a restart of the interference estimate, until a magnetic azimuth is used or a north seek replaces it.
    contested: bool
    doubt: float  #: variance added to the azimuth because good magnetic azimuths disagree with it, rad^2
    #: `innovation_ratio`, `innovation_mean`: last innovation divided by its sigma, and running mean of this ratio over
    #: good magnetic azimuths.
    innovation_ratio: float
    innovation_mean: float
    #: `rejected`, `disturbed`, `resets`: number of magnetic azimuths beyond the gate, number of magnetic azimuths that
    #: failed the field check, and number of resets of the azimuth.
    rejected: int
    disturbed: int
    resets: int
    mag_status: int  #: status bits of the last magnetic azimuth
    last_bin: int  #: index of the last processed bin; NO_BIN before the first
    bin_gyro_turn: float  #: `gyro_turn` at the end of the last processed bin, rad
    slow_sigma: float  #: 1 sigma that is the unit of the state Error.SLOW_ERROR, rad
    by_gyro_only: bool  #: whether the azimuth comes from a north seek and the gyros only
    have_station: bool  #: whether a station's azimuth is propagated
    station_constant_sigma: float  #: 1 sigma of the error common to the station and all magnetic azimuths, rad
    station_disagreed: bool  #: whether the last station disagreed with the propagated azimuth of an earlier station
    sums: Annotated[Sequence[BinSums], BINS]  #: gyro integrals over the last bins
    precision_sums: BinSums  #: gyro integrals of the precision unit over the last closed bin
    recent: GyroRing  #: last samples, for pairing with other streams


class MagneticAzimuth:
    """A magnetic azimuth from the reference north, and the interference that was removed from it."""

    place: int  #: index in the block of the IMU sample at which the magnetic sample was evaluated
    stamp_ns: int  #: stamp of the magnetic sample, ns
    azimuth: float  #: azimuth, rad
    #: `sigma_slow`, `sigma_held`, `sigma_noise`, `sigma_constant`: 1 sigma, rad, of the slowly changing error (the
    #: tool's own field), of the error that lasts for seconds (error of the vertical), of the error that is new in each
    #: sample (noise), and of the error that never changes (declination).
    sigma_slow: float
    sigma_held: float
    sigma_noise: float
    sigma_constant: float
    usable: bool  #: whether the field passes the check; otherwise the azimuth is never used
    restart: bool  #: True if earlier magnetic azimuths are withdrawn, so that the filter restarts
    new_start: bool  #: True if the interference estimate restarts here, with an error independent of the earlier one
    status: np.uint32  #: bits of `Status`
    #: `interference`, `sigma_interference`: the tool's own field and 1 sigma, T; NaN if it is not known.
    interference: Annotated[Array, 3]
    sigma_interference: Annotated[Array, 3]


class PropagatedAzimuth(NamedTuple):
    """Azimuths propagated to the end of a bin, from the reference north, rad; NaN for an azimuth that is unknown."""

    #: `station_azimuth`, `station_sigma`: azimuth of the last accepted station, propagated by the gyros alone.
    station_azimuth: float
    station_sigma: float
    #: 1 sigma of the part of the station azimuth's error that all magnetic azimuths share, rad; contained in
    #: `station_sigma`.
    station_constant_sigma: float
    #: `azimuth`, `sigma`: azimuth of the filter, and 1 sigma.
    azimuth: float
    sigma: float


class AzimuthRow:
    """Azimuth of a sample."""

    azimuth: float  #: azimuth of the hole axis from the reference north, rad in [0, 2 pi); NaN if there is none
    #: 1 sigma, rad, at most pi; infinite if no azimuth is propagated (none was ever known, or the hole is vertical).
    sigma: float
    #: GYRO_AIDED: propagated by the gyros alone. MAG_DISTURBED: the last magnetic azimuth was not used.
    status: np.uint32


class PrecisionRates(NamedTuple):
    """Rates of the precision unit: stamp_ns, ns, shape (q,), and rate_t in tool axes, rad/s, shape (q, 3)."""

    stamp_ns: Stamps
    rate_t: Array


STATE, BIN_SUMS = dtype_of(GyroAzimuthState), dtype_of(BinSums)
MAGNETIC_AZIMUTH, BIN_EVENT = dtype_of(MagneticAzimuth), dtype_of(BinEvent)
PROPAGATED_AZIMUTH, AZIMUTH_ROW = dtype_of(PropagatedAzimuth), dtype_of(AzimuthRow)


def initial() -> Samples:
    """Return the state before the first sample, shape (1,), dtype STATE; a run can continue from a copy."""
    state = np.zeros(1, dtype=STATE)
    state["last_bin"] = NO_BIN
    state["sums"]["bin"] = NO_BIN
    return state
