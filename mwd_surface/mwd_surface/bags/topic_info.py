# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag: their types, and whether the encoding of their messages can be read."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

from mwd_sensors.core import burst, wire
from mwd_sensors.core.foreign_text import first_of

CDR, ROS1 = "cdr", "ros1"
RATE, FORCE, MAGNETIC = "angular_velocity", "linear_acceleration", "magnetic_field"
# Beginnings of words in topic names that show the quantity of a vector, and words for vectors that are not
# measurements.
_SAID = {RATE: ("gyr", "angular", "omega", "rate"), FORCE: ("acc", "specific"), MAGNETIC: ("mag", "compass")}
_DERIVED = ("free", "bias", "offset", "delta", "euler", "std", "sigma", "variance", "covariance", "gravity", "truth")
#: Advice for messages in another encoding.
REMEDY = "record or convert them in ROS 2's own encoding (CDR)"
#: Problem text for messages that a recorder compressed one by one without stating it in metadata.yaml.
PACKED = "its messages are compressed one by one"
_ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of data compressed with zstd
# The two kinds of CDR encapsulation (first two bytes of a message) that ROS 2 writes: big and little endian.
_BIG_ENDIAN = b"\x00\x00"
_CDR_HEADS = (_BIG_ENDIAN, b"\x00\x01")


@dataclasses.dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag."""

    name: str
    type_name: str
    count: int  #: number of messages, from the index of the bag
    #: `schema_encoding`, `schema`: definition of the type inside the bag; empty if the bag has none.
    schema_encoding: str = ""
    schema: str = ""
    type_hash: str = ""  #: RIHS01 hash, empty if unknown
    qos: str = ""  #: offered profiles as YAML, empty if unknown
    serialization: str = CDR  #: encoding of the messages that the reader returns: ``cdr`` for ROS 2
    problem: str = ""  #: reason why the messages cannot be read; empty if they can
    #: For messages of one vector (`wire.VECTOR`): field of `wire.IMU` or `wire.MAG` that the vector fills; empty if
    #: unknown.
    quantity: str = ""

    @property
    def gives(self) -> str:
        """Type of message that has the topic's samples; a burst or a single vector counts as IMU or magnetometer."""
        if self.quantity:
            return wire.MAG.type_name if self.quantity == MAGNETIC else wire.IMU.type_name
        return wire.IMU.type_name if self.type_name == burst.TYPE_NAME else self.type_name

    def described(self) -> str:
        """Return the topic's name and type, and the reason why it cannot be read, as text."""
        return f"{self.name} ({self.type_name or 'no type'}): {self.problem}"


def quantity_of(name: str) -> str:
    """
    Return the quantity that the vectors of a topic measure, from the topic's name; "" if the name does not show it.

    Drivers also publish the vectors of an IMU separately, as ``/imu/acceleration``, ``/imu/angular_velocity`` and
    ``/imu/mag``, next to derived vectors such as ``/filter/free_acceleration``, for which the result is "". The last
    part of the name that contains a known word decides; if that part names two quantities, the result is "".
    """
    parts = [re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1_\2", part).lower()) for part in name.split("/")]
    if any(word in _DERIVED for words in parts for word in words):
        return ""
    for words in reversed(parts):
        found = {quantity for quantity, starts in _SAID.items() if any(word.startswith(starts) for word in words)}
        if found:
            return found.pop() if len(found) == 1 else ""
    return ""


def read_as(encoding: str, schema_encoding: str, declared: str) -> tuple[str, str, str]:
    """
    Return the ROS 2 name of a message type, the encoding of its messages, and the reason why they cannot be read.

    Parameters
    ----------
    encoding, schema_encoding : str
        Encoding of the messages and of their definition, as declared in the bag.
    declared : str
        Name of the type, as declared in the bag.

    Returns
    -------
    (str, str, str)
        Type name; ``cdr``, ``ros1`` or the declared encoding; and why the messages cannot be read (empty if they can).
    """
    known = encoding.lower()
    if known == CDR:
        # The first releases of ROS 2 omitted "msg" from type names, as ROS 1 does.
        return normalize_msgtype(declared) if declared.count("/") == 1 else declared, CDR, ""
    if known == ROS1 and schema_encoding.lower() == "ros1msg" and declared:
        name = normalize_msgtype(declared)
        common = name in ros2_types().fielddefs
        return name, ROS1, "" if common else "its ROS 1 type is not one of ROS 2's common packages"
    if known == ROS1:
        return declared, encoding, "its messages are in the encoding of ROS 1, and their definition is not"
    word = f"encoded as {encoding}" if encoding else "in an encoding that the recording does not name"
    return declared, encoding, f"its messages are {word}"


def cdr_problem(messages: list[bytes], type_name: str) -> str:
    """
    Return the reason why messages declared as CDR are not CDR, as text; "" if any of the messages may be CDR.

    Messages of a sensor that begin like big-endian CDR are decoded as a test, because the first message of a ROS 1
    recording begins with the same bytes.
    """
    if not messages or any(_may_be_cdr(data, type_name) for data in messages):
        return ""
    if all(data.startswith(_ZSTD) for data in messages):
        return PACKED
    begin = messages[0][:4].hex(" ") or "nothing"
    return f"its messages are not the CDR of that type, as the recording says they are (they begin with {begin})"


def _may_be_cdr(data: bytes, type_name: str) -> bool:
    """Return whether bytes begin like CDR of ROS 2; a big-endian message of a sensor must also be decodable."""
    if data[:2] not in _CDR_HEADS:
        return False
    if data[:2] != _BIG_ENDIAN or type_name not in wire.LAYOUTS or type_name not in ros2_types().fielddefs:
        return True
    try:
        ros2_types().deserialize_cdr(data, type_name)
    except Exception:  # noqa: BLE001  (a decoder may raise any error on damaged bytes)
        return False
    return True


def listed(topics: list[TopicInfo]) -> str:
    """Return a text that lists topics with their problems; topics with the same problem are listed together."""
    parts = []
    for problem, group in itertools.groupby(sorted(topics, key=lambda one: one.problem), lambda one: one.problem):
        mine = list(group)
        names = [f"{one.name} ({one.type_name or 'no type'})" for one in mine]
        parts.append(f"{first_of(names, 4)}: {problem}")
    return "; ".join(parts)


@functools.lru_cache(maxsize=1)
def ros2_types() -> Typestore:
    """Return the store of the types of the common packages of ROS 2; it also converts messages of ROS 1."""
    return get_typestore(Stores.ROS2_JAZZY)
