# SPDX-License-Identifier: Apache-2.0
"""
Attitude of every IMU sample, and magnetic interference of the tool, from gravity, rates and magnetic samples.

A block is processed in five steps, each compiled over all samples. Gravity of rejected samples is propagated to their
stamps (`rejected_samples`). Magnetic samples are paired with gravity at their own stamps (`time_alignment`). One pair
per interval updates the interference filter, which removes the tool's own field from the azimuth (`magnetic_azimuth`).
The gyros propagate the azimuth, and the magnetic azimuths correct it (`gyro_azimuth`). The messages are written
(`attitude_rows`). If no azimuth can be propagated (at the start, near vertical, without gyros), the messages contain
the last magnetic azimuth of the third step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude import attitude_rows, gyro_azimuth, gyro_azimuth_filter, rejected_samples, time_alignment
from mwd_estimation.attitude.attitude_rows import LAST_MAGNETIC, OneFieldStretch
from mwd_estimation.attitude.block import BinEvent, Block, MagneticModelInForce
from mwd_estimation.attitude.gyro_azimuth_filter import (
    BIN_EVENT,
    GATE,
    MAGNETIC_AZIMUTH,
    PrecisionRates,
    PropagatedAzimuth,
    at_latitude,
)
from mwd_estimation.attitude.gyro_azimuth_filter import initial as initial_azimuth
from mwd_estimation.attitude.magnetic_azimuth import MagneticAzimuths
from mwd_estimation.attitude.time_alignment import PAIR, MagBlock
from mwd_estimation.attitude.time_alignment import initial as initial_alignment
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import ACCEL
from mwd_estimation.core.status import Status
from mwd_estimation.gravity.bounded.field_roll import MagneticSamples
from mwd_estimation.magnetic import interference_filter
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps, joined

_NO_REFERENCE, _FAULT = int(Status.NO_REFERENCE), int(Status.SENSOR_FAULT)
# A magnetic sample updates the interference filter if 1 sigma of the vertical is at most this, rad.
_MAX_TILT = 0.1


class AttitudeStream:
    """Attitude of one tool, block by block; the result does not depend on how the samples are cut into blocks."""

    def __init__(
        self,
        alignment: time_alignment.TimeAlignmentParams,
        interference: interference_filter.InterferenceParams,
        azimuth: gyro_azimuth_filter.GyroAzimuthParams,
        errors: SensorErrors,
        latitude_deg: float | None,
    ) -> None:
        self._alignment, self._mag_lag_ns = alignment, alignment.mag_lag_ns
        self._azimuth = at_latitude(azimuth, latitude_deg)
        self._magnetic = MagneticAzimuths(interference, errors)
        self._alignment_state = initial_alignment()
        self._rejected_state = rejected_samples.initial()
        self._mag = MagBlock(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
        #: Dtype `time_alignment.PAIR`; magnetic samples selected in the last block, one per interval, with gravity at
        #: their own stamps.
        self.handed_on = np.zeros(0, dtype=PAIR)
        self.propagated: list[PropagatedAzimuth] = []  #: propagated azimuths at each bin event of the last block
        self.set_reference(None)

    def set_reference(self, reference: Reference | None) -> None:
        """Use this reference field from the next sample on; restart the estimates of interference and azimuth."""
        self._reference = reference
        self._magnetic.set_reference(reference)
        self._azimuth_state = initial_azimuth()
        self._azimuths_read = 0
        self._waiting = np.zeros(0, dtype=MAGNETIC_AZIMUTH)
        self._last = np.zeros(1, dtype=LAST_MAGNETIC)
        self._last["azimuth"] = math.nan
        # Last magnetic azimuth; its interference is valid for all bins before the next magnetic azimuth.
        self._last_magnetic = np.zeros(1, dtype=MAGNETIC_AZIMUTH)
        self._last_magnetic["interference"] = self._last_magnetic["sigma_interference"] = np.nan
        time_alignment.restart_smoothing(self._alignment_state)

    def restart_field(self) -> None:
        """Restart the estimate of the interference; discard the magnetic azimuths that wait for the end of a bin."""
        self._magnetic.start_anew()
        self._azimuths_read -= len(self._waiting)
        self._waiting = self._waiting[:0]
        time_alignment.restart_smoothing(self._alignment_state)

    @property
    def propagated_now(self) -> PropagatedAzimuth:
        """Azimuths propagated to the end of the last closed bin."""
        return gyro_azimuth.propagated_azimuth(self._azimuth_state)

    @property
    def innovations(self) -> list[Innovation]:
        """Innovations of the field against the reference and of the magnetic azimuth against the propagated one."""
        s = self._azimuth_state[0]
        rejected, disturbed = int(s["rejected"]), int(s["disturbed"])
        azimuth = Innovation("magnetic_azimuth", gate=GATE, rejected=rejected, disturbed=disturbed)
        # Azimuths of the open bin are still waiting.
        used = self._azimuths_read - len(self._waiting) - rejected - disturbed
        if used > 0 or rejected:
            azimuth = azimuth._replace(innovation=abs(float(s["innovation_ratio"])), used=used)
        return [self._magnetic.innovation, azimuth]

    def take_mag(self, time: tuple[Stamps, Stamps], b_t: Array) -> None:
        """
        Accept magnetic samples, which wait for gravity.

        time: stamps of the messages, and times at which the samples were measured, ns, shape (m,) each; b_t: field, T,
        shape (m, 3).
        """
        (sent, stamps), waiting = time, self._mag
        self._mag = MagBlock(
            np.concatenate([waiting.stamp_ns, stamps]),
            np.concatenate([waiting.b_t, b_t]),
            np.concatenate([waiting.sent_ns, sent]),
        )

    def shift_mag(self, late_ns: int, wait_ns: int) -> None:
        """
        Correct the stamps of waiting magnetic samples, and let all magnetic samples wait longer for gravity.

        late_ns: delay of the stamps that is removed; wait_ns: time added to the lag of the settings, `mag_lag_ns`.
        """
        waiting = self._mag
        self._mag = waiting._replace(stamp_ns=waiting.stamp_ns - late_ns, sent_ns=waiting.sent_ns - late_ns)
        self._alignment = self._alignment._replace(mag_lag_ns=self._mag_lag_ns + wait_ns)

    def leave_out_mag(self, time: tuple[Stamps, Stamps], out: NDArray[np.bool_]) -> None:
        """
        Invalidate the waiting magnetic samples that would be used at IMU samples marked in `out`.

        time: stamps of the IMU samples, and times at which they were measured, ns, shape (n,) each; out: shape (n,).
        """
        mag, (sent, times) = self._mag, time
        MagneticSamples(mag.stamp_ns, mag.b_t, self._alignment.mag_lag_ns, sent, mag.sent_ns).leave_out(times, out)

    def follow(
        self,
        block: Block,
        models: list[tuple[int, MagneticModelInForce]],
        events: list[BinEvent],
        precision: PrecisionRates,
        attitude: Samples,
        gravity: Samples,
    ) -> tuple[Samples, int]:
        """
        Fill the attitude and gravity messages of a block.

        Parameters
        ----------
        block : Block
            Samples. The gravity of a rejected sample is replaced by gravity propagated to its stamp.
        models : list of (place, MagneticModelInForce)
            Index of a sample in the block, and the field model that holds from this sample on. The first model holds
            from the start of the block.
        events : list of BinEvent
            Bins evaluated within the block.
        precision : PrecisionRates
            Rates of the precision unit in the time of these bins.
        attitude, gravity : ndarray, shape (n,)
            Output, one message for each sample, dtypes `wire.ATTITUDE` and `wire.GRAVITY`.

        Returns
        -------
        interference : ndarray of dtype `wire.INTERFERENCE`
            One sample for each bin event.
        rejected : int
            Number of rejected samples.
        """
        stops = [place for place, _ in models[1:]] + [len(block.samples)]
        stretches = [(slice(start, stop), model) for (start, model), stop in zip(models, stops, strict=True)]
        before = (time_alignment.last_totals(self._alignment_state) if events else None) or (math.nan, math.nan)
        rejected_samples.run(self._rejected_state, block.samples)
        plain, magnetic = self._align(block, stretches)
        azimuth = self._propagate(block, events, magnetic, precision)
        rejected = 0
        for part, model in stretches:
            taken = slice(*np.searchsorted(magnetic["place"], [part.start, part.stop]))
            rejected += attitude_rows.write(
                self._stretch(block, part.start, model),
                self._last,
                block.samples[part],
                plain[part],
                azimuth[part],
                magnetic[taken],
                attitude[part],
                gravity[part],
            )
        interference = self._interference(events, magnetic, plain, before)
        if len(magnetic):
            self._last_magnetic = magnetic[-1:].copy()
        return interference, rejected

    def _align(self, block: Block, stretches: list[tuple[slice, MagneticModelInForce]]) -> tuple[Samples, Samples]:
        """
        Return the attitude of the n samples without gyros, ATTITUDE_ROW, and the magnetic azimuths of the block.

        A magnetic sample is used after its waiting time for gravity; the samples used are stored in `handed_on`.
        """
        plain: list[Samples] = []
        magnetic: list[Samples] = []
        handed_on: list[Samples] = []
        for k, (part, in_force) in enumerate(stretches):
            if k > 0:
                time_alignment.restart_smoothing(self._alignment_state)
                self._magnetic.update(in_force.update)
                # The new model is less certain, so an azimuth that was estimated with the old one is withdrawn.
                self._magnetic.withdrawn |= in_force.unresolved > stretches[k - 1][1].unresolved
            rows, pairs, used = time_alignment.run(
                self._alignment, self._alignment_state, in_force.model, block.samples[part], self._mag
            )
            self._mag = MagBlock._make(column[used:] for column in self._mag)
            plain.append(rows)
            handed_on.append(pairs)
            level = pairs["sigma_tilt"] < _MAX_TILT
            if level.any():
                magnetic.append(self._magnetic.read(pairs[level], in_force, part.start))
                self._azimuths_read += len(magnetic[-1])
        self.handed_on = _joined(handed_on)
        return _joined(plain), _joined([np.zeros(0, dtype=MAGNETIC_AZIMUTH), *magnetic])

    def _propagate(self, block: Block, events: list[BinEvent], magnetic: Samples, precision: PrecisionRates) -> Samples:
        """
        Return the azimuth of every sample, AZIMUTH_ROW, from the gyros and the magnetic azimuths of the closed bins.

        The azimuths propagated to the bins are stored in `propagated`. Magnetic azimuths of the open bin wait.
        """
        known = _joined([self._waiting, magnetic])
        rows, propagated, used = gyro_azimuth.run(
            self._azimuth, self._azimuth_state, block.samples, np.array(events, dtype=BIN_EVENT), known, precision
        )
        self._waiting = known[used:]
        self.propagated = [PropagatedAzimuth(*row) for row in propagated.tolist()]
        return rows

    def _stretch(self, block: Block, start: int, model: MagneticModelInForce) -> OneFieldStretch:
        status = (0 if self._magnetic.has_reference else _NO_REFERENCE) | (_FAULT if block.unusable else 0)
        # If the magnetic azimuth contains wrong values of a sensor, write only azimuths propagated by the gyros.
        return OneFieldStretch(start, model.north, status, block.contaminated or block.unusable & ACCEL != 0)

    def _interference(
        self, events: list[BinEvent], magnetic: Samples, plain: Samples, before: tuple[float, float]
    ) -> Samples:
        """
        Return the interference messages of bins, each with the estimate before the sample that closed the bin.

        before: total field, T, and dip, rad, before the block; NaN if unknown.
        """
        samples = wire.INTERFERENCE.empty(len(events))
        if not events:
            return samples
        places = np.array([event.place for event in events])
        samples["stamp_ns"] = [event.end_ns for event in events]
        known = np.concatenate([self._last_magnetic, magnetic])[np.searchsorted(magnetic["place"], places)]
        field, sigma = known["interference"], known["sigma_interference"]
        samples["axial"], samples["cross_axial"] = field[:, 0], field[:, 1:]
        samples["sigma_axial"], samples["sigma_cross_axial"] = sigma[:, 0], sigma[:, 1:]
        reference = self._reference
        if reference is not None and reference.total is not None:
            total = np.concatenate([before[:1], plain["total"]])[places]
            dip = np.concatenate([before[1:], plain["dip"]])[places]
            samples["total_residual"] = total - reference.total
            samples["dip_residual"] = dip - (math.nan if reference.dip is None else reference.dip)
        else:
            samples["total_residual"] = samples["dip_residual"] = math.nan
        return samples


def _joined(parts: list[Samples]) -> Samples:
    """Return the concatenated samples; a single array with samples is not copied."""
    parts = [part for part in parts if len(part)] or parts[:1]
    return parts[0] if len(parts) == 1 else joined(parts)
