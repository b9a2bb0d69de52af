# SPDX-License-Identifier: Apache-2.0
"""Numbers of leases only grow: over restarts, a clock set back, a power cut, and a file that is lost."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.control.lease_numbers import LeaseNumbers


@pytest.mark.slow
@given(runs=st.lists(st.tuples(st.integers(1, 2**31), st.integers(0, 3000)), min_size=1, max_size=6))
def test_no_number_is_given_twice_whatever_the_clock_says(tmp_path_factory, runs):
    file = tmp_path_factory.mktemp("surface") / "well_1" / "control.json"
    newest = 0
    for clock, count in runs:
        numbers = LeaseNumbers(file)
        upcoming = numbers.first(clock)
        assert upcoming > newest or newest == 0
        assert upcoming >= clock
        for _ in range(count):
            numbers.reserve(upcoming)
            newest, upcoming = upcoming, upcoming + 1


def test_a_file_that_is_lost_leaves_the_clock(tmp_path):
    assert LeaseNumbers(tmp_path / "control.json").first(1_700_000_000) == 1_700_000_000


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "[" * 9_000,
        "x" * 20_000,
        '{"reserved_below": -1}',
        '{"reserved_below": 4294967295}',
        '{"reserved_below": "1"}',
    ],
)
def test_a_file_that_cannot_be_understood_says_what_to_do(tmp_path, text):
    (tmp_path / "control.json").write_text(text)
    with pytest.raises(ValueError, match="delete "):
        LeaseNumbers(tmp_path / "control.json").first(1)


def test_numbers_are_written_in_blocks(tmp_path):
    file = tmp_path / "control.json"
    numbers = LeaseNumbers(file)
    numbers.reserve(numbers.first(1))
    before = file.stat().st_mtime_ns
    for upcoming in range(2, 400):
        numbers.reserve(upcoming)
    assert file.stat().st_mtime_ns == before
