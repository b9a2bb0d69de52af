# SPDX-License-Identifier: Apache-2.0
"""Commands that a tool has received by downlink, and the tool configuration that results from them."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.telemetry import tool_commands
from mwd_sensors.telemetry.downlink import HEAD, LEVELS, TAIL, Downlink, DownlinkFrame, decode
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration


class Commands:
    """
    Commands received by one tool.

    Parameters
    ----------
    tool : ToolConfiguration
        Configuration as delivered; if it has no downlink, the tool accepts no commands.
    """

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool, self._downlink = tool, tool.downlink
        self._decoder = None if tool.downlink is None else DownlinkDecoder(tool.downlink)
        self._received: deque[ReceivedCommand] = deque()
        self.settings = tool_commands.ToolSettings()  #: settings after the commands received so far
        #: Code of the last command, which the tool transmits as confirmation; 0 before the first command.
        self.echo = 0

    def listen(self, medium: str, stamps: Stamps, signal: Array) -> None:
        """
        Add samples of the flow, m^3/s, or the rotation, rad/s, shape (n,), with their stamps, ns, shape (n,).

        medium: name of the quantity; the samples are ignored if the downlink uses the other one.
        """
        if self._decoder is not None and self._downlink is not None and self._downlink.medium == medium:
            self._received.extend(self._decoder.push(stamps, signal))

    def obey(self, now: int) -> bool:
        """
        Apply the commands that the tool has decoded at a time, ns; return whether the code to echo has changed.

        A command that the tool cannot carry out is ignored and not echoed.
        """
        before = self.echo
        while self._decoder is not None and self._received:
            if now < self._received[0].stamp_ns + self._decoder.delay_ns:
                break
            frame = self._received.popleft().frame
            settings = self.settings.after(frame)
            try:
                tool_commands.applied(self._tool, settings)
            except ValueError:
                # The tool cannot carry out the command. It does not echo the command, so that the surface detects this.
                continue
            self.settings, self.echo = settings, frame.echo
        return self.echo != before

    def speak(self) -> None:
        """End the muting; the tool does this when the flow is switched on again."""
        self.settings = self.settings._replace(mute=False)

    def tool(self) -> ToolConfiguration:
        """Return the tool configuration, changed by the commands received so far."""
        return self._tool if self._downlink is None else tool_commands.applied(self._tool, self.settings)


# Decode commands from the surface in the rotation or the flow that the tool measures.


_CELL_NS = 200_000_000  # the signal is averaged over cells of this length, ns
_DATA = 9  # number of data symbols of a command
_SAMPLES = len(HEAD) + _DATA + len(TAIL)  # number of symbols of a command
# Steps of the signal in rad/s or m^3/s: the signal is rounded to 1e-6 rad/s or 1e-9 m^3/s, far below sensor noise, and
# summed as whole numbers. The values are steps per unit.
_SCALE = {"rotation": 1e6, "flow": 1e9}
# Smallest and largest allowed ratio of the measured to the configured drop of flow or rotation: flow meters are
# inexact, and the string slips.
_DROP = (0.6, 1.5)
# Largest difference between the high values of one command, as a share of the drop: half the distance between two
# levels.
_STEADY = 1.0 / (2.0 * (LEVELS - 1))
# Largest allowed distance of the measured levels from whole levels, rms and maximum. Random values have an rms of 0.29.
_RMS, _MOST = 0.2, 0.42
# Longest gap without samples, in cells; after a longer gap the decoder restarts.
_GAP = 10


class ReceivedCommand(NamedTuple):
    """A command, and the stamp of its end, ns."""

    frame: DownlinkFrame
    stamp_ns: int


class DownlinkDecoder:
    """Decoder of commands in a stream of samples of flow or rotation."""

    def __init__(self, downlink: Downlink) -> None:
        self._downlink, self._scale = downlink, _SCALE[downlink.medium]
        cell_s = _CELL_NS * 1e-9
        self._half = max(round(0.5 * downlink.hold_s / cell_s), 1)
        places = [round(k * downlink.symbol_s / cell_s) for k in range(_SAMPLES)]
        self._places = [place - places[-1] - 1 for place in places]
        # Number of cells after the first match in which a better match of the same command may follow.
        self._settle = max(round(0.5 * downlink.symbol_s / cell_s), 1)
        self._begin()

    @property
    def delay_ns(self) -> int:
        """Longest time from the end of a command until it is decoded, ns."""
        return (self._settle + 2) * _CELL_NS

    def _begin(self) -> None:
        self._cell: int | None = None
        self._sum = self._count = self._value = 0
        self._once = self._twice = 0
        self._history: deque[int] = deque([0] * (2 * self._half + 1), maxlen=2 * self._half + 1)
        self._smooth: deque[float] = deque(maxlen=-self._places[0])
        self._skip = 2 * self._half
        self._best: tuple[float, ReceivedCommand] | None = None
        self._wait = 0

    def push(self, stamp_ns: Stamps, signal: Array) -> list[ReceivedCommand]:
        """
        Add samples in order of time, and return the commands that these samples complete.

        stamp_ns, shape (n,): ns. signal, shape (n,): rotation about the axis, rad/s, or flow, m^3/s; values that are
        not finite are ignored.
        """
        known = np.isfinite(signal)
        cells = stamp_ns[known] // _CELL_NS
        if not len(cells):
            return []
        whole = np.round(signal[known] * self._scale).astype(np.int64)
        starts = np.concatenate([[0], np.flatnonzero(np.diff(cells)) + 1])
        found: list[ReceivedCommand] = []
        counts = np.diff(np.append(starts, len(cells)))
        for cell, total, count in zip(cells[starts], np.add.reduceat(whole, starts), counts, strict=True):
            found += self._add_cell(int(cell), int(total), int(count))
        return found

    def _add_cell(self, cell: int, total: int, count: int) -> list[ReceivedCommand]:
        """
        Add samples of one averaging interval (cell of `_CELL_NS`); return the commands that are now complete.

        Later calls may add further samples of the same cell.

        cell: start of the cell divided by its length; total: sum of the samples, in steps of `_SCALE`; count: number of
        samples.
        """
        found: list[ReceivedCommand] = []
        if self._cell is not None and not 0 <= cell - self._cell <= _GAP:
            self._begin()
        if self._cell is not None and cell > self._cell:
            self._value = self._sum // self._count
            for k in range(self._cell, cell):
                found += self._close(k)
            self._sum = self._count = 0
        self._cell = cell
        self._sum += total
        self._count += count
        return found

    def _close(self, cell: int) -> list[ReceivedCommand]:
        """Smooth the signal up to the end of a cell; return a command in a list when no better match can follow."""
        half, history = self._half, self._history
        self._once += self._value
        self._twice += self._once
        history.append(self._twice)
        if self._skip:
            self._skip -= 1
            return []
        self._smooth.append((history[-1] - 2 * history[half] + history[0]) / (half * half * self._scale))
        if len(self._smooth) == self._smooth.maxlen:
            fit = self._fit(cell)
            if fit is not None and (self._best is None or fit[0] < self._best[0]):
                self._wait = self._wait if self._best is not None else self._settle
                self._best = fit
        if self._best is None:
            return []
        if self._wait:
            self._wait -= 1
            return []
        received, self._best = self._best[1], None
        self._smooth.clear()
        return [received]

    def _fit(self, cell: int) -> tuple[float, ReceivedCommand] | None:
        """Return rms error of the levels and command, if a command ends with this cell; otherwise None."""
        smooth, places, downlink = self._smooth, self._places, self._downlink
        first, low, second, last = (smooth[places[k]] for k in (0, 1, 2, -1))
        high = (first + second + last) / 3.0
        drop = high - low
        expected = downlink.depth * high
        if high < downlink.least_value or not _DROP[0] * expected < drop < _DROP[1] * expected:
            return None
        if max(first, second, last) - min(first, second, last) > _STEADY * drop:
            return None
        read = [(smooth[places[len(HEAD) + k]] - low) / drop * (LEVELS - 1) for k in range(_DATA)]
        whole = [min(max(round(one), 0), LEVELS - 1) for one in read]
        off = [abs(one - level) for one, level in zip(read, whole, strict=True)]
        rms = (sum(one * one for one in off) / _DATA) ** 0.5
        if rms > _RMS or max(off) > _MOST:
            return None
        frame = decode(tuple(whole), downlink)
        return None if frame is None else (rms, ReceivedCommand(frame, (cell + 1) * _CELL_NS))
