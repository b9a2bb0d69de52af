# SPDX-License-Identifier: Apache-2.0
"""
Track: the output of every gravity method for each sample, and the checks that each sample passes first.

A sample is admitted, admitted after a gap, or rejected (not finite, no force on any axis, or its stamp does not
advance). A rejected sample does not change the filter; the last estimate is repeated with a flag. Thus no filter ever
gets a value that is not finite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps, Vector
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

ROTATING_ABOVE = 0.5  # low-passed rate about the tool axis above which the string rotates, rad/s (4.8 r/min)
STILL_RATE = 0.05  # decaying peak of the angular rate below which the tool is still, rad/s
STILL_NON_GRAVITY = 0.5  # decaying peak of the non-gravity acceleration below which the tool is still, m/s^2
STILL_HOLD = 1.0  # time constant of the decay of both peaks, s
ROTARY_LAG = 0.5  # time constant of the rotary speed, s
NEAR_VERTICAL_BELOW = math.radians(3.0)  # inclination below which gravity across the tool is too small for a toolface
BACKWARD_LIMIT = 50  # number of samples with advancing stamps after which a clock that jumped back is accepted
# Force that no accelerometer resolves, m/s^2. A sample is a reading only if the force on at least one axis is larger.
FORCE_ABOVE = 1e-6
GAP_NS = 500_000_000  # a longer step between samples is a data gap, for methods without a rule of their own
# A reading of at least this share of the range counts as clipped: rounding can leave a clipped reading just below the
# end of the range.
AT_RANGE = 0.9995

FIRST, NEXT, AFTER_GAP, REJECTED = 0, 1, 2, 3

_REJECTED, _GAP, _CLIPPED = int(Status.REJECTED), int(Status.GAP), int(Status.CLIPPED)
_STILL, _SLIDING, _ROTATING = int(Status.STILL), int(Status.SLIDING), int(Status.ROTATING)
_NEAR_VERTICAL = int(Status.NEAR_VERTICAL)


class TrackClock:
    """Stamps of the samples admitted so far; zeros before the first."""

    last_ns: int  #: stamp of the last admitted sample, ns
    started: bool  #: whether a sample has been admitted
    #: `backward_ns`, `backward_count`: last stamp that was not later than `last_ns`, ns; and number of these stamps,
    #: each later than the previous one.
    backward_ns: int
    backward_count: int


class TrackMotion:
    """Rotary speed and decaying peaks; zeros before the first sample."""

    rotary_speed: float  #: low-passed rate about the tool axis, rad/s
    #: `peak_rate`, `peak_force`: peaks of the angular rate, rad/s, and of the non-gravity acceleration, m/s^2; they
    #: decay with the time constant STILL_HOLD.
    peak_rate: float
    peak_force: float
    #: `step`, `keep`: last step between samples, s, and the share of the peaks that is left after this step.
    step: float
    keep: float


CLOCK, MOTION = dtype_of(TrackClock), dtype_of(TrackMotion)


@compiled
def clips(v: Vector, full: float) -> bool:
    """Return whether a component of v is at the end of the range, `full`; v: rates, rad/s, or forces, m/s^2."""
    return bool(max(abs(v[0]), abs(v[1]), abs(v[2])) >= AT_RANGE * full)


class Track(NamedTuple):
    """Estimate of gravity for n samples; kernels fill it row by row."""

    g_t: Array  #: shape (n, 3); unit vector down, in tool axes. NaN until a first estimate exists.
    #: `sigma_inclination`, `sigma_toolface`: shape (n,); 1 sigma, rad, at most pi.
    sigma_inclination: Array
    sigma_toolface: Array
    #: shape (n,); decaying peak of the magnitude of the non-gravity specific force, time constant STILL_HOLD, m/s^2.
    non_gravity: Array
    rotary_speed: Array  #: shape (n,); low-passed rate about the tool axis, rad/s, positive clockwise looking down-hole
    status: NDArray[np.uint32]  #: uint32, shape (n,); bits of `mwd_estimation.core.status.Status`
    #: shape (n,); time since a step of the gyro bias that this sample has revealed, s; 0 in all other samples.
    gyro_step: Array

    @classmethod
    def empty(cls, n: int) -> Track:
        """Return a track for n samples, which a kernel must fill; only `status` and `gyro_step` are set, to 0."""
        one = (n,)
        status, gyro_step = np.zeros(one, dtype=np.uint32), np.zeros(one)
        return cls(np.empty((n, 3)), np.empty(one), np.empty(one), np.empty(one), np.empty(one), status, gyro_step)

    def part(self, samples: slice) -> Track:
        """Return the track of the samples in a slice, without copying."""
        return Track._make(column[samples] for column in self)

    @property
    def inclination(self) -> Array:
        """Angle of the tool axis from the vertical, shape (n,), rad."""
        return np.asarray(np.arctan2(np.hypot(self.g_t[:, 1], self.g_t[:, 2]), self.g_t[:, 0]))


def sample_arrays(stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> tuple[Stamps, Array, Array]:
    """
    Return stamps, rates and forces of one block, checked for shape, in the types and memory layout that kernels need.

    Raises
    ------
    ValueError
        If the stamps do not have shape (n,), or rates or forces not shape (n, 3).
    """
    stamps = np.ascontiguousarray(stamp_ns, dtype=np.int64)
    gyro = np.ascontiguousarray(gyro_t, dtype=np.float64)
    accel = np.ascontiguousarray(accel_t, dtype=np.float64)
    if stamps.ndim != 1:
        raise ValueError(f"stamp_ns: expected shape (n,), got {stamps.shape}")
    for name, block in (("gyro_t", gyro), ("accel_t", accel)):
        if block.shape != (len(stamps), 3):
            raise ValueError(f"{name}: expected shape ({len(stamps)}, 3), got {block.shape}")
    return stamps, gyro, accel


@compiled
def admit(clock: TrackClock, stamp: int, w: Vector, f: Vector, gap_ns: int) -> int:
    """
    Check one sample, update the clock, and return FIRST, NEXT, AFTER_GAP or REJECTED.

    clock : record of `TrackClock`; stamp, gap_ns : ns; w, f, shape (3,) : rate, rad/s, and force, m/s^2.

    A sample without force on any axis is rejected, because a real accelerometer shows gravity or at least noise. A
    stamp that does not advance is rejected too. But if more than BACKWARD_LIMIT stamps advance after a jump back, the
    new time is accepted (AFTER_GAP); otherwise setting the clock back would stop the estimate.
    """
    finite = math.isfinite(w[0] + w[1] + w[2] + f[0] + f[1] + f[2])
    if not finite or max(abs(f[0]), abs(f[1]), abs(f[2])) <= FORCE_ABOVE:
        return REJECTED
    if not clock.started:
        clock.started = True
        clock.last_ns = stamp
        return FIRST
    step = stamp - clock.last_ns
    if step > 0:
        clock.last_ns = stamp
        clock.backward_count = 0
        return NEXT if step <= gap_ns else AFTER_GAP
    if clock.backward_count == 0 or stamp > clock.backward_ns:
        clock.backward_count += 1
    clock.backward_ns = stamp
    if clock.backward_count > BACKWARD_LIMIT:
        clock.backward_count = 0
        clock.last_ns = stamp
        return AFTER_GAP
    return REJECTED


@compiled
def take(
    clock: TrackClock, stamp: int, w: Vector, f: Vector, gap_ns: int, gyro_range: float, accel_range: float
) -> tuple[int, float, int]:
    """
    Check one sample for any gravity method, and return its step in time and its status bits.

    Arguments as in `admit`; gyro_range, rad/s, accel_range, m/s^2 : ends of the ranges, at which the sensors clip.

    Returns
    -------
    verdict : int
        As in `admit`.
    step : float
        Time since the last admitted sample, s; 0 for the first sample and for a rejected one.
    bits : int
        REJECTED, GAP and CLIPPED of `Status`.
    """
    before = clock.last_ns
    verdict = admit(clock, stamp, w, f, gap_ns)
    if verdict == REJECTED:
        return verdict, 0.0, _REJECTED
    bits = _GAP if verdict == AFTER_GAP else 0
    if clips(w, gyro_range) or clips(f, accel_range):
        bits |= _CLIPPED
    return verdict, 0.0 if verdict == FIRST else 1e-9 * (stamp - before), bits


@compiled
def follow_motion(motion: TrackMotion, dt: float, w: Vector, non_gravity: float) -> int:
    """
    Update rotary speed and peaks with one sample; return STILL, SLIDING or ROTATING of `Status`.

    dt: time since the last sample, s; w, shape (3,): rate, rad/s; non_gravity: magnitude of the non-gravity specific
    force, m/s^2. The low-pass is S3 eq 11, whose second term takes the previous output.
    """
    share = dt / (ROTARY_LAG + dt)
    motion.rotary_speed += share * (w[0] - motion.rotary_speed)
    if dt != motion.step or motion.keep == 0.0:
        motion.step, motion.keep = dt, math.exp(-dt / STILL_HOLD)
    motion.peak_rate = max(motion.peak_rate * motion.keep, math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]))
    motion.peak_force = max(motion.peak_force * motion.keep, non_gravity)
    if abs(motion.rotary_speed) > ROTATING_ABOVE:
        return _ROTATING
    if motion.peak_rate < STILL_RATE and motion.peak_force < STILL_NON_GRAVITY:
        return _STILL
    return _SLIDING


@compiled
def write_row(out: Track, i: int, across: float, sigma: float, motion: TrackMotion, bits: int) -> None:
    """
    Fill row i of all columns except `g_t` and `gyro_step`.

    across: sine of the inclination; sigma: 1 sigma of the direction of gravity, rad; motion: as updated by
    `follow_motion`; bits: bits of `Status`, to which NEAR_VERTICAL is added here.
    """
    if across < math.sin(NEAR_VERTICAL_BELOW):
        bits |= _NEAR_VERTICAL
    out.sigma_inclination[i] = sigma
    # An error across the axis rotates the toolface by the error divided by the sine of the inclination.
    out.sigma_toolface[i] = min(math.pi, sigma / max(across, 1e-3))
    out.non_gravity[i] = motion.peak_force
    out.rotary_speed[i] = motion.rotary_speed
    out.status[i] = bits
