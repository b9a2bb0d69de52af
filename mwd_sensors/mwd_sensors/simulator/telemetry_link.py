"""
The link of a scenario: the tool's transmission goes in, the pressure at the standpipe and the strokes come out.

The channel follows the run at a distance, because the tool has to be asked first what it sends: `advance` is called
with the time up to which all of that is known. It runs in blocks of one second, whatever is asked for.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.mud_channel import RATE_HZ, MudChannel, Pressure
from mwd_sensors.simulator.mud_line import wave_speed
from mwd_sensors.simulator.schedule import Rig, Timeline
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

BLOCK_S = 1.0
PERIOD_S = 1.0 / RATE_HZ
FLOW_HZ = 5.0
_FLOW_SIGMA = 2e-4  # m^3/s; of the tool's own turbine
# Depth drilled after which the line is computed anew, m: a shift of the pulses by some milliseconds.
_DEEPER_M = 10.0


@dataclasses.dataclass(frozen=True)
class Telemetry:
    """The link of a scenario; depth, flow and pressure of the line are those of the run."""

    tool: ToolConfiguration = setting(ToolConfiguration, "what the tool sends, and how")
    mud: MudChannel = setting(MudChannel, "line, pumps, noise and valve")


class Heard(NamedTuple):
    """
    One block at the surface.

    Attributes
    ----------
    start_s : float
        Of its first sample, s of the run.
    pressure_pa : ndarray, shape (n,)
        At `RATE_HZ`.
    strokes : list of (int, float)
        Pump, from 1, and time of each stroke, s; in order of time.
    """

    start_s: float
    pressure_pa: Array
    strokes: list[tuple[int, float]]


class TelemetryLink:
    """
    The link of one run.

    Parameters
    ----------
    telemetry : Telemetry
    timeline : Timeline
        Depth and pumps.
    rig : Rig
        Drilling flow and pressure.
    seed : int
        Of all noise.
    """

    def __init__(self, telemetry: Telemetry, timeline: Timeline, rig: Rig, seed: int) -> None:
        self._timeline, self._full = timeline, rig.flow_lpm * 1e-3 / 60.0
        well = dataclasses.replace(
            telemetry.mud.well,
            depth_m=float(timeline.bit(np.zeros(1))[0, 0]),
            flow_m3_s=self._full,
            pressure_pa=rig.pressure_bar * 1e5,
        )
        self._well = well
        self._pressure = Pressure(
            dataclasses.replace(telemetry.mud, well=well), np.zeros((0, 2)), seed, self._flow_share, BLOCK_S
        )
        self._strokes_given = [0 for _ in telemetry.mud.pumps]
        self._random = np.random.default_rng(np.random.SeedSequence(seed).spawn(64)[63])
        self._flows = 0
        self.late = 0

    def send(self, pulses_s: Array) -> None:
        """
        Let the valve make pulses.

        pulses_s, shape (n, 2): begin and end of each, s of the run. One that comes too late for the channel is counted
        in `late` and left out.
        """
        for begin, end in np.asarray(pulses_s, dtype=float).reshape(-1, 2):
            if not self._pressure.add_pulse(float(begin), float(end)):
                self.late += 1

    def flows(self, until_s: float) -> tuple[Array, Array]:
        """
        Flow in the tool since the last call.

        Returns
        -------
        ndarray, shape (n,)
            Times, s of the run.
        ndarray, shape (n,)
            Flow as the tool's turbine has it, m^3/s: that of the pumps, one travel time of a wave ago.
        """
        count = max(math.floor(until_s * FLOW_HZ + 1e-9) - self._flows, 0)
        time = (self._flows + 1 + np.arange(count)) / FLOW_HZ
        self._flows += count
        delay = self._well.depth_m / wave_speed(self._well)
        noise = _FLOW_SIGMA * self._random.standard_normal(count)
        return time, np.maximum(self._flow_share(time - delay) * self._full + noise, 0.0)

    @property
    def flow_sigma(self) -> float:
        """1 sigma of the flow, m^3/s."""
        return _FLOW_SIGMA

    def advance(self, until_s: float) -> list[Heard]:
        """Blocks that end up to a time of the run, s."""
        blocks = []
        while self._pressure.seconds + BLOCK_S <= until_s + 1e-9:
            start = self._pressure.seconds
            depth = float(self._timeline.bit(np.array([start]))[0, 0])
            if abs(depth - self._well.depth_m) > _DEEPER_M:
                self._well = dataclasses.replace(self._well, depth_m=depth)
                self._pressure.deepen(self._well)
            pressure = self._pressure.block()
            blocks.append(Heard(start, pressure, self._new_strokes()))
        return blocks

    def _new_strokes(self) -> list[tuple[int, float]]:
        found = []
        for k, times in enumerate(self._pressure.strokes()):
            found += [(k + 1, float(at)) for at in times[self._strokes_given[k] :]]
            self._strokes_given[k] = len(times)
        return sorted(found, key=lambda one: (one[1], one[0]))

    def _flow_share(self, time: Array) -> Array:
        if self._full <= 0.0:
            return np.zeros(len(time))
        return np.asarray(np.maximum(self._timeline.flow(np.maximum(time, 0.0))[0] / self._full, 0.0))
