# SPDX-License-Identifier: Apache-2.0
"""
Running the estimator over a recording, in constant memory and in stages.

One thread reads blocks ahead of the estimator and another thread writes the results. The samples pass the same
pipeline as in the live node.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import datetime
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core import clip_flags
from mwd_estimation.core.rate_jumps import RateJumps
from mwd_estimation.core.stream_clock import StreamClock
from mwd_estimation.core.track import Track
from mwd_estimation.gravity import smoother as gravity_smoother
from mwd_estimation.gravity.bounded.filter import BoundedParams
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.core import burst, input_covariance, wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.mount import Mount, MountSettings, resolve
from mwd_surface.bags.bag_reader import Bag, BagError, Block, MessagePart
from mwd_surface.processing.bag_input import (
    FIELDS,
    InputSettings,
    Topics,
    check_units,
    find_topics,
    guesses,
    mount_of,
    refuse_damaged,
    refuse_wrong_unit,
    tool_frame,
    worth_saying,
)
from mwd_surface.processing.input_stream import InputStream, asked_span, offsets_of_clock, problems, refuse
from mwd_surface.processing.list_builder import ListBuilder
from mwd_surface.processing.recorded_requests import RecordedRequest, RecordedRequests
from mwd_surface.processing.rests import Rests
from mwd_surface.processing.run_output import Merger
from mwd_surface.processing.run_summary import Summary, hindrance, pipeline_warnings
from mwd_surface.surveys.recorded_settings import Recorded

# Samples of a block, by topic.
BlockSamples = dict[str | None, Samples]
# Largest difference, s, between the stamps of two sensors at the same log time. A larger difference shows that the
# sensors use different clocks.
_SKEW_S = 1.0


@dataclasses.dataclass(frozen=True)
class _Result:
    """Result of one stage, for the writer."""

    #: `output`, `log_ns`: results of some IMU samples, and the log times of these samples; or None
    output: Output | None
    log_ns: NDArray[np.int64] | None = None
    originals: list[MessagePart] = dataclasses.field(default_factory=list)  #: messages of the bag
    until_ns: int | None = None  #: no message logged up to this time will follow; None if no such time is known


class BagEstimate:
    """
    One run of the estimator over a bag.

    Parameters
    ----------
    estimator, given : settings
        Settings of the estimator and of the input.
    compensation : Compensation, optional
        Calibration of the AHRS, applied to its samples first.
    smooth : bool
        Smooth the gravity of each sample with the samples after it.
    merger : Merger, optional
        Receives the results, and all messages of the bag.
    recorded : Recorded, optional
        Settings in the recording, with which its live survey list was made.

    Raises
    ------
    BagError
        The bag has no topic of an IMU.
    ValueError
        The settings require a field that no model covers or smooth another method than bounded, or the samples cannot
        be used.
    """

    def __init__(
        self,
        bag: Bag,
        estimator: EstimatorSettings,
        given: InputSettings,
        *,
        compensation: Compensation | None = None,
        smooth: bool = False,
        merger: Merger | None = None,
        recorded: Recorded | None = None,
    ) -> None:
        if smooth and estimator.gravity.method != "bounded":
            raise ValueError(f"smooth: only the method bounded can be smoothed, not {estimator.gravity.method}")
        self.topics = find_topics(bag, given)
        self._bag, self._estimator, self._given = bag, estimator, given
        self._compensation, self._merger = compensation, merger
        # Raise an error before the run begins if the date is outside the field model; the live node continues then.
        derivation.reference(estimator, bag.start_ns)
        mount = mount_of(bag, self.topics, estimator.tool.mount)
        self._pipeline = Pipeline(estimator, mount=mount)
        frame = tool_frame(bag, self.topics, mount)
        self._list = ListBuilder(bag, self.topics, estimator, given, recorded or Recorded(), frame)
        if merger is not None:
            merger.frame = frame
        begin_ns = bag.start_ns + round(given.start_s * 1e9)
        same = estimator == (recorded or Recorded()).estimator
        self._requests = RecordedRequests(bag, self._list.namespace, begin_ns, with_field=same)
        self._used = UsedSamples(bag, self._list.namespace)
        # For each of the last two blocks: the samples of all sensors, and the block. If the estimate restarts, it needs
        # the samples again of all sensors except the IMU.
        self._companions: list[tuple[BlockSamples, Block]] = []
        self._queue = ImuQueue(_smoothing(estimator, bag.start_ns) if smooth else None, mount)
        self._span = asked_span(bag, given)
        refuse(problems(bag, self.topics, given, estimator.place))
        self._stream = InputStream(bag, self.topics, given)
        self._unchecked = {self.topics.imu, self.topics.mag}
        self._use_mag = self.topics.mag is not None
        self._rests = Rests(estimator.survey)
        self._summary = Summary(self.topics, warnings=guesses(bag, self.topics, given))

    def run(self, sink: Callable[[Output], None], progress: Callable[[float], None] = lambda _share: None) -> Summary:
        """
        Run the estimator and return the summary.

        sink : called with the output of each block, in order of time, in a separate thread; an exception in `sink` ends
        the run.
        progress : called with the completed share, 0 to 1.

        Raises
        ------
        BagError
            The bag is cut off or damaged (unless `given.partial`), or has no IMU sample.
        ValueError
            The samples cannot be used; OptionNeededError if options of the input solve the problem.
        """
        refuse_damaged(self._bag, self._given)
        self._warn_of_input()

        def write(result: _Result) -> None:
            if self._merger is not None:
                self._merger.take(result.output, result.log_ns, result.originals, result.until_ns)
            if result.output is not None:
                sink(result.output)
                self._summary.count(result.output)

        with behind(write) as give:
            for result in self._results(progress):
                if result.output is not None:
                    log_ns = None if result.log_ns is None else int(result.log_ns[-1])
                    self._summary.surveys += [
                        (survey, self._list.add(survey, log_ns)) for survey in result.output.surveys
                    ]
                    self._summary.faults += result.output.health
                give(result)
        progress(1.0)
        self._close()
        # Some damage is found only while reading.
        refuse_damaged(self._bag, self._given)
        if self._summary.rows == 0:
            self._refuse_empty()
        self._summary.warnings += worth_saying(self._bag)
        return self._summary

    def _refuse_empty(self) -> None:
        start_s, long = self._given.start_s, (self._bag.end_ns - self._bag.start_ns) * 1e-9
        if start_s > long > 0.0:
            raise BagError(f"{self._bag.path} ends after {long:.1f} s, before --start {start_s:g}")
        state = f"{self._bag.path} has no IMU sample in {self.topics.imu}"
        raise BagError(state, "look at the recording with `mwd bag info`")

    def _warn_of_input(self) -> None:
        unusable = self._pipeline.mount.unusable
        self._use_mag = self._use_mag and "mag" not in unusable
        units = {"mag": self.topics.mag, "precision": self.topics.precision}
        self._summary.warnings += [f"{units[unit]} is not used: {why}" for unit, why in unusable.items()]
        assumed = self._pipeline.mount.assumed
        taken = "is assumed to have the axes of the IMU"
        self._summary.warnings += [f"{units[unit]} {taken}: {why}" for unit, why in assumed.items()]

    def _blocks(self) -> Generator[tuple[Block, list[MessagePart]], None, None]:
        """Yield the blocks of the bag, each with the unchanged messages of its time if there is a merger."""
        if self._merger is not None:
            yield from self._bag.blocks_and_originals(self.topics.all, *self._span, fields=FIELDS)
            return
        for block in self._bag.blocks(self.topics.all, *self._span, fields=FIELDS):
            yield block, []

    def _results(self, progress: Callable[[float], None]) -> Iterator[_Result]:
        begin, end = self._bag.start_ns, self._bag.end_ns
        begin, end = self._span[0] or begin, min(end, self._span[1] or end)
        with ahead(self._blocks()) as ready:
            for recorded, originals in ready:
                block = self._stream.take(recorded)
                refuse(self._stream.problems)
                samples = self._checked(block)
                # The other sensors are one block ahead of the IMU, so that block boundaries do not affect how samples
                # are paired.
                self._push_companions(samples, block)
                logged = _last_log(recorded, originals)
                for imu in self._queue.done():
                    yield from self._estimated(imu)
                self._companions = self._companions[-1:]
                if self.topics.imu in samples:
                    self._queue.add(samples[self.topics.imu], block[self.topics.imu][0])
                if self._merger is not None:
                    waiting = [self._queue.first_log_ns] if self._queue.waiting else []
                    waiting += [first] if (first := self._stream.first_log_ns) is not None else []
                    until_ns = min(waiting) - 1 if waiting else logged
                    yield _Result(None, None, originals, until_ns)
                progress(min(max((logged - begin) / max(end - begin, 1), 0.0), 1.0))
        if rest := self._stream.finish():
            self._queue.add(self._checked(rest)[self.topics.imu], rest[self.topics.imu][0])
        for imu in self._queue.finish():
            yield from self._estimated(imu)
        for request in self._requests.rest():
            yield from self._asked(request)
        yield _Result(self._pipeline.finish())

    def _estimated(self, imu: Imu) -> Iterator[_Result]:
        """Yield the results of IMU samples, and of the requests that were made between these samples."""
        for part, requests in self._requests.cut(imu.samples["stamp_ns"], imu.log_ns):
            if part.stop > part.start:
                followed = None if imu.followed is None else imu.followed.part(part)
                yield _Result(self._pipeline.push_imu(imu.samples[part], followed), imu.log_ns[part])
            for request in requests:
                yield from self._asked(request)

    def _asked(self, request: RecordedRequest) -> Iterator[_Result]:
        """
        Apply a request of the recording to the pipeline, and yield the output, if any, that results.

        A request that cannot be applied becomes a warning. After a request that restarts the estimate, kept samples
        other than IMU samples are pushed again if they are later than the request.
        """
        try:
            output = request.apply(self._pipeline)
        except ValueError as error:
            self._summary.warnings.append(f"{request.kind} of the recording is not repeated: {error}")
            return
        if request.begins_anew:
            for samples, block in self._companions:
                later: BlockSamples = {
                    name: part[part["stamp_ns"] > request.stamp_ns]
                    for name, part in samples.items()
                    if (part["stamp_ns"] > request.stamp_ns).any()
                }
                self._push_companions(later, block, again=True)
        if output is not None:
            yield _Result(output)

    def _checked(self, block: Block) -> BlockSamples:
        """Return the samples of a block, checked and, if a compensation is given, calibrated."""
        samples: BlockSamples = {name: part[1] for name, part in block.items()}
        self._used.take(samples)
        self._check_units(samples)
        self._judge_covariances(samples)
        self._leave_out_skewed(samples, block)
        self._pass_gate(samples)
        if self.topics.imu in samples:
            self._rests.take(samples[self.topics.imu])
        if self._compensation is not None:
            _compensate(self._compensation, samples, self.topics)
        return samples

    def _check_units(self, samples: BlockSamples) -> None:
        """
        Check the units of the first IMU and magnetometer samples, unless they are the settings of the live list.

        A magnetometer whose readings are implausible in every unit is not used. Raises OptionNeededError if readings
        look like another unit.
        """
        new = {name: samples[name] for name in self._unchecked & samples.keys()}
        self._unchecked -= new.keys()
        if self._list.as_live:
            # The live estimator judged these readings by its own checks, and this run repeats its surveys.
            return
        warnings = check_units(self.topics, new)
        self._summary.warnings += warnings
        self._use_mag = self._use_mag and not any(text.startswith(f"{self.topics.mag}:") for text in warnings)

    def _judge_covariances(self, samples: BlockSamples) -> None:
        """Remove vectors that covariances declare absent, as the live estimator does; warn once of each finding."""
        topics = self.topics
        for topic, layout in ((topics.imu, wire.IMU), (topics.mag, wire.MAG), (topics.precision, wire.IMU)):
            if topic is None or topic not in samples:
                continue
            samples[topic], notes = input_covariance.judge(samples[topic], layout.type_name)
            said = [input_covariance.sentence(topic, vector, note) for vector, note in notes.items()]
            self._summary.warnings += [text for text in said if text not in self._summary.warnings]

    def _leave_out_skewed(self, samples: BlockSamples, block: Block) -> None:
        """
        Leave out sensors whose clock differs from the IMU's by more than `_SKEW_S` according to the log times.

        A warning names the sensors left out.
        """
        topics = self.topics
        if topics.imu not in samples or topics.imu in self._stream.without_time:
            return

        checked: Block = {name: (block[name][0], samples[name]) for name in topics.all if name in samples}

        def offset_s(topic: str) -> float:
            return -float(np.median(offsets_of_clock(checked, topic, topics.imu)))

        for topic in (topics.mag, topics.precision):
            if topic is None or topic not in samples or topic in self._stream.without_time:
                continue
            skew_s = offset_s(topic) - offset_s(topics.imu)
            if abs(skew_s) > _SKEW_S:
                del samples[topic]
                words = f"{topic}: the stamps are seconds ahead of the stamps of {topics.imu}" if skew_s > 0.0 else ""
                words = words or f"{topic}: the stamps are seconds behind the stamps of {topics.imu}"
                words = (
                    f"{words}, as the times of recording show; these samples are not used; stamp both with one clock"
                )
                self._summary.warnings += [words] * (words not in self._summary.warnings)

    def _pass_gate(self, samples: BlockSamples) -> None:
        """Replace impossible sensor values by NaN, before calibration and smoothing carry them into other values."""
        topics, gate = self.topics, self._pipeline.gate
        passes = {topics.imu: gate.imu, topics.mag: gate.mag, topics.precision: gate.precision}
        for topic, take in {**passes, topics.temperature: gate.temperature}.items():
            if topic in samples:
                samples[topic] = take(samples[topic])

    def _push_companions(self, samples: BlockSamples, block: Block, *, again: bool = False) -> None:
        """
        Push all samples except the IMU samples into the pipeline, and the depths of the rig into the survey list.

        The samples of a magnetometer that is not used are left out.

        block : the same samples with the log times of their messages.
        again : the samples were pushed before, and the estimate has been restarted since.
        """
        topics = self.topics
        if not again:
            self._companions.append((samples, block))
        if self._use_mag and topics.mag in samples:
            self._pipeline.push_mag(samples[topics.mag])
        if topics.precision in samples:
            self._pipeline.push_precision(samples[topics.precision])
        if topics.temperature in samples:
            self._pipeline.push_temperature(samples[topics.temperature])
        if topics.rig is not None and topics.rig in samples and not again:
            imu = (block[topics.imu][0], samples[topics.imu]) if topics.imu in samples else None
            self._list.take_rig((block[topics.rig][0], samples[topics.rig]), imu)

    def _close(self) -> None:
        """Complete the summary after the last sample."""
        summary, pipeline, compensation = self._summary, self._pipeline, self._compensation
        if self._merger is not None:
            summary.warnings += self._merger.remarks
        summary.warnings += self._stream.remarks
        summary.north = pipeline.north
        summary.reference = pipeline.reference.source if pipeline.reference is not None else "none"
        if compensation is not None and compensation.without_temperature:
            summary.warnings.append(
                f"{compensation.without_temperature} samples were calibrated before any temperature was known"
            )
        if not self._list.as_live:
            refuse_wrong_unit(self.topics, summary.faults)
            refuse(self._rests.problems(self.topics.imu, self._given.gyro_unit))
        now = pipeline.revisions()
        revised = [
            dataclasses.replace(now[survey.sequence], status=survey.status)
            for survey, _ in summary.surveys
            if survey.sequence in now
        ]
        summary.listed, summary.live = self._list.finish(revised)
        summary.other_input = self._used.differences(self.topics)
        summary.warnings += [*self._requests.remarks, *summary.other_input]
        summary.as_live = self._list.as_live
        summary.mag_used = self._use_mag
        if not summary.surveys:
            summary.no_survey = hindrance(pipeline, summary)
        summary.depths, summary.depth_table = self._list.depth_source, not self._list.uses_rig
        summary.warnings += self._list.warnings
        summary.warnings += pipeline_warnings(summary, pipeline, self._estimator, self._queue.samples_are)


def _last_log(block: Block, originals: list[MessagePart]) -> int:
    """Return the log time of the last message of a block, ns; 0 if there is no message."""
    logged = [int(part[0][-1]) for part in block.values()]
    return max(logged + [int(one.log_ns[-1]) for one in originals if len(one.log_ns)], default=0)


def _smoothing(estimator: EstimatorSettings, start_ns: int) -> BoundedParams:
    """Return the parameters of the smoother: those of the bounded filter, with the local gravity."""
    reference = derivation.reference(estimator, start_ns)
    found: BoundedParams = derivation.gravity_params(estimator, reference.gravity if reference is not None else None)
    return found


def _compensate(compensation: Compensation, samples: BlockSamples, topics: Topics) -> None:
    """Apply the calibration to the AHRS samples of a block, in place."""
    if topics.temperature in samples:
        compensation.push_temperature(samples[topics.temperature])
    if topics.imu in samples:
        samples[topics.imu] = compensation.imu(samples[topics.imu])
    if topics.mag in samples:
        samples[topics.mag] = compensation.mag(samples[topics.mag])


# Check whether a recording holds the samples that the live estimator used. The live estimator publishes the number of
# samples used from each topic, and a recording contains these messages.


TOPIC, TYPE = "used_samples", "mwd_msgs/msg/UsedSamples"


@dataclasses.dataclass
class _Count:
    """Numbers of samples of one topic, in one run of the live estimator."""

    #: `first_ns`, `last_ns`: stamps of the first and the last sample used live
    first_ns: int
    last_ns: int
    used: int  #: number of samples used live
    recorded: int = 0  #: number of samples between these stamps in the recording
    recorded_from_ns: int = 0  #: stamp of the first of these recorded samples


class UsedSamples:
    """
    Counts of the samples used live and of the samples in the recording.

    bag : Bag.
    namespace : namespace of the well, with a slash at its end.
    """

    def __init__(self, bag: Bag, namespace: str) -> None:
        self._counts: dict[str, list[_Count]] = {}
        self._singles = {f"{namespace}{name}": f"{namespace}{single}" for name, single in burst.TOPICS.items()}
        about = bag.topics.get(f"{namespace}{TOPIC}")
        if about is None or about.type_name != TYPE:
            return
        for _, _, _, data in bag.messages([about.name]):
            for one in bag.decode(about.name, data).topics:
                self._take_count(str(one.topic), stamp_of(one.first), stamp_of(one.last), int(one.samples))

    def _take_count(self, topic: str, first_ns: int, last_ns: int, used: int) -> None:
        """
        Add a count that the live estimator published.

        If the first stamp changes or the number of samples falls, the estimator was restarted.
        """
        runs = self._counts.setdefault(topic, [])
        if runs and used >= runs[-1].used and first_ns == runs[-1].first_ns:
            runs[-1] = _Count(first_ns, last_ns, used)
        else:
            runs.append(_Count(first_ns, last_ns, used))

    def take(self, samples: Mapping[str | None, Samples]) -> None:
        """
        Count the samples of the recording between the first and the last stamp of each count of the estimator.

        samples : samples by topic.
        """
        for topic, part in samples.items():
            stamps = part["stamp_ns"]
            for run in self._counts.get(self._singles.get(topic or "", topic or ""), ()):
                inside = stamps[(stamps >= run.first_ns) & (stamps <= run.last_ns)]
                if len(inside):
                    run.recorded += len(inside)
                    begin = int(inside.min())
                    run.recorded_from_ns = min(run.recorded_from_ns or begin, begin)

    def differences(self, topics: Topics) -> list[str]:
        """
        Return a sentence for each run of the live estimator and each topic in use whose numbers of samples differ.

        The number of recorded samples is compared with the number of samples used live.
        """
        found = []
        for topic in topics.all:
            single = self._singles.get(topic, topic)
            for run in self._counts.get(single, ()):
                if run.recorded == run.used:
                    continue
                late_s = (run.recorded_from_ns - run.first_ns) * 1e-9
                begins = f"; its first sample is {late_s:.3g} s later" if run.recorded and late_s > 0.0 else ""
                found.append(
                    f"the input differs from the live input: from {_time(run.first_ns)} on, the live estimator used "
                    f"{run.used} samples of {single}, and the recording has {run.recorded}{begins}; surveys may differ "
                    "from the live surveys"
                )
        return found


def _time(stamp_ns: int) -> str:
    moment = datetime.datetime.fromtimestamp(0, tz=datetime.UTC) + datetime.timedelta(seconds=stamp_ns * 1e-9)
    return f"{moment:%H:%M:%S}.{stamp_ns // 10**6 % 1000:03d}"


# Overlapping stages of a run: one thread fetches items ahead of the work, one thread processes results behind it.


T = TypeVar("T")

_DEPTH = 3  # default number of items that wait between two stages


@contextlib.contextmanager
def ahead(items: Generator[T, None, None], depth: int = _DEPTH) -> Iterator[Iterator[T]]:
    """
    Yield an iterator of the items, which a thread computes at most `depth` items before they are used.

    An exception in `items` is raised where the next item would have been used. When the `with` block ends, early or
    not, the thread finishes the current item and ends, and `items` is closed.
    """
    end: Any = object()
    with contextlib.closing(items), ThreadPoolExecutor(1, "ahead") as thread:
        waiting = collections.deque(thread.submit(next, items, end) for _ in range(depth))

        def used() -> Iterator[T]:
            while (item := waiting.popleft().result()) is not end:
                waiting.append(thread.submit(next, items, end))
                yield item

        try:
            yield used()
        finally:
            thread.shutdown(cancel_futures=True)


@contextlib.contextmanager
def behind(work: Callable[[T], None], depth: int = _DEPTH) -> Iterator[Callable[[T], None]]:
    """
    Yield a function that passes an item to a thread, which calls `work` with each item in order.

    The function waits while `depth` items wait already. An exception of `work` is raised by a later call or at the end
    of the block. If the block ends normally, all items have been processed; if `work` or the block raises an exception,
    waiting items are dropped.
    """
    failed = False

    def worked(item: T) -> None:
        nonlocal failed
        if failed:
            return
        failed = True
        work(item)
        failed = False

    with ThreadPoolExecutor(1, "behind") as thread:
        waiting: collections.deque[Future[None]] = collections.deque()

        def give(item: T) -> None:
            while waiting and (len(waiting) > depth or waiting[0].done()):
                waiting.popleft().result()
            waiting.append(thread.submit(worked, item))

        try:
            yield give
            for one in waiting:
                one.result()
        finally:
            thread.shutdown(cancel_futures=True)


# Queue of IMU samples that wait for the next block, or for enough later samples to smooth them.


# Longest gap in the log times, ns, across which gravity is smoothed. A longer gap divides the samples: those after the
# gap do not affect those before it.
_SILENCE_NS = 60 * wire.NANOSECONDS


@dataclasses.dataclass(frozen=True)
class Imu:
    """IMU samples ready for the estimator."""

    samples: Samples
    log_ns: Stamps  #: log times of the samples
    followed: Track | None  #: smoothed gravity at the samples; None without a smoother


class ImuQueue:
    """
    Queue of IMU samples that wait for the next block or for the smoother.

    smooth : settings of the method bounded, for smoothing gravity; None: no smoothing.
    mount : mount of the units in the tool; gravity is smoothed in tool axes.
    """

    def __init__(self, smooth: BoundedParams | None = None, mount: Mount | None = None) -> None:
        self._mount = mount or resolve(MountSettings())
        self._smoother = gravity_smoother.Smoother(smooth) if smooth is not None else None
        self._jumps, self._clock = RateJumps(), StreamClock()
        self._new: list[tuple[Samples, Stamps]] = []
        self._old: list[tuple[Samples, Stamps]] = []

    @property
    def samples_are(self) -> str:
        """Kind of the samples according to the data, see `BoundedState.samples_are`; "" without a smoother."""
        return self._smoother.samples_are if self._smoother is not None else ""

    @property
    def waiting(self) -> bool:
        """Whether any sample has not been processed yet."""
        return bool(self._old or self._new)

    @property
    def first_log_ns(self) -> int:
        """Log time of the first waiting sample, ns; only valid if a sample waits."""
        return int((self._old or self._new)[0][1][0])

    def add(self, samples: Samples, log_ns: Stamps) -> None:
        """Add the IMU samples of a block with their log times, ns."""
        if len(samples):
            self._new.append((samples, log_ns))

    def done(self) -> Iterator[Imu]:
        """
        Remove and yield the samples that are ready.

        The caller must have pushed the samples of the other sensors for the same time into the pipeline.
        """
        new, self._new = self._new, []
        if self._smoother is None:
            yield from (Imu(samples, log_ns, None) for samples, log_ns in new)
            return
        for samples, log_ns in new:
            last = self._old[-1][1][-1:] if self._old else log_ns[:1]
            silences = np.flatnonzero(np.diff(log_ns, prepend=last) > _SILENCE_NS)
            for k, part in enumerate(zip(np.split(samples, silences), np.split(log_ns, silences), strict=True)):
                if k > 0:
                    yield from self._finished()
                self._old.append(part)
                yield from self._taken([self._push(part[0])])

    def finish(self) -> Iterator[Imu]:
        """Remove and yield all waiting samples."""
        yield from self.done()
        yield from self._finished()

    def _push(self, samples: Samples) -> Track:
        smoother = self._smoother
        if smoother is None:
            return Track.empty(0)
        samples = self._mount.imu_in_tool(samples)
        # Use the times of the sensor, and remove rate jumps, as the estimator does.
        stamps, accel = self._clock.times(samples["stamp_ns"]), samples["linear_acceleration"]
        gyro = self._jumps.without(stamps, np.ascontiguousarray(samples["angular_velocity"]))
        return smoother.push(stamps, gyro, accel, clip_flags.of(samples))

    def _finished(self) -> Iterator[Imu]:
        if self._smoother is not None and self._old:
            rest = self._smoother.finish()
            self._smoother, self._clock = self._smoother.continued(), StreamClock()
            yield from self._taken([rest])

    def _taken(self, parts: list[Track]) -> Iterator[Imu]:
        followed = gravity_smoother.joined([Track.empty(0), *parts])
        count = len(followed.g_t)
        if not count:
            return
        samples = np.concatenate([samples for samples, _ in self._old])
        log_ns = np.concatenate([log_ns for _, log_ns in self._old])
        self._old = [(samples[count:], log_ns[count:])] if count < len(samples) else []
        yield Imu(samples[:count], log_ns[:count], followed)
