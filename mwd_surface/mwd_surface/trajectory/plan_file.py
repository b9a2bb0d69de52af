# SPDX-License-Identifier: Apache-2.0
"""Reading a planned well path from a file, by the rules of every list of stations (`list_file`)."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import read_list
from mwd_surface.list_files.station_list import StationList, completed
from mwd_surface.trajectory.plan import Plan, plan_of


def read_plan(path: str | Path, north: str = "", given: Given | None = None) -> Plan:
    """
    The plan of a file: a table, LAS or WITSML.

    north: "magnetic", "true" or "grid", which its azimuths must be from; empty: any. given: what the
    caller says of the file.

    Raises
    ------
    ListFileError
        The file is missing, unreadable, too large, not a plan, or from another north; the message gives file, line and
        rule.
    """
    plan = plan_from_list(read_list(path, given))
    check_north(plan, path, north)
    return plan


def check_north(plan: Plan, path: str | Path, north: str) -> None:
    """
    Refuse a plan whose azimuths are from another north than those of the well.

    Raises
    ------
    ListFileError
        It names both norths.
    """
    if north and plan.north not in ("", north):
        raise ListFileError(f"{path}: azimuths from {plan.north} north, those of the well from {north} north")


def plan_from_list(stations: StationList) -> Plan:
    """
    The plan through a list of stations; it starts where `station_list.start_of` says, as the path of every list.

    Raises
    ------
    ListFileError
        Fewer than two stations, or one without azimuth.
    """
    if stations.md.size < 2:
        raise ListFileError(f"{stations.name}: a plan needs at least two stations, got {stations.md.size}")
    without = np.isnan(stations.azimuth)
    if without.any():
        raise ListFileError(f"{stations.name}: no azimuth at {stations.md[without][0]:g} m; a plan needs each")
    md, inclination, azimuth, start, remarks = completed(stations)
    plan = plan_of(md, inclination, azimuth, start, stations.north, stations.name)
    return dataclasses.replace(plan, remarks=remarks)
