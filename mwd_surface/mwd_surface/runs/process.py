"""
A recording to attitude, surveys and the configuration that gave them: the estimator over a bag, in constant memory.

The same `Pipeline` as the live node's runs over blocks of the bag, while a thread reads ahead of it and another writes
behind it. Results appear complete or not at all.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.status import Status
from mwd_estimation.health.fault_messages import Finding
from mwd_estimation.pipeline import EstimatorSettings, Output, Pipeline
from mwd_estimation.survey.survey import Survey
from mwd_estimation.survey.survey_message import survey_fields
from mwd_sensors.calibration.compensation import Compensation
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_surface.bags.bag_reader import Bag, BagError, Block, Originals
from mwd_surface.runs.bag_input import (
    IMU,
    IMU_BURST,
    InputSettings,
    Topics,
    check_imu,
    check_mag,
    find_topics,
    frames_differ,
    guesses,
    in_si,
    refuse_damaged,
    unstamped,
    worth_saying,
)
from mwd_surface.runs.imu_queue import ImuQueue
from mwd_surface.runs.merger import Merger, end_rows
from mwd_surface.runs.overlap import ahead, behind
from mwd_surface.runs.run_config import config_text
from mwd_surface.runs.run_output import OutputSettings, destination, drafts, fault_text, survey_text
from mwd_surface.surveys.depth import DepthTrack
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_message import survey_of_fields
from mwd_surface.surveys.survey_store import encoded
from mwd_surface.surveys.well import Well

# All else of these messages is most of their bytes, and is not read.
_FIELDS = {
    wire.IMU.type_name: ("angular_velocity", "linear_acceleration"),
    wire.MAG.type_name: ("magnetic_field",),
    wire.TEMPERATURE.type_name: ("temperature",),
    wire.RIG_STATE.type_name: ("bit_depth", "valid"),
}
_AFTER = ("surveys.csv", "surveys.json", "faults.csv", "config.yaml")  # files named after the attitude
_MANY_REFUSED = 0.1  # share of the samples that is worth a warning
_MANY_DISTURBED = 0.05
_BIT_DEPTH = 1  # RigState.VALID bit of bit_depth


@dataclasses.dataclass
class Summary:
    """
    What came of a bag.

    Attributes
    ----------
    rows : int
        IMU messages.
    start_ns, end_ns : int
        Stamps of the first and the last of them.
    rejected, gaps, without_gravity, without_azimuth : int
        Rows with that flag or lack.
    disturbed : int
        Rows without an azimuth because the magnetic field was not in order.
    total_off, dip_off : float
        Furthest of the field's total and dip from the reference's about those, T, rad.
    lowest, highest : float
        Inclination met, rad; nan where there is none.
    north, reference : str
        North of the azimuth, and where the field comes from.
    surveys : list of (Survey, measured depth in m or nan)
    listed : SurveyList
        The same as the surface node would keep them: accepted ones in the path, the rest waiting for a person.
    faults : list of Finding
        Faults of sensors, as they were found, narrowed down or cleared.
    warnings : list of str
    files : list of str
        Names of what was written.
    """

    topics: Topics
    rows: int = 0
    start_ns: int = 0
    end_ns: int = 0
    rejected: int = 0
    gaps: int = 0
    without_gravity: int = 0
    without_azimuth: int = 0
    disturbed: int = 0
    total_off: float = 0.0
    dip_off: float = 0.0
    lowest: float = math.nan
    highest: float = math.nan
    north: str = "magnetic"
    reference: str = "none"
    surveys: list[tuple[Survey, float]] = dataclasses.field(default_factory=list)
    listed: SurveyList = dataclasses.field(default_factory=SurveyList)
    faults: list[Finding] = dataclasses.field(default_factory=list)
    warnings: list[str] = dataclasses.field(default_factory=list)
    files: list[str] = dataclasses.field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time covered, s."""
        return (self.end_ns - self.start_ns) * 1e-9


def process(
    bag: Bag,
    folder: Path,
    estimator: EstimatorSettings,
    given: InputSettings | None = None,
    progress: Callable[[float], None] = lambda _share: None,
    compensation: Compensation | None = None,
    wanted: OutputSettings | None = None,
) -> Summary:
    """
    Write the attitude (by default attitude.csv), surveys.csv, surveys.json, faults.csv and config.yaml of a bag.

    surveys.json is the survey list as the surface node keeps it: `mwd export` and `mwd report` take the folder.

    Parameters
    ----------
    bag : Bag
    folder : Path
        Made where it doesn't exist; other files in it are left alone.
    estimator, given : settings
        Of the estimator and of the input.
    progress : callable
        Told the share that is done, 0 to 1, now and then.
    compensation : Compensation, optional
        Calibration of the AHRS, taken off its samples first.
    wanted : OutputSettings, optional

    Raises
    ------
    BagError
        The bag is cut off or damaged (unless `given.partial`), or has no IMU sample.
    ValueError
        The settings ask for a field that no model gives, or the IMU is not in SI.
    OSError
        The folder cannot be written.
    """
    given, wanted = given or InputSettings(), wanted or OutputSettings()
    with drafts(folder) as draft:
        with destination(draft, bag, wanted, given) as (sink, merger):
            summary = estimate(bag, estimator, given, sink, progress, compensation, wanted.smooth, merger)
        (draft / "surveys.csv").write_text(survey_text(summary.surveys), encoding="utf-8")
        (draft / "surveys.json").write_bytes(encoded(summary.listed))
        (draft / "faults.csv").write_text(fault_text(summary.faults), encoding="utf-8")
        config = config_text(estimator, given, wanted, summary.topics)
        (draft / "config.yaml").write_text(config, encoding="utf-8")
        summary.files = [file.name for file in draft.iterdir()]
        # The largest first: what was asked for.
        summary.files.sort(key=lambda name: _AFTER.index(name) if name in _AFTER else -1)
    return summary


def estimate(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    sink: Callable[[Output], None],
    progress: Callable[[float], None] = lambda _share: None,
    compensation: Compensation | None = None,
    smooth: bool = False,
    merger: Merger | None = None,
) -> Summary:
    """
    Run the estimator over a bag.

    sink: handed what each block gave, in order of time, in a thread of its own; what it raises ends the run.
    smooth: gravity from what comes after each sample too. merger: handed the same, and all messages of the bag.

    Raises
    ------
    BagError, ValueError
        As `process`; or `smooth` with a method that has no smoother.
    """
    if smooth and estimator.method != "bounded":
        raise ValueError(f"smooth: only the method bounded can be smoothed, not {estimator.method}")
    topics = find_topics(bag, given)
    refuse_damaged(bag, given)
    summary = _estimate(bag, topics, estimator, given, compensation, sink, progress, smooth, merger)
    refuse_damaged(bag, given)
    if summary.rows == 0:
        if given.start_s > (long := (bag.end_ns - bag.start_ns) * 1e-9) > 0.0:
            raise BagError(f"{bag.path} ends after {long:.1f} s, before --start {given.start_s:g}")
        raise BagError(f"{bag.path} has no IMU sample in {topics.imu}", "look at it with `mwd bag info`")
    summary.warnings += worth_saying(bag)
    return summary


@dataclasses.dataclass(frozen=True)
class _Found:
    """
    What one stage hands to the next.

    Attributes
    ----------
    output, log_ns : Output and ndarray of int64
        What some IMU samples gave, and when these were logged; or None.
    originals : list of Originals
        Messages of the bag.
    until_ns : int
        Nothing that is logged up to then is still to come.
    """

    output: Output | None
    log_ns: NDArray[np.int64] | None
    originals: list[Originals] = dataclasses.field(default_factory=list)
    until_ns: int | None = None


def _last_log(block: Block, originals: list[Originals]) -> int:
    """Log time of the last message of a block, ns."""
    logged = [int(part[0][-1]) for part in block.values()]
    return max(logged + [int(one.log_ns[-1]) for one in originals if len(one.log_ns)], default=0)


def _estimate(
    bag: Bag,
    topics: Topics,
    estimator: EstimatorSettings,
    given: InputSettings,
    compensation: Compensation | None,
    sink: Callable[[Output], None],
    progress: Callable[[float], None],
    smooth: bool,
    merger: Merger | None,
) -> Summary:
    summary = Summary(topics, warnings=guesses(bag, topics, given))
    without_time = unstamped(bag, topics)
    if without_time:
        summary.warnings.append(
            f"{', '.join(sorted(without_time))}: no time in the headers; the times of recording are used"
        )
    differ = frames_differ(bag, topics)
    pipeline = Pipeline(estimator)
    depth = DepthTrack()

    def keep(survey: Survey, status: int) -> None:
        reading = depth.sensor_depth(survey.stamp_ns, given.sensor_to_bit_m)
        md = reading.measured_depth
        summary.surveys.append((survey, md if md >= 0.0 else math.nan))
        listed = survey_of_fields(survey_fields(survey, status), survey.stamp_ns)
        if not summary.listed.records:
            summary.listed = SurveyList(well=_well(topics, estimator, given, survey))
        try:
            summary.listed = summary.listed.add(listed, md, reading.depth_age, comment=reading.reason)
        except ValueError as error:
            summary.warnings.append(f"survey {survey.sequence} is not in the survey list: {error}")

    start_ns = bag.start_ns + round(given.start_s * 1e9)
    end_ns = bag.start_ns + round(given.end_s * 1e9) if math.isfinite(given.end_s) else None
    last_ns = min(bag.end_ns, end_ns) if end_ns is not None else bag.end_ns
    use_mag = topics.mag is not None
    if differ and not given.same_axes:
        use_mag = False
        summary.warnings.append(f"{differ}: the magnetometer is not used; if they share axes say --same-axes")
    unchecked = {topics.imu, topics.mag}

    def blocks() -> Iterator[tuple[Block, list[Originals]]]:
        if merger is not None:
            yield from bag.blocks_and_originals(topics.all, start_ns, end_ns, fields=_FIELDS)
            return
        for block in bag.blocks(topics.all, start_ns, end_ns, fields=_FIELDS):
            yield block, []

    def found() -> Iterator[_Found]:
        nonlocal use_mag, unchecked
        held = ImuQueue(estimator.bounded if smooth else None)
        with ahead(blocks()) as ready:
            for block, originals in ready:
                samples = in_si(block, topics, given, without_time)
                if topics.imu in unchecked and topics.imu in samples:
                    summary.warnings += check_imu(topics.imu, samples[topics.imu])
                if use_mag and topics.mag in unchecked and topics.mag in samples:
                    doubtful = check_mag(topics.mag, samples[topics.mag])
                    summary.warnings += doubtful
                    use_mag = not doubtful
                unchecked -= samples.keys()
                if compensation is not None:
                    _compensate(compensation, samples, topics)
                # One block ahead of the IMU, so that where a block ends makes no difference to how a sample is paired.
                if use_mag and topics.mag in samples:
                    pipeline.push_mag(samples[topics.mag])
                if topics.precision in samples:
                    pipeline.push_precision(samples[topics.precision])
                if topics.temperature in samples:
                    pipeline.push_temperature(samples[topics.temperature])
                if topics.rig in samples:
                    for row in samples[topics.rig]:
                        depth.update(int(row["stamp_ns"]), float(row["bit_depth"]), bool(row["valid"] & _BIT_DEPTH))
                logged = _last_log(block, originals)
                for imu in held.done(logged):
                    yield _Found(pipeline.push_imu(imu.samples, imu.followed), imu.log_ns)
                if topics.imu in samples:
                    held.add(samples[topics.imu], block[topics.imu][0])
                if merger is not None:
                    yield _Found(None, None, originals, held.first_log_ns - 1 if held.waiting else logged)
                progress(_share(logged, start_ns, last_ns))
        for imu in held.finish():
            yield _Found(pipeline.push_imu(imu.samples, imu.followed), imu.log_ns)
        yield _Found(pipeline.finish(), None)

    def put_away(one: _Found) -> None:
        if merger is not None:
            merger.take(one.output, one.log_ns, one.originals, one.until_ns)
        if one.output is not None:
            sink(one.output)
            _count(one.output, summary)

    last_status = 0
    with behind(put_away) as give:
        for one in found():
            if one.output is not None:
                attitude = one.output.attitude
                rows = end_rows(one.output) if len(attitude) else [-1] * len(one.output.surveys)
                for survey, row in zip(one.output.surveys, rows, strict=True):
                    keep(survey, int(attitude["status"][row]) if len(attitude) else last_status)
                last_status = int(attitude["status"][-1]) if len(attitude) else last_status
                summary.faults += one.output.health
            give(one)
    if merger is not None:
        summary.warnings += merger.remarks
    progress(1.0)
    summary.north = pipeline.north
    summary.reference = pipeline.reference.source if pipeline.reference is not None else "none"
    if compensation is not None and compensation.without_temperature:
        summary.warnings.append(
            f"{compensation.without_temperature} samples were calibrated before any temperature was known"
        )
    if summary.rejected > _MANY_REFUSED * summary.rows:
        summary.warnings.append(
            f"{summary.rejected} of {summary.rows} IMU samples were refused: times that do not advance, or values that "
            "are not finite or beyond reason"
        )
    if summary.disturbed > _MANY_DISTURBED * summary.rows:
        summary.warnings.append(
            f"{summary.disturbed} of {summary.rows} rows have no azimuth because the magnetic field is not the "
            f"reference's (up to {summary.total_off * 1e9:+,.0f} nT and {math.degrees(summary.dip_off):+.1f} deg of "
            "dip off): steel nearby, or a string magnetised beyond interference.axial_nt "
            f"({estimator.interference.axial_nt:,.0f} nT), which the first survey that is accepted tells"
        )
    if pipeline.went_back:
        often, (left_ns, begun_ns) = len(pipeline.went_back), pipeline.went_back[0]
        times = "once," if often == 1 else f"{often} times, the first"
        by_s, at_s = (left_ns - begun_ns) * 1e-9, (left_ns - summary.start_ns) * 1e-9
        summary.warnings.append(
            f"time went back {times} by {by_s:.1f} s, {at_s:.1f} s after the start: the estimate began anew"
        )
    if pipeline.counters.spikes:
        summary.warnings.append(
            f"{pipeline.counters.spikes} magnetic samples jumped away from those around them: not used"
        )
    if pipeline.counters.late_mag:
        summary.warnings.append(
            f"{pipeline.counters.late_mag} magnetic samples came later than azimuth.mag_lag_s allows: raise it"
        )
    return summary


def _well(topics: Topics, estimator: EstimatorSettings, given: InputSettings, first: Survey) -> Well:
    """What the recording and the settings tell of the well."""
    reference, station = estimator.reference, first.station
    place = (reference.lat_deg, reference.lon_deg) if reference.source == "model" else (0.0, 0.0)
    return Well(
        name=topics.imu.removesuffix(IMU).removesuffix(IMU_BURST).strip("/") or Well().name,
        latitude_deg=place[0],
        longitude_deg=place[1],
        north_reference=station.north,
        sensor_to_bit=given.sensor_to_bit_m,
        geomagnetic_model=station.reference.source if station.reference is not None else "",
    )


def _compensate(compensation: Compensation, samples: dict[str | None, Samples], topics: Topics) -> None:
    """Take the calibration off the AHRS samples of a block, in place."""
    if topics.temperature in samples:
        compensation.push_temperature(samples[topics.temperature])
    if topics.imu in samples:
        samples[topics.imu] = compensation.imu(samples[topics.imu])
    if topics.mag in samples:
        samples[topics.mag] = compensation.mag(samples[topics.mag])


def _count(output: Output, summary: Summary) -> None:
    attitude = output.attitude
    if summary.rows == 0 and len(attitude):
        summary.start_ns = int(attitude["stamp_ns"][0])
    summary.rows += len(attitude)
    if len(attitude):
        summary.end_ns = int(attitude["stamp_ns"][-1])
    status = np.ascontiguousarray(attitude["status"])
    summary.rejected += int(np.count_nonzero(status & int(Status.REJECTED)))
    summary.gaps += int(np.count_nonzero(status & int(Status.GAP)))
    known = attitude["sigma_inclination"] >= 0.0
    summary.without_gravity += int(len(attitude) - np.count_nonzero(known))
    unknown = attitude["sigma_azimuth"] < 0.0
    summary.without_azimuth += int(np.count_nonzero(unknown))
    withheld = int(np.count_nonzero(unknown & (status & int(Status.MAG_DISTURBED) != 0)))
    if withheld and len(output.interference):
        total, dip = output.interference["total_residual"], output.interference["dip_residual"]
        summary.total_off = max(float(total.min()), float(total.max()), summary.total_off, key=abs)
        summary.dip_off = max(float(dip.min()), float(dip.max()), summary.dip_off, key=abs)
    summary.disturbed += withheld
    inclination = attitude["inclination"][known]
    if len(inclination):
        summary.lowest = float(np.fmin(summary.lowest, inclination.min()))
        summary.highest = float(np.fmax(summary.highest, inclination.max()))


def _share(logged_ns: int, start_ns: int, last_ns: int) -> float:
    return min(max((logged_ns - start_ns) / max(last_ns - start_ns, 1), 0.0), 1.0)
