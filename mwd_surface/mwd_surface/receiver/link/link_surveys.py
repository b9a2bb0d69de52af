# SPDX-License-Identifier: Apache-2.0
"""
One list of surveys from all links of a tool: none twice, each with the better word of every quantity.

Words of one survey that came over several links, or again over one, were taken in the same rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import SURVEY_S
from mwd_surface.receiver.link.link_survey import HeardSurvey, survey
from mwd_surface.receiver.words import LinkValue
from mwd_surface.surveys.survey_record import Survey

_OF_SURVEY = (meanings.INCLINATION, meanings.AZIMUTH, meanings.G_TOTAL, meanings.B_TOTAL, meanings.DIP)
_ANGLES = (meanings.AZIMUTH,)
_SPARE_S = 30.0
# Values rounded by two words differ by half a step of each at most; sigma is a step over the root of 12.
_HALF_STEPS = 0.5 * math.sqrt(12.0) * 1.01


@dataclasses.dataclass
class _Station:
    """What is known of the newest survey: its time, values and the link each came over, until when it waits."""

    heard: HeardSurvey
    values: dict[str, LinkValue]
    links: dict[str, str]
    until_ns: int
    published: frozenset[str] = frozenset()


class LinkSurveys:
    """
    Surveys of one tool, in order.

    Parameters
    ----------
    tools : sequence of ToolConfiguration
        Of each link. With several, a survey that lacks a word waits for the other links to bring it.
    reference : callable
        Field of the place at a stamp, ns; None where it is not configured.
    errors : SensorErrors, optional
        Of the tool code, where the tool sends no sigma.
    quality : QualitySettings, optional
        When a survey is accepted, as of the estimator.

    Attributes
    ----------
    quality : QualitySettings
        For surveys to come.
    """

    def __init__(
        self,
        tools: Sequence[ToolConfiguration],
        reference: Callable[[int], Reference | None],
        errors: SensorErrors | None = None,
        quality: QualitySettings | None = None,
    ) -> None:
        self._reference, self._errors = reference, errors
        self.quality = quality or QualitySettings()
        sent = {meanings.meaning_of(item.name) for tool in tools for items in tool.surveys for item in items}
        self._wanted = sent & set(_OF_SURVEY)
        longest = max(tool.transmit_delay_s + tool.head_s + 2.0 * _longest_s(tool) for tool in tools)
        self._wait_ns = round((longest + _SPARE_S) * NANOSECONDS) if len(tools) > 1 else 0
        self._station: _Station | None = None
        self._count = 0

    def take(self, heard: HeardSurvey, now_ns: int) -> list[Survey]:
        """Take the words of a pass, as of a stamp, ns; gives the surveys that are complete by it."""
        station, out = self._station, []
        if station is None or not _same(station, heard):
            out = self._ended(station)
            links = dict.fromkeys(heard.values, heard.link)
            station = self._station = _Station(heard, dict(heard.values), links, now_ns + self._wait_ns)
        else:
            for quantity, value in heard.values.items():
                if quantity not in station.values or _better(value, station.values[quantity], quantity):
                    station.values[quantity], station.links[quantity] = value, heard.link
            # What is sent again after a rest too short for a survey was taken in the rest before.
            if heard.at.half_s < station.heard.at.half_s and heard.at.in_rest_of(station.heard.at):
                station.heard = station.heard._replace(at=heard.at)
        return out + self.advance(now_ns)

    def advance(self, now_ns: int) -> list[Survey]:
        """Surveys that have waited long enough as of a stamp, ns."""
        station = self._station
        if station is None or (not self._wanted <= station.values.keys() and now_ns < station.until_ns):
            return []
        return self._ended(station)

    def finish(self) -> list[Survey]:
        """Give what waits when no more words come."""
        return self._ended(self._station)

    def _ended(self, station: _Station | None) -> list[Survey]:
        """Survey of a station, unless it was given and nothing that it needs has come since."""
        if station is None:
            return []
        known = frozenset(station.values.keys() & {meanings.INCLINATION, meanings.AZIMUTH})
        if meanings.INCLINATION not in known or known <= station.published:
            return []
        links = " and ".join(sorted(set(station.links.values())))
        at = station.heard.at
        reference = self._reference(at.stamp_ns)
        found = survey(station.values, at, self._count + 1, links, reference, self._errors, self.quality)
        if found is None:
            return []
        station.published = known
        self._count += 1
        return [found]


def _longest_s(tool: ToolConfiguration) -> float:
    return max(tool.seconds(items) for items in tool.surveys)


def _same(station: _Station, heard: HeardSurvey) -> bool:
    """
    Whether words are of the survey before.

    A tool takes a new survey in each rest that is long enough for one, and in a straight hole it may have the codes of
    the survey before: so words of two such rests are never one survey, however equal. Within a rest, over another link
    they are one; over the same link, where the tool sent again what may be a survey taken while the string moved, if
    they are equal in all that both have, an angle among it. The same holds where a rest is too short or not known; one
    that was not seen ended before the survey was sent.
    Totals hardly change from station to station: alike, they alone do not tell one survey from the next.
    """
    one, two = station.heard.at, heard.at
    same_rest = one.in_rest_of(two)
    if not same_rest and SURVEY_S <= 2.0 * two.half_s < math.inf:
        return False
    if same_rest and one.known and two.known and station.heard.link != heard.link:
        return True
    both = [name for name in _OF_SURVEY if name in station.values and name in heard.values]
    angles = {meanings.INCLINATION, meanings.AZIMUTH}.intersection(both)
    return (
        len(both) >= 2 and bool(angles) and all(_agree(station.values[name], heard.values[name], name) for name in both)
    )


def _agree(one: LinkValue, two: LinkValue, quantity: str) -> bool:
    """Whether two words can be of one value: the same code, or within the rounding of both where their steps differ."""
    if one.sigma == two.sigma:
        return one.raw == two.raw
    off = one.value - two.value
    if quantity in _ANGLES:
        off = math.remainder(off, math.tau)
    return abs(off) <= _HALF_STEPS * (one.sigma + two.sigma)


def _better(new: LinkValue, old: LinkValue, quantity: str) -> bool:
    """Whether a word is to be used in place of another: the finer one, or where they differ the surer one."""
    if _agree(new, old, quantity):
        return new.sigma < old.sigma
    return new.confidence > old.confidence
