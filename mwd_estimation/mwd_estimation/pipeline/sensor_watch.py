# SPDX-License-Identifier: Apache-2.0
"""Health of conventional unit and magnetometer: cut a block into stretches with the same usable sensors."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import FaultCode, SensorFault
from mwd_estimation.health import monitor
from mwd_estimation.health.signal_checks import BIN_NS
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.fault_history import AZIMUTH, FaultHistory
from mwd_sensors.core import input_covariance
from mwd_sensors.core.arrays import Array, Samples, Stamps

# Number of the sensor of each message field; and faults that are found for a sensor that is declared not provided.
_SENSOR_OF = {"angular_velocity": 0, "linear_acceleration": 1, "magnetic_field": 2}
_MISSING = (FaultCode.INVALID, FaultCode.DEAD)
# Number of half seconds for which a declaration "not provided" is kept.
_DECLARED_BINS = 240


@dataclasses.dataclass(frozen=True)
class UsableStretch:
    """Part of a block in which the same sensors are usable."""

    part: slice  #: indices of the samples in the block
    #: `stamps`, `gyro`, `accel`: shapes (n,), (n, 3) and (n, 3); ns, rad/s and m/s^2.
    stamps: Stamps
    gyro: Array
    accel: Array
    suspect: NDArray[np.uint8]  #: uint8, shape (n,); bits of the doubtful sensors at each sample
    unusable: int  #: bits of the sensors that are unusable in the whole stretch
    drifted: bool  #: whether gravity shows that the gyros measure a rotation that does not exist
    #: `begins_contamination`: whether a fault found at the start of this stretch shows that the azimuth contains wrong
    #: values of a sensor. `contaminated`: whether the azimuth contains such values, because of this or an earlier
    #: fault.
    begins_contamination: bool
    contaminated: bool
    changes: list[SensorFault]  #: faults found, narrowed down or cleared at the first sample


class SensorWatch:
    """
    Health of the sensors and its history.

    mat_tu, shape (3, 3): rotation from the axes of the conventional unit to tool axes; the samples are in tool axes.
    """

    def __init__(self, settings: EstimatorSettings, mat_tu: Array) -> None:
        self._mat_tu = mat_tu
        self._params = derivation.health_params(settings)
        self._mag_lag_ns, self._mag_expected = self._params.mag_lag_ns, self._params.mag_expected
        self._state = monitor.initial()
        self.history = FaultHistory()
        self._contaminated = self._drifted = False
        # For each sensor and half second: stamp, ns, of the first sample that was declared not provided.
        self._declared_ns: dict[int, dict[int, int]] = {}
        # Stamp, ns, of the first magnetic sample used since the azimuth has contained no wrong values of a sensor.
        self._mag_since_ns = np.iinfo(np.int64).max

    @property
    def faults(self) -> list[SensorFault]:
        """Present faults."""
        return [self._explained(fault, np.iinfo(np.int64).max) for fault in monitor.faults(self._state)]

    @property
    def known(self) -> dict[str, int]:
        """State of the checks of units of measurement, axes and signs by name, as in `health.fault_debounce`."""
        return monitor.known(self._state)

    def expect_mag(self, *, expected: bool) -> None:
        """Set whether magnetic samples are expected; they are not if the mount of the magnetometer is unknown."""
        self._params = self._params._replace(mag_expected=self._mag_expected and expected)

    def set_reference(self, reference: Reference | None) -> None:
        """Compare force and field with this reference from now on."""
        known = (reference.gravity, reference.total, reference.dip) if reference is not None else (None, None, None)
        monitor.set_reference(self._state, *known)

    def take_mag(self, stamps: Stamps, b_t: Array) -> None:
        """Accept all magnetic samples as received: stamps, ns, shape (n,), and field, T, shape (n, 3)."""
        monitor.push_mag(self._state, stamps, b_t)

    def take_refused(self, refused: Samples) -> None:
        """Accept the refused readings that may be in another unit of measurement, dtype of `input_gate.REFUSED`."""
        monitor.push_refused(self._state, refused)

    def note_declared(self, samples: Samples) -> None:
        """Record the vectors that samples of the IMU or the magnetometer declare as not provided."""
        for vector in _SENSOR_OF.keys() & set(samples.dtype.names or ()):
            absent = input_covariance.not_provided(samples, vector)
            if absent.any():
                known, stamps = self._declared_ns.setdefault(_SENSOR_OF[vector], {}), samples["stamp_ns"][absent]
                for half, at in zip(*np.unique(stamps // BIN_NS, return_index=True), strict=True):
                    known.setdefault(int(half), int(stamps[at]))
                while len(known) > _DECLARED_BINS:
                    del known[next(iter(known))]

    def _explained(self, fault: SensorFault, now_ns: int) -> SensorFault:
        """
        Return the fault in axes of the unit.

        `declared` is set if messages between the beginning of the fault and `now_ns`, ns, declare the sensor not
        provided.
        """
        fault = fault.in_unit_axes(self._mat_tu)
        declared = self._declared_ns.get(fault.place // 3, {}).values()
        if fault.code in _MISSING and any(fault.since_ns <= at <= now_ns for at in declared):
            return dataclasses.replace(fault, declared=True)
        return fault

    def shift_mag(self, late_ns: int, wait_ns: int) -> None:
        """
        Subtract `late_ns`, ns, from the stamps of waiting magnetic samples.

        wait_ns : time added to the waiting time for magnetic samples.
        """
        monitor.shift_mag(self._state, late_ns)
        self._params = self._params._replace(mag_lag_ns=self._mag_lag_ns + wait_ns)

    def mag_used(self, first_ns: int) -> None:
        """Record that magnetic samples from this stamp, ns, on are used for the azimuth."""
        self._mag_since_ns = min(self._mag_since_ns, first_ns)

    def stretches(self, stamps: Stamps, gyro: Array, accel: Array) -> Iterator[UsableStretch]:
        """
        Yield the stretches of a block, which is cut where the health of a sensor changes.

        Arguments as in `monitor.run`. The history of the faults is updated when a stretch is requested.
        """
        found = monitor.run(self._params, self._state, stamps, gyro, accel)
        for start, stop in itertools.pairwise(sorted({0, *found.places, len(stamps)})):
            part = slice(start, stop)
            placed, now_ns = zip(found.changes, found.places, strict=True), int(stamps[start])
            changes = [self._explained(one, now_ns) for one, at in placed if at == start]
            for change in changes:
                self.history.note(change)
                if change.code == FaultCode.REST_RATE:
                    self._drifted = not change.cleared_ns
            unusable = int(found.unusable[start])
            harmful = self.history.contaminates(changes, self._mag_since_ns)
            self._contaminated = self._contaminated or harmful
            if self._contaminated and unusable & AZIMUTH == 0:
                self._contaminated, self._mag_since_ns = False, int(stamps[start])
            yield UsableStretch(
                part,
                stamps[part],
                gyro[part],
                accel[part],
                found.suspect[part],
                unusable,
                self._drifted,
                harmful,
                self._contaminated,
                changes,
            )
