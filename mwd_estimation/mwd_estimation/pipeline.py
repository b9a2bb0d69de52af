"""
The estimator: samples in, attitude and surveys out; one object for the live node, replay and batch.

Blocks may have any length; the output is the same bits however the streams are cut, and whatever the order in which
topics arrive, as long as a magnetic sample is there `mag_lag` after its stamp.

A block goes through in three steps, each compiled over all its samples: gravity, which asks nothing of the field; the
half-second bins, closed and judged in order, which may take a survey and so change how the field is read; attitude, in
one stretch per reading of the field. So work that changes the reading belongs into `_judge`, and sees the gravity of
the whole block there; work that needs attitude belongs behind `_follow`.
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
from mwd_estimation.track import Track
from mwd_estimation.track import samples as arrays_of
from mwd_sensors import earth, wire
from mwd_sensors.compiled import compiled
from mwd_sensors.settings import setting

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]
Samples = wire.Samples

NORTH_CODES = {"unknown": 0, "magnetic": 1, "true": 2, "grid": 3}
_REJECTED, _NEAR_VERTICAL = int(Status.REJECTED), int(Status.NEAR_VERTICAL)


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


@dataclasses.dataclass(frozen=True)
class _Block:
    """Samples of the AHRS, laid out for the kernels, and the gravity followed through them."""

    stamps: Stamps
    gyro: Array
    accel: Array
    track: Track


@dataclasses.dataclass(frozen=True)
class _Reading:
    """How the magnetic field is read, and what rows with (`azimuth_bits`) and without an azimuth say of that."""

    model: FieldModel
    north: int
    azimuth_bits: int
    bits: int


@dataclasses.dataclass(frozen=True)
class _Mark:
    """A bin judged before the sample at `place`: its end, and the axial interference and its sigma known from there."""

    place: int
    end_ns: int
    interference: tuple[float, float] | None


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
        self._precision_at = 0
        self._mag_ns = np.zeros(0, dtype=np.int64)
        self._mag_t = np.zeros((0, 3))
        self._last_imu_ns = np.iinfo(np.int64).min
        self._ready = False
        self.reference: Reference | None = self._given
        self.interference: tuple[float, float] | None = None
        self.north = "magnetic"
        self._reading = self._read_field()

    def set_reference(self, reference: Reference) -> None:
        """Judge and correct by this field from now on; the interference is estimated anew."""
        self._given = self.reference = reference
        self.interference = None
        if self._ready:
            self._reading = self._read_field()
            attitude_track.begin_smoothing(self._attitude_state)

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
        self._precision_ns = np.concatenate([self._precision_ns[self._precision_at :], stamps])
        self._precision_t = np.concatenate([self._precision_t[self._precision_at :], values])
        self._precision_at = 0

    def push_temperature(self, samples: Samples) -> None:
        """Take temperatures, dtype of `wire.TEMPERATURE`."""
        values = np.ascontiguousarray(samples["temperature"])[:, None]
        self._keep("temperature", self._binners["temperature"].add(np.ascontiguousarray(samples["stamp_ns"]), values))

    def push_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        """
        Take samples of the AHRS, dtype of `wire.IMU`; everything else of their time must be pushed before them.

        followed : gravity of these samples, where something else than the method followed it (a smoother).
        """
        self.counters.imu += len(samples)
        output = Output(wire.ATTITUDE.empty(len(samples)), wire.GRAVITY.empty(len(samples)), wire.INTERFERENCE.empty(0))
        if not len(samples):
            return output
        if not self._ready:
            self._begin(int(samples["stamp_ns"][0]))
        stamps, gyro, accel = arrays_of(
            samples["stamp_ns"], samples["angular_velocity"], samples["linear_acceleration"]
        )
        track = followed or self.method.run(self._gravity_params, self._gravity_state, stamps, gyro, accel)
        block = _Block(stamps, gyro, accel, track)
        readings, marks = [(0, self._reading)], []
        for closed, place in self._binners["imu"].add_placed(stamps, np.hstack([gyro, accel])):
            self._waiting.append(closed)
            # One bin late, so that the other streams of its time are there.
            if len(self._waiting) > 1:
                end_ns = self._judge(self._waiting.pop(0), output)
                marks.append(_Mark(place, end_ns, self.interference))
                if self._reading is not readings[-1][1]:
                    readings.append((place, self._reading))
        self._follow(block, readings, marks, output)
        self._last_imu_ns = int(stamps[-1])
        return output

    @property
    def _lag_ns(self) -> int:
        return round(self.settings.azimuth.mag_lag_s * 1e9)

    def _begin(self, first_ns: int) -> None:
        """What hangs on the day and place of the first sample."""
        if self._given is None:
            self.reference = reference_of(self.settings.reference, first_ns)
        self._ready = True
        self._reading = self._read_field()
        known = self.reference.gravity if self.reference is not None else None
        self._gyro = GyroStation(self.settings.gyro, latitude_of(self.settings), known)

    def _judge(self, imu: Bin, output: Output) -> int:
        """Everything that is done once for a bin, in the order of bins; returns its end, ns."""
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
        first, self._precision_at = self._precision_at, _reached(self._precision_ns, self._precision_at, end_ns)
        samples = self._precision_ns[first : self._precision_at], self._precision_t[first : self._precision_at]
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
        return end_ns

    def _follow(self, block: _Block, readings: list[tuple[int, _Reading]], marks: list[_Mark], output: Output) -> None:
        """Attitude of the block, each stretch by the reading that holds from its place on."""
        totals, dips = [], []
        if marks:
            before = attitude_track.last_totals(self._attitude_state) or (math.nan, math.nan)
            totals, dips = [np.array(before[:1])], [np.array(before[1:])]
        stops = [place for place, _ in readings[1:]] + [len(block.stamps)]
        for (start, reading), stop in zip(readings, stops, strict=True):
            if start > 0:
                attitude_track.begin_smoothing(self._attitude_state)
            part, track = slice(start, stop), block.track
            rows, used = attitude_track.run(
                self.settings.azimuth,
                self._attitude_state,
                reading.model,
                block.stamps[part],
                track.g_t[part],
                np.ascontiguousarray(block.gyro[part, 0]),
                track.sigma_inclination[part],
                self._mag_ns,
                self._mag_t,
            )
            self._mag_ns, self._mag_t = self._mag_ns[used:], self._mag_t[used:]
            self.counters.rejected += _write(
                output.attitude[part], output.gravity[part], block.stamps[part], track.g_t[part],
                track.sigma_inclination[part], track.sigma_toolface[part], track.non_gravity[part],
                track.rotary_speed[part], track.status[part], rows.inclination, rows.azimuth, rows.gravity_toolface,
                rows.magnetic_toolface, rows.sigma_azimuth, rows.sigma_magnetic_toolface, rows.status, reading.north,
                reading.azimuth_bits, reading.bits,
            )  # fmt: skip
            if marks:
                totals.append(rows.total)
                dips.append(rows.dip)
        if marks:
            at = [mark.place for mark in marks]
            output.interference = self._interference_samples(
                marks, np.concatenate(totals)[at], np.concatenate(dips)[at]
            )

    def _keep(self, name: str, closed: list[Bin]) -> None:
        for one in closed:
            self._closed[name][one.index] = one

    def _learn(self, station: Station) -> None:
        if station.corrected:
            self.interference = (station.interference, station.sigma_interference)
            self._reading = self._read_field()

    def _read_field(self) -> _Reading:
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
        model = FieldModel(
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

        corrected = Status.CORRECTED if self.interference else Status.UNCORRECTED
        return _Reading(model, NORTH_CODES[self.north], int(corrected), 0 if known else int(Status.NO_REFERENCE))

    def _interference_samples(self, marks: list[_Mark], total: Array, dip: Array) -> Samples:
        """Samples of bins; total, T, and dip, rad, of the last magnetic sample before each, nan where there is none."""
        samples = wire.INTERFERENCE.empty(len(marks))
        samples["stamp_ns"] = [mark.end_ns for mark in marks]
        unknown = (0.0, -1.0)
        samples["axial"], samples["sigma_axial"] = np.array([mark.interference or unknown for mark in marks]).T
        samples["sigma_cross_axial"] = -1.0
        if self.reference is not None and self.reference.total is not None:
            seen = np.isfinite(total)
            samples["total_residual"] = np.where(seen, total - self.reference.total, 0.0)
            samples["dip_residual"] = np.where(seen, dip - (self.reference.dip or 0.0), 0.0)
        return samples


@compiled
def _reached(stamps: Stamps, start: int, end_ns: int) -> int:
    """First place from `start` on whose stamp is not before `end_ns`."""
    while start < len(stamps) and stamps[start] < end_ns:
        start += 1
    return start


@compiled
def _write(
    attitude: Samples, gravity: Samples, stamps: Stamps, g_t: Array, sigma_inclination: Array, sigma_toolface: Array,
    non_gravity: Array, rotary_speed: Array, track_status: NDArray[np.uint32], inclination: Array, azimuth: Array,
    gravity_toolface: Array, magnetic_toolface: Array, sigma_azimuth: Array, sigma_magnetic_toolface: Array,
    row_status: NDArray[np.uint32], north: int, azimuth_bits: int, bits: int,
) -> int:  # fmt: skip
    """Fill the samples of a stretch, unknown values 0 with a sigma of -1; returns how many were rejected."""
    rejected = 0
    for i in range(len(stamps)):
        row, down = attitude[i], gravity[i]
        has_gravity, has_azimuth = math.isfinite(inclination[i]), math.isfinite(azimuth[i])
        status = np.int64(track_status[i]) | np.int64(row_status[i]) | bits
        near_vertical = status & _NEAR_VERTICAL != 0
        if has_azimuth:
            status |= azimuth_bits
        rejected += status & _REJECTED != 0
        row["stamp_ns"] = stamps[i]
        row["inclination"] = inclination[i] if has_gravity else 0.0
        row["azimuth"] = azimuth[i] if has_azimuth else 0.0
        row["gravity_toolface"] = gravity_toolface[i] if has_gravity else 0.0
        row["magnetic_toolface"] = magnetic_toolface[i] if has_azimuth else 0.0
        row["sigma_inclination"] = sigma_inclination[i] if has_gravity else -1.0
        row["sigma_azimuth"] = (math.pi if near_vertical else sigma_azimuth[i]) if has_azimuth else -1.0
        row["sigma_gravity_toolface"] = (math.pi if near_vertical else sigma_toolface[i]) if has_gravity else -1.0
        row["sigma_magnetic_toolface"] = sigma_magnetic_toolface[i] if has_azimuth else -1.0
        row["status"] = status
        row["north"] = north
        known = math.isfinite(g_t[i, 0] + g_t[i, 1] + g_t[i, 2])
        vector = down["gravity"]
        for c in range(3):
            vector[c] = g_t[i, c] if known else 0.0
        down["stamp_ns"] = stamps[i]
        down["sigma"] = sigma_inclination[i] if known else -1.0
        down["non_gravity"] = non_gravity[i] if math.isfinite(non_gravity[i]) else 0.0
        down["rotary_speed"] = rotary_speed[i] if math.isfinite(rotary_speed[i]) else 0.0
        down["status"] = status
    return rejected
