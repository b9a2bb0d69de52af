# SPDX-License-Identifier: Apache-2.0
"""Plots of two surveys of one hole: their differences along the hole, and the ends of their paths in plan view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.plots.drawing import DEGREES, SERIES, finish_axes, new_figure
from mwd_surface.trajectory.list_comparison import PathDifference
from mwd_surface.uncertainty.position_covariance import ellipse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BAND = 2.0  # half width of the bands, in sigmas


def end_ellipses(ends: Sequence[tuple[Array, Array | None]], names: Sequence[str]) -> Figure:
    """
    Return a figure of the ends of two paths in plan view, with ellipses of 2 sigma.

    ends: for each path, position of its end, shape (3,), m, and horizontal covariance, shape (2, 2), m^2; None: no
    ellipse.
    names: names of the paths.
    """
    figure = new_figure(6.0, 5.6)
    ax = figure.subplots()
    for (position, covariance), name, colour, line in zip(ends, names, SERIES, ("--", "-"), strict=False):
        ax.plot(position[1], position[0], "o", color=colour, label=name)
        if covariance is None:
            continue
        outline = ellipse(covariance, _BAND).outline()
        ax.plot(position[1] + outline[:, 1], position[0] + outline[:, 0], line, color=colour, linewidth=1.2)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("east, m", fontsize=9)
    ax.set_ylabel("north, m", fontsize=9)
    finish_axes(ax, legend=True)
    return figure


def figure_of(found: PathDifference, first: str, second: str) -> Figure:
    """
    Return a figure of the differences of inclination, azimuth and position against measured depth.

    The azimuth difference is times sin(inclination). The position has bands of 2 sigma where the sigma is known.

    first, second : names of the two lists.
    """
    figure = new_figure(10.0, 8.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    figure.suptitle(f"{first} minus {second}", fontsize=11)
    upper.plot(found.md, found.turn[:, 0] * DEGREES, color=SERIES[0], label="inclination")
    # Draw the rotation of the hole axis that the difference of azimuth causes, because near the vertical a change of
    # azimuth has little effect.
    across = found.turn[:, 1] * np.sin(found.inclination[:, 0])
    upper.plot(found.md, across * DEGREES, color=SERIES[1], label="azimuth x sin(inclination)")
    _finish(upper, "deg")
    for k, name in enumerate(("north", "east", "down")):
        lower.plot(found.md, found.position[:, k], color=SERIES[k], label=name)
        if np.isfinite(found.sigma[:, k]).any():
            band = _BAND * found.sigma[:, k]
            lower.fill_between(found.md, -band, band, color=SERIES[k], alpha=0.12, linewidth=0.0)
    if np.isfinite(found.sigma).any():
        lower.fill_between(
            [], [], [], color="#888888", alpha=0.3, label="2 sigma of the difference, in the same colour"
        )
    _finish(lower, "m")
    lower.set_xlabel("measured depth, m", fontsize=9)
    return figure


def _finish(ax: Axes, unit: str) -> None:
    ax.axhline(0.0, color="k", linewidth=0.7)
    ax.set_ylabel(f"difference, {unit}", fontsize=9)
    finish_axes(ax, legend=True)
