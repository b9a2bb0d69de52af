# SPDX-License-Identifier: Apache-2.0
"""
Telemetry links of a scenario: the tool's signals go in; pressure and strokes, voltage or bytes come out.

The channels lag behind the simulation, because the tool must first decide what it sends: `advance` is called with the
time up to which the tool's signals are complete. The channels run in blocks of one second.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator import coil_channel, earth_channel, mud_channel
from mwd_sensors.simulator.carrier_tool import CarrierStream
from mwd_sensors.simulator.coil_channel import CoilChannel, CoilVoltage, Place
from mwd_sensors.simulator.earth_channel import EarthChannel, EarthVoltage
from mwd_sensors.simulator.mud_channel import MudChannel, Pressure, wave_speed
from mwd_sensors.simulator.schedule import Rig, Timeline
from mwd_sensors.simulator.serial_channel import SerialChannel, SerialStream
from mwd_sensors.telemetry.carrier import Coil
from mwd_sensors.telemetry.serial_frames import BITS_PER_BYTE
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

BLOCK_S = 1.0  # length of a block of received samples, s


class OnAir(NamedTuple):
    """A group of words, or a sync, that the tool transmits."""

    link: str  #: name of the link: mud_pulse, em, coil or serial
    start_s: float  #: simulation time of the start
    #: `edges_s`, `phases`, `octets`: content as in `telemetry.on_air.GroupSignal`; only the field that belongs to the
    #: link is filled.
    edges_s: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()
    octets: bytes = b""
    width_s: float = 0.0  #: duration of a pulse or symbol
    frequency_hz: float = 0.0  #: carrier frequency

    def on_true_clock(self, fast: float) -> OnAir:
        """
        Return the signal with all times in true time.

        fast is the relative error of the tool's clock, positive if it runs fast; start_s is true time already.
        """
        scale = 1.0 / (1.0 + fast)
        edges = tuple(edge * scale for edge in self.edges_s)
        return self._replace(edges_s=edges, width_s=self.width_s * scale, frequency_hz=self.frequency_hz / scale)


class Heard(NamedTuple):
    """One block of the received signal at the surface."""

    link: str
    #: `start_s`, `period_s`: simulation time of the first sample, and time between samples.
    start_s: float
    period_s: float
    values: NDArray[Any]  #: shape (n,); samples in Pa or V, or bytes of type uint8
    #: For a link through mud: pump number, from 1, and time of each stroke, s, in order of time.
    strokes: list[tuple[int, float]]


class SampledLink:
    """
    Channel of a link whose receiver samples a pressure or a voltage.

    Parameters
    ----------
    name : str
        Name of the link.
    source : CarrierStream
        Carrier of the tool, which `received` contains.
    received : Pressure, EarthVoltage or CoilVoltage
        Received signal, computed in blocks of `BLOCK_S`.
    rate_hz : float
        Sample rate of the received signal.
    """

    def __init__(
        self, name: str, source: CarrierStream, received: Pressure | EarthVoltage | CoilVoltage, rate_hz: float
    ) -> None:
        self._name, self._source, self._signal, self._rate_hz = name, source, received, rate_hz

    def send(self, signal: OnAir) -> int:
        """Transmit a signal; return how many of its pulses, symbol groups or frames are lost because they are late."""
        if not signal.phases:
            return 0
        if signal.start_s < self._signal.seconds:
            return 1
        self._source.add(signal.start_s, np.exp(1j * np.array(signal.phases)), signal.width_s, signal.frequency_hz)
        return 0

    def deepen(self, depth_m: float) -> None:
        """Continue with the bit at another measured depth, m; a link that does not depend on the depth ignores it."""

    def advance(self, until_s: float) -> list[Heard]:
        """Return the blocks received since the last call, up to a simulation time, s."""
        blocks = []
        while self._signal.seconds + BLOCK_S <= until_s + 1e-9:
            start = self._signal.seconds
            values = self._signal.block()
            blocks.append(Heard(self._name, start, 1.0 / self._rate_hz, values, self._new_strokes()))
        return blocks

    def _new_strokes(self) -> list[tuple[int, float]]:
        """Return the pump strokes since the last call, as in `Heard.strokes`."""
        return []


class MudLink(SampledLink):
    """
    Link through mud, by pulses or a siren.

    Parameters
    ----------
    flow : callable
        Returns the flow as a share of its full value at times, s.
    """

    def __init__(self, channel: MudChannel, seed: int, flow: Callable[[Array], Array]) -> None:
        self._well = channel.well
        self._pressure = Pressure(channel, np.zeros((0, 2)), seed, flow, BLOCK_S)
        siren = CarrierStream("mud")
        self._pressure.modulate(siren.drive)
        self._strokes_given = [0 for _ in channel.pumps]
        super().__init__("mud_pulse", siren, self._pressure, mud_channel.RATE_HZ)

    def send(self, signal: OnAir) -> int:
        """Transmit pulses of the valve or symbols of the siren; see `SampledLink`."""
        begins = [signal.start_s + edge for edge in signal.edges_s]
        late = sum(not self._pressure.add_pulse(begin, begin + signal.width_s) for begin in begins)
        return late + super().send(signal)

    def deepen(self, depth_m: float) -> None:
        """Continue with the bit at another depth; see `SampledLink`."""
        self._well = dataclasses.replace(self._well, depth_m=depth_m)
        self._pressure.deepen(self._well)

    def _new_strokes(self) -> list[tuple[int, float]]:
        found = []
        for k, times in enumerate(self._pressure.strokes()):
            found += [(k + 1, float(at)) for at in times[self._strokes_given[k] :]]
            self._strokes_given[k] = len(times)
        return sorted(found, key=lambda one: (one[1], one[0]))


class EarthLink(SampledLink):
    """Link through the earth, by a carrier."""

    def __init__(self, channel: EarthChannel, seed: int) -> None:
        self._ground, source = channel.ground, CarrierStream("earth")
        self._voltage = EarthVoltage(channel, source.drive, seed, BLOCK_S)
        super().__init__("em", source, self._voltage, earth_channel.RATE_HZ)

    def deepen(self, depth_m: float) -> None:
        """Continue with the bit at another depth; see `SampledLink`."""
        self._ground = dataclasses.replace(self._ground, depth_m=depth_m)
        self._voltage.deepen(self._ground)


class CoilLink(SampledLink):
    """
    Link through the field of a coil whose strength is modulated; the strength follows the position of the sonde.

    Parameters
    ----------
    place : callable
        Position and direction of the sonde at a time.
    """

    def __init__(self, channel: CoilChannel, coil: Coil, place: Place, seed: int) -> None:
        source = CarrierStream("coil")
        voltage = CoilVoltage(channel, coil, place, source.drive, seed, BLOCK_S)
        super().__init__("coil", source, voltage, coil_channel.RATE_HZ)


class WireLink:
    """Link over a wire, by serial frames."""

    def __init__(self, channel: SerialChannel, baud: int, seed: int) -> None:
        self._period_s = BITS_PER_BYTE / baud
        self._line = SerialStream(channel, baud, seed)
        self._sent: deque[tuple[float, bytes]] = deque()
        self._until = -math.inf

    def send(self, signal: OnAir) -> int:
        """Transmit the bytes of a frame; see `SampledLink`."""
        if not signal.octets:
            return 0
        if signal.start_s < self._until:
            return 1
        self._sent.append((signal.start_s, signal.octets))
        return 0

    def deepen(self, depth_m: float) -> None:
        """Do nothing: a wire does not change with depth."""

    def advance(self, until_s: float) -> list[Heard]:
        """Return the received frames up to a simulation time, s; see `SampledLink`."""
        self._until = max(self._until, until_s)
        heard = []
        while self._sent and self._sent[0][0] + len(self._sent[0][1]) * self._period_s <= until_s:
            start, octets = self._sent.popleft()
            data = np.frombuffer(self._line.carry(start, octets), dtype=np.uint8)
            if len(data):
                # A byte has arrived when its stop bit has arrived.
                heard.append(Heard("serial", start + self._period_s, self._period_s, data, []))
        return heard


LinkChannel = SampledLink | WireLink  #: channel of one telemetry link


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
        self.late = 0  #: number of pulses, symbol groups and frames that came too late for their channel and are lost

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
