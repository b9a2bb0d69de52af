# SPDX-License-Identifier: Apache-2.0
"""Receiver of a pulse tool: standpipe pressure in, words out. The result does not depend on how samples are cut."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Doubt
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.grid import REACH, STEPS_PER_TU
from mwd_surface.receiver.pulse import segment, synchronisation
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU
from mwd_surface.receiver.pulse.survey_memory import SurveyMemory
from mwd_surface.receiver.pulse.tracker import Tracker
from mwd_surface.receiver.sampled_receiver import SampledReceiver
from mwd_surface.receiver.words import Reception, no_words

# The search for syncs advances by one hop (an interval of this length) at a time. To search a hop, pressure before it
# is needed for the noise model, and pressure after it for the pulses that begin in the hop.
_HOP_TU = 32
_GUARD_TU = 8
# Time before and after flow-on plus transmit delay in which a sync is expected. It allows for the valve, the travel
# time of the wave, and the flow switch of the tool.
_BEFORE_S, _AFTER_S = 5.0, 15.0
# Data before a hop for the noise model: at most the time between flow-on and sync. Its coefficients need many samples,
# but data of starting pumps would spoil them.
_NOISE_TU, _NOISE_S = 50, 40.0
_SETTLED_S = 5.0  # time after flow-on until the pressure has settled, s
_KEPT_TU = 500  # length of the pressure that is kept before a hop, TU
# Samples per TU that the pulse code needs: 2 for each edge of a 2 TU pulse, and some margin for the filter.
LEAST_PER_TU = 2.5
# A sync scores about 20 at 6 dB per bit (`synchronisation`), and its score grows with its energy. The words after a
# sync with at least the score of 9 dB are strong enough to be read; a lower score may be a chance of the noise.
_SCORE_6_DB, _NEEDED_DB = 20.0, 6.0
_CLEAR_SYNC = 40.0


class PulseReceiver(SampledReceiver):
    """
    Receiver of one pulse tool.

    Parameters
    ----------
    flow : FlowSpans, optional
        Spans without flow in the same pressure, which the caller updates before each push; without them the receiver
        finds the spans itself.

    Raises
    ------
    ValueError
        This receiver does not read the code of the tool.
    """

    def __init__(self, tool: ToolConfiguration, flow: FlowSpans | None = None) -> None:
        if tool.code != "mary":
            raise ValueError(f"code: this receiver reads pulses (mary), not {tool.code}")
        super().__init__(tool.tu_s / STEPS_PER_TU)
        self._tool = tool
        self._flow, self._finds_flow = flow or FlowSpans(), flow is None
        self._surveys = SurveyMemory(tool, self._flow.rested)
        self._tracker = Tracker(tool, self._grid, self._flow, Doubt())
        quiet_s = min(_NOISE_S, tool.transmit_delay_s - _SETTLED_S)
        self._noise_tu = min(max(_NOISE_TU, round(quiet_s / tool.tu_s)), _KEPT_TU - _HOP_TU)
        self._hop = 0
        self._last = math.inf
        self._lowest, self._highest = math.inf, -math.inf
        self._reason, self._ebn0_db = "", math.nan
        self._best = -math.inf
        self.last_sync_s = -math.inf
        #: Response to a pulse and noise model after the last pass of a sequence.
        self.channel: segment.ChannelEstimate | None = None

    def successor(self, tool: ToolConfiguration, flow: FlowSpans) -> PulseReceiver:
        """Return a receiver for the same tool with another configuration; it keeps the doubt learned from parities."""
        after = PulseReceiver(tool, flow)
        after._tracker.doubt = self._tracker.doubt.following()
        return after

    def push(self, time_s: Array, value: Array) -> Reception:
        """
        Add samples; return the words and frames that they complete, as `SampledReceiver.push`.

        If no flow spans were given, the spans are also found from these samples.
        """
        if self._finds_flow:
            self._flow.push(time_s, value)
        return super().push(time_s, value)

    def finish(self) -> Reception:
        """Decode the samples that are left at the end; return their words and the reports of their frames."""
        done = self._take(*self._resampler.finish())
        # Append unknown samples, as after a gauge failure, so that the last word is decoded too, without its echoes.
        self._last = self._grid.end
        missing = np.zeros(STEPS_PER_TU * (2 * _HOP_TU + self._beyond))
        if self._grid.end:
            done.add(self._take(missing, missing))
        self._add(done, self._tracker.finish())
        return done

    def why_nothing(self) -> str:
        """Return the reason, in one sentence, why there is no word or none is believed."""
        if self._grid.end == 0:
            return no_words("there are no samples with rising times")
        # Tolerance for the rounding of the interpolation between equal samples.
        if self._highest - self._lowest <= 1e-9 * abs(self._highest):
            return no_words(f"the gauge is stuck at {self._highest / 1e5:.6g} bar")
        longest, needed = self._longest_flow_s, self._tool.transmit_delay_s + self._tool.head_s
        started = any(math.isfinite(span.end_s) for span in self._flow.spans)
        if longest >= needed and not started and self._best < _CLEAR_SYNC:
            # The words after a false sync say nothing about the signal.
            return no_words(
                "no sync of this tool in the pressure, which contains no start of the pumps, and the tool"
                " sends its sync after they start; begin before the pumps start; if their start is contained, the"
                f" signal is too weak for pulses of {self._tool.pulse_width_s:g} s, the tool does not send, or"
                " pulse_width_s or sync of the tool configuration is wrong"
            )
        # A wrong table lowers the energy of the words, but not the score of the sync.
        if self._reason and self._ebn0_db < _NEEDED_DB and self._best < _CLEAR_SYNC:
            return (
                f"no words believed: the signal is too weak, {self._ebn0_db:.0f} dB with pulses of"
                f" {self._tool.pulse_width_s:g} s, and words need {_NEEDED_DB:g} dB; use wider pulses"
            )
        if self._reason:
            return f"no words believed: {self._reason}"
        if longest < needed:
            return no_words(
                f"the flow was on for {longest:.0f} s at most, and the sync ends {needed:.0f} s after"
                " flow-on; keep the pumps on longer"
            )
        return self._why_no_sequence()

    def _why_no_sequence(self) -> str:
        """Return the reason why no sequence was received although the flow was on long enough."""
        # Noise reaches this score somewhere in the pressure in about one recording of ten.
        chance = math.log(max(self._grid.end / STEPS_PER_TU * SAMPLES_PER_TU, 1.0)) + 2.0
        if self._best < max(chance, synchronisation.THRESHOLD):
            return no_words(
                "no sync of this tool in the pressure; either the signal is too weak for pulses of"
                f" {self._tool.pulse_width_s:g} s, the tool does not send, or pulse_width_s or sync of the tool"
                " configuration is wrong"
            )
        if self._best < _CLEAR_SYNC:
            return no_words(
                f"the signal is too weak for words: its sync has about {_sync_db(self._best):.0f} dB with"
                f" pulses of {self._tool.pulse_width_s:g} s, and words need {_NEEDED_DB:g} dB all the time; use wider"
                " pulses"
            )
        return no_words(
            f"a clear sync ({_sync_db(self._best):.0f} dB), but no sequence of this configuration after it;"
            " check sequences, header_bits and parity"
        )

    @property
    def _longest_flow_s(self) -> float:
        """Longest time with flow, s, as far as the pressure shows it."""
        # After the end of the recording the grid has unknown samples, which `finish` appends.
        end_s = self._grid.seconds(min(self._grid.end, self._last))
        ends = [*(span.start_s for span in self._flow.spans), end_s]
        starts = [self._grid.seconds(0), *(span.end_s for span in self._flow.spans)]
        return max(0.0, *(end - start for start, end in zip(starts, ends, strict=True)))

    def _take(self, values: Array, known: Array) -> Reception:
        seen = values[known > 0.0]
        self._lowest = min(self._lowest, float(seen.min(initial=math.inf)))
        self._highest = max(self._highest, float(seen.max(initial=-math.inf)))
        return super()._take(values, known)

    def _check(self, spacing_s: float) -> None:
        if spacing_s * LEAST_PER_TU > self._tool.tu_s * (1.0 + 1e-6):
            raise ValueError(
                f"pressure has {1.0 / spacing_s:.3g} samples a second; pulses of {self._tool.pulse_width_s:g} s need"
                f" {LEAST_PER_TU / self._tool.tu_s:.3g} or more"
            )

    def _advance(self, done: Reception) -> None:
        """Run the search and decoding steps for which enough pressure has arrived, in the order in which it arrives."""
        while True:
            searched = STEPS_PER_TU * self._hop * _HOP_TU
            # A pass waits until the search for syncs has covered its beginning, because the tool may have restarted
            # there.
            needs, one = self._tracker.due(searched, self._search_needs - searched)
            if one is None or self._search_needs <= needs:
                if not self._searchable:
                    return
                for found, position in self._found():
                    self._tracker.offer(found, position)
            elif needs <= self._grid.end and one.ends() <= self._last:
                self._add(done, self._tracker.step(one))
            else:
                return

    def _add(self, done: Reception, more: Reception) -> None:
        """Add words and reports of a step to `done`, after earlier surveys have decided erased words."""
        if more.frames and self._tracker.leader is not None:
            self.channel = self._tracker.leader.channel
        for frame in more.frames:
            words = [word for word in more.words if word.frame == frame.frame]
            done.words += self._surveys.settle(words)
        for frame in more.frames:
            if frame.reason:
                self._reason, self._ebn0_db = frame.reason, frame.ebn0_db
        done.frames += more.frames
        done.provisional += more.provisional

    @property
    def _beyond(self) -> int:
        """Length of pressure after a hop that the search for syncs in this hop needs, TU (half a pulse width)."""
        return _GUARD_TU + self._tool.sync.edges_tu[-1] + 16

    @property
    def _search_needs(self) -> int:
        """Position of the grid up to which the next hop of the search needs pressure."""
        return STEPS_PER_TU * ((self._hop + 1) * _HOP_TU + self._beyond) + REACH

    @property
    def _searchable(self) -> bool:
        """Whether enough pressure has arrived to search the next hop."""
        return self._search_needs <= self._grid.end

    def _found(self) -> list[tuple[synchronisation.SyncFound, float]]:
        """Search the next hop for syncs; return them with their positions, and drop the pressure no longer needed."""
        pace = STEPS_PER_TU // SAMPLES_PER_TU
        begin_tu, end_tu = self._hop * _HOP_TU, (self._hop + 1) * _HOP_TU
        first_tu = max(begin_tu - self._noise_tu, -(-self._grid.first // STEPS_PER_TU), 0)
        count = SAMPLES_PER_TU * (end_tu + self._beyond - first_tu)
        start = float(STEPS_PER_TU * first_tu)
        pressure, known = self._grid.samples(start, float(pace), count)
        angles = self._grid.angles(start, float(pace), count)
        low, high = (SAMPLES_PER_TU * (tu - first_tu) for tu in (begin_tu, end_tu))
        guard = SAMPLES_PER_TU * _GUARD_TU
        # During a transmission use its noise model, because a new estimate of the noise would contain the pulses.
        leader = self._tracker.leader
        whitener = None if leader is None else leader.channel.whitener
        least = synchronisation.EXPECTED_THRESHOLD if self._expected(end_tu) else synchronisation.THRESHOLD
        spans = (low - guard, high + guard)
        found = synchronisation.search(pressure, known, self._tool, *spans, whitener, angles, least)
        self._hop += 1
        self._grid.forget(int(min(self._tracker.oldest(), STEPS_PER_TU * (self._hop * _HOP_TU - _KEPT_TU))))
        both = [(one, start + one.at * pace) for one in (found, None if found is None else found.other) if one]
        # A start far beyond the end of the hop may be the edge of a later sync, which the next hop finds.
        both = [(one, position) for one, position in both if position < STEPS_PER_TU * (end_tu + _GUARD_TU // 2)]
        for one, position in both:
            self._best = max(self._best, one.score)
            if one.score >= synchronisation.THRESHOLD:
                self.last_sync_s = max(self.last_sync_s, self._grid.seconds(position))
        return both

    def _expected(self, end_tu: int) -> bool:
        """Return whether, after the last flow-on, the tool should send its sync in the hop that ends at end_tu, TU."""
        end_s = self._grid.seconds(STEPS_PER_TU * end_tu)
        late_s = end_s - self._flow.on_since(end_s) - self._tool.transmit_delay_s
        return -_BEFORE_S <= late_s <= _AFTER_S + _HOP_TU * self._tool.tu_s


def _sync_db(score: float) -> float:
    """Return the ratio of energy per bit to noise density, dB, estimated from the score of a sync."""
    return 6.0 + 10.0 * math.log10(score / _SCORE_6_DB)


def decode(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array] | None = None
) -> Reception:
    """
    Return the words of a whole recording, and the reports of its frames.

    strokes: times, s, of the strokes of each pump; other arguments as in `PulseReceiver.push`.
    """
    receiver = PulseReceiver(tool)
    for pump, times in (strokes or {}).items():
        receiver.strokes(pump, times)
    done = receiver.push(np.asarray(time_s, dtype=float), np.asarray(pressure_pa, dtype=float))
    done.add(receiver.finish())
    return done
