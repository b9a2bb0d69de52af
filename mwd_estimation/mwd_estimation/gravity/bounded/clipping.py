# SPDX-License-Identifier: Apache-2.0
"""Clipping: velocity that is lost in clipped shocks, and roll while the x gyro is at the end of its range."""

from __future__ import annotations

import math

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded.measurement import SHOCK_APART
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import BIAS, ERRORS, MISSING, SLOPE, TILT, VEL, BoundedRecord, forget_density
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled

HIDDEN = 0.0014  # clipped time within a sample, s, from which the mean force of a shock is computed
UNUSUAL = 2.2  # smallest ratio of an unusual acceleration to the usual acceleration
CHANCE = 0.0023  # share of unusual samples in Gaussian vibration (chi-square with 3 degrees of freedom)
SHOCK = 0.004  # longest shock, s
LOST = 1.0  # ratio of lost to measured velocity: 1.0 to 1.9 on simulated shocks above 4, 8 and 16 g
USUAL_TIME = 0.3  # averaging time of the usual acceleration, s
SHOCK_POWER = 1e4  # largest contribution of a shock to the usual acceleration, (m/s^2)^2
SHOCK_MEMORY = 10.0  # time over which shocks are counted, s
QUIET = 0.05  # lower limit of the usual squared innovation, of which the gate is a multiple
LEAST_EXPECTED = 1e-6  # smallest expected number of hidden shocks per update from which the gate is computed
# Gate if there are no shocks: largest squared innovation over its usual variance (12 sigma). Vibration stays below it;
# above it, a sample is wrong or a shock occurred between two samples.
FARTHEST = 144.0
# Smallest time since the last shock, s, for the gate FARTHEST: if the attitude is lost, many innovations in a row are
# large.
ALONE = 1.0
SLOPE_LAG, CURVE_LAG = 0.03, 0.1  # time constants of the low-passes of the slope of the x rate and of its curvature, s
CLIP_SLOPE = 15.0  # rad/s^2, 1 sigma of the slope when clipping begins
LEAST_SCALE = 0.01  # smallest scale by which the variance of this slope is divided
CLIP_BRIDGE = 4.0  # longest clipping after which the roll is not lost, s
LOST_ROLL = 0.25  # rad^2, largest variance of the roll that does not count as lost
# Scale of the variance of the roll while the x gyro clips, over the mean square of the innovations of the last
# ROLL_SCALE_TIME, s. The ratio is 0.8 to 3.7 on nine simulated kinds of stick-slip.
ROLL_SCALE, ROLL_SCALE_TIME = 2.0, 0.2
CLIP_LOST = 3.0  # largest missing rate at the end of clipping at which the roll is not lost, rad/s
SMALL_ROLL = 1e-3  # rad^2, largest variance of the roll at which its correction may be treated as a small tilt
NEVER = 1e30  # gate that no innovation exceeds


@compiled
def follow_shocks(p: BoundedParams, s: BoundedRecord, dt: float, f: Vector, power: float, flag: bool) -> None:
    """
    Count shocks, and increase the variance of the velocity for the part of each shock that may have been clipped.

    A force far above the usual one may be a shock whose peak was clipped before the sensor averaged the force. The lost
    velocity is mostly along the measured force, so the variance of the velocity is increased in this direction. Samples
    of one shock lose velocity in the same direction: their sigmas, and not their variances, are added.

    dt: time since the last sample, s; f: force, m/s^2; power: squared acceleration, (m/s^2)^2; flag: whether the unit
    reports clipping in this sample, even if the measured force is small.
    """
    s.since_shock += dt
    s.shocks -= dt / SHOCK_MEMORY * s.shocks
    clipped = flag or track.clips(f, p.accel_range)
    unusual = power > UNUSUAL**2 * s.power + 100.0
    if clipped or unusual:
        # A mean force over dt is at least the range times the clipped share of dt.
        shown = p.accel_range * min(HIDDEN / max(dt, 1e-4), 0.9)
        if clipped or power > shown * shown:
            if (flag or unusual) and s.since_shock > SHOCK_APART:
                s.shocks += 1.0
                s.since_shock = 0.0
            s.shock_time += dt
            lost = LOST**2 * dt * max(2.0 * min(s.shock_time, SHOCK) - dt, dt)
            C = s.C
            for j in range(3):
                aj = C[j, 0] * f[0] + C[j, 1] * f[1] + C[j, 2] * f[2]
                if j == 2:
                    aj += p.gravity
                s.P[VEL + j, VEL + j] += 0.1 * lost * power
                for m in range(3):
                    am = C[m, 0] * f[0] + C[m, 1] * f[1] + C[m, 2] * f[2]
                    if m == 2:
                        am += p.gravity
                    s.P[VEL + j, VEL + m] += lost * (aj * am)
    else:
        s.shock_time = 0.0
    # Limit the contribution of a single shock to the usual acceleration; strong vibration contributes fully.
    s.power += min(1.0, dt / USUAL_TIME) * (min(power, SHOCK_POWER + 4.0 * s.power) - s.power)


@compiled
def jump_gate(s: BoundedRecord) -> float:
    """
    Return the gate: the ratio of squared innovation to variance above which velocity was lost in a hidden shock.

    Above the gate, an innovation comes from a hidden shock more often than from chance. The square of a normal
    innovation exceeds x times its variance with a probability of at most exp(-x / 2) (Chernoff's bound). Hidden shocks
    are assumed to occur at random with the frequency n of the visible shocks, minus the frequency at which vibration
    looks like a shock by chance. The probability of at least one shock within a time T is 1 - exp(-n T). Without shocks
    the gate is `FARTHEST`.

    After a rotation was lost, a large innovation comes from a wrong roll more often than from a shock. The gate is then
    `NEVER`, because a filter that takes the innovation for a shock keeps the wrong roll.
    """
    if s.clipping.seen and _roll_variance(s) > SMALL_ROLL:
        return NEVER
    expected = (s.shocks / SHOCK_MEMORY - CHANCE / max(s.period, 1e-4)) * s.sums.time
    if expected >= LEAST_EXPECTED:
        gate = -2.0 * math.log(-math.expm1(-expected))
    elif s.since_shock > ALONE:
        gate = FARTHEST
    else:
        return NEVER
    return gate * max(s.innovations.usual, QUIET)


@compiled
def _roll_variance(s: BoundedRecord) -> float:
    """Return the variance of the roll if the whole variance of the two tilts came from a roll, rad^2."""
    tilt = s.P[TILT, TILT] + s.P[TILT + 1, TILT + 1]
    variance: float = tilt / max(s.C[0, 0] ** 2 + s.C[1, 0] ** 2, 1e-6)
    return variance


@compiled
def split_tilt(s: BoundedRecord) -> float:
    """Remove the tilt that changes inclination from the covariance; return its variance, rad^2."""
    P = s.P
    norm = math.sqrt(max(s.C[0, 0] ** 2 + s.C[1, 0] ** 2, 1e-9))
    ax, ay = s.C[0, 0] / norm, s.C[1, 0] / norm
    variance: float = P[TILT, TILT] * ay * ay - 2.0 * P[TILT, TILT + 1] * ax * ay + P[TILT + 1, TILT + 1] * ax * ax
    for j in range(ERRORS):
        a = ax * P[TILT, j] + ay * P[TILT + 1, j]
        P[TILT, j], P[TILT + 1, j] = ax * a, ay * a
    for j in range(ERRORS):
        a = ax * P[j, TILT] + ay * P[j, TILT + 1]
        P[j, TILT], P[j, TILT + 1] = ax * a, ay * a
    return variance


@compiled
def join_tilt(s: BoundedRecord, variance: float) -> None:
    """Add a tilt that changes inclination to the covariance; variance in rad^2."""
    P = s.P
    ax, ay = s.C[0, 0], s.C[1, 0]
    norm2 = max(ax * ax + ay * ay, 1e-9)
    P[TILT, TILT] += variance * ay * ay / norm2
    P[TILT + 1, TILT + 1] += variance * ax * ax / norm2
    P[TILT, TILT + 1] -= variance * ax * ay / norm2
    P[TILT + 1, TILT] = P[TILT, TILT + 1]


@compiled
def _forget_from(P: Array, first: int, last: int) -> None:
    for j in range(ERRORS):
        for m in range(first, last):
            P[j, m] = P[m, j] = 0.0


@compiled
def follow_rate(p: BoundedParams, s: BoundedRecord, dt: float, wx: float, flag: bool) -> bool:
    """
    Update the slope of the x rate and, while the gyro clips, the missing rate.

    Return True if clipping has ended and the roll is lost. The missing rate is a state that starts with the last slope
    of the rate. The covariances of the sensor errors and of the inclination are set aside during clipping, so that a
    wrong roll cannot change them; the gyros across the axis keep the inclination.

    dt: time since the last sample, s; wx: measured x rate, rad/s; flag: whether the unit reports clipping of the x gyro
    in this sample.
    """
    c = s.clipping
    if flag or abs(wx) >= track.AT_RANGE * p.gyro_range:
        if c.sign == 0.0:
            _begin_clipping(s)
        c.sign = 1.0 if wx > 0.0 else -1.0
        # Assume that the slope of the rate decreases with the curvature that it had before clipping.
        s.slope -= c.sign * max(-c.sign * c.curve, 0.0) * dt
        s.missing += s.slope * dt
        c.time += dt
        if s.missing * wx < 0.0:
            s.missing = 0.0
        return False
    if c.sign != 0.0:
        return _end_clipping(s)
    if dt > 0.0:
        late = c.slope
        c.slope += (wx - s.last_w[0] - late * dt) / (SLOPE_LAG + dt)
        c.curve += (c.slope - late - c.curve * dt) / (CURVE_LAG + dt)
    return False


@compiled
def _begin_clipping(s: BoundedRecord) -> None:
    P, c = s.P, s.clipping
    c.seen = True
    c.scale = ROLL_SCALE * s.innovations.usual
    for j in range(MISSING - BIAS):
        for m in range(MISSING - BIAS):
            c.kept[j, m] = P[BIAS + j, BIAS + m]
    _forget_from(P, BIAS, ERRORS)
    s.missing = 0.0
    # Correct the delay of the low-passed slope.
    s.slope = c.slope + SLOPE_LAG * c.curve
    # The scale multiplies the whole covariance, but this variance is not inflated.
    P[SLOPE, SLOPE] = CLIP_SLOPE**2 / max(roll_scale(s), LEAST_SCALE)
    c.tilt = split_tilt(s)


@compiled
def _end_clipping(s: BoundedRecord) -> bool:
    P, c = s.P, s.clipping
    # At the end of clipping the true missing rate is zero; a large value of the state shows that the roll is wrong.
    lost = c.lost or abs(s.missing) > CLIP_LOST or c.time > CLIP_BRIDGE
    _forget_from(P, BIAS, ERRORS)
    for j in range(MISSING - BIAS):
        for m in range(MISSING - BIAS):
            P[BIAS + j, BIAS + m] = c.kept[j, m]
    join_tilt(s, c.tilt)
    s.innovations.across.power = roll_scale(s)
    forget_density(s)
    clear(s)
    return lost


@compiled
def follow_roll(s: BoundedRecord, square: float) -> None:
    """
    Follow the scale of the roll while the x gyro clips, and note whether the roll is lost.

    The filter follows the rate quickly then, so that vibration, a shock or a wrong roll changes the roll within a
    tenth of a second, long before the scale of the corrections shows it; the innovations show it at once.

    square: mean of the squared innovations of the last update over their variances.
    """
    c = s.clipping
    if c.sign == 0.0:
        return
    c.scale += s.sums.time / ROLL_SCALE_TIME * (ROLL_SCALE * square - c.scale)
    if c.scale * _roll_variance(s) > LOST_ROLL:
        c.lost = True


@compiled
def roll_scale(s: BoundedRecord) -> float:
    """Return the scale of the variance of the tilt across the hole; it is larger while the x gyro clips."""
    return max(s.innovations.across.power, s.clipping.scale)


@compiled
def large_tilt(s: BoundedRecord) -> float:
    """Return the variance of the tilt, at most 1 rad^2, if a rotation about the axis was lost, and 0 otherwise."""
    c = s.clipping
    if not c.seen:
        return 0.0
    variance: float = s.P[TILT, TILT] + s.P[TILT + 1, TILT + 1]
    return min((s.innovations.across.power if c.sign == 0.0 else c.scale) * variance, 1.0)


@compiled
def clear(s: BoundedRecord) -> None:
    """Reset the state of clipping."""
    c = s.clipping
    s.missing = s.slope = c.sign = c.time = c.tilt = c.slope = c.curve = c.scale = 0.0
    c.lost = False
