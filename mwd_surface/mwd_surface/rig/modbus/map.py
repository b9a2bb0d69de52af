# SPDX-License-Identifier: Apache-2.0
"""
Modbus register map: 80 input registers that are replaced as one block, so that a reader never sees a partial update.

No standard map exists for MWD. Addresses count from 0; in a Modbus program that counts from 1, add one. The units are
those used on a rig: deg, m, nT, standard gravities, r/min, degC.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Sequence

from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.settings import setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.live.inputs import BLOCK, HAND, SONDE, InputTable
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS
from mwd_surface.live.toolface import GRAVITY
from mwd_surface.rig.values import RigValues, rig_input
from mwd_surface.signals.table import TO_RIG
from mwd_surface.signals.units import UNITS
from mwd_surface.trajectory.advice import AdviceMode

VERSION = 3  # version of the register map, register 0
COUNT = 80  # number of input registers
WRITABLE, WRITABLE_COUNT = 100, 2  # address and number of the holding registers for the bit depth
WORD_ORDERS = ("ABCD", "CDAB")
# Age sent while there is no toolface yet, s.
NEVER = 1e9
_LARGEST = 3.4e38  # largest magnitude that a 32-bit float holds
_NAN: tuple[int, ...] = (0x7FC0, 0x0000)  # words of a 32-bit float NaN
# By address of the first register of a float: name of the value, factor from SI to the unit of the register, and the
# value at which an angle starts again from 0 (0 if the value is not an angle).
FLOATS: dict[int, tuple[str, float, float]] = {
    signal.modbus: (signal.name, UNITS[signal.unit].modbus.factor, signal.wrap)
    for signal in TO_RIG
    if signal.modbus is not None
}
# First registers of toolface age, time of the survey, control, and inputs
_AGE, _TIME, _CONTROL, _INPUTS = 8, 34, 38, 78
# Values of register 78 by name of the depth source; 0: no source, 9: a source that is not in this table.
DEPTH_SOURCES = {"": 0, HAND: 1, "rig_floor": 2, OPCUA: 3, WITS: 4, MODBUS: 5, BLOCK: 6}
_ANOTHER, _NO_CLOCK = 9, 255  # a depth source that is not in the table; no clock, because the input sends no data
# The name of a Modbus controller in the control authority is this prefix and the number of the controller.
CONTROLLER = "modbus "


class StatusBit:
    """Bit numbers of register 2."""

    ACTIVE = 0
    SONDE_LINK = 1
    TOOLFACE_FRESH = 2
    SURVEY_ACCEPTED = 3
    QUALITY_DOUBTFUL = 4
    QUALITY_BAD = 5
    INTERFERENCE_CORRECTED = 6
    RECORDING = 7
    MAGNETIC_MODE = 8
    GRAVITY_MODE = 9
    ROTATING = 10
    SIMULATED = 15


class ControlBit:
    """Bit numbers of register 39."""

    ENABLED = 0
    MWD_ALIVE = 1
    REFUSED = 2
    ADVISED_SLIDE = 3
    ADVISED_ROTATE = 4
    ADVISED_MAGNETIC = 5


@dataclasses.dataclass(frozen=True)
class ModbusForm:
    """Encoding of numbers in registers."""

    word_order: str = setting(
        "ABCD",
        "Order of the bytes of a number that fills several registers. ABCD: high word first. CDAB: low word first.",
        choices=WORD_ORDERS,
    )
    nan_invalid: bool = setting(
        False,
        "Send a quiet NaN in place of a value that must not be used. If false, the registers keep the last value. A "
        "value that is not known is always NaN.",
    )


def registers(values: RigValues, form: ModbusForm) -> tuple[int, ...]:
    """Return registers 0 to 79 for the given values, each 0 to 65535."""
    block = [0] * COUNT
    survey = values.survey
    block[0] = VERSION
    block[1] = values.heartbeat & 0xFFFF
    block[2] = status_bits(values)
    block[3] = survey.result.sequence & 0xFFFF if survey is not None else 0
    for address, (name, factor, wrap) in FLOATS.items():
        value = values.values[name]
        # A number that nothing has given, such as the sigma of an azimuth that the survey does not have, is never 0.
        invalid = not value.condition.usable and (form.nan_invalid or value.age is None)
        words = _NAN if invalid else _float_words(value.value * factor, wrap)
        block[address : address + 2] = _ordered(words, form)
    age = values.toolface.age
    block[_AGE : _AGE + 2] = _ordered(_float_words(NEVER if age is None else age, 0.0), form)
    milliseconds = survey.result.stamp_ns * 1000 // NANOSECONDS if survey is not None else 0
    time_words = struct.unpack(">4H", struct.pack(">Q", milliseconds))
    block[_TIME : _TIME + 4] = _ordered(time_words, form)
    block[_CONTROL : _CONTROL + 8] = _control_registers(values, form)
    block[_INPUTS : _INPUTS + 2] = _input_registers(values.inputs)
    return tuple(block)


def _input_registers(inputs: InputTable) -> tuple[int, int]:
    """
    Return registers 78 and 79: source of the depth, and clocks that stamp the inputs.

    The clock of the rig's data is the high byte of register 79, the clock of the sonde's data the low byte.
    """
    clocks = [_NO_CLOCK if row is None else int(row.clock) for row in (rig_input(inputs), inputs.named(SONDE))]
    return DEPTH_SOURCES.get(inputs.depth_source, _ANOTHER), clocks[0] << 8 | clocks[1]


def _control_registers(values: RigValues, form: ModbusForm) -> tuple[int, ...]:
    """Return registers 38 to 45: owner and lease of the control, and numbers of the set-points."""
    control, advice = values.control, values.advice
    bits = {
        ControlBit.ENABLED: control.enabled,
        ControlBit.MWD_ALIVE: control.mwd_alive,
        ControlBit.REFUSED: bool(control.refusal),
        ControlBit.ADVISED_SLIDE: advice.mode == AdviceMode.SLIDE,
        ControlBit.ADVISED_ROTATE: advice.mode == AdviceMode.ROTATE,
        ControlBit.ADVISED_MAGNETIC: advice.magnetic,
    }
    number = control.owner.removeprefix(CONTROLLER)
    ours = control.owner.startswith(CONTROLLER) and number.isdecimal()
    return (
        int(control.state),
        sum(1 << bit for bit, on in bits.items() if on),
        *_ordered(long_words(control.lease), form),
        int(number) & 0xFFFF if ours else 0,
        control.sequence & 0xFFFF,
        control.acknowledged & 0xFFFF,
        int(control.mode),
    )


def long_words(number: int) -> tuple[int, int]:
    """Return both words of a 32-bit number, the higher word first."""
    return number >> 16 & 0xFFFF, number & 0xFFFF


def long_of(words: Sequence[int], form: ModbusForm) -> int:
    """Return the 32-bit number in two registers."""
    high, low = _ordered(tuple(words), form)
    return high << 16 | low


def status_bits(values: RigValues) -> int:
    """Return register 2. The toolface of a rotating string is never fresh, because it cannot be used to steer."""
    survey = values.survey
    usable = values.toolface.condition.usable
    bits = {
        StatusBit.ACTIVE: values.active,
        StatusBit.SONDE_LINK: values.sonde_link,
        StatusBit.TOOLFACE_FRESH: usable and not values.rotating,
        StatusBit.SURVEY_ACCEPTED: survey is not None,
        StatusBit.QUALITY_DOUBTFUL: survey is not None and survey.result.verdict == Verdict.DOUBTFUL,
        StatusBit.QUALITY_BAD: survey is not None and survey.result.verdict == Verdict.REJECT,
        StatusBit.INTERFERENCE_CORRECTED: survey is not None and survey.source.corrected,
        StatusBit.RECORDING: values.recording,
        StatusBit.MAGNETIC_MODE: values.mode != GRAVITY,
        StatusBit.GRAVITY_MODE: values.mode == GRAVITY,
        StatusBit.ROTATING: values.rotating,
        StatusBit.SIMULATED: values.simulated,
    }
    return sum(1 << bit for bit, on in bits.items() if on)


def float_of(words: Sequence[int], form: ModbusForm) -> float:
    """Return the float in two registers."""
    return float(struct.unpack(">f", struct.pack(">2H", *_ordered(tuple(words), form)))[0])


def _float_words(value: float, wrap: float) -> tuple[int, ...]:
    packed = struct.pack(">f", max(-_LARGEST, min(_LARGEST, value)))
    if wrap and struct.unpack(">f", packed)[0] >= wrap:
        packed = struct.pack(">f", 0.0)
    return struct.unpack(">2H", packed)


def _ordered(words: tuple[int, ...], form: ModbusForm) -> tuple[int, ...]:
    return words if form.word_order == "ABCD" else words[::-1]
