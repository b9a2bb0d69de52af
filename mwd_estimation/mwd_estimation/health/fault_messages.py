"""Faults of sensors in words a driller understands: what is wrong, with which sensor and axis, and what to do."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health.fault_debounce import (
    ABSENT,
    ACCEL,
    ALWAYS,
    AXES,
    CROSS,
    DEAD,
    FAULT,
    FRAME,
    GYRO,
    HELD,
    INVALID,
    LENGTH,
    MAG,
    MISMATCH,
    NOISE,
    RATE,
    SATURATED,
    SENSORS,
    SIGN,
    STAMPS,
    STATE,
    UNIT,
    UNKNOWN,
    Whole,
)


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    One fault, or its end, in words a driller understands.

    Attributes
    ----------
    kind : str
        stuck, saturated, invalid, dead, unit, swapped, flipped, frame, absent, rate, stamps, held, mismatch, gravity or
        noise.
    sensor, axis : str
        Which; several possible ones are joined by "/" ("" where no single axis is meant).
    severity : str
        "error": the sensor must not be used; "warning": it may, with care.
    confidence : float
        0 to 1: share of the possible explanations that is named, less where the evidence is indirect.
    message, remedy : str
    since_ns : int
        Stamp from which on the evidence stands.
    cleared_ns : int
        Stamp at which it was gone; 0 while it lasts.
    unusable : int
        Bits GYRO, ACCEL, MAG of what must not be used while it lasts.
    check : int
        Number of the check: the same fault, narrowed down or cleared, has the same.
    """

    kind: str
    sensor: str
    axis: str
    severity: str
    confidence: float
    message: str
    remedy: str
    since_ns: int = 0
    cleared_ns: int = 0
    unusable: int = 0
    check: int = -1


_UNITS = (
    ("deg/s",),
    ("g", "mg or cm/s^2", "ft/s^2"),
    ("mT", "gauss", "uT", "mG", "nT"),
)
_SI = ("rad/s", "m/s^2", "T")
CABLE = "check its plug and cable; if it stays, change the probe"
# Behind the message of a fault that is over.
ENDED = " (has ended)"
_IMU = "gyro/accelerometer"


def known(checks: Whole) -> dict[str, str]:
    """
    What is ok, a fault, or not yet known: units, axes and signs, by the words a panel shows.

    y and z of the gyro are listed once they are known: a string that rotates smoothly never shows them, and is healthy.
    """
    words = ("not yet known", "ok", "fault")
    names = {
        "gyro unit": UNIT, "accelerometer unit": UNIT + 1, "magnetometer unit": UNIT + 2, "axes": AXES,
        "signs of accelerometer and magnetometer": SIGN,
    }  # fmt: skip
    if checks[CROSS, STATE] != UNKNOWN:
        names["y and z of the gyro"] = CROSS
    return {name: words[int(checks[k, STATE])] for name, k in names.items()}


def finding(row: Sequence[int]) -> Finding:
    """An event of `health_evidence` in words: its time, check, state, since when, and three details."""
    now, k, condition, since = (int(v) for v in row[:4])
    fault = _described(k, [int(v) for v in row[4:7]])
    fault = dataclasses.replace(fault, since_ns=since, check=k)
    return fault if condition == FAULT else over(fault, now)


def over(fault: Finding, now: int) -> Finding:
    """The fault when it is gone, at `now`, ns."""
    return dataclasses.replace(fault, message=fault.message + ENDED, remedy="", cleared_ns=now)


def _fault(
    kind: str, sensor: str, axis: str, severity: str, confidence: float, message: str, remedy: str, unusable: int
) -> Finding:
    """A fault of no time yet."""
    return Finding(kind, sensor, axis, severity, confidence, message, remedy, unusable=unusable)


def _described(k: int, details: list[int]) -> Finding:
    if k < INVALID:
        return _axis(k, details[0])
    if k < AXES:
        return _sensor(k, details[0])
    if k == AXES:
        return _axes(details)
    if k == CROSS:
        return _axes([details[0], 0, 0])
    if k == NOISE:
        axis = "/".join(a for n, a in enumerate("xyz") if details[1] >> n & 1)
        message = f"magnetometer reads noise: it jumps by {details[0]} uT from sample to sample"
        return _fault("noise", "magnetometer", axis, "error", 0.95, message, CABLE, MAG)
    if k == LENGTH:
        return _length(0.01 * details[0], 0.01 * details[1], details[2] != 0)
    if k == SIGN:
        return _sign(details[0], details[1] != 0)
    if k == FRAME:
        return _frame(details)
    if k == MISMATCH:
        message = "gyro does not agree with gravity and the magnetic field, whatever its axes"
        remedy = "check the gyro's scale and calibration, then the probe"
        return _fault("mismatch", "gyro", "", "error", 0.7, message, remedy, GYRO)
    return _stream(k, details)


def _axis(k: int, detail: int) -> Finding:
    s, c = divmod(k % 9, 3)
    sensor, axis = SENSORS[s], "xyz"[c]
    if k < SATURATED:
        value = "zero" if detail else "one value"
        message = f"{sensor} {axis} axis is stuck at {value} while the tool feels something"
        return _fault("stuck", sensor, axis, "error", 0.99, message, CABLE, 1 << s)
    if detail == ALWAYS:
        message = f"{sensor} {axis} axis is always at the end of its range"
        remedy = "check the sensor's range setting; if it stays at rest, change the probe"
        return _fault("saturated", sensor, axis, "error", 0.99, message, remedy, 1 << s)
    message = f"{sensor} {axis} axis is often at the end of its range"
    remedy = "more than the sensor can read: reduce rotary speed or shocks, or fit a wider range"
    return _fault("saturated", sensor, axis, "warning", 0.99, message, remedy, 0)


def _sensor(k: int, detail: int) -> Finding:
    s = (k - INVALID) % 3
    sensor = SENSORS[s]
    if k < DEAD:
        axis = "/".join(a for n, a in enumerate("xyz") if detail >> n & 1)
        message = f"{sensor} sends values that are no numbers"
        return _fault("invalid", sensor, axis, "error", 1.0, message, CABLE, 1 << s)
    if k < UNIT:
        what = "only zeros" if detail else "the same values again and again"
        kind = "stuck" if s == 1 else "dead"
        return _fault(kind, sensor, "all", "error", 0.99, f"{sensor} is dead: it sends {what}", CABLE, 1 << s)
    message = f"{sensor} looks like {_UNITS[s][max(detail - 1, 0)]}, not {_SI[s]}"
    return _fault("unit", sensor, "all", "error", 0.97, message, f"convert it to {_SI[s]} in the driver", 1 << s)


def _stream(k: int, details: list[int]) -> Finding:
    if k == ABSENT:
        lost = details[0] == 1
        message = "magnetometer has fallen silent" if lost else "no magnetometer data arrives"
        severity = "error" if lost else "warning"
        return _fault("absent", "magnetometer", "all", severity, 1.0, message, CABLE, MAG if lost else 0)
    if k == RATE:
        pace = "slower" if details[0] else "faster"
        message = f"IMU samples come {pace} than the {details[1] / 1000.0:.0f} per second before"
        return _fault("rate", _IMU, "", "warning", 0.9, message, "check the rate setting and the link's load", 0)
    if k == STAMPS:
        message = "IMU stamps repeat or run backwards"
        return _fault("stamps", _IMU, "", "error", 1.0, message, "stamp samples where they are measured", 0)
    sensor = SENSORS[k - HELD]
    message = f"{sensor} sends values twice: about {details[0]} of 100 repeat the one before"
    return _fault("held", sensor, "all", "warning", 0.9, message, "set the output rate to the sensor's own", 0)


def _sign(bits: int, points_up: bool) -> Finding:
    sensor = "/".join(SENSORS[s] for s in (1, 2) if bits >> s & 1)
    if points_up:
        message = "accelerometer reads upside down: the hole would point upwards"
    elif bits == ACCEL:
        message = "accelerometer reads gravity instead of specific force: all its signs are reversed"
    elif bits == MAG:
        message = "all signs of the magnetometer are reversed"
    else:
        message = "all signs of the accelerometer or of the magnetometer are reversed"
    remedy = "reverse its signs in the driver: at rest the accelerometer reads up, the magnetometer along the field"
    confidence = 0.95 if bits != ACCEL | MAG else 0.5
    return _fault("flipped", sensor, "all", "error", confidence, message, remedy, bits)


def _length(force: float, gravity: float, noise: bool) -> Finding:
    if noise:
        message = f"accelerometer reads noise of {force:.0f} m/s^2 on each axis: gravity is lost in it"
    else:
        says = "reads no gravity" if force < gravity else "reads more than gravity"
        message = f"accelerometer {says}: the mean force is {force:.1f} m/s^2, expected {gravity:.1f}"
    return _fault("gravity", "accelerometer", "all", "error", 0.9, message, f"{CABLE}; check its range setting", ACCEL)


def _axes(masks: list[int]) -> Finding:
    texts, kinds, named, sensors, bits, count = [], [], [], [], 0, 0
    for s in range(3):
        ways = [mistake(k) for k in range(48) if masks[s] >> k & 1]
        if not ways:
            continue
        bits |= 1 << s
        sensors.append(SENSORS[s])
        count += len(ways)
        texts.append(f"{SENSORS[s]}: " + " or ".join(text for _, _, text in ways))
        kinds += [kind for kind, _, _ in ways]
        named += [axis for _, axis, _ in ways]
    return _fault(
        "/".join(dict.fromkeys(kinds)), "/".join(sensors), "/".join(dict.fromkeys(named)), "error",
        0.95 / max(count, 1), "the motion shows wrong axes; " + ", or ".join(texts),
        "correct the axes in the driver or the mounting, then rotate the tool again", bits,
    )  # fmt: skip


def _frame(masks: list[int]) -> Finding:
    found = [(s, *mistake(k)) for s in (1, 2) for k in range(48) if masks[s] >> k & 1]
    message = "accelerometer and magnetometer do not belong together: the dip is wrong at the right field strength"
    remedy = "check axes and frame of both, and the reference field; look for steel nearby"
    if not 0 < len(found) <= 4:
        return _fault("frame", "accelerometer/magnetometer", "", "warning", 0.6, message, remedy, MAG)
    sensors = dict.fromkeys(SENSORS[s] for s, *_ in found)
    text = ", or ".join(f"{SENSORS[s]}: {words}" for s, _, _, words in found)
    bits = MAG
    for s, *_ in found:
        bits |= 1 << s
    return _fault(
        "/".join(dict.fromkeys(kind for _, kind, _, _ in found)), "/".join(sensors),
        "/".join(dict.fromkeys(axis for _, _, axis, _ in found)), "error", 0.8 / len(found),
        f"{message}; it fits with {text}", remedy, bits,
    )  # fmt: skip


def mistake(k: int) -> tuple[str, str, str]:
    """Kind, axes and words of a mapping of `axis_consistency`."""
    m = axes.MAPPINGS[k]
    flipped = [a for n, a in enumerate("xyz") if m[n].sum() < 0]
    moved = [a for n, a in enumerate("xyz") if m[n, n] == 0]
    if not moved:
        if len(flipped) == 3:
            return "flipped", "all", "all axes reversed (or the frame left-handed)"
        if len(flipped) == 1:
            return "flipped", flipped[0], f"{flipped[0]} axis reversed"
        still = next(a for a in "xyz" if a not in flipped)
        return "frame", "".join(flipped), f"turned half round about {still}"
    if len(moved) == 2:
        if not flipped:
            return "swapped", "".join(moved), f"{moved[0]} and {moved[1]} exchanged"
        if round(float(np.linalg.det(m))) == 1 and len(flipped) == 1:
            still = next(a for a in "xyz" if a not in moved)
            return "frame", "".join(moved), f"turned a quarter about {still}"
    rows = ", ".join(
        f"{a} is {'-' if m[n].sum() < 0 else ''}{'xyz'[int(np.argmax(np.abs(m[n])))]}" for n, a in enumerate("xyz")
    )
    return "frame", "xyz", f"axes mixed up ({rows})"
