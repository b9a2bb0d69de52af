# SPDX-License-Identifier: Apache-2.0
"""Standpipe pressure as pictures: the last two minutes as a line, the last three minutes as a spectrogram."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array

LINE_HZ = 10.0  # rate of the points of the line, Hz
LINE_S = 120.0  # length of the line, s
RATE_HZ = 25.0  # approximate rate of the samples after averaging, Hz
WINDOW = 512  # number of samples in a spectrum: 20 s
BINS = 120  # number of bins of a spectrum, each of 2 RATE_HZ / WINDOW = 0.098 Hz, so that it ends near 11.7 Hz
STEP_S = 4.0  # time between two spectra, s
COLUMNS = 45  # number of spectra in the picture
# The line is drawn relative to the median over this time, s. Pulses of 2 s, which fill at most a quarter of the time,
# stand out from it, and pumps that start or change their strokes do not hide them.
_BASE_S = 10.0


@dataclasses.dataclass(frozen=True)
class PressurePicture:
    """
    Pressure as a line and a spectrogram.

    Attributes
    ----------
    end_ns : int
        Stamp of the newest sample.
    line : tuple of float
        Pressure of the last `LINE_S` minus its running median, kPa, newest last.
    spectra : tuple of tuple of int
        Power, dB: one tuple of `BINS` values from 0 Hz on for each `STEP_S`, newest last.
    bin_hz : float
        Width of a bin.
    line_hz : float
        Rate of the values in `line`.
    """

    end_ns: int
    line: tuple[float, ...]
    spectra: tuple[tuple[int, ...], ...]
    bin_hz: float = 2.0 * RATE_HZ / WINDOW
    line_hz: float = LINE_HZ


class PressureHistory:
    """Samples and spectra of the last minutes, from bursts of pressure as they arrive."""

    def __init__(self) -> None:
        self._samples = np.zeros(0)
        self._spectra: list[tuple[int, ...]] = []
        self._since_s = 0.0
        self._end_ns = 0
        self._rate = RATE_HZ

    def push(self, start_ns: int, period_s: float, pressure_pa: Array) -> bool:
        """
        Accept a burst; return whether a new spectrum was computed.

        start_ns: stamp of the first sample; period_s: time between two samples; pressure_pa: shape (n,), Pa. An
        integer number of samples is averaged, so that the rate comes as near as possible to `RATE_HZ`. A burst that
        starts more than `STEP_S` before the end of the last one clears the history.
        """
        if start_ns < self._end_ns - round(1e9 * STEP_S):
            self._samples, self._spectra = np.zeros(0), []
        many = max(round(1.0 / period_s / RATE_HZ), 1)
        self._rate = 1.0 / (period_s * many)
        whole = len(pressure_pa) // many * many
        means = np.asarray(pressure_pa[:whole]).reshape(-1, many).mean(axis=1)
        self._samples = np.concatenate([self._samples, means])[-max(round(LINE_S * self._rate), WINDOW) :]
        self._end_ns = start_ns + round(len(pressure_pa) * period_s * 1e9)
        self._since_s += len(pressure_pa) * period_s
        if self._since_s < STEP_S or len(self._samples) < WINDOW:
            return False
        self._since_s = math.fmod(self._since_s, STEP_S)
        self._spectra = [*self._spectra, self._spectrum()][-COLUMNS:]
        return True

    def picture(self) -> PressurePicture:
        """Return line and spectrogram up to the newest sample."""
        many = max(round(self._rate / LINE_HZ), 1)
        recent = self._samples[-round(LINE_S * self._rate) :]
        whole = recent[len(recent) % many :].reshape(-1, many).mean(axis=1) if len(recent) >= many else recent
        base = _running_median(whole, round(_BASE_S * self._rate / many)) if len(whole) else whole
        line = np.round((whole - base) * 1e-3, 2).tolist()
        return PressurePicture(self._end_ns, tuple(line), tuple(self._spectra), 2.0 * self._rate / WINDOW)

    def _spectrum(self) -> tuple[int, ...]:
        window = self._samples[-WINDOW:]
        power = np.abs(np.fft.rfft((window - window.mean()) * np.hanning(WINDOW))[: 2 * BINS]) ** 2
        pairs = power.reshape(-1, 2).mean(axis=1)
        return tuple(int(v) for v in np.round(10.0 * np.log10(np.maximum(pairs, 1e-3))))


def _running_median(values: Array, many: int) -> Array:
    # Import only when needed: a surface without a pressure gauge starts faster.
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(values, many, mode="reflect"))
