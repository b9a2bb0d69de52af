# SPDX-License-Identifier: Apache-2.0
"""Figures 7 to 10 of S3, drawn from the simulated experiments in the style of the other plots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from bench_gravity import inclination, toolface

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.plots.drawing import BLUE, NEUTRAL, RED, TRUTH_COLOUR, finish_axes, png

if TYPE_CHECKING:
    from papers import Experiment

_STYLES = {
    "raw": (NEUTRAL, "accelerometer alone", 0.8),
    "kalman": (RED, "Kalman", 1.0),
    "s3": (BLUE, "S3", 1.2),
}
_ROTATION_S = (20.0, 22.0)  # two seconds while the tool turns, five turns


def rotation(one: Experiment, folder: Path) -> None:
    """Draw figure 7, gravity by accelerometer and as extracted, and figure 8, inclination and toolface."""
    start, end = np.searchsorted(one.stamp_ns - one.stamp_ns[0], [round(s * 1e9) for s in _ROTATION_S])
    at = slice(int(start), int(end))
    _gravity(one, at, ("raw", "s3"), "S3, figure 7: gravity at 155 r/min", folder / "paper_s3_figure7.png")
    _angles(one, at, ("raw", "s3"), "S3, figure 8: attitude at 155 r/min", folder / "paper_s3_figure8.png")


def vibration(one: Experiment, at: slice, folder: Path) -> None:
    """Draw figure 9, gravity by three methods in a second at 13 Hz, and figure 10, inclination and toolface."""
    names = ("raw", "kalman", "s3")
    _gravity(one, at, names, "S3, figure 9: gravity in vibration at 13 Hz", folder / "paper_s3_figure9.png")
    _angles(one, at, names, "S3, figure 10: attitude in vibration at 13 Hz", folder / "paper_s3_figure10.png")


def _gravity(one: Experiment, at: slice, names: tuple[str, ...], title: str, path: Path) -> None:
    lines = {name: one.found[name][at] * STANDARD_GRAVITY for name in names}
    lines["raw"] = -one.force[at]
    panels = [(f"{axis}, m/s²", {name: line[:, c] for name, line in lines.items()}) for c, axis in enumerate("xyz")]
    _draw(one, at, panels, title, path)


def _angles(one: Experiment, at: slice, names: tuple[str, ...], title: str, path: Path) -> None:
    dips = {name: 90.0 - inclination(one.found[name][at]) for name in names}
    toolfaces = {name: toolface(one.found[name][at]) for name in names}
    dips["truth"], toolfaces["truth"] = 90.0 - inclination(one.down[at]), toolface(one.down[at])
    panels = [("dip, down positive, deg", dips), ("toolface, deg", toolfaces)]
    _draw(one, at, panels, title, path)


def _draw(one: Experiment, at: slice, panels: list[tuple[str, dict[str, Array]]], title: str, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 1.0 + 1.6 * len(panels)), layout="constrained")
    seconds = (one.stamp_ns[at] - one.stamp_ns[0]) * 1e-9
    axes: Any = figure.subplots(len(panels), 1, sharex=True)
    for ax, (label, lines) in zip(axes, panels, strict=True):
        for name, line in lines.items():
            if name == "truth":
                ax.plot(seconds, line, "--", color=TRUTH_COLOUR, linewidth=0.9, label="truth")
            else:
                colour, words, width = _STYLES[name]
                ax.plot(seconds, line, color=colour, linewidth=width, label=words)
        ax.set_ylabel(label, fontsize=9)
        ax.ticklabel_format(axis="y", useOffset=False)
        finish_axes(ax)
    axes[0].set_title(title, loc="left", fontsize=10)
    axes[0].legend(loc="upper right", fontsize=8, ncols=4)
    axes[-1].set_xlabel("seconds", fontsize=9)
    path.write_bytes(png(figure, 100))
