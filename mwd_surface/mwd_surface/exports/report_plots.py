"""The figures of a survey report: plan view, vertical section and quality control, as SVG or PNG."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.surveys.plan import interpolated
from mwd_surface.surveys.position_covariance import ellipse, in_section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's palette: distinguishable for colour-blind readers; the marks differ too.
_SURVEY, _PLAN, _BAD, _ELLIPSE = "#0072B2", "#009E73", "#D55E00", "#999999"
_SIGMAS = 2.0
_DEG = 180.0 / math.pi


def figures(table: SurveyTable) -> dict[str, Figure]:
    """Caption -> figure, in the order they are printed."""
    north = table.surveys.well.north_reference
    got = {
        f"Plan view, {north} north; ellipses {_SIGMAS:g} sigma": _plan_view(table),
        f"Vertical section along {math.degrees(table.path.section_azimuth):.1f} deg": _section(table),
    }
    if table.surveys.records:
        got["Deviation of gravity, field and dip from their references"] = _quality(table)
    return got


def svg(figure: Figure) -> str:
    """The figure as an SVG element without XML head; the same figure gives the same text."""
    import matplotlib as mpl

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "mwd", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def png(figure: Figure, dots_per_inch: int = 160) -> bytes:
    """The figure as PNG bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return out.getvalue()


def _new(width: float, height: float) -> tuple[Figure, Any]:
    # Not pyplot: figures of a server must not pile up in a global list.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _plan_view(table: SurveyTable) -> Figure:
    figure, ax = _new(6.2, 5.6)
    if table.plan is not None:
        line = interpolated(table.plan, 10.0).positions
        ax.plot(line[:, 1], line[:, 0], "--", color=_PLAN, label="plan")
    _path_line(ax, table, lambda p: (p[:, 1], p[:, 0]))
    if table.covariance is not None:
        for k in _some(table):
            # North, east -> east, north as the axes of the map.
            cov = table.covariance[k][:2, :2][::-1, ::-1]
            _outline(ax, ellipse(cov, _SIGMAS).outline() + table.path.positions[k, [1, 0]])
    ax.plot(0.0, 0.0, "k^", label="wellhead")
    ax.set(xlabel="east, m", ylabel="north, m")
    ax.set_aspect("equal", adjustable="datalim")
    _finish(ax)
    return figure


def _section(table: SurveyTable) -> Figure:
    figure, ax = _new(6.2, 5.6)
    azimuth = table.path.section_azimuth
    along = np.array([math.cos(azimuth), math.sin(azimuth)])
    if table.plan is not None:
        line = interpolated(table.plan, 10.0).positions
        ax.plot(line[:, :2] @ along, line[:, 2], "--", color=_PLAN, label="plan")
    _path_line(ax, table, lambda p: (p[:, :2] @ along, p[:, 2]))
    if table.covariance is not None:
        for k in _some(table):
            place = np.array([table.path.vertical_section[k], table.path.positions[k, 2]])
            _outline(ax, ellipse(in_section(table.covariance[k], azimuth), _SIGMAS).outline() + place)
    ax.invert_yaxis()
    ax.set(xlabel="vertical section, m", ylabel="vertical depth, m")
    _finish(ax)
    return figure


def _quality(table: SurveyTable) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.6), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    records = [r for r in table.surveys.records if r.measured_depth >= 0.0]
    for ax, label, values in zip(
        axes,
        ("ΔG, mg", "ΔB, nT", "Δdip, deg"),
        (
            [
                (r, (r.survey.g_total - r.survey.g_reference) / (1e-3 * STANDARD_GRAVITY))
                for r in records
                if r.survey.g_reference > 0.0
            ],
            [(r, (r.survey.b_total - r.survey.b_reference) * 1e9) for r in records if _has_field(r.survey)],
            [(r, (r.survey.dip - r.survey.dip_reference) * _DEG) for r in records if _has_field(r.survey)],
        ),
        strict=True,
    ):
        for used, mark, colour, name in ((True, "o", _SURVEY, "used"), (False, "x", _BAD, "not used")):
            points = [(v, r.measured_depth) for r, v in values if r.in_use is used]
            if points:
                ax.plot(*zip(*points, strict=True), mark, color=colour, label=name)
        ax.axvline(0.0, color="k", linewidth=0.8)
        ax.set_xlabel(label)
        _finish(ax)
    axes[0].set_ylabel("measured depth, m")
    axes[0].invert_yaxis()
    return figure


def _has_field(survey: Any) -> bool:
    return bool(survey.has_reference and survey.b_total >= 0.0)


def _path_line(ax: Any, table: SurveyTable, axes: Any) -> None:
    projected = table.path.kind[-1] == "projected"
    last = len(table.path.kind) - projected
    # Between stations the path is an arc; drawn as one.
    whole = _dense(table)
    ax.plot(*axes(whole), color=_SURVEY, linewidth=1.2)
    ax.plot(*axes(table.path.positions[:last]), "o", color=_SURVEY, markersize=3.5, label="survey")
    if projected:
        ax.plot(*axes(table.path.positions[-1:]), "D", color=_BAD, markersize=5, label="bit (projected)")


def _dense(table: SurveyTable) -> np.ndarray[Any, np.dtype[np.float64]]:
    from mwd_sensors.core import minimum_curvature as mc

    path = table.path
    if path.md.size < 2:
        return path.positions
    md = np.unique(np.concatenate([path.md, np.linspace(path.md[0], path.md[-1], 400)]))
    return mc.interpolate(path.md, path.inclination, path.azimuth, path.positions, md)[2]


def _some(table: SurveyTable) -> list[int]:
    """At most a dozen stations, the last measured one among them: more ellipses hide the path."""
    good = [k for k in table.rows if table.covariance is not None and np.all(np.isfinite(table.covariance[k]))]
    step = max(1, math.ceil(len(good) / 12))
    return good[::-1][::step]


def _outline(ax: Any, points: Any) -> None:
    ax.plot(points[:, 0], points[:, 1], color=_ELLIPSE, linewidth=0.7)


def _finish(ax: Any) -> None:
    ax.grid(visible=True, linewidth=0.4, color="#cccccc")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize="small")
