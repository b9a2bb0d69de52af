# SPDX-License-Identifier: Apache-2.0
"""
Decoder of one block of symbols on a carrier: it estimates channel, noise and bits in turn.

The first channel estimate comes from the marker in the middle of the block, later ones from all symbols as decoded so
far. Symbols and spectral lines are solved for together after whitening the noise. The decoded probability of each
symbol is its prior in the next iteration. Sources: M. Tuechler, R. Koetter, A. C. Singer, IEEE Trans. Commun. 50 (2002)
754 (turbo equalisation by linear estimation); C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine
Learning, 2006, section 2.1 (prior of the channel).
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.telemetry import carrier as air
from mwd_sensors.telemetry.carrier import MARKER_SYMBOLS, Carrier
from mwd_sensors.telemetry.convolution import MEMORY
from mwd_surface.receiver.carrier import convolutional
from mwd_surface.receiver.carrier.baseband import PER_SYMBOL, Complex
from mwd_surface.receiver.carrier.whitening_complex import filtered, prediction_error_filter
from mwd_surface.receiver.whitening import steadiness

MARGIN = 4  # symbols before and after the block whose response reaches into it
BEFORE, BEHIND = 1, 4  # length of the response before and after its own symbol, in symbols
_LAGS = PER_SYMBOL * (BEFORE + BEHIND)
_TURNS = 4  # number of iterations
_ORDER = 6  # order of the noise model
_UNCERTAIN = 0.03  # weight, in the estimate of the lines, of samples whose symbols are unknown
_SCALINGS = 3  # number of iterations of the prior variance of the response
_KNOWN = 1e-4  # variance of a known symbol
_LINE = 1e4  # prior variance of a line's amplitude relative to the noise: practically unknown


@dataclasses.dataclass(frozen=True)
class BlockData:
    """
    Data of a block with margins: its envelope, where its value is known, and the disturbing lines.

    The envelope has the shape (n,); the second array, shape (n,), is 1 where the value is known; the columns of the
    lines have the shape (n, k).
    """

    envelope: Complex
    known: Array
    lines: Complex


@dataclasses.dataclass(frozen=True)
class BlockDecision:
    """Result of decoding a block."""

    bits: Array  #: shape (n,); log posterior ratio of each bit at the input of the encoder, positive for 0
    evidence: float  #: log evidence, to compare trials of the same block
    ebn0_db: float  #: energy per bit at the input of the encoder over the noise density, after the equaliser
    turn: float  #: phase drift between the two halves of the block, rad per symbol: the remaining error of the clock
    taps: Complex  #: prediction error filter of the noise
    #: Bits for each phase by which all symbols may be rotated. A rotated code word is a valid code word, too, so the
    #: code alone cannot exclude a rotation; the check of the block decides.
    turned: tuple[Array, ...] = ()


@functools.cache
def _basis() -> Complex:
    """
    Return the components of the response to one symbol, each scaled by its standard deviation; shape (c, _LAGS).

    The model is the rectangle of a symbol, convolved with independent taps of decreasing variance: a small timing error
    and weaker echoes.
    """
    lag = np.arange(_LAGS) - PER_SYMBOL * BEFORE
    fine = np.arange(-PER_SYMBOL, 3 * PER_SYMBOL, 0.5)
    size = np.exp(-0.5 * (fine / (0.25 * PER_SYMBOL)) ** 2) + 0.02 * (fine > 0) * np.exp(-fine / PER_SYMBOL)
    since = (lag[:, None] - fine[None, :] + 0.5) / PER_SYMBOL
    # Rise time of the edges of a symbol after the filter of the band, in symbols.
    rise = 0.2
    shape = 0.5 * (np.tanh(since / rise) - np.tanh((since - 1.0) / rise))
    values, vectors = np.linalg.eigh(shape * size @ shape.T)
    kept = values > 1e-3 * values[-1]
    vectors = vectors[:, kept][:, ::-1]
    vectors = vectors * np.sign(vectors[np.argmax(np.abs(vectors), axis=0), np.arange(vectors.shape[1])])
    return np.ascontiguousarray((vectors * np.sqrt(values[kept][::-1] / values[-1])).T.astype(complex))


class BlockDecoder:
    """Decoder for the blocks of one carrier."""

    def __init__(self, carrier: Carrier) -> None:
        self._carrier = carrier
        self._count = carrier.block_symbols + 2 * MARGIN
        self.rows = PER_SYMBOL * self._count
        first = MARGIN + carrier.half
        self._marker = slice(first, first + MARKER_SYMBOLS)
        self._places = MARGIN + air.data_places(carrier)
        self._order = air.interleaver(carrier.coded_bits)

    def decode(self, data: BlockData, taps: Complex | None, turns: int = _TURNS) -> BlockDecision:
        """
        Decode a block.

        Parameters
        ----------
        taps : ndarray, optional
            Prediction error filter of the noise in the previous block.
        turns : int
            Number of iterations; 1 uses the channel of the marker only, which is enough to compare trials.

        Returns
        -------
        BlockDecision
            With the evidence -inf if less than half of the marker is known, or the envelope there is 0.
        """
        mean, prior = np.zeros(self._count, dtype=complex), np.ones(self._count)
        mean[self._marker], prior[self._marker] = air.marker(), _KNOWN
        rows = slice(PER_SYMBOL * self._marker.start, PER_SYMBOL * self._marker.stop)
        if np.mean(data.known[rows]) < 0.5 or not np.any(data.envelope[rows]):
            nothing = np.zeros(self._carrier.coded_bits // 2 - MEMORY)
            return BlockDecision(nothing, -math.inf, -60.0, 0.0, np.ones(1, dtype=complex))
        weight = data.known.copy()
        given_taps = taps is not None
        taps = taps if taps is not None else np.ones(1, dtype=complex)
        extrinsic = np.zeros(self._carrier.coded_bits)
        bits, evidence, quality = np.zeros(1), 0.0, 1.0
        estimate, precision = mean, prior
        for turn in range(turns):
            response, offset = self._channel(data, mean, prior, taps, weight)
            if turn > 0 or not given_taps:
                taps, weight = self._noise(data, response, offset, (mean, prior), weight)
            estimate, precision = self._equalised(data, (response, taps), mean, prior, weight)
            given = self._soft_bits(estimate, precision)
            ordered = np.empty(len(given))
            ordered[self._order] = given
            bits, coded, evidence = convolutional.decode(ordered)
            extrinsic = (coded - np.clip(ordered, -40.0, 40.0))[self._order]
            whole = coded[self._order]
            prior_mean, prior_var = self._symbols_of(extrinsic, estimate, precision)
            mean, prior = (prior_mean, prior_var) if turn < turns - 1 else self._symbols_of(whole, estimate, precision)
            quality = float(np.mean(precision[self._places]))
        coded_energy = quality / (2.0 if self._carrier.modulation == "qpsk" else 1.0)
        return BlockDecision(
            bits,
            evidence,
            10.0 * math.log10(max(2.0 * coded_energy, 1e-6)),
            self._turn(estimate, mean, prior),
            taps,
            self._turned(estimate, precision) if turns > 1 else (),
        )

    def _turned(self, estimate: Complex, precision: Array) -> tuple[Array, ...]:
        """Return the bits for each rotation of the phase of all symbols that the modulation allows."""
        turns = {"qpsk": (-1.0, 1j, -1j), "bpsk": (-1.0,), "dpsk": ()}[self._carrier.modulation]
        found = []
        for turn in turns:
            ordered = np.empty(self._carrier.coded_bits)
            ordered[self._order] = self._soft_bits(turn * estimate, precision)
            found.append(convolutional.decode(ordered)[0])
        return tuple(found)

    def _turn(self, estimate: Complex, mean: Complex, variance: Array) -> float:
        product = estimate * np.conj(mean) * (1.0 - np.minimum(variance, 1.0))
        middle = (self._marker.start + self._marker.stop) // 2
        early, late = product[MARGIN:middle].sum(), product[middle:-MARGIN].sum()
        return float(np.angle(late * np.conj(early))) / (0.5 * self._carrier.block_symbols)

    def _sent(self, mean: Complex, shape: Complex) -> Complex:
        """
        Return the envelope, shape (rows,), of symbols with the values `mean`, shape (count,).

        shape: response to one symbol; it begins `BEFORE` symbols before its symbol.
        """
        impulses = np.zeros(self.rows, dtype=complex)
        impulses[::PER_SYMBOL] = mean
        begin = PER_SYMBOL * BEFORE
        return np.convolve(impulses, shape)[begin : begin + self.rows]

    def _channel(
        self, data: BlockData, mean: Complex, variance: Array, taps: Complex, weight: Array
    ) -> tuple[Complex, Complex]:
        """Return the estimated response to one symbol, shape (_LAGS,), and the sum of the lines, shape (rows,)."""
        # Envelope of all symbols through each component of the response, and the lines.
        columns = np.concatenate([np.stack([self._sent(mean, one) for one in _basis()], axis=1), data.lines], axis=1)
        left = filtered(columns, taps)
        right = filtered(data.envelope, taps)
        # Uncertain symbols act as noise of their own size in the estimate of the response, but still show the lines.
        sure = 1.0 - np.minimum(np.repeat(variance, PER_SYMBOL), 1.0)
        share = weight * np.maximum(sure, _UNCERTAIN)
        count = len(_basis())
        gram = left.conj().T @ (share[:, None] * left)
        seen = left.conj().T @ (share * right)
        total = float(share @ np.abs(right) ** 2)
        trust = max(float(share.sum()), 1.0)
        size = float(np.real(np.trace(gram[:count, :count]))) / count
        ridge, u = 0.05 * size, seen
        for _ in range(_SCALINGS):
            prior = np.concatenate([np.full(count, ridge), np.full(columns.shape[1] - count, 1e-9 * size)])
            inverse = np.linalg.inv(gram + np.diag(prior + 1e-12 * size))
            u = inverse @ seen
            noise = max(total - float(np.real(np.vdot(seen, u))), 1e-9 * total) / trust
            spread = float(np.sum(np.abs(u[:count]) ** 2) + noise * np.real(np.trace(inverse[:count, :count]))) / count
            ridge = noise / max(spread, 1e-300)
        return u[:count] @ _basis(), data.lines @ u[count:]

    def _noise(
        self,
        data: BlockData,
        response: Complex,
        offset: Complex,
        symbols: tuple[Complex, Array],
        weight: Array,
    ) -> tuple[Complex, Array]:
        """Return the filter that whitens the residual to unit variance, and the weight of each envelope value."""
        mean, variance = symbols
        rest = data.envelope - offset - self._sent(mean, response)
        sure = weight * (np.repeat(variance, PER_SYMBOL) < 0.5)
        order = _ORDER if sure.sum() > 30 * _ORDER else 4
        taps = prediction_error_filter(rest, sure, order)
        white = filtered(rest, taps)
        known = sure if sure.sum() > 0.5 * len(sure) else data.known
        if sure.sum() > 0.5 * len(sure):
            weight = np.where(sure > 0.0, steadiness(np.abs(white), known), weight)
        scale = math.sqrt(
            max(float(np.sum(sure * weight * np.abs(white) ** 2) / max(np.sum(sure * weight), 1e-9)), 1e-300)
        )
        return taps / scale, weight

    def _equalised(
        self, data: BlockData, channel: tuple[Complex, Complex], mean: Complex, variance: Array, weight: Array
    ) -> tuple[Complex, Array]:
        """Return the estimate of each symbol without its own prior, and the estimate's precision, (count,) each."""
        response, taps = channel
        shape = np.convolve(response, taps)
        lines = filtered(data.lines, taps)
        rest = filtered(data.envelope, taps) - self._sent(mean, shape)
        size = self._count + lines.shape[1]
        gram, seen = np.zeros((size, size), dtype=complex), np.zeros(size, dtype=complex)
        _normal_equations((shape, PER_SYMBOL * BEFORE), lines, rest, weight, gram, seen)
        precision = 1.0 / np.concatenate([np.maximum(variance, _KNOWN), np.full(lines.shape[1], _LINE)])
        gram[np.diag_indices(size)] += precision
        _invert(gram)
        change = gram @ seen
        posterior = np.maximum(np.real(np.diag(gram))[: self._count], 1e-12)
        prior = 1.0 / np.maximum(variance, _KNOWN)
        own = np.maximum(1.0 / posterior - prior, 1e-6)
        return ((mean + change[: self._count]) / posterior - mean * prior) / own, own

    def _soft_bits(self, estimate: Complex, precision: Array) -> Array:
        """Return the log-likelihood ratio of each transmitted coded bit, positive for 0; shape (coded_bits,)."""
        z, rho = estimate[self._places], precision[self._places]
        if self._carrier.modulation == "qpsk":
            both = 2.0 * math.sqrt(2.0) * rho * z
            return np.stack([both.real, both.imag], axis=1).reshape(-1)
        if self._carrier.modulation == "bpsk":
            return np.asarray(4.0 * rho * z.real)
        turned = np.real(z * np.conj(estimate[self._places - 1]))
        return np.asarray(4.0 * turned / (2.0 / rho + 1.0 / rho**2))

    def _symbols_of(self, ratios: Array, estimate: Complex, precision: Array) -> tuple[Complex, Array]:
        """
        Return mean and variance of each symbol, shape (count,), from the log ratios of its coded bits.

        For DPSK both come from the estimate and its precision.
        """
        mean, variance = np.zeros(self._count, dtype=complex), np.ones(self._count)
        inside = slice(MARGIN, self._count - MARGIN)
        if self._carrier.modulation == "qpsk":
            soft = np.tanh(0.5 * ratios) / math.sqrt(2.0)
            mean[self._places] = soft[0::2] + 1j * soft[1::2]
        elif self._carrier.modulation == "bpsk":
            mean[self._places] = np.tanh(0.5 * ratios)
        else:
            mean[inside] = np.tanh(2.0 * precision * estimate.real)[inside]
        mean[self._marker] = air.marker()
        variance[inside] = np.maximum(1.0 - np.abs(mean[inside]) ** 2, _KNOWN)
        return mean, variance


@compiled
def _normal_equations(
    symbol: tuple[Complex, int], lines: Complex, rest: Complex, weight: Array, gram: Complex, seen: Complex
) -> None:
    """
    Fill the normal equations of symbols and lines. Only the nonzero elements of the design matrix are multiplied.

    Parameters
    ----------
    symbol : (ndarray, int)
        Response to a symbol, shape (m,), and the number of its values that come before the symbol.
    lines : ndarray, shape (n, j)
    rest, weight : ndarray, shape (n,)
    gram, seen : ndarray, shapes (k + j, k + j), (k + j,)
        Filled by this function.
    """
    shape, before = symbol
    n, j, m = len(rest), lines.shape[1], len(shape)
    count = len(seen) - j
    for k in range(count):
        first = PER_SYMBOL * k - before
        for row in range(max(first, 0), min(first + m, n)):
            own = weight[row] * np.conj(shape[row - first])
            seen[k] += own * rest[row]
            for other in range(k, count):
                lag = row - (PER_SYMBOL * other - before)
                if lag < 0:
                    break
                gram[k, other] += own * shape[lag]
            for line in range(j):
                gram[k, count + line] += own * lines[row, line]
    for line in range(j):
        for row in range(n):
            own = weight[row] * np.conj(lines[row, line])
            seen[count + line] += own * rest[row]
            for other in range(line, j):
                gram[count + line, count + other] += own * lines[row, other]
    for k in range(len(seen)):
        for other in range(k):
            gram[k, other] = np.conj(gram[other, k])


@compiled
def _invert(a: Complex) -> None:
    """
    Invert a positive definite Hermitian matrix, shape (n, n), in place (Gauss-Jordan without pivoting).

    The matrix is small: the threads of a linear algebra library would spend more time waiting for each other than
    working.
    """
    n = len(a)
    for k in range(n):
        pivot = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] *= pivot
        for i in range(n):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]
