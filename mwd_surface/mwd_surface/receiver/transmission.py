"""One transmission followed from its sync on: its sequences, its words stretch by stretch, the tool's clock."""

from __future__ import annotations

import dataclasses
import math
from collections import deque

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver import segment, trellis
from mwd_surface.receiver.belief import TEMPERATURES, Candidate, Soft, Temper
from mwd_surface.receiver.channel_estimate import RESPONSE, SAMPLES_PER_TU
from mwd_surface.receiver.grid import REACH, Grid
from mwd_surface.receiver.synchronisation import SyncFound
from mwd_surface.receiver.words import ReceivedWord, packet_rows, received

# Words are decoded together until they have so many bits: enough pulses for a channel estimate, and soon shown.
_STRETCH_BITS = 30
_HISTORY_TU = 400
_BEFORE_TU = 50
# A response that comes after the last packet, as far as it still carries energy.
_AFTER_TU = 14
_BEAM = 16
# 1 sigma of a tool's clock, and of its change from stretch to stretch: temperature, and windows that overlap.
_CLOCK, _CLOCK_WALK = 1e-3, 5e-5
# Beyond this probability that parities mean nothing, the transmission is lost.
_LOST = 0.95
_DOUBTFUL = 0.2
# Share of the usual evidence for pulses below which a stretch holds none, or those of a transmission that began anew.
_FAINT = 0.3
# Share above which a stretch is what it is taken for, although it may look like a sync.
_CLEAR = 0.7


@dataclasses.dataclass(frozen=True)
class FrameReport:
    """One pass of a sequence: kind and number, time on air, energy of a bit over noise density, clock error, reason."""

    frame: int
    kind: str
    start_s: float
    end_s: float
    ebn0_db: float
    clock_error: float
    reason: str


@dataclasses.dataclass
class _Pass:
    """A pass of a sequence that is being received."""

    kind: str
    items: tuple[SequenceItem, ...]
    start: int
    done: int = 0
    at: int = 0
    soft: list[Soft] = dataclasses.field(default_factory=list)
    starts: list[int] = dataclasses.field(default_factory=list)
    ebn0: list[float] = dataclasses.field(default_factory=list)


class Transmission:
    """
    A transmission from a sync to its loss.

    Parameters
    ----------
    tool : ToolConfiguration
    grid : Grid
        Pressure, which grows.
    found : SyncFound
    position : float
        Where the sync starts, steps of the grid.
    frame : int
        Number of its first pass.
    """

    def __init__(self, tool: ToolConfiguration, grid: Grid, found: SyncFound, position: float, frame: int) -> None:
        self._tool, self._grid = tool, grid
        self._start, self._pace = position, grid.steps_per_tu / SAMPLES_PER_TU
        self._clock_variance = _CLOCK**2
        self._edges = [float(SAMPLES_PER_TU * edge) for edge in tool.sync.edges_tu]
        self._chances = [1.0] * len(self._edges)
        response = np.zeros(RESPONSE)
        response[: len(found.response)] = found.response
        whitener = np.zeros(segment.ORDER + 2)
        whitener[: len(found.whitener)] = found.whitener
        # The search has fewer components than the estimate: the same variance in all, spread over more.
        self._channel = segment.Channel(response, found.scale, whitener)
        self.temper = Temper()
        self._usual: deque[float] = deque(maxlen=8)
        self.frame = frame
        self.lost = ""
        self.score = found.score
        self._pass: _Pass | None = None
        self._boundary = SAMPLES_PER_TU * tool.sync.length_tu
        self._offered = False

    def expects_sync(self, position: float) -> bool:
        """Whether a sync found at a position of the grid starts where the next pass would."""
        at = (position - self._start) / self._pace
        return self._pass is not None and abs(at - self._pass_end(self._pass)) <= SAMPLES_PER_TU

    def offer_sync(self) -> None:
        """Take a sync into account where the next pass begins; the data decide which of the two it is."""
        self._offered = True

    def needs(self) -> float:
        """Position of the grid up to which pressure has to be there for the next step."""
        if self._pass is None or self._done(self._pass):
            longest = max(self._first_length(kind) for kind in ("survey", "toolface"))
            start = self._boundary if self._pass is None else self._pass_end(self._pass)
            start += SAMPLES_PER_TU * self._tool.sync.length_tu if self._offered else 0
            return self._at(start + SAMPLES_PER_TU * (self._tool.header_tu + longest + _AFTER_TU)) + REACH
        items = _stretch(self._pass.items, self._pass.done)
        _, length = packet_rows(items)
        return self._at(self._pass.at + SAMPLES_PER_TU * (length + _AFTER_TU)) + REACH

    def reaches(self) -> float:
        """Position of the grid where the next stretch ends on air."""
        return self.needs() - SAMPLES_PER_TU * _AFTER_TU * self._pace

    def step(self) -> tuple[list[ReceivedWord], list[FrameReport]]:
        """Decode the next stretch; words and report of the pass, once it is complete."""
        if self._pass is None or self._done(self._pass):
            self._begin_pass()
        now = self._pass
        if now is None:
            return [], []
        items = _stretch(now.items, now.done)
        rows, length = packet_rows(items)
        decision = self._decode(rows, length, now.at)
        soft = _soft(decision, rows, items, self._parity)
        self.lost = self._breaks_off(decision, len(rows))
        if self.lost:
            return self.close()
        self._remember(rows, now.at, decision.probability)
        self._channel = decision.channel
        offset = 0
        for item in items:
            now.starts.append(now.at + SAMPLES_PER_TU * offset)
            offset += self._tool.pulses(0, item.length).length
        now.soft += soft
        now.ebn0.append(decision.ebn0_db)
        now.done += len(items)
        now.at += SAMPLES_PER_TU * length
        self.temper.learn(soft)
        if self.temper.failing > _LOST:
            self.lost = "parities fail half the time: wrong sequence, wrong pulse width or no tool"
        return self.close() if self._done(now) or self.lost else ([], [])

    def _breaks_off(self, decision: segment.Decision, packets: int) -> str:
        """Reason why a stretch does not belong to the transmission; empty: it does."""
        each = decision.evidence / packets
        usual = float(np.median(self._usual)) if self._usual else 0.0
        if each <= _FAINT * usual:
            return "no pulses any more: flow off, too weak, or the tool began anew"
        self._usual.append(each)
        return ""

    def close(self) -> tuple[list[ReceivedWord], list[FrameReport]]:
        """Words of the pass so far, judged by all its parities."""
        now = self._pass
        if now is None or not now.soft:
            return [], []
        words = []
        for item, soft, start in zip(now.items, now.soft, now.starts, strict=False):
            length = SAMPLES_PER_TU * self._tool.pulses(0, item.length).length
            span = (self._seconds(start), self._seconds(start + length))
            words.append(received(self._tool, item, self.temper.judge(soft), span, (self.frame, now.kind)))
        report = FrameReport(
            self.frame,
            now.kind,
            words[0].start_s,
            words[-1].end_s,
            float(np.mean(now.ebn0)),
            self._clock_error,
            self.lost,
        )
        self.frame += 1
        now.soft, now.starts = [], []
        return words, [report]

    @property
    def sound(self) -> bool:
        """Whether parities hold, so that nothing but its own end should break the transmission off."""
        return self.temper.failing < _DOUBTFUL and bool(self._usual)

    @property
    def heard(self) -> float:
        """Position of the grid up to which pulses were heard."""
        return self._at(self._pass.at if self._pass is not None else 0)

    @property
    def whitener(self) -> Array:
        """Prediction error filter of the noise, pulses taken out."""
        return self._channel.whitener

    @property
    def _parity(self) -> int:
        return int(self._tool.parity == "odd")

    @property
    def _clock_error(self) -> float:
        return self._pace * SAMPLES_PER_TU / self._grid.steps_per_tu - 1.0

    def _at(self, sample: float) -> float:
        return self._start + sample * self._pace

    def _seconds(self, sample: float) -> float:
        return self._grid.seconds(self._at(sample))

    def _done(self, one: _Pass) -> bool:
        return one.done == len(one.items)

    def _pass_end(self, one: _Pass) -> int:
        return one.start + SAMPLES_PER_TU * self._tool.length_tu(one.items)

    def _first_length(self, kind: str) -> int:
        return max(packet_rows(_stretch(items, 0))[1] for items in self._sequences(kind))

    def _sequences(self, kind: str) -> tuple[tuple[SequenceItem, ...], ...]:
        return self._tool.surveys if kind == "survey" else self._tool.toolfaces

    def _begin_pass(self) -> None:
        """Choose the sequence that comes: behind a sync by the evidence of the data, else toolface again."""
        if self._pass is not None:
            following = self._following(self._pass)
            offered, self._offered = self._offered, False
            if not offered or self._fits(following):
                self._pass = following
                return
            self._edges += [float(following.start + SAMPLES_PER_TU * edge) for edge in self._tool.sync.edges_tu]
            self._chances += [1.0] * len(self._tool.sync.edges_tu)
            self._boundary = following.start + SAMPLES_PER_TU * self._tool.sync.length_tu
        start, number = self._boundary, 0
        if self._tool.header_bits:
            number = self._header(start)
            start += SAMPLES_PER_TU * self._tool.header_tu
        best = (-math.inf, "survey")
        for kind in ("survey", "toolface"):
            sequences = self._sequences(kind)
            rows, length = packet_rows(_stretch(sequences[min(number, len(sequences) - 1)], 0))
            decision = self._decode_once(rows, length, start)
            best = max(best, (decision.evidence / length, kind))
        sequences = self._sequences(best[1])
        self._pass = _Pass(best[1], sequences[min(number, len(sequences) - 1)], start, at=start)

    def _following(self, last: _Pass) -> _Pass:
        """Pass that follows another one without a sync: the toolface sequence of the same number."""
        number = self._sequences(last.kind).index(last.items)
        toolfaces = self._tool.toolfaces
        items = last.items if last.kind == "toolface" else toolfaces[min(number, len(toolfaces) - 1)]
        start = self._pass_end(last)
        return _Pass("toolface", items, start, at=start)

    def _fits(self, one: _Pass) -> bool:
        """Whether the data have the pulses of a pass as clearly as those of the stretches before."""
        rows, length = packet_rows(_stretch(one.items, 0))
        evidence = self._decode_once(rows, length, one.at).evidence / len(rows)
        return evidence > _CLEAR * float(np.median(self._usual))

    def _header(self, start: int) -> int:
        items = (SequenceItem("header", self._tool.header_bits, False),)
        rows, length = packet_rows(items)
        decision = self._decode(rows, length, start)
        soft = _soft(decision, rows, items, self._parity)[0]
        most = max(len(self._tool.surveys), len(self._tool.toolfaces))
        self._remember(rows, start, decision.probability)
        valid = [one for one in soft.candidates if one.code < most]
        return max(valid, key=lambda one: one.probability[0]).code if valid else 0

    def _decode(self, rows: Indices, length: int, start: int) -> segment.Decision:
        decision = self._decode_once(rows, length, start)
        change = self._follow_clock(decision)
        # Half a sample at the ends of the window blurs the channel: once more on the better clock.
        window = SAMPLES_PER_TU * min(_HISTORY_TU, length + _BEFORE_TU + self._tool.sync.length_tu)
        return self._decode_once(rows, length, start) if abs(change) * window > 0.5 else decision

    def _decode_once(self, rows: Indices, length: int, start: int) -> segment.Decision:
        begin = max(start - SAMPLES_PER_TU * _HISTORY_TU, -SAMPLES_PER_TU * _BEFORE_TU)
        begin = max(begin, math.ceil((self._grid.first - self._start) / self._pace))
        count = start + SAMPLES_PER_TU * (length + _AFTER_TU) - begin
        pressure, known = self._grid.samples(self._at(begin), self._pace, count)
        edges, chances = np.array(self._edges) - begin, np.array(self._chances)
        stretch = segment.Stretch(pressure, known, edges, chances, rows, start - begin, self._parity)
        decision = segment.decode(stretch, self._channel)
        drift, variance, middle = decision.timing
        return dataclasses.replace(decision, timing=(drift, variance, middle + begin))

    def _follow_clock(self, decision: segment.Decision) -> float:
        """Turn the time axis about the middle of the pulses; returns the relative change of the pace."""
        drift, variance, middle = decision.timing
        self._clock_variance += _CLOCK_WALK**2
        gain = self._clock_variance / (self._clock_variance + variance)
        change = gain * drift
        self._clock_variance *= 1.0 - gain
        self._start -= middle * self._pace * change
        self._pace *= 1.0 + change
        return change

    def _remember(self, rows: Indices, start: int, probability: Array) -> None:
        for row, chance in zip(rows, probability, strict=True):
            for value in range(1 << row[1]):
                if chance[value] > 1e-3:
                    self._edges.append(float(start + SAMPLES_PER_TU * (row[0] + (1 << row[1]) - 1 - value)))
                    self._chances.append(float(chance[value]))
        oldest = start - SAMPLES_PER_TU * _HISTORY_TU - RESPONSE
        keep = next((k for k, edge in enumerate(self._edges) if edge >= oldest), len(self._edges))
        del self._edges[:keep], self._chances[:keep]


def _stretch(items: tuple[SequenceItem, ...], done: int) -> tuple[SequenceItem, ...]:
    """Next words of a sequence that are decoded together; a short rest joins the last stretch."""
    bits, end = 0, done
    while end < len(items) and bits < _STRETCH_BITS:
        bits += items[end].length
        end += 1
    if sum(item.length for item in items[end:]) < _STRETCH_BITS // 2:
        end = len(items)
    return items[done:end]


def _soft(decision: segment.Decision, rows: Indices, items: tuple[SequenceItem, ...], parity: int) -> list[Soft]:
    """Words with the probabilities of their codes at each temperature."""
    count = len(rows)
    forward, backward = np.empty((count, 16)), np.empty((count, 16))
    chance, even = np.empty((count, trellis.VALUES)), np.empty(count)
    ends = np.flatnonzero(rows[:, 2])
    firsts = np.concatenate([[0], ends[:-1] + 1])
    holds = np.empty((len(items), len(TEMPERATURES)))
    codes: list[dict[int, list[float]]] = [{} for _ in items]
    for t, temperature in enumerate(TEMPERATURES):
        given = (rows, decision.unary / temperature, decision.common / temperature, decision.level)
        trellis.forward_backward(*given, -1, forward, backward)
        trellis.marginals(rows, forward, backward, chance, even)
        holds[:, t] = even[ends] if parity == 0 else 1.0 - even[ends]
        trellis.forward_backward(*given, parity, forward, backward)
        evidence = trellis.marginals(rows, forward, backward, chance, even)
        found = np.empty((_BEAM, 2))
        for k, item in enumerate(items):
            made = trellis.best_words(*given, forward, backward, int(firsts[k]), found)
            for code, log in found[:made]:
                value = int(code) >> 1 if item.parity else int(code)
                codes[k].setdefault(value, [0.0] * len(TEMPERATURES))[t] += math.exp(min(log - evidence, 0.0))
    return [
        Soft(tuple(Candidate(code, tuple(p)) for code, p in codes[k].items()), tuple(holds[k]) if item.parity else None)
        for k, item in enumerate(items)
    ]
