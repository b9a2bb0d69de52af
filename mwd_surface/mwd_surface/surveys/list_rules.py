# SPDX-License-Identifier: Apache-2.0
"""Rules for entering surveys into the definitive list, and for flags."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting

DEEPEST = 15_000.0  # m; the deepest hole drilled has 12.3 km
LAST_SEQUENCE = 999_999  # one survey per minute for two years; a higher number is not valid


@dataclasses.dataclass(frozen=True)
class ListRules:
    """Rules for automatic acceptance of surveys, and limits for warnings."""

    automatic: bool = setting(
        True, "use a survey that passes the acceptance criteria at once; if false, every survey waits for an operator"
    )
    same_depth: float = setting(
        0.5,
        "stations closer in measured depth than this count as one depth; a larger value merges short check shots",
        unit="m",
        low=0.01,
    )
    depth_age_limit: float = setting(
        30.0,
        "age of the bit depth above which a survey waits for an operator; raise it for rig data at long intervals",
        unit="s",
        low=0.1,
    )
    gap_limit: float = setting(
        60.0, "interval between stations above which the list shows a warning", unit="m", low=1.0
    )
    dogleg_limit_deg: float = setting(
        10.0, "dogleg severity above which the list shows a warning", unit="deg/30 m", low=0.1
    )
    vertical_limit_deg: float = setting(
        1.0,
        "inclination below which a station without azimuth takes the azimuth of the station above; a "
        "larger value accepts larger position errors",
        unit="deg",
        low=0.0,
        high=5.0,
    )
    apply_revisions: str = setting(
        "at_once",
        "when later surveys of the run revise a survey: use the revised value at once (at_once), or wait for a person's"
        " decision (ask)",
        choices=("at_once", "ask"),
    )
    projection: str = setting(
        "straight",
        "projection from the last station to the bit: straight ahead, or along the last curve",
        choices=("straight", "curve"),
    )
