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
_LEAST_SIZE = 0.1  # at 6 dB a size has a sigma of a quarter
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
    """

    at: int
    score: float
    response: Array
    scale: float
    whitener: Array
    settled: int


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
    moved, early = 0, whitener is None and begin < _LEAST_NOISE
    if early:
        moved = min(_settled(pressure), max(begin - BEFORE, 0))
    elif whitener is None:
        moved = _settled(pressure[:begin])
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
    return None if found is None else dataclasses.replace(found, at=found.at + moved)


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
    # A disturbed sample counts as its weight, on either side of the ratio.
    whitened *= np.sqrt(steadiness(whitened, known))
    components = basis(RESPONSE, tool.tu_s)
    shapes = np.array([np.convolve(one, whitener)[: RESPONSE + _TAIL] for one in components])
    edges = SAMPLES_PER_TU * np.array(tool.sync.edges_tu)
    length = int(edges[-1]) + RESPONSE + _TAIL
    first = max(begin, BEFORE)
    last = min(end, len(pressure) - length)
    if last <= first:
        return None
    count = last - first
    explained, total, score = _explained(whitened, shapes, edges, first, count)
    freedom = len(shapes)
    at = int(np.argmax(score))
    if score[at] < least:
        return None
    # The response is free, so the time is not: lay the largest pressure where a pulse has its middle.
    found = _fitted(whitened, shapes, edges, first + at)
    early = int(np.argmax(np.abs(found[0] @ components))) - BEFORE - _MIDDLE
    moved = min(max(at + early, 0), count - 1)
    if moved != at:
        at, found = moved, _fitted(whitened, shapes, edges, first + moved)
    noise = float((total[at] - explained[at]) / (length - freedom))
    if not _alike(whitened, found[0] @ shapes, edges, first + at, noise):
        return None
    response = found[0] @ components
    return SyncFound(first + at, float(score[at]), response, found[1], whitener, first + at)


def _explained(whitened: Array, shapes: Array, edges: Array, first: int, count: int) -> tuple[Array, Array, Array]:
    """Energy that a sync explains at each of `count` samples from `first` on, all the energy there, and the score."""
    length = int(edges[-1]) + RESPONSE + _TAIL
    span = whitened[first - BEFORE : first + count + length - BEFORE]
    # Correlation with each component at each sample, summed over the pulses.
    folded = np.zeros((len(shapes), count))
    for k, shape in enumerate(shapes):
        one = np.correlate(span, shape, mode="valid")
        for edge in edges:
            folded[k] += one[edge : edge + count]
    matrix = _energies(shapes, edges, length)
    squares = np.concatenate([[0.0], np.cumsum(span**2)])
    total = np.maximum(squares[length : length + count] - squares[:count], 1e-9)
    values, vectors = np.linalg.eigh(matrix)
    along = (vectors.T @ folded) ** 2
    # A weak prior keeps components that the pulses hardly see from being fitted to noise.
    explained = np.sum(along / (values + 0.02 * values.mean())[:, None], axis=0)
    score = np.full(count, -np.inf)
    for energy in _ENERGIES:
        variance = energy / values.sum()
        share = np.sum(along / (values + 1.0 / variance)[:, None], axis=0) / total
        ratio = -0.5 * np.log1p(variance * np.maximum(values, 0.0)).sum() - 0.5 * length * np.log1p(
            -np.minimum(share, 0.999)
        )
        score = np.maximum(score, ratio)
    return explained, total, score


def _energies(shapes: Array, edges: Array, length: int) -> Array:
    train = np.zeros(length + BEFORE)
    train[BEFORE + edges] = 1.0
    matrix, right = np.empty((len(shapes), len(shapes))), np.empty(len(shapes))
    normal_equations(train, shapes, train, np.ones(len(train)), matrix, right)
    return matrix


def _fitted(whitened: Array, shapes: Array, edges: Array, at: int) -> tuple[Array, float]:
    """Coefficients of the response that fit a sync best, and their scale."""
    begin, end = at - BEFORE, at + int(edges[-1]) + shapes.shape[1]
    train = np.zeros(end - begin)
    train[BEFORE + edges] = 1.0
    matrix, right = np.empty((len(shapes), len(shapes))), np.empty(len(shapes))
    normal_equations(train, shapes, whitened[begin:end], np.ones(end - begin), matrix, right)
    scale = float(np.sqrt(len(shapes)) * np.linalg.norm(right) / np.trace(matrix))
    u = right
    for _ in range(5):
        u, scale, _ = coefficients(matrix, right, scale)
    return u, scale


def _alike(whitened: Array, response: Array, edges: Array, at: int, noise: float) -> bool:
    """Whether all pulses of a sync are there, with sizes that noise explains."""
    count = len(edges)
    begin = at - BEFORE
    columns = np.zeros((int(edges[-1]) + len(response), count))
    for k, edge in enumerate(edges):
        columns[edge : edge + len(response), k] = response
    gram = columns.T @ columns
    sizes = np.linalg.solve(
        gram + 1e-9 * np.trace(gram) * np.eye(count), columns.T @ whitened[begin : begin + len(columns)]
    )
    apart = sizes - sizes.mean()
    return bool(sizes.min() > _LEAST_SIZE and apart @ gram @ apart < _UNLIKE * noise)
