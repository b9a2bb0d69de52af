# SPDX-License-Identifier: Apache-2.0
"""
Log channels: quantities that a tool measures over time and that are shown and stored over depth.

A tool configuration declares its channels; tool and surface read the same declaration, so that a new channel needs no
code. A sample of a channel is a mean over an interval, with its sigma, and for a detector with a window also the means
by direction (sectors).
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.words import Word

GAMMA, BATTERY_VOLTAGE = "gamma", "battery_voltage"
#: Unit of a channel whose values are sums of bits, which are neither averaged nor assigned to a depth.
FLAGS = "flags"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
MOST_SECTORS = 16
# Bits of the quality, as in mwd_msgs/LogSample.
NO_TOOLFACE, INCOMPLETE, SATURATED, FROM_WORD, ONE_SIDED = 1, 2, 4, 8, 16
#: Shortest time from the end of an interval to the start of the word that carries its mean, s. The word carries the
#: newest interval that ended early enough; intervals end at whole seconds of the tool's clock.
SETTLE_S = 1.0


class ChannelSource(NamedTuple):
    """Source of a channel: unit of the values, stream of samples, and field of a sample that holds the value."""

    unit: str
    stream: str
    field: str


SOURCES = {
    GAMMA: ChannelSource("gAPI", "counts", "counts"),
    "inclination": ChannelSource("rad", "attitude", "inclination"),
    "temperature": ChannelSource("degC", "temperature", "temperature"),
    "lateral_vibration": ChannelSource("m/s^2", "dynamics", "lateral_rms"),
    "axial_vibration": ChannelSource("m/s^2", "dynamics", "axial_rms"),
    "rotary_speed": ChannelSource("rad/s", "dynamics", "rotary_speed"),
    "stick_slip": ChannelSource("", "dynamics", "stick_slip_index"),
    "shocks": ChannelSource("", "dynamics", "shocks"),
    "shock_peak": ChannelSource("m/s^2", "dynamics", "shock_peak"),
    BATTERY_VOLTAGE: ChannelSource("V", "status", "battery_voltage"),
    "battery_current": ChannelSource("A", "status", "battery_current"),
    "consumed_charge": ChannelSource("C", "status", "consumed_charge"),
    "run_time": ChannelSource("s", "status", "run_time"),
    "self_tests": ChannelSource(FLAGS, "status", "self_tests"),
    "failed_self_tests": ChannelSource(FLAGS, "status", "failed_self_tests"),
}


@dataclasses.dataclass(frozen=True)
class LogChannel:
    """Declaration of one log channel."""

    source: str = setting(GAMMA, "Quantity that the tool measures.", choices=tuple(SOURCES))
    interval_s: int = setting(
        10,
        "Length of the interval over which a value is averaged. A longer interval lowers the statistical error of "
        "counts and blurs thin beds: at 30 m/h, 10 s are 8 cm.",
        low=1,
        high=600,
    )
    sectors: int = setting(
        0, "Number of directions in which a gamma detector with a window is read; 0: none.", low=0, high=MOST_SECTORS
    )
    word: str = setting("", "Word that carries the value over the link; empty: the value is not sent.")
    sector_words: tuple[str, ...] = setting((), "Words that carry the sectors, the high side first, then clockwise.")
    tool_factor: float = setting(
        1.0, "API units of one count per second, for words in cps, from the calibration.", low=1e-3, high=1e3
    )
    sensor_to_bit_m: float | None = setting(
        None,
        "Distance of the sensor from the bit; none: the distance from the sonde to the bit. The surface uses this "
        "distance for "
        "values that were received as words.",
        low=0.0,
        high=100.0,
    )

    def __post_init__(self) -> None:
        """
        Check the sectors.

        Raises ValueError if there are 1 to 3 sectors, another source than gamma has sectors, or the number of sector
        words differs.
        """
        if self.sectors and (self.sectors < 4 or self.source != GAMMA):
            raise ValueError(f"sectors: must be 0, or 4 to {MOST_SECTORS} of a gamma detector, got {self.sectors}")
        if self.sector_words and len(self.sector_words) != self.sectors:
            raise ValueError(
                f"sector_words: {len(self.sector_words)} words for {self.sectors} sectors; name one of each"
            )

    @property
    def unit(self) -> str:
        """Unit of the channel's samples."""
        return SOURCES[self.source].unit

    @property
    def sensor_to_bit(self) -> float:
        """Distance of the sensor from the bit, m; NaN means the distance of the sonde from the bit."""
        return math.nan if self.sensor_to_bit_m is None else self.sensor_to_bit_m

    def factor(self, word_unit: str) -> float:
        """
        Return the factor from the unit of a word to the unit of the channel.

        Raises
        ------
        ValueError
            The unit of the word belongs to another quantity.
        """
        if self.source == GAMMA and word_unit == "cps":
            return self.tool_factor
        if meanings.si_unit(word_unit) != self.unit:
            raise ValueError(
                f"unit: {word_unit!r} of the word does not measure {self.source}, {self.unit or 'no unit'}"
            )
        return meanings.factor(word_unit)


#: Channels of a tool whose configuration declares none.
CHANNELS = {
    "gamma": LogChannel(sectors=8, word="Gama"),
    "inclination": LogChannel("inclination", word="RINC"),
    "temperature": LogChannel("temperature", word="Temp"),
    "lateral_vibration": LogChannel("lateral_vibration", word="LRMS"),
    "battery_voltage": LogChannel("battery_voltage", word="BatV"),
    "consumed_charge": LogChannel("consumed_charge", interval_s=60),
    "self_tests": LogChannel("self_tests", interval_s=60),
    "failed_self_tests": LogChannel("failed_self_tests", interval_s=60),
}


def is_channel_name(name: str) -> bool:
    """Return whether a channel may have this name, which files and protocols use for their columns."""
    return _NAME.fullmatch(name) is not None


def usual(words: Mapping[str, Word]) -> dict[str, LogChannel]:
    """
    Return the usual log channels (`CHANNELS`) of a tool with these words.

    A channel is not sent over the link if its word is missing in `words`, or has the unit of another quantity there.
    """
    found = {}
    for name, channel in CHANNELS.items():
        try:
            check({name: channel}, words)
        except ValueError:
            channel = dataclasses.replace(channel, word="")
        found[name] = channel
    return found


class Carried(NamedTuple):
    """Content of a word: name of the channel, its declaration, and the number of the sector (None: the total)."""

    name: str
    channel: LogChannel
    sector: int | None


def carried(channels: Mapping[str, LogChannel]) -> dict[str, Carried]:
    """
    Return the channel that each word carries, by the name of the word.

    Raises
    ------
    ValueError
        Two channels name the same word.
    """
    found: dict[str, Carried] = {}
    for name, channel in channels.items():
        words = [(channel.word, None), *((word, k) for k, word in enumerate(channel.sector_words))]
        for word, sector in words:
            if not word:
                continue
            if word in found:
                raise ValueError(f"channels.{name}: the word {word} already carries {found[word].name}; name another")
            found[word] = Carried(name, channel, sector)
    return found


def check(channels: Mapping[str, LogChannel], words: Mapping[str, Word]) -> None:
    """
    Check that the words of channels exist and measure their quantities.

    Raises
    ------
    ValueError
        A channel's name is not allowed (`is_channel_name`); or a word is not in the table, is named twice, or has a
        unit of another quantity.
    """
    for name in channels:
        if not is_channel_name(name):
            raise ValueError(
                f"channels.{name}: a name has up to 32 letters, digits and underscores and begins with a letter"
            )
    for word, item in carried(channels).items():
        if word not in words:
            raise ValueError(f"channels.{item.name}: no word {word} in the table of words; add it to `words`")
        try:
            item.channel.factor(words[word].unit)
        except ValueError as error:
            raise ValueError(f"channels.{item.name}: word {word}: {error}") from error


@dataclasses.dataclass(frozen=True, eq=False)
class LogSample(MessageRecord):
    """One sample of a log channel; fields as in mwd_msgs/LogSample."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/LogSample"

    stamp_ns: int
    channel: str
    unit: str
    duration: float
    span: float
    value: float
    sigma: float
    counts: float = math.nan
    sensor_to_bit: float = math.nan
    sectors: tuple[float, ...] = ()
    sigma_sectors: tuple[float, ...] = ()
    sector_durations: tuple[float, ...] = ()
    quality: int = 0
    source: str = ""
    link: str = ""
    frame_id: str = ""
