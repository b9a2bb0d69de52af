# SPDX-License-Identifier: Apache-2.0
"""Offset wells in the report: clearance by the separation rule, its plots, and the position uncertainty ahead."""

from __future__ import annotations

import math

import numpy as np

from mwd_surface.clearance.clearance import Clearance, ClearanceLevel
from mwd_surface.clearance.offset_wells import WellClearance, offset_wells_of, planned_rows, well_clearance
from mwd_surface.exports.report_section import DOUBTFUL, GOOD, REJECT, Drawing, Section, Sheet, sheet_of
from mwd_surface.list_files.remark import sentences
from mwd_surface.plots.clearance_plots import ladder, plan_view, travelling_cylinder
from mwd_surface.signals.cells import fixed, typed
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.plan import Plan
from mwd_surface.uncertainty.error_terms import CovarianceUnavailableError
from mwd_surface.uncertainty.position_covariance import ellipse

_TINTS = {ClearanceLevel.CLEAR: GOOD, ClearanceLevel.WARNING: DOUBTFUL, ClearanceLevel.STOP: REJECT}
_COLUMNS = (
    *(("Offset well", ""), ("Part", ""), ("MD", "m"), ("its MD", "m"), ("Distance", "m"), ("Allowed", "m")),
    *(("Factor", ""), ("Toolface", "deg"), ("Level", "")),
)
_AHEAD = (
    *(("MD", "m"), ("TVD", "m"), ("N/S", "m"), ("E/W", "m"), ("1σ N", "m"), ("1σ E", "m"), ("1σ V", "m")),
    *(("Ellipse 2σ", "m"), ("by", "m"), ("axis", "deg"), ("", "")),
)
# Approximate largest number of printed stations ahead of the last survey; the last station is always printed
_MOST = 40


def clearance_sections(
    surveys: SurveyList, plan: Plan | None, bit_depth: float | None = None, leg: str | None = None
) -> tuple[tuple[Section, ...], tuple[str, ...]]:
    """
    Return the section about offset wells, and sentences about comparisons that were not possible.

    Both are empty if the well has no offset wells or no surveys. If no clearance can be computed, there is no section,
    and the sentence is the reason. Arguments as for `well_clearance`.
    """
    try:
        offsets = offset_wells_of(surveys)
        if offsets is None or not surveys.records:
            return (), ()
        near = well_clearance(surveys, offsets, plan, bit_depth, leg)
    except (CovarianceUnavailableError, ValueError) as error:
        return (), (str(error),)
    return (clearance_section(near),), sentences(near.remarks)


def clearance_section(near: WellClearance) -> Section:
    """Return the section: for each offset well, one line for the whole path and one for the part below the surveys."""
    rule = near.rule
    rule_words = (
        f"Separation rule of the ISCWSA (SPE 187073): k = {rule.k:g}, surface margin {rule.surface_margin_m:g} m, "
        f"projection {rule.projection_sigma_m:g} m at 1 sigma. Below a factor of {rule.stop_factor:g} drilling stops, "
        f"below {rule.warning_factor:g} a warning is raised. Part ahead: from the last survey at "
        f"{near.surveyed:.1f} m to {float(near.well.md[-1]):.1f} m, the bit at {near.bit:.1f} m."
    )
    ahead = {one.name: one for one in near.ahead()}
    rows, levels = [], []
    for one in near.found:
        for part, words in ((one, "whole"), (ahead.get(one.name), "ahead")):
            if part is not None:
                rows.append(_row(part, words))
                levels.append(part.level)
    tints = {(k, len(_COLUMNS) - 1): _TINTS[level] for k, level in enumerate(levels)}
    sheet = sheet_of(
        "Clearance to offset wells",
        _COLUMNS,
        rows,
        tints=tints,
        legend="At the point of the smallest separation factor. Allowed: distance at factor 1. Toolface: direction to "
        "the offset well from the high side.",
    )
    drawings = (
        Drawing("Separation factor and distance along the hole", lambda: ladder(near.found), wide=True),
        Drawing("Travelling cylinder: toolface + azimuth", lambda: travelling_cylinder(near.found)),
        Drawing(
            "Plan view with offset wells; ellipses at 2 sigma, at the points nearest by the rule",
            lambda: plan_view(near),
        ),
    )
    sheets = (sheet, ahead_sheet(near))
    return Section(
        "Offset wells", (rule_words, *sentences(near.remarks)), sheets, drawings if near.found else (), page=True
    )


def ahead_sheet(near: WellClearance) -> Sheet:
    """Return the table of position uncertainty from the last survey down: at the bit and along the plan."""
    well, covariance = near.well, near.well.covariance()
    stations = planned_rows(near)
    chosen = np.unique(np.append(stations[:: max(1, math.ceil(stations.size / _MOST))], stations[-1]))
    rows = []
    for k in chosen:
        flat = ellipse(covariance[k, :2, :2])
        sigmas = np.sqrt(np.maximum(np.diagonal(covariance[k]), 0.0))
        kind = "surveyed" if well.md[k] <= near.surveyed else "bit" if well.md[k] <= near.bit else "ahead"
        n, e, down = well.positions[k]
        metres = (well.md[k], down, n, e, *sigmas, flat.major, flat.minor)
        rows.append((*(fixed(float(v), 2) for v in metres), fixed(math.degrees(flat.angle), 0), kind))
    legend = (
        "The bit and the plan ahead count as stations of the present tool. Ellipse: horizontal semi-axes at 2 sigma, "
        "and the direction of the larger one from north."
    )
    return sheet_of("Position ahead of the last survey", _AHEAD, rows, legend=legend)


def _row(one: Clearance, part: str) -> tuple[str, ...]:
    k = one.least
    return (
        typed(one.name),
        part,
        fixed(float(one.md[k]), 1),
        fixed(float(one.offset_md[k]), 1),
        fixed(float(one.distance[k]), 2),
        fixed(float(one.allowed[k]), 2),
        fixed(float(one.factor[k]), 2),
        fixed(math.degrees(one.toolface[k]), 0, 360.0),
        one.level.name.lower(),
    )
