"""
From gravity and magnetic samples to the attitude of every IMU sample, the tool's own field, and the azimuth carried.

A block goes through in five steps, each compiled over all its samples: gravity of samples that were not used is carried
to their stamps (`refused_rows`); magnetic samples are paired with gravity at their own stamps (`attitude_track`); the
tool's own field is learnt from one pair in each interval (`tool_field`), which frees the azimuth of it; the azimuth is
carried by the gyros and corrected by those (`continuous_azimuth`); the rows of the wire are written. Where no azimuth
can be carried (at the start, near vertical) the plain magnetic one stands.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.attitude import gyro_azimuth, rejected_samples, time_alignment
from mwd_estimation.attitude.gyro_azimuth import Precision, Steps
from mwd_estimation.attitude.time_alignment import FieldModel, Pairs
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.samples import Track
from mwd_estimation.core.status import Status
from mwd_estimation.health.sensor_fault import ACCEL, GYRO
from mwd_estimation.magnetic import interference_filter
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled

_REJECTED, _NEAR_VERTICAL = int(Status.REJECTED), int(Status.NEAR_VERTICAL)
_DISTURBED, _CORRECTED, _UNCORRECTED = int(Status.MAG_DISTURBED), int(Status.CORRECTED), int(Status.UNCORRECTED)
_REFUSED, _NO_REFERENCE = int(Status.CORRECTION_REFUSED), int(Status.NO_REFERENCE)
_FAULT, _SUSPECT, _AIDED = int(Status.SENSOR_FAULT), int(Status.SENSOR_SUSPECT), int(Status.GYRO_AIDED)
# Sensors that inclination and toolface rest on.
_LEVEL_SENSORS = GYRO | ACCEL
# An error whose sigma is still this share of its prior is called not observable.
_HIDDEN = 0.7
# Beyond this the axial field that is not seen turns the azimuth too far to say nothing of it, rad.
_TOO_FAR = math.radians(3.0)
# White noise of each magnetometer axis of one sample, T.
_MAG_NOISE = 100e-9
# A station's tilt, rad; and the chi-square over the gate from which on it contradicts what was learnt on the way.
_STATION_TILT = math.radians(0.1)
_CONTRADICTED = 4.0
# After a disturbed sample the field has to be in order for so long before it is believed again: on the way out of a
# casing it passes through values that a steel string could explain.
_SETTLED_NS = 3_000_000_000
# Steel that was seen a moment ago still turns the azimuth by what its field may have across the two directions that are
# checked, T, and goes on to for about so long.
_STEEL, _STEEL_NS = 300e-9, 60_000_000_000
# With a vertical less certain than this a magnetic sample says nothing of the tool's own field, rad.
_LEVEL = 0.1


@dataclasses.dataclass(frozen=True)
class Block:
    """
    Samples of the AHRS, laid out for the kernels, the gravity followed through them, and the state of the sensors.

    Attributes
    ----------
    stamps, gyro, accel : ndarray, shapes (n,), (n, 3) and (n, 3)
        ns, rad/s (nan where the gyros are unusable), m/s^2.
    track : Track
    suspect : ndarray of uint8, shape (n,)
        Sensors in doubt at each sample, bits of `health.sensor_fault`.
    unusable : int
        Sensors known to be faulty throughout the block, as such bits.
    contaminated : bool
        Whether the azimuth has taken in wrong values of a faulty sensor.
    """

    stamps: Stamps
    gyro: Array
    accel: Array
    track: Track
    suspect: NDArray[np.uint8]
    unusable: int = 0
    contaminated: bool = False


@dataclasses.dataclass(frozen=True)
class Lesson:
    """
    What a station teaches the continuous estimate.

    Attributes
    ----------
    own : (ndarray (8,), ndarray (8, 8)) or None
        State and covariance of the tool's own field, by many stations together, to go on from.
    down, field : ndarray, shape (3,)
        Unit vector down and field, T, of the station.
    azimuth, sigma : float
        From magnetic north, rad, by a gyro; nan where there is none.
    accepted : bool
        Whether the station passed its checks.
    axial : tuple of float
        Axial interference that it was corrected for, and 1 sigma, T.
    """

    own: tuple[Array, Array] | None
    down: Array
    field: Array
    azimuth: float = math.nan
    sigma: float = math.nan
    accepted: bool = False
    axial: tuple[float, float] = (0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Reading:
    """
    How the magnetic field is read from a sample on.

    Attributes
    ----------
    model : FieldModel
    north : int
        Code of its north.
    corrected : bool
        Whether the model takes off interference that a station showed.
    lesson : Lesson or None
        What was learnt there.
    steel : bool
        A gyro has shown that the magnetic azimuth is wrong though its field is in order: it is not used until a gyro
        shows otherwise.
    left_open : float
        How far a gyro that is too uncertain to contradict is from the magnetic azimuth, rad; in the model's sigma.
    """

    model: FieldModel
    north: int
    corrected: bool
    lesson: Lesson | None = None
    steel: bool = False
    left_open: float = 0.0


@dataclasses.dataclass(frozen=True)
class Mark:
    """
    A bin judged before the sample at `place`: its index, its end, and what was found in it.

    Attributes
    ----------
    azimuth, sigma : float
        Of a north seek, rad; nan where there is none.
    station : tuple of four float
        Of an accepted station: as `gyro_azimuth.Steps.station`.
    """

    place: int
    bin: int
    end_ns: int
    azimuth: float = math.nan
    sigma: float = math.nan
    station: tuple[float, float, float, float] = (math.nan, math.nan, math.nan, math.nan)


@dataclasses.dataclass(frozen=True)
class _Magnetic:
    """
    Pairs as they correct the azimuth, m of them.

    `sigma`, shape (m, 4), as `Steps.mag_sigma`; `afresh`: what was said before is withdrawn; `bits` of `Status`;
    `own` and `sigma_own`, shape (m, 3), the tool's field, T.
    """

    place: Stamps
    stamp_ns: Stamps
    azimuth: Array
    sigma: Array
    afresh: NDArray[np.bool_]
    bits: NDArray[np.uint32]
    own: Array
    sigma_own: Array

    def joined(self, other: _Magnetic) -> _Magnetic:
        """Those of `other` behind these."""
        return _Magnetic(
            *(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in dataclasses.fields(self))
        )

    def since(self, first: int) -> _Magnetic:
        """From one on."""
        return _Magnetic(*(getattr(self, f.name)[first:] for f in dataclasses.fields(self)))


def _no_pairs() -> _Magnetic:
    whole, one, three = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3))
    no, bits = np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.uint32)
    return _Magnetic(whole, whole, one, np.zeros((0, 4)), no, bits, three, three)


class AttitudeStream:
    """
    Attitude of one tool, block by block; any cut gives the same bits.

    Parameters
    ----------
    azimuth, field, carry
        Settings of the three steps.
    errors : SensorErrors
    bin_ns : int
    latitude_deg : float or None
    precision : Precision
    """

    def __init__(
        self,
        azimuth: time_alignment.Params,
        field: interference_filter.Params,
        carry: gyro_azimuth.Params,
        errors: SensorErrors,
        bin_ns: int,
        latitude_deg: float | None,
        precision: Precision,
    ) -> None:
        self._azimuth, self._field, self._errors, self._bin_ns = azimuth, field, errors, bin_ns
        self._carry = gyro_azimuth.kernel_settings(carry, latitude_deg, precision, azimuth.handing_on_s)
        self._share = carry.magnetic_share
        self._gap_ns = round(carry.gap_s * 1e9)
        self._track_state = time_alignment.initial()
        self._carry_state = gyro_azimuth.initial()
        self._refused = rejected_samples.initial()
        self._field_state: interference_filter.State | None = None
        self._reference: Reference | None = None
        self._mag_ns = np.zeros(0, dtype=np.int64)
        self._mag_t = np.zeros((0, 3))
        self._pairs = _no_pairs()
        # Magnetic samples with gravity at their own stamps, of the last block.
        self.handed_on = Pairs.joined([])
        # At each mark of the last block, the last station's azimuth carried on: as `gyro_azimuth.Rows.anchor`.
        self.anchors = np.zeros((0, 5))
        self._withdrawn = False
        self._bad_ns = -_SETTLED_NS
        # Of the last pair: bits, sigma of its azimuth; and the tool's field with sigma.
        self._bits, self._sigma = np.zeros(1, dtype=np.uint32), np.zeros(1)
        self._own = np.concatenate([np.zeros(3), np.full(3, -1.0)])

    def set_reference(self, reference: Reference | None) -> None:
        """Read the field against this from the next sample on; own field and carried azimuth begin anew."""
        self._reference = reference
        known = reference is not None and reference.has_field
        self._field_state = (
            interference_filter.initial(self._field, reference, self._errors) if known and reference else None
        )
        self._carry_state = gyro_azimuth.initial()
        self._pairs = _no_pairs()
        self._bits[0], self._sigma[0], self._bad_ns = 0, 0.0, -_SETTLED_NS
        self._own = np.concatenate([np.zeros(3), np.full(3, -1.0)])
        time_alignment.begin_smoothing(self._track_state)

    @property
    def anchor(self) -> Array:
        """The last accepted station's azimuth carried on to the last bin: as `gyro_azimuth.Rows.anchor`."""
        return gyro_azimuth.anchor_of(self._carry_state)

    def take_mag(self, stamps: Stamps, b_t: Array) -> None:
        """Magnetic samples, T; they wait for the gravity of their time."""
        self._mag_ns = np.concatenate([self._mag_ns, stamps])
        self._mag_t = np.concatenate([self._mag_t, b_t])

    def leave_out_mag(self, stamps: Stamps, out: NDArray[np.bool_]) -> None:
        """Of the samples that wait, those whose turn comes at one of these IMU samples, ns, that is `out`."""
        if not out.any():
            return
        lag = round(self._azimuth.mag_lag_s * 1e9)
        turn = np.searchsorted(np.maximum.accumulate(stamps), np.maximum.accumulate(self._mag_ns) + lag)
        left = turn < len(stamps)
        left[left] = out[turn[left]]
        self._mag_t[left] = math.nan

    def follow(
        self,
        block: Block,
        readings: list[tuple[int, Reading]],
        marks: list[Mark],
        precision: tuple[Stamps, Array],
        attitude: Samples,
        gravity: Samples,
    ) -> tuple[Samples, int]:
        """
        Write attitude and gravity of a block.

        Parameters
        ----------
        block : Block
        readings : list of (place, Reading)
            In force from a sample of the block on; the first from the block's start.
        marks : list of Mark
            Bins judged within the block.
        precision : (stamps (q,), rates (q, 3))
            Of the precision unit in the time of those bins, rad/s.
        attitude, gravity : ndarray
            Of the block's length, dtypes `wire.ATTITUDE` and `wire.GRAVITY`; filled.

        Returns
        -------
        interference : ndarray of dtype `wire.INTERFERENCE`
            One sample for each mark.
        rejected : int
            Samples not used.
        """
        stops = [place for place, _ in readings[1:]] + [len(block.stamps)]
        stretches = [(slice(start, stop), reading) for (start, reading), stop in zip(readings, stops, strict=True)]
        before = time_alignment.last_totals(self._track_state) or (math.nan, math.nan)
        rows, pairs, raw = [], _no_pairs(), []
        carried_on = rejected_samples.run(self._refused, block.stamps, block.gyro, block.track)
        for k, (part, reading) in enumerate(stretches):
            if k > 0:
                time_alignment.begin_smoothing(self._track_state)
                self._learn(reading.lesson)
                # What was sure before is so no longer.
                self._withdrawn |= reading.left_open > stretches[k - 1][1].left_open
            track = block.track
            found, handed, used = time_alignment.run(
                self._azimuth,
                self._track_state,
                reading.model,
                block.stamps[part],
                track.g_t[part],
                carried_on.rate_x[part],
                carried_on.sigma_down[part],
                self._mag_ns,
                self._mag_t,
            )
            self._mag_ns, self._mag_t = self._mag_ns[used:], self._mag_t[used:]
            rows.append(found)
            raw.append(handed)
            level = handed.sigma_tilt < _LEVEL
            if level.any():
                pairs = pairs.joined(self._read(handed.where(level), reading, part.start))
        self.handed_on = Pairs.joined(raw)
        carried, waiting = self._carry_on(block, marks, pairs, precision)
        rejected, sigma = 0, np.sqrt((pairs.sigma**2).sum(axis=1))
        bits = 0 if self._field_state is not None else _NO_REFERENCE
        bits |= _FAULT if block.unusable else 0
        # Of an azimuth that rests on wrong values, what the gyros have carried on since the fault stands.
        lost = block.contaminated or block.unusable & ACCEL != 0
        for (part, reading), found in zip(stretches, rows, strict=True):
            track = block.track
            here = slice(*np.searchsorted(pairs.place, [part.start, part.stop]))
            rejected += _write(
                attitude[part], gravity[part], block.stamps[part], track.g_t[part], track.sigma_inclination[part],
                track.sigma_toolface[part], track.non_gravity[part], track.rotary_speed[part], track.status[part],
                found.inclination, found.azimuth, found.gravity_toolface, found.magnetic_toolface, found.sigma_azimuth,
                found.sigma_magnetic_toolface, found.status, carried.azimuth[part], carried.sigma[part],
                carried.status[part], pairs.place[here] - part.start, pairs.bits[here], sigma[here], self._bits,
                self._sigma, carried_on.sigma_down[part], carried_on.turned[part],
                block.suspect[part], reading.north, bits, lost,
            )  # fmt: skip
        interference = self._interference(marks, pairs, rows, before)
        if len(pairs.place):
            self._own = np.concatenate([pairs.own[-1], pairs.sigma_own[-1]])
        self._pairs = waiting
        return interference, rejected

    def _learn(self, lesson: Lesson | None) -> None:
        state = self._field_state
        if lesson is None or state is None or self._reference is None:
            return
        if lesson.accepted and self._contradicts(state, lesson):
            # A station that passes its checks, in a field that is no longer the one that was learnt, or that is beyond
            # what the prior thinks possible.
            self._field_state = state = interference_filter.initial(
                self._field, self._reference, self._errors, lesson.axial
            )
            self._withdrawn = True
        if lesson.own is not None and lesson.own[1][0, 0] < state.covariance[0, 0]:
            # The same field, seen at rest and from more attitudes: it takes the place of what was learnt on the way.
            state.x[:], state.covariance[:] = lesson.own
        if math.isfinite(lesson.azimuth):
            interference_filter.aid_azimuth(self._field, state, lesson.down, lesson.field, lesson.azimuth, lesson.sigma)

    def _contradicts(self, state: interference_filter.State, lesson: Lesson) -> bool:
        one = np.full(1, int(state.stamp_ns[0]))
        tilt, noise = np.full(1, _STATION_TILT), np.full(1, _MAG_NOISE)
        held = interference_filter.run(
            self._field,
            state.copy(),
            one,
            lesson.down[None],
            lesson.field[None],
            tilt,
            noise,
            np.zeros(1, dtype=np.bool_),
        )
        return bool(held.ratio[0] > (_CONTRADICTED if state.learnt_s[0] > 0.0 else 1.0))

    def _read(self, pairs: Pairs, reading: Reading, start: int) -> _Magnetic:
        """What the pairs of a stretch say of the azimuth, by the tool's own field where a reference shows it."""
        n, model = len(pairs.place), reading.model
        if self._field_state is None:
            bits = np.full(n, _UNCORRECTED | (_DISTURBED if reading.steel else 0), dtype=np.uint32)
            unknown = np.full((n, 3), -1.0)
            parts = np.zeros((n, 4))
            parts[:, 3] = min(model.sigma_north, math.pi)
            rest = np.sqrt(np.maximum(pairs.sigma**2 - parts[:, 3] ** 2, 0.0))
            parts[:, 0], parts[:, 2] = self._share * rest, math.sqrt(1.0 - self._share**2) * rest
            return _Magnetic(
                pairs.place + start, pairs.stamp_ns, pairs.azimuth, parts, self._afresh(np.zeros(n, dtype=np.bool_)),
                bits, np.zeros((n, 3)), unknown,
            )  # fmt: skip
        state = self._field_state
        learnt = interference_filter.run(
            self._field, state, pairs.stamp_ns, pairs.g_t, pairs.b_t, pairs.sigma_tilt, np.full(n, _MAG_NOISE)
        )
        shown = learnt.sigma < _HIDDEN * np.sqrt(np.diagonal(state.prior)[:3])
        sine = np.sqrt(np.maximum(1.0 - pairs.g_t[:, 0] ** 2, 0.0))
        hidden = learnt.sigma[:, 0] * sine * np.abs(np.sin(learnt.azimuth)) / state.field[0]
        corrected = shown[:, 0] | reading.corrected
        bits = np.where(corrected, _CORRECTED, np.where(hidden > _TOO_FAR, _UNCORRECTED | _REFUSED, _UNCORRECTED))
        bad = np.maximum.accumulate(np.where(learnt.ratio <= 1.0, self._bad_ns, pairs.stamp_ns))
        self._bad_ns = int(bad[-1])
        bits |= np.where((pairs.stamp_ns - bad > _SETTLED_NS) & (not reading.steel), 0, _DISTURBED)
        afresh = self._afresh(learnt.restarted)
        white = np.full(n, _MAG_NOISE / state.field[0])
        near = _STEEL / state.field[0] * np.exp(-(pairs.stamp_ns - bad) / _STEEL_NS)
        held = np.sqrt(np.maximum(learnt.sigma_azimuth**2 - learnt.sigma_own**2 - white**2, 0.0) + near**2)
        return _Magnetic(
            pairs.place + start,
            pairs.stamp_ns,
            learnt.azimuth + model.north_correction,
            np.stack([learnt.sigma_own, held, white, np.full(n, model.sigma_north)], axis=1),
            afresh,
            bits.astype(np.uint32),
            np.where(shown, learnt.bias, 0.0),
            np.where(shown, learnt.sigma, -1.0),
        )

    def _afresh(self, restarted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """From which pairs on the azimuth begins anew; what was withdrawn counts once."""
        restarted[0] |= self._withdrawn
        self._withdrawn = False
        return restarted

    def _carry_on(
        self, block: Block, marks: list[Mark], pairs: _Magnetic, precision: tuple[Stamps, Array]
    ) -> tuple[gyro_azimuth.Rows, _Magnetic]:
        told = self._pairs.joined(pairs)
        steps = Steps(
            np.array([mark.place for mark in marks], dtype=np.int64),
            np.array([mark.bin for mark in marks], dtype=np.int64),
            np.array([mark.azimuth for mark in marks], dtype=np.float64),
            np.array([mark.sigma for mark in marks], dtype=np.float64),
            np.array([mark.station for mark in marks], dtype=np.float64).reshape(-1, 4),
            told.stamp_ns,
            told.azimuth,
            told.sigma,
            told.bits & _DISTURBED == 0,
            told.afresh,
            *precision,
        )
        track = block.track
        carried, used = gyro_azimuth.run(
            self._carry, self._bin_ns, self._gap_ns, self._carry_state, block.stamps, block.gyro, track.g_t,
            track.sigma_inclination, steps,
        )  # fmt: skip
        self.anchors = carried.anchor
        return carried, told.since(used)

    def _interference(
        self, marks: list[Mark], pairs: _Magnetic, rows: list[time_alignment.Rows], before: tuple[float, float]
    ) -> Samples:
        """Samples of bins, each by what was known before the sample that closed it."""
        samples = wire.INTERFERENCE.empty(len(marks))
        if not marks:
            return samples
        places = np.array([mark.place for mark in marks])
        samples["stamp_ns"] = [mark.end_ns for mark in marks]
        at = np.searchsorted(pairs.place, places)
        own = np.vstack([self._own, np.hstack([pairs.own, pairs.sigma_own])])[at]
        samples["axial"], samples["cross_axial"] = own[:, 0], own[:, 1:3]
        samples["sigma_axial"], samples["sigma_cross_axial"] = own[:, 3], own[:, 4:]
        reference = self._reference
        if reference is not None and reference.total is not None:
            total = np.concatenate([before[:1], *(row.total for row in rows)])[places]
            dip = np.concatenate([before[1:], *(row.dip for row in rows)])[places]
            seen = np.isfinite(total)
            samples["total_residual"] = np.where(seen, total - reference.total, 0.0)
            samples["dip_residual"] = np.where(seen, dip - (reference.dip or 0.0), 0.0)
        return samples


@compiled
def _write(
    attitude: Samples, gravity: Samples, stamps: Stamps, g_t: Array, sigma_inclination: Array, sigma_toolface: Array,
    non_gravity: Array, rotary_speed: Array, track_status: NDArray[np.uint32], inclination: Array, azimuth: Array,
    gravity_toolface: Array, magnetic_toolface: Array, sigma_azimuth: Array, sigma_magnetic_toolface: Array,
    row_status: NDArray[np.uint32], carried: Array, sigma_carried: Array, carried_status: NDArray[np.uint32],
    pair_place: Stamps, pair_bits: NDArray[np.uint32], pair_sigma: Array, last_bits: NDArray[np.uint32],
    last_sigma: Array, sigma_down: Array, turned: Array, suspect: NDArray[np.uint8], north: int, bits: int, lost: bool,
) -> int:  # fmt: skip
    """
    Fill the samples of a stretch, unknown values 0 with a sigma of -1; returns how many were rejected.

    What rests on a sensor in doubt has a sigma of pi; lost: no azimuth but one that the gyros alone have carried on.
    """
    rejected, pair = 0, 0
    tau = 2.0 * math.pi
    for i in range(len(stamps)):
        while pair < len(pair_place) and pair_place[pair] <= i:
            last_bits[0], last_sigma[0] = pair_bits[pair], pair_sigma[pair]
            pair += 1
        row, down = attitude[i], gravity[i]
        has_gravity = math.isfinite(inclination[i])
        # Near vertical is what the attitude says, by its settings, not the gravity method by its own.
        status = (np.int64(track_status[i]) & ~_NEAR_VERTICAL) | np.int64(row_status[i]) | bits
        status |= np.int64(carried_status[i])
        status |= np.int64(last_bits[0]) & _DISTURBED
        near_vertical = status & _NEAR_VERTICAL != 0
        has_plain = math.isfinite(azimuth[i])
        toolface, sigma_north_toolface = magnetic_toolface[i], sigma_magnetic_toolface[i]
        angle, sigma, has_azimuth = 0.0, -1.0, False
        if math.isfinite(carried[i]):
            angle, sigma, has_azimuth = carried[i], sigma_carried[i], True
            if not near_vertical:
                # The scribe line against north hangs on the azimuth, by the same geometry as against the high side.
                if has_plain:
                    toolface += angle - azimuth[i]
                else:
                    side = gravity_toolface[i]
                    toolface = angle + math.atan2(math.sin(side), math.cos(side) * g_t[i, 0])
                toolface = toolface - tau if toolface >= tau else (toolface + tau if toolface < 0.0 else toolface)
                sigma_north_toolface = sigma
        elif sigma_carried[i] == math.inf and has_plain and status & _DISTURBED == 0:
            angle, has_azimuth = azimuth[i], True
            sigma = max(sigma_azimuth[i], last_sigma[0])
        # Of a refused sample: how far the tool may have turned by its stamp.
        has_turn = turned[i] < math.inf
        has_north = (has_azimuth or (has_plain and near_vertical)) and has_turn
        has_high_side = has_gravity and has_turn
        if turned[i] > 0.0:
            sigma_north_toolface = min(math.hypot(sigma_north_toolface, turned[i]), math.pi)
        if has_azimuth:
            status |= np.int64(last_bits[0]) & ~_DISTURBED
        unsure, unsure_level = suspect[i] != 0, suspect[i] & _LEVEL_SENSORS != 0
        if unsure:
            status |= _SUSPECT
        if lost and status & _AIDED == 0:
            has_azimuth = has_north = False
            angle = 0.0
        rejected += status & _REJECTED != 0
        row["stamp_ns"] = stamps[i]
        row["inclination"] = inclination[i] if has_gravity else 0.0
        row["azimuth"] = angle
        row["gravity_toolface"] = gravity_toolface[i] if has_high_side else 0.0
        row["magnetic_toolface"] = toolface if has_north else 0.0
        row["sigma_inclination"] = (math.pi if unsure_level else sigma_inclination[i]) if has_gravity else -1.0
        row["sigma_azimuth"] = (math.pi if near_vertical or unsure else sigma) if has_azimuth else -1.0
        loose = near_vertical or unsure_level
        row["sigma_gravity_toolface"] = (math.pi if loose else sigma_toolface[i]) if has_high_side else -1.0
        row["sigma_magnetic_toolface"] = (math.pi if unsure else sigma_north_toolface) if has_north else -1.0
        row["status"] = status
        row["north"] = north
        known = math.isfinite(g_t[i, 0] + g_t[i, 1] + g_t[i, 2]) and has_turn
        vector = down["gravity"]
        for c in range(3):
            vector[c] = g_t[i, c] if known else 0.0
        down["stamp_ns"] = stamps[i]
        down["sigma"] = (math.pi if unsure_level else sigma_down[i]) if known else -1.0
        down["non_gravity"] = non_gravity[i] if math.isfinite(non_gravity[i]) else 0.0
        down["rotary_speed"] = rotary_speed[i] if math.isfinite(rotary_speed[i]) else 0.0
        down["status"] = status
    return rejected
