# SPDX-License-Identifier: Apache-2.0
"""
Magnetic azimuths that correct the gyro-propagated azimuth; with a reference, the tool's own field is removed.

The interference filter processes each magnetic sample that the time alignment selects. The filter removes bias and
scale errors as far as they are known, and splits the sigma into parts by the time for which the errors last.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude.block import MagneticModelInForce, StationUpdate
from mwd_estimation.attitude.gyro_azimuth_filter import MAGNETIC_AZIMUTH
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.innovations import Innovation
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_estimation.magnetic import interference_filter
from mwd_estimation.magnetic.interference_filter import FieldSamples
from mwd_sensors.core.arrays import Samples

_DISTURBED, _CORRECTED, _UNCORRECTED = int(Status.MAG_DISTURBED), int(Status.CORRECTED), int(Status.UNCORRECTED)
_REFUSED = int(Status.CORRECTION_REFUSED)
# Interference counts as not observed while its sigma is above this share of its prior sigma.
_UNOBSERVED = 0.7
# If the axial interference is not observed and its sigma turns the azimuth by more than this, rad, the correction is
# reported as refused.
_MAX_UNOBSERVED = math.radians(3.0)
# Without a reference: sigma of the slowly changing errors, as a share of the magnetic sigma without its constant part;
# the remaining variance is noise.
_SLOW_SHARE = 0.95
# 1 sigma of the tilt of a station, rad; and ratio of chi-square to the gate above which a station contradicts the
# estimated interference.
_STATION_TILT = math.radians(0.1)
_CONTRADICTED = 4.0
# Time for which the field must pass the check after a disturbed sample before it is used again, ns: when the sensor
# leaves a casing, the field takes values that drill-string interference could explain.
_SETTLED_NS = 3_000_000_000
# 1 sigma of external interference after a disturbed sample, T, and its decay time, ns. The field check tests the
# vertical and the horizontal field. It does not detect a disturbance towards east, which turns the azimuth.
_EXTERNAL, _EXTERNAL_NS = 300e-9, 60_000_000_000


class MagneticAzimuths:
    """Magnetic azimuths with their sigmas, and the interference filter that computes them."""

    def __init__(self, params: interference_filter.InterferenceParams, errors: SensorErrors) -> None:
        self._params, self._errors = params, errors
        #: Set to True to withdraw the earlier azimuths; the next one then restarts the propagated azimuth.
        self.withdrawn = False
        self._new_start = False
        self.set_reference(None)

    def set_reference(self, reference: Reference | None) -> None:
        """Use this reference field from the next sample on; restart the estimate of the interference."""
        self._reference = reference
        #: Innovation of the field against the reference, since the reference was set.
        self.innovation = Innovation("magnetic_field", gate=math.sqrt(self._params.gate))
        self._state: Samples | None = None
        if reference is not None and reference.has_field:
            self._state = interference_filter.initial(self._params, reference, self._errors)
        self._disturbed_ns = -_SETTLED_NS

    def start_anew(self) -> None:
        """Restart the interference estimate; its first azimuth and the propagated azimuth are then equally probable."""
        self.set_reference(self._reference)
        self._new_start = True

    @property
    def has_reference(self) -> bool:
        """Whether there is a reference with a field."""
        return self._state is not None

    def update(self, station: StationUpdate | None) -> None:
        """
        Use the interference and the gyro azimuth found at a station; do nothing if `station` is None.

        If an accepted station contradicts the estimated interference, the estimate restarts first. The interference
        from the stations replaces the estimate only if its axial variance is smaller.
        """
        state = self._state
        if station is None or state is None or self._reference is None:
            return
        if station.accepted and self._contradicts(state, station):
            # The station passes its checks, but its field contradicts the estimated interference (before the first
            # estimate, the prior).
            state = interference_filter.initial(self._params, self._reference, self._errors, station.axial)
            self._state, self._new_start = state, True
        s = state[0]
        if station.interference is not None and station.interference[1][0, 0] < s.P[0, 0]:
            # The stations measured the same interference at rest and at more attitudes: replace the estimate from
            # drilling.
            s.x[:], s.P[:] = station.interference
        if math.isfinite(station.azimuth):
            interference_filter.aid_azimuth(
                self._params, state, station.down, station.field, station.azimuth, station.sigma
            )

    def _contradicts(self, state: Samples, station: StationUpdate) -> bool:
        stamps, tilt = np.full(1, int(state[0].last_ns)), np.full(1, _STATION_TILT)
        sample = FieldSamples(stamps, station.down[None], station.field[None], tilt)
        found = interference_filter.run(self._params, state.copy(), sample)
        return bool(found["ratio"][0] > (_CONTRADICTED if state[0].learnt_s > 0.0 else 1.0))

    def read(self, pairs: Samples, in_force: MagneticModelInForce, start: int) -> Samples:
        """
        Return the azimuths of the pairs of a stretch of samples that begins at index `start` of its block.

        The interference filter is updated with the pairs. pairs is an array of dtype `time_alignment.PAIR` with
        at least one element. Returns dtype MAGNETIC_AZIMUTH.
        """
        rows = np.zeros(len(pairs), dtype=MAGNETIC_AZIMUTH)
        rows["place"], rows["stamp_ns"] = pairs["place"] + start, pairs["stamp_ns"]
        if self._state is None:
            self._read_plain(pairs, in_force, rows)
        else:
            self._read_corrected(self._state, pairs, in_force, rows)
        rows["usable"] = rows["status"] & _DISTURBED == 0
        # Report a withdrawal or a new start with one row only.
        rows["restart"][0] |= self.withdrawn
        rows["new_start"][0] |= self._new_start
        self.withdrawn = self._new_start = False
        return rows

    def _read_plain(self, pairs: Samples, in_force: MagneticModelInForce, rows: Samples) -> None:
        """Fill the rows with the measured azimuths, uncorrected, when the reference is unknown."""
        constant = min(in_force.model.sigma_north, math.pi)
        rest = np.sqrt(np.maximum(pairs["sigma"] ** 2 - constant**2, 0.0))
        rows["azimuth"], rows["sigma_constant"] = pairs["azimuth"], constant
        rows["sigma_slow"], rows["sigma_noise"] = _SLOW_SHARE * rest, math.sqrt(1.0 - _SLOW_SHARE**2) * rest
        rows["status"] = _UNCORRECTED | (_DISTURBED if in_force.external_interference else 0)
        rows["interference"] = rows["sigma_interference"] = np.nan

    def _read_corrected(self, state: Samples, pairs: Samples, in_force: MagneticModelInForce, rows: Samples) -> None:
        """Fill the rows with azimuths corrected for the interference estimated from the samples so far."""
        n, s = len(pairs), state[0]
        samples = FieldSamples(pairs["stamp_ns"], pairs["g_t"], pairs["b_t"], pairs["sigma_tilt"])
        found = interference_filter.run(self._params, state, samples)
        beyond = int(np.count_nonzero(~(found["ratio"] <= 1.0)))
        self.innovation = self.innovation._replace(
            innovation=math.sqrt(self._params.gate * max(float(found["ratio"][-1]), 0.0)),
            used=self.innovation.used + n - beyond,
            rejected=self.innovation.rejected + beyond,
        )
        horizontal = float(s.field[0])
        observed = found["sigma"] < _UNOBSERVED * np.sqrt(np.diagonal(s.prior)[:3])
        quiet = self._since_disturbed(found["ratio"], samples.stamp_ns)
        rows["status"] = _correction_status(found, samples, observed[:, 0] | in_force.corrected, horizontal)
        usable = (quiet > _SETTLED_NS) & (not in_force.external_interference)
        rows["status"] |= np.where(usable, 0, _DISTURBED).astype(np.uint32)
        white = self._params.noise / horizontal
        external = _EXTERNAL / horizontal * np.exp(-quiet / _EXTERNAL_NS)
        held = np.maximum(found["sigma_azimuth"] ** 2 - found["sigma_own"] ** 2 - white * white, 0.0)
        rows["azimuth"] = found["azimuth"] + in_force.model.north_correction
        rows["sigma_slow"], rows["sigma_held"] = found["sigma_own"], np.sqrt(held + external**2)
        rows["sigma_noise"], rows["sigma_constant"] = white, in_force.model.sigma_north
        rows["new_start"] = found["restarted"]
        rows["interference"] = np.where(observed, found["bias"], np.nan)
        rows["sigma_interference"] = np.where(observed, found["sigma"], np.nan)

    def _since_disturbed(self, ratio: NDArray[np.float64], stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """
        Return the time of each sample since the last sample that the filter rejected, ns, shape (n,).

        ratio, shape (n,): chi-square of each sample divided by the gate; the last rejected sample is kept for later
        calls.
        """
        disturbed = np.maximum.accumulate(np.where(ratio <= 1.0, self._disturbed_ns, stamps))
        self._disturbed_ns = int(disturbed[-1])
        return np.asarray(stamps - disturbed)


def _correction_status(
    found: Samples, samples: FieldSamples, corrected: NDArray[np.bool_], horizontal: float
) -> NDArray[np.uint32]:
    """
    Return the status bits of the azimuths, shape (n,).

    They are CORRECTED where `corrected` is True, otherwise UNCORRECTED. CORRECTION_REFUSED is added if the sigma of the
    axial interference turns the azimuth by more than `_MAX_UNOBSERVED`. horizontal: horizontal reference field, T.
    """
    sine = np.sqrt(np.maximum(1.0 - samples.g_t[:, 0] ** 2, 0.0))
    unobserved = found["sigma"][:, 0] * sine * np.abs(np.sin(found["azimuth"])) / horizontal
    bits = np.where(unobserved > _MAX_UNOBSERVED, _UNCORRECTED | _REFUSED, _UNCORRECTED)
    return np.asarray(np.where(corrected, _CORRECTED, bits), dtype=np.uint32)
