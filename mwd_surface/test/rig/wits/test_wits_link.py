# SPDX-License-Identifier: Apache-2.0
"""A conversation in WITS: what waits for a slow peer is bounded, and its newest is kept."""

from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.rig.wits.link import Peer


@given(sizes=st.lists(st.integers(1, 400), max_size=60), limit=st.integers(1, 1000))
def test_the_oldest_packets_go_where_there_is_no_room_and_the_newest_stays(sizes, limit):
    peer = Peer("10.0.0.7:1", limit, 0.0)
    packets = [bytes([k % 256]) * size for k, size in enumerate(sizes)]
    for packet in packets:
        peer.put(packet)
    waiting = []
    while (packet := peer.take()) is not None:
        waiting.append(packet)
    assert waiting == packets[len(packets) - len(waiting) :]
    assert peer.dropped == len(packets) - len(waiting)
    assert sum(map(len, waiting)) <= limit or len(waiting) == 1
    assert bool(waiting) == bool(packets)


def test_the_rate_is_that_of_the_last_packets_and_falls_in_silence():
    peer = Peer("10.0.0.7:1", 1000, 0.0)
    assert peer.status(10.0).rate == 0.0
    for k in range(20):
        peer.was_sent(100.0 + 0.5 * k)
    assert peer.status(110.0).rate == 2.0
    assert peer.status(140.0).rate == 0.5
    assert peer.status(110.0).sent == 20
