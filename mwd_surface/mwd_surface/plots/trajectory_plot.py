# SPDX-License-Identifier: Apache-2.0
"""Plot of a high-density trajectory: inclination between the stations and its effect on the position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mwd_surface.plots.drawing import DEGREES, SERIES, finish_axes, new_figure
from mwd_surface.trajectory.dense_trajectory import STATION, DenseTrajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
