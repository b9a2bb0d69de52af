# SPDX-License-Identifier: Apache-2.0
"""
Search for syncs in noise: the likelihood of the pressure with five pulses through a channel, against noise alone.

The channel response is a Gaussian process of unknown size, and the size of the noise is unknown as well; the score is
the ratio of the marginal likelihoods (R. E. Kass, A. E. Raftery, Bayes Factors, J. Am. Stat. Assoc. 90 (1995) 773).
One of the five pulses may be missing, with the probability with which a pulse of a word is missing. Pulses of unequal
size are not accepted as a sync.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pulse.channel_estimate import (
    BEFORE,
    SAMPLES_PER_TU,
    basis,
    coefficients,
    normal_equations,
    pulse_columns,
    reconstruct,
    whitened_responses,
)
from mwd_surface.receiver.pulse.segment import MISSING
from mwd_surface.receiver.pump_lines import pump_noise
from mwd_surface.receiver.whitening import FLOOR, SEARCH_ORDER, correlated, filtered, median, steadiness, steady_filter

# Samples of the response used in a search; later ones add more noise than signal with so few pulses.
RESPONSE = 30
_TAIL = 20  # samples by which whitening lengthens the response
# Noise exceeds a score x with a probability below exp(-x) at each independent place; an hour has about ten thousand
# places. At 6 dB per bit a sync scores 20 on average and 9 in one case of fifty. A false sync costs a trial: the
# packets after it decide whether it is a transmission.
THRESHOLD = 8.0
# Threshold where a sync is expected, which is lower because only a few hundred places follow each flow-on.
EXPECTED_THRESHOLD = 3.5
# Soon after flow-on there is little pressure before the sync, so its pulses are partly taken for noise. A candidate
# with at least the score _PROMISING is subtracted and the noise is estimated again, _ROUNDS times.
_PROMISING, _ROUNDS = 2.0, 2
# Ratios of the energy of the five pulses to the noise that are tried: 5 to 20 dB per bit.
_ENERGIES = (30.0, 100.0, 300.0, 1000.0)
# Limit on the chi square (4 degrees of freedom) of the pulse sizes about their mean; the estimated response adds to it.
_UNLIKE = 30.0
# Log likelihood ratio above which a pulse of the sync counts as missing. At 6 dB, noise alone exceeds this limit in one
# of a thousand syncs.
_MISSING = 6.0
# A pulse counts as disturbed, or as lost in a data gap, if its weighted energy is at most this share of the largest one
# of the five pulses.
_KNOWN = 0.5
_MIDDLE = SAMPLES_PER_TU  # samples from the edge of a 2 TU pulse to its middle
_LEAST_NOISE = 200  # smallest number of samples for a noise model
# Samples of a block, and shift of a block mean, in usual deviations, above which the pumps are starting.
_BLOCK, _MOVED = 16, 5.0


@dataclasses.dataclass(frozen=True)
class SyncFound:
    """A sync that was found."""

    at: int  #: sample at which the sync starts in the data searched
    score: float  #: log likelihood ratio of the sync
    sent: tuple[bool, ...]  #: which of its pulses were sent: all of them, or all but one
    response: Array  #: response to a pulse, Pa
    scale: float  #: standard deviation of the coefficients of its components
    whitener: Array  #: prediction error filter of the noise
    settled: int  #: number of samples between the start of the pumps and the sync
    #: Next best sync. A sync resembles itself shifted by 15 TU (three of five pulses); the words after it decide.
    other: SyncFound | None = None

    def later(self, samples: int) -> SyncFound:
        """Return the same sync for data that begin the given number of samples earlier."""
        other = None if self.other is None else self.other.later(samples)
        return dataclasses.replace(self, at=self.at + samples, other=other)


def search(
    pressure: Array,
    known: Array,
    tool: ToolConfiguration,
    begin: int,
    end: int,
    whitener: Array | None = None,
    angles: Array | None = None,
    least: float = THRESHOLD,
) -> SyncFound | None:
    """
    Find the best sync that starts within a range of samples.

    Parameters
    ----------
    pressure, known : ndarray, shape (n,)
        Pa, `SAMPLES_PER_TU` samples per TU; 1 where a sample is known.
    tool : ToolConfiguration
        Gives the sync and the time unit.
    begin, end : int
        Range of the first sample of the sync; the data before it give the noise model.
    whitener : ndarray, optional
        Prediction error filter of the noise during a transmission. If it is given, only syncs with all pulses are
        found, because the pulses of words often look like a sync without one pulse.
    angles : ndarray, shape (pumps, n), optional
        Crank angles of pumps with stroke counters, rad.
    least : float
        Lowest score of a sync.

    Returns
    -------
    SyncFound or None
        None if no sync has the score `least`, or if the noise cannot be modelled.
    """
    early, complete = whitener is None and begin < _LEAST_NOISE, whitener is not None
    moved = min(_settled(pressure), max(begin - BEFORE, 0)) if early else _settled(pressure[:begin])
    pressure, known, begin, end = pressure[moved:], known[moved:], begin - moved, end - moved
    angles = None if angles is None else angles[:, moved:]
    pressure = pressure - pump_noise(pressure, known, angles=angles)[0].pressure
    if whitener is None:
        quiet = slice(0, begin if begin >= _LEAST_NOISE else len(pressure))
        whitener = steady_filter(pressure[quiet], known[quiet], SEARCH_ORDER, FLOOR)
    if whitener is None:
        return None
    first, *others = (*[_PROMISING] * _ROUNDS, least) if early else (least,)
    found = _found(pressure, known, tool, (begin, end), whitener, first, complete)
    for one in others:
        found = None if found is None else _refined(pressure, known, tool, (begin, end), found, one)
    return None if found is None else found.later(moved)


def _refined(
    pressure: Array, known: Array, tool: ToolConfiguration, span: tuple[int, int], found: SyncFound, least: float
) -> SyncFound | None:
    """
    Find the sync again, with the noise model of the pressure without the pulses that were found first.

    Returns None if there is no noise model or no sync with the score `least`.
    """
    train = np.zeros(len(pressure))
    train[found.at + SAMPLES_PER_TU * np.array(tool.sync.edges_tu)] = found.sent
    whitener = steady_filter(pressure - reconstruct(train, found.response), known, SEARCH_ORDER, FLOOR)
    return None if whitener is None else _found(pressure, known, tool, span, whitener, least, False)


def _settled(pressure: Array) -> int:
    """
    Return the sample after which the pressure no longer moves as when pumps start, so that noise can be modelled.

    At least `_LEAST_NOISE` samples are left after it; 0 if there are not more.
    """
    count = len(pressure) // _BLOCK
    if len(pressure) <= _LEAST_NOISE:
        return 0
    means = pressure[: count * _BLOCK].reshape(count, _BLOCK).mean(axis=1)
    late = means[count // 2 :]
    middle = median(late)
    off = np.abs(means - middle) > _MOVED * median(np.abs(late - middle))
    last = int(np.flatnonzero(off[: count // 2])[-1]) + 3 if off[: count // 2].any() else 0
    return min(last * _BLOCK, len(pressure) - _LEAST_NOISE)


def _found(
    pressure: Array,
    known: Array,
    tool: ToolConfiguration,
    span: tuple[int, int],
    whitener: Array,
    least: float,
    complete: bool,
) -> SyncFound | None:
    """
    Return the best sync with a known noise model, and its next best as `other`; None if no sync has the score `least`.

    span: range of the first sample of the sync. whitener: noise model. complete: whether no pulse may be missing.
    """
    begin, end = span
    whitened = filtered(pressure, whitener)
    weight = steadiness(whitened, known)
    components = basis(RESPONSE, tool.tu_s)
    shapes = whitened_responses(components, whitener, RESPONSE + _TAIL)
    edges = SAMPLES_PER_TU * np.array(tool.sync.edges_tu)
    whole = np.ones(len(edges), dtype=bool)
    every = _columns(shapes, edges, whole)
    first = max(begin, BEFORE)
    last = min(end, len(pressure) - len(every))
    if last <= first:
        return None
    count = last - first
    score = _scores(whitened[first - BEFORE :], weight[first - BEFORE :], every, count)
    best: list[SyncFound] = []
    for _ in range(2):
        at = int(np.argmax(score))
        if score[at] < least:
            break
        sent, gained = (whole, 0.0) if complete else _sent(whitened, weight, shapes, edges, first + at)
        columns = _columns(shapes, edges, sent)
        # The response is free, so its time shift is ambiguous: align its largest pressure with the middle of a pulse.
        found = _fitted(whitened, weight, columns, first + at - BEFORE)
        early = int(np.argmax(np.abs(found[0] @ components))) - BEFORE - _MIDDLE
        moved = min(max(at + early, 0), count - 1)
        if moved != at:
            found = _fitted(whitened, weight, columns, first + moved - BEFORE)
        # The aligned start may be that of a sync found earlier, whose score is already removed.
        if score[moved] == -np.inf or not _alike(whitened, weight, found[0] @ shapes, edges[sent], first + moved):
            break
        response = found[0] @ components
        place = first + moved
        best.append(
            SyncFound(place, float(score[moved]) + gained, tuple(sent.tolist()), response, found[1], whitener, place)
        )
        for taken in (at, moved):
            score[max(taken - RESPONSE, 0) : taken + RESPONSE] = -np.inf
    return dataclasses.replace(best[0], other=best[-1] if len(best) > 1 else None) if best else None


def _sent(whitened: Array, weight: Array, shapes: Array, edges: Array, at: int) -> tuple[NDArray[np.bool_], float]:
    """
    Return which pulses of a sync were sent: all, or all except one, whichever case is more probable.

    Also return the log of the ratio of the probability of this case to that of all pulses; 0 if all were sent.

    edges: first samples of the pulses after the start of the sync, which is the sample `at`.
    """
    cases = np.concatenate([np.ones((1, len(edges)), dtype=bool), ~np.eye(len(edges), dtype=bool)])
    here = slice(at - BEFORE, at - BEFORE + int(edges[-1]) + shapes.shape[1])
    prior = np.where(cases.all(axis=1), 1.0 - len(edges) * MISSING, MISSING)
    pressures = (_columns(shapes, edges, sent) for sent in cases)
    scores = np.log(prior) + [_scores(whitened[here], weight[here], one, 1)[0] for one in pressures]
    best = int(np.argmax(scores))
    return cases[best], float(scores[best] - scores[0])


def _columns(shapes: Array, edges: Array, sent: NDArray[np.bool_]) -> Array:
    """
    Return the whitened pressure of the pulses of a sync that were sent, for each component, shape (samples, c).

    The first sample is `BEFORE` samples before the start of the sync.
    """
    train = np.zeros(int(edges[-1]) + shapes.shape[1])
    train[BEFORE + edges] = sent
    return pulse_columns(train, shapes)


@compiled
def _scores(whitened: Array, weight: Array, columns: Array, count: int) -> Array:
    """
    Return the log likelihood ratio of a sync at each of the first `count` places, the largest of several prior sizes.

    whitened, weight, shape (n,): pressure and the weights of its samples; columns, shape (k, c): pressure of a sync
    from each place on for each component, as in `_columns`.
    """
    length, c = columns.shape
    gram, folded, weighted = np.empty((c, c, count)), np.empty((c, count)), weight * whitened
    # Most weights are 1, so subtract what the others lack.
    lacking = np.flatnonzero(weight[: count + length - 1] < 1.0)
    for a in range(c):
        folded[a] = correlated(weighted, columns[:, a].copy(), count)
        for b in range(a + 1):
            product = columns[::-1, a] * columns[::-1, b]
            gram[a, b] = product.sum()
            for j in lacking:
                first, end = max(j + 1 - length, 0), min(j + 1, count)
                share, out, part = 1.0 - weight[j], gram[a, b, first:end], product[length - 1 - j + first :]
                for i in range(end - first):
                    out[i] -= share * part[i]
    ones, size = np.ones(length), np.sum(columns**2)
    total = np.maximum(correlated(weighted * whitened, ones, count), 1e-9)
    # A weight states the noise of a sample relative to the others, so each known sample counts as one.
    samples = correlated(np.where(weight > 0.0, 1.0, 0.0), ones, count)
    score = np.full(count, -np.inf)
    for energy in _ENERGIES:
        _raise(score, gram, folded, size / energy, total, samples)
    return score


@compiled
def _raise(score: Array, gram: Array, folded: Array, precision: float, total: Array, samples: Array) -> None:
    """
    Raise the log likelihood ratio at each place to its value for one prior precision of the components, noise being 1.

    gram, folded, shapes (c, c, n), (c, n): normal equations at each place; total, samples, shape (n,): total energy at
    each place and the number of its samples; score, shape (n,): changed.
    """
    c, n = folded.shape
    root, along, pivot = np.empty((c, c, n)), folded.copy(), np.empty((c, n))
    share, ratio = np.zeros(n), np.ones(n)
    # Cholesky factor of the normal equations with their prior (L D L'), and the energy they explain; all places at
    # once, so that the compiler works on several of them at a time.
    for a in range(c):
        for b in range(a):
            root[a, b] = gram[a, b]
            for k in range(b):
                for i in range(n):
                    root[a, b, i] -= root[a, k, i] * root[b, k, i] * pivot[k, i]
            for i in range(n):
                root[a, b, i] /= pivot[b, i]
        for i in range(n):
            pivot[a, i] = gram[a, a, i] + precision
        for k in range(a):
            for i in range(n):
                pivot[a, i] -= root[a, k, i] * root[a, k, i] * pivot[k, i]
                along[a, i] -= root[a, k, i] * along[k, i]
        for i in range(n):
            share[i] += along[a, i] * along[a, i] / (pivot[a, i] * total[i])
            ratio[i] *= pivot[a, i] / precision
    for i in range(n):
        one = -0.5 * math.log(ratio[i]) - 0.5 * samples[i] * math.log1p(-min(share[i], 0.999))
        score[i] = max(score[i], one)


def _fitted(whitened: Array, weight: Array, columns: Array, begin: int) -> tuple[Array, float]:
    """Return the response coefficients that fit a sync best, and their scale; columns: as in `_scores`."""
    here = slice(begin, begin + len(columns))
    matrix, right = normal_equations(columns, whitened[here], weight[here])
    scale = float(np.sqrt(len(right)) * np.linalg.norm(right) / np.trace(matrix))
    u = right
    for _ in range(5):
        u, scale, _ = coefficients(matrix, right, scale)
    return u, scale


def _alike(whitened: Array, weight: Array, response: Array, edges: Array, at: int) -> bool:
    """Return whether all known pulses of a sync, at least two, are present with sizes that agree within the noise."""
    count = len(edges)
    columns = np.zeros((int(edges[-1]) + len(response), count))
    for k, edge in enumerate(edges):
        columns[edge : edge + len(response), k] = response
    here = slice(at - BEFORE, at - BEFORE + len(columns))
    whitened, weighted = whitened[here], columns.T * weight[here]
    left = whitened - columns.sum(axis=1)
    noise = float(weight[here] @ left**2 / max(np.count_nonzero(weight[here]), 1))
    gram = weighted @ columns
    apart = np.linalg.solve(gram + 1e-9 * np.trace(gram) * np.eye(count), weighted @ left)
    known = np.diag(gram) > _KNOWN * np.diag(gram).max()
    if np.count_nonzero(known) < 2:
        return False
    # Log likelihood ratio of a missing pulse, with the other pulses as fitted, which hardly overlap it.
    missing = -np.diag(gram) * (0.5 + apart)
    # A stall adds an unknown amount to a pulse, unlike white noise, so disturbed pulses are not compared.
    apart = np.where(known, apart, 0.0)
    return bool(missing.max() < _MISSING * noise and apart @ gram @ apart < _UNLIKE * noise)
