# SPDX-License-Identifier: Apache-2.0
"""
Commands to the rig: set-points of top drive and pumps, their ramp and validity, and the commands that are due.

Each command is repeated every half second with the same sequence number. The rig ignores a repeated number, so a turn
is made only once. A changed set-point gets a new number.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_surface.control.set_point import LeaseLimits, Mode, SetPoint, check, ramped

RIG_TIMEOUT = 2.0  # time without a command after which the rig reacts by itself, s
_REFRESH = 0.5  # time between repetitions of a command, s
_MOST_UNANSWERED = 100  # largest number of commands whose answer is still expected; older commands are forgotten
# Longest time step of a ramp, s. The surface calls `due` ten times per second. After a pause of the process the speed
# must not jump to the value that the ramp would have reached during the pause.
_LONGEST_STEP = 0.2


@dataclasses.dataclass
class _DriveChannel:
    """
    State of the top drive or of the pumps.

    point: set-point in force; None: the driller has control.
    lapses: end of its validity, steady time, s.
    set: counter of set-points.
    key, number, sent_at: content of the last command sent to the rig, its number, and its time, s.
    """

    point: SetPoint | None = None
    lapses: float = math.inf
    set: int = 0
    key: tuple[int, float] = (0, 0.0)
    number: int = 0
    sent_at: float = -math.inf


class RigCommands:
    """
    Commands to the rig and their timing.

    Parameters
    ----------
    returns : bool
        Whether a rotating top drive returns to the driller's settings when no further commands arrive; otherwise the
        rig holds the string.
    """

    def __init__(self, *, returns: bool) -> None:
        self._returns = returns
        self._drive, self._pump = _DriveChannel(), _DriveChannel()
        self._speed = self._ramp_at = 0.0
        self._limits = LeaseLimits()
        self._sets = self._counter = 0
        self._unanswered: dict[int, int] = {}
        self._release_due = False

    @property
    def drive(self) -> SetPoint | None:
        """Set-point of the top drive; None if the driller controls the top drive."""
        return self._drive.point

    @property
    def pump(self) -> SetPoint | None:
        """Set-point of the pumps; None if the driller controls the pumps."""
        return self._pump.point

    @property
    def speed(self) -> float:
        """Commanded speed of the top drive at this point of its ramp, rad/s; 0 unless rotation is commanded."""
        return self._speed if self.drive is not None and self.drive.mode == Mode.ROTATE else 0.0

    @property
    def active(self) -> bool:
        """Whether any set-point is in force."""
        return self.drive is not None or self.pump is not None

    @property
    def rotating(self) -> bool:
        """Whether the top drive is commanded to rotate."""
        return self.drive is not None and self.drive.mode == Mode.ROTATE

    def limit(self, limits: LeaseLimits) -> None:
        """Set the limits; if a set-point or the present speed of the ramp exceeds them, give control to the driller."""
        self._limits = limits
        if self.rotating and not -limits.left_speed <= self._speed <= limits.speed:
            self.let_go()
        for point in (self.drive, self.pump):
            if point is not None:
                try:
                    check(point, limits)
                except ValueError:
                    self.let_go()

    def take(self, point: SetPoint, achieved_speed: float, now: float) -> None:
        """Put a checked set-point into force; achieved_speed: present speed, rad/s, at which a ramp begins."""
        if point.mode == Mode.RELEASE:
            self.let_go()
        elif point.mode == Mode.PUMP:
            self._set(self._pump, point, now + point.valid_for)
        else:
            if point.mode == Mode.ROTATE and not self.rotating:
                # The ramp begins at the driller's speed; after holding, the string begins at rest.
                speed = achieved_speed if self.drive is None else 0.0
                self._speed = min(max(speed, -self._limits.left_speed), self._limits.speed)
                self._ramp_at = now
            self._set(self._drive, point, now + point.valid_for)

    def hear(self, now: float) -> None:
        """Process a heartbeat: restart the validity of both set-points, except of a set-point without a time limit."""
        for channel in (self._drive, self._pump):
            if channel.point is not None and math.isfinite(channel.lapses):
                channel.lapses = now + channel.point.valid_for

    def hold(self) -> None:
        """Command the top drive to hold the string, without a time limit."""
        self._set(self._drive, SetPoint(Mode.HOLD, 0, 1), math.inf)

    def keep(self) -> None:
        """Keep the set-point of the top drive without a time limit."""
        self._drive.lapses = math.inf

    def let_go(self) -> None:
        """Give top drive and pumps back to the driller."""
        self._release_due = self._release_due or self.active
        self._drive.point = self._pump.point = None

    def stop_pump(self) -> None:
        """
        Give the pumps back to the driller.

        If no set-point of the top drive is in force, give the top drive back too.
        """
        if self.drive is None:
            self.let_go()
        # The rig ends the commanded flow by itself when the command is no longer repeated.
        self._pump.point = None

    def lapse(self, now: float) -> None:
        """
        End the set-points whose validity is over.

        The top drive then holds the string, or is given back with the pumps if it rotates and the set-point has
        `returns`. Pumps are given back to the driller.
        """
        drive = self.drive
        if drive is not None and now >= self._drive.lapses:
            if drive.mode == Mode.ROTATE and drive.returns:
                self.let_go()
            elif drive.mode != Mode.HOLD:
                self.hold()
        if self.pump is not None and now >= self._pump.lapses:
            self.stop_pump()

    def due(self, lease: int, sequence: int, now: float) -> list[SetPoint]:
        """
        Return the commands to send to the rig now; sequence: number of the controller's set-point in force.

        A command is sent if it has changed, and repeated every `_REFRESH`. When the lease ends, one command RELEASE is
        sent alone.
        """
        if self._release_due:
            self._release_due = False
            return [SetPoint(Mode.RELEASE, lease, self._number(sequence), valid_for=RIG_TIMEOUT)]
        found = []
        for channel in (self._drive, self._pump):
            point = channel.point
            if point is None:
                continue
            if point.mode == Mode.ROTATE:
                step = min(now - self._ramp_at, _LONGEST_STEP)
                self._speed = ramped(self._speed, point.rotary_speed, self._limits.speed_rate, step)
                self._ramp_at = now
                point = dataclasses.replace(point, rotary_speed=self._speed, returns=self._returns)
            key = channel.set, point.rotary_speed
            if key == channel.key and now - channel.sent_at < _REFRESH:
                continue
            if key != channel.key:
                channel.key, channel.number = key, self._number(sequence)
            channel.sent_at = now
            found.append(dataclasses.replace(point, lease=lease, sequence=channel.number, valid_for=RIG_TIMEOUT))
        return found

    def answered(self, number: int) -> int:
        """
        Return the number of the controller's set-point that led to an answered command; 0 if no answer is expected.

        number: number of the command to the rig.
        """
        return self._unanswered.pop(number, 0)

    def _set(self, channel: _DriveChannel, point: SetPoint, lapses: float) -> None:
        self._sets += 1
        channel.point, channel.lapses, channel.set = point, lapses, self._sets

    def _number(self, sequence: int) -> int:
        self._counter += 1
        self._unanswered[self._counter] = sequence
        while len(self._unanswered) > _MOST_UNANSWERED:
            del self._unanswered[next(iter(self._unanswered))]
        return self._counter
