# SPDX-License-Identifier: Apache-2.0
"""
Merge of the surveys of all links of a tool: each survey once, and each quantity from its better word.

Words that arrive over several links, or again over one link, belong to one survey if they were taken during the
same time at rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.flow_spans import SURVEY_S
from mwd_surface.receiver.link.link_survey import HeardSurvey, survey
from mwd_surface.receiver.words import LinkValue

_OF_SURVEY = (meanings.INCLINATION, meanings.AZIMUTH, meanings.G_TOTAL, meanings.B_TOTAL, meanings.DIP)
_SPARE_S = 30.0  # time in addition to the slowest link for which a survey waits for more words, s
# Largest difference of two words that may be roundings of one value, as a multiple of the sum of their sigmas: half a
# step of each word. The sigma of a word is its step over sqrt(12).
_HALF_STEPS = 0.5 * math.sqrt(12.0) * 1.01


@dataclasses.dataclass
class _LinkStation:
    """
    Newest survey: its received words, its values, and the link from which each value comes.

    until_ns: stamp until which the survey waits for more words; published: names of the angles already returned.
    """

    heard: HeardSurvey
    values: dict[str, LinkValue]
    links: dict[str, str]
    until_ns: int
    published: frozenset[str] = frozenset()


class LinkSurveys:
    """
    Surveys of one tool, in order of time.

    Parameters
    ----------
    tools : sequence of ToolConfiguration
        Configuration of each link. With several links, a survey that lacks a word waits for another link to bring it.
    reference : callable
        Returns the reference field at a stamp, ns, or None if no reference is configured.
    errors : SensorErrors, optional
        Errors of the tool code, used where the tool sends no sigma.
    quality : QualitySettings, optional
        Acceptance limits of a survey, the same as the estimator's.

    Attributes
    ----------
    quality : QualitySettings
        Acceptance limits of the surveys to come.
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
        self._station: _LinkStation | None = None
        self._count = 0

    def take(self, heard: HeardSurvey, now_ns: int) -> list[Survey]:
        """Add the words of one frame, all received until the stamp `now_ns`, ns; return the surveys now complete."""
        station, out = self._station, []
        if station is None or not _same(station, heard):
            out = self._ended(station)
            links = dict.fromkeys(heard.values, heard.link)
            station = self._station = _LinkStation(heard, dict(heard.values), links, now_ns + self._wait_ns)
        else:
            for quantity, value in heard.values.items():
                if quantity not in station.values or _better(value, station.values[quantity], quantity):
                    station.values[quantity], station.links[quantity] = value, heard.link
            # Words sent again after a time at rest too short for a survey belong to the survey before.
            if heard.at.half_s < station.heard.at.half_s and heard.at.in_rest_of(station.heard.at):
                station.heard = station.heard._replace(at=heard.at)
        return out + self.advance(now_ns)

    def advance(self, now_ns: int) -> list[Survey]:
        """Return a list with the present survey if it is complete, or has waited long enough at a stamp, ns."""
        station = self._station
        if station is None or (not self._wanted <= station.values.keys() and now_ns < station.until_ns):
            return []
        return self._ended(station)

    def finish(self) -> list[Survey]:
        """Return a list with the survey that still waits when no more words come."""
        return self._ended(self._station)

    def _ended(self, station: _LinkStation | None) -> list[Survey]:
        """
        Return a list with the survey of a station.

        The list is empty without an inclination, and if the survey was returned before and no angle has come since.
        """
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


def _same(station: _LinkStation, heard: HeardSurvey) -> bool:
    """
    Return whether received words belong to the survey of a station.

    - A tool takes a new survey in each time at rest that is long enough. In a straight hole the new survey may have the
      same codes as the survey before, so words from two long times at rest never belong to one survey.
    - Words from one time at rest over different links belong to one survey.
    - Words from one time at rest over the same link, or from times at rest that are too short or unknown, belong to one
      survey if they agree in every quantity that both have, and if one of these quantities is an angle. Otherwise the
      tool may have sent a second survey, taken while the string moved. A time at rest that was not seen ended before
      the survey was sent.
    - Equal totals alone are not enough, because totals hardly change from station to station.
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
    """Return whether two words may have the same value: equal codes, or equal within rounding if their steps differ."""
    if one.sigma == two.sigma:
        return one.raw == two.raw
    off = one.value - two.value
    if quantity == meanings.AZIMUTH:
        off = math.remainder(off, math.tau)
    return abs(off) <= _HALF_STEPS * (one.sigma + two.sigma)


def _better(new: LinkValue, old: LinkValue, quantity: str) -> bool:
    """Return whether `new` should replace `old`: if they agree, by its smaller sigma, else by its higher confidence."""
    if _agree(new, old, quantity):
        return new.sigma < old.sigma
    return new.confidence > old.confidence
