"""
The estimator: samples in, attitude and surveys out; one object for the live node, replay and batch.

Blocks may have any length; the output is the same bits however the streams are cut, and whatever the order in which
topics arrive, as long as a magnetic sample is there `mag_lag` after its stamp.
"""

from __future__ import annotations

import dataclasses
import datetime
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import attitude_track, fusion, gravity, gravity_bounded, gravity_kalman, gravity_raw, survey
from mwd_estimation.attitude_track import FieldModel
from mwd_estimation.binning import Bin, Binner
from mwd_estimation.gravity_s3 import MahonyParams
from mwd_estimation.gravity_s3 import Params as S3Params
from mwd_estimation.gyro_station import GyroSettings, GyroStation
from mwd_estimation.reference import Reference, best_north, from_field, north_correction
from mwd_estimation.station import Station, StationSettings
from mwd_estimation.status import Status
from mwd_estimation.still_survey import BIN_NS, BinSet, Refusal, StillAverage, StillSurvey
from mwd_estimation.still_survey import Params as StillParams
from mwd_estimation.survey import Survey
from mwd_sensors import earth, wire
from mwd_sensors.settings import setting

Array = NDArray[np.float64]
Samples = wire.Samples

NORTH_CODES = {"unknown": 0, "magnetic": 1, "true": 2, "grid": 3}


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
    gravity_mps2: float = setting(9.80665, "Local gravity", unit="m/s^2", low=9.76, high=9.84)


@dataclasses.dataclass(frozen=True)
class EstimatorSettings:
    """Everything that can be set about the estimator."""

    method: str = setting(gravity.DEFAULT, "Gravity extraction", choices=tuple(gravity.METHODS))
    reference: ReferenceSettings = setting(ReferenceSettings, "Reference field")
    azimuth: attitude_track.Params = setting(attitude_track.Params, "Continuous azimuth")
    survey: StillParams = setting(StillParams, "Surveys in still intervals")
    station: StationSettings = setting(StationSettings, "Working out a station")
    gyro: GyroSettings = setting(GyroSettings, "Gyro azimuth of a station")
    fusion: fusion.Settings = setting(fusion.Settings, "Weighing the azimuths of a station")
    bounded: gravity_bounded.Params = setting(gravity_bounded.Params, "Method bounded")
    s3: S3Params = setting(S3Params, "Method s3")
    mahony: MahonyParams = setting(MahonyParams, "Method mahony")
    kalman: gravity_kalman.Params = setting(gravity_kalman.Params, "Method kalman")
    raw: gravity_raw.Params = setting(gravity_raw.Params, "Method raw")


@dataclasses.dataclass
class Output:
    """What a block gave: attitude and gravity of every IMU sample, interference and surveys as they came."""

    attitude: Samples
    gravity: Samples
    interference: Samples
    surveys: list[Survey] = dataclasses.field(default_factory=list)
    refusals: list[Refusal] = dataclasses.field(default_factory=list)


@dataclasses.dataclass
class Counters:
    """What was received and not used."""

    imu: int = 0
    mag: int = 0
    precision: int = 0
    rejected: int = 0
    late_mag: int = 0


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
            gravity=settings.gravity_mps2,
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


class Pipeline:
    """
    The estimator of one well.

    Parameters
    ----------
    settings : EstimatorSettings
    reference : Reference, optional
        Overrides what the settings say, for a field measured beforehand.
    """

    def __init__(self, settings: EstimatorSettings, reference: Reference | None = None) -> None:
        self.settings = settings
        self.counters = Counters()
        self.sequence = 0
        self._given = reference
        self.reset()

    def reset(self) -> None:
        """Forget everything but settings, counters and the survey numbering."""
        settings = self.settings
        self.method = gravity.method(settings.method)
        self._gravity_params = getattr(settings, settings.method)
        self._gravity_state = self.method.initial(self._gravity_params)
        self._attitude_state = attitude_track.initial()
        self._binners = {
            "imu": Binner(6, BIN_NS),
            "mag": Binner(3, BIN_NS),
            "precision": Binner(6, BIN_NS),
            "temperature": Binner(1, BIN_NS),
        }
        self._closed: dict[str, dict[int, Bin]] = {"mag": {}, "precision": {}, "temperature": {}}
        self._waiting: list[Bin] = []
        self._still = StillSurvey(settings.survey)
        self._gyro = GyroStation(settings.gyro, None, None)
        self._precision_ns = np.zeros(0, dtype=np.int64)
        self._precision_t = np.zeros((0, 6))
        self._mag_ns = np.zeros(0, dtype=np.int64)
        self._mag_t = np.zeros((0, 3))
        self._last_imu_ns = np.iinfo(np.int64).min
        self._ready = False
        self.reference: Reference | None = self._given
        self.interference: tuple[float, float] | None = None
        self._model = FieldModel(np.zeros(3), 0.0, 0.0)
        self.north = "magnetic"

    def set_reference(self, reference: Reference) -> None:
        """Judge and correct by this field from now on; the interference is estimated anew."""
        self._given = self.reference = reference
        self.interference = None
        if self._ready:
            self._set_model()

    def request_survey(self, duration_s: float = 0.0) -> None:
        """Take a survey from the next half second on; `duration_s` 0 means as configured."""
        self._still.request(duration_s)

    @property
    def survey_progress(self) -> float:
        """Share of the survey under way, 0 to 1."""
        return self._still.progress

    def push_mag(self, samples: Samples) -> None:
        """Take magnetic samples, dtype of `wire.MAG`."""
        self.counters.mag += len(samples)
        stamps, b_t = samples["stamp_ns"], samples["magnetic_field"]
        usable = np.isfinite(b_t).all(axis=1)
        stamps, b_t = np.ascontiguousarray(stamps[usable]), np.ascontiguousarray(b_t[usable])
        self.counters.rejected += int(len(usable) - len(stamps))
        self.counters.late_mag += int((stamps <= self._last_imu_ns - self._lag_ns).sum())
        self._keep("mag", self._binners["mag"].add(stamps, b_t))
        self._mag_ns = np.concatenate([self._mag_ns, stamps])
        self._mag_t = np.concatenate([self._mag_t, b_t])

    def push_precision(self, samples: Samples) -> None:
        """Take samples of the high-precision unit, dtype of `wire.IMU`."""
        self.counters.precision += len(samples)
        values = np.hstack([samples["angular_velocity"], samples["linear_acceleration"]])
        stamps = np.ascontiguousarray(samples["stamp_ns"])
        self._keep("precision", self._binners["precision"].add(stamps, values))
        self._precision_ns = np.concatenate([self._precision_ns, stamps])
        self._precision_t = np.concatenate([self._precision_t, values])

    def push_temperature(self, samples: Samples) -> None:
        """Take temperatures, dtype of `wire.TEMPERATURE`."""
        values = np.ascontiguousarray(samples["temperature"])[:, None]
        self._keep("temperature", self._binners["temperature"].add(np.ascontiguousarray(samples["stamp_ns"]), values))

    def push_imu(self, samples: Samples) -> Output:
        """Take samples of the AHRS, dtype of `wire.IMU`; everything else of their time must be pushed before them."""
        self.counters.imu += len(samples)
        stamps = np.ascontiguousarray(samples["stamp_ns"])
        gyro = np.ascontiguousarray(samples["angular_velocity"])
        accel = np.ascontiguousarray(samples["linear_acceleration"])
        if len(stamps) and not self._ready:
            if self._given is None:
                self.reference = reference_of(self.settings.reference, int(stamps[0]))
            self._ready = True
            self._set_model()
            known = self.reference.gravity if self.reference is not None else None
            self._gyro = GyroStation(self.settings.gyro, latitude_of(self.settings), known)
        pieces: list[Output] = []
        start = 0
        # The block is cut where a bin ends, because a survey changes the field model from there on.
        for stop in _bin_ends(stamps):
            pieces.append(self._span(stamps[start:stop], gyro[start:stop], accel[start:stop]))
            start = stop
        pieces.append(self._span(stamps[start:], gyro[start:], accel[start:]))
        if len(stamps):
            self._last_imu_ns = int(stamps[-1])
        return _joined(pieces)

    @property
    def _lag_ns(self) -> int:
        return round(self.settings.azimuth.mag_lag_s * 1e9)

    def _span(self, stamps: NDArray[np.int64], gyro: Array, accel: Array) -> Output:
        """Samples of one bin at most: only the first can close the bin before, and what that changes holds from it."""
        output = Output(wire.ATTITUDE.empty(0), wire.GRAVITY.empty(0), wire.INTERFERENCE.empty(0))
        for closed in self._binners["imu"].add(stamps, np.hstack([gyro, accel])):
            self._waiting.append(closed)
            # One bin late, so that the other streams of its time are there.
            if len(self._waiting) > 1:
                self._judge(self._waiting.pop(0), output)
        track = self.method.run(self._gravity_params, self._gravity_state, stamps, gyro, accel)
        rows, used = attitude_track.run(
            self.settings.azimuth,
            self._attitude_state,
            self._model,
            stamps,
            track.g_t,
            np.ascontiguousarray(gyro[:, 0]),
            track.sigma_inclination,
            self._mag_ns,
            self._mag_t,
        )
        self._mag_ns, self._mag_t = self._mag_ns[used:], self._mag_t[used:]
        output.attitude = self._attitude_samples(stamps, track, rows)
        output.gravity = _gravity_samples(stamps, track, output.attitude["status"])
        self.counters.rejected += int((output.attitude["status"] & int(Status.REJECTED) > 0).sum())
        return output

    def _judge(self, imu: Bin, output: Output) -> None:
        end_ns = (imu.index + 1) * BIN_NS
        for name in self._closed:
            self._keep(name, self._binners[name].flush(end_ns))
        found = {name: bins.pop(imu.index, None) for name, bins in self._closed.items()}
        for bins in self._closed.values():
            for index in [k for k in bins if k < imu.index]:
                del bins[index]
        result = self._still.add(BinSet(imu, found["mag"], found["precision"], found["temperature"]))
        still = self._still.still_bins
        # By bins, not by blocks: the same samples go into the seek however the stream is cut.
        before = int(np.count_nonzero(np.logical_and.accumulate(self._precision_ns < end_ns)))
        samples = self._precision_ns[:before], self._precision_t[:before]
        self._precision_ns, self._precision_t = self._precision_ns[before:], self._precision_t[before:]
        self._gyro.add(imu, BIN_NS * 1e-9, still * BIN_NS > self.settings.survey.settle_s * 1e9, still > 0, samples)
        if isinstance(result, Refusal):
            output.refusals.append(result)
        elif isinstance(result, StillAverage):
            self.sequence += 1
            taken = survey.from_average(
                result,
                self.sequence,
                self.reference,
                self.settings.station,
                self._gyro.solution(),
                self.settings.fusion,
            )
            output.surveys.append(taken)
            self._learn(taken.station)
        output.interference = np.concatenate([output.interference, self._interference_sample(end_ns)])

    def _keep(self, name: str, closed: list[Bin]) -> None:
        for one in closed:
            self._closed[name][one.index] = one

    def _learn(self, station: Station) -> None:
        if station.corrected:
            self.interference = (station.interference, station.sigma_interference)
            self._set_model()

    def _set_model(self) -> None:
        attitude_track.begin_smoothing(self._attitude_state)
        reference, settings = self.reference, self.settings.station
        self.north = best_north(reference) if settings.north == "best" else settings.north
        correction = north_correction(reference, self.north)
        if correction is None:
            self.north, correction = "magnetic", 0.0
        axial, sigma_axial = self.interference or (0.0, settings.errors.axial_interference_nt * 1e-9)
        known = reference is not None and reference.has_field
        variance = 0.0
        if reference is not None and known and self.north != "magnetic":
            variance = reference.declination_variance(reference.horizontal)
        self._model = FieldModel(
            interference=np.array([axial, 0.0, 0.0]),
            sigma_axial=sigma_axial,
            sigma_cross=settings.errors.magnetometer_bias_nt * 1e-9,
            north_correction=correction,
            sigma_north=math.sqrt(variance),
            total=reference.total if reference is not None and reference.total is not None else math.nan,
            dip=reference.dip if reference is not None and reference.dip is not None else math.nan,
            total_limit=self.settings.azimuth.disturbed_field_nt * 1e-9,
            dip_limit=math.radians(self.settings.azimuth.disturbed_dip_deg),
        )

    def _attitude_samples(self, stamps: NDArray[np.int64], track: gravity.Track, rows: attitude_track.Rows) -> Samples:
        samples = wire.ATTITUDE.empty(len(stamps))
        status = track.status | rows.status
        has_azimuth = np.isfinite(rows.azimuth)
        has_gravity = np.isfinite(rows.inclination)
        near_vertical = status & int(Status.NEAR_VERTICAL) > 0
        correction = Status.CORRECTED if self.interference else Status.UNCORRECTED
        status = np.where(has_azimuth, status | int(correction), status)
        if self.reference is None or not self.reference.has_field:
            status |= int(Status.NO_REFERENCE)
        samples["stamp_ns"] = stamps
        samples["status"] = status
        samples["north"] = NORTH_CODES[self.north]
        samples["inclination"] = np.where(has_gravity, rows.inclination, 0.0)
        samples["azimuth"] = np.where(has_azimuth, rows.azimuth, 0.0)
        samples["gravity_toolface"] = np.where(has_gravity, rows.gravity_toolface, 0.0)
        samples["magnetic_toolface"] = np.where(has_azimuth, rows.magnetic_toolface, 0.0)
        samples["sigma_inclination"] = np.where(has_gravity, track.sigma_inclination, -1.0)
        sigma_azimuth = np.where(near_vertical, math.pi, rows.sigma_azimuth)
        samples["sigma_azimuth"] = np.where(has_azimuth, sigma_azimuth, -1.0)
        sigma_toolface = np.where(near_vertical, math.pi, track.sigma_toolface)
        samples["sigma_gravity_toolface"] = np.where(has_gravity, sigma_toolface, -1.0)
        samples["sigma_magnetic_toolface"] = np.where(has_azimuth, self._sigma_magnetic_toolface(rows, track), -1.0)
        return samples

    def _sigma_magnetic_toolface(self, rows: attitude_track.Rows, track: gravity.Track) -> Array:
        # The scribe line against north: as the azimuth, without what the axis itself loses near vertical.
        horizontal = np.maximum(rows.total * np.abs(np.cos(rows.dip)), 1e-9)
        tilt = rows.total * np.abs(np.sin(rows.dip)) * track.sigma_inclination
        field = (self._model.sigma_cross**2 + tilt**2) / horizontal**2
        return np.asarray(np.minimum(np.sqrt(field + self._model.sigma_north**2), math.pi))

    def _interference_sample(self, stamp_ns: int) -> Samples:
        sample = wire.INTERFERENCE.empty(1)
        sample["stamp_ns"] = stamp_ns
        sample["sigma_axial"] = -1.0
        sample["sigma_cross_axial"] = -1.0
        if self.interference:
            sample["axial"], sample["sigma_axial"] = self.interference
        totals = attitude_track.last_totals(self._attitude_state)
        if self.reference is not None and self.reference.total is not None and totals is not None:
            sample["total_residual"] = totals[0] - self.reference.total
            sample["dip_residual"] = totals[1] - (self.reference.dip or 0.0)
        return sample


def _bin_ends(stamps: NDArray[np.int64]) -> list[int]:
    """Places in a block where a later bin begins."""
    return [int(k) + 1 for k in np.flatnonzero(np.diff(stamps // BIN_NS) != 0)]


def _gravity_samples(stamps: NDArray[np.int64], track: gravity.Track, status: NDArray[np.uint32]) -> Samples:
    samples = wire.GRAVITY.empty(len(stamps))
    known = np.asarray(np.isfinite(track.g_t).all(axis=1))
    samples["stamp_ns"] = stamps
    samples["gravity"] = np.where(known[:, None], track.g_t, 0.0)
    samples["sigma"] = np.where(known, track.sigma_inclination, -1.0)
    samples["non_gravity"] = np.where(np.isfinite(track.non_gravity), track.non_gravity, 0.0)
    samples["rotary_speed"] = np.where(np.isfinite(track.rotary_speed), track.rotary_speed, 0.0)
    samples["status"] = status
    return samples


def _joined(pieces: list[Output]) -> Output:
    return Output(
        np.concatenate([piece.attitude for piece in pieces]),
        np.concatenate([piece.gravity for piece in pieces]),
        np.concatenate([piece.interference for piece in pieces]),
        [one for piece in pieces for one in piece.surveys],
        [one for piece in pieces for one in piece.refusals],
    )
