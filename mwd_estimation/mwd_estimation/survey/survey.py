# SPDX-License-Identifier: Apache-2.0
"""
A survey as a record: measurements and verdict of the estimator at one station.

Its fields are those of mwd_msgs/msg/Survey. Numbers are in SI and rad; an unknown number is NaN. The estimator makes
this record (`decided_survey`); every message, file, protocol and page is a view of it.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Any, ClassVar

from mwd_estimation.core.north import North
from mwd_estimation.core.reason_text import HYPOTHESES
from mwd_estimation.core.reference_field import Reference
from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.settings import Number
from mwd_sensors.core.unknown import or_none

Three = tuple[Number, Number, Number]
Nine = tuple[Number, Number, Number, Number, Number, Number, Number, Number, Number]
UNKNOWN_3: Three = (math.nan,) * 3
UNKNOWN_9: Nine = (math.nan,) * 9
# Kinds of a survey, with the numbers of mwd_msgs/msg/Survey: taken at rest, or while the string rotates.
STATIC, ROTARY = 0, 1
#: Field of a survey for each value of a `Reference`.
REFERENCE_FIELDS = {
    "total": "b_reference",
    "dip": "dip_reference",
    "declination": "declination",
    "convergence": "convergence",
    "gravity": "g_reference",
}


class Verdict(enum.IntEnum):
    """Automatic verdict, with the numbers of mwd_msgs/msg/Survey; only single quantities may be NOT_DETERMINED."""

    ACCEPT = 0
    DOUBTFUL = 1
    REJECT = 2
    NOT_DETERMINED = 3

    @property
    def word(self) -> str:
        """Text for people and files."""
        return self.name.lower().replace("_", " ")


RECEIVED_OVER = "received over "  #: beginning of the reason that names the links over which a survey came


@dataclasses.dataclass(frozen=True, eq=False)
class AzimuthEstimate(MessageRecord):
    """Azimuth by one method: rad from `north`, 1 sigma in rad, weight in the fused azimuth."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/AzimuthEstimate"

    method: str
    north: int = int(North.UNKNOWN)
    azimuth: Number = math.nan
    sigma: Number = math.nan
    weight: float = 0.0
    reason: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Survey(MessageRecord):
    """A station as measured and judged by the estimator; units as in Survey.msg, stamp in ns."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/Survey"

    stamp_ns: int
    uuid: str
    sequence: int
    inclination: float
    azimuth: Number
    north: int
    frame_id: str = "sonde_link"
    kind: int = STATIC
    requested: bool = False
    duration: float = 0.0
    samples: int = 0
    specific_force: Three = UNKNOWN_3
    specific_force_covariance: Nine = UNKNOWN_9
    magnetic_field: Three = UNKNOWN_3
    magnetic_field_covariance: Nine = UNKNOWN_9
    angular_rate: Three = UNKNOWN_3
    temperature: Number = math.nan
    gravity_toolface: Number = math.nan
    magnetic_toolface: Number = math.nan
    covariance: Nine = UNKNOWN_9
    azimuth_method: str = ""
    azimuths: tuple[AzimuthEstimate, ...] = ()
    g_total: Number = math.nan
    b_total: Number = math.nan
    dip: Number = math.nan
    g_reference: Number = math.nan
    b_reference: Number = math.nan
    dip_reference: Number = math.nan
    declination: Number = math.nan
    convergence: Number = math.nan
    reference_source: str = ""
    axial_interference: Number = math.nan
    sigma_axial_interference: Number = math.nan
    g_deviation: Number = math.nan
    b_deviation: Number = math.nan
    dip_deviation: Number = math.nan
    g_limit: Number = math.nan
    b_limit: Number = math.nan
    dip_limit: Number = math.nan
    verdict: int = int(Verdict.ACCEPT)
    verdict_inclination: int = int(Verdict.ACCEPT)
    verdict_azimuth: int = int(Verdict.ACCEPT)
    verdict_toolface: int = int(Verdict.ACCEPT)
    headline: str = ""
    reasons: tuple[str, ...] = ()
    alternatives: tuple[float, ...] = ()
    alternative_odds: tuple[float, ...] = ()
    hypotheses: tuple[str, ...] = ()
    hypothesis_odds: tuple[float, ...] = ()
    status: int = 0
    revision: int = 0
    withdrawn: bool = False

    @property
    def verdicts(self) -> tuple[str, str, str]:
        """Automatic verdicts of inclination, azimuth and toolface, in one word each."""
        given = (self.verdict_inclination, self.verdict_azimuth, self.verdict_toolface)
        return Verdict(given[0]).word, Verdict(given[1]).word, Verdict(given[2]).word

    @property
    def link(self) -> str:
        """Links over which the survey came; empty if it came directly from the tool."""
        named = [one.removeprefix(RECEIVED_OVER) for one in self.reasons if one.startswith(RECEIVED_OVER)]
        return named[-1] if named else ""

    @property
    def action(self) -> str:
        """Main reason to act; in older lists without a headline, the first reason of the verdict."""
        return self.headline or (self.reasons[0] if self.reasons and self.verdict != Verdict.ACCEPT else "")

    @property
    def disturbances(self) -> list[tuple[str, float]]:
        """Possible disturbances with their probabilities, most likely first; negligible ones are left out."""
        pairs = zip(self.hypotheses, self.hypothesis_odds, strict=True)
        known = sorted(((odds, name) for name, odds in pairs if odds >= 0.005), reverse=True)
        return [(HYPOTHESES.get(name, name), odds) for odds, name in known]

    def alternatives_from(self, north: North) -> list[tuple[float, float]]:
        """Return other azimuths that fit, rad, and their odds; if `north` is unknown, from the survey's own north."""
        pairs = zip(self.alternatives, self.alternative_odds, strict=True)
        turned = ((self.turned(azimuth, North(self.north), north), azimuth, odds) for azimuth, odds in pairs)
        return [(own % math.tau if found is None else found, odds) for found, own, odds in turned]

    @property
    def has_azimuth(self) -> bool:
        """Whether the survey has an azimuth from a known north."""
        return math.isfinite(self.azimuth) and self.north != North.UNKNOWN

    @property
    def has_readings(self) -> bool:
        """Whether the readings are known; false for an imported station with angles only."""
        return math.isfinite(self.g_total)

    @property
    def toolfaces(self) -> tuple[float | None, float | None]:
        """Gravity and magnetic toolface, rad; both None for a rotating tool, the second None without an azimuth."""
        if self.kind == ROTARY or not self.has_readings:
            return None, None
        return self.gravity_toolface, self.magnetic_toolface if self.has_azimuth else None

    @property
    def has_reference(self) -> bool:
        """Whether the reference field is known."""
        return math.isfinite(self.b_reference)

    @property
    def reference(self) -> Reference:
        """Reference with which the survey was judged."""
        values: dict[str, Any] = {name: or_none(getattr(self, field)) for name, field in REFERENCE_FIELDS.items()}
        return Reference(**values, source=self.reference_source)

    @property
    def sigma_inclination(self) -> float:
        """1 sigma of the inclination, rad."""
        return math.sqrt(self.covariance[0])

    @property
    def sigma_azimuth(self) -> float:
        """1 sigma of the azimuth, rad."""
        return math.sqrt(self.covariance[4])

    @property
    def sigma_toolface(self) -> float:
        """1 sigma of the gravity toolface, rad."""
        return math.sqrt(self.covariance[8])

    def azimuth_from(self, north: North) -> float | None:
        """Return the azimuth from a given north, rad in [0, 2 pi), or None if it cannot be converted; see `turned`."""
        return self.turned(self.azimuth, North(self.north), north) if self.has_azimuth else None

    def turned(self, azimuth: float, given: North, north: North) -> float | None:
        """
        Return an azimuth at this survey's place, converted from one north to another, rad in [0, 2 pi).

        None if not possible. True = magnetic + declination, grid = true - convergence. The declination needs a
        reference field.
        """
        if North.UNKNOWN in (given, north):
            return None
        if given == north:
            return azimuth % math.tau
        if North.MAGNETIC in (given, north) and not self.has_reference:
            return None
        to_true = {North.MAGNETIC: self.declination, North.TRUE: 0.0, North.GRID: self.convergence}
        before, after = to_true[given], to_true[north]
        turned = (azimuth + before - after) % math.tau
        return turned if math.isfinite(turned) else None
