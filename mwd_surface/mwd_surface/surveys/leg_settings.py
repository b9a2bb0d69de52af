# SPDX-License-Identifier: Apache-2.0
"""Where the survey list stands in the well: tie-on, leg and tool of the surveys to come, as people set them."""

from __future__ import annotations

import dataclasses
import math

from mwd_sensors.core.settings import setting
from mwd_surface.surveys.leg import MAIN, TieOn
from mwd_surface.surveys.survey_list import SurveyList


@dataclasses.dataclass(frozen=True)
class LegSettings:
    """Tie-on of the main leg, and leg and tool that surveys to come belong to."""

    name: str = setting(
        "", "name of the leg of the next surveys; empty: unchanged. A new name with kick_off_depth starts a sidetrack"
    )
    kick_off_depth: float | None = setting(
        None, "measured depth at which a new leg leaves its parent; nan: no new leg", unit="m", low=0.0
    )
    parent: str = setting("", "leg from which a new leg branches off; empty: the present one")
    tool: str = setting("", "serial number or name of the tool in the hole; empty: unchanged")
    tie_on_depth: float | None = setting(
        None,
        "measured depth of the tie-on station of the main leg; nan: not given. Without one the hole above the first "
        "survey is taken as vertical, and its coordinates are marked as assumed",
        unit="m",
        low=0.0,
    )
    tie_on_inclination_deg: float = setting(0.0, "inclination of the tie-on station", unit="deg", low=0.0, high=180.0)
    tie_on_azimuth_deg: float = setting(
        0.0, "azimuth of the tie-on station, from the north reference of the well", unit="deg", low=0.0, high=360.0
    )
    tie_on_north: float | None = setting(
        None, "distance of the tie-on station north of the wellhead; nan: not given", unit="m"
    )
    tie_on_east: float | None = setting(
        None, "distance of the tie-on station east of the wellhead; nan: not given", unit="m"
    )
    tie_on_vertical_depth: float | None = setting(
        None, "vertical depth of the tie-on station; nan: not given", unit="m"
    )


def arranged(surveys: SurveyList, asked: LegSettings) -> SurveyList:
    """
    The list as the settings want it; one that stands so already comes back as it is.

    Raises
    ------
    ValueError
        A new leg without a kick-off depth, one that is not on the parent's path, or a tie-on that stations lie above.
        The list is unchanged.
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
