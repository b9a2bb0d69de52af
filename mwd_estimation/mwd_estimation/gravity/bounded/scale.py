"""
Covariance scale of the bounded filter: its innovations against its covariance, along the hole and across it.

The noises have reserve, because motion is not white and gains need only their ratios. What disturbs the tilt is what
the updates put into it. Whitened innovations, summed over the time in which the variance of the tilt grows by twice
itself, have unit power if the covariance is right; if the disturbance is vibration faster than the filter, their sum is
the error itself, whatever the spectrum. Their power is the factor of the covariance. What no innovation shows is added:
calibration, gyros out of line with the accelerometers, travel along a curve.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded.clipping import FREQUENT
from mwd_estimation.gravity.bounded.measurement import hole_direction
from mwd_estimation.gravity.bounded.params import KernelParams
from mwd_estimation.gravity.bounded.state import TILT, Record
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

NEAR_LEAST, NEAR_MOST = 0.3, 12.0  # s, limits of the filter's own time
NEAR_AGE = 0.15  # the most of it for each time since the start, which had more to find out than what is steady
SCALE_TIME = 10.0  # s, memory of the power, and twice the filter's own time more
SCALE_YOUNG, SCALE_AGE = 2.0, 0.25  # s and share: after a start it is no longer than these allow
USUAL_TIME = 10.0  # s, memory of the usual innovation
DOWN_TIME, DOWN_FROM = 3.0, 0.3  # s; power of the vertical innovations that noises with reserve leave room for
RESERVE = 1.15  # variance published for each that the innovations show
ROTATING = 6.0  # rad/s, mean rate about the axis beyond which the filter cannot follow what is fixed in the tool
AXIAL = (
    0.4  # of the variance of calibration: bias and scale of the axial accelerometer, which rotation does not average
)
SQUARE = 0.35  # of it: accelerometers out of square
CURVE_TIME, CURVE_MOST = 5.0, 0.01  # s, memory of the axis; rad/s, rate of its turning that no hole asks for


@compiled
def follow_innovations(s: Record, turn: float, ix: float, iy: float, iz: float) -> None:
    """Follow the scale. turn: variance that one interval added to the tilt; whitened innovation in level axes."""
    P, T, found = s.P, s.sums.time, s.innovations
    dx, dy = hole_direction(s)
    # The tilt that an acceleration along the hole resembles is the one that inclination sees.
    tilt = P[TILT, TILT] * dy * dy - 2.0 * P[TILT, TILT + 1] * dx * dy + P[TILT + 1, TILT + 1] * dx * dx
    aside = P[TILT, TILT] + P[TILT + 1, TILT + 1] - tilt
    if s.clipping.sign == 0.0:
        near, memory = _times(s, 2.0 * tilt * T / turn)
        power = _power(found.near_along, T / near, ix, iy, dx, dy)
        found.along += T / memory * (power - found.along)
        near, memory = _times(s, 2.0 * aside * T / turn)
        power = _power(found.near_across, T / near, ix, iy, -dy, dx)
        found.across += T / memory * (power - found.across)
    found.near_down += T / DOWN_TIME * (iz - found.near_down)
    found.down += T / SCALE_TIME * (2.0 * DOWN_TIME / T * found.near_down**2 - found.down)
    for j in range(2):
        s.slow_axis[j] += T / CURVE_TIME * (s.C[j, 0] - s.slow_axis[j])


@compiled
def _times(s: Record, near: float) -> tuple[float, float]:
    """Return the filter's own time within its limits, and memory of the power, s."""
    near = max(min(near, NEAR_MOST, NEAR_LEAST + NEAR_AGE * s.settled), NEAR_LEAST)
    return near, min(SCALE_TIME + 2.0 * near, SCALE_YOUNG + SCALE_AGE * s.settled)


@compiled
def _power(mean: Array, share: float, ix: float, iy: float, dx: float, dy: float) -> float:
    """Follow the mean innovation, level axes; returns its power along d, 1 expected."""
    share = min(share, 1.0)
    mean[0] += share * (ix - mean[0])
    mean[1] += share * (iy - mean[1])
    along: float = dx * mean[0] + dy * mean[1]
    return 2.0 / share * along * along


@compiled
def factors(s: Record) -> tuple[float, float]:
    """Factors of the covariance along the hole and across it."""
    # Neither tilt nor gyros affect the vertical: what runs there is the accelerometer out of scale or out of
    # square, which the horizontal, where the tilt makes up for it, does not show. Shocks run there as well.
    excess = max(0.0, s.innovations.down - DOWN_FROM) if s.shocks < FREQUENT else 0.0
    return RESERVE * (s.innovations.along + excess), RESERVE * (s.innovations.across + excess)


@compiled
def floors(p: KernelParams, s: Record) -> tuple[float, float]:
    """Variances that no innovation shows, of the inclination and of the tilt across the hole, rad^2."""
    C, turn2 = s.C, s.turning**2
    across2 = C[0, 0] ** 2 + C[1, 0] ** 2
    upright2 = min(C[2, 0] ** 2, 1.0)
    rotating = turn2 / (turn2 + ROTATING**2)
    # Rotation averages out what is fixed across the axis. Gyros out of line see the tool rotate about another axis.
    floor, askew = p.calibration_sigma**2, rotating * p.misalignment_sigma**2
    # The pull of the circle that the sensor runs is across the axis; a share of it lies along the hole.
    pull2 = turn2 * turn2 * (s.lever[1] ** 2 + s.lever[2] ** 2) / p.gravity**2
    along = floor * (1.0 - rotating * (1.0 - AXIAL * across2)) + askew + (SQUARE * floor + askew) * pull2
    aside = (1.0 - rotating) * floor + askew * upright2
    # On its way along a curve the tool is accelerated across the hole.
    bx, by = (C[0, 0] - s.slow_axis[0]) / CURVE_TIME, (C[1, 0] - s.slow_axis[1]) / CURVE_TIME
    rate2 = bx * bx + by * by
    share = (p.axial_speed / p.gravity) ** 2 * min(1.0, CURVE_MOST**2 / max(rate2, 1e-12)) / max(across2, 1e-6)
    along += share * (bx * C[0, 0] + by * C[1, 0]) ** 2
    aside += share * (bx * C[1, 0] - by * C[0, 0]) ** 2
    return along, aside


@compiled
def publish(p: KernelParams, s: Record) -> None:
    """Sigma of inclination and of toolface, rad, at most pi, until the covariance changes again."""
    P = s.P
    dx, dy = hole_direction(s)
    tilt = P[TILT, TILT] * dy * dy - 2.0 * P[TILT, TILT + 1] * dx * dy + P[TILT + 1, TILT + 1] * dx * dx
    aside = P[TILT, TILT] + P[TILT + 1, TILT + 1] - tilt
    along, across = factors(s)
    floor_along, floor_aside = floors(p, s)
    s.sigma_inclination = min(math.pi, math.sqrt(max(along * (tilt + s.clipping.tilt), 0.0) + floor_along))
    sine2 = max(s.C[0, 0] ** 2 + s.C[1, 0] ** 2, 1e-6)
    s.sigma_toolface = min(math.pi, math.sqrt((max(across * aside, 0.0) + floor_aside) / sine2))
