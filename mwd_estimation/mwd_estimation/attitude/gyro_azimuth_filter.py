# SPDX-License-Identifier: Apache-2.0
"""
Kalman filter of the gyro-propagated azimuth, with one compiled step per bin of time.

The azimuth of the last station is not corrected by magnetic azimuths (a Schmidt-Kalman state: no gain, full
covariance), so that it is an independent check at the next station. The leakage of the x rate is measured from the mean
cross-axis rates of a rotating tool (`estimate_leakage`). Derivation: ``docs/methods/continuous_attitude.md``.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.attitude.block import StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_state import (
    STATES,
    BinSums,
    Error,
    GyroAzimuthParams,
    GyroAzimuthState,
    MagneticAzimuth,
)
from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded.jumps import BIAS_STEP
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import project_covariance, reset_state, scalar_update, wrap_angle

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
    """Process a magnetic azimuth; azimuth is `measured.azimuth` propagated to the end of the bin, rad."""
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
