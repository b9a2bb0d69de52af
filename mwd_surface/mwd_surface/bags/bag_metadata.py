# SPDX-License-Identifier: Apache-2.0
"""
Reading and writing metadata.yaml of a rosbag2 directory (version 9, as in Jazzy) and a topic's quality of service.

Readers match a topic in metadata.yaml with a channel in the file by name, type *and* quality of service. The profiles
in metadata.yaml and in the channel are therefore written from the same parsed list.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_yaml, read_text
from mwd_sensors.core.output_files import write_whole

FILE_NAME = "metadata.yaml"
VERSION = 9  # version of metadata.yaml that is written
# Start time, ns, of a bag or file without messages, as rosbag2 writes it.
NO_TIME = 2**63 - 1

# Infinite duration, as rmw defines it.
_FOREVER = {"sec": 9223372036, "nsec": 854775807}
# Names of the values of each rmw policy. Bags of version 8 and older have the position in the tuple, from 0, instead.
_POLICIES = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"),
}

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class MetadataError(ValueError):
    """Raised if metadata.yaml is missing, unreadable, or does not describe a bag."""


@dataclasses.dataclass(frozen=True)
class Topic:
    """One topic of a bag; `qos` is the list of offered profiles as `parse_qos` returns it."""

    name: str
    type_name: str
    count: int
    type_hash: str = ""
    qos: Sequence[Mapping[str, Any]] = ()
    serialization_format: str = "cdr"


@dataclasses.dataclass(frozen=True)
class File:
    """One file of a bag; times in ns since the epoch, `start_ns` is None if the file holds no message."""

    path: str
    start_ns: int | None
    end_ns: int
    count: int


@dataclasses.dataclass(frozen=True)
class BagMetadata:
    """Contents of the metadata.yaml of a bag."""

    files: Sequence[File]
    topics: Sequence[Topic]
    storage: str = "mcap"
    custom: Mapping[str, str] = dataclasses.field(default_factory=dict)
    ros_distro: str = "jazzy"
    compression_format: str = ""
    compression_mode: str = ""

    @property
    def count(self) -> int:
        """Number of messages in all files."""
        return sum(file.count for file in self.files)


def qos_profile(
    reliability: str = "reliable", durability: str = "volatile", history: str = "keep_last", depth: int = 10
) -> dict[str, Any]:
    """
    Return one quality-of-service profile as a table with the names that rosbag2 uses.

    Raises
    ------
    ValueError
        A policy has a value that rmw does not define.
    """
    given = {"history": history, "reliability": reliability, "durability": durability}
    for policy, value in given.items():
        if value not in _POLICIES[policy]:
            raise ValueError(f"{policy}: {value!r} is not one of {', '.join(_POLICIES[policy])}")
    return {
        "history": history,
        "depth": depth,
        "reliability": reliability,
        "durability": durability,
        "deadline": dict(_FOREVER),
        "lifespan": dict(_FOREVER),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_FOREVER),
        "avoid_ros_namespace_conventions": False,
    }


def parse_qos(given: str | Sequence[Mapping[str, Any]] | None) -> list[dict[str, Any]]:
    """
    Return the quality-of-service profiles of a topic, complete and with names of policy values.

    given : YAML text or a list of tables; "" or None gives an empty list. Numbers in bags of version 8 and older become
    names; missing entries get the defaults of rmw.

    Raises
    ------
    ValueError
        `given` is neither a list of tables nor the YAML text of such a list.
    """
    if isinstance(given, str):
        try:
            given = load_yaml(given)
        except yaml.YAMLError as error:
            raise ValueError(f"qos: not YAML: {error}") from error
    if not given:
        return []
    if isinstance(given, Mapping) or not isinstance(given, Sequence):
        raise ValueError(f"qos: expected a list of profiles, got {given!r}")  # noqa: TRY004
    profiles = []
    for item in given:
        if not isinstance(item, Mapping):
            raise ValueError(f"qos: expected a table of policies, got {item!r}")  # noqa: TRY004
        profile = qos_profile()
        for key in profile:
            if key in item:
                profile[key] = item[key]
        for policy, names in _POLICIES.items():
            value = profile[policy]
            if isinstance(value, int):
                profile[policy] = names[value] if 0 <= value < len(names) else "unknown"
            else:
                profile[policy] = str(value).lower()
        profiles.append(profile)
    return profiles


def qos_if_readable(given: str) -> list[dict[str, Any]]:
    """Return the profiles as `parse_qos` does; an empty list for a text that it refuses."""
    try:
        return parse_qos(given)
    except ValueError:
        return []


def qos_text(profiles: Sequence[Mapping[str, Any]]) -> str:
    """Return the profiles as YAML text for the metadata of an MCAP channel; "" if the list is empty."""
    return _dump([dict(profile) for profile in profiles]).strip() if profiles else ""


def to_text(bag: BagMetadata) -> str:
    """Return the text of metadata.yaml."""
    return _dump({"rosbag2_bagfile_information": _information(bag)})


def serialized(bag: BagMetadata) -> str:
    """Return the text of metadata.yaml without its root key, for the ``rosbag2`` metadata record of an MCAP file."""
    return _dump(_information(bag))


def write(folder: Path, bag: BagMetadata) -> None:
    """
    Write metadata.yaml atomically: at every moment the folder holds either the old or the new file.

    Raises OSError if the file cannot be written.
    """
    write_whole(folder / FILE_NAME, to_text(bag))


def read(folder: Path) -> BagMetadata:
    """
    Read metadata.yaml of a folder, of any rosbag2 version.

    Raises
    ------
    MetadataError
        The file is missing, is not YAML, or lacks a required entry.
    """
    path = folder / FILE_NAME
    try:
        table = load_yaml(read_text(path, budgets.YAML))
        info = table["rosbag2_bagfile_information"]
        names = [Path(str(name)).name for name in info["relative_file_paths"]]
        details = {Path(str(item["path"])).name: item for item in info.get("files") or []}
        topics = [_topic(entry) for entry in info.get("topics_with_message_count") or []]
        return BagMetadata(
            files=[_file(name, details.get(name)) for name in names],
            topics=topics,
            storage=str(info["storage_identifier"]),
            custom={str(k): str(v) for k, v in (info.get("custom_data") or {}).items()},
            ros_distro=str(info.get("ros_distro") or ""),
            compression_format=str(info.get("compression_format") or "").lower(),
            compression_mode=str(info.get("compression_mode") or "").lower(),
        )
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        # Do not quote the contents of the file: the replay node logs this error, and its parameter can name any folder.
        raise MetadataError(without_contents(path, error)) from error


def _file(name: str, item: Mapping[str, Any] | None) -> File:
    if item is None:
        return File(name, None, 0, 0)
    count = int(item["message_count"])
    start = int(item["starting_time"]["nanoseconds_since_epoch"])
    return File(name, start if count else None, start + int(item["duration"]["nanoseconds"]) if count else 0, count)


def _topic(entry: Mapping[str, Any]) -> Topic:
    about = entry["topic_metadata"]
    return Topic(
        name=str(about["name"]),
        type_name=str(about["type"]),
        count=int(entry["message_count"]),
        type_hash=str(about.get("type_description_hash") or ""),
        qos=parse_qos(about.get("offered_qos_profiles")),
        serialization_format=str(about.get("serialization_format") or "cdr"),
    )


def _information(bag: BagMetadata) -> dict[str, Any]:
    filled = [file for file in bag.files if file.start_ns is not None]
    start = min((file.start_ns for file in filled if file.start_ns is not None), default=NO_TIME)
    end = max((file.end_ns for file in filled), default=NO_TIME)
    return {
        "version": VERSION,
        "storage_identifier": bag.storage,
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": bag.count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": topic.serialization_format,
                    "offered_qos_profiles": [dict(profile) for profile in topic.qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in bag.topics
        ],
        "compression_format": bag.compression_format,
        "compression_mode": bag.compression_mode,
        "relative_file_paths": [file.path for file in bag.files],
        "files": [
            {
                "path": file.path,
                "starting_time": {"nanoseconds_since_epoch": NO_TIME if file.start_ns is None else file.start_ns},
                "duration": {"nanoseconds": 0 if file.start_ns is None else file.end_ns - file.start_ns},
                "message_count": file.count,
            }
            for file in bag.files
        ],
        "custom_data": dict(bag.custom) or None,
        "ros_distro": bag.ros_distro,
    }


def _dump(value: Any) -> str:
    # Write equal tables in full: YAML would otherwise replace them by anchors, which the parser of rosbag2 does not
    # support.
    class Plain(_Dumper):  # type: ignore[misc]
        def ignore_aliases(self, _data: Any) -> bool:
            return True

    return str(yaml.dump(value, Dumper=Plain, sort_keys=False, default_flow_style=False, width=2**16))
