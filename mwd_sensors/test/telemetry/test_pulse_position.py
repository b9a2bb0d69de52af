# SPDX-License-Identifier: Apache-2.0
"""The M-ary pulse position code against the figures its inventors print."""

import itertools

import pytest
from hypothesis import given
from hypothesis.strategies import integers

from mwd_sensors.telemetry.pulse_position import edge_tu, encode, packets


def test_packets_are_of_three_bits_and_the_rest_of_two_at_the_end():
    assert packets(12) == (3, 3, 3, 3)
    assert packets(13) == (3, 3, 3, 2, 2)
    assert packets(7) == (3, 2, 2)
    assert packets(8) == (3, 3, 2)
    with pytest.raises(ValueError, match="2 or 3 bits"):
        packets(1)


def test_edges_of_a_two_bit_packet_are_the_published_ones():
    """Value 3 at TU 0, 2 at 1, 1 at 2, 0 at 3 (Erdos Miller, 2017)."""
    assert [edge_tu(value, 2) for value in (3, 2, 1, 0)] == [0, 1, 2, 3]


@given(bits=integers(2, 24))
def test_a_bit_takes_four_time_units(bits):
    assert encode(0, bits).length == 4 * bits


@given(bits=integers(2, 16), data=integers(0, 2**16 - 1))
def test_codes_have_edges_of_their_own(bits, data):
    code = data % 2**bits
    edges = encode(code, bits).edges
    assert edges != encode(code ^ 1, bits).edges
    assert all(b - a >= 5 for a, b in itertools.pairwise(edges))
