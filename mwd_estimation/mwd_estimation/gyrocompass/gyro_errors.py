# SPDX-License-Identifier: Apache-2.0
"""
What a run has shown of the biases of its gyros: a mixture over how good the unit is, station after station.

The stated bias is one figure for all units of a type, and so is what it drifts by. How good this one is, its run tells:
along the vertical and in the length of the horizontal Earth rate every station measures what the latitude knows, and at
other toolfaces other axes of the tool. So bias and ramp of the three axes are followed for several scales of the stated
bias and of the stated drift (a scale mixture, as of Student's t; Gelman et al., Bayesian Data Analysis, section 17.2),
which weigh themselves by their evidence: a Kalman filter each, with the azimuth marginalised on the circle of the
latitude. Nothing of it is a rule: a better unit earns its smaller sigma, and a worse one than stated is found out.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.gyrocompass.azimuth_posterior import Part, along, part
from mwd_estimation.gyrocompass.seek_params import SeekParams, kernel_params
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR

# Scales of the stated bias and of its stated drift, evenly in the logarithm: four units in five are as stated, the
# fifth is anything from a 256th of it, which is noise, to eight times it, which hides every north.
_BIAS_SCALES = 2.0 ** np.arange(-8, 4)
_DRIFT_SCALES = 4.0 ** np.arange(-2, 2)
_AS_STATED = 0.8
# Time after which a ramp of the bias is another one, s: a collar takes up the temperature around it.
_RAMP_S = 3600.0
# Least stated bias, rad/s, and ramp, rad/s^2: zero has no scales.
_LEAST, _LEAST_RAMP = 1e-6 * DEG_PER_HOUR, 1e-9 * DEG_PER_HOUR / 3600.0
_BIAS, _RAMP = slice(0, 3), slice(3, 6)
# Logarithm of the odds that no pair of scales falls below: the unit may change.
_LEAST_ODDS = math.log(1e-6)
# Probability beforehand that the biases are others than at the station before, as after a shock: a guess on the wide
# side, for a step that nobody expects is answered with a sigma that it does not keep. From the second one on they are.
_STEP, _STEPPED = 0.02, 0.5


@dataclasses.dataclass(frozen=True)
class GyroErrors:
    """Bias and ramp of the gyros for each pair of scales, and, of a run, where the biases stepped, in a last row."""

    log_weight: Array  #: shape (k,)
    drift: Array  #: shape (k,); scale of the drift
    #: `mean`, `covariance`: shapes (k, 6) and (k, 6, 6); of biases x, y, z, rad/s, and their ramps, rad/s^2.
    mean: Array
    covariance: Array

    @property
    def bias(self) -> Array:
        """Mean bias of x, y, z, rad/s, shape (3,)."""
        return np.asarray(np.exp(self.log_weight) @ self.mean[:, _BIAS])

    @property
    def bias_sigma(self) -> Array:
        """1 sigma of it, rad/s, shape (3,)."""
        own = np.diagonal(self.covariance, axis1=1, axis2=2)[:, _BIAS]
        return np.sqrt(np.exp(self.log_weight) @ (own + (self.mean[:, _BIAS] - self.bias) ** 2))


def stated(params: SeekParams) -> GyroErrors:
    """What the parameters say, before any station."""
    one = np.array([params.gyro_x_bias_deg_h, params.gyro_bias_deg_h, params.gyro_bias_deg_h]) * DEG_PER_HOUR
    bias, drift = (values.ravel() for values in np.meshgrid(_BIAS_SCALES, _DRIFT_SCALES))
    weight = np.ones(len(bias))
    for scales in (bias, drift):
        as_stated = scales == 1.0
        weight *= np.where(as_stated, _AS_STATED, (1.0 - _AS_STATED) / (len(np.unique(scales)) - 1))
    variances = np.zeros((len(bias), 6))
    variances[:, _BIAS] = (bias[:, None] * np.maximum(one, _LEAST)) ** 2
    variances[:, _RAMP] = (drift[:, None] * max(kernel_params(params).bias_ramp, _LEAST_RAMP)) ** 2
    return GyroErrors(np.log(weight), drift, np.zeros((len(bias), 6)), variances[:, :, None] * np.eye(6))


def after(errors: GyroErrors, params: SeekParams, seconds: float) -> GyroErrors:
    """
    The same so many seconds later: biases have moved by their ramps and walked.

    A ramp is a first-order Gauss-Markov process: the warmth that causes it is gone, or another, after an hour. Brown
    and Hwang, Introduction to Random Signals, the integrated process.
    """
    p = kernel_params(params)
    share = max(seconds, 0.0) / _RAMP_S
    kept = math.exp(-share)
    moved = _RAMP_S * (1.0 - kept)
    noise = np.array(
        [
            [max(2.0 * share - 3.0 + 4.0 * kept - kept**2, 0.0) * _RAMP_S**2, _RAMP_S * (1.0 - kept) ** 2],
            [_RAMP_S * (1.0 - kept) ** 2, 1.0 - kept**2],
        ]
    )
    noise *= p.bias_ramp**2
    noise[0, 0] += p.bias_walk**2 * max(seconds, 0.0)
    phi = np.kron(np.array([[1.0, moved], [0.0, kept]]), np.eye(3))
    added = errors.drift[:, None, None] ** 2 * np.kron(noise, np.eye(3))
    return dataclasses.replace(errors, mean=errors.mean @ phi.T, covariance=phi @ errors.covariance @ phi.T + added)


def maybe_stepped(errors: GyroErrors, params: SeekParams) -> GyroErrors:
    """
    The same before another station, with a last row for biases that stepped: as stated anew, whatever was before.

    What the station before made likely of a step stays in that row, or becomes what all pairs of scales know.
    """
    begun = stated(params)
    pairs, as_stated = len(begun.log_weight), int(np.argmax(begun.log_weight))
    log_weight, mean, covariance = errors.log_weight[:pairs], errors.mean[:pairs], errors.covariance[:pairs]
    if len(errors.log_weight) > pairs:
        odds = math.exp(errors.log_weight[pairs])
        if _STEP < odds <= _STEPPED:
            return errors
        if odds > _STEPPED:
            mean, covariance = np.tile(errors.mean[pairs], (pairs, 1)), np.tile(errors.covariance[pairs], (pairs, 1, 1))
    kept = log_weight - math.log(float(np.exp(log_weight).sum())) + math.log(1.0 - _STEP)
    return GyroErrors(
        np.append(kept, math.log(_STEP)),
        np.append(begun.drift, begun.drift[as_stated]),
        np.append(mean, begun.mean[[as_stated]], axis=0),
        np.append(covariance, begun.covariance[[as_stated]], axis=0),
    )


def parts(errors: GyroErrors, x: Array, P: Array, right: Array, earth: slice, bias: slice) -> list[Part]:
    """
    Gaussian of the horizontal Earth rate for each pair of scales, weighed by its evidence.

    Parameters
    ----------
    errors : GyroErrors
        Of the time of the seek's end.
    x, P : ndarray, shapes (n,) and (n, n)
        What a seek found that knew nothing of the biases, and its covariance.
    right : ndarray, shape (n,)
        Row that makes the heading of the hole axis of the states.
    earth, bias : slice
        Places of the horizontal Earth rate and of the biases in x.
    """
    return _parts(errors, _joined(errors, x, P, bias), x, P, right, earth, bias)


def learnt(errors: GyroErrors, x: Array, P: Array, earth: slice, bias: slice, horizontal: float) -> GyroErrors:
    """
    What a station adds: as of `parts`, given the length of the horizontal Earth rate, rad/s.

    The Gaussians of all azimuths are collapsed to their mean and covariance (Murphy, Machine Learning, 2012, 18.6).
    """
    joined = _joined(errors, x, P, bias)
    found = _parts(errors, joined, x, P, np.zeros(len(x)), earth, bias)
    angle, share, log_weight = along(found, horizontal)
    circle = horizontal * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    means, covariances = [], []
    each_pair = zip(found, share, errors.mean, errors.covariance, *joined[:2], strict=True)
    for one, of_angles, m, C, gain, off in each_pair:
        S = P - gain @ P[bias]
        K = np.linalg.solve(S[earth, earth], S[earth, bias]).T
        each = (x + gain @ off)[bias] + (circle - one.earth) @ K.T
        now = of_angles @ each
        spread = ((each - now).T * of_angles) @ (each - now) + S[bias, bias] - K @ S[earth, bias]
        # What is known of the ramp by the bias.
        G = np.linalg.solve(C[_BIAS, _BIAS], C[_BIAS]).T
        means.append(m + G @ (now - m[_BIAS]))
        change = C + G @ (spread - C[_BIAS, _BIAS]) @ G.T
        covariances.append(0.5 * (change + change.T))
    log_weight = np.maximum(log_weight - log_weight.max(), _LEAST_ODDS)
    log_weight -= math.log(float(np.exp(log_weight).sum()))
    return GyroErrors(log_weight, errors.drift, np.array(means), np.array(covariances))


def _joined(errors: GyroErrors, x: Array, P: Array, bias: slice) -> tuple[Array, Array, Array]:
    """Gain, shape (k, n, 3), innovation (k, 3) and log evidence (k,) where each pair of scales knows the biases."""
    S, off = P[bias, bias] + errors.covariance[:, _BIAS, _BIAS], errors.mean[:, _BIAS] - x[bias]
    gain: Array = np.asarray(np.linalg.solve(S, P[bias]).transpose(0, 2, 1), dtype=float)
    distance: Array = np.einsum("ki,ki->k", off, np.linalg.solve(S, off[:, :, None])[:, :, 0])
    return gain, off, np.asarray(-0.5 * (distance + np.linalg.slogdet(S)[1]), dtype=float)


def _parts(
    errors: GyroErrors, joined: tuple[Array, Array, Array], x: Array, P: Array, right: Array, earth: slice, bias: slice
) -> list[Part]:
    found = []
    for log, gain, off, log_evidence in zip(errors.log_weight, *joined, strict=True):
        moved = gain @ off
        one = part(log + log_evidence, x[earth] + moved[earth], P - gain @ P[bias], right, earth, float(right @ moved))
        found.append(one)
    return found
