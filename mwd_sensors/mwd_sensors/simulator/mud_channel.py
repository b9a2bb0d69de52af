# SPDX-License-Identifier: Apache-2.0
"""
Standpipe pressure of a well that is drilled with a pulse tool: pulses, pumps, bit, stalls, gauge.

Each pipe is a transmission line. Its impedance per metre is the inertia with Womersley's boundary layer, valid for the
wave, plus the linearised friction of the turbulent mean flow, 2 (dp/dx) / Q. The wave speed is Korteweg's.
Sources: W. Zielke, J. Basic Eng. 90 (1968) 109 (frequency-dependent friction); E. B. Wylie, V. L. Streeter, Fluid
Transients in Systems, 1993, chapter 12 (impedance method); C. Xia, T. Chen, 1993 (mud channel).

The channel runs in blocks counted from its start, so that the pressure does not depend on how it is requested; the same
seed gives the same pressure. The noise levels are assumptions: no public recording of standpipe pressure is known.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting

Complex = NDArray[np.complex128]
_STEEL = 2.07e11  # Young's modulus of steel, Pa
_GAS = 1.2  # polytropic exponent of the gas in a dampener, between isothermal and adiabatic
_ATMOSPHERE = 1.0e5  # atmospheric pressure, Pa


@dataclasses.dataclass(frozen=True)
class WellGeometry:
    """Settings of a well for the pressure waves: geometry, mud and surface piping."""

    depth_m: float = setting(3000.0, "Measured depth of the bit.", low=100.0, high=12000.0)
    flow_m3_s: float = setting(0.033, "Flow rate.", unit="m^3/s", low=0.002, high=0.2)
    pressure_pa: float = setting(
        2.0e7, "Standpipe pressure at the flow that flow_m3_s states.", unit="Pa", low=1e5, high=1e8
    )
    density: float = setting(1200.0, "Density of the mud.", unit="kg/m^3", low=500.0, high=2500.0)
    viscosity: float = setting(0.020, "Viscosity of the mud.", unit="Pa s", low=1e-4, high=1.0)
    bulk_modulus: float = setting(2.1e9, "Bulk modulus of the mud; gas lowers it.", unit="Pa", low=1e7, high=1e10)
    bore_m: float = setting(0.1086, "Inner diameter of the drill pipe.", low=0.03, high=0.3)
    wall_m: float = setting(0.0092, "Wall thickness of the drill pipe.", low=0.001, high=0.05)
    hole_m: float = setting(0.2159, "Diameter of the hole.", low=0.08, high=0.7)
    collars_m: float = setting(150.0, "Length of the bottom-hole assembly, bore 71 mm.", low=10.0, high=500.0)
    friction: float = setting(1600.0, "Pressure gradient of the mean flow in the pipe.", unit="Pa/m", low=0.0, high=1e4)
    valve_to_bit_m: float = setting(15.0, "Distance from the pulse valve to the bit.", low=1.0, high=100.0)
    bit_pa: float = setting(5.0e6, "Pressure drop over nozzles and motor.", unit="Pa", low=1e5, high=3e7)
    gauge_m: float = setting(25.0, "Length of pipe from the pumps to the gauge.", low=1.0, high=200.0)
    hose_m: float = setting(40.0, "Length from the gauge to the top of the string.", low=1.0, high=200.0)
    dampener_m3: float = setting(0.075, "Volume of the pulsation dampener.", unit="m^3", low=0.0, high=1.0)
    precharge: float = setting(
        0.35,
        "Precharge of the dampener divided by standpipe pressure. At 0 (no gas) and from 1 (overcharged) the dampener "
        "has no effect.",
        low=0.0,
        high=1.5,
    )


def wave_speed(well: WellGeometry) -> float:
    """Return Korteweg's speed of pressure waves in the drill pipe, m/s."""
    return math.sqrt(
        well.bulk_modulus / well.density / (1.0 + well.bulk_modulus * well.bore_m / (_STEEL * well.wall_m))
    )


def _line(well: WellGeometry, omega: Array, radius: float, area: float, friction: float) -> tuple[Complex, Complex]:
    """
    Return propagation constant, 1/m, and characteristic impedance, Pa s/m^3, of a pipe, shape (n,) each.

    omega, shape (n,): angular frequencies, rad/s. radius, m, and area, m^2, of the flow. friction: pressure gradient of
    the mean flow, Pa/m.
    """
    s = radius * np.sqrt(1j * omega * well.density / well.viscosity)
    # Compute I1 / I0 from exponentially scaled functions, because the unscaled functions overflow above some hertz.
    series = 1j * omega * well.density / area / (1.0 - 2.0 * scipy.special.ive(1, s) / (s * scipy.special.ive(0, s)))
    series = series + 2.0 * friction / well.flow_m3_s
    shunt = 1j * omega * area / (well.density * wave_speed(well) ** 2)
    return np.sqrt(series * shunt), np.sqrt(series / shunt)


def _seen(load: Complex, length: float, line: tuple[Complex, Complex]) -> Complex:
    """Return the impedance, Pa s/m^3, at the near end of a line whose far end has the impedance `load`."""
    gamma, zc = line
    th = np.tanh(gamma * length)
    return np.asarray(zc * (load + zc * th) / (zc + load * th))


def _carried(load: Complex, length: float, line: tuple[Complex, Complex]) -> Complex:
    """Return the ratio of the pressure at the load to the pressure at the near end of the line."""
    gamma, zc = line
    return np.asarray(1.0 / (np.cosh(gamma * length) + zc / load * np.sinh(gamma * length)))


def _dampener(well: WellGeometry, omega: Array) -> Complex:
    """Return the impedance of the pulsation dampener, Pa s/m^3: its gas and the mud in its neck."""
    gas = well.dampener_m3 * well.precharge
    if gas <= 0.0 or well.precharge >= 1.0:
        return np.full(len(omega), 1e15 + 0j)
    compliance = gas / (_GAS * (well.pressure_pa + _ATMOSPHERE))
    neck = well.density * 0.5 / (0.25 * math.pi * 0.1**2)
    return np.asarray(1.0 / (1j * omega * compliance) + 1j * omega * neck + 1e6)


def responses(well: WellGeometry, frequency_hz: Array) -> tuple[Complex, Complex, Complex]:
    """
    Return the frequency responses at the gauge.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n,)
        Frequencies, above 0.

    Returns
    -------
    ndarray, shape (n,)
        Pressure at the gauge divided by the pressure drop added at the valve.
    ndarray, shape (n,)
        Pressure at the gauge divided by the flow of the pumps, Pa s/m^3.
    ndarray, shape (n,)
        Pressure at the gauge divided by the pressure drop added at bit and motor.
    """
    omega = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float)
    pipe_area, collar_area = 0.25 * math.pi * well.bore_m**2, 0.25 * math.pi * 0.071**2
    outer = well.bore_m + 2.0 * well.wall_m
    pipe = _line(well, omega, 0.5 * well.bore_m, pipe_area, well.friction)
    collar = _line(well, omega, 0.0355, collar_area, 4.0 * well.friction)
    annulus_area = 0.25 * math.pi * (well.hole_m**2 - outer**2)
    annulus = _line(well, omega, 0.5 * (well.hole_m - outer), annulus_area, 0.2 * well.friction)
    drill_pipe = max(well.depth_m - well.collars_m, 1.0)
    surface = _line(well, omega, 0.05, 0.25 * math.pi * 0.1**2, well.friction)
    # Impedances looking upwards: closed piston and dampener, surface line, hose, string. The flow line above the
    # annulus is open.
    pumps = _dampener(well, omega)
    at_gauge = _seen(pumps, well.gauge_m, surface)
    at_top = _seen(at_gauge, well.hose_m, surface)
    at_collars = _seen(at_top, drill_pipe, pipe)
    above = well.collars_m - well.valve_to_bit_m
    up = _seen(at_collars, above, collar)
    nozzles = 2.0 * well.bit_pa / well.flow_m3_s
    returns = _seen(np.full(len(omega), 1.0 + 0j), well.depth_m, annulus)
    below = _seen(nozzles + returns, well.valve_to_bit_m, collar)
    lifted = (
        _carried(at_collars, above, collar)
        * _carried(at_top, drill_pipe, pipe)
        * _carried(at_gauge, well.hose_m, surface)
    )
    # A pressure drop divides over the impedances above and below; a growing drop raises the pressure above the valve.
    from_valve = up / (up + below) * lifted
    up_at_bit = _seen(up, well.valve_to_bit_m, collar)
    from_bit = up_at_bit / (up_at_bit + nozzles + returns) * _carried(up, well.valve_to_bit_m, collar) * lifted
    gauge_load = _seen(_seen(_seen(nozzles + returns, well.collars_m, collar), drill_pipe, pipe), well.hose_m, surface)
    down = _seen(gauge_load, well.gauge_m, surface)
    from_pumps = pumps * down / (pumps + down) * _carried(gauge_load, well.gauge_m, surface)
    return from_valve, np.asarray(from_pumps), from_bit


# Triplex mud pumps: flow of three pistons with common pump faults, and the switch that counts strokes.


_ROD = 0.2  # length of the crank divided by the length of the connecting rod


@dataclasses.dataclass(frozen=True)
class Pump:
    """One mud pump."""

    strokes_hz: float = setting(1.5, "Strokes per second (90 per minute is 1.5).", low=0.1, high=5.0)
    share: float = setting(1.0, "Share of the flow relative to the other pumps.", low=0.01, high=100.0)
    leak: float = setting(0.0, "Share of one piston's delivery that a leaking valve loses.", low=0.0, high=1.0)
    imbalance: float = setting(0.01, "Difference between the deliveries of the pistons.", low=0.0, high=0.5)
    hunting: float = setting(0.0015, "Variation of the stroke rate, 1 sigma, as a share.", low=0.0, high=0.2)
    hunting_s: float = setting(15.0, "Correlation time of the variation of the stroke rate.", low=0.5, high=600.0)
    counter_jitter_s: float = setting(0.0, "Error of the time of a counted stroke, 1 sigma.", low=0.0, high=0.2)
    counter_missed: float = setting(0.0, "Share of strokes that the counter misses.", low=0.0, high=0.5)


class PumpStream:
    """
    Flow of one pump, produced block after block.

    Parameters
    ----------
    flow : float
        Mean flow of this pump, m^3/s.
    random : numpy Generator
        Random numbers for phase and stroke rate.
    rate_hz : float
        Sample rate.
    """

    def __init__(self, pump: Pump, flow: float, random: np.random.Generator, rate_hz: float) -> None:
        self._pump, self._flow, self._random, self._rate = pump, flow, random, rate_hz
        self._phase = float(random.uniform())
        self._hunt = np.zeros(1)
        self._samples = 0
        self._strokes: list[Array] = []
        # A separate random stream, so that the counter does not change the pressure.
        self._counter = np.random.default_rng(int(1e6 * self._phase))

    def block(self, flow: Array) -> Array:
        """
        Return the flow of this pump at the next n samples, m^3/s, shape (n,).

        flow, shape (n,), is the mean flow at these samples as a share of the full flow; the stroke rate is proportional
        to the mean flow.
        """
        pump, n = self._pump, len(flow)
        decay = math.exp(-1.0 / (self._rate * pump.hunting_s))
        white = self._random.normal(size=n) * math.sqrt(1.0 - decay**2) * pump.hunting
        hunt, self._hunt = scipy.signal.lfilter([1.0], [1.0, -decay], white, zi=self._hunt)
        rate = pump.strokes_hz * flow * (1.0 + hunt)
        turns = self._phase + np.concatenate([[0.0], np.cumsum(rate) / self._rate])
        whole = np.floor(turns)
        at = np.flatnonzero(whole[1:] > whole[:-1])
        if len(at):
            share = (whole[at + 1] - turns[at]) / (turns[at + 1] - turns[at])
            self._strokes.append(self._counted((self._samples + at + share) / self._rate))
        self._phase = float(turns[-1] - whole[-1])
        self._samples += n
        return np.asarray(self._delivered(2.0 * math.pi * turns[:-1]) * self._flow * flow)

    def _counted(self, time: Array) -> Array:
        """Return the times at which the counter counts strokes, s, from the true times of the strokes, s."""
        kept = self._counter.uniform(size=len(time)) >= self._pump.counter_missed
        return np.sort(time + self._pump.counter_jitter_s * self._counter.normal(size=len(time)))[kept]

    def strokes(self) -> Array:
        """Return the times of all counted strokes so far, s."""
        return np.concatenate(self._strokes) if self._strokes else np.zeros(0)

    def _delivered(self, angle: Array) -> Array:
        """Return the flow of the three pistons divided by their mean flow, at crank angles, rad, shape (n,)."""
        total = np.zeros(len(angle))
        for k in range(3):
            turn = angle - 2.0 * math.pi * k / 3.0
            speed = np.sin(turn) * (1.0 + _ROD * np.cos(turn))
            delivery = 1.0 + self._pump.imbalance * (k - 1) - (self._pump.leak if k == 0 else 0.0)
            total += np.maximum(speed, 0.0) * delivery
        return np.asarray(total * math.pi / 3.0)


RATE_HZ = 100.0  # sample rate of the pressure, Hz
_RESPONSE_S = 40.96  # length of the impulse responses, s; echoes in a deep well have decayed by then
_TAPS = round(_RESPONSE_S * RATE_HZ)
_BAND_HZ = 35.0  # bandwidth of the gauge, Hz


@dataclasses.dataclass(frozen=True)
class PressureNoise:
    """Pressure noise: everything that is neither a pulse nor a pump."""

    bit_pa: float = setting(
        5.0e4, "1/f noise of bit and motor, at the bit: rms value of the part below 1 Hz.", unit="Pa", low=0.0, high=1e7
    )
    surface_pa: float = setting(
        8.0e3, "1/f noise at the surface: rms value of the part below 1 Hz.", unit="Pa", low=0.0, high=1e6
    )
    gauge_pa: float = setting(300.0, "White noise of the gauge, rms at 100 Hz.", unit="Pa", low=0.0, high=1e6)
    stick_slip_pa: float = setting(0.0, "Stick-slip: amplitude at the bit.", unit="Pa", low=0.0, high=5e6)
    stick_slip_hz: float = setting(0.18, "Stick-slip: frequency.", low=0.02, high=2.0)
    bounce_pa: float = setting(0.0, "Bit bounce: amplitude at the bit.", unit="Pa", low=0.0, high=5e6)
    bounce_hz: float = setting(6.0, "Bit bounce: frequency, three times the rotation.", low=0.2, high=30.0)
    stalls_per_hour: float = setting(0.0, "Number of motor stalls per hour.", low=0.0, high=200.0)
    stall_pa: float = setting(3.0e6, "Rise of the pressure in a stall, at the bit.", unit="Pa", low=0.0, high=2e7)
    full_scale_pa: float = setting(3.5e7, "Range of the gauge.", unit="Pa", low=1e5, high=2e8)
    adc_bits: int = setting(16, "Bits of the converter over the range.", low=8, high=24)


@dataclasses.dataclass(frozen=True)
class MudChannel:
    """Settings of a mud channel: well, pumps, noise, and valve of the tool."""

    well: WellGeometry = setting(WellGeometry, "Geometry, mud, surface piping.")
    pumps: tuple[Pump, ...] = setting((Pump(1.45), Pump(1.52)), "Pumps in parallel, which share the flow.")
    noise: PressureNoise = setting(PressureNoise, "Pressure noise.")
    valve_pa: float = setting(7.0e5, "Pressure drop of a pulse; negative for a valve to the annulus.", unit="Pa")
    rise_s: float = setting(0.12, "Time constant of the valve.", low=0.005, high=2.0)
    flow_off_s: tuple[tuple[float, float], ...] = setting((), "Begin and end of each span without flow, s.")


class Pressure:
    """
    Standpipe pressure of a mud channel, computed block after block.

    Parameters
    ----------
    pulses : ndarray, shape (n, 2)
        Begin and end of each pulse of the valve after the start, s, in order of time.
    seed : int
        Seed of all noise.
    flow : callable, optional
        Replaces `flow_off_s`: flow as a share of its full value, shape (n,), at times after the start, s, shape (n,).
    block_s : float
        Length of a block. A different length gives a different draw of the stalls.
    """

    def __init__(
        self,
        channel: MudChannel,
        pulses: Array,
        seed: int,
        flow: Callable[[Array], Array] | None = None,
        block_s: float = 10.0,
    ) -> None:
        self._channel, self._pulses = channel, np.asarray(pulses, dtype=float).reshape(-1, 2)
        self._flow, self._count = flow or self._scheduled_flow, round(block_s * RATE_HZ)
        sources = np.random.SeedSequence(seed).spawn(5 + len(channel.pumps))
        self._bit, self._surface, self._gauge, self._stall, self._stick = map(np.random.default_rng, sources[:5])
        total = sum(pump.share for pump in channel.pumps)
        self._pumps = [
            PumpStream(pump, channel.well.flow_m3_s * pump.share / total, np.random.default_rng(source), RATE_HZ)
            for pump, source in zip(channel.pumps, sources[5:], strict=True)
        ]
        frequency: Array = np.fft.rfftfreq(_TAPS, 1.0 / RATE_HZ).astype(np.float64)
        frequency[0] = 0.25 * frequency[1]
        self._frequency = frequency
        self.deepen(channel.well)
        self._tails = [np.zeros(_TAPS - 1) for _ in self._responses]
        self._filters: dict[str, Array] = {}
        self._block = 0
        self._drive: Callable[[Array], Array] = np.zeros_like
        self._stalled = np.zeros(0)

    def modulate(self, drive: Callable[[Array], Array]) -> None:
        """Add the signal of a siren to the pulses of the valve; drive returns the signal, -1 to 1, at times, s."""
        self._drive = drive

    def deepen(self, well: WellGeometry) -> None:
        """Continue in a deeper well; pressure waves that are already under way arrive as at the old depth."""
        self._channel = dataclasses.replace(self._channel, well=well)
        frequency = self._frequency
        valve, pump, bit = responses(well, frequency)
        # Gentle roll-off against aliasing; the delay of 0.1 s keeps the filter causal.
        roll = 1.0 / np.sqrt(1.0 + (frequency / _BAND_HZ) ** 8) * np.exp(-2j * math.pi * frequency * 0.1)
        # Slow changes of the flow are part of the mean pressure, which is added separately.
        pump = pump * (1j * frequency / 0.1) / (1.0 + 1j * frequency / 0.1)
        self._responses = [np.fft.irfft(one * roll, _TAPS) for one in (valve, pump, bit)]

    @property
    def seconds(self) -> float:
        """Time up to which blocks have been computed, s."""
        return self._block * self._count / RATE_HZ

    def add_pulse(self, begin: float, end: float) -> bool:
        """
        Close the valve from begin to end, s after the start; return False if begin is before `seconds`.

        The part of the pulse before `seconds` is then lost.
        """
        self._pulses = np.vstack([self._pulses[self._pulses[:, 1] > self.seconds - 60.0], (begin, end)])
        return begin >= self.seconds

    def block(self) -> Array:
        """
        Return the next block of pressure.

        Returns
        -------
        ndarray, shape (n,)
            Pressure at the gauge, Pa, at 100 Hz.
        """
        count = self._count
        time = (self._block * count + np.arange(count)) / RATE_HZ
        flow = self._flow(time)
        noise, well = self._channel.noise, self._channel.well
        drops = [
            self._valve(time) * flow**2,
            sum((pump.block(flow) for pump in self._pumps), np.zeros(count)),
            self._at_bit(time, noise) * flow**2,
        ]
        total = well.pressure_pa * flow**1.8
        for k, (drop, response) in enumerate(zip(drops, self._responses, strict=True)):
            whole = scipy.signal.oaconvolve(drop, response)
            whole[: len(self._tails[k])] += self._tails[k]
            self._tails[k] = whole[count:]
            total = total + whole[:count]
        total += self._pink("surface", self._surface.normal(size=count), noise.surface_pa)
        total += noise.gauge_pa * self._gauge.normal(size=count)
        step = noise.full_scale_pa / 2**noise.adc_bits
        self._block += 1
        return np.asarray(np.clip(np.round(total / step) * step, 0.0, noise.full_scale_pa))

    def strokes(self) -> list[Array]:
        """Return the times of the counted strokes of each pump so far, s."""
        return [pump.strokes() for pump in self._pumps]

    def _scheduled_flow(self, time: Array) -> Array:
        """Return the scheduled flow as a share of its full value; pumps start and stop within some seconds."""
        flow = np.ones(len(time))
        for begin, end in self._channel.flow_off_s:
            off = 0.5 * (np.tanh((time - begin) / 1.5) - np.tanh((time - end) / 3.0))
            flow *= 1.0 - off
        return np.where(flow < 1e-4, 0.0, flow)

    def _valve(self, time: Array) -> Array:
        inside = (self._pulses[:, 1] > time[0] - 1.0) & (self._pulses[:, 0] <= time[-1])
        target = np.asarray(self._drive(time), dtype=float)
        for begin, end in self._pulses[inside]:
            # A sample in which an edge falls gets a partial value, so that edge times are not rounded to samples.
            target += np.clip((time - begin) * RATE_HZ + 0.5, 0.0, 1.0) - np.clip(
                (time - end) * RATE_HZ + 0.5, 0.0, 1.0
            )
        decay = math.exp(-1.0 / (RATE_HZ * self._channel.rise_s))
        return self._filtered("valve", [1.0 - decay], [1.0, -decay], target * self._channel.valve_pa)

    def _at_bit(self, time: Array, noise: PressureNoise) -> Array:
        drop = self._pink("bit", self._bit.normal(size=len(time)), noise.bit_pa)
        wander = self._filtered("stick", [2e-4], [1.0, -0.9998], self._stick.normal(size=len(time)))
        phase = 2.0 * math.pi * noise.stick_slip_hz * time + 20.0 * wander
        # Stick-slip gives short peaks, that is, several harmonics.
        drop += noise.stick_slip_pa * (np.exp(2.0 * (np.cos(phase) - 1.0)) - 0.3)
        drop += noise.bounce_pa * np.cos(2.0 * math.pi * noise.bounce_hz * time + 60.0 * wander)
        for begin in self._new_stalls(time):
            self._stalled = np.append(self._stalled, begin)
        for begin in self._stalled[self._stalled > time[0] - 60.0]:
            since = time - begin
            drop += np.where(
                since > 0.0, noise.stall_pa * (1 - np.exp(-since / 0.4)) * np.exp(-np.maximum(since - 4, 0)), 0
            )
        return drop

    def _new_stalls(self, time: Array) -> Array:
        count = self._stall.poisson(self._channel.noise.stalls_per_hour * self._count / RATE_HZ / 3600.0)
        return np.asarray(np.sort(time[0] + self._stall.uniform(0.0, self._count / RATE_HZ, size=count)))

    def _pink(self, name: str, white: Array, rms: float) -> Array:
        """Return noise falling as 1/f from 0.03 to 10 Hz, with this rms below 1 Hz (three filters a decade apart)."""
        total = np.zeros(len(white))
        for k, corner in enumerate((0.05, 0.5, 5.0)):
            decay = math.exp(-2.0 * math.pi * corner / RATE_HZ)
            # A first-order filter with pole a and gain 1 - a passes the variance (1 - a) / (1 + a).
            gain = math.sqrt((1.0 + decay) / (1.0 - decay)) * (1.0 - decay)
            total += self._filtered(f"{name}{k}", [gain], [1.0, -decay], white) / math.sqrt(3.0)
        return rms * total

    def _filtered(self, name: str, b: list[float], a: list[float], x: Array) -> Array:
        state = self._filters.get(name, np.zeros(max(len(a), len(b)) - 1))
        y, self._filters[name] = scipy.signal.lfilter(b, a, x, zi=state)
        return np.asarray(y)
