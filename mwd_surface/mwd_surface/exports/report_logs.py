# SPDX-License-Identifier: Apache-2.0
"""Sections of the report about the tool of a run: its health, and its logs as depth tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mwd_surface.exports.report_section import DOUBTFUL, GOOD, REJECT, Drawing, Section, sheet_of
from mwd_surface.logs.depth_log import Curve
from mwd_surface.logs.tool_health import ToolHealth
from mwd_surface.plots.drawing import new_figure
from mwd_surface.signals.table import Display
from mwd_surface.signals.units import UNITS, UnitScale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HOUR_S = 3600.0
# Share of the tool's life, used by one exposure, from which the share is highlighted; as in `live.log_monitor`.
_WARNING = 0.8
# Title of the axis of each channel, in the order of the depth tracks.
_TRACKS = {
    "gamma": "Gamma",
    "inclination": "Inclination",
    "lateral_vibration": "Vibration",
    "temperature": "Temperature",
    "battery_voltage": "Battery",
}


def health_section(health: ToolHealth, display: Display) -> Section | None:
    """Return the section on times, battery, exposures and parts of the tool; None if there are no data of the tool."""
    if not health.stamp_ns and not health.parts:
        return None
    text, sheets = [f"{one}." for one in health.remarks], []
    battery = health.battery
    rows = [("Run time", _number(health.run_time / _HOUR_S), "h"), ("Pumps on", _number(health.pumping / _HOUR_S), "h")]
    if battery is not None:
        rows += [
            ("Battery voltage", _number(battery.voltage), "V"),
            ("Battery used", _number(battery.used / _HOUR_S), "A h"),
            ("Battery remaining", _number(battery.remaining / _HOUR_S), "h"),
            ("Battery remaining, 1 sigma", _number(battery.sigma_remaining / _HOUR_S), "h"),
        ]
        text += [f"The remaining time is assumed: {one}." for one in battery.assumed]
    if health.failed_tests is not None:
        rows.append(("Self-tests that failed", ", ".join(health.failed_tests) or "none", ""))
        rows.append(("Self-tests not reported", ", ".join(health.unreported_tests) or "none", ""))
    sheets.append(sheet_of("Run of the tool", (("Quantity", ""), ("Value", ""), ("Unit", "")), rows))
    if health.exposures:
        columns = (
            ("Quantity", ""),
            ("Unit", ""),
            ("Largest", ""),
            ("Limit from", ""),
            ("Observed", "h"),
            ("Life used", "%"),
        )
        levels = [
            (
                one.source.replace("_", " "),
                scale.symbol,
                _number(scale.of(one.largest)),
                _number(scale.of(one.limit)),
                _number(one.observed / _HOUR_S),
                _number(100.0 * one.dose),
            )
            for one in health.exposures
            for scale in (_scale(one.unit, display),)
        ]
        tints = {
            (k, 5): REJECT if one.dose >= 1.0 else DOUBTFUL if one.dose >= _WARNING else GOOD
            for k, one in enumerate(health.exposures)
        }
        assumed = any(one.assumed for one in health.exposures)
        legend = "The limits are assumed: the tool file states none." if assumed else ""
        sheets.append(sheet_of("Exposure of the tool", columns, levels, tints=tints, legend=legend))
    if health.parts:
        parts = [
            (one.name, one.serial_number, one.calibrated, str(one.overdue_days) if one.overdue_days else "")
            for one in health.parts
        ]
        heads = (("Part", ""), ("Serial number", ""), ("Calibrated", ""), ("Days too old", ""))
        sheets.append(sheet_of("Parts of the tool", heads, parts))
    return Section("Health of the tool", tuple(text), tuple(sheets))


def log_section(curves: Sequence[Curve], display: Display) -> Section | None:
    """Return the section with the logs as depth tracks, in the units of the well; None without logs."""
    by_name = {curve.channel: curve for curve in curves if len(curve.depth) and np.isfinite(curve.value).any()}
    shown = [by_name[name] for name in _TRACKS if name in by_name]
    if not shown:
        return None
    caption = "Logs over measured depth, first pass, each with its 1 sigma; sectors from the high side, clockwise."
    return Section("Logs", drawings=(Drawing(caption, lambda: tracks(shown, display), wide=True),))


def tracks(curves: Sequence[Curve], display: Display) -> Figure:
    """Return a figure with a track for each curve, and an image next to each curve that has sectors."""
    images = [curve for curve in curves if np.isfinite(curve.sectors).any()]
    figure = new_figure(11.0, 5.6)
    axes = np.atleast_1d(figure.subplots(1, len(curves) + len(images), sharey=True))
    place = iter(axes)
    for curve in curves:
        axis = next(place)
        scale = _scale(curve.unit, display)
        title, values = _TRACKS[curve.channel], curve.value
        if curve.channel == "inclination" and display.angles.points:
            title, values = display.angles.heading, display.angles.shown(values)
        value, sigma = values * scale.factor + scale.offset, curve.sigma * scale.factor
        axis.fill_betweenx(curve.depth, value - sigma, value + sigma, alpha=0.25, linewidth=0.0)
        axis.plot(value, curve.depth, linewidth=0.7, marker=".", markersize=1.5)
        axis.set_title(f"{title}\n{scale.symbol}", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(linewidth=0.3)
        if curve in images:
            _image(next(place), curve)
    axes[0].set_ylabel("measured depth, m", fontsize=8)
    axes[0].invert_yaxis()
    return figure


def _image(axis: object, curve: Curve) -> None:
    step = float(np.diff(curve.depth[:2]).sum()) or 1.0
    edges = np.append(curve.depth - 0.5 * step, curve.depth[-1] + 0.5 * step)
    sides = np.arange(curve.sectors.shape[1] + 1)
    axis.pcolormesh(sides, edges, np.ma.masked_invalid(curve.sectors), cmap="YlOrBr", rasterized=True)  # type: ignore[attr-defined]
    quarter = curve.sectors.shape[1] / 4.0
    axis.set_xticks([0.5 + k * quarter for k in range(4)], ["U", "R", "D", "L"], fontsize=7)  # type: ignore[attr-defined]
    axis.set_title("sectors", fontsize=8)  # type: ignore[attr-defined]


def _scale(unit: str, display: Display) -> UnitScale:
    return UNITS[unit].shown_in(display.units) if unit in UNITS else UnitScale(unit, 1.0)


def _number(value: float) -> str:
    return "" if not math.isfinite(value) else f"{value:.1f}"
