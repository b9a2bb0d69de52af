# SPDX-License-Identifier: Apache-2.0
"""State of the telemetry link for page and rig interfaces: words of the last survey, received frames, quality."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import deque
from collections.abc import Mapping
from typing import ClassVar

from mwd_sensors.core.message_record import MessageRecord
from mwd_surface.live.pressure_picture import PressurePicture


class LinkHealth(enum.IntEnum):
    """State of a link, as in mwd_msgs/LinkQuality."""

    NO_INPUT = 0
    NO_FLOW = 1
    SEARCHING = 2
    LOCKED = 3
    DOUBTFUL = 4


class WordStatus(enum.IntEnum):
    """Reliability of a received word, with the numbers of mwd_msgs/LinkWord."""

    BELIEVED = 0
    ERASED = 1
    BY_CONSISTENCY = 2


class LinkSequence(enum.IntEnum):
    """Sequence to which a word belongs, as in mwd_msgs/LinkWord."""

    SURVEY = 2
    TOOLFACE = 3


NO_INPUT, NO_FLOW, SEARCHING, LOCKED, DOUBTFUL = LinkHealth
SURVEY, TOOLFACE = LinkSequence
_FRAMES, _WORDS = 20, 40  # largest numbers of frames and of words that are kept for the page


@dataclasses.dataclass(frozen=True, eq=False)
class LinkWordState(MessageRecord):
    """A received word, with the fields of mwd_msgs/LinkWord; start_ns and stamp_ns: begin and end of transmission."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/LinkWord"

    name: str
    value: float
    sigma: float
    unit: str
    confidence: float
    status: WordStatus
    kind: LinkSequence
    frame: int
    place: int
    revision: int
    start_ns: int
    stamp_ns: int
    pulses: tuple[float, ...] = ()
    alternatives: tuple[int, ...] = ()
    alternative_odds: tuple[float, ...] = ()

    @property
    def final(self) -> bool:
        """Whether the word is final: all parities of its frame have been used."""
        return self.revision > 0


@dataclasses.dataclass(frozen=True, eq=False)
class LinkFrameState(MessageRecord):
    """
    One pass of a sequence (all its words sent once), with the fields of mwd_msgs/LinkFrame.

    reason: cause if the pass was cut off, else empty.
    """

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/LinkFrame"

    kind: LinkSequence
    frame: int
    words: int
    believed: int
    ebn0_db: float
    start_ns: int
    stamp_ns: int
    reason: str


@dataclasses.dataclass(frozen=True, eq=False)
class LinkStatus(MessageRecord):
    """
    State of a link, with the fields of mwd_msgs/LinkQuality, and the words received over it.

    Attributes
    ----------
    at : float
        Time of arrival of this state, s of the steady clock.
    survey : tuple of LinkWordState
        Words of the newest survey, in the order of the sequence.
    frames : tuple of LinkFrameState
        Last passes of sequences, newest last.
    words : tuple of LinkWordState
        Last words, newest last.
    picture : PressurePicture or None
        Standpipe pressure; None if it is not received.
    strokes : tuple of float
        Stroke rate of each running pump, Hz.
    others : tuple of LinkStatus
        States of the other links, in order of their names.
    """

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/LinkQuality"
    NOT_SENT: ClassVar[frozenset[str]] = frozenset({"at", "strokes", "picture", "survey", "frames", "words", "others"})

    link: str
    state: LinkHealth
    reason: str
    ebn0_db: float
    margin_db: float
    clock_error: float
    word_error: float
    goodput: float
    mode: str
    words_done: int
    words_expected: int
    toolface_age: float
    survey_age: float
    inclination_age: float
    azimuth_age: float
    stamp_ns: int
    at: float = math.nan
    strokes: tuple[float, ...] = ()
    picture: PressurePicture | None = None
    survey: tuple[LinkWordState, ...] = ()
    frames: tuple[LinkFrameState, ...] = ()
    words: tuple[LinkWordState, ...] = ()
    others: tuple[LinkStatus, ...] = ()

    @property
    def name(self) -> str:
        """Name of the link in words."""
        return self.link.replace("_", " ")


class LinkCollector:
    """Collector of the words and frames (passes of a sequence) that arrive over one link."""

    def __init__(self) -> None:
        self._survey: dict[int, LinkWordState] = {}
        self._survey_frame = -1
        self._words: dict[tuple[int, int], LinkWordState] = {}
        self._frames: deque[LinkFrameState] = deque(maxlen=_FRAMES)

    def on_word(self, word: LinkWordState) -> None:
        """Accept a word, provisional or final; a newer revision of a word replaces the older one."""
        if word.kind == SURVEY:
            if word.frame != self._survey_frame:
                self._survey, self._survey_frame = {}, word.frame
            self._survey[word.place] = word
        self._words.pop((word.frame, word.place), None)
        self._words[word.frame, word.place] = word
        for key in list(self._words)[:-_WORDS]:
            del self._words[key]

    def on_frame(self, frame: LinkFrameState) -> None:
        """Add a received frame: one pass of a sequence, in which all its words are sent once."""
        self._frames.append(frame)

    def status(self, quality: LinkStatus) -> LinkStatus:
        """Return the state of the link with the words and frames received so far."""
        return dataclasses.replace(
            quality,
            survey=tuple(self._survey[place] for place in sorted(self._survey)),
            frames=tuple(self._frames),
            words=tuple(sorted(self._words.values(), key=lambda word: word.stamp_ns)),
        )


# States from best to worst: words arrive, some words arrive, words may arrive, the tool is silent, no input.
_ORDER = (LOCKED, DOUBTFUL, SEARCHING, NO_FLOW, NO_INPUT)


def best_link(links: Mapping[str, LinkStatus], shown: str = "") -> str:
    """
    Return the name of the link to show: the link with the best state or, between equal states, the newest toolface.

    shown is the name of the link shown so far. It stays until another link has a better state, or an equal state and a
    toolface less than half as old.
    """

    def rank(name: str) -> tuple[int, float]:
        age = links[name].toolface_age
        return _ORDER.index(links[name].state), math.inf if math.isnan(age) else age * (0.5 if name == shown else 1.0)

    return min(sorted(links), key=lambda name: (rank(name), name != shown))
