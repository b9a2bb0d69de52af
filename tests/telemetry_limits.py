# SPDX-License-Identifier: Apache-2.0
"""
Closed-form limits of the codes in white Gaussian noise: what no receiver can beat, for tests, benchmarks and planning.

Eb / N0 counts every bit on air, parity included.
Source: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008: union bound (4.2-70), DPSK over several symbols
(11.1-13), coded bits (8.2-16).
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.telemetry import convolution
from mwd_sensors.telemetry.pulse_position import packets


def ratio(db: float) -> float:
    """Power ratio of decibels."""
    return float(10.0 ** (db / 10.0))


def packet_error(ebn0_db: float, bits: int) -> float:
    """
    Error probability of one packet decided by the strongest of its 2^bits places; a union bound, tight above 4 dB.

    A pulse is 2 TU wide and its places are 1 TU apart, so pulses at neighbouring places correlate by a half and all
    others not at all: two places at correlation rho are confused with probability Q(sqrt(E (1 - rho) / N0)).

    ebn0_db: energy per bit over noise density, dB; a packet has bits times that energy.
    """
    energy, count = bits * ratio(ebn0_db), 1 << bits
    neighbours = 2.0 * (count - 1) / count
    near, far = (0.5 * math.erfc(math.sqrt(0.5 * energy * share)) for share in (0.5, 1.0))
    return neighbours * near + (count - 1 - neighbours) * far


def word_error(ebn0_db: float, bits: int) -> float:
    """Error probability of a word whose packets are each decided alone (hard decision)."""
    return 1.0 - math.prod(1.0 - packet_error(ebn0_db, size) for size in packets(bits))


def bit_error(ebn0_db: float, modulation: str) -> float:
    """Bit error probability of a carrier without code; of DPSK with each symbol against the one before."""
    energy = ratio(ebn0_db)
    return 0.5 * math.exp(-energy) if modulation == "dpsk" else 0.5 * math.erfc(math.sqrt(energy))


class Spectrum(NamedTuple):
    """Paths that leave the all-zero path and come back: their weights, how many there are, how many ones they send."""

    weights: Indices
    paths: Array
    ones: Array


@functools.cache
def spectrum(most: int = 24) -> Spectrum:
    """
    Distance spectrum up to a weight, counted along the trellis.

    most : int
        Largest weight of coded bits.
    """
    table, states, memory = convolution.outputs(), convolution.STATES, convolution.MEMORY
    # Paths and ones at each state by the weight so far; a path begins with a one and ends where it meets zero.
    paths, ones = np.zeros((states, most + 1)), np.zeros((states, most + 1))
    start = int(table[0, 1])
    paths[1 << (memory - 1), start.bit_count()] = 1.0
    ones[1 << (memory - 1), start.bit_count()] = 1.0
    ended, sent = np.zeros(most + 1), np.zeros(most + 1)
    while paths.any():
        next_paths, next_ones = np.zeros_like(paths), np.zeros_like(ones)
        for state in range(1, states):
            for bit in (0, 1):
                weight = int(table[state, bit]).bit_count()
                to = (bit << memory | state) >> 1
                kept = most + 1 - weight
                next_paths[to, weight:] += paths[state, :kept]
                next_ones[to, weight:] += ones[state, :kept] + bit * paths[state, :kept]
        ended += next_paths[0]
        sent += next_ones[0]
        next_paths[0] = next_ones[0] = 0.0
        paths, ones = next_paths, next_ones
    weights = np.flatnonzero(ended)
    return Spectrum(weights, ended[weights], sent[weights])


def coded_block_error(ebn0_db: float, bits: int, modulation: str) -> float:
    """
    Error probability of a block behind the convolutional code, soft decisions; a union bound, tight below 0.1.

    Parameters
    ----------
    ebn0_db : float
        Energy per bit into the encoder over noise density, dB; a coded bit has half of it.
    bits : int
        Into the encoder, the ending zeros left out: as many places where an error can begin.
    modulation : str
        "bpsk", "qpsk" or "dpsk".
    """
    code = spectrum()
    pair = _dpsk_pair if modulation == "dpsk" else _coherent_pair
    errors = [count * pair(0.5 * ratio(ebn0_db), int(d)) for d, count in zip(code.weights, code.paths, strict=True)]
    return float(min(1.0, bits * sum(errors)))


def _coherent_pair(energy: float, distance: int) -> float:
    """Probability to confuse two paths that differ in `distance` coded bits, each of the given energy over N0."""
    return 0.5 * math.erfc(math.sqrt(distance * energy))


def _dpsk_pair(energy: float, distance: int) -> float:
    """As `_coherent_pair`, the products of neighbouring symbols summed."""
    total = distance * energy
    series = sum(
        total**k / math.factorial(k) * sum(math.comb(2 * distance - 1, n) for n in range(distance - k))
        for k in range(distance)
    )
    return float(math.exp(-total) * series / 2 ** (2 * distance - 1))


def soft_word_error(ebn0_db: float, bits: int, trials: int = 20000, seed: int = 0) -> float:
    """
    Error probability of a word with even parity, the most likely of all words that hold it being taken.

    The best of all words with even parity has no closed form: drawn by chance, 1 sigma sqrt(p (1 - p) / trials).
    """
    return _drawn([white_common(ebn0_db, size) for size in packets(bits)], bits, trials, seed)


def channel_word_error(common: Array, bits: int, trials: int = 20000, seed: int = 0) -> float:
    """
    Error probability as `soft_word_error` of a receiver that knows channel, time and noise; neighbours do not disturb.

    common : ndarray, shape (8,) or more: what two whitened pulses have in common, by their distance in TU.
    """
    return _drawn([common] * len(packets(bits)), bits, trials, seed)


def white_common(ebn0_db: float, size: int) -> Array:
    """What two pulses of a packet have in common in white noise, by their distance in TU; shape (8,)."""
    return 2.0 * size * ratio(ebn0_db) * np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def _drawn(commons: list[Array], bits: int, trials: int, seed: int) -> float:
    random = np.random.default_rng(seed)
    right = np.zeros(trials)
    # Best metric of all words but the right one so far, by whether their parity differs from the right word's.
    wrong = np.full((2, trials), -np.inf)
    for size, common in zip(packets(bits), commons, strict=True):
        metric, sent = packet_metrics(random, common, size, trials)
        others = metric.copy()
        others[np.arange(trials), sent] = -np.inf
        differs = np.array([[(v ^ w).bit_count() & 1 for v in range(2**size)] for w in range(2**size)])[sent]
        same = np.where(differs == 0, others, -np.inf).max(axis=1)
        other = np.where(differs == 1, others, -np.inf).max(axis=1)
        truth = metric[np.arange(trials), sent]
        stay = np.maximum(truth, same)
        wrong = np.array(
            [
                np.maximum.reduce([wrong[0] + stay, wrong[1] + other, right + same]),
                np.maximum.reduce([wrong[1] + stay, wrong[0] + other, right + other]),
            ]
        )
        right += truth
    return float(np.mean(wrong[0] > right))


def packet_metrics(random: np.random.Generator, common: Array, size: int, trials: int) -> tuple[Array, Indices]:
    """
    Draw the log-likelihood of each value of a packet of `size` bits, and the value sent.

    Parameters
    ----------
    random : numpy Generator
    common : ndarray, shape (8,) or more
        What two whitened pulses have in common, by their distance in TU: mean and covariance of the matched filter.
    size : int
    trials : int

    Returns
    -------
    ndarray, shape (trials, 2^size)
        Log-likelihood, a constant for each trial left out.
    ndarray, shape (trials,)
        Value sent.
    """
    count = 2**size
    apart = np.abs(np.arange(count)[:, None] - np.arange(count)[None, :])
    covariance = np.asarray(common)[apart]
    sent = random.integers(count, size=trials)
    values, vectors = np.linalg.eigh(covariance)
    noise = random.normal(size=(trials, count)) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return covariance[sent] + noise, sent
