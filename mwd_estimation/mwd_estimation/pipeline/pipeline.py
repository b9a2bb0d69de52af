# SPDX-License-Identifier: Apache-2.0
"""
The estimator: samples in, attitude and surveys out; the live node, replay and batch use the same object.

Blocks may have any length. The output has the same bits for any cut of the streams into blocks and for any order of the
topics, if each magnetic sample arrives at most `tool.magnetometer.delay_s` after its stamp.

Values first pass the gate (`core.input_gate`). Then the pipeline checks their time: if time goes back (a recording that
loops or is rewound), the estimate restarts. The estimate also restarts if covariances state more noise than the tool's
settings. The next stages, in the order of the signal, are in `estimate`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from mwd_estimation.attitude import time_alignment
from mwd_estimation.core.calibrated_range import TemperatureWatch
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.input_gate import InputGate
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.core.time_jumps import Clocks
from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded.params import BoundedParams
from mwd_estimation.pipeline.bin_stage import Numbering
from mwd_estimation.pipeline.estimate import Estimate
from mwd_estimation.pipeline.output import Output, SampleCounters
from mwd_estimation.pipeline.requests import Requests
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.static_survey import StillSurvey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.input_covariance import VECTORS, NoiseWatch, StatedNoise
from mwd_sensors.core.mount import Mount, resolve


class Pipeline:
    """
    The estimator of one well.

    Parameters
    ----------
    reference : Reference, optional
        Reference that replaces the reference of the settings, such as a field measured before the run.
    mount : Mount, optional
        Mount of the units in the tool; by default from the settings, without frames and static transforms.
    noise : mapping of StatedNoise, optional
        Noise of each vector that covariances stated before (`input_covariance.NoiseWatch`); used from the start.

    Raises
    ------
    ValueError
        If the settings do not allow an estimate: a file cannot be read, or the place has no field.
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        reference: Reference | None = None,
        mount: Mount | None = None,
        noise: Mapping[str, StatedNoise] | None = None,
    ) -> None:
        derivation.check(settings)
        self.settings = settings
        self.mount = mount or resolve(settings.tool.mount)
        #: The gate that all samples pass. Samples may pass the gate before they are pushed: passing the gate twice
        #: changes nothing.
        self.gate = InputGate(derivation.input_ranges(settings))
        self.counters = SampleCounters()
        self._numbering = Numbering()
        self.given_reference = reference  #: the reference that replaces the reference of the settings, if any
        #: `noise_notes`: a sentence for each vector whose stated noise is larger than that of the tool's settings and
        #: is therefore used.
        self._with_noise, self.noise_notes = with_noise(settings, noise or {})
        self._onset = NoiseOnset(noise or {}, round(settings.tool.magnetometer.delay_s * 1e9))
        #: Temperatures outside the range of the calibration, at which the sigmas are increased.
        self.temperature = TemperatureWatch(derivation.calibrated_range(settings.tool))
        self.reset()

    def reset(self) -> None:
        """
        Restart the estimate, and discard the times of the streams.

        Settings, mount, counters, survey numbering, a given reference and stated noise are kept.
        """
        self._clocks = Clocks()
        # Output of a restart between two blocks of the conventional unit.
        self._ended: Output | None = None
        self._begin_anew()

    def _begin_anew(self, mag_late_ns: int = 0) -> None:
        self._onset.forget()
        self._new_estimate(mag_late_ns)

    def _new_estimate(self, mag_late_ns: int) -> None:
        mat_tu = self.mount.imu
        given = self.given_reference
        self._estimate = Estimate(self._with_noise, given, self.counters, self._numbering, mat_tu, mag_late_ns)
        self._estimate.watch.expect_mag(expected="mag" not in self.mount.unusable)

    def push_mag(self, samples: Samples) -> None:
        """
        Accept magnetic samples, dtype of `wire.MAG`, in axes of the unit.

        The samples are not used if the mount of the magnetometer is unknown.
        """
        if "mag" not in self.mount.unusable:
            self.counters.mag += len(samples)
            self._onset.take_mag(samples)
            self._take_beside("mag", self.mount.mag_in_tool(self.gate.mag(samples)))

    def push_precision(self, samples: Samples) -> None:
        """
        Accept samples of the precision unit, dtype of `wire.IMU`, in axes of the unit.

        The samples are not used if the mount of the precision unit is unknown.
        """
        if "precision" not in self.mount.unusable:
            self.counters.precision += len(samples)
            self._take_beside("precision", self.mount.precision_in_tool(self.gate.precision(samples)))

    def push_temperature(self, samples: Samples) -> None:
        """Accept temperatures, dtype of `wire.TEMPERATURE`."""
        samples = self.gate.temperature(samples)
        self.temperature.take(samples["temperature"])
        self._take_beside("temperature", samples)

    def _take_beside(self, name: str, samples: Samples) -> None:
        samples = self._clocks.beside(name, samples)
        if self._clocks.hidden_jump:
            self._clocks.hidden_jump = False
            self._ended = self._ended or Output.empty(0)
            self._estimate.end_requests(Reason(ReasonCode.TIME_WENT_BACK), self._ended)
            self.counters.set_back += 1
            self._begin_anew(self.mag_late_ns)
        self._hand_on(name, samples)

    def _hand_on(self, name: str, samples: Samples) -> None:
        self._estimate.take_beside(name, self._onset.keep_beside(name, samples))

    def push_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        """
        Process samples of the conventional unit, dtype of `wire.IMU`, in axes of the unit, and return their output.

        Push the samples of all other streams of the same time first.

        followed : gravity of these samples in tool axes, if another method (a smoother) has already estimated it.
        """
        if "imu" in self.mount.unusable:
            return Output.empty(0)
        self._onset.take_imu(samples)
        samples = self.mount.imu_in_tool(self.gate.imu(samples))
        self._estimate.take_refused(self.gate.take_refused())
        self.counters.imu += len(samples)
        ended, self._ended = self._ended, None
        output = self._push_leader(samples, followed)
        return output if ended is None else ended.joined(output)

    def _push_leader(self, samples: Samples, followed: Track | None) -> Output:
        """Process samples of the conventional unit after gate and mount, cut where time jumps; return their output."""
        before_ns = self._clocks.lead_ns
        (first, new), *rest = self._clocks.lead(samples)
        if new is None:
            for name, waiting in self._clocks.reached(before_ns).items():
                self._hand_on(name, waiting)
            return self._take_imu(first, followed)
        output, place = Output.empty(0), 0
        for part, begun in [(first, new), *rest]:
            given = followed.part(slice(place, place + len(part))) if followed is not None else None
            place += len(part)
            output = output.joined(self._take_imu(part, given))
            if begun is not None:
                self._estimate.end_requests(Reason(ReasonCode.TIME_WENT_BACK), output)
                self._set_back(begun)
        return output

    def _take_imu(self, samples: Samples, followed: Track | None) -> Output:
        """Process samples without a jump back of time, cut where the stated noise changes; return their output."""
        output: Output | None = None
        while True:
            count, noise = self._onset.next_change(samples)
            part = samples[:count]
            self._onset.keep_imu(part, followed)
            taken = self._estimate.take_imu(part, followed)
            output = taken if output is None else output.joined(taken)
            if noise is None:
                return output
            self._set_noise(noise, output)
            samples = samples[count:]
            followed = followed.part(slice(count, None)) if followed is not None else None

    def _set_back(self, begun: Samples) -> None:
        """
        Restart the estimate with the samples that confirmed the jump back of time.

        Their rows were already output as rejected, so they give no output here.
        """
        self.counters.set_back += 1
        self._begin_anew(self.mag_late_ns)
        for name, waiting in self._clocks.release().items():
            self._hand_on(name, waiting)
        self._onset.keep_imu(begun, None)
        self._estimate.take_imu(begun)

    def set_mount(self, mount: Mount) -> None:
        """Use this mount from now on; if it changes the axes of the conventional unit, the estimate restarts."""
        before, self.mount = self.mount, mount
        self._estimate.watch.expect_mag(expected="mag" not in mount.unusable)
        if not np.array_equal(before.imu, mount.imu):
            self.reset()

    def _set_noise(self, stated: Mapping[str, StatedNoise], output: Output) -> None:
        """
        Use the noise stated by covariances if it is larger than that of the tool's settings.

        If this changes the settings, requests end and the estimate restarts. The new estimate processes the kept
        samples again. They were already output and counted, so they give no further rows and the counters are restored.
        """
        self._onset.count(stated)
        settings, self.noise_notes = with_noise(self.settings, stated)
        if settings == self._with_noise:
            return
        self._with_noise = settings
        self._estimate.end_requests(Reason(ReasonCode.NOISE_STATED), output)
        kept, counted = self._onset.begin_again(self.last_imu_ns), dataclasses.astuple(self.counters)
        self._new_estimate(self.mag_late_ns)
        for name, samples in kept.beside:
            self._estimate.take_beside(name, samples)
        for samples, followed in kept.imu:
            self._estimate.take_imu(samples, followed)
        for field, count in zip(dataclasses.fields(self.counters), counted, strict=True):
            setattr(self.counters, field.name, count)

    def finish(self) -> Output:
        """
        Return an output without rows, with the survey that waits for the gyro if there is one.

        Call this method at the end of the data; more samples may still follow.
        """
        return self._estimate.finish()

    def revisions(self) -> dict[int, DecidedSurvey]:
        """Return the surveys, by number, whose result has changed since publication; see `SurveyDecision.revisions`."""
        return self._estimate.bin_stage.decision.revisions()

    def judging_again(self, newest: int) -> Callable[[], dict[int, DecidedSurvey]]:
        """
        Return a function that decides the newest surveys again with the present state of the run.

        newest: number of surveys. The function may be called in another thread.
        """
        return self._estimate.bin_stage.decision.judging_again(newest)

    def set_reference(self, reference: Reference) -> None:
        """Use this reference for all checks and corrections from now on; restart the estimate of the interference."""
        self.given_reference = reference
        self._estimate.set_reference(reference)

    def request_survey(self, duration_s: float = 0.0) -> None:
        """
        Take a survey from the next half second on; arguments and errors as in `StillSurvey.request`.

        The result is in `Output.surveys`, or in `Output.refusals`.
        """
        self.still.request(duration_s)

    def request_north(self, duration_s: float = 0.0, mode: str = "") -> None:
        """
        Seek north from now on; arguments and errors as in `Requests.start_north`.

        The result is in `Output.north`.
        """
        self.requests.start_north(duration_s, mode)

    @property
    def requests(self) -> Requests:
        """The requested north seek and rotary survey, with their progress."""
        return self._estimate.bin_stage.requests

    @property
    def still(self) -> StillSurvey:
        """The current survey at rest, with its progress and the condition for which it waits."""
        return self._estimate.bin_stage.still

    @property
    def sequence(self) -> int:
        """Number of the last survey."""
        return self._numbering.last

    def continue_numbering(self, last: int) -> None:
        """Number the next survey after `last`, the last number of an earlier process; numbers never go back."""
        self._numbering.last = max(self._numbering.last, last)

    @property
    def reference(self) -> Reference | None:
        """The reference with which azimuths and totals are checked; None if it is not known."""
        return self._estimate.field.reference

    @property
    def north(self) -> str:
        """The north from which azimuths are counted: magnetic, true or grid."""
        return self._estimate.field.north

    @property
    def went_back(self) -> list[tuple[int, int]]:
        """Latest stamp before and first stamp after each jump back of time since the last reset, ns."""
        return self._clocks.went_back

    @property
    def of_no_time(self) -> int:
        """Number of samples of other streams that were dropped because their time does not match the IMU's."""
        return self._clocks.dropped

    @property
    def innovations(self) -> list[Innovation]:
        """Innovations of each source of measurements since the estimate began."""
        return self._estimate.innovations

    @property
    def mag_late_ns(self) -> int:
        """Delay of the magnetometer's stamps relative to the IMU's, as found and corrected, ns; negative if early."""
        return self._estimate.mag_late_ns

    @property
    def samples_are(self) -> str:
        """Kind of the samples according to the data ("points"), if it differs from `tool.samples`; otherwise empty."""
        return self._estimate.samples_are

    @property
    def last_imu_ns(self) -> int:
        """Stamp of the last sample of the IMU, ns; the smallest integer before the first sample."""
        return int(self._estimate.last_imu_ns)

    @property
    def sensor_faults(self) -> list[SensorFault]:
        """Present faults of the sensors."""
        return self._estimate.watch.faults + self._estimate.bin_stage.precision.faults

    @property
    def sensors_known(self) -> dict[str, int]:
        """State of the checks of units of measurement, axes and signs by name, as in `health.fault_debounce`."""
        return self._estimate.watch.known


# Noise that covariances state: the time from which it is used, and the samples with which the estimate then restarts.


# An estimate younger than this, ns, restarts with its first sample: it is too young for a survey to be lost or taken
# twice. An older estimate restarts with the next sample.
_YOUNG_NS = 2_000_000_000
# Largest number of samples kept of each stream: 2 s of a unit of 10 kHz. It also holds while the stamps do not advance.
_MOST = 20_000
_ALL = sum(len(vectors) for vectors in VECTORS.values())  # number of vectors whose noise may be stated
_MAG = "magnetic_field"


class KeptSamples(NamedTuple):
    """Samples with which an estimate restarts."""

    imu: list[tuple[Samples, Track | None]]  #: samples of the conventional unit, and their gravity from a smoother
    beside: list[tuple[str, Samples]]  #: samples of the other streams (mag, precision, temperature), by name


class NoiseOnset:
    """
    Noise that covariances state for the conventional unit and the magnetometer, and the samples for a restart.

    known: noise of each vector that is used from the first sample on; mag_delay_ns: time after its stamp at which a
    magnetic sample has arrived.
    """

    def __init__(self, known: Mapping[str, StatedNoise], mag_delay_ns: int) -> None:
        self._watch, self._delay_ns = NoiseWatch(known), mag_delay_ns
        self._counting = set(known)
        self.forget()

    def forget(self) -> None:
        """Discard the kept samples, because the estimate restarts for another reason."""
        self._begun_ns: int | None = None
        # Samples of other streams are used from this stamp on, ns; None: all.
        self._from_ns: int | None = None
        self._imu: list[tuple[Samples, Track | None]] = []
        self._beside: dict[str, Samples] = {}

    def take_mag(self, samples: Samples) -> None:
        """Read the noise that the covariances of magnetic samples state."""
        self._watch.take(samples, wire.MAG.type_name)

    def take_imu(self, samples: Samples) -> None:
        """Read the noise that the covariances of samples of the conventional unit state."""
        self._watch.take(samples, wire.IMU.type_name)

    def next_change(self, samples: Samples) -> tuple[int, Mapping[str, StatedNoise] | None]:
        """
        Return the number of these samples of the conventional unit that come before the next change of the noise.

        Also return the noise of each vector from that change on; None if the noise does not change within the samples.
        """
        known_ns = {
            vector: ns + (self._delay_ns if vector == _MAG else 0)
            for vector, ns in self._watch.known_ns.items()
            if vector not in self._counting
        }
        if not known_ns:
            return len(samples), None
        due_ns = min(known_ns.values())
        later = np.flatnonzero(samples["stamp_ns"] > due_ns)
        if not len(later):
            return len(samples), None
        counting = self._counting | {vector for vector, ns in known_ns.items() if ns == due_ns}
        return int(later[0]), {vector: self._watch.noise[vector] for vector in counting}

    def keep_imu(self, samples: Samples, followed: Track | None) -> None:
        """Keep samples of the conventional unit while the estimate is young and the noise may still change."""
        if len(samples) and len(self._counting) < _ALL:
            last_ns = int(samples["stamp_ns"][-1])
            self._begun_ns = int(samples["stamp_ns"][0]) if self._begun_ns is None else self._begun_ns
            count = sum(len(part) for part, _ in self._imu) + len(samples)
            if last_ns - self._begun_ns <= _YOUNG_NS and count <= _MOST:
                self._imu.append((samples, followed))
            else:
                self._imu = []
                self._beside = {name: part[part["stamp_ns"] > last_ns] for name, part in self._beside.items()}

    def keep_beside(self, name: str, samples: Samples) -> Samples:
        """
        Keep samples of another stream until the IMU samples of their time are no longer kept.

        Returns the samples that the present estimate uses.
        """
        used = samples if self._from_ns is None else samples[samples["stamp_ns"] > self._from_ns]
        if len(self._counting) < _ALL:
            self._beside[name] = np.concatenate([self._beside.get(name, used[:0]), used])[-_MOST:]
        return used

    def count(self, noise: Mapping[str, StatedNoise]) -> None:
        """Record that the noise of these vectors is used from now on."""
        self._counting = set(noise)

    def begin_again(self, last_ns: int) -> KeptSamples:
        """
        Return the kept samples for an estimate that restarts.

        If no samples of the conventional unit are kept, samples of other streams up to `last_ns`, ns, the stamp of the
        last processed sample, are not used again. If the noise of all vectors is known, nothing is kept any more.
        """
        kept = KeptSamples(list(self._imu), list(self._beside.items()))
        if not self._imu:
            self._begun_ns, self._from_ns = None, last_ns
        if len(self._counting) == _ALL:
            self._imu, self._beside = [], {}
        return kept


# Settings of the tool with the noise that the covariances of its samples state.


# Smallest ratio of the stated noise of a gyro to the noise in the settings at which the stated noise is used. A data
# sheet states the noise density; a driver states the noise of a sample after the filter of the sensor. The density
# computed from such a sample is about twice the real density (filter of first order, 255 Hz, read at 100 Hz).
_LARGER = 3.0
# Accelerometer noise density that the bounded filter assumes, m/s^2/sqrt(Hz); a smaller stated noise changes nothing.
_ACCEL_NOISE = BoundedParams().accel_noise


def with_noise(settings: EstimatorSettings, stated: Mapping[str, StatedNoise]) -> tuple[EstimatorSettings, list[str]]:
    """
    Return settings with the noise that covariances state, where it is larger than the noise in the settings.

    Parameters
    ----------
    stated : mapping
        Noise of each vector of the messages, by field name, from `input_covariance.NoiseWatch`.

    Returns
    -------
    settings : EstimatorSettings
        The given settings, with larger gyro noise and larger biases of accelerometer and magnetometer where needed.
    notes : list of str
        One sentence for each vector whose stated noise is used; empty if the settings stay the same.
    """
    tool, notes = settings.tool, []
    gyro, accel, mag = (
        stated.get(vector, StatedNoise()) for vector in ("angular_velocity", "linear_acceleration", "magnetic_field")
    )
    gyro_noise, mag_bias = tool.gyro.noise_deg_sqrt_h, tool.magnetometer.bias_nt
    accel_bias = tool.accelerometer.bias_ug
    taken = "more than the settings of the tool; the sigmas are widened accordingly"
    # Averaging time of the continuous attitude, s, which is shorter than the averaging time of a station.
    seconds = max(2.0 * time_alignment.TimeAlignmentParams().smoothing_s, accel.period_s, mag.period_s)
    density = math.degrees(gyro.density) * 60.0
    if density > _LARGER * gyro_noise:
        gyro_noise = density
        notes.append(f"the covariance of angular_velocity states {density:.2g} deg/sqrt(h), {taken}")
    if accel.density > _ACCEL_NOISE:
        accel_bias = math.hypot(accel_bias, accel.density / STANDARD_GRAVITY / math.sqrt(seconds) * 1e6)
        notes.append(f"the covariance of linear_acceleration states {accel.sigma:.2g} m/s^2 per sample, {taken}")
    if mag.sigma * 1e9 > mag_bias:
        mag_bias = math.hypot(mag_bias, mag.density * 1e9 / math.sqrt(seconds))
        notes.append(f"the covariance of magnetic_field states {mag.sigma * 1e9:.0f} nT per sample, {taken}")
    if not notes:
        return settings, notes
    tool = dataclasses.replace(
        tool,
        gyro=dataclasses.replace(tool.gyro, noise_deg_sqrt_h=gyro_noise),
        accelerometer=dataclasses.replace(tool.accelerometer, bias_ug=min(accel_bias, 1e5)),
        magnetometer=dataclasses.replace(tool.magnetometer, bias_nt=min(mag_bias, 1e4)),
    )
    return dataclasses.replace(settings, tool=tool), notes
