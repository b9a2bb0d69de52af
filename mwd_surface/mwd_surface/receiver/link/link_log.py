# SPDX-License-Identifier: Apache-2.0
"""Samples of the log channels from the words that carry them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.log_channels import (
    BATTERY_VOLTAGE,
    FROM_WORD,
    GAMMA,
    SETTLE_S,
    Carried,
    LogSample,
    carried,
)
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link_survey import HeardSurvey
from mwd_surface.receiver.words import ReceivedWord

# The tool's mean ends at a whole second of its clock, SETTLE_S to SETTLE_S + 1 s before the word begins.
_ENDED_S = SETTLE_S + 0.5


def log_samples(
    words: Iterable[ReceivedWord], tool: ToolConfiguration, stamp_of: Callable[[float], int]
) -> Iterator[LogSample]:
    """
    Yield the log samples in the final, usable words, except those that `survey_samples` yields.

    Parameters
    ----------
    stamp_of : callable
        Returns the stamp, ns, at which the tool sent the signal that the surface received at a time, s.
    """
    by_word = carried(tool.logged)
    for word in words:
        item = by_word.get(word.name)
        if item is None or not word.revision or not word.usable or not math.isfinite(word.value):
            continue
        if item.channel.source == BATTERY_VOLTAGE and word.value <= 0.0:
            # A tool that sends has a voltage: many tools send 0 for a missing measurement.
            continue
        # A word with a meaning of its own carries a momentary value. If it belongs to a survey, the value has the time
        # of the survey, and `survey_samples` yields it.
        running = not meanings.meaning_of(word.name)
        if running or word.kind == "toolface":
            yield _sample(word, item, stamp_of(word.start_s), link=tool.link, running=running)


def survey_samples(heard: HeardSurvey, tool: ToolConfiguration) -> Iterator[LogSample]:
    """Yield the samples of the channels whose words came with a survey; they have the time of the survey."""
    for word, item in carried(tool.logged).items():
        found = heard.values.get(meanings.meaning_of(word))
        if found is not None:
            yield LogSample(
                heard.at.stamp_ns,
                item.name,
                item.channel.unit,
                0.0,
                0.0,
                found.value,
                found.sigma,
                sensor_to_bit=item.channel.sensor_to_bit,
                quality=FROM_WORD,
                source=item.channel.source,
                link=tool.link,
            )


def _sample(word: ReceivedWord, item: Carried, sent_ns: int, *, link: str, running: bool) -> LogSample:
    channel, factor = item.channel, item.channel.factor(word.unit)
    span = float(channel.interval_s) if running else 0.0
    stamp_ns = sent_ns - round((_ENDED_S + 0.5 * span) * NANOSECONDS) if running else sent_ns
    value, sigma = word.value * factor, word.sigma * factor
    if running and channel.source == GAMMA:
        # The tool does not send the error of its counts; it follows from their number.
        seconds = span if item.sector is None else span / channel.sectors
        counts = max(value, 0.0) / channel.tool_factor * seconds
        sigma = math.hypot(sigma, channel.tool_factor * math.sqrt(counts + 0.5) / seconds)
    seen = [k == item.sector for k in range(channel.sectors)]
    whole = item.sector is None
    return LogSample(
        stamp_ns,
        item.name,
        channel.unit,
        span,
        span,
        value if whole else math.nan,
        sigma if whole else math.nan,
        sensor_to_bit=channel.sensor_to_bit,
        quality=FROM_WORD,
        source=channel.source,
        link=link,
        sectors=tuple(value if one else math.nan for one in seen),
        sigma_sectors=tuple(sigma if one else math.nan for one in seen),
        sector_durations=tuple(span / channel.sectors if one else 0.0 for one in seen),
    )
