# SPDX-License-Identifier: Apache-2.0
"""
Pressure waves in a circulating well, from the tool's valve and from the pumps to the gauge at the standpipe.

Each pipe is a transmission line. Its impedance per metre is the inertia with Womersley's boundary layer, valid for the
wave, plus the linearised friction of the turbulent mean flow, 2 (dp/dx) / Q. The wave speed is Korteweg's.
Sources: W. Zielke, J. Basic Eng. 90 (1968) 109 (frequency-dependent friction); E. B. Wylie, V. L. Streeter, Fluid
Transients in Systems, 1993, chapter 12 (impedance method); C. Xia, T. Chen, 1993 (mud channel).
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
_STEEL = 2.07e11  # Young's modulus of steel, Pa
_GAS = 1.2  # polytropic exponent of the gas in a dampener, between isothermal and adiabatic
_ATMOSPHERE = 1.0e5  # atmospheric pressure, Pa


@dataclasses.dataclass(frozen=True)
class WellGeometry:
    """Settings of a well for the pressure waves: geometry, mud and surface piping."""

    depth_m: float = setting(3000.0, "Measured depth of the bit.", low=100.0, high=12000.0)
    flow_m3_s: float = setting(0.033, "Flow rate.", unit="m^3/s", low=0.002, high=0.2)
    pressure_pa: float = setting(2.0e7, "Standpipe pressure at this flow.", unit="Pa", low=1e5, high=1e8)
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
