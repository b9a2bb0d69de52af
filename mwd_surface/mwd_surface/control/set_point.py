# SPDX-License-Identifier: Apache-2.0
"""What a controller asks of top drive and pumps, the limits it must keep, and the ramp of the speed."""

from __future__ import annotations

import dataclasses
import enum
import math

from mwd_surface.control.settings import ControlSettings

_RPM = math.pi / 30.0
_LITRE_PER_MINUTE = 1e-3 / 60.0


class Mode(enum.IntEnum):
    """As in mwd_msgs/RigCommand."""

    HOLD = 0
    ROTATE = 1
    ORIENT = 2
    PUMP = 3
    RELEASE = 4


@dataclasses.dataclass(frozen=True)
class LeaseLimits:
    """
    Limits of a lease, each above 0; in a request 0 means: as set at the rig.

    Attributes
    ----------
    speed, speed_rate : float
        Of the top drive, rad/s and rad/s^2.
    torque : float
        Measured at the top drive, N m.
    turn : float
        Of one ORIENT, rad.
    flow : float
        m^3/s.
    """

    speed: float = 0.0
    speed_rate: float = 0.0
    torque: float = 0.0
    turn: float = 0.0
    flow: float = 0.0

    @classmethod
    def of_settings(cls, settings: ControlSettings) -> LeaseLimits:
        """Return the limits set at the rig."""
        return cls(
            settings.speed_rpm * _RPM,
            settings.speed_rate_rpm_s * _RPM,
            settings.torque_nm,
            math.radians(settings.turn_deg),
            settings.flow_lpm * _LITRE_PER_MINUTE,
        )

    def within(self, site: LeaseLimits) -> LeaseLimits:
        """
        Return the narrower of each.

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
            narrowed[field.name] = min(wanted, most) if wanted > 0.0 else most
        return LeaseLimits(**narrowed)


@dataclasses.dataclass(frozen=True)
class SetPoint:
    """
    What is asked of the top drive, or with PUMP of the pumps; as mwd_msgs/RigCommand.

    Attributes
    ----------
    mode : int
        Of `Mode`.
    lease, sequence : int
        Under which lease; the same sequence again is a heartbeat alone.
    rotary_speed, turn, flow_rate : float
        Of ROTATE, rad/s; of ORIENT, rad; of PUMP, m^3/s.
    valid_for : float
        s, above 0: with no newer command the string is held then.
    returns : bool
        Of ROTATE: it returns then to what the driller has set; PUMP always does.
    stamp_ns : int
        Of the toolface that led to it, or 0.
    """

    mode: int
    lease: int
    sequence: int
    rotary_speed: float = 0.0
    turn: float = 0.0
    flow_rate: float = 0.0
    valid_for: float = 10.0
    returns: bool = False
    stamp_ns: int = 0


def check(point: SetPoint, limits: LeaseLimits) -> None:
    """
    Whether a set-point is one and within the limits.

    Raises
    ------
    ValueError
        An unknown mode, a number that is not finite, beyond its limit, or a time that is not positive.
    """
    if point.mode not in set(Mode):
        raise ValueError(f"mode: must be one of {', '.join(f'{m.value} {m.name.lower()}' for m in Mode)}")
    if point.sequence < 1:
        raise ValueError("sequence: set-points count from 1")
    for name, low, high, unit in (
        ("rotary_speed", -limits.speed, limits.speed, "rad/s"),
        ("turn", -limits.turn, limits.turn, "rad"),
        ("flow_rate", 0.0, limits.flow, "m^3/s"),
    ):
        value = getattr(point, name)
        if not (math.isfinite(value) and low - 1e-9 <= value <= high + 1e-9):
            raise ValueError(f"{name}: the lease allows {low:.4g} to {high:.4g} {unit}, got {value:g}")
    if not (math.isfinite(point.valid_for) and point.valid_for > 0.0):
        raise ValueError(f"valid_for: must be above 0 and finite, got {point.valid_for:g}")


def ramped(speed: float, wanted: float, rate: float, elapsed: float) -> float:
    """Speed, rad/s, after `elapsed` s on the way to `wanted` at no more than `rate`, rad/s^2."""
    step = rate * max(elapsed, 0.0)
    return wanted if abs(wanted - speed) <= step else speed + math.copysign(step, wanted - speed)
