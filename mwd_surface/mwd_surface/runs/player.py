# SPDX-License-Identifier: Apache-2.0
"""
Playback of a recording into the state of a well: the content of the live page at any time, at any rate.

`live.LiveWell` computes the state. In the surface node it receives live messages; here it receives recorded messages,
and a clock that follows the recording: a pause stops the clock, so that no value becomes stale.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mwd_sensors.core import wire
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag, BagError, Message
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.inputs import InputTable
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.live_well import LiveWell, live_settings
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.said import SAID
from mwd_surface.live.settings import LinkSettings, WellSettings
from mwd_surface.live.survey_book import SurveyBook
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.live.well_state import WellState
from mwd_surface.logs.depth_log import STEP_M, DepthLog
from mwd_surface.logs.log_journal import NAME, lines_of, restore
from mwd_surface.logs.recorded_log import FILE, RIG, TOOL, TOPICS, limits_of_run, namespace_with, recorded_limits
from mwd_surface.logs.tool_health import HealthLedger, ToolHealth
from mwd_surface.surveys.leg_settings import arranged
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE, recorded_sections
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan
from mwd_surface.trajectory.slide_sheet import SLIDES, recorded_stretches

#: Topics with depths of the bit, and their types: rig data, and depths that people have set.
OF_DEPTH = {RIG: wire.RIG_STATE.type_name, "inputs": InputTable.MESSAGE}
_LINK_ATTITUDE = "link/attitude"
_ALL_DEPTHS = 10**9  # larger than the number of depths in any recording
_STEP_S = 5.0  # length of the recording that is read at a time, s


def recorded_well(bag: Bag, namespace: str) -> WellSettings:
    """
    Return the surface's settings in a recording.

    If the recording has no settings, its topics show whether the data of the tool came over a telemetry link.
    namespace: namespace of the well, with a slash at its end.
    """
    settings = recorded_sections(bag, WellSettings())
    if settings is not None:
        return settings
    of_tool, of_links = (
        any(namespace + topic in bag.topics for topic in topics)
        for topics in (("attitude", "log"), (_LINK_ATTITUDE, "link/log"))
    )
    over_link = of_links and not of_tool
    return WellSettings(link=LinkSettings("best")) if over_link else WellSettings()


def recorded_surface(bag: Bag) -> WellSettings:
    """Return the surface's settings in a recording; the usual settings if the recording has none."""
    return recorded_sections(bag, WellSettings()) or WellSettings()


class _Simulated(WellOutlet):
    """Receiver of the results of a well whose recorded data were made by a simulator."""

    def is_simulated(self) -> bool:
        """Return True, because a simulator made the data."""
        return True


class Player:
    """
    Player of one recording.

    Parameters
    ----------
    namespace : str
        Namespace of the well, with a slash at its end.
    settings : WellSettings, optional
        Settings of the surface; by default those of the recording.
    plan : Plan, optional
        Plan of the well.
    said : collection of str
        Topics of the surface that are shown as recorded; other results of the surface are computed again.
    only : frozenset of str, optional
        Topics to play; None plays all.
    log_step : float
        Depth step of the logs, m.
    """

    def __init__(
        self,
        bag: Bag,
        namespace: str,
        settings: WellSettings | None = None,
        plan: Plan | None = None,
        *,
        said: frozenset[str] = SAID,
        only: frozenset[str] | None = None,
        log_step: float = STEP_M,
    ) -> None:
        self._bag, self._namespace, self._plan = bag, namespace, plan
        self._only, self._log_step = only, log_step
        self._settings = settings or recorded_well(bag, namespace)
        self._said = frozenset(topic for topic in said if self._count(topic))
        self.length_s = bag.duration_s  #: length of the recording
        self._begin()

    def _count(self, topic: str) -> int:
        about = self._bag.topics.get(self._full(topic))
        return 0 if about is None else about.count

    def _full(self, topic: str) -> str:
        return topic if topic.startswith("/") else self._namespace + topic

    def _begin(self) -> None:
        """Create an empty well at the beginning of the recording."""
        settings, clock = self._settings, WellClock(self._bag.start_ns - 1)
        outlet = _Simulated() if self._count("truth") else WellOutlet()
        context = WellContext(clock, LiveState(live_settings(settings)), AlarmLog(lambda: clock.now_ns), outlet)
        planned = PlanMonitor(context)
        planned.plan = self._plan
        begun = self._empty_list(context.alarm_log)
        book = SurveyBook(context, planned, begun, settings.depth, self._log_step)
        tables = self._bag.metadata()
        book.health = HealthLedger(recorded_limits(tables.get(TOOL, {})))
        full_name = f"{self._namespace}surface"
        self.well = LiveWell(
            context,
            settings,
            self._decode,
            book=book,
            plan=planned,
            full_name=full_name,
            stretches=recorded_stretches(tables.get(SLIDES, {})),
            said=self._said,
        )
        limit = dict(tables.get(ESTIMATOR, {})).get("attitude.vertical_deg")
        self.well.vertical_limit = None if limit is None else math.radians(float(limit))
        self.well.live.show(clock.now, well_given=SURFACE in tables or self._settings.well != Well())
        self.well.diagnostics.show_well(settings.well)
        planned.show_plan()
        book.show()
        topics = {self._full(topic): topic for topic in self.well.topics if self._only is None or topic in self._only}
        self._names = {full: topic for full, topic in topics.items() if full in self._bag.topics}
        self._messages: Iterator[Message] = self._bag.messages(list(self._names)) if self._names else iter(())
        self._next: Message | None = next(self._messages, None)
        self.at_s = 0.0  #: time played so far, s after the first message

    def _empty_list(self, log: AlarmLog) -> SurveyList:
        """Return the list before its first message: with tie-on, leg and tool of the settings."""
        settings = self._settings
        bare, leg = SurveyList(well=settings.well, rules=settings.rules, plan=self._plan), settings.leg
        try:
            return arranged(bare, leg)
        except ValueError as error:
            # A sidetrack begins at a station of an earlier recording; a recorded list has its legs.
            if "surveys" not in self._said:
                text = f"the leg of the recording is not used: {error}"
                log.log_event("survey list", text, Severity.WARNING)
            return arranged(bare, dataclasses.replace(leg, name="", kick_off_depth=None))

    def _decode(self, topic: str, data: bytes) -> Any:
        return self._bag.decode(self._full(topic), data)

    def clipped(self, at_s: float) -> float:
        """Return a time, s after the first message, limited to the length of the recording."""
        return min(max(at_s, 0.0), self.length_s)

    def seek(self, at_s: float, patience_s: float = math.inf) -> bool:
        """
        Go to a time, s after the first message; to go back, playback starts again from the beginning.

        patience_s: longest time to work; after this time playback stops on the way. Return whether playback started
        again.
        """
        at_s, back = self.clipped(at_s), self.clipped(at_s) < self.at_s
        if back:
            self._begin()
        self.advance(0.0)  # plays the messages of this moment, including the first message of a recording
        ends = time.monotonic() + patience_s
        while self.at_s < at_s and time.monotonic() < ends:
            self.advance(min(_STEP_S, at_s - self.at_s))
        return back

    def advance(self, seconds: float) -> None:
        """Play `seconds` of the recording, at most to its end."""
        self.at_s = min(self.at_s + max(seconds, 0.0), self.length_s)
        until_ns = self._bag.start_ns + round(self.at_s * 1e9)
        while self._next is not None and self._next[0] <= until_ns:
            log_ns, name, _, data = self._next
            self.well.put(self._names[name], data, log_ns)
            self._next = next(self._messages, None)
        self.well.advance(until_ns)

    def state(self) -> WellState:
        """Return the state of the well at the present time of the playback."""
        return self.well.state()


def recorded_depths(bag: Bag, well: str = "", step_m: float = STEP_M) -> DepthLog:
    """Return a log without samples, with the bit depths of a recording; arguments and errors as `recorded_book`."""
    return recorded_book(bag, well, step_m).logs


def recorded_book(bag: Bag, well: str = "", step_m: float = STEP_M) -> SurveyBook:
    """
    Return a survey book without surveys that has the bit depths of a recording, as on the live surface.

    The rules, the source of rig data and the depths set by hand are those of the recording. well: namespace of the
    well, if the recording has several wells. step_m: depth step of the logs.

    Raises
    ------
    BagError
        The recording has neither rig data nor a depth set by hand.
    """
    missing = BagError(
        f"{bag.path} has no depth of the bit: neither {RIG} nor a depth set by hand in inputs",
        "log samples need a depth: record the rig's data, or set depths by hand",
    )
    namespace = namespace_with(bag, OF_DEPTH, well)
    if namespace is None:
        raise missing
    settings = recorded_well(bag, namespace)
    settings = dataclasses.replace(settings, depth=dataclasses.replace(settings.depth, history=_ALL_DEPTHS))
    player = Player(bag, namespace, settings, only=frozenset(OF_DEPTH), log_step=step_m)
    player.seek(player.length_s)
    # Advance by one more second: the last second of the recording, which may be incomplete, is processed only then.
    player.well.advance(bag.start_ns + round(bag.duration_s * 1e9) + wire.NANOSECONDS)
    if namespace + RIG not in bag.topics and player.well.book.depth.latest is None:
        raise missing
    return player.well.book


@dataclasses.dataclass
class Playing:
    """Requests of a viewer: whether to play, at which rate, and the time to go to, s (None: continue)."""

    playing: bool = True
    rate: float = 1.0
    seek_s: float | None = None


def namespace_of(bag: Bag) -> str:
    """
    Return the namespace of the well whose attitude is in a bag, with a slash at its end; "" if it has no attitude.

    Raises
    ------
    BagError
        The bag has the attitude of several wells.
    """
    if not any(topic.type_name == wire.ATTITUDE.type_name and topic.count for topic in bag.topics.values()):
        return ""
    ends = ("attitude", _LINK_ATTITUDE)
    found = [
        topic.name
        for topic in bag.topics.values()
        if topic.type_name == wire.ATTITUDE.type_name and topic.count and topic.name.endswith(ends)
    ]
    spaces = {name.removesuffix(_LINK_ATTITUDE).removesuffix("attitude") for name in found}
    return spaces.pop() if len(spaces) == 1 else bag.find_topic(wire.ATTITUDE.type_name, "attitude")[:-8]


_PLAYED = {**OF_DEPTH, **dict.fromkeys(TOPICS, LogSample.MESSAGE)}


def run_logs(path: Path, sensor_to_bit: float) -> tuple[DepthLog, ToolHealth] | None:
    """
    Return the logs and the health of the tool of a run; None if it has neither a journal of logs nor recorded samples.

    Parameters
    ----------
    path : Path
        Folder of a run, a survey list in it, or a recording.
    sensor_to_bit : float
        Distance from the sonde to the bit, m, for a folder.
    """
    folders = [path.parent] if path.is_file() else [path, path / "surveys", *path.glob("*/surveys")]
    journal = next((folder / NAME for folder in folders if (folder / NAME).is_file()), None)
    if journal is not None:
        limits, remark = limits_of_run(journal.with_name(FILE))
        log, health = DepthLog(sensor_to_bit), HealthLedger(limits)
        restore(lines_of(journal), log, health)
        return log, dataclasses.replace(health.health(), remarks=(remark,) if remark else ())
    if not path.is_dir() or not any(path.glob("*.mcap")):
        return None
    with Bag(path) as bag:
        namespace = namespace_with(bag, _PLAYED)
        if namespace is None:
            return None
        player = Player(bag, namespace, only=frozenset(_PLAYED))
        player.seek(player.length_s)
        return player.well.book.logs, player.state().tool_health
