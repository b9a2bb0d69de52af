# SPDX-License-Identifier: Apache-2.0
"""
Syncs found in noise: how much more probable the pressure is with five pulses through a channel than without.

The channel's response is a Gaussian process of unknown size, the size of the noise is unknown as well: the marginal
likelihood of both over that of noise alone (R. E. Kass, A. E. Raftery, Bayes Factors, J. Am. Stat. Assoc. 90 (1995)
773). Pulses of unlike size are no sync: each of them must be there.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.pulse.channel_estimate import (
    BEFORE,
    SAMPLES_PER_TU,
    basis,
    coefficients,
    normal_equations,
    reconstruct,
)
from mwd_surface.receiver.pump_lines import pump_noise
from mwd_surface.receiver.whitening import filtered, steadiness, steady_filter

ORDER = 24
FLOOR = 1e-6
# Samples of the response that a search uses: what comes later adds more noise than signal to so few pulses.
RESPONSE = 30
_TAIL = 20
# Noise has a ratio beyond exp(x) with a probability below exp(-x) at each independent place, of which an hour has some
# ten thousand; 6 dB a bit give 20 in the mean, 9 in one case of fifty. What passes by chance costs a trial: the packets
# behind it decide whether it is a transmission.
_THRESHOLD = 8.0
# Soon after flow-on there is too little pressure before the sync to learn the noise from: pulses in it hide themselves,
# so that one with a score as low as this is taken out, and the noise learnt anew.
_PROMISING, _ROUNDS = 2.0, 2
# Energy of the five pulses over noise that is tried: 5 to 20 dB a bit.
_ENERGIES = (30.0, 100.0, 300.0, 1000.0)
# Chi square with 4 degrees of freedom of the pulses' sizes about their mean; the estimated response adds to it.
_UNLIKE = 30.0
# Log likelihood ratio up to which a pulse may rather be missing: noise has more once in a thousand syncs at 6 dB.
_MISSING = 6.0
# What a pulse says, over what the best known of the five does, from which on it is not disturbed nor in a data gap.
_KNOWN = 0.5
_MIDDLE = SAMPLES_PER_TU  # of a pulse of 2 TU behind its edge
_LEAST_NOISE = 200  # samples that a noise model needs
# Pumps that start move the mean of some samples by more than so many times its usual deviation, and settle.
_BLOCK, _MOVED = 16, 5.0


@dataclasses.dataclass(frozen=True)
class SyncFound:
    """
    A sync.

    Attributes
    ----------
    at : int
        Sample at which it starts in the data searched.
    score : float
        Log of its likelihood ratio.
    response : ndarray
        Of a pulse, Pa.
    scale : float
        Standard deviation of the coefficients of its components.
    whitener : ndarray
        Prediction error filter of the noise.
    settled : int
        Samples before it that are past the start of the pumps.
    other : SyncFound or None
        Next best one. A sync is like itself 15 TU later, three pulses of five: the words behind tell the true one.
    """

    at: int
    score: float
    response: Array
    scale: float
    whitener: Array
    settled: int
    other: SyncFound | None = None

    def later(self, samples: int) -> SyncFound:
        """Same, in data that begin so many samples earlier."""
        other = None if self.other is None else self.other.later(samples)
        return dataclasses.replace(self, at=self.at + samples, other=other)


def search(
    pressure: Array, known: Array, tool: ToolConfiguration, begin: int, end: int, whitener: Array | None = None
) -> SyncFound | None:
    """
    Best sync that starts at a sample of a range.

    Parameters
    ----------
    pressure, known : ndarray, shape (n,)
        Pa, `SAMPLES_PER_TU` samples a TU; 1 where a sample is known.
    tool : ToolConfiguration
        Its sync and its time unit.
    begin, end : int
        Range of its first sample. What comes before it teaches the noise.
    whitener : ndarray, optional
        Prediction error filter of the noise, where it is known better.

    Returns
    -------
    SyncFound or None
        None where nothing looks like one.
    """
    early = whitener is None and begin < _LEAST_NOISE
    moved = min(_settled(pressure), max(begin - BEFORE, 0)) if early else _settled(pressure[:begin])
    pressure, known, begin, end = pressure[moved:], known[moved:], begin - moved, end - moved
    pressure = pressure - pump_noise(pressure, known)
    if whitener is None:
        quiet = slice(0, begin if begin >= _LEAST_NOISE else len(pressure))
        whitener = steady_filter(pressure[quiet], known[quiet], ORDER, FLOOR)
    if whitener is None:
        return None
    first, *others = (*[_PROMISING] * _ROUNDS, _THRESHOLD) if early else (_THRESHOLD,)
    found = _found(pressure, known, tool, (begin, end), whitener, first)
    for least in others:
        found = None if found is None else _refined(pressure, known, tool, (begin, end), found, least)
    return None if found is None else found.later(moved)


def _refined(
    pressure: Array, known: Array, tool: ToolConfiguration, span: tuple[int, int], found: SyncFound, least: float
) -> SyncFound | None:
    """Sync found anew with noise learnt from the same pressure without the pulses found."""
    train, pulses = np.zeros(len(pressure)), np.empty(len(pressure))
    train[found.at + SAMPLES_PER_TU * np.array(tool.sync.edges_tu)] = 1.0
    reconstruct(train, found.response, pulses)
    whitener = steady_filter(pressure - pulses, known, ORDER, FLOOR)
    return None if whitener is None else _found(pressure, known, tool, span, whitener, least)


def _settled(pressure: Array) -> int:
    """Sample from which the pressure no longer moves as it does when pumps start, so that noise can be learnt."""
    count = len(pressure) // _BLOCK
    if len(pressure) <= _LEAST_NOISE:
        return 0
    means = pressure[: count * _BLOCK].reshape(count, _BLOCK).mean(axis=1)
    late = means[count // 2 :]
    off = np.abs(means - np.median(late)) > _MOVED * np.median(np.abs(late - np.median(late)))
    last = int(np.flatnonzero(off[: count // 2])[-1]) + 3 if off[: count // 2].any() else 0
    return min(last * _BLOCK, len(pressure) - _LEAST_NOISE)


def _found(
    pressure: Array, known: Array, tool: ToolConfiguration, span: tuple[int, int], whitener: Array, least: float
) -> SyncFound | None:
    """Best sync in pressure whose noise is known; span: range of its first sample; least: score."""
    begin, end = span
    whitened = np.empty(len(pressure))
    filtered(pressure, whitener, whitened)
    weight = steadiness(whitened, known)
    components = basis(RESPONSE, tool.tu_s)
    shapes = np.array([np.convolve(one, whitener)[: RESPONSE + _TAIL] for one in components])
    edges = SAMPLES_PER_TU * np.array(tool.sync.edges_tu)
    length = int(edges[-1]) + RESPONSE + _TAIL
    first = max(begin, BEFORE)
    last = min(end, len(pressure) - length)
    if last <= first:
        return None
    count = last - first
    score = _scores(whitened, weight, _columns(shapes, edges), first, count)
    best: list[SyncFound] = []
    for _ in range(2):
        at = int(np.argmax(score))
        if score[at] < least:
            break
        # The response is free, so the time is not: lay the largest pressure where a pulse has its middle.
        found = _fitted(whitened, weight, shapes, edges, first + at)
        early = int(np.argmax(np.abs(found[0] @ components))) - BEFORE - _MIDDLE
        moved = min(max(at + early, 0), count - 1)
        if moved != at:
            found = _fitted(whitened, weight, shapes, edges, first + moved)
        if not _alike(whitened, weight, found[0] @ shapes, edges, first + moved):
            break
        response = found[0] @ components
        place = first + moved
        best.append(SyncFound(place, float(score[moved]), response, found[1], whitener, place))
        for taken in (at, moved):
            score[max(taken - RESPONSE, 0) : taken + RESPONSE] = -np.inf
    return dataclasses.replace(best[0], other=best[-1] if len(best) > 1 else None) if best else None


def _columns(shapes: Array, edges: Array) -> Array:
    """Whitened pressure of all pulses of a sync for each component, from `BEFORE` its start; shape (c, samples)."""
    columns = np.zeros((len(shapes), int(edges[-1]) + shapes.shape[1]))
    for edge in edges:
        columns[:, edge : edge + shapes.shape[1]] += shapes
    return columns


def _scores(whitened: Array, weight: Array, columns: Array, first: int, count: int) -> Array:
    """Log likelihood ratio of a sync at each of `count` samples from `first` on."""
    length = columns.shape[1]
    span = slice(first - BEFORE, first + count + length - 1 - BEFORE)
    whitened, weight = whitened[span], weight[span]
    gram = np.empty((count, len(columns), len(columns)))
    folded = np.empty((count, len(columns)))
    for a, one in enumerate(columns):
        folded[:, a] = np.correlate(weight * whitened, one, mode="valid")
        for b in range(a + 1):
            gram[:, a, b] = gram[:, b, a] = np.correlate(weight, one * columns[b], mode="valid")
    # A weight says how large the noise of a sample is beside that of the others; so each that is known counts as one.
    total, samples = (np.convolve(x, np.ones(length), mode="valid") for x in (weight * whitened**2, weight > 0.0))
    score = np.empty(count)
    _ratios(gram, folded, np.maximum(total, 1e-9), samples, np.array(_ENERGIES) / np.sum(columns**2), score)
    return score


@compiled
def _ratios(gram: Array, folded: Array, total: Array, samples: Array, variances: Array, score: Array) -> None:
    """
    Fill the largest log likelihood ratio of some variances of the components, noise being 1.

    gram, folded, shapes (n, c, c), (n, c): normal equations at each place; total, samples, shape (n,): all the energy
    there, and of how many samples; score, shape (n,).
    """
    c = gram.shape[1]
    root, along = np.zeros((c, c)), np.zeros(c)
    for i in range(len(score)):
        score[i] = -np.inf
        for variance in variances:
            # Cholesky factor of the normal equations with their prior, and the energy that they explain.
            share, size = 0.0, c * np.log(variance)
            for a in range(c):
                for b in range(a + 1):
                    x = gram[i, a, b] + (1.0 / variance if a == b else 0.0)
                    for k in range(b):
                        x -= root[a, k] * root[b, k]
                    root[a, b] = x / root[b, b] if a > b else np.sqrt(x)
                along[a] = folded[i, a]
                for k in range(a):
                    along[a] -= root[a, k] * along[k]
                along[a] /= root[a, a]
                share += along[a] ** 2 / total[i]
                size += 2.0 * np.log(root[a, a])
            score[i] = max(score[i], -0.5 * size - 0.5 * samples[i] * np.log1p(-min(share, 0.999)))


def _fitted(whitened: Array, weight: Array, shapes: Array, edges: Array, at: int) -> tuple[Array, float]:
    """Coefficients of the response that fit a sync best, and their scale."""
    begin, end = at - BEFORE, at + int(edges[-1]) + shapes.shape[1]
    train = np.zeros(end - begin)
    train[BEFORE + edges] = 1.0
    matrix, right = np.empty((len(shapes), len(shapes))), np.empty(len(shapes))
    normal_equations(train, shapes, whitened[begin:end], weight[begin:end], matrix, right)
    scale = float(np.sqrt(len(shapes)) * np.linalg.norm(right) / np.trace(matrix))
    u = right
    for _ in range(5):
        u, scale, _ = coefficients(matrix, right, scale)
    return u, scale


def _alike(whitened: Array, weight: Array, response: Array, edges: Array, at: int) -> bool:
    """Whether the pulses of a sync that are known are there, two at least, with sizes that noise explains."""
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
    # Log likelihood ratio of no pulse to one, the others as fitted, which hardly overlap it.
    missing = -np.diag(gram) * (0.5 + apart)
    # What a stall adds to a pulse is no white noise: of how large a disturbed one is, nothing is known.
    apart = np.where(known, apart, 0.0)
    return bool(missing.max() < _MISSING * noise and apart @ gram @ apart < _UNLIKE * noise)
