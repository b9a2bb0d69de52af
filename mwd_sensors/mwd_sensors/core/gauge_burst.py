# SPDX-License-Identifier: Apache-2.0
"""
Bursts of a gauge or line, mwd_msgs/PressureBurst, VoltageBurst and SerialBurst, as bytes and back, without loops.

Encoding: CDR, little endian, as ROS 2 writes it (see `wire`).
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
# By the name of the link that is carried: topic and type.
TOPICS = {
    "mud_pulse": ("rig/standpipe", PRESSURE),
    "em": ("rig/earth_voltage", VOLTAGE),
    "serial": ("rig/serial", SERIAL),
}
MOST = 100_000  # samples of one burst, as the message bounds them
_HEAD = wire.Layout(PRESSURE, (("period", "float64", 1), ("count", "uint32", 1)))
_STROKE_HEAD = wire.Layout(STROKES, (("count", "uint32", 1),))
_PADDING = bytes(4)


def encode(stamp_ns: int, period_s: float, values: NDArray[Any], frame_id: str = wire.RIG_FRAME) -> bytes:
    """
    One burst.

    Parameters
    ----------
    stamp_ns : int
        Of the first sample.
    period_s : float
        From one sample to the next, s.
    values : ndarray, shape (n,)
        Pa or V; of type uint8: bytes of a line.

    Raises
    ------
    ValueError
        No samples or more than `MOST`, one that is not finite, or a period that is not positive.
    """
    octets = values.dtype == np.uint8
    values = np.ascontiguousarray(values, dtype=np.uint8 if octets else "<f8")
    if not 1 <= len(values) <= MOST:
        raise ValueError(f"values: a burst has 1 to {MOST} samples, got {len(values)}")
    if not np.isfinite(values).all():
        raise ValueError("values: a sample that is not finite ends a burst; it is not part of one")
    if not period_s > 0.0:
        raise ValueError(f"period_s: must be above 0, got {period_s}")
    head = np.zeros(1, dtype=_HEAD.dtype)
    head["stamp_ns"], head["period"], head["count"] = stamp_ns, period_s, len(values)
    start: bytes = _HEAD.encode(head, frame_id)[0].tobytes()
    # Alignment counts from the end of the encapsulation header.
    return start + _PADDING[: 0 if octets else -(len(start) - 4) % 8] + values.tobytes()


def decode(message: bytes, kind: str = PRESSURE) -> tuple[int, float, Array]:
    """
    Stamp of the first sample, ns, period, s, and samples, shape (n,), of a burst; bytes of a line as whole numbers.

    Raises
    ------
    WireError
        Bytes that are not a burst.
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
    Strokes of the pumps as mwd_msgs/StrokeBurst.

    Parameters
    ----------
    until_ns : int
        Stamp up to which all strokes are in this message or an earlier one.
    strokes : sequence of (int, int)
        Pump, from 1, and stamp of each, ns; in order of time.
    """
    counted = _STROKE_HEAD.empty(1)
    counted["stamp_ns"], counted["count"] = until_ns, len(strokes)
    head: bytes = _STROKE_HEAD.encode(counted, frame_id)[0].tobytes() + bytes(pump for pump, _ in strokes)
    stamps = [part for _, at in strokes for part in divmod(at, wire.NANOSECONDS)]
    # Alignment counts from the end of the encapsulation header.
    return head + _PADDING[: -(len(head) - 4) % 4] + struct.pack(f"<I{len(stamps)}I", len(strokes), *stamps)
