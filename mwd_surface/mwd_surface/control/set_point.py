# SPDX-License-Identifier: Apache-2.0
"""Set-points of a controller for top drive and pumps, the limits of a lease, and the ramp of the speed."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import ClassVar

from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.units import LPM, RPM
from mwd_surface.control.settings import ControlSettings

_ROUNDING = 1.0 + 1e-6  # factor on a limit that allows for the rounding of float32 registers
LARGEST_NUMBER = 2**32 - 1  # largest number of a lease or set-point, uint32 on the wire


class Mode(enum.IntEnum):
    """Mode of a set-point, as in mwd_msgs/RigCommand."""

    HOLD = 0
    ROTATE = 1
    ORIENT = 2
    PUMP = 3
    RELEASE = 4


@dataclasses.dataclass(frozen=True)
class LeaseLimits:
    """
    Limits of a lease, not below 0.

    In a request, 0 means the limit set at the rig; a left-hand limit of 0 means that left-hand motion is not requested.
    """

    #: `speed`, `speed_rate`: limits of the top drive, rad/s and rad/s^2; the speed is clockwise looking downhole.
    speed: float = 0.0
    speed_rate: float = 0.0
    torque: float = 0.0  #: limit of the torque measured at the top drive, N m
    turn: float = 0.0  #: limit of one clockwise turn (mode ORIENT), rad
    flow: float = 0.0  #: limit of the flow, m^3/s
    #: `left_speed`, `left_turn`: counter-clockwise limits, rad/s and rad. Left-hand motion can unscrew the string, so
    #: it must be requested explicitly.
    left_speed: float = 0.0
    left_turn: float = 0.0

    @classmethod
    def of_settings(cls, settings: ControlSettings) -> LeaseLimits:
        """Return the limits set at the rig."""
        return cls(
            settings.speed_rpm * RPM,
            settings.speed_rate_rpm_s * RPM,
            settings.torque_nm,
            math.radians(settings.turn_deg),
            settings.flow_lpm * LPM,
            settings.left_speed_rpm * RPM,
            math.radians(settings.left_turn_deg),
        )

    def within(self, site: LeaseLimits) -> LeaseLimits:
        """
        Return, for each limit, the narrower of the requested limit and the limit set at the rig.

        Raises
        ------
        ValueError
            A limit is negative or not finite.
        """
        narrowed = {}
        for field in dataclasses.fields(self):
            wanted, most = getattr(self, field.name), getattr(site, field.name)
            if not (math.isfinite(wanted) and wanted >= 0.0):
                raise ValueError(f"{field.name}_limit: must be finite and not below 0, got {wanted:g}")
            as_set = wanted == 0.0 and not field.name.startswith("left_")
            narrowed[field.name] = most if as_set else min(wanted, most)
        return LeaseLimits(**narrowed)

    def beyond(self, granted: LeaseLimits) -> list[str]:
        """Return the names of the limits that are wider than the granted limits."""
        names = [field.name for field in dataclasses.fields(self)]
        return [f"{name}_limit" for name in names if getattr(self, name) > getattr(granted, name)]


@dataclasses.dataclass(frozen=True, eq=False)
class SetPoint(MessageRecord):
    """Set-point of the top drive or, with mode PUMP, of the pumps; with the fields of mwd_msgs/RigCommand."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/RigCommand"

    mode: int  #: value of `Mode`
    #: `lease`, `sequence`: number of the lease, and number of the set-point, which increases within the lease; sequence
    #: 0 is a heartbeat.
    lease: int
    sequence: int
    #: `rotary_speed`, `turn`, `flow_rate`: speed for ROTATE, rad/s; turn for ORIENT, rad; flow for PUMP, m^3/s.
    rotary_speed: float = 0.0
    turn: float = 0.0
    flow_rate: float = 0.0
    valid_for: float = 10.0  #: validity, s, above 0; without a newer command the string is held after this time
    #: With mode ROTATE: whether the rig returns to the driller's settings after `valid_for` instead of holding the
    #: string. With mode PUMP it always returns.
    returns: bool = False
    stamp_ns: int = 0  #: stamp of the toolface that led to the set-point, ns since the epoch, or 0


def check(point: SetPoint, limits: LeaseLimits) -> None:
    """
    Check that a set-point is valid and within the limits.

    Raises
    ------
    ValueError
        The mode is unknown, the sequence number is not from 1 to `LARGEST_NUMBER`, a number is not finite or beyond its
        limit, or the validity is not positive.
    """
    if point.mode not in set(Mode):
        raise ValueError(f"mode: must be one of {', '.join(f'{m.value} {m.name.lower()}' for m in Mode)}")
    if not 1 <= point.sequence <= LARGEST_NUMBER:
        raise ValueError(f"sequence: set-points count from 1 to {LARGEST_NUMBER}, got {point.sequence}")
    for name, low, high, unit in (
        ("rotary_speed", -limits.left_speed, limits.speed, "rad/s"),
        ("turn", -limits.left_turn, limits.turn, "rad"),
        ("flow_rate", 0.0, limits.flow, "m^3/s"),
    ):
        value = getattr(point, name)
        # Allow for rounding in a protocol's units; a limit of zero has no tolerance.
        if not (math.isfinite(value) and low * _ROUNDING <= value <= high * _ROUNDING):
            raise ValueError(f"{name}: the lease allows {low:.4g} to {high:.4g} {unit}, got {value:g}")
    if not (math.isfinite(point.valid_for) and point.valid_for > 0.0):
        raise ValueError(f"valid_for: must be above 0 and finite, got {point.valid_for:g}")


def ramped(speed: float, wanted: float, rate: float, elapsed: float) -> float:
    """Return the speed, rad/s, after it has changed towards `wanted` for `elapsed` s at `rate`, rad/s^2."""
    step = rate * max(elapsed, 0.0)
    return wanted if abs(wanted - speed) <= step else speed + math.copysign(step, wanted - speed)
