# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run: azimuth of each station, given the earlier stations of the run.

A single station is a run of length one. The model and its priors are in `survey.posterior`. Here readings, references
and gyro solutions are converted to records of the model, and its densities to findings (`finding`) for `verdict`.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.finding import Finding, GyroParts, gyro_share
from mwd_estimation.survey.measurement import Measured
from mwd_estimation.survey.posterior import circle, field_model, hypotheses
from mwd_estimation.survey.posterior.field_model import Row, Shared
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.posterior.run_filter import Predicted, RunFilter, RunState
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.turning_string import Across, Turning
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau

# Share of the variance of the lasting gyro error that is the same from station to station.
_SAME = 0.7
# Smallest 1 sigma of the lasting gyro error, rad; steps of the bias are expressed as multiples of this sigma.
_LEAST_LASTING = 1e-3
# Largest differences of a reference from the first reference of the run, in field, T, and in declination, rad. With a
# larger difference, the reference belongs to another place.
_ELSEWHERE = 1e-6, math.radians(2.0)
# Largest angle between the gravities, and between the fields, of two stations with the same attitude, in tool axes,
# rad.
_STAYED = math.radians(0.5)
# Estimate without information, for a string that has never turned.
_NOTHING = Across(np.zeros(2), math.inf)
_NO_LAY = np.zeros((0, 2, 3))
# Time between two stations if it is unknown, h: the time to drill a stand.
_STAND = 0.5
# Probability of a wrong gyro below which the gyro agrees with the magnetometer.
_AGREES = 0.2


class _Last(NamedTuple):
    """The last station from which the model has learned."""

    row: Row  #: record of the station, with the last gyro azimuth of its seek
    began_ns: int | None  #: stamp at which its seek began, ns; None without a seek
    before: RunState  #: state of the model before this station


class _Read(NamedTuple):
    """Evaluation of a station by the filters of its run."""

    model: RunFilter
    one: Row
    evidence: Predicted
    doubts: tuple[float, float]  #: `RunFilter.gyro_doubts` before the station
    turn: float  #: angle to add to azimuths of the filters to get azimuths from the north of the station, rad
    repeats: int | None
    agreed: bool  #: whether gyro and field had agreed before the station


class Taken(NamedTuple):
    """
    Input of a run for one station.

    Readings with their time in hours from any origin (NaN if unknown), the gyro azimuth, and the estimates of the last
    rotation of the string.
    """

    measured: Measured
    hours: float = math.nan
    gyro: Solution | None = None
    turning: Turning | None = None
    #: Hazard of a change of the string (`hypotheses.hazard`), summed from the start of the run to this station, so
    #: that stations may be added in any order; NaN: the station follows the last one added.
    hazard: float = math.nan
    #: Time since the first seek of the run's gyro, h; NaN: the station follows the last one added.
    age: float = math.nan


def elapsed(before: float, now: float) -> float:
    """Return the time between two consecutive stations, h; `_STAND` if it is unknown."""
    return abs(now - before) if math.isfinite(now - before) else _STAND


class RunModel:
    """Model of the stations of one tool in one assembly, in the order in which they were taken."""

    def __init__(self, settings: StationSettings) -> None:
        self._settings = settings
        self._filter: RunFilter | None = None
        self._of: tuple[Reference | None, bool] = (None, False)
        self._seen: dict[bytes, int] = {}
        # Directions of force and field at each station, shape (n, 2, 3).
        self._lay = _NO_LAY
        self._last: _Last | None = None
        self._count, self._agreed = 0, False
        self._told: dict[str, Across] = {}
        # Time of the last station, h, and cumulative hazard of a change of the string up to it.
        self._reached = math.nan, 0.0
        # Time at which the last station (or its seek) began, h, and time from the first seek to this time, h; None
        # before the first seek.
        self._aged: tuple[float, float] | None = None

    def copy(self) -> RunModel:
        """Return an independent copy."""
        other = copy.copy(self)
        if self._filter is not None:
            other._filter = _copied(self._filter, self._filter.state)
        other._seen, other._told = dict(self._seen), dict(self._told)
        return other

    def take(self, taken: Taken, *, learn: bool = True) -> Finding | None:
        """
        Process a station; return the finding about its azimuth, None if no sensor measures the azimuth.

        learn: whether the model uses this station for later stations.
        """
        read = self._read(taken, learn)
        return None if read is None else self._finding(read)

    def at(self, taken: Taken, turning: Turning | None = None) -> RunModel:
        """
        Return a copy of the model at the time of a station, for the findings of this station only.

        taken: the station, with hazard and age; turning: last estimates of the run from the turning string.
        """
        other, one = self.copy(), self._record_of(taken)
        if one is None:
            return other
        model, last, place = other._model(taken.measured), other._last, other._lay_before(one)
        again = place is not None and place == len(other._lay) - 1
        other._last, other._seen, other._lay = None, {}, _NO_LAY
        if again and last is not None:
            # The tool is still at the last station: the azimuth is found without it.
            without = _copied(model, last.before)
            other._pass_time(without, taken, one)
            other._last, other._lay = _Last(one, None, without.state), _directions(one)[None]
        other._pass_time(model, taken, one)
        if turning is not None:
            other._take_turning(model, turning)
        return other

    def between(self, later: RunModel, taken: Taken) -> RunModel:
        """
        Return the model at a station from the stations before it and after it.

        This model, from `at`, has learned the earlier stations; `later` has learned the later stations, in reverse
        order. taken: the station, with hazard and age.
        """
        other, after = self.copy(), later.at(taken)
        if other._filter is None or after._filter is None:
            return other
        last = other._last or after._last
        if last is not None:
            first, second = (
                _copied(filters, filters.state if side._last is None else side._last.before)
                for side, filters in ((other, other._filter), (after, after._filter))
            )
            other._last, other._lay = last._replace(before=first.between(second)), _directions(last.row)[None]
        other._filter.state = other._filter.between(after._filter)
        other._agreed |= after._agreed
        return other

    def merge(self) -> None:
        """Merge the filters after `between`, before stations at other times are learned or judged with the model."""
        if self._filter is not None:
            self._filter.merge()

    def learn(self, taken: Taken) -> None:
        """Use a station for the later stations, without a finding about its own azimuth."""
        self._read(taken, learn=True)

    def _read(self, taken: Taken, learn: bool) -> _Read | None:
        """
        Return the evidence of a station from the earlier stations; None if no sensor measures the azimuth.

        The time of the model advances to the station. learn: whether the model then learns from the station.
        """
        one = self._record_of(taken)
        if one is None:
            return None
        measured, gyro, turning = taken.measured, taken.gyro, taken.turning
        model = self._model(measured)
        began_ns = None if gyro is None else gyro.began_ns
        place, seek = self._lay_before(one), self._back_in_seek(model, began_ns)
        # If the tool has not moved since the last station, the station gives no information on lasting errors: use the
        # state before the last station.
        again = place is not None and place == len(self._lay) - 1
        if math.isnan(taken.age):
            taken = taken._replace(age=self._age_at(taken.hours, one, goes_on=seek is not None))
        if math.isnan(taken.hazard):
            taken = taken._replace(hazard=self._hazard_at(taken.hours))
        self._pass_time(model, taken, one)
        if turning is not None:
            self._take_turning(model, turning)
        if seek is not None:
            # A seek is one reading of the gyro: replace its last azimuth, so that a seek does not confirm itself.
            self._last = seek = seek._replace(before=model.state.copy())
            _learn(model, _with_gyro(seek.row, None))
        state = self._last.before if again and self._last is not None else model.state
        evidence, doubts = model.evidence(one, state), model.gyro_doubts(state)
        repeats = self._repeats(one) if learn else None
        if learn and repeats is None and place is None:
            self._lay = np.concatenate([self._lay, _directions(one)[None]])
            self._last = _Last(one, began_ns, model.state.copy())
            model.learn(one, evidence)
        if seek is not None and self._last is not None:
            self._learn_last(model, self._last, one if learn and math.isfinite(one["gyro"]) else seek.row)
        agreed = self._agreed
        if learn and one["has_field"] and math.isfinite(one["gyro"]):
            outside = model.probabilities(evidence.by_kind)[Hypothesis.EXTERNAL]
            right = float(evidence.by_angle[:, 0].sum())
            self._agreed |= right > 1.0 - _AGREES and outside < _AGREES
        turn = measured.station.north_correction - measured.declination
        return _Read(model, one, evidence, doubts, turn, repeats, agreed)

    @staticmethod
    def _pass_time(model: RunFilter, taken: Taken, one: Row) -> None:
        """Predict the filters at the time of a station, which has a hazard and an age."""
        gyro = None
        if math.isfinite(one["gyro"]):
            model.expect_gyro()
            gyro = taken.age, float(one["gyro_lasting"])
        model.pass_time(taken.hours, taken.hazard, gyro)

    def _hazard_at(self, hours: float) -> float:
        """
        Return the cumulative hazard of a change of the string at a station, and make the station the last one.

        hours: time of the station, h.
        """
        before, hazard = self._reached
        self._reached = hours, hazard + hypotheses.hazard(self._settings.priors, hours - before)
        return self._reached[1]

    def _age_at(self, hours: float, one: Row, *, goes_on: bool) -> float:
        """
        Return the time from the first seek of the run to a station, h; 0 before the first seek.

        The time is kept for the next station. goes_on: whether the station belongs to the seek of the last station.
        """
        if self._aged is not None and not goes_on:
            self._aged = hours, self._aged[1] + elapsed(self._aged[0], hours)
        elif self._aged is None and math.isfinite(one["gyro"]):
            self._aged = hours, 0.0
        return 0.0 if self._aged is None else self._aged[1]

    def _back_in_seek(self, model: RunFilter, began_ns: int | None) -> _Last | None:
        """
        Restore the state before the last station, if this station belongs to the seek that began at `began_ns`, ns.

        Return the last station in this case, else None.
        """
        if began_ns is None or self._last is None or self._last.began_ns != began_ns:
            return None
        model.state = self._last.before.copy()
        return self._last

    def _learn_last(self, model: RunFilter, last: _Last, reading: Row) -> None:
        """Learn from the last station again, with the last gyro azimuth of its seek from `reading`."""
        self._last = last._replace(row=_with_gyro(last.row, reading))
        model.state = last.before.copy()
        _learn(model, self._last.row)

    def shared(self) -> tuple[Array, Array] | None:
        """Return mean and covariance of the shared errors, as `RunFilter.shared`; None before the first station."""
        return None if self._filter is None else self._filter.shared()

    @staticmethod
    def _record_of(taken: Taken) -> Row | None:
        """Return the record of a station; None if no sensor measures the azimuth."""
        one = taken.measured.row
        if one is not None and taken.gyro is not None and taken.gyro.answers:
            one = _with_solution(one, taken.measured.station, taken.gyro)
        return one if one is not None and (one["has_field"] or math.isfinite(one["gyro"])) else None

    def _model(self, measured: Measured) -> RunFilter:
        """Return the filters of the run; at another place or with another north, start anew with new filters."""
        reference, magnetic = measured.station.reference, measured.station.north == "magnetic"
        if self._filter is None or magnetic != self._of[1] or _elsewhere(reference, self._of[0]):
            known = reference if reference is not None and reference.has_field else None
            sigmas = field_model.nominal_sigmas(self._settings.errors, known, magnetic)
            self._filter, self._of = RunFilter(self._settings.priors, sigmas), (reference, magnetic)
            self._seen, self._lay, self._count, self._agreed, self._told = {}, _NO_LAY, 0, False, {}
            self._last = None
        return self._filter

    def _take_turning(self, model: RunFilter, turning: Turning) -> None:
        """
        Update mount and cross-axial bias from the turning string, once the information has doubled since the last time.

        The errors of mount and bias count as independent, although both contain the axis of rotation in the
        magnetometers.
        """
        sigma, at, bias = model.sigma, Shared.MOUNT, Shared.FIELD_BIAS
        mount, field = np.zeros((2, field_model.SIZE)), np.zeros((2, field_model.SIZE))
        # In accelerometers that are turned by (0, y, z), the axis of rotation is at (1, z, -y).
        mount[0, at + 2], mount[1, at + 1] = sigma[at + 2], -sigma[at + 1]
        field[0, bias + 1], field[1, bias + 2] = sigma[bias + 1], sigma[bias + 2]
        for name, H, now, unit in (
            ("mount", mount, turning.mount, 1.0),
            ("field", field, turning.field, field_model.UT),
        ):
            told = self._told.get(name, _NOTHING)
            before, more = told.sigma**-2, now.sigma**-2 - told.sigma**-2
            if more > before:
                value = (now.sigma**-2 * now.value - before * told.value) / more
                model.observe(H, value / unit, np.eye(2) / (more * unit**2))
                self._told[name] = now

    def _lay_before(self, one: Row) -> int | None:
        """
        Return the index in `_lay` of the last station with the same attitude as `one`; None without such a station.

        The directions of force and field at the two stations differ by less than `_STAYED`.
        """
        apart = np.linalg.norm(self._lay - _directions(one), axis=2)
        near = np.flatnonzero((apart < _STAYED).all(axis=1))
        return int(near[-1]) if len(near) else None

    def _repeats(self, one: Row) -> int | None:
        self._count += 1
        readings = one["force"].tobytes() + one["field"].tobytes()
        first = self._seen.setdefault(readings, self._count)
        return None if first == self._count else first

    @staticmethod
    def _finding(read: _Read) -> Finding:
        model, one, evidence, (doubted, shown), turn, repeats, agreed = read
        right, stepped, wrong = evidence.by_azimuth.T
        width = circle.widths(evidence.azimuths)
        mass, by_gyro, gyro_wrong, parts = right + stepped + wrong, 0.0, 0.0, None
        angles = wrap_tau(evidence.azimuths + turn)
        order = np.argsort(angles)
        if math.isfinite(one["gyro"]):
            parts = GyroParts((right / width)[order], ((stepped + wrong) / width)[order], doubted, shown / doubted)
            mass = np.empty(len(angles))
            mass[order] = parts.weighed(angles[order]) * width[order]
            by_gyro = gyro_share(evidence.azimuths, mass, wrong if one["has_field"] else None) * float(right.sum())
            # A gyro that the run has already shown to be wrong does not count as a contradiction.
            gyro_wrong = float((stepped + wrong).sum()) * (1.0 - doubted)
        mean, covariance = model.shared()
        at, turned = Shared.FIELD_BIAS, slice(Shared.MOUNT, Shared.MOUNT + 3)
        known = bool(one["has_field"])
        axial = (float(mean[at]), math.sqrt(float(covariance[at, at]))) if known else (math.nan, math.nan)
        # The error of the inclination is the turn of the mount about the level axis across the hole.
        right = one["axes"][1]
        mount = math.sqrt(float(right @ covariance[turned, turned] @ right + (right @ mean[turned]) ** 2))
        peak = float(evidence.azimuths[int(np.argmax(mass / width))])
        return Finding(
            angles=angles[order],
            density=(mass / width)[order],
            hypotheses=model.probabilities(evidence.by_kind) if known else {},
            nominal=model.nominal_sigma(one, peak),
            misfit=evidence.misfit,
            by_gyro=by_gyro,
            gyro_wrong=gyro_wrong,
            of_gyro=parts,
            gyro_agreed=agreed,
            axial=(axial[0] * field_model.UT, axial[1] * field_model.UT),
            mount=mount,
            repeats=repeats,
        )


def _copied(model: RunFilter, state: RunState) -> RunFilter:
    """Return filters like those of a model, in a copy of a state."""
    other = copy.copy(model)
    other.state = state.copy()
    return other


def _directions(one: Row) -> Array:
    """Return the unit vectors of force and field in tool axes, shape (2, 3); zeros without a field."""
    both = np.stack([one["force"], one["field"]])
    return np.asarray(both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-9))


def _with_solution(one: Row, station: Station, gyro: Solution) -> Row:
    """Return the record of a station with a gyro azimuth, unless the azimuth has no north in common with the record."""
    reference = station.reference
    found = [angle for angle, _ in gyro.choices] or [gyro.azimuth]
    sigma = max([sigma for _, sigma in gyro.choices] or [gyro.sigma])
    turn, north = 0.0, 0.0
    if station.north == "magnetic":
        if reference is None or reference.declination is None:
            return one
        turn = reference.declination
        north = reference.declination_variance(reference.horizontal) if reference.has_field else 0.0
    noise = min(gyro.limit, sigma) if math.isfinite(gyro.limit) else sigma
    lasting = sigma**2 - noise**2
    one = one.copy()
    one["gyro"], one["gyro_other"] = found[0] - turn, found[-1] - turn
    one["gyro_lasting"] = max(math.sqrt(_SAME * lasting + north), _LEAST_LASTING)
    one["gyro_variance"] = noise**2 + (1.0 - _SAME) * lasting
    return one


def _with_gyro(one: Row, other: Row | None) -> Row:
    """Return the record of a station with the gyro azimuth of `other`, or without a gyro azimuth if `other` is None."""
    row = one.copy()
    for name, value in field_model.NO_GYRO.items():
        row[name] = value if other is None else other[name]
    return row


def _learn(model: RunFilter, one: Row) -> None:
    if one["has_field"] or math.isfinite(one["gyro"]):
        model.learn(one, model.evidence(one))


def _elsewhere(reference: Reference | None, first: Reference | None) -> bool:
    if reference is None or first is None or not (reference.has_field and first.has_field):
        return (reference is None or not reference.has_field) != (first is None or not first.has_field)
    apart = math.hypot(reference.horizontal - first.horizontal, reference.vertical - first.vertical)
    turned = abs(float(wrap_pi((reference.declination or 0.0) - (first.declination or 0.0))))
    return apart > _ELSEWHERE[0] or turned > _ELSEWHERE[1]


def declination_sigma(station: Station) -> float:
    """Return 1 sigma of the declination in azimuths from the station's north, rad; 0 for magnetic north."""
    reference = station.reference
    if reference is None or station.north == "magnetic":
        return 0.0
    return math.sqrt(reference.declination_variance(reference.horizontal if reference.has_field else 1e-5))


def gyro_azimuth(gyro: Solution, station: Station) -> MethodAzimuth:
    """Return the gyro azimuth from the station's north, or the reason why there is none."""
    method, reference = AzimuthMethod.GYRO, station.reference
    if not math.isfinite(gyro.azimuth):
        return MethodAzimuth(method, math.nan, math.nan, gyro.reason)
    turn: float | None = 0.0
    if station.north != "true":
        known = reference or Reference()
        turn = known.convergence if station.north == "grid" else known.declination
    if turn is None:
        return MethodAzimuth(method, math.nan, math.nan, Reason(Code.GYRO_NORTH_UNKNOWN, names=(station.north,)))
    return MethodAzimuth(method, float(wrap_tau(gyro.azimuth - turn)), min(gyro.sigma, math.pi), gyro.reason)
