# SPDX-License-Identifier: Apache-2.0
"""
Pulse widths that a channel allows, predicted from the pulses and the noise received at one width.

A pulse of another width has the spectrum of a rectangle of that width in the same channel. At frequencies where the
received pulses have no energy, the gain is extrapolated as for friction: its logarithm falls with the root of the
frequency (boundary layer; J. R. Womersley, J. Physiol. 127 (1955) 553, at high frequencies).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU
from mwd_surface.receiver.pulse.segment import ChannelEstimate

WIDTHS_S = (2.0, 1.5, 1.2, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2)
# The margin of one pulse width is predicted from another width if their ratio is at most this. At a larger ratio, the
# channel was not measured at the frequencies that matter.
_FARTHEST = 2.5
_POINTS = 4096  # length of the discrete Fourier transform
# Band, in 1 / width, where the pulses have enough energy to fit the attenuation, and the upper end of the measured
# band.
_FITTED, _MEASURED = (0.15, 0.8), 0.8
_TOP = 1.4  # upper end of the noise model, 1 / TU; the receiver's low-pass filter begins above it


class WidthMargin(NamedTuple):
    """Pulse width and the energy per bit over noise density predicted for it, dB."""

    width_s: float
    ebn0_db: float


def margins(channel: ChannelEstimate, width_s: float, ebn0_db: float) -> list[WidthMargin]:
    """
    Predict Eb/N0 of other pulse widths in the same channel.

    Parameters
    ----------
    channel : ChannelEstimate
        Channel estimated from pulses of `width_s`.
    ebn0_db : float
        Eb/N0 measured at that width.

    Returns
    -------
    list of WidthMargin
        Widest first, including `width_s` itself.
    """
    tu = 0.5 * width_s
    frequency: Array = np.fft.rfftfreq(_POINTS, tu / SAMPLES_PER_TU).astype(np.float64)
    band = (frequency > 0.05 / width_s) & (frequency < _TOP / tu)
    frequency = frequency[band]
    heard = np.abs(np.fft.rfft(channel.response, _POINTS))[band]
    noise = np.abs(np.fft.rfft(channel.whitener, _POINTS))[band]
    gain = _gain(frequency, heard, width_s)

    def energy(width: float) -> float:
        return float(np.sum((gain * _pulse(frequency, width) * noise) ** 2))

    widths = [one for one in WIDTHS_S if width_s / _FARTHEST <= one <= width_s * _FARTHEST]
    return [
        WidthMargin(one, ebn0_db + 10.0 * float(np.log10(energy(one) / energy(width_s))))
        for one in sorted({*widths, width_s}, reverse=True)
    ]


def _pulse(frequency: Array, width: float) -> Array:
    """Return the magnitude of the spectrum, s, of a rectangle with this width, s; frequency: Hz."""
    return np.asarray(width * np.abs(np.sinc(frequency * width)))


def _gain(frequency: Array, heard: Array, width: float) -> Array:
    """Return the gain of the channel: measured at frequencies where pulses have energy, above them extrapolated."""
    measured = heard / np.maximum(_pulse(frequency, width), 1e-3 * width)
    low, high = (share / width for share in _FITTED)
    fitted = (frequency > low) & (frequency < high)
    slope, level = np.polyfit(np.sqrt(frequency[fitted]), np.log(measured[fitted]), 1, w=heard[fitted])
    beyond = np.exp(level + min(float(slope), 0.0) * np.sqrt(frequency))
    return np.where(frequency < _MEASURED / width, measured, beyond)
