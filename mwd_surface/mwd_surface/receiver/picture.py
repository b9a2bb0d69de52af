# SPDX-License-Identifier: Apache-2.0
"""Figure of a decoded recording: pressure with words and chosen pulses, confidence of the words, and spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.plots.drawing import BLACK, BLUE, GOOD, NEUTRAL, finish_axes, new_figure
from mwd_surface.receiver.words import BELIEVED, ReceivedWord, pulse_edges

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {True: GOOD, False: NEUTRAL}
_MOST_POINTS = 6000


class PictureQuantity(NamedTuple):
    """Recorded quantity for the axes: its name, the unit shown, and the size of the unit in SI."""

    name: str
    unit: str
    size: float


PRESSURE, VOLTAGE = PictureQuantity("Pressure", "bar", 1e5), PictureQuantity("Voltage", "mV", 1e-3)


def figure_of(
    time_s: Array,
    pressure_pa: Array,
    words: Sequence[ReceivedWord],
    tool: ToolConfiguration,
    quantity: PictureQuantity = PRESSURE,
) -> Figure:
    """
    Return the figure of a decoded recording.

    Parameters
    ----------
    time_s, pressure_pa : ndarray, shape (n,)
    tool : ToolConfiguration
        Tool configuration: its pulses are drawn on the last survey, and it sets the range of the spectrum.
    """
    closer = words and tool.code == "mary"
    figure = new_figure(12.5, 10.0 if closer else 7.5)
    pressure, *pulses, confidence, spectrum = figure.subplots(4 if closer else 3, 1)
    _pressure(pressure, time_s, pressure_pa, quantity)
    for ax in pulses:
        _pulses(ax, time_s, pressure_pa / quantity.size, words, tool)
        ax.set_ylabel(quantity.unit)
    if words:
        # Scale the pressure axis to the time while the tool sends: the step at flow-on would hide the pulses.
        heard = pressure_pa[(time_s >= words[0].start_s) & (time_s <= words[-1].end_s)] / quantity.size
        if len(heard) and np.ptp(heard) > 0.0:
            pressure.set_ylim(float(heard.min()), float(heard.max()))
    for ax in (pressure, confidence):
        for word in words:
            good = word.status == BELIEVED
            ax.axvspan(
                word.start_s, word.end_s, color=_COLOURS[good], alpha=0.15, linewidth=0, hatch="" if good else "///"
            )
        ax.set_xlim(float(time_s[0]), float(time_s[-1]))
        ax.set_xlabel("time, s")
    for status in (True, False):
        some = [word for word in words if (word.status == BELIEVED) is status]
        middle = [0.5 * (word.start_s + word.end_s) for word in some]
        label = "believed" if status else "erased"
        confidence.plot(middle, [word.confidence for word in some], "o", ms=3, color=_COLOURS[status], label=label)
    confidence.set_ylim(-0.05, 1.05)
    confidence.set_ylabel("confidence")
    confidence.set_title("Words: probability that the code is right", loc="left", fontsize=9)
    confidence.legend(loc="lower right", fontsize=8)
    _spectrum(spectrum, time_s, pressure_pa, tool.shortest_s, quantity)
    for ax in (pressure, *pulses, confidence, spectrum):
        finish_axes(ax)
    return figure


def _pressure(ax: Axes, time_s: Array, pressure_pa: Array, quantity: PictureQuantity) -> None:
    """Draw the lowest and highest value of each short block of samples, so that no pulse is lost."""
    pieces = max(len(time_s) // _MOST_POINTS, 1)
    count = len(time_s) // pieces * pieces
    blocks = pressure_pa[:count].reshape(-1, pieces) / quantity.size
    at = time_s[:count:pieces]
    ax.fill_between(at, blocks.min(axis=1), blocks.max(axis=1), color=BLUE, linewidth=0.5)
    ax.set_ylabel(quantity.unit)
    ax.set_title(f"{quantity.name}; words in green, erased ones hatched in grey", loc="left", fontsize=9)


def _pulses(ax: Axes, time_s: Array, value: Array, words: Sequence[ReceivedWord], tool: ToolConfiguration) -> None:
    """Draw the pressure of the last survey (else of the last words) with the chosen pulses below it."""
    frame = max((word.frame for word in words if word.kind == "survey"), default=words[-1].frame)
    shown = [word for word in words if word.frame == frame]
    inside = (time_s >= shown[0].start_s) & (time_s <= shown[-1].end_s)
    if np.any(inside):
        ax.plot(time_s[inside], value[inside], color=BLUE, linewidth=0.6)
    for word in shown:
        colour = _COLOURS[word.status == BELIEVED]
        for edge in pulse_edges(word, tool):
            begin = word.start_s + edge
            ax.axvspan(begin, begin + tool.pulse_width_s, ymax=0.06, color=colour, linewidth=0)
        ax.axvline(word.start_s, color=colour, linewidth=0.6)
        ax.text(word.start_s, 1.0, f" {word.name}", fontsize=8, va="top", transform=ax.get_xaxis_transform())
    ax.set_xlim(shown[0].start_s, shown[-1].end_s)
    ax.set_xlabel("time, s")
    ax.set_title(f"Pulses chosen in the last {shown[0].kind}, below the pressure", loc="left", fontsize=9)


def _spectrum(ax: Axes, time_s: Array, pressure_pa: Array, tu_s: float, quantity: PictureQuantity) -> None:
    """Draw the mean spectrum of pieces of 64 pulse widths (Welch's method)."""
    step = float(np.median(np.diff(time_s)))
    length = min(max(round(128.0 * tu_s / step), 64), len(pressure_pa))
    window = np.hanning(length)
    starts = range(0, len(pressure_pa) - length + 1, max(length // 2, 1))
    pieces = [pressure_pa[k : k + length] for k in starts]
    power = np.mean([np.abs(np.fft.rfft((one - one.mean()) * window)) ** 2 for one in pieces], axis=0)
    power = power * 2.0 * step / np.sum(window**2)
    frequency = np.fft.rfftfreq(length, step)
    shown = (frequency > 0.0) & (frequency <= 1.6 / tu_s)
    density = power[shown] / quantity.size**2
    ax.plot(frequency[shown], density, color=BLACK, linewidth=0.8)
    # A constant signal, as of a gauge that is stuck, has no power, and a logarithmic axis cannot show zero.
    if np.any(density > 0.0):
        ax.set_yscale("log")
    ax.set_xlabel("frequency, Hz")
    ax.set_ylabel(f"{quantity.unit}²/Hz")
    ax.set_title(f"Spectrum of the {quantity.name.lower()}: lines are pumps", loc="left", fontsize=9)
