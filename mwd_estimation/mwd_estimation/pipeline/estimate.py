# SPDX-License-Identifier: Apache-2.0
"""
The stages of the estimator in the order of the signal, with the state from one start of the estimate to the next.

Health (stretches of samples with the same usable sensors) -> gravity -> half-second bins, which may take a survey and
change the field model -> attitude, in one part for each field model -> completion of the surveys -> dynamics. A step
that changes the field model belongs to the bins; a step that needs the attitude belongs after the attitude.
"""

from __future__ import annotations

import collections
import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude import drilling_dynamics, toolface_dwell
from mwd_estimation.attitude.block import Block
from mwd_estimation.attitude.continuous_attitude import AttitudeStream
from mwd_estimation.attitude.gyro_azimuth_filter import PrecisionRates, PropagatedAzimuth
from mwd_estimation.attitude.magnetic_delay import SPAN_NS, MagneticDelay
from mwd_estimation.attitude.sample import samples_of
from mwd_estimation.core import clip_flags, input_gate
from mwd_estimation.core.calibrated_range import HeatedSigmas
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.rate_jumps import RateJumps
from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import ACCEL, GYRO, MAG
from mwd_estimation.core.status import Status
from mwd_estimation.core.stream_clock import StampJitter, StreamClock
from mwd_estimation.core.time_jumps import MOST_AHEAD, advances
from mwd_estimation.core.track import Track, sample_arrays
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.gravity.bounded.field_roll import MagneticSamples
from mwd_estimation.gravity.fallback import GravityWithFallback, without_faulty
from mwd_estimation.magnetic import spike_filter
from mwd_estimation.pipeline.bin_stage import BinStage, Numbering
from mwd_estimation.pipeline.output import Output, SampleCounters
from mwd_estimation.pipeline.sensor_watch import SensorWatch, UsableStretch
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.decision import Provisional
from mwd_estimation.survey.magnetic_feedback import MagneticFeedback
from mwd_estimation.survey.static_survey import BIN_NS, Refusal
from mwd_sensors.core import input_covariance
from mwd_sensors.core.arrays import Array, Samples, Stamps

_WEAKEST = 1e-9  # a magnetic sample is a measurement only if at least one component is larger, T
# Number of samples in a row whose stamps are not later than the newest one, after which the stamps count as stopped. It
# is more than the samples of a fast unit in a second, because single stamps may be wrong by a second
# (`time_jumps.BACK_NS`).
_STANDS_STILL = 10_000
_CLIPPED, _TOOL_ASSUMED = int(Status.CLIPPED), np.uint32(Status.TOOL_ASSUMED)


class _Ahead:
    """Samples of a stream that wait until the time of the conventional unit advances."""

    def __init__(self) -> None:
        self._parts: collections.deque[Samples] = collections.deque()
        self._count = 0

    def add(self, samples: Samples) -> int:
        """Add a block; drop the oldest blocks while at least `MOST_AHEAD` samples remain; return the number dropped."""
        self._parts.append(samples)
        before = self._count = self._count + len(samples)
        while self._count - len(self._parts[0]) >= MOST_AHEAD:
            self._count -= len(self._parts.popleft())
        return before - self._count

    def take(self) -> Samples | None:
        """Remove and return all waiting samples; None if no samples wait."""
        parts = list(self._parts)
        self._parts.clear()
        self._count = 0
        return np.concatenate(parts) if len(parts) > 1 else next(iter(parts), None)


class Estimate:
    """
    State from one start of the estimate to the next.

    reference : reference that replaces the reference of the settings, or None.
    mat_tu : rotation from the axes of the unit to tool axes; the samples are in tool axes already.
    mag_late_ns : initial delay of the magnetometer's stamps; rotation of the string corrects it later.
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        reference: Reference | None,
        counters: SampleCounters,
        numbering: Numbering,
        mat_tu: Array,
        mag_late_ns: int = 0,
    ) -> None:
        self.settings, self._counters, self._given = settings, counters, reference
        self.watch = SensorWatch(settings, mat_tu)
        self.field = MagneticFeedback(derivation.station_params(settings), reference)
        self.bin_stage = BinStage(settings, self.field, self.watch.history, numbering)
        self._spikes = spike_filter.initial()
        self._jumps, self._precision_jumps = RateJumps(), RateJumps()
        self._jitter = StampJitter()
        # Largest difference between times and stamps of the conventional unit in the time span so far, ns.
        self._spread_ns = 0
        self._clock, self._mag_clock = StreamClock(), StreamClock()
        self._attitude = AttitudeStream(
            derivation.time_alignment_params(settings),
            derivation.interference_params(settings),
            derivation.gyro_azimuth_params(settings),
            derivation.sensor_errors(settings),
            settings.place.lat_deg,
        )
        self._heated = HeatedSigmas(derivation.calibrated_range(settings.tool))
        self._mag_lag_ns = round(settings.tool.magnetometer.delay_s * 1e9)
        self._use_gravity(None, MagneticSamples.none(self._mag_lag_ns))
        self._dynamics_state = drilling_dynamics.initial()
        self._dwell_state = np.zeros(1, dtype=toolface_dwell.RECORD)
        self._delay, self._delay_span, self.mag_late_ns = MagneticDelay(), 0, 0
        self._gyro_usable, self._gyro_range = True, derivation.health_params(settings).gyro_range
        self._shift_mag(mag_late_ns)
        self._ahead = {"mag": _Ahead(), "precision": _Ahead(), "temperature": _Ahead()}
        self.last_imu_ns = self._newest_ns = np.iinfo(np.int64).min
        # Stamp, rates, forces and time of the last sample, to recognise a copy of it.
        self._last: tuple[Stamps, Array, Stamps] | None = None
        self._standing = 0  # number of samples since the newest stamp
        self._ready = False
        self._statuses = StatusHistory(BIN_NS)

    def _use_gravity(self, known: float | None, mag: MagneticSamples) -> None:
        """Use the local gravity `known`, m/s^2, None if unknown, in all stages; mag: magnetic samples not used yet."""
        settings = self.settings
        self._gravity = GravityWithFallback(
            gravity.method(settings.gravity.method),
            derivation.gravity_params(settings, known),
            derivation.accelerometer_params(settings, known),
            mag,
        )
        self._dynamics_params = derivation.dynamics_params(settings, known)

    def _begin(self, first_ns: int) -> None:
        """Set reference and gravity, which depend on the place and on the date of the first sample."""
        if self._given is None:
            self.field.set_reference(derivation.reference_or_none(self.settings, first_ns))
        self._ready = True
        self._attitude.set_reference(self.field.reference)
        self.watch.set_reference(self.field.reference)
        reference = self.field.reference
        self._use_gravity(None if reference is None else reference.gravity, self._gravity.mag)

    @property
    def innovations(self) -> list[Innovation]:
        """Innovations of each source of measurements."""
        return self._gravity.innovations + self._attitude.innovations

    @property
    def samples_are(self) -> str:
        """Kind of the samples ("points") that the filter detected if `tool.samples` states another; otherwise empty."""
        return self._gravity.samples_are

    def set_reference(self, reference: Reference) -> None:
        """Use this reference for all checks and corrections from now on; restart the estimate of the interference."""
        self._given = reference
        self.field.set_reference(reference)
        if self._ready:
            self._attitude.set_reference(reference)
            self.watch.set_reference(reference)

    def take_beside(self, name: str, samples: Samples) -> None:
        """
        Accept samples of another stream: mag, precision or temperature.

        Their dtype is that of `wire.MAG`, `wire.IMU` or `wire.TEMPERATURE`. The samples wait for the next block of the
        conventional unit. If the conventional unit sends nothing, or its stamps do not advance, the oldest samples are
        rejected, because they would be paired with gravity of another time.
        """
        self._counters.rejected += self._ahead[name].add(samples)

    def take_refused(self, refused: Samples) -> None:
        """Accept the refused readings that may be in another unit of measurement, dtype of `input_gate.REFUSED`."""
        if len(refused):
            refused["stamp_ns"][refused["sensor"] == input_gate.MAG] -= self.mag_late_ns
            self.watch.take_refused(refused)
            self.bin_stage.precision.take_refused(refused)

    def _use_beside(self) -> None:
        """Pass the waiting samples of the other streams to the stages."""
        use = {"mag": self._use_mag, "precision": self._use_precision, "temperature": self._use_temperature}
        for name, ahead in self._ahead.items():
            samples = ahead.take()
            if samples is not None:
                use[name](samples)

    def _use_mag(self, samples: Samples) -> None:
        self.watch.note_declared(samples)
        sent, b_t = np.ascontiguousarray(samples["stamp_ns"]), samples["magnetic_field"]
        stamps = self._mag_clock.times(sent)
        self.watch.take_mag(stamps - self.mag_late_ns, b_t)
        usable = np.isfinite(b_t).all(axis=1) & (np.abs(b_t) > _WEAKEST).any(axis=1)
        usable &= ~input_covariance.clipped(samples, "magnetic_field").any(axis=1)
        sent, stamps, b_t = sent[usable], stamps[usable], np.ascontiguousarray(b_t[usable])
        self._counters.rejected += int(len(usable) - len(stamps))
        sound = spike_filter.run(self._spikes, stamps, b_t)
        self._counters.spikes += int(len(sound) - np.count_nonzero(sound))
        sent, stamps, b_t = sent[sound], stamps[sound], b_t[sound]
        self._counters.late_mag += int((sent <= self.last_imu_ns - self._mag_lag_ns).sum())
        if len(stamps):
            self.watch.mag_used(int(stamps[0]))
        self.bin_stage.streams.add("mag", stamps, b_t)
        self.bin_stage.turning.take_mag(stamps, b_t)
        time = sent - self.mag_late_ns, stamps - self.mag_late_ns
        self._attitude.take_mag(time, b_t)
        self._delay.take_mag(time[1], b_t)
        self._gravity.take_mag(time, b_t)

    def _use_precision(self, samples: Samples) -> None:
        stamps = np.ascontiguousarray(samples["stamp_ns"])
        rates = self._precision_jumps.without(stamps, np.ascontiguousarray(samples["angular_velocity"]))
        values = np.hstack([rates, samples["linear_acceleration"]])
        self.bin_stage.streams.add("precision", stamps, values)
        self.bin_stage.precision.take(stamps, values, clip_flags.of(samples))

    def _use_temperature(self, samples: Samples) -> None:
        values = np.ascontiguousarray(samples["temperature"])[:, None]
        self.bin_stage.streams.add("temperature", np.ascontiguousarray(samples["stamp_ns"]), values)
        self._heated.take(samples["stamp_ns"], samples["temperature"])

    def take_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        """
        Process samples of the conventional unit, dtype of `wire.IMU`, and return their output.

        followed: gravity of these samples from a smoother; None: estimate the gravity here.
        """
        if not len(samples):
            return Output.empty(0)
        self._standing = 0 if samples["stamp_ns"].max() > self.last_imu_ns else self._standing + len(samples)
        if self._standing < _STANDS_STILL:
            self._use_beside()
        if not self._ready:
            self._begin(int(samples["stamp_ns"][0]))
        self.watch.note_declared(samples)
        sent, gyro, accel = sample_arrays(
            samples["stamp_ns"], samples["angular_velocity"], samples["linear_acceleration"]
        )
        # From here on a sample has the time at which it was measured; the rows get the stamps of the messages again.
        stamps, sigma = self._times(sent, np.hstack([gyro, accel]))
        clipped = clip_flags.of(samples)
        spans = stamps // SPAN_NS
        cuts = [0, *(np.flatnonzero(np.diff(spans)) + 1), len(spans)]
        pieces: list[Output] = []
        for start, stop in itertools.pairwise(cuts):
            self._correct_delay(int(spans[start]))
            part = slice(start, stop)
            self._spread_ns = max(self._spread_ns, int(np.abs(stamps[part] - sent[part]).max()))
            given = followed.part(part) if followed is not None else None
            stretches = self.watch.stretches(stamps[part], gyro[part], accel[part])
            beside = sent[part], sigma[part], clipped[part]
            pieces += [self._run_stages(stretch, beside, given) for stretch in stretches]
        output, *rest = pieces
        for piece in rest:
            output = output.joined(piece)
        return output

    def _times(self, sent: Stamps, values: Array) -> tuple[Stamps, Array]:
        """
        Return the times at which samples were measured, ns, and 1 sigma of the error of their stamps, s.

        A copy of the sample before it (same stamp and values) gets the time of this sample, so that it is rejected.
        sent: stamps, ns, shape (n,); values: rates and forces, shape (n, 6).
        """
        first = self._last or (sent[:0], values[:0], sent[:0])
        before = len(first[0])
        stamps, rows = np.concatenate([first[0], sent]), np.concatenate([first[1], values])
        copy = np.flatnonzero(np.diff(stamps) == 0) + 1
        copy = copy[(rows[copy] == rows[copy - 1]).all(axis=1)] - before
        # The clock ignores a stamp that goes back.
        counted = sent if not len(copy) else sent.copy()
        counted[copy] -= 1
        times, sigma = self._clock.times(counted), self._jitter.sigma(counted)
        for k in copy.tolist():
            times[k] = times[k - 1] if k > 0 else first[2][0]
        self._last = sent[-1:], values[-1:], times[-1:]
        return times, sigma

    def _measure_delay(self, stretch: UsableStretch, track: Track, rate_x: Array, later: NDArray[np.bool_]) -> None:
        """
        Measure the delay of the magnetometer's stamps with gravity and the rate about x.

        Samples are left out while gyro or accelerometer is doubtful. When the gyro becomes unusable, the measurement
        begins anew. rate_x, shape (n,): rad/s, NaN while the gyro must not be used; later, shape (n,): whether a stamp
        is later than all earlier ones.
        """
        usable = stretch.unusable & GYRO == 0
        if self._gyro_usable and not usable:
            self._delay.begin_anew()
        self._gyro_usable = usable
        rate_x = np.where(track.status & _CLIPPED != 0, np.nan, rate_x)
        # Skip samples of doubtful sensors: a wrong delay would stay until the rotary speed changes again.
        later = later & (stretch.suspect & (GYRO | ACCEL) == 0)
        self._delay.take(stretch.stamps[later], track.g_t[later], rate_x[later])

    def _correct_delay(self, span: int) -> None:
        """At the start of a new time span (index `span`), estimate and correct the delay of the magnetometer."""
        if span > self._delay_span:
            self._delay_span = span
            self._shift_mag(self._delay.judge(span * SPAN_NS))
            # Uneven stamps of both streams: a magnetic sample arrives later after its time than after its stamp.
            self.watch.shift_mag(0, max(self.mag_late_ns, 0) + 2 * self._spread_ns)
            self._spread_ns = 0

    def _shift_mag(self, late_ns: int) -> None:
        """
        Add `late_ns` to the delay of the magnetometer, and subtract it from the stamps of waiting magnetic samples.

        The estimate of the interference is discarded. Nothing changes if `late_ns` is 0.
        """
        if late_ns:
            self.mag_late_ns += late_ns
            # Wait longer by the delay, so that the pairing of IMU and magnetic samples does not depend on arrival
            # times.
            wait_ns = max(self.mag_late_ns, 0)
            self._delay.shift(late_ns)
            self.watch.shift_mag(late_ns, wait_ns)
            self._attitude.shift_mag(late_ns, wait_ns)
            self._gravity.shift_mag(late_ns, self._mag_lag_ns + wait_ns)
            # Discard the estimate of the interference: it comes from fields that were paired with wrong toolfaces.
            self._attitude.restart_field()

    def _run_stages(
        self, stretch: UsableStretch, beside: tuple[Stamps, Array, NDArray[np.uint8]], followed: Track | None
    ) -> Output:
        """
        Run all stages on a stretch of samples with the same usable sensors, and return its output.

        beside: stamps of the messages, ns, 1 sigma of their error, s, and clip flags, of the whole block; followed:
        gravity of the whole block from a smoother, or None.
        """
        sent, sigma, clipped = beside[0][stretch.part], beside[1][stretch.part], beside[2][stretch.part]
        output = Output.empty(len(stretch.stamps))
        output.health += stretch.changes
        if stretch.begins_contamination:
            self._attitude.set_reference(self.field.reference)
        stretch = dataclasses.replace(stretch, gyro=self._jumps.without(stretch.stamps, stretch.gyro))
        stamps, accel, unusable = stretch.stamps, stretch.accel, stretch.unusable
        # Estimate gravity.
        faulty_mag = (stretch.suspect | np.uint8(unusable)) & MAG != 0
        self._gravity.mag._replace(due_ns=sent).leave_out(stamps, faulty_mag)
        given = followed.part(stretch.part) if followed is not None else None
        track = self._gravity.run(unusable, (sent, stamps), stretch.gyro, accel, clipped, given)
        if self.settings.tool.accelerometer.assumed:
            track.status[:] |= _TOOL_ASSUMED
        toolface_dwell.run(derivation.dwell_params(self.settings), self._dwell_state, stamps, track)
        # Do not store samples whose stamps do not advance: their number has no limit.
        later = advances(stamps, self._newest_ns)
        self._newest_ns = max(self._newest_ns, int(stamps.max()))
        # Close the bins that end here, and begin their surveys.
        bins = self.bin_stage.close_bins(stretch, later, clipped, output)
        # Estimate the attitude.
        gyro = without_faulty(unusable, stretch.gyro, self._gyro_range)
        self._measure_delay(stretch, track, gyro[:, 0], later)
        self._attitude.leave_out_mag((sent, stamps), faulty_mag)
        samples = samples_of((sent, stamps), gyro, accel, track, stretch.suspect)
        # 1 sigma of the toolface from the error of the stamp, rad.
        turned = sigma * np.abs(track.rotary_speed)
        samples["turned"] = turned
        samples["sigma_toolface"] = np.minimum(np.hypot(samples["sigma_toolface"], turned), np.pi)
        block = Block(samples, unusable, stretch.contaminated)
        rates = PrecisionRates(*self.bin_stage.precision.rates)
        output.interference, rejected = self._attitude.follow(
            block, bins.models, bins.events, rates, output.attitude, output.gravity
        )
        self._counters.rejected += rejected
        self._heated.widen(output.attitude, output.gravity, self.field.reference)
        # Complete the surveys: the attitude up to their end is known now.
        self._statuses.add(output.attitude["status"], [(event.place, event.end_ns) for event in bins.events])
        propagated = self._attitude.propagated
        output.surveys += [self._completed(taken, propagated[at]) for at, taken in bins.taken]
        ended = self.bin_stage.requests.average(samples, self._attitude.handed_on)
        if ended is not None:
            average, rotary_speed = ended
            if isinstance(average, Refusal):
                output.rotary_refusals.append(average)
            else:
                output.surveys.append(self._with_status(self.bin_stage.rotary(average, rotary_speed)))
        # Summarise the drilling dynamics.
        output.dynamics = drilling_dynamics.run(self._dynamics_params, self._dynamics_state, samples, output.attitude)
        self.last_imu_ns = max(self.last_imu_ns, int(sent.max()))
        return output

    def end_requests(self, why: Reason, output: Output) -> None:
        """End all open requests: add their refusals, with the reason `why`, to the output."""
        refusal, requests = Refusal(self.last_imu_ns, why), self.bin_stage.requests
        if self.bin_stage.still.requested:
            output.refusals.append(refusal)
        if requests.rotary_progress is not None:
            output.rotary_refusals.append(refusal)
        ended = requests.end_north(why)
        output.north += [ended] if ended is not None else []

    def finish(self) -> Output:
        """
        Return an output without rows, with the survey that waits for the gyro if there is one.

        Call this method at the end of the data.
        """
        self._use_beside()
        output = Output.empty(0)
        held = self.bin_stage.finish()
        if held is not None:
            output.surveys.append(self._completed(held, self._attitude.propagated_now))
        return output

    def _completed(self, taken: Provisional, propagated: PropagatedAzimuth) -> DecidedSurvey:
        """Return a completed survey; propagated: azimuths propagated by the gyros to its time."""
        return self._with_status(self.bin_stage.decision.complete(taken, propagated))

    def _with_status(self, survey: DecidedSurvey) -> DecidedSurvey:
        return dataclasses.replace(survey, status=self._statuses.at(survey.end_ns))


# Status of the attitude at the end of each bin, for surveys that are completed later.


# Number of bins whose status is kept (ten minutes): a survey waits a shorter time for the gyro.
_KEPT = 1200
_SLACK_NS = 1_000_000  # tolerance for the end of a survey, ns: more than its rounding error


class StatusHistory:
    """History of the attitude status, which does not depend on how the stream is cut; bin_ns: length of a bin."""

    def __init__(self, bin_ns: int) -> None:
        self._bin_ns = bin_ns
        self._last = 0
        self._kept: collections.deque[tuple[int, int]] = collections.deque(maxlen=_KEPT)

    def add(self, status: Samples, bins: list[tuple[int, int]]) -> None:
        """
        Add the status of the rows of a block.

        bins : for each bin event of the block, the index of the row before which the event is evaluated, and the end of
        its bin, ns. An event is one bin late, so the row before it is the last one of the next bin.
        """
        for place, end_ns in bins:
            # Row `place` - 1 is the last row of the bin after the bin of the event.
            self._kept.append((end_ns + self._bin_ns, int(status[place - 1]) if place else self._last))
        if len(status):
            self._last = int(status[-1])

    def at(self, end_ns: int) -> int:
        """Return the status of the last row in the bin that ends at a time, ns, or else of the last earlier row."""
        for known_ns, status in reversed(self._kept):
            if known_ns <= end_ns + _SLACK_NS:
                return status
        return self._last
