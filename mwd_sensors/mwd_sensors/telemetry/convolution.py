# SPDX-License-Identifier: Apache-2.0
"""
Convolutional code of constraint length 7 and rate 1/2, polynomials 133 and 171 (octal), ended with zeros.

Source: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008, section 8.1; the code of CCSDS 131.0-B.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices

POLYNOMIALS = (0o133, 0o171)
MEMORY = 6  # bits that the encoder remembers; as many zeros end a block
STATES = 1 << MEMORY


class Spectrum(NamedTuple):
    """Paths that leave the all-zero path and come back: their weights, how many there are, how many ones they send."""

    weights: Indices
    paths: Array
    ones: Array


@functools.cache
def outputs() -> Indices:
    """Two coded bits of each step, first bit high; shape (states, 2): state before, input bit."""
    table = np.empty((STATES, 2), dtype=np.int64)
    for state in range(STATES):
        for bit in (0, 1):
            register = bit << MEMORY | state
            first, second = ((register & polynomial).bit_count() & 1 for polynomial in POLYNOMIALS)
            table[state, bit] = first << 1 | second
    return table


def encode(bits: Indices) -> Indices:
    """
    Coded bits of a block.

    bits, shape (n,): 0 or 1. Returns shape (2 (n + MEMORY),): both bits of each step, the ending zeros included.
    """
    table, state = outputs(), 0
    coded = np.empty((len(bits) + MEMORY, 2), dtype=np.int64)
    for k, bit in enumerate([*np.asarray(bits).tolist(), *[0] * MEMORY]):
        pair = table[state, bit]
        coded[k] = pair >> 1, pair & 1
        state = (bit << MEMORY | state) >> 1
    return coded.reshape(-1)


@functools.cache
def spectrum(most: int = 24) -> Spectrum:
    """
    Distance spectrum up to a weight, counted along the trellis.

    most : int
        Largest weight of coded bits.
    """
    table = outputs()
    # Paths and ones at each state by the weight so far; a path begins with a one and ends where it meets zero.
    paths, ones = np.zeros((STATES, most + 1)), np.zeros((STATES, most + 1))
    start = int(table[0, 1])
    paths[1 << (MEMORY - 1), start.bit_count()] = 1.0
    ones[1 << (MEMORY - 1), start.bit_count()] = 1.0
    ended, sent = np.zeros(most + 1), np.zeros(most + 1)
    while paths.any():
        next_paths, next_ones = np.zeros_like(paths), np.zeros_like(ones)
        for state in range(1, STATES):
            for bit in (0, 1):
                weight = int(table[state, bit]).bit_count()
                to = (bit << MEMORY | state) >> 1
                kept = most + 1 - weight
                next_paths[to, weight:] += paths[state, :kept]
                next_ones[to, weight:] += ones[state, :kept] + bit * paths[state, :kept]
        ended += next_paths[0]
        sent += next_ones[0]
        next_paths[0] = next_ones[0] = 0.0
        paths, ones = next_paths, next_ones
    weights = np.flatnonzero(ended)
    return Spectrum(weights, ended[weights], sent[weights])
