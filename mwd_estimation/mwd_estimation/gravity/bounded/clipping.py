# SPDX-License-Identifier: Apache-2.0
"""Clipping: velocity that a cut-off shock hides, and roll while the x gyro is beyond its range."""

from __future__ import annotations

import math

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import BIAS, ERRORS, MISSING, SLOPE, TILT, VEL, Record
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled

HIDDEN = 0.0014  # s of clipping that a sample must be able to show before it counts as a shock
UNUSUAL = 2.2  # times the usual acceleration
CHANCE = 0.0023  # share of samples of Gaussian vibration that is beyond it (chi-square of 3)
LOST = 1.0  # velocity lost for each velocity shown: 1.0 to 1.9 on simulated shocks beyond 4, 8 and 16 g
USUAL_TIME = 0.3  # s, memory of the usual acceleration
SHOCK_POWER = 1e4  # (m/s^2)^2, the most of a shock that enters it
SHOCK_MEMORY = 10.0  # s, over which shocks are counted
QUIET = 0.05  # least usual square of an innovation that the gate is a multiple of
LEAST_EXPECTED = 1e-6  # shocks in one update: fewer are none
SLOPE_LAG, CURVE_LAG = 0.03, 0.1  # s, low-passes of the slope of the x rate and of its curvature
CLIP_SLOPE = 15.0  # rad/s^2, error of that slope when clipping begins
CLIP_BRIDGE = 4.0  # s, longest clipping that is bridged
CLIP_TILT = 9.0  # rad^2, variance of the tilt at the end of clipping from which on roll is lost
CLIP_LOST = 3.0  # rad/s, missing rate at the end of clipping that shows roll astray
NEVER = 1e30  # gate that no innovation passes


@compiled
def follow_shocks(p: Params, s: Record, dt: float, f: Vector, power: float, flag: bool) -> None:
    """
    Count shocks, and make the velocity uncertain by what each may have hidden.

    A force far above the usual may be a shock whose tip was cut off before the sensor averaged it. Velocity is lost
    then, mostly along the force that is shown: that goes into its variance at once.

    flag: the unit says so of this sample. It is believed however little the sample shows.
    """
    s.since_shock += dt
    s.shocks -= dt / SHOCK_MEMORY * s.shocks
    clipped = flag or track.clips(f, p.accel_range)
    unusual = power > UNUSUAL**2 * s.power + 100.0
    if clipped or unusual:
        # A sample that is a mean of dt shows no less than the share of it that was clipped.
        shown = p.accel_range * min(HIDDEN / max(dt, 1e-4), 0.9)
        if clipped or power > shown * shown:
            if (flag or unusual) and s.since_shock > 0.1:
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
    # A shock counts little in the usual acceleration, strong vibration counts whole.
    s.power += min(1.0, dt / USUAL_TIME) * (min(power, SHOCK_POWER + 4.0 * s.power) - s.power)


@compiled
def jump_gate(s: Record) -> float:
    """
    Square of an innovation over its variance that shows a velocity lost in a shock that did not stand out.

    It is taken for one where chance makes an innovation as large less often than shocks come: a normal one has a square
    beyond x times its variance with a probability of at most exp(-x / 2) (Chernoff's bound). Assumed: as many shocks do
    not stand out as do, less those that are vibration by chance, and they come at random, with a probability of
    1 - exp(-n T) of one or more within a time T.
    """
    expected = (s.shocks / SHOCK_MEMORY - CHANCE / max(s.period, 1e-4)) * s.sums.time
    if expected < LEAST_EXPECTED:
        return NEVER
    return -2.0 * math.log(-math.expm1(-expected)) * max(s.innovations.usual, QUIET)


@compiled
def split_tilt(s: Record) -> float:
    """Take the tilt that changes inclination out of the covariance; returns its variance, rad^2."""
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
    """Put a tilt that changes inclination into the covariance; variance in rad^2."""
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
    Follow the slope of the x rate, and the missing rate while the gyro clips; True if roll is lost at the end of that.

    The missing rate is a state that starts with the slope the rate had. What is known of the sensors and of inclination
    is set aside meanwhile, lest a roll gone astray spoil it: the gyros across the axis keep it.

    flag: the unit says that the x gyro was beyond its range within this sample.
    """
    c = s.clipping
    if flag or abs(wx) >= track.AT_RANGE * p.gyro_range:
        if c.sign == 0.0:
            _begin_clipping(s)
        c.sign = 1.0 if wx > 0.0 else -1.0
        # It bends back as it did before.
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
    # The low-passed slope is late by its time constant.
    s.slope = c.slope + SLOPE_LAG * c.curve
    P[SLOPE, SLOPE] = CLIP_SLOPE**2
    c.tilt = split_tilt(s)


@compiled
def _end_clipping(s: Record) -> bool:
    P, c = s.P, s.clipping
    # When the gyro is back nothing is missing: if the state shows otherwise it is wrong, and roll with it.
    lost = abs(s.missing) > CLIP_LOST or c.time > CLIP_BRIDGE
    _forget_from(P, BIAS, ERRORS)
    for j in range(MISSING - BIAS):
        for m in range(MISSING - BIAS):
            P[BIAS + j, BIAS + m] = c.kept[j, m]
    join_tilt(s, c.tilt)
    clear(s)
    return lost or P[TILT, TILT] + P[TILT + 1, TILT + 1] > CLIP_TILT


@compiled
def clear(s: Record) -> None:
    """Note that the x gyro does not clip."""
    c = s.clipping
    s.missing = s.slope = c.sign = c.time = c.tilt = c.slope = c.curve = 0.0
