# SPDX-License-Identifier: Apache-2.0
"""
The tool's transmission: a state machine from flow and rotation to words on air.

Without flow the tool is silent. Flow that has held for a while starts the transmit delay; behind it come sync, header,
the survey, and the toolface sequence again and again, each word measured when it goes on air. On a carrier blocks of
words take the place of sync, header and words. A tool on a wire does not ask for flow: it sends toolface frames all the
time, and each survey as soon as it was taken. The machine moves in steps of 0.1 s of the tool's clock, so that what is
sent does not depend on how the samples are cut into blocks.

A command of the downlink changes what is sent from the next sync on, which then follows the word on air.
"""

from __future__ import annotations

import dataclasses
import enum
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

from mwd_estimation.core import input_gate
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.status import Status
from mwd_estimation.downhole import readings
from mwd_estimation.downhole.commands import Commands
from mwd_estimation.downhole.continuous_survey import ContinuousSurvey
from mwd_estimation.downhole.readings import Reading, Readings
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry import meanings, on_air
from mwd_sensors.telemetry.downlink import FLOW, ROTATION
from mwd_sensors.telemetry.on_air import Group
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.switch import Switch
from mwd_sensors.telemetry.tool_configuration import PULSE_CODES, ToolConfiguration

NANOSECONDS = 1_000_000_000
_STEP_NS = NANOSECONDS // 10
# Averaging time of the surveys taken while the string moves, s: at 30 m/h a tenth of a metre of hole.
_CONTINUOUS_S = 10.0
# Attitude that waits longer for its flow is dropped: a flow that never comes must not fill the memory.
_KEPT_NS = 60 * NANOSECONDS
Row = TypeVar("Row", bound=tuple[Any, ...])


class Kind(enum.IntEnum):
    """What a part of a transmission is, by the numbers of mwd_msgs/Transmission."""

    SYNC = 0
    HEADER = 1
    SURVEY = 2
    TOOLFACE = 3


class TransmitterState(enum.StrEnum):
    """What the tool does."""

    SILENT = "silent: no flow"
    WAITING = "flow is on: transmit delay"
    SENDING = "sending"
    MUTED = "silent: told so by downlink, until the next flow-on or command"


@dataclasses.dataclass(frozen=True)
class Sent:
    """A sync, header or word that went on air."""

    kind: Kind
    frame: int  #: counts the passes of sequences from 0
    sequence: int  #: number of the sequence
    name: str  #: of the word; empty for a sync or header
    #: `raw`, `bits`: code without parity, and its length.
    raw: int
    bits: int
    reading: Reading | None  #: what was measured, SI; None where there is no measurement
    start_ns: int  #: begin on air, clock of the tool
    duration_s: float
    edges_s: tuple[float, ...]  #: begin of each pulse after the start, s
    tool: ToolConfiguration  #: in force
    phases: tuple[float, ...] = ()  #: of each symbol on a carrier, rad; empty but at the first word of a block
    octets: bytes = b""  #: on a line; empty but at the first word of a frame


class _Part(NamedTuple):
    """What goes on air next: kind, number of the sequence, words; of a sync none."""

    kind: Kind
    number: int
    group: Group


_KINDS = {"survey": Kind.SURVEY, "toolface": Kind.TOOLFACE}


class Transmitter:
    """The transmission of one tool: `tool` says what is sent, and how, `settings` when."""

    def __init__(self, tool: ToolConfiguration, settings: Transmit) -> None:
        self.tool, self._settings = tool, settings
        self._commands, self._commanded = Commands(tool), False
        self._flow = Switch(round(settings.flow_hold_s * NANOSECONDS))
        self._rotation = Switch(round(settings.rotation_switching_s * NANOSECONDS))
        self._continuous = ContinuousSurvey(round(_CONTINUOUS_S * NANOSECONDS))
        self._flows: deque[tuple[int, float]] = deque()
        self._attitudes: deque[tuple[int, int, Readings]] = deque()
        self._now: int | None = None
        self._frame = -1
        self._survey: Readings = {}
        self._fresh = False
        self._current: Readings = {}
        self._slow: Readings = {}
        self._on_air: Iterator[_Part] = iter(())
        self._next_ns = 0
        self._begins_anew = False
        self.state = TransmitterState.SILENT

    def take_flow(self, samples: Samples) -> None:
        """Take samples of `wire.TOOL_FLOW`, in order; those of a time must come before its attitude."""
        samples = input_gate.flow(samples)
        self._commands.listen(FLOW, samples["stamp_ns"], samples["flow"])
        if self.wired:
            return
        self._flows.extend(zip(samples["stamp_ns"].tolist(), samples["flow"].tolist(), strict=True))

    def take_rotation(self, samples: Samples) -> None:
        """Take samples of `wire.IMU` in tool axes, in order; those of a time must come before its attitude."""
        self._commands.listen(ROTATION, samples["stamp_ns"], samples["angular_velocity"][:, 0])

    def take_survey(self, survey: Survey) -> None:
        """Keep a survey taken at rest for the next transmission."""
        self._survey = readings.of_survey(survey)
        self._fresh = True

    def take_dynamics(self, samples: Samples) -> None:
        """Take summaries of `wire.DYNAMICS`; the last one counts."""
        if len(samples):
            self._slow |= readings.of_dynamics(samples[-1])

    def advance(self, attitude: Samples, reference: Reference | None) -> list[Sent]:
        """
        Take samples of `wire.ATTITUDE` and give what went on air up to the last one whose flow is known.

        reference : field whose declination and convergence turn azimuths to magnetic north.
        """
        stamps = attitude["stamp_ns"]
        # The first sample of each step is enough.
        last = self._attitudes[-1][0] // _STEP_NS if self._attitudes else (self._now or 0) // _STEP_NS
        for k, cell in enumerate((stamps // _STEP_NS).tolist()):
            if cell > last:
                row = attitude[k]
                found = readings.of_attitude(row, reference)
                self._attitudes.append((int(stamps[k]), int(row["status"]), found))
                last = cell
        sent: list[Sent] = []
        needed: list[deque[Any]] = [self._attitudes] if self.wired else [self._attitudes, self._flows]
        if not all(needed):
            self._drop_old()
            return sent
        if self._now is None:
            self._now = max(rows[0][0] for rows in needed) // _STEP_NS * _STEP_NS
        while self._now + _STEP_NS <= min(rows[-1][0] for rows in needed):
            self._now += _STEP_NS
            sent += self._step(self._now)
        self._drop_old()
        return sent

    @property
    def wired(self) -> bool:
        """Whether it sends over a line, with flow or without."""
        return self.tool.code == "serial"

    @property
    def knows_flow(self) -> bool:
        """Whether samples of the flow have come at all."""
        return bool(self._flows)

    @property
    def waits_s(self) -> float:
        """Attitude that waits for its flow, s, at most 60."""
        if not self._attitudes:
            return 0.0
        known = max(self._attitudes[0][0], self._flows[-1][0] if self._flows else 0)
        return max(self._attitudes[-1][0] - known, 0) / NANOSECONDS

    def _drop_old(self) -> None:
        while self._attitudes and self._attitudes[-1][0] - self._attitudes[0][0] > _KEPT_NS:
            self._attitudes.popleft()

    def _step(self, now: int) -> list[Sent]:
        row = _newest(self._attitudes, now)
        if row is None:
            return []
        _, status, self._current = row
        self._continuous.take(now, self._current)
        self._commanded = self._commands.obey(now) or self._commanded
        if not self.wired:
            flow = _newest(self._flows, now)
            if flow is None:
                return []
            if self._flow.update(now, flow[1] > self.tool.flow_threshold):
                self._switch_flow()
        elif self.state == TransmitterState.SILENT:
            self._begin_sending(now)
        turned = self._rotation.update(now, bool(status & Status.ROTATING))
        if turned and self._settings.rotation_switching_s > 0.0 and self.tool.names_sequences and not self.wired:
            self._begins_anew = self.state == TransmitterState.SENDING
        if (self.state == TransmitterState.WAITING and now >= self._next_ns) or (
            self.state == TransmitterState.MUTED and self._commanded
        ):
            self._begin_sending(max(now, self._next_ns) if self.state == TransmitterState.MUTED else self._next_ns)
        sent = []
        while self.state == TransmitterState.SENDING and self._next_ns <= now:
            if self._commanded:
                self._begin_sending(self._next_ns)
            elif self._begins_anew:
                self._begins_anew = False
                self._on_air = self._parts(with_survey=self._rotation.on)
            part = next(self._on_air, None)
            if part is None:
                self.state = TransmitterState.MUTED
                break
            sent += self._put_on_air(part)
        return sent

    def _begin_sending(self, at_ns: int) -> None:
        """Begin with a survey, by the tool configuration that commands have led to."""
        self.state, self._next_ns, self._commanded, self._begins_anew = TransmitterState.SENDING, at_ns, False, False
        self.tool = self._commands.tool()
        self._on_air = self._frames() if self.wired else self._parts(with_survey=True)

    def _switch_flow(self) -> None:
        self._on_air, self._begins_anew = iter(()), False
        if self._flow.on:
            self.state = TransmitterState.WAITING
            self._commands.speak()
            self._next_ns = self._flow.since_ns + round(self.tool.transmit_delay_s * NANOSECONDS)
        else:
            self.state = TransmitterState.SILENT

    @property
    def _number(self) -> int:
        """Number of the sequences to send now."""
        if not self.tool.names_sequences:
            return 0
        switches = self._settings.rotation_switching_s > 0.0
        return int(self._rotation.on) if switches else self._commands.settings.sequence

    def _parts(self, *, with_survey: bool) -> Iterator[_Part]:
        """Sync, header, survey and for ever the toolface sequence."""
        number = self._number
        if self.tool.code in PULSE_CODES:
            yield _Part(Kind.SYNC, number, Group("", number, 0, ()))
            if self.tool.header_bits:
                header = SequenceItem("", self.tool.header_bits, False)
                yield _Part(Kind.HEADER, number, Group("", number, 0, (header,)))
        if with_survey:
            self._choose_survey()
            yield from self._pass("survey", number)
        while not self._commands.settings.mute:
            self._frame += 1
            yield from self._pass("toolface", number)

    def _frames(self) -> Iterator[_Part]:
        """Of a tool on a wire: a survey where one was taken, else toolfaces, for ever."""
        while not self._commands.settings.mute:
            kind = "survey" if self._fresh else "toolface"
            if self._fresh:
                self._choose_survey()
            else:
                self._frame += 1
            yield from self._pass(kind, self._number)

    def _pass(self, kind: str, number: int) -> Iterator[_Part]:
        return (_Part(_KINDS[kind], number, group) for group in on_air.groups(self.tool, kind, number))

    def _choose_survey(self) -> None:
        """Send the survey taken at rest since the last transmission, else the least noisy continuous one."""
        self._frame += 1
        if not self._fresh:
            self._survey = self._continuous.best() or self._survey
        self._fresh = False
        self._continuous.forget()

    def _put_on_air(self, part: _Part) -> list[Sent]:
        kind, number, group = part
        start = self._next_ns
        names = [item.name for item in group.items]
        measured = [self._reading(kind, name) if name else None for name in names]
        codes = tuple(
            number if kind == Kind.HEADER else self._code(item, reading)
            for item, reading in zip(group.items, measured, strict=True)
        )
        # Sync and header belong to the pass behind them.
        frame = self._frame if kind in (Kind.SURVEY, Kind.TOOLFACE) else self._frame + 1
        if kind == Kind.SYNC:
            signal = on_air.sync(self.tool)
        else:
            signal = on_air.signal(self.tool, group, self.tool.sent(group.items, codes), frame)
        self._next_ns = start + round(signal.period_s * NANOSECONDS)
        time = (start, signal.duration_s, signal.edges_s, self.tool)
        if kind == Kind.SYNC:
            return [Sent(kind, frame, number, "", 0, 0, None, *time)]
        sent = [
            Sent(kind, frame, number, item.name, code or 0, item.bits, reading, *time)
            for item, code, reading in zip(group.items, codes, measured, strict=True)
        ]
        sent[0] = dataclasses.replace(sent[0], phases=signal.phases, octets=signal.octets)
        return sent

    def _reading(self, kind: Kind, name: str) -> Reading | None:
        quantity = meanings.meaning_of(name)
        if quantity == meanings.DOWNLINK:
            return Reading(float(self._commands.echo), 0.0, self._next_ns)
        of_now = self._slow | self._current
        return (self._survey | of_now if kind == Kind.TOOLFACE else of_now | self._survey).get(quantity)

    def _code(self, item: SequenceItem, reading: Reading | None) -> int | None:
        """Code of a reading; None where there is none: what is sent then cannot be taken for a reading."""
        if reading is None:
            return None
        word = self.tool.table[item.name]
        return word.code(reading.value / meanings.factor(word.unit), item.bits)


def _newest(rows: deque[Row], now: int) -> Row | None:
    """Last row with a stamp up to now; older ones are dropped. None: the first one is later."""
    while len(rows) > 1 and rows[1][0] <= now:
        rows.popleft()
    return rows[0] if rows[0][0] <= now else None
