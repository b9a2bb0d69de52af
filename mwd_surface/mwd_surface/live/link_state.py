# SPDX-License-Identifier: Apache-2.0
"""State of the telemetry link for page and rig interfaces: words of the last survey, received frames, quality."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import deque
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.message_record import MessageRecord

# Standpipe pressure as pictures: the last two minutes as a line, the last three minutes as a spectrogram.

LINE_HZ = 10.0  # rate of the points of the line, Hz
LINE_S = 120.0  # length of the line, s
RATE_HZ = 25.0  # approximate rate of the samples after averaging, Hz
WINDOW = 512  # number of samples in a spectrum: 20 s
BINS = 120  # number of bins of a spectrum, each of 2 RATE_HZ / WINDOW = 0.098 Hz, so that it ends near 11.7 Hz
STEP_S = 4.0  # time between two spectra, s
COLUMNS = 45  # number of spectra in the picture
# The line is drawn relative to the median over this time, s. Pulses of 2 s, which fill at most a quarter of the time,
# stand out from it, and pumps that start or change their strokes do not hide them.
_BASE_S = 10.0


@dataclasses.dataclass(frozen=True)
class PressurePicture:
    """Pressure as a line and a spectrogram."""

    end_ns: int  #: stamp of the newest sample
    line: tuple[float, ...]  #: pressure of the last `LINE_S` minus its running median, kPa, newest last
    #: Power, dB: one tuple of `BINS` values from 0 Hz on for each `STEP_S`, newest last.
    spectra: tuple[tuple[int, ...], ...]
    bin_hz: float = 2.0 * RATE_HZ / WINDOW  #: width of a bin
    line_hz: float = LINE_HZ  #: rate of the values in `line`


class PressureHistory:
    """Samples and spectra of the last minutes, from bursts of pressure as they arrive."""

    def __init__(self) -> None:
        self._samples = np.zeros(0)
        self._spectra: list[tuple[int, ...]] = []
        self._since_s = 0.0
        self._end_ns = 0
        self._rate = RATE_HZ

    def push(self, start_ns: int, period_s: float, pressure_pa: Array) -> bool:
        """
        Accept a burst; return whether a new spectrum was computed.

        start_ns: stamp of the first sample; period_s: time between two samples; pressure_pa: shape (n,), Pa. An
        integer number of samples is averaged, so that the rate comes as near as possible to `RATE_HZ`. A burst that
        starts more than `STEP_S` before the end of the last one clears the history.
        """
        if start_ns < self._end_ns - round(1e9 * STEP_S):
            self._samples, self._spectra = np.zeros(0), []
        many = max(round(1.0 / period_s / RATE_HZ), 1)
        self._rate = 1.0 / (period_s * many)
        whole = len(pressure_pa) // many * many
        means = np.asarray(pressure_pa[:whole]).reshape(-1, many).mean(axis=1)
        self._samples = np.concatenate([self._samples, means])[-max(round(LINE_S * self._rate), WINDOW) :]
        self._end_ns = start_ns + round(len(pressure_pa) * period_s * 1e9)
        self._since_s += len(pressure_pa) * period_s
        if self._since_s < STEP_S or len(self._samples) < WINDOW:
            return False
        self._since_s = math.fmod(self._since_s, STEP_S)
        self._spectra = [*self._spectra, self._spectrum()][-COLUMNS:]
        return True

    def picture(self) -> PressurePicture:
        """Return line and spectrogram up to the newest sample."""
        many = max(round(self._rate / LINE_HZ), 1)
        recent = self._samples[-round(LINE_S * self._rate) :]
        whole = recent[len(recent) % many :].reshape(-1, many).mean(axis=1) if len(recent) >= many else recent
        base = _running_median(whole, round(_BASE_S * self._rate / many)) if len(whole) else whole
        line = np.round((whole - base) * 1e-3, 2).tolist()
        return PressurePicture(self._end_ns, tuple(line), tuple(self._spectra), 2.0 * self._rate / WINDOW)

    def _spectrum(self) -> tuple[int, ...]:
        window = self._samples[-WINDOW:]
        power = np.abs(np.fft.rfft((window - window.mean()) * np.hanning(WINDOW))[: 2 * BINS]) ** 2
        pairs = power.reshape(-1, 2).mean(axis=1)
        return tuple(int(v) for v in np.round(10.0 * np.log10(np.maximum(pairs, 1e-3))))


def _running_median(values: Array, many: int) -> Array:
    # Import only when needed: a surface without a pressure gauge starts faster.
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(values, many, mode="reflect"))


# Words, frames and quality of a link.


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
    """One pass of a sequence (all its words sent once), with the fields of mwd_msgs/LinkFrame."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/LinkFrame"

    kind: LinkSequence
    frame: int
    words: int
    believed: int
    ebn0_db: float
    start_ns: int
    stamp_ns: int
    reason: str  #: cause if the pass was cut off, else empty


@dataclasses.dataclass(frozen=True, eq=False)
class LinkStatus(MessageRecord):
    """State of a link, with the fields of mwd_msgs/LinkQuality, and the words received over it."""

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
    at: float = math.nan  #: time of arrival of this state, s of the steady clock
    strokes: tuple[float, ...] = ()  #: stroke rate of each running pump, Hz
    picture: PressurePicture | None = None  #: standpipe pressure; None if it is not received
    survey: tuple[LinkWordState, ...] = ()  #: words of the newest survey, in the order of the sequence
    frames: tuple[LinkFrameState, ...] = ()  #: last passes of sequences, newest last
    words: tuple[LinkWordState, ...] = ()  #: last words, newest last
    others: tuple[LinkStatus, ...] = ()  #: states of the other links, in order of their names

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
