# SPDX-License-Identifier: Apache-2.0
"""
Search for markers in noise: the score is the share of energy that the marker's symbols explain at any size and phase.

The score is a generalised likelihood ratio for a known shape in whitened noise (S. M. Kay, Fundamentals of Statistical
Signal Processing II, 1998, section 7.4); in noise alone the score exceeds x with probability exp(-x), nearly.
"""

from __future__ import annotations

import numpy as np
import scipy

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import carrier as air
from mwd_sensors.telemetry.carrier import MARKER_SYMBOLS
from mwd_surface.receiver.carrier.baseband import PER_SYMBOL, Complex
from mwd_surface.receiver.carrier.whitening_complex import filtered, prediction_error_filter

# Noise exceeds this about once in some thousand positions. A false marker costs one trial; the block's check decides.
THRESHOLD = 8.0
_ORDER = 6


def marker_score(envelope: Complex, known: Array, lines: Complex) -> Array:
    """
    Return the score of a marker that begins at each value of the envelope.

    Parameters
    ----------
    envelope : ndarray, shape (n,)
        `PER_SYMBOL` values per symbol.
    known : ndarray, shape (n,)
        1 where the envelope is known.
    lines : ndarray, shape (n, k)
        Columns of the disturbing lines; they are fitted and subtracted first.

    Returns
    -------
    ndarray, shape (n - 20 PER_SYMBOL,)
    """
    if lines.shape[1]:
        weighted = known[:, None] * lines
        gram = lines.conj().T @ weighted + 1e-6 * len(envelope) * np.eye(lines.shape[1])
        envelope = envelope - lines @ np.linalg.solve(gram, weighted.conj().T @ envelope)
    taps = prediction_error_filter(envelope * known, known, _ORDER)
    white = filtered(envelope * known, taps)
    shape = filtered(np.concatenate([np.repeat(air.marker(), PER_SYMBOL), np.zeros(_ORDER)]), taps)
    count = PER_SYMBOL * MARKER_SYMBOLS
    shape = shape[:count]
    length = len(white) - count
    got = scipy.signal.correlate(white, shape, mode="valid")[:length]
    squares = np.concatenate([[0.0], np.cumsum(np.abs(white) ** 2)])
    there = np.concatenate([[0.0], np.cumsum(known)])
    energy = squares[count : count + length] - squares[:length]
    rows = there[count : count + length] - there[:length]
    explained = np.abs(got) ** 2 / float(np.real(np.vdot(shape, shape)))
    score = rows * explained / np.maximum(energy, 1e-300)
    return np.where(rows > 0.9 * count, score, 0.0)
