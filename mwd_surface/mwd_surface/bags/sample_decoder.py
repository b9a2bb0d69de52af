# SPDX-License-Identifier: Apache-2.0
"""
Decoding of messages to samples: as rows of numbers if their layout is fixed, else one by one through `rosbags`.

A message that cannot be decoded is reported and left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import zstandard
from rosbags.serde import SerdeError

from mwd_sensors.core import burst, wire
from mwd_sensors.core.arrays import Samples, Stamps
from mwd_surface.bags.bag_files import BagError, TopicInfo
from mwd_surface.bags.definitions import DefinitionError, Definitions
from mwd_surface.bags.message_parts import MessagePart, merged, rows_at
from mwd_surface.bags.topic_info import FORCE, RATE

Fields = Mapping[str, tuple[str, ...]]

_MAX_MESSAGE_BYTES = 64 * 1024 * 1024  # largest size of a message that was compressed by itself


class SampleDecoder:
    """
    Decoder of the messages of one bag.

    Parameters
    ----------
    message_compression : bool
        Whether each message is compressed separately.
    report : callable
        Called with a sentence on messages that cannot be decoded.
    """

    def __init__(
        self, topics: Mapping[str, TopicInfo], message_compression: bool, report: Callable[[str], None]
    ) -> None:
        self._topics, self._message_compression, self._report = topics, message_compression, report
        #: By topic, the only frame whose messages are decoded to samples; messages of other frames come from other
        #: units.
        self.frames: dict[str, str] = {}
        # Keyed by type and schema: a merged recording may contain topics with an older definition of a type.
        self._definitions: dict[tuple[str, str], Definitions] = {}

    def decode(self, topic: str, data: bytes) -> Any:
        """Decode a message, see `bag_reader.Bag.decode`."""
        about = self._topics[topic]
        try:
            store = self._knowing(about).typestore
            try:
                return store.deserialize_cdr(data, about.type_name)
            except SerdeError:
                return _without_slack(store, data, about.type_name)
        except DefinitionError as error:
            raise BagError(f"{topic} cannot be decoded: {error}") from error
        except Exception as error:
            # Damaged bytes can make a decoder fail with any exception.
            raise BagError(f"a message of {topic} is not a {about.type_name}: {error!r}") from error

    def samples(
        self, part: MessagePart, names: Mapping[int, str], fields: Fields, wanted: set[str] | None = None
    ) -> Iterator[tuple[str, Stamps, Any]]:
        """
        Yield (topic, log_ns, samples) of a part.

        Messages that are not of their declared type are reported and left out.

        names : topic of each channel number of the part.
        fields : fields to read, by type name; types not named here are read completely.
        wanted : topics to decode; by default all.
        """
        numbers = np.unique(part.channel)
        for number in numbers.tolist():
            name = names[number]
            if wanted is not None and name not in wanted:
                continue
            mine = part if len(numbers) == 1 else part.at(part.channel == number)
            if name in self.frames and not self._message_compression:
                mine = _in_frame(mine, self.frames[name])
                if not len(mine):
                    continue
            if self._topics[name].type_name == burst.TYPE_NAME:
                yield name, *self._from_bursts(name, mine, fields.get(wire.IMU.type_name))
                continue
            if self._topics[name].quantity:
                yield name, *self._from_vectors(name, mine, fields.get(self._topics[name].gives))
                continue
            layout = wire.LAYOUTS.get(self._topics[name].type_name)
            some = fields.get(self._topics[name].type_name)
            yield name, *self._from_messages(name, layout, mine, some)

    def _from_messages(
        self, name: str, layout: wire.Layout | None, part: MessagePart, some: tuple[str, ...] | None
    ) -> tuple[Stamps, Any]:
        """
        Return the log times, ns, and the samples of messages.

        Messages without a layout are returned as bytes instead of samples.
        """
        if self._message_compression or layout is None or self._topics[name].serialization != "cdr":
            listed = [part.data[a : a + n].tobytes() for a, n in zip(part.offset, part.size, strict=True)]
            return self._from_list(name, layout, part.log_ns, listed, some)
        if (part.size == part.size[0]).all():
            return self._from_rows(name, layout, part, some)
        kinds = [part.at(part.size == size) for size in np.unique(part.size)]
        return merged([self._from_rows(name, layout, kind, some) for kind in kinds])

    def _from_vectors(self, name: str, part: MessagePart, some: tuple[str, ...] | None) -> tuple[Stamps, Samples]:
        """
        Return log times, ns, and samples of an IMU or a magnetometer from messages with one vector.

        Samples of an IMU also have the other vector; it is marked as absent.
        """
        quantity = self._topics[name].quantity
        log_ns, vectors = self._from_messages(name, wire.VECTOR, part, None)
        layout = wire.LAYOUTS[self._topics[name].gives]
        samples = np.zeros(len(log_ns), dtype=layout.dtype_of(some))
        samples["stamp_ns"] = vectors["stamp_ns"]
        for field in samples.dtype.names or ():
            if field == quantity:
                samples[field] = vectors["vector"]
            elif field in (RATE, FORCE):
                samples[field] = np.nan
            elif field.endswith("_covariance") and field != f"{quantity}_covariance":
                # REP-145: a covariance that begins with -1 belongs to a vector that is not measured.
                samples[field][:, 0] = -1.0
        return log_ns, samples

    def _from_rows(
        self, name: str, layout: wire.Layout, part: MessagePart, some: tuple[str, ...] | None
    ) -> tuple[Stamps, Samples]:
        """Return log times, ns, and samples of messages that all have the same size."""
        size = int(part.size[0])
        rows = rows_at(part.data, part.offset, size)
        try:
            return part.log_ns, layout.decode(rows, some)
        except wire.WireError as error:
            frames = rows[:, 12:16].copy().view("<u4")[:, 0] if size >= 16 else np.zeros(len(rows), dtype="<u4")
            kinds = np.unique(frames)
            if 1 < len(kinds) <= 16:
                # Messages of one size may still have frame names of different lengths, hidden by the padding.
                return merged([self._from_rows(name, layout, part.at(frames == kind), some) for kind in kinds])
            self._report(
                f"{name}: some messages are not in the fixed layout ({error}); they are read by the library rosbags"
            )
        listed = [part.data[a : a + size].tobytes() for a in part.offset]
        log_ns, samples = self._from_list(name, layout, part.log_ns, listed, some)
        return log_ns, samples

    def _from_bursts(self, name: str, part: MessagePart, some: tuple[str, ...] | None) -> tuple[Stamps, Samples]:
        """Return log times, ns, and the samples inside bursts; each sample has the log time of its burst."""
        listed = [part.data[a : a + n].tobytes() for a, n in zip(part.offset, part.size, strict=True)]
        log_ns, listed = self._from_list(name, None, part.log_ns, listed, some)
        parts, counts = [wire.IMU.empty(0)], []
        for data in listed:
            try:
                parts.append(burst.decode(data))
                counts.append(len(parts[-1]))
            except wire.WireError as error:
                counts.append(0)
                self._report(f"{name}: a message cannot be decoded and is left out: {error}")
        return np.repeat(log_ns, counts), _with_fields(np.concatenate(parts), wire.IMU, some)

    def _from_list(
        self,
        name: str,
        layout: wire.Layout | None,
        log_ns: Stamps,
        listed: list[bytes],
        some: tuple[str, ...] | None,
    ) -> tuple[Stamps, Any]:
        if self._message_compression:
            unzipped = [self.unzipped(data) for data in listed]
            keep = np.array([data is not None for data in unzipped], dtype=np.bool_)
            log_ns, listed = log_ns[keep], [data for data in unzipped if data is not None]
        if layout is None or self._topics[name].serialization != "cdr":
            return log_ns, listed
        samples, keep = layout.empty(len(listed)), np.ones(len(listed), dtype=np.bool_)
        for k, data in enumerate(listed):
            try:
                samples[k] = self._one_sample(name, layout, data)
            except (BagError, ValueError, AttributeError) as error:
                keep[k] = False
                self._report(f"{name}: a message cannot be decoded and is left out: {error}")
        return log_ns[keep], _with_fields(samples[keep], layout, some)

    def _one_sample(self, name: str, layout: wire.Layout, data: bytes) -> np.void:
        try:
            return layout.decode(data)[0]  # type: ignore[no-any-return]
        except wire.WireError:
            message = self.decode(name, data)
        sample = layout.empty(1)
        stamp = message.header.stamp
        sample["stamp_ns"] = stamp.sec * wire.NANOSECONDS + stamp.nanosec
        for field, _, _ in layout.fields:
            sample[field] = _plain_value(getattr(message, field))
        return sample[0]  # type: ignore[no-any-return]

    def unzipped(self, data: bytes) -> bytes | None:
        """Return a message that was compressed by itself, decompressed; report a damaged message and return None."""
        reason = f"it claims more than {_MAX_MESSAGE_BYTES} bytes"
        try:
            if zstandard.frame_content_size(data) <= _MAX_MESSAGE_BYTES:
                return zstandard.ZstdDecompressor().decompress(data, max_output_size=_MAX_MESSAGE_BYTES)
        except (zstandard.ZstdError, MemoryError) as error:
            reason = str(error)
        self._report(f"a compressed message is damaged and left out: {reason}")
        return None

    def _knowing(self, about: TopicInfo) -> Definitions:
        known = self._definitions.get((about.type_name, about.schema))
        if known is None:
            known = Definitions()
            if about.type_name not in known.typestore.fielddefs:
                if about.schema and about.schema_encoding in ("ros2msg", "msg"):
                    known.learn(about.type_name, about.schema)
                else:
                    known.load(about.type_name)
            self._definitions[about.type_name, about.schema] = known
        return known


def _in_frame(part: MessagePart, frame: str) -> MessagePart:
    """Return the messages of a part whose header names a frame; in CDR the frame name follows the stamp."""
    wanted = np.frombuffer(frame.encode() + b"\0", dtype=np.uint8)
    end = wire.FRAME_AT + len(wanted)
    part = part.at(part.size >= end)
    if not len(part):
        return part
    heads = rows_at(part.data, part.offset, end)
    lengths = heads[:, wire.FRAME_AT - 4 : wire.FRAME_AT].copy().view("<u4")[:, 0]
    return part.at((lengths == len(wanted)) & (heads[:, wire.FRAME_AT :] == wanted).all(axis=1))


def _with_fields(samples: Samples, layout: wire.Layout, some: tuple[str, ...] | None) -> Samples:
    """Return samples reduced to some of their fields; None keeps all fields."""
    if some is None:
        return samples
    chosen = np.empty(len(samples), dtype=layout.dtype_of(some))
    for field in chosen.dtype.names or ():
        chosen[field] = samples[field]
    return chosen


def _plain_value(value: Any) -> Any:
    # A vector or quaternion is a message of its own in ROS, and a row of numbers in a layout.
    if hasattr(value, "__msgtype__"):
        return [getattr(value, field.name) for field in dataclasses.fields(value) if not field.name.startswith("_")]
    return value


def _without_slack(store: Any, data: bytes, type_name: str) -> Any:
    """
    Decode a message that is followed by unused bytes.

    The middleware adds the alignment of sequence items to the size of a message even if a sequence is empty, so that up
    to four bytes per sequence stay unused after the last field. Each sequence has a count of four bytes, so there are
    never more unused bytes than used bytes.

    Raises SerdeError if the bytes are not a message of the type.
    """
    definition = store.get_msgdef(type_name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    message, end = read(data[4:], 0, definition.cls, store)
    if len(data) - 4 > 2 * end:
        raise SerdeError(f"it is not a {type_name}")
    return message
