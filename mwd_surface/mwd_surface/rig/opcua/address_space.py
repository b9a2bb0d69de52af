# SPDX-License-Identifier: Apache-2.0
"""
OPC UA variables of a well: names, units, values and status codes, independent of any server.

Names and namespace follow the D-WIS drilling convention: a client finds a signal of the manifest by name and unit,
never by a node number. Values are in SI and rad; every variable has its unit.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
from typing import Any

from mwd_surface.live.inputs import SONDE
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.rig.values import Condition, RigValues, rig_input
from mwd_surface.signals.table import FACTS, TO_RIG
from mwd_surface.signals.units import UNITS

MANIFEST = "MWDSurveyManifest"
NAMESPACE = f"http://ddhub.no/{MANIFEST}/Variables/"
UNITS_NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"
EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
# Status codes of OPC 10000-4, annex A, for each condition of a value.
STATUS_CODES: dict[Condition, int] = {
    Condition.GOOD: 0x00000000,
    Condition.OVERRIDE: 0x00960000,  # GoodLocalOverride
    Condition.DOUBTFUL: 0x40930000,  # UncertainSensorNotAccurate
    Condition.STALE: 0x40900000,  # UncertainLastUsableValue
    Condition.WAITING: 0x80320000,  # BadWaitingForInitialData
    Condition.FAULT: 0x808C0000,  # BadSensorFailure
    Condition.NO_LINK: 0x80310000,  # BadNoCommunication
    Condition.INACTIVE: 0x808D0000,  # BadOutOfService
}


@dataclasses.dataclass(frozen=True)
class Variable:
    """One variable; kind is "Double", "UInt32", "Boolean" or "String"; unit is empty if the variable has none."""

    name: str
    kind: str
    unit: str
    description: str


@dataclasses.dataclass(frozen=True)
class VariableValue:
    """Present content of a variable: value, status code, and time of the measurement, ns since the epoch, or 0."""

    value: float | int | bool | str
    status: int
    stamp_ns: int

    def data_value(self, ua: Any, kind: str) -> Any:
        """
        Return a DataValue; source timestamp: time of the measurement, server timestamp: present time.

        ua: `asyncua.ua`; kind: name of the variable's `VariantType`. A value without a stamp has no source timestamp.
        """
        return ua.DataValue(
            ua.Variant(self.value, getattr(ua.VariantType, kind)),
            StatusCode=ua.StatusCode(self.status),
            SourceTimestamp=moment(self.stamp_ns) if self.stamp_ns else None,
            ServerTimestamp=dt.datetime.now(dt.UTC),
        )


def moment(stamp_ns: int) -> dt.datetime:
    """Return a stamp, ns since the epoch, as a UTC datetime with microseconds."""
    return EPOCH + dt.timedelta(microseconds=stamp_ns // 1000)


VARIABLES: tuple[Variable, ...] = tuple(
    Variable(signal.opcua, signal.type, signal.unit, signal.meaning) for signal in (*TO_RIG, *FACTS)
)


def unit_id(unit: str) -> int:
    """Return the number of a unit in EUInformation, from its UNECE code (OPC 10000-8, section 5.6.3)."""
    number = 0
    for character in UNITS[unit].unece:
        number = number << 8 | ord(character)
    return number


def variable_values(values: RigValues) -> dict[str, VariableValue]:
    """Return the content of every variable, by name."""
    table = {
        name: VariableValue(v.value, STATUS_CODES[v.condition], v.stamp_ns)
        for name, v in ((signal.opcua, values.values[signal.name]) for signal in TO_RIG)
    }
    toolface, survey = values.toolface, values.survey
    state = STATUS_CODES[Condition.GOOD if values.active else Condition.INACTIVE]
    waiting = STATUS_CODES[Condition.WAITING]
    face = STATUS_CODES[toolface.condition]
    taken = table["Inclination"].status
    now = values.made_ns
    mode = "gravity" if values.mode == GRAVITY else "magnetic"
    table["ToolfaceMode"] = VariableValue(mode, face, toolface.stamp_ns)
    # The age itself is valid, even if the toolface is too old to be used.
    age_state = waiting if toolface.age is None else state
    table["ToolfaceAge"] = VariableValue(0.0 if toolface.age is None else toolface.age, age_state, now)
    table["Rotating"] = VariableValue(values.rotating, face, toolface.stamp_ns)
    number, verdict, stamp = 0, 0, 0
    if survey is not None:
        number, verdict, stamp = survey.result.sequence, int(survey.result.verdict), survey.result.stamp_ns
    table["SurveySequence"] = VariableValue(number, taken, stamp)
    made_of = "" if survey is None else survey.source.words
    table["SurveyAzimuthSource"] = VariableValue(made_of, taken, stamp)
    table["SurveyQuality"] = VariableValue(verdict, taken, stamp)
    table["NorthReference"] = VariableValue(values.north, state, now)
    table["SondeLink"] = VariableValue(values.sonde_link, state, now)
    for name, fact in (("Circulating", values.circulating), ("InSlips", values.in_slips)):
        table[name] = VariableValue(bool(fact), waiting if fact is None else state, now)
    table["Recording"] = VariableValue(values.recording, state, now)
    table["Simulated"] = VariableValue(values.simulated, state, now)
    control, advice = values.control, values.advice
    facts: dict[str, int | str] = {
        "ControlState": int(control.state),
        "ControlOwner": control.owner,
        "ControlLease": control.lease,
        "ControlPending": control.pending,
        "ControlPendingOf": control.pending_controller,
        "ControlReason": control.reason,
        "ControlRefusal": control.refusal,
        "SetPointSequence": control.sequence,
        "SetPointAcknowledged": control.acknowledged,
        "SetPointMode": int(control.mode),
        "AdvisedMode": int(advice.mode),
        "AdviceReason": advice.reason,
        "DepthSource": values.inputs.depth_source,
    }
    table |= {name: VariableValue(fact, state, now) for name, fact in facts.items()}
    for name, row in (("SondeClock", values.inputs.named(SONDE)), ("RigClock", rig_input(values.inputs))):
        clock = "" if row is None else row.clock.name.lower()
        table[name] = VariableValue(clock, waiting if row is None else state, now)
    table["Heartbeat"] = VariableValue(values.heartbeat & 0xFFFFFFFF, state, now)
    return table
