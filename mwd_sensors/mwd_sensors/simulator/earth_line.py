# SPDX-License-Identifier: Apache-2.0
"""
Electric waves along a drill string in layered ground, from the gap of an EM tool to electrodes at the surface.

The string is a leaky transmission line with one mode. The mode's propagation constant G follows from the boundary
condition at the steel, with the ground as outer conductor: G^2 = g^2 + 2 pi s z / K0(l a), l^2 = g^2 - G^2. Here g is
the propagation constant of the ground (g^2 = j w mu s), s the ground's conductivity, z the impedance of the steel per
metre and a the radius of the string. Layers are lines connected in series.
Sources: J. R. Wait, D. A. Hill, IEEE Trans. Geosci. Electron. 17 (1979) 21 (rod in conducting rock, mode equation);
D. A. Hill, J. R. Wait, IEEE Trans. Geosci. Electron. 16 (1978) (propagation along a string); P. DeGauque, R.
Grudzinski, SPE Drilling Eng. 2 (1987) 127 (surface voltage).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.settings import setting

Complex = NDArray[np.complex128]
_STEEL, _PERMEABILITY = 4.9e6, 100.0  # conductivity of steel, S/m, and its relative permeability
_TURNS = 30  # iterations of the mode equation


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
