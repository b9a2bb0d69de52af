# SPDX-License-Identifier: Apache-2.0
"""What page, rig interfaces and reports know of the telemetry link: state, words of the last survey, passes."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping

from mwd_surface.live.pressure_picture import PressurePicture

NO_INPUT, NO_FLOW, SEARCHING, LOCKED, DOUBTFUL = range(5)
STATE_WORDS = ("no pressure", "no flow", "searching", "locked", "doubtful")
SURVEY, TOOLFACE = 2, 3
STATUS_WORDS = ("believed", "erased", "by consistency")
_FRAMES, _WORDS = 20, 40


@dataclasses.dataclass(frozen=True)
class LinkWordState:
    """A word as received; value and sigma SI, in `unit`; status as in mwd_msgs/LinkWord; pulses: s after start_ns."""

    name: str
    value: float
    sigma: float
    unit: str
    confidence: float
    status: int
    kind: int
    frame: int
    place: int
    revision: int
    start_ns: int
    end_ns: int
    pulses: tuple[float, ...] = ()
    alternatives: tuple[tuple[int, float], ...] = ()


@dataclasses.dataclass(frozen=True)
class LinkFrameState:
    """A pass of a sequence: words received and believed, Eb/N0 in dB, why it broke off (empty: complete)."""

    kind: int
    frame: int
    words: int
    believed: int
    ebn0_db: float
    start_ns: int
    end_ns: int
    reason: str


@dataclasses.dataclass(frozen=True)
class LinkStatus:
    """
    State of the link in use; fields as in mwd_msgs/LinkQuality, ages in s (NaN: nothing came yet).

    Attributes
    ----------
    at : float
        When it arrived, s of the steady clock.
    survey : tuple of LinkWordState
        Words of the newest survey, in their order.
    frames : tuple of LinkFrameState
        The newest last.
    words : tuple of LinkWordState
        The newest last.
    picture : PressurePicture or None
    pump_lines : tuple of float
        Strokes of each pump, Hz.
    others : tuple of LinkStatus
        Links beside this one, by name.
    """

    link: str
    state: int
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
    at: float
    pump_lines: tuple[float, ...] = ()
    picture: PressurePicture | None = None
    survey: tuple[LinkWordState, ...] = ()
    frames: tuple[LinkFrameState, ...] = ()
    words: tuple[LinkWordState, ...] = ()
    others: tuple[LinkStatus, ...] = ()


class LinkCollector:
    """Collects words and passes of a link."""

    def __init__(self) -> None:
        self._survey: dict[int, LinkWordState] = {}
        self._survey_frame = -1
        self._words: dict[tuple[int, int], LinkWordState] = {}
        self._frames: deque[LinkFrameState] = deque(maxlen=_FRAMES)

    def on_word(self, word: LinkWordState) -> None:
        """Accept a word, provisional or final; a final one replaces the provisional one."""
        if word.kind == SURVEY:
            if word.frame != self._survey_frame:
                self._survey, self._survey_frame = {}, word.frame
            self._survey[word.place] = word
        self._words.pop((word.frame, word.place), None)
        self._words[word.frame, word.place] = word
        for key in list(self._words)[:-_WORDS]:
            del self._words[key]

    def on_frame(self, frame: LinkFrameState) -> None:
        """Accept a pass of a sequence."""
        self._frames.append(frame)

    def status(self, quality: LinkStatus) -> LinkStatus:
        """Return the state of the link with the words and passes so far."""
        return dataclasses.replace(
            quality,
            survey=tuple(self._survey[place] for place in sorted(self._survey)),
            frames=tuple(self._frames),
            words=tuple(sorted(self._words.values(), key=lambda word: word.end_ns)),
        )


# The better, the earlier: words arrive, some arrive, they may come, the tool is silent, nothing can come.
_ORDER = (LOCKED, DOUBTFUL, SEARCHING, NO_FLOW, NO_INPUT)


def best_link(links: Mapping[str, LinkStatus], shown: str = "") -> str:
    """
    Name of the link to show: the one with the best state, and of equal ones that with the youngest toolface.

    shown: the one shown so far, which stays while no other has a better state or a toolface half as old.
    """

    def rank(name: str) -> tuple[int, float]:
        age = links[name].toolface_age
        return _ORDER.index(links[name].state), math.inf if math.isnan(age) else age * (0.5 if name == shown else 1.0)

    return min(sorted(links), key=lambda name: (rank(name), name != shown))
