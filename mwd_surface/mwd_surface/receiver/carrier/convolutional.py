# SPDX-License-Identifier: Apache-2.0
"""
Soft-decision decoder of the convolutional code: the forward-backward algorithm along its trellis.

It works with probabilities scaled at each step instead of logarithms: the result is the same without a function call
per branch.
Source: L. Bahl, J. Cocke, F. Jelinek, J. Raviv, IEEE Trans. Inf. Theory 20 (1974) 284.
"""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry.convolution import MEMORY, outputs

_SUREST = 40.0  # larger log-likelihood ratios are clipped: they add nothing, and exp() would overflow


@compiled
def _forward_backward(given: Array, table: Indices, tail: int, bits: Array, coded: Array) -> float:
    """
    Run the forward and the backward recursion along the trellis; return the log evidence.

    given (n, 2): log-likelihood ratios of the received coded bits; table (states, 2): coded bits of each state for the
    inputs 0 and 1; tail: number of zeros that end the block; bits (n,), coded (n, 2): filled with the log posterior
    ratios of the data bits and of the coded bits.
    """
    n, states = len(given), len(table)
    half = states // 2
    forward = np.zeros((n + 1, states))
    forward[0, 0] = 1.0
    branch = np.empty((n, 4))
    evidence = 0.0
    for k in range(n):
        one = 1.0 / (1.0 + np.exp(given[k, 0]))
        two = 1.0 / (1.0 + np.exp(given[k, 1]))
        branch[k, 0] = (1.0 - one) * (1.0 - two)
        branch[k, 1] = (1.0 - one) * two
        branch[k, 2] = one * (1.0 - two)
        branch[k, 3] = one * two
        total = 0.0
        inputs = 1 if k >= n - tail else 2
        for state in range(states):
            reach = forward[k, state]
            if reach > 0.0:
                for bit in range(inputs):
                    step = reach * branch[k, table[state, bit]]
                    forward[k + 1, (state >> 1) + bit * half] += step
                    total += step
        total = max(total, 1e-300)
        evidence += np.log(total)
        for state in range(states):
            forward[k + 1, state] /= total
    backward, before = np.zeros(states), np.zeros(states)
    backward[0] = 1.0
    for k in range(n - 1, -1, -1):
        before[:] = 0.0
        inputs = 1 if k >= n - tail else 2
        ones = zeros = first0 = first1 = second0 = second1 = 1e-300
        total = 0.0
        for state in range(states):
            for bit in range(inputs):
                sent = table[state, bit]
                step = branch[k, sent] * backward[(state >> 1) + bit * half]
                before[state] += step
                both = forward[k, state] * step
                if bit == 1:
                    ones += both
                else:
                    zeros += both
                if sent >= 2:
                    first1 += both
                else:
                    first0 += both
                if sent & 1:
                    second1 += both
                else:
                    second0 += both
            total += before[state]
        bits[k] = np.log(zeros / ones)
        coded[k, 0] = np.log(first0 / first1)
        coded[k, 1] = np.log(second0 / second1)
        for state in range(states):
            backward[state] = before[state] / max(total, 1e-300)
    return evidence


def decode(given: Array) -> tuple[Array, Array, float]:
    """
    Return the posterior of the bits of a block.

    Parameters
    ----------
    given : ndarray, shape (2 n,)
        Log-likelihood ratio of each coded bit, positive for 0, in the order of the encoder.

    Returns
    -------
    ndarray, shape (n - MEMORY,)
        Log posterior ratio of each bit, positive for 0, without the zeros that end the block.
    ndarray, shape (2 n,)
        Log posterior ratio of each coded bit, including the given one.
    float
        Log evidence of the given ratios under the code, to compare trials of the same block.
    """
    pairs = np.clip(given, -_SUREST, _SUREST).reshape(-1, 2)
    bits, coded = np.empty(len(pairs)), np.empty((len(pairs), 2))
    evidence = float(_forward_backward(pairs, outputs(), MEMORY, bits, coded))
    return bits[:-MEMORY], coded.reshape(-1), evidence
