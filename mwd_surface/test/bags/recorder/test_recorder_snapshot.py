# SPDX-License-Identifier: Apache-2.0
"""What is kept for a snapshot: the newest, within its bytes."""

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import installed
from mwd_surface.bags.recorder.message_queue import OVERHEAD, QueuedMessage
from mwd_surface.bags.recorder.recorder import SnapshotRing

TYPE = "std_msgs/msg/String"


def item(k, size=40):
    return QueuedMessage("/t", TYPE, b"\0\1\0\0" + bytes([k]) * (size - 4), k, k)


def test_the_oldest_go_when_the_bytes_are_used_up(tmp_path):
    ring = SnapshotRing(60.0, 3 * (40 + OVERHEAD))
    for k in range(10):
        ring.keep(item(k))
    assert len(ring) == 3
    with BagWriter(tmp_path / "s", installed()) as writer:
        ring.write(writer)
    with Bag(tmp_path / "s") as bag:
        assert [data[4] for _, _, _, data in bag.messages(["/t"])] == [7, 8, 9]


def test_a_message_larger_than_all_room_is_not_kept():
    ring = SnapshotRing(60.0, 100)
    ring.keep(item(1))
    assert len(ring) == 0
