# SPDX-License-Identifier: Apache-2.0
"""Instrument grades: error figures of a class of sensors with their source, from the YAML files in `grades`."""

from __future__ import annotations

import dataclasses
import importlib.resources
from typing import Any

import yaml

from mwd_sensors.core.settings import SettingsError, from_mapping, setting, unknown_key


@dataclasses.dataclass(frozen=True)
class GyroGrade:
    """Errors of a gyro triad; for an error that is drawn at random for each tool, the figure is 1 sigma."""

    range_deg_s: tuple[float, float, float] = setting(
        (2000.0, 2000.0, 2000.0), "Range of each axis. Larger rates are clipped.", low=0.001
    )
    bandwidth_hz: float = setting(0.0, "Bandwidth of the output, -3 dB. 0: unlimited.", low=0.0)
    noise_deg_sqrt_h: float = setting(0.0, "Angle random walk, the white noise of the rate.", low=0.0)
    bias_deg_h: float = setting(0.0, "Bias after switch-on.", low=0.0)
    instability_deg_h: float = setting(0.0, "Bias instability, the lowest value of the Allan deviation.", low=0.0)
    instability_s: float = setting(300.0, "Correlation time of the bias instability.", low=1.0)
    walk_deg_h_sqrt_h: float = setting(
        0.0, "Rate random walk, the growth of the bias with the square root of time.", unit="deg/h/sqrt(h)", low=0.0
    )
    scale_ppm: float = setting(0.0, "Relative error of the scale factor.", low=0.0)
    misalignment_mrad: float = setting(0.0, "Misalignment of each axis towards each other axis.", low=0.0)
    bias_deg_h_per_c: float = setting(0.0, "Change of the bias per degree of temperature.", unit="deg/h/degC", low=0.0)
    scale_ppm_per_c: float = setting(
        0.0, "Change of the scale factor per degree of temperature.", unit="ppm/degC", low=0.0
    )
    g_deg_h_g: float = setting(
        0.0, "Rate error of each axis per acceleration along each axis (g-sensitivity).", low=0.0
    )
    g2_deg_h_g2: float = setting(
        0.0, "Rate error per squared acceleration (vibration rectification).", unit="deg/h/g^2", low=0.0
    )
    step_deg_s: float = setting(0.0, "Quantisation step of the output. 0: not quantised.", low=0.0)
    delay_ms: float = setting(0.0, "Delay of the output, caused by demodulation.", unit="ms", low=0.0, high=20.0)


@dataclasses.dataclass(frozen=True)
class AccelerometerGrade:
    """Errors of an accelerometer triad; for an error that is drawn at random for each tool, the figure is 1 sigma."""

    range_g: tuple[float, float, float] = setting(
        (16.0, 16.0, 16.0), "Range of each axis. Larger forces are clipped.", low=0.1
    )
    bandwidth_hz: float = setting(0.0, "Bandwidth of the output, -3 dB. 0: unlimited.", low=0.0)
    noise_ug_sqrt_hz: float = setting(0.0, "Noise density of the specific force.", unit="ug/sqrt(Hz)", low=0.0)
    bias_ug: float = setting(0.0, "Bias after switch-on.", low=0.0)
    instability_ug: float = setting(0.0, "Bias instability, the lowest value of the Allan deviation.", low=0.0)
    instability_s: float = setting(300.0, "Correlation time of the bias instability.", low=1.0)
    walk_ug_sqrt_h: float = setting(
        0.0, "Random walk of the bias, its growth with the square root of time.", unit="ug/sqrt(h)", low=0.0
    )
    scale_ppm: float = setting(0.0, "Relative error of the scale factor.", low=0.0)
    misalignment_mrad: float = setting(0.0, "Misalignment of each axis towards each other axis.", low=0.0)
    bias_ug_per_c: float = setting(0.0, "Change of the bias per degree of temperature.", low=0.0)
    scale_ppm_per_c: float = setting(
        0.0, "Change of the scale factor per degree of temperature.", unit="ppm/degC", low=0.0
    )
    g2_ug_g2: float = setting(0.0, "Error per squared acceleration (vibration rectification).", unit="ug/g^2", low=0.0)
    step_ug: float = setting(0.0, "Quantisation step of the output. 0: not quantised.", low=0.0)
    delay_ms: float = setting(0.0, "Delay of the output.", unit="ms", low=0.0, high=20.0)


@dataclasses.dataclass(frozen=True)
class MagnetometerGrade:
    """Errors of a magnetometer triad without drill string interference; figures as for `GyroGrade`."""

    range_ut: float = setting(800.0, "Range of all axes. Larger fields are clipped.", low=1.0)
    noise_nt: float = setting(0.0, "Noise of one sample.", low=0.0)
    bias_nt: float = setting(0.0, "Bias.", low=0.0)
    scale_ppm: float = setting(0.0, "Relative error of the scale factor.", low=0.0)
    misalignment_mrad: float = setting(0.0, "Misalignment of each axis towards each other axis.", low=0.0)
    bias_nt_per_c: float = setting(0.0, "Change of the bias per degree of temperature.", low=0.0)
    step_nt: float = setting(0.0, "Quantisation step of the output. 0: not quantised.", low=0.0)


@dataclasses.dataclass(frozen=True)
class Grade:
    """Error figures of a class of instruments, with its name and the source of the figures."""

    name: str = setting(doc="Name of the grade.")
    source: str = setting(doc="Source of the figures, such as a data sheet.")
    gyro: GyroGrade = setting(GyroGrade, "Errors of the gyros.")
    accelerometer: AccelerometerGrade = setting(AccelerometerGrade, "Errors of the accelerometers.")
    magnetometer: MagnetometerGrade = setting(MagnetometerGrade, "Errors of the magnetometers.")
    temperature_c: float = setting(0.0, "Error of the temperature sensor, 1 sigma.", low=0.0)
    calibrated_at_c: float = setting(
        25.0,
        "Temperature of the calibration, at which the errors that depend on temperature are zero.",
        low=-60.0,
        high=250.0,
    )
    adc_hz: int = setting(1000, "Sample rate of the analogue-to-digital converter.", low=10, high=20000)
    flags_clipping: bool = setting(False, "True if each sample reports which axes were beyond their range.")


def grade_names() -> tuple[str, ...]:
    """Return the names of the grades that come with the package."""
    folder = importlib.resources.files("mwd_sensors.simulator") / "grades"
    return tuple(sorted(item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")))


def grade(name: str, changes: dict[str, Any] | None = None) -> Grade:
    """
    Read a grade by its name and apply nested changes to it.

    Raises
    ------
    SettingsError
        There is no grade of that name (similar names are suggested), or a change is not valid.
    """
    if name not in grade_names():
        raise SettingsError(unknown_key(name, grade_names(), "grade").replace("no such setting", "no such grade"))
    text = (importlib.resources.files("mwd_sensors.simulator") / "grades" / f"{name}.yaml").read_text(encoding="utf-8")
    return from_mapping(Grade, _overlaid(yaml.safe_load(text), changes or {}), f"grade {name}")


def _overlaid(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        merged[key] = (
            _overlaid(merged[key], value) if isinstance(merged.get(key), dict) and isinstance(value, dict) else value
        )
    return merged
