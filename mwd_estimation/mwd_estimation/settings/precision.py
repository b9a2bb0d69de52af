# SPDX-License-Identifier: Apache-2.0
"""The high-precision inertial unit in the settings of the tool; names and units are those of the simulator's grades."""

from __future__ import annotations

from dataclasses import dataclass

from mwd_sensors.core.settings import setting

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PrecisionGyro:
    """Gyros of the high-precision unit, 1 sigma; the figures are a tactical MEMS unit's."""

    range_deg_s: Vector = setting(
        (100.0, 100.0, 100.0),
        "Largest rate that each axis reads; the smallest of the three counts. Too large, and clipped rates turn the "
        "gyro azimuth. From the data sheet.",
        unit="deg/s",
        low=0.1,
        high=2e6,
        expert=True,
    )
    noise_deg_sqrt_h: float = setting(
        0.0,
        "White noise (angle random walk); 0: measured while the tool rests. Raising it widens the sigma of the gyro "
        "azimuth. Set it where pumps shake the tool during every survey.",
        unit="deg/sqrt(h)",
        low=0.0,
        high=10.0,
        expert=True,
    )
    bias_deg_h: float = setting(
        5.0,
        "Bias that may remain, 1 sigma. Raising it widens the sigma of a gyro azimuth in one position; how good this "
        "unit is, the stations of a run tell.",
        unit="deg/h",
        low=0.0,
        high=1e5,
    )
    walk_deg_h_sqrt_h: float = setting(
        0.3,
        "Random walk of the bias. Raising it widens the sigma of long seeks and of an azimuth that the gyros carry.",
        unit="deg/h/sqrt(h)",
        low=0.0,
        high=1e4,
        expert=True,
    )
    misalignment_mrad: float = setting(
        0.3,
        "Rate about the tool axis that the cross axes read too. Raising it widens sigma in a turning string.",
        unit="mrad",
        low=0.0,
        high=100.0,
        expert=True,
    )
    g_deg_h_g: float = setting(
        0.5,
        "Sensitivity of the rate to specific force, of each axis to each. Raising it widens the sigma of every gyro "
        "azimuth. State it for a better unit.",
        unit="deg/h/g",
        low=0.0,
        high=1e3,
        expert=True,
    )
    g_calibration_deg_h_g: tuple[float, float, float, float] = setting(
        (0.0, 0.0, 0.0, 0.0),
        "Sensitivity to specific force found by calibration and taken off: along, across, stretch, shear. Zeros: "
        "not calibrated.",
        unit="deg/h/g",
        expert=True,
    )


@dataclass(frozen=True)
class PrecisionUnit:
    """The high-precision inertial unit (topic gyro/data_raw); a tool without one needs nothing set here."""

    gyro: PrecisionGyro = setting(PrecisionGyro, "Gyros")
