# SPDX-License-Identifier: Apache-2.0
"""
Covariance scale of the bounded filter: compare its tilt corrections with their expected variance.

The noises of the filter are inflated, because motion is not white, and gains depend only on ratios of the noises. If
the covariance is right, the variance of a tilt correction is the decrease of the covariance in the update. The
corrections are low-passed with the time constant of the filter, which is the time in which noise adds the variance of
the tilt. Their power, weighted as in equation (10), is the factor on the covariance. An event that the model does not
contain moves the tilt before this average shows it; a sum of recent corrections that is too large for chance is
therefore added as a variance. A displacement that does not fit into the hole shows a wrong vertical. Errors that no
innovation shows are added too: calibration errors, a cone of the cross-axis gyros while the tool rotates, and travel
along a curve. Equation numbers are those of ``docs/methods/bounded_gravity_filter.md``.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded import accelerometer_errors, clipping, noise
from mwd_estimation.gravity.bounded.measurement import hole_direction
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import ASKEW, BIAS, SCALE, TILT, BoundedRecord, CovarianceScale
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

OWN_LEAST, OWN_MOST = 0.3, 20.0  # lower and upper limit of the time constant of the filter, s
# After a start, corrections are larger than in steady state: the upper limit of the time constant grows from OWN_LEAST
# by this share of the time since the start.
OWN_AGE = 0.25
# Smallest expected variance of a correction, as a share of the variance that an interval adds to the tilt.
LEAST_CORRECTION = 0.3
# Averaging time of the power: SCALE_TIME, s, plus SCALE_OWN times the time constant of the filter.
SCALE_TIME, SCALE_OWN = 4.0, 3.0
# After a start the averaging time is at most SCALE_YOUNG plus the square of (time since the start / SCALE_SETTLED), s.
# Thus the corrections of the first ten seconds, which find the sensor errors, lose their weight, but later ones keep
# it. The power must average several time constants of the filter: with only two, the reciprocal of the scale, and with
# it the ratio of error to sigma, has no finite mean.
SCALE_YOUNG, SCALE_SETTLED = 1.0, 12.0
# Share of the mean square force that may be in phase with the torsion: vibration along one axis with unknown phase.
RECTIFIED = 0.5
# Smallest ratio of the squared sum of recent corrections to its scaled variance that is not chance (2 sigma).
CHANCE = 4.0
# Largest rms displacement of a tool across its hole, m: the radial clearance of a slim string in a wide hole.
CLEARANCE = 0.1
# A slow motion with a displacement of 1 m after the three high-passes has an acceleration of at least this many m/s^2:
# a sine of frequency u / (2 pi SWING_TIME) has (1 + u^2)^1.5 / (u SWING_TIME^2), least at u^2 = 1/2.
LEAST_PULL = 1.5 * math.sqrt(3.0) / noise.SWING_TIME**2
BAND = 4.0  # weight of the middle of the filter's band, equations (8) and (10)
USUAL_TIME = 10.0  # averaging time of the usual innovation, s
ROTATING = 1.5  # mean rate about the axis at which errors fixed in the tool have half of their full weight, rad/s
BIAS_SHARE = 0.4  # sigma of gyro bias and misalignment in the tool's settings over the filter's sigma (inflated by 2.5)
LEAST_PRIOR = 1e-18  # smallest prior variance, for sensors whose settings state no error
CURVE_TIME, CURVE_MOST = 5.0, 0.01  # averaging time of the axis, s; largest rate at which a hole turns the tool, rad/s


@compiled
def tilts(s: BoundedRecord) -> tuple[float, float]:
    """Return the variances of the tilt that changes inclination and of the tilt that changes toolface, rad^2."""
    return _split(s, s.P)


@compiled
def _split(s: BoundedRecord, P: Array) -> tuple[float, float]:
    """Return what `tilts` returns, from a covariance P whose elements TILT and TILT + 1 are the tilts."""
    dx, dy = hole_direction(s)
    # The tilt that changes inclination cannot be distinguished from an acceleration along the hole.
    along = P[TILT, TILT] * dy * dy - 2.0 * P[TILT, TILT + 1] * dx * dy + P[TILT + 1, TILT + 1] * dx * dx
    return along, P[TILT, TILT] + P[TILT + 1, TILT + 1] - along


@compiled
def follow_corrections(s: BoundedRecord, turn: float, along: float, across: float) -> None:
    """
    Update the covariance scales along and across the hole with the tilt corrections of one update.

    along, across: tilt variances before the measurements, rad^2; turn: variance that the interval added to each, rad^2.
    """
    found, unit = s.innovations, 1.0 / turn
    dx, dy = hole_direction(s)
    tilt, aside = tilts(s)
    if s.meaning.sampled:
        # The measurements reduce an earlier error by the same share as the variance.
        kept = (tilt + aside) / max(along + across, 1e-18)
        for j in range(2):
            for m in range(2):
                s.motion.rocked[j, m] *= kept * kept
    if s.clipping.sign == 0.0:
        _follow(s, found.along, max(along - tilt, LEAST_CORRECTION * turn), tilt * unit, dy, -dx)
        _follow(s, found.across, max(across - aside, LEAST_CORRECTION * turn), aside * unit, dx, dy)
    # The noise of aliased vibration is not inflated, so the scale is at least its share, `noise.whole`. Otherwise small
    # corrections during this noise would lower the scale for the time after the noise.
    whole = noise.whole(s)
    found.along.power, found.across.power = max(found.along.power, whole), max(found.across.power, whole)
    for j in range(2):
        s.slow_axis[j] += s.sums.time / CURVE_TIME * (s.C[j, 0] - s.slow_axis[j])


@compiled
def _follow(s: BoundedRecord, found: CovarianceScale, expected: float, updates: float, nx: float, ny: float) -> None:
    """
    Update the power of the corrections about the level axis (nx, ny), equation (8), and their recent sum, eq. (20).

    expected: expected variance of a correction, rad^2; updates: time constant of the filter, in updates.
    """
    T = s.sums.time
    own = max(min(updates * T, OWN_MOST, OWN_LEAST + OWN_AGE * s.settled), OWN_LEAST)
    length, unit = max(own / T, 1.0), 1.0 / math.sqrt(expected)
    share = 1.0 / length
    low = found.low
    for j in range(2):
        found.moved[j] += s.correction[TILT + j] - share * found.moved[j]
        value = s.correction[TILT + j] * unit
        for m in range(3):
            low[m, j] += share * (value - low[m, j])
            value = low[m, j]
    mean = nx * low[0, 0] + ny * low[0, 1]
    band = nx * (low[1, 0] - low[2, 0]) + ny * (low[1, 1] - low[2, 1])
    power = (mean * mean + BAND * band * band) * length
    memory = min(SCALE_TIME + SCALE_OWN * own, SCALE_YOUNG + (s.settled / SCALE_SETTLED) ** 2)
    found.power += T / memory * (power - found.power)
    found.expected += expected - share * (2.0 - share) * found.expected
    square = (nx * found.moved[0] + ny * found.moved[1]) ** 2
    found.event = max(square - CHANCE * found.power * found.expected, (1.0 - share) * found.event)


@compiled
def _cone(p: BoundedParams, s: BoundedRecord, rotating: float) -> float:
    """
    Return the variance of the axis about which the tool seems to rotate, mean of y and z, rad^2.

    rotating: weight of errors fixed in the tool, 0 (at rest) to 1. With misalignment or bias of the cross-axis gyros,
    the measured axis of rotation is wrong. At constant speed no innovation shows most of this error. The part of P that
    still comes from the error at switch-on is scaled to the tool's sigma; the part from a step of the bias, whose prior
    is not inflated, counts fully. The remaining part of P is noise of the estimate and is multiplied by the scale of
    the inclination.
    """
    P, total, slow = s.P, 0.0, rotating / math.copysign(max(s.turning, 1e-3), s.last_w[0])
    bias2 = max(p.bias_sigma**2, LEAST_PRIOR)
    # Inverses of the prior variances.
    scale, askew = 1.0 / max(p.scale_sigma**2, LEAST_PRIOR), 1.0 / max(p.misalignment_sigma**2, LEAST_PRIOR)
    x, y, z = 1.0 / (bias2 + s.stepped[0]), 1.0 / (bias2 + s.stepped[1]), 1.0 / (bias2 + s.stepped[2])
    for j in range(2):
        b, k = BIAS + 1 + j, ASKEW + j
        variance = P[k, k] + slow * (P[b, b] * slow + 2.0 * P[b, k])
        left = scale * (P[k, SCALE] + slow * P[b, SCALE]) ** 2
        left += x * (P[k, BIAS] + slow * P[b, BIAS]) ** 2
        left += y * (P[k, BIAS + 1] + slow * P[b, BIAS + 1]) ** 2 + z * (P[k, BIAS + 2] + slow * P[b, BIAS + 2]) ** 2
        for m in range(2):
            left += askew * (P[k, ASKEW + m] + slow * P[b, ASKEW + m]) ** 2
        left = min(left, variance)
        share = (BIAS_SHARE**2 * bias2 + s.stepped[1 + j]) * (y if j == 0 else z)
        total += 0.5 * (share * left + s.innovations.along.power * (variance - left))
    return total


@compiled
def _heading_rate(s: BoundedRecord) -> float:
    """Return the variance of the rate about the vertical from the gyro bias, (rad/s)^2."""
    total = 0.0
    for j in range(3):
        for m in range(3):
            total += s.C[2, j] * s.P[BIAS + j, BIAS + m] * s.C[2, m]
    return BIAS_SHARE**2 * total


@compiled
def floors(p: BoundedParams, s: BoundedRecord) -> tuple[float, float]:
    """
    Return the variances of inclination and of tilt across the hole due to errors that cause no innovation, rad^2.

    The variances are those of equation (11).
    """
    C, turn2 = s.C, s.turning**2
    across2 = C[0, 0] ** 2 + C[1, 0] ** 2
    upright2 = min(C[2, 0] ** 2, 1.0)
    rotating = turn2 / (turn2 + ROTATING**2)
    along, aside = accelerometer_errors.variances(p, s, *hole_direction(s))
    askew = rotating * _cone(p, s, rotating)
    # The centripetal force of the sensor's circle is across the axis. If the axis of rotation is wrong, part of this
    # force is along the axis, where rotation does not average it out; it tilts the inclination in proportion to its
    # sine.
    pull2 = turn2 * turn2 * (s.lever[0] ** 2 + s.lever[1] ** 2) / p.gravity**2
    along += askew * (1.0 + pull2 * across2)
    aside += askew * upright2
    # A tool that moves along a curved hole is accelerated across the hole.
    bx, by = (C[0, 0] - s.slow_axis[0]) / CURVE_TIME, (C[1, 0] - s.slow_axis[1]) / CURVE_TIME
    rate2 = bx * bx + by * by
    share = (p.axial_speed / p.gravity) ** 2 * min(1.0, CURVE_MOST**2 / max(rate2, 1e-12)) / max(across2, 1e-6)
    along += share * (bx * C[0, 0] + by * C[1, 0]) ** 2
    turned2 = (bx * C[1, 0] - by * C[0, 0]) ** 2 - across2 * across2 * _heading_rate(s)
    aside += share * max(turned2, 0.0)
    outside = _outside(p, s)
    # Integrated samples can only have a wrong roll. Point samples can also show a false force, in any direction.
    return along + outside if s.meaning.sampled else along, aside + outside


@compiled
def _outside(p: BoundedParams, s: BoundedRecord) -> float:
    """
    Return the variance of the tilt error that follows from a displacement larger than the hole allows, rad^2.

    Equation (21). A tool cannot move across its hole by more than its clearance. If the estimated displacement is
    larger and white force (6) does not explain it, gravity was rotated by a wrong roll, or point samples aliased a
    force.
    """
    beyond = max(s.motion.across - s.motion.white - CLEARANCE**2, 0.0)
    return beyond * (LEAST_PULL / p.gravity) ** 2


@compiled
def _doubt(p: BoundedParams, s: BoundedRecord) -> tuple[float, float]:
    """
    Return the variances of inclination and of tilt across the hole from events that may have happened, rad^2.

    Jumps that are possible but not certain have the covariance `BoundedRecord.doubt`. If the samples are points with
    the probability w, and points change the tilt by e, the variance is w (1 - w) e^2. If they are points for certain,
    torsion may be aliased: the fast part of the roll may be wrong, and it turns vibration of the same frequency into a
    constant level force, equation (19).
    """
    dx, dy = hole_direction(s)
    odds = math.exp(min(s.meaning.odds, 0.0))
    share = odds / (1.0 + odds) ** 2
    ex, ey = s.meaning.effect[TILT, 0], s.meaning.effect[TILT + 1, 0]
    along, across = _split(s, s.doubt)
    rocked, rolled = _split(s, s.motion.rocked)
    along += share * (ex * dy - ey * dx) ** 2
    across += share * (ex * dx + ey * dy) ** 2
    rectified = RECTIFIED * s.motion.ripple * s.power / p.gravity**2
    roll = s.motion.ripple * (s.C[0, 0] ** 2 + s.C[1, 0] ** 2)
    return along + rectified + rocked, across + rectified + roll + rolled


@compiled
def publish(p: BoundedParams, s: BoundedRecord) -> None:
    """Set the sigmas of inclination and toolface, equation (9), rad, at most pi; valid until the next update."""
    tilt, aside = tilts(s)
    along, across = s.innovations.along, s.innovations.across
    floor_along, floor_aside = floors(p, s)
    doubt_along, doubt_aside = _doubt(p, s)
    floor_along, floor_aside = floor_along + doubt_along + along.event, floor_aside + doubt_aside + across.event
    s.sigma_inclination = min(math.pi, math.sqrt(max(along.power * (tilt + s.clipping.tilt), 0.0) + floor_along))
    sine2 = max(s.C[0, 0] ** 2 + s.C[1, 0] ** 2, 1e-6)
    s.sigma_toolface = min(math.pi, math.sqrt((max(clipping.roll_scale(s) * aside, 0.0) + floor_aside) / sine2))
    if s.clipping.lost:
        s.sigma_toolface = math.pi
