# SPDX-License-Identifier: Apache-2.0
"""
What pulse width a channel allows, from the pulses and the noise that were heard at another one.

A pulse of another width has the spectrum of a rectangle of that width in the same channel. Where the pulses heard have
no energy, the channel goes on as friction does: the logarithm of its gain falls with the root of the frequency
(boundary layer; J. R. Womersley, J. Physiol. 127 (1955) 553, at high frequencies).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU
from mwd_surface.receiver.pulse.segment import Channel

WIDTHS_S = (2.0, 1.5, 1.2, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2)
# Beyond this ratio of the widths the channel was not heard in the band that counts.
_FARTHEST = 2.5
_POINTS = 4096
# Where the pulses heard have enough energy to fit the attenuation to, and up to where it is measured, in 1 / width.
_FITTED, _MEASURED = (0.15, 0.8), 0.8
_TOP = 1.4  # of the noise model, 1 / TU: the low-pass filter of the receiver begins above


class WidthMargin(NamedTuple):
    """Energy of a bit over noise density that a pulse width would have, dB."""

    width_s: float
    ebn0_db: float


def margins(channel: Channel, width_s: float, ebn0_db: float) -> list[WidthMargin]:
    """
    Eb/N0 of other pulse widths in the same channel.

    Parameters
    ----------
    channel : Channel
        As estimated from pulses of `width_s`, s.
    width_s : float
    ebn0_db : float
        Measured at that width.

    Returns
    -------
    list of WidthMargin
        Widest first; `width_s` itself is one of them.
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
    """Size of the spectrum of a rectangle."""
    return np.asarray(width * np.abs(np.sinc(frequency * width)))


def _gain(frequency: Array, heard: Array, width: float) -> Array:
    """Size of the channel's response: measured where the pulses heard have energy, as friction has it beyond."""
    measured = heard / np.maximum(_pulse(frequency, width), 1e-3 * width)
    low, high = (share / width for share in _FITTED)
    fitted = (frequency > low) & (frequency < high)
    slope, level = np.polyfit(np.sqrt(frequency[fitted]), np.log(measured[fitted]), 1, w=heard[fitted])
    beyond = np.exp(level + min(float(slope), 0.0) * np.sqrt(frequency))
    return np.where(frequency < _MEASURED / width, measured, beyond)
