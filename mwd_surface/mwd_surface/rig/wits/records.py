# SPDX-License-Identifier: Apache-2.0
"""
Records of WITS level 0: 7 (survey), 8 (formation) and 9 (mechanical) out, 1 (time based) in.

Codes, short names and units are those of the WITS specification as two independent transcriptions give them. No
standard item exists for totals, dip, quality or temperature: the spare items of record 7 carry what a profile defines,
and the peer must know which.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
import math
from collections.abc import Sequence

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.exports.survey_table import fixed
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.rig.signals import SIGNALS
from mwd_surface.rig.survey import AcceptedSurvey
from mwd_surface.rig.value import RigValue
from mwd_surface.rig.values import RigValues
from mwd_surface.rig.wits.format import Frame, checked_text, number_text, plain_text
from mwd_surface.surveys.azimuth_source import AzimuthSource

UNITS = ("metric", "fps")
SPARES = ("totals", "mwdstd-raw6", "none")
_FOOT = 0.3048
_DEG = 180.0 / math.pi
_RPM = 30.0 / math.pi
# Deg per 30 m and per 100 ft, of rad/m.
_DOGLEG = {"metric": 30.0 * _DEG, "fps": 100.0 * _FOOT * _DEG}
_LENGTH = {"metric": 1.0, "fps": 1.0 / _FOOT}
_POUND_FORCE = 4.4482216152605  # N
# Of record 1: code, name in RigState, and what one unit of it is in SI, metric and FPS.
RECORD_1: dict[int, tuple[str, float, float]] = {
    108: ("bit_depth", 1.0, _FOOT),
    110: ("hole_depth", 1.0, _FOOT),
    112: ("block_position", 1.0, _FOOT),
    113: ("rate_of_penetration", 1.0 / 3600.0, _FOOT / 3600.0),
    114: ("hookload", 1e4, 1e3 * _POUND_FORCE),
    116: ("weight_on_bit", 1e4, 1e3 * _POUND_FORCE),
    118: ("torque", 1e3, 1e3 * _POUND_FORCE * _FOOT),
    120: ("rotary_speed", 1.0 / _RPM, 1.0 / _RPM),
    121: ("pressure", 1e3, 6894.757293168),
    130: ("flow_rate", 1e-3 / 60.0, 3.785411784e-3 / 60.0),
}
# What we send: code, short name, decimals in metric and FPS units (None: text or whole number).
SENT: dict[int, tuple[str, int | None]] = {
    701: ("WID", None),
    702: ("SKNO", None),
    703: ("RID", None),
    704: ("SQID", None),
    705: ("DATE", None),
    706: ("TIME", None),
    707: ("ACTC", None),
    708: ("DSVM", 2),
    709: ("DSVV", 2),
    711: ("DMEA", 2),
    712: ("STYP", None),
    713: ("SINC", 2),
    714: ("SAZU", 2),
    715: ("SAZC", 2),
    716: ("SMTF", 2),
    717: ("SGTF", 2),
    718: ("SNS", 2),
    719: ("SEW", 2),
    720: ("SDLS", 2),
    721: ("SWLK", 2),
    808: ("DMEA", 2),
    810: ("DBTM", 2),
    919: ("MMRP", 0),
}
# Records of live signals: codes and signals, by their numbers.
_LIVE_ITEMS = {
    record: [(s.wits, s) for s in sorted(SIGNALS, key=lambda s: s.wits or 0) if s.wits and s.wits // 100 == record]
    for record in (8, 9)
}
_SAME_TIME_NS = 600 * NANOSECONDS
_DRILLING, _CONNECTION, _CIRCULATING = 2, 3, 7
# Sequence numbers count from the seconds since then, so that they grow over a restart without a file.
_SEQUENCE_EPOCH = 1_577_836_800  # 2020-01-01


@dataclasses.dataclass(frozen=True)
class Wits0Format:
    """How records are written; both sides must agree on all of it."""

    units: str = setting("metric", "units of the session", choices=UNITS, fixed=True)
    spares: str = setting(
        "totals",
        "items 0722 to 0727: totals (g, nT, deg, quality 0 to 2, degC), six axes (mgn, nT), or none",
        choices=SPARES,
        fixed=True,
    )
    source: str = setting("", "name sent as item 1984 of every packet; empty: none", fixed=True)
    well_id: str = setting("", "item WID; empty: the name of the well in ASCII", fixed=True)
    section: int = setting(0, "item SKNO, sidetrack or hole section number", low=0, high=99, fixed=True)
    null_text: str = setting("", "text sent in place of an invalid value; empty: the item is left out", fixed=True)
    mixed: bool = setting(False, "send all records in one packet instead of one packet each", fixed=True)
    toolface_while_rotating: bool = setting(False, "send toolfaces also while the string rotates", fixed=True)

    def __post_init__(self) -> None:
        """Refuse names that would break a frame."""
        for name in ("source", "well_id", "null_text"):
            try:
                checked_text(getattr(self, name))
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from error


Items = list[tuple[int, str]]


class RecordWriter:
    """Values to the items of records; all that changes is the last sequence number of each record."""

    def __init__(self, form: Wits0Format) -> None:
        self.form = form
        self._sequence: dict[int, int] = {}
        self._length = _LENGTH[form.units]

    def survey(self, values: RigValues, survey: AcceptedSurvey) -> Items:
        """Record 7 of an accepted survey, at the time of its measurement."""
        turn = _DOGLEG[self.form.units]
        items = self._head(7, values, survey.stamp_ns, None)
        items += self._numbers(
            ((708, survey.measured_depth * self._length), (709, survey.vertical_depth * self._length))
        )
        hole = values.values["hole_depth"]
        # The hole depth of now does not belong to an old survey.
        if hole.condition.usable and abs(hole.stamp_ns - survey.stamp_ns) < _SAME_TIME_NS:
            items += self._numbers(((711, hole.value * self._length),))
        items.append((712, _survey_type(survey.source)))
        uncorrected = survey.azimuth_uncorrected
        items += self._numbers(((713, survey.inclination * _DEG),))
        items += self._angle(714, uncorrected) + self._angle(715, survey.azimuth)
        items += self._numbers(
            (
                (718, survey.position_north * self._length),
                (719, survey.position_east * self._length),
                (720, survey.dogleg_severity * turn),
                (721, survey.turn_rate * turn),
            )
        )
        return items + self._spares(survey)

    def toolface(self, values: RigValues) -> Items:
        """Record 7 with the toolface in force; empty where there is none to be used and nulls are left out."""
        value = values.toolface
        code = 717 if values.mode == GRAVITY else 716
        usable = value.condition.usable and (self.form.toolface_while_rotating or not values.rotating)
        if usable:
            item = self._angle(code, value.value)
        elif self.form.null_text and value.stamp_ns:
            item = [(code, self.form.null_text)]
        else:
            return []
        return self._head(7, values, value.stamp_ns, activity_code(values)) + item

    def formation(self, values: RigValues) -> Items:
        """Record 8: hole and bit depth; empty where neither is known now."""
        return self._record(8, values)

    def mechanical(self, values: RigValues) -> Items:
        """Record 9: rotary speed down-hole; empty where it is not known now."""
        return self._record(9, values)

    def _record(self, record: int, values: RigValues) -> Items:
        """A record of live signals: the items that the signal table gives it."""
        items: Items = []
        stamp = 0
        for code, signal in _LIVE_ITEMS[record]:
            value = values.values[signal.name]
            if value.condition.usable:
                items += self._numbers(((code, value.value * (self._length if signal.unit == "m" else _RPM)),))
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

    def _numbers(self, numbers: Sequence[tuple[int, float | None]]) -> Items:
        items: Items = []
        for code, value in numbers:
            text = number_text(value, SENT[code][1] or 0)
            if text is not None:
                items.append((code, text))
            elif self.form.null_text:
                items.append((code, self.form.null_text))
        return items

    def _angle(self, code: int, value: float | None) -> Items:
        """An angle of a full circle in degrees; what rounds to 360 is 0."""
        text = fixed(None if value is None else value * _DEG, 2, 360.0)
        return [(code, text)] if text else self._numbers(((code, None),))

    def _spares(self, s: AcceptedSurvey) -> Items:
        rows: tuple[tuple[int, float | None, int], ...] = ()
        if self.form.spares == "totals":
            rows = (
                (722, s.g_total / STANDARD_GRAVITY, 4),
                (723, None if s.b_total is None else s.b_total * 1e9, 1),
                (724, None if s.dip is None else s.dip * _DEG, 2),
                (725, float(s.verdict), 0),
                (726, s.temperature, 2),
            )
        elif self.form.spares == "mwdstd-raw6":
            # Gravity as it points, in thousandths of the standard one; the tool feels the opposite.
            g = [-v / STANDARD_GRAVITY * 1e3 for v in s.specific_force]
            b: list[float | None] = [None] * 3 if s.magnetic_field is None else [v * 1e9 for v in s.magnetic_field]
            rows = tuple((722 + k, v, 2) for k, v in enumerate(g)) + tuple((725 + k, v, 1) for k, v in enumerate(b))
        items: Items = []
        for code, value, decimals in rows:
            text = number_text(value, decimals) or self.form.null_text
            if text:
                items.append((code, text))
        return items


def _survey_type(source: AzimuthSource) -> str:
    """Text of item 0712: what the azimuth is made of."""
    if source.by_gyro:
        return "MAG+GYRO" if source.magnetic else "GYRO"
    if source.multi_station:
        return "MAG-MS"
    return "MAG-AX" if source.axial_corrected else "MWD"


def activity_code(values: RigValues) -> int | None:
    """
    What the rig does, as far as its data show: 2 drilling, 3 connection, 7 circulating; None otherwise.

    Codes as DigiDrill's WITS quick reference prints the specification's table.
    """
    if values.in_slips:
        return _CONNECTION
    bit, hole = values.values["bit_depth"], values.values["hole_depth"]
    if values.circulating is not True or not (bit.condition.usable and hole.condition.usable):
        return None
    return _DRILLING if hole.value - bit.value < 0.5 else _CIRCULATING


def rig_readings(frame: Frame, units: str) -> dict[str, float]:
    """Rig values of a frame of record 1, by the names of RigState, in SI; nulls and other records are left out."""
    readings = {}
    for code, (name, metric, fps) in RECORD_1.items():
        number = frame.number(code)
        if number is not None:
            readings[name] = number * (metric if units == "metric" else fps)
    return readings


def shown(value: RigValue) -> str:
    """One value for a status line."""
    return fixed(value.value, 4) if value.condition.usable else value.condition.value
