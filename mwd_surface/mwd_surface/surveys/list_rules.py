# SPDX-License-Identifier: Apache-2.0
"""Rules for entering surveys into the definitive list, and for flags."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

LAST_SEQUENCE = 999_999  # largest valid survey number: one survey per minute for two years


@dataclasses.dataclass(frozen=True)
class ListRules:
    """Rules for automatic acceptance of surveys, and limits for warnings."""

    automatic: bool = setting(
        True,
        "Accept a survey automatically if it passes the acceptance criteria. If false, every survey waits for an "
        "operator.",
    )
    same_depth: float = setting(
        0.5,
        "Difference of measured depth below which two stations count as repeated surveys of one depth. Raising it "
        "can merge stations that are close together.",
        unit="m",
        low=0.01,
    )
    depth_age_limit: float = setting(
        30.0,
        "Age of the bit depth above which a survey waits for an operator. Raise it for rig data at long intervals.",
        unit="s",
        low=0.1,
    )
    gap_limit: float = setting(
        60.0,
        "Distance between two stations above which the list shows a warning. Raising it warns less often.",
        unit="m",
        low=1.0,
    )
    dogleg_limit_deg: float = setting(
        10.0,
        "Dogleg severity above which the list shows a warning. Raising it warns less often.",
        unit="deg/30 m",
        low=0.1,
    )
    vertical_limit_deg: float = setting(
        1.0,
        "Inclination below which a station without azimuth gets the azimuth of the station above. Raising it "
        "accepts larger position errors.",
        low=0.0,
        high=5.0,
    )
    apply_revisions: str = setting(
        "at_once",
        "Reaction when later surveys of a run change an earlier survey. at_once: the revised value is used at once. "
        "ask: a person decides.",
        choices=("at_once", "ask"),
    )
    projection: str = setting(
        "straight",
        "Path from the last station to the bit. straight: the direction of the last station. curve: the curvature "
        "between the last two stations.",
        choices=("straight", "curve"),
    )
