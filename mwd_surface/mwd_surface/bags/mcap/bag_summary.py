# SPDX-License-Identifier: Apache-2.0
"""Metadata of a bag from the contents of its files."""

from __future__ import annotations

from collections.abc import Sequence

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, File, Topic
from mwd_surface.bags.mcap.contents import Contents
from mwd_surface.bags.mcap.records import Channel, Schema
from mwd_surface.bags.mcap.writer import McapWriter


def metadata_of_files(
    parts: Sequence[tuple[str, dict[int, Channel], dict[int, Schema], McapWriter | Contents]],
) -> BagMetadata:
    """Return the metadata of a bag from the name, channels, schemas and totals of each file."""
    files: list[File] = []
    topics: dict[tuple[str, str], Topic] = {}
    for name, channels, schemas, source in parts:
        if isinstance(source, McapWriter):
            start, end = source.start_ns, source.end_ns
        else:
            start = min((span.start_ns for span in source.spans), default=None)
            end = max((span.end_ns for span in source.spans), default=0)
        files.append(File(name, start, end, sum(source.counts.values())))
        for number, channel in channels.items():
            schema = schemas.get(channel.schema_id)
            type_name = schema.name if schema else ""
            known = topics.get((channel.topic, type_name))
            topics[channel.topic, type_name] = Topic(
                channel.topic,
                type_name,
                source.counts.get(number, 0) + (known.count if known else 0),
                channel.metadata.get("topic_type_hash", ""),
                _qos(channel),
            )
    return BagMetadata(files=files, topics=list(topics.values()))


def _qos(channel: Channel) -> list[dict[str, object]]:
    try:
        return bag_metadata.parse_qos(channel.metadata.get("offered_qos_profiles", ""))
    except ValueError:
        return []
