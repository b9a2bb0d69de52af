# SPDX-License-Identifier: Apache-2.0
"""
Transmission of the tool: a state machine that converts flow, rotation and measurements to telemetry words.

Without flow the tool is silent. When the flow has been on for `flow_hold_s`, the transmit delay starts; after the delay
the tool sends sync, header, the survey, and then the toolface sequence repeatedly. Each word has the newest measurement
at the start of its transmission. On a carrier, blocks of words replace sync, header and words. A tool on a wire does
not wait for flow: it sends toolface frames all the time, and each survey as soon as it has been taken. The machine
moves in steps of 0.1 s of the tool's clock, so that the result does not depend on how the samples are cut into blocks.

A downlink command takes effect with the next sync. After a command the tool sends a sync as soon as the current word is
complete.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from mwd_estimation.core import input_gate, magnetic_geometry
from mwd_estimation.core.north import North
from mwd_estimation.core.reference_field import NORTHS, Reference, north_correction
from mwd_estimation.core.status import Status
from mwd_estimation.downhole.commands import Commands
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry import meanings, on_air
from mwd_sensors.telemetry.downlink import FLOW, ROTATION
from mwd_sensors.telemetry.log_channels import LogSample, carried
from mwd_sensors.telemetry.on_air import Group
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.switch import Switch
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

NANOSECONDS = 1_000_000_000
_STEP_NS = NANOSECONDS // 10  # step of the state machine, ns
# Averaging time of surveys while the string moves, s; in this time the hole grows by a tenth of a metre at 30 m/h.
_CONTINUOUS_S = 10.0
# Longest time for which attitude waits for the flow of the same time, ns; older attitude is dropped.
_KEPT_NS = 60 * NANOSECONDS
_KEPT_LOGS = 60  # number of running means of the log channels that are kept, one per second
Row = TypeVar("Row", bound=tuple[Any, ...])


class PartKind(enum.IntEnum):
    """Kind of a transmitted part: sync, header, or word of a survey or toolface frame; as in mwd_msgs/Transmission."""

    SYNC = 0
    HEADER = 1
    SURVEY = 2
    TOOLFACE = 3


class TransmitterState(enum.StrEnum):
    """State of the transmission, with a text for the operator."""

    SILENT = "silent: no flow"
    WAITING = "flow is on: the transmit delay runs"
    SENDING = "sending"
    MUTED = "silent: muted by downlink until the flow is switched on again or a command comes"
    DONE = "silent: the survey was sent, and the tool sends surveys only"


@dataclasses.dataclass(frozen=True)
class Sent:
    """A sync, header or word that was transmitted."""

    kind: PartKind
    frame: int  #: number of the frame (one transmission of a whole sequence), from 0
    sequence: int  #: number of the sequence
    name: str  #: name of the word; empty for a sync or header
    #: `raw`, `bits`: code without parity, and number of its bits.
    raw: int
    bits: int
    reading: StampedValue | None  #: measurement that the word carries, SI; None without a measurement
    start_ns: int  #: start of the transmission, clock of the tool, ns
    duration_s: float  #: duration of the transmission, s
    edges_s: tuple[float, ...]  #: start of each pulse, counted from `start_ns`, s
    tool: ToolConfiguration  #: tool configuration with which it was sent
    #: `phases`: phase of each symbol of the block on a carrier, rad; empty except for the first word of a block.
    #: `octets`: content of the whole frame on a serial line; empty except for the first word of a frame.
    phases: tuple[float, ...] = ()
    octets: bytes = b""


class _Part(NamedTuple):
    """Next part to transmit: kind, number of the sequence, and words (a sync has no words)."""

    kind: PartKind
    number: int
    group: Group


_KINDS = {"survey": PartKind.SURVEY, "toolface": PartKind.TOOLFACE}


class Transmitter:
    """
    Transmission of one tool.

    tool: tool configuration, with words and modulation; settings: times at which the tool transmits.
    """

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
        # Words that carry log channels and have no other meaning. `_logs` has the time from which readings of these
        # words are known, ns, and the readings by word.
        self._logged_words = {
            word: item for word, item in carried(tool.logged).items() if not meanings.meaning_of(word)
        }
        self._logs: deque[tuple[int, Readings]] = deque(maxlen=_KEPT_LOGS)
        self._on_air: Iterator[_Part] = iter(())
        self._next_ns = 0
        self._begins_anew = False
        self.state = TransmitterState.SILENT

    def take_flow(self, samples: Samples) -> None:
        """Add samples of `wire.TOOL_FLOW` in order; call this before `advance` with the attitude of the same time."""
        samples = input_gate.flow(samples)
        self._commands.listen(FLOW, samples["stamp_ns"], samples["flow"])
        if self.wired:
            return
        self._flows.extend(zip(samples["stamp_ns"].tolist(), samples["flow"].tolist(), strict=True))

    def take_rotation(self, samples: Samples) -> None:
        """
        Add samples of `wire.IMU` in tool axes, in order.

        Call this method before `advance` with the attitude of the same time.
        """
        self._commands.listen(ROTATION, samples["stamp_ns"], samples["angular_velocity"][:, 0])

    def take_survey(self, survey: DecidedSurvey) -> None:
        """Keep a survey taken at rest, for the next transmission."""
        self._survey = _of_survey(survey)
        self._fresh = True

    def take_dynamics(self, samples: Samples) -> None:
        """Add summaries of `wire.DYNAMICS`; only the last one is used."""
        if len(samples):
            self._slow |= _of_dynamics(samples[-1])

    def take_logs(self, known_ns: int, samples: Mapping[str, LogSample]) -> None:
        """
        Add running means of log channels, in order of time and before the attitude of the same time.

        known_ns: time from which the means are known; samples: means by the name of the channel.
        """
        found: Readings = {}
        for word, (name, channel, sector) in self._logged_words.items():
            sample = samples.get(name)
            if sample is None or (sector is not None and sector >= len(sample.sectors)):
                continue
            value, sigma = (
                (sample.value, sample.sigma)
                if sector is None
                else (sample.sectors[sector], sample.sigma_sectors[sector])
            )
            if math.isfinite(value):
                # Readings are in SI, or in the unit of the word if the quantity has no SI unit.
                unit = self.tool.table[word].unit
                factor = meanings.factor(unit) / channel.factor(unit)
                found[word] = StampedValue(value * factor, sigma * factor, sample.stamp_ns)
        self._logs.append((known_ns, found))

    def advance(self, attitude: Samples, reference: Reference | None) -> list[Sent]:
        """
        Add samples of `wire.ATTITUDE`; return the syncs, headers and words transmitted since the last call.

        The tool is simulated up to the last time at which attitude and flow are known; a tool with a serial line does
        not need the flow. reference: its declination and convergence convert azimuths to magnetic north.
        """
        stamps = attitude["stamp_ns"]
        # Keep only the first sample in each step.
        last = self._attitudes[-1][0] // _STEP_NS if self._attitudes else (self._now or 0) // _STEP_NS
        for k, cell in enumerate((stamps // _STEP_NS).tolist()):
            if cell > last:
                row = attitude[k]
                found = _of_attitude(row, reference)
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
        """Whether the tool sends over a serial line, which does not depend on flow."""
        return self.tool.code == "serial"

    @property
    def knows_flow(self) -> bool:
        """Whether any sample of the flow has arrived."""
        return bool(self._flows)

    @property
    def waits_s(self) -> float:
        """Time span of the attitude that waits for the flow of the same time, s, at most 60."""
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
        elif self.state == TransmitterState.SILENT or (self.state == TransmitterState.DONE and self._fresh):
            self._begin_sending(now)
        turned = self._rotation.update(now, bool(status & Status.ROTATING))
        if turned and self._settings.rotation_switching_s > 0.0 and self.tool.names_sequences and not self.wired:
            self._begins_anew = self.state == TransmitterState.SENDING
        quiet = self.state in (TransmitterState.MUTED, TransmitterState.DONE)
        if (self.state == TransmitterState.WAITING and now >= self._next_ns) or (quiet and self._commanded):
            self._begin_sending(max(now, self._next_ns) if quiet else self._next_ns)
        sent = []
        while self.state == TransmitterState.SENDING and self._next_ns <= now:
            if self._commanded:
                self._begin_sending(self._next_ns)
            elif self._begins_anew:
                self._begins_anew = False
                # When rotation ends, a tool without toolface sequences sends its survey again.
                self._on_air = self._parts(with_survey=self._rotation.on or not self.tool.toolfaces)
            part = next(self._on_air, None)
            if part is None:
                muted = self.tool.toolfaces or self._commands.settings.mute
                self.state = TransmitterState.MUTED if muted else TransmitterState.DONE
                break
            sent += self._put_on_air(part)
        return sent

    def _begin_sending(self, at_ns: int) -> None:
        """Start to send at a time, ns, beginning with the survey; use the configuration changed by commands so far."""
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
        """Index of the survey and the toolface sequence to send now."""
        if not self.tool.names_sequences:
            return 0
        switches = self._settings.rotation_switching_s > 0.0
        return int(self._rotation.on) if switches else self._commands.settings.sequence

    def _parts(self, *, with_survey: bool) -> Iterator[_Part]:
        """
        Yield sync and header (of a pulse code), the survey if `with_survey`, then the toolface sequence repeatedly.

        The end comes when the tool is muted, or after the survey if the tool has no toolface sequence.
        """
        number = self._number
        if self.tool.code == "mary":
            yield _Part(PartKind.SYNC, number, Group("", number, 0, ()))
            if self.tool.header_bits:
                header = SequenceItem("", self.tool.header_bits, False)
                yield _Part(PartKind.HEADER, number, Group("", number, 0, (header,)))
        if with_survey:
            self._choose_survey()
            yield from self._pass("survey", number)
        while self.tool.toolfaces and not self._commands.settings.mute:
            self._frame += 1
            yield from self._pass("toolface", number)

    def _frames(self) -> Iterator[_Part]:
        """Yield the frames of a tool on a wire until it is muted: a new survey once, otherwise toolfaces."""
        while (self._fresh or self.tool.toolfaces) and not self._commands.settings.mute:
            kind = "survey" if self._fresh else "toolface"
            if self._fresh:
                self._choose_survey()
            else:
                self._frame += 1
            yield from self._pass(kind, self._number)

    def _pass(self, kind: str, number: int) -> Iterator[_Part]:
        return (_Part(_KINDS[kind], number, group) for group in on_air.groups(self.tool, kind, number))

    def _choose_survey(self) -> None:
        """
        Use the survey taken at rest since the last transmission, or else the least noisy continuous survey.

        Without either, the survey of the last transmission is used again.
        """
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
            number if kind == PartKind.HEADER else self._code(item, reading)
            for item, reading in zip(group.items, measured, strict=True)
        )
        # Sync and header get the frame number of the sequence that follows them.
        frame = self._frame if kind in (PartKind.SURVEY, PartKind.TOOLFACE) else self._frame + 1
        if kind == PartKind.SYNC:
            signal = on_air.sync(self.tool)
        else:
            signal = on_air.signal(self.tool, group, self.tool.sent(group.items, codes), frame)
        self._next_ns = start + round(signal.period_s * NANOSECONDS)
        time = (start, signal.duration_s, signal.edges_s, self.tool)
        if kind == PartKind.SYNC:
            return [Sent(kind, frame, number, "", 0, 0, None, *time)]
        sent = [
            Sent(kind, frame, number, item.name, code or 0, item.bits, reading, *time)
            for item, code, reading in zip(group.items, codes, measured, strict=True)
        ]
        sent[0] = dataclasses.replace(sent[0], phases=signal.phases, octets=signal.octets)
        return sent

    def _reading(self, kind: PartKind, name: str) -> StampedValue | None:
        quantity = meanings.meaning_of(name)
        if name in self._logged_words:
            row = _newest(self._logs, self._next_ns) if self._logs else None
            return None if row is None else row[1].get(name)
        if quantity == meanings.DOWNLINK:
            return StampedValue(float(self._commands.echo), 0.0, self._next_ns)
        of_now = self._slow | self._current
        return (self._survey | of_now if kind == PartKind.TOOLFACE else of_now | self._survey).get(quantity)

    def _code(self, item: SequenceItem, reading: StampedValue | None) -> int | None:
        """Return the code of a reading; None without a reading (the tool then sends a code that is not a value)."""
        if reading is None:
            return None
        word = self.tool.table[item.name]
        return word.code(reading.value / meanings.factor(word.unit), item.bits)


def _newest(rows: deque[Row], now: int) -> Row | None:
    """Return the last row with a stamp up to `now`, ns, and drop older rows; None if all rows are later."""
    while len(rows) > 1 and rows[1][0] <= now:
        rows.popleft()
    return rows[0] if rows[0][0] <= now else None


# Surveys while the string moves: averages over some seconds; the least noisy average is kept.


# For each averaged quantity: the quantities of a survey for its mean and for 1 sigma.
_OF_SURVEY = {
    meanings.CONTINUOUS_INCLINATION: (meanings.INCLINATION, meanings.SIGMA_INCLINATION),
    meanings.CONTINUOUS_AZIMUTH: (meanings.AZIMUTH, meanings.SIGMA_AZIMUTH),
}


class ContinuousSurvey:
    """Averages of inclination and azimuth over windows of equal length, `window_ns`, ns."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._begin: int | None = None
        self._sums: dict[str, list[float]] = {}
        self._least = math.inf
        self._best: Readings = {}

    def take(self, stamp_ns: int, readings: Readings) -> None:
        """Add the readings of one sample; stamp_ns: stamp of the sample."""
        if self._begin is None:
            self._begin = stamp_ns
        elif stamp_ns - self._begin >= self._window_ns:
            self._close(stamp_ns)
        for quantity in _OF_SURVEY:
            if quantity in readings:
                one = readings[quantity]
                sums = self._sums.setdefault(quantity, [0.0] * 4)
                for k, more in enumerate((math.sin(one.value), math.cos(one.value), one.sigma, 1.0)):
                    sums[k] += more

    def best(self) -> Readings:
        """Return the readings of the least noisy window since the last call of `forget`; empty before a full window."""
        return dict(self._best)

    def forget(self) -> None:
        """Discard the best window, because it has been sent."""
        self._least, self._best = math.inf, {}

    def _close(self, stamp_ns: int) -> None:
        begin, sums = self._begin or stamp_ns, self._sums
        self._begin, self._sums = stamp_ns, {}
        if set(sums) != set(_OF_SURVEY):
            return
        found: Readings = {}
        noise = 0.0
        middle = (begin + stamp_ns) // 2
        for quantity, (value, sigma) in _OF_SURVEY.items():
            sin, cos, sigmas, count = sums[quantity]
            # Circular standard deviation (N. I. Fisher, Statistical Analysis of Circular Data, 1993, 2.3.1).
            length = min(math.hypot(sin, cos) / count, 1.0)
            spread = math.sqrt(max(-2.0 * math.log(max(length, 1e-12)), 0.0))
            stated = math.hypot(sigmas / count, spread / math.sqrt(count))
            found[value] = StampedValue(math.atan2(sin, cos) % math.tau, stated, middle)
            found[sigma] = StampedValue(stated, math.nan, middle)
            noise += stated
        if noise < self._least:
            self._least, self._best = noise, found


# Newest measurement of each quantity that a telemetry word may carry, in SI, with its sigma and stamp.


_NORTH = {int(north): north.name.lower() for north in North}
# Field of the attitude for each quantity, and whether its angle counts from north.
_ATTITUDE = {
    meanings.CONTINUOUS_INCLINATION: ("inclination", False),
    meanings.CONTINUOUS_AZIMUTH: ("azimuth", True),
    meanings.GRAVITY_TOOLFACE: ("gravity_toolface", False),
    meanings.MAGNETIC_TOOLFACE: ("magnetic_toolface", True),
}


class StampedValue(NamedTuple):
    """Value and 1 sigma, SI, NaN if unknown; and stamp of the measurement, ns."""

    value: float
    sigma: float
    stamp_ns: int


Readings = dict[str, StampedValue]


def _to_magnetic(north: str, reference: Reference | None) -> float | None:
    """
    Return the angle from magnetic north to the named north, rad; None if unknown.

    Added to an azimuth from the named north, it gives the magnetic azimuth. By convention a tool transmits azimuths
    from magnetic north; the surface adds declination and convergence.
    """
    correction = north_correction(reference, north) if north in NORTHS else None
    return None if correction is None else -correction


def _of_attitude(row: Samples, reference: Reference | None) -> Readings:
    """Return the readings of one sample of `wire.ATTITUDE`, without those that are unknown."""
    stamp, status = int(row["stamp_ns"]), int(row["status"])
    found: Readings = {}
    turn = _to_magnetic(_NORTH.get(int(row["north"]), ""), reference)
    for quantity, (field, by_azimuth) in _ATTITUDE.items():
        value, sigma = float(row[field]), float(row[f"sigma_{field}"])
        if math.isfinite(sigma) and not by_azimuth:
            found[quantity] = StampedValue(value, sigma, stamp)
        elif math.isfinite(sigma) and turn is not None:
            found[quantity] = StampedValue((value + turn) % math.tau, sigma, stamp)
    # Near the vertical the high side is not defined; the toolface is measured from magnetic north.
    automatic = meanings.MAGNETIC_TOOLFACE if status & Status.NEAR_VERTICAL else meanings.GRAVITY_TOOLFACE
    if automatic in found:
        found[meanings.TOOLFACE] = found[automatic]
    return found


def _of_dynamics(row: Samples) -> Readings:
    """Return the readings of one summary of `wire.DYNAMICS`."""
    stamp = int(row["stamp_ns"])
    fields = {
        meanings.LATERAL_RMS: "lateral_rms",
        meanings.AXIAL_RMS: "axial_rms",
        meanings.LATERAL_PEAK: "lateral_peak",
        meanings.AXIAL_PEAK: "axial_peak",
    }
    return {quantity: StampedValue(float(row[field]), math.nan, stamp) for quantity, field in fields.items()}


def _of_survey(survey: DecidedSurvey) -> Readings:
    """
    Return the readings of a survey taken at rest, without quantities whose value is unknown (None or NaN).

    The azimuth refers to magnetic north and is left out if the angle to magnetic north is unknown. If the azimuth was
    corrected for the axial field of the string, dip and total field are also without this field.
    """
    station, stamp = survey.station, survey.stamp_ns
    variance = np.asarray(station.covariance, dtype=float)
    found: Readings = {}

    def put(quantity: str, value: float | None, sigma: float) -> None:
        if value is not None and math.isfinite(value):
            found[quantity] = StampedValue(float(value), sigma, stamp)

    sigma_inclination = math.sqrt(max(float(variance[0, 0]), 0.0))
    put(meanings.INCLINATION, station.inclination, sigma_inclination)
    put(meanings.SIGMA_INCLINATION, sigma_inclination, math.nan)
    turn = _to_magnetic(station.north, station.reference)
    if turn is not None and math.isfinite(station.azimuth):
        sigma_azimuth = math.sqrt(max(float(variance[1, 1]), 0.0))
        put(meanings.AZIMUTH, (station.azimuth + turn) % math.tau, sigma_azimuth)
        put(meanings.SIGMA_AZIMUTH, sigma_azimuth, math.nan)
    put(meanings.G_TOTAL, station.g_total, math.nan)
    # Use the field from which the azimuth was computed, without the axial field of the drill string.
    axial = station.interference if station.corrected and math.isfinite(station.interference) else 0.0
    b_t = np.asarray(station.b_t, dtype=float) - np.array([axial, 0.0, 0.0])
    put(meanings.DIP, float(magnetic_geometry.dip(station.f_t, b_t)), math.nan)
    put(meanings.B_TOTAL, float(np.linalg.norm(b_t)), math.nan)
    put(meanings.TEMPERATURE, survey.average.temperature, math.nan)
    return found
