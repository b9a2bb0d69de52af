# SPDX-License-Identifier: Apache-2.0
"""
WITS level 0 records: 7 (survey), 8 (formation) and 9 (mechanical) are sent, 1 (time based) is received.

Codes, short names and units follow the WITS specification as given by two independent transcriptions. There are no
standard items for totals, dip, quality or temperature. They are sent in the spare items of record 7, in the order that
a profile defines; the peer must use the same profile.
"""

from __future__ import annotations

import dataclasses
import datetime as dt

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.rig.values import Condition, RigValue, RigValues, survey_values
from mwd_surface.rig.wits.format import WitsFrame, checked_text, plain_text
from mwd_surface.signals.cells import fixed
from mwd_surface.signals.table import BY_NAME, SIGNALS, SURVEY, TO_RIG, Signal, Wits
from mwd_surface.signals.units import UNITS, UnitScale
from mwd_surface.surveys.azimuth_source import AzimuthSource

SYSTEMS = ("metric", "fps")
SPARES = ("totals", "mwdstd-raw6", "none")
# Signal that is read from each item of record 1, by code.
RECORD_1: dict[int, Signal] = {s.reads: s for s in SIGNALS if s.reads is not None}
_ITEMS = tuple((s.wits, s) for s in TO_RIG if s.wits is not None)
_HOLE = Wits(711, "DMEA", 2)  # hole depth, also sent in the record of a survey
# Item and signal of each value that is sent, by code.
SENT: dict[int, tuple[Wits, Signal]] = {item.code: (item, s) for item, s in _ITEMS} | {
    _HOLE.code: (_HOLE, BY_NAME["hole_depth"])
}
# Name of the signal of each standard item that is taken from the accepted survey, by code.
_OF_SURVEY = {item.code: s.name for item, s in _ITEMS if item.name and s.source == SURVEY}
# Codes and names of the live values, by record number.
_LIVE_ITEMS = {
    record: sorted((item.code, s.name) for item, s in _ITEMS if item.code // 100 == record) for record in (8, 9)
}
_SAME_TIME_NS = 600 * NANOSECONDS  # longest time between a survey and a hole depth that is sent with the survey
_DRILLING, _CONNECTION, _CIRCULATING = 2, 3, 7  # codes of the rig activity
# Sequence numbers count seconds from 2020-01-01 (here in s since the epoch), so that they continue to grow after a
# restart without being stored.
_SEQUENCE_EPOCH = 1_577_836_800


@dataclasses.dataclass(frozen=True)
class Wits0Format:
    """Format of the records; both sides must use the same settings."""

    units: str = setting("metric", "System of units of all records.", choices=SYSTEMS)
    spares: str = setting(
        "totals",
        "Content of the spare items 0722 to 0727. totals: total gravity (g), total field (nT), dip (deg), verdict (0 "
        "good, 1 doubtful, 2 bad) and temperature (degC). mwdstd-raw6: gravity (mg) and field (nT) of the three axes.",
        choices=SPARES,
    )
    source: str = setting("", "Name of the sender, sent as item 1984 of every packet. Empty: the item is not sent.")
    well_id: str = setting("", "Text of item WID. Empty: the name of the well in ASCII.")
    section: int = setting(0, "Value of item SKNO, the number of the sidetrack or hole section.", low=0, high=99)
    null_text: str = setting("", "Text sent in place of an invalid value, such as -9999. Empty: the item is left out.")
    mixed: bool = setting(False, "Send all records in one packet. If false, each record has a packet of its own.")
    toolface_while_rotating: bool = setting(False, "Send toolfaces also while the string rotates.")

    def __post_init__(self) -> None:
        """Raise ValueError for a text that would break a frame: name of the sender, name of the well, or null text."""
        for name in ("source", "well_id", "null_text"):
            try:
                checked_text(getattr(self, name))
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from error


Items = list[tuple[int, str]]


class RecordWriter:
    """Writer of records from values; the last sequence number of each record is stored."""

    def __init__(self, form: Wits0Format) -> None:
        self.form = form
        self._sequence: dict[int, int] = {}

    def survey(self, values: RigValues, survey: AcceptedSurvey) -> Items:
        """Return record 7 of an accepted survey, with the time of its measurement."""
        known = survey_values(survey, survey.result.stamp_ns)
        # A WITS number has no quality flag, so a number that is based on an assumption is not sent.
        numbers: dict[int, float | None] = {
            code: None
            if known[name].condition == Condition.WAITING or BY_NAME[name].field in survey.assumed
            else known[name].value
            for code, name in _OF_SURVEY.items()
        }
        hole = values.values["hole_depth"]
        # Send the hole depth only if it was measured at the time of the survey.
        if hole.condition.usable and abs(hole.stamp_ns - survey.result.stamp_ns) < _SAME_TIME_NS:
            numbers[_HOLE.code] = hole.value
        items = self._head(7, values, survey.result.stamp_ns, None)
        found = [(712, _survey_type(survey.source))]
        for code, number in numbers.items():
            found += self._number(code, number)
        items += sorted(found)
        return items + self._spares(survey)

    def toolface(self, values: RigValues) -> Items:
        """Return record 7 with the toolface in force; empty if no toolface is usable and there is no null text."""
        value = values.toolface
        code = 717 if values.mode == GRAVITY else 716
        usable = value.condition.usable and (self.form.toolface_while_rotating or not values.rotating)
        if usable:
            item = self._number(code, value.value)
        elif self.form.null_text and value.stamp_ns:
            item = [(code, self.form.null_text)]
        else:
            return []
        return self._head(7, values, value.stamp_ns, activity_code(values)) + item

    def formation(self, values: RigValues) -> Items:
        """Return record 8, hole and bit depth; empty if neither is usable and there is no null text."""
        return self._record(8, values)

    def mechanical(self, values: RigValues) -> Items:
        """Return record 9, downhole rotary speed; empty if the speed is not usable and there is no null text."""
        return self._record(9, values)

    def _record(self, record: int, values: RigValues) -> Items:
        """Return a record of live signals with its items from the signal table."""
        items: Items = []
        stamp = 0
        for code, name in _LIVE_ITEMS[record]:
            value = values.values[name]
            if value.condition.usable:
                items += self._number(code, value.value)
                stamp = max(stamp, value.stamp_ns)
            elif self.form.null_text and value.stamp_ns:
                items.append((code, self.form.null_text))
                stamp = max(stamp, value.stamp_ns)
        return self._head(record, values, stamp, activity_code(values)) + items if items else []

    def _head(self, record: int, values: RigValues, stamp_ns: int, activity: int | None) -> Items:
        at = dt.datetime.fromtimestamp(stamp_ns // NANOSECONDS, tz=dt.UTC)
        items = [
            (1, self.form.well_id or plain_text(values.well)),
            (2, str(self.form.section)),
            (3, str(record)),
            (4, str(self._next(record, values.made_ns))),
            (5, f"{at:%y%m%d}"),
            (6, f"{at:%H%M%S}"),
        ]
        if activity is not None:
            items.append((7, str(activity)))
        return [(record * 100 + code, text) for code, text in items if text]

    def _next(self, record: int, made_ns: int) -> int:
        number = max(self._sequence.get(record, 0) + 1, made_ns // NANOSECONDS - _SEQUENCE_EPOCH)
        self._sequence[record] = number
        return number

    def _number(self, code: int, value: float | None) -> Items:
        """Return the item of an SI value, converted to the unit of the record; for None no item, or the null text."""
        item, signal = SENT[code]
        scale = _scale(signal, self.form.units)
        # An angle that rounds to 360 deg is written as 0.
        return self._item(code, fixed(None if value is None else scale.of(value), item.decimals, signal.wrap))

    def _item(self, code: int, text: str) -> Items:
        """Return the item of a text; for an empty text no item, or the null text of the settings."""
        text = text or self.form.null_text
        return [(code, text)] if text else []

    def _spares(self, s: AcceptedSurvey) -> Items:
        rows: tuple[tuple[int, float | None, int], ...] = ()
        items: Items = []
        if self.form.spares == "totals":
            for code, field in ((722, "g_total"), (723, "b_total"), (724, "dip")):
                items += self._number(code, s.value(field))
            rows = ((725, float(s.result.verdict), 0), (726, s.value("temperature"), 2))
        elif self.form.spares == "mwdstd-raw6":
            # The profile sends gravity, which points down, in thousandths of standard gravity; specific force has the
            # opposite sign.
            g = [-v / STANDARD_GRAVITY * 1e3 for v in s.result.specific_force]
            b = [v * 1e9 for v in s.result.magnetic_field]
            rows = tuple((722 + k, v, 2) for k, v in enumerate(g)) + tuple((725 + k, v, 1) for k, v in enumerate(b))
        for code, value, decimals in rows:
            items += self._item(code, fixed(value, decimals))
        return items


def _survey_type(source: AzimuthSource) -> str:
    """Return the text of item 0712: the composition of the azimuth."""
    if source.by_gyro:
        return "MAG+GYRO" if source.magnetic else "GYRO"
    if source.multi_station:
        return "MAG-MS"
    return "MAG-AX" if source.axial_corrected else "MWD"


def activity_code(values: RigValues) -> int | None:
    """
    Return the code of the rig activity: 2 drilling, 3 connection, 7 circulating; None if the rig's data do not show it.

    The codes are those of the specification's table as printed in DigiDrill's WITS quick reference.
    """
    if values.in_slips:
        return _CONNECTION
    bit, hole = values.values["bit_depth"], values.values["hole_depth"]
    if values.circulating is not True or not (bit.condition.usable and hole.condition.usable):
        return None
    return _DRILLING if hole.value - bit.value < 0.5 else _CIRCULATING


def rig_readings(frame: WitsFrame, units: str) -> dict[str, float]:
    """Return the rig values of a frame of record 1 in SI, by RigState names, without nulls and other records."""
    readings = {}
    for code, signal in RECORD_1.items():
        number = frame.number(code)
        if number is not None:
            readings[signal.field] = _scale(signal, units).si(number)
    return readings


def _scale(signal: Signal, units: str) -> UnitScale:
    """Return the unit of a signal in a system of units."""
    return UNITS[signal.unit].metric if units == "metric" else UNITS[signal.unit].fps


def shown(value: RigValue) -> str:
    """Return the text of a value for a status line; the condition in words if the value is not usable."""
    return fixed(value.value, 4) if value.condition.usable else value.condition.value
