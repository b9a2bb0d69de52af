# SPDX-License-Identifier: Apache-2.0
"""
A recording played into the state of a well: what the live page showed at any moment of it, at any rate.

The state is that of `live.LiveState`, by a clock that runs with the recording: a pause stops it, and what was fresh
stays fresh.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_surface.bags.bag_reader import Bag, Block
from mwd_surface.live.alarms import Alarm
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_state import WellState
from mwd_surface.surveys.message_conversion import advice_of, stamp_of, survey_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Survey
from mwd_surface.trajectory.plan import DRAWN_STEP, Plan, interpolated, offset_of_end

# Time before the moment that is looked for that is played first, for the charts and for latched values, s.
CHARTS_S = 300.0
# The state is brought forward in steps of at most so long, s: charts keep their rows.
_STEP_S = 0.5
_BLOCK = 512  # messages read at a time
_TOPICS = ("imu/data_raw", "rig/state", "gravity", "attitude", "dynamics", "interference", "imu/temperature", "imu/mag")


class Player:
    """
    Plays one recording.

    Parameters
    ----------
    bag : Bag
    namespace : str
        Of the well, with a slash at its end.
    surveys : SurveyList
        All surveys of the recording; each is shown from its stamp on, a revision from when it was recorded, or else at
        the end, where the whole run was judged.
    plan : Plan, optional
        Of the well.

    Attributes
    ----------
    length_s : float
    at_s : float
        Time played so far, after the first message.
    """

    def __init__(self, bag: Bag, namespace: str, surveys: SurveyList, plan: Plan | None = None) -> None:
        self._bag, self._surveys, self._plan = bag, surveys, plan
        self._names = {namespace + topic: topic for topic in _TOPICS if bag.topics.get(namespace + topic) is not None}
        self.length_s = bag.duration_s
        self._alarms = _alarms(bag, f"{namespace}alarms")
        self._advice = [
            (log_ns, advice_of(message))
            for log_ns, message in _messages(bag, f"{namespace}steering/advice", "mwd_msgs/msg/SteeringAdvice")
        ]
        self._revisions = [
            (log_ns, survey_of(message))
            for log_ns, message in _messages(bag, f"{namespace}survey/revised", "mwd_msgs/msg/Survey")
        ]
        self.at_s = 0.0
        self.seek(0.0)

    def seek(self, at_s: float) -> None:
        """Go to a moment, s after the first message; the charts before it are filled."""
        at_s = min(max(at_s, 0.0), self.length_s)
        begin_s = max(at_s - CHARTS_S, 0.0)
        self._live = LiveState()
        self._handlers: dict[str, Callable[[Samples, float], None]] = {
            "imu/data_raw": lambda _samples, now: self._live.on_stream("sonde", 0, now),
            "rig/state": self._on_rig_state,
            "gravity": self._live.on_gravity,
            "attitude": self._live.on_attitude,
            "dynamics": self._live.on_dynamics,
            "interference": self._live.on_interference,
            "imu/temperature": self._live.on_temperature,
            "imu/mag": self._live.on_magnetic_field,
        }
        self._shown = self._alarms_shown = self._advice_shown = -1
        self._revised: tuple[int, bool] | None = None
        self._bit_depth: float | None = None
        self._path_to: tuple[int, float | None] | None = None
        if self._plan is not None:
            self._live.on_plan(interpolated(self._plan, DRAWN_STEP), begin_s)
        begin_ns = self._bag.start_ns + round(begin_s * 1e9)
        self._blocks: Iterator[Block] = self._bag.blocks(list(self._names), begin_ns, block_messages=_BLOCK)
        self._pending: Block = {}
        self.at_s = begin_s
        self.advance(at_s - begin_s)

    def advance(self, seconds: float) -> None:
        """Play on by so many seconds of the recording, at most to its end."""
        end = min(self.at_s + seconds, self.length_s)
        while self.at_s < end:
            self.at_s = min(self.at_s + _STEP_S, end)
            self._feed(self.at_s)
        self._show_surveys(self.at_s)
        self._show_alarms(self.at_s)
        self._show_advice(self.at_s)

    def state(self) -> WellState:
        """State of the well at this moment."""
        return self._live.at(self.at_s)

    def _feed(self, until_s: float) -> None:
        """Take all messages logged up to a moment."""
        until_ns = self._bag.start_ns + round(until_s * 1e9)
        parts: dict[str, list[Samples]] = {}
        while True:
            for name in list(self._pending):
                log_ns, samples = self._pending[name]
                count = int(np.searchsorted(log_ns, until_ns, side="right"))
                if count:
                    parts.setdefault(self._names[name], []).append(samples[:count])
                if count < len(log_ns):
                    self._pending[name] = log_ns[count:], samples[count:]
                else:
                    del self._pending[name]
            if self._pending:
                break
            following = next(self._blocks, None)
            if following is None:
                break
            self._pending = dict(following)
        # In the order of the surface node: what a topic shows may depend on those before it.
        for topic in _TOPICS:
            if topic in parts:
                self._handlers[topic](np.concatenate(parts[topic]), until_s)

    def _show_surveys(self, now: float) -> None:
        """Show the surveys that had been taken by this moment."""
        now_ns = self._bag.start_ns + round(now * 1e9)
        records = tuple(r for r in self._surveys.records if r.survey.stamp_ns <= now_ns)
        revised = [survey for log_ns, survey in self._revisions if log_ns <= now_ns]
        state = len(revised), now >= self.length_s
        if len(records) != self._shown or state != self._revised:
            self._shown, self._revised = len(records), state
            if now < self.length_s:
                known: dict[str, Survey] = {survey.uuid: survey for survey in revised}
                records = tuple(
                    dataclasses.replace(r, revised=(known[r.survey.uuid],) if r.survey.uuid in known else ())
                    for r in records
                )
            table = dataclasses.replace(self._surveys, records=records).to_mapping()
            self._known = SurveyList.from_mapping(table, self._surveys.rules)
            self._live.on_well(self._known.well, now)
            self._live.on_records(self._known.records, now, self._known.remarks)
        if self._path_to == (len(records), self._bit_depth):
            return
        self._path_to = len(records), self._bit_depth
        path = self._known.definitive(bit_depth=self._bit_depth)
        self._live.on_trajectory(path, now)
        offset, dogleg = offset_of_end(self._plan, path)
        self._live.on_offset(offset, now, dogleg)

    def _on_rig_state(self, samples: Samples, now: float) -> None:
        """Take the state of the rig; the path is projected to its bit."""
        self._live.on_rig_state(samples, now)
        known = samples["bit_depth"][(samples["valid"] & wire.RIG_VALID["bit_depth"]) != 0]
        self._bit_depth = float(known[-1]) if len(known) else self._bit_depth

    def _show_alarms(self, now: float) -> None:
        """Show the alarms that stood at this moment."""
        now_ns = self._bag.start_ns + round(now * 1e9)
        which = sum(log_ns <= now_ns for log_ns, _ in self._alarms) - 1
        if which != self._alarms_shown:
            self._alarms_shown = which
            self._live.on_alarms(self._alarms[which][1] if which >= 0 else (), (), now, now_ns)

    def _show_advice(self, now: float) -> None:
        """Show the advice on steering that held at this moment."""
        now_ns = self._bag.start_ns + round(now * 1e9)
        which = sum(log_ns <= now_ns for log_ns, _ in self._advice) - 1
        if which != self._advice_shown:
            self._advice_shown = which
            self._live.on_advice(self._advice[which][1], now)


def _messages(bag: Bag, topic: str, type_name: str) -> Iterator[tuple[int, Any]]:
    """Each message of a topic with the time at which it was logged, ns; none where the topic is of another type."""
    about = bag.topics.get(topic)
    if about is None or about.type_name != type_name:
        return
    for log_ns, _, _, data in bag.messages([topic]):
        yield log_ns, bag.decode(topic, data)


def _alarms(bag: Bag, topic: str) -> list[tuple[int, tuple[Alarm, ...]]]:
    """Each list of alarms in a recording, newest alarm first, with the time at which it was logged, ns."""
    fields = ("id", "severity", "text", "remedy", "active", "acknowledged", "count")
    return [
        (
            log_ns,
            tuple(
                Alarm(
                    raised_ns=stamp_of(one.raised),
                    last_ns=stamp_of(one.last),
                    **{name: getattr(one, name) for name in fields},
                )
                for one in message.alarms
            ),
        )
        for log_ns, message in _messages(bag, topic, "mwd_msgs/msg/AlarmList")
    ]


@dataclasses.dataclass
class Playing:
    """What a viewer asks for: whether and how fast it plays, and where to go (None: on)."""

    playing: bool = True
    rate: float = 1.0
    seek_s: float | None = None


def namespace_of(bag: Bag) -> str:
    """
    Namespace of the well whose attitude is in a bag, with a slash at its end; empty where it has none.

    Raises
    ------
    BagError
        It has attitudes of several wells.
    """
    if not any(topic.type_name == wire.ATTITUDE.type_name and topic.count for topic in bag.topics.values()):
        return ""
    return bag.find_topic(wire.ATTITUDE.type_name, "attitude").removesuffix("attitude")
