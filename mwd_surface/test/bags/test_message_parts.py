# SPDX-License-Identifier: Apache-2.0
"""Messages as arrays: nothing is lost, doubled or put out of order by cutting and joining."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import wire
from mwd_surface.bags.message_parts import NEVER, blocks_of, part_of, rows_at

LOGGED = st.lists(st.integers(0, 30), min_size=1, max_size=40)


def samples(log_ns):
    """Temperatures that say when they were logged."""
    found = wire.TEMPERATURE.empty(len(log_ns))
    found["stamp_ns"] = log_ns
    found["temperature"] = np.arange(len(log_ns))
    return found


def piece(log_ns):
    log_ns = np.sort(np.array(log_ns, dtype=np.int64))
    return log_ns, samples(log_ns)


def test_single_messages_become_a_part_that_still_holds_their_bytes():
    part = part_of([(5, 1, b"abc"), (6, 2, b""), (7, 1, b"de")])
    assert part.log_ns.tolist() == [5, 6, 7]
    assert part.channel.tolist() == [1, 2, 1]
    assert [part.data[a : a + n].tobytes() for a, n in zip(part.offset, part.size, strict=True)] == [b"abc", b"", b"de"]


@given(log_ns=LOGGED, mark=st.integers(-1, 31))
def test_a_split_part_is_whole_together_and_apart_at_the_mark(log_ns, mark):
    part = part_of([(one, 0, bytes([one])) for one in sorted(log_ns)])
    early, late = part.split(mark)
    assert [*early.log_ns, *late.log_ns] == part.log_ns.tolist()
    assert [*early.offset, *late.offset] == part.offset.tolist()
    assert (early.log_ns < mark).all()
    assert (late.log_ns >= mark).all()


@given(
    pieces=st.dictionaries(st.sampled_from("abc"), st.lists(LOGGED, min_size=1, max_size=3), min_size=1),
    size=st.integers(1, 50),
)
def test_blocks_hold_every_message_once_and_none_is_later_than_the_next_block(pieces, size):
    given_ = {name: [piece(one) for one in parts] for name, parts in pieces.items()}
    blocks = list(blocks_of(given_, size))
    for name, parts in pieces.items():
        found = np.concatenate([block[name][0] for block in blocks if name in block])
        assert found.tolist() == sorted(one for part in parts for one in part)
        stamps = np.concatenate([block[name][1]["stamp_ns"] for block in blocks if name in block])
        assert stamps.tolist() == found.tolist()
    ends = [(min(p[0][0] for p in b.values()), max(p[0][-1] for p in b.values())) for b in blocks]
    assert all(one[1] <= two[0] for one, two in itertools.pairwise(ends))


def test_messages_without_a_layout_are_joined_and_ordered_as_well():
    early, late = (np.array([1, 4]), [b"1", b"4"]), (np.array([2, 3]), [b"2", b"3"])
    (block,) = blocks_of({"a": [late, early]}, NEVER)
    assert block["a"][0].tolist() == [1, 2, 3, 4]
    assert block["a"][1] == [b"1", b"2", b"3", b"4"]


@pytest.mark.parametrize(
    ("offset", "view"), [([2, 7, 12], True), ([2, 7, 13], False), ([12, 7, 2], False), ([4], False)]
)
def test_rows_are_a_view_where_messages_lie_at_even_distances_and_a_copy_elsewhere(offset, view):
    data = np.arange(20, dtype=np.uint8)
    rows = rows_at(data, np.array(offset), 4)
    assert rows.tolist() == [list(range(at, at + 4)) for at in offset]
    assert np.shares_memory(rows, data) == view
