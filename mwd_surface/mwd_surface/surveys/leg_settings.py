# SPDX-License-Identifier: Apache-2.0
"""Settings of tie-on, leg and tool for the next surveys."""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.settings import setting
from mwd_surface.surveys.leg import MAIN, TieOn
from mwd_surface.surveys.survey_list import SurveyList


@dataclasses.dataclass(frozen=True)
class LegSettings:
    """Tie-on of the main leg, and the leg and tool of the next surveys."""

    name: str = setting(
        "",
        "Name of the leg to which the next surveys belong. Empty: the present leg. A new name together with "
        "kick_off_depth starts a sidetrack.",
    )
    kick_off_depth: float | None = setting(
        None, "Measured depth at which a new leg leaves its parent. nan if there is no new leg.", unit="m", low=0.0
    )
    parent: str = setting("", "Leg from which a new leg branches off. Empty: the present leg.")
    tool: str = setting("", "Serial number or name of the tool in the hole. Empty: the tool stays the same.")
    tie_on_depth: float | None = setting(
        None,
        "Measured depth of the tie-on station of the main leg. nan if not given: the hole above the first survey "
        "is then assumed to be vertical, and its coordinates are marked as assumed.",
        unit="m",
        low=0.0,
    )
    tie_on_inclination_deg: float = setting(0.0, "Inclination of the tie-on station.", low=0.0, high=180.0)
    tie_on_azimuth_deg: float = setting(
        0.0, "Azimuth of the tie-on station, from the north reference of the well.", low=0.0, high=360.0
    )
    tie_on_north: float | None = setting(
        None, "Distance of the tie-on station north of the wellhead. nan if not given.", unit="m"
    )
    tie_on_east: float | None = setting(
        None, "Distance of the tie-on station east of the wellhead. nan if not given.", unit="m"
    )
    tie_on_vertical_depth: float | None = setting(
        None, "Vertical depth of the tie-on station. nan if not given.", unit="m"
    )


def arranged(surveys: SurveyList, asked: LegSettings) -> SurveyList:
    """
    Return the list with the tie-on, leg and tool of the settings; a list that already has them is returned unchanged.

    Raises
    ------
    ValueError
        A new leg has no kick-off depth, a kick-off depth that is not on the path of its parent, or a parent that does
        not exist; or stations in use lie at or above the tie-on, or a value of the tie-on is out of range.
    """
    if asked.tie_on_depth is not None:
        tie_on = TieOn.given(
            asked.tie_on_depth,
            math.radians(asked.tie_on_inclination_deg),
            math.radians(asked.tie_on_azimuth_deg),
            (asked.tie_on_north, asked.tie_on_east, asked.tie_on_vertical_depth),
        )
        if next(leg for leg in surveys.legs if leg.name == MAIN).tie_on != tie_on:
            surveys = surveys.tied_on(tie_on, MAIN)
    if asked.name and asked.name not in {leg.name for leg in surveys.legs}:
        if asked.kick_off_depth is None:
            raise ValueError(f"leg.name: {asked.name!r} is new; give leg.kick_off_depth together with it")
        surveys = surveys.sidetracked(asked.name, asked.kick_off_depth, asked.parent or None)
    if (asked.name and asked.name != surveys.leg) or (asked.tool and asked.tool != surveys.tool):
        surveys = surveys.using(leg=asked.name or None, tool=asked.tool or None)
    return surveys
