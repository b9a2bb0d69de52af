# SPDX-License-Identifier: Apache-2.0
"""Reading of a planned well path from a file, by the rules for all lists of stations (`list_file`)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import read_list
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.station_list import VERTICAL, StationList, carried, completed
from mwd_surface.trajectory.plan import Plan, plan_of


def read_plan(path: str | Path, north: str = "", given: Given | None = None) -> Plan:
    """
    Return the plan in a file, in any format that `list_file.read_list` reads.

    north: north from which the azimuths must be measured, "magnetic", "true" or "grid"; empty: any. given: facts about
    the file that the caller states.

    Raises
    ------
    ListFileError
        The file is missing, unreadable, too large or not a plan, or its azimuths are from another north; the message
        names file, line and rule.
    """
    return in_north(plan_from_list(read_list(path, given)), path, north)


def in_north(plan: Plan, path: str | Path, north: str) -> Plan:
    """
    Return the plan if its azimuths are from the north of a well; north: name of this north, empty: any.

    If the plan does not name its north, its azimuths are assumed to be from the north of the well, and a remark is
    added.

    Raises
    ------
    ListFileError
        The plan's azimuths are from another north; the message names both.
    """
    if north and plan.north not in ("", north):
        raise ListFileError(f"{path}: azimuths from {plan.north} north, those of the well from {north} north")
    if north and not plan.north:
        text = f"{plan.name} does not name the north of its azimuths: taken as {north}, like those of the well"
        plan = dataclasses.replace(plan, remarks=(*plan.remarks, Remark(RemarkKind.NORTH_ASSUMED, text)))
    return plan


def plan_from_list(stations: StationList) -> Plan:
    """
    Return the plan through a list of stations; it starts at `station_list.start_of`, like the path of every list.

    Raises
    ------
    ListFileError
        There are fewer than two stations, or a station that is not vertical has no azimuth.
    """
    if stations.md.size < 2:
        raise ListFileError(f"{stations.name}: a plan needs at least two stations, got {stations.md.size}")
    without = np.isnan(stations.azimuth)
    deviated = without & (stations.inclination > VERTICAL)
    if deviated.any():
        raise ListFileError(
            f"{stations.name}: no azimuth at {stations.md[deviated][0]:g} m, where the hole is not vertical; a plan or"
            " an offset well needs each azimuth"
        )
    if without.any():
        # The azimuth of a vertical station is undefined: use the azimuth of an adjacent station.
        stations = dataclasses.replace(stations, azimuth=carried(stations.azimuth))
    md, inclination, azimuth, start, remarks = completed(stations)
    plan = plan_of(md, inclination, azimuth, start, stations.north, stations.name)
    return dataclasses.replace(plan, remarks=remarks)
