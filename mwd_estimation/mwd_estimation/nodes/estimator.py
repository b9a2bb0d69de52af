# SPDX-License-Identifier: Apache-2.0
"""The estimator as a ROS node: it decodes messages, calls the pipeline and publishes the results."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from mwd_msgs.action import NorthSeek, RotarySurvey
from mwd_msgs.msg import (
    Attitude,
    Dynamics,
    Gravity,
    InnovationList,
    Interference,
    OperatorEvent,
    RecorderStatus,
    SampleCount,
    SurveyList,
    UsedSamples,
)
from mwd_msgs.msg import Innovation as InnovationMessage
from mwd_msgs.msg import Survey as SurveyMessage
from mwd_msgs.srv import SetReferenceField, TakeSurvey
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from mwd_estimation.core.fault_messages import describe
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.reason_text import joined, text
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded import sample_meaning
from mwd_estimation.nodes import diagnostics
from mwd_estimation.nodes.action_servers import FEEDBACK_PERIOD, EstimatorActions
from mwd_estimation.nodes.inputs import InputTopics
from mwd_estimation.nodes.transmission import LogPublisher, Running, TransmissionPublisher
from mwd_estimation.nodes.warm_up import warm_up
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.revision import is_revised
from mwd_estimation.survey.survey import ROTARY, STATIC
from mwd_sensors.core import frames, wire
from mwd_sensors.core.arrays import Indices, Samples, Stamps
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.unknown import or_none
from mwd_sensors.ros import qos
from mwd_sensors.ros.deferred import DeferredResponse, answering
from mwd_sensors.ros.diagnostics import ERROR, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import make, unknown
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.ros.time_stamps import header, stamp

# Topics of the other streams, whose samples are processed together with the samples of the conventional unit.
_BESIDE = ("imu/mag", "gyro/data_raw", "imu/temperature")
_BLOCK_PERIOD = 0.002  # longest time for which samples wait before they are processed together, s
_INNOVATIONS_PERIOD = 1.0  # interval between messages of innovations and of used samples, s
_SILENCE_PERIOD = 1.0  # interval between checks whether the samples have stopped, s
_FIELD = ("total", "dip", "declination", "convergence", "gravity", "source")
_TF_PERIOD_NS = 50_000_000  # shortest interval between transforms on /tf, ns
_LATELY_S = 10.0  # time without unused samples after which the warning about unused samples ends, s


class EstimatorNode(GraphNode[EstimatorSettings]):
    """Node that subscribes to the topics of the sonde, never to simulated truth, and publishes attitude and surveys."""

    # Beginnings of the parameters that may change while the node runs: all except the choice of the gravity method.
    changeable = ("tool.", "place.", "survey.", "verdict.", "attitude.", "dynamics.")

    def __init__(self, **node_options: Any) -> None:
        super().__init__("estimator", EstimatorSettings(), **node_options)
        self._survey_response: DeferredResponse | None = None
        self._requested_s = 0.0
        self._revisions: LiveRevisions | None = None
        self._actions = EstimatorActions(
            lambda: self._pipeline, lambda: not self._inputs.silent("imu/data_raw"), self._tell
        )

    def configure(self) -> None:
        """Compile the kernels, make the pipeline, and open topics, services, actions and timers."""
        self.prepare(lambda: warm_up(self.settings))
        self._inputs = InputTopics(self)
        self._mount_key = self._inputs.mount_key
        self._pipeline = Pipeline(self.settings, None, self._inputs.mount(self.settings.tool.mount))
        # Number of unused samples at the last diagnostics, and monotonic time, s, at which this number last changed.
        self._unused = 0, 0.0
        self._last_tf_ns = 0
        self._last_published_ns = -MIN_SPACING_NS
        self._last_status, self._has_azimuth = 0, False
        self._times_set_back = 0
        self._samples_are = ""
        self._attitude = self.add_publisher(Attitude, "attitude", qos.DEADLINE_STREAM)
        self._gravity = self.add_publisher(Gravity, "gravity", qos.DEADLINE_STREAM)
        self._imu = self.add_publisher(Imu, "imu/data", qos.STREAM)
        self._interference = self.add_publisher(Interference, "interference", qos.STATE)
        self._dynamics = self.add_publisher(Dynamics, "dynamics", qos.STATE)
        self._innovations = self.add_publisher(InnovationList, "innovations", qos.STATE)
        self._survey = self.add_publisher(SurveyMessage, "survey", qos.EVENT)
        self._revised = self.add_publisher(SurveyMessage, "survey/revised", qos.EVENT)
        revisions = self._revisions = LiveRevisions(self._publish_revision)
        self._operator_events = self.add_publisher(OperatorEvent, "operator_events", qos.STATE)
        self._used_samples = self.add_publisher(UsedSamples, "used_samples", qos.STATE)
        self._used = SampleCounts()
        self._last_imu_ns = 0  # stamp of the last IMU sample in the pipeline's time, ns; 0 before the first sample
        self._gate = RecordingGate(self)
        self._tf = self.add_publisher(TFMessage, "/tf", qos.STATE)
        self._transmission = TransmissionPublisher(self, self.settings.transmit)
        self._logs = LogPublisher(self, self._transmission.channels)
        self.add_timer(_BLOCK_PERIOD, self._estimate_block)
        self.add_timer(_INNOVATIONS_PERIOD, self._publish_innovations)
        self.add_timer(_INNOVATIONS_PERIOD, self._publish_used_samples)
        self.add_timer(_SILENCE_PERIOD, self._end_silent_survey)
        self.add_timer(_SILENCE_PERIOD, revisions.update)
        self.add_timer(FEEDBACK_PERIOD, self._actions.publish_feedback)
        self.add_subscription(SurveyList, "surveys", self._on_surveys, qos.LATCHED)
        self.add_service(TakeSurvey, "take_survey", self._take_survey)
        self.add_service(SetReferenceField, "set_reference_field", self._set_reference_field)
        self.add_service(Trigger, "reset_estimator", self._reset_estimator)
        actions = self._actions
        self.add_action_server(NorthSeek, "north_seek", actions.start_north_seek, actions.cancel_north_seek)
        self.add_action_server(RotarySurvey, "rotary_survey", actions.start_rotary_survey, actions.cancel_rotary_survey)

    def check_settings(self, settings: EstimatorSettings) -> None:
        """Raise ValueError for settings that allow no estimate, for example with a date outside the field model."""
        Pipeline(settings)

    def on_settings_changed(self, settings: EstimatorSettings) -> None:
        """
        Abort open requests and restart the estimate.

        Survey numbers are kept, and also a reference set by service if the settings of the place stay the same.
        """
        self._actions.abort("the settings were changed")
        self._respond(False, "no survey taken: the settings were changed", 0)
        before = self._pipeline
        reference = before.given_reference if settings.place == before.settings.place else None
        self._pipeline = Pipeline(settings, reference, self._inputs.mount(settings.tool.mount), self._inputs.noise)
        self._pipeline.continue_numbering(before.sequence)
        self._times_set_back = 0
        self._samples_are = ""

    def deactivate(self) -> None:
        """Publish a survey that waits for the gyro without waiting longer; finish open requests without success."""
        self._publish_pending_survey()
        self._logs.finish()
        if self._revisions is not None:
            self._revisions.finish()
        self._respond(False, "no survey taken: the estimator stops", 0)
        self._actions.abort("the estimator stops")

    def cleanup(self) -> None:
        """End the revision of published surveys."""
        if self._revisions is not None:
            self._revisions.close()

    # Subscriptions.

    def _on_surveys(self, table: SurveyList) -> None:
        """Number the next survey after the highest number in the table, which may be from an earlier estimator."""
        self._pipeline.continue_numbering(max((record.survey.sequence for record in table.records), default=0))

    def _estimate_block(self) -> None:
        """Process all waiting samples as one block; the results do not depend on the length of the block."""
        # Take IMU samples first and push them last: the other samples of the same time were sent before them.
        inputs, pipeline = self._inputs, self._pipeline
        taken = {"imu/data_raw": inputs.take("imu/data_raw")}
        taken |= {topic: inputs.take(topic) for topic in _BESIDE}
        taken = self._gate.passed(taken)
        if not any(map(len, taken.values())):
            return
        imu, others = taken["imu/data_raw"], [taken[topic] for topic in _BESIDE]
        if inputs.mount_key != self._mount_key:
            # The mount changes when frames and static transforms arrive with the first messages.
            self._mount_key = inputs.mount_key
            pipeline.set_mount(inputs.mount(pipeline.settings.tool.mount))
        pushes = (pipeline.push_mag, pipeline.push_precision, pipeline.push_temperature)
        for push, topic, samples in zip(pushes, _BESIDE, others, strict=True):
            if len(samples):
                self._used.take(topic, samples)
                push(samples)
        self._logs.push_temperature(pipeline.gate.temperature(taken["imu/temperature"]))
        if len(imu) and "imu" not in pipeline.mount.unusable:
            self._used.take("imu/data_raw", imu)
            imu = pipeline.gate.imu(imu)
            output = pipeline.push_imu(imu)
            self._last_imu_ns = pipeline.last_imu_ns
            self._publish(imu, output, self._logs.take(output, self._frame))

    @property
    def _frame(self) -> str:
        """Frame id of tool axes: the sonde's frame if the mount rotates the samples, else the frame of the samples."""
        frame = self._inputs.frames.get("imu/data_raw", "")
        return self.frame(wire.SONDE_FRAME) if self._pipeline.mount.turns else frame

    # Publishers.

    def _publish(self, samples: Samples, output: Output, running: Running) -> None:
        frame = self._frame
        self._publish_streams(samples, output, frame)
        self._transmission.take(samples, output, self._pipeline, running, frame)
        for change in output.health:
            fault = describe(change)
            if change.cleared_ns:
                self.get_logger().info(printable(fault.message))
            else:
                self.get_logger().warning(printable(f"{fault.message}; {fault.remedy}"))
        if output.health and self._revisions is not None:
            self._revisions.judge_again(self._pipeline)
        for survey in output.surveys:
            message, verdict = self._publish_survey(survey, frame)
            if survey.kind == ROTARY:
                self._actions.finish_rotary_survey(message, verdict)
            elif survey.average.requested:
                self._respond(True, verdict, survey.sequence)
        for refusal in output.refusals:
            self._respond(False, f"no survey taken: {text(refusal.reason)}", 0)
        for refusal in output.rotary_refusals:
            self._actions.finish_rotary_survey(None, text(refusal.reason))
        for solution in output.north:
            self._actions.finish_north_seek(solution)
        if self._pipeline.samples_are != self._samples_are:
            self._samples_are = self._pipeline.samples_are
            if self._samples_are:
                self.get_logger().warning(printable(sample_meaning.in_words(self._samples_are)))
        if self._pipeline.counters.set_back > self._times_set_back:
            self._times_set_back = self._pipeline.counters.set_back
            self.get_logger().warning("the samples' time went back by more than a second: the estimate began anew")

    def _publish_streams(self, samples: Samples, output: Output, frame: str) -> None:
        rows = published_rows(samples["stamp_ns"], self._last_published_ns)
        if len(rows):
            self._last_published_ns = int(samples["stamp_ns"][rows[-1]])
        self._attitude.publish_rows(wire.ATTITUDE.encode(output.attitude[rows], frame))
        self._gravity.publish_rows(wire.GRAVITY.encode(output.gravity[rows], frame))
        self._interference.publish_rows(wire.INTERFERENCE.encode(output.interference, frame))
        self._dynamics.publish_rows(wire.DYNAMICS.encode(output.dynamics, frame))
        oriented = oriented_imu(self._pipeline.mount.imu_in_tool(samples[rows]), output.attitude[rows])
        self._imu.publish_rows(wire.IMU.encode(oriented, frame))
        if len(oriented):
            self._last_status = int(output.attitude["status"][-1])
            self._has_azimuth = bool(np.isfinite(output.attitude["azimuth"][-1]))
            self._inputs.at_rest = bool(self._last_status & Status.STILL)
            self._publish_tf(oriented[-1], frame)

    def _publish_innovations(self) -> None:
        pipeline = self._pipeline
        if pipeline.last_imu_ns > 0 and not self._inputs.silent("imu/data_raw"):
            self._innovations.publish(innovation_message(pipeline.innovations, pipeline.last_imu_ns, self._frame))

    def _publish_used_samples(self) -> None:
        if self._last_imu_ns:
            topics = self._used.messages(self.resolve_topic_name)
            self._used_samples.publish(UsedSamples(header=header(self._last_imu_ns, self._frame), topics=topics))

    def _tell(self, kind: int, *, success: bool = True, **fields: Any) -> None:
        """
        Publish a request that affects surveys, with the stamp of the last sample before the request; for recordings.

        kind, success, fields: fields of mwd_msgs/msg/OperatorEvent.
        """
        about = header(self._last_imu_ns)
        self._operator_events.publish(unknown(OperatorEvent, header=about, kind=kind, success=success, **fields))

    def _publish_survey(self, survey: DecidedSurvey, frame: str) -> tuple[SurveyMessage, str]:
        message = survey.record(frame).to_message(make)
        self._survey.publish(message)
        verdict = f"survey {survey.sequence}: {survey.station.verdict}"
        self.get_logger().info(printable(f"{verdict}; {joined(survey.station.reasons)}"))
        if self._revisions is not None:
            self._revisions.take(survey, self._pipeline, frame)
        return message, verdict

    def _publish_revision(self, survey: DecidedSurvey, frame: str) -> None:
        self._revised.publish(survey.record(frame).to_message(make))
        words = f"survey {survey.sequence}, revision {survey.revision}: {survey.station.verdict}"
        self.get_logger().info(printable(f"{words}; {joined(survey.station.reasons)}"))

    def _end_silent_survey(self) -> None:
        """If the samples have stopped, answer an open request and publish a survey that waits for the gyro."""
        if self._inputs.silent("imu/data_raw"):
            self._respond(False, "no survey taken: the samples stopped", 0)
            if self._pipeline.still.waits_for is not None:
                self._publish_pending_survey()

    def _publish_pending_survey(self) -> None:
        """Publish the survey that waits for the gyro without waiting longer."""
        surveys = self._pipeline.finish().surveys
        if surveys:
            self._tell(OperatorEvent.COMPLETE_SURVEY, message="the samples stopped")
        for survey in surveys:
            self._publish_survey(survey, self._frame)

    def _publish_tf(self, oriented: Any, frame: str) -> None:
        stamp_ns = int(oriented["stamp_ns"])
        if not 0 <= stamp_ns - self._last_tf_ns < _TF_PERIOD_NS:
            self._last_tf_ns = stamp_ns
            transform = tool_transform(oriented, self.frame(wire.LOCAL_FRAME), frame)
            self._tf.publish(TFMessage(transforms=[transform]))

    # Services.

    def _take_survey(self, request: Any, response: Any) -> Any:
        answer = self._started_survey(request, response)
        started = answer is not response
        words = "" if started else response.message
        self._tell(OperatorEvent.TAKE_SURVEY, success=started, message=words, duration=request.duration)
        return answer

    @answering
    def _started_survey(self, request: Any, _response: Any) -> DeferredResponse:
        """Start the requested survey; its response is sent when the survey is taken."""
        if self._survey_response is not None:
            raise ValueError("a survey is already being taken")
        if self._inputs.silent("imu/data_raw"):
            raise ValueError("no survey taken: no samples arrive from the sonde")
        try:
            self._pipeline.request_survey(request.duration)
        except ValueError as error:
            raise ValueError(f"no survey taken: {error}") from error
        self._survey_response = DeferredResponse()
        self._requested_s = request.duration or self.settings.survey.duration_s
        return self._survey_response

    def _respond(self, success: bool, message: str, sequence: int) -> None:
        """Respond to the open request for a survey, if there is one."""
        pending, self._survey_response = self._survey_response, None
        if pending is not None:
            pending.send(TakeSurvey.Response(success=success, message=message, sequence=sequence))

    def _set_reference_field(self, request: Any, response: Any) -> Any:
        response = self._used_reference(request, response)
        field = {name: getattr(request, name) for name in _FIELD}
        self._tell(OperatorEvent.SET_REFERENCE_FIELD, success=response.success, message=response.message, **field)
        return response

    @answering
    def _used_reference(self, request: Any, _response: Any) -> str:
        if not request.source.strip():
            raise ValueError("source: must name where the field comes from")
        reference = Reference(
            total=request.total,
            dip=request.dip,
            declination=request.declination,
            convergence=request.convergence,
            gravity=or_none(request.gravity) or None,  # 0: the client gave no gravity
            source=request.source,
        )
        self._pipeline.set_reference(reference)
        self.get_logger().info(printable(f"reference field from {request.source}"))
        return f"reference field from {request.source}"

    @answering
    def _reset_estimator(self, _request: Any, _response: Any) -> str:
        self._actions.abort("the estimator was reset")
        self._tell(OperatorEvent.RESET_ESTIMATOR)
        self._pipeline.reset()
        self._respond(False, "no survey taken: the estimator was reset", 0)
        return "the estimate starts anew"

    # Diagnostics.

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the diagnostics of input topics, unused samples, reference field, sensors, survey and attitude."""
        inputs, pipeline = self._inputs, self._pipeline
        counters = pipeline.counters
        found = [inputs.diagnostic("imu/data_raw", counters.imu, ERROR)]
        found.append(inputs.diagnostic("imu/mag", counters.mag, WARN))
        if inputs.received("gyro/data_raw"):
            found.append(inputs.diagnostic("gyro/data_raw", counters.precision, WARN))
        found += inputs.mount_diagnostics(pipeline.mount)
        found += [*inputs.covariance_diagnostics(), *inputs.frame_diagnostics()]
        found += [*inputs.repeat_diagnostics(), *inputs.skew_diagnostics()]
        found += diagnostics.input_diagnostics(pipeline)
        unused = diagnostics.unused_samples(pipeline, inputs.unreadable)
        if unused != self._unused[0]:
            self._unused = unused, time.monotonic()
        lately = time.monotonic() - self._unused[1] < _LATELY_S
        found.append(diagnostics.sample_diagnostic(pipeline, inputs.unreadable, lately))
        found.append(diagnostics.reference_diagnostic(pipeline.reference))
        found += diagnostics.sensor_diagnostics(pipeline, has_azimuth=self._has_azimuth)
        requested_s = self._requested_s if self._survey_response is not None else None
        found.append(diagnostics.survey_diagnostic(pipeline, self.settings, requested_s))
        found.append(diagnostics.attitude_diagnostic(self._last_status))
        found += self._transmission.diagnostics()
        return found


def main(args: Sequence[str] | None = None) -> int:
    """Run the estimator node; return the exit status."""
    return run_node(EstimatorNode, args)


# While a recorder runs, only samples from the first recorded sample on are used, so that processing the recording gives
# the same results.


# Longest wait for the recorder, s, which publishes its status once a second, and at once when a topic begins.
_LONGEST_S = 5.0
# Largest number of waiting samples of a topic: a minute of a unit of 1 kHz.
_MOST = 60_000


class SampleCounts:
    """First stamp, last stamp and number of the used samples of each topic."""

    def __init__(self) -> None:
        self._counts: dict[str, tuple[int, int, int]] = {}

    def take(self, topic: str, samples: Samples) -> None:
        """Count one or more samples of a topic."""
        stamps = samples["stamp_ns"]
        low, high = int(stamps.min()), int(stamps.max())
        first, last, count = self._counts.get(topic, (low, high, 0))
        self._counts[topic] = min(first, low), max(last, high), count + len(samples)

    def messages(self, full_name: Callable[[str], str]) -> list[SampleCount]:
        """Return the counts as messages; full_name resolves the name of a topic."""
        return [
            SampleCount(topic=full_name(topic), first=stamp(first), last=stamp(last), samples=count)
            for topic, (first, last, count) in self._counts.items()
        ]


class RecordingGate:
    """
    Gate that holds the first samples back until the recorder receives samples too, if a recorder runs.

    node: node in which the subscription to `recorder` is created.
    """

    def __init__(self, node: GraphNode[Any]) -> None:
        self._node = node
        self._open = False
        self._waiting: dict[str, Samples] = {}
        self._since: float | None = None
        # Full name of each recorded topic of samples, with the first stamp, ns; 0: no sample yet. None: no status yet.
        self._first_ns: dict[str, int] | None = None
        node.add_subscription(RecorderStatus, "recorder", self._on_status, qos.STATE)

    def _on_status(self, message: RecorderStatus) -> None:
        names = message.streams if message.state == RecorderStatus.RECORDING else []
        self._first_ns = dict(zip(names, map(stamp_of, message.first), strict=False))

    def passed(self, taken: Mapping[str, Samples]) -> dict[str, Samples]:
        """
        Return the samples of each topic to use now.

        taken: samples of each topic received since the last call. While samples are held back, the result has no
        samples. If the recorder still lacks a topic after 5 s, the samples are used, with a warning.
        """
        if self._open:
            return dict(taken)
        for topic, samples in taken.items():
            held = self._waiting.get(topic, samples[:0])
            self._waiting[topic] = np.concatenate([held, samples])[-_MOST:]
        if not any(len(samples) for samples in self._waiting.values()):
            return dict(taken)
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        begin_ns, lacking = self._recorded_from()
        if lacking and now - self._since < _LONGEST_S:
            return {topic: samples[:0] for topic, samples in taken.items()}
        if lacking:
            names = ", ".join(lacking)
            text = f"the recorder receives nothing of {names}: the recording will lack samples that are used"
            self._node.get_logger().warning(printable(text))
        self._open = True
        waiting, self._waiting = self._waiting, {}
        return {topic: samples[samples["stamp_ns"] >= begin_ns.get(topic, 0)] for topic, samples in waiting.items()}

    def _recorded_from(self) -> tuple[dict[str, int], list[str]]:
        """
        Return the first recorded stamp, ns, of each topic with samples, and the full names of the topics not recorded.

        If a recorder runs and its first status has not arrived, the only name is the name of the recorder topic.
        """
        if self._first_ns is None:
            recorder = self._node.resolve_topic_name("recorder")
            # Either no recorder runs, or its first status has not arrived yet.
            return {}, [recorder] if self._node.count_publishers(recorder) else []
        begin_ns, lacking = {}, []
        for topic, samples in self._waiting.items():
            name = self._node.resolve_topic_name(topic)
            if len(samples) and name in self._first_ns:
                begin_ns[topic] = self._first_ns[name]
                lacking += [name] if not self._first_ns[name] else []
        return begin_ns, lacking


# Results of the estimator as ROS messages.


# Shortest time between two published estimates, ns (0.8 ms). Samples of a unit faster than 1 kHz are all processed.
MIN_SPACING_NS = 800_000


def innovation_message(found: Sequence[Innovation], stamp_ns: int, frame_id: str) -> InnovationList:
    """Return innovations as mwd_msgs/msg/InnovationList."""
    sources = [InnovationMessage(test_ratio=one.test_ratio, **one._asdict()) for one in found]
    return InnovationList(header=header(stamp_ns, frame_id), sources=sources)


def tool_transform(oriented: Any, local_frame: str, tool_frame: str) -> TransformStamped:
    """
    Return the transform from the local east-north-up frame to the tool frame.

    oriented: record of `wire.IMU` with its orientation; local_frame: frame id of the well's east-north-up axes;
    tool_frame: frame id of the tool's messages.
    """
    about = header(int(oriented["stamp_ns"]), local_frame)
    transform = TransformStamped(header=about, child_frame_id=tool_frame)
    x, y, z, w = (float(v) for v in oriented["orientation"])
    rotation = transform.transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = x, y, z, w
    return transform


def published_rows(stamps: Stamps, last_ns: int) -> Indices:
    """
    Return the indices of the samples whose estimates are published: at least `MIN_SPACING_NS` apart.

    stamps: stamps of the samples, ns, shape (n,); last_ns: stamp of the last published estimate. If time goes back
    by at least this spacing, the next estimate is published.
    """
    far = np.abs(np.diff(stamps)) >= MIN_SPACING_NS
    if len(stamps) and abs(int(stamps[0]) - last_ns) >= MIN_SPACING_NS and far.all():
        return np.arange(len(stamps))
    rows = []
    for k, stamp_ns in enumerate(stamps.tolist()):
        if abs(stamp_ns - last_ns) >= MIN_SPACING_NS:
            rows.append(k)
            last_ns = stamp_ns
    return np.array(rows, dtype=np.int64)


def oriented_imu(samples: Samples, attitude: Samples) -> Samples:
    """
    Return IMU samples with their orientation, from tool to east-north-up axes (REP-103, REP-145).

    Without attitude the first covariance element is -1 (not reported). Without azimuth the azimuth counts as zero, with
    a sigma of pi.
    """
    oriented = samples.copy()
    attitude_known = np.isfinite(attitude["sigma_inclination"])
    azimuth_known = np.isfinite(attitude["sigma_azimuth"])
    mat = frames.mat_nt(*(np.nan_to_num(attitude[angle]) for angle in ("inclination", "azimuth", "gravity_toolface")))
    oriented["orientation"] = np.where(attitude_known[:, None], frames.orientation_et(mat), [0.0, 0.0, 0.0, 1.0])
    tilt = attitude["sigma_inclination"] ** 2
    heading = np.where(azimuth_known, attitude["sigma_azimuth"], np.pi) ** 2
    covariance = np.zeros((len(samples), 9))
    covariance[:, 0] = np.where(attitude_known, tilt, -1.0)
    covariance[:, 4] = np.where(attitude_known, tilt, 0.0)
    covariance[:, 8] = np.where(attitude_known, heading, 0.0)
    oriented["orientation_covariance"] = covariance
    return oriented


# Published surveys are decided again after later surveys and sensor faults; changed ones go to the topic
# survey/revised.


# Number of stations that are decided again after each survey: steel, and a step of a gyro bias, become visible within a
# few stations. Number of surveys that are kept: a sensor fault that existed from the start affects all of them.
_NEWEST, _KEPT = 30, 1000
# Longest wait for a decision at the end, s: the node must stop within three seconds.
_AT_THE_END_S = 1.5


class LiveRevisions:
    """
    Revisions of the surveys published so far.

    publish: called with each revised survey and the frame of its readings, in the thread of `update`.
    """

    def __init__(self, publish: Callable[[DecidedSurvey, str], None]) -> None:
        self._publish = publish
        self._executor = concurrent.futures.ThreadPoolExecutor(1, "revisions")
        self._job: concurrent.futures.Future[dict[int, DecidedSurvey]] | None = None
        self._waiting: Callable[[], dict[int, DecidedSurvey]] | None = None
        # For each survey number: the survey as first published, and its last revision.
        self._surveys: dict[int, tuple[DecidedSurvey, DecidedSurvey]] = {}
        self._frame = ""

    def close(self) -> None:
        """Start no further decision; a running one is completed, and its result is not published."""
        self._waiting = None
        self._executor.shutdown(wait=False, cancel_futures=True)

    def take(self, survey: DecidedSurvey, pipeline: Pipeline, frame: str) -> None:
        """Add a survey that was published; decide earlier surveys again if the new one was taken at rest."""
        self._surveys[survey.sequence], self._frame = (survey, survey), frame
        while len(self._surveys) > _KEPT:
            del self._surveys[next(iter(self._surveys))]
        if survey.kind == STATIC:
            self.judge_again(pipeline)

    def judge_again(self, pipeline: Pipeline) -> None:
        """Decide surveys again with the pipeline's present data; call this after a survey or a change of a fault."""
        if self._surveys:
            self._waiting = pipeline.judging_again(_NEWEST)

    def finish(self) -> None:
        """Publish the remaining revisions before the estimator stops, within a limited time."""
        self.update()
        while self._job is not None:
            concurrent.futures.wait([self._job], _AT_THE_END_S)
            if not self._job.done():
                return
            self.update()

    def update(self) -> None:
        """Publish the revisions of a finished decision, and start the waiting decision."""
        if self._job is not None and self._job.done():
            job, self._job = self._job, None
            now = job.result()
            # Restore surveys that were withdrawn because of a sensor fault that is now cleared.
            back = {k: first for k, (first, last) in self._surveys.items() if last.withdrawn and k not in now}
            for number, survey in {**back, **now}.items():
                self._revise(number, survey)
        if self._job is None and self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._job = self._executor.submit(waiting)

    def _revise(self, number: int, now: DecidedSurvey) -> None:
        """Publish a revision if it differs from the last published value of the survey."""
        if number not in self._surveys:
            return
        first, last = self._surveys[number]
        changed = now.withdrawn != last.withdrawn
        if changed or is_revised(last.station, now.station, now.station.sigma_azimuth):
            survey = dataclasses.replace(now, status=first.status, revision=last.revision + 1)
            self._surveys[number] = first, survey
            self._publish(survey, self._frame)
