"""What people may choose of the live page: how often what is expected, and how much is kept."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class Limits:
    """What totals may deviate from the reference, as the quality lights show it where a survey brings no limits."""

    gravity: float = setting(0.0245, "total gravity", unit="m/s^2", low=0.0)
    field_nt: float = setting(300.0, "total field", unit="nT", low=0.0)
    dip_deg: float = setting(0.45, "dip", unit="deg", low=0.0)
    reject_factor: float = setting(1.5, "beyond so many times a limit a station is rejected", low=1.0)


@dataclasses.dataclass(frozen=True)
class LiveSettings:
    """How often what is expected, and how much is kept for the page. A value is stale after two expected periods."""

    estimator_period: float = setting(0.5, "longest usual time between attitudes", unit="s", low=0.05)
    dynamics_period: float = setting(1.0, "time between summaries of drilling dynamics", unit="s", low=0.05)
    rig_period: float = setting(1.0, "time between rig data", unit="s", low=0.05)
    temperature_period: float = setting(1.0, "time between temperatures", unit="s", low=0.05)
    magnetometer_period: float = setting(0.5, "time between fields", unit="s", low=0.05)
    interference_period: float = setting(1.0, "time between interference estimates", unit="s", low=0.05)
    recorder_period: float = setting(1.0, "time between recorder reports", unit="s", low=0.05)
    sonde_period: float = setting(0.5, "longest usual time between raw samples", unit="s", low=0.05)
    withheld_sigma_deg: float = setting(
        45.0, "an angle less certain than this is not shown", unit="deg", low=1.0, high=180.0
    )
    readings: int = setting(12, "last toolfaces on the dial", low=1, high=60)
    reading_spacing: float = setting(1.0, "shortest time between two of them", unit="s", low=0.0)
    history_seconds: float = setting(600.0, "length of the strip charts", unit="s", low=10.0, high=7200.0)
    history_rate: float = setting(1.0, "points of the strip charts per second", unit="Hz", low=0.1, high=5.0)
    log_step: float = setting(0.5, "depth of one point of the depth tracks", unit="m", low=0.05, high=10.0)
    log_length: float = setting(600.0, "length of the depth tracks", unit="m", low=10.0, high=5000.0)
    max_rows: int = setting(1000, "survey rows and path stations sent to the page", low=10, high=10000)
    limits: Limits = setting(Limits)
