# SPDX-License-Identifier: Apache-2.0
"""
The echoes that a tool may send without having received a new command.

The tool repeats the last command it received: counter, command, argument. The counter has seven values, so a code
comes again; an echo proves that a command arrived only where the tool could not have sent that code before. Those are
the codes to tell apart: the echo heard last, and the commands sent since that the tool may have received unheard.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mwd_sensors.telemetry.downlink import COUNTERS, Frame, frame_of, next_counter


class ToolEcho:
    """
    Codes that the tool may repeat now.

    Parameters
    ----------
    heard : int, optional
        Code heard last; None: none was heard yet, so any code is possible.
    sent : sequence of int
        Codes sent since, oldest first, of which no echo was heard.
    """

    def __init__(self, heard: int | None = None, sent: Sequence[int] = ()) -> None:
        self.heard = heard
        # With each code the steady time, s, from which another echo shows that the command was not received.
        self._sent = dict.fromkeys(sent, math.nan)

    @property
    def sent(self) -> tuple[int, ...]:
        """Codes sent since the last echo, oldest first."""
        return tuple(self._sent)

    def send(self, code: int, answered_by: float) -> None:
        """Note that a command begins; answered_by: steady time, s, by which its echo is heard if it is received."""
        self._sent.pop(code, None)
        self._sent[code] = answered_by

    def hear(self, code: int, now: float, answer_s: float) -> None:
        """Take an echo; answer_s: longest time from a command to its echo, s."""
        if code in self._sent:
            # Commands arrive in their order: the tool no longer repeats an earlier one.
            codes = list(self._sent)
            for old in codes[: codes.index(code) + 1]:
                del self._sent[old]
        else:
            # The word may have been on its way when a command arrived, but not for longer than an answer takes.
            self._sent = {
                old: now + answer_s if math.isnan(by) else by for old, by in self._sent.items() if not by < now
            }
        self.heard = code

    def possible(self, code: int) -> bool:
        """Whether the tool may repeat this code without receiving a new command."""
        return self.heard is None or code == self.heard or code in self._sent

    def numbered(self, frame: Frame, last: int) -> tuple[Frame, bool]:
        """
        Return the frame with the counter to send, and whether its echo will prove that the command arrived.

        last : counter sent last, 0: not known. Then the counters furthest behind that of the echo come first, since a
        surface that lost its memory may have sent those behind it a moment ago.
        """
        known = frame_of(self.heard) if self.heard is not None else None
        if last == 0 and known is not None:
            counters = [(known.counter - 2 - k) % (COUNTERS - 1) + 1 for k in range(COUNTERS - 1)]
        else:
            counters = [next_counter(last)]
            while len(counters) < COUNTERS - 1:
                counters.append(next_counter(counters[-1]))
        frames = [frame._replace(counter=counter) for counter in counters]
        for one in frames:
            if not self.possible(one.echo):
                return one, True
        return frames[0], False
