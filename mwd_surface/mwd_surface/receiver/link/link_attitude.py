# SPDX-License-Identifier: Apache-2.0
"""
Attitude between the words of a link: the newest word of each angle, with a sigma that grows with its age.

sigma^2 = word^2 + tool^2 + (rate age)^2. A toolface is withheld above a set age and while the string rotates. Where
the top drive reports its angle, the toolface follows that angle with a lag. Friction at the wall opposes the motion of
the pipe, so a string that slides along the hole yields to torsion like a viscous damper, at the rate stiffness x speed
x wind-up / (friction x pipe radius). The lag is therefore a drilled length, not a time.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry import meanings
from mwd_surface.receiver.link.link_survey import north_of
from mwd_surface.receiver.words import LinkValue, ReceivedWord, value_of


@dataclasses.dataclass(frozen=True)
class AgeRules:
    """Settings for the largest age of values received over a link, and for the growth of their sigmas with age."""

    toolface_max_age_s: float = setting(
        120.0,
        "Age above which a toolface is not shown or used. Raising it bridges longer losses of signal and shows older "
        "angles. Without a toolface, a toolface controller stops.",
        unit="s",
        low=1.0,
        high=3600.0,
    )
    toolface_rate_deg_s: float = setting(
        0.15,
        "1 sigma of the rate of change of the toolface while sliding. Raise it for a motor whose reactive torque "
        "varies.",
        unit="deg/s",
        low=0.0,
        high=90.0,
    )
    toolface_sigma_deg: float = setting(
        2.0,
        "1 sigma of the toolface as the tool measures it, combined with the rounding of the transmitted word.",
        unit="deg",
        low=0.0,
        high=45.0,
    )
    quill_share: float = setting(
        0.2,
        "1 sigma of the difference between a turn of the top drive and the turn of the tool, as a share of the turn. "
        "Raise it in a hole with much friction.",
        low=0.0,
        high=1.0,
    )
    quill_lag_m: float = setting(
        0.3,
        "Hole drilled until 63 % of a turn of the top drive has reached the tool: friction torque on the wall times "
        "the radius of the pipe, over the torsional stiffness of the string. Raise it in a long hole with much "
        "friction. With 0 the tool turns at once.",
        unit="m",
        low=0.0,
        high=20.0,
    )
    inclination_sigma_deg: float = setting(
        0.25,
        "1 sigma of the tool's inclination, combined with the rounding, if the tool does not send its sigma (word "
        "sInc).",
        unit="deg",
        low=0.0,
        high=10.0,
    )
    azimuth_sigma_deg: float = setting(
        1.0,
        "1 sigma of the tool's azimuth, combined with the rounding, if the tool does not send its sigma (word sAzm).",
        unit="deg",
        low=0.0,
        high=90.0,
    )
    angle_rate_deg_s: float = setting(
        0.002,
        "1 sigma of the rate of change of inclination and azimuth while drilling. Raise it for a fast, strongly curved "
        "hole.",
        unit="deg/s",
        low=0.0,
        high=10.0,
        expert=True,
    )
    vertical_deg: float = setting(
        3.0,
        "Inclination below which the automatic toolface is magnetic. Use the tool's `attitude.vertical_deg`.",
        unit="deg",
        low=0.5,
        high=20.0,
    )


# Quantities of each angle, and the quantity in which the tool sends the sigma of that angle.
_ANGLES = {
    "inclination": ((meanings.CONTINUOUS_INCLINATION, meanings.INCLINATION), meanings.SIGMA_INCLINATION),
    "azimuth": ((meanings.CONTINUOUS_AZIMUTH, meanings.AZIMUTH), meanings.SIGMA_AZIMUTH),
}
_PIPE_RADIUS_M = 0.1  # radius at which the pipe touches the wall (tool joints), m
_TOOLFACES = ("gravity_toolface", "magnetic_toolface")


class LinkAttitude:
    """Attitude from the newest words of a link, as samples of `wire.ATTITUDE`."""

    def __init__(self, rules: AgeRules) -> None:
        self._rules = rules
        self._newest: dict[str, tuple[LinkValue, int, int]] = {}
        # Time, angle of the top drive, and the part of that angle that has reached the end of the string.
        self._quill: deque[tuple[float, float, float]] = deque(maxlen=4096)
        # Time and angle of the top drive that do not follow the newest ones and are not confirmed yet.
        self._earlier: tuple[float, float] | None = None
        #: Speed of the string along the hole, m/s; None if unknown, and then the tool is assumed to follow the top
        #: drive without delay.
        self.speed: float | None = None
        self.travel_s = 0.0  #: travel time of a word to the surface
        #: `rotating`: whether the string rotates.
        #: `in_slips`: whether the string hangs in the slips.
        self.rotating = self.in_slips = False

    def take(self, word: ReceivedWord) -> None:
        """
        Store a usable word, provisional or final, unless a later one of the same quantity is stored.

        An erased word removes the stored word with the same frame and index, which is its provisional form.
        """
        quantity = meanings.meaning_of(word.name)
        if not quantity:
            return
        held = self._newest.get(quantity)
        if word.usable:
            if held is None or word.start_s >= held[0].start_s:
                self._newest[quantity] = (value_of(word), word.frame, word.index)
        elif held is not None and held[1:] == (word.frame, word.index):
            del self._newest[quantity]

    def take_quill(self, at_s: float, angle: float) -> None:
        """
        Store the angle of the top drive, rad, at a time on the clock of the pressure, s.

        A time that does not rise is dropped. If the next time does not rise either, but follows the dropped one, the
        clock was wrong before: the stored times after the dropped one are removed.
        """
        if self._quill and at_s <= self._quill[-1][0]:
            earlier, self._earlier = self._earlier, (at_s, angle)
            if earlier is None or at_s <= earlier[0]:
                return
            while self._quill and self._quill[-1][0] >= earlier[0]:
                self._quill.pop()
            self._earlier = None
            self.take_quill(*earlier)
        self._earlier = None
        if not self._quill:
            self._quill.append((at_s, angle, angle))
            return
        before, _, end = self._quill[-1]
        lag = self._rules.quill_lag_m
        drilled = math.inf if self.speed is None else max(self.speed, 0.0) * (at_s - before)
        wound = (angle - end) * math.exp(-drilled / lag) if lag > 0.0 else 0.0
        # Friction holds the wind-up up to a limit; a larger wind-up turns the end of the string with the top drive.
        most = lag / _PIPE_RADIUS_M
        self._quill.append((at_s, angle, angle - min(max(wound, -most), most)))

    def toolface_age(self, now_s: float) -> float:
        """Return the age of the newest toolface, s; NaN if there is none."""
        found = self._toolface()
        return math.nan if found is None else self._age(found[1], now_s)

    def angle_age(self, name: str, now_s: float) -> float:
        """Return the age of the newest word of inclination or azimuth (`name`), s; NaN if there is none."""
        newest = self._angle_word(_ANGLES[name][0])
        return math.nan if newest is None else self._age(newest, now_s)

    def sample(self, now_s: float, stamp_ns: int, reference: Reference | None) -> Samples:
        """
        Return the present attitude, one row of `wire.ATTITUDE`.

        now_s: time on the clock of the pressure; stamp_ns: the stamp of the same moment. reference: field that converts
        magnetic azimuths to another north.
        """
        row = wire.ATTITUDE.empty(1)
        row["stamp_ns"] = stamp_ns
        north, turn = north_of(reference)
        row["north"] = int(north)
        status = self._motion()
        of_tool = {"inclination": self._rules.inclination_sigma_deg, "azimuth": self._rules.azimuth_sigma_deg}
        for name, (quantities, sent) in _ANGLES.items():
            tool = self._newest[sent][0].value if sent in self._newest else math.radians(of_tool[name])
            value, sigma = self._angle(quantities, tool, now_s)
            row[name] = (value + turn) % math.tau if name == "azimuth" else value
            row["sigma_" + name] = sigma
        for name in _TOOLFACES:
            row[name] = row["sigma_" + name] = math.nan
        found = self._toolface()
        vertical = self._near_vertical(row)
        if vertical:
            status |= Status.NEAR_VERTICAL
        if found is not None and not self.rotating:
            quantity, newest = found
            angle, sigma = self._predicted(newest, now_s)
            magnetic = quantity == meanings.MAGNETIC_TOOLFACE or (quantity == meanings.TOOLFACE and vertical)
            name = "magnetic_toolface" if magnetic else "gravity_toolface"
            if self._age(newest, now_s) <= self._rules.toolface_max_age_s:
                row[name] = (angle + turn if magnetic else angle) % math.tau
                row["sigma_" + name] = sigma
        row["status"] = int(status)
        return row

    def _near_vertical(self, row: Samples) -> bool:
        return float(row["inclination"][0]) < math.radians(self._rules.vertical_deg)

    def _angle(self, quantities: tuple[str, ...], tool_sigma: float, now_s: float) -> tuple[float, float]:
        newest = self._angle_word(quantities)
        if newest is None:
            return math.nan, math.nan
        grown = math.radians(self._rules.angle_rate_deg_s) * self._age(newest, now_s)
        return newest.value, min(math.hypot(newest.sigma, tool_sigma, grown), math.pi)

    def _angle_word(self, quantities: tuple[str, ...]) -> LinkValue | None:
        found = [self._newest[quantity][0] for quantity in quantities if quantity in self._newest]
        return max(found, key=lambda one: one.start_s) if found else None

    def _motion(self) -> Status:
        """
        Return the motion of the string from rig data: rotating, still in the slips, or sliding.

        Sliding requires motion along the hole. Return Status(0) if none of these is known.
        """
        if self.rotating:
            return Status.ROTATING
        if self.in_slips:
            return Status.STILL
        return Status.SLIDING if self.speed else Status(0)

    def _toolface(self) -> tuple[str, LinkValue] | None:
        found = [(name, self._newest[name][0]) for name in meanings.TOOLFACES if name in self._newest]
        return max(found, key=lambda one: one[1].start_s) if found else None

    def _predicted(self, value: LinkValue, now_s: float) -> tuple[float, float]:
        """
        Return the present toolface and its sigma, rad.

        The received toolface is turned by the motion of the top drive that has reached the end of the string since.
        """
        rules, age = self._rules, self._age(value, now_s)
        (drive, end), (drive_then, end_then) = self._quill_at(now_s), self._quill_at(now_s - age)
        grown = math.radians(rules.toolface_rate_deg_s) * age
        unsure = rules.quill_share * (drive - drive_then)
        sigma = math.hypot(value.sigma, math.radians(rules.toolface_sigma_deg), grown, unsure)
        return value.value + end - end_then, min(sigma, math.pi)

    def _quill_at(self, at_s: float) -> tuple[float, float]:
        """
        Return the angle of the top drive and the angle that has reached the end of the string, rad, by interpolation.

        Both are 0 if the top drive has reported no angle.
        """
        if not self._quill:
            return 0.0, 0.0
        times, drive, end = zip(*self._quill, strict=True)
        return float(np.interp(at_s, times, drive)), float(np.interp(at_s, times, end))

    def _age(self, value: LinkValue, now_s: float) -> float:
        return max(now_s - (value.start_s - self.travel_s), 0.0)


def best(rows: Sequence[Samples]) -> Samples:
    """
    Return the merged attitude of several links at the same moment: each angle from the link with the smallest sigma.

    rows: at least one, each one row of `wire.ATTITUDE`. Both toolfaces, gravity and magnetic, and the status come from
    the same link.
    """
    row = rows[0].copy()
    for name in ("inclination", "azimuth"):
        one = _surest(rows, (name,))
        row[name], row["sigma_" + name] = one[name], one["sigma_" + name]
    one = _surest(rows, _TOOLFACES)
    for name in _TOOLFACES:
        row[name], row["sigma_" + name] = one[name], one["sigma_" + name]
    row["status"] = one["status"]
    return row


def _surest(rows: Sequence[Samples], names: Sequence[str]) -> Samples:
    """Return the row in which one of the named angles has the smallest sigma; NaN counts as the largest sigma."""
    sigmas = np.array([[float(row["sigma_" + name][0]) for name in names] for row in rows])
    return rows[int(np.argmin(np.nan_to_num(sigmas, nan=math.inf).min(axis=1)))]
