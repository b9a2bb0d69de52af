# SPDX-License-Identifier: Apache-2.0
"""
Gyro errors estimated during a run: a mixture over the quality of the unit, updated at each station.

The stated bias, drift and g-sensitivity are figures for all units of a type; the run shows how good this unit is. At
every station the vertical rate and the length of the horizontal Earth rate are known from the latitude, and other
toolfaces show other axes of the tool. Bias, ramp and g-sensitivity are therefore estimated for several scales of each
stated figure (a scale mixture, as for Student's t; Gelman et al., Bayesian Data Analysis, section 17.2). Each is a
Kalman filter, weighted by its evidence, with the azimuth marginalised on the circle of the latitude. A shock may change
the biases: this is a possible change point before any station (Adams and MacKay, Bayesian online changepoint detection,
2007), whose probability follows from the same evidence.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_estimation.gyrocompass.azimuth_posterior import Mixture, along
from mwd_estimation.gyrocompass.seek_state import G_SCALES, LEAST_BIAS, KernelParams, SeekParams, kernel_params
from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.constants import DEG_PER_HOUR
from mwd_sensors.core.frames import wrap_pi

# Scale factors of the stated bias and of the stated drift, in logarithmic steps. The smallest bias is below the noise.
# The largest drift changes a bias by degrees per hour within a minute, which is visible within each position. The
# shares of units that are better than stated, as stated, and worse than stated are a guess. The share of better units
# is small, because some units that are as stated look better by chance, and their sigma would be too small.
_BIAS_SCALES: Array = np.array([4.0**k for k in range(-4, 2)])
# Scales of a drift whose slope changes within `_RAMP_S`, and of a drift whose slope is constant for the whole run. From
# the fifth station on, a constant slope is known, so that it no longer makes the azimuth uncertain. Of 800 stations of
# a unit that drifts steadily by 10 deg/h per hour, 196 give an azimuth, six of them beyond 3 sigma; without `_LASTING`,
# 32 and seven.
_CHANGING, _LASTING = np.array([4.0**k for k in (-2, -1, 0, 1, 4)]), np.array([4.0])
_DRIFT_SCALES: Array = np.append(_CHANGING, _LASTING)
# Assumed sigmas of the g-sensitivity, relative to the largest of `G_SCALES`, and their equal prior probability. One
# seek cannot show the g-sensitivity of a unit, the stations of a run can. The sigma of the first azimuths must
# therefore cover a unit with three times the stated g-sensitivity: with less probability of the larger sigmas, more
# than 1 % of the azimuths of such a unit differ from the truth by more than 3 sigma (`test_gyro_errors.py`).
_OF_G = np.array(G_SCALES) / G_SCALES[-1]
_G_SHARE = 1.0 / len(G_SCALES)
_BETTER, _AS_STATED, _WORSE = 0.05, 0.8, 0.15
# Correlation time of a ramp of the bias, s: the time in which a collar takes the temperature around it.
_RAMP_S = 3600.0
_BIAS, _RAMP, _DRIFTING, _G, _SIZE = slice(0, 3), slice(3, 6), slice(0, 6), slice(6, 10), 10
# Indices in the Gaussian of a seek.
_EARTH, _INSTRUMENT, _HEADING = slice(0, 2), slice(2, 12), 12
# Indices in `GyroErrors.kind` for a unit whose biases stepped earlier in the run, and for a unit whose biases step
# before this station.
_EARLIER, _NOW = len(_BIAS_SCALES), len(_BIAS_SCALES) + 1
# Centres of overlapping arcs of azimuth, rad, which are so short that the Earth rate along an arc is nearly a straight
# line; and smallest probability of an arc with its own Gaussian.
_ARCS, _WORTH_AN_ARC = np.arange(12) * math.tau / 12.0, 1e-4
# Smallest odds of a kind relative to the most probable kind, so that a unit that changes can still be recognised; and a
# probability that counts as zero.
_LEAST_ODDS, _NONE = 1e-6, 1e-300
# Probability that the biases step between two stations (a shock): a guess of one shock in a run of fifty stations.
_STEP = 0.02


@dataclasses.dataclass(frozen=True)
class GyroErrors:
    """Bias, ramp and g-sensitivity of the gyros as k Gaussians, one or more for each kind of unit."""

    log_weight: Array  #: shape (k,); logarithm of the probability of each Gaussian
    #: shape (k, 3); kind of unit as three indices: of the scale of the stated bias (or `_EARLIER` or `_NOW`), of the
    #: scale of the stated drift, and of the scale of the stated g-sensitivity.
    kind: Indices
    #: `mean`, `covariance`: shapes (k, 10) and (k, 10, 10), of biases x, y, z, rad/s, their ramps, rad/s^2, and
    #: g-sensitivity along, across, stretch and shear, rad/s per m/s^2.
    mean: Array
    covariance: Array

    @property
    def bias(self) -> Array:
        """Mean bias of x, y, z, rad/s, shape (3,)."""
        return np.asarray(np.exp(self.log_weight) @ self.mean[:, _BIAS])

    @property
    def bias_sigma(self) -> Array:
        """1 sigma of the bias of x, y, z, rad/s, shape (3,)."""
        own = np.diagonal(self.covariance, axis1=1, axis2=2)[:, _BIAS]
        return np.sqrt(np.exp(self.log_weight) @ (own + (self.mean[:, _BIAS] - self.bias) ** 2))


@dataclasses.dataclass(frozen=True)
class Sought:
    """
    Result of a seek: a Gaussian of Earth rate, gyro errors and heading.

    The order is horizontal Earth rate (2) and biases (3), rad/s, ramps (3), rad/s^2, g-sensitivity beyond the
    calibrated one (4), rad/s per m/s^2, heading, rad, and vertical Earth rate, rad/s.
    """

    mean: Array  #: shape (14,)
    covariance: Array  #: shape (14, 14)
    #: shape (10, 10); prior covariance, about zero, that the seek assumed for biases, ramps and g-sensitivity,
    #: propagated to the end of the seek
    prior: Array


class Joined(NamedTuple):
    """Result of a seek for each of k Gaussians of gyro errors, in the order of `Sought`."""

    log_evidence: Array  #: shape (k,)
    mean: Array  #: shape (k, 14); shape (k, 13) where the vertical Earth rate is given
    covariance: Array  #: shape (k, 14, 14), or (k, 13, 13)
    #: shape (k,); squared distance of the given vertical Earth rate from the estimate, in sigmas
    misfit: Array

    def at(self, down: float) -> Joined:
        """Return the Gaussians under the condition that the vertical Earth rate is `down`, rad/s."""
        mean, S = self.mean, self.covariance
        variance = S[:, -1, -1]
        gain, off = S[:, :-1, -1] / variance[:, None], down - mean[:, -1]
        misfit = off**2 / variance
        left = S[:, :-1, :-1] - gain[:, :, None] * S[:, None, -1, :-1]
        return Joined(
            self.log_evidence - 0.5 * (misfit + np.log(variance)),
            mean[:, :-1] + gain * off[:, None],
            0.5 * (left + np.transpose(left, (0, 2, 1))),
            misfit,
        )


def stated(params: SeekParams) -> GyroErrors:
    """Return the gyro errors as the parameters state them, before any station."""
    kind = np.indices((len(_BIAS_SCALES), len(_DRIFT_SCALES), len(_OF_G))).reshape(3, -1).T
    bias, drift, _ = kind.T
    of_drift = _beforehand(_DRIFT_SCALES)[drift]
    # If the bias of a unit is worse than stated, a drift as stated and a worse drift are assumed equally probable.
    alike = np.count_nonzero(_DRIFT_SCALES[:, None] == _DRIFT_SCALES, axis=1)
    worse = (_BIAS_SCALES[bias] > 1.0) & (_DRIFT_SCALES[drift] >= 1.0)
    of_drift[worse] = 0.5 * (_AS_STATED + _WORSE) / alike[drift[worse]]
    return _as_stated(params, _beforehand(_BIAS_SCALES)[bias] * of_drift * _G_SHARE, kind, _BIAS_SCALES[bias])


def _as_stated(params: SeekParams, weight: Array, kind: Indices, scale: Array) -> GyroErrors:
    """
    Return Gaussians of gyro errors with mean zero and the sigmas that the parameters state.

    weight, shape (k,): probabilities; kind, shape (k, 3): see `GyroErrors`; scale, shape (k,): factors on the stated
    bias.
    """
    p = kernel_params(params)
    one = np.array([params.gyro_x_bias_deg_h, params.gyro_bias_deg_h, params.gyro_bias_deg_h]) * DEG_PER_HOUR
    sigmas = np.empty((len(scale), _SIZE))
    sigmas[:, _BIAS] = scale[:, None] * np.maximum(one, LEAST_BIAS * DEG_PER_HOUR)
    sigmas[:, _RAMP] = _DRIFT_SCALES[kind[:, 1], None] * p.bias_ramp
    sigmas[:, _G] = _OF_G[kind[:, 2], None] * p.g_sensitivity
    return GyroErrors(np.log(weight), kind, np.zeros((len(scale), _SIZE)), sigmas[:, :, None] ** 2 * np.eye(_SIZE))


def _beforehand(scales: Array) -> Array:
    better = _BETTER / np.count_nonzero(scales < 1.0)
    # The prior of a worse scale is inversely proportional to the scale.
    rarer = np.where(scales > 1.0, 1.0 / scales, 0.0)
    return np.where(scales < 1.0, better, np.where(scales > 1.0, _WORSE * rarer / rarer.sum(), _AS_STATED))


def after(errors: GyroErrors, params: SeekParams, seconds: float) -> GyroErrors:
    """
    Return the gyro errors propagated over `seconds`: biases change by their ramps and random walks.

    A ramp is constant for the kinds `_LASTING`. For the others it is a first-order Gauss-Markov process, because its
    thermal cause changes within about an hour. Source: Brown and Hwang, Introduction to Random Signals, the integrated
    process.
    """
    of_axis, noise = _drifts(kernel_params(params), max(seconds, 0.0))
    drift = errors.kind[:, 1]
    phi, added = np.repeat(np.eye(_SIZE)[None], len(drift), axis=0), np.zeros((len(drift), _SIZE, _SIZE))
    phi[:, _DRIFTING, _DRIFTING] = np.kron(of_axis, np.eye(3))[drift]
    added[:, _DRIFTING, _DRIFTING] = np.kron(noise, np.eye(3))[drift]
    mean = np.einsum("kij,kj->ki", phi, errors.mean)
    return dataclasses.replace(errors, mean=mean, covariance=phi @ errors.covariance @ np.swapaxes(phi, 1, 2) + added)


def _drifts(p: KernelParams, seconds: float) -> tuple[Array, Array]:
    """Return transition and added covariance of bias and ramp of one axis, shape (d, 2, 2), for each kind of drift."""
    share = seconds / _RAMP_S
    kept = math.exp(-share)
    moved = _RAMP_S * (1.0 - kept)
    noise = np.array(
        [
            [max(2.0 * share - 3.0 + 4.0 * kept - kept**2, 0.0) * _RAMP_S**2, _RAMP_S * (1.0 - kept) ** 2],
            [_RAMP_S * (1.0 - kept) ** 2, 1.0 - kept**2],
        ]
    )
    walk = np.diag([p.bias_walk**2 * seconds, 0.0])
    phi, added = np.empty((2, len(_DRIFT_SCALES), 2, 2))
    changing, lasting = slice(0, len(_CHANGING)), slice(len(_CHANGING), None)
    phi[changing], added[changing] = [[1.0, moved], [0.0, kept]], noise * p.bias_ramp**2 + walk
    phi[lasting], added[lasting] = [[1.0, seconds], [0.0, 1.0]], walk
    added[changing] *= _CHANGING[:, None, None] ** 2
    return phi, added


def between_stations(errors: GyroErrors, params: SeekParams) -> GyroErrors:
    """
    Return the gyro errors before the next station of a run, when the biases may have stepped.

    With the probability `_STEP` a shock has changed the biases; the new biases have the stated sigma and mean zero.
    """
    weight = np.exp(errors.log_weight)
    # A step leaves drift and g-sensitivity as they are: one Gaussian for each pair of their kinds.
    pairs, of_pair = np.unique(errors.kind[:, 1:], axis=0, return_inverse=True)
    total, mean, covariance = _merged(of_pair.ravel(), weight, errors.mean, errors.covariance)
    kind = np.column_stack([np.full(len(pairs), _NOW), pairs])
    steps = _as_stated(params, _STEP * np.maximum(total, _NONE), kind, np.ones(len(pairs)))
    steps.mean[:, _G], steps.covariance[:, _G, _G] = mean[:, _G], covariance[:, _G, _G]
    before = errors.kind.copy()
    before[before[:, 0] == _NOW, 0] = _EARLIER
    return GyroErrors(
        np.append(errors.log_weight + math.log(1.0 - _STEP), steps.log_weight),
        np.append(before, steps.kind, axis=0),
        np.append(errors.mean, steps.mean, axis=0),
        np.append(errors.covariance, steps.covariance, axis=0),
    )


def joined(errors: GyroErrors, sought: Sought) -> Joined:
    """
    Return the result of a seek, combined with each Gaussian of `errors` at the end of the seek.

    The seek's own prior of biases, ramps and g-sensitivity is divided out, so that the prior counts only once in a run.
    """
    unit = np.sqrt(np.diagonal(sought.covariance))
    unit = np.where(unit > 0.0, unit, 1.0)
    of_instrument = unit[_INSTRUMENT, None] * unit[_INSTRUMENT]
    information = np.linalg.inv(sought.covariance / np.outer(unit, unit))
    seen = information @ (sought.mean / unit)
    inverse = np.linalg.inv(errors.covariance / of_instrument)
    known = np.einsum("kij,kj->ki", inverse, errors.mean / unit[_INSTRUMENT])
    total = np.repeat(information[None], len(inverse), axis=0)
    total[:, _INSTRUMENT, _INSTRUMENT] += inverse - np.linalg.inv(sought.prior / of_instrument)
    towards = np.repeat(seen[None], len(inverse), axis=0)
    towards[:, _INSTRUMENT] += known
    S = np.linalg.inv(total)
    S = 0.5 * (S + np.transpose(S, (0, 2, 1)))
    mean = np.einsum("kij,kj->ki", S, towards)
    log: Array = np.einsum("ki,ki->k", towards, mean) - np.einsum("ki,ki->k", known, errors.mean / unit[_INSTRUMENT])
    log += np.linalg.slogdet(inverse)[1] - np.linalg.slogdet(total)[1]
    return Joined(0.5 * log, mean * unit, S * np.outer(unit, unit), np.zeros(len(log)))


def parts(errors: GyroErrors, found: Joined) -> Mixture:
    """Return Gaussians of the horizontal Earth rate, weighted by evidence; found is `Joined.at` the latitude."""
    mean, S = found.mean, found.covariance
    earth, with_heading = S[:, _EARTH, _EARTH], S[:, _EARTH, _HEADING]
    cross = np.asarray(np.linalg.solve(earth, with_heading[:, :, None])[:, :, 0], dtype=float)
    own = np.maximum(S[:, _HEADING, _HEADING] - np.einsum("ki,ki->k", cross, with_heading), 0.0)
    log_weight = errors.log_weight + found.log_evidence
    return Mixture(log_weight, mean[:, _EARTH], earth, cross, own, mean[:, _HEADING], found.misfit)


def learnt(errors: GyroErrors, found: Joined, horizontal: float) -> GyroErrors:
    """
    Return the gyro errors after a station, given the horizontal Earth rate at the latitude, rad/s; found as in `parts`.

    If the azimuth were known, the biases would nearly be known. For each kind of unit, the Gaussians of all azimuths of
    an arc are therefore merged to their mean and covariance (Murphy, Machine Learning, 2012, 18.6). A single Gaussian
    for the whole circle would also cover the disc inside the circle; combined with the circle of the next station it
    would wrongly determine the azimuth.
    """
    angle, share, log_weight = along(parts(errors, found), horizontal)
    circle = horizontal * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    # Arcs overlap as a partition of unity, so that the sum of their Gaussians has no ripples.
    arcs = np.maximum(1.0 - np.abs(wrap_pi(angle - _ARCS[:, None])) / (_ARCS[1] - _ARCS[0]), 0.0)
    of_arc = share[:, None, :] * arcs
    mass = of_arc.sum(axis=2)
    whole = np.maximum(mass, _NONE)
    earth = of_arc @ circle / whole[:, :, None]
    squares = (circle[:, :, None] * circle[:, None, :]).reshape(-1, 4)
    spread = (of_arc @ squares / whole[:, :, None]).reshape(*mass.shape, 2, 2)
    spread -= earth[:, :, :, None] * earth[:, :, None, :]
    S, at = found.covariance, found.mean
    K = np.transpose(np.linalg.solve(S[:, _EARTH, _EARTH], S[:, _EARTH, _INSTRUMENT]), (0, 2, 1))[:, None]
    mean = at[:, None, _INSTRUMENT] + (K @ (earth - at[:, None, _EARTH])[..., None])[..., 0]
    change = K @ (spread - S[:, None, _EARTH, _EARTH]) @ np.swapaxes(K, 2, 3)
    return _collapsed(errors, log_weight, mass, mean, S[:, None, _INSTRUMENT, _INSTRUMENT] + change)


def _collapsed(errors: GyroErrors, log_weight: Array, mass: Array, mean: Array, covariance: Array) -> GyroErrors:
    """
    Return the Gaussians of a station, merged by kind of unit and arc; the improbable arcs of a kind give one Gaussian.

    log_weight, shape (k,): one for each previous Gaussian; mass, shape (k, a): its share in each arc; mean and
    covariance have shapes (k, a, 10) and (k, a, 10, 10).
    """
    kinds, of_kind = np.unique(errors.kind, axis=0, return_inverse=True)
    of_kind = of_kind.ravel()
    # Weights relative to the best weight of each kind. Relative to the whole mixture, the weights of an improbable kind
    # would underflow.
    most = np.full(len(kinds), -math.inf)
    np.maximum.at(most, of_kind, log_weight)
    weight = np.exp(log_weight - most[of_kind])[:, None] * mass
    of_all = np.exp(most - most.max())
    by_arc = np.zeros((len(kinds), weight.shape[1]))
    np.add.at(by_arc, of_kind, weight)
    by_arc *= (of_all / (of_all @ by_arc.sum(axis=1)))[:, None]
    arc = np.where(by_arc > _WORTH_AN_ARC, np.arange(weight.shape[1]), weight.shape[1])[of_kind]
    cells, cell = np.unique(of_kind[:, None] * (weight.shape[1] + 1) + arc, return_inverse=True)
    total, middle, square = _merged(
        cell.ravel(), weight.ravel(), mean.reshape(-1, _SIZE), covariance.reshape(-1, _SIZE, _SIZE)
    )
    of_cell = cells // (weight.shape[1] + 1)
    held = total > _NONE
    odds = total * of_all[of_cell]
    log = np.log(np.maximum(odds / odds.max(), _LEAST_ODDS))[held]
    return GyroErrors(log - math.log(float(np.exp(log).sum())), kinds[of_cell[held]], middle[held], square[held])


def _merged(cell: Indices, weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return total weight, mean and covariance of each cell; cell, shape (n,): cell of each Gaussian, without gaps."""
    order = np.argsort(cell, kind="stable")
    begins = np.flatnonzero(np.diff(cell[order], prepend=-1))
    total = np.add.reduceat(weight[order], begins)
    share = weight[order] / np.maximum(total, _NONE)[cell[order]]
    middle = np.add.reduceat(share[:, None] * mean[order], begins)
    off = mean[order] - middle[cell[order]]
    each = share[:, None, None] * (covariance[order] + off[:, :, None] * off[:, None, :])
    square = np.add.reduceat(each, begins)
    return total, middle, 0.5 * (square + np.transpose(square, (0, 2, 1)))
