# SPDX-License-Identifier: Apache-2.0
"""Panels of the surveys of a bag: inclination, azimuth and residuals with their sigmas."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from mwd_estimation.survey.survey import Survey
from mwd_surface.plots.drawing import BAD, DEGREES, DOUBTFUL, GOOD, TRUTH_COLOUR, drawer, finish_axes, time_unit
from mwd_surface.plots.plot_data import PlotData
from mwd_surface.plots.traces import NORTHS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VERDICTS = (("o", GOOD, "accepted"), ("^", DOUBTFUL, "doubtful"), ("x", BAD, "rejected"))


def survey_drawers(data: PlotData) -> list[Callable[[Axes], None]]:
    """Return the functions that draw the panels of the surveys; the panels are placed side by side."""
    surveys = [survey for survey, _ in data.surveys]
    norths = {NORTHS.get(s.north, "unnamed") for s in surveys if s.has_azimuth}
    north = " and ".join(sorted(norths)) or "unnamed"
    return [
        drawer(_draw_survey, data, "inclination, deg", lambda s: (s.inclination * DEGREES, _sigma(s, 0)), True),
        drawer(_draw_survey, data, f"azimuth from {north} north, deg", _azimuth, False),
        drawer(_draw_survey, data, "field less reference, nT", _field_residual, False),
        drawer(_draw_survey, data, "dip less reference, deg", _dip_residual, False),
    ]


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


def _sigma(survey: Survey, k: int) -> float:
    return math.sqrt(survey.covariance[4 * k]) * DEGREES


def _azimuth(survey: Survey) -> tuple[float, float]:
    return survey.azimuth * DEGREES, _sigma(survey, 1)


def _field_residual(survey: Survey) -> tuple[float, float]:
    return (survey.b_total - survey.b_reference) * 1e9, 0.0


def _dip_residual(survey: Survey) -> tuple[float, float]:
    return (survey.dip - survey.dip_reference) * DEGREES, 0.0
