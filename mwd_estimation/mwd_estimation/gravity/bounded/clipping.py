# SPDX-License-Identifier: Apache-2.0
"""Clipping: velocity lost in shocks that were cut off, and roll while the x gyro is beyond its range."""

from __future__ import annotations

import math

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded.measurement import SHOCK_APART
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import BIAS, ERRORS, MISSING, SLOPE, TILT, VEL, Record, forget_density
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled

HIDDEN = 0.0014  # s, clipped time from which a sample's mean force counts as a shock
UNUSUAL = 2.2  # factor on the usual acceleration above which a sample is unusual
CHANCE = 0.0023  # share of samples of Gaussian vibration above that (chi-square with 3 degrees of freedom)
LOST = 1.0  # lost velocity per shown velocity: 1.0 to 1.9 on simulated shocks beyond 4, 8 and 16 g
USUAL_TIME = 0.3  # s, averaging time of the usual acceleration
SHOCK_POWER = 1e4  # (m/s^2)^2, largest contribution of a shock to the usual acceleration
SHOCK_MEMORY = 10.0  # s, time over which shocks are counted
QUIET = 0.05  # least usual square of an innovation, of which the gate is a multiple
LEAST_EXPECTED = 1e-6  # expected shocks per update below which they set no gate
# Limit of a squared innovation over its usual variance (12 sigma). Vibration stays below it; above it, a sample is
# wrong or a shock occurred between two samples.
FARTHEST = 144.0
ALONE = 1.0  # s without a shock before it: an attitude that is lost shows in many innovations in a row
SLOPE_LAG, CURVE_LAG = 0.03, 0.1  # s, low-passes of the slope of the x rate and of its curvature
CLIP_SLOPE = 15.0  # rad/s^2, error of that slope when clipping begins
CLIP_BRIDGE = 4.0  # s, longest clipping that is bridged
CLIP_TILT = 9.0  # rad^2, variance of the tilt at the end of clipping above which roll is lost
CLIP_LOST = 3.0  # rad/s, missing rate at the end of clipping above which roll is lost
NEVER = 1e30  # gate that no innovation exceeds


@compiled
def follow_shocks(p: Params, s: Record, dt: float, f: Vector, power: float, flag: bool) -> None:
    """
    Count shocks, and increase the variance of the velocity for the part of each shock that may have been clipped.

    A force far above the usual may be a shock whose peak was cut off before the sensor averaged it. The lost velocity
    is mostly along the shown force, so its variance is increased in that direction at once.

    flag means that the unit reports clipping in this sample; it is trusted even if the sample shows a small force.
    """
    s.since_shock += dt
    s.shocks -= dt / SHOCK_MEMORY * s.shocks
    clipped = flag or track.clips(f, p.accel_range)
    unusual = power > UNUSUAL**2 * s.power + 100.0
    if clipped or unusual:
        # A sample that is a mean over dt shows at least the share of it that was clipped.
        shown = p.accel_range * min(HIDDEN / max(dt, 1e-4), 0.9)
        if clipped or power > shown * shown:
            if (flag or unusual) and s.since_shock > SHOCK_APART:
                s.shocks += 1.0
                s.since_shock = 0.0
            lost = (LOST * dt) ** 2
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
                    s.P[VEL + j, VEL + m] += lost * aj * am
    # A shock adds little to the usual acceleration, strong vibration adds fully.
    s.power += min(1.0, dt / USUAL_TIME) * (min(power, SHOCK_POWER + 4.0 * s.power) - s.power)


@compiled
def jump_gate(s: Record) -> float:
    """
    Return the squared innovation over its variance that reveals a velocity lost in a hidden shock.

    The gate is where chance makes an innovation as large less often than hidden shocks occur. A normal innovation
    exceeds x times its variance with a probability of at most exp(-x / 2) (Chernoff's bound). It is assumed that hidden
    shocks are as frequent as visible ones, less those that are vibration by chance, and occur at random: the
    probability of at least one within a time T is 1 - exp(-n T). Without shocks a single innovation may
    exceed `FARTHEST`.
    """
    expected = (s.shocks / SHOCK_MEMORY - CHANCE / max(s.period, 1e-4)) * s.sums.time
    if expected >= LEAST_EXPECTED:
        gate = -2.0 * math.log(-math.expm1(-expected))
    elif s.since_shock > ALONE:
        gate = FARTHEST
    else:
        return NEVER
    return gate * max(s.innovations.usual, QUIET)


@compiled
def split_tilt(s: Record) -> float:
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
def join_tilt(s: Record, variance: float) -> None:
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
def follow_rate(p: Params, s: Record, dt: float, wx: float, flag: bool) -> bool:
    """
    Follow the slope of the x rate and, while the gyro clips, the missing rate; return True if roll is lost at its end.

    The missing rate is a state that starts with the last slope of the rate. The covariances of the sensor errors and of
    the inclination are set aside meanwhile, so that a wrong roll cannot spoil them; the gyros across the axis keep the
    inclination.

    flag means that the unit reports the x gyro beyond its range in this sample.
    """
    c = s.clipping
    if flag or abs(wx) >= track.AT_RANGE * p.gyro_range:
        if c.sign == 0.0:
            _begin_clipping(s)
        c.sign = 1.0 if wx > 0.0 else -1.0
        # Assume that the rate bends back with the curvature it had before.
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
        c.slope += dt / (SLOPE_LAG + dt) * ((wx - s.last_w[0]) / dt - late)
        c.curve += dt / (CURVE_LAG + dt) * ((c.slope - late) / dt - c.curve)
    return False


@compiled
def _begin_clipping(s: Record) -> None:
    P, c = s.P, s.clipping
    c.seen = True
    for j in range(MISSING - BIAS):
        for m in range(MISSING - BIAS):
            c.kept[j, m] = P[BIAS + j, BIAS + m]
    _forget_from(P, BIAS, ERRORS)
    s.missing = 0.0
    # Correct the delay of the low-passed slope.
    s.slope = c.slope + SLOPE_LAG * c.curve
    P[SLOPE, SLOPE] = CLIP_SLOPE**2
    c.tilt = split_tilt(s)


@compiled
def _end_clipping(s: Record) -> bool:
    P, c = s.P, s.clipping
    # After clipping the missing rate must be zero; if the state says otherwise, it is wrong and so is the roll.
    lost = abs(s.missing) > CLIP_LOST or c.time > CLIP_BRIDGE
    _forget_from(P, BIAS, ERRORS)
    for j in range(MISSING - BIAS):
        for m in range(MISSING - BIAS):
            P[BIAS + j, BIAS + m] = c.kept[j, m]
    join_tilt(s, c.tilt)
    forget_density(s)
    clear(s)
    return lost or P[TILT, TILT] + P[TILT + 1, TILT + 1] > CLIP_TILT


@compiled
def clear(s: Record) -> None:
    """Reset the state of clipping."""
    c = s.clipping
    s.missing = s.slope = c.sign = c.time = c.tilt = c.slope = c.curve = 0.0
