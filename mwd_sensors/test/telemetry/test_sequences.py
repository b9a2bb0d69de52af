# SPDX-License-Identifier: Apache-2.0
"""The grammar of sequences, as public configurations of kits have it."""

import pytest
from hypothesis import given
from hypothesis.strategies import booleans, integers, lists, sampled_from, tuples

from mwd_sensors.telemetry.sequences import SequenceItem, parse, written

TOOLFACE = "3{2{aTFA:6:P} Gama:8:P aTFA:6:P Gama:8:P} RINC:11:P RAZM:11:P LRMS:11 ARMS:11 LMxG:11 AMxG:11"


def test_nested_repeats_are_written_out():
    items = parse(TOOLFACE)
    assert [item.name for item in items[:5]] == ["aTFA", "aTFA", "Gama", "aTFA", "Gama"]
    assert len(items) == 3 * 5 + 6
    assert items[-1] == SequenceItem("AMxG", 11, False)
    assert items[0].length == 7


def test_bits_come_from_the_table_where_the_sequence_gives_none():
    assert parse("Inc Azm:10:P") == (SequenceItem("Inc", 12, False), SequenceItem("Azm", 10, True))


@given(lists(tuples(sampled_from(["Inc", "Gama", "aTFA"]), integers(2, 24), booleans()), min_size=1, max_size=30))
def test_what_is_written_is_read_back(given_items):
    items = tuple(SequenceItem(*one) for one in given_items)
    assert parse(written(items)) == items


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "at least one word"),
        ("Inc:12:Q", "cannot read"),
        ("Incl:12:P", "did you mean Inc"),
        ("2{Inc:12", "not closed"),
        ("Inc:12}", "brace too many"),
        ("Inc:1", "2 to 24 bits"),
        ("99{99{99{Inc:12}}}", "more than 1000 words"),
    ],
)
def test_a_slip_is_named(text, complaint):
    with pytest.raises(ValueError, match=complaint):
        parse(text)


@pytest.mark.parametrize(
    "text",
    [
        "Inc:12:P, Azm:12:P",
        "Inc:12:P;Azm:12:P",
        " inc:12:p\n AZM:12:P ",
        "{Inc:12:P Azm:12:P}",
        "Inc : 12 : P Azm : 12 : P",
    ],
)
def test_spellings_of_kits_are_one_sequence(text):
    assert parse(text) == parse("Inc:12:P Azm:12:P")
    assert parse("Inc:12:N") == parse("Inc:12")
