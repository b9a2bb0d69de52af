# SPDX-License-Identifier: Apache-2.0
"""
An example of a controller on this graph: brings the toolface to an angle and holds it there by turning the top drive.

It is here to show, and to test, that the graph can sit inside a control loop; a rig's own controller replaces it. It
steers by angle, sigma and age of `toolface` alone: no torque, no model of the string. Where any of them cannot be
trusted it gives no command, and what it last asked for ends by itself.
"""

from __future__ import annotations

import dataclasses
import math

HOLD, ROTATE, ORIENT = range(3)  # modes of RigCommand


@dataclasses.dataclass(frozen=True)
class Reading:
    """A toolface as it came: stamp, s of the measurement; received, s (steady clock); rad; sigma -1: not available."""

    stamp: float
    received: float
    mode: int
    angle: float
    sigma: float
    rotating: bool


@dataclasses.dataclass(frozen=True)
class Command:
    """As the RigCommand message."""

    mode: int
    turn: float = 0.0
    valid_for: float = 3.0


@dataclasses.dataclass(frozen=True)
class HoldSettings:
    """Gains are turns of the top drive, rad, for an error of the toolface of 1 rad."""

    wanted: float
    mode: int = 0
    period: float = 0.5  # s of the measurement between commands
    gain: float = 10.0
    integral: float = 0.04  # 1/s
    rate_gain: float = 8.0  # s
    most: float = 4.0  # rad; of what error and rate together wind up
    enough: float = 0.05  # rad/s towards the wanted angle
    step: float = 0.45  # rad; largest turn at once
    stale_after: float = 2.0  # s
    worst_sigma: float = math.radians(10.0)


class ToolfaceHold:
    """What to ask of the top drive now. `why` says in words why there is no command; empty while it steers."""

    def __init__(self, settings: HoldSettings) -> None:
        self.settings = settings
        self.why = "no toolface yet"
        self._acted = -math.inf
        self._last: Reading | None = None
        self._rate = 0.0
        self._wound = self._pull = 0.0

    def update(self, now: float, reading: Reading | None) -> Command | None:
        """The command for the newest reading, at most one a period; None: leave the top drive alone."""
        s = self.settings
        self.why = self._refuses(now, reading)
        if self.why or reading is None:
            # What was known of the string may no longer hold.
            self._last, self._wound, self._pull = None, 0.0, 0.0
            return None
        if reading.rotating:
            self._last = None
            if reading.stamp - self._acted < 1.0:
                return None
            self._acted = reading.stamp
            return Command(HOLD)
        if reading.stamp - self._acted < s.period:
            return None
        error = _turn(s.wanted - reading.angle)
        elapsed = s.period
        if self._last is not None:
            elapsed = min(max(reading.stamp - self._last.stamp, 1e-3), 4.0 * s.period)
            self._rate = _turn(reading.angle - self._last.angle) / elapsed
        else:
            self._rate = 0.0
        self._last, self._acted = reading, reading.stamp
        wanted = min(max(s.gain * error - s.rate_gain * self._rate, -s.most), s.most)
        if self._rate * error < s.enough * abs(error):
            # What stands or creeps needs more wind; what comes round by itself does not.
            self._pull += s.gain * s.integral * min(max(error, -1.0), 1.0) * elapsed
        turn = min(max(wanted + self._pull - self._wound, -s.step), s.step)
        self._wound += turn
        return Command(ORIENT, turn)

    def _refuses(self, now: float, reading: Reading | None) -> str:
        s = self.settings
        if reading is None:
            return "no toolface yet"
        if now - reading.received > s.stale_after:
            return f"the toolface is {now - reading.received:.1f} s old"
        if reading.mode != s.mode:
            return "the toolface is of the other kind"
        if not 0.0 <= reading.sigma <= s.worst_sigma:
            return "the toolface is not certain enough"
        return ""


def _turn(angle: float) -> float:
    return (angle + math.pi) % math.tau - math.pi
