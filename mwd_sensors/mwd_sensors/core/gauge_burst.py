# SPDX-License-Identifier: Apache-2.0
"""
Encode and decode the bursts PressureBurst, VoltageBurst, SerialBurst and StrokeBurst of mwd_msgs without loops.

The encoding is little-endian CDR as ROS 2 writes it (see `wire`).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import WireError

PRESSURE, VOLTAGE, SERIAL = (f"mwd_msgs/msg/{name}Burst" for name in ("Pressure", "Voltage", "Serial"))
STROKES = "mwd_msgs/msg/StrokeBurst"
# Telemetry link -> topic and type of its samples.
TOPICS = {
    "mud_pulse": ("rig/standpipe", PRESSURE),
    "em": ("rig/earth_voltage", VOLTAGE),
    "coil": ("rig/coil_voltage", VOLTAGE),
    "serial": ("rig/serial", SERIAL),
}
MOST = 100_000  # largest number of samples in one burst, the bound in the message definition
_HEAD = wire.Layout(PRESSURE, (("period", "float64", 1), ("count", "uint32", 1)))
_STROKE_HEAD = wire.Layout(STROKES, (("count", "uint32", 1),))
_PADDING = bytes(4)


def encode(stamp_ns: int, period_s: float, values: NDArray[Any], frame_id: str = wire.RIG_FRAME) -> bytes:
    """
    Encode samples of a gauge, or bytes of a serial line, as one burst.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the first sample, ns since 1970.
    period_s : float
        Time from one sample to the next.
    values : ndarray, shape (n,)
        Samples in Pa or V; with type uint8, bytes of a serial line.

    Raises
    ------
    ValueError
        There are no samples or more than `MOST`, a sample is not finite, or the period is not positive.
    """
    octets = values.dtype == np.uint8
    values = np.ascontiguousarray(values, dtype=np.uint8 if octets else "<f8")
    if not 1 <= len(values) <= MOST:
        raise ValueError(f"values: a burst has 1 to {MOST} samples, got {len(values)}")
    if not np.isfinite(values).all():
        raise ValueError("values: samples must be finite; end the burst before a sample that is not finite")
    if not period_s > 0.0:
        raise ValueError(f"period_s: must be above 0, got {period_s}")
    head = np.zeros(1, dtype=_HEAD.dtype)
    head["stamp_ns"], head["period"], head["count"] = stamp_ns, period_s, len(values)
    start: bytes = _HEAD.encode(head, frame_id)[0].tobytes()
    # Alignment counts from the end of the encapsulation header.
    return start + _PADDING[: 0 if octets else -(len(start) - 4) % 8] + values.tobytes()


def decode(message: bytes, kind: str = PRESSURE) -> tuple[int, float, Array]:
    """
    Return the stamp of the first sample, the sample period and the samples of a burst.

    message is the serialised burst, kind its type: `PRESSURE`, `VOLTAGE` or `SERIAL`. The stamp is in ns since 1970,
    the period in s; the samples, shape (n,), are in Pa or V, or are the values of the bytes (0 to 255) of a serial
    line.

    Raises
    ------
    WireError
        The bytes are not a burst of this kind.
    """
    size = _HEAD.size(wire.frame_id(message))
    if len(message) < size:
        raise WireError(f"{kind}: {len(message)} bytes end inside the head")
    head = _HEAD.decode(message[:size])[0]
    width = 1 if kind == SERIAL else 8
    count, begin = int(head["count"]), size + -(size - 4) % width
    if not 0 <= count <= MOST or not 0 <= len(message) - begin - width * count < 8:
        raise WireError(f"{kind}: {count} samples do not fit into {len(message)} bytes")
    values = np.frombuffer(message, "u1" if width == 1 else "<f8", count, begin).astype(float)
    return int(head["stamp_ns"]), float(head["period"]), values


def encode_strokes(until_ns: int, strokes: Sequence[tuple[int, int]], frame_id: str = wire.RIG_FRAME) -> bytes:
    """
    Return the bytes of one mwd_msgs/StrokeBurst with pump strokes.

    Parameters
    ----------
    until_ns : int
        Stamp up to which all strokes are in this message or in an earlier one, ns since 1970.
    strokes : sequence of (int, int)
        Number of the pump, 1 to 255, and stamp, ns since 1970, of each stroke, in order of time; may be empty.
    """
    counted = _STROKE_HEAD.empty(1)
    counted["stamp_ns"], counted["count"] = until_ns, len(strokes)
    head: bytes = _STROKE_HEAD.encode(counted, frame_id)[0].tobytes() + bytes(pump for pump, _ in strokes)
    stamps = [part for _, at in strokes for part in divmod(at, wire.NANOSECONDS)]
    # Alignment counts from the end of the encapsulation header.
    return head + _PADDING[: -(len(head) - 4) % 4] + struct.pack(f"<I{len(stamps)}I", len(strokes), *stamps)
