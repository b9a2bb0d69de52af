# SPDX-License-Identifier: Apache-2.0
"""Output of the estimator for a block of samples, and its counters."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mwd_estimation.core.sensor_fault import SensorFault
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.static_survey import Refusal
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples


@dataclasses.dataclass
class Output:
    """Attitude and gravity of every IMU sample of a block, and all other results of that time."""

    #: `attitude`, `gravity`: dtype `wire.ATTITUDE` and `wire.GRAVITY`; one row for each IMU sample.
    attitude: Samples
    gravity: Samples
    #: `interference`, `dynamics`: dtype `wire.INTERFERENCE` and `wire.DYNAMICS`; one row per half second and per
    #: second.
    interference: Samples
    dynamics: Samples
    #: Surveys by number, both those taken at rest and rotary ones (taken while the string turned).
    surveys: list[DecidedSurvey] = dataclasses.field(default_factory=list)
    refusals: list[Refusal] = dataclasses.field(default_factory=list)  #: refused requests for a survey at rest
    rotary_refusals: list[Refusal] = dataclasses.field(default_factory=list)  #: refused requests for a rotary survey
    #: Faults of sensors that were found, narrowed down or cleared.
    health: list[SensorFault] = dataclasses.field(default_factory=list)
    north: list[Solution] = dataclasses.field(default_factory=list)  #: results of north seeks on request

    @classmethod
    def empty(cls, n: int) -> Output:
        """Return an output with rows for n IMU samples."""
        return cls(wire.ATTITUDE.empty(n), wire.GRAVITY.empty(n), wire.INTERFERENCE.empty(0), wire.DYNAMICS.empty(0))

    def joined(self, later: Output) -> Output:
        """Return this output with the later output `later` appended."""
        pairs = zip(vars(self).values(), vars(later).values(), strict=True)
        joined: list[Any] = [one + two if isinstance(one, list) else np.concatenate([one, two]) for one, two in pairs]
        return Output(*joined)


@dataclasses.dataclass
class SampleCounters:
    """Number of samples received, number of samples not used, and number of times that time went back."""

    #: `imu`, `mag`, `precision`: samples received from the conventional unit, the magnetometer and the precision unit.
    imu: int = 0
    mag: int = 0
    precision: int = 0
    rejected: int = 0  #: samples of all streams that were rejected
    late_mag: int = 0  #: magnetic samples that arrived later than `tool.magnetometer.delay_s` after their stamp
    spikes: int = 0  #: magnetic samples that were spikes
    set_back: int = 0  #: number of restarts because time went back
