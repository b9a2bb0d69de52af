# SPDX-License-Identifier: Apache-2.0
"""
Decoder of a stretch of a transmission: it finds packets and noise together, with the channel of the other pulses.

It alternates the forward-backward algorithm over the packets with a new noise model. The packets are those of the next
words or, when a pass of a sequence is complete, those of all its words again, each word being a group. The channel of a
group is estimated from the sync and the packets before and after the group, never from the pressure of the group
itself.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry.pulse_position import GAP_TU
from mwd_surface.receiver.pulse import trellis
from mwd_surface.receiver.pulse.channel_estimate import (
    BEFORE,
    LAGS,
    SAMPLES_PER_TU,
    coefficients,
    common_energy,
    matched,
    normal_equations,
    place_pairs,
    pulse_columns,
    pulse_places,
    reconstruct,
    spread,
    whitened_responses,
)
from mwd_surface.receiver.pump_lines import Crank, PumpNoise, lines, pump_noise
from mwd_surface.receiver.whitening import FLOOR, ORDER, correlated, filtered, precision, prediction_error_filter

_ROUNDS = 3
# Samples by which whitening lengthens the response; at most `SEARCH_ORDER`, the order of the first noise model. With 60
# samples as many words are right, and with 0 samples a word in stalls becomes wrong.
_TAIL = 24
_FEW = 1e-4  # a smaller expected number of pulses at a place counts as 0
# Prior probability that the pulse of a packet is missing, and probability that its window holds a second pulse.
MISSING, _EXTRA = 0.003, 0.0005
_ENOUGH = 20.0  # number of pulses that suffice to estimate a response without the response from before an interruption


@dataclasses.dataclass
class ChannelEstimate:
    """Estimate of the channel."""

    response: Array  #: shape (m,); response to a pulse, Pa, from `BEFORE` samples before its edge
    scale: float  #: standard deviation of the coefficients of its components
    whitener: Array  #: prediction error filter of the noise
    components: Array  #: shape (c, m); components of the response (`channel_estimate.basis`)
    memory: float  #: 1 sigma of the average over the pump lines, samples
    #: Coefficients of the components and their precision, from the pulses of the last stretch.
    posterior: tuple[Array, Array] | None = None


@dataclasses.dataclass(frozen=True)
class StretchOnToolClock:
    """Data and packets of one stretch on the clock of the tool: `SAMPLES_PER_TU` samples per TU."""

    #: `pressure`, `known`: shape (n,); pressure, Pa; 1 where a sample is known.
    pressure: Array
    known: Array
    pulses: Array  #: shape (j, 3); pulses before the packets, as in `channel_estimate.place_pairs`
    packets: Indices  #: shape (k, 5); packets, as in `trellis.forward_backward`; starts in TU after `start`
    #: Shape (g, 3); groups of packets; the response for a group is estimated without the pressure of that group.
    #: Columns: number of the first packet; first place and place after the last, TU after `start`.
    groups: Indices
    start: int  #: sample of TU 0 of the packets
    parity: int  #: parity of the words: 0 even, 1 odd
    probability: Array | None = None  #: shape (k, values); probability of each packet value from an earlier decoding
    angles: Array | None = None  #: shape (pumps, n); crank angles of pumps with stroke counters, rad
    #: Coefficients and precision of the response from before an interruption, if too few pulses precede this stretch.
    carried: tuple[Array, Array] | None = None
    missing: float = MISSING  #: probability that the pulse of a packet is missing
    #: First sample of the sync before the packets, and the sample after it, to measure the size of its pulses.
    sync: tuple[int, int] | None = None

    @functools.cached_property
    def places(self) -> Indices:
        """Place of each packet value, TU after `start`; shape (k, values)."""
        return trellis.places_of(self.packets)

    @functools.cached_property
    def own(self) -> list[slice]:
        """Return the range of samples that belongs to each group of packets."""
        return [
            slice(max(self.start + SAMPLES_PER_TU * int(begin) - BEFORE, 0), self.start + SAMPLES_PER_TU * int(end))
            for _, begin, end in self.groups
        ]

    @functools.cached_property
    def members(self) -> list[slice]:
        """Packets of each group."""
        return [slice(*ends) for ends in itertools.pairwise([*self.groups[:, 0], len(self.packets)])]

    def per_packet(self, values: Sequence[float] | Array) -> Array:
        """Return a value of each group for each of its packets; shape (k,)."""
        return np.repeat(values, np.diff([*self.groups[:, 0], len(self.packets)]))


class ExpectedPulses(NamedTuple):
    """Pulses that are expected in a stretch."""

    own: Array  #: shape (k, values); expected number of pulses at each place of each packet
    rows: Array  #: shape (j, 3); these pulses and the pulses before the packets, as in `channel_estimate.place_pairs`
    train: Array  #: shape (n,); expected number of edges at each sample


@dataclasses.dataclass(frozen=True)
class DecodedStretch:
    """Result of decoding a stretch."""

    #: `unary`, `level`, `common`: metrics, weights and common energies, as in `trellis.forward_backward`.
    unary: Array
    level: Array
    common: Array
    probability: Array  #: shape (k, values); probability of each packet value, using the parity
    #: Shape (k, values); probability that the pulse of each value is present, if the packet has that value.
    present: Array
    #: Shape (k, 3); log likelihood ratio of each packet: one pulse in its window, against one, two, or two of half size
    #: anywhere.
    fits: Array
    channel: ChannelEstimate  #: channel estimated from the other pulses, with the noise model of this stretch
    ebn0_db: Array  #: shape (k,); energy per bit over noise density, of the group of each packet
    #: Relative drift of the pulses against the sample clock, its variance, and the sample about which it is measured,
    #: relative to TU 0 of the packets.
    timing: tuple[float, float, float]
    evidence: float  #: log likelihood ratio of pulses, at any of their places, against no pulses
    expected: float  #: mean of the evidence in this noise if the pulses are like the earlier ones
    #: Shape (k,); probability that a disturbance, not only steady noise, affects the pressure of the group of each
    #: packet.
    disturbed: Array
    #: Size of the pulses of the sync relative to those of the packets, and its 1 sigma; infinite if it was not asked
    #: for.
    sync: tuple[float, float]


def decode(stretch: StretchOnToolClock, channel: ChannelEstimate) -> DecodedStretch:
    """
    Return the decoded packets of a stretch, with the channel, timing and evidence.

    Parameters
    ----------
    channel : ChannelEstimate
        Estimate to start from.
    """
    packets, weight, again = stretch.packets, stretch.known.copy(), stretch.probability is not None
    state = dataclasses.replace(channel)
    pulses = expected_pulses(stretch, trellis.uniform(packets) if stretch.probability is None else stretch.probability)
    noise = stretch.pressure - reconstruct(pulses.train, state.response)
    pumps, cranks = pump_noise(noise, stretch.known, state.memory, stretch.angles)
    for turn in range(_ROUNDS):
        whitened = filtered(stretch.pressure - pumps.pressure, state.whitener)
        if turn == 0 and not again and state.posterior is not None:
            # A disturbance before the packets must not distort the estimate of the response, so its samples get small
            # weights. After a sync alone, the response is too uncertain to find disturbances.
            before = slice(0, stretch.own[0].start)
            g = _whitened(state.response[None], state.whitener)[0]
            weight[before] = precision((whitened - reconstruct(pulses.train, g))[before], stretch.known[before])
        responses = _estimate(stretch, state, whitened, weight, pulses)
        g = _whitened(state.response[None], state.whitener)[0]
        if turn > 0 or again:
            weight = precision(whitened - reconstruct(pulses.train, g), stretch.known)
        metric, level = _metric(stretch, responses, state.whitener, (whitened, weight))
        common = common_energy(g, len(g) // SAMPLES_PER_TU)
        energies = common, _absorbed(g, len(common), pumps.lines)
        far, beside = shared_energy(stretch, stretch.places, energies, pulses)
        common = energies[0] - energies[1]
        unary = metric[stretch.places] - level[:, None] * far
        unary, present = _any_pulses(stretch, unary, level[:, None] * beside, common, level)
        sums = trellis.forward_backward(packets, unary, common, level, stretch.parity)
        probability, _, evidence = trellis.marginals(packets, *sums)
        pulses = expected_pulses(stretch, probability * present)
        if not (again and turn == _ROUNDS - 1):
            pumps = _new_noise(stretch, pulses, state, weight, cranks)
    fits = _fits(stretch, metric, energies, level, pulses)
    g = _whitened(state.response[None], state.whitener)[0]
    members = stretch.members
    # Logarithm of the number of ways to place all pulses.
    ways = [float(packets[mine, trellis.BITS].sum()) * math.log(2.0) for mine in members]
    counts = np.array([mine.stop - mine.start for mine in members])
    ebn0 = 10.0 * np.log10(np.maximum(float(g @ g) * counts * math.log(2.0) / (2.0 * np.array(ways)), 1e-6))
    # A pulse at its true place has a metric of half its energy, reduced where samples are unknown.
    expected = 0.5 * float(g @ g * level.sum()) - sum(ways)
    timing = (0.0, 1.0, 0.0) if again else _timing(stretch, pulses.train, state, weight, pumps.pressure)
    return DecodedStretch(
        *(unary, level, common, probability, present, fits, state, stretch.per_packet(ebn0), timing),
        *(evidence - sum(ways), expected, stretch.per_packet(_disturbed(stretch, weight))),
        _sync_size(stretch, pulses, state, weight, whitened),
    )


def _metric(
    stretch: StretchOnToolClock, responses: Array, whitener: Array, data: tuple[Array, Array]
) -> tuple[Array, Array]:
    """
    Return the metric of one pulse at each TU, and the weight of the data of each packet.

    responses, shape (g, m): response for each group; data: whitened pressure and weights.
    """
    metric, level = np.zeros(int(stretch.groups[-1, 2])), np.ones(len(stretch.packets))
    shapes = _whitened(responses, whitener)
    for (_, begin, end), mine, g in zip(stretch.groups, stretch.members, shapes, strict=True):
        out, energy = matched(*data, g, stretch.start + SAMPLES_PER_TU * int(begin), int(end - begin))
        metric[begin:end] = out - 0.5 * energy
        middle = stretch.packets[mine, trellis.START] + stretch.packets[mine, trellis.COUNT] // 2 - begin
        level[mine] = np.minimum(energy[middle] / max(float(g @ g), 1e-300), 1.0)
    return metric, level


def _disturbed(stretch: StretchOnToolClock, weight: Array) -> Array:
    """Return the probability that a disturbance affects the samples of each group, by their weights."""
    return np.array([1.0 - math.exp(-float(np.sum(stretch.known[own] - weight[own]))) for own in stretch.own])


def _any_pulses(
    stretch: StretchOnToolClock, unary: Array, beside: Array, common: Array, level: Array
) -> tuple[Array, Array]:
    """
    Return metrics that allow for missing and second pulses, and the probability that the pulse of a value is present.

    unary: metrics without the energy shared with far pulses; beside: energy shared with the packets before and after.

    A missing pulse has the likelihood of no pulse, whatever the value is; a second pulse may be at any place of the
    window. Both limit the confidence of a packet: a window without its pulse contains no information about the value.
    """
    count, missing = stretch.packets[:, trellis.COUNT], stretch.missing
    unary = unary - beside
    second = unary + _second(unary, stretch.places, count, common, level) + np.log(_EXTRA / count)[:, None]
    pulse = np.logaddexp(unary + math.log(1.0 - missing - _EXTRA), second)
    total = np.logaddexp(pulse, math.log(missing))
    return total + beside, np.exp(pulse - total)


@compiled
def _second(unary: Array, at: Indices, count: Indices, common: Array, level: Array) -> Array:
    """
    Return the log sum of the metrics of a second pulse, for each place of the first.

    at: places, TU; count, shape (k,): number of the places of each packet at which the second pulse may be.
    """
    out, logs = np.empty(unary.shape), np.empty(unary.shape[1])
    for k in range(len(unary)):
        for value in range(unary.shape[1]):
            for other in range(count[k]):
                gap = min(abs(at[k, value] - at[k, other]), len(common) - 1)
                logs[other] = unary[k, other] - level[k] * common[gap] if gap > 1 else trellis.NEVER
            out[k, value] = trellis.log_sum(logs[: count[k]])
    return out


def _absorbed(response: Array, count: int, pumps: Array) -> Array:
    """
    Return the part of the common energy of two pulses that the pump lines take up, by their distance in TU.

    The amplitudes of the lines are fitted to the pressure after the expected pulses are subtracted. The lines take up
    a part of a pulse that is not where it is expected, which leaves less information about its place.

    response: whitened response to a pulse; count: number of distances; pumps: lines, as in `PumpNoise`.
    """
    turns = np.exp(-1j * pumps[:, :1] * np.arange(len(response)))
    power = pumps[:, 1] * np.abs(turns @ response) ** 2
    return np.asarray(power @ np.cos(pumps[:, :1] * SAMPLES_PER_TU * np.arange(count)))


def shared_energy(
    stretch: StretchOnToolClock, at: Indices, energies: tuple[Array, Array], pulses: ExpectedPulses
) -> tuple[Array, Array]:
    """
    Return the mean energy that a pulse of each packet shares with far pulses and with the neighbouring packets.

    Parameters
    ----------
    stretch : StretchOnToolClock
    at : ndarray, shape (k, n)
        Places of the pulse of each packet, TU.
    energies : (ndarray, ndarray), shapes (m,), (m,)
        Common energy of two pulses, by their distance in TU, and the part of it that the pump lines take up.
    pulses : ExpectedPulses

    Returns
    -------
    ndarray, shape (k, n)
        Energy shared with all pulses except the pulses of the packet itself and of the packets before and after.
    ndarray, shape (k, n)
        Energy shared with the packets before and after.
    """
    common, absorbed = energies
    beyond, count = len(common), int(stretch.groups[-1, 2])
    place = beyond + (pulses.rows[:, 0] - stretch.start) / SAMPLES_PER_TU
    edges = _edges(place, pulses.rows[:, 1], count + 2 * beyond)
    total = correlated(edges[1:], np.concatenate([common[:0:-1], common]), count)[at]
    # The lines were fitted without the expected pulses, so they contain a part of those that are decided here.
    within, beside = _near_energy(at, stretch.places, pulses.own, common - absorbed)
    return total - within - beside - 0.5 * absorbed[0], beside


@compiled
def _near_energy(at: Indices, places: Indices, own: Array, common: Array) -> tuple[Array, Array]:
    """
    Return the mean energy that a pulse of each packet shares with its own packet and with the neighbouring packets.

    at, common: as in `shared_energy`; places, own: as in `StretchOnToolClock` and `ExpectedPulses`.
    """
    within, beside = np.zeros(at.shape), np.zeros(at.shape)
    for k in range(at.shape[0]):
        for j in range(max(k - 1, 0), min(k + 2, len(places))):
            out = within if j == k else beside
            for v in range(at.shape[1]):
                for u in range(places.shape[1]):
                    gap = abs(at[k, v] - places[j, u])
                    if gap < len(common):
                        out[k, v] += own[j, u] * common[gap]
    return within, beside


def _fits(
    stretch: StretchOnToolClock, metric: Array, energies: tuple[Array, Array], level: Array, pulses: ExpectedPulses
) -> Array:
    """
    Return for each packet the log likelihood ratio of the present word table to each kind of wrong table, shape (k, 3).

    The present table has one pulse in each window. Another table, or a second tool, has one or two pulses anywhere in a
    window and the gap after it; two pulses have half the size if the response was estimated from syncs that two tools
    sent together. Where no pulse arrives, both have the same likelihood: silence counts neither for nor against the
    table. The columns are: one pulse, two pulses, and two pulses of half size.

    metric: metric of a single pulse at each TU; energies: as in `shared_energy`.
    """
    packets, missing, common = stretch.packets, stretch.missing, energies[0] - energies[1]
    size = packets[:, trellis.COUNT, None] + GAP_TU
    each = np.arange(int(size.max()))[None, :]
    at = packets[:, trellis.START, None] + np.minimum(each, size - 1)
    unary = metric[at] - level[:, None] * sum(shared_energy(stretch, at, energies, pulses))
    counts = size[:, 0]
    inside = _log_sums(unary, counts - GAP_TU) - np.log(counts - GAP_TU)
    free = [_log_sums(unary, counts) - np.log(counts)]
    for share in (1.0, 0.5):
        first = share * unary + 0.5 * share * (1.0 - share) * common[0] * level[:, None]
        both = first + _second(first, at, counts, share**2 * common, level)
        free.append(_log_sums(both, counts) - 2.0 * np.log(counts))
    sent, none = math.log(1.0 - missing), math.log(missing)
    return np.asarray((np.logaddexp(sent + inside, none) - np.logaddexp(sent + np.array(free), none)).T)


@compiled
def _log_sums(logs: Array, count: Indices) -> Array:
    """Return the log sum of the first `count` logarithms of each row."""
    out = np.empty(len(logs))
    for k in range(len(logs)):
        out[k] = trellis.log_sum(logs[k, : count[k]])
    return out


def expected_pulses(stretch: StretchOnToolClock, own: Array) -> ExpectedPulses:
    """Return all pulses that are expected in a stretch; own: the pulses of its packets, as in `ExpectedPulses`."""
    rows = np.concatenate([stretch.pulses, pulse_places(stretch.packets, own, stretch.start, 0.0)])
    return ExpectedPulses(own, rows, _edges(rows[:, 0], rows[:, 1], len(stretch.pressure)))


@compiled
def _edges(at: Array, chance: Array, count: int) -> Array:
    """Return the expected number of edges at each of `count` places, from pulses with a place and a probability."""
    edges = np.zeros(count)
    for k in range(len(at)):
        place = round(at[k])
        if 0 <= place < count:
            edges[place] += chance[k]
    return edges


def _whitened(responses: Array, whitener: Array) -> Array:
    return whitened_responses(responses, whitener, responses.shape[1] + _TAIL)


def _estimate(
    stretch: StretchOnToolClock, state: ChannelEstimate, whitened: Array, weight: Array, pulses: ExpectedPulses
) -> Array:
    """
    Return the response for each group, Pa, shape (g, m); `state` receives the mean of these estimates.

    The response is estimated from the pulses around the group. The pressure of the group itself is not used, because a
    response estimated from its own decisions confirms them.
    """
    shapes = _whitened(state.components, state.whitener)
    columns = pulse_columns(pulses.train, shapes)
    whole = normal_equations(columns, whitened, weight)
    pairs, owns = [], stretch.own
    for own in owns:
        others = weight.copy()
        others[own] = 0.0
        pairs.append(place_pairs(pulses.rows, others))
    found, scales, matrices = [], [], []
    for own, unplaced in zip(owns, spread(np.array(pairs), shapes), strict=True):
        matrix, right = (
            a - b for a, b in zip(whole, normal_equations(columns[own], whitened[own], weight[own]), strict=True)
        )
        if stretch.carried is not None:
            used = pulses.train * (weight > 0.0)
            lacking = max(1.0 - float(used.sum() - used[own].sum()) / _ENOUGH, 0.0)
            matrix += lacking * stretch.carried[1]
            right += lacking * stretch.carried[1] @ stretch.carried[0]
        # The unknown places of pulses enlarge the covariance, so that such pulses do not sharpen the response.
        u, scale, _ = coefficients(matrix + unplaced, right, state.scale)
        found.append(u)
        scales.append(scale)
        matrices.append(matrix)
    mean: Array = np.add.reduce(found) / len(owns)
    state.response, state.scale = mean @ state.components, sum(scales) / len(owns)
    state.posterior = mean, np.add.reduce(matrices) / len(owns)
    return np.array(found) @ state.components


def _sync_size(
    stretch: StretchOnToolClock, pulses: ExpectedPulses, state: ChannelEstimate, weight: Array, whitened: Array
) -> tuple[float, float]:
    """
    Measure the size of the pulses of the sync relative to the pulses of the packets.

    Two tools that start together send their syncs at the same places, and their packets at different ones.

    Returns
    -------
    (float, float)
        Size and its 1 sigma, as in `DecodedStretch.sync`.
    """
    if stretch.sync is None:
        return 1.0, math.inf
    here = slice(max(stretch.sync[0] - BEFORE, 0), stretch.sync[1])
    of_sync = stretch.pulses[(stretch.pulses[:, 0] >= here.start) & (stretch.pulses[:, 0] < here.stop)]
    shapes = _whitened(state.components, state.whitener)
    columns = pulse_columns(pulses.train, shapes)
    sync = pulse_columns(_edges(of_sync[:, 0], of_sync[:, 1], len(whitened)), shapes)
    others = weight.copy()
    others[here] = 0.0
    pairs = place_pairs(pulses.rows, others)
    matrix, right = normal_equations(columns, whitened, others)
    u, _, covariance = coefficients(matrix + spread(pairs, shapes), right, state.scale)
    expected = sync[here] @ u
    rest = whitened[here] - (columns[here] - sync[here]) @ u
    weighted = weight[here] * expected
    power = float(weighted @ expected)
    if not power > 0.0:
        return 1.0, math.inf
    error = weighted @ sync[here]
    return float(weighted @ rest) / power, math.sqrt(1.0 / power + float(error @ covariance @ error) / power**2)


def _new_noise(
    stretch: StretchOnToolClock, pulses: ExpectedPulses, state: ChannelEstimate, weight: Array, cranks: list[Crank]
) -> PumpNoise:
    """Fit the noise model to the pressure without pulses and pumps; return the pump noise."""
    residual = stretch.pressure - reconstruct(pulses.train, state.response)
    background = lines(residual, weight, state.memory, cranks)
    residual -= background.pressure
    root, unsure = np.sqrt(weight), _unsure(pulses.rows, state.response, weight)
    taps, size = prediction_error_filter(residual, root, ORDER, FLOOR, unsure, True)
    if size > 0.0 and len(background.lines):
        unsure += _unsure_lines(background.lines, taps, weight)
        taps, size = prediction_error_filter(residual, root, ORDER, FLOOR, unsure, True)
    state.whitener = taps if size > 0.0 else state.whitener
    return background


def _unsure(places: Array, response: Array, weight: Array) -> Array:
    """
    Return the autocorrelation of the error of the expected pulses, Pa^2 summed over the samples; shape (ORDER + 2,).

    The expected pulses are means over the places where each pulse may be. If its place is uncertain, the mean differs
    from the real pulse. The noise model needs the autocorrelation of the residual plus that of this difference (A. P.
    Dempster et al., J. R. Stat. Soc. B 39 (1977) 1); without it the noise is too small and the words too confident.

    places: as `StretchOnToolClock.pulses`.
    """
    pairs = place_pairs(places, weight)
    lags, apart = np.arange(ORDER + 2), SAMPLES_PER_TU * np.arange(LAGS)[:, None]
    farthest = int(lags[-1] + apart[-1, 0])
    common = correlated(np.concatenate([response, np.zeros(farthest)]), response, farthest + 1)
    return np.asarray(2.0 * pairs.sum() * common[lags] - pairs @ (common[lags + apart] + common[np.abs(lags - apart)]))


def _unsure_lines(pumps: Array, whitener: Array, weight: Array) -> Array:
    """
    Return the autocorrelation of the error of the pump lines, Pa^2 summed over the samples; shape (ORDER + 2,).

    The fitted lines also follow the noise at their frequencies, which is then missing from the residual.

    pumps: lines, as in `PumpNoise`; whitener: noise model of the residual.
    """
    gain = np.abs(np.exp(-1j * pumps[:, :1] * np.arange(len(whitener))) @ whitener) ** 2
    return np.asarray(weight.sum() * (pumps[:, 1] / gain) @ np.cos(pumps[:, :1] * np.arange(ORDER + 2)))


def _timing(
    stretch: StretchOnToolClock, train: Array, state: ChannelEstimate, weight: Array, pumps: Array
) -> tuple[float, float, float]:
    """
    Measure the drift of the pulses against the sample clock; train: as in `ExpectedPulses`.

    Returns
    -------
    (float, float, float)
        Drift, its variance and its centre, as in `DecodedStretch.timing`; (0, 1, 0) if the pulses are too few.
    """
    g = _whitened(state.response[None], state.whitener)[0]
    slope = np.gradient(g)
    rest = filtered(stretch.pressure - pumps, state.whitener) - reconstruct(train, g)
    count = float(train.sum())
    if count < 6.0:
        return 0.0, 1.0, 0.0
    at = np.arange(len(train), dtype=float)
    middle = float(train @ at) / count
    # Delaying a response by tau changes it by -tau times its slope; tau is a constant plus a drift.
    late = reconstruct(train, -slope)
    drifting = reconstruct(np.where(train > _FEW, train * (at - middle), 0.0), -slope)
    both, right = float(late @ (weight * drifting)), float(drifting @ (weight * rest))
    own, other = float(drifting @ (weight * drifting)), float(late @ (weight * late))
    if own * other <= both * both:
        return 0.0, 1.0, 0.0
    left = own - both * both / other
    return (right - both / other * float(late @ (weight * rest))) / left, 1.0 / left, middle - stretch.start
