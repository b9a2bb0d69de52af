# SPDX-License-Identifier: Apache-2.0
"""The forward-backward pass against all combinations written out."""

import itertools

import numpy as np
import pytest

from mwd_sensors.telemetry.sequences import parse
from mwd_surface.receiver.pulse import trellis
from mwd_surface.receiver.words import packet_rows

ROWS, _ = packet_rows(parse("aTFA:4:P aTFA:3:P"))
COMMON = np.array([4.0, 2.0, 0.5, 0.2, 0.1, -0.8, 0.6, 0.3, 0.0])
LEVEL = np.array([1.0, 0.7, 1.0, 0.9])


def everything(unary, parity):
    """Probability of each combination of packet values, by the sum of its metrics."""
    found = {}
    for values in itertools.product(*(range(1 << row[1]) for row in ROWS)):
        total = sum(
            trellis.step_metric(ROWS, unary, COMMON, LEVEL, k, values[k - 1] if k else 0, value)
            for k, value in enumerate(values)
        )
        ones = [sum(values[k].bit_count() for k in word) for word in ((0, 1), (2, 3))]
        if parity < 0 or all(count % 2 == parity for count in ones):
            found[values] = total
    logs = np.array(list(found.values()))
    weights = np.exp(logs - logs.max())
    return dict(zip(found, weights / weights.sum(), strict=True)), np.log(weights.sum()) + logs.max()


@pytest.mark.parametrize("parity", [-1, 0, 1])
def test_marginals_and_words_are_those_of_all_combinations(parity):
    unary = np.random.default_rng(5).normal(size=(4, 8)) * 2.0
    expected, evidence = everything(unary, parity)
    sums = trellis.forward_backward(ROWS, unary, COMMON, LEVEL, parity)
    chance, even, found = trellis.marginals(ROWS, *sums)
    assert found == pytest.approx(evidence)
    for k in range(4):
        for value in range(1 << ROWS[k, 1]):
            total = sum(p for values, p in expected.items() if values[k] == value)
            assert chance[k, value] == pytest.approx(total, abs=1e-12)
    assert even[1] == pytest.approx(
        sum(p for values, p in expected.items() if (values[0].bit_count() + values[1].bit_count()) % 2 == 0)
    )
    for word, packets in enumerate(((0, 1), (2, 3))):
        best = trellis.best_words(ROWS, unary, COMMON, LEVEL, *sums, packets[0], 16)
        bits = int(ROWS[packets[0], 1] + ROWS[packets[1], 1])
        assert len(best) == min(1 << (bits - (parity >= 0)), 16)
        low = int(ROWS[packets[1], 1])
        for code, log in best:
            pair = (int(code) >> low, int(code) & (1 << low) - 1)
            total = sum(p for values, p in expected.items() if (values[2 * word], values[2 * word + 1]) == pair)
            assert np.exp(log - evidence) == pytest.approx(total, abs=1e-9)
