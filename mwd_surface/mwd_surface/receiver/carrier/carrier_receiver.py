# SPDX-License-Identifier: Apache-2.0
"""Receiver of a carrier: pressure or voltage in, words out. The result does not depend on how the samples are cut."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import carrier as air
from mwd_sensors.telemetry.carrier import MARKER_SYMBOLS, BlockName
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Judged
from mwd_surface.receiver.carrier import baseband
from mwd_surface.receiver.carrier.baseband import PER_SYMBOL, Complex
from mwd_surface.receiver.carrier.carrier_block import MARGIN, BlockData, BlockDecision, BlockDecoder
from mwd_surface.receiver.carrier.whitening_complex import filtered, prediction_error_filter
from mwd_surface.receiver.grid import REACH
from mwd_surface.receiver.sampled_receiver import SampledReceiver
from mwd_surface.receiver.words import FrameReport, ReceivedWord, Reception, WordPlace, no_words, received

_HOP = 16  # step of the marker search, symbols
_PAST = 48  # symbols before a step from which its noise is estimated
_CLOCK = 1.2e-3  # largest relative error of the tool's clock that is searched
_STEP_RAD = 0.7  # difference of the phase at the end of a block between two clock trials
_KEPT_BLOCKS = 3  # length of the samples that are kept, blocks
# Smallest number of samples per period at the upper edge of the carrier's band.
_LEAST = 2.1
# Score below which a marker counts as absent at the place where the next block should begin.
_ABSENT = 3.0
_MOST_LOST = 2  # largest number of blocks in a row that fail before tracking is given up


@dataclasses.dataclass
class _Lock:
    """State of the tracking of blocks."""

    #: `start`, `name`: start and expected name of the next block.
    start: float
    symbol: float  #: steps per symbol
    name: BlockName
    taps: Complex  #: noise filter
    #: `blocks`, `lost`: number of blocks received, and of blocks lost in a row.
    blocks: int = 1
    lost: int = 0
    good_end: float = 0.0  #: end of the last good block, steps


@dataclasses.dataclass
class _Pass:
    """The pass of a sequence (all its words sent once) that is being received."""

    name: BlockName
    start_s: float
    end_s: float = 0.0
    ebn0: list[float] = dataclasses.field(default_factory=list)
    failed: int = 0


def least_rate(sent: air.Carrier) -> float:
    """Return the lowest number of samples per second that the receiver of a carrier needs."""
    return _LEAST * (sent.frequency_hz + sent.symbol_rate_hz)


class CarrierReceiver(SampledReceiver):
    """Receiver of a tool that sends on a carrier."""

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool, self._carrier = tool, tool.carrier
        super().__init__(baseband.step_s(tool.carrier))
        self._band = baseband.band_of(tool.carrier)
        self._decoder = BlockDecoder(tool.carrier)
        # Symbols from the start of a block to the middle of its marker.
        self._half = tool.carrier.half + 0.5 * MARKER_SYMBOLS
        self._hop_steps = round(_HOP * self._band.symbol)
        self._hop = 0
        self._candidate: tuple[float, float] | None = None
        self._lock: _Lock | None = None
        self._pass: _Pass | None = None
        self._frame = 0
        self._markers = 0
        self.last_sync_s = -math.inf
        self._clock_error = 0.0
        self._line = ""

    def finish(self) -> Reception:
        """Decode the samples that are left at the end; return their words and the report of the last frame."""
        done = self._take(*self._resampler.finish())
        if self._grid.end:
            # Append unknown samples, as after a gauge failure, so that an incomplete last block is decoded too.
            missing = np.zeros(round((self._carrier.block_symbols + 4 * _HOP) * self._band.symbol))
            line = self._line
            done.add(self._take(missing, missing))
            self._line = line
        done.frames += self._end_pass("")
        return done

    def why_nothing(self) -> str:
        """Return the reason, in one sentence, why no word was received."""
        if self._grid.end == 0:
            return no_words("there are no samples with rising times")
        if not self._markers:
            reason = (
                f"no marker of this tool on {self._carrier.frequency_hz:g} Hz; either the signal is too weak, the flow"
                " was not on long enough, or frequency_hz, symbol_rate_hz or modulation of the tool configuration is"
                " wrong"
            )
        else:
            reason = (
                f"{self._markers} times something like a marker was found, but no block with a correct check: the"
                " signal is too weak, the tool does not send, or it sends other sequences, words or block_bits than"
                " this configuration has"
            )
        return no_words(self._beside_line(reason))

    def _beside_line(self, reason: str) -> str:
        """Return `reason`, preceded by the line that disturbs the carrier, if such a line was found."""
        return f"{self._line}; {reason}" if self._line else reason

    def _check(self, spacing_s: float) -> None:
        least = least_rate(self._carrier)
        if spacing_s * least > 1.0:
            raise ValueError(
                f"there are {1.0 / spacing_s:.3g} samples a second; a carrier of {self._carrier.frequency_hz:g} Hz"
                f" needs {least:.3g} or more"
            )

    def _advance(self, done: Reception) -> None:
        """Search for markers and decode blocks in the samples that have arrived; add words and reports to `done`."""
        while True:
            if self._lock is not None:
                if self._needs(self._lock.start, self._lock.symbol) > self._grid.end:
                    return
                self._follow(self._lock, done)
            elif self._candidate is not None:
                if self._needs(self._candidate[0], self._band.symbol) > self._grid.end:
                    return
                self._try(*self._candidate, done)
            else:
                end = (self._hop + 1) * self._hop_steps + (MARKER_SYMBOLS + 2) * self._band.symbol
                if math.ceil(end + self._band.reach) + REACH > self._grid.end:
                    return
                self._search()
                self._hop += 1
                kept = _KEPT_BLOCKS * self._carrier.block_symbols + _PAST
                self._grid.forget(self._hop * self._hop_steps - round(kept * self._band.symbol))

    def _needs(self, start: float, symbol: float) -> int:
        return math.ceil(start + (self._carrier.block_symbols + MARGIN) * symbol * 1.01 + self._band.reach) + REACH

    def _window(self, begin: float, end: float) -> tuple[Array, Array, int]:
        """
        Return samples without their mean, a mask (1 for known samples), and the position of the first sample.

        The samples reach from `begin` to `end`, steps, and by the half width of the filter to both sides.
        """
        first = math.floor(begin - self._band.reach) - 1
        value, known = self._grid.samples(float(first), 1.0, math.ceil(end + self._band.reach) + 1 - first)
        known = known * (np.arange(first, first + len(value)) >= self._grid.first)
        mean = float(value @ known) / max(float(known.sum()), 1.0)
        return (value - mean) * known, known, first

    def _search(self) -> None:
        """Look for a marker in the next `_HOP` symbols; its block becomes the candidate that is decoded next."""
        symbol = self._band.symbol
        begin = self._hop * self._hop_steps
        past = min(_PAST, math.floor((begin - self._grid.first) / symbol))
        count = PER_SYMBOL * (past + _HOP + MARKER_SYMBOLS + 2)
        at = begin - past * symbol
        score = self._scores(at, count, symbol)[PER_SYMBOL * past : PER_SYMBOL * (past + _HOP)]
        best = int(np.argmax(score))
        if score[best] > THRESHOLD:
            start = begin + best * symbol / PER_SYMBOL - self._carrier.half * symbol
            self._candidate = start, float(score[best])
            self._markers += 1
            self.last_sync_s = self._grid.seconds(start)

    def _scores(self, at: float, count: int, symbol: float) -> Array:
        """Return the score of a marker at each of `count` positions from `at` on, in steps."""
        value, known, first = self._window(at, at + count * symbol / PER_SYMBOL)
        middle = at - first + 0.5 * symbol / PER_SYMBOL
        found, whole = baseband.envelope(value, known, self._band, middle, count, symbol)
        lines = baseband.lines(value, self._band)
        self._line = self._named(lines, first, len(value)) if known.all() else ""
        return marker_score(found, whole, baseband.line_columns(lines, self._band, count, symbol))

    def _named(self, lines: Array, first: int, count: int) -> str:
        """
        Return a clause on the strongest line on the carrier, with its pump if known; empty if there is no line.

        lines, shape (k,): frequencies, rad per step, strongest first; first, count: position and number of the samples.
        """
        carrier, step_s = self._carrier, self._grid.step_s
        hertz = lines / (2.0 * math.pi * step_s)
        near = hertz[np.abs(hertz - carrier.frequency_hz) < carrier.symbol_rate_hz]
        if not len(near):
            return ""
        line = float(near[0])
        made = self._grid.strokes.harmonic(line, self._grid.seconds(first), self._grid.seconds(first + count))
        if made is None:
            return f"a line of {line:.2f} Hz is on the carrier"
        return f"harmonic {made[1]} of pump {made[0]} ({line:.2f} Hz) is on the carrier"

    def _data(self, start: float, symbol: float) -> BlockData:
        begin = start - MARGIN * symbol
        value, known, first = self._window(begin, begin + self._decoder.rows * symbol / PER_SYMBOL)
        at = begin - first + 0.5 * symbol / PER_SYMBOL
        found, whole = baseband.envelope(value, known, self._band, at, self._decoder.rows, symbol)
        lines = baseband.lines(value, self._band)
        return BlockData(found, whole, baseband.line_columns(lines, self._band, self._decoder.rows, symbol))

    def _best(
        self, middle: float, symbols: list[float], taps: Complex | None
    ) -> tuple[BlockDecision, float, tuple[BlockName, bytes] | None, int]:
        """
        Decode a block with several clocks; symbols: steps per symbol of each clock.

        Return the best decision, the corrected steps per symbol, name and data bytes of the block if its check holds
        (else None), and the number of trials.
        """
        half, best = self._half, symbols[0]
        if len(symbols) > 1:
            claims = [self._decoder.decode(self._data(middle - half * one, one), taps, 1).evidence for one in symbols]
            best = symbols[int(np.argmax(claims))]
        tries = 0
        while True:
            decision = self._decoder.decode(self._data(middle - half * best, best), taps)
            trials = (checked(self._tool, bits) for bits in (decision.bits, *decision.turned))
            block = next((one for one in trials if one is not None), None)
            tries += 1
            # A remaining error of the clock rotates the second half of the block against the first.
            change = decision.turn / (self._band.omega * self._band.symbol)
            if block is not None or tries == 3 or abs(decision.turn) * self._carrier.block_symbols < 0.1:
                return decision, best * (1.0 - change), block, tries * (1 + len(decision.turned))
            best *= 1.0 - change

    def _try(self, start: float, score: float, done: Reception) -> None:
        """Decode the block at a marker that the search found; if its check holds, begin to track later blocks."""
        self._candidate = None
        symbol = self._band.symbol
        turned = self._band.omega * symbol * 0.5 * self._carrier.block_symbols * _CLOCK
        count = 2 * math.ceil(turned / _STEP_RAD) + 1
        clocks = [symbol * (1.0 + e) for e in np.linspace(-_CLOCK, _CLOCK, count)]
        middle = start + self._half * symbol
        decision, found, block, tries = self._best(middle, clocks, None)
        if block is None:
            return
        self._pass = None
        self._lock = _Lock(middle - self._half * found, found, block[0], decision.taps)
        self._report(done, self._lock, block[1], decision, odds_of_marker(score) / tries)

    def _follow(self, lock: _Lock, done: Reception) -> None:
        """
        Decode the next block at its expected place.

        A block whose check fails counts as missed. Tracking ends if the marker of such a block is absent too, or if
        more than `_MOST_LOST` blocks in a row fail.
        """
        middle = lock.start + self._half * lock.symbol
        decision, found, block, tries = self._best(middle, [lock.symbol], lock.taps)
        if block is None:
            at = lock.start + self._carrier.half * lock.symbol
            near = self._scores(at - _PAST * lock.symbol, PER_SYMBOL * (_PAST + MARKER_SYMBOLS + 2), lock.symbol)
            present = float(near[PER_SYMBOL * _PAST - 2 : PER_SYMBOL * _PAST + 3].max()) > _ABSENT
            lock.lost += 1
            if not present or lock.lost > _MOST_LOST:
                self._unlock(lock, done)
                return
            self._report(done, lock, None, decision)
            return
        # Average the symbol length over the blocks since the lock, or with a weight of 0.2 for each new block.
        gain = max(1.0 / (lock.blocks + 1), 0.2)
        lock.symbol += gain * (found - lock.symbol)
        lock.start = middle - self._half * lock.symbol
        lock.taps, lock.name, lock.lost = decision.taps, block[0], 0
        lock.blocks += 1
        self._report(done, lock, block[1], decision, ODDS_EXPECTED / tries)

    def _report(
        self, done: Reception, lock: _Lock, data: bytes | None, decision: BlockDecision, odds: float = 0.0
    ) -> None:
        """
        Report the words of the block at the lock, and move the lock to the next block.

        data: bytes of the block; None if its check fails: then its words are erased, with the probabilities from the
        decoder. odds: as in `believed`.
        """
        end = lock.start + self._carrier.block_symbols * lock.symbol
        span = float(self._grid.seconds(lock.start)), float(self._grid.seconds(end))
        now = self._pass
        if now is not None and (lock.name[:2] != now.name[:2] or lock.name.place <= now.name.place):
            done.frames += self._end_pass("")
            now = None
        now = self._pass = now or _Pass(lock.name, span[0])
        now.name, now.end_s = lock.name, span[1]
        now.ebn0.append(decision.ebn0_db)
        if data is None:
            now.failed += 1
            done.words += erased(self._tool, (lock.name, self._frame), decision.bits, span)
        else:
            lock.good_end = end
            done.words += believed(self._tool, (lock.name, self._frame), data, odds, span)
        lock.start, lock.name = end, following(self._tool, lock.name)
        self._clock_error = lock.symbol / self._band.symbol - 1.0

    def _unlock(self, lock: _Lock, done: Reception) -> None:
        """Give up tracking and search again from the end of the last good block."""
        self._lock = None
        done.frames += self._end_pass(
            self._beside_line(
                "the carrier has ended: the flow is off, the signal is too weak, or the tool started a new transmission"
            )
        )
        self._hop = max(math.floor((lock.good_end - self._band.symbol) / self._hop_steps), 0)

    def _end_pass(self, reason: str) -> list[FrameReport]:
        last, self._pass = self._pass, None
        if last is None:
            return []
        if not reason and last.failed:
            reason = self._beside_line(f"the check of {last.failed} of {len(last.ebn0)} blocks failed")
        report = FrameReport(
            self._frame,
            last.name.kind,
            last.start_s,
            last.end_s,
            float(np.mean(last.ebn0)),
            self._clock_error,
            reason,
        )
        self._frame += 1
        return [report]


# Search for markers in noise: the score is the share of energy that the marker's symbols explain at any size and phase.


# Noise exceeds this score at one of about 3000 positions. A false marker costs one trial; the check of the block
# decides.
THRESHOLD = 8.0
_ORDER = 6


def marker_score(envelope: Complex, known: Array, lines: Complex) -> Array:
    """
    Return the score of a marker that begins at each value of the envelope.

    Parameters
    ----------
    envelope : ndarray, shape (n,)
        `PER_SYMBOL` values per symbol.
    known : ndarray, shape (n,)
        1 where the envelope is known.
    lines : ndarray, shape (n, k)
        Columns of the disturbing lines; they are fitted and subtracted first.

    Returns
    -------
    ndarray, shape (n - MARKER_SYMBOLS PER_SYMBOL,)
        Score; 0 where a tenth or more of the marker is unknown.
    """
    if lines.shape[1]:
        weighted = known[:, None] * lines
        gram = lines.conj().T @ weighted + 1e-6 * len(envelope) * np.eye(lines.shape[1])
        envelope = envelope - lines @ np.linalg.solve(gram, weighted.conj().T @ envelope)
    taps = prediction_error_filter(envelope * known, known, _ORDER)
    white = filtered(envelope * known, taps)
    shape = filtered(np.concatenate([np.repeat(air.marker(), PER_SYMBOL), np.zeros(_ORDER)]), taps)
    count = PER_SYMBOL * MARKER_SYMBOLS
    shape = shape[:count]
    length = len(white) - count
    got = scipy.signal.correlate(white, shape, mode="valid")[:length]
    squares = np.concatenate([[0.0], np.cumsum(np.abs(white) ** 2)])
    there = np.concatenate([[0.0], np.cumsum(known)])
    energy = squares[count : count + length] - squares[:length]
    rows = there[count : count + length] - there[:length]
    explained = np.abs(got) ** 2 / float(np.real(np.vdot(shape, shape)))
    score = rows * explained / np.maximum(energy, 1e-300)
    return np.where(rows > 0.9 * count, score, 0.0)


# Words of a carrier block and their confidence.


# Odds that a block is present at the place where the next block is expected after the last one.
ODDS_EXPECTED = 10.0
_PASSES_BY_CHANCE = 2.0**-16  # probability that the check of a wrong block holds
_BLOCKS_PER_SYMBOL = 1e-3  # prior of a block at a symbol: one block in about 500 symbols, with flow half the time
_HEADER_BITS = 8  # bits of a block before its first word
_ALTERNATIVES = 3  # number of alternatives of an erased word
# If the check of a block fails, the probability that all its bits are right must be at most _NO_SURPRISE. The log
# ratios of the bits are divided by _FLATTER until this is true.
_NO_SURPRISE, _FLATTER = 0.5, 1.25
# Upper bound of the confidence of words of a block whose check fails: the code cannot detect a rotation of all phases.
_MOST_ERASED = 0.9


def odds_of_marker(score: float) -> float:
    """
    Return the odds that a marker with this score is real, at most `ODDS_EXPECTED`.

    Noise exceeds a score x with probability exp(-x).
    """
    return min(_BLOCKS_PER_SYMBOL * math.exp(min(score, 50.0)), ODDS_EXPECTED)


def items_of(tool: ToolConfiguration, name: BlockName) -> tuple[SequenceItem, ...]:
    """Return the words of a block; empty where the configuration has no such block."""
    sequences = tool.surveys if name.kind == "survey" else tool.toolfaces
    if name.number >= len(sequences):
        return ()
    blocks = air.blocks_of(sequences[name.number], tool.carrier.block_bits)
    return blocks[name.place] if name.place < len(blocks) else ()


def following(tool: ToolConfiguration, name: BlockName) -> BlockName:
    """Return the next block: the next of the same sequence, else the first of the toolface sequence."""
    after = name._replace(place=name.place + 1)
    if items_of(tool, after):
        return after
    number = name.number if name.kind == "toolface" else max(min(name.number, len(tool.toolfaces) - 1), 0)
    return BlockName("toolface", number, 0)


def checked(tool: ToolConfiguration, bits: Array) -> tuple[BlockName, bytes] | None:
    """
    Return name and data of a block if its check, name, parities and fill bits are right, else None.

    bits: log posterior ratio of each bit, positive for 0.
    """
    block = air.read_block((bits < 0.0).astype(np.int64), tool.table_check)
    if block is None:
        return None
    items = items_of(tool, block[0])
    lengths = [item.length for item in items]
    sent = air.unpacked(block[1], lengths)
    filled = air.packed(sent, lengths, tool.carrier.block_bits) == block[1]
    holds = all(tool.parity_bit(code >> 1) == code & 1 for code, item in zip(sent, items, strict=True) if item.parity)
    return block if items and filled and holds else None


def believed(
    tool: ToolConfiguration, block: tuple[BlockName, int], data: bytes, odds: float, span: tuple[float, float]
) -> list[ReceivedWord]:
    """
    Return the words of a block whose check holds.

    block: name of the block, and number of the frame; odds: prior odds of the block divided by the number of trials;
    span: begin and end of the block, s.
    """
    name, frame = block
    confidence = 1.0 / (1.0 + _PASSES_BY_CHANCE / odds)
    items = items_of(tool, name)
    words = []
    for k, (item, sent) in enumerate(zip(items, air.unpacked(data, [one.length for one in items]), strict=True)):
        code = sent >> 1 if item.parity else sent
        place = WordPlace(frame, _index(tool, name) + k, name.kind, 1)
        words.append(received(tool, item, Judged(code, confidence, ()), span, place))
    return words


def erased(
    tool: ToolConfiguration, block: tuple[BlockName, int], bits: Array, span: tuple[float, float]
) -> list[ReceivedWord]:
    """Return the words of a block whose check fails; bits: log posterior ratios; other arguments as in `believed`."""
    name, frame = block
    # The code was sure of this block although its check fails, so the noise is worse than modelled: flatten the
    # probabilities until a failed check is not surprising.
    while _right(bits) > _NO_SURPRISE:
        bits = bits / _FLATTER
    whole = _right(bits)
    words = []
    at = _HEADER_BITS
    for k, item in enumerate(items_of(tool, name)):
        own = bits[at : at + item.bits]
        at += item.length
        # At least one bit of the block is wrong: subtract the case in which all bits are right from the word's
        # probability.
        confidence = _MOST_ERASED * max(_right(own) - whole, 0.0) / max(1.0 - whole, 1e-9)
        code = _number(own)
        weakest = np.argsort(np.abs(own), kind="stable")[:_ALTERNATIVES]
        others = tuple(
            (code ^ 1 << int(item.bits - 1 - bit), float(confidence * math.exp(-abs(own[bit])))) for bit in weakest
        )
        place = WordPlace(frame, _index(tool, name) + k, name.kind, 1)
        words.append(received(tool, item, Judged(code, confidence, others), span, place))
    return words


def _index(tool: ToolConfiguration, name: BlockName) -> int:
    """Return the index of the first word of a block within its sequence."""
    return sum(len(items_of(tool, name._replace(place=place))) for place in range(name.place))


def _right(bits: Array) -> float:
    """Return the probability that all bits are right if their errors are independent; bits: log posterior ratios."""
    return float(np.exp(-np.sum(np.log1p(np.exp(-np.abs(bits))))))


def _number(bits: Array) -> int:
    return int("".join("1" if bit < 0.0 else "0" for bit in bits), 2)
