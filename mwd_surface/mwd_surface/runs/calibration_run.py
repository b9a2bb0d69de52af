# SPDX-License-Identifier: Apache-2.0
"""Calibration of one unit from a recorded or simulated tumble and temperature run, and the file of a calibration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from mwd_estimation.core.stream_clock import StreamClock
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.calibration import tumble
from mwd_sensors.calibration.triad_calibration import Calibration, TriadCalibration, as_table, from_table
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.input_files import read_yaml
from mwd_sensors.core.output_files import write_whole
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator.scenario import Scenario, parse
from mwd_sensors.simulator.sonde import Sonde, reference_of
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.processing.bag_input import (
    InputSettings,
    Topics,
    check_units,
    find_topics,
    guesses,
    refuse_damaged,
)
from mwd_surface.processing.input_stream import InputStream, problems, refuse

UNITS = {"ahrs": "imu/data_raw", "precision": "gyro/data_raw"}
_MAG, _TEMPERATURE = "imu/mag", "imu/temperature"
# Largest number of samples of a calibration run: a day at 100 Hz. A run takes minutes.
_MOST_SAMPLES = 8_640_000
# Largest scale error or misalignment of a sensor: several times the 3 % that data sheets of consumer MEMS sensors
# allow. An exchanged axis or a wrong unit gives about 1.
_LARGEST = 0.2
# Distance from the temperature range of the calibration run up to which the temperature slopes are valid, degC.
_MARGIN = 10.0


@dataclasses.dataclass(frozen=True)
class CalibrationReadings:
    """Readings of one unit over a run."""

    source: str  #: description of the run, shown to users
    unit: str  #: name of the unit, a key of `UNITS`
    imu: Samples  #: shape (n,); layout `wire.IMU`, in order of time
    mag: Array | None  #: shape (n, 3); magnetic field, T, interpolated to the stamps of `imu`
    celsius: Array  #: shape (n,); temperature, degC, interpolated to the stamps of `imu`
    rate: float  #: sample rate, Hz


def simulated(scenario: Scenario, unit: str) -> CalibrationReadings:
    """
    Return the readings of a simulated calibration run of a unit.

    Raises
    ------
    ValueError
        The sonde of the scenario has no such unit, or the run has fewer than 100 samples.
    """
    if unit == "precision" and scenario.precision is None:
        raise ValueError(f"scenario {scenario.name}: its sonde has no precision unit")
    wanted = (UNITS[unit], _MAG, _TEMPERATURE)
    parts: dict[str, list[Samples]] = {topic: [] for topic in wanted}
    for block in Sonde(scenario).blocks(10.0):
        for topic in wanted:
            parts[topic].append(block[topic])
    joined = {topic: np.concatenate(found) for topic, found in parts.items()}
    return _run(f"scenario {scenario.name}, seed {scenario.seed}", unit, joined, wanted)


def recorded(bag: Bag, unit: str, given: InputSettings | None = None) -> tuple[CalibrationReadings, list[str]]:
    """
    Read the calibration run of a unit from a recording; return the run, and sentences about unusual data.

    Raises
    ------
    BagError
        The recording has no IMU of that unit, or several, or it is longer than a day at 100 Hz.
    ValueError
        The samples cannot be used, or the recording has no temperature.
    """
    given = given or InputSettings()
    refuse_damaged(bag, given)
    topics = _topics_of(bag, unit, given)
    if bag.topics[topics.imu].count > _MOST_SAMPLES:
        raise BagError(
            f"{bag.path} is too long for a calibration run",
            "a tumble run takes minutes; cut this part out of the recording first",
        )
    refuse(problems(bag, topics, given, Place()))
    stream = InputStream(bag, topics, given)
    parts: dict[str, list[Samples]] = {name: [] for name in topics.all}
    for block in stream.blocks():
        refuse(stream.problems)
        for topic, (_, samples) in block.items():
            parts[topic].append(samples)
    refuse_damaged(bag, given)
    joined = {topic: np.concatenate(found) for topic, found in parts.items() if found}
    if topics.imu not in joined:
        raise BagError(f"{bag.path} has no IMU sample in {topics.imu}", "`mwd bag info` shows its topics")
    warnings = check_units(topics, {name: joined[name] for name in (topics.imu, topics.mag) if name in joined})
    run = _run(f"bag {bag.path.resolve().name}", unit, joined, (topics.imu, topics.mag, topics.temperature))
    return run, [*guesses(bag, topics, given), *stream.remarks, *warnings]


def _topics_of(bag: Bag, unit: str, given: InputSettings) -> Topics:
    """Return the topics of one unit, arranged so that this unit is read as the main IMU."""
    if unit == "precision":
        name = given.gyro_topic or bag.find_topic(wire.IMU.type_name, UNITS[unit])
        given = dataclasses.replace(given, imu_topic=name, gyro_topic="")
    return dataclasses.replace(find_topics(bag, given), precision=None, rig=None)


def scenario_of(bag: Bag) -> Scenario | None:
    """Return the scenario stored in a simulated recording; None if the recording has no scenario."""
    for attachment in bag.attachments():
        if attachment.name == "scenario.yaml":
            return parse(attachment.data.decode())
    return None


def field_of(scenario: Scenario) -> tuple[float, tuple[float, float]]:
    """Return gravity, m/s^2, and the pair of strength, T, and dip, rad, of the magnetic field in a scenario."""
    reference = reference_of(scenario)
    return reference.gravity, (reference.total, reference.dip)


def calibrated(run: CalibrationReadings, gravity: float, field: tuple[float, float] | None) -> Calibration:
    """
    Return the calibration of a run; without a magnetic field the magnetometer is not calibrated.

    gravity: m/s^2. field: strength, T, and dip, rad, or None.

    Raises
    ------
    ValueError
        The run is not sufficient for a calibration, or the errors that it gives are larger than those of any sensor;
        the message says why.
    """
    imu = run.imu
    mag = run.mag if run.unit == "ahrs" and field is not None else None
    found = tumble.calibrate(
        imu["angular_velocity"], imu["linear_acceleration"], mag, run.celsius, run.rate, gravity, field
    )
    for name, triad, causes in (
        ("accelerometers", found.accelerometer, "the unit of the accelerometer and the gravity"),
        ("gyros", found.gyro, "the unit of the gyro, and whether its axes are those of the accelerometer"),
        (
            "magnetometers",
            found.magnetometer,
            "the unit of the magnetometer, the place or field, its axes and their signs",
        ),
    ):
        if triad is not None:
            _refuse_implausible(name, triad, causes)
    return found


def _refuse_implausible(name: str, triad: TriadCalibration, causes: str) -> None:
    """Raise ValueError if scale or misalignment of a triad are larger than those of a sensor, or not determined."""
    largest = float(np.max(np.abs(triad.matrix - np.eye(3))))
    if not largest <= _LARGEST:
        raise ValueError(
            f"{name}: scale or misalignment of {100.0 * largest:.0f} % is more than a sensor has: check {causes}"
        )
    sigma = float(np.max(triad.sigma_matrix))
    if not sigma <= _LARGEST:
        raise ValueError(
            f"{name}: the run does not determine scale and misalignment (1 sigma {100.0 * sigma:.0f} %): let the "
            "probe rest in more attitudes, and turn it about all axes between them"
        )


def write(path: Path, found: Calibration, about: Mapping[str, Any]) -> None:
    """
    Write a calibration as YAML.

    about: origin of the calibration, as values that YAML can store.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    table = {"about": dict(about), "calibration": as_table(found)}
    head = "# Made by `mwd calibrate`. SI units: rad/s, m/s^2, T, degC. Corrected = matrix @ ((reading - bias\n"
    head += "# - bias_per_c * warm) / (1 + scale_per_c * warm)), warm = temperature - reference_c.\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, head + yaml.safe_dump(table, sort_keys=False, default_flow_style=None))


def read(path: Path, unit: str = "ahrs") -> Calibration:
    """
    Return the calibration in a file that `write` made, for use with a unit.

    Raises
    ------
    SettingsError
        The file is not YAML, not a calibration, or belongs to another unit; the message names the file.
    OSError
        The file cannot be read.
    """
    table = read_yaml(path)
    if not isinstance(table, dict) or not isinstance(table.get("calibration"), dict):
        raise SettingsError(f"{path} is not a calibration; `mwd calibrate` makes one")
    about = table.get("about")
    made_for = about.get("unit", unit) if isinstance(about, dict) else unit
    if made_for != unit:
        raise SettingsError(f"{path} is a calibration of the unit {made_for!r}, not of {unit!r}")
    try:
        return from_table(table["calibration"])
    except ValueError as error:
        raise SettingsError(f"{path}: {error}") from error


def within_calibration(settings: EstimatorSettings, path: Path) -> EstimatorSettings:
    """
    Return the settings with the temperature range of a calibration file, degC, extended by 10 degC on both sides.

    The settings are returned unchanged if the file has no temperature range.
    """
    table = read_yaml(path)
    about = table.get("about") if isinstance(table, dict) else None
    given = about.get("temperature_c") if isinstance(about, dict) else None
    if not isinstance(given, list) or len(given) != 2 or not all(isinstance(one, (int, float)) for one in given):
        return settings
    calibrated = min(given) - _MARGIN, max(given) + _MARGIN
    return dataclasses.replace(settings, tool=dataclasses.replace(settings.tool, calibrated_c=calibrated))


def _run(
    source: str, unit: str, joined: Mapping[str, Samples], topics: tuple[str, str | None, str | None]
) -> CalibrationReadings:
    imu = _ordered(_at_measured_times(joined[topics[0]]))
    if len(imu) < 100:
        raise ValueError(f"{source}: {len(imu)} samples are too few for a calibration")
    stamps = imu["stamp_ns"]
    rate = float(1e9 / np.median(np.diff(stamps)))
    mag = None
    if topics[1] is not None and topics[1] in joined and len(joined[topics[1]]) > 1:
        field = _ordered(_at_measured_times(joined[topics[1]]))
        mag = np.column_stack(
            [_interpolated(stamps, field["stamp_ns"], field["magnetic_field"][:, axis]) for axis in range(3)]
        )
    if topics[2] is None or topics[2] not in joined or len(joined[topics[2]]) == 0:
        raise ValueError(f"{source}: there is no temperature; a calibration needs {_TEMPERATURE}")
    heat = _ordered(joined[topics[2]])
    celsius = _interpolated(stamps, heat["stamp_ns"], heat["temperature"])
    return CalibrationReadings(source, unit, imu, mag, celsius, rate)


def _at_measured_times(samples: Samples) -> Samples:
    """Return the samples with the times of the sensor (`core.stream_clock`), because samples may share a stamp."""
    samples = samples.copy()
    samples["stamp_ns"] = StreamClock().times(np.ascontiguousarray(samples["stamp_ns"]))
    return samples


def _ordered(samples: Samples) -> Samples:
    return np.asarray(samples[np.unique(samples["stamp_ns"], return_index=True)[1]])


def _interpolated(stamps: NDArray[np.int64], at: NDArray[np.int64], values: Array) -> Array:
    origin = int(stamps[0])
    return np.asarray(np.interp((stamps - origin) * 1e-9, (at - origin) * 1e-9, values), dtype=float)


def residuals(found: Calibration) -> list[tuple[str, int, float, float, str]]:
    """
    Return rows to print: triad, number of positions or turns, residual before and after calibration, unit.

    Accelerometers and magnetometers are calibrated from positions at rest, gyros from the turns between them.
    """
    ug, nt, mrad = 1e6 / STANDARD_GRAVITY, 1e9, 1e3
    rows = [
        ("accelerometers", found.accelerometer, ug, "µg (strength of gravity)"),
        ("gyros", found.gyro, mrad, "mrad (direction of gravity after a turn)"),
    ]
    if found.magnetometer is not None:
        rows.append(("magnetometers", found.magnetometer, nt, "nT (strength and dip of the field)"))
    return [(name, triad.poses, triad.before * scale, triad.after * scale, unit) for name, triad, scale, unit in rows]


def errors(found: Calibration) -> list[tuple[str, str, list[str]]]:
    """Return rows to print: triad, quantity with its unit, and value with 1 sigma for each of the three axes."""
    rows: list[tuple[str, str, list[str]]] = []
    dph, ug = math.degrees(1.0) * 3600.0, 1e6 / STANDARD_GRAVITY
    for name, triad, scale, unit in (
        ("accelerometers", found.accelerometer, ug, "µg"),
        ("gyros", found.gyro, dph, "deg/h"),
        ("magnetometers", found.magnetometer, 1e9, "nT"),
    ):
        if triad is None:
            continue
        gain = 1e6 * (1.0 / np.diag(triad.matrix) - 1.0)
        for words, value, sigma in (
            (f"bias, {unit}", triad.bias * scale, triad.sigma_bias * scale),
            (f"bias over temperature, {unit}/°C", triad.bias_per_c * scale, triad.sigma_bias_per_c * scale),
            ("scale, ppm", gain, 1e6 * np.diag(triad.sigma_matrix)),
            ("scale over temperature, ppm/°C", 1e6 * triad.scale_per_c, 1e6 * triad.sigma_scale_per_c),
        ):
            rows.append((name, words, [_figure(v, s) for v, s in zip(value, sigma, strict=True)]))
    return rows


def _figure(value: float, sigma: float) -> str:
    """Return value and 1 sigma as text, to the second digit of the sigma; the value alone if the sigma is 0."""
    if not sigma > 0.0:
        return f"{value:.4g}"
    decimals = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"
