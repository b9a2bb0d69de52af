# SPDX-License-Identifier: Apache-2.0
"""
How the bounded filter goes over a data gap: by the rates on either side of it, as far as those can be trusted.

Between two known rates the lost ones are taken for a random walk tied at both ends: the angle is that of the mean rate,
its variance q T^3 / 12, equation (7), with q how much rates have changed lately. How the tool vibrated meanwhile is not
known: velocity and position begin anew; attitude and all that was learnt of the sensors stay.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded import alignment, mechanisation
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import BIAS, STEADY, TILT, Record
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

GAP_NS = 250_000_000  # a step as long is a gap; so is half of it where it stands out
STANDS_OUT = 4.0  # times the usual step
MORE = 4.0  # times the random walk: oscillating rates change by more over a gap than a walk does
LOST_ROLL = 0.25  # rad^2, variance of the roll from which on it counts as lost


@compiled
def stands_out(s: Record, dt: float) -> bool:
    """Whether a step of dt s is a gap though it is shorter than `GAP_NS`."""
    return bool(2e9 * dt > GAP_NS and s.period > 0.0 and dt > STANDS_OUT * s.period)


@compiled
def bridge(p: Params, s: Record, T: float, w: Array) -> bool:
    """
    Carry the attitude over a gap of T s, at whose end the rates are w, rad/s; False where the roll is lost.

    The sums must be empty. Inclination is carried either way.
    """
    P, C = s.P, s.C
    mean = 0.5 * (w + s.last_w)
    # Down is known to the axes before the gap; without a force nothing else moves.
    mechanisation.mechanise(p, s, T, mean, mean * 0.0)
    s.sums.force[0] = s.sums.force[1] = s.sums.force[2] = 0.0
    mechanisation.propagate(P, s.sums, STEADY)
    mechanisation.clear_sums(s.sums)
    cube, square = MORE * T * T * T / 12.0, T * T / 12.0
    # When a rate changed between two that differ is not known.
    turned = (w[1] - s.last_w[1]) ** 2 + (w[2] - s.last_w[2]) ** 2
    across = s.rate_walk[1] * cube + turned * square + p.gyro_noise**2 * T
    along = s.rate_walk[0] * cube + (w[0] - s.last_w[0]) ** 2 * square
    for j in range(2):
        P[TILT + j, TILT + j] += across
        for m in range(2):
            P[TILT + j, TILT + m] += along * C[j, 0] * C[m, 0]
    alignment.forget_motion(s)
    alignment.unknown_motion(s, s.power / p.gravity**2)
    for j in range(3):
        P[BIAS + j, BIAS + j] += p.bias_walk**2 * T
    s.epoch += 1
    return bool(along < LOST_ROLL)
