# SPDX-License-Identifier: Apache-2.0
"""The convolutional code against its published distance spectrum, and linear as a code must be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import integers, lists

from mwd_sensors.telemetry.convolution import MEMORY, encode
from telemetry_limits import spectrum

BITS = lists(integers(0, 1), min_size=12, max_size=60)


def test_the_distance_spectrum_is_the_published_one():
    """J. Conan, IEEE Trans. Commun. 32 (1984) 1050, table for K = 7, rate 1/2: free distance 10."""
    found = spectrum()
    assert found.weights.tolist() == [10, 12, 14, 16, 18, 20, 22, 24]
    assert found.paths[:5].tolist() == [11, 38, 193, 1331, 7275]
    assert found.ones[:5].tolist() == [36, 211, 1404, 11633, 77433]


def test_a_single_one_sends_both_polynomials():
    coded = encode(np.array([1]))
    assert "".join(map(str, coded[0::2])) == f"{0o133:b}"
    assert "".join(map(str, coded[1::2])) == f"{0o171:b}"


@pytest.mark.slow
@given(one=BITS, other=BITS)
def test_the_code_is_linear_and_ends_in_zero(one, other):
    count = min(len(one), len(other))
    a, b = np.array(one[:count]), np.array(other[:count])
    assert np.array_equal(encode(a) ^ encode(b), encode(a ^ b))
    assert len(encode(a)) == 2 * (count + MEMORY)
    if a.any():
        assert encode(a).sum() >= 10
