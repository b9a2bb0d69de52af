# SPDX-License-Identifier: Apache-2.0
"""
Roll of the bounded filter from the magnetic field, for rotations that the x gyro cannot measure.

In the plane across the tool axis, the angle between the field and gravity does not change when the tool rotates. While
the roll is known from the gyro and the forces, this angle is estimated, and the magnetometer does not change the
attitude. When the x gyro clips, when samples are missing, or after a start, the field and the estimated angle give the
roll (equation (13) of ``docs/methods/bounded_gravity_filter.md``). A magnetic sample is used a fixed time after its
stamp, and is compared with the roll at the time of its stamp.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import ring, track
from mwd_estimation.gravity.bounded import measurement, mechanisation
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.gravity.bounded.state import ERRORS, MISSING, SLOPE, STEADY, TILT, BoundedRecord, Field
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.kalman import wrap_angle

ANGLE_WALK = 1e-5  # rad^2/s, random walk of the angle: fast drilling turns the hole by 0.6 deg in 10 s
TILT_TIME = 3.0  # correlation time of the error of the roll from which the angle is estimated, s
STRENGTH_TIME = 10.0  # averaging time of the field strength across the axis, s
STAMP_ERROR = 1e-3  # remaining error of the delay between gyro and magnetometer, s (`magnetic_delay`)
UNCERTAIN = 4.0  # the field is used if the variance of the roll is above this multiple of the variance by the field
YOUNG = 3.0  # time after a start during which the first roll may be wrong, s
SURPRISE = 25.0  # largest squared innovation over its variance (5 sigma); a larger one shows a lost roll
FRESH_NS = 500_000_000  # largest age of the last magnetic sample with which the field can show the roll, ns
_NEAR_VERTICAL_SINE2 = math.sin(track.NEAR_VERTICAL_BELOW) ** 2


class MagneticSamples(NamedTuple):
    """Magnetic samples in tool axes that wait for the filter, in the order of their arrival."""

    stamp_ns: Stamps  #: times at which they were measured, ns, shape (m,)
    b_t: Array  #: field, T, shape (m, 3)
    #: Lag, ns: a magnetic sample is used at the first sample of the conventional unit whose stamp is at least this much
    #: later, and that was not measured before it.
    lag_ns: int
    #: `due_ns`, `sent_ns`: stamps, ns, of the samples of the conventional unit, shape (n,), and of the magnetic
    #: samples, shape (m,), between which the lag is counted. If `due_ns` is empty, it is counted from the times at
    #: which the samples of the conventional unit were measured.
    due_ns: Stamps
    sent_ns: Stamps

    @classmethod
    def none(cls, lag_ns: int = 0) -> MagneticSamples:
        """Return an instance without samples; lag_ns: see the attribute of this name."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, np.zeros((0, 3)), lag_ns, none, none)

    def leave_out(self, times: Stamps, out: NDArray[np.bool_]) -> None:
        """
        Replace magnetic samples that would be used at samples marked in `out` by NaN, in place.

        times, out: times at which the samples of the conventional unit in `due_ns` were measured, ns, and marks, shape
        (n,) each.
        """
        if not out.any():
            return
        turn = np.searchsorted(np.maximum.accumulate(self.due_ns), np.maximum.accumulate(self.sent_ns) + self.lag_ns)
        measured = np.searchsorted(np.maximum.accumulate(times), np.maximum.accumulate(self.stamp_ns))
        turn = np.maximum(turn, measured)
        left = turn < len(self.due_ns)
        left[left] = out[turn[left]]
        self.b_t[left] = math.nan


@compiled
def follow_turn(s: BoundedRecord, stamp_ns: int) -> None:
    """Store the rotation about the axis at an accepted sample; stamp_ns: its stamp."""
    row = s.field.turns.rows[ring.next_place(s.field.turns)]
    row.stamp_ns, row.turn = stamp_ns, s.turn


@compiled
def begin_anew(f: Field, stamp_ns: int) -> None:
    """Use only magnetic samples after this stamp, ns, because the gyro did not measure the rotation before it."""
    f.since_ns = stamp_ns
    f.turns.head = f.turns.length = 0


@compiled
def at_hand(f: Field, stamp_ns: int) -> bool:
    """Return whether the field can give the roll: its angle to gravity is known, and a magnetic sample is recent."""
    return bool(f.variance > 0.0 and stamp_ns - f.last_ns < FRESH_NS)


@compiled
def follow(p: BoundedParams, s: BoundedRecord, stamp_ns: int) -> bool:
    """
    Compare the roll with the newest magnetic sample, after an update; return whether the roll was corrected.

    Either the estimate of the angle between gravity and field across the axis is updated, or the roll is corrected with
    this angle. stamp_ns: stamp of the present sample.
    """
    f = s.field
    strength = math.sqrt(f.b_t[1] ** 2 + f.b_t[2] ** 2)
    across2 = s.C[0, 0] ** 2 + s.C[1, 0] ** 2
    back = f.turns.length
    if f.stamp_ns <= f.last_ns or f.stamp_ns < f.since_ns or back < 2 or across2 < _NEAR_VERTICAL_SINE2:
        return False
    if f.turns.rows[ring.place(f.turns, back)].stamp_ns > f.stamp_ns or not strength > 10.0 * p.mag_error:
        return False
    dt, f.last_ns = min(1e-9 * (f.stamp_ns - f.last_ns), STRENGTH_TIME), f.stamp_ns
    f.variance += ANGLE_WALK * dt if f.variance > 0.0 else 0.0
    earlier, later, share = ring.around(f.turns, f.stamp_ns)
    turned = s.turn - (1.0 - share) * f.turns.rows[earlier].turn - share * f.turns.rows[later].turn
    shown = math.atan2(f.b_t[1], f.b_t[2]) + turned
    off = wrap_angle(shown + f.angle - math.atan2(s.C[2, 1], s.C[2, 2]))
    noise = (p.mag_error / strength) ** 2 + (STAMP_ERROR * s.last_w[0]) ** 2
    if f.variance > 0.0:
        # A disturbance turns the field by an angle, rad, of about the relative change of its strength.
        noise += (strength / f.strength - 1.0) ** 2
    roll2, total = s.sigma_toolface**2, f.variance + noise
    # Do not correct a roll that is uncertain although no rotation was lost: the cause may be a faulty gyro, which the
    # correction would hide.
    lost = s.clipping.seen or s.settled < YOUNG
    if s.clipping.sign != 0.0 or (lost and roll2 > UNCERTAIN * total):
        if f.variance == 0.0:
            return False
        # The factor on the published toolface variance must not be below 1, because the variance of the roll by the
        # field is not inflated.
        s.innovations.across.power = max(s.innovations.across.power, 1.0)
        _correct_roll(s, off, total, min(1e-9 * (stamp_ns - f.stamp_ns), s.clipping.time))
        return True
    if f.variance == 0.0:
        f.angle, f.variance, f.strength = f.angle - off, roll2 + noise, strength
        return False
    if roll2 < total:
        s.clipping.seen = False
    # If roll and field disagree by more than 5 sigma, the angle between field and gravity has changed.
    f.variance += off * off if off * off > SURPRISE * (roll2 + total) else 0.0
    gain = f.variance / (f.variance + roll2 * max(2.0 * TILT_TIME / max(dt, 1e-3), 1.0) + noise)
    f.angle -= gain * off
    f.variance -= gain * f.variance
    f.strength += dt / STRENGTH_TIME * (strength - f.strength)
    return False


@compiled
def _correct_roll(s: BoundedRecord, off: float, variance: float, clipped: float) -> None:
    """
    Rotate the tool about its axis by the roll error from the field, equation (13).

    off: roll error, rad; variance: variance of the roll by the field, rad^2; clipped: time since the magnetic sample
    during which the x gyro clipped, s.
    """
    P, C, e, PH = s.P, s.C, s.correction, s.work[0]
    s.clipping.lost = False
    across2 = C[0, 0] ** 2 + C[1, 0] ** 2
    nx, ny = C[0, 0] / across2, C[1, 0] / across2
    size = STEADY if s.clipping.sign == 0.0 else ERRORS
    # The missing part of the rate has rotated the tool since the magnetic sample.
    late, later = (clipped, 0.5 * clipped * clipped) if size == ERRORS else (0.0, 0.0)
    for j in range(size):
        PH[j] = nx * P[TILT, j] + ny * P[TILT + 1, j]
        if size == ERRORS:
            PH[j] += later * P[SLOPE, j] - late * P[MISSING, j]
    S = variance + nx * PH[TILT] + ny * PH[TILT + 1]
    if size == ERRORS:
        S += later * PH[SLOPE] - late * PH[MISSING]
    if off * off > SURPRISE * S:
        for a in range(2):
            PH[TILT + a] += off * off * C[a, 0]
            for b in range(2):
                P[TILT + a, TILT + b] += off * off * (C[a, 0] * C[b, 0])
        S += off * off
    for j in range(size):
        e[j] = PH[j] / S * off
        for m in range(size):
            P[j, m] -= PH[j] * PH[m] / S
    mechanisation.symmetrise(P, size)
    roll = nx * e[TILT] + ny * e[TILT + 1]
    e[TILT] -= roll * C[0, 0]
    e[TILT + 1] -= roll * C[1, 0]
    heading = roll * C[2, 0]
    measurement.correct(s, size)
    mechanisation.rotate(s, roll, 0.0, 0.0)
    cosine, sine = math.cos(heading), math.sin(heading)
    for v in (s.vel, s.pos):
        v[0], v[1] = cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1]
    # All magnetic samples have the same error of the angle, so the roll variance must not fall below that of one
    # sample.
    missing = variance - (nx * nx * P[TILT, TILT] + 2.0 * nx * ny * P[TILT, TILT + 1] + ny * ny * P[TILT + 1, TILT + 1])
    if missing > 0.0:
        for a in range(2):
            for b in range(2):
                P[TILT + a, TILT + b] += missing * (C[a, 0] * C[b, 0])
