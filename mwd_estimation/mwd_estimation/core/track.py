# SPDX-License-Identifier: Apache-2.0
"""
Track: what every gravity method publishes, sample by sample, and the checks every sample passes first.

A sample is admitted, admitted after a gap, or rejected (not finite, or its stamp does not advance). Rejected samples
leave the filter as it was and repeat the last estimate with a flag; nothing not finite ever reaches a filter.
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

ROTATING_ABOVE = 0.5  # rad/s, low-passed rate about the tool axis (4.8 r/min)
STILL_RATE = 0.05  # rad/s, held peak of the angular rate
STILL_NON_GRAVITY = 0.5  # m/s^2, held peak of the non-gravity acceleration
STILL_HOLD = 1.0  # s, time constant with which a peak is forgotten
ROTARY_LAG = 0.5  # s, time constant of the rotary speed
NEAR_VERTICAL_BELOW = math.radians(3.0)  # where the high side is too short to name a toolface
BACKWARD_LIMIT = 50  # samples whose stamps advance again, after which a clock that jumped back counts
FORCE_ABOVE = 1e-6  # m/s^2, less than any accelerometer resolves
GAP_NS = 500_000_000  # a longer step between samples is a data gap, for those that have no rule of their own
AT_RANGE = (
    0.9995  # of the range: rounding and the steps of the converter leave readings of a clipped sensor short of it
)

FIRST, NEXT, AFTER_GAP, REJECTED = 0, 1, 2, 3

_REJECTED, _GAP, _CLIPPED = int(Status.REJECTED), int(Status.GAP), int(Status.CLIPPED)
_STILL, _SLIDING, _ROTATING = int(Status.STILL), int(Status.SLIDING), int(Status.ROTATING)
_NEAR_VERTICAL = int(Status.NEAR_VERTICAL)


class Clock:
    """Stamps of the samples admitted so far; zeros before the first."""

    last_ns: int  #: stamp of the last sample admitted
    started: bool  #: whether there is one
    #: `backward_ns`, `backward_count`: last of the stamps that went back, and how many of these have advanced among
    #: themselves.
    backward_ns: int
    backward_count: int


class Motion:
    """Rotary speed and held peaks; zeros before the first sample."""

    rotary_speed: float  #: low-passed rate about the tool axis, rad/s
    #: `peak_rate`, `peak_force`: peaks of the angular rate, rad/s, and of the non-gravity acceleration, m/s^2,
    #: forgotten over STILL_HOLD.
    peak_rate: float
    peak_force: float


CLOCK, MOTION = dtype_of(Clock), dtype_of(Motion)


@compiled
def clips(v: Vector, full: float) -> bool:
    """Whether a component of v, a rate, rad/s, or force, m/s^2, is at the end of the range `full`."""
    return bool(max(abs(v[0]), abs(v[1]), abs(v[2])) >= AT_RANGE * full)


class Track(NamedTuple):
    """Gravity followed through n samples; kernels fill it row by row."""

    g_t: Array  #: shape (n, 3); unit vector down, in tool axes. NaN until a first estimate exists.
    #: `sigma_inclination`, `sigma_toolface`: shape (n,); one sigma, rad, at most pi.
    sigma_inclination: Array
    sigma_toolface: Array
    #: shape (n,); largest magnitude of the specific force that is not gravity, forgotten over about a second, m/s^2.
    non_gravity: Array
    rotary_speed: Array  #: shape (n,); low-passed rate about the tool axis, rad/s, positive clockwise looking down-hole
    status: NDArray[np.uint32]  #: uint32, shape (n,); bits of `mwd_estimation.core.status.Status`

    @classmethod
    def empty(cls, n: int) -> Track:
        """Room for n samples, to be filled by a kernel."""
        one = (n,)
        return cls(
            np.empty((n, 3)), np.empty(one), np.empty(one), np.empty(one), np.empty(one), np.zeros(one, dtype=np.uint32)
        )

    def part(self, samples: slice) -> Track:
        """Return some of the samples."""
        return Track._make(column[samples] for column in self)

    @property
    def inclination(self) -> Array:
        """Angle of the tool axis from the vertical, shape (n,), rad."""
        return np.asarray(np.arctan2(np.hypot(self.g_t[:, 1], self.g_t[:, 2]), self.g_t[:, 0]))


def sample_arrays(stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> tuple[Stamps, Array, Array]:
    """
    Arrays of one block, checked for shape and laid out for a kernel.

    Raises
    ------
    ValueError
        Stamps not of shape (n,), or rates or forces not of shape (n, 3).
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
def admit(clock: Clock, stamp: int, w: Vector, f: Vector, gap_ns: int) -> int:
    """
    Judge one sample and move the clock: FIRST, NEXT, AFTER_GAP or REJECTED.

    clock : record of `Clock`; stamp, gap_ns : ns; w, f, shape (3,) : rate, rad/s, and force, m/s^2.

    No force on any axis is no measurement: an accelerometer has gravity or noise. A stamp that does not advance is
    rejected. When the stamps after a backward jump advance among themselves for
    BACKWARD_LIMIT samples the new clock counts (AFTER_GAP), so that a clock set back does not end the estimate.
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
    clock: Clock, stamp: int, w: Vector, f: Vector, gap_ns: int, gyro_range: float, accel_range: float
) -> tuple[int, float, int]:
    """
    Take one sample as every gravity method does.

    Arguments as of `admit`; gyro_range, rad/s, accel_range, m/s^2 : where the sensors clip.

    Returns
    -------
    verdict : int
        As `admit`.
    step : float
        Time since the last sample admitted, s; 0 for the first, and for one that is rejected.
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
def follow_motion(motion: Motion, dt: float, w: Vector, non_gravity: float) -> int:
    """Rotary speed (S3 eq 11 with the previous output in its second term) and STILL, SLIDING or ROTATING."""
    share = dt / (ROTARY_LAG + dt)
    motion.rotary_speed += share * (w[0] - motion.rotary_speed)
    forget = math.exp(-dt / STILL_HOLD)
    motion.peak_rate = max(motion.peak_rate * forget, math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]))
    motion.peak_force = max(motion.peak_force * forget, non_gravity)
    if abs(motion.rotary_speed) > ROTATING_ABOVE:
        return _ROTATING
    if motion.peak_rate < STILL_RATE and motion.peak_force < STILL_NON_GRAVITY:
        return _STILL
    return _SLIDING


@compiled
def write_row(out: Track, i: int, across: float, sigma: float, motion: Motion, bits: int) -> None:
    """
    Fill row i but for its direction.

    across: sine of the inclination; sigma: of the direction, rad; motion: as `follow_motion` keeps it; bits: of
    `Status`, to which NEAR_VERTICAL is added here.
    """
    if across < math.sin(NEAR_VERTICAL_BELOW):
        bits |= _NEAR_VERTICAL
    out.sigma_inclination[i] = sigma
    # The toolface turns by the error across the axis over the sine of the inclination.
    out.sigma_toolface[i] = min(math.pi, sigma / max(across, 1e-3))
    out.non_gravity[i] = motion.peak_force
    out.rotary_speed[i] = motion.rotary_speed
    out.status[i] = bits
