# SPDX-License-Identifier: Apache-2.0
"""Plots of clearance: ladder plot along the hole, travelling-cylinder plot, and plan view of all wells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core import minimum_curvature
from mwd_sensors.core.arrays import Array
from mwd_surface.clearance.clearance import Clearance, ClearanceRule
from mwd_surface.clearance.offset_wells import WellClearance
from mwd_surface.plots.drawing import BAD, DOUBTFUL, SERIES, arcs, finish_axes, grid, new_figure
from mwd_surface.uncertainty.position_covariance import UncertainWell, ellipse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 12  # largest number of wells drawn; more would hide each other
_LOWEST, _FAR = -0.5, 10.0  # ends of the axis of the separation factor; where wells overlap, it is negative
_ELLIPSE_SIGMAS = 2.0  # semi-axes of the error ellipses, in sigmas


def ladder(found: Sequence[Clearance]) -> Figure:
    """
    Return a figure of separation factor and distance between centres along the hole; dashed: smallest allowed distance.

    found: clearances, the smallest separation factor first; at most twelve wells are drawn.
    """
    figure = new_figure(9.6, 4.8)
    factor, distance = figure.subplots(1, 2, sharey=True)
    _bands(factor, found[0].rule)
    for k, other in enumerate(found[:_MOST]):
        colour, line = _style(k)
        factor.plot(np.clip(other.factor, _LOWEST, _FAR), other.md, line, color=colour, label=other.name)
        distance.plot(other.distance, other.md, line, color=colour)
        distance.plot(other.allowed, other.md, "--", color=colour, linewidth=0.9)
    factor.set(xlabel=f"separation factor (drawn to {_FAR:g})", ylabel="measured depth, m", xlim=(_LOWEST, _FAR))
    distance.set(xlabel="centre to centre, m; dashed: smallest allowed distance")
    distance.set_xlim(0.0, 1.05 * _near(found))
    factor.invert_yaxis()
    for ax in (factor, distance):
        finish_axes(ax)
    factor.legend(fontsize=8, frameon=False, loc="lower right")
    return figure


def travelling_cylinder(found: Sequence[Clearance]) -> Figure:
    """
    Return a figure of the other wells around the hole: direction from north (toolface + azimuth), and distance.

    Every well is shown where its separation factor is smallest. Numbers along the lines are measured depths of the
    drilled well.
    """
    figure = new_figure(6.4, 6.2)
    ax: Any = figure.add_subplot(projection="polar")
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    most = _near(found)
    for k, other in enumerate(found[:_MOST]):
        colour, line = _style(k)
        shown = np.where(other.distance <= most, other.distance, np.nan)
        ax.plot(np.unwrap(other.bearing), shown, line, color=colour, label=other.name, linewidth=1.2)
        for at in _labelled(other, shown, most / 8.0):
            ax.annotate(f"{other.md[at]:.0f}", (other.bearing[at], shown[at]), fontsize=7, color=colour)
        worst = other.least
        if other.distance[worst] <= most:
            level = other.level
            mark = BAD if level == 2 else DOUBTFUL if level == 1 else colour
            ax.plot(other.bearing[worst], other.distance[worst], "o", color=mark, markeredgecolor="k", markersize=7)
    ax.set_rmax(most)
    ax.set_rlabel_position(135.0)
    ax.set_title(
        "angle: toolface to the other well + azimuth of this well; radius: distance of the wells, m", fontsize=9
    )
    ax.set_xlabel("numbers: measured depth of this well, m; dot: smallest separation factor", fontsize=8)
    grid(ax)
    ax.legend(fontsize=8, loc="lower left", bbox_to_anchor=(-0.12, -0.05), frameon=False)
    return figure


def plan_view(near: WellClearance) -> Figure:
    """
    Return a figure of the well and its offset wells from above, zoomed to last survey and least separation factors.

    A dot marks the last survey of the well; the hole ahead of it is dashed. Where the separation factor of an offset
    well is smallest, a line joins both wells, and each well has its error ellipse at 2 sigma.
    """
    figure = new_figure(6.4, 6.2)
    ax: Any = figure.subplots()
    well = near.well
    depths, whole = arcs(well.md, well.inclination, well.azimuth, well.positions)
    name, last = well.name or "well", _at(well, near.surveyed)[0]
    for ahead, line, label in ((False, "-", name), (True, "--", "ahead of the last survey")):
        part = whole[depths >= near.surveyed] if ahead else whole[depths <= near.surveyed]
        if len(part) > 1:
            ax.plot(part[:, 1], part[:, 0], line, color="k", linewidth=1.8, label=label)
    ax.plot(last[1], last[0], "o", color="k", markersize=5, label="last survey")
    close = []
    for k, one in enumerate(near.found[:_MOST]):
        if one.other is None:
            continue
        colour, line = _style(k)
        _, path = arcs(one.other.md, one.other.inclination, one.other.azimuth, one.other.positions)
        ax.plot(path[:, 1], path[:, 0], line, color=colour, linewidth=1.2, label=one.name)
        ends = [_at(of, float(md[one.least])) for of, md in ((well, one.md), (one.other, one.offset_md))]
        ax.plot([ends[0][0][1], ends[1][0][1]], [ends[0][0][0], ends[1][0][0]], "-", color=colour, linewidth=0.7)
        for place, covariance in ends:
            # Change the order of axes from north, east to east, north, as on the map.
            outline = ellipse(covariance[:2, :2][::-1, ::-1], _ELLIPSE_SIGMAS).outline() + place[[1, 0]]
            ax.plot(outline[:, 0], outline[:, 1], color=colour, linewidth=0.7)
            close.append(outline)
    ax.set(xlabel="east, m", ylabel=f"north ({well.north.name.lower()}), m")
    if close:
        points = np.concatenate([*close, whole[-1:, [1, 0]], last[None, [1, 0]]])
        middle, half = 0.5 * (points.min(axis=0) + points.max(axis=0)), 0.7 * float(np.ptp(points, axis=0).max())
        ax.set_xlim(middle[0] - half, middle[0] + half)
        ax.set_ylim(middle[1] - half, middle[1] + half)
    ax.set_aspect("equal", adjustable="box")
    grid(ax)
    ax.legend(fontsize=8, frameon=False, loc="best")
    return figure


def _at(well: UncertainWell, md: float) -> tuple[Array, Array]:
    """Return the position at a depth, m, shape (3,), and the covariance of the station above, m^2, shape (3, 3)."""
    place = minimum_curvature.interpolate(well.md, well.inclination, well.azimuth, well.positions, md)[2]
    station = max(int(np.searchsorted(well.md, md + 1e-6)) - 1, 0)
    return place, well.covariance()[station]


def _style(k: int) -> tuple[str, str]:
    return SERIES[k % len(SERIES)], ("-", "-.", ":")[k // len(SERIES) % 3]


def _bands(ax: Any, rule: ClearanceRule) -> None:
    ax.axvspan(_LOWEST, rule.stop_factor, color=BAD, alpha=0.25, label=f"stop, below {rule.stop_factor:g}")
    if rule.warning_factor > rule.stop_factor:
        words = f"warning, below {rule.warning_factor:g}"
        ax.axvspan(rule.stop_factor, rule.warning_factor, color=DOUBTFUL, alpha=0.35, label=words)


def _labelled(other: Clearance, shown: Array, apart: float) -> list[int]:
    """Return the indices of the points that get a depth label; the points are at least `apart` m from each other."""
    chosen: list[int] = []
    last = np.array([math.inf, math.inf])
    for at in np.flatnonzero(np.isfinite(shown)):
        place = shown[at] * np.array([math.cos(other.bearing[at]), math.sin(other.bearing[at])])
        if not np.linalg.norm(place - last) < apart:
            chosen.append(int(at))
            last = place
    return chosen


def _near(found: Sequence[Clearance]) -> float:
    """Return the largest distance to draw, m: enough to show every well where its separation factor is smallest."""
    least = max(float(c.distance[c.least]) for c in found[:_MOST])
    allowed = max(float(c.allowed[c.least]) for c in found[:_MOST])
    return 10.0 * math.ceil(1.5 * max(allowed, least) / 10.0)
