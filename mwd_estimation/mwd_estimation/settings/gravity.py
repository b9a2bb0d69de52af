# SPDX-License-Identifier: Apache-2.0
"""The parameters of each gravity method that may be set: the node declares those of the selected one alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mwd_sensors.core.settings import setting


@dataclass(frozen=True)
class Mahony:
    """The complementary filter with fixed gains."""

    k_p: float = setting(
        0.15,
        "Proportional gain: correction by the accelerometer. Raising it forgets gyro errors sooner and lets more "
        "vibration through.",
        unit="1/s",
        low=0.0,
        high=10.0,
        expert=True,
    )
    k_i: float = setting(
        0.003,
        "Integral gain, which learns the gyro bias; 0: none. Raising it learns sooner and overshoots.",
        unit="1/s^2",
        low=0.0,
        high=1.0,
        expert=True,
    )


@dataclass(frozen=True)
class FuzzyMahony(Mahony):
    """S3's filter: the proportional gain follows a fuzzy table."""

    k_p_least: float = setting(
        0.01,
        "Lower bound of the gain that the fuzzy table gives. Raising it lets more vibration through.",
        unit="1/s",
        low=0.0,
        high=10.0,
        expert=True,
    )
    window: int = setting(
        20,
        "Number of samples whose largest non-gravity acceleration enters the table. Raising it reacts to single "
        "shocks for longer.",
        unit="samples",
        low=1,
        high=512,
        expert=True,
    )


@dataclass(frozen=True)
class LigorioKalman:
    """The linear Kalman extraction."""

    gyro_noise: float = setting(
        0.01,
        "Gyro white noise with reserve. Raising it follows the accelerometer more.",
        unit="rad/s/sqrt(Hz)",
        low=1e-7,
        high=1.0,
        expert=True,
    )
    accel_noise: float = setting(
        0.5,
        "Accelerometer noise of a sample. Raising it follows the gyro more.",
        unit="m/s^2",
        low=0.0001,
        high=100.0,
        expert=True,
    )
    motion: float = setting(
        10.0,
        "Acceleration of the tool, 1 sigma. Raising it follows the gyro more.",
        unit="m/s^2",
        low=0.01,
        high=1000.0,
        expert=True,
    )
    memory: float = setting(
        0.05,
        "Correlation time of that acceleration; a longer lasting one is taken for gravity.",
        unit="s",
        low=0.001,
        high=100.0,
        expert=True,
    )


@dataclass(frozen=True)
class AccelerometerOnly:
    """The direction of the accelerometer alone."""

    memory: float = setting(
        2.0,
        "Time over which the disturbance is averaged for sigma. Raising it holds sigma wide for longer.",
        unit="s",
        low=0.01,
        high=60.0,
        expert=True,
    )


@dataclass(frozen=True)
class NoExpert:
    """A method without parameters to set."""


# A method that is not listed has none.
EXPERT: dict[str, type[Any]] = {
    "s3": FuzzyMahony,
    "mahony": Mahony,
    "kalman": LigorioKalman,
    "raw": AccelerometerOnly,
}
