"""
How the bounded filter goes over a silence: by the rates on either side of it, as far as those can be trusted.

Between two known rates the lost ones are taken for a random walk tied at both ends: the angle is that of the mean rate,
its variance q T^3 / 12, with q how much rates have changed lately. How the tool shook meanwhile nobody knows: velocity
and position begin anew, attitude and all that was learnt of the sensors stay. Derivation: ``docs/gravity_bounded.md``.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded import mechanisation as model
from mwd_estimation.gravity.bounded.mechanisation import BIAS, ERRORS, N_DOWN, N_VEL, POS, STEADY, SUMS, TILT, VEL
from mwd_estimation.gravity.bounded.motion import (
    AGE,
    DRIFT,
    EPOCH,
    LAST_W,
    PERIOD,
    SETTLED,
    STRONG,
    SWING_X,
    WALK_ACROSS,
    WALK_ALONG,
)
from mwd_estimation.gravity.bounded.params import K_BIAS_WALK, K_GRAVITY, K_GYRO_NOISE
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

_MEMORY = 5.0  # s, over which the changes of the rates are followed
_MORE = 4.0  # times that: rates that swing change by more over a silence than a walk does
_STEPS = 4.0  # times the usual step that are a silence
_LOST = 0.25  # rad^2, variance of the roll from which on it counts as lost


@compiled
def follow_changes(st: Array, dt: float, wx: float, wy: float, wz: float) -> None:
    """How fast the variance of the rates would grow, were they a random walk: along and across, (rad/s)^2/s."""
    if dt > 0.0:
        share = dt / (min(_MEMORY, st[AGE] + st[SETTLED]) + dt)
        along = wx - st[LAST_W]
        across = 0.5 * ((wy - st[LAST_W + 1]) ** 2 + (wz - st[LAST_W + 2]) ** 2)
        st[WALK_ALONG] += share * (along * along / dt - st[WALK_ALONG])
        st[WALK_ACROSS] += share * (across / dt - st[WALK_ACROSS])


@compiled
def stands_out(st: Array, dt: float) -> bool:
    """Whether a step of dt s is several times the usual one."""
    return bool(st[PERIOD] > 0.0 and dt > _STEPS * st[PERIOD])


@compiled
def bridge(
    k: Array, x: Array, P: Array, s: Array, st: Array, C: Array, T: float, wx: float, wy: float, wz: float
) -> bool:  # fmt: skip
    """
    Carry the attitude over a silence of T s, at whose end the rates are w, rad/s; False where the roll is lost.

    The sums must be empty. Inclination is carried either way.
    """
    mean_x, mean_y, mean_z = 0.5 * (wx + st[LAST_W]), 0.5 * (wy + st[LAST_W + 1]), 0.5 * (wz + st[LAST_W + 2])
    model.mechanise(x, s, C, -x[N_DOWN], T, mean_x, mean_y, mean_z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    model.propagate(P, s, STEADY)
    for j in range(SUMS):
        s[j] = 0.0
    cube = _MORE * T * T * T / 12.0
    # When a rate changed between two that differ is not known.
    square = T * T / 12.0
    turned_y, turned_z = wy - st[LAST_W + 1], wz - st[LAST_W + 2]
    across = st[WALK_ACROSS] * cube + (turned_y * turned_y + turned_z * turned_z) * square + k[K_GYRO_NOISE] ** 2 * T
    along = st[WALK_ALONG] * cube + (wx - st[LAST_W]) ** 2 * square
    P[TILT, TILT] += across + along * C[0, 0] * C[0, 0]
    P[TILT + 1, TILT + 1] += across + along * C[1, 0] * C[1, 0]
    P[TILT, TILT + 1] += along * C[0, 0] * C[1, 0]
    P[TILT + 1, TILT] = P[TILT, TILT + 1]
    speed = 0.25 + 0.25 * st[STRONG] / (k[K_GRAVITY] * k[K_GRAVITY])
    for j in range(3):
        x[N_VEL + j] = x[N_VEL + 3 + j] = 0.0
        for m in range(ERRORS):
            P[VEL + j, m] = P[m, VEL + j] = P[POS + j, m] = P[m, POS + j] = 0.0
        P[VEL + j, VEL + j], P[POS + j, POS + j] = speed, 0.01
        P[BIAS + j, BIAS + j] += k[K_BIAS_WALK] ** 2 * T
    for j in range(DRIFT, SWING_X):
        st[j] = 0.0
    st[EPOCH] += 1.0
    return bool(along < _LOST)
