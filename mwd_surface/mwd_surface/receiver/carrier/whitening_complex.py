# SPDX-License-Identifier: Apache-2.0
"""
Whitening of complex noise: an autoregressive model and its prediction error filter.

Source: S. M. Kay, Modern Spectral Estimation, 1988, section 7.3 (Yule-Walker).
"""

from __future__ import annotations

import numpy as np
import scipy

from mwd_sensors.core.arrays import Array
from mwd_surface.receiver.carrier.baseband import Complex

# White noise added to the model, as a share of its variance, so that the empty edges of the band are not amplified.
_FLOOR = 1e-2


def filtered(x: Complex, taps: Complex) -> Complex:
    """Return x, shape (n,) or (n, k), filtered causally along the first axis, with zeros before the first row."""
    out = np.asarray(taps[0] * x, dtype=complex)
    for k in range(1, len(taps)):
        out[k:] += taps[k] * x[:-k]
    return out


def prediction_error_filter(noise: Complex, weight: Array, order: int) -> Complex:
    """
    Return the coefficients of the filter that whitens noise; the first belongs to the newest sample and is 1.

    The shape is (order + 1,), or (1,) if the noise is 0 everywhere.

    Parameters
    ----------
    noise : ndarray, shape (n,)
    weight : ndarray, shape (n,)
        0 where a sample is unknown or disturbed.
    """
    root = np.sqrt(weight)
    x = root * noise
    n = len(x)
    lags = np.array([np.vdot(x[: n - k], x[k:]) / max(float(root[: n - k] @ root[k:]), 1.0) for k in range(order + 1)])
    if lags[0].real <= 0.0:
        return np.ones(1, dtype=complex)
    lags[0] *= 1.0 + _FLOOR
    a = scipy.linalg.solve_toeplitz((lags[:-1], lags[:-1].conj()), lags[1:])
    return np.concatenate([[1.0 + 0j], -a])
