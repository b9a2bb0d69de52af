# SPDX-License-Identifier: Apache-2.0
"""Settings of the live state of a well: list, plan, link, rig data, and the values and data that the page shows."""

from __future__ import annotations

import dataclasses
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_surface.list_files.list_settings import ListSettings
from mwd_surface.live.source_selection import SourceRules
from mwd_surface.surveys.recorded_settings import SurfacePart
from mwd_surface.trajectory.advice import AdvisorySettings
from mwd_surface.trajectory.slide_sheet import SlideRules


def _period_setting(seconds: float, messages: str) -> Any:
    """Declare the usual time between messages of one kind, s."""
    return setting(
        seconds,
        f"Usual time between {messages}. The page shows STALE after twice this time without one. Raise it for a slower "
        "source.",
        unit="s",
        low=0.05,
    )


@dataclasses.dataclass(frozen=True)
class LiveSettings:
    """Usual time between messages of each kind, and amounts of data kept for the page."""

    estimator_period: float = _period_setting(0.5, "attitudes")
    dynamics_period: float = _period_setting(1.0, "summaries of drilling dynamics")
    rig_period: float = _period_setting(1.0, "messages of rig data")
    temperature_period: float = _period_setting(1.0, "temperatures")
    magnetometer_period: float = _period_setting(0.5, "magnetometer samples")
    interference_period: float = _period_setting(1.0, "estimates of the magnetic interference")
    recorder_period: float = _period_setting(1.0, "reports of the recorder")
    sonde_period: float = _period_setting(0.5, "raw samples of the sonde")
    history_seconds: float = setting(
        600.0,
        "Time range of the strip charts. Raising it costs memory and data volume to each browser.",
        low=10.0,
        high=7200.0,
    )
    trend_hours: float = setting(
        24.0,
        "Time range of the long charts. Raising it costs memory and data volume to each browser.",
        unit="h",
        low=0.1,
        high=72.0,
    )
    log_step: float = setting(
        0.5,
        "Depth between two points of the depth tracks. Lowering it costs memory and data volume to each browser.",
        unit="m",
        low=0.05,
        high=10.0,
    )
    log_length: float = setting(
        600.0,
        "Depth range of the depth tracks. Raising it costs memory and data volume to each browser.",
        unit="m",
        low=10.0,
        high=5000.0,
    )
    max_rows: int = setting(
        1000,
        "Largest number of survey rows and of path stations sent to the page; older ones are left out. Raising it "
        "costs data volume to each browser.",
        low=10,
        high=10000,
    )


@dataclasses.dataclass(frozen=True)
class PlanSettings(ListSettings):
    """Planned well path: a list file and the options for reading it, or a straight hole from its opening."""

    file: str = setting(
        "",
        "File of the planned path, in any format that `mwd path` reads. Empty: no plan. Any change of a parameter "
        "of the node reads the file again.",
    )
    opening_azimuth_deg: float | None = setting(
        None,
        "Azimuth of a straight planned hole, from the north of the well. nan if the plan is a file.",
        low=0.0,
        high=360.0,
    )
    opening_angle_deg: float | None = setting(
        None,
        "Vertical angle of a straight planned hole, dip or inclination as the convention of the well says. nan if "
        "the plan is a file.",
        low=-180.0,
        high=180.0,
    )
    length_m: float = setting(100.0, "Length of a straight planned hole.", low=1.0, high=5000.0)


@dataclasses.dataclass(frozen=True)
class LinkSettings:
    """Settings of the connection from the tool to the surface."""

    source: str = setting(
        "direct",
        "Source of attitude and surveys. direct: the topics of the tool, as over a wire without limits "
        "(simulation, bench). mud_pulse, em, coil, serial: only the topics link/... of one receiver. best: the "
        "topics link/... of several receivers. With any value except direct, the surface subscribes to no other topic "
        "of the tool.",
        choices=("direct", "mud_pulse", "em", "coil", "serial", "best"),
    )


@dataclasses.dataclass(frozen=True)
class WellSettings(SurfacePart):
    """Sections of the surface's settings from which the live state of a well is computed."""

    link: LinkSettings = setting(LinkSettings, "Reception of the tool's data at the surface.")
    plan: PlanSettings = setting(PlanSettings, "The planned well path.")
    advisory: AdvisorySettings = setting(AdvisorySettings, "The advice on steering.")
    rig_sources: SourceRules = setting(SourceRules, "Arbitration of several sources of rig data.")
    slides: SlideRules = setting(SlideRules, "The slide sheet.")
    live: LiveSettings = setting(LiveSettings, "Expected message intervals, and chart ranges of the page.")
