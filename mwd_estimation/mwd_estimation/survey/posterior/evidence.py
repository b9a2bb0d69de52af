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
from numpy.typing import NDArray

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
# A density that is smoothed with a sigma of `TURNED` is known well enough at this number of angles. `_SMEAR`, shape
# (circle.STEPS, _FEW): weights of the smoothing from every step of the circle to these angles.
_FEW = 72
_ONE = np.exp(-0.5 * (wrap_pi(np.arange(circle.STEPS) * math.tau / circle.STEPS) / TURNED) ** 2)
_SMEAR = _ONE[np.arange(circle.STEPS)[:, None] - np.arange(0, circle.STEPS, circle.STEPS // _FEW)]
_SMEAR /= TURNED * math.sqrt(math.tau)


@dataclasses.dataclass(frozen=True)
class CircleEvidence:
    """A station's evidence on the circle."""

    angles: Array  #: shape (n,); azimuths for the declination of the reference, rad, in order
    #: shape (n, m, h, j); log density of the readings with all prior weights, by angle, filter in use, external field,
    #: and state of the gyro: right (0), its bias stepped (1), or wrong (2). Filters of negligible probability are left
    #: out. Without a gyro, j is 1.
    log: Array
    filters: Indices  #: shape (m,); indices of the filters in use among all
    count: int  #: number of all filters, k
    adrift: NDArray[np.bool_]  #: shape (m,); whether the gyro of the filter drifts
    misfit: float = 0.0  #: smallest chi-square of the field under the widest hypothesis

    @functools.cached_property
    def widths(self) -> Array:
        """Width of the interval around each angle, rad, shape (n,)."""
        return circle.widths(self.angles)

    @functools.cached_property
    def _probable(self) -> tuple[Array, Array, Array, Array]:
        """Compute probabilities of points, angles, kinds, and the highest of each filter, in one pass."""
        n, m, h, _ = self.log.shape
        share, found = np.empty_like(self.log), (np.zeros((n, 3)), np.zeros((m, h)), np.zeros(m))
        _probabilities(self.log, self.widths, self.adrift, share, *found)
        by_kind = np.zeros((self.count, h))
        by_kind[self.filters] = found[1]
        return share, found[0], by_kind, found[2]

    @property
    def share(self) -> Array:
        """Probability of each point, shape of `log`."""
        return self._probable[0]

    @property
    def by_angle(self) -> Array:
        """
        Probability of each angle and state of the gyro, shape (n, 3).

        The states are: right; its bias stepped or drifts; wrong. Without a gyro, only "wrong" is not zero.
        """
        return self._probable[1]

    @property
    def by_kind(self) -> Array:
        """Probability of each filter and external field, shape (k, h)."""
        return self._probable[2]

    @property
    def highest(self) -> Array:
        """Probability of the most probable point of each filter in use, shape (m,)."""
        return self._probable[3]


@compiled
def _probabilities(
    log: Array, width: Array, adrift: NDArray[np.bool_], share: Array, by_angle: Array, by_kind: Array, highest: Array
) -> None:
    """
    Fill the probabilities of `CircleEvidence` from a log density up to a constant and the width of each angle.

    adrift, shape (m,): whether the gyro drifts in each filter. All outputs except share must be zero before the call.
    """
    top, whole, first = log.max(), 0.0, 3 - log.shape[3]
    for n in range(log.shape[0]):
        for k in range(log.shape[1]):
            for h in range(log.shape[2]):
                for j in range(log.shape[3]):
                    below, value = log[n, k, h, j] - top, 0.0
                    if below > -_NOTHING:
                        value = math.exp(below) * width[n]
                        by_angle[n, 1 if adrift[k] and first + j == 0 else first + j] += value
                        by_kind[k, h] += value
                        whole += value
                        highest[k] = max(highest[k], value)
                    share[n, k, h, j] = value
    # A loop over one axis is faster than a division of the whole array.
    flat = share.reshape(-1)
    for n in range(len(flat)):
        flat[n] /= whole
    by_angle /= whole
    by_kind /= whole
    highest /= whole


@compiled
def packed_products(S: Array, out: Array) -> None:
    """
    Fill the coefficients of the innovation covariance by the products of the basis: S, shape (3, 3, 4, 4).

    out, shape (4, 4, 6): its lower triangle is filled, by the products 00, 11, 22, 01, 02, 12.
    """
    for a in range(4):
        for b in range(a + 1):
            for i in range(3):
                out[a, b, i] = S[i, i, a, b]
            out[a, b, 3] = S[0, 1, a, b] + S[1, 0, a, b]
            out[a, b, 4] = S[0, 2, a, b] + S[2, 0, a, b]
            out[a, b, 5] = S[1, 2, a, b] + S[2, 1, a, b]


# The kernels below index whole arrays: a view of one row for each point would take longer than the arithmetic.
@compiled
def spread_at(phi: Array, n: int, packed: Array, size: int, out: Array) -> None:
    """
    Compute the covariance of the innovation at one angle.

    phi, shape (m, 3): basis of all angles; n: index of the angle; packed: coefficients from `packed_products`; out,
    shape (4, 4).
    """
    p, q, r = phi[n, 0], phi[n, 1], phi[n, 2]
    p00, p11, p22, p01, p02, p12 = p * p, q * q, r * r, p * q, p * r, q * r
    # The compiler unrolls loops of fixed length.
    for a in range(3):
        for b in range(a + 1):
            value = p00 * packed[a, b, 0] + p11 * packed[a, b, 1] + p22 * packed[a, b, 2]
            value += p01 * packed[a, b, 3] + p02 * packed[a, b, 4] + p12 * packed[a, b, 5]
            out[a, b] = out[b, a] = value
    if size == 4:
        for b in range(4):
            value = p00 * packed[3, b, 0] + p11 * packed[3, b, 1] + p22 * packed[3, b, 2]
            value += p01 * packed[3, b, 3] + p02 * packed[3, b, 4] + p12 * packed[3, b, 5]
            out[3, b] = out[b, 3] = value


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
    wrong, last = log.shape[3] - 1, len(extra) - 2
    size = 4 if wrong > 0 else 3
    packed, s, e = np.zeros((4, 4, 6)), np.zeros((4, 4)), np.zeros(4)
    # Highest log density so far. A gyro azimuth makes a density at most `_SHARP` higher than the field alone.
    best = -math.inf
    log[:] = -math.inf
    for k in range(len(r)):
        packed_products(S[k], packed)
        for n in range(len(phi)):
            spread_at(phi, n, packed, size, s)
            for a in range(size):
                e[a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
            # With the variance x of an external field, the inverse of s + x is (x^2 + x (trace - s) + adjugate of s)
            # divided by the characteristic polynomial, so that each external field costs a few products.
            a, b, c, d, f, g = s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[0, 2], s[1, 2]
            i00, i01, i02 = b * c - g * g, f * g - d * c, d * g - f * b
            i11, i12, i22 = a * c - f * f, d * f - a * g, a * b - d * d
            trace, minors, det = a + b + c, i00 + i11 + i22, a * i00 + d * i01 + f * i02
            e0, e1, e2 = e[0], e[1], e[2]
            ee = e0 * e0 + e1 * e1 + e2 * e2
            se = a * e0 * e0 + b * e1 * e1 + c * e2 * e2 + 2.0 * (d * e0 * e1 + f * e0 * e2 + g * e1 * e2)
            ie = i00 * e0 * e0 + i11 * e1 * e1 + i22 * e2 * e2 + 2.0 * (i01 * e0 * e1 + i02 * e0 * e2 + i12 * e1 * e2)
            te = trace * ee - se
            x = extra[last]
            misfit[n, k] = (x * (x * ee + te) + ie) / (x * (x * (x + trace) + minors) + det)
            # An external field can only increase the determinant of the innovation covariance.
            least = 0.5 * math.log(det)
            for h in range(last + 1):
                x = extra[h]
                whole = x * (x * (x + trace) + minors) + det
                value = prior[k, h] - 0.5 * (x * (x * ee + te) + ie) / whole
                if value - least < best - _SHARP - _NOTHING:
                    continue
                value -= least if h == 0 else 0.5 * math.log(whole)
                if value < best - _SHARP - _NOTHING:
                    continue
                log[n, k, h, wrong] = value + states[n, wrong]
                best = max(best, log[n, k, h, wrong])
                if wrong == 0:
                    continue
                # Residual and variance of the gyro, given the residual of the field.
                u, v, w = s[0, 3], s[1, 3], s[2, 3]
                y0 = x * (x * u + trace * u - a * u - d * v - f * w) + i00 * u + i01 * v + i02 * w
                y1 = x * (x * v + trace * v - d * u - b * v - g * w) + i01 * u + i11 * v + i12 * w
                y2 = x * (x * w + trace * w - f * u - g * v - c * w) + i02 * u + i12 * v + i22 * w
                off = gyro[n] + e[3] - (y0 * e0 + y1 * e1 + y2 * e2) / whole
                variance = max(s[3, 3] - (y0 * u + y1 * v + y2 * w) / whole, 1e-12)
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

    Outputs, which must be zero before: weight (k, p); mean (k, p, 12) of basis x inverse innovation; spread
    (k, p, 12, 12), the covariance of basis x inverse innovation minus the mean inverse. Index 0 of the second axis is
    for points at which the gyro's bias did not step, index 1, only with a gyro, for points at which it did.
    """
    phi, gyro = circle_of
    r, S = terms
    parts, size = weight.shape[1], 4 if share.shape[3] > 1 else 3
    packed, s, i, x = np.zeros((4, 4, 6)), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((2, 4))
    whole, first, second = np.zeros(parts), np.zeros((parts, 4)), np.zeros((parts, 4, 4))
    products = np.zeros((parts, 4, 4, 6))
    for k in range(len(r)):
        packed_products(S[k], packed)
        products[:] = 0.0
        for n in range(len(phi)):
            if not highest_share(share, n, k) > least[k]:
                continue
            spread_at(phi, n, packed, size, s)
            for a in range(size):
                x[0, a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
            x[0, 3] += gyro[n]
            _gains_at(share, n, k, least[k], extra, (s, i, x), (whole, first, second))
            for c in range(parts):
                if whole[c] > 0.0:
                    weight[k, c] += whole[c]
                    _add_angle(phi, n, c, (first, second), mean, k, products)
        for c in range(parts):
            if weight[k, c] > 0.0:
                mean[k, c] /= weight[k, c]
                products[c] /= weight[k, c]
                for a in range(12):
                    for b in range(12):
                        m, q, i_a, i_b = a // 4, b // 4, max(a % 4, b % 4), min(a % 4, b % 4)
                        both = products[c, i_a, i_b, m if m == q else 2 + m + q]
                        spread[k, c, a, b] = both - mean[k, c, a] * mean[k, c, b]


@compiled
def highest_share(share: Array, n: int, k: int) -> float:
    """Return the largest probability in `share` of filter k at angle n, over all external fields and gyro states."""
    highest = 0.0
    for h in range(share.shape[2]):
        for j in range(share.shape[3]):
            highest = max(highest, share[n, k, h, j])
    return highest


@compiled
def _gains_at(
    share: Array,
    n: int,
    k: int,
    least: float,
    extra: Array,
    work: tuple[Array, Array, Array],
    sums: tuple[Array, Array, Array],
) -> None:
    """
    Fill `sums` with the moments of the inverse innovations of filter k at angle n.

    sums: weight (p,), first (p, 4) and second (p, 4, 4) moment, of which only the lower triangle is filled. share,
    least and extra: as in `gains`; work: innovation covariance (4, 4), space for its inverse (4, 4), and the innovation
    in the first row of (2, 4).
    """
    s, i, x = work
    whole, first, second = sums
    whole[:], first[:], second[:] = 0.0, 0.0, 0.0
    wrong = share.shape[3] - 1
    _add_field(share, n, k, least, extra, s, x, sums)
    for h in range(share.shape[2]):
        for j in range(wrong):
            value = share[n, k, h, j]
            if value <= least:
                continue
            inverse(s, extra[h], j * extra[-1], i)
            whole[j] += value
            for a in range(4):
                x[1, a] = i[a, 0] * x[0, 0] + i[a, 1] * x[0, 1] + i[a, 2] * x[0, 2] + i[a, 3] * x[0, 3]
                first[j, a] += value * x[1, a]
                for b in range(a + 1):
                    second[j, a, b] += value * (x[1, a] * x[1, b] - i[a, b])


@compiled
def _add_field(
    share: Array,
    n: int,
    k: int,
    least: float,
    extra: Array,
    s: Array,
    x: Array,
    sums: tuple[Array, Array, Array],
) -> None:
    """Add the points without a gyro, or with a wrong one, to `sums` of `_gains_at`: they use the field alone."""
    whole, first, second = sums
    wrong = share.shape[3] - 1
    a, b, c, d, f, g = s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[0, 2], s[1, 2]
    i00, i01, i02 = b * c - g * g, f * g - d * c, d * g - f * b
    i11, i12, i22 = a * c - f * f, d * f - a * g, a * b - d * d
    trace, minors, det = a + b + c, i00 + i11 + i22, a * i00 + d * i01 + f * i02
    # The inverse covariance is that of `fill_evidence`: a ratio of polynomials of the variance of the external field.
    v0, v1, v2, w0, w1, w2, w3, w4 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for h in range(share.shape[2]):
        value, y = share[n, k, h, wrong], extra[h]
        if value <= least:
            continue
        whole[0] += value
        inverse = 1.0 / (y * (y * (y + trace) + minors) + det)
        v, w = value * inverse, value * inverse * inverse
        v0, v1, v2 = v0 + v, v1 + v * y, v2 + v * y * y
        w0, w1, w2, w3, w4 = w0 + w, w1 + w * y, w2 + w * y**2, w3 + w * y**3, w4 + w * y**4
    e0, e1, e2 = x[0, 0], x[0, 1], x[0, 2]
    t0, t1, t2 = (b + c) * e0 - d * e1 - f * e2, (a + c) * e1 - d * e0 - g * e2, (a + b) * e2 - f * e0 - g * e1
    z0, z1, z2 = i00 * e0 + i01 * e1 + i02 * e2, i01 * e0 + i11 * e1 + i12 * e2, i02 * e0 + i12 * e1 + i22 * e2
    first[0, 0] += v2 * e0 + v1 * t0 + v0 * z0
    first[0, 1] += v2 * e1 + v1 * t1 + v0 * z1
    first[0, 2] += v2 * e2 + v1 * t2 + v0 * z2
    E = (e0, e1, e2)
    T = (t0, t1, t2)
    Z = (z0, z1, z2)
    S = ((a, d, f), (d, b, g), (f, g, c))
    A = ((i00, i01, i02), (i01, i11, i12), (i02, i12, i22))
    for m in range(3):
        for q in range(m + 1):
            found = w4 * E[m] * E[q] + w3 * (E[m] * T[q] + T[m] * E[q]) + w1 * (T[m] * Z[q] + Z[m] * T[q])
            found += w2 * (E[m] * Z[q] + Z[m] * E[q] + T[m] * T[q]) + w0 * Z[m] * Z[q]
            second[0, m, q] += found + v1 * S[m][q] - v0 * A[m][q]
        second[0, m, m] -= v2 + v1 * trace


@compiled
def _add_angle(phi: Array, n: int, c: int, moments: tuple[Array, Array], mean: Array, k: int, products: Array) -> None:
    """
    Add the moments of the weighted innovation at angle n to the sums of filter k over all angles, in place.

    moments: first (p, 4) and second (p, 4, 4) moments at the angle; mean (k, p, 12): sums of the products of basis and
    first; products (p, 4, 4, 6): sums of second times the products of the basis, ordered as in `packed_products`.
    """
    first, second = moments
    p, q, r = phi[n, 0], phi[n, 1], phi[n, 2]
    for a in range(4):
        mean[k, c, a] += p * first[c, a]
        mean[k, c, 4 + a] += q * first[c, a]
        mean[k, c, 8 + a] += r * first[c, a]
        for b in range(a + 1):
            value = second[c, a, b]
            products[c, a, b, 0] += p * p * value
            products[c, a, b, 1] += q * q * value
            products[c, a, b, 2] += r * r * value
            products[c, a, b, 3] += p * q * value
            products[c, a, b, 4] += p * r * value
            products[c, a, b, 5] += q * r * value


@compiled
def inverse(s: Array, field: float, gyro: float, out: Array) -> None:
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
    gyro. The states of the gyro are: its bias did not step, its bias stepped, or its azimuth is wrong. Returns shape
    (n, k, j).

    angles, shape (n,): azimuths, rad. log, shape (n, k): log evidence of the field without the turn. gyro, shape (n,):
    residual of the gyro, rad (`gyro_residual`). states, shape (n, j): log weights of the states. own: mean, rad, and
    variance, rad^2, of the gyro error in each filter, shape (k,) each, and the variance, rad^2, that a step adds.
    """
    place, apart = circle.places(angles), circle.STEPS // _FEW
    smear = _SMEAR[place].T * circle.widths(angles)
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
