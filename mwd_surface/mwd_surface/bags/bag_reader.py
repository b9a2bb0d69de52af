"""
A bag as arrays: blocks of samples in time order, in constant memory, at the speed of decompression.

Chunks of MCAP files are decompressed ahead in a thread and their messages gathered as rows without touching them one by
one. What that way cannot read (sqlite3 storage, messages compressed singly, big-endian or odd messages) goes through
`rosbags` by itself, and `Bag.notes` says so.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import re
import tempfile
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader as RosbagsReader

from mwd_sensors import burst, wire
from mwd_surface.bags import bag_metadata, mcap_format
from mwd_surface.bags.bag_metadata import MetadataError
from mwd_surface.bags.definitions import DefinitionError, Definitions
from mwd_surface.bags.mcap_format import Attachment, FormatError
from mwd_surface.bags.mcap_index import Contents, McapFile, Span

Stamps = NDArray[np.int64]
Block = dict[str, tuple[Stamps, Any]]
Message = tuple[int, str, str, bytes]
Fields = Mapping[str, tuple[str, ...]]

_AHEAD = 4
_AHEAD_BYTES = 64 * 1024 * 1024
_MANY = 2**62
_MAX_MESSAGE_BYTES = 64 * 1024 * 1024


class BagError(Exception):
    """A bag that cannot be used: what is wrong in one sentence, and in `hint` what to do about it."""

    def __init__(self, sentence: str, hint: str = "") -> None:
        super().__init__(f"{sentence}; {hint}" if hint else sentence)
        self.sentence = sentence
        self.hint = hint


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
        ``cdr`` for ROS 2.
    """

    name: str
    type_name: str
    count: int
    schema_encoding: str = ""
    schema: str = ""
    type_hash: str = ""
    qos: str = ""
    serialization: str = "cdr"


@dataclasses.dataclass(frozen=True)
class Originals:
    """
    Messages as they lie in a bag, in order of their log time.

    Attributes
    ----------
    data : ndarray of uint8
        Bytes they are part of.
    log_ns, offset, size : ndarray of int64, shape (n,)
        Log time, and where each payload begins and how long it is.
    topic : ndarray of int64, shape (n,)
        Place of each message's topic in `Bag.topics`.
    framed : bool
        Each payload follows the head of its MCAP record in `data`.
    """

    data: NDArray[np.uint8]
    log_ns: Stamps
    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    topic: NDArray[np.int64]
    framed: bool


@dataclasses.dataclass
class _Part:
    """Messages of one span, selected and in time order."""

    rank: tuple[int, int]
    file: int
    data: NDArray[np.uint8]
    log_ns: Stamps
    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    channel: NDArray[np.uint16]

    def split(self, mark: int) -> tuple[_Part, _Part]:
        """Messages before and from a time on."""
        cut = int(np.searchsorted(self.log_ns, mark))
        return self.at(slice(0, cut)), self.at(slice(cut, None))

    def at(self, where: Any) -> _Part:
        """A selection of the messages."""
        return _Part(
            self.rank,
            self.file,
            self.data,
            self.log_ns[where],
            self.offset[where],
            self.size[where],
            self.channel[where],
        )


class Bag:
    """
    A recording opened for reading: a rosbag2 directory, or a bare ``.mcap`` or ``.db3`` file.

    Parameters
    ----------
    path : Path or str

    Attributes
    ----------
    topics : dict of str to TopicInfo
    start_ns, end_ns : int
        Log time of the first and of the last message; both 0 when there is none.
    notes : list of str
        What was unusual or damaged, one sentence each; grows while reading.
    files : list of Path
        The files read, as they lie on the disk.
    size_bytes : int
        Of these files.
    storage : str
        ``mcap`` or ``sqlite3``.
    custom : dict of str
        ``custom_data`` of metadata.yaml.
    damaged_chunks, damaged_messages : int
        Skipped while reading because a checksum or a layout was wrong.
    complete : bool
        False for a recording that was cut off or is damaged, as far as known.

    Raises
    ------
    BagError
        There is nothing at `path`, it is no bag, or it holds no message.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.topics: dict[str, TopicInfo] = {}
        self.start_ns = self.end_ns = 0
        self.notes: list[str] = []
        self.damaged_chunks = self.damaged_messages = 0
        self.complete = True
        self.custom: dict[str, str] = {}
        self.files: list[Path] = []
        self.size_bytes = 0
        self.storage = ""
        self._files: list[tuple[McapFile, Contents]] = []
        self._names: list[dict[int, str]] = []
        self._rosbags: RosbagsReader | None = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._definitions: Definitions | None = None
        self._message_compression = False
        self._told: set[str] = set()
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    @property
    def message_count(self) -> int:
        """Messages in all topics, as the bag's index says."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def find_topic(self, type_name: str, suffix: str = "") -> str:
        """
        The topic of a type whose name ends like this, in whatever namespace.

        suffix : relative name, for example ``imu/data_raw``, matched from a slash on; empty matches every name.

        Raises
        ------
        BagError
            There is none, or more than one; both list what there is.
        """
        tail = suffix.strip("/")
        of_type = [topic for topic in self.topics.values() if topic.type_name == type_name]
        found = [topic.name for topic in of_type if not tail or ("/" + topic.name.strip("/")).endswith("/" + tail)]
        if len(found) == 1:
            return found[0]
        if found:
            raise BagError(
                f"{self.path} has {len(found)} topics of {type_name} that end in {tail!r}: {', '.join(found)}",
                "name the one you mean",
            )
        wanted = f"that ends in {tail!r}" if tail else ""
        if of_type:
            hint = f"topics of that type: {', '.join(topic.name for topic in of_type)}; name the one you mean"
        else:
            hint = f"it has {', '.join(f'{topic.name} ({topic.type_name})' for topic in self.topics.values())}"
        raise BagError(f"{self.path} has no topic of {type_name} {wanted}".rstrip(), hint)

    def blocks(
        self,
        topics: Sequence[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        block_messages: int = 16384,
        fields: Fields | None = None,
    ) -> Iterator[Block]:
        """
        Samples in log-time order, block by block, in constant memory.

        Parameters
        ----------
        topics : sequence of str, optional
            Names as in `topics`; by default all.
        start_ns, end_ns : int, optional
            Log time from (inclusive) and to (exclusive).
        block_messages : int
            A block ends after about so many messages of all topics together.
        fields : mapping of str to tuple of str, optional
            By type name, which fields to read besides the stamp; types that are not named are read whole.

        Yields
        ------
        dict of str to (log_ns, samples)
            Only topics with a message in the block. log_ns, shape (n,), int64, not decreasing. Samples: a structured
            array of the type's layout in `wire.LAYOUTS`, or a list of bytes for types without one (see `decode`).
            A topic of bursts gives the samples they carry.
            Everything in one block was logged before, or at the same time as, everything in the next.

        Raises
        ------
        BagError
            A topic the bag doesn't have.
        """
        wanted = self._checked(topics)
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        count = 0
        for group in self._groups(wanted, start_ns, end_ns):
            for part in group:
                for name, log_ns, samples in self._samples(part, fields or {}):
                    pieces.setdefault(name, []).append((log_ns, samples))
                    count += len(log_ns)
            if count >= block_messages:
                yield from _blocks_of(pieces, block_messages)
                pieces, count = {}, 0
        if count:
            yield from _blocks_of(pieces, block_messages)

    def blocks_and_originals(
        self,
        topics: Sequence[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
        block_messages: int = 16384,
        fields: Fields | None = None,
    ) -> Iterator[tuple[Block, list[Originals]]]:
        """
        As `blocks`, and with each block every message of the bag of its time, those of other topics too, as it lies.

        A block has no upper size but that of the chunks of one time, and may be without a sample.
        """
        wanted = set(self._checked(topics))
        pieces: dict[str, list[tuple[Stamps, Any]]] = {}
        originals: list[Originals] = []
        count = 0
        for group in self._groups(list(self.topics), start_ns, end_ns):
            for part in group:
                for name, log_ns, samples in self._samples(part, fields or {}, wanted):
                    pieces.setdefault(name, []).append((log_ns, samples))
                originals.append(self._originals(part))
                count += len(part.log_ns)
            if count >= block_messages:
                yield next(_blocks_of(pieces, _MANY), {}), originals
                pieces, originals, count = {}, [], 0
        if count:
            yield next(_blocks_of(pieces, _MANY), {}), originals

    def messages(
        self, topics: Sequence[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Message]:
        """
        (log_ns, topic, type, bytes) of every message in log-time order, in constant memory.

        Messages with the same log time come in the order of the file. Arguments and errors as `blocks`.
        """
        wanted = self._checked(topics)
        for group in self._groups(wanted, start_ns, end_ns):
            yield from self._in_order(group)

    def decode(self, topic: str, data: bytes) -> Any:
        """
        A message as an object with the fields of its type.

        Raises
        ------
        BagError
            The type is unknown here and in the bag, or the bytes are not of it.
        """
        about = self.topics[topic]
        try:
            store = self._knowing(about).typestore
            return store.deserialize_cdr(data, about.type_name)
        except DefinitionError as error:
            raise BagError(f"{topic} cannot be decoded: {error}") from error
        except Exception as error:
            # Bytes that lie can fail in any way inside a decoder.
            raise BagError(f"a message of {topic} is not a {about.type_name}: {error!r}") from error

    def attachments(self) -> list[Attachment]:
        """Files kept inside the bag; damaged ones are noted and left out."""
        return [mcap_format.parse_attachment(body) for body in self._extra("attachments", mcap_format.ATTACHMENT)]

    def metadata(self) -> dict[str, dict[str, str]]:
        """Named tables kept inside the bag; a later file's table of the same name replaces an earlier one's."""
        return dict(mcap_format.parse_metadata(body) for body in self._extra("metadata", mcap_format.METADATA))

    def close(self) -> None:
        """Close the files."""
        for file, _ in self._files:
            file.close()
        self._files = []
        if self._rosbags is not None and self._rosbags.is_open:
            self._rosbags.close()
        if self._scratch is not None:
            self._scratch.cleanup()
            self._scratch = None

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # Opening

    def _open(self) -> None:
        if not self.path.exists():
            raise BagError(f"there is nothing at {self.path}", "check the path; a bag is a folder or an .mcap file")
        files = self._directory() if self.path.is_dir() else [self.path]
        if not files:
            raise BagError(f"{self.path} holds no recording", "a bag has .mcap or .db3 files and a metadata.yaml")
        self.files, self.size_bytes = files, sum(file.stat().st_size for file in files)
        suffixes = {_suffix(file) for file in files}
        self.storage = "sqlite3" if suffixes == {".db3"} else "mcap"
        if suffixes == {".mcap"}:
            self._open_mcap(files)
        elif suffixes == {".db3"}:
            self._open_rosbags(files)
        else:
            raise BagError(f"{self.path} is not a bag", "expected a folder with metadata.yaml, an .mcap or a .db3 file")
        if not self.topics or self.message_count == 0:
            reason = "; ".join(self.notes)
            raise BagError(f"{self.path} holds no message" + (f" ({reason})" if reason else ""), "record it again")

    def _directory(self) -> list[Path]:
        there = sorted(
            (file for file in self.path.iterdir() if _suffix(file) in (".mcap", ".db3") and file.is_file()),
            key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)],
        )
        try:
            about = bag_metadata.read(self.path)
        except MetadataError as error:
            if there:
                self.notes.append(f"{error}; used the files that are there")
            return there
        self.custom = dict(about.custom)
        self._message_compression = about.compression_mode == "message"
        listed = [self.path / file.path for file in about.files]
        missing = [file.name for file in listed if not file.exists()]
        if missing:
            self.notes.append(f"missing: {', '.join(missing)}, named in metadata.yaml")
            self.complete = False
        extra = [file for file in there if file not in listed and not about.compression_mode]
        if extra:
            self.notes.append(f"{', '.join(file.name for file in extra)} read too, although not in metadata.yaml")
        return [file for file in listed if file.exists()] + extra

    def _open_mcap(self, files: list[Path]) -> None:
        problems = []
        for path in files:
            try:
                file = McapFile(self._unpacked(path))
            except FormatError as error:
                problems.append(f"{path.name}: {error}")
                continue
            except OSError as error:
                problems.append(f"{path.name} cannot be opened: {error.strerror}")
                continue
            contents = file.contents()
            self._files.append((file, contents))
            self.notes += contents.notes
            self.complete = self.complete and contents.complete
        if problems and not self._files:
            raise BagError(f"{self.path} cannot be read: {'; '.join(problems)}", "`mwd recover` may save parts of it")
        if problems:
            self.notes += [f"{problem}; skipped" for problem in problems]
            self.complete = False
        for _, contents in self._files:
            self._names.append(self._join_topics(contents))
        spans = [span for _, contents in self._files for span in contents.spans]
        if spans:
            self.start_ns = min(span.start_ns for span in spans)
            self.end_ns = max(span.end_ns for span in spans)
        if not all(contents.checksums for _, contents in self._files):
            self.notes.append("the recording carries no checksums: damage inside it would not be seen")
        if self._message_compression:
            self.notes.append("messages are compressed one by one: read slowly")

    def _join_topics(self, contents: Contents) -> dict[int, str]:
        names = {}
        for number, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            type_name = schema.name if schema else ""
            known = self.topics.get(channel.topic)
            if known is not None and known.type_name != type_name:
                self.notes.append(
                    f"{channel.topic} has messages of {known.type_name} and of {type_name}; the latter are left out"
                )
                continue
            count = contents.counts.get(number, 0) + (known.count if known else 0)
            self.topics[channel.topic] = TopicInfo(
                channel.topic,
                type_name,
                count,
                schema.encoding if schema else "",
                schema.data.decode(errors="replace") if schema else "",
                channel.metadata.get("topic_type_hash", ""),
                channel.metadata.get("offered_qos_profiles", ""),
                channel.encoding,
            )
            names[number] = channel.topic
        orphans = sum(count for number, count in contents.counts.items() if number not in contents.channels)
        if orphans:
            self.notes.append(f"{orphans} messages belong to no topic, for its declaration is lost; left out")
            self.complete = False
        return names

    def _open_rosbags(self, files: list[Path]) -> None:
        path = self.path
        if path.is_file() and path.suffix == ".zstd":
            path = self._unpacked(path)
        try:
            self._rosbags = RosbagsReader(path)
            self._rosbags.open()
        except Exception as error:
            # rosbags, sqlite and its YAML parser each raise their own kinds.
            raise BagError(f"{self.path} cannot be read: {error}", "is it a rosbag2 recording?") from error
        for name, info in self._rosbags.topics.items():
            connection = info.connections[0]
            self.topics[name] = TopicInfo(
                name,
                connection.msgtype,
                info.msgcount,
                info.msgdef.format.name.lower(),
                info.msgdef.data,
                connection.digest,
                "",
                getattr(connection.ext, "serialization_format", "cdr"),
            )
        if self._rosbags.message_count:
            self.start_ns, self.end_ns = self._rosbags.start_time, self._rosbags.end_time - 1
        self._message_compression = False  # rosbags undoes it itself
        self.notes.append(f"{files[0].suffix} storage: read through rosbags, which is slower")

    def _unpacked(self, path: Path) -> Path:
        if path.suffix != ".zstd":
            return path
        self._scratch = self._scratch or tempfile.TemporaryDirectory(prefix="mwd_bag_")
        target = Path(self._scratch.name) / path.stem
        try:
            with path.open("rb") as packed, target.open("wb") as plain:
                zstandard.ZstdDecompressor().copy_stream(packed, plain)
        except zstandard.ZstdError as error:
            raise FormatError(f"the file does not decompress: {error}") from error
        self.notes.append(f"{path.name} was decompressed to a temporary file first")
        return target

    # Reading

    def _checked(self, topics: Sequence[str] | None) -> list[str]:
        if topics is None:
            return list(self.topics)
        for name in topics:
            if name not in self.topics:
                raise BagError(f"{self.path} has no topic {name}", f"it has {', '.join(self.topics)}")
        return list(topics)

    def _groups(self, topics: list[str], start_ns: int | None, end_ns: int | None) -> Iterator[list[_Part]]:
        """Groups of parts: everything in one is logged no later than everything in the next."""
        start, end = start_ns or 0, _MANY if end_ns is None else end_ns
        if self._rosbags is not None:
            yield from self._rosbags_groups(self._rosbags, topics, start, end)
            return
        chosen: list[tuple[int, Span]] = []
        for number, (_, contents) in enumerate(self._files):
            channels = {key for key, name in self._names[number].items() if name in topics}
            for span in contents.spans:
                inside = span.end_ns >= start and span.start_ns < end
                if inside and (span.channels is None or not channels.isdisjoint(span.channels)):
                    chosen.append((number, span))
        chosen.sort(key=lambda item: (item[1].start_ns, item[0], item[1].offset))
        pending: list[_Part] = []
        for k, part in enumerate(self._ahead(chosen, topics, start, end)):
            if part is not None:
                pending.append(part)
            mark = chosen[k + 1][1].start_ns if k + 1 < len(chosen) else _MANY
            released, kept = [], []
            for waiting in pending:
                early, late = waiting.split(mark)
                if len(early.log_ns):
                    released.append(early)
                if len(late.log_ns):
                    kept.append(late)
            pending = kept
            if released:
                yield sorted(released, key=lambda one: one.rank)

    def _ahead(self, chosen: list[tuple[int, Span]], topics: list[str], start: int, end: int) -> Iterator[_Part | None]:
        """Parts of the chosen spans, loaded by a thread a few spans ahead of their use."""
        waiting: deque[tuple[concurrent.futures.Future[_Part], int]] = deque()
        wanted = []
        for names in self._names:
            mask = np.zeros(65536, dtype=np.bool_)
            mask[[number for number, name in names.items() if name in topics]] = True
            wanted.append(mask)
        # One thread: it keeps ahead of any consumer, and a second one costs more in contended memory than it brings.
        pool = concurrent.futures.ThreadPoolExecutor(1, thread_name_prefix="bag")
        decompress = mcap_format.Decompressor()
        try:
            position, held = 0, 0
            while position < len(chosen) or waiting:
                while position < len(chosen) and len(waiting) < _AHEAD and (not waiting or held < _AHEAD_BYTES):
                    number, span = chosen[position]
                    waiting.append(
                        (pool.submit(self._load, decompress, number, span, wanted[number], start, end), span.size)
                    )
                    held += span.size
                    position += 1
                future, size = waiting.popleft()
                held -= size
                try:
                    yield future.result()
                except (FormatError, MemoryError) as error:
                    self.damaged_chunks += 1
                    self.complete = False
                    self.notes.append(f"a damaged chunk was skipped: {error}")
                    yield None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _load(
        self,
        decompress: mcap_format.Decompressor,
        number: int,
        span: Span,
        wanted: NDArray[np.bool_],
        start: int,
        end: int,
    ) -> _Part:
        data = np.frombuffer(self._files[number][0].plain(span, decompress), dtype=np.uint8)
        walk = mcap_format.walk(data)
        if walk.end != len(data):
            raise FormatError(f"a chunk's records end at byte {walk.end} of {len(data)}")
        part = _Part((number, span.offset), number, data, walk.log_ns, walk.offset, walk.size, walk.channel)
        chosen = wanted[walk.channel]
        if start > 0 or end < _MANY:
            chosen &= (walk.log_ns >= start) & (walk.log_ns < end)
        if not chosen.all():
            part = part.at(chosen)
        if len(part.log_ns) and (part.log_ns[1:] < part.log_ns[:-1]).any():
            part = part.at(np.argsort(part.log_ns, kind="stable"))
        return part

    def _in_order(self, group: list[_Part]) -> Iterator[Message]:
        which = np.concatenate([np.full(len(part.log_ns), k) for k, part in enumerate(group)])
        inside = np.concatenate([np.arange(len(part.log_ns)) for part in group])
        order = np.argsort(np.concatenate([part.log_ns for part in group]), kind="stable")
        views = [memoryview(part.data) for part in group]  # type: ignore[arg-type]
        tables = [
            (part.log_ns.tolist(), part.offset.tolist(), part.size.tolist(), part.channel.tolist()) for part in group
        ]
        names = [self._part_names(part) for part in group]
        for k, row in zip(which[order].tolist(), inside[order].tolist(), strict=True):
            log_ns, offset, size, channel = tables[k]
            at = offset[row]
            name = names[k][channel[row]]
            data = bytes(views[k][at : at + size[row]])
            if self._message_compression:
                unpacked = self._unzipped(data)
                if unpacked is None:
                    continue
                data = unpacked
            yield log_ns[row], name, self.topics[name].type_name, data

    def _part_names(self, part: _Part) -> Mapping[int, str]:
        return self._names[part.file] if self._rosbags is None else dict(enumerate(self.topics))

    def _originals(self, part: _Part) -> Originals:
        if self._message_compression:
            rows = []
            for log_ns, at, size, channel in zip(part.log_ns, part.offset, part.size, part.channel, strict=True):
                data = self._unzipped(part.data[at : at + size].tobytes())
                if data is not None:
                    rows.append((int(log_ns), int(channel), data))
            plain = _part_of(rows)
            part = dataclasses.replace(plain, rank=part.rank, file=part.file)
        places = {name: place for place, name in enumerate(self.topics)}
        table = np.zeros(65536, dtype=np.int64)
        for channel, name in self._part_names(part).items():
            table[channel] = places[name]
        framed = self._rosbags is None and not self._message_compression
        return Originals(part.data, part.log_ns, part.offset, part.size, table[part.channel], framed)

    def _samples(
        self, part: _Part, fields: Fields, wanted: set[str] | None = None
    ) -> Iterator[tuple[str, Stamps, Any]]:
        """(topic, log_ns, samples) of a part; messages that are not of their type are counted and left out."""
        names = self._part_names(part)
        numbers = np.unique(part.channel)
        for number in numbers.tolist():
            name = names[number]
            if wanted is not None and name not in wanted:
                continue
            mine = part if len(numbers) == 1 else part.at(part.channel == number)
            if self.topics[name].type_name == burst.TYPE_NAME:
                yield name, *self._from_bursts(name, mine, fields.get(wire.IMU.type_name))
                continue
            layout = wire.LAYOUTS.get(self.topics[name].type_name)
            some = fields.get(self.topics[name].type_name)
            if self._message_compression or layout is None or self.topics[name].serialization != "cdr":
                listed = [mine.data[a : a + n].tobytes() for a, n in zip(mine.offset, mine.size, strict=True)]
                yield name, *self._from_list(name, layout, mine.log_ns, listed, some)
                continue
            if (mine.size == mine.size[0]).all():
                yield name, *self._from_rows(name, layout, mine, some)
                continue
            kinds = [mine.at(mine.size == size) for size in np.unique(mine.size)]
            yield name, *_merged([self._from_rows(name, layout, kind, some) for kind in kinds])

    def _from_rows(
        self, name: str, layout: wire.Layout, part: _Part, some: tuple[str, ...] | None
    ) -> tuple[Stamps, wire.Samples]:
        """Samples of messages of one size."""
        size = int(part.size[0])
        rows = _rows(part.data, part.offset, size)
        try:
            return part.log_ns, layout.decode(rows, some)
        except wire.WireError as error:
            frames = rows[:, 12:16].copy().view("<u4")[:, 0] if size >= 16 else np.zeros(len(rows), dtype="<u4")
            kinds = np.unique(frames)
            if 1 < len(kinds) <= 16:
                # Frame names of other lengths can hide in messages of one size, behind the padding.
                return _merged([self._from_rows(name, layout, part.at(frames == kind), some) for kind in kinds])
            self._tell(f"{name}: some messages are not in the fixed layout ({error}); read through rosbags")
        listed = [part.data[a : a + size].tobytes() for a in part.offset]
        log_ns, samples = self._from_list(name, layout, part.log_ns, listed, some)
        return log_ns, samples

    def _from_bursts(self, name: str, part: _Part, some: tuple[str, ...] | None) -> tuple[Stamps, wire.Samples]:
        """The samples that bursts carry, each with the log time of its burst."""
        listed = [part.data[a : a + n].tobytes() for a, n in zip(part.offset, part.size, strict=True)]
        log_ns, listed = self._from_list(name, None, part.log_ns, listed, some)
        parts, counts = [wire.IMU.empty(0)], []
        for data in listed:
            try:
                parts.append(burst.decode(data))
                counts.append(len(parts[-1]))
            except wire.WireError as error:
                counts.append(0)
                self.damaged_messages += 1
                self._tell(f"{name}: a message cannot be decoded and is left out: {error}")
        samples = np.concatenate(parts)
        if some is not None:
            chosen = np.empty(len(samples), dtype=wire.IMU.dtype_of(some))
            for field in chosen.dtype.names or ():
                chosen[field] = samples[field]
            samples = chosen
        return np.repeat(log_ns, counts), samples

    def _from_list(
        self,
        name: str,
        layout: wire.Layout | None,
        log_ns: Stamps,
        listed: list[bytes],
        some: tuple[str, ...] | None,
    ) -> tuple[Stamps, Any]:
        if self._message_compression:
            unzipped = [self._unzipped(data) for data in listed]
            keep = np.array([data is not None for data in unzipped], dtype=np.bool_)
            log_ns, listed = log_ns[keep], [data for data in unzipped if data is not None]
        if layout is None or self.topics[name].serialization != "cdr":
            return log_ns, listed
        samples, keep = layout.empty(len(listed)), np.ones(len(listed), dtype=np.bool_)
        for k, data in enumerate(listed):
            try:
                samples[k] = self._one_sample(name, layout, data)
            except (BagError, ValueError, AttributeError) as error:
                keep[k] = False
                self.damaged_messages += 1
                self._tell(f"{name}: a message cannot be decoded and is left out: {error}")
        if some is None:
            return log_ns[keep], samples[keep]
        chosen = np.empty(len(samples), dtype=layout.dtype_of(some))
        for field in chosen.dtype.names or ():
            chosen[field] = samples[field]
        return log_ns[keep], chosen[keep]

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

    def _unzipped(self, data: bytes) -> bytes | None:
        reason = f"it claims more than {_MAX_MESSAGE_BYTES} bytes"
        try:
            if zstandard.frame_content_size(data) <= _MAX_MESSAGE_BYTES:
                return zstandard.ZstdDecompressor().decompress(data, max_output_size=_MAX_MESSAGE_BYTES)
        except (zstandard.ZstdError, MemoryError) as error:
            reason = str(error)
        self.damaged_messages += 1
        self._tell(f"a compressed message is damaged and left out: {reason}")
        return None

    def _rosbags_groups(self, reader: RosbagsReader, topics: list[str], start: int, end: int) -> Iterator[list[_Part]]:
        numbers = {name: number for number, name in enumerate(self.topics)}
        connections = [one for one in reader.connections if one.topic in topics]
        rows: list[tuple[int, int, bytes]] = []
        try:
            for connection, log_ns, data in reader.messages(connections, start or None, end if end < _MANY else None):
                rows.append((log_ns, numbers[connection.topic], bytes(data)))
                if len(rows) >= 4096:
                    yield [_part_of(rows)]
                    rows = []
        except Exception as error:  # noqa: BLE001  (sqlite, rosbags and zstd each raise their own kinds)
            self.complete = False
            self.notes.append(f"reading stopped early: {error}")
        if rows:
            yield [_part_of(rows)]

    def _extra(self, kind: str, opcode: int) -> Iterator[bytes]:
        for file, contents in self._files:
            for offset, _ in getattr(contents, kind):
                try:
                    body = file.body(offset, opcode)
                    if opcode == mcap_format.ATTACHMENT:
                        mcap_format.parse_attachment(body)
                    else:
                        mcap_format.parse_metadata(body)
                except FormatError as error:
                    self._tell(f"one of the {kind} is damaged and left out: {error}")
                    continue
                yield body

    def _knowing(self, about: TopicInfo) -> Definitions:
        if self._definitions is None:
            self._definitions = Definitions()
        if about.type_name not in self._definitions.typestore.fielddefs:
            if about.schema and about.schema_encoding in ("ros2msg", "msg"):
                self._definitions.learn(about.type_name, about.schema)
            else:
                self._definitions.load(about.type_name)
        return self._definitions

    def _tell(self, note: str) -> None:
        # One note per kind and topic, not one per message.
        key = note.split("(")[0].split(": it ")[0][:80]
        if key not in self._told:
            self._told.add(key)
            self.notes.append(note)


def _blocks_of(pieces: dict[str, list[tuple[Stamps, Any]]], block_messages: int) -> Iterator[Block]:
    """Pieces of each topic joined and sorted, in blocks of about the size asked for that end at one time for all."""
    joined: Block = {}
    for name, parts in pieces.items():
        log_ns = parts[0][0] if len(parts) == 1 else np.concatenate([part[0] for part in parts])
        samples = parts[0][1]
        if len(parts) > 1:
            listed = isinstance(samples, list)
            samples = [one for part in parts for one in part[1]] if listed else _one_array([p[1] for p in parts])
        if (log_ns[1:] < log_ns[:-1]).any():
            order = np.argsort(log_ns, kind="stable")
            log_ns = log_ns[order]
            samples = [samples[k] for k in order.tolist()] if isinstance(samples, list) else samples[order]
        joined[name] = (log_ns, samples)
    total = sum(len(log_ns) for log_ns, _ in joined.values())
    if total < 2 * block_messages:
        yield {name: part for name, part in joined.items() if len(part[0])}
        return
    # A chunk larger than a block: cut all topics at the same times.
    times = np.sort(np.concatenate([log_ns for log_ns, _ in joined.values()]))
    marks = np.unique(times[block_messages::block_messages])
    done = dict.fromkeys(joined, 0)
    for mark in [*marks.tolist(), _MANY]:
        block: Block = {}
        for name, (log_ns, samples) in joined.items():
            cut = int(np.searchsorted(log_ns, mark))
            if cut > done[name]:
                block[name] = (log_ns[done[name] : cut], samples[done[name] : cut])
                done[name] = cut
        if block:
            yield block


def _merged(parts: list[tuple[Stamps, wire.Samples]]) -> tuple[Stamps, wire.Samples]:
    if len(parts) == 1:
        return parts[0]
    log_ns = np.concatenate([part[0] for part in parts])
    order = np.argsort(log_ns, kind="stable")
    return log_ns[order], _one_array([part[1] for part in parts])[order]


def _one_array(parts: list[wire.Samples]) -> wire.Samples:
    """Samples of one type one after another; as bytes, because numpy joins records field by field."""
    joined: NDArray[np.uint8] = np.concatenate([part.view(np.uint8) for part in parts])
    return joined.view(parts[0].dtype)


def _rows(data: NDArray[np.uint8], offset: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Messages of one size as rows, shape (n, size): a view where they lie at even distances, else a copy."""
    if len(offset) > 1:
        steps = offset[1:] - offset[:-1]
        if steps[0] > 0 and (steps == steps[0]).all():
            first = int(offset[0])
            return np.lib.stride_tricks.as_strided(
                data[first:], (len(offset), size), (int(steps[0]), 1), writeable=False
            )
    return np.lib.stride_tricks.sliding_window_view(data, size)[offset]


def _part_of(rows: list[tuple[int, int, bytes]]) -> _Part:
    log_ns = np.array([row[0] for row in rows], dtype=np.int64)
    size = np.array([len(row[2]) for row in rows], dtype=np.int64)
    channel = np.array([row[1] for row in rows], dtype=np.uint16)
    data = np.frombuffer(b"".join(row[2] for row in rows), dtype=np.uint8)
    return _Part((0, 0), 0, data, log_ns, np.cumsum(size) - size, size, channel)


def _plain_value(value: Any) -> Any:
    # A vector or quaternion is a message of its own in ROS, and a row of numbers in a layout.
    if hasattr(value, "__msgtype__"):
        return [getattr(value, field.name) for field in dataclasses.fields(value) if not field.name.startswith("_")]
    return value


def _suffix(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == ".zstd" else path.suffix
