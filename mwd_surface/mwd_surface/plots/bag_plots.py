# SPDX-License-Identifier: Apache-2.0
"""Plot of a bag for the driller: sensors, rig, truth, attitude, surveys, spectra and Allan deviation."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_estimation.survey.survey import Survey
from mwd_sensors.calibration.allan import figures
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.plots.drawing import (
    BAD,
    DEGREES,
    DOUBTFUL,
    GOOD,
    SERIES,
    TRUTH_COLOUR,
    drawer,
    finish_axes,
    png,
    svg,
    time_unit,
)
from mwd_surface.plots.plot_data import AllanOf, Panel, PlotData, SpectrumOf
from mwd_surface.plots.traces import NORTHS, WHAT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
# Heading of each part of the plot, by its word in `WHAT`.
_HEADINGS = {
    "sensors": "Sensors",
    "rig": "Rig",
    "truth": "Truth of the simulator",
    "attitude": "Attitude as estimated",
    "surveys": "Surveys",
    "spectra": "Spectra",
    "allan": "Allan deviation of the longest still interval",
}
# Width of the plot, its margins, and heights of its parts, inches.
_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 12.5, 0.95, 1.85, 0.6, 0.35
_PANEL, _HEADING, _SQUARE, _TITLE, _AXIS = 1.35, 0.3, 3.0, 0.28, 0.5
_DOTS_PER_INCH = 110  # resolution of a PNG file
_NORTH_TRUE = 2  # number of true north in the messages


@dataclasses.dataclass
class _Row:
    """Row of the plot: height and space below, inches, and the functions that draw the axes of the row."""

    height: float
    draw: list[Callable[[Axes], None]]
    under: float
    heading: str = ""


def sections(data: PlotData, what: Sequence[str]) -> list[str]:
    """Return those words of `what` for which there are data, in the order of drawing."""
    return [word for word in WHAT if word in what and _section(data, word)]


def figure(data: PlotData, what: Sequence[str]) -> Figure:
    """
    Return the plot of a bag with the parts named in `what`.

    Every panel has a title with its topic, an axis with its unit, and a legend.
    """
    # Do not use pyplot, which keeps every figure in a global list.
    from matplotlib.figure import Figure

    rows = [row for word in WHAT if word in what for row in _section(data, word)]
    remarks = 0.2 * len(data.remarks)
    height = _TOP + _BOTTOM + remarks + sum(row.height + row.under + _TITLE for row in rows)
    height += _HEADING * sum(bool(row.heading) for row in rows)
    whole = Figure(figsize=(_WIDTH, height))
    start = datetime.datetime.fromtimestamp(data.start_ns * 1e-9, tz=datetime.UTC)
    title = f"{data.name}: {_duration(data.seconds)} from {start:%Y-%m-%d %H:%M:%S} UTC"
    whole.text(_LEFT / _WIDTH, 1.0 - 0.38 / height, title, fontsize=14, weight="bold", va="center")
    top = _TOP
    for row in rows:
        if row.heading:
            top += _HEADING
            whole.text(0.2 / _WIDTH, 1.0 - (top - 0.02) / height, row.heading, fontsize=12, weight="bold", va="bottom")
        top += _TITLE
        for k, draw in enumerate(row.draw):
            draw(whole.add_axes(_place(k, len(row.draw), top, row.height, height)))
        top += row.height + row.under
    for k, remark in enumerate(data.remarks):
        whole.text(_LEFT / _WIDTH, (_BOTTOM + remarks - 0.2 * (k + 1)) / height, remark, fontsize=9, color=TRUTH_COLOUR)
    return whole


def image(picture: Figure, kind: str) -> bytes:
    """Return the plot as the bytes of a file; kind: png or svg. The same plot gives the same bytes."""
    return png(picture, _DOTS_PER_INCH) if kind == "png" else svg(picture).encode()


def _place(k: int, count: int, top: float, row: float, height: float) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of one of several axes of a row, as shares of the figure."""
    if count == 1:
        width, left = _WIDTH - _LEFT - _RIGHT, _LEFT
    else:
        gap = 0.75
        width = (_WIDTH - _LEFT - 0.3 - gap * (count - 1)) / count
        left = _LEFT + k * (width + gap)
    return left / _WIDTH, 1.0 - (top + row) / height, width / _WIDTH, row / height


def _section(data: PlotData, word: str) -> list[_Row]:
    rows: list[_Row] = []
    if word == "spectra":
        rows = _spectrum_rows(data)
    elif word == "allan":
        # Draw the gyros and the accelerometers of an IMU side by side.
        for start in range(0, len(data.allan), 2):
            pair = [drawer(_draw_allan, item) for item in data.allan[start : start + 2]]
            rows.append(_Row(_SQUARE, pair, _AXIS))
    elif word == "surveys":
        if data.surveys:
            rows = [_Row(_SQUARE, survey_drawers(data), _AXIS)]
    else:
        panels = [panel for panel in data.panels if panel.trace.what == word]
        for panel in panels:
            last = panel is panels[-1]
            rows.append(_Row(_PANEL, [drawer(_draw_panel, data, panel, last)], _AXIS if last else 0.08))
    if rows:
        rows[0].heading = _HEADINGS[word]
    return rows


def _draw_panel(ax: Axes, data: PlotData, panel: Panel, last: bool) -> None:
    trace, (scale, unit) = panel.trace, time_unit(data.seconds)
    dense = not panel.envelope.exact
    for k, label in enumerate(trace.labels):
        seconds, value = panel.envelope.line(k)
        sparse = len(seconds) < 60
        ax.plot(
            seconds / scale,
            value,
            color=SERIES[k % len(SERIES)],
            linewidth=0.5 if dense else 0.9,
            marker="." if sparse else "",
            markersize=3.0,
            alpha=0.85,
            label=label,
        )
    truth = _truth_beside(data, panel)
    if truth is not None:
        seconds, value = truth.envelope.line(0)
        ax.plot(seconds / scale, value, "--", color=TRUTH_COLOUR, linewidth=0.9, label="truth")
    _label(ax, panel.title, y=trace.unit)
    ax.set_xlim(0.0, max(data.seconds, 1e-3) / scale)
    if trace.log:
        ax.set_yscale("log")
    if trace.down:
        ax.invert_yaxis()
    if trace.circle:
        _as_angles(ax, half="toolface" in trace.title)
    elif not trace.log:
        ax.ticklabel_format(axis="y", useOffset=False)
    if trace.rotary:
        beside = ax.secondary_yaxis("right", functions=(_per_minute, _per_second))
        beside.set_ylabel("r/min", fontsize=8, labelpad=2)
        beside.tick_params(labelsize=7)
    finish_axes(ax)
    legend = ax.legend(loc="center left", bbox_to_anchor=(1.055, 0.5), fontsize=8, frameon=False, handlelength=1.5)
    for line in legend.get_lines():
        line.set_linewidth(2.0)
    if last:
        start = datetime.datetime.fromtimestamp(data.start_ns * 1e-9, tz=datetime.UTC)
        ax.set_xlabel(f"{unit} after {start:%H:%M:%S} UTC", fontsize=9)
    else:
        ax.tick_params(labelbottom=False)


def _label(ax: Axes, title: str, x: str = "", y: str = "") -> None:
    ax.set_title(title, loc="left", fontsize=9, pad=3)
    ax.set_xlabel(x, fontsize=9)
    ax.set_ylabel(y, fontsize=9)


def _per_minute(rate_deg_s: Any) -> Any:
    return rate_deg_s / 6.0


def _per_second(speed_rpm: Any) -> Any:
    return speed_rpm * 6.0


def _truth_beside(data: PlotData, panel: Panel) -> Panel | None:
    """
    Return the truth panel of the same angle and well, for comparison with an attitude panel.

    Return None if there is no such panel, and for an azimuth that is not from true north.
    """
    key = panel.trace.key
    if panel.trace.what != "attitude" or not key or (key == "azimuth" and panel.north != _NORTH_TRUE):
        return None
    well = panel.topic.rpartition("/")[0]
    for other in data.panels:
        same = other.trace.what == "truth" and other.trace.key == key and other.topic.rpartition("/")[0] == well
        if same:
            return other
    return None


def _as_angles(ax: Axes, half: bool) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    def text(value: float, _position: int | None) -> str:
        return f"{(value + 180.0) % 360.0 - 180.0 if half else value % 360.0:g}"

    low, high = ax.get_ylim()
    if half and high - low > 180.0:
        ax.set_ylim(-185.0, 185.0)
        ax.set_yticks([-180.0, -90.0, 0.0, 90.0, 180.0])
    else:
        # Show at least 1 deg, so that the noise of a nearly constant angle does not fill the height of the panel.
        if high - low < 1.0:
            middle = 0.5 * (low + high)
            ax.set_ylim(middle - 0.5, middle + 0.5)
        ax.yaxis.set_major_locator(MaxNLocator(5))
        ax.yaxis.set_major_formatter(FuncFormatter(text))


def _spectrum_rows(data: PlotData) -> list[_Row]:
    rows: list[_Row] = []
    for start in range(0, len(data.spectra), 3):
        drawers = [drawer(_draw_spectrum, item) for item in data.spectra[start : start + 3]]
        # One or two axes get the same width as three.
        rows.append(_Row(_SQUARE, drawers + [_nothing] * (3 - len(drawers)), _AXIS))
    rows += [
        _Row(1.6, [drawer(_draw_waterfall, data, item)], _AXIS)
        for item in data.spectra
        if item.quantity == "specific force" and len(item.spectrum.waterfall) >= 8
    ]
    return rows


def _nothing(ax: Axes) -> None:
    ax.set_axis_off()


def _draw_spectrum(ax: Axes, item: SpectrumOf) -> None:
    spectrum = item.spectrum
    for k, label in enumerate(("x (down-hole)", "y", "z (scribe)")):
        level = np.sqrt(spectrum.density[1:, k])
        ax.loglog(spectrum.frequency[1:], np.maximum(level, 1e-12), color=SERIES[k], linewidth=0.8, label=label)
    averages = f"Hz ({spectrum.segments} averages of {spectrum.segment / spectrum.rate:.3g} s)"
    _label(ax, f"{item.topic}: {item.quantity}", averages, f"{item.unit}/√Hz")
    finish_axes(ax, legend=True)


def _draw_waterfall(ax: Axes, data: PlotData, item: SpectrumOf) -> None:
    spectrum, (scale, unit) = item.spectrum, time_unit(data.seconds)
    across = spectrum.waterfall[:, 1:, 1:].sum(axis=2).T
    level = 10.0 * np.log10(np.maximum(across, 1e-12))
    known = level[np.isfinite(level)]
    drawn = ax.imshow(
        level,
        aspect="auto",
        origin="lower",
        extent=(0.0, data.seconds / scale, float(spectrum.frequency[1]), spectrum.rate / 2.0),
        cmap="viridis",
        vmin=float(np.percentile(known, 5)),
        vmax=float(np.percentile(known, 99.5)),
        interpolation="nearest",
    )
    _label(ax, f"{item.topic}: specific force across the tool, over time", f"{unit} after the start", "Hz")
    ax.tick_params(labelsize=8)
    bar = ax.figure.colorbar(drawn, ax=ax, cax=ax.inset_axes((1.02, 0.0, 0.015, 1.0)))
    bar.set_label("dB of (m/s²)²/Hz", fontsize=8)
    bar.ax.tick_params(labelsize=7)


_DEG_H = DEGREES * 3600.0
_UG = 1e6 / STANDARD_GRAVITY


def _draw_allan(ax: Axes, item: AllanOf) -> None:
    gyro = item.quantity == "angular rate"
    scale, unit = (_DEG_H, "deg/h") if gyro else (_UG, "µg")
    for k, axis in enumerate("xyz"):
        got = figures(item.curve, k)
        white = f"{got.white * DEGREES * 60.0:.3g} deg/√h" if gyro else f"{got.white * _UG:.3g} µg/√Hz"
        label = f"{axis}: {white}; lowest {got.floor * scale:.3g} {unit} at {got.floor_tau:.3g} s"
        deviation = item.curve.deviation[:, k] * scale
        ax.loglog(item.curve.tau, np.maximum(deviation, 1e-12), color=SERIES[k], linewidth=1.0, label=label)
        low, high = (np.maximum(deviation * (1.0 + s * item.curve.sigma), 1e-12) for s in (-1.0, 1.0))
        ax.fill_between(item.curve.tau, low, high, color=SERIES[k], alpha=0.15, linewidth=0.0)
    title = f"{item.topic}: {item.quantity}, still for {item.seconds:.0f} s from {item.start_s:.0f} s"
    _label(ax, title, "averaging time, s", f"Allan deviation, {unit}")
    finish_axes(ax, legend=True)


def _duration(seconds: float) -> str:
    if seconds < 300.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3.0 * 3600.0 else f"{seconds / 3600.0:.2f} h"


_VERDICTS = (("o", GOOD, "accepted"), ("^", DOUBTFUL, "doubtful"), ("x", BAD, "rejected"))


def survey_drawers(data: PlotData) -> list[Callable[[Axes], None]]:
    """Return the functions that draw the panels of the surveys; the panels are placed side by side."""
    surveys = [survey for survey, _ in data.surveys]
    norths = {NORTHS.get(s.north, "unnamed") for s in surveys if s.has_azimuth}
    north = " and ".join(sorted(norths)) or "unnamed"
    columns: tuple[tuple[str, Callable[[Survey], tuple[float, float]]], ...] = (
        ("inclination, deg", lambda s: (s.inclination * DEGREES, s.sigma_inclination * DEGREES)),
        (f"azimuth from {north} north, deg", lambda s: (s.azimuth * DEGREES, s.sigma_azimuth * DEGREES)),
        ("field less reference, nT", lambda s: ((s.b_total - s.b_reference) * 1e9, 0.0)),
        ("dip less reference, deg", lambda s: ((s.dip - s.dip_reference) * DEGREES, 0.0)),
    )
    return [drawer(_draw_survey, data, label, value, k == 0) for k, (label, value) in enumerate(columns)]


def _draw_survey(
    ax: Axes, data: PlotData, label: str, value: Callable[[Survey], tuple[float, float]], first: bool
) -> None:
    deep = all(not math.isnan(depth) for _, depth in data.surveys)
    scale, unit = time_unit(data.seconds)
    for verdict, (mark, colour, name) in enumerate(_VERDICTS):
        rows = []
        for survey, depth in data.surveys:
            x, sigma = value(survey)
            if survey.verdict == verdict and not math.isnan(x):
                rows.append((x, depth if deep else (survey.stamp_ns - data.start_ns) * 1e-9 / scale, sigma))
        if rows:
            points = np.array(rows)
            ax.errorbar(
                points[:, 0],
                points[:, 1],
                xerr=points[:, 2],
                fmt=mark,
                color=colour,
                markersize=5,
                elinewidth=0.8,
                label=name,
            )
    if "less" in label:
        ax.axvline(0.0, color="k", linewidth=0.7)
    ax.invert_yaxis()
    ax.set_xlabel(label + (" (± 1 sigma)" if "less" not in label else ""), fontsize=9)
    if first:
        ax.set_ylabel("measured depth, m" if deep else f"{unit} after the start", fontsize=9)
    ax.ticklabel_format(axis="x", useOffset=False)
    finish_axes(ax)
    if first:
        ax.legend(fontsize=8, frameon=False)
    elif not ax.get_legend_handles_labels()[0]:
        ax.text(
            0.5, 0.5, "not available", ha="center", va="center", transform=ax.transAxes, fontsize=9, color=TRUTH_COLOUR
        )
