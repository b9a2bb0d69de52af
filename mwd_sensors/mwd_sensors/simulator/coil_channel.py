# SPDX-License-Identifier: Apache-2.0
"""
Voltage of a receiver whose coil picks up the field of a sonde: dipole, ground, mains harmonics, receiver noise.

The receiver filters a band about the frequency of the sonde. Its voltage is proportional to the amplitude of the field
in this band. All signals are computed in this band, as complex amplitudes. The channel runs in blocks counted from its
start; the same seed gives the same voltage. The noise levels are assumptions.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.dipole import dipole_field, wave_number
from mwd_sensors.core.settings import setting
from mwd_sensors.simulator.carrier_tool import CarrierSent
from mwd_sensors.telemetry.carrier import Coil

RATE_HZ = 250.0  # sample rate of the voltage, Hz
# Half of the receiver's band, Hz. Random error of the mains frequency: 1 sigma, Hz, and correlation time, s.
_HALF_BAND_HZ = 0.4 * RATE_HZ
_MAINS_SIGMA_HZ, _MAINS_S = 0.01, 20.0

#: Position, m, north, east, down, and unit vector of the tool axis at a time, s; each of shape (3,).
Place = Callable[[float], tuple[Array, Array]]


@dataclasses.dataclass(frozen=True)
class CoilChannel:
    """Receiver of the field of a sonde: position and axis of the receiver, the ground, and the noise."""

    position_m: tuple[float, float, float] = setting(
        (0.0, 0.0, -1.0), "Position of the receiver from the wellhead: north, east, down."
    )
    axis: tuple[float, float, float] = setting(
        (1.0, 0.0, 0.0),
        "Direction of the receiving coil: north, east, down, of any length. The signal is lost where the field is "
        "across it.",
        low=-1.0,
        high=1.0,
    )
    resistivity: float = setting(
        50.0, "Resistivity of the ground; its currents weaken the field.", unit="ohm m", low=0.05, high=1e6
    )
    noise_t: float = setting(
        5.0e-14, "Noise of receiver and atmosphere near the frequency of the sonde.", unit="T/sqrt(Hz)", low=0.0
    )
    mains_t: float = setting(
        1.0e-12,
        "Amplitude of each odd harmonic of the mains at the receiver; even harmonics have a tenth of this amplitude.",
        unit="T",
        low=0.0,
    )
    mains_hz: float = setting(50.0, "Frequency of the mains.", low=10.0, high=120.0)
    volt_per_t: float = setting(1.0e9, "Voltage of the receiver for a field of 1 T.", unit="V/T", low=1.0, high=1e15)

    def __post_init__(self) -> None:
        """Raise ValueError if all components of the axis are 0."""
        if not any(self.axis):
            raise ValueError("axis: all three components are 0; give a direction")


class CoilVoltage:
    """
    Voltage of the receiver of a coil, computed block after block.

    Parameters
    ----------
    place : callable
        Position and direction of the sonde at a time; called for the ends of the blocks.
    drive : callable
        Signal of the carrier, -1 to 1, at times, s, shape (n,).
    seed : int
        Seed of all noise.
    block_s : float
        Length of a block. A different length gives a different draw of the noise.
    """

    def __init__(
        self,
        channel: CoilChannel,
        coil: Coil,
        place: Place,
        drive: Callable[[Array], Array],
        seed: int,
        block_s: float = 1.0,
    ) -> None:
        self._channel, self._coil, self._place, self._drive = channel, coil, place, drive
        self._count, self._block = round(block_s * RATE_HZ), 0
        self._noise, self._mains = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
        axis = np.array(channel.axis)
        self._axis = axis / np.linalg.norm(axis)
        self._wave = wave_number(coil.frequency_hz, channel.resistivity)
        numbers = np.arange(
            math.ceil((coil.frequency_hz - _HALF_BAND_HZ) / channel.mains_hz),
            math.floor((coil.frequency_hz + _HALF_BAND_HZ) / channel.mains_hz) + 1,
        )
        self._harmonics = numbers[numbers > 0]
        self._phases: Array = self._mains.uniform(0.0, 2.0 * math.pi, len(self._harmonics))
        self._wander, self._turned = np.zeros(1), 0.0

    @property
    def seconds(self) -> float:
        """Time up to which blocks have been computed, s."""
        return self._block * self._count / RATE_HZ

    def coupling(self, at_s: float) -> complex:
        """Return the complex amplitude of the unmodulated field along the receiving coil, T, at a time, s."""
        position, axis = self._place(at_s)
        offset = np.array(self._channel.position_m) - position
        return complex(dipole_field(offset, self._coil.moment_a_m2 * axis, self._wave) @ self._axis)

    def block(self) -> Array:
        """Return the next block of voltage, V, at 250 Hz, shape (n,)."""
        channel, count, begin = self._channel, self._count, self.seconds
        time = begin + np.arange(count) / RATE_HZ
        first, last = self.coupling(begin), self.coupling(begin + count / RATE_HZ)
        field = first + (last - first) * np.arange(count) / count
        field = field * (1.0 + self._coil.depth * np.asarray(self._drive(time), dtype=float))
        # White noise in a band as wide as the sample rate: real and imaginary part each have the variance
        # noise_t^2 * rate.
        sigma = channel.noise_t * math.sqrt(RATE_HZ)
        field = field + sigma * (self._noise.normal(size=count) + 1j * self._noise.normal(size=count))
        field = field + self._hum(time)
        self._block += 1
        return np.asarray(channel.volt_per_t * np.abs(field))

    def _hum(self, time: Array) -> NDArray[np.complex128]:
        """Return the mains harmonics in the band, T; harmonic k has k times the frequency error of the mains."""
        channel, decay = self._channel, math.exp(-1.0 / (_MAINS_S * RATE_HZ))
        white = _MAINS_SIGMA_HZ * math.sqrt(1.0 - decay**2) * self._mains.normal(size=len(time))
        error, self._wander = scipy.signal.lfilter([1.0], [1.0, -decay], white, zi=self._wander)
        turned = self._turned + 2.0 * math.pi * np.cumsum(error) / RATE_HZ
        self._turned = float(turned[-1])
        total = np.zeros(len(time), dtype=complex)
        for number, phase in zip(self._harmonics.tolist(), self._phases.tolist(), strict=True):
            size = channel.mains_t * (1.0 if number % 2 else 0.1)
            away = 2.0 * math.pi * (number * channel.mains_hz - self._coil.frequency_hz)
            total += size * np.exp(1j * (away * time + number * turned + phase))
        return total


def coil_run(channel: CoilChannel, coil: Coil, sent: CarrierSent, seconds: float, seed: int) -> tuple[Array, Array]:
    """Return times, s, and receiver voltages, V, shape (n,) each, for a level sonde at the wellhead, pointing north."""
    stream = CoilVoltage(channel, coil, lambda _at: (np.zeros(3), np.array([1.0, 0.0, 0.0])), sent.drive, seed)
    voltage = np.concatenate([stream.block() for _ in range(math.ceil(seconds))])
    return np.arange(len(voltage)) / RATE_HZ, voltage
