# SPDX-License-Identifier: Apache-2.0
"""
Telemetry links of a scenario: the tool's signals go in; pressure and strokes, voltage or bytes come out.

The channels lag behind the simulation, because the tool must first decide what it sends: `advance` is called with the
time up to which the tool's signals are complete. The channels run in blocks of one second.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.coil_channel import CoilChannel, Place
from mwd_sensors.simulator.earth_channel import EarthChannel
from mwd_sensors.simulator.link_channels import (
    BLOCK_S,
    CoilLink,
    EarthLink,
    Heard,
    LinkChannel,
    MudLink,
    OnAir,
    WireLink,
)
from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.simulator.mud_line import wave_speed
from mwd_sensors.simulator.schedule import Rig, Timeline
from mwd_sensors.simulator.serial_channel import SerialChannel
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

FLOW_HZ = 5.0  # rate at which the tool measures the flow
_FLOW_SIGMA = 2e-4  # m^3/s; noise of the tool's own turbine
# Change of depth, m, after which the channels are computed again; it shifts the pulses by some milliseconds.
_DEEPER_M = 10.0


@dataclasses.dataclass(frozen=True)
class Telemetry:
    """Telemetry links of a scenario; depth, flow and pressure of the channels are those of the scenario."""

    tool: ToolConfiguration = setting(ToolConfiguration, "Configuration of the tool's transmission.")
    second_tool: ToolConfiguration | None = setting(
        None, "Configuration of a second, simultaneous link. null: one link."
    )
    mud: MudChannel = setting(MudChannel, "Mud channel of pulses or a siren: line, pumps, noise and valve.")
    earth: EarthChannel = setting(EarthChannel, "Earth channel of an EM tool: ground, string, electrodes and noise.")
    coil: CoilChannel = setting(CoilChannel, "Receiver of the field of a sonde: position, ground and noise.")
    serial: SerialChannel = setting(SerialChannel, "Errors of the line of a wired tool.")

    def __post_init__(self) -> None:
        """Raise ValueError if both tool configurations use the same link."""
        if self.second_tool is not None and self.second_tool.link == self.tool.link:
            raise ValueError(f"second_tool: uses the link {self.tool.link} like the first tool; give it another code")

    @property
    def tools(self) -> tuple[ToolConfiguration, ...]:
        """Configuration of each link."""
        return (self.tool,) if self.second_tool is None else (self.tool, self.second_tool)


class TelemetryLink:
    """
    Telemetry links of one simulation.

    Parameters
    ----------
    timeline : Timeline
        Depth and pumps of the simulation.
    rig : Rig
        Drilling flow and pressure.
    seed : int
        Seed of all noise.
    place : callable
        Position and axis of the sonde at a simulation time, s.
    clock : float
        Relative error of the tool's clock, positive if the clock runs fast.

    Attributes
    ----------
    late : int
        Number of pulses, symbol groups and frames that came too late for their channel and are lost.
    """

    def __init__(
        self, telemetry: Telemetry, timeline: Timeline, rig: Rig, seed: int, place: Place, clock: float = 0.0
    ) -> None:
        self._timeline, self._full, self._clock = timeline, rig.flow_lpm * 1e-3 / 60.0, clock
        self._well = dataclasses.replace(
            telemetry.mud.well,
            depth_m=self._depth(0.0),
            flow_m3_s=self._full,
            pressure_pa=rig.pressure_bar * 1e5,
        )
        self._channels = {tool.link: self._channel(telemetry, tool, seed, place) for tool in telemetry.tools}
        self._random = np.random.default_rng(np.random.SeedSequence(seed).spawn(64)[63])
        self._flows = 0
        self._done_s = 0.0
        self.late = 0

    def _channel(self, telemetry: Telemetry, tool: ToolConfiguration, seed: int, place: Place) -> LinkChannel:
        if tool.link == "em":
            ground = dataclasses.replace(telemetry.earth.ground, depth_m=self._well.depth_m)
            return EarthLink(dataclasses.replace(telemetry.earth, ground=ground), seed)
        if tool.link == "coil":
            return CoilLink(telemetry.coil, tool.coil, place, seed)
        if tool.link == "serial":
            return WireLink(telemetry.serial, tool.serial.baud, seed)
        return MudLink(dataclasses.replace(telemetry.mud, well=self._well), seed, self._flow_share)

    def _depth(self, at_s: float) -> float:
        return float(self._timeline.bit(np.array([at_s]))[0, 0])

    def send(self, signal: OnAir) -> None:
        """Transmit a signal whose times, except the start, are on the tool's clock; add its late parts to `late`."""
        self.late += self._channels[signal.link].send(signal.on_true_clock(self._clock))

    def flows(self, until_s: float) -> tuple[Array, Array]:
        """
        Return the flow that the tool measured since the last call, up to the simulation time until_s, s.

        Returns
        -------
        ndarray, shape (n,)
            Simulation times, s.
        ndarray, shape (n,)
            Flow at the tool's turbine, m^3/s: the flow of the pumps one wave travel time earlier.
        """
        count = max(math.floor(until_s * FLOW_HZ + 1e-9) - self._flows, 0)
        time = (self._flows + 1 + np.arange(count)) / FLOW_HZ
        self._flows += count
        delay = self._well.depth_m / wave_speed(self._well)
        noise = _FLOW_SIGMA * self._random.standard_normal(count)
        return time, np.maximum(self._flow_share(time - delay) * self._full + noise, 0.0)

    @property
    def flow_sigma(self) -> float:
        """1 sigma of the flow that the tool measures, m^3/s."""
        return _FLOW_SIGMA

    def advance(self, until_s: float) -> list[Heard]:
        """Return the received signals of all whole seconds up to a simulation time, s."""
        heard = []
        while self._done_s + BLOCK_S <= until_s + 1e-9:
            depth = self._depth(self._done_s)
            if abs(depth - self._well.depth_m) > _DEEPER_M:
                self._well = dataclasses.replace(self._well, depth_m=depth)
                for channel in self._channels.values():
                    channel.deepen(depth)
            self._done_s += BLOCK_S
            for channel in self._channels.values():
                heard += channel.advance(self._done_s)
        return heard

    def _flow_share(self, time: Array) -> Array:
        if self._full <= 0.0:
            return np.zeros(len(time))
        return np.asarray(np.maximum(self._timeline.flow(np.maximum(time, 0.0))[0] / self._full, 0.0))
