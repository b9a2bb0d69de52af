# SPDX-License-Identifier: Apache-2.0
"""Sections of the report of a final list: changes from the first list, overlapping sources, and the inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mwd_sensors.core.angle_convention import AngleConvention
from mwd_sensors.core.arrays import Array
from mwd_surface.exports.report_section import Drawing, Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.plots.path_plots import end_ellipses, figure_of
from mwd_surface.signals.cells import fixed, typed
from mwd_surface.surveys.final_list import FinalList, Overlap
from mwd_surface.trajectory.list_comparison import PathDifference, covariance_between

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CHANGES = (
    *(("MD", "m"), ("Inc first", "deg"), ("Inc final", "deg"), ("Azi first", "deg"), ("Azi final", "deg")),
    *(("Azi change", "deg"), ("North", "m"), ("East", "m"), ("Down", "m"), ("Distance", "m")),
)
_OVERLAPS = (
    *(("From", "m"), ("To", "m"), ("Used", ""), ("Left out", ""), ("1σ used", "m"), ("1σ left out", "m")),
    ("Differ by more than their errors", ""),
)
_DEG = 180.0 / math.pi


def final_sections(
    final: FinalList,
    changes: PathDifference,
    tables: tuple[SurveyTable, SurveyTable],
    inputs: Sequence[tuple[str, str]],
) -> tuple[Section, ...]:
    """
    Return two sections of a final list: its sources, and its differences from the list as first decided.

    changes: final path minus the path as first decided. tables: tables of the first and of the final list. inputs: name
    and SHA-256 of each input file.
    """
    angles = tables[1].surveys.well.angles
    rows = [
        tuple(
            fixed(float(value), 2, wrap)
            for value, wrap in (
                (changes.md[k], 0.0),
                *((angles.shown(float(changes.inclination[k, one])) * _DEG, 0.0) for one in (1, 0)),
                *((changes.azimuth[k, one] * _DEG, 360.0) for one in (1, 0)),
                (changes.turn[k, 1] * _DEG, 0.0),
                *((axis, 0.0) for axis in changes.position[k]),
                (changes.distance[k], 0.0),
            )
        )
        for k in range(changes.md.size)
    ]
    names = ("final list", "first list")

    def along() -> Figure:
        return figure_of(changes, *names)

    last = float(changes.md[-1])
    ends = [(table.path.at(last)[2], _horizontal(table, last)) for table in tables]
    has_ellipses = any(covariance is not None for _, covariance in ends)

    def at_the_end() -> Figure:
        return end_ellipses(ends, ("as first decided", "final"))

    differences = Section(
        "Final list against the list as first decided",
        sheets=(sheet_of("Changes by station", _titled(angles), rows),),
        drawings=(
            Drawing("Differences along the hole", along),
            Drawing(
                "Plan view at the last station of the final list, ellipses at 2 sigma"
                if has_ellipses
                else "Plan view at the last station of the final list, without position uncertainty",
                at_the_end,
            ),
        ),
    )
    sources = [sheet_of("Input files", (("File", ""), ("SHA-256", "")), [(typed(name), sha) for name, sha in inputs])]
    if final.overlaps:
        sources.insert(
            0, sheet_of("Intervals that two sources cover", _OVERLAPS, [_overlap(one) for one in final.overlaps])
        )
    return Section("Sources of the final list", final.remarks, tuple(sources)), differences


def _titled(angles: AngleConvention) -> list[tuple[str, str]]:
    """Return titles and units of the changes, with the vertical angle of the well's convention."""
    first = {"Inc first": f"{angles.heading}, first", "Inc final": f"{angles.heading}, final"} if angles.points else {}
    return [(first.get(title, title), unit) for title, unit in _CHANGES]


def _overlap(one: Overlap) -> tuple[str, ...]:
    metres = (fixed(one.from_m, 2), fixed(one.to_m, 2))
    sigmas = (fixed(one.sigma_used, 2), fixed(one.sigma_left_out, 2))
    apart = "nowhere" if not one.apart else f"at {', '.join(fixed(md, 1) for md in one.apart[:6])} m"
    return *metres, typed(one.used), typed(one.left_out), *sigmas, apart


def _horizontal(table: SurveyTable, measured_depth: float) -> Array | None:
    """Return the horizontal covariance of a path at a depth, m, shape (2, 2), m^2; None if it is unknown."""
    if table.covariance is None:
        return None
    found = covariance_between(table.path.md, table.covariance, np.array([measured_depth]))[0, :2, :2]
    return np.asarray(found) if np.all(np.isfinite(found)) else None
