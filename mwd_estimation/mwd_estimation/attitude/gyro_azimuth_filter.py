# SPDX-License-Identifier: Apache-2.0
"""
Kalman filter of the gyro-propagated azimuth, with one compiled step per bin of time.

The first two states are the azimuth of the hole axis and the azimuth of the last accepted station, both propagated by
the gyros. The next two are the slow and the constant error of the magnetic azimuth, each in units of its own sigma. The
other states exist for the conventional unit and for the precision unit: bias of the y and z gyros, leakage (share of
the x rate that the y and z gyros read), drift about the vertical due to g-sensitivity, and time lag of the gyros
relative to the gravity vector.

The azimuth of the last station is not corrected by magnetic azimuths (a Schmidt-Kalman state: no gain, full
covariance), so that it is an independent check at the next station. The leakage of the x rate is measured from the mean
cross-axis rates of a rotating tool (`estimate_leakage`). Derivation: ``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from mwd_estimation.attitude import time_alignment
from mwd_estimation.attitude.block import BinEvent, StationAzimuth
from mwd_estimation.attitude.sample import Sample
from mwd_estimation.core.ring import Ring
from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded.jumps import BIAS_STEP
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.kalman import project_covariance, reset_state, scalar_update, wrap_angle
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
    held_repeats: float = 2.0 * _HELD_S / (time_alignment.TimeAlignmentParams().interval_ns * 1e-9)
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
    slow_sigma: float  #: 1 sigma of the slow error, rad; the state Error.SLOW_ERROR is in multiples of it
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


# Smallest number of turns in a bin from which the leakage is estimated; and 1 sigma of the true rate across the axis
# (in a fast curve or by whirl), rad/s, which does not average out over the incomplete turn of a bin.
_MIN_TURNS, _ACROSS_RATE = 0.5, math.radians(0.05)
# Innovation over its sigma above which a magnetic azimuth is not used.
GATE = 4.0
# Difference, in sigmas, above which an azimuth of a station or of a north seek disagrees with the propagated azimuth.
_DISAGREES = 3.0
# If the mean innovation of good magnetic azimuths exceeds _BIASED_MEAN sigmas, the gyro bias is changing (for example
# while warming up). The variance of the biases then grows by their prior variance in each _MEAN_TIME, s, which is also
# the averaging time of the innovation.
_BIASED_MEAN, _MEAN_TIME = 1.5, 5.0
# If good magnetic azimuths are rejected for this time, s, they count as equally probable as the propagated azimuth. The
# field of a tool joint disturbs the sensor for less time.
_BELIEVED = 10.0
# If the smaller of the new and the last magnetic sigma is at least this share of the larger, the slow error is the
# same.
_SAME_SIGMA = 0.9

_DISTURBED = int(Status.MAG_DISTURBED)


@compiled
def begin(p: GyroAzimuthParams, s: GyroAzimuthState) -> None:
    """Restart the filter; keep the estimated leakage, because it does not depend on the azimuth."""
    for i in range(STATES):
        known = Error.LEAKAGE <= i < Error.DRIFT and s.P[i, i] > 0.0
        reset_state(s.P, i, s.P[i, i] if known else 0.0)
        if not known:
            s.x[i] = 0.0
    for u in range(2):
        unit = p.units[u]
        for i in range(2):
            bias, leakage = Error.BIAS + 2 * u + i, Error.LEAKAGE + 2 * u + i
            s.P[bias, bias] = unit.bias**2
            if not s.P[leakage, leakage] > 0.0:
                s.P[leakage, leakage] = unit.leakage**2
        s.P[Error.DRIFT + u, Error.DRIFT + u] = unit.drift**2
        s.P[Error.LAG + u, Error.LAG + u] = unit.lag**2
    s.P[Error.SLOW_ERROR, Error.SLOW_ERROR] = s.P[Error.CONSTANT_ERROR, Error.CONSTANT_ERROR] = 1.0
    s.have_azimuth = True
    s.have_station = s.station_disagreed = s.contested = False
    s.doubt = 0.0


@compiled
def _update(s: GyroAzimuthState, ph: Array, innovation: float, variance: float) -> None:
    """
    Update the states with one scalar measurement, which does not change the propagated azimuth of the station.

    ph, shape (STATES,): covariance of the measured quantity with the states; variance: variance of the innovation.
    """
    # The gains of the other states change the station azimuth's covariances, not its variance (Joseph form, zero gain).
    azimuth, own = s.x[Error.STATION], s.P[Error.STATION, Error.STATION]
    scalar_update(s.P, s.x, ph, variance, innovation)
    s.x[Error.STATION], s.P[Error.STATION, Error.STATION] = azimuth, own
    s.x[Error.AZIMUTH] %= 2.0 * math.pi


@compiled
def correct(s: GyroAzimuthState, azimuth: float, slow: float, constant: float, variance: float, extra: float) -> bool:
    """
    Update with an azimuth = x[AZIMUTH] + slow x[SLOW_ERROR] + constant x[CONSTANT_ERROR] + noise, rad.

    variance: variance of the noise, rad^2; extra: variance added after the test against the gate, rad^2, for noise that
    consecutive azimuths have in common. Returns whether the azimuth is used; beyond the gate, x and P stay unchanged.
    """
    h, ph = np.zeros(STATES), np.empty(STATES)
    h[Error.AZIMUTH], h[Error.SLOW_ERROR], h[Error.CONSTANT_ERROR] = 1.0, slow, constant
    total = project_covariance(s.P, h, ph) + variance
    innovation = _innovation(s, azimuth, slow, constant)
    s.innovation_ratio = innovation / math.sqrt(total)
    if abs(s.innovation_ratio) > GATE:
        return False
    _update(s, ph, innovation, total + extra)
    return True


@compiled
def _innovation(s: GyroAzimuthState, azimuth: float, slow: float, constant: float) -> float:
    """Return the measured azimuth minus the predicted azimuth, rad in [-pi, pi); slow, constant: as in `correct`."""
    x = s.x
    return wrap_angle(azimuth - x[Error.AZIMUTH] - slow * x[Error.SLOW_ERROR] - constant * x[Error.CONSTANT_ERROR])


@compiled
def fade_slow_error(s: GyroAzimuthState, share: float) -> None:
    """Replace part of the slow magnetic error by a new, independent error; share: part that is kept, 0 to 1."""
    s.x[Error.SLOW_ERROR] *= share
    for j in range(STATES):
        if j != Error.SLOW_ERROR:
            s.P[Error.SLOW_ERROR, j] *= share
            s.P[j, Error.SLOW_ERROR] = s.P[Error.SLOW_ERROR, j]
    s.P[Error.SLOW_ERROR, Error.SLOW_ERROR] = 1.0 + share * share * (s.P[Error.SLOW_ERROR, Error.SLOW_ERROR] - 1.0)


@compiled
def propagate(p: GyroAzimuthParams, s: GyroAzimuthState, sums: BinSums, unit: int) -> None:
    """
    Propagate the azimuth and the station's azimuth through one bin with the sums of one unit.

    azimuth += turn - bias . across - leakage . leakage sums - lag * lag sum - drift time - earth_down time
               + earth_north cos(azimuth) earth,
    with the names of `BinSums` and `GyroAzimuthParams`. It is the integral over the bin of the azimuth rate of the hole
    axis, (w - w_ie) . (d - (d.x) x) / sin^2(I).
    """
    slopes, rows = np.zeros((2, STATES)), np.zeros((2, STATES))
    turn = sums.turn - p.earth_down * sums.time
    north = p.earth_north * sums.earth
    for n in range(2):
        azimuth = s.x[n]
        slopes[n, n] = 1.0 - north * math.sin(azimuth)
        for i in range(2):
            slopes[n, Error.BIAS + 2 * unit + i] = -sums.across[i]
            slopes[n, Error.LEAKAGE + 2 * unit + i] = -sums.leakage[i]
        slopes[n, Error.DRIFT + unit], slopes[n, Error.LAG + unit] = -sums.time, -sums.lag
        moved = turn + north * math.cos(azimuth)
        for i in range(Error.BIAS, STATES):
            moved += slopes[n, i] * s.x[i]
        s.x[n] = (azimuth + moved) % (2.0 * math.pi)
        for i in range(STATES):
            if slopes[n, i] != 0.0:
                for j in range(STATES):
                    rows[n, j] += slopes[n, i] * s.P[i, j]
    # Variance of the azimuth from gyro noise, from rates mistaken for an azimuth rate because of an error of the
    # gravity direction, and from data gaps.
    gyros = p.units[unit]
    noise = gyros.noise**2 * sums.noise + 2.0 * p.tilt_memory_s * sums.tilt
    noise += (p.gap_rate * sums.gap) ** 2
    for n in range(2):
        for j in range(2, STATES):
            s.P[n, j] = s.P[j, n] = rows[n, j]
    for n in range(2):
        for o in range(n + 1):
            both = noise
            for i in range(STATES):
                both += rows[n, i] * slopes[o, i]
            s.P[n, o] = s.P[o, n] = both
    fade_slow_error(s, math.exp(-sums.time / p.slow_error_time_s))
    for u in range(2):
        for i in range(2):
            s.P[Error.BIAS + 2 * u + i, Error.BIAS + 2 * u + i] += p.units[u].walk ** 2 * sums.time


@compiled
def open_bias(s: GyroAzimuthState, sums: BinSums) -> None:
    """
    Increase the bias variances of the conventional unit if the gravity estimate found a step of the biases in this bin.

    Gravity shows only the component of a step across the vertical, and the azimuth needs the component along the
    vertical. From the step to the end of the bin this unknown component has turned both propagated azimuths.
    """
    if sums.gyro_step <= 0.0 or sums.time <= 0.0:
        return
    for i in range(2):
        bias, moved = Error.BIAS + i, -sums.across[i] / sums.time * sums.gyro_step
        variance = BIAS_STEP * BIAS_STEP
        s.P[bias, bias] += variance
        for n in range(2):
            s.P[n, bias] += variance * moved
            s.P[bias, n] = s.P[n, bias]
            for o in range(2):
                s.P[n, o] += variance * moved * moved


@compiled
def estimate_leakage(p: GyroAzimuthParams, s: GyroAzimuthState, sums: BinSums, unit: int) -> None:
    """
    Estimate the leakage of the x rate into y and z of a unit, from a bin in which the tool made at least half a turn.

    In axes of the rotating tool, a true rotation of the hole axis averages out over whole turns. The remaining integral
    of a cross-axis rate is bias * time + leakage * spin.
    """
    turns = abs(sums.spin) / (2.0 * math.pi)
    if turns < _MIN_TURNS:
        return
    time = sums.time
    noise = p.units[unit].noise ** 2 * time + (_ACROSS_RATE * time / turns) ** 2
    ph = np.zeros(STATES)
    for axis in range(2):
        bias, leakage = Error.BIAS + 2 * unit + axis, Error.LEAKAGE + 2 * unit + axis
        for i in range(STATES):
            ph[i] = time * s.P[i, bias] + sums.spin * s.P[i, leakage]
        variance = time * ph[bias] + sums.spin * ph[leakage] + noise
        innovation = sums.rate[axis] - time * s.x[bias] - sums.spin * s.x[leakage]
        if innovation * innovation <= GATE**2 * variance:
            _update(s, ph, innovation, variance)


@compiled
def _follow_innovations(p: GyroAzimuthParams, s: GyroAzimuthState, dt: float) -> None:
    """
    Update the mean innovation of good magnetic azimuths; increase the bias variances if the mean is too large.

    dt: time since the last magnetic azimuth, s.
    """
    s.innovation_mean += min(dt / _MEAN_TIME, 1.0) * (min(max(s.innovation_ratio, -GATE), GATE) - s.innovation_mean)
    if abs(s.innovation_mean) > _BIASED_MEAN:
        for u in range(2):
            prior = p.units[u].bias ** 2
            for i in range(Error.BIAS + 2 * u, Error.BIAS + 2 * u + 2):
                s.P[i, i] = min(s.P[i, i] + prior * dt / _MEAN_TIME, prior)


@compiled
def _scale_of_slow_error(s: GyroAzimuthState, measured: MagneticAzimuth) -> float:
    """
    Return the factor of the state SLOW_ERROR in a magnetic azimuth, rad.

    If the azimuth is usable and its sigma has changed, the state is rescaled.
    """
    slow = measured.sigma_slow
    kept = s.have_azimuth and s.slow_sigma > 0.0 and slow > 0.0
    share = min(slow / s.slow_sigma, s.slow_sigma / slow) if kept else 0.0
    if measured.usable and share < _SAME_SIGMA:
        if kept:
            # A better estimate of the interference keeps only the part `share` of the earlier error, in units of the
            # new sigma. A small change of sigma is noise and not a better estimate.
            fade_slow_error(s, share)
        s.slow_sigma = slow
    # Use the sigma of the time at which the slow error was estimated: if the sigma varied with noise, the filter would
    # wrongly separate slow error and azimuth.
    return s.slow_sigma if kept else slow


@compiled
def _first_azimuth(
    p: GyroAzimuthParams, s: GyroAzimuthState, azimuth: float, slow: float, constant: float, variance: float
) -> None:
    """
    Start the filter at a magnetic azimuth, whose slow and constant errors are then the errors of the azimuth state.

    slow, constant: 1 sigma of the slow and the constant error, rad; variance: variance of the noise, rad^2.
    """
    begin(p, s)
    s.innovation_mean = 0.0
    s.x[Error.AZIMUTH] = azimuth % (2.0 * math.pi)
    s.P[Error.AZIMUTH, Error.AZIMUTH] = slow * slow + variance + constant * constant
    s.P[Error.AZIMUTH, Error.SLOW_ERROR] = s.P[Error.SLOW_ERROR, Error.AZIMUTH] = -slow
    s.P[Error.AZIMUTH, Error.CONSTANT_ERROR] = s.P[Error.CONSTANT_ERROR, Error.AZIMUTH] = -constant


@compiled
def _doubt(s: GyroAzimuthState, innovation: float) -> float:
    """
    Return the variance, rad^2, to add to the azimuth because a good magnetic azimuth differs by `innovation`, rad.

    If the two azimuths differ by more than their sigma, either may be right. A single rejected magnetic azimuth is
    probably wrong. The magnetic azimuth is as probable as the propagated azimuth if the estimate of the tool's own
    field was restarted, or if good magnetic azimuths have differed for `_BELIEVED` seconds.
    """
    share = 1.0 if s.contested else min(s.rejected_s / _BELIEVED, 1.0)
    return 0.5 * share * innovation * innovation * max(1.0 - 1.0 / max(s.innovation_ratio**2, 1e-9), 0.0)


@compiled
def azimuth_sigma(s: GyroAzimuthState) -> float:
    """Return 1 sigma of the azimuth, rad."""
    return math.sqrt(max(s.P[Error.AZIMUTH, Error.AZIMUTH] + s.doubt, 0.0))


@compiled
def magnetic(p: GyroAzimuthParams, s: GyroAzimuthState, measured: MagneticAzimuth, azimuth: float) -> None:
    """
    Process a magnetic azimuth.

    measured: the magnetic azimuth with its sigmas; azimuth: the value of this azimuth propagated by the gyros to the
    end of the bin, rad.
    """
    held, white, constant = measured.sigma_held, measured.sigma_noise, measured.sigma_constant
    variance, extra = held * held + white * white, held * held * (p.held_repeats - 1.0)
    if measured.restart:
        s.have_azimuth = s.have_station = False
        s.innovation_mean = 0.0
    if measured.new_start:
        # The new magnetic azimuth and the propagated azimuth are two hypotheses; neither replaces the other yet.
        fade_slow_error(s, 0.0)
        s.slow_sigma, s.contested = 0.0, True
    slow = _scale_of_slow_error(s, measured)
    # A data gap is not evidence against the azimuth, so count at most the time-out between two magnetic azimuths.
    since = min(s.since_seen_s, p.mag_timeout_s)
    used, off = False, _innovation(s, azimuth, slow, constant)
    if not measured.usable:
        s.disturbed += 1
        s.rejected_s = 0.0
    elif not s.have_azimuth:
        _first_azimuth(p, s, azimuth, slow, constant, variance)
        used = True
    elif correct(s, azimuth, slow, constant, variance, extra):
        used = True
        # After a restart of the interference estimate, compute the added variance anew for each azimuth. Otherwise let
        # it decay, because the magnetic azimuths agree with the propagated azimuth again.
        decayed = s.doubt * math.exp(-since / p.reset_time_s) if s.rejected_s == 0.0 else 0.0
        s.doubt = _doubt(s, off) if s.contested else decayed
    else:
        s.doubt = _doubt(s, off)
        s.rejected += 1
        s.rejected_s += since
        if s.rejected_s > p.reset_time_s:
            # Good magnetic azimuths consistently differ, so the propagated azimuth has a larger error than its sigma.
            s.resets += 1
            s.P[Error.AZIMUTH, Error.AZIMUTH] += off * off
            correct(s, azimuth, slow, constant, variance, extra)
            s.doubt = 0.0
            used = True
    if measured.usable:
        _follow_innovations(p, s, since)
    s.since_seen_s = 0.0
    s.mag_status = 0 if used else _DISTURBED
    if used:
        s.by_gyro_only = s.contested = False
        s.rejected_s = s.since_used_s = 0.0


@compiled
def seek(p: GyroAzimuthParams, s: GyroAzimuthState, azimuth: float, sigma: float) -> None:
    """
    Process the azimuth of a north seek and its 1 sigma, rad.

    If it disagrees with the propagated azimuth, the propagated azimuth restarts from the north seek.

    North seeks of one gyro have a common error. If the azimuth already comes from an earlier seek, use the more
    accurate of the two and not their mean.
    """
    if not s.have_azimuth:
        begin(p, s)
        s.P[Error.AZIMUTH, Error.AZIMUTH] = math.pi * math.pi
        s.x[Error.AZIMUTH] = azimuth
    alone, s.by_gyro_only = s.by_gyro_only, True
    away = wrap_angle(azimuth - s.x[Error.AZIMUTH])
    agrees = away * away <= _DISAGREES**2 * (s.P[Error.AZIMUTH, Error.AZIMUTH] + sigma * sigma)
    if alone and agrees and sigma * sigma >= s.P[Error.AZIMUTH, Error.AZIMUTH]:
        return
    if alone or not agrees or not correct(s, azimuth, 0.0, 0.0, sigma * sigma, 0.0):
        if not agrees:
            s.resets += 1
        s.x[Error.AZIMUTH] = azimuth % (2.0 * math.pi)
        reset_state(s.P, Error.AZIMUTH, sigma * sigma)
    s.doubt, s.contested = 0.0, False


@compiled
def station(s: GyroAzimuthState, accepted: StationAzimuth) -> None:
    """
    Begin to propagate the azimuth of an accepted station.

    If a station without gyro azimuth disagrees with the propagated azimuth of the previous station, its azimuth is not
    used. If the next station disagrees too, the azimuth of this next station is propagated.
    """
    if not s.have_azimuth:
        return
    sigma, constant = accepted.sigma, accepted.constant_sigma
    if s.have_station and not accepted.by_gyro:
        apart = wrap_angle(accepted.azimuth - s.x[Error.STATION])
        variance = s.P[Error.STATION, Error.STATION] + sigma * sigma - 2.0 * constant * s.station_constant_sigma
        if apart * apart > _DISAGREES**2 * variance and not s.station_disagreed:
            s.station_disagreed = True
            return
    s.station_disagreed = False
    s.x[Error.STATION] = accepted.azimuth % (2.0 * math.pi)
    reset_state(s.P, Error.STATION, sigma * sigma)
    s.have_station, s.station_constant_sigma = True, constant
