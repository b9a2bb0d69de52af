# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run as one linear-Gaussian model on the circle: parallel filters of what the stations share.

Given the azimuth, a station's residual is linear in the shared errors (`field_model`). So each filter, a Gaussian of
the shared errors with one of the priors of `hypotheses`, gives every angle of the circle its evidence N(r - H m; 0,
H P H' + R), for each hypothesis of the station itself. The sum is the station's posterior; the shared errors are
updated with the azimuth marginalised (a Rao-Blackwellised mixture, collapsed to its moments; Murphy, *Machine
Learning*, 18.6), and the filters weigh themselves by their evidence.

Errors that last are never averaged away by repetition: they are states. What was known of the azimuth before, from the
station above, enters what is published, never the states.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.survey.posterior import circle, field_model, hypotheses
from mwd_estimation.survey.posterior.evidence import (
    Evidence,
    fill_evidence,
    gyro_residual,
    gyro_step,
    turned_field,
    wrong_gyro,
)
from mwd_estimation.survey.posterior.field_model import SIZE, Row, Shared, Sigmas
from mwd_estimation.survey.posterior.hypotheses import EXTERNAL_UT, Hypothesis, Priors
from mwd_sensors.core.arrays import Array

# No filter loses more than this share of its prior probability for ever.
_FLOOR = 1e-3
# Points with a smaller share of a filter's evidence do not move its states.
_LEAST = 1e-4
# Variance that leaves an observation out, in its own units squared.
_OUT = 1e8
# Share of a field from outside at one station that is there at the next.
_GOES_ON = 0.5
# What is believed beforehand of the gyro and of fields from outside counts as so many stations.
_BELIEVED = 20.0
# A kind that is more probable than this is counted.
_DECIDED = 0.9
_REFERENCE = slice(Shared.TOTAL, Shared.OUTSIDE)
_OUTSIDE = slice(Shared.OUTSIDE, Shared.OUTSIDE + 3)


@dataclasses.dataclass
class State:
    """What a run has shown so far."""

    #: `mean`, `covariance`: shapes (k, 22) and (k, 22, 22); of the shared errors in nominal sigmas, for each filter.
    mean: Array
    covariance: Array
    log_weight: Array  #: shape (k,)
    hours: float = math.nan  #: of the last station; nan before the first
    #: shape (h,), or None; probabilities of each external field at the last station: steel goes on along the hole.
    outside: Array | None = None
    #: shape (h,); sum of them over all stations.
    of_outside: Array = dataclasses.field(default_factory=lambda: np.zeros(len(EXTERNAL_UT) + 1))
    #: shape (3,); the same of a gyro that is right, whose bias stepped, and that is wrong altogether.
    of_gyro: Array = dataclasses.field(default_factory=lambda: np.zeros(3))


class RunFilter:
    """
    Stations of one tool in one assembly.

    Parameters
    ----------
    priors : Priors
    sigmas : Sigmas
    """

    def __init__(self, priors: Priors, sigmas: Sigmas) -> None:
        self.priors, self.sigma, self._own = priors, sigmas.shared, sigmas.own
        self.filters = hypotheses.filters(priors, self.sigma)
        self._external = hypotheses.external_weights(priors)
        k = len(self.filters.weight)
        covariance = np.zeros((k, SIZE, SIZE))
        covariance[:, range(SIZE), range(SIZE)] = self.filters.variance
        self.state = State(np.zeros((k, SIZE)), covariance, np.log(np.maximum(self.filters.weight, 1e-300)))

    def pass_time(self, hours: float) -> None:
        """Let the field from outside drift up to this time, h."""
        state = self.state
        apart = abs(hours - state.hours) if math.isfinite(hours - state.hours) else 0.0
        keep, at = hypotheses.kept(apart), range(_OUTSIDE.start, _OUTSIDE.stop)
        state.mean[:, _OUTSIDE] *= keep
        state.covariance[:, _OUTSIDE, :] *= keep
        state.covariance[:, :, _OUTSIDE] *= keep
        state.covariance[:, at, at] += (1.0 - keep * keep) * self.filters.variance[:, _OUTSIDE]
        if math.isfinite(hours):
            state.hours = hours

    def observe(self, H: Array, value: Array, covariance: Array) -> None:
        """
        Take in what is measured of the shared errors beside the stations.

        H, shape (n, 22): slopes by the errors in nominal sigmas; value, shape (n,), and its covariance, shape (n, n).
        """
        state = self.state
        for k, (mean, P) in enumerate(zip(state.mean, state.covariance, strict=True)):
            gain = P @ H.T
            S, e = H @ gain + covariance, value - H @ mean
            x = np.linalg.solve(S, e)
            state.log_weight[k] -= 0.5 * (float(e @ x) + float(np.linalg.slogdet(S)[1]))
            state.mean[k] = mean + gain @ x
            state.covariance[k] = P - gain @ np.linalg.solve(S, gain.T)
        weight = np.exp(state.log_weight - state.log_weight.max())
        state.log_weight = self._floored(weight / weight.sum())

    def evidence(self, one: Row, state: State | None = None) -> Evidence:
        """Evidence of a station, a record of `field_model.GEOMETRY`, given what the run has shown (or a state)."""
        state = self.state if state is None else state
        r, S, _ = self._terms(one, state)
        angles = circle.coarse()
        log, _ = self._logs(one, r, S, state, angles)
        top = log.max()
        density = np.log(np.exp(log - top).sum(axis=(1, 2, 3)) + 1e-300)
        angles = circle.refined(density, float(one["gyro"]), float(one["gyro_other"]))
        log, misfit = self._logs(one, r, S, state, angles)
        return Evidence(angles, log, misfit if one["has_field"] else 0.0)

    def learn(self, one: Row, evidence: Evidence) -> None:
        """Take over what a station shows of the shared errors; evidence: as `evidence` of the state as it is."""
        state, share = self.state, evidence.share
        r, S, M = self._terms(one, state)
        of_filter = share.sum(axis=(0, 2, 3))
        for k, weight in enumerate(of_filter):
            if weight > 0.0:
                self._update(k, share[:, k] / weight, one, evidence, (r[k], S[k], M[k]))
        if math.isfinite(one["gyro"]):
            # What is not decided is no experience with the gyro.
            state.of_gyro = state.of_gyro + (share.sum(axis=(0, 1, 2)) > _DECIDED)
        state.outside = share.sum(axis=(0, 1, 3))
        state.of_outside = state.of_outside + state.outside
        state.log_weight = self._floored(of_filter)

    def _floored(self, weight: Array) -> Array:
        """Logarithms of the filters' weights, none of which loses its prior for ever."""
        weight = np.maximum(weight, _FLOOR * self.filters.weight)
        return np.asarray(np.log(weight / weight.sum()))

    def gyro_shares(self, state: State) -> Array:
        """Probabilities that a gyro is right, its bias steps, and it is wrong: with what the run has shown of them."""
        step, wrong = self.priors.gyro_step, self.priors.gyro_outlier
        return _learnt(np.array([1.0 - step - wrong, step, wrong]), state.of_gyro)

    def gyro_doubts(self, state: State) -> tuple[float, float]:
        """Probability that a gyro steps or is wrong, and how much of it comes from what the run has shown."""
        doubted = 1.0 - float(self.gyro_shares(state)[0])
        return doubted, float(state.of_gyro[1:].sum()) / (_BELIEVED + float(state.of_gyro.sum()))

    def probabilities(self, share: Array) -> dict[Hypothesis, float]:
        """Probability of each hypothesis at a station; share: as `Evidence.share`."""
        quiet = share[:, :, 0].sum(axis=(0, 2))
        found = dict.fromkeys(Hypothesis, 0.0)
        for kind, value in zip(self.filters.kinds, quiet, strict=True):
            found[kind] += float(value)
        found[Hypothesis.EXTERNAL] = float(1.0 - quiet.sum())
        return found

    def shared(self) -> tuple[Array, Array]:
        """Mean and covariance of the shared errors in SI units (field uT), over all filters; shapes (22,), (22, 22)."""
        state = self.state
        weight = np.exp(state.log_weight)
        mean = weight @ state.mean
        off = state.mean - mean
        covariance = np.tensordot(weight, state.covariance, axes=1) + (off.T * weight) @ off
        return mean * self.sigma, covariance * np.outer(self.sigma, self.sigma)

    def nominal_sigma(self, one: Row, angle: float) -> float:
        """1 sigma of the azimuth that a sound tool has at this attitude by itself, rad; a record of `GEOMETRY`."""
        if not one["has_field"]:
            return math.pi
        residual, slopes, turns = field_model.expansion(one, self.sigma)
        phi = field_model.basis(np.array(angle))
        H, J = np.tensordot(phi, slopes, axes=1)[:3], np.tensordot(phi, turns, axes=1)[:3]
        own = H[:, _REFERENCE] * self._own
        S = H @ H.T + own @ own.T + J @ one["force_noise"] @ J.T + one["noise"]
        slope = np.tensordot(np.array([0.0, -math.sin(angle), math.cos(angle)]), residual, axes=1)[:3]
        return min(1.0 / math.sqrt(float(slope @ np.linalg.solve(S, slope))), math.pi)

    def _terms(self, one: Row, state: State) -> tuple[Array, Array, Array]:
        """Residual (k, 3, 4), its covariance (k, 3, 3, 4, 4) and P H' (k, 3, 22, 4) as factors of the basis."""
        residual, slopes, turns = field_model.expansion(one, self.sigma)
        M = np.swapaxes(state.covariance @ slopes.reshape(12, SIZE).T, 1, 2).reshape(-1, 3, 4, SIZE)
        S = np.einsum("iax,kjbx->kijab", slopes, M)
        own = slopes[:, :, _REFERENCE] * self._own
        S += np.einsum("iax,jbx->ijab", own, own)
        S += np.einsum("iax,xy,jby->ijab", turns, one["force_noise"], turns)
        S[:, 0, 0, :3, :3] += one["noise"] if one["has_field"] else np.eye(3)
        S[:, 0, 0, 3, 3] += one["gyro_variance"] if math.isfinite(one["gyro"]) else 1.0
        S = 0.5 * (S + np.transpose(S, (0, 2, 1, 4, 3)))
        return residual - np.einsum("iax,kx->kia", slopes, state.mean), S, np.swapaxes(M, 2, 3)

    def _logs(self, one: Row, r: Array, S: Array, state: State, angles: Array) -> tuple[Array, float]:
        """Log evidence with all prior weights, as `Evidence.log`, and the misfit."""
        log = np.empty((len(angles), len(r), len(self._external), 3))
        misfit = np.empty(len(angles))
        gyro = gyro_residual(one, angles)
        sizes = EXTERNAL_UT**2 if one["has_field"] else np.zeros(len(EXTERNAL_UT))
        extra = np.append(sizes, gyro_step(one) ** 2)
        fill_evidence(field_model.basis(angles), gyro, r, np.ascontiguousarray(S), extra, log, misfit)
        log[:, :, -1] = turned_field(angles, log[:, :, 0, 2], gyro, (r[:, 0, 3], S[:, 0, 0, 3, 3], extra[-1]))
        outside = _learnt(self._external, state.of_outside)
        if state.outside is not None:
            outside = (1.0 - _GOES_ON) * outside + _GOES_ON * state.outside
        log += state.log_weight[None, :, None, None] + np.log(np.maximum(outside, 1e-300))[None, None, :, None]
        if math.isfinite(one["gyro"]):
            log += np.log(np.maximum(self.gyro_shares(state), 1e-300))
            log[..., 2] += wrong_gyro(gyro)[:, None, None]
        else:
            log[..., :2] = -math.inf
        return log, float(misfit.min())

    def _update(self, k: int, points: Array, one: Row, evidence: Evidence, terms: tuple[Array, Array, Array]) -> None:
        """Moments of filter k over all points (n, h, 3): where the gyro's bias stepped, of a wider prior."""
        r, S, M = terms
        at = np.argwhere(points > _LEAST * points.max())
        share = points[at[:, 0], at[:, 1], at[:, 2]]
        share = share / share.sum()
        phi = field_model.basis(evidence.angles[at[:, 0]])
        e = phi @ r
        if math.isfinite(one["gyro"]):
            e[:, 3] += gyro_residual(one, evidence.angles)[at[:, 0]]
        s = ((phi[:, :, None] * phi[:, None, :]).reshape(-1, 9) @ S.reshape(9, 16)).reshape(-1, 4, 4)
        stepped = at[:, 2] == 1
        # A field that is turned says nothing of what is shared.
        s[:, range(3), range(3)] += np.append(EXTERNAL_UT**2, _OUT)[at[:, 1]][:, None]
        s[:, 3, 3] += np.array([0.0, gyro_step(one) ** 2, _OUT])[at[:, 2]]
        M = np.transpose(M, (1, 0, 2)).reshape(SIZE, 12)
        P, mean = self.state.covariance[k], self.state.mean[k]
        parts = [_moments(mean, P, M, phi[~stepped], s[~stepped], e[~stepped], share[~stepped])]
        if stepped.any():
            P, M = P.copy(), M.copy()
            P[-1, -1] += (gyro_step(one) / one["gyro_lasting"]) ** 2
            M[-1, 3] += gyro_step(one) ** 2 / one["gyro_lasting"]
            parts.append(_moments(mean, P, M, phi[stepped], s[stepped], e[stepped], share[stepped]))
        mean = sum(weight * of_part for weight, of_part, _ in parts)
        self.state.mean[k] = mean
        self.state.covariance[k] = sum(w * (C + np.outer(m - mean, m - mean)) for w, m, C in parts)


def _learnt(prior: Array, seen: Array) -> Array:
    """Probabilities after stations that were of each kind with probabilities of sum `seen`."""
    shares = prior * _BELIEVED + seen
    return np.asarray(shares / shares.sum())


def _moments(
    mean: Array, P: Array, M: Array, phi: Array, s: Array, e: Array, share: Array
) -> tuple[float, Array, Array]:
    """
    Weight, mean and covariance of the Gaussians of some points.

    mean (22,), P (22, 22): before the station; M (22, 12): P H' as factors of the basis; phi (p, 3), s (p, 4, 4),
    e (p, 4) and share (p,): of each point basis, innovation covariance, innovation and probability.
    """
    weight = float(share.sum())
    if not weight > 0.0:
        return 0.0, mean, P
    share = share / weight
    inverse = np.linalg.inv(s)
    # The gain at each point is M (basis x inverse): its moments are those of 12 numbers.
    y = (phi[:, :, None] * np.einsum("pab,pb->pa", inverse, e)[:, None, :]).reshape(-1, 12)
    both = (phi[:, :, None] * phi[:, None, :]).reshape(-1, 9)
    known = ((both * share[:, None]).T @ inverse.reshape(-1, 16)).reshape(3, 3, 4, 4)
    moved = share @ y
    off = y - moved
    change = (off.T * share) @ off - np.transpose(known, (0, 2, 1, 3)).reshape(12, 12)
    C = P + M @ change @ M.T
    return weight, mean + M @ moved, 0.5 * (C + C.T)
