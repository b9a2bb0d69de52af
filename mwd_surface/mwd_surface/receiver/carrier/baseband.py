# SPDX-License-Identifier: Apache-2.0
"""
Complex envelope of a carrier on the tool's clock, and the spectral lines that disturb the carrier.

Source: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008, section 2.1 (complex envelope).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry.carrier import Carrier
from mwd_surface.receiver.pump_lines import line_frequencies

Complex = NDArray[np.complex128]
PER_SYMBOL = 8  # envelope values per symbol
# Cut-off of the filter in symbol rates, and its half width in symbols. The passed band holds 95 % of the energy of
# rectangular symbols.
_CUT_OFF = 3.5
_HALF = 1.5
# Smallest ratio of the power of a line to the spectrum around it. No symbol sequence of a block reaches this ratio.
_STANDS_OUT = 25.0
# The amplitude and phase of a line vary with the pump speed: each line is modelled by four slow cosines over a block.
WANDER = 4


@dataclasses.dataclass(frozen=True)
class Band:
    """Carrier on the grid: frequency in rad per step, steps per symbol, and filter cut-off in cycles per step."""

    omega: float
    symbol: float
    cut_off: float

    @property
    def reach(self) -> float:
        """Half width of the filter, steps."""
        return _HALF * self.symbol


def step_s(carrier: Carrier) -> float:
    """Return the step of the grid for a carrier, s, with which the low-pass of a `Resampler` passes the band."""
    return 0.2 / (carrier.frequency_hz + _CUT_OFF * carrier.symbol_rate_hz)


def band_of(carrier: Carrier) -> Band:
    """Return frequency, symbol length and filter cut-off of a carrier, in units of the grid step `step_s`."""
    step = step_s(carrier)
    # Stop short of zero frequency, where the noise is strongest.
    width = min(_CUT_OFF * carrier.symbol_rate_hz, 0.9 * carrier.frequency_hz)
    return Band(2.0 * math.pi * carrier.frequency_hz * step, 1.0 / (carrier.symbol_rate_hz * step), width * step)


@compiled
def _envelope(
    value: Array, known: Array, at: float, spacing: float, band: tuple[float, float, float], out: Complex, whole: Array
) -> None:
    """
    Fill the complex envelope `out` at the positions `at` + k `spacing`, steps.

    band: frequency, cut-off and half width of the filter, as in `Band`; whole: filled with the share of the filter
    weight that lies on known values.
    """
    omega, cut_off, reach = band
    for k in range(len(out)):
        middle = at + k * spacing
        real = imag = weight = total = 0.0
        for n in range(math.ceil(middle - reach), math.floor(middle + reach) + 1):
            u = n - middle
            a = 2.0 * math.pi * cut_off * u
            c = math.cos(0.5 * math.pi * u / reach)
            kernel = 2.0 * cut_off * c * c * c * c * (1.0 if a == 0.0 else math.sin(a) / a)
            total += kernel
            if 0 <= n < len(value) and known[n] > 0.0:
                # The phase is counted from the middle of the filter, so that it does not depend on where the samples
                # begin.
                real += kernel * value[n] * math.cos(omega * u)
                imag -= kernel * value[n] * math.sin(omega * u)
                weight += kernel
        out[k] = complex(real, imag)
        whole[k] = weight / total


def envelope(value: Array, known: Array, band: Band, at: float, count: int, symbol: float) -> tuple[Complex, Array]:
    """
    Return the complex envelope on the clock of the tool.

    Parameters
    ----------
    value, known : ndarray, shape (n,)
        Samples of the grid with their mean removed, and 1 where a sample is known.
    at : float
        Position of the first value, steps.
    symbol : float
        Steps per symbol by the clock of the tool; the carrier of the tool runs on the same clock.

    Returns
    -------
    ndarray, shape (count,)
        Envelope, `PER_SYMBOL` values per symbol; its phase is relative to the tool's carrier at `at`.
    ndarray, shape (count,)
        1 where the envelope is known.
    """
    out, whole = np.empty(count, dtype=complex), np.empty(count)
    spacing = symbol / PER_SYMBOL
    omega = band.omega * band.symbol / symbol
    _envelope(value, known, at, spacing, (omega, band.cut_off, band.reach), out, whole)
    turn = np.exp(-1j * omega * spacing * np.arange(count))
    return out * turn, (whole > 0.95).astype(float)


def lines(value: Array, band: Band) -> Array:
    """
    Return the frequencies of the spectral lines in a band, strongest first.

    value, shape (n,): samples of the grid. Returns shape (k,), rad per step.
    """
    reach = 2.0 * math.pi * band.cut_off
    return line_frequencies(value, _STANDS_OUT, (band.omega - reach, band.omega + reach))


def line_columns(found: Array, band: Band, count: int, symbol: float) -> Complex:
    """
    Return the columns of the lines in an envelope, to fit and subtract the lines; shape (count, WANDER k).

    found, shape (k,): frequencies of the lines, rad per step. count, symbol: as in `envelope`.
    """
    spacing = symbol / PER_SYMBOL
    n = np.arange(count)
    slow = np.cos(math.pi * (n[:, None] + 0.5) / count * np.arange(WANDER)[None, :])
    # The envelope is relative to the tool's carrier, so a line rotates in it at the difference of the frequencies.
    turn = np.exp(1j * (found - band.omega * band.symbol / symbol)[None, :] * spacing * n[:, None])
    return np.asarray((turn[:, :, None] * slow[:, None, :]).reshape(count, -1))
