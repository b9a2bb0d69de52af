# SPDX-License-Identifier: Apache-2.0
"""The figures of a survey report: plan view, vertical section and quality control."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.plots.drawing import BAD, BLUE, GOOD, NEUTRAL, SKY, arcs, grid, new_figure
from mwd_surface.surveys.station_quality import totals
from mwd_surface.trajectory.plan import interpolated
from mwd_surface.trajectory.well_path import ASSUMED
from mwd_surface.uncertainty.position_covariance import ellipse, in_section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of Okabe and Ito's palette, which colour-blind readers can distinguish; the marks also differ.
_SURVEY, _PLAN, _ELLIPSE, _LIMIT = BLUE, GOOD, NEUTRAL, SKY
ELLIPSE_SIGMAS = 2.0  # semi-axes of the error ellipses, in sigmas
# Gravity, field and dip: axis label and factor from SI.
_QUALITY = (("ΔG, mg", 1e3 / STANDARD_GRAVITY), ("ΔB, nT", 1e9), ("Δdip, deg", 180.0 / math.pi))


def plan_view(table: SurveyTable) -> Figure:
    """Return the figure of the path in plan view, with error ellipses of some stations and the planned path."""
    figure = new_figure(6.2, 5.6)
    ax = figure.subplots()
    if table.plan is not None:
        line = interpolated(table.plan, 10.0).positions
        ax.plot(line[:, 1], line[:, 0], "--", color=_PLAN, label="plan")
    _path_line(ax, table, lambda p: (p[:, 1], p[:, 0]))
    if table.covariance is not None:
        for label, k in _some(table):
            # Change the order of axes from north, east to east, north, as on the map.
            cov = table.covariance[k][:2, :2][::-1, ::-1]
            _outline(ax, ellipse(cov, ELLIPSE_SIGMAS).outline() + table.path.positions[k, [1, 0]], label)
    ax.plot(0.0, 0.0, "k^", label="wellhead")
    ax.set(xlabel="east, m", ylabel="north, m")
    ax.set_aspect("equal", adjustable="datalim")
    _finish(ax)
    return figure


def section_view(table: SurveyTable) -> Figure:
    """
    Return the figure of the path in the plane of the vertical section.

    The figure also shows the error ellipses of some stations and the planned path.
    """
    figure = new_figure(6.2, 5.6)
    ax = figure.subplots()
    azimuth = table.path.section_azimuth
    along = np.array([math.cos(azimuth), math.sin(azimuth)])
    if table.plan is not None:
        line = interpolated(table.plan, 10.0).positions
        ax.plot(line[:, :2] @ along, line[:, 2], "--", color=_PLAN, label="plan")
    _path_line(ax, table, lambda p: (p[:, :2] @ along, p[:, 2]))
    if table.covariance is not None:
        for label, k in _some(table):
            place = np.array([table.path.vertical_section[k], table.path.positions[k, 2]])
            _outline(ax, ellipse(in_section(table.covariance[k], azimuth), ELLIPSE_SIGMAS).outline() + place, label)
    ax.invert_yaxis()
    ax.set(xlabel="vertical section, m", ylabel="vertical depth, m")
    _finish(ax)
    return figure


def quality_view(table: SurveyTable) -> Figure:
    """Return the figure of the deviations of gravity, field and dip over depth, with the limits as a band."""
    figure = new_figure(9.6, 4.4)
    axes = figure.subplots(1, 3, sharey=True)
    deep = (r for r in table.surveys.records if math.isfinite(r.measured_depth))
    records = sorted(deep, key=lambda r: r.measured_depth)
    found = [(r, totals(r.survey)) for r in records]
    for k, (ax, (label, factor)) in enumerate(zip(axes, _QUALITY, strict=True)):
        known = [(r, t[k]) for r, t in found if t[k].deviation is not None]
        if known:
            depth = [r.measured_depth for r, _ in known]
            limit = np.array([t.limit for _, t in known]) * factor
            band = {"color": _LIMIT, "alpha": 0.25, "linewidth": 0.8, "label": "within the limit"}
            # Draw the limits of a single survey as a band over 30 m of depth.
            ends = ([depth[0] - 15.0], [depth[0] + 15.0]) if len(depth) == 1 else ([], [])
            ax.fill_betweenx([*ends[0], *depth, *ends[1]], -_padded(limit, ends), _padded(limit, ends), **band)
        for used, mark, colour, name in ((True, "o", _SURVEY, "used"), (False, "x", BAD, "not used")):
            points = [((t.deviation or 0.0) * factor, r.measured_depth) for r, t in known if r.in_use is used]
            if points:
                ax.plot(*zip(*points, strict=True), mark, color=colour, markersize=4.5, label=name)
        ax.axvline(0.0, color="k", linewidth=0.8)
        ax.set_xlabel(label)
        grid(ax)
    axes[0].set_ylabel("measured depth, m")
    axes[0].invert_yaxis()
    named = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if named:
        figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=len(named), fontsize="small")
    return figure


def _padded(limit: Any, ends: tuple[list[float], list[float]]) -> Any:
    """Return the limits, with the first and the last one repeated for each depth in `ends`."""
    return np.concatenate([limit[:1] if ends[0] else [], limit, limit[-1:] if ends[1] else []])


def _path_line(ax: Any, table: SurveyTable, axes: Any) -> None:
    path = table.path
    projected = path.kind[-1] == "projected"
    last = len(path.kind) - projected
    assumed = path.kind[0] == ASSUMED
    # Between stations the path is drawn as an arc.
    md, whole = arcs(path.md, path.inclination, path.azimuth, path.positions)
    measured = (md >= path.md[1]) if assumed else np.full(md.size, True)
    ax.plot(*axes(whole[measured]), color=_SURVEY, linewidth=1.2)
    if assumed:
        # Draw the assumed hole down to the first survey, so that the line has no gap.
        ax.plot(*axes(whole[md <= path.md[1]]), ":", color=BAD, linewidth=1.4, label="hole assumed, not surveyed")
    words = "survey, place assumed" if path.assumed else "survey"
    ax.plot(*axes(path.positions[int(assumed) : last]), "o", color=_SURVEY, markersize=3.5, label=words)
    if projected:
        ax.plot(*axes(path.positions[-1:]), "D", color=BAD, markersize=5, label="bit (projected)")


def _some(table: SurveyTable) -> list[tuple[str, int]]:
    """Return (legend label, station index) of the ellipses to draw: at most 12, the last station among them."""
    good = [k for k in table.rows if table.covariance is not None and np.all(np.isfinite(table.covariance[k]))]
    step = max(1, math.ceil(len(good) / 12))
    return [(f"ellipse, {ELLIPSE_SIGMAS:g} sigma" if not j else "", k) for j, k in enumerate(good[::-1][::step])]


def _outline(ax: Any, points: Any, label: str) -> None:
    ax.plot(points[:, 0], points[:, 1], color=_ELLIPSE, linewidth=0.7, label=label)


def _finish(ax: Any) -> None:
    grid(ax)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize="small")
