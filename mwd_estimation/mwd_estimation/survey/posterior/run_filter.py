# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run as one linear-Gaussian model on the circle: parallel filters of the errors that stations share.

Given the azimuth, the residual of a station is linear in the shared errors (`field_model`). Each filter is a Gaussian
of the shared errors that starts with one of the priors of `hypotheses`. At every angle of the circle, and for each
hypothesis of the station, it has the evidence N(r - H m; 0, H P H' + R). The sum over filters and hypotheses is the
posterior of the station. The shared errors are updated with the azimuth marginalised (a Rao-Blackwellised mixture,
collapsed to its moments; Murphy, *Machine Learning*, 18.6), and each filter is weighted by its evidence.

Lasting errors are states, so repeated readings do not average them away. The azimuth propagated from the station above
changes the published result only, never the states.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from mwd_estimation.survey.posterior import circle, field_model, hypotheses
from mwd_estimation.survey.posterior.declination import Declination, azimuth_density
from mwd_estimation.survey.posterior.evidence import (
    OUT,
    CircleEvidence,
    fill_evidence,
    gains,
    gyro_residual,
    gyro_step,
    turned_field,
    wrong_gyro,
)
from mwd_estimation.survey.posterior.field_model import SIZE, Row, Shared, Sigmas
from mwd_estimation.survey.posterior.hypotheses import EXTERNAL_UT, Hypothesis, Priors
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled

# A filter always keeps at least this share of its prior probability, so that later stations can make it probable again.
_FLOOR = 1e-3
# Smallest share that updates the states. A point of the grid of azimuths is left out if its share is less than this
# fraction of the largest share in its filter. A filter for a changed string (`_branched`) is left out if its share is
# less than this fraction of the share of the filter from which it was made.
_LEAST = 1e-4
# A filter with a lower probability on the coarse grid is not evaluated on the fine grid.
_HOPELESS = 1e-6
# Probability that an external field at one station is also present at the next station.
_GOES_ON = 0.5
# Weight of the prior of the gyro and of external fields, as a number of stations.
_BELIEVED = 20.0
# Log weight, relative to the highest one, below which a filter is left out of the evidence of a station.
_IMPOSSIBLE = -50.0
# Log weight of a filter with zero probability.
_NEVER = math.log(1e-300)
# Probability above which a state of the gyro counts as the state at a station. Later stations use these counts.
_DECIDED = 0.9
# Limits of the ratio of two variances of a combination of errors: its variance after the later stations, divided by its
# variance before any station. If the ratio is above the upper limit in every filter, the later stations give no
# information about this combination, and `between` does not use it as an observation.
_KNOWN, _UNKNOWN = 1e-9, 0.99
# Indices of the errors that the string causes; they get new values when the string is changed.
_STRING = [*range(Shared.FIELD_BIAS, Shared.FIELD_BIAS + 3), Shared.FIELD_RATE]
_REFERENCE = slice(Shared.TOTAL, Shared.OUTSIDE)
_OUTSIDE = slice(Shared.OUTSIDE, Shared.OUTSIDE + 3)


@dataclasses.dataclass
class RunState:
    """Shared errors estimated from the run so far."""

    #: `mean`, `covariance`: shapes (k, 23) and (k, 23, 23); of the shared errors in nominal sigmas, for each filter.
    mean: Array
    covariance: Array
    log_weight: Array  #: shape (k,); logarithm of the probability of each filter
    hours: float = math.nan  #: time of the last station, h; nan before the first
    hazard: float = math.nan  #: hazard of a change of the string, summed up to the last station; nan before the first
    age: float = 0.0  #: time from the first seek of the gyro in the run to the last one, h
    drifted: bool = False  #: whether the gyro may have drifted so far
    lasting: float = math.nan  #: 1 sigma of the constant part of the gyro's azimuth error at the last seek, rad
    changed: float = 0.0  #: probability that the string has changed since the last station that updated the states
    #: shape (h,), or None; probability of each external field at the last station, because steel can extend to the
    #: next station.
    outside: Array | None = None
    #: shape (h,); sum of these probabilities over all stations.
    of_outside: Array = dataclasses.field(default_factory=lambda: np.zeros(len(EXTERNAL_UT) + 1))
    #: shape (3,); the same sum for the states of the gyro: right, its bias stepped, wrong.
    of_gyro: Array = dataclasses.field(default_factory=lambda: np.zeros(3))

    def copy(self) -> RunState:
        """Return an independent copy; `pass_time` changes the arrays of the shared errors in place."""
        return dataclasses.replace(
            self, mean=self.mean.copy(), covariance=self.covariance.copy(), log_weight=self.log_weight.copy()
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Predicted(CircleEvidence):
    """Evidence of a station, and the filters that predicted its readings; with both, the filters are updated."""

    branched: RunState  #: the filters, with a second one for each if the string may have changed
    terms: tuple[Array, Array, Array]  #: residual, its covariance and P H' for the filters in use
    gyro: Array  #: shape (n,); residual of the gyro at each angle, rad; 0 without a gyro
    #: shape (h + 1,); variances of the external fields and, last, of a step of the gyro's bias, as for `gains`
    extra: Array
    #: what the filters in use know of the declination error; None if the angles are already azimuths, because the
    #: station has no magnetic field or azimuths are from magnetic north
    declination: Declination | None

    @functools.cached_property
    def _azimuths(self) -> tuple[Array, Array]:
        if self.declination is None:
            return self.angles, self.by_angle
        of_angles, terms = (field_model.basis(self.angles), self.gyro), self.terms[:2]
        whole = azimuth_density(self.angles, self.share, self.adrift, of_angles, terms, self.extra, self.declination)
        # A product is faster than a sum over a short axis.
        azimuths = circle.refined(np.log(circle.highest(whole @ np.ones(3)) + 1e-300))
        found = whole[circle.places(azimuths)] * circle.widths(azimuths)[:, None]
        return azimuths, found / found.sum()

    @property
    def azimuths(self) -> Array:
        """Azimuths from the north of the run, rad, in order, shape (a,)."""
        return self._azimuths[0]

    @property
    def by_azimuth(self) -> Array:
        """Probability of each azimuth and state of the gyro, shape (a, 3); states as in `by_angle`."""
        return self._azimuths[1]


class RunFilter:
    """Parallel filters that estimate the errors common to all stations of one tool in one assembly."""

    def __init__(self, priors: Priors, sigmas: Sigmas) -> None:
        self.priors, self.sigma, self._own = priors, sigmas.shared, sigmas.own
        self.filters = hypotheses.filters(priors, sigmas)
        self._external = hypotheses.external_weights(priors)
        k = len(self.filters.weight)
        covariance = np.zeros((k, SIZE, SIZE))
        covariance[:, range(SIZE), range(SIZE)] = self.filters.variance
        self.state = RunState(np.zeros((k, SIZE)), covariance, np.log(np.maximum(self.filters.weight, 1e-300)))

    def expect_gyro(self) -> None:
        """At the first seek of a gyro, copy each filter; in the copy the azimuth error of the gyro drifts."""
        if not self.filters.adrift.any():
            self.filters = self.filters.with_gyro()

    def _of_filters(self, state: RunState) -> RunState:
        """Return the state with all filters; before the first seek it lacks the filters in which the gyro drifts."""
        if len(state.mean) % len(self.filters.weight) == 0:
            return state
        return dataclasses.replace(
            state,
            mean=np.concatenate([state.mean] * 2),
            covariance=np.concatenate([state.covariance] * 2),
            log_weight=np.concatenate([state.log_weight, np.full(len(state.mean), _NEVER)]),
        )

    def pass_time(self, hours: float, hazard: float = 0.0, gyro: tuple[float, float] | None = None) -> None:
        """
        Predict the state at the time of a station: external field and gyro may drift, and the string may change.

        Parameters
        ----------
        hours : float
            Time of the station, h.
        hazard : float
            Hazard of a change of the string (`hypotheses.hazard`), summed from the start of the run to this station.
        gyro : (float, float), optional
            For a station with a seek: its time since the first seek of the run, h, and 1 sigma of the constant part of
            the gyro's azimuth error, rad.
        """
        state = self.state = self._of_filters(self.state)
        if math.isfinite(state.hazard):
            state.changed += (1.0 - state.changed) * -math.expm1(-abs(hazard - state.hazard))
        state.hazard = hazard
        if abs(hours - state.hours) > 0.0:
            self._change_outside(hours - state.hours)
            self._change_string(hours - state.hours)
        if gyro is not None and gyro[0] != state.age:
            self._drift(*gyro)
        state.lasting = state.lasting if gyro is None else gyro[1]
        if math.isfinite(hours):
            state.hours = hours

    def _change_outside(self, hours: float) -> None:
        """Predict the varying external field `hours` later or earlier: it fades, and other fields take its place."""
        state, keep, at = self.state, hypotheses.kept(abs(hours)), range(_OUTSIDE.start, _OUTSIDE.stop)
        state.mean[:, _OUTSIDE] *= keep
        state.covariance[:, _OUTSIDE, :] *= keep
        state.covariance[:, :, _OUTSIDE] *= keep
        state.covariance[:, at, at] += (1.0 - keep * keep) * self.filters.variance[:, _OUTSIDE]

    def _change_string(self, hours: float) -> None:
        """Predict the string's field `hours` later (earlier if negative) from its rate, which fades meanwhile."""
        mean, covariance, along, rate = self.state.mean, self.state.covariance, Shared.FIELD_BIAS, Shared.FIELD_RATE
        keep = math.exp(-abs(hours) / hypotheses.RATE_HOURS)
        lasting = math.copysign(hypotheses.RATE_HOURS * (1.0 - keep), hours)
        step = lasting * self.sigma[rate] / max(self.sigma[along], 1e-9)
        mean[:, along] += step * mean[:, rate]
        covariance[:, along] += step * covariance[:, rate]
        covariance[:, :, along] += step * covariance[:, :, rate]
        mean[:, rate] *= keep
        covariance[:, rate] *= keep
        covariance[:, :, rate] *= keep
        covariance[:, rate, rate] += (1.0 - keep * keep) * self.filters.variance[:, rate]

    def _drift(self, age: float, lasting: float) -> None:
        """
        Predict the drift of the gyro from the last seek taken to this one, which may be an earlier seek of the run.

        The gyro may begin to drift between the two seeks. The error of a drifting gyro is a constant plus a random walk
        that is zero at the first seek of the run, so that stations may be taken in any order. age: time of this seek
        since the first one of the run, h; lasting: 1 sigma of the constant part of the gyro's azimuth error, rad.
        """
        state, adrift = self.state, self.filters.adrift
        begins = self.priors.gyro_fails if state.drifted else self.priors.gyro_adrift
        weight = np.exp(state.log_weight)
        both = np.stack([weight[~adrift] * begins, weight[adrift]], axis=1)
        means, covariances = (np.stack([of[~adrift], of[adrift]], axis=1) for of in (state.mean, state.covariance))
        mean, covariance = _merged(both, means, covariances)
        weight[adrift], weight[~adrift] = both.sum(axis=1), (1.0 - begins) * weight[~adrift]
        state.log_weight = np.log(np.maximum(weight, 1e-300))
        before, now = (1.0 + hypotheses.drifted(at) / lasting**2 for at in (state.age, age))
        kept = min(before, now) / before
        mean[:, Shared.GYRO] *= kept
        covariance[:, Shared.GYRO] *= kept
        covariance[:, :, Shared.GYRO] *= kept
        covariance[:, Shared.GYRO, Shared.GYRO] += now - kept**2 * before
        state.mean[adrift], state.covariance[adrift] = mean, covariance
        state.age, state.drifted = age, True

    def between(self, later: RunFilter) -> RunState:
        """
        Return the filters at a station, given the stations before it (this model) and after it (`later`).

        Both models are at the time of the station; `later` learned its stations in reverse order. The ratio of a
        Gaussian of `later` to the prior is the likelihood of the shared errors by the later stations (two-filter
        smoother; D. C. Fraser, J. E. Potter, IEEE Trans. Automatic Control 14, 1969). In units of the prior sigmas,
        along the principal axes of the covariance of `later`, this ratio is a set of independent observations; they
        update each filter of this model. If the string may have changed before the station, after it, or both, the
        result has a part of each filter for each of these cases (up to four).
        """
        for one, other in ((self, later), (later, self)):
            if other.filters.adrift.any():
                one.expect_gyro()
            one.state = one._of_filters(one.state)
        variance, prior = self._meet(later)
        first, second = self._branched(self.state), self._branched(later.state)
        count, scale = len(prior), np.sqrt(variance)
        # The nominal sigmas of both models may differ, because each follows from the first reference of its model.
        unit = np.divide(self.sigma, later.sigma, out=np.ones(SIZE), where=later.sigma > 0.0)
        # Treat the later stations as observations of the shared errors: value, variance and derivatives.
        whitened = second.covariance.reshape(-1, count, SIZE, SIZE) / (scale[:, :, None] * scale[:, None, :])
        size, axes = np.linalg.eigh(whitened)
        used = int((size < _UNKNOWN).sum(axis=-1).max())
        size, axes = np.clip(size[..., :used], _KNOWN, _UNKNOWN), np.swapaxes(axes[..., :used], -1, -2)
        value = (axes @ (second.mean.reshape(-1, count, SIZE) / scale)[..., None])[..., 0] / (1.0 - size)
        noise, H = size / (1.0 - size), np.ascontiguousarray(axes * (unit / scale)[:, None, :])
        # Update each filter of this model with the filter of `later` for the same hypothesis, for all pairs of cases.
        cases = len(noise)
        mean = np.repeat(first.mean.reshape(-1, 1, count, SIZE), cases, axis=1)
        covariance = np.repeat(first.covariance.reshape(-1, 1, count, SIZE, SIZE), cases, axis=1)
        log_weight = np.zeros(mean.shape[:3])
        _observe_all(H, value, noise, mean, covariance, log_weight)
        log_weight += 0.5 * (value**2 / (1.0 + noise) + np.log1p(noise)).sum(axis=-1)
        log_weight += first.log_weight.reshape(-1, 1, count) + second.log_weight.reshape(-1, count)
        log_weight -= np.log(np.maximum(prior, 1e-300))
        weight = np.exp(log_weight - log_weight.max()).reshape(-1, count)
        weight /= weight.sum()
        least, whole = _FLOOR * prior, weight.sum(axis=0)
        weight *= np.maximum(1.0, least / np.maximum(whole, 1e-300))
        return dataclasses.replace(
            self.state,
            mean=mean.reshape(-1, SIZE),
            covariance=covariance.reshape(-1, SIZE, SIZE),
            log_weight=np.log(np.where(weight > _HOPELESS * least, weight, 1e-300)).ravel(),
            changed=0.0,
            outside=_between(self.state.outside, later.state.outside),
            of_outside=self.state.of_outside + later.state.of_outside,
            of_gyro=self.state.of_gyro + later.state.of_gyro,
        )

    def _meet(self, later: RunFilter) -> tuple[Array, Array]:
        """
        Predict the gyro errors of this model and of `later` at one time: the time of the last seek in this model.

        Returns the prior variances at this time, shape (k, 23), in squares of the nominal sigmas of `later`, and the
        prior weights of the filters at this time, shape (k,). later: as in `between`.
        """
        variance, prior, adrift = later.filters.variance.copy(), self.filters.weight.copy(), self.filters.adrift
        lasting = self.state.lasting if math.isfinite(self.state.lasting) else later.state.lasting
        # Without a seek that counts, no filter assumes a drift of the gyro yet.
        if adrift.any() and math.isfinite(lasting):
            age = self.state.age
            for one in (self, later):
                if one.state.age != age or not one.state.drifted:
                    one._drift(age, lasting)
            variance[adrift, Shared.GYRO] += hypotheses.drifted(age) / lasting**2
            prior *= np.where(adrift, self.priors.gyro_adrift, 1.0 - self.priors.gyro_adrift)
        return variance, prior / prior.sum()

    def merge(self) -> None:
        """Merge the parts of each filter that `between` returned; `pass_time` and `learn` need one part per filter."""
        state = self.state
        self._join(np.exp(state.log_weight)[:, None], state.mean[:, None], state.covariance[:, None])

    def observe(self, H: Array, value: Array, covariance: Array) -> None:
        """
        Update the shared errors with a measurement other than a station.

        H, shape (n, 23): slopes by the errors in nominal sigmas; value, shape (n,), and its covariance, shape (n, n).
        """
        branched = self._branched(self.state)
        gain = branched.covariance @ H.T
        S, e = H @ gain + covariance, value - branched.mean @ H.T
        x = np.linalg.solve(S, e[..., None])
        log_weight = branched.log_weight - 0.5 * ((e * x[..., 0]).sum(axis=1) + np.linalg.slogdet(S)[1])
        weight = np.exp(log_weight - log_weight.max())
        mean = branched.mean + (gain @ x)[..., 0]
        left = branched.covariance - gain @ np.linalg.solve(S, np.swapaxes(gain, 1, 2))
        self._join((weight / weight.sum())[:, None], mean[:, None], left[:, None])

    def evidence(self, one: Row, state: RunState | None = None) -> Predicted:
        """
        Return the evidence of a station.

        one: a record of `field_model.GEOMETRY`; state: the filters before the station, by default the present ones.
        """
        state = self._branched(self.state if state is None else state)
        at = np.flatnonzero(state.log_weight > state.log_weight.max() + _IMPOSSIBLE)
        terms, prior = self._terms(one, state, at), self._log_prior(state)[at]
        angles = circle.coarse()
        coarse = self._logs(one, terms, state, angles, prior)
        adrift = self.filters.adrift[at % len(self.filters.adrift)]
        first = CircleEvidence(angles, coarse[0], np.arange(len(at)), len(at), adrift)
        density = np.log(first.by_angle.sum(axis=1) + 1e-300)
        # Filters of negligible probability are left out.
        used = np.flatnonzero(first.by_kind.sum(axis=1) >= _HOPELESS)
        r, S, M = (part[used] for part in terms)
        angles, prior = circle.refined(density, float(one["gyro"]), float(one["gyro_other"])), prior[used]
        log, misfit = (np.empty((len(angles), len(used), *whole.shape[2:])) for whole in coarse)
        again = circle.is_coarse(angles)
        fine = self._logs(one, (r, S, M), state, angles[~again], prior)
        for whole, known, new in zip((log, misfit), coarse, fine, strict=True):
            # `take` is faster than an index of the second axis.
            whole[again], whole[~again] = known.take(used, axis=1), new
        self._add_turned(one, (r, S), state, angles, prior, log)
        least = float(misfit.min()) if one["has_field"] else 0.0
        # A field turned about the vertical does not measure the shared errors: its extra variance has no limit.
        return Predicted(
            angles,
            log,
            at[used],
            len(state.mean),
            adrift[used],
            least,
            branched=state,
            terms=(r, S, M),
            gyro=gyro_residual(one, angles) if math.isfinite(one["gyro"]) else np.zeros(len(angles)),
            extra=np.array([*EXTERNAL_UT**2, OUT, gyro_step(one) ** 2]),
            declination=self._declination(one, state, at[used], M),
        )

    def _declination(self, one: Row, state: RunState, at: Indices, M: Array) -> Declination | None:
        """Return the error of the declination at a station in the filters at `at`; M, shape (k, 23, 12): their P H'."""
        index = Shared.DECLINATION
        sigma, own = self.sigma[index], self._own[-1] ** 2
        if not one["has_field"] or not sigma > 0.0:
            return None
        variance, slope = sigma**2 * (state.covariance[at, index, index] + own), sigma * M[:, index].reshape(-1, 3, 4)
        if math.isfinite(one["gyro"]):
            # Only the gyro measures the part of the error that belongs to this station.
            slope[:, 0, 3] += sigma**2 * own
        return Declination(sigma * state.mean[at, index], variance, slope)

    def learn(self, one: Row, evidence: Predicted) -> None:
        """Update the shared errors with a station; evidence: result of `evidence` for the present state."""
        state = self.state = self._of_filters(self.state)
        branched, (r, S, M) = evidence.branched, evidence.terms
        of_branch, at = evidence.by_kind.sum(axis=1), evidence.filters
        # Do not update a filter, or its second version, whose share of the probability of both is negligible.
        both = np.tile(of_branch.reshape(-1, len(state.mean)).sum(axis=0), len(of_branch) // len(state.mean))
        least = np.where(of_branch[at] > _LEAST * both[at], _LEAST * evidence.highest, math.inf)
        has_gyro, step = math.isfinite(one["gyro"]), gyro_step(one)
        # With a gyro, the points where its bias stepped are a second part of each filter.
        k, parts = len(at), 2 if has_gyro else 1
        weight, moved, spread = np.zeros((k, parts)), np.zeros((k, parts, 12)), np.zeros((k, parts, 12, 12))
        of_angles = field_model.basis(evidence.angles), evidence.gyro
        gains(evidence.share, least, of_angles, (r, S), evidence.extra, weight, moved, spread)
        mean, covariance = (np.repeat(whole[:, None], parts, 1) for whole in (branched.mean, branched.covariance))
        M = np.repeat(M[:, None], parts, 1)
        if has_gyro:
            # At points where the gyro's bias stepped, the prior of this bias is wider.
            covariance[:, 1, -1, -1] += (step / one["gyro_lasting"]) ** 2 if one["gyro_lasting"] > 0.0 else 0.0
            M[:, 1, -1, 3] += step**2 / one["gyro_lasting"] if one["gyro_lasting"] > 0.0 else 0.0
        mean[at] += (M @ moved[..., None])[..., 0]
        change = M @ spread @ np.swapaxes(M, 2, 3)
        covariance[at] += 0.5 * (change + np.swapaxes(change, 2, 3))
        split = np.eye(1, parts).repeat(len(of_branch), 0)
        updated = weight.sum(axis=1)
        split[at[updated > 0.0]] = (weight / np.maximum(updated, 1e-300)[:, None])[updated > 0.0]
        self._join(of_branch[:, None] * split, mean, covariance)
        if has_gyro:
            # A station at which no state of the gyro is probable enough is not counted.
            state.of_gyro = state.of_gyro + (evidence.by_angle.sum(axis=0) > _DECIDED)
        state.outside = evidence.by_kind.sum(axis=0)
        state.of_outside = state.of_outside + state.outside

    def _branched(self, state: RunState) -> RunState:
        """
        Return the filters; if the string may have changed since the last station, add a second filter for each.

        In the second filter the field of the string has its prior again, and the other errors keep their estimates. A
        changed string can be of any kind, so the second filters share their weight by the priors of the kinds.
        """
        state = self._of_filters(state)
        if not state.changed > 0.0:
            return state
        weight, prior = np.exp(state.log_weight), self.filters.weight
        mean, covariance, anew = state.mean.copy(), state.covariance.copy(), weight.copy()
        for adrift in np.unique(self.filters.adrift):
            strings = self.filters.of_string(adrift)
            mean[strings], covariance[strings] = _merged(weight[strings], mean[strings], covariance[strings])
            anew[strings] = weight[strings].sum() * prior[strings] / prior[strings].sum()
        mean[:, _STRING] = covariance[:, _STRING, :] = covariance[:, :, _STRING] = 0.0
        covariance[:, _STRING, _STRING] = self.filters.variance[:, _STRING]
        weights = np.concatenate([(1.0 - state.changed) * weight, state.changed * anew])
        return dataclasses.replace(
            state,
            mean=np.concatenate([state.mean, mean]),
            covariance=np.concatenate([state.covariance, covariance]),
            log_weight=np.log(np.maximum(weights, 1e-300)),
        )

    def _join(self, weight: Array, mean: Array, covariance: Array) -> None:
        """
        Merge the parts of each filter, and of its second filter from `_branched` if there is one, into one Gaussian.

        weight (k, p), mean (k, p, 23), covariance (k, p, 23, 23): p parts of each of k filters: the first filters,
        then, if `_branched` added them, the second filters in the same order.
        """
        state, count = self.state, len(self.filters.weight)

        def by_filter(values: Array) -> Array:
            whole = np.swapaxes(values.reshape(-1, count, *values.shape[1:]), 0, 1)
            return whole.reshape(count, -1, *values.shape[2:])

        weight = by_filter(weight)
        state.mean, state.covariance = _merged(weight, by_filter(mean), by_filter(covariance))
        # Every filter keeps at least `_FLOOR` of its prior weight, except the filters in which the gyro drifts: their
        # weights come from `_drift`.
        joined = np.maximum(weight.sum(axis=1), np.where(self.filters.adrift, 0.0, _FLOOR * self.filters.weight))
        state.log_weight, state.changed = np.log(np.maximum(joined / joined.sum(), 1e-300)), 0.0

    def gyro_shares(self, state: RunState) -> Array:
        """Return the probabilities that a gyro is right, has a step of bias, or is wrong, learnt from the run, (3,)."""
        step, wrong = self.priors.gyro_step, self.priors.gyro_outlier
        return _learnt(np.array([1.0 - step - wrong, step, wrong]), state.of_gyro)

    def gyro_doubts(self, state: RunState) -> tuple[float, float]:
        """Return the probability that a gyro steps, drifts or is wrong, and the part of it that the run has shown."""
        adrift = self._adrift(np.exp(self._of_filters(state).log_weight))
        doubted = 1.0 - float(self.gyro_shares(state)[0]) * (1.0 - adrift)
        shown = float(state.of_gyro[1:].sum()) / (_BELIEVED + float(state.of_gyro.sum()))
        # A drift counts as shown by the run only when it is more probable than not.
        return doubted, min(shown + (adrift if adrift > 0.5 else 0.0), doubted)

    def _adrift(self, weight: Array) -> float:
        """Return the probability that the gyro drifts, from the weights of the filters."""
        adrift = weight.reshape(-1, len(self.filters.adrift))[:, self.filters.adrift]
        return float(adrift.sum() / max(float(weight.sum()), 1e-300))

    def probabilities(self, by_kind: Array) -> dict[Hypothesis, float]:
        """Return the probability of each hypothesis at a station; by_kind: `CircleEvidence.by_kind` of the station."""
        quiet = by_kind[:, 0].reshape(-1, len(self.filters.kinds)).sum(axis=0)
        found = dict.fromkeys(Hypothesis, 0.0)
        for kind, value in zip(self.filters.kinds, quiet, strict=True):
            found[kind] += float(value)
        found[Hypothesis.EXTERNAL] = float(1.0 - quiet.sum())
        return found

    def shared(self) -> tuple[Array, Array]:
        """
        Return mean and covariance of the shared errors over all filters, SI with fields in uT; (23,), (23, 23).

        After `between`, only the filters of the most probable case count: string unchanged, or changed on one side of
        the station or on both.
        """
        state, count = self._of_filters(self.state), len(self.filters.weight)
        cases = np.exp(state.log_weight).reshape(-1, count)
        likeliest = int(np.argmax(cases.sum(axis=1)))
        weight, case = cases[likeliest] / cases[likeliest].sum(), slice(likeliest * count, (likeliest + 1) * count)
        mean = weight @ state.mean[case]
        off = state.mean[case] - mean
        covariance = np.tensordot(weight, state.covariance[case], axes=1) + (off.T * weight) @ off
        return mean * self.sigma, covariance * np.outer(self.sigma, self.sigma)

    def nominal_sigma(self, one: Row, angle: float) -> float:
        """
        Return 1 sigma of the azimuth of a healthy tool at this attitude, rad; pi without a field.

        one: a record of `GEOMETRY`; angle: azimuth, rad.
        """
        if not one["has_field"]:
            return math.pi
        residual, slopes, turns = field_model.expansion(one, self.sigma)
        phi = field_model.basis(np.array(angle))
        H, J = np.tensordot(phi, slopes, axes=1)[:3], np.tensordot(phi, turns, axes=1)[:3]
        own = H[:, _REFERENCE] * self._own
        S = H @ H.T + own @ own.T + J @ one["force_noise"] @ J.T + one["noise"]
        slope = np.tensordot(np.array([0.0, -math.sin(angle), math.cos(angle)]), residual, axes=1)[:3]
        variance = 1.0 / float(slope @ np.linalg.solve(S, slope))
        declination = self.sigma[Shared.DECLINATION] ** 2 * (1.0 + self._own[-1] ** 2)
        return min(math.sqrt(variance + declination), math.pi)

    def _terms(self, one: Row, state: RunState, at: Indices) -> tuple[Array, Array, Array]:
        """
        Return residual (k, 3, 4), its covariance (k, 3, 3, 4, 4) and P H' (k, 23, 12) as factors of the basis.

        at: indices of the k filters.
        """
        mean, covariance = state.mean[at], state.covariance[at]
        residual, slopes, turns = field_model.expansion(one, self.sigma)
        H, by_force = slopes.reshape(12, SIZE), turns.reshape(12, 3)
        M, own = covariance @ H.T, H[:, _REFERENCE] * self._own
        S = H @ M + own @ own.T + by_force @ one["force_noise"] @ by_force.T
        S = 0.5 * (S + np.swapaxes(S, 1, 2))
        S[:, :3, :3] += one["noise"] if one["has_field"] else np.eye(3)
        S[:, 3, 3] += one["gyro_variance"] if math.isfinite(one["gyro"]) else 1.0
        S = np.ascontiguousarray(np.swapaxes(S.reshape(-1, 3, 4, 3, 4), 2, 3))
        return residual - (mean @ H.T).reshape(-1, 3, 4), S, M

    def _log_prior(self, state: RunState) -> Array:
        """Return the logarithms of the prior probabilities of each filter and external field, shape (k, h)."""
        outside = _learnt(self._external, state.of_outside)
        if state.outside is not None:
            outside = (1.0 - _GOES_ON) * outside + _GOES_ON * state.outside
        return np.asarray(state.log_weight[:, None] + np.log(np.maximum(outside, 1e-300)))

    def _logs(
        self, one: Row, terms: tuple[Array, Array, Array], state: RunState, angles: Array, prior: Array
    ) -> tuple[Array, Array]:
        """Return the log evidence as in `CircleEvidence.log`, without a turned field, and the misfits, shape (n, k)."""
        r, S, _ = terms
        gyro, states = self._gyro_states(one, state, angles)
        log = np.empty((len(angles), len(r), len(self._external), states.shape[1]))
        misfit = np.empty((len(angles), len(r)))
        sizes = EXTERNAL_UT**2 if one["has_field"] else np.zeros(len(EXTERNAL_UT))
        extra = np.append(sizes, gyro_step(one) ** 2)
        fill_evidence(field_model.basis(angles), gyro, r, S, extra, (prior, states), log, misfit)
        return log, misfit

    def _gyro_states(self, one: Row, state: RunState, angles: Array) -> tuple[Array, Array]:
        """Return the residual of the gyro at each angle, and the log prior of its states, shape (n, j)."""
        gyro = gyro_residual(one, angles)
        if not math.isfinite(one["gyro"]):
            return gyro, np.zeros((len(angles), 1))
        states = np.tile(np.log(np.maximum(self.gyro_shares(state), 1e-300)), (len(angles), 1))
        states[:, 2] += wrong_gyro(gyro)
        return gyro, states

    def _add_turned(
        self, one: Row, terms: tuple[Array, Array], state: RunState, angles: Array, prior: Array, log: Array
    ) -> None:
        """
        Fill the log evidence of a turned field, the last external field of `log`.

        terms: residual and its covariance, as in `_terms`; prior: as from `_log_prior`; all for the filters in use.
        """
        gyro, states = self._gyro_states(one, state, angles)
        r, S = terms
        field = log[:, :, 0, -1] - states[:, -1:] - prior[:, 0] + prior[:, -1]
        log[:, :, -1] = turned_field(angles, field, gyro, states, (r[:, 0, 3], S[:, 0, 0, 3, 3], gyro_step(one) ** 2))


@compiled
def _observe_all(H: Array, value: Array, noise: Array, mean: Array, covariance: Array, log_likelihood: Array) -> None:
    """
    Update Gaussians with independent observations, one after the other (Kalman update).

    H (b, k, n, 23), value and noise (b, k, n): slopes, values and variances of n observations of each filter, in b
    cases. mean (a, b, k, 23) and covariance (a, b, k, 23, 23): changed in place. log_likelihood (a, b, k): the log
    likelihoods of the observations are added, without their constant.
    """
    size = mean.shape[3]
    gain = np.zeros(size)
    for a in range(mean.shape[0]):
        for b in range(mean.shape[1]):
            for k in range(mean.shape[2]):
                x, P = mean[a, b, k], covariance[a, b, k]
                for n in range(value.shape[2]):
                    h, variance, off = H[b, k, n], noise[b, k, n], value[b, k, n]
                    gain[:] = 0.0
                    for i in range(size):
                        for j in range(size):
                            gain[j] += h[i] * P[i, j]
                    for i in range(size):
                        variance += h[i] * gain[i]
                        off -= h[i] * x[i]
                    one = 1.0 / math.sqrt(variance)
                    for i in range(size):
                        gain[i] *= one
                        x[i] += gain[i] * off * one
                    for i in range(size):
                        for j in range(size):
                            P[i, j] -= gain[i] * gain[j]
                    log_likelihood[a, b, k] -= 0.5 * (off * off / variance + math.log(variance))


def _merged(weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """
    Return mean and covariance of mixtures of p parts.

    weight (..., p), mean (..., p, n), covariance (..., p, n, n): the parts; the weights need not have the sum 1.
    """
    whole = weight.sum(axis=-1, keepdims=True)
    share = np.where(whole > 0.0, weight / np.maximum(whole, 1e-300), 1.0 / weight.shape[-1])
    merged = (share[..., None] * mean).sum(axis=-2)
    off = mean - merged[..., None, :]
    scattered = np.swapaxes(share[..., None] * off, -1, -2) @ off
    return merged, (share[..., None, None] * covariance).sum(axis=-3) + scattered


def _between(before: Array | None, after: Array | None) -> Array | None:
    """
    Return the probabilities of the external fields from the neighbouring stations, or None.

    They are the mean of both neighbours, or those of the only neighbour for which they are known. The result is None if
    they are known for neither.
    """
    known = [one for one in (before, after) if one is not None]
    return np.mean(known, axis=0) if known else None


def _learnt(prior: Array, seen: Array) -> Array:
    """Return the prior probabilities updated by stations; seen: sum of the probabilities of each kind over stations."""
    shares = prior * _BELIEVED + seen
    return np.asarray(shares / shares.sum())
