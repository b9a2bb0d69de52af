# SPDX-License-Identifier: Apache-2.0
"""
Clearance from the well of a survey list to the offset wells near it: along its path, at the bit, and ahead on the plan.

A YAML file names the lists of the offset wells, their wellheads, hole sizes and error models.

Any list or plan that the importer can read may be used. Positions are relative to the wellhead of the well being
drilled; azimuths from another north are converted to the north of that well.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.frames import wrap_tau
from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.settings import setting
from mwd_surface.clearance.clearance import (
    Clearance,
    ClearanceLevel,
    ClearanceRule,
    check_plausible,
    clearance,
    nearest_first,
)
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_settings import OFFSET_WELL, ListSettings, asked
from mwd_surface.list_files.map_coordinates import wellhead_of
from mwd_surface.list_files.remark import Remark, RemarkKind, distinct
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well_position import continued, uncertain_well
from mwd_surface.trajectory.plan import Plan, interpolated, read_plan
from mwd_surface.uncertainty.error_terms import ErrorReference
from mwd_surface.uncertainty.position_covariance import UncertainWell
from mwd_surface.uncertainty.programme import ProgrammeStations, SurveyProgramme, read_programme

# Usual distance between surveys, m; and distance between surveys, m, above which the hole between them is hardly known.
_SPACING = 30.0
_WIDE = 150.0
# Largest plausible distance between two wellheads, m; at a larger distance one of the positions is wrong.
_FAR = 20_000.0
# Largest distance between two stated positions of one wellhead, m; at a larger distance they contradict each other.
_ASTRAY = 5.0


class OffsetWellError(ValueError):
    """Raised for an offset well that cannot be used; the message names the well and the reason."""


@dataclasses.dataclass(frozen=True)
class OffsetWell(ListSettings):
    """One offset well, with the settings for reading its list."""

    name: str  #: name for display
    file: str  #: path of its list or plan, relative to the file that names the offset wells
    north_m: float | None = setting(
        None,
        "Distance of the offset well's wellhead north of the wellhead of this well. If left out, it follows from "
        "the map coordinates of both lists; without map coordinates it is 0.",
    )
    east_m: float | None = setting(
        None,
        "Distance of the offset well's wellhead east of the wellhead of this well. If left out, it follows as for "
        "north_m.",
    )
    tvd_m: float = setting(
        0.0,
        "Height of the depth datum of this well above the depth datum of the offset well. This height is added to the "
        "vertical depths "
        "of the offset well.",
    )
    hole_diameter_m: float = setting(
        0.31,
        "Diameter of the hole of the offset well, or of its casing if it is cased. Raising it lowers the "
        "separation factor.",
        low=0.0,
        high=5.0,
    )
    code: str = setting(
        "MWD+SRGM", "Tool code of the surveys of the whole offset well, which gives the uncertainty of its position."
    )
    programme: str = setting("", "File of the survey programme of the offset well. If given, it replaces code.")
    wellhead_sigma_m: float = setting(
        0.0,
        "1 sigma of the position of the offset wellhead relative to this one, in north and in east. Raising it "
        "lowers the separation factor.",
        low=0.0,
    )
    planned: bool = setting(
        False,
        "True if the file is a plan that has not been drilled. Its uncertainty is then computed for surveys every 30 "
        "m, "
        "instead of surveys at the stations of the file.",
    )
    shared_to_m: float | None = setting(
        None,
        "Measured depth down to which both wells are the same hole, for a sidetrack. Above this depth the wells are "
        "not "
        "compared.",
        low=0.0,
    )


@dataclasses.dataclass(frozen=True)
class OffsetWells:
    """Content of the file of offset wells: all offset wells of a well, and the separation rule."""

    wells: tuple[OffsetWell, ...]
    rule: ClearanceRule = setting(ClearanceRule, "The separation rule and its levels.")
    hole_diameter_m: float = setting(
        0.31, "Diameter of the hole that is being drilled. Raising it lowers the separation factor.", low=0.0, high=5.0
    )
    ahead_m: float = setting(
        300.0,
        "Length of the plan ahead of the bit that is compared with the offset wells. Raising it warns earlier and "
        "takes more computing time.",
        low=0.0,
        high=20000.0,
    )
    #: `name`, `folder`: name and folder of the file
    name: str = ""
    folder: str = ""


def read_offset_wells(path: Path) -> OffsetWells:
    """
    Return the content of the file that names the offset wells.

    Raises
    ------
    OffsetWellError
        The file cannot be read, is not a YAML table with `wells`, or has unknown keys or two wells of the same name.
    """
    try:
        table = read_yaml(path)
    except OSError as error:
        raise OffsetWellError(f"{path}: {error.strerror}") from error
    except settings.SettingsError as error:
        raise OffsetWellError(str(error)) from error
    if not isinstance(table, dict) or not table.get("wells"):
        raise OffsetWellError(f"{path.name}: expected a table with wells, each with name and file")
    try:
        offsets = settings.from_mapping(OffsetWells, {**table, "name": path.name, "folder": str(path.parent)})
    except ValueError as error:
        raise OffsetWellError(f"{path.name}: {error}") from error
    names = [well.name for well in offsets.wells]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise OffsetWellError(f"{path.name}: two wells are named {twice[0]}")
    return offsets


def offset_well(
    offset: OffsetWell,
    folder: Path,
    north: North,
    reference: ErrorReference,
    wellhead: tuple[float, float] | None = None,
) -> UncertainWell:
    """
    Return an offset well in the axes of the well being drilled, with the remarks about its list.

    folder: folder of the file that names the offset wells.
    north: north of the axes.
    reference: local field of the well being drilled.
    wellhead: northing and easting of the well being drilled, m, if its list has them.

    Raises
    ------
    OffsetWellError
        The list or the programme of the offset well cannot be used, or the position of its wellhead is too far away or
        contradicts the map coordinates.
    """
    try:
        plan = read_plan(folder / Path(offset.file).expanduser(), given=offset.given())
        remarks = _remarks(offset, plan)
        plan = interpolated(plan, _SPACING) if offset.planned else plan
        programme = (
            read_programme(folder / Path(offset.programme).expanduser())
            if offset.programme
            else SurveyProgramme.of_code(offset.code)
        )
        errors = programme.errors(ProgrammeStations.plain(plan.md))
    except ListFileError as error:
        raise OffsetWellError(f"offset well {offset.name}: {asked(error, OFFSET_WELL)}") from error
    except ValueError as error:
        raise OffsetWellError(f"offset well {offset.name}: {error}") from error
    to_true = {"true": 0.0, "magnetic": reference.declination, "grid": reference.convergence}
    own = plan.north or north.name.lower()
    if not plan.north:
        text = f"offset well {offset.name}: its list does not name the north of its azimuths: {own} is assumed"
        remarks = (*remarks, Remark(RemarkKind.NORTH_ASSUMED, text))
    turn = to_true[own] - to_true[north.name.lower()]
    azimuth = wrap_tau(plan.azimuth + turn)
    place, said = _wellhead(offset, plan, wellhead, north, reference)
    remarks = (*remarks, *said)
    start = _turned(plan.positions[0], turn) + np.array([*place, offset.tvd_m])
    tie_on = np.zeros((3, 3)) if errors.tie_on is None else errors.tie_on
    head = np.diag([offset.wellhead_sigma_m**2, offset.wellhead_sigma_m**2, 0.0])
    return UncertainWell(
        offset.name,
        plan.md,
        plan.inclination,
        azimuth,
        mc.path(plan.md, plan.inclination, azimuth, start),
        north,
        dataclasses.replace(errors, tie_on=tie_on + head),
        reference,
        0.5 * offset.hole_diameter_m,
        remarks=remarks,
    )


def clearances(
    well: UncertainWell, offsets: OffsetWells, quoting: bool = True
) -> tuple[list[Clearance], tuple[Remark, ...]]:
    """
    Return the clearance to each offset well, smallest separation factor first, and the remarks about all offset wells.

    Remarks name what is not compared and why, assumptions about the lists, and wells whose stations are so far apart
    that the hole between them is hardly known.

    quoting: whether a remark may quote contents of a file that cannot be read.

    Raises
    ------
    ValueError
        The position of the well itself has no covariance.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    well.covariance()
    found: list[Clearance] = []
    remarks: list[Remark] = []
    for offset in offsets.wells:
        try:
            other = offset_well(offset, Path(offsets.folder), well.north, well.reference, wellhead_of(well.remarks))
            found.append(clearance(well, other, offsets.rule, offset.shared_to_m))
        except ValueError as error:
            text = str(error) if offset.name in str(error) else f"offset well {offset.name}: {error}"
            if not quoting and error.__cause__ is not None:
                # The list or programme of the offset well cannot be read, so the message must not quote it.
                text = f"offset well {offset.name}: {without_contents(offset.file, error, '`mwd clearance`')}"
            remarks.append(Remark(RemarkKind.NOT_COMPARED, text))
            continue
        remarks += other.remarks
    return nearest_first(found), tuple(remarks)


def _turned(position: Array, turn: float) -> Array:
    """Return a position, shape (3,), m, in axes whose north lies `turn` rad anticlockwise of its present north."""
    level = complex(position[0], position[1]) * np.exp(1j * turn)
    return np.array([level.real, level.imag, position[2]])


def _wellhead(
    offset: OffsetWell, plan: Plan, wellhead: tuple[float, float] | None, north: North, reference: ErrorReference
) -> tuple[tuple[float, float], tuple[Remark, ...]]:
    """
    Return north and east from the wellhead of the well being drilled to an offset wellhead, m, and remarks.

    Raises OffsetWellError if the wellheads are more than 20 km apart, or their map coordinates contradict north_m and
    east_m of the file.
    """
    named = f"offset well {offset.name}"
    own = wellhead_of(plan.remarks)
    mapped: tuple[float, float] | None = None
    said: tuple[Remark, ...] = ()
    if own is not None and wellhead is not None:
        # Map coordinates refer to grid north: turn them to the north of the well.
        turn = {"true": 0.0, "magnetic": reference.declination, "grid": reference.convergence}[north.name.lower()]
        step = complex(own[0] - wellhead[0], own[1] - wellhead[1]) * np.exp(1j * (reference.convergence - turn))
        mapped = float(step.real), float(step.imag)
    if offset.north_m is None and offset.east_m is None and mapped is not None:
        place = mapped
        text = (
            f"{named}: its wellhead lies {place[0]:+.2f} m north and {place[1]:+.2f} m east, by the map coordinates of"
            " both lists, which are assumed to be of one grid"
        )
        said = (Remark(RemarkKind.WELLHEAD_ASSUMED, text, {"north": place[0], "east": place[1]}),)
    else:
        place = offset.north_m or 0.0, offset.east_m or 0.0
        apart = 0.0 if mapped is None else float(np.hypot(place[0] - mapped[0], place[1] - mapped[1]))
        if mapped is not None and apart > _ASTRAY + 0.01 * float(np.hypot(*mapped)):
            raise OffsetWellError(
                f"{named}: its wellhead lies {mapped[0]:+.1f} m north and {mapped[1]:+.1f} m east by the map"
                f" coordinates of both lists, and {place[0]:+.1f} and {place[1]:+.1f} m by north_m and east_m;"
                " correct one of them"
            )
        if offset.north_m is None and offset.east_m is None:
            text = f"{named}: neither north_m and east_m nor map coordinates are given: the same wellhead is assumed"
            said = (Remark(RemarkKind.WELLHEAD_ASSUMED, text),)
    if np.hypot(*place) > _FAR:
        raise OffsetWellError(
            f"{named}: its wellhead lies {np.hypot(*place) / 1000.0:.1f} km away; check the map coordinates and north_m"
            " and east_m, or leave the well out"
        )
    return place, said


def _remarks(offset: OffsetWell, plan: Plan) -> tuple[Remark, ...]:
    """Return the remarks about an offset well's list: assumptions made on reading, and parts that are not compared."""
    named = f"offset well {offset.name}"
    remarks = [dataclasses.replace(one, text=f"{named}: {one.text}") for one in plan.remarks]
    above = float(plan.md[0])
    if above > 0.0:
        text = f"{named}: its list begins at {above:.2f} m; the hole above is not known and was not compared"
        remarks.append(Remark(RemarkKind.NOT_COMPARED, text, {"from": 0.0, "to": above}))
    apart = np.diff(plan.md)
    # An assumed hole above the list has its own remark, so exclude it from the widest gap.
    assumed = any(one.kind == RemarkKind.HOLE_ABOVE_ASSUMED for one in plan.remarks)
    gap = float(np.max(apart[1:] if assumed and apart.size > 1 else apart))
    if gap > _WIDE and not offset.planned:
        text = (
            f"{named} has stations {gap:.0f} m apart, between which its path is hardly known; set planned: true if the"
            " file is a plan"
        )
        remarks.append(Remark(RemarkKind.SPARSE, text, {"distance": gap}))
    return tuple(remarks)


@dataclasses.dataclass(frozen=True)
class WellClearance:
    """Clearances of a well to the wells near it."""

    well: UncertainWell  #: path that was compared, including projection and plan ahead
    #: `surveyed`, `bit`: measured depths of the last survey and of the bit, m; below the bit the path is planned
    surveyed: float
    bit: float
    found: tuple[Clearance, ...]  #: clearances, smallest separation factor first
    #: parts that were not compared, and all assumptions made for the lists of the well, the plan and the offset wells
    remarks: tuple[Remark, ...]
    rule: ClearanceRule
    #: names of the offset wells that could not be compared, so that their separation is unknown
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
        The list has no leg of this name, its path is implausible (`check_plausible`), or its position has no
        covariance.
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
