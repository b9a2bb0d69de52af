# SPDX-License-Identifier: Apache-2.0
"""
Half-second bins: the work that is done once per bin, in the order of the bins.

A bin may end the interval at rest of a survey; then the survey begins in this bin. The magnetic field measured by the
survey changes the field model from this bin on. The continuity check of the survey waits for the attitude up to the end
of the survey.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude.block import BinEvent, MagneticModelInForce
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import GYRO
from mwd_estimation.core.time_bins import Bin, Binner
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.pipeline.external_field import Observatory
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.precision_unit import PrecisionUnitStage
from mwd_estimation.pipeline.requests import Requests
from mwd_estimation.pipeline.sensor_watch import UsableStretch
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.decision import Provisional, SurveyDecision
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.magnetic_feedback import MagneticFeedback
from mwd_estimation.survey.static_survey import BIN_NS, BinSet, Refusal, StillAverage, StillSurvey
from mwd_estimation.survey.turning_string import TurningString
from mwd_sensors.core.arrays import Array, Stamps


@dataclasses.dataclass
class Numbering:
    """Number of the last published survey; a restart of the estimate does not reset it."""

    last: int = 0

    def next(self) -> int:
        """Return the number of the next survey, and count it as published."""
        self.last += 1
        return self.last


@dataclasses.dataclass
class Bins:
    """Bins that closed within a stretch of samples, and the surveys that began in them."""

    events: list[BinEvent]  #: the closed bins
    #: Field models, each with the index in the stretch of the sample from which the model holds; the first model holds
    #: from the start.
    models: list[tuple[int, MagneticModelInForce]]
    taken: list[tuple[int, Provisional]]  #: surveys, each with the index of its bin in `events`


class SideStreams:
    """Bins of magnetometer, precision unit and temperature, kept until the conventional unit closes the same bin."""

    def __init__(self) -> None:
        self._binners = {"mag": Binner(3, BIN_NS), "precision": Binner(6, BIN_NS), "temperature": Binner(1, BIN_NS)}
        self._closed: dict[str, dict[int, Bin]] = {name: {} for name in self._binners}

    def add(self, name: str, stamps: Stamps, values: Array) -> None:
        """Add samples of a stream: stamps, ns, shape (n,), and values, shape (n, channels)."""
        self._keep(name, self._binners[name].add(stamps, values))

    def beside(self, imu: Bin) -> BinSet:
        """
        Return the bins of all streams at the time of a bin of the conventional unit, None for a stream without samples.

        Call this method once for each bin.
        """
        found: dict[str, Bin | None] = {}
        for name, bins in self._closed.items():
            self._keep(name, self._binners[name].flush((imu.index + 1) * BIN_NS))
            found[name] = bins.pop(imu.index, None)
            # Delete the bins before this bin; the bins of a stream are stored in order.
            while bins and next(iter(bins)) < imu.index:
                del bins[next(iter(bins))]
        return BinSet(imu, found["mag"], found["precision"], found["temperature"])

    def _keep(self, name: str, closed: list[Bin]) -> None:
        for one in closed:
            self._closed[name][one.index] = one


class BinStage:
    """Bins and surveys of one tool; a survey changes the field model of the samples after it."""

    def __init__(
        self, settings: EstimatorSettings, field: MagneticFeedback, faults: FaultHistory, numbering: Numbering
    ) -> None:
        self._field, self._faults, self._numbering = field, faults, numbering
        self.requests = Requests(settings)
        self.precision = PrecisionUnitStage(settings)
        self.streams = SideStreams()
        self.still = StillSurvey(settings.survey)
        self.turning = TurningString()
        self.decision = SurveyDecision(derivation.station_params(settings), faults)
        self._observatory = Observatory(settings.place)
        self._binner = Binner(6, BIN_NS)
        self._waiting: list[Bin] = []
        self._sensors_usable = True

    def close_bins(
        self, stretch: UsableStretch, later: NDArray[np.bool_], clipped: NDArray[np.uint8], output: Output
    ) -> Bins:
        """
        Close and return the bins that end within a stretch; add refusals, faults and results of requests to `output`.

        later, clipped, shape (n,): whether the stamp of a sample is later than all stamps that came before it, and clip
        flags of a sample as from `clip_flags.of`.
        """
        # Gyros that have drifted, or that give no data, cannot show whether the tool is at rest. Set their rates to
        # zero, so that only gravity and the magnetic field decide whether the tool is at rest.
        gyro = np.zeros_like(stretch.gyro) if stretch.drifted else stretch.gyro
        if stretch.unusable & GYRO:
            gyro = np.nan_to_num(gyro, nan=0.0)
        values = np.hstack([gyro, stretch.accel])
        doubted_sensors = stretch.suspect | np.uint8(stretch.unusable)
        if later.any():
            stamps, kept = stretch.stamps[later], values[later]
            self.turning.take_imu(stamps, kept[:, 0], kept[:, 3:], (doubted_sensors | clipped)[later] != 0)
            self.requests.take_rates(stamps, kept[:, :3])
            self.precision.compare(stamps, kept, doubted_sensors[later])
        self._sensors_usable = not stretch.unusable
        bins = Bins([], [(0, self._field.in_force)], [])
        doubted = 0
        for closed, place in self._binner.add_placed(stretch.stamps, values):
            self._waiting.append(closed)
            # Close a bin one bin late, so that the other streams of its time have arrived.
            if len(self._waiting) > 1:
                self._doubt(stretch, doubted, place)
                doubted = place
                self._close(self._waiting.pop(0), place, bins, output)
        self._doubt(stretch, doubted, len(stretch.stamps))
        return bins

    def finish(self) -> Provisional | None:
        """Return the survey that waits for the gyro, at the end of the data; None if no survey waits."""
        held = self.still.finish()
        return None if held is None else self._survey(held, self.precision.station.solution())

    def rotary(self, average: StillAverage, rotary_speed: float) -> DecidedSurvey:
        """Return a rotary survey with its verdict, from an average over a turning string; rotary_speed: rad/s."""
        return self.decision.rotary(average, self._numbering.next(), self._reference(average), rotary_speed)

    def _reference(self, average: StillAverage) -> Reference | None:
        """Return the reference with the external field at the middle of an average, as `Observatory.at`; or None."""
        return self._observatory.at(self._field.reference, (average.start_ns + average.end_ns) // 2)

    def _doubt(self, stretch: UsableStretch, start: int, stop: int) -> None:
        suspect = stretch.suspect[start:stop]
        if suspect.any():
            self._faults.doubt(stretch.stamps[start:stop], suspect)

    def _close(self, imu: Bin, place: int, bins: Bins, output: Output) -> None:
        """Do the work of one bin; the results hold from the sample with index `place` in the stretch on."""
        end_ns = (imu.index + 1) * BIN_NS
        gyro = self.precision.station
        beside = self.streams.beside(imu)
        self.turning.close(imu.index)
        result = self.still.add(beside, gyro.pending() if self.still.complete else None)
        # If the tool moved in this bin, use the gyro result from before this bin.
        so_far = gyro.solution() if isinstance(result, StillAverage) and result.moved else None
        unit = self.precision.close(imu, self.still.still_bins)
        for change in unit.changes:
            self._faults.note(change)
        output.health += unit.changes
        ended = self.requests.end_north(unit.fault) if unit.fault is not None else None
        found = ended or self.requests.seek(end_ns, unit.samples)
        if found is not None:
            output.north.append(found)
        event = BinEvent(place, imu.index, end_ns)
        if isinstance(result, Refusal):
            output.refusals.append(result)
        elif isinstance(result, StillAverage):
            north = so_far if result.moved else gyro.solution()
            taken = self._survey(result, north)
            event = BinEvent(place, imu.index, end_ns, *taken.gyro, taken.accepted_azimuth)
            bins.taken.append((len(bins.events), taken))
        bins.events.append(event)
        if self._field.in_force is not bins.models[-1][1]:
            bins.models.append((place, self._field.in_force))

    def _survey(self, still: StillAverage, found: Solution | None) -> Provisional:
        """Return the provisional survey of an interval at rest; update the field model if no sensor was faulty."""
        number = self._numbering.next()
        reference, turning = self._reference(still), self.turning.found
        taken = self.decision.begin(still, number, reference, found, turning, usable=self._sensors_usable)
        if taken.sound:
            self._field.take(taken.survey, taken.shared)
        return taken
