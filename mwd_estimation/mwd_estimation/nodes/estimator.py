"""The estimator as a node: unpacks messages, calls the pipeline, publishes what it found."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from mwd_msgs.action import NorthSeek, RotarySurvey
from mwd_msgs.msg import Attitude, Dynamics, Gravity, ImuBurst, Interference, SurveyList
from mwd_msgs.msg import Survey as SurveyMessage
from mwd_msgs.srv import SetReferenceField, TakeSurvey
from numpy.typing import NDArray
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status, words
from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_params import SeekParams
from mwd_estimation.nodes.action_servers import PERIOD, Errands
from mwd_estimation.nodes.messages import stamp, survey_message
from mwd_estimation.pipeline import EstimatorSettings, Output, Pipeline
from mwd_estimation.survey.static_survey import Refusal
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import burst, frames, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros import qos
from mwd_sensors.ros.lifecycle_node import ERROR, OK, WARN, Finding, GraphNode, Later, run_node
from mwd_sensors.ros.message_buffer import decoded, publish_rows

_SILENT_AFTER = 2.0  # s without a message before a topic counts as silent
_BLOCK_S = 0.002  # how long a sample may wait for others before it is estimated
_INPUTS = {
    "imu/mag": MagneticField,
    "gyro/data_raw": Imu,
    "gyro/burst": ImuBurst,
    "imu/temperature": Temperature,
    "imu/data_raw": Imu,
    "imu/burst": ImuBurst,
}
_BURSTS = {single: (name,) for name, single in burst.TOPICS.items()}
_APART_NS = 800_000  # of published estimates: a unit beyond 1 kHz is estimated at its rate and told at this one
_TF_PERIOD_NS = 50_000_000
_WARM_UP = 160  # samples that compile every kernel before the first message: three bins of half a second


class EstimatorNode(GraphNode[EstimatorSettings]):
    """Listens to the sonde's topics, never to the truth; publishes what the pipeline makes of them."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("estimator", EstimatorSettings(), **node_options)
        self._waiting: Later | None = None
        self._asked_s = 0.0
        self._errands = Errands(lambda: self._pipeline, lambda: not self._silent("imu/data_raw"))

    def open(self) -> None:
        """Compile the kernels and open the topics."""
        self.get_logger().info("preparing the filters; the first time after a change they are compiled")
        warm_up(self.settings)
        self.get_logger().info("the filters are ready")
        self._begin()
        self._attitude = self.publish_on(Attitude, "attitude", qos.WATCHED_STREAM)
        self._gravity = self.publish_on(Gravity, "gravity", qos.WATCHED_STREAM)
        self._imu = self.publish_on(Imu, "imu/data", qos.STREAM)
        self._interference = self.publish_on(Interference, "interference", qos.STATE)
        self._dynamics = self.publish_on(Dynamics, "dynamics", qos.STATE)
        self._survey = self.publish_on(SurveyMessage, "survey", qos.EVENT)
        self._tf = self.publish_on(TFMessage, "/tf", qos.STATE)
        self._inputs = {topic: self.collect(kind, topic, qos.deep(qos.STREAM)) for topic, kind in _INPUTS.items()}
        self.every(_BLOCK_S, self._take_block)
        self.every(PERIOD, self._errands.tell)
        self.listen(SurveyList, "surveys", self._on_surveys, qos.LATCHED)
        self.serve(TakeSurvey, "take_survey", self._take_survey)
        self.serve(SetReferenceField, "set_reference_field", self._set_reference_field)
        self.serve(Trigger, "reset_estimator", self._reset_estimator)
        self.perform(NorthSeek, "north_seek", self._errands.seek_north, self._errands.cancel_north)
        self.perform(RotarySurvey, "rotary_survey", self._errands.take_rotary, self._errands.cancel_rotary)

    def _begin(self) -> None:
        self._pipeline = Pipeline(self.settings)
        self._heard: dict[str, float] = {}
        self._frames: dict[str, str] = {}
        self._unreadable = 0
        self._last_tf_ns = 0
        self._last_told_ns = -_APART_NS
        self._last_status = 0
        self._set_back = 0

    def settings_changed(self, settings: EstimatorSettings) -> None:
        """Start the estimate anew with the new settings, survey numbering kept."""
        self._errands.end("the settings were changed")
        sequence = self._pipeline.sequence
        self._pipeline = Pipeline(settings)
        self._pipeline.continue_numbering(sequence)

    # Messages in.

    def _on_surveys(self, table: SurveyList) -> None:
        """Numbers that an estimator before this one has given are not given again."""
        self._pipeline.continue_numbering(max((record.survey.sequence for record in table.records), default=0))

    def _take_block(self) -> None:
        """Estimate from everything that waits: the same bits as one by one, and one call of each kernel."""
        # IMU samples are taken first and pushed last: what they need beside them was sent before them.
        imu = self._take("imu/data_raw")
        for topic, push in (
            ("imu/mag", self._push_mag),
            ("gyro/data_raw", self._pipeline.push_precision),
            ("imu/temperature", self._pipeline.push_temperature),
        ):
            samples = self._take(topic)
            if len(samples):
                push(samples)
        if len(imu):
            self._publish(imu, self._pipeline.push_imu(imu))

    def _take(self, topic: str) -> Samples:
        """Samples that wait on a topic; those of the bursts that stand for it too."""
        layout = wire.SONDE_TOPICS[topic]
        waiting = [arrival.data for arrival in self._inputs[topic].take()]
        samples, errors = decoded(layout, waiting)
        bursts = [arrival.data for name in _BURSTS.get(topic, ()) for arrival in self._inputs[name].take()]
        for message in bursts:
            try:
                samples = np.concatenate([samples, burst.decode(message)])
            except wire.WireError as error:
                errors.append(error)
        if waiting or bursts:
            self._heard[topic] = time.monotonic()
        if topic not in self._frames and len(samples):
            self._frames[topic] = wire.frame_id((waiting + bursts)[0])
        for error in errors:
            self._unreadable += 1
            self.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=10.0)
        return samples

    def _push_mag(self, samples: Samples) -> None:
        if not self._frames_differ():
            self._pipeline.push_mag(samples)

    def _frames_differ(self) -> bool:
        imu = self._frames.get("imu/data_raw")
        return imu is not None and imu != self._frames.get("imu/mag", imu)

    # Messages out.

    def _publish(self, samples: Samples, output: Output) -> None:
        frame = self._frames["imu/data_raw"]
        told = apart(samples["stamp_ns"], self._last_told_ns)
        if len(told):
            self._last_told_ns = int(samples["stamp_ns"][told[-1]])
        publish_rows(self._attitude, wire.ATTITUDE.encode(output.attitude[told], frame))
        publish_rows(self._gravity, wire.GRAVITY.encode(output.gravity[told], frame))
        publish_rows(self._interference, wire.INTERFERENCE.encode(output.interference, frame))
        publish_rows(self._dynamics, wire.DYNAMICS.encode(output.dynamics, frame))
        oriented = oriented_imu(samples[told], output.attitude[told])
        publish_rows(self._imu, wire.IMU.encode(oriented, frame))
        if len(oriented):
            self._last_status = int(output.attitude["status"][-1])
            self._publish_tf(oriented[-1], frame)
        for change in output.health:
            if change.cleared_ns:
                self.get_logger().info(change.message)
            else:
                self.get_logger().warning(f"{change.message}; {change.remedy}")
        for survey in output.surveys:
            verdict = self._publish_survey(survey, frame)[1]
            if survey.requested:
                self._answer(True, verdict, survey.sequence)
        for refusal in output.refusals:
            self._answer(False, f"no survey taken: {refusal.reason}", 0)
        for result in output.rotary:
            told = (None, result.reason) if isinstance(result, Refusal) else self._publish_survey(result, frame)
            self._errands.rotary_taken(*told)
        for found in output.north:
            self._errands.north_found(found)
        if self._pipeline.counters.set_back > self._set_back:
            self._set_back = self._pipeline.counters.set_back
            self.get_logger().warning("the samples' time went back by more than a second: the estimate began anew")

    def _publish_survey(self, survey: Survey, frame: str) -> tuple[SurveyMessage, str]:
        message = survey_message(survey, frame, self._last_status)
        self._survey.publish(message)
        verdict = f"survey {survey.sequence}: {survey.station.verdict}"
        self.get_logger().info(f"{verdict}; {'; '.join(survey.station.reasons)}")
        return message, verdict

    def _publish_tf(self, sample: Any, frame: str) -> None:
        if sample["stamp_ns"] - self._last_tf_ns < _TF_PERIOD_NS and sample["stamp_ns"] >= self._last_tf_ns:
            return
        self._last_tf_ns = int(sample["stamp_ns"])
        prefix = self.get_namespace().strip("/")
        transform = TransformStamped()
        transform.header.stamp = stamp(self._last_tf_ns)
        transform.header.frame_id = f"{prefix}/local_enu" if prefix else "local_enu"
        transform.child_frame_id = f"{prefix}/{frame}" if prefix else frame
        x, y, z, w = (float(v) for v in sample["orientation"])
        rotation = transform.transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = x, y, z, w
        self._tf.publish(TFMessage(transforms=[transform]))

    # Services.

    def _take_survey(self, request: TakeSurvey.Request, response: TakeSurvey.Response) -> TakeSurvey.Response | Later:
        if self._waiting is not None:
            response.success, response.message = False, "a survey is already being taken"
            return response
        if not np.isfinite(request.duration) or request.duration < 0.0:
            response.success, response.message = False, f"duration: must be 0 or more seconds, got {request.duration}"
            return response
        if self._silent("imu/data_raw"):
            response.success, response.message = False, "no survey taken: no samples arrive from the sonde"
            return response
        self._waiting = Later()
        self._asked_s = request.duration or self.settings.survey.duration_s
        self._pipeline.request_survey(request.duration)
        return self._waiting

    def _answer(self, success: bool, message: str, sequence: int) -> None:
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.answer(TakeSurvey.Response(success=success, message=message, sequence=sequence))

    def _set_reference_field(
        self, request: SetReferenceField.Request, response: SetReferenceField.Response
    ) -> SetReferenceField.Response:
        if not request.source.strip():
            response.success, response.message = False, "source: say where the field comes from"
            return response
        try:
            reference = Reference(
                total=request.total,
                dip=request.dip,
                declination=request.declination,
                convergence=request.convergence,
                gravity=request.gravity if request.gravity > 0.0 else None,
                source=request.source,
            )
        except ValueError as error:
            response.success, response.message = False, str(error)
            return response
        self._pipeline.set_reference(reference)
        response.success, response.message = True, f"reference field from {request.source}"
        self.get_logger().info(response.message)
        return response

    def _reset_estimator(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._errands.end("the estimator was reset")
        self._pipeline.reset()
        self._answer(False, "no survey taken: the estimator was reset", 0)
        response.success, response.message = True, "the estimate starts anew"
        return response

    # Health.

    def halt(self) -> None:
        """A survey that waits for the gyro is given as it is; what somebody else waits for will not come."""
        self._hand_over()
        self._answer(False, "no survey taken: the estimator stops", 0)
        self._errands.end("the estimator stops")

    def _hand_over(self) -> None:
        """Nothing more comes of the still interval: a survey that waits for the gyro is given as it is."""
        for survey in self._pipeline.finish().surveys:
            self._publish_survey(survey, self._frames.get("imu/data_raw", ""))

    def _silent(self, topic: str) -> bool:
        return time.monotonic() - self._heard.get(topic, -_SILENT_AFTER) >= _SILENT_AFTER

    def findings(self) -> Sequence[Finding]:
        """Inputs, frames, rejected samples and the state of the estimate."""
        if self._waiting is not None and self._silent("imu/data_raw"):
            self._answer(False, "no survey taken: the samples stopped", 0)
        if self._pipeline.survey_waits_for and self._silent("imu/data_raw"):
            self._hand_over()
        counters = self._pipeline.counters
        found = [self._input("imu/data_raw", counters.imu, ERROR), self._input("imu/mag", counters.mag, WARN)]
        if "gyro/data_raw" in self._heard:
            found.append(self._input("gyro/data_raw", counters.precision, WARN))
        if self._frames_differ():
            found.append(
                Finding(
                    "frames",
                    ERROR,
                    f"imu/data_raw is in {self._frames['imu/data_raw']!r}, imu/mag in {self._frames['imu/mag']!r}: "
                    "the magnetometer is not used",
                    "publish both in one frame",
                )
            )
        dropped = counters.rejected + counters.late_mag + counters.spikes + self._unreadable
        found.append(
            Finding(
                "samples",
                OK if not dropped else WARN,
                "all used" if not dropped else f"{dropped} not used",
                "" if not dropped else "look for gaps, repeated stamps and values that are not finite",
                (
                    ("rejected", str(counters.rejected)),
                    ("late magnetic", str(counters.late_mag)),
                    ("magnetic spikes", str(counters.spikes)),
                    ("unreadable", str(self._unreadable)),
                    ("time went back", str(counters.set_back)),
                ),
            )
        )
        reference = self._pipeline.reference
        known = reference is not None and reference.has_field
        found.append(
            Finding(
                "reference field",
                OK if known else WARN,
                reference.source if reference is not None else "none: azimuth is magnetic and uncorrected",
                "" if known else "set reference.source, or call set_reference_field",
                _figures(reference) if reference is not None and known else (),
            )
        )
        found += self._sensor_findings()
        found.append(self._survey_finding())
        found.append(Finding("attitude", OK, words(self._last_status & ~int(Status.NO_REFERENCE)) or "moving"))
        return found

    def _sensor_findings(self) -> list[Finding]:
        """Each fault of a sensor by itself; without one, what the motion so far has not shown."""
        faults = self._pipeline.sensor_faults
        if not faults:
            unknown = [name for name, word in self._pipeline.sensors_known.items() if word == "not yet known"]
            values = tuple(self._pipeline.sensors_known.items())
            message = f"no fault; not yet known: {', '.join(unknown)}" if unknown else "healthy"
            return [Finding("sensors", OK, message, values=values)]
        return [
            Finding(
                "sensors" if k == 0 else f"sensors {k + 1}",
                ERROR if one.severity == "error" else WARN,
                one.message,
                one.remedy,
                (
                    ("kind", one.kind),
                    ("sensor", one.sensor),
                    ("axis", one.axis),
                    ("confidence", f"{one.confidence:.2f}"),
                    ("since_s", f"{one.since_ns * 1e-9:.1f}"),
                ),
            )
            for k, one in enumerate(faults)
        ]

    def _survey_finding(self) -> Finding:
        survey, share = self.settings.survey, self._pipeline.survey_progress
        seconds = self._asked_s if self._waiting is not None else survey.settle_s + survey.duration_s
        if not (survey.automatic or self._waiting is not None) or share == 0.0:
            return Finding("survey", OK, "none under way")
        if share >= 1.0:
            return Finding("survey", OK, "taken; the next one comes after the tool has moved")
        values = (("elapsed_s", f"{share * seconds:.1f}"), ("remaining_s", f"{(1.0 - share) * seconds:.1f}"))
        waits_for = self._pipeline.survey_waits_for
        if waits_for:
            return Finding("survey", OK, f"averaging on, waits for the gyro: {waits_for}", values=values)
        settling = self._waiting is None and share * seconds < survey.settle_s
        return Finding("survey", OK, "letting the string settle" if settling else "averaging", values=values)

    def _input(self, topic: str, count: int, level: bytes) -> Finding:
        name = self.resolve_topic_name(topic)
        values = (("messages", str(count)), ("frame", self._frames.get(topic, "")))
        if not self._silent(topic):
            return Finding(topic, OK, "arriving", values=values)
        if topic in self._heard:
            age = time.monotonic() - self._heard[topic]
            return Finding(topic, level, f"silent for {age:.0f} s", "is the sonde alive and connected?", values)
        publishers = self.get_publishers_info_by_topic(name)
        if not publishers:
            return Finding(topic, level, f"nobody publishes {name}", "start the sonde, or remap the topic", values)
        policy = publishers[0].qos_profile.reliability.name
        return Finding(topic, level, f"{name} has a publisher ({policy}) but nothing arrives", "check its QoS", values)


def _figures(reference: Reference) -> tuple[tuple[str, str], ...]:
    """The field in force: T, rad and m/s^2, as many digits as it has."""
    names = ("total", "dip", "declination", "convergence", "gravity")
    known = [(name, getattr(reference, name)) for name in names]
    return tuple((name, repr(float(value))) for name, value in known if value is not None)


def apart(stamps: NDArray[np.int64], last_ns: int) -> NDArray[np.int64]:
    """
    Places of the samples whose estimates are published: all of a unit up to 1 kHz, of a faster one those 0.8 ms apart.

    stamps, shape (n,), and last_ns, of the one published last: ns. Time that goes back begins anew.
    """
    if len(stamps) and abs(int(stamps[0]) - last_ns) >= _APART_NS and (np.abs(np.diff(stamps)) >= _APART_NS).all():
        return np.arange(len(stamps))
    places = []
    for k, stamp_ns in enumerate(stamps.tolist()):
        if abs(stamp_ns - last_ns) >= _APART_NS:
            places.append(k)
            last_ns = stamp_ns
    return np.array(places, dtype=np.int64)


def oriented_imu(samples: Samples, attitude: Samples) -> Samples:
    """
    The IMU samples with their orientation filled in, tool to east-north-up (REP-103, REP-145).

    Without attitude the first covariance element is -1 (not reported); without azimuth the heading is zero with the
    variance of a full circle.
    """
    oriented = samples.copy()
    known = attitude["sigma_inclination"] >= 0.0
    azimuth_known = attitude["sigma_azimuth"] >= 0.0
    mat = frames.mat_nt(attitude["inclination"], attitude["azimuth"], attitude["gravity_toolface"])
    oriented["orientation"] = np.where(known[:, None], frames.orientation_et(mat), [0.0, 0.0, 0.0, 1.0])
    tilt = attitude["sigma_inclination"] ** 2
    heading = np.where(azimuth_known, attitude["sigma_azimuth"], np.pi) ** 2
    covariance = np.zeros((len(samples), 9))
    covariance[:, 0] = np.where(known, tilt, -1.0)
    covariance[:, 4] = np.where(known, tilt, 0.0)
    covariance[:, 8] = np.where(known, heading, 0.0)
    oriented["orientation_covariance"] = covariance
    return oriented


def warm_up(settings: EstimatorSettings) -> None:
    """Compile every kernel on made-up samples, so that the first real one is not late."""
    imu, mag, heat = wire.IMU.empty(_WARM_UP), wire.MAG.empty(_WARM_UP), wire.TEMPERATURE.empty(_WARM_UP)
    imu["stamp_ns"] = mag["stamp_ns"] = heat["stamp_ns"] = 10**18 + np.arange(_WARM_UP) * 10**7
    imu["linear_acceleration"] = (-7.0, 0.0, 7.0)
    mag["magnetic_field"] = (2e-5, 1e-5, 4e-5)
    pipeline = Pipeline(settings, Reference(total=5e-5, dip=1.0, source="warm-up"))
    pipeline.push_mag(mag)
    pipeline.push_precision(imu)
    pipeline.push_temperature(heat)
    pipeline.push_imu(imu)
    forces, rates = imu["linear_acceleration"], imu["angular_velocity"]
    north_seek.run(SeekParams(), north_seek.initial(), imu["stamp_ns"], rates, forces)


def main(args: Sequence[str] | None = None) -> int:
    """Run the estimator node."""
    return run_node(EstimatorNode, args)
