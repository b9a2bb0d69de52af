# SPDX-License-Identifier: Apache-2.0
"""
Scenario: the settings of one simulation of a sonde.

The settings describe place and date, hole, schedule, vibration, instruments, magnetic disturbances, faults, and the
seed of all random numbers.
"""

from __future__ import annotations

import dataclasses
import datetime
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from mwd_sensors.core import budgets
from mwd_sensors.core.angle_convention import CONVENTIONS, AngleConvention
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.input_files import load_yaml, read_text
from mwd_sensors.core.settings import SettingsError, from_mapping, setting
from mwd_sensors.simulator.battery import SondeBattery
from mwd_sensors.simulator.faults import Fault, MessageFaults, check
from mwd_sensors.simulator.gamma import Gamma
from mwd_sensors.simulator.instrument_grade import grade
from mwd_sensors.simulator.interference import Interference
from mwd_sensors.simulator.schedule import Rig, SchedulePhase
from mwd_sensors.simulator.steering import Steering
from mwd_sensors.simulator.telemetry_link import Telemetry
from mwd_sensors.simulator.vibration import Vibrations


@dataclasses.dataclass(frozen=True)
class ScenarioPlace:
    """Place of the well."""

    latitude_deg: float = setting(38.0, "Latitude of the well, north positive.", low=-90.0, high=90.0)
    longitude_deg: float = setting(109.0, "Longitude of the well, east positive.", low=-180.0, high=360.0)
    height_m: float = setting(1100.0, "Height of the wellhead above the ellipsoid.", low=-1000.0, high=9000.0)


@dataclasses.dataclass(frozen=True)
class ScenarioWell:
    """The hole, and the position in it at the start of the simulation."""

    convention: str = setting(
        AngleConvention.INCLINATION.value,
        "Vertical angle of the stations: inclination from the vertical, or dip from the horizontal, positive up or "
        "down.",
        choices=CONVENTIONS,
    )
    stations: tuple[tuple[float, float, float], ...] = setting(
        ((0.0, 30.0, 45.0),),
        "True path of the hole. Each row has the measured depth, m, the inclination or dip, deg (see convention), "
        "and the azimuth from true north, deg.",
    )
    plan: tuple[tuple[float, float, float], ...] = setting(
        (), "Planned path, which `mwd run` loads. Rows as in `stations`; empty: no plan."
    )
    bit_m: float = setting(30.0, "Measured depth of the bit at the start.", low=0.0, high=20000.0)
    sensor_to_bit_m: float = setting(3.0, "Distance along the hole from the sonde to the bit.", low=0.0, high=100.0)
    toolface_deg: float = setting(0.0, "Gravity toolface at the start.", low=-360.0, high=360.0)

    @property
    def hole(self) -> tuple[Array, Array, Array]:
        """Measured depth, m, inclination and azimuth, rad, of the stations, each of shape (n,)."""
        md, angle, azimuth = np.array(self.stations, dtype=float).T
        return md, AngleConvention(self.convention).inclination(np.radians(angle)), np.radians(azimuth)


@dataclasses.dataclass(frozen=True)
class SimulatedUnit:
    """One measuring unit of the sonde."""

    grade: str = setting("mti3_calibrated", "Name of the instrument grade, which gives the errors of the unit.")
    changes: dict[str, Any] = setting({}, "Figures that replace those of the grade, structured as in the grade's file.")
    lever_mm: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), "Position of the unit in the tool: x down-hole, y, z.", low=-10000.0, high=10000.0
    )
    output: str = setting(
        "integrated",
        "Kind of output. integrated: mean over each sample interval (strapdown integration). sampled: value at one "
        "moment.",
        choices=("integrated", "sampled"),
    )


@dataclasses.dataclass(frozen=True)
class Temperature:
    """Temperature of the sensors."""

    surface_c: float = setting(20.0, "Temperature at the wellhead.", low=-60.0, high=80.0)
    gradient_c_km: float = setting(
        30.0, "Rise of the rock temperature with vertical depth.", unit="degC/km", low=0.0, high=300.0
    )
    warm_up_c: float = setting(
        0.0, "Rise of the temperature of the electronics after switch-on.", low=-100.0, high=150.0
    )
    warm_up_s: float = setting(120.0, "Time constant of the rise after switch-on.", low=1.0, high=1e5)


@dataclasses.dataclass(frozen=True)
class ClockErrors:
    """Errors of the sonde's clock relative to the rig's."""

    drift_ppm: float = setting(
        0.0, "Drift of the clock. A clock with a positive drift runs fast.", low=-1000.0, high=1000.0
    )
    jitter_us: float = setting(0.0, "Random error of each stamp, 1 sigma.", unit="us", low=0.0, high=1e5)


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Settings of one simulation."""

    name: str = setting("unnamed", "Name of the scenario, one word.")
    about: str = setting("", "Purpose of the scenario in one sentence.")
    seed: int = setting(1, "Seed of all random numbers. The same seed gives the same run.", low=0, high=2**62)
    date: str = setting("2026-03-01", "Start of the run in universal time, such as 2026-03-01 or 2026-03-01T06:00:00.")
    model: str = setting("wmm2025", "Model of the Earth's magnetic field.", choices=("wmm2025", "igrf"))
    field_override: tuple[float, float, float] | None = setting(
        None, "Field that replaces the model: total (nT), dip (deg), declination (deg).", low=-1e6, high=1e6
    )
    place: ScenarioPlace = setting(ScenarioPlace, "Place of the well.")
    well: ScenarioWell = setting(ScenarioWell, "The hole, and the start of the run in it.")
    schedule: tuple[SchedulePhase, ...] = setting((SchedulePhase(),), "Work of the rig, phase by phase.")
    cycles: int = setting(1, "Number of times that the whole schedule runs.", low=1, high=10000)
    rig: Rig = setting(Rig, "Properties of the rig.")
    vibration: Vibrations = setting(Vibrations, "Vibration of the sonde.")
    steering: Steering | None = setting(
        None, "Top drive that obeys commands, and a string that winds up, sticks and slips."
    )
    ahrs: SimulatedUnit = setting(SimulatedUnit, "Conventional unit: gyros, accelerometers and magnetometers.")
    precision: SimulatedUnit | None = setting(
        SimulatedUnit(grade="tactical_north"), "High-precision unit: gyros and accelerometers."
    )
    gamma: Gamma | None = setting(None, "Natural gamma detector, and the rock around the hole. none: no detector.")
    battery: SondeBattery | None = setting(
        None, "Battery and self-tests of the sonde. none: the sonde does not report them."
    )
    temperature: Temperature = setting(Temperature, "Temperature of the sensors.")
    clock: ClockErrors = setting(ClockErrors, "Errors of the sonde's clock.")
    string: str = setting(
        "non_magnetic",
        "Kind of string around the sonde, as stated to the estimator (tool.string).",
        choices=("non_magnetic", "short", "steel"),
    )
    interference: Interference = setting(Interference, "Magnetic disturbances.")
    faults: tuple[Fault, ...] = setting((), "Sensor faults with their times.")
    link: MessageFaults = setting(MessageFaults, "Faults of the connection from the sensors to the log.")
    surface: dict[str, Any] = setting(
        {}, "Parameters of the surface node, by name, that `mwd run` sets for the scenario."
    )
    telemetry: Telemetry | None = setting(None, "Telemetry link to the surface: tool configuration and channel.")
    rate_hz: int = setting(100, "Output rate of both units. Raising it costs computing time.", low=1, high=10000)
    rig_hz: int = setting(5, "Output rate of the rig's gauges.", low=1, high=100)
    kinematics_hz: int = setting(
        2000,
        "Rate at which the motion is computed. Raising it represents faster vibration and costs computing time.",
        low=100,
        high=32000,
    )

    def __post_init__(self) -> None:
        """
        Check the scenario.

        Raise ValueError for a date that is not readable, a schedule without phases, a fault that is not possible,
        stick-slip or hunting in a scenario with steering, or rates of kinematics, converter, output and rig that are
        not multiples of each other.
        """
        parse_date(self.date)
        if not self.schedule:
            raise ValueError("schedule: at least one phase is needed")
        for fault in self.faults:
            check(fault)
        if self.steering is not None and (self.vibration.stick_slip or self.vibration.hunting):
            raise ValueError("steering: its string sticks, slips and wanders by itself; remove stick_slip and hunting")
        if self.rate_hz % self.rig_hz:
            raise ValueError(f"rate_hz {self.rate_hz} must be a multiple of rig_hz {self.rig_hz}")
        for unit in (self.ahrs, self.precision):
            if unit is not None:
                adc = grade(unit.grade, unit.changes).adc_hz
                if adc % self.rate_hz or self.kinematics_hz % (2 * adc):
                    raise ValueError(
                        f"kinematics_hz {self.kinematics_hz} must be a multiple of twice the converter rate {adc} of "
                        f"the grade, and this rate a multiple of rate_hz {self.rate_hz}"
                    )


def parse_date(text: str) -> datetime.datetime:
    """
    Return the start of a simulation in universal time.

    Raises
    ------
    ValueError
        The text is not a date of the form 2026-03-01 or 2026-03-01T06:00:00.
    """
    try:
        date = datetime.datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"date {text!r} must look like 2026-03-01 or 2026-03-01T06:00:00") from error
    return date.replace(tzinfo=datetime.UTC) if date.tzinfo is None else date.astimezone(datetime.UTC)


def parse(text: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """
    Read a scenario from YAML text; changes replaces top-level entries (for example ``{"seed": 2}``).

    Raises
    ------
    SettingsError
        The text is not a table, a key is unknown (similar ones are suggested), or a value is not allowed.
    """
    try:
        given = load_yaml(text)
    except yaml.YAMLError as error:
        raise SettingsError(f"scenario: not readable as YAML: {error}") from error
    if not isinstance(given, dict):
        raise SettingsError("scenario: expected a table of settings")
    return from_mapping(Scenario, _plain_dates(_with_missing_code({**given, **(changes or {})})))


def read(path: str | pathlib.Path, changes: Mapping[str, Any] | None = None) -> Scenario:
    """
    Read a scenario from a YAML file; changes as for `parse`.

    Raises
    ------
    SettingsError
        The errors of `parse`, with the name of the file in the message; or the file is not UTF-8.
    OSError
        The file cannot be read.
    """
    path = pathlib.Path(path)
    try:
        return parse(read_text(path, budgets.YAML), changes)
    except SettingsError as error:
        raise SettingsError(f"{path.name}: {error}") from error


def _with_missing_code(given: dict[str, Any]) -> dict[str, Any]:
    """
    Return the settings with `missing_code` of the tool true, unless the settings set it.

    The tool then reports missing values.
    """
    telemetry = given.get("telemetry")
    if not isinstance(telemetry, Mapping) or not isinstance(telemetry.get("tool", {}), Mapping):
        return given
    return {**given, "telemetry": {**telemetry, "tool": {"missing_code": True, **telemetry.get("tool", {})}}}


def _plain_dates(value: Any) -> Any:
    # YAML reads 2026-03-01 as a date; people write it with or without quotes.
    if isinstance(value, dict):
        return {key: _plain_dates(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain_dates(item) for item in value]
    return value.isoformat() if isinstance(value, datetime.date) else value
