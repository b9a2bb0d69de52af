# SPDX-License-Identifier: Apache-2.0
"""
Alignment of the bounded filter: first attitude from the mean force. Each start and restart of the filter aligns.

A restart keeps bias, scale and lever arm of the sensors. If only the roll was lost, it keeps the inclination too.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded import accelerometer_errors, clipping, mechanisation, noise
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import (
    BIAS,
    ERRORS,
    MISSING,
    POS,
    SCALE,
    TILT,
    VEL,
    BoundedRecord,
    forget_density,
)
from mwd_sensors.core.arrays import Vector
from mwd_sensors.core.compiled import compiled

START_TIME = 0.3  # time over which forces are averaged, s
CORRELATED = 0.05  # correlation time of the scatter of the force, s
START_SIGMA = 0.06  # smallest sigma of the first tilt, rad
START_SPEED = 0.5  # 1 sigma of the velocity at a start, m/s; its variance doubles for a force scatter of 1 g
START_PLACE = 0.1  # 1 sigma of the displacement at a start, m
KEPT_SIGMA = 0.05  # added to the sigma of an inclination that is kept from before a restart, rad
LOST_AFTER = 1.0  # time for which the mean force must contradict the attitude before the attitude counts as lost, s
LOST_FORCE2 = 25.0  # largest square of the mean non-gravity force at which the attitude is not lost, (m/s^2)^2
# 1/s, factor on the density of white force; the product is added to LOST_FORCE2, because the mean of white force is not
# exactly zero.
WHITE2 = 9.0
LIKE_GRAVITY = 0.5  # largest difference in length between gravity and a mean force that counts as gravity, m/s^2


@compiled
def begin(s: BoundedRecord) -> None:
    """Begin a new epoch: restart attitude, velocity and position, and keep the estimated sensor errors."""
    mechanisation.clear_sums(s.sums)
    accelerometer_errors.begin(s)
    for j in range(ERRORS):
        for m in range(ERRORS):
            if j < BIAS or m < BIAS or j >= MISSING or m >= MISSING:
                s.P[j, m] = 0.0
    s.q[0] = s.q[1] = s.q[2] = 0.0
    s.q[3] = 1.0
    mechanisation.set_matrix(s)
    clipping.clear(s)
    s.clipping.seen = False
    forget_motion(s)
    s.motion.along = s.motion.across = noise.START_DISPLACEMENT**2
    s.motion.white = s.motion.rough = 0.0
    s.motion.rocked[:] = 0.0
    for found in (s.innovations.along, s.innovations.across):
        found.low[:] = 0.0
        found.power = 1.0
        found.event = 0.0
    s.age = s.settled = s.mean_power = s.kept_tilt = 0.0
    for j in range(3):
        s.mean[j] = 0.0
    s.started = False
    s.epoch += 1


@compiled
def begin_roll(s: BoundedRecord) -> None:
    """Restart if only the roll is lost; keep the inclination, which the rates across the axis still give."""
    down, tilt = s.C[2, 0], clipping.split_tilt(s)
    begin(s)
    # The roll from the mean force may be wrong by a large angle.
    s.clipping.seen = True
    s.kept_down, s.kept_tilt = down, tilt


@compiled
def forget_motion(s: BoundedRecord) -> None:
    """Reset velocity, position and the averages derived from them, because the motion is unknown."""
    motion = s.motion
    forget_density(s)
    motion.force_time = motion.lost_time = 0.0
    for j in range(3):
        s.vel[j] = s.pos[j] = 0.0
        motion.force[j] = motion.slow_acceleration[j] = motion.velocity[j] = motion.position[j] = 0.0
        for m in range(3):
            motion.arm[j, m] = 0.0
        for m in range(2):
            motion.slow_force[j, m] = 0.0


@compiled
def unknown_motion(s: BoundedRecord, scatter: float) -> None:
    """Set the covariance of velocity and position after an alignment; scatter: variance of the force / gravity^2."""
    for j in range(3):
        for m in range(ERRORS):
            s.P[VEL + j, m] = s.P[m, VEL + j] = s.P[POS + j, m] = s.P[m, POS + j] = 0.0
        s.P[VEL + j, VEL + j] = START_SPEED**2 * (1.0 + scatter)
        s.P[POS + j, POS + j] = START_PLACE**2


@compiled
def average(p: BoundedParams, s: BoundedRecord, dt: float, f: Vector, clips: bool) -> bool:
    """
    Add a force, m/s^2, to the mean force of the alignment; return True when the first attitude is set.

    The gyro rotates the forces to common axes. dt: time since the last sample, s; clips: whether the x gyro clips; then
    the rotation is unknown, and the mean restarts.
    """
    step, C, turn2 = max(dt, 1e-3), s.C, s.last_w[0] ** 2
    if clips:
        s.age = s.mean_power = s.mean[0] = s.mean[1] = s.mean[2] = 0.0
    # Subtract the centripetal force of the sensor's circle, as far as its lever arm is known.
    fx, fy, fz = f[0], f[1] + turn2 * s.lever[0], f[2] + turn2 * s.lever[1]
    s.age += step
    for j in range(3):
        s.mean[j] += step * (C[j, 0] * fx + C[j, 1] * fy + C[j, 2] * fz)
    s.mean_power += step * (fx * fx + fy * fy + fz * fz)
    mechanisation.clear_sums(s.sums)
    direction(s)
    if dt == 0.0 or s.age < START_TIME or clips:
        return False
    _start(p, s)
    return True


@compiled
def direction(s: BoundedRecord) -> float:
    """
    Set gravity to minus the direction of the mean force so far, in the present tool axes.

    Returns 1 sigma of the inclination, rad; pi if no inclination is kept from before a restart.
    """
    C, mean, g = s.C, s.mean, s.g_t
    norm = max(math.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2), 1e-9)
    for j in range(3):
        g[j] = -(C[0, j] * mean[0] + C[1, j] * mean[1] + C[2, j] * mean[2]) / norm
    if s.kept_tilt == 0.0:
        return math.pi
    # Use the kept inclination, and only the roll of the mean force.
    g[0] = min(max(s.kept_down, -1.0), 1.0)
    side = math.sqrt((1.0 - g[0] ** 2) / max(g[1] ** 2 + g[2] ** 2, 1e-18))
    g[1] *= side
    g[2] *= side
    return math.sqrt(min(s.kept_tilt, 1.0)) + KEPT_SIGMA


@compiled
def _start(p: BoundedParams, s: BoundedRecord) -> None:
    """Set the first attitude from the mean force, and its covariance from the scatter of the force."""
    P = s.P
    mx, my, mz = s.mean[0] / s.age, s.mean[1] / s.age, s.mean[2] / s.age
    size = math.sqrt(mx * mx + my * my + mz * mz)
    scatter = max(0.0, s.mean_power / s.age - size * size) / p.gravity**2
    turned = 0.5 * s.age * (math.sqrt(P[BIAS, BIAS]) + math.sqrt(P[SCALE, SCALE]) * abs(s.last_w[0]))
    # If the mean is not one g long, it contains an acceleration, which probably tilts it by the same relative amount.
    off = size / p.gravity - 1.0
    tilt = min(scatter * CORRELATED / s.age + START_SIGMA**2 + off * off + turned * turned, 1.0)
    g = s.g_t
    if s.kept_tilt > 0.0:
        # Weighted mean of two inclinations, from the mean force and the kept one.
        mean = math.acos(min(max(-(s.C[0, 0] * mx + s.C[1, 0] * my + s.C[2, 0] * mz) / size, -1.0), 1.0))
        share = s.kept_tilt / (s.kept_tilt + tilt)
        inclination = share * mean + (1.0 - share) * math.acos(g[0])
        side = math.sin(inclination) / max(math.sqrt(g[1] ** 2 + g[2] ** 2), 1e-9)
        g[0], g[1], g[2] = math.cos(inclination), side * g[1], side * g[2]
    if g[2] > -0.9999:
        w = math.sqrt(0.5 * (1.0 + g[2]))
        s.q[0], s.q[1], s.q[2], s.q[3] = 0.5 * g[1] / w, -0.5 * g[0] / w, 0.0, w
    else:
        s.q[0], s.q[1], s.q[2], s.q[3] = 1.0, 0.0, 0.0, 0.0
    mechanisation.set_matrix(s)
    unknown_motion(s, scatter)
    for j in range(2):
        P[TILT + j, TILT + j] = tilt
        s.slow_axis[j] = s.C[j, 0]
    if s.kept_tilt > 0.0:
        clipping.split_tilt(s)
        clipping.join_tilt(s, s.kept_tilt * tilt / (s.kept_tilt + tilt))
        s.kept_tilt = 0.0
    s.power = max(s.power, scatter * p.gravity**2)
    s.started = True


@compiled
def attitude_lost(p: BoundedParams, s: BoundedRecord) -> bool:
    """
    Return whether the mean force has had the size of gravity for some time, but a very different direction from it.

    This happens if the tool was rotated during a data gap. A mean force of another length is a real force on the tool,
    or vibration that point samples alias to zero frequency. While such vibration begins and ends, the mean force has
    the length of gravity for a moment; after a lost attitude it keeps this length.
    """
    motion, force = s.motion, s.motion.force
    level = force[0] ** 2 + force[1] ** 2
    much = level + (force[2] + p.gravity) ** 2 > LOST_FORCE2 + WHITE2 * s.motion.rough
    like = abs(math.sqrt(level + force[2] ** 2) - p.gravity) < LIKE_GRAVITY
    motion.lost_time = motion.lost_time + s.sums.time if much and like else 0.0
    return bool(motion.lost_time > LOST_AFTER)
