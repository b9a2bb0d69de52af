# SPDX-License-Identifier: Apache-2.0
"""
Likelihood of one station's readings at every azimuth, for each filter of the run and each hypothesis of the station.

The likelihood of the field is N(r - H m; 0, H P H' + R). It is multiplied by the likelihood of the gyro residual, given
the field residual. For a field turned about the vertical, the likelihood of the field is smeared over the azimuth.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from mwd_estimation.survey.posterior import circle
from mwd_estimation.survey.posterior.field_model import Row
from mwd_estimation.survey.posterior.hypotheses import TURNED
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.frames import wrap_pi

# 1 sigma of the azimuth error from a step of the gyro's bias: the first value, rad, plus the second value times 1 sigma
# of the gyro azimuth.
_STEP = math.radians(1.75), 0.75
# A wrong gyro azimuth has errors of any size (wrapped Cauchy; Mardia and Jupp, Directional Statistics, section 3.5.7):
# half of them are larger than this, rad.
_WRONG = math.radians(10.0)
# Greatest amount that a gyro azimuth can add to a log density: the peak for a sigma of 1e-3 rad.
_SHARP = 6.0
# A point whose log density is farther than this below the highest has a share below floating-point resolution (1e-16).
_NOTHING = 37.0
# Variance so large that an observation with it has no influence, in the squared unit of the observation.
OUT = 1e8
# Number of angles that suffice for a density smeared by `TURNED`, and the smearing kernel at every step of the circle.
_FEW = 72
_SMEAR = np.exp(-0.5 * (wrap_pi(np.arange(circle.STEPS) * math.tau / circle.STEPS) / TURNED) ** 2)
_SMEAR /= TURNED * math.sqrt(math.tau)


@dataclasses.dataclass(frozen=True)
class CircleEvidence:
    """A station's evidence on the circle."""

    angles: Array  #: shape (n,); rad, in order
    #: shape (n, m, h, j); log density of the readings with all prior weights, by angle, filter in use, external field,
    #: and state of the gyro: right (0), its bias stepped (1), or wrong (2). Filters of negligible probability are left
    #: out. Without a gyro, j is 1.
    log: Array
    filters: Indices  #: shape (m,); indices of the filters in use among all
    count: int  #: number of all filters, k
    misfit: float = 0.0  #: smallest chi-square of the field under the widest hypothesis

    @functools.cached_property
    def _probable(self) -> tuple[Array, Array, Array, Array, Array]:
        """Return `share`, `by_angle`, `by_kind`, `with_gyro` and `highest`, which are computed together."""
        n, m, h, _ = self.log.shape
        share, found = np.empty_like(self.log), (np.zeros((n, 3)), np.zeros((m, h)), np.zeros((n, m)), np.zeros(m))
        _probabilities(self.log, circle.widths(self.angles), share, *found)
        by_kind = np.zeros((self.count, h))
        by_kind[self.filters] = found[1]
        return share, found[0], by_kind, found[2], found[3]

    @property
    def share(self) -> Array:
        """Probability of each point, shape of `log`."""
        return self._probable[0]

    @property
    def by_angle(self) -> Array:
        """Probability of each angle and state of the gyro, shape (n, 3); without a gyro, only "wrong" is not zero."""
        return self._probable[1]

    @property
    def by_kind(self) -> Array:
        """Probability of each filter and external field, shape (k, h)."""
        return self._probable[2]

    @property
    def with_gyro(self) -> Array:
        """Probability of each angle and filter in use with a gyro that is right, shape (n, m)."""
        return self._probable[3]

    @property
    def highest(self) -> Array:
        """Probability of the most probable point of each filter in use, shape (m,)."""
        return self._probable[4]


@compiled
def _probabilities(
    log: Array, width: Array, share: Array, by_angle: Array, by_kind: Array, with_gyro: Array, highest: Array
) -> None:
    """
    Fill the probabilities of `CircleEvidence` from a log density up to a constant and the width of each angle.

    All outputs except share must be zero before the call.
    """
    top, whole, first = log.max(), 0.0, 3 - log.shape[3]
    for n in range(log.shape[0]):
        for k in range(log.shape[1]):
            for h in range(log.shape[2]):
                for j in range(log.shape[3]):
                    below, value = log[n, k, h, j] - top, 0.0
                    if below > -_NOTHING:
                        value = math.exp(below) * width[n]
                        by_angle[n, first + j] += value
                        by_kind[k, h] += value
                        whole += value
                        highest[k] = max(highest[k], value)
                    share[n, k, h, j] = value
            if first == 0:
                for h in range(log.shape[2]):
                    with_gyro[n, k] += share[n, k, h, 0]
    share /= whole
    by_angle /= whole
    by_kind /= whole
    with_gyro /= whole
    highest /= whole


@compiled
def _spread(phi: Array, S: Array, out: Array) -> None:
    """Compute the innovation covariance at an angle: phi, shape (3,); S, shape (3, 3, 4, 4); out, shape (4, 4)."""
    for a in range(4):
        for b in range(a + 1):
            value = 0.0
            for i in range(3):
                for j in range(3):
                    value += phi[i] * phi[j] * S[i, j, a, b]
            out[a, b] = out[b, a] = value


@compiled
def fill_evidence(
    phi: Array,
    gyro: Array,
    r: Array,
    S: Array,
    extra: Array,
    weights: tuple[Array, Array],
    log: Array,
    misfit: Array,
) -> None:
    """
    Fill the log evidence of every angle, filter and hypothesis, except the last hypothesis (a turned field).

    phi (n, 3), gyro (n,) : basis and gyro residual of each angle. r (k, 3, 4), S (k, 3, 3, 4, 4) : residual and its
    covariance as factors of the basis. extra (h + 1,) : variance of each external field (`EXTERNAL_UT`), uT^2, and last
    that of a step of the gyro, rad^2. weights : logarithms of the prior of filter and field (k, h + 1), and of the
    gyro's state (n, j). The function fills log (n, k, h + 1, j), as in `CircleEvidence.log`, and misfit (n, k).
    """
    prior, states = weights
    s, e, x = np.zeros((4, 4)), np.zeros(4), np.zeros(3)
    # Highest log density so far. A gyro azimuth makes a density at most `_SHARP` higher than the field alone.
    best = -math.inf
    log[:] = -math.inf
    wrong = log.shape[3] - 1
    for n in range(len(phi)):
        for k in range(len(r)):
            misfit[n, k] = 1e300
            _spread(phi[n], S[k], s)
            for a in range(4):
                e[a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
            # An external field can only increase the determinant of the innovation covariance.
            least = 0.0
            for h in range(len(extra) - 1):
                a, b, c = s[0, 0] + extra[h], s[1, 1] + extra[h], s[2, 2] + extra[h]
                d, f, g = s[0, 1], s[0, 2], s[1, 2]
                i00, i01, i02 = b * c - g * g, f * g - d * c, d * g - f * b
                i11, i12, i22 = a * c - f * f, d * f - a * g, a * b - d * d
                det = a * i00 + d * i01 + f * i02
                x[0] = (i00 * e[0] + i01 * e[1] + i02 * e[2]) / det
                x[1] = (i01 * e[0] + i11 * e[1] + i12 * e[2]) / det
                x[2] = (i02 * e[0] + i12 * e[1] + i22 * e[2]) / det
                chi = x[0] * e[0] + x[1] * e[1] + x[2] * e[2]
                misfit[n, k] = min(misfit[n, k], chi)
                value = prior[k, h] - 0.5 * chi
                if h > 0 and value - least < best - _SHARP - _NOTHING:
                    continue
                half = 0.5 * math.log(det)
                if h == 0:
                    least = half
                value -= half
                if value < best - _SHARP - _NOTHING:
                    continue
                log[n, k, h, wrong] = value + states[n, wrong]
                best = max(best, log[n, k, h, wrong])
                if wrong > 0:
                    u, v, w = s[0, 3], s[1, 3], s[2, 3]
                    off = gyro[n] + e[3] - (u * x[0] + v * x[1] + w * x[2])
                    known = u * (i00 * u + i01 * v + i02 * w)
                    known += v * (i01 * u + i11 * v + i12 * w) + w * (i02 * u + i12 * v + i22 * w)
                    variance = max(s[3, 3] - known / det, 1e-12)
                    for j in range(2):
                        wide = variance + j * extra[-1]
                        of_gyro = states[n, j] - 0.5 * (off * off / wide + math.log(wide * 6.283185307179586))
                        log[n, k, h, j] = value + of_gyro
                        best = max(best, log[n, k, h, j])


@compiled
def gains(
    share: Array,
    least: Array,
    circle_of: tuple[Array, Array],
    terms: tuple[Array, Array],
    extra: Array,
    weight: Array,
    mean: Array,
    spread: Array,
) -> None:
    """
    Fill the moments of the gains of every filter, M (basis x inverse innovation), over its probable points.

    Inputs: share (n, k, h, j) as in `CircleEvidence.share`; least (k,), smallest share of a point that is used;
    circle_of, basis (n, 3) and gyro residual (n,) of each angle; terms, r (k, 3, 4) and S (k, 3, 3, 4, 4) as in
    `fill_evidence`; extra (h + 1,), variances of each external field, uT^2, and of a step of the gyro, rad^2.

    Outputs, which must be zero before: weight (k, 2); mean (k, 2, 12) of basis x inverse innovation; spread
    (k, 2, 12, 12), the covariance of basis x inverse innovation minus the mean inverse. Index 0 of the second axis is
    for points at which the gyro's bias did not step, index 1 for points at which it did.
    """
    phi, gyro = circle_of
    r, S = terms
    s, i, x = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((2, 4))
    whole, first, second = np.zeros(2), np.zeros((2, 4)), np.zeros((2, 4, 4))
    for n in range(len(phi)):
        for k in range(len(r)):
            if not share[n, k].max() > least[k]:
                continue
            _spread(phi[n], S[k], s)
            for a in range(4):
                x[0, a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
            x[0, 3] += gyro[n]
            _gains_at(share[n, k], least[k], extra, (s, i, x), (whole, first, second))
            for c in range(2):
                if not whole[c] > 0.0:
                    continue
                weight[k, c] += whole[c]
                _add_angle(phi[n], first[c], second[c], mean[k, c], spread[k, c])
    for k in range(len(r)):
        for c in range(2):
            if weight[k, c] > 0.0:
                mean[k, c] /= weight[k, c]
                spread[k, c] /= weight[k, c]
                for a in range(12):
                    for b in range(12):
                        spread[k, c, a, b] -= mean[k, c, a] * mean[k, c, b]


@compiled
def _gains_at(
    share: Array, least: float, extra: Array, work: tuple[Array, Array, Array], sums: tuple[Array, Array, Array]
) -> None:
    """
    Fill `sums`: weight (2,), first (2, 4) and second (2, 4, 4) moments of a filter's inverse innovations at an angle.

    share (h, j): shares of the points; least and extra: as in `gains`; work: innovation covariance (4, 4), space for
    its inverse (4, 4), and the innovation in the first row of (2, 4).
    """
    s, i, x = work
    whole, first, second = sums
    whole[:], first[:], second[:] = 0.0, 0.0, 0.0
    wrong = share.shape[1] - 1
    for h in range(share.shape[0]):
        for j in range(wrong + 1):
            value = share[h, j]
            if value <= least:
                continue
            c = 1 if j == 1 else 0
            _inverse(s, extra[h], extra[-1] if j == 1 else (OUT if j == wrong else 0.0), i)
            whole[c] += value
            for a in range(4):
                x[1, a] = i[a, 0] * x[0, 0] + i[a, 1] * x[0, 1] + i[a, 2] * x[0, 2] + i[a, 3] * x[0, 3]
                first[c, a] += value * x[1, a]
            for a in range(4):
                for b in range(4):
                    second[c, a, b] += value * (x[1, a] * x[1, b] - i[a, b])


@compiled
def _add_angle(phi: Array, first: Array, second: Array, mean: Array, spread: Array) -> None:
    """
    Add the weighted moments of the inverse innovation at one angle to the sums over all angles, in place.

    phi (3,): basis at the angle; first (4,), second (4, 4): moments at the angle; mean (12,), spread (12, 12): sums of
    the products of basis and inverse innovation.
    """
    for m in range(3):
        for a in range(4):
            mean[4 * m + a] += phi[m] * first[a]
        for q in range(3):
            both = phi[m] * phi[q]
            for a in range(4):
                for b in range(4):
                    spread[4 * m + a, 4 * q + b] += both * second[a, b]


@compiled
def _inverse(s: Array, field: float, gyro: float, out: Array) -> None:
    """Invert s, shape (4, 4), after adding `field` to its first three diagonal elements and `gyro` to the last."""
    a, b, c = s[0, 0] + field, s[1, 1] + field, s[2, 2] + field
    d, f, g = s[0, 1], s[0, 2], s[1, 2]
    out[0, 0], out[0, 1], out[0, 2] = b * c - g * g, f * g - d * c, d * g - f * b
    out[1, 1], out[1, 2], out[2, 2] = a * c - f * f, d * f - a * g, a * b - d * d
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    det = a * out[0, 0] + d * out[0, 1] + f * out[0, 2]
    for m in range(3):
        for q in range(3):
            out[m, q] /= det
    # Schur complement of the field's block.
    rest = s[3, 3] + gyro
    for m in range(3):
        out[m, 3] = out[m, 0] * s[0, 3] + out[m, 1] * s[1, 3] + out[m, 2] * s[2, 3]
        rest -= s[m, 3] * out[m, 3]
    out[3, 3] = 1.0 / rest
    for m in range(3):
        for q in range(3):
            out[m, q] += out[m, 3] * out[q, 3] / rest
    for m in range(3):
        out[m, 3] = out[3, m] = -out[m, 3] / rest


def gyro_residual(one: Row, angles: Array) -> Array:
    """Return the gyro azimuth minus each angle, rad; of two azimuths that fit the gyro equally, the nearer is used."""
    first, other = wrap_pi(one["gyro"] - angles), wrap_pi(one["gyro_other"] - angles)
    return np.where(np.abs(other) < np.abs(first), other, first)


def gyro_step(one: Row) -> float:
    """Return 1 sigma of the azimuth error that a step of the gyro's bias adds, rad."""
    return _STEP[0] + _STEP[1] * math.hypot(one["gyro_lasting"], math.sqrt(one["gyro_variance"]))


def wrong_gyro(residual: Array) -> Array:
    """Return the log density, per rad, of the residual, rad, of a wrong gyro azimuth; see `gyro_residual`."""
    rho = math.exp(-_WRONG)
    return np.log((1.0 - rho * rho) / math.tau / (1.0 + rho * rho - 2.0 * rho * np.cos(residual)))


def turned_field(angles: Array, log: Array, gyro: Array, states: Array, own: tuple[Array, Array, float]) -> Array:
    """
    Return the log evidence of a field turned about the vertical, for n azimuths, k filters and j states of the gyro.

    The evidence of the field is smeared over the azimuth with 1 sigma `TURNED`, and multiplied by the evidence of the
    gyro. Returns shape (n, k, j). The states of the gyro are: no step of its bias, a step, and a wrong
    azimuth.

    angles: azimuths, rad, shape (n,); log: log evidence of the field without the turn, shape (n, k); gyro: residual of
    the gyro, rad, shape (n,), see `gyro_residual`; states: log weights of the states, shape (n, j); own: mean, rad, and
    variance, rad^2, of the gyro error in each filter, shape (k,), and the variance that a step adds, rad^2.
    """
    place, apart = circle.places(angles), circle.STEPS // _FEW
    smear = _SMEAR[(apart * np.arange(_FEW)[:, None] - place) % circle.STEPS] * circle.widths(angles)
    top = log.max(axis=0)
    top = np.where(np.isfinite(top), top, 0.0)
    # Subnormal numbers would make the product many times slower.
    few = np.log(smear @ np.exp(np.maximum(log - top, -300.0)) + 1e-300) + top
    before, share = place // apart, (place % apart / apart)[:, None]
    smeared = (1.0 - share) * few[before] + share * few[(before + 1) % _FEW]
    found = smeared[:, :, None] + states[:, None, :]
    for j in range(states.shape[1] - 1):
        variance = own[1] + j * own[2]
        off = gyro[:, None] + own[0]
        found[:, :, j] -= 0.5 * (off**2 / variance + np.log(math.tau * variance))
    return np.asarray(found)
