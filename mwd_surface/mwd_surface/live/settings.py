# SPDX-License-Identifier: Apache-2.0
"""What people may choose of the live page: how often what is expected, and how much is kept."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_surface.list_files.list_settings import ListSettings
from mwd_surface.surveys.station_quality import QualityLimits


@dataclasses.dataclass(frozen=True)
class LiveSettings:
    """How often what is expected, and how much is kept for the page. A value is stale after two expected periods."""

    estimator_period: float = setting(
        0.5, "usual time between attitudes; after twice this time the page shows STALE", unit="s", low=0.05
    )
    dynamics_period: float = setting(
        1.0,
        "usual time between summaries of drilling dynamics; after twice this time the page shows STALE",
        unit="s",
        low=0.05,
    )
    rig_period: float = setting(
        1.0, "usual time between rig data; after twice this time the page shows STALE", unit="s", low=0.05
    )
    temperature_period: float = setting(
        1.0, "usual time between temperatures; after twice this time the page shows STALE", unit="s", low=0.05
    )
    magnetometer_period: float = setting(
        0.5, "usual time between magnetometer samples; after twice this time the page shows STALE", unit="s", low=0.05
    )
    interference_period: float = setting(
        1.0, "usual time between interference estimates; after twice this time the page shows STALE", unit="s", low=0.05
    )
    recorder_period: float = setting(
        1.0,
        "usual time between reports of the recorder; after twice this time the page shows STALE",
        unit="s",
        low=0.05,
    )
    sonde_period: float = setting(
        0.5, "usual time between raw samples; after twice this time the page shows STALE", unit="s", low=0.05
    )
    withheld_sigma_deg: float = setting(
        45.0, "sigma above which an angle is not shown", unit="deg", low=1.0, high=180.0
    )
    readings: int = setting(12, "number of previous toolfaces on the dial", low=1, high=60)
    reading_spacing: float = setting(1.0, "shortest time between two toolfaces of the dial", unit="s", low=0.0)
    history_seconds: float = setting(600.0, "length of the strip charts", unit="s", low=10.0, high=7200.0)
    history_rate: float = setting(1.0, "points of the strip charts per second", unit="Hz", low=0.1, high=5.0)
    trend_hours: float = setting(24.0, "length of the long charts", unit="h", low=0.1, high=72.0)
    trend_step: float = setting(
        30.0,
        "time interval of one point of the long charts; finer costs data volume to each browser",
        unit="s",
        low=1.0,
        high=600.0,
    )
    log_step: float = setting(
        0.5,
        "depth interval of one point of the depth tracks; finer costs data volume to each browser",
        unit="m",
        low=0.05,
        high=10.0,
    )
    log_length: float = setting(600.0, "length of the depth tracks", unit="m", low=10.0, high=5000.0)
    max_rows: int = setting(
        1000,
        "most survey rows and path stations sent to the page; more cost data volume to each browser",
        low=10,
        high=10000,
    )
    limits: QualityLimits = setting(QualityLimits)


@dataclasses.dataclass(frozen=True)
class PlanSettings(ListSettings):
    """The planned well path: a list and how it is read, or a straight hole from its opening."""

    file: str = setting(
        "",
        "File of the planned path, any list that `mwd path` reads; empty: no plan. Any change of a parameter of the "
        "node reads it again",
    )
    opening_azimuth_deg: float | None = setting(
        None,
        "Azimuth of a straight planned hole, from the north of the well; nan if the plan is a file",
        unit="deg",
        low=0.0,
        high=360.0,
    )
    opening_angle_deg: float | None = setting(
        None,
        "Vertical angle of a straight planned hole, in the convention of the well: dip or inclination; nan if the plan "
        "is a file",
        unit="deg",
        low=-180.0,
        high=180.0,
    )
    length_m: float = setting(100.0, "Length of a straight planned hole", unit="m", low=1.0, high=5000.0)


@dataclasses.dataclass(frozen=True)
class LinkSettings:
    """Settings of the connection from the tool to the surface."""

    source: str = setting(
        "direct",
        "How attitude and surveys reach the surface. direct: the topics of the tool, as over a wire without limits "
        "(simulation, bench). mud_pulse, em, coil, serial: the topics link/... of a receiver alone; best: the same, of "
        "several receivers. With any but direct the surface subscribes to nothing else of the tool",
        choices=("direct", "mud_pulse", "em", "coil", "serial", "best"),
        fixed=True,
    )
