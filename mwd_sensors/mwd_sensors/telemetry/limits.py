"""
Closed-form limits of the codes in white Gaussian noise: what no receiver can beat, for tests, benchmarks and planning.

Eb / N0 counts every bit on air, parity included.
Sources: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008: union bound (4.2-70), BPSK and QPSK (4.3-13),
DPSK (4.5-12).
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
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


def bpsk_bit_error(ebn0_db: float) -> float:
    """Bit error probability of BPSK, and of QPSK with Gray mapping."""
    return 0.5 * math.erfc(math.sqrt(ratio(ebn0_db)))


def dpsk_bit_error(ebn0_db: float) -> float:
    """Bit error probability of binary DPSK decided from two neighbouring symbols."""
    return 0.5 * math.exp(-ratio(ebn0_db))


def soft_word_error(ebn0_db: float, bits: int, trials: int = 20000, seed: int = 0) -> float:
    """
    Error probability of a word with even parity, the most likely of all words that hold it being taken.

    The best of all words with even parity has no closed form: drawn by chance, 1 sigma sqrt(p (1 - p) / trials).
    """
    random = np.random.default_rng(seed)
    right = np.zeros(trials)
    # Best metric of all words but the right one so far, by whether their parity differs from the right word's.
    wrong = np.full((2, trials), -np.inf)
    for size in packets(bits):
        metric, sent = packet_metrics(random, ebn0_db, size, trials)
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


def packet_metrics(random: np.random.Generator, ebn0_db: float, size: int, trials: int) -> tuple[Array, Indices]:
    """
    Draw the log-likelihood of each value of a packet of `size` bits, and the value sent.

    Returns
    -------
    ndarray, shape (trials, 2^size)
        Log-likelihood, a constant for each trial left out.
    ndarray, shape (trials,)
        Value sent.
    """
    count = 2**size
    energy = 2.0 * size * ratio(ebn0_db)
    sent = random.integers(count, size=trials)
    # What is integrated over each TU, of unit noise: a pulse lies in two of them.
    cells = random.normal(size=(trials, count + 1))
    rows = np.arange(trials)
    for half in (0, 1):
        cells[rows, count - 1 - sent + half] += math.sqrt(0.5 * energy)
    places = math.sqrt(0.5 * energy) * (cells[:, :-1] + cells[:, 1:])
    return places[:, ::-1], sent
