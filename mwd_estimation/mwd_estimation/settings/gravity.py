# SPDX-License-Identifier: Apache-2.0
"""Parameters of each gravity method that users may set; the node declares only the parameters of the method in use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mwd_sensors.core.settings import setting


@dataclass(frozen=True)
class Mahony:
    """Parameters of the complementary filter with fixed gains."""

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
    """Parameters of the Mahony filter with a proportional gain from a fuzzy table (`gravity.fuzzy_mahony`)."""

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
        "Number of last samples; their largest non-gravity acceleration is the input of the fuzzy table. Raising it "
        "keeps the gain low for longer after a single shock.",
        unit="samples",
        low=1,
        high=512,
        expert=True,
    )


@dataclass(frozen=True)
class LigorioKalman:
    """Parameters of the linear Kalman extraction."""

    gyro_noise: float = setting(
        0.01,
        "White noise of the gyro, with a reserve for its other errors. Raising it gives the accelerometer more weight.",
        unit="rad/s/sqrt(Hz)",
        low=1e-7,
        high=1.0,
        expert=True,
    )
    accel_noise: float = setting(
        0.5,
        "Noise of one accelerometer sample, 1 sigma. Raising it gives the gyro more weight.",
        unit="m/s^2",
        low=0.0001,
        high=100.0,
        expert=True,
    )
    motion: float = setting(
        10.0,
        "Acceleration of the tool, 1 sigma. Raising it gives the gyro more weight.",
        unit="m/s^2",
        low=0.01,
        high=1000.0,
        expert=True,
    )
    memory: float = setting(
        0.05,
        "Correlation time of the tool's acceleration; an acceleration that lasts longer is taken for gravity.",
        unit="s",
        low=0.001,
        high=100.0,
        expert=True,
    )


@dataclass(frozen=True)
class AccelerometerOnly:
    """Parameters of the method that uses only the direction of the accelerometer."""

    memory: float = setting(
        2.0,
        "Time over which non-gravity acceleration is averaged to compute sigma. Raising it keeps sigma large for "
        "longer after a disturbance.",
        unit="s",
        low=0.01,
        high=60.0,
        expert=True,
    )


@dataclass(frozen=True)
class NoExpert:
    """Stand-in for a method without parameters to set."""


# Class of the parameters of each method; a method that is missing here has no parameters to set.
EXPERT: dict[str, type[Any]] = {
    "s3": FuzzyMahony,
    "mahony": Mahony,
    "kalman": LigorioKalman,
    "raw": AccelerometerOnly,
}
