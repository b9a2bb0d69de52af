# SPDX-License-Identifier: Apache-2.0
"""
Convolutional code of constraint length 7 and rate 1/2, polynomials 133 and 171 (octal), terminated with zeros.

Source: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008, section 8.1; the code of CCSDS 131.0-B.
"""

from __future__ import annotations

import functools

import numpy as np

from mwd_sensors.core.arrays import Indices

POLYNOMIALS = (0o133, 0o171)
MEMORY = 6  # bits in the encoder's register; the same number of zeros ends a block
STATES = 1 << MEMORY


@functools.cache
def outputs() -> Indices:
    """
    Return the two coded bits of a step as one number (2 times the first bit plus the second bit).

    The result has shape (states, 2), indexed by state and input bit.
    """
    table = np.empty((STATES, 2), dtype=np.int64)
    for state in range(STATES):
        for bit in (0, 1):
            register = bit << MEMORY | state
            first, second = ((register & polynomial).bit_count() & 1 for polynomial in POLYNOMIALS)
            table[state, bit] = first << 1 | second
    return table


def encode(bits: Indices) -> Indices:
    """
    Encode the bits of a block.

    bits, shape (n,): 0 or 1. Returns shape (2 (n + MEMORY),): both bits of each step, including the zeros at the end.
    """
    table, state = outputs(), 0
    coded = np.empty((len(bits) + MEMORY, 2), dtype=np.int64)
    for k, bit in enumerate([*np.asarray(bits).tolist(), *[0] * MEMORY]):
        pair = table[state, bit]
        coded[k] = pair >> 1, pair & 1
        state = (bit << MEMORY | state) >> 1
    return coded.reshape(-1)
