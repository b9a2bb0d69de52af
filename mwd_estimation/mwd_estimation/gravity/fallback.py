# SPDX-License-Identifier: Apache-2.0
"""
Gravity while a sensor is faulty: the faulty sensor is not used, and gravity is unknown rather than wrong.

Without usable gyros, gravity is the direction of the accelerometer alone, with a sigma from the scatter of the force.
Without a usable accelerometer gravity is NaN. After the fault the method restarts, because its state during the
fault may be wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.innovations import Innovation, of_power
from mwd_estimation.core.sensor_fault import ACCEL, GYRO
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import AT_RANGE, Track
from mwd_estimation.gravity import accelerometer_only
from mwd_estimation.gravity.bounded.field_roll import MagneticSamples
from mwd_estimation.gravity.bounded.state import BoundedState
from mwd_estimation.gravity.methods import Method
from mwd_sensors.core.arrays import Array, Stamps

_NOT_TURNING = np.uint32(Status.STILL | Status.SLIDING)


class GravityWithFallback:
    """
    Gravity method that does not use faulty sensors.

    Parameters
    ----------
    params : Any
        Parameters of the method.
    remaining : accelerometer_only.AccelerometerParams
        Parameters of the accelerometer-only method, used while the gyros are faulty.
    mag : MagneticSamples
        Magnetic samples that the method has not used yet.
    """

    def __init__(
        self, method: Method, params: Any, remaining: accelerometer_only.AccelerometerParams, mag: MagneticSamples
    ) -> None:
        self._method, self._params, self._remaining = method, params, remaining
        self._state = method.initial(params)
        self._remaining_state = accelerometer_only.initial(remaining)
        self._unusable = 0
        self.mag = mag

    @property
    def innovations(self) -> list[Innovation]:
        """Innovations of inclination and toolface; an empty list for a method without innovations."""
        if not isinstance(self._state, BoundedState):
            return []
        found = self._state.record[0]["innovations"]
        return [
            of_power("gravity_inclination", float(found["along"]["power"])),
            of_power("gravity_toolface", float(found["across"]["power"])),
        ]

    @property
    def samples_are(self) -> str:
        """
        Kind of the samples ("points") that the filter detected if the settings state another; otherwise empty.

        Also empty for a method that does not check the samples; see `BoundedState.samples_are`.
        """
        return self._state.samples_are if isinstance(self._state, BoundedState) else ""

    def run(
        self,
        unusable: int,
        time: tuple[Stamps, Stamps],
        gyro: Array,
        accel: Array,
        clipped: NDArray[np.uint8],
        followed: Track | None = None,
    ) -> Track:
        """
        Return the gravity of a block of n samples, and update the method.

        The unusable sensors must be the same in the whole block.

        Parameters
        ----------
        unusable : int
            Unusable sensors, as bits of `core.sensor_fault`.
        time : tuple of ndarray of int64, shape (n,) each
            Stamps, ns, and times at which the samples were measured (`core.stream_clock`), ns.
        gyro, accel : ndarray, shape (n, 3)
            Rates, rad/s, and forces, m/s^2, in tool axes.
        clipped : ndarray of uint8, shape (n,)
            Bits of `core.clip_flags`.
        followed : Track, optional
            Gravity from another method (a smoother), which is returned if both sensors are usable.
        """
        stamps, times = time
        unusable, before = unusable & (GYRO | ACCEL), self._unusable
        self._unusable = unusable
        if unusable or followed is not None or not self._method.uses_field:
            self._drop_mag(int((self.mag.sent_ns <= stamps.max() - self.mag.lag_ns).sum()))
        if unusable & ACCEL:
            return _unknown(len(stamps))
        if unusable & GYRO:
            if before != unusable:
                self._remaining_state = accelerometer_only.initial(self._remaining)
            found = accelerometer_only.run(self._remaining, self._remaining_state, times, np.zeros_like(gyro), accel)
            # Without gyros a single sample cannot show whether the tool turns.
            found.status[:] &= ~_NOT_TURNING
            return found
        if before:
            found, self._state = self._state, self._method.initial(self._params)
            if isinstance(found, BoundedState):
                self._state.keep_meaning(found)
        if followed is not None:
            return followed
        if self._method.uses_field:
            track: Track = self._method.run(
                self._params, self._state, times, gyro, accel, clipped, self.mag._replace(due_ns=stamps)
            )
            self._drop_mag(self._state.field_used)
            return track
        return self._method.run(self._params, self._state, times, gyro, accel)

    def take_mag(self, time: tuple[Stamps, Stamps], b_t: Array) -> None:
        """
        Keep magnetic samples until the IMU samples of their time arrive.

        time: stamps, ns, and times at which the samples were measured, ns; b_t: field in tool axes, T.
        """
        mag, (sent, stamps) = self.mag, time
        self.mag = mag._replace(
            stamp_ns=np.concatenate([mag.stamp_ns, stamps]),
            b_t=np.concatenate([mag.b_t, b_t]),
            sent_ns=np.concatenate([mag.sent_ns, sent]),
        )

    def shift_mag(self, late_ns: int, lag_ns: int) -> None:
        """Subtract late_ns from the stamps of waiting magnetic samples, and set their lag, ns (`MagneticSamples`)."""
        mag = self.mag
        self.mag = mag._replace(stamp_ns=mag.stamp_ns - late_ns, sent_ns=mag.sent_ns - late_ns, lag_ns=lag_ns)

    def _drop_mag(self, count: int) -> None:
        mag = self.mag
        self.mag = mag._replace(stamp_ns=mag.stamp_ns[count:], b_t=mag.b_t[count:], sent_ns=mag.sent_ns[count:])


def without_faulty(unusable: int, gyro: Array, full: float) -> Array:
    """
    Return the rates, rad/s, shape (n, 3), for the steps after gravity, with NaN in place of rates that are wrong.

    All rates are NaN if the gyros are unusable. If the y or the z gyro clips in a sample, both of these rates are NaN
    in this sample: no tool rotates so fast across its axis, so such a rate comes from a blow. A clipped x rate is kept,
    because a string may rotate faster than the gyro can measure. full: end of the gyro's range, rad/s.
    """
    if unusable & GYRO:
        return np.full_like(gyro, np.nan)
    clipped = (np.abs(gyro[:, 1:]) >= AT_RANGE * full).any(axis=1)
    if not clipped.any():
        return gyro
    gyro = gyro.copy()
    gyro[clipped, 1:] = np.nan
    return gyro


def _unknown(n: int) -> Track:
    track = Track.empty(n)
    track.g_t[:] = np.nan
    track.sigma_inclination[:] = track.sigma_toolface[:] = np.pi
    track.non_gravity[:] = track.rotary_speed[:] = 0.0
    track.status[:] = int(Status.INITIALISING)
    return track
