# SPDX-License-Identifier: Apache-2.0
"""Plots along a hole: two surveys compared, a high-density trajectory, and the forecast of surveys along a plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.plots.drawing import BAD, BLUE, DEGREES, PURPLE, SERIES, SKY, finish_axes, new_figure
from mwd_surface.trajectory.dense_trajectory import STATION, DenseTrajectory
from mwd_surface.uncertainty.position_covariance import ellipse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mwd_surface.trajectory.list_comparison import PathDifference
    from mwd_surface.uncertainty.forecast import Forecast

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


def trajectory_plot(found: DenseTrajectory) -> Figure:
    """Return a figure of the inclination, stations marked, and of the position minus that by minimum curvature."""
    figure = new_figure(10.0, 8.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    figure.suptitle("High-density trajectory (not the definitive survey)", fontsize=11)
    at_station = np.array([source == STATION for source in found.source])
    upper.plot(found.md, found.inclination * DEGREES, color=SERIES[0], linewidth=1.0, label="between stations")
    upper.plot(found.md[at_station], found.inclination[at_station] * DEGREES, "k.", markersize=5, label="stations")
    upper.set_ylabel("inclination, deg", fontsize=9)
    for k, name in enumerate(("north", "east", "vertical depth")):
        lower.plot(found.md, found.differences[:, k], color=SERIES[k], label=name)
    lower.axhline(0.0, color="k", linewidth=0.7)
    lower.set_ylabel("minus minimum curvature, m", fontsize=9)
    lower.set_xlabel("measured depth, m", fontsize=9)
    for ax in (upper, lower):
        finish_axes(ax, legend=True)
    return figure


_INC, _AZI, _CORRECTED, _NO_GO = SKY, BLUE, PURPLE, BAD


def forecast_figure(found: Forecast, chart: tuple[Array, Array, Array] | None) -> Figure:
    """
    Return the figure of a forecast: sigmas and share of accepted stations along the plan, and a polar map.

    chart: true azimuths, inclinations and sigmas of the corrected azimuth from `correction_map`, for the map; None
    if the tool code has no such correction, and then the figure has no map.
    """
    figure = new_figure(12.0, 5.2)
    grid = figure.add_gridspec(1, 4)
    sigma = figure.add_subplot(grid[0, 0])
    passes = figure.add_subplot(grid[0, 1], sharey=sigma)
    _draw_sigmas(sigma, found)
    passes.plot(100.0 * found.accepted, found.md, color=_AZI)
    lines = ("stations accepted, %", f"axial interference {found.axial * 1e9:.0f} nT")
    passes.set(xlim=(0.0, 101.0), xlabel="\n".join(lines))
    if not np.any(np.isfinite(found.accepted)):
        passes.text(0.5, 0.5, "no magnetic sensors", ha="center", transform=passes.transAxes, fontsize=9)
    for ax in (sigma, passes):
        finish_axes(ax)
    if chart is not None:
        _draw_map(figure, figure.add_subplot(grid[0, 2:], projection="polar"), found, chart)
    return figure


def _draw_sigmas(ax: Any, found: Forecast) -> None:
    most = 2.0 * found.most * DEGREES
    ax.plot(found.sigma_inclination * DEGREES, found.md, color=_INC, label="inclination")
    ax.plot(found.sigma_azimuth * DEGREES, found.md, color=_AZI, label="azimuth")
    ax.plot(np.clip(found.sigma_corrected * DEGREES, 0.0, most), found.md, "--", color=_CORRECTED, label="corrected")
    ax.axvline(found.most * DEGREES, color=_NO_GO, linewidth=0.9, label="no-go of the correction")
    ax.set(xlabel="1 sigma, deg", ylabel="measured depth, m")
    ax.set_xlim(0.0, most)
    ax.invert_yaxis()
    ax.legend(fontsize=8, frameon=False)


def _draw_map(figure: Figure, ax: Any, found: Forecast, chart: tuple[Array, Array, Array]) -> None:
    azimuths, inclinations, sigmas = chart
    most = found.most * DEGREES
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    levels = most * np.array([0.0, 0.25, 0.5, 0.75, 1.0, 2.0, 4.0])
    shown = np.clip(np.nan_to_num(sigmas * DEGREES, nan=0.0), 0.0, levels[-1])
    drawn = ax.contourf(azimuths, inclinations * DEGREES, shown, levels=levels, cmap="viridis_r")
    ax.contour(azimuths, inclinations * DEGREES, shown, levels=[most], colors=_NO_GO, linewidths=1.4)
    good = found.inclination >= math.radians(1.0)
    ax.plot(found.true_azimuth[good], found.inclination[good] * DEGREES, "k-", linewidth=2.0, label="plan")
    ax.set_rmax(90.0)
    ax.set_title("sigma of the corrected azimuth by true azimuth and inclination; red line: no-go beyond", fontsize=9)
    figure.colorbar(drawn, ax=ax, label="deg", shrink=0.8)
    ax.legend(fontsize=8, loc="lower left", bbox_to_anchor=(-0.1, -0.05), frameon=False)
