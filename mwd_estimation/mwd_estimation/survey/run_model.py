# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run: what each says of its azimuth, given all that the run has shown before it.

A single station is a run of length one. The model and its priors are in `survey.posterior`; here readings, references
and gyro solutions become its records, and its densities become findings that `judgement` reads.
"""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.measurement import Measured, Readings
from mwd_estimation.survey.posterior import circle, field_model
from mwd_estimation.survey.posterior.field_model import FieldErrors, Row, Shared
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.posterior.run_filter import Evidence, RunFilter, State
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi, wrap_tau

# Share of the variance of what lasts in a gyro's error that stays the same from station to station.
_SAME = 0.7
# Least 1 sigma of it, rad: steps of the bias are counted in it.
_LEAST_LASTING = 1e-3
# A reference farther from the run's first one belongs to another place: T, rad.
_ELSEWHERE = 1e-6, math.radians(2.0)
# A gyro whose probability of being wrong has risen by more than this factor is contradicted by something.
_CONTRADICTED = 2.0
# Two stations whose gravity and field lie nearer to each other in tool axes than this, rad, are at one attitude.
_STAYED = math.radians(0.5)
# A gyro less probably wrong than this agrees with the magnetometer.
_AGREES = 0.2
# What is known of the azimuth from the station above: half width, rad, and the share that it leaves to all others.
_CONTINUITY, _BROKEN = math.radians(5.0), 0.05
# A gyro with a larger share than this makes the azimuth.
_MOSTLY = 0.5
# Azimuths farther apart than so many sigma, and this angle, rad, contradict each other.
_APART, _NEAR = 3.0, math.radians(1.0)


@dataclasses.dataclass(frozen=True)
class GyroParts:
    """
    Density of an azimuth where a gyro is right, and where its bias stepped or it is wrong.

    Attributes
    ----------
    right, doubted : ndarray, shape (n,)
        Per rad, with their probabilities.
    before, shown : float
        Probability of the second before this station, and the share of it that the run itself has shown.
    """

    right: Array
    doubted: Array
    before: float
    shown: float

    def weighed(self, angles: Array, known: Array | float = 1.0) -> Array:
        """
        Density of both, with an azimuth known from elsewhere (per rad) as evidence of which is true.

        That evidence is in the weights alone: the errors that both azimuths share narrow nothing.
        """
        width = circle.widths(angles)
        of_right, of_doubted = float(width @ self.right), float(width @ self.doubted)
        if not (of_right > 0.0 and of_doubted > 0.0):
            return self.right + self.doubted
        odds = float(width @ (self.doubted * known)) / max(float(width @ (self.right * known)), 1e-300)
        # Where nothing contradicts the gyro, only what the run has shown to go wrong with it has a say.
        if odds <= _CONTRADICTED * self.before * (1.0 + odds):
            odds *= self.shown
        return np.asarray(self.right / of_right + odds * self.doubted / of_doubted)


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    A station's azimuth as a density, and what may disturb it.

    Attributes
    ----------
    angles, density : ndarray, shape (n,)
        From the station's north, rad; per rad, of any size.
    hypotheses : dict of Hypothesis to float
        Probabilities, sum 1; empty without a field.
    nominal : float
        1 sigma of a sound tool by itself at this attitude, rad.
    misfit : float
        Least chi-square of the field under the widest hypothesis.
    by_gyro : float
        Share of the gyro in what is known of the azimuth, 0 to 1.
    gyro_wrong : float
        Probability that the gyro is wrong here.
    of_gyro : GyroParts or None
        What the density is made of where a gyro gave an azimuth here.
    gyro_agreed : bool
        Whether a gyro agreed with the magnetometer at an earlier station of the run.
    broken : tuple of (float, float) or None
        How far this azimuth is from a propagated one that contradicts it: rad, and in sigmas.
    axial : tuple of float
        Field of the string along the axis and 1 sigma, T; nan where nothing is known of it.
    mount : float
        1 sigma of the inclination, rad, by accelerometers that may be turned in their mount.
    repeats : int or None
        Number in the run, from 1, of an earlier station with these very readings.
    stations : int
        In the run, with this one.
    """

    angles: Array
    density: Array
    hypotheses: dict[Hypothesis, float]
    nominal: float
    misfit: float = 0.0
    by_gyro: float = 0.0
    gyro_wrong: float = 0.0
    of_gyro: GyroParts | None = None
    gyro_agreed: bool = False
    broken: tuple[float, float] | None = None
    axial: tuple[float, float] = (math.nan, math.nan)
    mount: float = 0.0
    repeats: int | None = None
    stations: int = 1

    @property
    def circle(self) -> circle.Circle:
        """The density as people read it."""
        return circle.read(self.angles, self.density)

    def beyond(self, width: float, alignment: float) -> float:
        """Probability that the azimuth is farther from the published one than this, rad; 1 sigma of alignment, rad."""
        return circle.beyond(self.angles, self.density, self.circle.mean, width, alignment)

    def continued(self, azimuth: float, sigma: float, shared: float = 0.0) -> Finding:
        """
        With what the station above and the gyros since say of the azimuth: it chooses between modes, or contradicts.

        azimuth, sigma : from the same north, rad; shared : variance that both azimuths have in common, rad^2.
        """
        density = self.density
        if self.of_gyro is not None:
            if not self.gyro_agreed:
                # The station above may lie in the same field: it is no judge between this gyro and the magnetometer.
                return self
            density = self.of_gyro.weighed(self.angles, _known(self.angles, azimuth, sigma))
        density = density * _known(self.angles, azimuth, math.hypot(_CONTINUITY, sigma))
        found = circle.read(self.angles, density)
        off = float(wrap_pi(found.mean - azimuth))
        apart = abs(off) / math.sqrt(max(sigma**2 + found.sigma**2 - 2.0 * shared, 1e-4 * sigma**2))
        # Where the gyro found north here, it is the station above that was wrong, unless a gyro has borne that out.
        trusted = self.by_gyro < _MOSTLY or self.gyro_agreed
        broken = (off, apart) if apart > _APART and abs(off) > _NEAR and trusted else None
        # Where an earlier gyro azimuth bore the magnetometer out, two that agree show which of the three is wrong.
        wrong = self.gyro_wrong if broken else 0.0
        return dataclasses.replace(self, density=density, broken=broken, gyro_wrong=wrong)


def _known(angles: Array, azimuth: float, sigma: float) -> Array:
    """Density of an azimuth known to a sigma, rad, with what it leaves to all others."""
    near = np.exp(-0.5 * (wrap_pi(angles - azimuth) / sigma) ** 2) / (sigma * math.sqrt(math.tau))
    return np.asarray((1.0 - _BROKEN) * near + _BROKEN / math.tau)


class RunModel:
    """
    Stations of one tool in one assembly, in the order they were taken.

    Parameters
    ----------
    settings : StationSettings
    """

    def __init__(self, settings: StationSettings) -> None:
        self._settings, self._errors = settings, FieldErrors()
        self._filter: RunFilter | None = None
        self._of: tuple[Reference | None, bool] = (None, False)
        self._seen: dict[bytes, int] = {}
        self._lay: list[tuple[Array, Array]] = []
        self._before: State | None = None
        self._count, self._agreed = 0, False

    def take(
        self, measured: Measured, hours: float = math.nan, gyro: Solution | None = None, *, learn: bool = True
    ) -> Finding | None:
        """
        Take a station in.

        Parameters
        ----------
        measured : Measured
        hours : float
            When, h from anywhere; nan: not known.
        gyro : Solution or None
        learn : bool
            Whether the station counts for those after it.

        Returns
        -------
        Finding or None
            None where nothing says anything of the azimuth.
        """
        readings, station = measured.readings, measured.station
        if readings is None:
            return None
        one = self._record(readings, measured, gyro)
        if not (one["has_field"] or math.isfinite(one["gyro"])):
            return None
        model = self._model(measured)
        model.pass_time(hours)
        place = self._lay_before(one)
        # Measured again at rest: what the tool showed here a moment ago is nothing new of its lasting errors.
        again = place is not None and place == len(self._lay) - 1
        state = self._before if again and self._before is not None else model.state
        evidence, doubts = model.evidence(one, state), model.gyro_doubts(state)
        repeats = self._repeats(one) if learn else None
        if learn and repeats is None and place is None:
            self._lay.append(_directions(one))
            self._before = copy.deepcopy(model.state)
            model.learn(one, evidence)
        turn = _turn(station.north_correction, self._north(measured))
        found = self._finding(model, one, evidence, doubts, turn, repeats)
        outside = found.hypotheses.get(Hypothesis.EXTERNAL, 1.0)
        self._agreed |= learn and found.of_gyro is not None and found.gyro_wrong < _AGREES and outside < _AGREES
        return found

    def shared(self) -> tuple[Array, Array] | None:
        """Mean and covariance of the shared errors, as `RunFilter.shared`; None before the first station."""
        return None if self._filter is None else self._filter.shared()

    def _north(self, measured: Measured) -> float:
        """Declination from the north of the model: true, or magnetic where the station's is."""
        reference = measured.station.reference
        if measured.station.north == "magnetic" or reference is None or reference.declination is None:
            return 0.0
        return reference.declination

    def _record(self, readings: Readings, measured: Measured, gyro: Solution | None) -> Row:
        station, reference = measured.station, measured.station.reference
        b_h = readings.b_h if readings.has_field else np.full(3, math.nan)
        declination = self._north(measured)
        row = field_model.geometry(readings.f_h, b_h, readings.noise, reference, declination, self._errors)
        one = row[0]
        if gyro is None or not (gyro.success or gyro.choices):
            return one
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
        one["gyro"], one["gyro_other"] = found[0] - turn, found[-1] - turn
        one["gyro_lasting"] = max(math.sqrt(_SAME * lasting + north), _LEAST_LASTING)
        one["gyro_variance"] = noise**2 + (1.0 - _SAME) * lasting
        return one

    def _model(self, measured: Measured) -> RunFilter:
        """The filters of the run; new ones at another place or with another north."""
        reference, magnetic = measured.station.reference, measured.station.north == "magnetic"
        if self._filter is None or magnetic != self._of[1] or _elsewhere(reference, self._of[0]):
            known = reference if reference is not None and reference.has_field else None
            sigmas = field_model.nominal_sigmas(self._settings.errors, known, self._errors, magnetic)
            self._filter, self._of = RunFilter(self._settings.priors, sigmas), (reference, magnetic)
            self._seen, self._lay, self._count, self._agreed = {}, [], 0, False
        return self._filter

    def _lay_before(self, one: Row) -> int | None:
        """Latest station at which the tool lay alike: what errs there errs again, and shows nothing new."""
        now = _directions(one)
        for place in reversed(range(len(self._lay))):
            if all(float(np.linalg.norm(a - b)) < _STAYED for a, b in zip(now, self._lay[place], strict=True)):
                return place
        return None

    def _repeats(self, one: Row) -> int | None:
        self._count += 1
        readings = one["force"].tobytes() + one["field"].tobytes()
        first = self._seen.setdefault(readings, self._count)
        return None if first == self._count else first

    def _finding(
        self,
        model: RunFilter,
        one: Row,
        evidence: Evidence,
        doubts: tuple[float, float],
        turn: float,
        repeats: int | None,
    ) -> Finding:
        share, (doubted, shown) = evidence.share, doubts
        whole = share.sum(axis=(1, 2))
        right, stepped, wrong = whole.T
        width = circle.widths(evidence.angles)
        mass, by_gyro, gyro_wrong, parts = right + stepped + wrong, 0.0, 0.0, None
        angles = wrap_tau(evidence.angles + turn)
        order = np.argsort(angles)
        if math.isfinite(one["gyro"]):
            parts = GyroParts((right / width)[order], ((stepped + wrong) / width)[order], doubted, shown / doubted)
            mass = np.empty(len(angles))
            mass[order] = parts.weighed(angles[order]) * width[order]
            by_gyro = _gyro_share(evidence.angles, mass, wrong if one["has_field"] else None) * float(right.sum())
            gyro_wrong = float((stepped + wrong).sum())
        mean, covariance = model.shared()
        at, turned = int(Shared.FIELD_BIAS), slice(int(Shared.MOUNT), int(Shared.MOUNT) + 3)
        known = bool(one["has_field"])
        axial = (float(mean[at]), math.sqrt(float(covariance[at, at]))) if known else (math.nan, math.nan)
        # The inclination errs by the turn about the level axis across the hole.
        right = one["axes"][1]
        mount = math.sqrt(float(right @ covariance[turned, turned] @ right + (right @ mean[turned]) ** 2))
        peak = float(evidence.angles[int(np.argmax(mass / width))])
        return Finding(
            angles=angles[order],
            density=(mass / width)[order],
            hypotheses=model.probabilities(share) if known else {},
            nominal=model.nominal_sigma(one, peak),
            misfit=evidence.misfit,
            by_gyro=by_gyro,
            gyro_wrong=gyro_wrong,
            of_gyro=parts,
            gyro_agreed=self._agreed,
            axial=(axial[0] * field_model.UT, axial[1] * field_model.UT),
            mount=mount,
            repeats=repeats,
            stations=max(self._count, 1),
        )


def _directions(one: Row) -> tuple[Array, Array]:
    """Unit vectors of force and field in tool axes."""
    return one["force"] / np.linalg.norm(one["force"]), one["field"] / max(float(np.linalg.norm(one["field"])), 1e-9)


def _gyro_share(angles: Array, mass: Array, magnetic: Array | None) -> float:
    """Share of the gyro in what all together and the magnetometer alone (None: no reading) say of the azimuth."""
    if magnetic is None:
        return 1.0
    width = circle.widths(angles)
    whole, alone = circle.read(angles, mass / width), circle.read(angles, magnetic / width)
    if abs(float(wrap_pi(whole.mean - alone.mean))) > _APART * math.hypot(whole.sigma, alone.sigma):
        return 1.0
    return min(max(1.0 - (whole.sigma / alone.sigma) ** 2, 0.0), 1.0)


def _turn(correction: float, declination: float) -> float:
    """What to add to the model's azimuth for one from the station's north, rad."""
    return correction - declination


def _elsewhere(reference: Reference | None, first: Reference | None) -> bool:
    if reference is None or first is None or not (reference.has_field and first.has_field):
        return (reference is None or not reference.has_field) != (first is None or not first.has_field)
    apart = math.hypot(reference.horizontal - first.horizontal, reference.vertical - first.vertical)
    turned = abs(float(wrap_pi((reference.declination or 0.0) - (first.declination or 0.0))))
    return apart > _ELSEWHERE[0] or turned > _ELSEWHERE[1]


def declination_sigma(station: Station) -> float:
    """1 sigma of the declination in azimuths from the station's north, rad."""
    reference = station.reference
    if reference is None or station.north == "magnetic":
        return 0.0
    return math.sqrt(reference.declination_variance(reference.horizontal if reference.has_field else 1e-5))


def gyro_azimuth(gyro: Solution, station: Station) -> MethodAzimuth:
    """The gyro's azimuth from the station's north, for comparison, or why there is none."""
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
