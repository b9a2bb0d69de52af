"""
Bursts of a gauge, mwd_msgs/PressureBurst and VoltageBurst, as bytes and back: a kilohertz of doubles without loops.

Encoding: CDR, little endian, as ROS 2 writes it (see `wire`).
"""

from __future__ import annotations

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import WireError

PRESSURE, VOLTAGE = "mwd_msgs/msg/PressureBurst", "mwd_msgs/msg/VoltageBurst"
MOST = 100_000  # samples of one burst, as the message bounds them
_HEAD = wire.Layout(PRESSURE, (("period", "float64", 1), ("count", "uint32", 1)))
_PADDING = bytes(4)


def encode(stamp_ns: int, period_s: float, values: Array, frame_id: str = wire.RIG_FRAME) -> bytes:
    """
    One burst.

    Parameters
    ----------
    stamp_ns : int
        Of the first sample.
    period_s : float
        From one sample to the next, s.
    values : ndarray, shape (n,)
        Pa or V.

    Raises
    ------
    ValueError
        No samples or more than `MOST`, one that is not finite, or a period that is not positive.
    """
    values = np.ascontiguousarray(values, dtype="<f8")
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
    return start + _PADDING[: -(len(start) - 4) % 8] + values.tobytes()


def decode(message: bytes) -> tuple[int, float, Array]:
    """
    Stamp of the first sample, ns, period, s, and samples, shape (n,), of a burst.

    Raises
    ------
    WireError
        Bytes that are not a burst.
    """
    size = _HEAD.size(wire.frame_id(message))
    if len(message) < size:
        raise WireError(f"{PRESSURE}: {len(message)} bytes end inside the head")
    head = _HEAD.decode(message[:size])[0]
    count, begin = int(head["count"]), size + -(size - 4) % 8
    if not 0 <= count <= MOST or not 0 <= len(message) - begin - 8 * count < 8:
        raise WireError(f"{PRESSURE}: {count} samples do not fit into {len(message)} bytes")
    return int(head["stamp_ns"]), float(head["period"]), np.frombuffer(message, "<f8", count, begin).astype(float)
