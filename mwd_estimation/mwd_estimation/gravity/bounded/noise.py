# SPDX-License-Identifier: Apache-2.0
"""
Noise of the bounded filter: the motion of the tool determines the noise of the measured zero displacement.

The displacement after three high-passes (`SWING_TIME`), along and across the hole, measures the vibration. It sets the
white noise and the random walk of the displacement; the random walk is a white velocity. Force that is white down to
low frequencies does not have a bounded velocity, so it becomes noise of the velocity. Such force has the same spectral
density in differences of neighbouring samples and in the displacement across the hole. Equation numbers are those of
``docs/methods/bounded_gravity_filter.md``.
"""

from __future__ import annotations

import math

from mwd_estimation.core import track
from mwd_estimation.gravity.bounded import clipping
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import BIAS, DOWN, POS, SLOPE, TILT, VEL, BoundedRecord
from mwd_sensors.core.arrays import Array, Vector
from mwd_sensors.core.compiled import compiled

SWING_TIME = 0.5  # time constant of the three high-passes, s
SWING_MEMORY = 2.1  # averaging time of the displacement, s
RIPPLE_TIME = 0.03  # time constant of the three high-passes of the roll, s: stick-slip and rotation do not pass
START_DISPLACEMENT = 0.1  # displacement assumed at a start, m
# Averaging time of the fast part of the rates, s; the slow part lies between the two time constants SLOW, s.
ROCKING_MEMORY, SLOW = 10.0, (0.1, 2.0)
# Bound of the squared peak of aliased rocking over the mean square of the fast part: a factor of 2 for a sine, and a
# further factor of 2 because the fast part becomes smaller while the vibration approaches the sampling rate.
ROCKING_PEAK = 4.0
# Correlation time of aliased rocking, s: a sweep of 1 Hz/s passes the sampling rate within a second.
ROCKING_TIME = 0.25
# Variance of the part between the two time constants SLOW of a white signal of spectral density 1, 1/s.
SLOW_BAND = 0.5 / SLOW[0] + 0.5 / SLOW[1] - 2.0 / (SLOW[0] + SLOW[1])
WHITE_CHANCE = 9.0  # ratio of the square of a slow force to its variance by white force up to which it is chance
# Share of the largest aliased rocking and of the largest aliased force that is added to the noise of the filter.
# Without it, the filter corrects as slowly as with quiet samples. From 0.1 to 0.25 the errors are nearly equal.
ALIASED_NOISE = 0.15
ROTATING = 3.0  # mean rate about the axis above which the circular motion of the sensor is subtracted, rad/s
# Ratio of the random walk of the resting point (`measurement`) to the observed displacement, 1/sqrt(s).
WALK_PER_DISPLACEMENT = 2.7
FOLDED_LEAST = 0.6  # (m/s^2)^2 s, spectral density of the force below which vibration does not count as aliased
# Averaging time of the displacement that shows aliasing: FOLDED_MEMORY, s, but after a start at most FOLDED_FIRST, s,
# plus FOLDED_AGE times the time since the start.
FOLDED_MEMORY, FOLDED_FIRST, FOLDED_AGE = 20.0, 2.0, 0.5
FOLDED_YOUNG = 1.0  # time after a start in which the high-passes have not settled, s
FREQUENT = 6.0  # largest number of shocks (in `clipping.SHOCK_MEMORY`) at which white force may come from aliasing
WHITE_SHARE = 0.16  # share of the density from the displacement that is used as noise, because not all of it is white
ROTARY_NOISE = 0.00005  # gyro noise in proportion to the rate about the axis, 1/sqrt(Hz)
CROSS_TURN = 5.0  # 1 sigma of the rate that is lost while a cross-axis gyro clips, rad/s
LONG_STEP = 1.6  # if a step of the stamps is above this multiple of the usual step, samples are missing
DOWN_WALK = 1e-4  # m/s^2/sqrt(s), random walk of the vertical force error
CLIP_JERK = 200.0  # rad/s^2/sqrt(s), random walk of the slope of a clipped rate
# A wrong roll of sigma a moves gravity by a second-order part of the variance 3/4 g^2 a^4 (the variance of 1 - cos),
# which lasts until the roll is corrected, about 0.3 s.
CURVED = 0.75 * 0.3
RATE_MEMORY = 5.0  # averaging time of the squared changes of the rates between updates, s
TURNING_MEMORY = 10.0  # averaging time of the rate about the axis, s
FORCE_MEMORY = 3.0  # averaging time of the force that shows a lost attitude, s
# Smallest values at which vibration is reported as aliased: share of the displacement that white force explains;
# density of the force, (m/s^2)^2 s; and time since a start, s.
ALIASED_SHARE, ALIASED_LEAST, ALIASED_AFTER = 0.3, 0.002, 3.0


@compiled
def follow_rates(p: BoundedParams, s: BoundedRecord, dt: float, w: Vector, f: Vector, flag: bool) -> None:
    """
    Add attitude noise from errors proportional to the rates, from clipping and from missing samples.

    dt: step, s; w, f: rate, rad/s, and force, m/s^2; flag: whether the unit reports clipping of a cross-axis gyro.
    """
    sums, motion, rotary = s.sums, s.motion, w[0] + s.missing
    sums.turn += (p.rate_noise**2 * (w[1] * w[1] + w[2] * w[2]) + ROTARY_NOISE**2 * rotary * rotary) * dt
    if flag or max(abs(w[1]), abs(w[2])) >= track.AT_RANGE * p.gyro_range:
        sums.turn += (CROSS_TURN * dt) ** 2
    df2 = (f[0] - s.last_f[0]) ** 2 + (f[1] - s.last_f[1]) ** 2 + (f[2] - s.last_f[2]) ** 2
    if s.meaning.sampled:
        _follow_ripple(s, dt, w[0])
        _follow_rocking(p, s, dt, w)
        motion.fast_force += dt / (min(ROCKING_MEMORY, s.settled) + dt) * (0.5 * df2 - motion.fast_force)
    if dt > 0.0:
        motion.rough += dt / (min(SWING_MEMORY, s.settled) + dt) * (df2 * dt / 6.0 - motion.rough)
    # If samples are missing, add noise for the unknown rates and forces in between.
    if dt > LONG_STEP * s.period and s.period > 0.0:
        rate = abs(w[0] - s.last_w[0]) + abs(w[1] - s.last_w[1]) + abs(w[2] - s.last_w[2]) + 0.05
        sums.turn += (0.5 * rate * dt) ** 2
        sums.jump += s.power * dt * dt / 3.0
    s.period += (0.05 if s.period > 0.0 else 1.0) * (dt - s.period)


@compiled
def _follow_ripple(s: BoundedRecord, dt: float, rate: float) -> None:
    """
    Update the fast part of the roll, equation (19); dt: step, s; rate: x rate, rad/s, of a point sample.

    Torsion faster than half the sampling rate appears at a lower frequency, and its integral is then a roll that the
    tool does not have. The sum of the rates, and not the integral by the trapezoid, is used: at half the sampling rate
    the trapezoid shows nothing, although the tool moves.
    """
    motion, moved = s.motion, rate * dt
    keep = RIPPLE_TIME / (RIPPLE_TIME + dt)
    for n in range(3):
        swing = keep * (motion.swing[n] + moved)
        moved = swing - motion.swing[n]
        motion.swing[n] = swing
    motion.ripple += dt / (min(SWING_MEMORY, s.settled) + dt) * (motion.swing[2] ** 2 - motion.ripple)


@compiled
def _follow_rocking(p: BoundedParams, s: BoundedRecord, dt: float, w: Vector) -> None:
    """
    Add the variance of slow rates that may be aliased rocking to `MotionAverages.rocked`, equation (23).

    Rocking near a multiple of the sampling rate appears as a slow rate of the size of the rocking. Before and after
    that, it appears as a fast rate. A share of the variance is noise of the filter, as `_false_force` is. dt: step, s;
    w: point sample of the rates, rad/s.
    """
    motion, C = s.motion, s.C
    keep, share = dt / (RIPPLE_TIME + dt), dt / (min(ROCKING_MEMORY, s.settled) + dt)
    noise = p.gyro_noise**2 / max(dt, 1e-4)
    for j in range(3):
        if s.settled == 0.0:
            motion.quick[j, 0] = motion.slow[j, 0] = motion.slow[j, 1] = w[j]
            motion.quick[j, 1] = motion.quick[j, 2] = motion.fast[j] = 0.0
        value = w[j]
        for n in range(3):
            motion.quick[j, n] += keep * (value - motion.quick[j, n])
            value -= motion.quick[j, n]
        motion.fast[j] += share * (value * value - motion.fast[j])
        for n in range(2):
            motion.slow[j, n] += dt / (SLOW[n] + dt) * (w[j] - motion.slow[j, n])
        most = ROCKING_PEAK * (motion.fast[j] - noise)
        if most > 0.0:
            square = (motion.slow[j, 0] - motion.slow[j, 1]) ** 2
            # A rate that is much larger than the rocking is real, except for a share of the size of the rocking.
            turn = 2.0 * ROCKING_TIME * dt * min(square, most * most / max(square, most))
            for a in range(2):
                for c in range(2):
                    motion.rocked[a, c] += turn * (C[a, j] * C[c, j])
                    s.P[TILT + a, TILT + c] += ALIASED_NOISE * turn * (C[a, j] * C[c, j])


@compiled
def follow_motion(s: BoundedRecord, w: Array) -> None:
    """Update the averages of force, displacement and rates with one update interval; w: latest rates, rad/s."""
    T, motion = s.sums.time, s.motion
    keep, rate = math.exp(-T / SWING_TIME), 1.0 / T
    along, total = 0.0, 0.0
    share = T / (min(FORCE_MEMORY, motion.force_time) + T)
    motion.force_time += T
    for j in range(3):
        a = rate * s.sums.velocity[j]
        if s.meaning.sampled:
            for n in range(2):
                motion.slow_force[j, n] += T / (SLOW[n] + T) * (a - motion.slow_force[j, n])
        motion.force[j] += share * (rate * s.sums.force[j] - motion.force[j])
        motion.slow_acceleration[j] += (1.0 - keep) * (a - motion.slow_acceleration[j])
        slow = motion.slow_acceleration[j]
        moved = motion.velocity[j] * T + s.sums.position[j] - 0.5 * slow * T * T
        motion.position[j] = keep * (motion.position[j] + moved)
        motion.velocity[j] = keep * (motion.velocity[j] + s.sums.velocity[j] - slow * T)
        # The circle on which rotation moves the sensor is not vibration: high-pass it in the same way, to subtract it.
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
        # Assume white force until the high-passes have settled.
        motion.folded = motion.folded_aside = explained(s)
    # The tool vibrates along and across its hole; white force is equal in all directions.
    motion.white = min(motion.across, explained(s))
    s.turning += T / (TURNING_MEMORY + T) * (abs(w[0] + s.missing) - s.turning)
    share = T / (min(RATE_MEMORY, s.age + s.settled) + T)
    s.rate_walk[0] += share * (rate * (w[0] - s.tick_w[0]) ** 2 - s.rate_walk[0])
    across = 0.5 * ((w[1] - s.tick_w[1]) ** 2 + (w[2] - s.tick_w[2]) ** 2)
    s.rate_walk[1] += share * (rate * across - s.rate_walk[1])
    for j in range(3):
        s.tick_w[j] = w[j]


@compiled
def explained(s: BoundedRecord) -> float:
    """Return the mean square displacement, m^2, that white force of density `rough` causes, eq. (6)."""
    # White force of density 1 gives a displacement variance of time^3 / 16 after the three high-passes.
    return SWING_TIME**3 / 16.0 * s.motion.rough


@compiled
def shaken_by_shocks(s: BoundedRecord) -> bool:
    """Return whether shocks are frequent; the velocity lost in clipped shocks looks like aliased vibration."""
    return bool(s.shocks > FREQUENT)


@compiled
def whole(s: BoundedRecord) -> float:
    """
    Return the share, 0 to 1, of the force density `MotionAverages.rough` that counts as aliased vibration.

    The share is above 0 if shocks are rare and the displacement of the last 20 s is a large part of the displacement
    that this density explains. With a shorter averaging time, the density would sometimes be too small by chance, and
    the gain of the filter too large.
    """
    if s.motion.rough < FOLDED_LEAST or shaken_by_shocks(s):
        return 0.0
    return min(max(3.0 * s.motion.folded_aside / max(s.motion.folded, 1e-12) - 1.0, 0.0), 1.0)


@compiled
def aliased(s: BoundedRecord) -> bool:
    """Return whether point sampling aliases vibration: white force, and not shocks, explains the displacement."""
    white = s.motion.white > ALIASED_SHARE * explained(s) and s.motion.rough > ALIASED_LEAST
    return bool(white and s.settled > ALIASED_AFTER and not shaken_by_shocks(s))


@compiled
def _displacement(s: BoundedRecord) -> tuple[float, float]:
    motion = s.motion
    along, across = max(motion.along - motion.white, 0.0), max(motion.across - motion.white, 0.0)
    if s.clipping.sign != 0.0:
        # While the roll is uncertain, displacements along and across the hole cannot be separated.
        along = across = max(along, across)
    return along, across


@compiled
def _false_force(s: BoundedRecord) -> float:
    """
    Return the spectral density, (m/s^2)^2 s, of the slow force that may be aliased vibration, equation (24).

    It is 0 for samples that are not points. The variance of a slow force that white force explains, 3 sigma, does not
    count.
    """
    motion, square = s.motion, -WHITE_CHANCE * 3.0 * SLOW_BAND * s.motion.rough
    for j in range(3):
        square += (motion.slow_force[j, 0] - motion.slow_force[j, 1]) ** 2
    most = ROCKING_PEAK * motion.fast_force
    if square <= 0.0 or most <= 0.0:
        return 0.0
    return ALIASED_NOISE * 2.0 * ROCKING_TIME * min(square, most * most / max(square, most))


@compiled
def add_noise(p: BoundedParams, s: BoundedRecord) -> float:
    """Add the noise of one interval, equation (5); return the variance added to the tilt, rad^2."""
    P, T = s.P, s.sums.time
    turn = p.gyro_noise**2 * T + s.sums.turn
    density = max(WHITE_SHARE * s.motion.white, whole(s) * explained(s)) * 16.0 / SWING_TIME**3
    density += CURVED * (p.gravity * clipping.large_tilt(s)) ** 2
    force = (p.accel_noise**2 + density + _false_force(s)) * T + s.sums.jump
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
            P[POS + j, POS + m] += (along - across) * (s.C[j, 0] * s.C[m, 0])
    P[DOWN, DOWN] += DOWN_WALK**2 * T
    if s.clipping.sign != 0.0:
        P[SLOPE, SLOPE] += CLIP_JERK**2 * T
    return turn
