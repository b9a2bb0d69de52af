# SPDX-License-Identifier: Apache-2.0
"""
Echoes that a tool may send without having received a new command.

The tool repeats the last command that it received: counter, command and argument, encoded in one code. The counter has
seven values, so codes repeat. An echo proves that a command arrived only if the tool could not have sent that code
before. The possible codes are the last echo received, and the codes of commands sent since then that the tool may have
received although no echo of them was received.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mwd_sensors.telemetry.downlink import COUNTERS, DownlinkFrame, frame_of, next_counter


class ToolEcho:
    """
    Set of the echo codes that the tool may still send for earlier commands.

    Parameters
    ----------
    heard : int, optional
        Code of the last echo received; None: no echo was received yet, so any code is possible.
    sent : sequence of int
        Codes of the commands sent since the last echo, oldest first.
    """

    def __init__(self, heard: int | None = None, sent: Sequence[int] = ()) -> None:
        self.heard = heard
        # For each code, the steady time, s, after which an echo with another code shows that the tool did not receive
        # the command.
        self._sent = dict.fromkeys(sent, math.nan)

    @property
    def sent(self) -> tuple[int, ...]:
        """Codes of the commands sent since the last echo, oldest first."""
        return tuple(self._sent)

    def send(self, code: int, answered_by: float) -> None:
        """Record the start of a command; answered_by: steady time, s, by which its echo must arrive."""
        self._sent.pop(code, None)
        self._sent[code] = answered_by

    def hear(self, code: int, now: float, answer_s: float) -> None:
        """Process an echo; now: steady time, s; answer_s: longest time from a command to its echo."""
        if code in self._sent:
            # Commands arrive in order, so the tool no longer repeats an earlier command.
            codes = list(self._sent)
            for old in codes[: codes.index(code) + 1]:
                del self._sent[old]
        else:
            # The tool may have sent this echo before a command arrived: wait until the command's echo is overdue.
            self._sent = {
                old: now + answer_s if math.isnan(by) else by for old, by in self._sent.items() if not by < now
            }
        self.heard = code

    def possible(self, code: int) -> bool:
        """Return whether the tool may repeat this code without receiving a new command."""
        return self.heard is None or code == self.heard or code in self._sent

    def numbered(self, frame: DownlinkFrame, last: int) -> tuple[DownlinkFrame, bool]:
        """
        Return the frame with the counter to send, and whether its echo will prove that the command arrived.

        last: counter of the last command sent; 0: unknown, because the surface lost its memory. Counters are tried in
        rising order, starting after `last`. If `last` is unknown and the tool has echoed counter c, they are tried in
        falling order, starting with c - 1: the surface may have sent c + 1 and the following counters before it lost
        its memory, so an echo of these would prove nothing.
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
