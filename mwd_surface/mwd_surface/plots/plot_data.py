# SPDX-License-Identifier: Apache-2.0
"""Data for a plot of a bag, collected in constant memory while the bag is read once; an Allan plot reads it twice."""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mwd_estimation.core.stream_clock import StreamClock
from mwd_estimation.survey.survey import Survey
from mwd_sensors.calibration.allan import AllanCurve, allan
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.topic_info import listed
from mwd_surface.plots.traces import NORTHS, WHAT, Trace, north_of, traces_of
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.input_stream import RecordingStream, asked_span
from mwd_surface.surveys.message_conversion import record_of
from mwd_surface.surveys.survey_record import SurveyRecord

_SURVEY, _RECORD = "mwd_msgs/msg/Survey", "mwd_msgs/msg/SurveyRecord"
# Largest difference between the stamp of a sample and its time of recording, ns. A stamp that differs more is from
# another clock, and the time of recording is used instead.
_OTHER_CLOCK_NS = 60 * wire.NANOSECONDS
# An interval is still if the variation within every half second is less than these limits, rad/s and m/s^2, and less
# than _AS_QUIET times the 10th percentile. It is at least _STILL_S long, s.
_QUIET_RATE, _QUIET_FORCE = 0.03, 0.25
_AS_QUIET = 1.8
_STILL_S = 10.0
_SEGMENT_S = 10.0  # longest segment of a spectrum, s


@dataclasses.dataclass
class Panel:
    """One panel over time: definition, topic, samples in time bins, and north of the azimuths (see `NORTHS`)."""

    trace: Trace
    topic: str
    envelope: Envelope
    north: int = 0

    @property
    def title(self) -> str:
        """Title of the panel: topic and quantity, with the north reference."""
        return f"{self.topic}: {self.trace.title.format(north=NORTHS.get(self.north, 'unnamed'))}"


@dataclasses.dataclass
class SpectrumOf:
    """Spectrum of one vector of one topic."""

    topic: str
    quantity: str
    unit: str
    spectrum: Spectrum


@dataclasses.dataclass
class AllanOf:
    """Allan deviation of one vector of one topic over its longest still interval."""

    topic: str
    quantity: str
    start_s: float  #: begin of the interval after the start of the plot
    seconds: float  #: length of the interval, s
    curve: AllanCurve


@dataclasses.dataclass
class PlotData:
    """Data for the plot of a bag."""

    name: str  #: name of the bag
    #: `start_ns`, `end_ns`: span drawn, ns since the epoch
    start_ns: int
    end_ns: int
    #: `panels`, `spectra`, `allan`, `surveys`: data of each part of the plot; each survey is paired with its measured
    #: depth, m, or NaN
    panels: list[Panel] = dataclasses.field(default_factory=list)
    spectra: list[SpectrumOf] = dataclasses.field(default_factory=list)
    allan: list[AllanOf] = dataclasses.field(default_factory=list)
    surveys: list[tuple[Survey, float]] = dataclasses.field(default_factory=list)
    remarks: list[str] = dataclasses.field(default_factory=list)  #: reasons why requested data cannot be shown

    @property
    def seconds(self) -> float:
        """Length of the span, s."""
        return (self.end_ns - self.start_ns) * 1e-9


def gather(
    bag: Bag,
    what: Sequence[str] = ("sensors", "attitude", "surveys"),
    given: InputSettings | None = None,
    topics: Sequence[str] = (),
    bins: int = 1600,
    progress: Callable[[float], None] = lambda _share: None,
) -> PlotData:
    """
    Return the data for a plot, read from a bag.

    Parameters
    ----------
    what : sequence of str
        Words of `traces.WHAT`.
    given : InputSettings, optional
        Settings for reading the samples, and the span to read.
    topics : sequence of str
        Full names of the topics to draw; empty: all topics that can be drawn.
    bins : int
        Number of time bins of the plot.
    progress : callable
        Called with the completed share, 0 to 1.

    Raises
    ------
    ValueError
        `what` has an unknown word, or the span ends before it starts.
    BagError
        The bag does not have a topic of `topics`, or no data of `what`.
    """
    given = given or InputSettings()
    _check_request(bag, what, given.start_s)
    begin, end = asked_span(bag, given)
    first, last = begin or bag.start_ns, min(bag.end_ns, end or bag.end_ns)
    data = PlotData(bag.path.resolve().name, first, last)
    stream = RecordingStream(bag, _chosen(bag, topics), given)
    pens = _pens(bag, stream, what, data, bins)
    if not pens:
        asked = ", ".join(what)
        has = ", ".join(f"{topic.name} ({topic.type_name})" for topic in bag.topics.values())
        unread = listed([topic for topic in bag.unreadable.values() if topic.count])
        cannot = f"; not read: {unread}" if unread else ""
        raise BagError(f"{bag.path} has nothing to draw for {asked}", f"it has {has}{cannot}")
    stream = RecordingStream(bag, sorted({pen.topic for pen in pens}), given)
    for block in stream.blocks(first, last + 1):
        for pen in pens:
            if pen.topic in block:
                pen.draw(block[pen.topic])
        newest = max((int(part[0][-1]) for part in block.values()), default=first)
        progress(min((newest - first) / max(last - first, 1), 1.0))
    data.remarks += stream.remarks
    for pen in pens:
        pen.end()
    progress(1.0)
    data.panels = [panel for panel in data.panels if panel.envelope.samples]
    data.spectra = [item for item in data.spectra if item.spectrum.segments]
    if not (data.panels or data.spectra or data.allan or data.surveys):
        reason = f" ({'; '.join(data.remarks)})" if data.remarks else ""
        raise BagError(f"{bag.path} has nothing to draw for {', '.join(what)}{reason}")
    return data


def _check_request(bag: Bag, what: Sequence[str], start_s: float) -> None:
    for word in what:
        if word not in WHAT:
            raise ValueError(f"--what {word}: unknown; use one of {', '.join(WHAT)}")
    if start_s > bag.duration_s:
        raise ValueError(f"--start {start_s:g}: the recording ends after {bag.duration_s:.1f} s")


def _chosen(bag: Bag, topics: Sequence[str]) -> list[str]:
    if not topics:
        # Omit imu/data, which is the estimator's copy of the IMU data, so that no data are drawn twice.
        return sorted((name for name in bag.topics if not name.endswith("imu/data")), key=_order)
    names = []
    for name in topics:
        found = [candidate for candidate in (name, f"/{name}") if candidate in bag.topics]
        if not found:
            raise BagError(f"{bag.path} has no topic {name}", f"it has {', '.join(bag.topics)}")
        names.append(found[0])
    return names


def _order(topic: str) -> tuple[str, int, str]:
    """Return the sort key of a topic: by well, then in the order of `wire.SONDE_TOPICS`."""
    for k, relative in enumerate(wire.SONDE_TOPICS):
        if topic.endswith(f"/{relative}"):
            return topic.removesuffix(relative), k, topic
    return topic.rpartition("/")[0] + "/", len(wire.SONDE_TOPICS), topic


class _Pen(abc.ABC):
    """Collector of the samples of one topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic

    @abc.abstractmethod
    def draw(self, part: tuple[Stamps, Any]) -> None:
        """Add the times of recording and the samples of a block."""

    def end(self) -> None:  # noqa: B027  (most collectors have nothing to finish)
        """Finish after the last block."""


def _pens(bag: Bag, stream: RecordingStream, what: Sequence[str], data: PlotData, bins: int) -> list[_Pen]:
    pens: list[_Pen] = []
    for topic in stream.names:
        about = bag.topics[topic]
        if about.count == 0:
            continue
        traces = [t for t in traces_of(about.gives) if t.what in what or (t.key and _compared(t, what))]
        if traces:
            pens.append(_TimePen(topic, traces, data, bins))
        if "surveys" in what and about.type_name in (_SURVEY, _RECORD):
            pens.append(_SurveyPen(topic, about.type_name, data, bag))
        if about.gives in _VECTORS and "spectra" in what:
            pens.append(_SpectrumPen(topic, about.gives, data))
        if about.gives == wire.IMU.type_name and "allan" in what:
            pens.append(_StillPen(topic, data, RecordingStream(bag, [topic], stream.given)))
    return pens


def _compared(trace: Trace, what: Sequence[str]) -> bool:
    """Return whether a trace is the truth of the simulator, which is drawn for comparison if the attitude is drawn."""
    return trace.what == "truth" and "attitude" in what


class _TimePen(_Pen):
    def __init__(self, topic: str, traces: list[Trace], data: PlotData, bins: int) -> None:
        super().__init__(topic)
        self.panels = [
            Panel(t, topic, Envelope(data.start_ns, data.end_ns, len(t.labels), bins, t.circle)) for t in traces
        ]
        data.panels += self.panels

    def draw(self, part: tuple[Stamps, Any]) -> None:
        log_ns, samples = part
        stamps = _times(log_ns, samples)
        for panel in self.panels:
            if panel.north == 0 and "north" in (samples.dtype.names or ()):
                panel.north = north_of(samples)
            panel.envelope.add(stamps, panel.trace.values(samples))


class _SurveyPen(_Pen):
    def __init__(self, topic: str, type_name: str, data: PlotData, bag: Bag) -> None:
        super().__init__(topic)
        self.type_name, self.data, self.bag = type_name, data, bag
        self.found: dict[str, tuple[Survey, float]] = {}

    def draw(self, part: tuple[Stamps, Any]) -> None:
        for message in part[1]:
            decoded = self.bag.decode(self.topic, message)
            if self.type_name == _RECORD:
                record: SurveyRecord = record_of(decoded)
                self.found[record.survey.uuid] = (record.survey, record.measured_depth)
            else:
                survey = Survey.from_message(decoded)
                self.found[survey.uuid] = (survey, math.nan)

    def end(self) -> None:
        # Only the records of the survey list have depths: a record with a depth replaces the survey without depth.
        known = {survey.uuid: (survey, depth) for survey, depth in self.data.surveys}
        for uuid, (survey, depth) in self.found.items():
            if uuid not in known or not math.isnan(depth):
                known[uuid] = (survey, depth)
        self.data.surveys = sorted(known.values(), key=lambda item: item[0].stamp_ns)


_VECTORS = {
    wire.IMU.type_name: (
        ("angular rate", "deg/s", "angular_velocity", 180.0 / math.pi),
        ("specific force", "m/s²", "linear_acceleration", 1.0),
    ),
    wire.MAG.type_name: (("magnetic field", "nT", "magnetic_field", 1e9),),
}


class _SpectrumPen(_Pen):
    def __init__(self, topic: str, type_name: str, data: PlotData) -> None:
        super().__init__(topic)
        self.vectors, self.data = _VECTORS[type_name], data
        self._clock = StreamClock()
        self.spectra: list[Spectrum] = []

    def draw(self, part: tuple[Stamps, Any]) -> None:
        log_ns, samples = part
        # Use the times of the sensor: samples may share a stamp.
        stamps = self._clock.times(_times(log_ns, samples))
        if not self.spectra and not self._begin(stamps):
            return
        fresh = np.concatenate([[True], np.diff(stamps) > 0])
        for spectrum, (_, _, field, scale) in zip(self.spectra, self.vectors, strict=True):
            spectrum.add(stamps[fresh], samples[field][fresh] * scale)

    def _begin(self, stamps: Stamps) -> bool:
        rate = rate_of(stamps)
        if rate <= 0.0:
            return False
        seconds = self.data.seconds
        # Use shorter segments for a short recording, so that several periodograms are averaged.
        longest = min(_SEGMENT_S, max(seconds / 8.0, 16.0 / rate))
        segment = max(16, 1 << int(math.log2(longest * rate)))
        bins = int(min(240, max(1, seconds * rate / segment)))
        for quantity, unit, _, _ in self.vectors:
            spectrum = Spectrum(rate, 3, self.data.start_ns, self.data.end_ns, segment, bins)
            self.spectra.append(spectrum)
            self.data.spectra.append(SpectrumOf(self.topic, quantity, unit, spectrum))
        return True


class _StillPen(_Pen):
    """Finder of the longest still interval, which is then read again to compute its Allan deviation."""

    def __init__(self, topic: str, data: PlotData, again: RecordingStream) -> None:
        super().__init__(topic)
        self.data, self.again = data, again
        self.rate = 0.0
        self._stamps = np.empty(0, dtype=np.int64)
        self._held = np.empty((0, 6))
        # For every half second: first and last stamp; spread of rate and force, and mean force. A day has 170 000 rows.
        self._edges: list[tuple[int, int]] = []
        self._moved: list[tuple[float, ...]] = []

    def draw(self, part: tuple[Stamps, Any]) -> None:
        log_ns, samples = part
        self.rate = self.rate or rate_of(log_ns)
        if not self.rate:
            return
        self._stamps = np.concatenate([self._stamps, log_ns])
        values = np.column_stack([samples["angular_velocity"], samples["linear_acceleration"]])
        self._held = np.concatenate([self._held, values])
        window = max(4, round(0.5 * self.rate))
        whole = len(self._held) // window
        for k in range(whole):
            first, last = k * window, (k + 1) * window
            values = self._held[first:last]
            spread = np.ptp(values, axis=0)
            self._edges.append((int(self._stamps[first]), int(self._stamps[last - 1])))
            self._moved.append((float(spread[:3].max()), float(spread[3:].max()), *values[:, 3:].mean(axis=0)))
        self._stamps, self._held = self._stamps[whole * window :], self._held[whole * window :]

    def _longest(self) -> tuple[int, int]:
        """Return first and last stamp of the longest still interval, ns; (0, 0) if there is none."""
        if not self._edges:
            return 0, 0
        edges, moved = np.array(self._edges), np.array(self._moved)
        spread, mean = moved[:, :2], moved[:, 2:]
        # During a steady rotation the rate is also constant, but the direction of the specific force changes.
        turned = np.abs(np.diff(mean, axis=0, prepend=mean[:1])).max(axis=1)
        quiet = (spread < (_QUIET_RATE, _QUIET_FORCE)).all(axis=1) & (turned < 0.5 * _QUIET_FORCE)
        quiet &= (edges[:, 1] - edges[:, 0]) * 1e-9 < 0.75
        if not quiet.any():
            return 0, 0
        # Vibration by the pumps is below these limits, so keep only the quietest parts, which show the sensor noise.
        floor = np.percentile(spread[quiet], 10, axis=0)
        quiet &= (spread <= np.maximum(_AS_QUIET * floor, 1e-9)).all(axis=1)
        changes = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]]))).reshape(-1, 2)
        spans = edges[changes[:, 1] - 1, 1] - edges[changes[:, 0], 0]
        first, past = changes[int(np.argmax(spans))]
        return int(edges[first, 0]), int(edges[past - 1, 1])

    def end(self) -> None:
        start, end = self._longest()
        if (end - start) * 1e-9 < _STILL_S:
            self.data.remarks.append(f"{self.topic} has no still interval of {_STILL_S:g} s for an Allan deviation")
            return
        vectors = _VECTORS[wire.IMU.type_name]
        records = [LongAllan(self.rate, 3) for _ in vectors]
        for block in self.again.blocks(start, end + 1):
            samples = block[self.topic][1]
            for record, (_, _, field, _) in zip(records, vectors, strict=True):
                record.add(np.array(samples[field]))
        missing = 1.0 - records[0].samples / ((end - start) * 1e-9 * self.rate + 1.0)
        if missing > 0.01:
            self.data.remarks.append(f"{self.topic}: {missing:.0%} of the still interval's samples are missing")
        for record, (quantity, _, _, _) in zip(records, vectors, strict=True):
            span = (start - self.data.start_ns) * 1e-9, (end - start) * 1e-9
            self.data.allan.append(AllanOf(self.topic, quantity, *span, record.curve()))


def rate_of(stamps: Stamps) -> float:
    """Return the sampling rate, Hz, from the median step of the stamps; 0 if unknown."""
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    return float(1e9 / np.median(steps)) if len(steps) >= 8 else 0.0


def _times(log_ns: Stamps, samples: Samples) -> Stamps:
    """Return the stamps of the samples, or the times of recording if the stamps are from another clock, ns."""
    stamps = samples["stamp_ns"]
    return np.where(np.abs(stamps - log_ns) > _OTHER_CLOCK_NS, log_ns, stamps)


# Spectrum of a signal of any length, and its change over time, from averaged periodograms, in constant memory.


class Spectrum:
    """
    One-sided power spectral density of k columns, over the whole span and in time bins.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    start_ns, end_ns : int
        Span that is divided into time bins.
    segment : int
        Number of samples in a periodogram.
    bins : int
        Number of time bins.
    """

    def __init__(
        self, rate: float, columns: int, start_ns: int, end_ns: int, segment: int = 1024, bins: int = 240
    ) -> None:
        self.rate, self.segment = rate, segment
        self.segments = 0
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
        self._start, self._span = start_ns, end_ns - start_ns + 1
        self._sum = np.zeros((bins, segment // 2 + 1, columns))
        self._count = np.zeros(bins, dtype=np.int64)
        self._held_ns = np.empty(0, dtype=np.int64)
        self._held = np.empty((0, columns))

    @property
    def frequency(self) -> Array:
        """Frequencies, Hz, shape (segment // 2 + 1,)."""
        return np.asarray(np.arange(self.segment // 2 + 1) * self.rate / self.segment)

    @property
    def density(self) -> Array:
        """Power spectral density over the whole span, (unit of the signal)^2 / Hz, shape (frequencies, columns)."""
        return np.asarray(self._sum.sum(axis=0) / max(self.segments, 1))

    @property
    def waterfall(self) -> Array:
        """Density as in `density`, but in each time bin, shape (bins, frequencies, columns); NaN in an empty bin."""
        count = np.where(self._count > 0, self._count, np.nan)
        return np.asarray(self._sum / count[:, None, None])

    def add(self, stamp_ns: Stamps, values: Array) -> None:
        """
        Add samples in order of time; the division into blocks has no effect on the spectrum.

        stamp_ns, shape (n,); values, shape (n, columns). A segment with a gap or with a value that is not finite is
        skipped.
        """
        stamps = np.concatenate([self._held_ns, stamp_ns])
        signal = np.concatenate([self._held, values])
        half = self.segment // 2
        first = 0
        while first + self.segment <= len(signal):
            self._add_segments(stamps[first : first + self.segment], signal[first : first + self.segment])
            first += half
        self._held_ns, self._held = stamps[first:], signal[first:]

    def _add_segments(self, stamps: Stamps, signal: Array) -> None:
        seconds = (stamps[-1] - stamps[0]) * 1e-9
        usual = (self.segment - 1) / self.rate
        if abs(seconds - usual) > 0.02 * usual + 1.5 / self.rate or not np.isfinite(signal).all():
            return
        amplitude = np.fft.rfft((signal - signal.mean(axis=0)) * self._window[:, None], axis=0)
        power = (amplitude.real**2 + amplitude.imag**2) / (self.rate * np.sum(self._window**2))
        power[1 : (self.segment + 1) // 2] *= 2.0
        middle = (int(stamps[self.segment // 2]) - self._start) / self._span
        k = min(max(int(middle * len(self._count)), 0), len(self._count) - 1)
        self._sum[k] += power
        self._count[k] += 1
        self.segments += 1


# Allan deviation of a record of any length, in constant memory.


# For averaging times shorter than the duration of this number of stored means, the curve is computed from the first
# `capacity` samples of the record, before any samples were averaged.
_FROM_MEANS = 16


class LongAllan:
    """
    Collector of a record of any length, which computes the overlapping Allan deviation of the record.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    capacity : int
        Largest number of samples or means in memory; even.
    """

    def __init__(self, rate: float, columns: int, capacity: int = 1 << 18) -> None:
        self.rate, self.samples = rate, 0
        self._kept = np.empty((capacity, columns))
        self._count, self._ratio = 0, 1
        self._left = np.empty((0, columns))
        self._short: AllanCurve | None = None

    def add(self, values: Array) -> None:
        """Add samples, shape (n, columns), equally spaced in time, measured at rest."""
        self.samples += len(values)
        pending = np.concatenate([self._left, values])
        self._left = pending[:0]
        while len(pending):
            if self._count == len(self._kept):
                self._halve()
            whole = min(len(pending) // self._ratio, len(self._kept) - self._count)
            if whole == 0:
                self._left = pending
                return
            taken, pending = pending[: whole * self._ratio], pending[whole * self._ratio :]
            means = taken.reshape(whole, self._ratio, -1).mean(axis=1)
            self._kept[self._count : self._count + whole] = means
            self._count += whole

    def curve(self) -> AllanCurve:
        """
        Return the Allan deviation of each column, for averaging times up to a fifth of the record.

        Raises
        ------
        ValueError
            There are fewer than 20 samples, or samples that are not finite.
        """
        long = allan(self._kept[: self._count], self.rate / self._ratio)
        if self._short is None:
            return long
        limit = _FROM_MEANS * self._ratio / self.rate
        early, late = self._short.tau < limit, long.tau >= limit
        return AllanCurve(
            np.concatenate([self._short.tau[early], long.tau[late]]),
            np.concatenate([self._short.deviation[early], long.deviation[late]]),
            np.concatenate([self._short.sigma[early], long.sigma[late]]),
        )

    def _halve(self) -> None:
        if self._short is None:
            self._short = allan(self._kept, self.rate)
        half = self._count // 2
        self._kept[:half] = 0.5 * (self._kept[0 : self._count : 2] + self._kept[1 : self._count : 2])
        self._count = half
        self._ratio *= 2


# Reduction of a long signal to the width of a plot: lowest and highest value in each of a fixed number of time bins.


# Interval between two samples, as a multiple of the usual interval, above which the line is interrupted.
_GAP = 5.0


class Envelope:
    """
    Lowest and highest value of k columns in each time bin of a span.

    Parameters
    ----------
    start_ns, end_ns : int
        Span; samples outside are ignored.
    circle : float
        If positive, the values are angles with this period. Each angle is changed by whole periods to the value nearest
        to the first value of its column, so that a line does not jump where the angle wraps.
    """

    def __init__(self, start_ns: int, end_ns: int, columns: int, bins: int = 1600, circle: float = 0.0) -> None:
        self.circle = circle
        self._start, self._span = start_ns, end_ns - start_ns + 1
        self._low = np.full((bins, columns), np.nan)
        self._high = np.full((bins, columns), np.nan)
        self._at = np.zeros(bins, dtype=np.int64)
        self._count = np.zeros(bins, dtype=np.int64)
        self._first = np.full(columns, np.nan)

    @property
    def exact(self) -> bool:
        """Whether no bin has more than one sample."""
        return int(self._count.max()) <= 1

    @property
    def samples(self) -> int:
        """Number of samples added."""
        return int(self._count.sum())

    def add(self, stamp_ns: Stamps, values: Array) -> None:
        """
        Add samples, in any order of time.

        stamp_ns, shape (n,); values, shape (n, columns): values that are not finite count as missing.
        """
        inside = (stamp_ns >= self._start) & (stamp_ns < self._start + self._span)
        if not inside.all():
            stamp_ns, values = stamp_ns[inside], values[inside]
        if len(stamp_ns) == 0:
            return
        values = np.where(np.isfinite(values), values, np.nan)
        if self.circle:
            values = self._near_first(values)
        bins = len(self._at)
        # Compute with floats, because for a run of days nanoseconds times bins would overflow an integer.
        index = np.minimum(((stamp_ns - self._start) / self._span * bins).astype(np.int64), bins - 1)
        order = np.argsort(stamp_ns, kind="stable")
        index, stamp_ns, values = index[order], stamp_ns[order], values[order]
        heads = np.flatnonzero(np.diff(index, prepend=-1))
        hit = index[heads]
        self._low[hit] = np.fmin(self._low[hit], np.fmin.reduceat(values, heads, axis=0))
        self._high[hit] = np.fmax(self._high[hit], np.fmax.reduceat(values, heads, axis=0))
        fresh = self._count[hit] == 0
        self._at[hit] = np.where(fresh, stamp_ns[heads], np.minimum(self._at[hit], stamp_ns[heads]))
        self._count[hit] += np.diff(heads, append=len(index))

    def line(self, column: int) -> tuple[Array, Array]:
        """
        Return one column as a line to draw: seconds from the start of the span, and values.

        For a bin with several samples the line has the lowest and the highest value at the same time. A NaN interrupts
        the line where samples are missing or an angle wraps.
        """
        filled = np.flatnonzero(self._count)
        seconds = np.asarray((self._at[filled] - self._start) * 1e-9, dtype=float)
        low, high = self._low[filled, column], self._high[filled, column]
        time = np.repeat(seconds, 2)
        value = np.column_stack([low, high]).ravel()
        keep = np.ones(len(value), dtype=bool)
        keep[1::2] = (low != high) & ~np.isnan(low)
        time, value = time[keep], value[keep]
        return _broken(time, value, seconds, self.circle)

    def _near_first(self, values: Array) -> Array:
        for column in np.flatnonzero(np.isnan(self._first)):
            known = values[:, column][~np.isnan(values[:, column])]
            if len(known):
                self._first[column] = known[0]
        away = (values - self._first + 0.5 * self.circle) % self.circle - 0.5 * self.circle
        return np.asarray(self._first + away)


def _broken(time: Array, value: Array, seconds: Array, circle: float) -> tuple[Array, Array]:
    if len(time) < 2:
        return time, value
    steps = np.diff(seconds)
    usual = float(np.median(steps)) if len(steps) else math.inf
    away = np.diff(time) > _GAP * usual
    if circle:
        away |= (np.abs(np.diff(value)) > 0.5 * circle) & (np.diff(time) > 0.0)
    where = np.flatnonzero(away) + 1
    return np.insert(time, where, time[where]), np.insert(value, where, np.nan)
