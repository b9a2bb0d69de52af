"""The rules by which a survey goes into the definitive list, and what is flagged."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class ListRules:
    """When a survey goes into the definitive list by itself, and what is pointed out."""

    automatic: bool = setting(True, "use a survey that quality control accepts without waiting for a person")
    same_depth: float = setting(0.5, "closer in measured depth than this is the same depth", unit="m", low=0.01)
    depth_age_limit: float = setting(30.0, "an older depth needs a person's acceptance", unit="s", low=0.1)
    gap_limit: float = setting(60.0, "a longer interval between stations is pointed out", unit="m", low=1.0)
    dogleg_limit_deg: float = setting(10.0, "a sharper dogleg is pointed out", unit="deg/30 m", low=0.1)
    vertical_limit_deg: float = setting(
        1.0, "below this inclination a station without azimuth is used with the azimuth of the one above",
        unit="deg", low=0.0, high=5.0,
    )  # fmt: skip
    projection: str = setting(
        "straight", "how the path goes on from the last station to the bit", choices=("straight", "curve")
    )
