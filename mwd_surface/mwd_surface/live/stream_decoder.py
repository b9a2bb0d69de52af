# SPDX-License-Identifier: Apache-2.0
"""Decoding of the sample streams of the ROS nodes for the live state, in blocks of messages that have arrived."""

from __future__ import annotations

from collections.abc import Callable

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_surface.live.alarms import Causes, Severity
from mwd_surface.live.source_selection import SourceSelection
from mwd_surface.live.well_context import WellContext

Handler = Callable[[Samples, float], None]
RIG = "rig/state"

_FRAME = slice(12, 48)  # bytes of a serialised message with the length and the beginning of its frame name
_OF_SONDE = ("attitude", "imu/temperature", "imu/mag")


def _frame_of(message: bytes) -> str | None:
    try:
        return wire.frame_id(message)
    except wire.WireError:
        return None


class StreamDecoder:
    """
    Decoder of the topics of fixed layout: updates the live state with their samples and publishes the toolface.

    Parameters
    ----------
    on_attitude, on_rig_state : callable
        Called with the samples of `attitude` and `rig/state` before the live state is updated; `on_rig_state` returns
        the samples to be shown.
    on_sonde : callable
        Called with samples that have stamps of the sonde's clock.
    on_rig_input : callable
        `on_rig_input(frame, samples)`, called with the rig data of every source, in force or not, before the source in
        force is used.
    """

    def __init__(
        self,
        context: WellContext,
        rig_sources: SourceSelection,
        *,
        on_attitude: Callable[[Samples], None],
        on_rig_state: Callable[[Samples], Samples],
        on_sonde: Callable[[Samples], None],
        on_rig_input: Callable[[str, Samples], None],
    ) -> None:
        self._context, self._live = context, context.live
        self._on_attitude, self._on_rig_state, self._on_sonde = on_attitude, on_rig_state, on_sonde
        self._on_rig_input = on_rig_input
        # Topics in the order of decoding: the shown values of a topic may depend on the topics before it.
        self._topics: dict[str, tuple[wire.Layout, Handler]] = {
            RIG: (wire.RIG_STATE, self._take_rig_state),
            "gravity": (wire.GRAVITY, self._live.on_gravity),
            "attitude": (wire.ATTITUDE, self._take_attitude),
            "dynamics": (wire.DYNAMICS, self._live.on_dynamics),
            "interference": (wire.INTERFERENCE, self._live.on_interference),
            "imu/temperature": (wire.TEMPERATURE, self._live.on_temperature),
            "imu/mag": (wire.MAG, self._live.on_magnetic_field),
        }
        #: Topic -> list to which its serialised messages are appended as they arrive.
        self.buffers: dict[str, list[bytes]] = {topic: [] for topic in self._topics}
        self._sources = {topic: SourceSelection() for topic in self._topics} | {RIG: rig_sources}
        self.unreadable = 0  #: number of messages that could not be decoded
        self.tool_frame = ""  #: frame name of the attitude; empty before the first attitude

    def decode_all(self, now: float) -> None:
        """Decode the waiting messages of all topics. now: steady time, s."""
        for topic in self._topics:
            self.decode(topic, now)

    def decode(self, topic: str, now: float) -> None:
        """Decode the waiting messages of one topic. now: steady time, s."""
        messages = list(self.buffers[topic])
        if not messages:
            return
        self.buffers[topic].clear()
        layout, handler = self._topics[topic]
        samples, errors = wire.decode_messages(layout, self._of_one_source(topic, messages, now))
        for error in errors:
            self.unreadable += 1
            self._context.outlet.warn(f"{topic}: {error}")
        if not len(samples):
            return
        if topic in _OF_SONDE:
            self._on_sonde(samples)
        if topic == "attitude":
            self.tool_frame = wire.frame_id(messages[0])
        handler(samples, now)

    def _of_one_source(self, topic: str, messages: list[bytes], now: float) -> list[bytes]:
        """
        Return the messages of the source in force, and the messages whose header cannot be read.

        The rig data of every source are first passed to `on_rig_input`; other messages of other sources are not used.
        """
        heads = {message[_FRAME] for message in messages}
        selection = self._sources[topic]
        if len(heads) == 1 and selection.source is not None and not selection.others(now):
            # There is one source, as almost always: read its name once per block.
            frames = [_frame_of(messages[0])] * len(messages)
        else:
            frames = [_frame_of(message) for message in messages]
        named = [frame for frame in frames if frame is not None]
        if not named:
            return messages
        source = selection.choose(named, now)
        if topic == RIG:
            for frame in dict.fromkeys(named):
                of_frame = [message for message, name in zip(messages, frames, strict=True) if name == frame]
                self._on_rig_input(frame, wire.decode_messages(wire.RIG_STATE, of_frame)[0])
        # Keep messages without a readable header: the decoder counts them as unreadable.
        return [message for message, frame in zip(messages, frames, strict=True) if frame in (source, None)]

    def update(self, now: float) -> None:
        """
        Raise an alarm for each topic with a second source that the order of priority does not name.

        Called once a second. now: steady time, s.
        """
        causes: Causes = {}
        for topic, selection in self._sources.items():
            if others := selection.uninvited(now):
                text = f"{topic} comes from {', '.join([str(selection.source), *others])}: {selection.source} is used"
                causes[f"sources.{topic}"] = (Severity.CRITICAL, text, "stop all but one of them")
        self._context.alarm_log.set_alarms("sources.", causes)

    def _take_rig_state(self, samples: Samples, now: float) -> None:
        self._live.on_rig_state(self._on_rig_state(samples), now)

    def _take_attitude(self, samples: Samples, now: float) -> None:
        self._on_attitude(samples)
        self._live.on_attitude(samples, now)
        reading = self._live.toolface_reading
        if reading is not None:
            age = self._live.toolface_age(reading.stamp_ns)
            self._context.outlet.on_toolface(reading, age, self.tool_frame)
