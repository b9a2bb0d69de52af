# SPDX-License-Identifier: Apache-2.0
"""Estimator and surface of a well without middleware, and the recording of what they send."""

import itertools
import math

import numpy as np

from mwd_estimation.core.repeated_samples import RepeatedSamples
from mwd_estimation.nodes.estimator import LiveRevisions
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import input_covariance, settings, wire
from mwd_sensors.core.message_record import HEADER, time_message
from mwd_sensors.core.mount import PRESETS
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs.launch_plan import reference_parameters
from mwd_surface.surveys import message_conversion
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE, SurfacePart
from mwd_surface.surveys.survey_list import SurveyList

LIST, SURVEY = "mwd_msgs/msg/SurveyList", "mwd_msgs/msg/Survey"
EVENT, USED = "mwd_msgs/msg/OperatorEvent", "mwd_msgs/msg/UsedSamples"
TAKE, ROTARY, RESET, DEPTH, ACCEPT, REJECT = 0, 3, 6, 8, 9, 10
BESIDE = {"imu/mag": "push_mag", "gyro/data_raw": "push_precision", "imu/temperature": "push_temperature"}
UNITS = ("imu/data_raw", "imu/mag", "gyro/data_raw")
VECTORS = ("angular_velocity", "linear_acceleration", "magnetic_field")


def texts(made, **more):
    return {name: str(value) for name, (value, _) in settings.flat(made).items()} | more


class LiveGraph:
    """
    A well that is drilled, with its recording at `path`.

    skip: topics that the recorder does not record; lost: of each topic of samples, how many it lacks at the begin;
    mount: preset of the unit.
    """

    def __init__(self, path, story, *, mount="x-down", skip=(), lost=None, **changes):
        self.settings = settings.changed(EstimatorSettings(), {**reference_parameters(story), **changes})
        self.sonde, self.mat = Sonde(story), PRESETS[mount]
        self.pipeline = Pipeline(self.settings)
        self.revisions = LiveRevisions(self._on_revision)
        place = {"well.latitude_deg": story.place.latitude_deg, "well.longitude_deg": story.place.longitude_deg}
        surface = settings.changed(SurfacePart(), place)
        self.list = SurveyList(well=surface.well)
        self.answers, self.published, self.used = [], [], {}
        self.bag, self._skip, self._lost = BagWriter(path), skip, dict(lost or {})
        self.bag.add_metadata(ESTIMATOR, texts(self.settings, use_sim_time="False"))
        self.bag.add_metadata(SURFACE, texts(surface))
        for name in (LIST, EVENT, USED):
            self.bag.definitions.load(name)
        self.store, self.make = self.bag.definitions.typestore, self.bag.definitions.make
        self.now_ns = self.newest_ns = 0
        self.depth = 1000.0
        self._repeated = {name: RepeatedSamples(hold=name == "imu/data_raw") for name in UNITS}

    def run(self, actions=(), step_s=0.5, seconds=math.inf):
        """Drill for so long at most; actions: (seconds, callable of this graph). Returns the list at the end."""
        waiting = sorted(actions, key=lambda one: one[0])
        first = None
        self.now_ns = self.sonde.epoch_ns
        self._say_list()
        for block in itertools.takewhile(lambda _: self.sonde.time <= seconds, self.sonde.blocks(step_s)):
            for name in block:
                for vector in VECTORS:
                    if vector in (block[name].dtype.names or ()) and name != "truth":
                        block[name][vector] = block[name][vector] @ self.mat
            # Samples arrive within their block, in the order in which they are sent, whatever their stamps.
            span = self.now_ns, max(self.now_ns, self.sonde.epoch_ns + round(self.sonde.time * 1e9))
            for name, samples in block.items():
                if name != "truth":
                    self._record(name, samples, span)
            self.now_ns = span[1]
            self._estimate(block)
            first = self.now_ns if first is None else first
            while waiting and (self.now_ns - first) * 1e-9 >= waiting[0][0]:
                waiting.pop(0)[1](self)
        for survey in self.pipeline.finish().surveys:
            self._on_survey(survey)
        self.revisions.finish()
        for _, action in waiting:
            action(self)
        self.say_used()
        self.revisions.close()
        self.bag.close()
        return self.list

    def _record(self, name, samples, span):
        lost = min(self._lost.get(name, 0), len(samples))
        self._lost[name] = self._lost.get(name, 0) - lost
        layout, kept = wire.SONDE_TOPICS[name], samples[lost:]
        if len(kept):
            frame = "w1/rig_floor" if name == "rig/state" else "w1/sonde_link"
            channel = self.bag.topic(f"/w1/{name}", layout.type_name)
            log_ns = np.maximum.accumulate(np.clip(kept["stamp_ns"], *span))
            self.bag.write_rows(channel, layout.encode(kept, frame), log_ns)

    def _estimate(self, block):
        block = {name: self._taken_as_stated(name, samples) for name, samples in block.items()}
        for name, push in BESIDE.items():
            if name in block and len(block[name]):
                self._count(name, block[name])
                getattr(self.pipeline, push)(block[name])
        imu = block["imu/data_raw"]
        if not len(imu):
            return
        self._count("imu/data_raw", imu)
        output = self.pipeline.push_imu(imu)
        self.newest_ns = max(self.newest_ns, int(imu["stamp_ns"].max()))
        if output.health:
            self.revisions.judge_again(self.pipeline)
        for survey in output.surveys:
            self._on_survey(survey)
        self.revisions.finish()

    def _taken_as_stated(self, name, samples):
        """Samples that came once, without the vectors that covariances declare absent, as the node takes them."""
        if name not in UNITS or not len(samples):
            return samples
        samples = self._repeated[name].take(samples["stamp_ns"], samples)[1]
        return input_covariance.judge(samples, wire.SONDE_TOPICS[name].type_name)[0]

    def _count(self, name, samples):
        stamps = samples["stamp_ns"]
        low, high, count = self.used.get(name, (int(stamps.min()), int(stamps.max()), 0))
        self.used[name] = min(low, int(stamps.min())), max(high, int(stamps.max())), count + len(samples)

    # What the nodes send.

    def write(self, name, type_name, message):
        self.now_ns += 1000
        if name not in self._skip:
            data = bytes(self.store.serialize_cdr(message, type_name))
            self.bag.write(self.bag.topic(f"/w1/{name}", type_name), data, self.now_ns, self.now_ns)

    def _listed(self, survey):
        return survey.record("w1/sonde_link")

    def _survey(self, name, survey):
        self.write(name, SURVEY, survey.to_message(self.make))

    def replace(self, surveys):
        if surveys is not self.list:
            self.list = surveys
            self._say_list()

    def _say_list(self):
        self.write("surveys", LIST, message_conversion.list_message(self.list, "wellhead", self.make))

    def _on_survey(self, survey):
        self.published.append(survey)
        listed = self._listed(survey)
        self._survey("survey", listed)
        self.depth += 10.0
        self.replace(self.list.add(listed, self.depth, 0.0))
        self.revisions.take(survey, self.pipeline, "w1/sonde_link")

    def _on_revision(self, survey, _frame):
        listed = self._listed(survey)
        self._survey("survey/revised", listed)
        self.replace(self.list.revise(listed))

    def say_used(self):
        topics = []
        for name, (first, last, count) in self.used.items():
            times = {"first": time_message(first, self.make), "last": time_message(last, self.make)}
            fields = {"topic": f"/w1/{name}", "samples": count, **times}
            topics.append(self.make("mwd_msgs/msg/SampleCount", fields))
        self.write("used_samples", USED, self.make(USED, {"topics": topics}))

    # Requests.

    def _tell(self, kind, stamp_ns, act, **fields):
        reason = ""
        try:
            act()
        except ValueError as error:
            reason = str(error)
        self.answers.append(reason)
        header = self.make(HEADER, {"stamp": time_message(stamp_ns, self.make)})
        said = {"header": header, "kind": kind, "success": not reason, "message": reason}
        self.write("operator_events", EVENT, self.make(EVENT, {**said, **fields}))

    def ask(self, kind, duration=0.0):
        acts = {
            TAKE: lambda: self.pipeline.request_survey(duration),
            ROTARY: lambda: self.pipeline.requests.start_rotary(duration),
            RESET: self.pipeline.reset,
        }
        self._tell(kind, self.newest_ns, acts[kind], duration=duration)

    def judge(self, kind, which, who, *, depth=-1.0, replace=True, reason="so"):
        """Accept or reject the survey that was published as number `which` from the end."""
        found = self.published[-which] if len(self.published) >= which else None
        number = 99 if found is None else found.sequence
        stamp_ns = self.now_ns + 500

        def act():
            if kind == ACCEPT:
                taken = self.list.accept(number, who, reason, stamp_ns, measured_depth=depth, replace=replace)
            else:
                taken = self.list.reject(number, who, reason, stamp_ns)
            self.replace(taken)

        fields = {"uuid": "" if found is None else found.uuid, "sequence": number, "operator_name": who}
        self._tell(kind, stamp_ns, act, reason=reason, depth=depth, replace=replace, **fields)
