# SPDX-License-Identifier: Apache-2.0
"""
Covariance scale of the bounded filter: its corrections of the tilt against the variance expected of them.

The noises have reserve, because motion is not white and gains need only their ratios. An update that finds as much as
it should corrects the tilt by a variance of what the covariance shrinks by. Corrections are low-passed by the filter's
own time, that in which noise adds as much as the variance of the tilt, and their power, weighted as in equation (10),
is the factor of the covariance. What no innovation shows is added: calibration, a cone of the gyros across the axis
while the tool rotates, travel along a curve.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded import noise
from mwd_estimation.gravity.bounded.measurement import hole_direction
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import ASKEW, BIAS, DOWN, SCALE, TILT, Record, Scale
from mwd_sensors.core.compiled import compiled

OWN_LEAST, OWN_MOST = 0.3, 20.0  # s, limits of the filter's own time
OWN_AGE = 0.25  # the most of it for each time since the start, which had more to find out than what is steady
# Least expected variance of a correction over what an interval adds to the tilt; after clipping, that which is judged.
LEAST_CORRECTION, SHARE_AFTER_CLIP = 0.3, 0.5
SCALE_TIME, SCALE_OWN = 4.0, 3.0  # s, memory of the power, and so many times the filter's own time more
# After a start the memory is no longer than a second and the square of the time over this, s: that forgets the
# corrections that find the sensors, which take some ten seconds, and not those behind them. The power must be the mean
# of several of the filter's own times: from two the reciprocal of the scale, and with it the error over sigma, has no
# finite mean.
SCALE_YOUNG, SCALE_SETTLED = 1.0, 12.0
BAND = 4.0  # weight of the middle of the filter's band, equations (8) and (10)
USUAL_TIME = 10.0  # s, memory of the usual innovation
ROTATING = 1.5  # rad/s, mean rate about the axis beyond which the filter cannot follow what is fixed in the tool
HALF = 0.5  # of the variance of calibration: biases; the other half is scales and axes out of square
BIAS_SHARE = 0.4  # of the carried sigmas of gyro bias and misalignment, which are 2.5 times those of the tool
LEAST_PRIOR = 1e-18  # variance, of sensors that are said to have no error
CURVE_TIME, CURVE_MOST = 5.0, 0.01  # s, memory of the axis; rad/s, rate of its turning above that of any hole


@compiled
def tilts(s: Record) -> tuple[float, float]:
    """Variances of the tilt that changes inclination and of the one that changes toolface, rad^2."""
    P = s.P
    dx, dy = hole_direction(s)
    # Tilt that changes inclination: an acceleration along the hole cannot be told from it.
    along = P[TILT, TILT] * dy * dy - 2.0 * P[TILT, TILT + 1] * dx * dy + P[TILT + 1, TILT + 1] * dx * dx
    return along, P[TILT, TILT] + P[TILT + 1, TILT + 1] - along


@compiled
def follow_corrections(s: Record, turn: float, along: float, across: float) -> None:
    """Follow the scales over one update; along, across: variances of the tilts before it; turn: what they grew by."""
    found = s.innovations
    dx, dy = hole_direction(s)
    tilt, aside = tilts(s)
    if s.clipping.sign == 0.0:
        # An inclination that was set aside while the x gyro clipped is at first not corrected: that says nothing.
        if along - tilt > SHARE_AFTER_CLIP * turn or not s.clipping.seen:
            _follow(s, found.along, max(along - tilt, LEAST_CORRECTION * turn), tilt / turn, dy, -dx)
        _follow(s, found.across, max(across - aside, LEAST_CORRECTION * turn), aside / turn, dx, dy)
    # Vibration that counts as dense as neighbouring samples say has no reserve. Where it stops counting, corrections
    # that were found small beside such a noise say nothing of the covariance that its absence leaves.
    whole = noise.whole(s)
    found.along.power, found.across.power = max(found.along.power, whole), max(found.across.power, whole)
    for j in range(2):
        s.slow_axis[j] += s.sums.time / CURVE_TIME * (s.C[j, 0] - s.slow_axis[j])


@compiled
def _follow(s: Record, found: Scale, expected: float, updates: float, nx: float, ny: float) -> None:
    """Follow the power of the corrections about n, over `updates`, equation (8); expected: their variance, rad^2."""
    T = s.sums.time
    own = max(min(updates * T, OWN_MOST, OWN_LEAST + OWN_AGE * s.settled), OWN_LEAST)
    share, unit = min(T / own, 1.0), 1.0 / math.sqrt(expected)
    low = found.low
    for j in range(2):
        value = s.correction[TILT + j] * unit
        for m in range(3):
            low[m, j] += share * (value - low[m, j])
            value = low[m, j]
    mean = nx * low[0, 0] + ny * low[0, 1]
    band = nx * (low[1, 0] - low[2, 0]) + ny * (low[1, 1] - low[2, 1])
    power = (mean * mean + BAND * band * band) / share
    memory = min(SCALE_TIME + SCALE_OWN * own, SCALE_YOUNG + (s.settled / SCALE_SETTLED) ** 2)
    found.power += T / memory * (power - found.power)


@compiled
def _cone(p: Params, s: Record, rotating: float) -> float:
    """
    Variance of the axis that a tool seems to rotate about, mean of y and z, rad^2.

    Gyros across the axis that are out of line, or have a bias, see the tool rotate about another axis than its own. A
    lasting speed hides much of that, and no innovation shows it. P / P0 of the error at switch-on is left of it, with
    the tool's sigma; the rest of P is noise of what was found, and has the scale of inclination.
    """
    P, total, slow = s.P, 0.0, rotating / math.copysign(max(s.turning, 1e-3), s.last_w[0])
    scale2, bias2 = max(p.scale_sigma**2, LEAST_PRIOR), max(p.bias_sigma**2, LEAST_PRIOR)
    askew2 = max(p.misalignment_sigma**2, LEAST_PRIOR)
    for j in range(2):
        y, k = BIAS + 1 + j, ASKEW + j
        variance = P[k, k] + slow * (P[y, y] * slow + 2.0 * P[y, k])
        left = (P[k, SCALE] + slow * P[y, SCALE]) ** 2 / scale2
        for m in range(3):
            left += (P[k, BIAS + m] + slow * P[y, BIAS + m]) ** 2 / bias2
        for m in range(2):
            left += (P[k, ASKEW + m] + slow * P[y, ASKEW + m]) ** 2 / askew2
        left = min(left, variance)
        total += 0.5 * (BIAS_SHARE**2 * left + s.innovations.along.power * (variance - left))
    return total


@compiled
def _heading_rate(s: Record) -> float:
    """Variance of the rate about the vertical that the bias of the gyros feigns, (rad/s)^2."""
    total = 0.0
    for j in range(3):
        for m in range(3):
            total += s.C[2, j] * s.P[BIAS + j, BIAS + m] * s.C[2, m]
    return BIAS_SHARE**2 * total


@compiled
def floors(p: Params, s: Record) -> tuple[float, float]:
    """Variances that no innovation shows, of the inclination and of the tilt across the hole, rad^2, equation (11)."""
    C, turn2 = s.C, s.turning**2
    across2 = C[0, 0] ** 2 + C[1, 0] ** 2
    upright2 = min(C[2, 0] ** 2, 1.0)
    rotating = turn2 / (turn2 + ROTATING**2)
    # Accelerometers that show another gravity than the place has are in error by as much across it as well.
    shown2 = s.down**2 - s.P[DOWN, DOWN] - p.gravity_sigma**2
    floor = max(p.calibration_sigma**2, shown2 / p.gravity**2)
    askew = rotating * _cone(p, s, rotating)
    # The pull of the circle that the sensor runs is across the axis. A share of it seems to lie along the axis, where
    # rotation does not average it out: that acts along the hole by the sine of inclination.
    pull2 = turn2 * turn2 * (s.lever[0] ** 2 + s.lever[1] ** 2) / p.gravity**2
    # Rotation averages out what is fixed across the axis, but for a turn of the accelerometers about it.
    along = floor * (1.0 - rotating * (1.0 - HALF * across2)) + askew + (HALF * floor + askew) * pull2 * across2
    aside = floor * (1.0 - rotating * (1.0 - 0.5 * HALF * across2)) + askew * upright2
    # On its way along a curve the tool is accelerated across the hole.
    bx, by = (C[0, 0] - s.slow_axis[0]) / CURVE_TIME, (C[1, 0] - s.slow_axis[1]) / CURVE_TIME
    rate2 = bx * bx + by * by
    share = (p.axial_speed / p.gravity) ** 2 * min(1.0, CURVE_MOST**2 / max(rate2, 1e-12)) / max(across2, 1e-6)
    along += share * (bx * C[0, 0] + by * C[1, 0]) ** 2
    turned2 = (bx * C[1, 0] - by * C[0, 0]) ** 2 - across2 * across2 * _heading_rate(s)
    aside += share * max(turned2, 0.0)
    return along, aside


@compiled
def publish(p: Params, s: Record) -> None:
    """Sigma of inclination and of toolface by equation (9), rad, at most pi, until the covariance changes again."""
    tilt, aside = tilts(s)
    along, across = s.innovations.along.power, s.innovations.across.power
    floor_along, floor_aside = floors(p, s)
    s.sigma_inclination = min(math.pi, math.sqrt(max(along * (tilt + s.clipping.tilt), 0.0) + floor_along))
    sine2 = max(s.C[0, 0] ** 2 + s.C[1, 0] ** 2, 1e-6)
    s.sigma_toolface = min(math.pi, math.sqrt((max(across * aside, 0.0) + floor_aside) / sine2))
