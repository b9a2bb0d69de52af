# SPDX-License-Identifier: Apache-2.0
"""
A ROS 1 recording (``.bag``) read as if ROS 2 had written it: the messages of common types are brought to its encoding.

The conversion is that of `rosbags` (CDR from the ROS 1 serialisation, without the header's sequence number). Topics of
types that ROS 2's common packages do not have are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Generator
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore


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

    def open(self) -> None:
        """Open the file and read its index."""
        super().open()
        self.is_open = True
        known = [one for one in self.connections if one.msgtype in self._store.fielddefs]
        self.left_out = sorted({one.topic for one in self.connections if one not in known})
        self.connections = known

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
