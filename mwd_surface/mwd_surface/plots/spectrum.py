# SPDX-License-Identifier: Apache-2.0
"""
Spectrum of a signal of any length and its change over time: averaged periodograms, in constant memory.

Source: P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Trans. Audio and
Electroacoustics 15 (1967): Hann window, segments that overlap by half, each with its mean removed.
"""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps


class Spectrum:
    """
    One-sided power spectral density of k columns, over the whole span and in time bins.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    columns : int
    start_ns, end_ns : int
        The span that is divided into time bins.
    segment : int
        Number of samples in a periodogram.
    bins : int
        Number of time bins.

    Raises
    ------
    ValueError
        The rate is not positive, or a segment has fewer than 16 samples.
    """

    def __init__(
        self, rate: float, columns: int, start_ns: int, end_ns: int, segment: int = 1024, bins: int = 240
    ) -> None:
        if not rate > 0.0 or segment < 16:
            raise ValueError(f"a spectrum needs a rate and segments of 16 samples or more; got {rate} Hz, {segment}")
        self.rate, self.segment = rate, segment
        self.segments = 0
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
        self._start, self._span = start_ns, end_ns - start_ns + 1
        self._sum = np.zeros((bins, segment // 2 + 1, columns))
        self._count = np.zeros(bins, dtype=np.int64)
        self._held_ns = np.empty(0, dtype=np.int64)
        self._held = np.empty((0, columns))

    @property
    def frequency(self) -> Array:
        """Hz, shape (segment // 2 + 1,)."""
        return np.asarray(np.arange(self.segment // 2 + 1) * self.rate / self.segment)

    @property
    def density(self) -> Array:
        """Power spectral density over the whole span, (unit of the signal)^2 / Hz, shape (frequencies, columns)."""
        return np.asarray(self._sum.sum(axis=0) / max(self.segments, 1))

    @property
    def waterfall(self) -> Array:
        """Power spectral density in each time bin, shape (bins, frequencies, columns); nan in an empty bin."""
        count = np.where(self._count > 0, self._count, np.nan)
        return np.asarray(self._sum / count[:, None, None])

    def add(self, stamp_ns: Stamps, values: Array) -> None:
        """
        Add samples in order of time; the division into blocks has no effect on the spectrum.

        A segment with a gap or with a value that is not finite is skipped.
        """
        stamps = np.concatenate([self._held_ns, stamp_ns])
        signal = np.concatenate([self._held, values])
        half = self.segment // 2
        first = 0
        while first + self.segment <= len(signal):
            self._take(stamps[first : first + self.segment], signal[first : first + self.segment])
            first += half
        self._held_ns, self._held = stamps[first:], signal[first:]

    def _take(self, stamps: Stamps, signal: Array) -> None:
        seconds = (stamps[-1] - stamps[0]) * 1e-9
        usual = (self.segment - 1) / self.rate
        if abs(seconds - usual) > 0.02 * usual + 1.5 / self.rate or not np.isfinite(signal).all():
            return
        amplitude = np.fft.rfft((signal - signal.mean(axis=0)) * self._window[:, None], axis=0)
        power = (amplitude.real**2 + amplitude.imag**2) / (self.rate * np.sum(self._window**2))
        power[1 : (self.segment + 1) // 2] *= 2.0
        middle = (int(stamps[self.segment // 2]) - self._start) / self._span
        k = min(max(int(middle * len(self._count)), 0), len(self._count) - 1)
        self._sum[k] += power
        self._count[k] += 1
        self.segments += 1
