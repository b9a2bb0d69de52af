# SPDX-License-Identifier: Apache-2.0
"""
Soft decisions on packets: the forward-backward algorithm over the packets of some words, parity included.

A packet is a window of time with one pulse; the place of the pulse gives the value of the packet.

The metric is Ungerboeck's: the output of the matched filter at a place, minus half the energy of a pulse, minus the
energy that pulses have in common. The previous pulse is a state of the trellis and enters exactly; pulses farther away
enter by their mean.
Sources: G. Ungerboeck, IEEE Trans. Commun. 22 (1974) 624; L. Bahl et al., IEEE Trans. Inf. Theory 20 (1974) 284.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled

_VALUES = 8  # number of values of a packet of 3 bits
START, BITS, ENDS, PARITY, COUNT = range(5)  # columns of a row of packets
NEVER = -1e30  #: log probability of an impossible path


@compiled
def log_sum(logs: Array) -> float:
    """Return the logarithm of the sum of exponentials; `NEVER` if all are impossible."""
    top = NEVER
    for one in logs:
        top = max(top, one)
    if top <= NEVER:
        return NEVER
    total = 0.0
    for one in logs:
        total += math.exp(one - top)
    return top + math.log(total)


def uniform(packets: Indices) -> Array:
    """Return equal probabilities for all values of each packet; shape (n, values)."""
    at = np.arange(_VALUES)[None, :]
    return np.where(at < packets[:, COUNT, None], 1.0 / packets[:, COUNT, None], 0.0)


def places_of(packets: Indices) -> Indices:
    """Return the place of each packet value, TU; shape (n, values). Columns after the last value repeat its place."""
    return np.asarray(packets[:, START, None] + np.maximum(packets[:, COUNT, None] - 1 - np.arange(_VALUES), 0))


@compiled
def _odd(value: int) -> int:
    return (value ^ (value >> 1) ^ (value >> 2)) & 1


@compiled
def _pair(common: Array, gap: int, level: float) -> float:
    """Return the common energy of two pulses `gap` TU apart times `level`; 0 if they are too far apart to overlap."""
    return float(level * common[gap]) if gap < len(common) else 0.0


@compiled
def place(packets: Indices, k: int, value: int) -> int:
    """Return the place of the pulse of packet k for a value, TU."""
    return int(packets[k, 0] + packets[k, 4] - 1 - value)


@compiled
def step_metric(packets: Indices, unary: Array, common: Array, level: Array, k: int, before: int, value: int) -> float:
    """Return the metric of a value given the previous packet's value."""
    metric = float(unary[k, value])
    if k > 0:
        at = place(packets, k, value)
        last = place(packets, k - 1, before)
        metric -= _pair(common, at - last, math.sqrt(level[k] * level[k - 1]))
    return metric


@compiled
def forward_backward(packets: Indices, unary: Array, common: Array, level: Array, parity: int) -> tuple[Array, Array]:
    """
    Return the log sums of all paths that lead to each state and from each state.

    Parameters
    ----------
    packets : ndarray, shape (n, 5)
        Columns: start of the window in TU; bits; whether a word ends with the packet; whether that word has a parity
        bit; number of values, which count from the end of the window.
    unary : ndarray, shape (n, values)
        Metric of each value by itself.
    common : ndarray, shape (m,)
        Common energy of two pulses, by their distance in TU.
    level : ndarray, shape (n,)
        Weight of the data around the packet, 0 to 1.
    parity : int
        0: words have an even number of ones, 1: odd, -1: parity is not used.

    Returns
    -------
    ndarray, shape (n, 2 values)
        Log sums of the paths to each state; state = 2 value + parity of the word up to this packet.
    ndarray, shape (n, 2 values)
        Log sums of the paths from each state.
    """
    forward = _forward(packets, unary, common, level, parity)
    return forward, _backward(packets, unary, common, level, forward)


@compiled
def _forward(packets: Indices, unary: Array, common: Array, level: Array, parity: int) -> Array:
    forward, logs = np.full((len(packets), 2 * unary.shape[1]), NEVER), np.empty((unary.shape[1], 2))
    for value in range(packets[0, 4]):
        if _holds(packets, parity, 0, _odd(value)):
            forward[0, 2 * value + _odd(value)] = unary[0, value]
    for k in range(1, len(packets)):
        count = packets[k - 1, 4]
        for value in range(packets[k, 4]):
            for before in range(count):
                metric = step_metric(packets, unary, common, level, k, before, value)
                for odd in range(2):
                    logs[before, odd] = forward[k - 1, 2 * before + odd] + metric
                if packets[k - 1, 2] == 1:
                    # A word begins with no ones, whatever the word before had.
                    logs[before, 0], logs[before, 1] = log_sum(logs[before]), NEVER
            for odd in range(2):
                new = odd ^ _odd(value)
                if _holds(packets, parity, k, new):
                    forward[k, 2 * value + new] = log_sum(logs[:count, odd])
    return forward


@compiled
def _backward(packets: Indices, unary: Array, common: Array, level: Array, forward: Array) -> Array:
    backward, logs = np.where(forward > NEVER, 0.0, NEVER), np.empty((unary.shape[1], 2))
    for k in range(len(packets) - 2, -1, -1):
        count, fresh = packets[k + 1, 4], packets[k, 2] == 1
        for before in range(packets[k, 4]):
            for value in range(count):
                metric = step_metric(packets, unary, common, level, k + 1, before, value)
                for odd in range(2):
                    after = 2 * value + ((0 if fresh else odd) ^ _odd(value))
                    logs[value, odd] = backward[k + 1, after] + metric
            for odd in range(2):
                # A state that no path reaches stays impossible.
                backward[k, 2 * before + odd] += log_sum(logs[:count, odd])
    return backward


@compiled
def _holds(packets: Indices, parity: int, k: int, odd: int) -> bool:
    """Return whether a word may have an odd (1) or even (0) number of ones up to packet k, by its parity."""
    return parity < 0 or packets[k, 2] == 0 or packets[k, 3] == 0 or odd == parity


@compiled
def marginals(packets: Indices, forward: Array, backward: Array) -> tuple[Array, Array, float]:
    """
    Return the probabilities of each packet value, and of an even number of ones up to each packet in its word.

    Parameters
    ----------
    packets, forward, backward
        As in `forward_backward`.

    Returns
    -------
    ndarray, shape (n, values)
        Probability of each value.
    ndarray, shape (n,)
        Probability that the word up to the packet has an even number of ones.
    float
        Log sum of all paths: the evidence of the data.
    """
    n, values = len(packets), forward.shape[1] // 2
    out, even = np.zeros((n, values)), np.empty(n)
    evidence = log_sum(forward[n - 1])
    for k in range(n):
        total = whole = 0.0
        for state in range(forward.shape[1]):
            if forward[k, state] > NEVER and backward[k, state] > NEVER:
                p = math.exp(min(forward[k, state] + backward[k, state] - evidence, 0.0))
                out[k, state // 2] += p
                whole += p
                total += p if state % 2 == 0 else 0.0
        for value in range(values):
            out[k, value] /= max(whole, 1e-300)
        even[k] = total / max(whole, 1e-300)
    return out, even, evidence


@compiled
def best_words(
    packets: Indices,
    unary: Array,
    common: Array,
    level: Array,
    forward: Array,
    backward: Array,
    first: int,
    beam: int,
) -> Array:
    """
    Return the most probable codes of one word, parity bit included.

    Parameters
    ----------
    packets, unary, common, level, forward, backward
        As in `forward_backward`.
    first : int
        First packet of the word.
    beam : int
        Largest number of codes.

    Returns
    -------
    ndarray, shape (codes, 2)
        Codes and log probabilities (not normalised by the evidence), best first.
    """
    out = np.empty((beam, 2))
    # Columns: value of the last packet, parity and code so far, log sum of the paths so far.
    rows, count, k = np.zeros((beam, 4)), 1, first
    while True:
        size = packets[k, 1]
        reach, total = np.empty(count << size), np.empty(count << size)
        for at in range(count << size):
            row, value = at >> size, at & ((1 << size) - 1)
            if k > first:
                reach[at] = rows[row, 3] + step_metric(packets, unary, common, level, k, int(rows[row, 0]), value)
            else:
                reach[at] = _entry(packets, unary, common, level, forward, k, value)
            after = backward[k, 2 * value + (int(rows[row, 1]) ^ _odd(value))]
            total[at] = reach[at] + after if after > NEVER else NEVER
        order = np.argsort(-total)
        kept = np.zeros((beam, 4))
        made = 0
        while made < min(beam, len(order)) and total[order[made]] > NEVER:
            at = order[made]
            row, value = at >> size, at & ((1 << size) - 1)
            kept[made, 0] = value
            kept[made, 1] = int(rows[row, 1]) ^ _odd(value)
            kept[made, 2] = int(rows[row, 2]) << size | value
            kept[made, 3] = reach[at]
            out[made, 0] = kept[made, 2]
            out[made, 1] = total[at]
            made += 1
        rows, count = kept, made
        if packets[k, 2] == 1 or made == 0:
            return out[:count]
        k += 1


@compiled
def _entry(packets: Indices, unary: Array, common: Array, level: Array, forward: Array, k: int, value: int) -> float:
    """Return the log sum of all paths to a value of the first packet of a word."""
    if k == 0:
        return float(unary[k, value])
    logs = forward[k - 1].copy()
    for state in range(len(logs)):
        if logs[state] > NEVER:
            logs[state] += step_metric(packets, unary, common, level, k, state // 2, value)
    return log_sum(logs)
