# SPDX-License-Identifier: Apache-2.0
"""
Surface voltage of a well with an EM tool: string and ground, electrodes, telluric and rig noise, converter.

The string is a leaky transmission line with one mode. The mode's propagation constant G follows from the boundary
condition at the steel, with the ground as outer conductor: G^2 = g^2 + 2 pi s z / K0(l a), l^2 = g^2 - G^2. Here g is
the propagation constant of the ground (g^2 = j w mu s), s the ground's conductivity, z the impedance of the steel per
metre and a the radius of the string. Layers are lines connected in series.
Sources: J. R. Wait, D. A. Hill, IEEE Trans. Geosci. Electron. 17 (1979) 21 (rod in conducting rock, mode equation);
D. A. Hill, J. R. Wait, IEEE Trans. Geosci. Electron. 16 (1978) (propagation along a string); P. DeGauque, R.
Grudzinski, SPE Drilling Eng. 2 (1987) 127 (surface voltage).

The channel runs in blocks counted from its start; the same seed gives the same voltage. The noise levels are
assumptions.
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
from mwd_sensors.simulator.carrier_tool import CarrierSent

Complex = NDArray[np.complex128]
_STEEL, _PERMEABILITY = 4.9e6, 100.0  # conductivity of steel, S/m, and its relative permeability
_TURNS = 30  # number of iterations that solve the equation of the propagation constant


@dataclasses.dataclass(frozen=True)
class Ground:
    """Layers from the surface down, the string in them, source and electrodes."""

    bottom_m: tuple[float, ...] = setting(
        (1000.0, 12000.0), "Depth of the bottom of each layer; the last reaches below the bit.", low=1.0
    )
    resistivity: tuple[float, ...] = setting(
        (20.0, 10.0),
        "Resistivity of each layer, for example 1 to 5 for clay, 10 to 50 for sand, 100 and more for limestone.",
        unit="ohm m",
        low=0.05,
        high=1e5,
    )
    depth_m: float = setting(2000.0, "Depth of the bit.", low=50.0, high=12000.0)
    below_m: float = setting(15.0, "Distance from the gap to the bit.", low=1.0, high=200.0)
    radius_m: float = setting(0.0635, "Outer radius of the string.", low=0.02, high=0.3)
    wall_m: float = setting(0.0092, "Wall thickness of the string.", low=0.002, high=0.05)
    source_v: float = setting(3.0, "Voltage across the gap.", low=0.01, high=100.0)
    source_a: float = setting(5.0, "Largest current of the source.", low=0.01, high=50.0)
    electrode_m: float = setting(60.0, "Distance from the wellhead to the electrode.", low=1.0, high=2000.0)

    def __post_init__(self) -> None:
        """
        Check the layers.

        Raises ValueError if the numbers of layers and resistivities differ, layers are out of order, or the bit is
        below the last layer.
        """
        if len(self.bottom_m) != len(self.resistivity):
            raise ValueError(
                f"resistivity: {len(self.bottom_m)} layers need as many values, got {len(self.resistivity)}"
            )
        if list(self.bottom_m) != sorted(set(self.bottom_m)):
            raise ValueError(f"bottom_m: layers must go down, got {self.bottom_m}")
        if self.bottom_m[-1] < self.depth_m:
            raise ValueError(f"bottom_m: the last layer ends at {self.bottom_m[-1]:g} m, above the bit")


def _steel(ground: Ground, omega: Array) -> Complex:
    """Return the impedance of the string's wall per metre, ohm/m (skin effect in a tube)."""
    k = np.sqrt(1j * omega * scipy.constants.mu_0 * _PERMEABILITY * _STEEL)
    return np.asarray(k / (2.0 * math.pi * ground.radius_m * _STEEL) / np.tanh(k * ground.wall_m))


def propagation(ground: Ground, resistivity: float, frequency_hz: Array) -> tuple[Complex, Complex, Complex]:
    """
    Return the properties of the electric wave along the string in uniform ground.

    Parameters
    ----------
    ground : Ground
        Radius and wall thickness of the string; the layers are not used.
    resistivity : float
        Resistivity of the ground, ohm m.
    frequency_hz : ndarray, shape (n,)
        Frequencies, above 0.

    Returns
    -------
    ndarray, shape (n,)
        Propagation constant, 1/m.
    ndarray, shape (n,)
        Characteristic impedance, ohm.
    ndarray, shape (n,)
        Radial wave number in the ground, 1/m.
    """
    omega = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float)
    sigma = 1.0 / resistivity
    wave = 1j * omega * scipy.constants.mu_0 * sigma
    leak = 2.0 * math.pi * sigma * _steel(ground, omega)
    radial = np.sqrt(-leak / 8.0)
    for _ in range(_TURNS):
        radial = np.sqrt(-leak / scipy.special.kv(0, radial * ground.radius_m))
        radial = np.where(radial.real < 0.0, -radial, radial)
    outer = scipy.special.kv(0, radial * ground.radius_m)
    constant = np.sqrt(wave + leak / outer)
    return constant, constant * outer / (2.0 * math.pi * sigma), radial


def response(ground: Ground, frequency_hz: Array) -> Complex:
    """
    Return the complex voltage between wellhead and electrode for the largest source signal, V, shape (n,).

    frequency_hz, shape (n,), must be above 0.
    """
    frequency = np.asarray(frequency_hz, dtype=float)
    gap = ground.depth_m - ground.below_m
    tops = (0.0, *ground.bottom_m[:-1])
    layers = [
        (min(bottom, gap) - top, propagation(ground, resistivity, frequency))
        for top, bottom, resistivity in zip(tops, ground.bottom_m, ground.resistivity, strict=True)
        if top < gap
    ]
    # Compute voltage and current at the bottom of each layer for 1 V at the wellhead, where the line is open.
    voltage, current = np.ones(len(frequency), dtype=complex), np.zeros(len(frequency), dtype=complex)
    scale = np.zeros(len(frequency))
    for length, (constant, impedance, _) in layers:
        x = constant * length
        # Keep the growth of the voltage as an exponent in `scale`: the voltage would overflow in a deep well in clay.
        ch, sh = 0.5 * (1.0 + np.exp(-2.0 * x)), 0.5 * (1.0 - np.exp(-2.0 * x))
        turn = np.exp(1j * x.imag)
        voltage, current = (
            turn * (ch * voltage + impedance * sh * current),
            turn * (ch * current + sh / impedance * voltage),
        )
        scale = scale + x.real
    above = voltage / current
    constant, impedance, _ = propagation(ground, _at(ground, gap), frequency)
    below = impedance / np.tanh(constant * ground.below_m)
    driven = np.minimum(ground.source_v, ground.source_a * np.abs(above + below))
    at_top = driven * above / (above + below) / voltage * np.exp(-scale)
    radial = layers[0][1][2]
    # The ground's own potential falls with the logarithm of the distance; only a distant electrode is at zero
    # potential.
    share = 1.0 - scipy.special.kv(0, radial * ground.electrode_m) / scipy.special.kv(0, radial * ground.radius_m)
    return np.asarray(at_top * share)


def _at(ground: Ground, depth_m: float) -> float:
    return next(r for bottom, r in zip(ground.bottom_m, ground.resistivity, strict=True) if depth_m <= bottom)


RATE_HZ = 250.0  # sample rate of the voltage, Hz
_RESPONSE_S = 4.096  # length of the impulse response, s
_CORNERS_HZ = (0.05, 0.5, 5.0)  # corner frequencies of the low-passes whose sum falls as 1/f


@dataclasses.dataclass(frozen=True)
class EarthNoise:
    """Noise of the surface voltage: everything that is not the tool's signal."""

    telluric_v: float = setting(
        2.0e-5, "1/f noise of earth currents and electrodes: rms value of the part below 1 Hz.", low=0.0
    )
    amplifier_v: float = setting(2.0e-6, "White noise of the amplifier, rms at 250 Hz.", low=0.0)
    mains_v: float = setting(2.0e-4, "Mains: amplitude.", low=0.0)
    mains_hz: float = setting(50.0, "Mains: frequency.", low=10.0, high=120.0)
    drive_v: float = setting(1.0e-5, "Rig drives: amplitude of the first line.", low=0.0)
    drive_hz: float = setting(
        1.45, "Rig drives: base frequency. Lines are at its multiples, as in the current of pumps and rotary.", low=0.05
    )
    switching_per_hour: float = setting(20.0, "Number of loads switched per hour.", low=0.0, high=1e4)
    switching_v: float = setting(1.0e-3, "Step of the voltage when a load is switched.", low=0.0)
    full_scale_v: float = setting(0.1, "Largest voltage of the converter, of either sign.", low=1e-4)
    adc_bits: int = setting(24, "Bits of the converter over its whole range.", low=8, high=32)


@dataclasses.dataclass(frozen=True)
class EarthChannel:
    """Settings of an earth channel: layers and string in the ground, and noise at the surface."""

    ground: Ground = setting(Ground, "Layers, string, source, electrodes.")
    noise: EarthNoise = setting(EarthNoise, "Noise at the surface.")


class EarthVoltage:
    """
    Surface voltage of an earth channel, computed block after block.

    Parameters
    ----------
    drive : callable
        Source signal as a share of its full voltage, shape (n,), at times, s, shape (n,).
    seed : int
        Seed of all noise.
    block_s : float
        Length of a block. A different length gives a different draw of the noise.
    """

    def __init__(
        self, channel: EarthChannel, drive: Callable[[Array], Array], seed: int, block_s: float = 10.0
    ) -> None:
        self._channel, self._drive, self._count = channel, drive, round(block_s * RATE_HZ)
        sources = np.random.SeedSequence(seed).spawn(4)
        self._telluric, self._amplifier, self._wander, self._switch = map(np.random.default_rng, sources)
        self.deepen(channel.ground)
        self._tail = np.zeros(len(self._taps) - 1)
        self._states = [np.zeros(1) for _ in range(len(_CORNERS_HZ) + 1)]
        self._level = 0.0
        self._block = 0

    def deepen(self, ground: Ground) -> None:
        """Use the response of another ground from the next block on, for example of a deeper well."""
        taps = round(_RESPONSE_S * RATE_HZ)
        frequency: Array = np.fft.rfftfreq(taps, 1.0 / RATE_HZ).astype(np.float64)
        frequency[0] = 0.5 * frequency[1]
        # The roll-off before the converter has no delay of its own, so its response would begin before time zero. A
        # delay of 0.1 s makes the filter causal.
        roll = 1.0 / np.sqrt(1.0 + (frequency / 60.0) ** 8) * np.exp(-2j * math.pi * frequency * 0.1)
        self._taps: Array = np.fft.irfft(response(ground, frequency) * roll, taps)

    @property
    def seconds(self) -> float:
        """Time up to which blocks have been computed, s."""
        return self._block * self._count / RATE_HZ

    def block(self) -> Array:
        """Return the next block of voltage, V, at 250 Hz, shape (n,)."""
        noise, count = self._channel.noise, self._count
        time = (self._block * count + np.arange(count)) / RATE_HZ
        whole = scipy.signal.oaconvolve(np.asarray(self._drive(time), dtype=float), self._taps)
        whole[: len(self._tail)] += self._tail
        self._tail = whole[count:]
        total = whole[:count] + self._pink() * noise.telluric_v
        total += noise.amplifier_v * self._amplifier.normal(size=count)
        decay = math.exp(-1.0 / (20.0 * RATE_HZ))
        white = self._wander.normal(size=count) * math.sqrt(1.0 - decay**2)
        wander, self._states[-1] = scipy.signal.lfilter([1.0], [1.0, -decay], white, zi=self._states[-1])
        total += noise.mains_v * np.cos(2.0 * math.pi * noise.mains_hz * time + 0.2 * wander)
        for k in range(1, 13):
            total += (
                noise.drive_v / k * np.cos(2.0 * math.pi * k * noise.drive_hz * time + k * (0.3 * wander + 1.7 * k))
            )
        total += self._switched()
        step = 2.0 * noise.full_scale_v / 2**noise.adc_bits
        self._block += 1
        return np.asarray(np.clip(np.round(total / step) * step, -noise.full_scale_v, noise.full_scale_v))

    def _pink(self) -> Array:
        """Return noise that falls as 1/f from 0.05 to 10 Hz, rms 1 below 1 Hz, from three filters a decade apart."""
        white = self._telluric.normal(size=self._count)
        total = np.zeros(self._count)
        for k, corner in enumerate(_CORNERS_HZ):
            decay = math.exp(-2.0 * math.pi * corner / RATE_HZ)
            gain = math.sqrt((1.0 + decay) * (1.0 - decay))
            one, self._states[k] = scipy.signal.lfilter([gain], [1.0, -decay], white, zi=self._states[k])
            total += one / math.sqrt(3.0)
        return total

    def _switched(self) -> Array:
        """Return the voltage of switched loads in the next block, V: steps that decay within some seconds."""
        noise = self._channel.noise
        decay = math.exp(-1.0 / (3.0 * RATE_HZ))
        count = self._switch.poisson(noise.switching_per_hour * self._count / RATE_HZ / 3600.0)
        steps = np.zeros(self._count)
        places = self._switch.integers(0, self._count, size=count)
        np.add.at(steps, places, noise.switching_v * self._switch.choice((-1.0, 1.0), size=count))
        out, last = scipy.signal.lfilter([1.0], [1.0, -decay], steps, zi=[self._level])
        self._level = float(last[0])
        return np.asarray(out)


def earth_run(channel: EarthChannel, sent: CarrierSent, seconds: float, seed: int) -> tuple[Array, Array]:
    """Return times, s, and simulated surface voltages, V, of a transmission, shape (n,) each."""
    stream = EarthVoltage(channel, sent.drive, seed)
    blocks = []
    while stream.seconds < seconds:
        blocks.append(stream.block())
    voltage = np.concatenate(blocks)
    return np.arange(len(voltage)) / RATE_HZ, voltage
