# SPDX-License-Identifier: Apache-2.0
"""
Bridge data gaps of the bounded filter with the rates before and after the gap, if the gap is not too long.

The lost rates are modelled as a random walk between the known rates at both ends. The rotation is then the mean of
these rates times T, with the variance q T^3 / 12, equation (7) of ``docs/methods/bounded_gravity_filter.md``; q is the
recent growth rate of the variance of the rates. Vibration during the gap is unknown, so velocity and position restart;
attitude and the errors of the sensors are kept.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded import alignment, clipping, mechanisation
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import BIAS, STEADY, TILT, BoundedRecord
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

GAP_NS = 250_000_000  # longest step that is not a gap, ns
STANDS_OUT = 4.0  # a step longer than this multiple of the usual step, and than half of GAP_NS, is a gap too
MORE = 4.0  # factor on the random walk: oscillating rates change more over a gap than a random walk
CLOCK_SET = 0.005  # assumed probability that a long step comes from a clock that was set, so that no time has passed
BACKWARD = 3  # number of samples in a row with earlier stamps after which the clock was set, as `time_jumps.CONFIRMED`


@compiled
def stands_out(s: BoundedRecord, dt: float) -> bool:
    """Return whether a step of dt s is a gap although it is shorter than `GAP_NS`."""
    return bool(2e9 * dt > GAP_NS and s.period > 0.0 and dt > STANDS_OUT * s.period)


@compiled
def widen_roll(s: BoundedRecord, variance: float) -> None:
    """Add a variance, rad^2, to the roll; if the variance is large, later roll corrections count as large angles."""
    s.clipping.seen |= variance > clipping.SMALL_ROLL
    for j in range(2):
        for m in range(2):
            s.P[TILT + j, TILT + m] += variance * (s.C[j, 0] * s.C[m, 0])


@compiled
def bridge(p: BoundedParams, s: BoundedRecord, T: float, w: Array) -> bool:
    """
    Propagate the attitude over a gap of T, s; return False if the roll is lost.

    w: rates after the gap, rad/s. The sums must be empty. The inclination is propagated in either case.
    """
    P = s.P
    mean = 0.5 * (w + s.last_w)
    # Propagate by the mean rate, without a force.
    mechanisation.mechanise(p, s, T, mean, mean * 0.0)
    s.sums.force[0] = s.sums.force[1] = s.sums.force[2] = 0.0
    mechanisation.propagate(s, STEADY)
    mechanisation.clear_sums(s.sums)
    cube, square = MORE * T * T * T / 12.0, T * T / 12.0
    # If the rates before and after the gap differ, the time of the change is unknown: add variance.
    turned = (w[1] - s.last_w[1]) ** 2 + (w[2] - s.last_w[2]) ** 2
    across = s.rate_walk[1] * cube + turned * square + p.gyro_noise**2 * T
    along = s.rate_walk[0] * cube + (w[0] - s.last_w[0]) ** 2 * square + CLOCK_SET * (mean[0] * T) ** 2
    for j in range(2):
        P[TILT + j, TILT + j] += across
    widen_roll(s, along)
    alignment.forget_motion(s)
    alignment.unknown_motion(s, s.power / p.gravity**2)
    for j in range(3):
        P[BIAS + j, BIAS + j] += p.bias_walk**2 * T
    s.epoch += 1
    return bool(along < clipping.LOST_ROLL)
