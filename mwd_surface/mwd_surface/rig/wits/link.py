# SPDX-License-Identifier: Apache-2.0
"""
WITS level 0 conversations: full duplex, with any number of peers at a time, over any transport.

A slow peer loses the oldest waiting packets, and is disconnected after a while; it never delays other peers. Data from
peers are read by a decoder with bounded memory. `RigInput` checks the rig data, which are accepted from one peer at a
time.
"""

from __future__ import annotations

import asyncio
import dataclasses
import time
from collections import Counter, deque

from mwd_sensors.core.settings import setting
from mwd_surface.rig.input import RigInput, RigInputSettings
from mwd_surface.rig.interface import InterfaceStatus, OnRigState, PeerStatus, RigInterface
from mwd_surface.rig.values import RigValues
from mwd_surface.rig.wits.format import KEEP_ALIVE, Decoder, DecoderCounts, WitsFrame, encode
from mwd_surface.rig.wits.records import Items, RecordWriter, Wits0Format, rig_readings, shown

# Schedule of WITS packets: surveys once when accepted, toolfaces when they arrive, other records periodically.


@dataclasses.dataclass(frozen=True)
class Wits0Schedule:
    """Times between WITS packets."""

    toolface_period: float = setting(
        4.0, "Shortest time between two toolfaces. Lowering it loads a slow serial line.", unit="s", low=1.0, high=60.0
    )
    record_period: float = setting(
        5.0, "Time between two records 8 and 9. Lowering it loads a slow serial line.", unit="s", low=1.0, high=600.0
    )
    keep_alive: float = setting(
        30.0,
        "Time between two keep-alive packets. Lowering it loads a slow serial line.",
        unit="s",
        low=5.0,
        high=600.0,
    )
    stream_survey: bool = setting(
        False, "Send the last accepted survey again every record_period. If false, send it once, when it is accepted."
    )


class Wits0Sender:
    """Scheduler that returns the packets that are due; times are steady time, s."""

    def __init__(self, form: Wits0Format, schedule: Wits0Schedule) -> None:
        self.form, self.schedule = form, schedule
        self._writer = RecordWriter(form)
        self._sent_keys: set[tuple[str, int, int]] | None = None
        self._sent_last = ""  # uuid of the survey that the peers have as the last one
        self._toolface_at = self._records_at = self._alive_at = -1e9
        self._toolface_stamp = 0

    def due(self, values: RigValues, now: float) -> list[bytes]:
        """Return the packets that are due for all peers, in order: surveys, toolface, records 8 and 9, keep-alive."""
        groups = self._surveys(values)
        toolface = values.toolface
        new = toolface.stamp_ns != self._toolface_stamp or not toolface.condition.usable
        if new and now - self._toolface_at >= self.schedule.toolface_period:
            items = self._writer.toolface(values)
            if items:
                groups.append(items)
                self._toolface_at, self._toolface_stamp = now, toolface.stamp_ns
        if now - self._records_at >= self.schedule.record_period:
            self._records_at = now
            if self.schedule.stream_survey and values.survey is not None:
                groups.append(self._writer.survey(values, values.survey))
            groups += [self._writer.formation(values), self._writer.mechanical(values)]
        packets = self._packets(groups)
        if now - self._alive_at >= self.schedule.keep_alive:
            self._alive_at = now
            packets.append(KEEP_ALIVE)
        return packets

    def greeting(self, values: RigValues) -> list[bytes]:
        """Return the packets for a new peer: the last accepted survey and the toolface in force."""
        survey = values.survey
        groups = [] if survey is None else [self._writer.survey(values, survey)]
        return self._packets([*groups, self._writer.toolface(values)])

    def _surveys(self, values: RigValues) -> list[Items]:
        """
        Return the records of new and changed surveys; the last one is always that of the last accepted survey.

        WITS cannot withdraw a survey. If an older survey changes, or the latest one is no longer accepted, the latest
        survey that is still accepted is sent again, so that the peers do not keep another one as the last.
        """
        before, last = self._sent_last, values.survey
        known = {s.key for s in values.surveys} if self._sent_keys is None else self._sent_keys
        fresh = [s for s in values.surveys if s.key not in known]
        # Surveys accepted before the start are not sent as new; the packets for a new peer contain the last one.
        withdrawn = before not in {"", *(s.result.uuid for s in values.surveys)}
        if last is not None and (withdrawn or fresh) and last not in fresh[-1:]:
            fresh.append(last)
        self._sent_keys = {s.key for s in values.surveys}
        self._sent_last = "" if last is None else last.result.uuid
        return [self._writer.survey(values, s) for s in fresh]

    def _packets(self, groups: list[Items]) -> list[bytes]:
        groups = [items for items in groups if items]
        if self.form.mixed:
            groups = _merged(groups)
        return [encode(items, self.form.source) for items in groups]


def _merged(groups: list[Items]) -> list[Items]:
    """Return records merged into packets, in order, so that no packet holds the same record twice."""
    merged: list[Items] = []
    inside: set[int] = set()
    for items in groups:
        record = items[0][0] // 100
        if merged and record not in inside:
            merged[-1] = merged[-1] + items
        else:
            merged.append(items)
            inside = set()
        inside.add(record)
    return merged


_TICK = 0.5  # time between checks for packets that are due, s
_BUFFER_BYTES = 2048  # number of outgoing bytes above which a peer counts as slow
_SOURCE_SILENT = 10.0  # time of silence, s, after which another peer may become the source of rig data


@dataclasses.dataclass(frozen=True)
class Wits0Settings:
    """Settings common to all WITS interfaces."""

    form: Wits0Format = setting(Wits0Format, "Format of the records.")
    schedule: Wits0Schedule = setting(Wits0Schedule, "Times between records.")
    rig: RigInputSettings = setting(RigInputSettings, "Acceptance of the rig's data.")
    queue_bytes: int = setting(
        16384,
        "Largest amount of data, in bytes, that waits for a slow peer; beyond it the oldest packets are dropped. "
        "Raising it delays new values to a slow peer.",
        low=1024,
    )
    send_timeout: float = setting(
        15.0,
        "Time without accepting data after which a peer is disconnected. Raise it for a slow network.",
        unit="s",
        low=0.2,
        high=300.0,
    )


class Peer:
    """One connection: packets waiting to be sent, decoder of received data, and counts."""

    def __init__(self, address: str, queue_bytes: int, since: float) -> None:
        self.address, self.since = address, since
        self.decoder = Decoder()
        self.sent = self.received = self.dropped = 0
        self.last = ""
        self.greeted = False
        self.end = asyncio.Event()
        self.news = asyncio.Event()
        self._queue: deque[bytes] = deque()
        self._waiting = 0
        self._limit = queue_bytes
        self._times: deque[float] = deque(maxlen=32)

    def put(self, packet: bytes) -> None:
        """Queue a packet; if there is no room, the oldest waiting packets are dropped."""
        self._queue.append(packet)
        self._waiting += len(packet)
        while self._waiting > self._limit and len(self._queue) > 1:
            self._waiting -= len(self._queue.popleft())
            self.dropped += 1
        self.news.set()

    def take(self) -> bytes | None:
        """Remove and return the next packet to send; None if there is none."""
        if not self._queue:
            self.news.clear()
            return None
        packet = self._queue.popleft()
        self._waiting -= len(packet)
        return packet

    def was_sent(self, now: float) -> None:
        """Count a packet that was sent."""
        self.sent += 1
        self._times.append(now)

    def status(self, now: float) -> PeerStatus:
        """Return the counts; the rate is averaged over the last packets, and falls while no packets are sent."""
        times = list(self._times)
        rate = len(times) / max(now - times[0], 1.0) if times else 0.0
        return PeerStatus(self.address, self.since, self.sent, self.received, self.dropped, rate, self.last)


class Wits0Link(RigInterface):
    """
    Base of all WITS interfaces: exchanges data with the peers that a subclass connects.

    Parameters
    ----------
    on_rig_state : callable, optional
        Receives rig data, `wire.RIG_STATE`, in the thread of the interface.
    """

    def __init__(
        self,
        name: str,
        settings: Wits0Settings,
        on_rig_state: OnRigState | None = None,
    ) -> None:
        super().__init__(name)
        self.talk = settings
        self.refused = 0
        self.cut_off = 0
        self._on_rig_state = on_rig_state if settings.rig.accept else None
        self._input = RigInput(settings.rig)
        self._sender = Wits0Sender(settings.form, settings.schedule)
        self._peers: set[Peer] = set()
        self._source: tuple[Peer, float] | None = None
        self._gone = PeerStatus("", 0.0)
        self._strangers = 0
        self._decoded = Counter(dataclasses.asdict(DecoderCounts()))

    @property
    def peers(self) -> int:
        """Number of connected peers."""
        return len(self._peers)

    async def send_due(self, stop: asyncio.Event) -> None:
        """Send due packets to all peers until `stop` is set."""
        while not stop.is_set():
            await self.woken(_TICK)
            if self.values is None:
                continue
            for peer in self._peers:
                self._greet(peer)
            for packet in self._sender.due(self.values, time.monotonic()):
                for peer in self._peers:
                    peer.put(packet)

    async def converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, address: str) -> None:
        """Exchange data with one peer until either side ends."""
        writer.transport.set_write_buffer_limits(high=_BUFFER_BYTES)
        peer = Peer(address, self.talk.queue_bytes, time.monotonic())
        self._peers.add(peer)
        self._greet(peer)
        tasks = [
            asyncio.ensure_future(work)
            for work in (self._listen(reader, peer), self._speak(writer, peer), peer.end.wait())
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._peers.discard(peer)
            self._forget(peer)
            writer.transport.abort()

    def end_all(self) -> None:
        """End the connections with all peers."""
        for peer in self._peers:
            peer.end.set()

    def _greet(self, peer: Peer) -> None:
        """Queue the first packets for a new peer, as soon as there are values."""
        if self.values is None or peer.greeted:
            return
        peer.greeted = True
        for packet in self._sender.greeting(self.values):
            peer.put(packet)

    async def _listen(self, reader: asyncio.StreamReader, peer: Peer) -> None:
        while True:
            try:
                data = await reader.read(4096)
            except OSError:
                return
            if not data:
                return
            for frame in peer.decoder.feed(data):
                peer.received += 1
                self._receive(peer, frame)

    async def _speak(self, writer: asyncio.StreamWriter, peer: Peer) -> None:
        while True:
            await peer.news.wait()
            packet = peer.take()
            if packet is None:
                continue
            try:
                writer.write(packet)
                # Use timeout instead of wait_for: before Python 3.12 wait_for can lose the cancellation that ends this
                # task.
                async with asyncio.timeout(self.talk.send_timeout):
                    await writer.drain()
            except TimeoutError:
                self.cut_off += 1
                return
            except OSError:
                return
            peer.was_sent(time.monotonic())
            if packet != KEEP_ALIVE:
                peer.last = packet.decode("ascii").splitlines()[-2]

    def _receive(self, peer: Peer, frame: WitsFrame) -> None:
        readings = rig_readings(frame, self.talk.form.units)
        if self._on_rig_state is None or not readings:
            return
        now = time.monotonic()
        if self._source is not None and self._source[0] is not peer and now - self._source[1] < _SOURCE_SILENT:
            # Do not mix depths from two rigs.
            self._strangers += 1
            return
        self._source = (peer, now)
        sample = self._input.take(readings, time.time_ns())
        if sample is not None:
            self._on_rig_state(sample)

    def _forget(self, peer: Peer) -> None:
        if self._source is not None and self._source[0] is peer:
            self._source = None
        s = self._gone
        self._gone = dataclasses.replace(
            s, sent=s.sent + peer.sent, received=s.received + peer.received, dropped=s.dropped + peer.dropped
        )
        self._decoded.update(dataclasses.asdict(peer.decoder.counts))

    def status_as(self, state: str, reason: str = "") -> InterfaceStatus:
        """Return the status of the interface, with the counts of all peers; state, reason: as in `InterfaceStatus`."""
        now = time.monotonic()
        peers = tuple(sorted((p.status(now) for p in tuple(self._peers)), key=lambda p: p.since))
        counted = self._decoded.copy()
        for peer in tuple(self._peers):
            counted.update(dataclasses.asdict(peer.decoder.counts))
        counts = {
            **counted,
            "cut_off": self.cut_off,
            "rig_samples": self._input.counts.taken,
            "rig_refused": self._input.counts.refused,
            "rig_held": self._input.counts.held,
            "rig_strangers": self._strangers,
        }
        last: tuple[tuple[str, str], ...] = ()
        if self.values is not None:
            survey = self.values.survey
            last = (
                ("toolface", shown(self.values.toolface)),
                ("survey", "none" if survey is None else str(survey.result.sequence)),
            )
        return InterfaceStatus(
            self.name,
            state,
            self.address,
            reason,
            peers,
            self._gone.sent + sum(p.sent for p in peers),
            self._gone.received + sum(p.received for p in peers),
            self._gone.dropped + sum(p.dropped for p in peers),
            self.refused,
            tuple(counts.items()),
            last,
        )
