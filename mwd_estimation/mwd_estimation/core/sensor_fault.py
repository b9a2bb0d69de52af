# SPDX-License-Identifier: Apache-2.0
"""Sensor faults as data: code, unit, sensor, axis, value and limit. The texts are in `fault_messages`."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np

from mwd_sensors.core import mount
from mwd_sensors.core.arrays import Array

# Bits for sensors that must not be used. The last one stands for the whole precision unit.
GYRO, ACCEL, MAG, PRECISION = 1, 2, 4, 8
SENSORS = ("gyro", "accelerometer", "magnetometer")


class FaultUnit(enum.IntEnum):
    """Sensor unit that a fault belongs to; EITHER: one of the two units is faulty, but which of them is unknown."""

    CONVENTIONAL = 0
    PRECISION = 1
    EITHER = 2


class FaultCode(enum.IntEnum):
    """
    Checks of the sensors; each code means the same for every unit.

    On one axis: STUCK, SATURATED (always at the end of the range), CLIPPED (often at the end of the range). On one
    sensor: INVALID (values that are not finite or that the gate refused), DEAD (all axes repeat), NOISE (random
    numbers), NEVER_CAME and SILENT (no samples), REPEATED (sent twice), UNIT (wrong unit of measurement), MISMATCH
    (matches no axis of the other unit), GRAVITY (the mean force is not gravity), REST_RATE (shows rotation at rest). On
    the stream: RATE, STAMPS, REPLAYED (old samples come again). Between sensors: AXES, SIGN, POINTS_UP (a wrong sign,
    found without a reference), FRAME, ADRIFT (the gyro does not turn as gravity and field do). On the whole unit: MOUNT
    (the string rotates about another axis of the unit than x).
    """

    STUCK = 0
    SATURATED = 1
    CLIPPED = 2
    INVALID = 3
    DEAD = 4
    NOISE = 5
    NEVER_CAME = 6
    SILENT = 7
    REPEATED = 8
    RATE = 9
    STAMPS = 10
    UNIT = 11
    AXES = 12
    SIGN = 13
    POINTS_UP = 14
    FRAME = 15
    MISMATCH = 16
    GRAVITY = 17
    REST_RATE = 18
    REPLAYED = 19
    MOUNT = 20
    ADRIFT = 21


# Faults of the installation. As a rule they exist before the first sample and last for the whole run.
OF_INSTALLATION = frozenset(
    {
        *(FaultCode.UNIT, FaultCode.AXES, FaultCode.SIGN, FaultCode.POINTS_UP, FaultCode.FRAME),
        *(FaultCode.MISMATCH, FaultCode.MOUNT),
    }
)


@dataclasses.dataclass(frozen=True)
class SensorFault:
    """A sensor fault that lasts or that has ended."""

    code: FaultCode
    unit: FaultUnit
    place: int  #: row of the check: three times the sensor (0 gyro, 1 accelerometer, 2 magnetometer), plus the axis
    #: `value`, `limit`: value found, and limit for a healthy sensor, in SI units; checks that count samples use the
    #: share of the samples, 0 to 1.
    value: float
    limit: float
    #: Details as the check stores them; `mappings`, `axes`, `sensors`, `other_unit` and `mount` decode them.
    which: tuple[int, int, int]
    unusable: int  #: bits GYRO, ACCEL, MAG, PRECISION of the sensors that must not be used while the fault lasts
    since_ns: int  #: stamp from which the fault is evident
    cleared_ns: int = 0  #: stamp at which the fault had ended; 0 while it lasts
    #: For INVALID and DEAD: the messages of the sensor declare it not provided (covariance -1), so it is not broken.
    declared: bool = False
    #: True for a fault of the installation whose sensors were never found healthy: the fault exists since the first
    #: sample.
    from_start: bool = False

    def lasted_in(self, begin_ns: int, end_ns: int) -> bool:
        """Return whether the fault existed at some time in [begin_ns, end_ns), as far as is known now."""
        begun = self.from_start or self.since_ns < end_ns
        return begun and (not self.cleared_ns or self.cleared_ns > begin_ns)

    @property
    def check(self) -> int:
        """Number of the check that found the fault; it stays the same when the fault is narrowed down or has ended."""
        return 1000 * int(self.unit != FaultUnit.CONVENTIONAL) + 9 * int(self.code) + self.place

    @property
    def mappings(self) -> tuple[int, int, int]:
        """
        For AXES and FRAME: mappings that explain the fault, for gyro, accelerometer and magnetometer.

        Bit k stands for `axis_mappings.MAPPINGS[k]`; zeros for other codes.
        """
        return self.which if self.code in (FaultCode.AXES, FaultCode.FRAME) else (0, 0, 0)

    @property
    def axes(self) -> tuple[int, ...]:
        """For INVALID and NOISE: the faulty axes, 0 (x) to 2 (z)."""
        return tuple(k for k in range(3) if self.which[0] >> k & 1)

    @property
    def other_unit(self) -> int:
        """For UNIT: index in `fault_messages.OTHER_UNITS` of the unit of measurement that the sensor seems to send."""
        return max(self.which[0] - 1, 0)

    @property
    def mount(self) -> str:
        """For MOUNT: orientation of the unit in the tool, from the axis about which the string turned; else ""."""
        return mount.words(mount.by_turning(np.array(self.which, dtype=float))) if any(self.which) else ""

    def in_unit_axes(self, mat_tu: Array) -> SensorFault:
        """
        Return a MOUNT fault with the axis of rotation in axes of the unit, as `mount` needs it.

        A fault with another code is returned unchanged.

        mat_tu, shape (3, 3): rotation from unit to tool axes that was applied to the samples.
        """
        if self.code != FaultCode.MOUNT:
            return self
        x, y, z = (round(float(v)) for v in mat_tu.T @ np.array(self.which, dtype=float))
        return dataclasses.replace(self, which=(x, y, z))

    @property
    def sensors(self) -> tuple[int, ...]:
        """Sensors that the fault concerns: 0 gyro, 1 accelerometer, 2 magnetometer."""
        if self.code in (FaultCode.AXES, FaultCode.FRAME):
            named = tuple(s for s in range(3) if self.mappings[s])
            return named or (1, 2)
        if self.code in (FaultCode.REPLAYED, FaultCode.MOUNT):
            return 0, 1, 2
        if self.code == FaultCode.SIGN:
            return tuple(s for s in range(3) if self.which[0] >> s & 1)
        return (0, 1) if self.code in (FaultCode.RATE, FaultCode.STAMPS) else (self.place // 3,)
