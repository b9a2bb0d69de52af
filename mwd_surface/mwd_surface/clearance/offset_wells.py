# SPDX-License-Identifier: Apache-2.0
"""
Wells near the one that is drilled: a YAML file names their lists, wellheads, hole sizes and error models.

Any list or plan that the importer reads serves. Positions count from the wellhead of the well that is drilled; azimuths
from another north are turned to that of the well.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.frames import wrap_tau
from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.settings import setting
from mwd_surface.clearance.clearance import Clearance, ClearanceRule, clearance, nearest_first
from mwd_surface.trajectory.north import North
from mwd_surface.trajectory.plan import interpolated
from mwd_surface.trajectory.plan_file import read_plan
from mwd_surface.uncertainty.error_terms import ErrorReference
from mwd_surface.uncertainty.programme import Programme, ProgrammeStations, read_programme
from mwd_surface.uncertainty.uncertain_well import UncertainWell

# Usual distance between surveys, m; and one beyond which the hole between is said to be hardly known.
_SPACING = 30.0
_WIDE = 150.0


class OffsetWellError(ValueError):
    """An offset well that cannot be used; the message names it and says why."""


@dataclasses.dataclass(frozen=True)
class OffsetWell:
    """
    One offset well.

    name: as it is shown. file: its list or plan; relative to the file that names it.
    """

    name: str
    file: str
    north_m: float = setting(0.0, "wellhead of the offset well north of this wellhead", unit="m")
    east_m: float = setting(0.0, "wellhead of the offset well east of this wellhead", unit="m")
    tvd_m: float = setting(0.0, "depth datum of the offset well below that of this one", unit="m")
    hole_diameter_m: float = setting(
        0.31, "diameter of its hole, or of the casing where there is one", unit="m", low=0.0, high=5.0
    )
    code: str = setting("MWD+SRGM", "tool code of the whole well")
    programme: str = setting("", "file of its survey programme; it replaces the code")
    wellhead_sigma_m: float = setting(
        0.0, "1 sigma of its wellhead relative to this one, in north and east", unit="m", low=0.0
    )
    planned: bool = setting(
        False, "the file is a plan: its errors are those of surveys every 30 m, not of the stations of the plan"
    )
    shared_to_m: float | None = setting(
        None, "measured depth down to which both wells are the same hole, for a sidetrack", unit="m", low=0.0
    )


@dataclasses.dataclass(frozen=True)
class OffsetWells:
    """
    The file: all offset wells of a well, and how they are judged.

    name, folder: of the file.
    """

    wells: tuple[OffsetWell, ...]
    rule: ClearanceRule = setting(ClearanceRule, "the separation rule and its levels")
    hole_diameter_m: float = setting(0.31, "diameter of the hole that is drilled", unit="m", low=0.0, high=5.0)
    ahead_m: float = setting(
        300.0, "how far ahead of the bit the plan is compared; further takes longer", unit="m", low=0.0, high=20000.0
    )
    name: str = ""
    folder: str = ""


def read_offset_wells(path: Path) -> OffsetWells:
    """
    Read the file that names the offset wells.

    Raises
    ------
    OffsetWellError
        A file that cannot be read, is no YAML table of `wells`, or has unknown keys or two wells of one name.
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


def offset_well(offset: OffsetWell, folder: Path, north: North, reference: ErrorReference) -> UncertainWell:
    """
    Return an offset well in the axes of the well that is drilled.

    north: of those axes. reference: the local field, which is that of the well.

    Raises
    ------
    OffsetWellError
        Its list or its programme cannot be used.
    """
    try:
        plan = read_plan(folder / Path(offset.file).expanduser())
        plan = interpolated(plan, _SPACING) if offset.planned else plan
        programme = (
            read_programme(folder / Path(offset.programme).expanduser())
            if offset.programme
            else Programme.of_code(offset.code)
        )
        errors = programme.errors(ProgrammeStations.plain(plan.md))
    except ValueError as error:
        raise OffsetWellError(f"offset well {offset.name}: {error}") from error
    to_true = {"true": 0.0, "magnetic": reference.declination, "grid": reference.convergence}
    own = plan.north or north.name.lower()
    azimuth = wrap_tau(plan.azimuth + to_true[own] - to_true[north.name.lower()])
    start = plan.positions[0] + np.array([offset.north_m, offset.east_m, offset.tvd_m])
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
    )


def clearances(well: UncertainWell, offsets: OffsetWells) -> tuple[list[Clearance], tuple[str, ...]]:
    """
    Clearance to each offset well, the nearest by the rule first, and sentences about what people must know of them.

    That is which cannot be used and why, and which have stations so far apart that the hole between is hardly known.

    Raises
    ------
    ValueError
        The position of the well itself has no covariance.
    CovarianceUnavailableError
        `welleng` is not installed.
    """
    well.covariance()
    found, remarks = [], []
    for offset in offsets.wells:
        try:
            other = offset_well(offset, Path(offsets.folder), well.north, well.reference)
            found.append(clearance(well, other, offsets.rule, offset.shared_to_m))
            gap = float(np.max(np.diff(other.md)))
            if gap > _WIDE:
                remarks.append(
                    f"offset well {offset.name} has stations {gap:.0f} m apart, between which its path is hardly known;"
                    " set planned: true if the file is a plan"
                )
        except ValueError as error:
            remarks.append(str(error) if offset.name in str(error) else f"offset well {offset.name}: {error}")
    return nearest_first(found), tuple(remarks)
