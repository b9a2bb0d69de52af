# SPDX-License-Identifier: Apache-2.0
"""
Inspection of a recording: its contents, missing contents, and the options with which `mwd process` can read it.

The samples pass the checks of the sensors repeatedly, each time with the findings so far (unit, sign, mount), until
nothing new is found. The findings become the options of `mwd process`.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.core.fault_messages import describe, unit_words
from mwd_estimation.core.input_gate import InputGate
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import FaultCode, SensorFault
from mwd_estimation.core.stream_clock import StreamClock
from mwd_estimation.health import monitor
from mwd_estimation.health.motion_window import TURNING
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import input_covariance, settings, units, wire
from mwd_sensors.core import mount as mounts
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.mount import Mount
from mwd_surface.bags.bag_reader import Bag, BagError, Block
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import (
    QUANTITIES,
    InputSettings,
    Topics,
    find_topics,
    frame_names,
    guesses,
    mount_of,
    option_of,
)
from mwd_surface.processing.input_stream import CLOCK_SET_NS, InputStream, StreamProblem, problems
from mwd_surface.processing.rests import Rests
from mwd_surface.processing.run_summary import Summary
from mwd_surface.processing.stream_times import StreamTimes
from mwd_surface.surveys.recorded_settings import with_a_model

_UNIT_OPTIONS = ("accel_unit", "gyro_unit", "mag_unit")
_PASSES = 6  # largest number of corrections of the settings
# Number of each vector's sensor, and faults that a sensor has if its messages declare the vector absent.
_SENSORS = {"angular_velocity": 0, "linear_acceleration": 1, "magnetic_field": 2}
_MISSING = (FaultCode.DEAD, FaultCode.INVALID)
# Step between the magnetic samples that are used; allowed additional standard deviation of the sine of the dip over the
# attitudes; allowed difference between the mean dip and the reference, rad.
_EVERY, _STEADY, _DIP = 7, 0.01, 0.05
_ASKEW = (
    "the unit is mounted obliquely; its mount was found from the axis about which the string turns, which does not "
    "show the scribe line; correct the toolface with --set tool.toolface_offset_deg, or give the full mount with "
    "--mount"
)


@dataclasses.dataclass(frozen=True)
class Inspection:
    """Result of an inspection."""

    topics: Topics
    times: dict[str, StreamTimes]  #: times of each topic used
    frames: dict[str, str]  #: frame that the messages of each topic name
    units: dict[str, str]  #: units of the readings, by name of the option
    mount: str  #: mount of the units in the tool, as text
    #: axis of the unit about which the string turned, and its direction; empty if the string never turned
    turns_about: str
    #: number of intervals at rest that are long enough for a survey; None if the samples are too few to judge
    rests: int | None
    rest_s: float  #: longest interval at rest
    #: sensor faults present at the end, with the samples read with the units and the mount found
    faults: list[SensorFault]
    remarks: list[str]  #: sentences on anything unusual
    missing: list[tuple[str, str]]  #: results that cannot be computed, each with the input that is missing
    surveys: list[str]  #: verdicts of the surveys that the command yields
    refusal: str  #: reason why `mwd process` refuses the recording; empty if it accepts the recording
    command: str  #: command that processes the recording; empty if `mwd process` refuses it


@dataclasses.dataclass
class _InspectionPass:
    """One reading of the whole recording: the settings with which the samples were read, and the findings."""

    given: InputSettings
    estimator: EstimatorSettings
    times: dict[str, StreamTimes]
    rests: Rests
    remarks: list[str] = dataclasses.field(default_factory=list)
    #: axis of the IMU that points down-hole, as text, for each interval of 3 s in which the string turned
    turn: list[str] = dataclasses.field(default_factory=list)
    #: sum of the rotation vectors in these intervals, in axes of the IMU, rad
    turned: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    faults: list[SensorFault] = dataclasses.field(default_factory=list)
    problems: list[StreamProblem] = dataclasses.field(default_factory=list)


def inspect(
    bag: Bag,
    given: InputSettings,
    estimator: EstimatorSettings,
    output: Path,
    progress: Callable[[float], None] = lambda _share: None,
    recorded: EstimatorSettings | None = None,
) -> Inspection:
    """
    Inspect a bag.

    Parameters
    ----------
    given, estimator : settings
        Known facts: topics, units, place, mount.
    output : Path
        Output folder to write into the command.
    progress : callable
        Called with the completed share of one reading of the recording, 0 to 1; there are several readings.
    recorded : settings, optional
        Settings in the recording, which `mwd process` uses without options.

    Raises
    ------
    BagError
        There is no IMU, or several; see `bag_input.find_topics`.
    """
    topics, given, refusal = _readable(bag, given, estimator)
    given = _with_units(bag, topics, given)
    reading = _read(bag, topics, given, estimator, progress)
    changes: dict[str, Any] = {one.option[0]: one.option[1] for one in reading.problems if one.option}
    if changes:
        reading = _read(bag, topics, dataclasses.replace(given, **changes), estimator, progress)
    for _ in range(_PASSES):
        found = _corrected(reading)
        if found is None:
            break
        reading = _read(bag, topics, *found, progress)
    doubted = any(fault.code == FaultCode.AXES and fault.mappings[2] for fault in reading.faults)
    apart = "mag" in mount_of(bag, topics, reading.estimator.tool.mount).unusable and bool(reading.turn)
    if doubted or apart:
        turned = _mag_mounts(bag, topics, reading.given, reading.estimator)
        if len(turned) == 1:
            named = settings.changed(reading.estimator, {"tool.mount.mag": turned[0]})
            reading = _read(bag, topics, reading.given, named, progress)
    mount = mount_of(bag, topics, reading.estimator.tool.mount)
    summary: Summary | None = None
    if not refusal:
        summary, refusal = _processed(bag, reading)
    surveys = [record.survey for record in summary.listed.records] if summary is not None else []
    verdicts = [Verdict(survey.verdict) for survey in surveys]
    unsure = [(one, verdict.word) for one, verdict in zip(surveys, verdicts, strict=True) if one.action]
    doubts = list(dict.fromkeys(f"surveys: {word}: {one.action}" for one, word in unsure))
    reason = summary.no_survey if summary is not None else ""
    own = recorded or EstimatorSettings()
    if recorded is not None and (differences := _other_place(estimator.place, recorded.place)):
        doubts.append(f"the given place differs from the place in the recording: {differences}")
    return Inspection(
        topics,
        reading.times,
        frame_names(bag, topics.all),
        {name: getattr(reading.given, name) for name in _UNIT_OPTIONS},
        _mount_words(mount, topics),
        max(set(reading.turn), key=reading.turn.count) if reading.turn else "",
        reading.rests.count,
        reading.rests.longest_s,
        reading.faults,
        _remarks(bag, topics, reading, estimator) + doubts,
        _missing(topics, reading, mount, reason),
        [verdict.word for verdict in verdicts],
        refusal,
        "" if refusal else _command(bag, topics, reading, output, own),
    )


def _readable(bag: Bag, given: InputSettings, estimator: EstimatorSettings) -> tuple[Topics, InputSettings, str]:
    """
    Return the topics and settings with which a recording can be read.

    The third value is the reason why `mwd process` refuses the recording even with these settings, or "".
    """
    topics = find_topics(bag, given)
    for _ in range(_PASSES):
        found = problems(bag, topics, given, estimator.place)
        changes: dict[str, Any] = dict(one.option for one in found if one.option)
        if not changes:
            return topics, given, "; ".join(one.sentence for one in found)
        given = dataclasses.replace(given, **changes)
        topics = find_topics(bag, given)
    return topics, given, "; ".join(one.sentence for one in problems(bag, topics, given, estimator.place))


def _processed(bag: Bag, reading: _InspectionPass) -> tuple[Summary | None, str]:
    """Return the summary of `mwd process` and an empty text; for a refused recording, None and the reason."""
    given = dataclasses.replace(reading.given, partial=reading.given.partial or not bag.complete)
    day = _day(reading, find_topics(bag, given).imu)
    settled = settings.changed(reading.estimator, {"place.date": day}) if day else reading.estimator
    try:
        settled, _ = with_a_model(settled, bag.start_ns)
        return BagEstimate(bag, settled, given).run(lambda _output: None), ""
    except (BagError, ValueError) as error:
        return None, str(error)


def _with_units(bag: Bag, topics: Topics, given: InputSettings) -> InputSettings:
    """Return the settings with the units in which the first readings are plausible; units that a user gave are kept."""
    first: Block = {}
    for block in InputStream(bag, topics, given).blocks():
        first = {**block, **first}
        if first.keys() >= {topics.imu, topics.mag} - {None}:
            break
    changes: dict[str, Any] = {}
    for (name, field, quantity, _), option in zip(QUANTITIES, _UNIT_OPTIONS, strict=True):
        part = first.get(getattr(topics, name) or "")
        if part is None or getattr(given, option) != getattr(InputSettings(), option):
            continue
        found = units.doubt(quantity, part[1][field])
        if found is not None and found[1]:
            changes[option] = found[1]
    return dataclasses.replace(given, **changes)


def _read(
    bag: Bag, topics: Topics, given: InputSettings, estimator: EstimatorSettings, progress: Callable[[float], None]
) -> _InspectionPass:
    """Pass all samples through the checks of the sensors, and return the findings."""
    mount = mount_of(bag, topics, estimator.tool.mount)
    params = derivation.health_params(estimator)
    state, gate = monitor.initial(), InputGate(derivation.input_ranges(estimator))
    rests = Rests(estimator.survey)
    reading = _InspectionPass(given, estimator, {name: StreamTimes() for name in topics.all}, rests)
    stream = InputStream(bag, topics, given)
    clocks = {topics.imu: StreamClock(), topics.mag: StreamClock()}
    first, absent = True, set[int]()
    for block in stream.blocks():
        samples = {name: part[1] for name, part in block.items()}
        for name, (log_ns, _) in block.items():
            reading.times[name].take(samples[name]["stamp_ns"], log_ns)
        for unit, layout in ((topics.imu, wire.IMU), (topics.mag, wire.MAG)):
            if unit is not None and unit in samples:
                # Remove vectors that covariances declare absent, as `mwd process` does.
                samples[unit], notes = input_covariance.judge(samples[unit], layout.type_name)
                absent |= {_SENSORS[vector] for vector, note in notes.items() if note == input_covariance.ABSENT}
                # Use the times of the sensor, as `mwd process` does.
                samples[unit] = samples[unit].copy()
                samples[unit]["stamp_ns"] = clocks[unit].times(np.ascontiguousarray(samples[unit]["stamp_ns"]))
        if topics.mag in samples and "mag" not in mount.unusable:
            mag = mount.mag_in_tool(gate.mag(samples[topics.mag]))
            monitor.push_mag(state, mag["stamp_ns"], mag["magnetic_field"])
        if topics.imu in samples:
            raw = gate.imu(samples[topics.imu])
            if first:
                reference = _reference(estimator, int(raw["stamp_ns"][0]))
                if reference is not None:
                    monitor.set_reference(state, reference.gravity, reference.total, reference.dip)
                first = False
            _note_turns(reading, raw)
            imu = mount.imu_in_tool(raw)
            reading.rests.take(imu)
            monitor.push_refused(state, gate.take_refused())
            monitor.run(params, state, imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"])
        if block:
            done = max(int(log_ns[-1]) for log_ns, _ in block.values())
            progress((done - bag.start_ns) / max(bag.end_ns - bag.start_ns, 1))
    reading.remarks = stream.remarks
    reading.problems = stream.problems + reading.rests.problems(topics.imu, given.gyro_unit)
    standing = [fault for fault in monitor.faults(state) if fault.code != FaultCode.NEVER_CAME]
    reading.faults = [
        dataclasses.replace(fault, declared=fault.code in _MISSING and fault.place // 3 in absent).in_unit_axes(
            mount.imu
        )
        for fault in standing
    ]
    return reading


def _note_turns(reading: _InspectionPass, imu: Samples) -> None:
    """Note the axis of the unit that points down-hole, for each 3 s whose mean turn rate exceeds `TURNING`."""
    stamps, gyro = imu["stamp_ns"], np.nan_to_num(imu["angular_velocity"])
    dt = np.clip(np.diff(stamps, prepend=stamps[:1]) * 1e-9, 0.0, 0.25)
    part = (stamps - stamps[0]) // (3 * wire.NANOSECONDS)
    for k in np.unique(part):
        turns = (gyro * dt[:, None])[part == k]
        net, path = turns.sum(axis=0), float(np.linalg.norm(turns, axis=1).sum())
        if np.linalg.norm(net) > 3.0 * TURNING:
            off = math.degrees(math.acos(min(abs(float(net[0])) / float(np.linalg.norm(net)), 1.0)))
            along = float(np.abs(net).max()) > mounts.ALONG * float(np.linalg.norm(net))
            reading.turn.append((along and mounts.axis_down(net, path)) or f"{off:.0f} deg off x")
            reading.turned += net


def _corrected(reading: _InspectionPass) -> tuple[InputSettings, EstimatorSettings] | None:
    """Return corrected settings from the first fault that suggests a correction; None if no fault does."""
    before, given = reading.estimator.tool.mount, reading.given
    for fault in sorted(reading.faults, key=lambda one: one.since_ns):
        if fault.code == FaultCode.UNIT:
            option = ("gyro_unit", "accel_unit", "mag_unit")[fault.place // 3]
            changed_unit: dict[str, Any] = {option: unit_words(fault)}
            return dataclasses.replace(given, **changed_unit), reading.estimator
        changes: dict[str, str] = {}
        if fault.code in (FaultCode.SIGN, FaultCode.POINTS_UP) and fault.sensors == (1,):
            changes = {"accelerometer": "down" if before.accelerometer == "up" else "up"}
        elif fault.code == FaultCode.MOUNT and reading.turned.any():
            # Use the rotation over the whole recording in axes of the unit: it does not depend on the assumed mount.
            changes = {"imu": mounts.words(mounts.by_turning(reading.turned))}
        changes = {unit: value for unit, value in changes.items() if value != getattr(before, unit)}
        if changes:
            named = {f"tool.mount.{name}": value for name, value in changes.items()}
            return given, settings.changed(reading.estimator, named)
    return None


def _mount_words(mount: Mount, topics: Topics) -> str:
    words = f"IMU {mounts.words(mount.imu)}"
    if topics.mag is not None:
        same = np.array_equal(mount.mag, mount.imu)
        known = "as the IMU" if same else mounts.words(mount.mag)
        words += ", magnetometer " + ("not known" if "mag" in mount.unusable else known)
    return words + (", accelerometer reads gravity (down)" if mount.reversed_accelerometer else "")


def _remarks(bag: Bag, topics: Topics, reading: _InspectionPass, start: EstimatorSettings) -> list[str]:
    """Return sentences on anything unusual about topics, times and sensors."""
    remarks = guesses(bag, topics, reading.given)
    if reading.estimator.tool.mount.imu not in (start.tool.mount.imu, *mounts.PRESETS):
        remarks.append(_ASKEW)
    remarks += reading.remarks
    for name, times in reading.times.items():
        remarks += [f"{name}: {text}" for text in times.remarks(name != topics.rig)]
    remarks += [f"{text.message}; {text.remedy}" for text in map(describe, reading.faults)]
    return remarks


def _missing(topics: Topics, reading: _InspectionPass, mount: Mount, reason: str) -> list[tuple[str, str]]:
    """Return the results that cannot be computed, each with the input that the recording lacks."""
    place, missing = reading.estimator.place, []
    if reason:
        missing.append(("surveys", reason))
    if topics.mag is None:
        missing.append(("magnetic azimuth", f"a magnetometer: {wire.MAG.type_name}"))
    elif "mag" in mount.unusable:
        missing.append(("magnetic azimuth", f"the mount of the magnetometer: {mount.unusable['mag']}"))
    if place.field == "none":
        missing.append(("true north, checks of the field", "the position: --lat and --lon, or --field"))
    elif place.model:
        first = reading.times[topics.imu].first_ns
        if not place.date and first < CLOCK_SET_NS:
            missing.append(("the field of the model", "the date: --date YYYY-MM-DD, because the clock was not set"))
    if topics.precision is None:
        missing.append(("gyro azimuth", "a high-precision unit: --gyro-topic"))
    elif place.lat_deg is None:
        missing.append(("gyro azimuth", "the latitude: --lat"))
    if topics.rig is None and not reading.given.depths:
        missing.append(("depths, path, exports", "the rig's depth (mwd_msgs/msg/RigState), or --depths TABLE.csv"))
    return missing


def _day(reading: _InspectionPass, imu: str) -> str:
    """
    Return the date for the field model: the given date, else the date of the first sample.

    Returns "" if no model is used, or if no date is given and the clock was not set.
    """
    place, first = reading.estimator.place, reading.times[imu].first_ns
    if not place.model or place.date or first < CLOCK_SET_NS:
        return place.date if place.model else ""
    return f"{datetime.datetime.fromtimestamp(first * 1e-9, tz=datetime.UTC):%Y-%m-%d}"


def _other_place(given: Place, recorded: Place) -> str:
    """Return the differences between the given place and the place in the recording; empty if none is recorded."""
    if recorded.field == "none":
        return ""
    names = [field.name for field in dataclasses.fields(given)]
    pairs = [(name, getattr(given, name), getattr(recorded, name)) for name in names]
    return ", ".join(f"{name} {one} instead of {other}" for name, one, other in pairs if one != other)


def _command(bag: Bag, topics: Topics, reading: _InspectionPass, output: Path, own: EstimatorSettings) -> str:
    """Return the command that processes the bag as it was read; own: settings in force without any option."""
    words = ["mwd", "process", str(bag.path), "-o", str(output)]
    for name, usual in vars(InputSettings()).items():
        if (value := getattr(reading.given, name)) != usual and name != "partial":
            words += [option_of(name), f"{value:g}" if isinstance(value, float) else str(value)]
    mount, default = reading.estimator.tool.mount, own.tool.mount
    for unit in ("imu", "mag", "precision"):
        if getattr(mount, unit) != getattr(default, unit):
            words += ["--mount", f"{unit}={getattr(mount, unit).replace(', ', ',')}"]
    if mount.accelerometer != default.accelerometer:
        words += ["--accelerometer", mount.accelerometer]
    place = reading.estimator.place
    if place == own.place:
        pass
    elif place.model:
        words += ["--lat", f"{place.lat_deg:g}", "--lon", f"{place.lon_deg:g}"]
        day = _day(reading, topics.imu)
        words += ["--date", day] if day else []
    elif place.field == "fixed":
        figures = (place.total_nt, place.dip_deg, place.declination_deg)
        words += ["--field", ",".join(f"{v:g}" for v in figures if v is not None)]
    if not bag.complete or reading.given.partial:
        words.append("--partial")
    return shlex.join(words)


def figures(times: StreamTimes) -> str:
    """Return the number of samples and the rate of a topic as text."""
    rate = f"{times.rate:.4g} Hz" if math.isfinite(times.rate) else "one message"
    return f"{times.count} samples, {rate}"


def _reference(estimator: EstimatorSettings, first_ns: int) -> Reference | None:
    """Return the reference field of the place; None if no field is set, or if the model does not cover the date."""
    try:
        return derivation.reference(estimator, first_ns)
    except ValueError:
        return None


def _mag_mounts(bag: Bag, topics: Topics, given: InputSettings, estimator: EstimatorSettings) -> list[str]:
    """
    Return the mounts of the magnetometer that fit gravity and the reference field.

    All 24 mounts along the axes of the tool are tried. The angle between gravity and field is the complement of the dip
    in every attitude: with a wrong mount the angle varies as the tool turns, or gives another dip. Empty without a
    reference field.
    """
    mount = mount_of(bag, topics, estimator.tool.mount)
    up, field, first_ns = [], [], 0
    for block in InputStream(bag, topics, given).blocks():
        samples = {name: part[1] for name, part in block.items()}
        if topics.imu not in samples or topics.mag not in samples:
            continue
        imu, mag = mount.imu_in_tool(samples[topics.imu]), samples[topics.mag][::_EVERY]
        first_ns = first_ns or int(imu["stamp_ns"][0])
        at = np.searchsorted(imu["stamp_ns"], mag["stamp_ns"]).clip(max=len(imu) - 1)
        up.append(imu["linear_acceleration"][at])
        field.append(mag["magnetic_field"])
    reference = _reference(estimator, first_ns)
    if not up or reference is None or reference.dip is None:
        return []
    f, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (np.concatenate(up), np.concatenate(field)))
    rotations = [np.array(m, dtype=float) for m in MAPPINGS if np.linalg.det(np.array(m, dtype=float)) > 0.0]
    sines = [-np.einsum("ni,ij,nj->n", f, mat, b) for mat in rotations]
    spread = [float(np.nanstd(sine)) for sine in sines]
    dips = [math.asin(min(max(float(np.nanmean(sine)), -1.0), 1.0)) for sine in sines]
    return [
        mounts.words(mat)
        for mat, wide, dip in zip(rotations, spread, dips, strict=True)
        if wide < 1.5 * min(spread) + _STEADY and abs(dip - reference.dip) < _DIP
    ]
