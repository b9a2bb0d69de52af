# SPDX-License-Identifier: Apache-2.0
"""The rig during a downlink: its clock, and control of top drive and pumps under a lease of the control authority."""

from __future__ import annotations

import math

from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.set_point import Mode, SetPoint
from mwd_surface.control.status import ControlJudgement, ControlRequest, Permission, Sender

_NAME, _ROLE = "downlink", "command to the tool"
_SENDER = Sender("surface", _NAME)
_PRIORITY = 100  # priority of the request for control, 0 to 255; owners with a lower priority lose control
_VALID_S = 5.0  # if the surface stops, the rig returns to the driller's settings after this time, s
_SILENT_S = 2.0  # time without data after which the rig is silent, s


class RigControl:
    """Controller of the rig for the downlink."""

    def __init__(self, authority: ControlAuthority) -> None:
        self._authority = authority
        self._lease = self._sequence = 0

    @property
    def has(self) -> bool:
        """Whether the downlink got a lease and has not released it, even if the authority has ended the lease."""
        return self._lease > 0

    def why_not(self, now: float) -> str:
        """
        Return the reason why the rig refuses set-points of the downlink, or would refuse them; empty if it does not.

        now: steady time, s.
        """
        status = self._authority.status(now)
        if not status.enabled:
            return "the rig does not accept set-points: set control.enabled when the rig can accept them"
        if self.has and status.lease != self._lease:
            return f"control was taken away: {status.reason or status.owner}"
        if not self.has and status.owner and status.priority >= _PRIORITY:
            return f"{status.owner} has control of the rig"
        return ""

    def take(self, granted_by: str, now: float) -> str:
        """
        Take control of the rig; return why this failed, or an empty string.

        granted_by: name of the person who granted the downlink; this grant includes control of the rig.
        """
        decision = self._authority.request(ControlRequest(_SENDER, _NAME, _ROLE, _PRIORITY), now)
        if decision.permission == Permission.PENDING:
            done, message = self._authority.judge(
                ControlJudgement.GRANT, granted_by, now, "for the downlink", decision.lease
            )
            if not done:
                return message
        elif decision.permission == Permission.DENIED:
            return decision.message
        self._lease, self._sequence = decision.lease, 0
        return ""

    def ask(self, rotation: bool, value: float, now: float) -> str:
        """Command a rotary speed, rad/s, or a flow, m^3/s; return why it was refused, or an empty string."""
        self._sequence += 1
        point = SetPoint(
            Mode.ROTATE if rotation else Mode.PUMP,
            self._lease,
            self._sequence,
            rotary_speed=value if rotation else 0.0,
            flow_rate=0.0 if rotation else value,
            valid_for=_VALID_S,
            returns=True,
        )
        taken, message = self._authority.command(point, now, _SENDER)
        return "" if taken else message

    def release(self, now: float, reason: str) -> None:
        """Give the rig back to the driller; does nothing without a lease."""
        if self.has:
            self._authority.release(self._lease, now, _SENDER, reason)
            self._lease = 0


class RigClock:
    """
    Clock that follows the time of the rig's data, s; when the data are late, it continues with a steady clock.

    The clock goes back only if the rig reports a time that is more than five seconds earlier.
    """

    def __init__(self) -> None:
        self._rig = self._steady = -math.inf
        self._given = -math.inf

    def take(self, rig: float, steady: float) -> float:
        """
        Add a time of the rig that arrived at a steady time, both s; return the time in force, s.

        The time in force is the latest time of the rig so far. If the rig's time is more than 5 s before it, the
        clock begins again with the rig's time.
        """
        if rig < self._given - 5.0:
            self._given = -math.inf
        self._rig, self._steady = rig, steady
        self._given = max(self._given, rig)
        return self._given

    def now(self, steady: float, otherwise: float) -> float:
        """Return the time of the rig at a steady time, s; otherwise: value to return before the first data."""
        if math.isinf(self._rig):
            return otherwise
        late = steady - self._steady
        # Continue the time by the steady clock only if data are late, because the time of a rig that is simulated
        # faster than real time runs ahead of the steady clock.
        self._given = max(self._given, self._rig + (late if late > _SILENT_S else 0.0))
        return self._given

    def silent(self, steady: float) -> bool:
        """Return whether the rig has sent no data in the last two seconds; steady: steady time, s."""
        return steady - self._steady > _SILENT_S
