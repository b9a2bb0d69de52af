# SPDX-License-Identifier: Apache-2.0
"""
One hypothesis of a transmission, followed from its sync: its sequences, its words stretch by stretch, and the clock.

Where no pulses are found, sequence and clock continue with the last channel, so that an interruption is bridged.
"""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
import statistics
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.telemetry.pulse_position import GAP_TU
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import TOOLFACE_LEVEL, Doubt, judge
from mwd_surface.receiver.grid import REACH, STEPS_PER_TU, Grid
from mwd_surface.receiver.pulse import passes, segment, trellis
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU, basis, response_length
from mwd_surface.receiver.pulse.passes import DecodedWord, Pass, parts_of, rows_from_sync, soft_words, stretch_of
from mwd_surface.receiver.pulse.synchronisation import SyncFound
from mwd_surface.receiver.pump_lines import STEADY_S
from mwd_surface.receiver.words import (
    BELIEVED,
    ERASED,
    FrameReport,
    ReceivedWord,
    Reception,
    WordPlace,
    packet_rows,
    received,
)

_HISTORY_TU = 400  # length of the past that is used for the estimate of channel and clock, TU
# Time after the last packet in which its response still carries energy.
_AFTER_TU = 14
# Probability of a wrong table above which the transmission counts as lost: at least three words in a row do not fit.
_LOST = 0.999
_DOUBTFUL = 0.2  # probability of a wrong word table above which the parities count as failing
_PARITIES_FAIL = (
    "the parity bits do not fit: sequences, header_bits, parity or pulse_width_s of the tool configuration are wrong, "
    "or no tool sends"
)
_TWO_TOOLS = "two tools send at once; give them different pulse widths or transmit delays"
FADED = "the pulses have ended: the flow is off, the signal is too weak, or the tool started a new transmission"
# Prior of the share of missing pulses: its weight in packets; and the largest share.
_PRIOR_PACKETS, _MOST_MISSING = 80.0, 0.15
# Factor by which a toolface after a sync needs more evidence per TU than a survey.
_CLEARER = 1.2
# A sync that begins during this one shows a second tool if its score, a log likelihood ratio, exceeds `_SECOND` and the
# share `_SECOND_SHARE` of the score of this sync. Noise reaches `_SECOND` at about one place in a million, and another
# sync can begin at about 40 places. The share excludes the echo of a strong sync.
_SECOND, _SECOND_SHARE = 14.0, 0.15


class ReceivedTransmission:
    """
    A transmission from a sync on.

    Parameters
    ----------
    grid : Grid
        Pressure, to which later samples are appended.
    position : float
        Position where the sync starts, steps of the grid.
    doubt : Doubt
        Doubt about the configuration that the earlier transmissions left.
    """

    def __init__(self, tool: ToolConfiguration, grid: Grid, found: SyncFound, position: float, doubt: Doubt) -> None:
        self._tool, self._grid = tool, grid
        self._clock = ToolClock(position)
        self._settled = -found.settled
        self._places = passes.sync_places(tool, 0)[np.array(found.sent)]
        response = np.zeros(response_length(tool.tu_s))
        response[: len(found.response)] = found.response
        # The estimate has more components than the search. Distribute the same total variance over them.
        memory = STEADY_S / tool.tu_s * SAMPLES_PER_TU
        #: Response to a pulse, and noise model without the pulses.
        self.channel = segment.ChannelEstimate(
            response, found.scale, found.whitener, basis(len(response), tool.tu_s), memory
        )
        self._at_once, self.doubt = copy.deepcopy(doubt), doubt
        self.presence = Presence(found.score)
        self._boundary = SAMPLES_PER_TU * tool.sync.length_tu
        self._gains = [(position, 0.0), (self._clock.at(self._boundary), found.score)]
        self._heard_at = 0
        self._carried: tuple[Array, Array] | None = None
        self._missing = [segment.MISSING * _PRIOR_PACKETS, _PRIOR_PACKETS]
        self._off_s = math.inf
        self._held: list[ReceivedWord] = []
        self._pending = Reception()
        self.begin, self.score = position, found.score  #: position and score of the sync
        self.second = 0.0  #: score of another sync that begins during the first one
        #: Number of passes of sequences so far; number of passes that were published before the first of them.
        self.frames = self.base = 0
        self.published = False  #: whether words of this hypothesis were published
        self.sent = False  #: whether the tool has sent all that follows a sync, because it sends surveys only
        self.lost = ""  #: reason why the hypothesis has ended by itself; empty while the hypothesis continues
        self._pass: Pass | None = None
        self._offered = False
        self._parity = int(tool.parity == "odd")

    @property
    def total(self) -> float:
        """Log likelihood ratio of all pulses so far against no pulses."""
        return self._gains[-1][1]

    @property
    def end(self) -> float:
        """Position of the grid up to which pulses were sought."""
        return self._gains[-1][0]

    @property
    def at(self) -> float:
        """Position of the grid at which the next step begins."""
        return self._clock.at(self._boundary if self._pass is None else self._pass.at)

    def gained(self, begin: float, end: float) -> float:
        """Return the log likelihood ratio of the pulses between two positions of the grid."""
        places, sums = zip(*self._gains, strict=True)
        return float(np.interp(end, places, sums) - np.interp(begin, places, sums))

    def expects_sync(self, position: float) -> bool:
        """Return whether a sync at a position of the grid starts where the next pass of a sequence would start."""
        at = (position - self._clock.start) / self._clock.pace
        return (
            self._pass is not None
            and bool(self._tool.toolfaces)
            and abs(at - self._pass_end(self._pass)) <= SAMPLES_PER_TU
        )

    def offer_sync(self) -> None:
        """Let the next pass of a sequence begin with a sync if the data support the sync."""
        self._offered = True

    def needs(self) -> float:
        """Return the position of the grid up to which the next step needs pressure."""
        if self._pass is None or (self._pass.complete and self._offered):
            start = self._boundary if self._pass is None else self._pass_end(self._pass)
            length = self._tool.header_tu + max(self._first_length(kind) for kind in ("survey", "toolface"))
            length += self._tool.sync.length_tu if self._offered else 0
        else:
            now = self._following(self._pass) if self._pass.complete else self._pass
            start, (_, length) = now.at, packet_rows(now.following())
        return self._clock.at(start + SAMPLES_PER_TU * (length + _AFTER_TU)) + REACH

    def ends(self) -> float:
        """Return the latest position of the grid at which the last pulse of the next step ends."""
        return self.needs() - SAMPLES_PER_TU * (_AFTER_TU + GAP_TU) * self._clock.pace - REACH

    def begins(self) -> float:
        """
        Return the position of the grid that the sync search must have reached before the next step.

        Return -inf if the next step does not depend on a sync.
        """
        if self._pass is None:
            return self._clock.at(self._boundary)
        return self._clock.at(self._pass_end(self._pass) + SAMPLES_PER_TU) if self._pass.complete else -math.inf

    def keeps(self) -> float:
        """Return the first position of the grid still needed, because a complete sequence is decoded again."""
        start = self._boundary if self._pass is None else self._pass.start
        return self._clock.at(start - SAMPLES_PER_TU * _HISTORY_TU)

    def step(self, off_s: float) -> None:
        """
        Decode the next stretch.

        off_s: time from which the flow is off; the pressure after it is not used.
        """
        self._off_s = off_s
        if self._pass is None or self._pass.complete:
            self._pass = self._next_pass()
        now, presence = self._pass, self.presence
        items = now.following()
        rows, length = packet_rows(items)
        clock, began, was_faint = self._clock, now.at, presence.faint
        decision = self._decode(rows, length, now.at)
        presence.judge(PulseEvidence(decision.evidence, decision.expected, len(rows), len(items)))
        self._gains.append((self._clock.at(began + SAMPLES_PER_TU * length), self.total + decision.evidence))
        soft = soft_words(decision, rows, items, self._parity)
        now.add(items, decision, soft)
        if presence.faint:
            # Clock and channel must not be updated from data without pulses; the words are shown if the pulses come
            # back.
            self._heard_at = min(self._heard_at, now.take_back(presence.faint_words + len(items)))
            self._clock = clock
            self._carried = self._carried if was_faint else self.channel.posterior
        else:
            self._use(now, decision, len(items))
        if now.complete:
            self._complete()
            self.sent = not self._tool.toolfaces

    def _use(self, now: Pass, decision: segment.DecodedStretch, count: int) -> None:
        """Continue with the channel of the last `count` words, in which pulses were found; show these words."""
        self._heard_at = now.at
        self.channel = decision.channel
        packets = len(decision.present)
        self._missing[0] += float(packets - np.sum(decision.probability * decision.present))
        self._missing[1] += packets
        trusted = self._at_once.learn([part.soft for part in now.parts[-count:]])
        if self._at_once.failing > _LOST and self._at_once.two_tools < 0.5:
            self.lost = _PARITIES_FAIL
        provisional = self._held + self._words(now, now.done - count, trusted, 0)
        # Words after a doubtful sync are held back until it is confirmed.
        confirmed = self.presence.confirmed
        self._held = [] if confirmed else provisional
        self._pending.provisional += provisional if confirmed else []
        now.shown = now.done if confirmed else 0

    def taken(self) -> Reception:
        """Return and remove the words that are ready to be published, with the number of the pass of each word."""
        ready, self._pending = self._pending, Reception()
        first = self.base
        return Reception(
            [dataclasses.replace(word, frame=word.frame + first) for word in ready.words],
            [dataclasses.replace(report, frame=report.frame + first) for report in ready.frames],
            [dataclasses.replace(word, frame=word.frame + first) for word in ready.provisional],
        )

    def close(self, until: float, reason: str) -> None:
        """End the transmission at a position of the grid, for a reason; words that end later count as silent."""
        now = self._pass
        self.lost = self.lost or reason
        if now is not None and math.isfinite(until):
            sample = (until - self._clock.start) / self._clock.pace
            now.take_back(sum(part.at + SAMPLES_PER_TU * part.length > sample for part in now.parts))
        self._complete()

    def _complete(self) -> None:
        """
        Decode the words of the present sequence again, with all pulses and parities, and make them ready to publish.

        Nothing is done without a decoded word, or before the sync is confirmed.
        """
        now = self._pass
        if now is None or not now.parts or not self.presence.confirmed:
            return
        heard = now.heard
        if self.lost or not now.complete:
            del now.parts[max([now.shown, *(k + 1 for k, part in enumerate(now.parts) if part.pulses)]) :]
        if not (heard or now.shown):
            self._forget(now)
            return
        self._decode_again(now, heard)
        trusted = self.doubt.learn([part.soft for part in now.parts])
        # Provisional words of the next pass begin with everything learned so far.
        self._at_once = copy.deepcopy(self.doubt)
        words = self._words(now, 0, trusted, 1)
        # Retract a word that was shown and then found to have no pulses.
        words = [
            word if part.pulses else dataclasses.replace(word, status=ERASED)
            for word, part in zip(words, now.parts, strict=True)
        ]
        ebn0 = float(np.mean([part.ebn0_db for part in heard or now.parts]))
        # A second tool is named if it prevents words from being believed and is more probable than a wrong table, or if
        # no word is believed after a sync during which another one began.
        failing = self.doubt.failing
        another = self.second > max(_SECOND, _SECOND_SHARE * self.score)
        another &= all(word.status != BELIEVED for word in words)
        two = another or self.doubt.two_tools > max(1.0 - TOOLFACE_LEVEL, 0.5 * failing)
        reason = _TWO_TOOLS if two else self.lost
        reason = reason or (_PARITIES_FAIL if failing > _DOUBTFUL else "")
        reason = reason or (FADED if len(heard) < len(now.parts) else "")
        report = FrameReport(self.frames, now.kind, words[0].start_s, words[-1].end_s, ebn0, self._clock.error, reason)
        self.frames += 1
        self._forget(now)
        self._pending.add(Reception(words, [report]))

    def _words(self, now: Pass, first: int, trusted: list[float], revision: int) -> list[ReceivedWord]:
        words = []
        for k, (part, sure) in enumerate(zip(now.parts[first:], trusted, strict=True), first):
            span = (self._seconds(part.at), self._seconds(part.at + SAMPLES_PER_TU * part.length))
            place = WordPlace(self.frames, k, now.kind, revision)
            words.append(received(self._tool, part.item, judge(part.soft, sure), span, place))
        return words

    def _decode_again(self, now: Pass, parts: list[DecodedWord]) -> None:
        """
        Decode words of a sequence once more, all together: each with the pulses before and after it; update `parts`.

        For words after a sync, also compute the probability that a second tool sends.
        """
        if not parts:
            return
        starts = [(part.at - now.start) // SAMPLES_PER_TU for part in parts]
        rows = np.concatenate([part.rows for part in parts])
        counts = [len(part.rows) for part in parts]
        rows[:, trellis.START] += np.repeat(starts, counts)
        firsts = np.cumsum([0, *counts[:-1]])
        groups = np.column_stack([firsts, starts, np.add(starts, [part.length for part in parts])])
        probability = np.concatenate([part.probability for part in parts])
        stretch = self._stretch(rows, groups, now.start, probability)
        if now.start == self._boundary + SAMPLES_PER_TU * self._tool.header_tu:
            end = stretch.start - now.start + self._boundary
            begin = end - SAMPLES_PER_TU * self._tool.sync.length_tu
            stretch = dataclasses.replace(stretch, sync=(begin, end) if begin > 0 else None)
        decision = segment.decode(stretch, self.channel)
        self.channel = decision.channel
        items = tuple(part.item for part in parts)
        soft = soft_words(decision, rows, items, self._parity)
        for part, first, one in zip(parts, firsts, soft, strict=True):
            mine = slice(first, first + len(part.rows))
            part.probability, part.present = decision.probability[mine], decision.present[mine]
            part.ebn0_db, part.soft = float(decision.ebn0_db[first]), one
        if stretch.sync is not None:
            self.doubt.hear_sync(*decision.sync)

    def _forget(self, now: Pass) -> None:
        """Remove the words of a decoded sequence; keep those of its pulses that the decoding of later words needs."""
        self._places = self._pulses()
        now.parts = []
        oldest = now.at - SAMPLES_PER_TU * _HISTORY_TU - len(self.channel.response)
        self._places = self._places[self._places[:, 0] >= oldest]

    def _pulses(self) -> Array:
        """Return the possible places of all known pulses: of earlier words, and of the words of the present pass."""
        parts = self._pass.parts if self._pass is not None else []
        return np.concatenate([self._places, *(part.places() for part in parts)])

    @property
    def sound(self) -> bool:
        """Whether the parities hold, so that another hypothesis should not end the transmission."""
        return self._at_once.failing < _DOUBTFUL and self.presence.confirmed and not self.presence.faint

    @property
    def heard(self) -> float:
        """Position of the grid up to which pulses were found."""
        return self._clock.at(self._heard_at)

    def _seconds(self, sample: Any) -> Any:
        return self._grid.seconds(self._clock.at(sample))

    def _pass_end(self, one: Pass) -> int:
        return one.start + SAMPLES_PER_TU * self._tool.length_tu(one.items)

    def _first_length(self, kind: str) -> int:
        if not self._tool.header_bits and not self._offered:
            items = self._tool.sequence(kind, 0)
            return packet_rows(stretch_of(items, 0))[1] if items else 0
        return max(
            (packet_rows(stretch_of(items, 0, passes.LOOK_BITS))[1] for items in self._sequences(kind)), default=0
        )

    def _sequences(self, kind: str) -> tuple[tuple[SequenceItem, ...], ...]:
        return self._tool.surveys if kind == "survey" else self._tool.toolfaces

    def _next_pass(self) -> Pass:
        """
        Return the next pass: after a sync by the header and the evidence in the data, else of the toolface sequence.

        If the tool sends no header, a survey follows a sync.
        """
        if self._pass is not None:
            following = self._following(self._pass)
            offered, self._offered = self._offered, False
            if not offered or self._goes_on(following):
                return following
            self._places = np.concatenate([self._places, passes.sync_places(self._tool, following.start)])
            self._boundary = following.start + SAMPLES_PER_TU * self._tool.sync.length_tu
        # Without a header a tool sends a sync only after flow-on, and then it sends a survey.
        start, number, kind = self._boundary, 0, "survey"
        if self._tool.header_bits:
            number = self._header(start)
            start += SAMPLES_PER_TU * self._tool.header_tu
            kind = self._kind_after_header(number, start)
        return Pass(kind, self._tool.sequence(kind, number), start, at=start)

    def _kind_after_header(self, number: int, start: int) -> str:
        """Return whether a survey or a toolface sequence begins at a sample, by the evidence of the data."""
        if not self._tool.toolfaces:
            return "survey"
        looks = (stretch_of(self._tool.sequence(one, number), 0, passes.LOOK_BITS) for one in ("survey", "toolface"))
        survey, toolface = (self._density(*packet_rows(items), start) for items in looks)
        # Packets of another sequence may fit the pulses of a survey nearly as well as the packets of the survey.
        return "toolface" if toolface > max(_CLEARER * survey, 0.0) else "survey"

    def _density(self, rows: Indices, length: int, start: int) -> float:
        """Return the log likelihood ratio per TU that the packets `rows` begin at the sample `start`."""
        return self._decode_once(rows, length, start).evidence / length

    def _following(self, last: Pass) -> Pass:
        """Return the pass that follows another one without a sync: the toolface sequence of the same number."""
        number = self._sequences(last.kind).index(last.items)
        toolfaces = self._tool.toolfaces
        items = last.items if last.kind == "toolface" else toolfaces[min(number, len(toolfaces) - 1)]
        start = self._pass_end(last)
        return Pass("toolface", items, start, at=start)

    def _goes_on(self, one: Pass) -> bool:
        """
        Return whether the data continue with this pass repeated, rather than with a sync and a new sequence.

        Both hypotheses are weighed on the same pressure. A disturbance that looks like a sync lowers both, and the
        pulses after it decide.
        """
        kinds = ("survey", "toolface") if self._tool.header_bits else ("survey",)
        looks = [stretch_of(items, 0, passes.LOOK_BITS) for kind in kinds for items in self._sequences(kind)]
        anew = [rows_from_sync(self._tool, items) for items in looks]
        longest = max(length for _, length in anew)
        words: tuple[SequenceItem, ...] = ()
        for item in itertools.cycle(one.items):
            if self._tool.length_tu((*words, item)) > longest:
                break
            words += (item,)
        return self._density(*packet_rows(words), one.at) > max(self._density(*rows, one.at) for rows in anew)

    def _header(self, start: int) -> int:
        items = (SequenceItem("header", self._tool.header_bits, False),)
        rows, length = packet_rows(items)
        decision = self._decode(rows, length, start)
        soft = soft_words(decision, rows, items, self._parity)[0]
        most = max(len(self._tool.surveys), len(self._tool.toolfaces))
        self._places = np.concatenate([self._places, parts_of(items, decision, [soft], start)[0].places()])
        valid = [one for one in soft.candidates if one.code < most]
        return max(valid, key=lambda one: one.probability).code if valid else 0

    def _decode(self, rows: Indices, length: int, start: int) -> segment.DecodedStretch:
        decision = self._decode_once(rows, length, start)
        heard = start // SAMPLES_PER_TU
        window = min(_HISTORY_TU, heard) + length
        overlap = None if heard <= _HISTORY_TU else window / length
        drift, variance, middle = decision.timing
        self._clock = self._clock.followed((drift, variance, start + middle), overlap)
        return decision

    def _decode_once(self, rows: Indices, length: int, start: int) -> segment.DecodedStretch:
        return segment.decode(self._stretch(rows, np.array([[0, 0, length + _AFTER_TU]]), start), self.channel)

    def _stretch(
        self, rows: Indices, groups: Indices, start: int, probability: Array | None = None
    ) -> segment.StretchOnToolClock:
        """Return the pressure around some packets; if their probabilities are known, up to the end of the response."""
        pulses = self._pulses() if probability is None else self._places
        after = 0 if probability is None else _AFTER_TU
        begin = max(start - SAMPLES_PER_TU * _HISTORY_TU, self._settled)
        begin = max(begin, math.ceil((self._grid.first - self._clock.start) / self._clock.pace))
        count = start + SAMPLES_PER_TU * (int(groups[-1, 2]) + after) - begin
        pressure, known = self._grid.samples(self._clock.at(begin), self._clock.pace, count)
        if math.isfinite(self._off_s):
            known[self._seconds(begin + np.arange(count)) >= self._off_s] = 0.0
        return segment.StretchOnToolClock(
            pressure,
            known,
            pulses - (begin, 0.0, begin),
            rows,
            groups,
            start - begin,
            self._parity,
            probability,
            self._grid.angles(self._clock.at(begin), self._clock.pace, count),
            self._carried,
            min(self._missing[0] / self._missing[1], _MOST_MISSING),
        )


# Clock of the tool relative to the clock of the pressure: position of each sample of a transmission on the grid.


# 1 sigma of the relative clock error of tools with a good clock and of tools with a poor clock, and the shares of both
# kinds of tools. _CLOCK_WALK: 1 sigma of the change of the relative clock error, due to temperature, from one stretch
# (part of a transmission that is decoded at once) to the next.
_CLOCKS, _SHARES = (5e-4, 5e-3), (0.95, 0.05)
_CLOCK_WALK = 3e-5


@dataclasses.dataclass(frozen=True)
class ToolClock:
    """Positions of the samples of a transmission on the grid."""

    start: float  #: position of sample 0 on the grid, steps
    pace: float = STEPS_PER_TU / SAMPLES_PER_TU  #: steps from one sample to the next
    variance: float = _CLOCKS[0] ** 2  #: variance of the relative error of the pace

    def at(self, sample: float) -> float:
        """Return the position of a sample on the grid, steps."""
        return self.start + sample * self.pace

    @property
    def error(self) -> float:
        """Relative error of the tool's clock; at 1e-3 the tool sends 0.1 % slower."""
        return self.pace * SAMPLES_PER_TU / STEPS_PER_TU - 1.0

    def followed(self, timing: tuple[float, float, float], overlap: float | None) -> ToolClock:
        """
        Return the clock after a measurement.

        Parameters
        ----------
        timing : (float, float, float)
            Relative drift of the pulses, its variance, and the sample about which it is measured.
        overlap : float or None
            Windows overlap: length of this window divided by its new part; only the new part counts as a measurement.
            None: the window holds all data so far, so it replaces earlier measurements.
        """
        drift, variance, middle = timing
        if overlap is None:
            error, left = _from_all(self.error + drift, variance)
        else:
            prior = self.variance + _CLOCK_WALK**2
            gain = prior / (prior + variance * overlap)
            error, left = self.error + gain * drift, prior * (1.0 - gain)
        change = error - self.error
        # Change the pace, but keep the position of the sample `middle`.
        return ToolClock(self.start - middle * self.pace * change, self.pace * (1.0 + change), left)


def _from_all(measured: float, variance: float) -> tuple[float, float]:
    """Return the error of a clock and its variance from a single measurement, with a mixture of two priors."""
    sigmas, shares = np.square(_CLOCKS), np.array(_SHARES)
    total = sigmas + variance
    logs = np.log(shares) - 0.5 * (np.log(total) + measured**2 / total)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    gains = sigmas / total
    mean = float(weights @ gains) * measured
    spread = float(weights @ (gains * measured - mean) ** 2)
    return mean, float(weights @ (gains * variance)) + spread


# Decision whether pulses are present after a sync, from the evidence of the last stretches.


# Lowest log likelihood ratio of a sync with the words after it. Noise reaches it with a probability below exp(-18) at
# each of ten thousand places per hour. Starting pumps can look like a sync, but not like the words after it.
_LEAST_EVIDENCE = 18.0
# Number of packets that are judged together (about 30 bits), and number of packets without words after which a sync is
# rejected as noise.
_JUDGED_PACKETS, _NO_WORDS_PACKETS = 10, 40
# Share of the expected evidence below which stretches hold no pulses.
_FAINT = 0.3


class PulseEvidence(NamedTuple):
    """Log likelihood ratio of the pulses of a stretch against no pulses, with its numbers of packets and words."""

    evidence: float
    expected: float  #: mean of the ratio if the usual pulses were present in the noise of this stretch
    packets: int
    words: int


class Presence:
    """
    Decision whether pulses are present, for one hypothesis, from the evidence of its stretches.

    Parameters
    ----------
    score : float
        Score of the sync.
    """

    def __init__(self, score: float) -> None:
        self._score = score
        self._usual: deque[float] = deque(maxlen=24)
        self._recent: list[PulseEvidence] = []
        self._total = 0.0
        self.packets = 0  #: number of packets so far
        self.confirmed = False  #: whether words were found after the sync
        #: Whether the last stretches hold no pulses: a disturbance, an interruption, or the tool is silent.
        self.faint = False

    @property
    def usual(self) -> float:
        """Median evidence per packet so far."""
        return statistics.median(self._usual) if self._usual else 0.0

    @property
    def hopeless(self) -> bool:
        """Whether the sync was noise: no words came after it."""
        return not self.confirmed and (self.packets >= _NO_WORDS_PACKETS or self._total < -_LEAST_EVIDENCE)

    @property
    def faint_words(self) -> int:
        """Number of words before the last stretch that are now known to have had no pulses."""
        return sum(one.words for one in self._recent[:-1])

    def judge(self, stretch: PulseEvidence) -> None:
        """Add a stretch, which may confirm the sync, or show that there are no pulses at present."""
        self._recent.append(stretch)
        self.packets += stretch.packets
        self._total += stretch.evidence
        if not self.confirmed:
            # The sync counts at most as much as the words, so a clear sync without words is never confirmed.
            self.confirmed = min(self._score, self._total) + self._total >= _LEAST_EVIDENCE
            if self.confirmed:
                self._accept(self._total / self.packets)
            return
        last = self._last()
        packets = sum(one.packets for one in last)
        if packets < _JUDGED_PACKETS:
            return
        evidence = sum(one.evidence for one in last)
        was = self.faint
        # Growing noise, as after stalls, lowers the expected evidence. The expectation stays above the evidence that
        # noise alone can reach.
        noise = _LEAST_EVIDENCE * packets / _JUDGED_PACKETS
        expected = max(_FAINT * sum(one.expected for one in last), noise)
        self.faint = evidence <= min(_FAINT * self.usual * packets, expected)
        if not self.faint:
            self._accept(evidence / packets)
        elif not was:
            self._recent = last

    def _accept(self, each: float) -> None:
        self._usual.append(each)
        while sum(one.packets for one in self._recent) >= _JUDGED_PACKETS:
            del self._recent[0]

    def _last(self) -> list[PulseEvidence]:
        """Return the last stretches with `_JUDGED_PACKETS` packets or more together, else all recent stretches."""
        packets = 0
        for k in range(len(self._recent) - 1, -1, -1):
            packets += self._recent[k].packets
            if packets >= _JUDGED_PACKETS:
                return self._recent[k:]
        return self._recent
