"""
The estimator: samples in, attitude and surveys out; one object for the live node, replay and batch.

Blocks may have any length; the output is the same bits however the streams are cut, and whatever the order in which
topics arrive, as long as a magnetic sample is there `mag_lag` after its stamp.

A block goes through in three steps, each compiled over all its samples: gravity, which asks nothing of the field; the
half-second bins, closed and judged in order, which may take a survey and so change how the field is read; attitude
(`attitude_stream`), in one stretch per reading of the field, and dynamics. So work that changes the reading belongs
into `_judge`, and sees the gravity of the whole block there; work that needs attitude belongs behind it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import derivation
from mwd_estimation.attitude import drilling_dynamics
from mwd_estimation.attitude.block import BinEvent, Block
from mwd_estimation.attitude.continuous_attitude import AttitudeStream
from mwd_estimation.attitude.gyro_azimuth_state import PrecisionRates
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import Reason, ReasonCode, quoted
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.samples import Track
from mwd_estimation.core.samples import samples as arrays_of
from mwd_estimation.core.time_bins import Bin, Binner
from mwd_estimation.core.time_jumps import Clocks
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.gravity.fallback import GravityWithFallback, without_faulty
from mwd_estimation.gyrocompass.session import NorthProgress, NorthSession
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.gyrocompass.station import GyroStation
from mwd_estimation.health import monitor
from mwd_estimation.health.sensor_fault import ACCEL, MAG, SensorFault
from mwd_estimation.health.sensor_fault import GYRO as GYRO_BIT
from mwd_estimation.health.unit_comparison import PrecisionHealth
from mwd_estimation.magnetic import spike_filter
from mwd_estimation.settings import EstimatorSettings, Place, latitude_of, reference_of
from mwd_estimation.survey.decision import Provisional, SurveyDecision
from mwd_estimation.survey.fault_history import AZIMUTH, FaultHistory
from mwd_estimation.survey.magnetic_feedback import NORTH_CODES, FieldReader
from mwd_estimation.survey.rotary_survey import Progress as RotaryProgress
from mwd_estimation.survey.rotary_survey import RotarySurvey
from mwd_estimation.survey.static_survey import BIN_NS, BinSet, Refusal, StillAverage, StillSurvey
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled

# Who runs the estimator finds here all that goes with it.
__all__ = [
    "NORTH_CODES",
    "Counters",
    "EstimatorSettings",
    "Output",
    "Pipeline",
    "Place",
    "latitude_of",
    "reference_of",
]


_STRONGEST = 0.01  # T; a hundred times what a magnetised string adds


@dataclasses.dataclass
class Output:
    """
    What a block gave: attitude and gravity of every IMU sample, interference, dynamics and surveys as they came.

    health : faults of sensors that were found, narrowed down or cleared.
    north : what a north seek that was asked for ended with.
    rotary : surveys taken while the string turned, or why there is none.
    """

    attitude: Samples
    gravity: Samples
    interference: Samples
    dynamics: Samples
    surveys: list[Survey] = dataclasses.field(default_factory=list)
    refusals: list[Refusal] = dataclasses.field(default_factory=list)
    health: list[SensorFault] = dataclasses.field(default_factory=list)
    north: list[Solution] = dataclasses.field(default_factory=list)
    rotary: list[Survey | Refusal] = dataclasses.field(default_factory=list)

    @classmethod
    def empty(cls, n: int) -> Output:
        """Room for n IMU samples."""
        return cls(wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n), wire.INTERFERENCE.empty(0), wire.DYNAMICS.empty(0))

    def joined(self, later: Output) -> Output:
        """This, and behind it a later one."""
        return Output(
            np.concatenate([self.attitude, later.attitude]),
            np.concatenate([self.gravity, later.gravity]),
            np.concatenate([self.interference, later.interference]),
            np.concatenate([self.dynamics, later.dynamics]),
            self.surveys + later.surveys,
            self.refusals + later.refusals,
            self.health + later.health,
            self.north + later.north,
            self.rotary + later.rotary,
        )


@dataclasses.dataclass
class Counters:
    """What was received and not used, and how often time went back."""

    imu: int = 0
    mag: int = 0
    precision: int = 0
    rejected: int = 0
    late_mag: int = 0
    spikes: int = 0
    set_back: int = 0


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

    def continue_numbering(self, last: int) -> None:
        """Number the next survey after `last` at least: what others remember of a run that this process did not see."""
        self.sequence = max(self.sequence, last)

    def reset(self) -> None:
        """Forget everything but settings, counters and the survey numbering."""
        self._clocks = Clocks()
        self._forget()

    def _forget(self) -> None:
        settings = self.settings
        self._health_params = derivation.health_params(settings)
        self._health = monitor.initial(self._health_params)
        self._spikes = spike_filter.initial()
        self._precision_health = PrecisionHealth(derivation.precision_gyro_bias(settings))
        self._faults = FaultHistory()
        self._unusable, self._contaminated = 0, False
        # Since when the magnetometer, as far as is known a sound one, has been taken in.
        self._fed_ns = np.iinfo(np.int64).max
        self._attitude = self._attitude_stream()
        self._gyro_params = derivation.gyrocompass_params(settings)
        self._station_params = derivation.station_params(settings)
        self._use_gravity(None)
        self._dynamics_state = drilling_dynamics.initial(self._dynamics_params)
        self._binners = {
            "imu": Binner(6, BIN_NS),
            "mag": Binner(3, BIN_NS),
            "precision": Binner(6, BIN_NS),
            "temperature": Binner(1, BIN_NS),
        }
        self._closed: dict[str, dict[int, Bin]] = {"mag": {}, "precision": {}, "temperature": {}}
        self._waiting: list[Bin] = []
        self._still = StillSurvey(derivation.still_params(settings))
        self._gyro = GyroStation(self._gyro_params, None, None)
        self._decision = SurveyDecision(
            self._station_params, derivation.fusion_params(settings), derivation.run_params(settings), self._faults
        )
        self._north: NorthSession | None = None
        self._ahrs = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        self._rotary: RotarySurvey | None = None
        self._precision_ns = np.zeros(0, dtype=np.int64)
        self._precision_t = np.zeros((0, 6))
        self._precision_at = 0
        self._last_imu_ns = np.iinfo(np.int64).min
        self._ready = False
        self._field = FieldReader(self._station_params, self._given)

    def set_reference(self, reference: Reference) -> None:
        """Judge and correct by this field from now on; the interference is estimated anew."""
        self._given = reference
        self._field.set_reference(reference)
        if self._ready:
            self._attitude.set_reference(reference)
            self._judge_sensors_by(reference)

    def _judge_sensors_by(self, reference: Reference | None) -> None:
        known = (reference.gravity, reference.total, reference.dip) if reference is not None else (None, None, None)
        monitor.set_reference(self._health, *known)

    @property
    def reference(self) -> Reference | None:
        """The field that azimuths and totals are judged by."""
        return self._field.reference

    @property
    def went_back(self) -> list[tuple[int, int]]:
        """Each time that time went back since the last reset: the latest stamp before that and the first after, ns."""
        return self._clocks.went_back

    @property
    def north(self) -> str:
        """The north that azimuths count from."""
        return self._field.north

    @property
    def interference(self) -> tuple[float, float] | None:
        """Axial interference and 1 sigma, T, as the last corrected station showed it."""
        return self._field.interference

    @property
    def sensor_faults(self) -> list[SensorFault]:
        """Faults of the sensors that stand now."""
        return monitor.faults(self._health) + self._precision_health.faults

    @property
    def sensors_known(self) -> dict[str, int]:
        """Conditions of units, axes and signs: UNKNOWN, OK or FAULT of `health.fault_debounce`."""
        return monitor.known(self._health)

    def request_survey(self, duration_s: float = 0.0) -> None:
        """Take a survey from the next half second on; `duration_s` 0 means as configured."""
        self._still.request(duration_s)

    def request_north(self, duration_s: float = 0.0, mode: str = "") -> None:
        """
        Seek north from now on; what it ends with comes in `Output.north`.

        Raises
        ------
        ValueError
            What is asked for cannot be sought; one is under way; the latitude is not known; no sample came yet.
        """
        latitude = latitude_of(self.settings)
        if self._north is not None:
            raise ValueError("north is already being sought")
        if latitude is None:
            raise ValueError("the latitude is not known: set place.lat_deg and place.lon_deg")
        gravity_ = self.reference.gravity if self.reference is not None else None
        params = derivation.north_params(self.settings)
        self._north = NorthSession(params, self._gyro_params, latitude, gravity_, duration_s, mode)
        self._ahrs = np.zeros(0, dtype=np.int64), np.zeros((0, 3))

    def cancel_north(self) -> None:
        """Seek it no longer."""
        self._north = None

    @property
    def north_progress(self) -> NorthProgress | None:
        """How far the seek is; None where there is none."""
        return self._north.progress() if self._north is not None else None

    def request_rotary(self, duration_s: float = 0.0) -> None:
        """
        Average from now on in axes that do not turn; what it ends with comes in `Output.rotary`.

        Raises
        ------
        ValueError
            The duration is no duration, or one is under way.
        """
        if self._rotary is not None:
            raise ValueError("a rotary survey is already being taken")
        self._rotary = RotarySurvey(derivation.rotary_params(self.settings), duration_s)

    def cancel_rotary(self) -> None:
        """Take it no longer."""
        self._rotary = None

    @property
    def rotary_progress(self) -> RotaryProgress | None:
        """How far the rotary survey is; None where there is none."""
        return self._rotary.progress() if self._rotary is not None else None

    @property
    def survey_progress(self) -> float:
        """Share of the survey under way, 0 to 1."""
        return self._still.progress

    @property
    def survey_waits_for(self) -> str:
        """What a survey that has averaged enough still waits for, in words; empty where it does not wait."""
        return "" if self._still.waits_for is None else text(self._still.waits_for)

    def push_mag(self, samples: Samples) -> None:
        """Take magnetic samples, dtype of `wire.MAG`."""
        self.counters.mag += len(samples)
        self._take_mag(self._clocks.beside("mag", samples))

    def _take_mag(self, samples: Samples) -> None:
        stamps, b_t = samples["stamp_ns"], samples["magnetic_field"]
        monitor.push_mag(self._health, stamps, b_t)
        # A field that no tool meets is another unit, none at all is no reading; the health of the sensors names it.
        usable = (np.abs(b_t) < _STRONGEST).all(axis=1) & b_t.any(axis=1)
        stamps, b_t = np.ascontiguousarray(stamps[usable]), np.ascontiguousarray(b_t[usable])
        self.counters.rejected += int(len(usable) - len(stamps))
        sound = spike_filter.run(self._spikes, stamps, b_t)
        self.counters.spikes += int(len(sound) - np.count_nonzero(sound))
        stamps, b_t = stamps[sound], b_t[sound]
        self.counters.late_mag += int((stamps <= self._last_imu_ns - self._lag_ns).sum())
        if len(stamps):
            self._fed_ns = min(self._fed_ns, int(stamps[0]))
        self._keep("mag", self._binners["mag"].add(stamps, b_t))
        self._attitude.take_mag(stamps, b_t)

    def push_precision(self, samples: Samples) -> None:
        """Take samples of the high-precision unit, dtype of `wire.IMU`."""
        self.counters.precision += len(samples)
        self._take_precision(self._clocks.beside("precision", samples))

    def _take_precision(self, samples: Samples) -> None:
        values = np.hstack([samples["angular_velocity"], samples["linear_acceleration"]])
        stamps = np.ascontiguousarray(samples["stamp_ns"])
        self._keep("precision", self._binners["precision"].add(stamps, values))
        self._precision_ns = np.concatenate([self._precision_ns[self._precision_at :], stamps])
        self._precision_t = np.concatenate([self._precision_t[self._precision_at :], values])
        self._precision_at = 0

    def push_temperature(self, samples: Samples) -> None:
        """Take temperatures, dtype of `wire.TEMPERATURE`."""
        self._take_temperature(self._clocks.beside("temperature", samples))

    def _take_temperature(self, samples: Samples) -> None:
        values = np.ascontiguousarray(samples["temperature"])[:, None]
        self._keep("temperature", self._binners["temperature"].add(np.ascontiguousarray(samples["stamp_ns"]), values))

    def push_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        """
        Take samples of the AHRS, dtype of `wire.IMU`; everything else of their time must be pushed before them.

        followed : gravity of these samples, where something else than the method followed it (a smoother).
        """
        self.counters.imu += len(samples)
        (first, new), *rest = self._clocks.lead(samples)
        if new is None:
            return self._take_imu(first, followed)
        output, place = Output.empty(0), 0
        for part, begun in [(first, new), *rest]:
            given = followed.part(slice(place, place + len(part))) if followed is not None else None
            place += len(part)
            output = output.joined(self._take_imu(part, given))
            if begun is not None:
                self._set_back(begun, output)
        return output

    def _set_back(self, begun: Samples, output: Output) -> None:
        """Begin anew with the samples that showed that time went back; their rows have been given, as not used."""
        self.counters.set_back += 1
        why = Refusal(self._last_imu_ns, Reason(ReasonCode.TIME_WENT_BACK))
        if self._still.requested:
            output.refusals.append(why)
        if self._rotary is not None:
            output.rotary.append(why)
        if self._north is not None:
            output.north.append(dataclasses.replace(self._north.solution(), reason=why.reason))
        self._forget()
        waiting = self._clocks.release()
        for name, take in (
            ("mag", self._take_mag),
            ("precision", self._take_precision),
            ("temperature", self._take_temperature),
        ):
            if name in waiting:
                take(waiting[name])
        self._take_imu(begun)

    def _take_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        n = len(samples)
        if not n:
            return Output.empty(0)
        if not self._ready:
            self._begin(int(samples["stamp_ns"][0]))
        stamps, gyro, accel = arrays_of(
            samples["stamp_ns"], samples["angular_velocity"], samples["linear_acceleration"]
        )
        found = monitor.run(self._health_params, self._health, stamps, gyro, accel)
        output = None
        # Cut where the health of a sensor changes, which is rare: from there on the estimate does without it, or anew.
        edges = sorted({0, *found.places, n})
        for start, stop in itertools.pairwise(edges):
            part = slice(start, stop)
            changes = [one for one, at in zip(found.changes, found.places, strict=True) if at == start]
            for change in changes:
                self._faults.note(change)
            self._unusable = int(found.unusable[start])
            if self._faults.misleads(changes, self._fed_ns):
                self._attitude.set_reference(self.reference)
                self._contaminated = True
            if self._contaminated and self._unusable & AZIMUTH == 0:
                self._contaminated, self._fed_ns = False, int(stamps[start])
            given = followed.part(part) if followed is not None else None
            piece = self._estimate(stamps[part], gyro[part], accel[part], found.suspect[part], given)
            piece.health = changes + piece.health
            output = piece if output is None else output.joined(piece)
        return output or Output.empty(0)

    def _estimate(
        self, stamps: Stamps, gyro: Array, accel: Array, suspect: NDArray[np.uint8], followed: Track | None
    ) -> Output:
        """Samples during which the same sensors are usable."""
        output = Output.empty(len(stamps))
        track = self._gravity.run(self._unusable, stamps, gyro, accel, followed)
        if self._north is not None:
            self._ahrs = np.concatenate([self._ahrs[0], stamps]), np.concatenate([self._ahrs[1], gyro])
        values = np.hstack([gyro, accel])
        if self.settings.health.watch:
            unsure = (suspect | np.uint8(self._unusable)) & (GYRO_BIT | ACCEL) != 0
            self._precision_health.beside(stamps, np.where(unsure[:, None], np.nan, values) if unsure.any() else values)
        readings = [(0, self._field.reading)]
        events: list[BinEvent] = []
        taken: list[tuple[int, Provisional]] = []
        doubted, doubtful = 0, bool(suspect.any())
        for closed, place in self._binners["imu"].add_placed(stamps, values):
            self._waiting.append(closed)
            # One bin late, so that the other streams of its time are there.
            if len(self._waiting) > 1:
                if doubtful:
                    self._faults.doubt(stamps[doubted:place], suspect[doubted:place])
                    doubted = place
                step, survey_ = self._judge(self._waiting.pop(0), place, output)
                if survey_ is not None:
                    taken.append((len(events), survey_))
                events.append(step)
                if self._field.reading is not readings[-1][1]:
                    readings.append((place, self._field.reading))
        if doubtful:
            self._faults.doubt(stamps[doubted:], suspect[doubted:])
        gyro = without_faulty(self._unusable, gyro)
        self._attitude.leave_out_mag(stamps, (suspect | np.uint8(self._unusable)) & MAG != 0)
        block = Block(stamps, gyro, accel, track, suspect, self._unusable, self._contaminated)
        output.interference, rejected = self._attitude.follow(
            block,
            readings,
            events,
            PrecisionRates(self._precision_ns, self._precision_t[:, :3]),
            output.attitude,
            output.gravity,
        )
        output.surveys += [self._decision.complete(one, self._attitude.propagated[at]) for at, one in taken]
        if self._rotary is not None:
            self._turn_on(self._rotary, block, output)
        self.counters.rejected += rejected
        output.dynamics = drilling_dynamics.run(
            self._dynamics_params, self._dynamics_state, stamps, gyro, accel, track.g_t, output.attitude["status"]
        )
        self._last_imu_ns = int(stamps[-1])
        return output

    @property
    def _lag_ns(self) -> int:
        return round(self.settings.tool.magnetometer.delay_s * 1e9)

    def _begin(self, first_ns: int) -> None:
        """What hangs on the day and place of the first sample."""
        if self._given is None:
            self._field.set_reference(derivation.reference(self.settings, first_ns))
        self._ready = True
        self._attitude.set_reference(self.reference)
        self._judge_sensors_by(self.reference)
        known = self.reference.gravity if self.reference is not None else None
        self._use_gravity(known)
        self._gyro = GyroStation(self._gyro_params, latitude_of(self.settings), known)

    def _use_gravity(self, known: float | None) -> None:
        """Local gravity, m/s^2, for what follows gravity; None: not known."""
        settings = self.settings
        self._gravity = GravityWithFallback(
            gravity.method(settings.gravity.method),
            derivation.gravity_params(settings, known),
            derivation.accelerometer_only_params(settings, known),
        )
        self._dynamics_params = derivation.dynamics_params(settings, known)

    def _attitude_stream(self) -> AttitudeStream:
        settings = self.settings
        return AttitudeStream(
            derivation.time_alignment_params(settings),
            derivation.interference_params(settings),
            derivation.gyro_azimuth_params(settings),
            derivation.sensor_errors(settings),
            BIN_NS,
            latitude_of(settings),
            derivation.precision_gyro_params(settings),
        )

    def _judge(self, imu: Bin, place: int, output: Output) -> tuple[BinEvent, Provisional | None]:
        """
        Everything that is done once for a bin, in the order of bins; its results hold from the sample at `place`.

        The survey of a still interval that ends with the bin is returned provisional: its continuity check needs the
        attitude up to it.
        """
        end_ns = (imu.index + 1) * BIN_NS
        found: dict[str, Bin | None] = {}
        for name, bins in self._closed.items():
            self._keep(name, self._binners[name].flush(end_ns))
            found[name] = bins.pop(imu.index, None)
            # A stream's bins close in order.
            while bins and next(iter(bins)) < imu.index:
                del bins[next(iter(bins))]
        waits_for = self._gyro.pending() if self._still.complete else None
        result = self._still.add(BinSet(imu, found["mag"], found["precision"], found["temperature"]), waits_for)
        # What the gyro had found before this bin, which ended the interval.
        so_far = self._gyro.solution() if isinstance(result, StillAverage) and result.moved else None
        still = self._still.still_bins
        # By bins, not by blocks: the same samples go into the seek however the stream is cut.
        first, self._precision_at = self._precision_at, _reached(self._precision_ns, self._precision_at, end_ns)
        samples = self._precision_ns[first : self._precision_at], self._precision_t[first : self._precision_at]
        faulty = self._judge_precision(end_ns, still > 0, samples, output)
        if not faulty:
            settled = still * BIN_NS > self.settings.survey.settle_s * 1e9
            self._gyro.add(imu, BIN_NS * 1e-9, settled, still > 0, samples)
        if self._north is not None:
            self._seek(self._north, end_ns, samples, output)
        if isinstance(result, Refusal):
            output.refusals.append(result)
        elif isinstance(result, StillAverage):
            found_north = so_far if result.moved else self._gyro.solution()
            taken = self._survey(result, found_north)
            return BinEvent(place, imu.index, end_ns, *taken.gyro, taken.accepted_azimuth), taken
        return BinEvent(place, imu.index, end_ns), None

    def _judge_precision(self, end_ns: int, still: bool, samples: tuple[Stamps, Array], output: Output) -> bool:
        """Health of the precision unit in a bin: what is named, and whether it is left out from now on."""
        if not self.settings.health.watch:
            return False
        unit = self._precision_health
        for change in unit.judge(end_ns, still, samples):
            self._faults.note(change)
            output.health.append(change)
        if not unit.heard:
            return False
        faulty = any(one.unusable for one in unit.faults)
        refusal = quoted(unit.refusal) if unit.refusal else None
        self._gyro.refuse(refusal, faulty)
        if faulty:
            samples[1][:] = math.nan
            if self._north is not None:
                ended = dataclasses.replace(self._north.solution(), reason=refusal)
                output.north.append(ended)
                self._north = None
        return faulty

    def finish(self) -> Output:
        """
        What the samples so far still hold when no more come: a survey that waited for the gyro.

        Samples may follow all the same.
        """
        output = Output.empty(0)
        held = self._still.finish()
        if held is not None:
            taken = self._survey(held, self._gyro.solution())
            output.surveys.append(self._decision.complete(taken, self._attitude.propagated_now))
        return output

    def _survey(self, still: StillAverage, found: Solution | None) -> Provisional:
        """The survey of a still interval; what it shows of the field is used from here on."""
        self.sequence += 1
        taken = self._decision.begin(still, self.sequence, self.reference, found, usable=not self._unusable)
        if taken.sound:
            self._field.learn(taken.survey, taken.analysis)
        return taken

    def _seek(self, run: NorthSession, end_ns: int, samples: tuple[Stamps, Array], output: Output) -> None:
        """A bin for the seek that was asked for, unless it began before that."""
        stamps, rates = self._ahrs
        if not len(stamps) or stamps[0] >= end_ns:
            return
        before = _reached(stamps, 0, end_ns)
        run.add(BIN_NS * 1e-9, samples, (stamps[:before], rates[:before]))
        self._ahrs = stamps[before:], rates[before:]
        if run.done:
            output.north.append(run.solution())
            self._north = None

    def _turn_on(self, survey_: RotarySurvey, block: Block, output: Output) -> None:
        """Samples for the rotary survey that was asked for."""
        result = survey_.add(block.stamps, block.gyro, block.accel, block.track, self._attitude.handed_on)
        if result is None:
            return
        self._rotary = None
        if isinstance(result, Refusal):
            output.rotary.append(result)
            return
        self.sequence += 1
        output.rotary.append(self._decision.rotary(result, self.sequence, self.reference, survey_.rotary_speed))

    def _keep(self, name: str, closed: list[Bin]) -> None:
        for one in closed:
            self._closed[name][one.index] = one


@compiled
def _reached(stamps: Stamps, start: int, end_ns: int) -> int:
    """First place from `start` on whose stamp is not before `end_ns`."""
    while start < len(stamps) and stamps[start] < end_ns:
        start += 1
    return start
