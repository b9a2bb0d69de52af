# SPDX-License-Identifier: Apache-2.0
"""
Noise of the bounded filter: how the tool moves decides how firmly its displacement is known to be none.

The displacement behind a fixed high-pass (`SWING_TIME`, three times), along the hole and across it, is the vibration of
the tool: it sets the white noise of the displacement and its random walk, which is a white velocity. Force that
is white down to low frequencies is bounded by no velocity: it is noise of the velocity. It shows alike in the
difference of neighbouring samples, across the hole and in the vertical, which tilt does not reach to first order.
"""

from __future__ import annotations

import math

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded.params import Params
from mwd_estimation.gravity.bounded.state import BIAS, DOWN, POS, SLOPE, TILT, VEL, Record
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled

SWING_TIME = 0.5  # s, time constant of the three high-passes
SWING_MEMORY = 2.1  # s, over which the displacement is averaged
START_DISPLACEMENT = 0.1  # m, displacement assumed at a start
ROTATING = 3.0  # rad/s, mean rate about the axis from which the sensor circles with its lever arm
WALK_PER_DISPLACEMENT = 2.7  # random walk of the point that stays for each displacement seen, 1/sqrt(s)
FOLDED_LEAST = 0.6  # (m/s^2)^2 s, density of the force from which on it may be vibration that point samples fold down
FOLDED_MEMORY, FOLDED_FIRST, FOLDED_AGE = 20.0, 2.0, 0.5  # s, over which it is judged whether it is; less at a start
FOLDED_YOUNG = 1.0  # s since a start, in which the high-passes have not settled yet
FREQUENT = 6.0  # shocks in 10 s (`clipping.SHOCK_MEMORY`) from which on white force is theirs, not folded vibration
WHITE_SHARE = 0.16  # of the density that the displacement shows, in the noise: not all of it is white
ROTARY_NOISE = 0.00005  # gyro noise for each rate about the axis, whose scale is a state
CROSS_TURN = 5.0  # rad/s, rate lost while a cross-axis gyro clips
LONG_STEP = 1.6  # times the usual step of the stamps: samples are missing
DOWN_WALK = 1e-4  # m/s^2/sqrt(s): what is learnt of the vertical force ages
CLIP_JERK = 200.0  # rad/s^2/sqrt(s), random walk of the slope of a clipped rate
RATE_MEMORY = 5.0  # s, over which changes of the rates are averaged
TURNING_MEMORY = 10.0  # s
FORCE_MEMORY = 3.0  # s, over which the force is averaged that shows an attitude lost
ALIASED_SHARE, ALIASED_LEAST, ALIASED_AFTER = 0.3, 0.002, 3.0  # of the displacement; (m/s^2)^2 s; s since a start


@compiled
def follow_rates(p: Params, s: Record, dt: float, w: Vector, f: Vector, flag: bool) -> None:
    """
    Noise of the attitude from errors in proportion to the rates, from clipping and from samples that are missing.

    flag: the unit says that a gyro across the axis was beyond its range within this sample.
    """
    sums, motion = s.sums, s.motion
    sums.turn += (p.rate_noise**2 * (w[1] * w[1] + w[2] * w[2]) + ROTARY_NOISE**2 * w[0] * w[0]) * dt
    if flag or max(abs(w[1]), abs(w[2])) >= track.AT_RANGE * p.gyro_range:
        sums.turn += (CROSS_TURN * dt) ** 2
    df2 = (f[0] - s.last_f[0]) ** 2 + (f[1] - s.last_f[1]) ** 2 + (f[2] - s.last_f[2]) ** 2
    if dt > 0.0:
        motion.rough += dt / (min(SWING_MEMORY, s.settled) + dt) * (df2 * dt / 6.0 - motion.rough)
    # How rates and forces went on while samples are missing is known roughly.
    if dt > LONG_STEP * s.period and s.period > 0.0:
        rate = abs(w[0] - s.last_w[0]) + abs(w[1] - s.last_w[1]) + abs(w[2] - s.last_w[2]) + 0.05
        sums.turn += (0.5 * rate * dt) ** 2
        sums.jump += s.power * dt * dt / 3.0
    s.period += (0.05 if s.period > 0.0 else 1.0) * (dt - s.period)


@compiled
def follow_motion(s: Record, w: Array) -> None:
    """Follow displacement, drift, the axis and the rates w over one interval."""
    T, motion = s.sums.time, s.motion
    keep = math.exp(-T / SWING_TIME)
    along, total = 0.0, 0.0
    share = T / (min(FORCE_MEMORY, motion.force_time) + T)
    motion.force_time += T
    for j in range(3):
        a = s.sums.velocity[j] / T
        motion.force[j] += share * (s.sums.force[j] / T - motion.force[j])
        motion.slow_acceleration[j] += (1.0 - keep) * (a - motion.slow_acceleration[j])
        slow = motion.slow_acceleration[j]
        moved = motion.velocity[j] * T + s.sums.position[j] - 0.5 * slow * T * T
        motion.position[j] = keep * (motion.position[j] + moved)
        motion.velocity[j] = keep * (motion.velocity[j] + s.sums.velocity[j] - slow * T)
        # The lever arm's circle, seen through the same three high-passes, is no vibration.
        arm = s.C[j, 1] * s.lever[0] + s.C[j, 2] * s.lever[1]
        for n in range(3):
            motion.arm[j, n] += (1.0 - keep) * (arm - motion.arm[j, n])
            arm -= motion.arm[j, n]
        moved = motion.position[j] - (arm if s.turning > ROTATING else 0.0)
        total += moved * moved
        along += s.C[j, 0] * moved
    along *= along
    across = 0.5 * max(total - along, 0.0)
    share = T / (min(FOLDED_MEMORY, FOLDED_FIRST + FOLDED_AGE * s.settled) + T)
    motion.folded_aside += share * (across - motion.folded_aside)
    motion.folded += share * (explained(s) - motion.folded)
    if s.clipping.sign == 0.0:
        share = T / (SWING_MEMORY + T)
        motion.along += share * (along - motion.along)
        motion.across += share * (across - motion.across)
    if s.settled < FOLDED_YOUNG:
        # Until then it is taken for white.
        motion.folded = motion.folded_aside = explained(s)
    # The tool moves along its hole, white force in all directions.
    motion.white = min(motion.across, explained(s))
    s.turning += T / (TURNING_MEMORY + T) * (abs(w[0]) - s.turning)
    share = T / (min(RATE_MEMORY, s.age + s.settled) + T)
    s.rate_walk[0] += share * ((w[0] - s.tick_w[0]) ** 2 / T - s.rate_walk[0])
    across = 0.5 * ((w[1] - s.tick_w[1]) ** 2 + (w[2] - s.tick_w[2]) ** 2)
    s.rate_walk[1] += share * (across / T - s.rate_walk[1])
    for j in range(3):
        s.tick_w[j] = w[j]


@compiled
def explained(s: Record) -> float:
    """Displacement, m^2, that forces would leave that are as white as neighbouring samples are, equation (6)."""
    # White force of density one leaves a displacement of variance time^3 / 16 behind the three high-passes.
    return SWING_TIME**3 / 16.0 * s.motion.rough


@compiled
def shaken_by_shocks(s: Record) -> bool:
    """Whether shocks are frequent: the velocity that each hides looks like vibration that point samples fold down."""
    return bool(s.shocks > FREQUENT)


@compiled
def whole(s: Record) -> float:
    """
    Return the share, 0 to 1, to which vibration that point samples fold down counts as dense as neighbours say.

    It counts where shocks are rare and the displacement of the last 20 s is most of what neighbouring samples explain.
    A density that followed the displacement within seconds would be too small by chance at times, and the gain too
    large.
    """
    if s.motion.rough < FOLDED_LEAST or shaken_by_shocks(s):
        return 0.0
    return min(max(3.0 * s.motion.folded_aside / max(s.motion.folded, 1e-12) - 1.0, 0.0), 1.0)


@compiled
def aliased(s: Record) -> bool:
    """Whether vibration folds down into point samples: white force explains the displacement, and is not shocks."""
    white = s.motion.white > ALIASED_SHARE * explained(s) and s.motion.rough > ALIASED_LEAST
    return bool(white and s.settled > ALIASED_AFTER and not shaken_by_shocks(s))


@compiled
def _displacement(s: Record) -> tuple[float, float]:
    motion = s.motion
    along, across = max(motion.along - motion.white, 0.0), max(motion.across - motion.white, 0.0)
    if s.clipping.sign != 0.0:
        # With a roll that is uncertain the two cannot be separated.
        along = across = max(along, across)
    return along, across


@compiled
def add_noise(p: Params, s: Record) -> float:
    """Noise of one interval, equation (5); returns the variance that is added to the tilt, rad^2."""
    P, T = s.P, s.sums.time
    turn = p.gyro_noise**2 * T + s.sums.turn
    density = max(WHITE_SHARE * s.motion.white, whole(s) * explained(s)) * 16.0 / SWING_TIME**3
    force = (p.accel_noise**2 + density) * T + s.sums.jump
    along, across = _displacement(s)
    along = (p.walk**2 + WALK_PER_DISPLACEMENT**2 * along) * T
    across = (p.walk**2 + WALK_PER_DISPLACEMENT**2 * across) * T
    for j in range(2):
        P[TILT + j, TILT + j] += turn
    for j in range(3):
        P[VEL + j, VEL + j] += force
        P[BIAS + j, BIAS + j] += p.bias_walk**2 * T
        P[POS + j, POS + j] += across
        for m in range(3):
            P[POS + j, POS + m] += (along - across) * s.C[j, 0] * s.C[m, 0]
    P[DOWN, DOWN] += DOWN_WALK**2 * T
    if s.clipping.sign != 0.0:
        P[SLOPE, SLOPE] += CLIP_JERK**2 * T
    return turn
