# SPDX-License-Identifier: Apache-2.0
"""Texts for sensor faults, for tables, logs and diagnostics; no program parses them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

from mwd_estimation.core.axis_mappings import MAPPINGS, kind_of
from mwd_estimation.core.sensor_fault import SENSORS, FaultCode, FaultUnit, SensorFault
from mwd_sensors.core.mount import PRESETS

# Units other than SI that gyro, accelerometer and magnetometer may send; `SensorFault.other_unit` is an index in the
# tuple of a sensor.
OTHER_UNITS = (("deg/s",), ("g",), ("mT", "gauss", "uT", "mG", "nT"))
_SI = ("rad/s", "m/s^2", "T")
_VECTORS = ("angular_velocity", "linear_acceleration", "magnetic_field")
_CABLE = "check plug and cable of the sensor; if the fault remains, change the probe"


@dataclasses.dataclass(frozen=True)
class FaultText:
    """Description of a fault for people."""

    #: stuck, saturated, invalid, dead, noise, absent, held, rate, stamps, replayed, unit, swapped, flipped, frame,
    #: mount, mismatch or gravity; several possible kinds are joined by "/".
    kind: str
    #: `sensor`, `axis`: names of the faulty sensor and axis; several possible names are joined by "/". The axis is ""
    #: if the fault does not belong to single axes.
    sensor: str
    axis: str
    severity: str  #: "error": do not use the sensor; "warning": use it with care
    confidence: float  #: probability that the description is right, 0 to 1; lower for indirect evidence
    #: `message`, `remedy`: what is wrong, and what to do about it ("" for a fault that has ended).
    message: str
    remedy: str


def describe(fault: SensorFault) -> FaultText:
    """Return the description of a fault for people; a fault that has ended gets no remedy."""
    sensor, description = SENSORS[fault.place // 3], _DESCRIPTIONS[fault.code]
    message, remedy = (_not_provided if fault.declared else description.words)(fault, sensor)
    text = FaultText(
        description.kind or fault.code.name.lower(),
        _sensors(fault),
        _axis(fault),
        "warning" if description.warns or (fault.code == FaultCode.FRAME and not any(_few(fault))) else "error",
        _confidence(fault),
        message,
        remedy,
    )
    ways = [kind_of(k) for mask in _few(fault) for k in _bits(mask, len(MAPPINGS))]
    if ways:
        text = dataclasses.replace(text, kind=_joined(kind for kind, _ in ways), axis=_joined(axis for _, axis in ways))
    if fault.cleared_ns:
        return dataclasses.replace(text, message=f"{text.message} (has ended)", remedy="")
    return text


def _bits(mask: int, count: int) -> list[int]:
    return [k for k in range(count) if mask >> k & 1]


def _joined(names: Iterable[str]) -> str:
    return "/".join(dict.fromkeys(names))


def _few(fault: SensorFault) -> tuple[int, ...]:
    """
    Return the mappings that explain an AXES or FRAME fault, one bit mask (`SensorFault.mappings`) for each sensor.

    The result is empty for other faults, and for a FRAME fault that more than four mappings explain.
    """
    count = sum(mask.bit_count() for mask in fault.mappings)
    return fault.mappings if fault.code == FaultCode.AXES or 0 < count <= 4 else ()


def _sensors(fault: SensorFault) -> str:
    if fault.code == FaultCode.STAMPS or (fault.code == FaultCode.SILENT and fault.unit != FaultUnit.CONVENTIONAL):
        return "gyro/accelerometer" if fault.unit == FaultUnit.CONVENTIONAL else "precision unit"
    names = [SENSORS[s] for s in fault.sensors]
    if fault.code == FaultCode.FRAME and not any(_few(fault)):
        names = list(SENSORS[1:])
    precise = [f"precision {sensor}" for sensor in names]
    return "/".join(
        {FaultUnit.CONVENTIONAL: names, FaultUnit.PRECISION: precise, FaultUnit.EITHER: names + precise}[fault.unit]
    )


def _axis(fault: SensorFault) -> str:
    if fault.code in (FaultCode.STUCK, FaultCode.SATURATED, FaultCode.CLIPPED):
        return "xyz"[fault.place % 3]
    if fault.code in (FaultCode.INVALID, FaultCode.NOISE):
        return "/".join("xyz"[k] for k in fault.axes)
    if fault.code in (FaultCode.RATE, FaultCode.STAMPS, FaultCode.REPLAYED, FaultCode.FRAME, FaultCode.MOUNT):
        return ""
    return "y/z" if fault.code == FaultCode.REST_RATE else "all"


def _confidence(fault: SensorFault) -> float:
    count = sum(mask.bit_count() for mask in _few(fault))
    sure = (0.8 if fault.code == FaultCode.FRAME else 0.95) / count if count else _DESCRIPTIONS[fault.code].confidence
    if fault.code == FaultCode.SIGN:
        sure /= len(fault.sensors)
    return 0.5 * sure if fault.unit == FaultUnit.EITHER else sure


def _stuck(fault: SensorFault, sensor: str) -> tuple[str, str]:
    where = "zero" if fault.value == 0.0 else "one value"
    return f"{_of(fault)}{sensor} {_axis(fault)} axis is stuck at {where} while the tool moves", _CABLE


def _of(fault: SensorFault) -> str:
    return {FaultUnit.CONVENTIONAL: "", FaultUnit.PRECISION: "precision ", FaultUnit.EITHER: "one of the two units: "}[
        fault.unit
    ]


def _not_provided(fault: SensorFault, sensor: str) -> tuple[str, str]:
    remedy = (
        f"if the unit has this sensor, let the driver send {_VECTORS[fault.place // 3]}_covariance, or zeros if unknown"
    )
    return f"{_of(fault)}{sensor} is not used: its messages declare it not provided (covariance -1)", remedy


def _saturated(fault: SensorFault, sensor: str) -> tuple[str, str]:
    if fault.code == FaultCode.SATURATED:
        remedy = "check the range setting of the sensor; if the fault remains at rest, change the probe"
        return f"{_of(fault)}{sensor} {_axis(fault)} axis is always at the end of its range", remedy
    remedy = "reduce rotary speed or shocks, or use a sensor with a wider range"
    return f"{_of(fault)}{sensor} {_axis(fault)} axis is often at the end of its range", remedy


def _dead(fault: SensorFault, sensor: str) -> tuple[str, str]:
    what = "only zeros" if fault.value == 0.0 else "the same values again and again"
    return f"{_of(fault)}{sensor} is dead: it sends {what}", _CABLE


def _noise(fault: SensorFault, sensor: str) -> tuple[str, str]:
    factor, unit = ((1.0, "rad/s"), (1.0, "m/s^2"), (1e6, "uT"))[fault.place // 3]
    size = f"{factor * fault.value:.0f} {unit}"
    return f"{sensor} reads noise of {size} from sample to sample", f"check the range setting of the sensor; {_CABLE}"


def unit_words(fault: SensorFault) -> str:
    """Return the name of the unit of measurement that the sensor seems to send, for a fault with code UNIT."""
    name = OTHER_UNITS[fault.place // 3][fault.other_unit]
    return "G" if name == "gauss" else name


def _unit(fault: SensorFault, sensor: str) -> tuple[str, str]:
    s = fault.place // 3
    return (
        f"{_of(fault)}{sensor} looks like {unit_words(fault)}, not {_SI[s]}",
        f"convert the samples to {_SI[s]} in the driver",
    )


def _silent(fault: SensorFault, sensor: str) -> tuple[str, str]:
    return f"{sensor if fault.unit == FaultUnit.CONVENTIONAL else 'precision unit'} no longer sends samples", _CABLE


def _rate(fault: SensorFault, _: str) -> tuple[str, str]:
    pace = f"{fault.value:.0f} IMU samples come per second, {fault.limit:.0f} came before"
    return pace, "check the rate setting and the link's load"


def _gravity(fault: SensorFault, sensor: str) -> tuple[str, str]:
    says = "reads no gravity" if fault.value < fault.limit else "reads more than gravity"
    mean = f"the mean force is {fault.value:.1f} m/s^2, expected {fault.limit:.1f}"
    return f"{sensor} {says}: {mean}", f"check the range setting of the sensor; {_CABLE}"


def _sign(fault: SensorFault, _: str) -> tuple[str, str]:
    remedy = "reverse the signs in the driver: at rest the accelerometer reads up, the magnetometer along the field"
    if 2 in fault.sensors:
        remedy += "; or correct the reference, if its dip or latitude was given with the wrong sign"
    if fault.code == FaultCode.POINTS_UP or fault.sensors == (1,):
        remedy = "set tool.mount.accelerometer to down (mwd process: --accelerometer down)"
    if fault.code == FaultCode.POINTS_UP:
        return "accelerometer reads upside down: the hole would point upwards", remedy
    if fault.sensors == (1,):
        return "accelerometer reads gravity instead of specific force: all its signs are reversed", remedy
    return f"all signs of the {' or the '.join(SENSORS[s] for s in fault.sensors)} are reversed", remedy


def _frame(fault: SensorFault, _: str) -> tuple[str, str]:
    message = "accelerometer and magnetometer do not match: the field strength is right, but the dip is wrong"
    remedy = "check axes, frame and stamps of both, and the reference field; look for external interference"
    ways = _way_words(_few(fault))
    return (f"{message}; the dip fits with {ways}" if ways else message), remedy


def _mount(fault: SensorFault, _: str) -> tuple[str, str]:
    found = fault.mount
    if found not in PRESETS:
        off = math.degrees(math.acos(min(max(fault.value, -1.0), 1.0)))
        remedy = (
            f'set tool.mount.imu (mwd process: --mount) to "{found}"; turning does not show the scribe line, which '
            "tool.toolface_offset_deg sets"
        )
        return f"the string turns about an axis {off:.0f} deg off the unit's x: the unit is mounted askew", remedy
    remedy = f"set tool.mount.imu to {found} (mwd process: --mount {found})"
    return (
        f"the string turns about the unit's {found[0]} axis: the unit is mounted {found}, not as tool.mount.imu states",
        remedy,
    )


def _axes_words(fault: SensorFault, _: str) -> tuple[str, str]:
    remedy = "correct the axes in the driver or the mounting, then rotate the tool again"
    return f"{_of(fault)}the motion shows wrong axes; {_way_words(fault.mappings)}", remedy


def _way_words(masks: tuple[int, ...]) -> str:
    return ", or ".join(
        f"{SENSORS[s]}: " + " or ".join(mapping_words(k) for k in _bits(mask, len(MAPPINGS)))
        for s, mask in enumerate(masks)
        if mask
    )


def mapping_words(k: int) -> str:
    """Return words that say how the mapping with index k in `axis_mappings.MAPPINGS` changes the axes."""
    kind, axes = kind_of(k)
    still = [a for a in "xyz" if a not in axes]
    if kind == "flipped":
        return "all axes reversed (or the frame left-handed)" if axes == "all" else f"{axes} axis reversed"
    if kind == "swapped":
        return f"{axes[0]} and {axes[1]} exchanged"
    if still:
        half = all(MAPPINGS[k][n, n] for n in range(3))
        return f"turned {'half round' if half else 'a quarter'} about {still[0]}"
    signs = ("-" if row.sum() < 0 else "" for row in MAPPINGS[k])
    sources = ("xyz"[int(abs(row).argmax())] for row in MAPPINGS[k])
    return "axes mixed up ({})".format(
        ", ".join(f"{a} is {s}{b}" for a, s, b in zip("xyz", signs, sources, strict=True))
    )


Words = Callable[[SensorFault, str], tuple[str, str]]


class _Description(NamedTuple):
    """Message, remedy, kind, confidence and severity for the faults with one code."""

    words: Words  #: returns message and remedy, from a fault and the name of its sensor
    kind: str = ""  #: `FaultText.kind`; if empty, the name of the fault code in lower case
    confidence: float = 0.99  #: confidence of the description; lower for a fault that shows only indirectly
    warns: bool = False  #: whether the severity is "warning" instead of "error"


def _plain(message: str, remedy: str) -> Words:
    return lambda fault, sensor: (message.format(sensor=_of(fault) + sensor, fault=fault), remedy)


_DESCRIPTIONS = {
    FaultCode.STUCK: _Description(_stuck),
    FaultCode.SATURATED: _Description(_saturated),
    FaultCode.CLIPPED: _Description(_saturated, "saturated", warns=True),
    FaultCode.INVALID: _Description(
        _plain(
            "{sensor} sends values that are not finite or far outside its range",
            "compare the range in the settings of the tool (tool.gyro.range_deg_s and the like) with the data sheet of "
            f"the sensor; {_CABLE}",
        )
    ),
    FaultCode.DEAD: _Description(_dead),
    FaultCode.NOISE: _Description(_noise, confidence=0.95),
    FaultCode.NEVER_CAME: _Description(
        _plain(
            "no {sensor} data arrives",
            "connect the sensor, or remap its topic; for a tool without magnetometer set tool.magnetometer.present to "
            "false",
        ),
        "absent",
        warns=True,
    ),
    FaultCode.SILENT: _Description(_silent, "absent"),
    FaultCode.REPEATED: _Description(
        _plain(
            "{sensor} sends values twice: {fault.value:.0%} repeat the previous value",
            "set the output rate to the sampling rate of the sensor",
        ),
        "held",
        0.9,
        warns=True,
    ),
    FaultCode.RATE: _Description(_rate, confidence=0.9, warns=True),
    FaultCode.STAMPS: _Description(
        _plain("stamps of samples repeat or run backwards", "stamp samples where they are measured")
    ),
    FaultCode.REPLAYED: _Description(
        _plain(
            "earlier samples arrive again with new stamps",
            "the link plays old data: clear its buffer and take the surveys of this time again",
        )
    ),
    FaultCode.UNIT: _Description(_unit, confidence=0.97),
    FaultCode.AXES: _Description(_axes_words),
    FaultCode.SIGN: _Description(_sign, "flipped", 0.95),
    FaultCode.POINTS_UP: _Description(_sign, "flipped", 0.95),
    FaultCode.FRAME: _Description(_frame, confidence=0.6),
    FaultCode.MOUNT: _Description(_mount, confidence=0.95),
    FaultCode.GRAVITY: _Description(_gravity, confidence=0.9),
    FaultCode.MISMATCH: _Description(
        _plain(
            "{sensor} agrees with no axis of the same sensor in the other unit",
            "check scale, clock and mounting of the sensor",
        ),
        confidence=0.9,
    ),
    FaultCode.ADRIFT: _Description(
        _plain(
            "{sensor} measures a rotation that does not fit gravity and the magnetic field",
            f"check unit and range of the sensor; {_CABLE}",
        ),
        "mismatch",
        0.9,
    ),
    FaultCode.REST_RATE: _Description(
        _plain(
            "{sensor} measures a larger rate at rest than the Earth rate and its stated bias",
            "check unit (rad/s) and calibration of the gyro; tool.precision.gyro.bias_deg_h is the bias that is "
            "allowed",
        ),
        "unit",
        0.9,
    ),
}
