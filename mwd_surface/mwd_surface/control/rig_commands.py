# SPDX-License-Identifier: Apache-2.0
"""
What is asked of the rig at present: set-points of top drive and pumps, their ramp and validity, and the commands due.

The rig gets each command once more every half second. Its numbers count what was asked: the same number again is no new
command, so that a turn is made once.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_surface.control.set_point import LeaseLimits, Mode, SetPoint, check, ramped

RIG_TIMEOUT = 2.0  # s; without a command for so long the rig reacts by itself
_REFRESH = 0.5  # s between repetitions of a command
_MOST_UNANSWERED = 100
# s of a ramp that one call may make up for. The surface calls ten times a second; a process that stood still must not
# ask in one step for what the string was to reach meanwhile.
_LONGEST_STEP = 0.2


@dataclasses.dataclass
class _Channel:
    """
    Top drive, or pumps.

    point: what is asked; None: the driller's. lapses: when its time is over. set: counts what was asked. key, number,
    sent_at: what the rig was sent last, under which number, and when.
    """

    point: SetPoint | None = None
    lapses: float = math.inf
    set: int = 0
    key: tuple[int, float] = (0, 0.0)
    number: int = 0
    sent_at: float = -math.inf


class RigCommands:
    """
    Commands to the rig.

    Parameters
    ----------
    returns : bool
        Whether a rotating rig that hears nothing more goes back to what the driller has set; otherwise it holds.
    """

    def __init__(self, *, returns: bool) -> None:
        self._returns = returns
        self._drive, self._pump = _Channel(), _Channel()
        self._speed = self._ramp_at = 0.0
        self._limits = LeaseLimits()
        self._sets = self._counter = 0
        self._unanswered: dict[int, int] = {}
        self._release_due = False

    @property
    def drive(self) -> SetPoint | None:
        """What is asked of the top drive; None: it is the driller's."""
        return self._drive.point

    @property
    def pump(self) -> SetPoint | None:
        """What is asked of the pumps; None: they are the driller's."""
        return self._pump.point

    @property
    def speed(self) -> float:
        """Speed asked of the top drive now, on its ramp, rad/s."""
        return self._speed if self.drive is not None and self.drive.mode == Mode.ROTATE else 0.0

    @property
    def active(self) -> bool:
        """True while anything is asked."""
        return self.drive is not None or self.pump is not None

    @property
    def rotating(self) -> bool:
        """True where the top drive is asked to rotate."""
        return self.drive is not None and self.drive.mode == Mode.ROTATE

    def limit(self, limits: LeaseLimits) -> None:
        """Set the limits in force; what is beyond them, or still on its ramp from beyond, goes back to the driller."""
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
        """Ask for a set-point that has been checked; achieved_speed: of the top drive, rad/s, where its ramp begins."""
        if point.mode == Mode.RELEASE:
            self.let_go()
        elif point.mode == Mode.PUMP:
            self._set(self._pump, point, now + point.valid_for)
        else:
            if point.mode == Mode.ROTATE and not self.rotating:
                # The driller's speed is where the ramp begins; a string that is held begins at rest.
                speed = achieved_speed if self.drive is None else 0.0
                self._speed = min(max(speed, -self._limits.left_speed), self._limits.speed)
                self._ramp_at = now
            self._set(self._drive, point, now + point.valid_for)

    def hear(self, now: float) -> None:
        """Accept a heartbeat: the set-points of top drive and pumps are valid for their full time again."""
        for channel in (self._drive, self._pump):
            if channel.point is not None and math.isfinite(channel.lapses):
                channel.lapses = now + channel.point.valid_for

    def hold(self) -> None:
        """Hold the string, without end."""
        self._set(self._drive, SetPoint(Mode.HOLD, 0, 1), math.inf)

    def keep(self) -> None:
        """Let what is asked of the top drive go on, without end."""
        self._drive.lapses = math.inf

    def let_go(self) -> None:
        """Give both back to the driller."""
        self._release_due = self._release_due or self.active
        self._drive.point = self._pump.point = None

    def stop_pump(self) -> None:
        """Give the pumps back to the driller."""
        if self.drive is None:
            self.let_go()
        # The rig ends a flow by itself that is not asked for again.
        self._pump.point = None

    def lapse(self, now: float) -> None:
        """End what is asked where its time is over."""
        drive = self.drive
        if drive is not None and now >= self._drive.lapses:
            if drive.mode == Mode.ROTATE and drive.returns:
                self.let_go()
            elif drive.mode != Mode.HOLD:
                self.hold()
        if self.pump is not None and now >= self._pump.lapses:
            self.stop_pump()

    def due(self, lease: int, sequence: int, now: float) -> list[SetPoint]:
        """Return the commands that the rig is to get now; sequence: of the controller's set-point in force."""
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
        """Return the controller's number behind a command that the rig answers; 0 where nobody waits for that."""
        return self._unanswered.pop(number, 0)

    def _set(self, channel: _Channel, point: SetPoint, lapses: float) -> None:
        self._sets += 1
        channel.point, channel.lapses, channel.set = point, lapses, self._sets

    def _number(self, sequence: int) -> int:
        self._counter += 1
        self._unanswered[self._counter] = sequence
        while len(self._unanswered) > _MOST_UNANSWERED:
            del self._unanswered[next(iter(self._unanswered))]
        return self._counter
