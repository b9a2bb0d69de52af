# SPDX-License-Identifier: Apache-2.0
"""The topics of a bag: their types, and whether their messages are in an encoding that can be read here."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

from mwd_sensors.core import burst, wire

CDR, ROS1 = "cdr", "ros1"
RATE, FORCE, MAGNETIC = "angular_velocity", "linear_acceleration", "magnetic_field"
# Beginnings of the words of a name that say what a vector measures, and words of vectors that are no measurement.
_SAID = {RATE: ("gyr", "angular", "omega", "rate"), FORCE: ("acc", "specific"), MAGNETIC: ("mag", "compass")}
_DERIVED = ("free", "bias", "offset", "delta", "euler", "std", "sigma", "variance", "covariance", "gravity", "truth")
#: What to do about messages of another encoding.
REMEDY = "record or convert them in ROS 2's own encoding (CDR)"
#: Problem of messages that a recorder compressed one by one, where no metadata.yaml says so.
PACKED = "its messages are compressed one by one"
_ZSTD = b"\x28\xb5\x2f\xfd"
# Kinds of CDR encapsulation (its first two bytes) that ROS 2 writes: big and little endian.
_BIG_ENDIAN = b"\x00\x00"
_CDR_HEADS = (_BIG_ENDIAN, b"\x00\x01")


@dataclasses.dataclass(frozen=True)
class TopicInfo:
    """
    One topic of a bag.

    Attributes
    ----------
    name, type_name : str
    count : int
        Messages, as the bag's index says.
    schema_encoding, schema : str
        Definition of the type inside the bag; empty where it carries none.
    type_hash : str
        RIHS01, empty where unknown.
    qos : str
        Offered profiles as YAML, empty where unknown.
    serialization : str
        Encoding of the messages as they are handed out: ``cdr`` for ROS 2.
    problem : str
        Why its messages cannot be read, in words; empty where they can.
    quantity : str
        Of messages of one vector (`wire.VECTOR`), the field of `wire.IMU` or `wire.MAG` that it stands for; empty where
        that is not known.
    """

    name: str
    type_name: str
    count: int
    schema_encoding: str = ""
    schema: str = ""
    type_hash: str = ""
    qos: str = ""
    serialization: str = CDR
    problem: str = ""
    quantity: str = ""

    @property
    def gives(self) -> str:
        """Type of the samples that its messages carry: those of an IMU for a burst or one vector of an IMU."""
        if self.quantity:
            return wire.MAG.type_name if self.quantity == MAGNETIC else wire.IMU.type_name
        return wire.IMU.type_name if self.type_name == burst.TYPE_NAME else self.type_name

    def described(self) -> str:
        """Return its name, type and why it cannot be read, in words."""
        return f"{self.name} ({self.type_name or 'no type'}): {self.problem}"


def quantity_of(name: str) -> str:
    """
    Return what the vectors of a topic measure, by its name; empty where the name does not say.

    Drivers publish the vectors of an IMU alone too, as ``/imu/acceleration``, ``/imu/angular_velocity`` and
    ``/imu/mag`` next to ``/filter/free_acceleration``. The last part of the name that says anything counts.
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
    Return the type, by its ROS 2 name, the encoding and the problem of messages.

    Parameters
    ----------
    encoding, schema_encoding : str
        Of the messages and of their definition, as the bag declares them.
    declared : str
        Name of the type, as the bag declares it.

    Returns
    -------
    (str, str, str)
        Type name, ``cdr`` or ``ros1`` or as declared, and why the messages cannot be read (empty where they can).
    """
    known = encoding.lower()
    if known == CDR:
        # The first releases of ROS 2 left the "msg" out, as ROS 1 does.
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
    Return why messages that are declared as CDR are not, in words; empty where any of them may be.

    A message of a sensor that begins as big-endian CDR is decoded too: the first one of ROS 1 begins so as well.
    """
    if not messages or any(_may_be_cdr(data, type_name) for data in messages):
        return ""
    if all(data.startswith(_ZSTD) for data in messages):
        return PACKED
    begin = messages[0][:4].hex(" ") or "nothing"
    return f"its messages are not the CDR of that type, as the recording says they are (they begin with {begin})"


def _may_be_cdr(data: bytes, type_name: str) -> bool:
    """Whether bytes begin as ROS 2 writes CDR and, of a sensor in big-endian order, can be decoded."""
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
    """Return topics with their problems in words; topics of one problem together."""
    parts = []
    for problem, group in itertools.groupby(sorted(topics, key=lambda one: one.problem), lambda one: one.problem):
        mine = list(group)
        names = ", ".join(f"{one.name} ({one.type_name or 'no type'})" for one in mine[:4])
        parts.append(f"{names}{' ...' if len(mine) > 4 else ''}: {problem}")
    return "; ".join(parts)


@functools.lru_cache(maxsize=1)
def ros2_types() -> Typestore:
    """Types of ROS 2's common packages, which also convert messages of ROS 1."""
    return get_typestore(Stores.ROS2_JAZZY)
