# SPDX-License-Identifier: Apache-2.0
"""The same messages give the same state of the well, bit for bit, live in pieces of any size or in the viewer."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.page.state_json import StateJson
from mwd_surface.runs.player import Player
from page_states import exact
from project import ROOT

pytestmark = pytest.mark.slow(6)

RECORDING = ROOT / "bags/golden/stations/bag"
MS = 1_000_000


def heard(bag, until_ns, pieces_ms):
    """Return the well after it received a recording in pieces; each piece is sorted by topic, as in the node."""
    well = Player(bag, "/").well
    waiting = [(at, name, data) for at, name, _, data in bag.messages() if at <= until_ns][::-1]
    now_ns, pieces = bag.start_ns, itertools.cycle(pieces_ms)
    while now_ns < until_ns:
        now_ns = min(now_ns + next(pieces) * MS, until_ns)
        arrived = []
        while waiting and waiting[-1][0] <= now_ns:
            arrived.append(waiting.pop())
        for at, name, data in sorted(arrived, key=lambda one: one[1]):
            topic = name.removeprefix("/")
            if topic in well.topics:
                well.put(topic, data, at)
        well.advance(now_ns)
    return well


@given(st.integers(1, 34_000), st.lists(st.integers(1, 3000), min_size=1, max_size=5))
@settings(max_examples=8)
def test_live_and_viewed_states_are_equal_to_the_last_bit(at_ms, pieces_ms):
    with Bag(RECORDING) as bag:
        viewed = Player(bag, "/")
        viewed.seek(at_ms * 1e-3)
        state = heard(bag, bag.start_ns + at_ms * MS, pieces_ms).state()
    assert exact(state) == exact(viewed.state())
    assert StateJson().snapshot(state) == StateJson().snapshot(viewed.state())
    # Make sure that the two states are not both empty: this recording has a moving bit.
    assert at_ms < 1000 or state.rig.bit_depth.value is not None
