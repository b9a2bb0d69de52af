# SPDX-License-Identifier: Apache-2.0
"""Plot of a forecast: sigmas and share of accepted surveys along the plan, and no-go zone of the axial correction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.plots.drawing import BAD, BLUE, DEGREES, PURPLE, SKY, finish_axes, new_figure
from mwd_surface.uncertainty.forecast import Forecast

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
