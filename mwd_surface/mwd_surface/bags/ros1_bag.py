# SPDX-License-Identifier: Apache-2.0
"""
A ROS 1 recording (``.bag``) read as if ROS 2 had written it: the messages of common types are brought to its encoding.

The conversion is that of `rosbags` (CDR from the ROS 1 serialisation, without the header's sequence number). Topics of
types that ROS 2's common packages do not have are left out.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable, Collection, Generator
from functools import partial
from pathlib import Path
from typing import Any

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import decompressors
from rosbags.typesys import Stores, get_typestore

from mwd_sensors.core import budgets

_BOUNDED: dict[str, Callable[[], bz2.BZ2Decompressor | lz4.frame.LZ4FrameDecompressor]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
}


class Ros1Reader(Reader):
    """
    As `rosbags.rosbag2.Reader` gives them: connections and messages of the types that ROS 2 knows.

    Attributes
    ----------
    left_out : list of str
        Topics of other types.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.left_out: list[str] = []
        self.is_open = False
        self._sizes: dict[int, int] = {}

    def open(self) -> None:
        """Open the file and read its index."""
        super().open()
        self.is_open = True
        for place, chunk in self.chunks.items():
            for name, make in _BOUNDED.items():
                if chunk.decompressor is decompressors[name]:
                    bounded = partial(self._unpacked, make, place)
                    self.chunks[place] = chunk._replace(decompressor=bounded)
        known = [one for one in self.connections if one.msgtype in self._store.fielddefs]
        self.left_out = sorted({one.topic for one in self.connections if one not in known})
        self.connections = known

    def _unpacked(self, make: Callable[[], Any], place: int, data: bytes) -> bytes:
        """Records of a chunk, within the budget; raises BudgetError."""
        most = budgets.ROS1.unpacked or 0
        plain = bytes(make().decompress(data, max_length=most + 1))
        budgets.ROS1.check("unpacked", len(plain))
        self._sizes[place] = len(plain)
        budgets.ROS1.check_ratio(self.path.stat().st_size, sum(self._sizes.values()))
        return plain

    def close(self) -> None:
        """Close the file."""
        self.is_open = False
        super().close()

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Connection, log time, ns, and the bytes of each message as ROS 2 encodes it."""
        for connection, log_ns, data in super().messages(connections, start, stop):
            yield connection, log_ns, bytes(self._store.ros1_to_cdr(data, connection.msgtype))
