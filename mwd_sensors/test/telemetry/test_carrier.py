# SPDX-License-Identifier: Apache-2.0
"""Blocks on a carrier: what goes in comes out, the marker stands alone, and a damaged block is refused."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import integers

from mwd_sensors.telemetry import carrier
from mwd_sensors.telemetry.carrier import BlockName, Carrier, block_bits, data_places, read_block, symbols, unpacked
from mwd_sensors.telemetry.tool_configuration import from_mapping

MODULATIONS = ("bpsk", "qpsk", "dpsk")


@given(inclination=integers(0, 4095), toolface=integers(0, 63), number=integers(0, 7), place=integers(0, 15))
def test_a_block_comes_back_from_its_bits(inclination, toolface, number, place):
    name = BlockName("toolface", number, place)
    bits = block_bits(Carrier(), name, (inclination, toolface), (12, 6))
    got, data = read_block(bits)
    assert got == name
    assert unpacked(data, (12, 6)) == (inclination, toolface)


@given(places=integers(0, 2**64 - 1))
def test_a_block_with_wrong_bits_is_refused(places):
    bits = block_bits(Carrier(), BlockName("survey", 0, 0), (1, 2), (12, 12))
    wrong = np.array([places >> k & 1 for k in range(len(bits))])
    # All errors of up to three bits are seen, and one in 65536 of the others is not: 64 random ones never here.
    if 0 < wrong.sum() <= 3:
        assert read_block(bits ^ wrong) is None


@pytest.mark.parametrize("modulation", MODULATIONS)
def test_all_symbols_have_size_1_and_the_marker_is_in_the_middle(modulation):
    one = dataclasses.replace(Carrier(), modulation=modulation)
    sent = symbols(one, block_bits(one, BlockName("survey", 0, 0), (1000,), (12,)))
    assert np.abs(sent) == pytest.approx(1.0)
    assert len(sent) == one.block_symbols
    assert np.array_equal(sent[one.half : one.half + carrier.MARKER_SYMBOLS], carrier.marker())
    assert abs(one.half + 10 - one.block_symbols / 2) <= 1.0
    assert len(data_places(one)) * (2 if modulation == "qpsk" else 1) == one.coded_bits


def test_differences_of_dpsk_are_the_coded_bits_across_the_marker():
    one = dataclasses.replace(Carrier(), modulation="dpsk")
    bits = block_bits(one, BlockName("survey", 0, 0), (1234,), (12,))
    sent, places = symbols(one, bits), data_places(one)
    turned = np.real(sent[places] * np.conj(sent[places - 1]))
    coded = carrier.convolution.encode(bits)[carrier.interleaver(one.coded_bits)]
    assert np.array_equal(turned < 0.0, coded == 1)


def test_the_marker_resembles_itself_at_no_other_place():
    marker = carrier.marker().real
    side = [abs(marker[k:] @ marker[:-k]) for k in range(1, len(marker))]
    assert max(side) <= 2.0


@pytest.mark.parametrize("count", [140, 156, 284])
def test_neighbours_on_air_are_far_from_each_other_in_the_code(count):
    order = carrier.interleaver(count)
    assert sorted(order) == list(range(count))
    # Ten symbols of QPSK lost in a row hit no two coded bits that lie within one memory of the code.
    burst = np.sort(order[:20])
    assert np.diff(burst).min() >= 3


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"carrier": {"block_bits": 42}}, "multiple of 8"),
        ({"carrier": {"frequency_hz": 1.0}}, "below symbol_rate_hz"),
        ({"carrier": {"block_bits": 16}, "survey_sequences": ["Inc:18"]}, "more than a block holds"),
        ({"toolface_sequences": ["120{aTFA:6}"]}, "raise block_bits"),
        ({"survey_sequences": ["Inc"] * 9}, "number 8 sequences"),
        ({"code": "serial", "survey_sequences": ["200{Inc}"]}, "too many for a serial frame"),
    ],
)
def test_what_a_code_cannot_send_is_refused(change, complaint):
    with pytest.raises(ValueError, match=complaint):
        from_mapping({"code": "psk", **change})
