# SPDX-License-Identifier: Apache-2.0
"""
The estimator: samples in, attitude and surveys out; one object for the live node, replay and batch.

Blocks may have any length; the output is the same bits however the streams are cut, and whatever the order in which
topics arrive, as long as a magnetic sample is there `tool.magnetometer.delay_s` after its stamp.

Values pass the gate (`core.input_gate`) before anything else sees them. The pipeline admits samples in time: where time
goes back (a recording that loops or is wound back) the estimate begins anew. The stages behind that, in the order of
the signal, are those of `estimate`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mwd_estimation.core.calibrated_range import TemperatureWatch
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.input_gate import InputGate
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.core.time_jumps import Clocks
from mwd_estimation.core.track import Track
from mwd_estimation.pipeline.bin_stage import Numbering
from mwd_estimation.pipeline.estimate import Estimate
from mwd_estimation.pipeline.output import Counters, Output
from mwd_estimation.pipeline.requests import Requests
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.stated_noise import with_noise
from mwd_estimation.survey.static_survey import StillSurvey
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.input_covariance import Noise
from mwd_sensors.core.mount import Mount, resolve


class Pipeline:
    """
    The estimator of one well.

    Parameters
    ----------
    settings : EstimatorSettings
    reference : Reference, optional
        Overrides the settings, for a field measured beforehand.
    mount : Mount, optional
        How the units sit in the tool; by default as the settings say without frames and static transforms.

    Raises
    ------
    ValueError
        Settings that no estimate can be made with: a file that cannot be read, a place without a field.

    Attributes
    ----------
    noise_notes : list of str
        A sentence for each vector whose stated noise is larger than the tool's and is taken (`set_noise`).
    gate : InputGate
        The gate that all samples pass. Samples that are used elsewhere too may pass it before they are pushed: what
        has passed passes again as it is.
    temperature : TemperatureWatch
        Temperatures beyond those of the calibration, where the sigma of surveys is widened.
    """

    def __init__(
        self, settings: EstimatorSettings, reference: Reference | None = None, mount: Mount | None = None
    ) -> None:
        derivation.check(settings)
        self.settings = settings
        self.mount = mount or resolve(settings.tool.mount)
        self.gate = InputGate(derivation.input_ranges(settings))
        self.counters = Counters()
        self._numbering = Numbering()
        self._given = reference
        self._with_noise = settings
        self.noise_notes: list[str] = []
        self.temperature = TemperatureWatch(derivation.calibrated_range(settings.tool))
        self.reset()

    def reset(self) -> None:
        """Forget everything but settings, counters and the survey numbering."""
        self._clocks = Clocks()
        self._begin_anew()

    def _begin_anew(self, mag_late_ns: int = 0) -> None:
        mat_tu = self.mount.imu
        self._estimate = Estimate(self._with_noise, self._given, self.counters, self._numbering, mat_tu, mag_late_ns)
        self._estimate.watch.expect_mag(expected="mag" not in self.mount.unusable)

    def push_mag(self, samples: Samples) -> None:
        """Take magnetic samples, dtype of `wire.MAG`, in axes of the unit; left out where its mount is not known."""
        if "mag" not in self.mount.unusable:
            self.counters.mag += len(samples)
            self._take_beside("mag", self.mount.mag_in_tool(self.gate.mag(samples)))

    def push_precision(self, samples: Samples) -> None:
        """Take samples of the high-precision unit, dtype of `wire.IMU`; left out where its mount is not known."""
        if "precision" not in self.mount.unusable:
            self.counters.precision += len(samples)
            self._take_beside("precision", self.mount.precision_in_tool(self.gate.precision(samples)))

    def push_temperature(self, samples: Samples) -> None:
        """Take temperatures, dtype of `wire.TEMPERATURE`."""
        samples = self.gate.temperature(samples)
        self.temperature.take(samples["temperature"])
        self._take_beside("temperature", samples)

    def _take_beside(self, name: str, samples: Samples) -> None:
        self._estimate.take_beside(name, self._clocks.beside(name, samples))

    def push_imu(self, samples: Samples, followed: Track | None = None) -> Output:
        """
        Take samples of the AHRS, dtype of `wire.IMU`, in axes of the unit; all else of their time comes before them.

        followed : gravity of these samples in tool axes, where something else than the method followed it (a smoother).
        """
        if "imu" in self.mount.unusable:
            return Output.empty(0)
        samples = self.mount.imu_in_tool(self.gate.imu(samples))
        self._estimate.take_refused(self.gate.take_refused())
        self.counters.imu += len(samples)
        before_ns = self._clocks.lead_ns
        (first, new), *rest = self._clocks.lead(samples)
        if new is None:
            for name, waiting in self._clocks.reached(before_ns).items():
                self._estimate.take_beside(name, waiting)
            return self._estimate.take_imu(first, followed)
        output, place = Output.empty(0), 0
        for part, begun in [(first, new), *rest]:
            given = followed.part(slice(place, place + len(part))) if followed is not None else None
            place += len(part)
            output = output.joined(self._estimate.take_imu(part, given))
            if begun is not None:
                self._estimate.end_requests(Reason(ReasonCode.TIME_WENT_BACK), output)
                self._set_back(begun)
        return output

    def _set_back(self, begun: Samples) -> None:
        """Begin anew with the samples that showed that time went back; their rows have been given, as not used."""
        self.counters.set_back += 1
        self._begin_anew(self.mag_late_ns)
        for name, waiting in self._clocks.release().items():
            self._estimate.take_beside(name, waiting)
        self._estimate.take_imu(begun)

    def set_mount(self, mount: Mount) -> None:
        """Turn samples like this from now on; with other axes of the conventional unit the estimate begins anew."""
        before, self.mount = self.mount, mount
        self._estimate.watch.expect_mag(expected="mag" not in mount.unusable)
        if not np.array_equal(before.imu, mount.imu):
            self.reset()

    def set_noise(self, stated: Mapping[str, Noise]) -> None:
        """Reckon with the noise that covariances state where it is larger than the tool's; the estimate begins anew."""
        settings, self.noise_notes = with_noise(self.settings, stated)
        if settings != self._with_noise:
            self._with_noise = settings
            self.reset()

    def finish(self) -> Output:
        """
        Give what the samples so far still hold when no more come: a survey that waited for the gyro.

        Samples may follow all the same.
        """
        return self._estimate.finish()

    def revisions(self) -> dict[int, Survey]:
        """Surveys, by number, of which the later ones say something else than was published; that stays."""
        return self._estimate.bin_stage.decision.revisions()

    def judging_again(self, newest: int) -> Callable[[], dict[int, Survey]]:
        """Return what judges the newest surveys, by number, as the run is now; it may be called in a thread."""
        return self._estimate.bin_stage.decision.judging_again(newest)

    def set_reference(self, reference: Reference) -> None:
        """Judge and correct by this field from now on; the interference is estimated anew."""
        self._given = reference
        self._estimate.set_reference(reference)

    def request_survey(self, duration_s: float = 0.0) -> None:
        """Take a survey from the next half second on, as `StillSurvey.request`; it comes in `Output.surveys`."""
        self.still.request(duration_s)

    def request_north(self, duration_s: float = 0.0, mode: str = "") -> None:
        """Seek north from now on, as `Requests.start_north`; the result comes in `Output.north`."""
        self.requests.start_north(duration_s, mode, self._estimate.local_gravity)

    @property
    def requests(self) -> Requests:
        """The north seek and the rotary survey that were asked for, with their progress."""
        return self._estimate.bin_stage.requests

    @property
    def still(self) -> StillSurvey:
        """The survey in a still interval that is under way: its progress, and what it waits for."""
        return self._estimate.bin_stage.still

    @property
    def sequence(self) -> int:
        """Number of the last survey."""
        return self._numbering.last

    def continue_numbering(self, last: int) -> None:
        """Give the next survey a number after `last`, which others remember of a run before this process."""
        self._numbering.last = max(self._numbering.last, last)

    @property
    def given_reference(self) -> Reference | None:
        """The field that was given in place of what the settings say."""
        return self._given

    @property
    def reference(self) -> Reference | None:
        """The field that azimuths and totals are judged by."""
        return self._estimate.field.reference

    @property
    def north(self) -> str:
        """The north that azimuths count from."""
        return self._estimate.field.north

    @property
    def went_back(self) -> list[tuple[int, int]]:
        """Each time that time went back since the last reset: the latest stamp before that and the first after, ns."""
        return self._clocks.went_back

    @property
    def of_no_time(self) -> int:
        """Samples beside those of the IMU that were left out because their time is not the IMU's."""
        return self._clocks.dropped

    @property
    def innovations(self) -> list[Innovation]:
        """What each source of measurements was expected to give and what it gave, since the estimate began."""
        return self._estimate.innovations

    @property
    def mag_late_ns(self) -> int:
        """By how much the magnetometer's stamps are late against the IMU's, as found and corrected, ns; early: < 0."""
        return self._estimate.mag_late_ns

    @property
    def last_imu_ns(self) -> int:
        """Stamp of the last sample of the IMU, ns; far before any where none came."""
        return int(self._estimate.last_imu_ns)

    @property
    def sensor_faults(self) -> list[SensorFault]:
        """Faults of the sensors that stand now."""
        return self._estimate.watch.faults + self._estimate.bin_stage.precision.faults

    @property
    def sensors_known(self) -> dict[str, int]:
        """Conditions of units, axes and signs: UNKNOWN, OK or FAULT of `health.fault_debounce`."""
        return self._estimate.watch.known
