# SPDX-License-Identifier: Apache-2.0
"""Clearance of the well of a survey list: along its path, at the bit and ahead along the plan."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_surface.clearance.clearance import Clearance, ClearanceRule, Level, check_plausible, nearest_first
from mwd_surface.clearance.offset_wells import OffsetWells, clearances, read_offset_wells
from mwd_surface.list_files.remark import Remark, RemarkKind, distinct
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well_position import continued, uncertain_well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.uncertainty.uncertain_well import UncertainWell


@dataclasses.dataclass(frozen=True)
class WellClearance:
    """
    Wells near a well, with their clearances.

    Attributes
    ----------
    well : UncertainWell
        The path that was compared, with its projection and what lies ahead.
    surveyed, bit : float
        Measured depths of the last survey and of the bit, m; beyond the bit the path is planned.
    found : tuple of Clearance
        The nearest by the rule first.
    remarks : tuple of Remark
        What was not compared, and every assumption behind the lists of the well, the plan and the offset wells.
    rule : ClearanceRule
    refused : tuple of str
        Offset wells of the file that could not be compared: nothing is known of their separation.
    """

    well: UncertainWell
    surveyed: float
    bit: float
    found: tuple[Clearance, ...]
    remarks: tuple[Remark, ...]
    rule: ClearanceRule
    refused: tuple[str, ...] = ()

    def ahead(self) -> tuple[Clearance, ...]:
        """Return the clearances from the last survey on, the nearest by the rule first."""
        parts = (one.between(self.surveyed, float(self.well.md[-1])) for one in self.found)
        return tuple(nearest_first([part for part in parts if part is not None]))

    @property
    def not_compared(self) -> tuple[Remark, ...]:
        """The remarks that leave a well or a part of one uncompared; those of a refused well are among them."""
        return tuple(one for one in self.remarks if one.kind == RemarkKind.NOT_COMPARED)

    @property
    def level(self) -> Level:
        """Level from the last survey on."""
        ahead = self.ahead()
        return ahead[0].level if ahead else Level.CLEAR


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
    Compare the well of a list with its offset wells.

    Parameters
    ----------
    surveys : SurveyList
    offsets : OffsetWells
    plan : Plan, optional
        The path is continued along it, as far as the offset wells' file says.
    bit_depth : float, optional
        m; left out, `sensor_to_bit` below the last survey.
    leg : str, optional
        Other than the current one.
    quoting : bool
        Whether a remark may quote a list that cannot be read; the page needs no login, so the node says no.

    Raises
    ------
    ValueError
        No such leg, an implausible path (`check_plausible`), or the position of the well has no covariance.
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
    records = [surveys.find(number) if number else None for number in path.sequence]
    try:
        well = uncertain_well(surveys, path, records, 0.5 * offsets.hole_diameter_m)
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
    Return the offset wells that the well of a list names; None where it names none.

    Raises
    ------
    OffsetWellError
        Their file cannot be used.
    """
    name = surveys.well.offset_wells
    return read_offset_wells(Path(name).expanduser()) if name else None


def planned_rows(clearance: WellClearance) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the stations of the path from the last survey on: itself, the bit, and what is planned."""
    return np.flatnonzero(clearance.well.md >= clearance.surveyed - 1e-6)
