# SPDX-License-Identifier: Apache-2.0
"""
Motion of some seconds as an array of steps, and a test whether healthy sensors may have measured it.

A step has the rotation and the sums of the samples of a tenth of a second, or of less time if the tool turns fast. The
test (`consistent`) rotates the vectors by the gyros to the axes at the start of the window (`carry`) and compares
gravity, field and dip with the expected values. Only if they do not agree, `window_checks` evaluates the window.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from mwd_estimation.core.time_jumps import BACK_NS
from mwd_sensors.core.arrays import Array, Indices, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import rotate_right
from mwd_sensors.core.records import dtype_of

PARTS = 6  #: number of half seconds in a window
#: Largest number of steps in a window: a gyro in deg/s makes each sample a step, which gives 6000 in 3 s at 2 kHz.
ROWS = 8192
# A step ends after this squared rotation, rad^2, or this time, ns.
_TURN2, _STEP_NS = 0.2, 100_000_000
# Longest interval between two samples over which the rotation is integrated, s.
_LONGEST = 0.25
#: Net rate above which a string rotates, rad/s: a tool handled by people does not turn that fast for seconds.
TURNING = 3.0
#: Smallest cosine of the angle from x to the axis of the net rotation of a window for a rotation about x (5 deg).
ABOUT_X = math.cos(math.radians(5.0))
#: `ABOUT_X` for a part of a window: a second of whirl or a blow leaves a net rotation across the axis.
ROUGHLY_X = 0.85
#: Range of the Earth's field plus a magnetised string, T; other fields are in another unit of measurement.
LEAST_FIELD, MOST_FIELD = 5e-6, 3e-4
UPWARDS = 0.17  #: axial force, as a share of gravity, above which the hole would point upwards by 10 deg


class MotionStep:
    """Rotation and sums of the samples of a tenth of a second or less, in the units of the sensors."""

    turn: Annotated[Array, 3]  #: integral of the rates, rad
    #: `force`, `field`, `forces`, `fields`, `force2`, `field2`: sums of the vectors, their numbers, sums of squares.
    force: Annotated[Array, 3]
    field: Annotated[Array, 3]
    forces: int
    fields: int
    force2: float
    field2: float
    part: int  #: index in the window of the half second to which the step belongs


STEP = dtype_of(MotionStep)


class CarriedVectors(NamedTuple):
    """Sums of the vectors of steps, rotated by the gyros to the axes at the start of the first step (carried)."""

    #: `force`, `field`, `forces`, `fields`, `force2`, `field2`: sums of the carried vectors, shape (3,), their numbers,
    #: and sums of squares.
    force: Array
    field: Array
    forces: int
    fields: int
    force2: float
    field2: float
    #: `part_force`, `part_forces`: sum of the carried forces of each half second, shape (PARTS, 3), and their number.
    part_force: Array
    part_forces: Indices
    #: `product`, `products`: sum of the scalar products of each force with the mean field of the same step, and number
    #: of these forces.
    product: float
    products: int
    parts: int  #: number of half seconds
    path: float  #: total rotation in any direction, rad
    turn: Array  #: sum of the rotations in tool axes, shape (3,), rad
    force_x: float  #: sum of the forces along tool x


class Samples(NamedTuple):
    """IMU and magnetometer samples: stamps, ns, shapes (n,) and (m,), and values, shapes (n, 3) and (m, 3)."""

    stamps: Stamps
    gyro: Array
    accel: Array
    mag_ns: Stamps
    mag: Array


class ExpectedField(NamedTuple):
    """Gravity, m/s^2, total field, T, and dip, rad, at the place; NaN if unknown."""

    gravity: float
    total: float
    dip: float


class Consistency(NamedTuple):
    """Limits for a healthy window; a window outside them is evaluated in full. They are tighter than `WindowLimits`."""

    #: `length`, `sigmas`: largest relative error of the length of gravity is `length` plus `sigmas` times its noise.
    length: float = 0.02
    sigmas: float = 2.5
    #: Smallest squared length of the mean field, rotated to the start of the window, as a share of the mean squared
    #: field.
    field: float = 0.9
    dip: float = 0.2  #: largest difference of the dip from the reference, rad


@compiled
def carry(steps: Any) -> CarriedVectors:
    """Rotate the sums of steps, dtype STEP, to the axes at the start of the first step, and return their sums."""
    mat, force, field, turn = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
    part_force, part_forces = np.zeros((PARTS, 3)), np.zeros(PARTS, dtype=np.int64)
    forces, fields, products, parts = 0, 0, 0, 0
    force2, field2, product, path, force_x = 0.0, 0.0, 0.0, 0.0, 0.0
    for step in steps:
        own_product, parts = 0.0, step.part + 1
        for a in range(3):
            carried_force, carried_field = 0.0, 0.0
            for b in range(3):
                carried_force += mat[a, b] * step.force[b]
                carried_field += mat[a, b] * step.field[b]
            force[a] += carried_force
            field[a] += carried_field
            part_force[step.part, a] += carried_force
            own_product += step.force[a] * step.field[a]
            turn[a] += step.turn[a]
        if step.forces and step.fields:
            product += own_product / step.fields
            products += step.forces
        part_forces[step.part] += step.forces
        forces, fields = forces + step.forces, fields + step.fields
        force2, field2, force_x = force2 + step.force2, field2 + step.field2, force_x + step.force[0]
        path += math.sqrt(step.turn[0] ** 2 + step.turn[1] ** 2 + step.turn[2] ** 2)
        rotate_right(mat, step.turn[0], step.turn[1], step.turn[2])
    sums = force, field, forces, fields, force2, field2
    return CarriedVectors(*sums, part_force, part_forces, product, products, parts, path, turn, force_x)


@compiled
def add(stream: Any, steps: Any, samples: Samples) -> None:
    """
    Add half a second of samples to the steps of a window.

    stream is a record of `stream_checks.Stream`; its `steps`, `parts` and `mag_first` advance. A magnetic sample
    belongs to the first IMU sample that is not earlier.
    """
    last = opened = stream.last_ns
    # Local names for speed: the loop runs for every sample.
    tx, ty, tz, fx, fy, fz, force2, forces = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for i in range(stream.first, stream.stop):
        at = samples.stamps[i]
        dt = 1e-9 * (at - last)
        dt = dt if 0.0 < dt <= _LONGEST else 0.0
        last = at if at > last or last - at > BACK_NS else last
        x, y, z = samples.gyro[i, 0], samples.gyro[i, 1], samples.gyro[i, 2]
        if math.isfinite(x + y + z):
            tx, ty, tz = tx + x * dt, ty + y * dt, tz + z * dt
        x, y, z = samples.accel[i, 0], samples.accel[i, 1], samples.accel[i, 2]
        if math.isfinite(x + y + z):
            forces += 1
            fx, fy, fz = fx + x, fy + y, fz + z
            force2 += x * x + y * y + z * z
        turn2 = tx * tx + ty * ty + tz * tz
        if turn2 > _TURN2 or at - opened >= _STEP_NS or at < opened or i == stream.stop - 1:
            step = steps[stream.steps]
            stream.mag_first = _add_fields(step, samples, stream.mag_first, at)
            step.turn[0], step.turn[1], step.turn[2] = tx, ty, tz
            step.force[0], step.force[1], step.force[2] = fx, fy, fz
            step.force2, step.forces, step.part = force2, forces, stream.parts
            stream.steps = min(stream.steps + 1, ROWS - 1)
            tx, ty, tz, fx, fy, fz, force2, forces, opened = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, at
    stream.parts += 1


@compiled
def _add_fields(step: Any, samples: Samples, used: int, at: int) -> int:
    """Add the magnetic samples up to a time, ns, to a step; return the number of magnetic samples used so far."""
    step.field[0] = step.field[1] = step.field[2] = step.field2 = 0.0
    step.fields = 0
    while used < len(samples.mag_ns) and samples.mag_ns[used] <= at:
        x, y, z = samples.mag[used, 0], samples.mag[used, 1], samples.mag[used, 2]
        if at - samples.mag_ns[used] < _LONGEST * 1e9 and math.isfinite(x + y + z):
            step.fields += 1
            step.field[0] += x
            step.field[1] += y
            step.field[2] += z
            step.field2 += x * x + y * y + z * z
        used += 1
    return used


@compiled
def _length_noise(carried: CarriedVectors) -> float:
    """
    Return 1 sigma of the mean force along one axis, m/s^2, from the scatter of the half seconds.

    If the window is not full, the result is at least the sigma from white noise.
    """
    mean2, total2, n = 0.0, 0.0, 0
    for a in range(3):
        total, n = 0.0, 0
        for part in range(PARTS):
            if carried.part_forces[part]:
                mean = carried.part_force[part, a] / carried.part_forces[part]
                total += mean
                total2 += mean * mean
                n += 1
        mean2 += total * total / max(n, 1)
    own = math.sqrt(max(total2 - mean2, 0.0) / (3.0 * (n - 1) * n)) if n > 1 else 0.0
    if n == PARTS:
        return own
    # The scatter of a few half seconds is not reliable: use the scatter of the samples if it gives a larger sigma.
    length2 = (carried.force[0] ** 2 + carried.force[1] ** 2 + carried.force[2] ** 2) / carried.forces**2
    return max(own, math.sqrt(max(carried.force2 / carried.forces - length2, 0.0) / (3.0 * carried.forces)))


@compiled
def _turns_about_x(expected: ExpectedField, carried: CarriedVectors, seconds: float) -> bool:
    """
    Return whether the tool does not rotate, or rotates about x like a tool whose x axis points down the hole.

    seconds: length of the window, s.
    """
    upwards = carried.force_x / carried.forces > UPWARDS * expected.gravity
    turn_x = carried.turn[0]
    turned = -turn_x if math.isfinite(expected.dip) else abs(turn_x)
    if upwards and turned > TURNING * seconds:
        return False
    net = math.sqrt(turn_x**2 + carried.turn[1] ** 2 + carried.turn[2] ** 2)
    least = ABOUT_X if carried.parts == PARTS else ROUGHLY_X
    return bool(net <= TURNING * seconds or abs(turn_x) >= least * net)


@compiled
def consistent(p: Consistency, expected: ExpectedField, carried: CarriedVectors, seconds: float) -> bool:
    """Return whether gravity, field and dip of a window are as expected; seconds: length of the window, s."""
    if carried.path > 50.0 * seconds:
        return False
    # A single half second does not show the noise of the mean force.
    if carried.forces >= 10 and carried.parts > 1:
        length = math.sqrt(carried.force[0] ** 2 + carried.force[1] ** 2 + carried.force[2] ** 2) / carried.forces
        off = abs(length / expected.gravity - 1.0)
        if off > p.length + p.sigmas * _length_noise(carried) / expected.gravity:
            return False
        if not _turns_about_x(expected, carried, seconds):
            return False
    if carried.fields < 3:
        return True
    rms = math.sqrt(carried.field2 / carried.fields)
    if not LEAST_FIELD < rms < MOST_FIELD:
        return False
    held = (carried.field[0] ** 2 + carried.field[1] ** 2 + carried.field[2] ** 2) / carried.fields**2
    if held < p.field * rms**2 and carried.path < 0.6 * carried.fields:
        return False
    if not math.isfinite(expected.dip) or not carried.products or abs(rms / expected.total - 1.0) > 0.1:
        return True
    sine = -carried.product / carried.products / (expected.gravity * rms)
    return abs(math.asin(min(max(sine, -1.0), 1.0)) - expected.dip) < p.dip
