# SPDX-License-Identifier: Apache-2.0
"""
What one station's readings say of every azimuth, under each filter of the run and each hypothesis of the station.

The field's evidence is N(r - H m; 0, H P H' + R); the gyro's is that of its residual given the field's. A field turned
about the vertical is that evidence smeared over the azimuth.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.survey.posterior import circle
from mwd_estimation.survey.posterior.field_model import Row
from mwd_estimation.survey.posterior.hypotheses import TURNED
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.frames import wrap_pi

# A step of a gyro's bias: so much, rad, and so many of its sigmas.
_STEP = math.radians(1.75), 0.75
# A wrong gyro azimuth has errors of any size (wrapped Cauchy; Mardia and Jupp, Directional Statistics, section 3.5.7):
# half of them are larger than this, rad.
_WRONG = math.radians(10.0)
# Angles of a density that is smeared by `TURNED`, rad.
_FEW = np.arange(72) * math.tau / 72.0


@dataclasses.dataclass(frozen=True)
class Evidence:
    """A station's evidence on the circle."""

    angles: Array  #: shape (n,); rad, in order
    #: shape (n, k, h, 3); log density of the readings, with all prior weights: by angle, filter, external field, and
    #: whether the gyro is right (0), its bias stepped (1), or it is wrong altogether (2).
    log: Array
    misfit: float  #: least chi-square of the field under the widest hypothesis

    @property
    def share(self) -> Array:
        """Probability of each point, shape of `log`."""
        share = np.exp(self.log - self.log.max()) * circle.widths(self.angles)[:, None, None, None]
        return np.asarray(share / share.sum())


@compiled
def _spread(phi: Array, S: Array, out: Array) -> None:
    """The innovation covariance at an angle: phi, shape (3,); S, shape (3, 3, 4, 4); out, shape (4, 4)."""
    for a in range(4):
        for b in range(a + 1):
            value = 0.0
            for i in range(3):
                for j in range(3):
                    value += phi[i] * phi[j] * S[i, j, a, b]
            out[a, b] = out[b, a] = value


@compiled
def fill_evidence(phi: Array, gyro: Array, r: Array, S: Array, extra: Array, log: Array, misfit: Array) -> None:
    """
    Fill the log evidence of every angle, filter and hypothesis.

    phi (n, 3) and gyro (n,): basis and gyro residual of each angle; r (k, 3, 4) and S (k, 3, 3, 4, 4): residual and its
    covariance as factors of the basis; extra (h + 1,): variances of each external field (`EXTERNAL_UT`), uT^2, and of a
    step of the gyro, rad^2. Filled: log (n, k, h or more, 3), misfit (n,).
    """
    s, e, x = np.zeros((4, 4)), np.zeros(4), np.zeros(3)
    for n in range(len(phi)):
        misfit[n] = 1e300
        for k in range(len(r)):
            _spread(phi[n], S[k], s)
            for a in range(4):
                e[a] = phi[n, 0] * r[k, 0, a] + phi[n, 1] * r[k, 1, a] + phi[n, 2] * r[k, 2, a]
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
                misfit[n] = min(misfit[n], chi)
                value = -0.5 * (chi + math.log(det))
                log[n, k, h, 0] = log[n, k, h, 1] = log[n, k, h, 2] = value
                if gyro[n] == gyro[n]:
                    u, v, w = s[0, 3], s[1, 3], s[2, 3]
                    off = gyro[n] + e[3] - (u * x[0] + v * x[1] + w * x[2])
                    known = u * (i00 * u + i01 * v + i02 * w)
                    known += v * (i01 * u + i11 * v + i12 * w) + w * (i02 * u + i12 * v + i22 * w)
                    variance = max(s[3, 3] - known / det, 1e-12)
                    for j in range(2):
                        wide = variance + j * extra[-1]
                        log[n, k, h, j] = value - 0.5 * (off * off / wide + math.log(wide * 6.283185307179586))


def gyro_residual(one: Row, angles: Array) -> Array:
    """The gyro's azimuth less each angle, rad; of two azimuths that fit it alike the nearer."""
    first, other = wrap_pi(one["gyro"] - angles), wrap_pi(one["gyro_other"] - angles)
    return np.where(np.abs(other) < np.abs(first), other, first)


def gyro_step(one: Row) -> float:
    """1 sigma of what a step of its bias adds to a gyro's error, rad."""
    return _STEP[0] + _STEP[1] * math.hypot(one["gyro_lasting"], math.sqrt(one["gyro_variance"]))


def wrong_gyro(residual: Array) -> Array:
    """Log density of a gyro azimuth that is wrong, per rad; residual: of the gyro, rad."""
    rho = math.exp(-_WRONG)
    return np.log((1.0 - rho * rho) / math.tau / (1.0 + rho * rho - 2.0 * rho * np.cos(residual)))


def turned_field(angles: Array, log: Array, gyro: Array, own: tuple[Array, Array, float]) -> Array:
    """
    Log evidence, shape (n, k, 3), where the whole field is turned about the vertical: that of the field smeared.

    log (n, k): of the field as it is; gyro (n,): its residual; own: what each filter takes off that, and its variance,
    shape (k,), and the variance of a step.
    """
    # What is smeared so wide needs few angles.
    apart = wrap_pi(_FEW[:, None] - angles)
    smear = np.exp(-0.5 * (apart / TURNED) ** 2) * circle.widths(angles) / (TURNED * math.sqrt(math.tau))
    top = log.max(axis=0)
    # Numbers below the normal ones make the product many times slower.
    few = np.log(smear @ np.exp(np.maximum(log - top, -300.0)) + 1e-300) + top
    every = [np.interp(angles, _FEW, one, period=math.tau) for one in few.T]
    found = np.repeat(np.stack(every, axis=1)[:, :, None], 3, axis=2)
    if math.isfinite(gyro[0]):
        off = gyro[:, None] + own[0]
        for j in range(2):
            variance = own[1] + j * own[2]
            found[:, :, j] -= 0.5 * (off**2 / variance + np.log(math.tau * variance))
    return np.asarray(found)
