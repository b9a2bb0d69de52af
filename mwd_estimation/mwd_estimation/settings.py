"""Everything that can be set about the estimator, and the reference field and latitude that follow from it."""

from __future__ import annotations

import dataclasses
import datetime
import math

from mwd_estimation.attitude import drilling_dynamics, gyro_azimuth, time_alignment
from mwd_estimation.core.reference_field import Reference, from_field
from mwd_estimation.gravity import accelerometer_only, ligorio_kalman
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.gravity.bounded import filter as gravity_bounded
from mwd_estimation.gravity.fuzzy_mahony import MahonyParams
from mwd_estimation.gravity.fuzzy_mahony import Params as S3Params
from mwd_estimation.gyrocompass.gyro_params import GyroParams
from mwd_estimation.gyrocompass.session import SessionParams
from mwd_estimation.health import monitor
from mwd_estimation.magnetic import interference_filter
from mwd_estimation.survey import azimuth_fusion as fusion
from mwd_estimation.survey.rotary_survey import Params as RotaryParams
from mwd_estimation.survey.run_history import Params as RunParams
from mwd_estimation.survey.static_survey import Params as StillParams
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core import earth
from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class ReferenceSettings:
    """Where the reference field comes from."""

    source: str = setting(
        "none",
        "none: azimuth stays magnetic and uncorrected; model: by place and date; fixed: the figures below",
        choices=("none", "model", "fixed"),
    )
    model: str = setting("wmm2025", "Geomagnetic model", choices=earth.MODELS)
    lat_deg: float = setting(0.0, "Latitude, WGS 84, north positive", unit="deg", low=-90.0, high=90.0)
    lon_deg: float = setting(0.0, "Longitude, WGS 84, east positive", unit="deg", low=-180.0, high=360.0)
    height_m: float = setting(0.0, "Height above the ellipsoid", unit="m", low=-12000.0, high=9000.0)
    grid: str = setting("none", "Map grid of the well, for grid north by the model's place", choices=("none", "utm"))
    date: str = setting("", "Day of the model, YYYY-MM-DD; empty: the day of the first sample")
    total_nt: float = setting(50000.0, "Strength of the fixed field", unit="nT", low=15000.0, high=75000.0)
    dip_deg: float = setting(60.0, "Dip of the fixed field, below the horizontal", unit="deg", low=-90.0, high=90.0)
    declination_deg: float = setting(0.0, "Magnetic from true north, east positive", unit="deg", low=-180.0, high=180.0)
    convergence_deg: float = setting(0.0, "Grid from true north, east positive", unit="deg", low=-180.0, high=180.0)
    gravity_mps2: float = setting(0.0, "Gravity beside the fixed field; 0: not known", unit="m/s^2", low=0.0, high=9.84)


@dataclasses.dataclass(frozen=True)
class EstimatorSettings:
    """Everything that can be set about the estimator."""

    method: str = setting(gravity.DEFAULT, "Gravity extraction", choices=tuple(gravity.METHODS))
    reference: ReferenceSettings = setting(ReferenceSettings, "Reference field")
    azimuth: time_alignment.Params = setting(time_alignment.Params, "Magnetic azimuth and toolfaces of each sample")
    interference: interference_filter.Params = setting(
        interference_filter.Params, "The tool's own field, sample by sample"
    )
    carried: gyro_azimuth.Params = setting(gyro_azimuth.Params, "Azimuth carried on by the gyros")
    dynamics: drilling_dynamics.Params = setting(drilling_dynamics.Params, "Drilling dynamics")
    health: monitor.Params = setting(monitor.Params, "Health of the sensors")
    survey: StillParams = setting(StillParams, "Surveys in still intervals")
    station: StationSettings = setting(StationSettings, "Working out a station")
    gyro: GyroParams = setting(GyroParams, "Gyro azimuth of a station")
    multistation: RunParams = setting(RunParams, "The stations of a run together")
    north: SessionParams = setting(SessionParams, "North sought on request")
    rotary: RotaryParams = setting(RotaryParams, "Surveys while the string turns")
    fusion: fusion.Settings = setting(fusion.Settings, "Weighing the azimuths of a station")
    bounded: gravity_bounded.Params = setting(gravity_bounded.Params, "Method bounded")
    s3: S3Params = setting(S3Params, "Method s3")
    mahony: MahonyParams = setting(MahonyParams, "Method mahony")
    kalman: ligorio_kalman.Params = setting(ligorio_kalman.Params, "Method kalman")
    raw: accelerometer_only.Params = setting(accelerometer_only.Params, "Method raw")


def reference_of(settings: ReferenceSettings, first_ns: int) -> Reference | None:
    """
    Reference by the settings; None for "none".

    first_ns: stamp whose day counts where no date is set.

    Raises
    ------
    ValueError
        The date is no date, or outside the model's years.
    """
    if settings.source == "none":
        return None
    if settings.source == "fixed":
        return Reference(
            total=settings.total_nt * 1e-9,
            dip=math.radians(settings.dip_deg),
            declination=math.radians(settings.declination_deg),
            convergence=math.radians(settings.convergence_deg),
            gravity=settings.gravity_mps2 or None,
            source="configured",
        )
    if settings.date:
        try:
            day = datetime.date.fromisoformat(settings.date)
        except ValueError as error:
            raise ValueError(f"reference.date: {settings.date!r} is not a day as YYYY-MM-DD") from error
    else:
        day = datetime.datetime.fromtimestamp(first_ns * 1e-9, tz=datetime.UTC).date()
    reference = from_field(
        earth.reference_field(
            math.radians(settings.lat_deg), math.radians(settings.lon_deg), settings.height_m, day, settings.model
        )
    )
    # A place says where true north is; which grid the well's maps use, somebody has to say.
    return reference if settings.grid == "utm" else dataclasses.replace(reference, convergence=None)


def latitude_of(settings: EstimatorSettings) -> float | None:
    """Latitude for the gyros, deg north; None where nobody has said."""
    if settings.gyro.latitude_source == "fixed":
        return settings.gyro.latitude_deg
    by_place = settings.gyro.latitude_source == "reference" and settings.reference.source == "model"
    return settings.reference.lat_deg if by_place else None
