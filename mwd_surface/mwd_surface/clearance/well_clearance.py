# SPDX-License-Identifier: Apache-2.0
"""Clearance from the well of a survey list to its offset wells: along its path, at the bit, and ahead on the plan."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_surface.clearance.clearance import Clearance, ClearanceLevel, ClearanceRule, check_plausible, nearest_first
from mwd_surface.clearance.offset_wells import OffsetWells, clearances, read_offset_wells
from mwd_surface.list_files.remark import Remark, RemarkKind, distinct
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well_position import continued, uncertain_well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.uncertainty.uncertain_well import UncertainWell


@dataclasses.dataclass(frozen=True)
class WellClearance:
    """
    Clearances of a well to the wells near it.

    Attributes
    ----------
    well : UncertainWell
        Path that was compared, including projection and plan ahead.
    surveyed, bit : float
        Measured depths of the last survey and of the bit, m; below the bit the path is planned.
    found : tuple of Clearance
        Clearances, smallest separation factor first.
    remarks : tuple of Remark
        Parts that were not compared, and all assumptions made for the lists of the well, the plan and the offset wells.
    refused : tuple of str
        Names of the offset wells that could not be compared, so that their separation is unknown.
    """

    well: UncertainWell
    surveyed: float
    bit: float
    found: tuple[Clearance, ...]
    remarks: tuple[Remark, ...]
    rule: ClearanceRule
    refused: tuple[str, ...] = ()

    def ahead(self) -> tuple[Clearance, ...]:
        """Return the clearances below the last survey, smallest separation factor first."""
        parts = (one.between(self.surveyed, float(self.well.md[-1])) for one in self.found)
        return tuple(nearest_first([part for part in parts if part is not None]))

    @property
    def not_compared(self) -> tuple[Remark, ...]:
        """Remarks on wells or parts that were not compared, including wells that could not be used."""
        return tuple(one for one in self.remarks if one.kind == RemarkKind.NOT_COMPARED)

    @property
    def level(self) -> ClearanceLevel:
        """Level of the smallest separation factor below the last survey."""
        ahead = self.ahead()
        return ahead[0].level if ahead else ClearanceLevel.CLEAR


def well_clearance(
    surveys: SurveyList,
    offsets: OffsetWells,
    plan: Plan | None = None,
    bit_depth: float | None = None,
    leg: str | None = None,
    *,
    quoting: bool = True,
) -> WellClearance:
    """
    Return the clearances of the well of a survey list to its offset wells.

    Parameters
    ----------
    plan : Plan, optional
        Plan along which the path is continued below the bit, for `ahead_m` of the file of offset wells.
    bit_depth : float, optional
        Bit depth, m; by default `sensor_to_bit` below the last survey.
    leg : str, optional
        Name of the leg; by default the current leg.
    quoting : bool
        Whether a remark may quote contents of a list that cannot be read; the node passes False, because anyone can
        read the page without a login.

    Raises
    ------
    ValueError
        There is no such leg, the path is implausible (`check_plausible`), or the well's position has no covariance.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    path = surveys.definitive(leg)
    surveyed = float(path.md[-1])
    if bit_depth is None and surveys.well.sensor_offset > 0.0 and path.kind[-1] == "survey":
        bit_depth = surveyed + surveys.well.sensor_offset
    path = surveys.definitive(leg, bit_depth)
    bit = float(path.md[-1])
    path = continued(path, plan, offsets.ahead_m)
    try:
        well = uncertain_well(surveys, path, 0.5 * offsets.hole_diameter_m)
        well = dataclasses.replace(well, surveyed=surveyed)
        check_plausible(well, offsets.rule)
        found, remarks = clearances(well, offsets, quoting)
    except ValueError as error:
        raise ValueError(f"no clearance: {error}") from error
    own = (*path.assumptions, *surveys.remarks, *(() if plan is None else plan.remarks))
    missing = dict.fromkeys(part for one in found for part in one.not_compared if not part.shared)
    compared = {one.name for one in found}
    refused = tuple(one.name for one in offsets.wells if one.name not in compared)
    remarks = distinct((*own, *remarks, *(part.remark() for part in missing)))
    return WellClearance(well, surveyed, bit, tuple(found), remarks, offsets.rule, refused)


def offset_wells_of(surveys: SurveyList) -> OffsetWells | None:
    """
    Return the offset wells from the file that the well of a survey list names; None if no file is named.

    Raises
    ------
    OffsetWellError
        The file of the offset wells cannot be used.
    """
    name = surveys.well.offset_wells
    return read_offset_wells(Path(name).expanduser()) if name else None


def planned_rows(clearance: WellClearance) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the indices of the path points from the last survey down: the survey, the bit, and planned points."""
    return np.flatnonzero(clearance.well.md >= clearance.surveyed - 1e-6)
