# SPDX-License-Identifier: Apache-2.0
"""Receiver of a pulse tool: standpipe pressure in, words out. The result does not depend on how samples are cut."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import PULSE_CODES, ToolConfiguration
from mwd_surface.receiver.belief import Doubt
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.grid import REACH, STEPS_PER_TU
from mwd_surface.receiver.pulse import segment, synchronisation
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU
from mwd_surface.receiver.pulse.survey_memory import SurveyMemory
from mwd_surface.receiver.pulse.transmission import Transmission
from mwd_surface.receiver.sampled_receiver import SampledReceiver
from mwd_surface.receiver.words import Reception

# The search for syncs advances in hops; each also needs data before it for the noise model and after it for the pulses.
_HOP_TU = 32
_GUARD_TU = 8
# Data before a hop for the noise model: at most the time between flow-on and sync. Its coefficients need many samples,
# but data of starting pumps would spoil them.
_NOISE_TU, _NOISE_S = 50, 40.0
_SETTLED_S = 5.0
_KEPT_TU = 500
# A sync replaces a doubtful transmission at once if its score is larger by this factor.
_SURER = 1.5
# Samples per TU that the pulse code needs: 2 for each edge of a 2 TU pulse, and some margin for the filter.
LEAST_PER_TU = 2.5

# A sync and its position on the grid.
Waiting = tuple[synchronisation.SyncFound, float]


class PulseReceiver(SampledReceiver):
    """
    Receiver of one pulse tool.

    Parameters
    ----------
    tool : ToolConfiguration
    flow : FlowSpans, optional
        Spans without flow in the same pressure, which the caller updates before each push; without them the receiver
        finds the spans itself.

    Attributes
    ----------
    channel : Channel or None
        Response to a pulse and noise model after the last pass of a sequence.

    Raises
    ------
    ValueError
        This receiver does not read the code of the tool.
    """

    def __init__(self, tool: ToolConfiguration, flow: FlowSpans | None = None) -> None:
        if tool.code not in PULSE_CODES:
            raise ValueError(f"code: this receiver reads pulses ({', '.join(PULSE_CODES)}), not {tool.code}")
        super().__init__(tool.tu_s / STEPS_PER_TU)
        self._tool = tool
        self._flow, self._finds_flow = flow or FlowSpans(), flow is None
        self._surveys = SurveyMemory(tool, self._flow.rested)
        parity = any(item.parity for items in (*tool.surveys, *tool.toolfaces) for item in items)
        self._doubt = Doubt(parity)
        quiet_s = min(_NOISE_S, tool.transmit_delay_s - _SETTLED_S)
        self._noise_tu = min(max(_NOISE_TU, round(quiet_s / tool.tu_s)), _KEPT_TU - _HOP_TU)
        self._hop = 0
        self._frame = 0
        self._last = math.inf
        self._active: Transmission | None = None
        self._last_sync = -math.inf
        self._waiting: Waiting | None = None
        self._lowest, self._highest = math.inf, -math.inf
        self._reason = ""
        self._syncs = 0
        self.last_sync_s = -math.inf
        self.channel: segment.Channel | None = None

    def successor(self, tool: ToolConfiguration, flow: FlowSpans) -> PulseReceiver:
        """Return a receiver for the same tool with another configuration; it keeps the doubt learned from parities."""
        after = PulseReceiver(tool, flow)
        after._doubt = self._doubt.following()
        return after

    def push(self, time_s: Array, value: Array) -> Reception:
        """Add samples, as `SampledReceiver.push`."""
        if self._finds_flow:
            self._flow.push(time_s, value)
        return super().push(time_s, value)

    def finish(self) -> Reception:
        """Decode the samples that are left at the end and return their words."""
        done = self._take(*self._resampler.finish())
        # Append unknown samples, as after a gauge failure, so that the last word is decoded too, without its echoes.
        self._last = self._grid.end
        missing = np.zeros(STEPS_PER_TU * (2 * _HOP_TU + self._beyond))
        if self._grid.end:
            done.add(self._take(missing, missing))
        if self._active is not None:
            self._add(done, self._active.close())
        return done

    def why_nothing(self) -> str:
        """Return the reason, in one sentence, why there is no word or none is believed."""
        if self._grid.end == 0:
            return "no words: there are no samples with rising times"
        # Tolerance for the rounding of the interpolation between equal samples.
        if self._highest - self._lowest <= 1e-9 * abs(self._highest):
            return f"no words: the gauge is stuck at {self._highest:.6g} Pa"
        if self._reason:
            return f"no words believed: {self._reason}"
        if not self._syncs:
            return (
                f"no words: no sync of this tool in the pressure; check pulse_width_s ({self._tool.pulse_width_s:g} s)"
                " and sync of the tool configuration, and that the flow was on long enough"
            )
        return (
            f"no words: {self._syncs} syncs, but no sequence of this configuration after them; check sequences,"
            " header_bits and parity"
        )

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
        """Run the search and decoding steps for which the pressure is there, in the order of the time they need."""
        while True:
            search_needs = STEPS_PER_TU * ((self._hop + 1) * _HOP_TU + self._beyond) + REACH
            active = self._active
            # A pass waits until the search has passed its beginning, because the tool may have started anew there.
            ready = active is not None and active.begins() <= STEPS_PER_TU * self._hop * _HOP_TU
            if active is not None and ready and active.needs() <= self._grid.end and active.ends() <= self._last:
                self._add(done, active.step(self._waiting is not None))
                self._frame = active.frame
                if active.lost:
                    self._active = self._successor(active)
                elif self._waiting is not None and active.confirmed and active.heard > self._waiting[1]:
                    self._waiting = None
            elif not ready and search_needs <= self._grid.end:
                self._search(done)
                self._hop += 1
                self._grid.forget(
                    STEPS_PER_TU * (self._hop * _HOP_TU - _KEPT_TU) if self._active is None else self._oldest()
                )
            else:
                return

    def _add(self, done: Reception, more: Reception) -> None:
        """Add the result of a step (at most one pass), after settling its words against earlier surveys."""
        if more.frames and self._active is not None:
            self.channel = self._active.channel
        more.words = self._surveys.settle(more.words)
        self._reason = next((frame.reason for frame in reversed(more.frames) if frame.reason), self._reason)
        done.add(more)

    def _successor(self, lost: Transmission) -> Transmission | None:
        """Return the transmission of a waiting sync that began while the lost one seemed to go on, if there is one."""
        waiting, self._waiting = self._waiting, None
        if waiting is None or (lost.confirmed and waiting[1] < lost.heard):
            return None
        return self._begun(*waiting)

    def _begun(self, found: synchronisation.SyncFound, position: float) -> Transmission:
        """Return the transmission that begins with a sync at a position of the grid."""
        self._doubt = self._doubt.following()
        return Transmission(self._tool, self._grid, found, position, self._frame, self._doubt)

    @property
    def _beyond(self) -> int:
        """Pressure after a hop that its syncs need, TU."""
        return _GUARD_TU + self._tool.sync.edges_tu[-1] + 16

    def _oldest(self) -> int:
        needed = self._active.keeps() if self._active is not None else self._grid.end
        return int(min(needed, STEPS_PER_TU * (self._hop * _HOP_TU - _KEPT_TU)))

    def _search(self, done: Reception) -> None:
        pace = STEPS_PER_TU // SAMPLES_PER_TU
        begin_tu, end_tu = self._hop * _HOP_TU, (self._hop + 1) * _HOP_TU
        first_tu = max(begin_tu - self._noise_tu, -(-self._grid.first // STEPS_PER_TU), 0)
        count = SAMPLES_PER_TU * (end_tu + self._beyond - first_tu)
        pressure, known = self._grid.samples(float(STEPS_PER_TU * first_tu), float(pace), count)
        low, high = (SAMPLES_PER_TU * (tu - first_tu) for tu in (begin_tu, end_tu))
        guard = SAMPLES_PER_TU * _GUARD_TU
        active = self._active
        # Before a transmission has words, its noise model may have treated noise as pulses, so also search with a new
        # noise model.
        known_noise = () if active is None else (active.channel.stepwise,)
        learnt = (None,) if active is None or not active.confirmed else ()
        spans = (low - guard, high + guard)
        searches = (synchronisation.search(pressure, known, self._tool, *spans, w) for w in (*known_noise, *learnt))
        found = max((one for one in searches if one is not None), key=lambda one: one.score, default=None)
        if found is None:
            return
        # A start farther after the hop may be the flank of a sync beyond the range; the next hop finds that sync.
        least, most = self._last_sync + STEPS_PER_TU * _GUARD_TU, STEPS_PER_TU * (end_tu + _GUARD_TU // 2)
        start = float(STEPS_PER_TU * first_tu)
        position = start + found.at * pace
        if not least <= position < most:
            return
        other = None if found.other is None else (found.other, start + found.other.at * pace)
        other = other if other is not None and least <= other[1] < most else None
        self._last_sync = position
        self._syncs += 1
        self.last_sync_s = self._grid.seconds(position)
        if active is not None and active.expects_sync(position):
            active.offer_sync()
        elif active is not None and active.replaced_by(position, found.score):
            waiting = self._waiting
            self._begin(found, position, other)
            if waiting is not None and abs(waiting[1] - position) >= STEPS_PER_TU * _GUARD_TU:
                self._wait(*waiting)
        elif active is not None and (active.sound or found.score <= _SURER * active.score):
            # Data can look like a sync by chance: keep it for the case that the transmission breaks off.
            self._wait(found, position)
        else:
            if active is not None:
                self._add(done, active.close())
                self._frame = active.frame
            self._begin(found, position, other)

    def _begin(self, found: synchronisation.SyncFound, position: float, other: Waiting | None) -> None:
        """Begin a transmission with a sync at a position of the grid; keep the next best sync waiting."""
        self._active, self._waiting = self._begun(found, position), other

    def _wait(self, found: synchronisation.SyncFound, position: float) -> None:
        """Keep the best waiting sync until the transmission breaks off."""
        if self._waiting is None or found.score > self._waiting[0].score:
            self._waiting = (found, position)


def decode(
    tool: ToolConfiguration, time_s: Array, pressure_pa: Array, strokes: Mapping[int, Array] | None = None
) -> Reception:
    """Decode a whole recording with strokes per pump; arguments as in `PulseReceiver.push` and `strokes`."""
    receiver = PulseReceiver(tool)
    for pump, times in (strokes or {}).items():
        receiver.strokes(pump, times)
    done = receiver.push(np.asarray(time_s, dtype=float), np.asarray(pressure_pa, dtype=float))
    done.add(receiver.finish())
    return done
