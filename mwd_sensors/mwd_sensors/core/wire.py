# SPDX-License-Identifier: Apache-2.0
"""
Convert messages of fixed layout between bytes and numpy arrays of samples.

A message whose only variable part is the frame name of its header has a fixed layout once that name is known. Such
messages are packed and unpacked here without any middleware, one or a million at a time. Live nodes, simulator,
recorder and replay all use this code, so that the same bytes give the same numbers everywhere.

The encoding is little-endian CDR as ROS 2 writes it (OMG DDS-RTPS 2.5, section 10; XCDR1 alignment).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Samples

Rows = NDArray[np.uint8]

NANOSECONDS = 1_000_000_000
LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"
_HEAD = int.from_bytes(LITTLE_ENDIAN_CDR, "little")
#: Offset of the frame name in a message: encapsulation 4, stamp 8, length of the frame name 4.
FRAME_AT = 16
_KINDS = {"float64": "<f8", "uint32": "<u4", "uint8": "u1", "bool": "?"}


class WireError(ValueError):
    """The bytes are not a message of the expected layout."""


@dataclasses.dataclass(frozen=True)
class Layout:
    """Layout of one message type: a std_msgs/Header followed by fields of fixed size."""

    type_name: str  #: name of the type in ROS, for example ``sensor_msgs/msg/Imu``
    #: Fields (name, kind, count) in wire order; kind is a ROS primitive, count the length of a fixed array or 1.
    fields: tuple[tuple[str, str, int], ...]

    @functools.cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Dtype of samples: ``stamp_ns`` (int64, ns since 1970) and the fields of the message."""
        return self.dtype_of(None)

    def dtype_of(self, fields: tuple[str, ...] | None) -> np.dtype[np.void]:
        """
        Return the dtype of samples with ``stamp_ns`` and some of the fields, in wire order; None selects all fields.

        Raises
        ------
        ValueError
            The message does not have one of the fields.
        """
        known = [name for name, _, _ in self.fields]
        for name in fields or ():
            if name not in known:
                raise ValueError(f"fields: {self.type_name} has no {name!r}; it has {', '.join(known)}")
        return np.dtype(
            [("stamp_ns", "<i8", ())]
            + [
                (name, _KINDS[kind], (count,) if count > 1 else ())
                for name, kind, count in self.fields
                if fields is None or name in fields
            ]
        )

    def row_dtype(self, frame_bytes: int) -> np.dtype[np.void]:
        """Return the dtype of one message on the wire; frame_bytes counts the frame name without its final NUL."""
        return _row_dtype(self, frame_bytes)

    def size(self, frame_id: str) -> int:
        """Return the size in bytes of one message with this frame name."""
        return self.row_dtype(len(frame_id.encode())).itemsize

    def empty(self, count: int) -> Samples:
        """Return samples of this layout, filled with zeros."""
        return np.zeros(count, dtype=self.dtype)

    def encode(self, samples: Samples, frame_id: str) -> Rows:
        """
        Serialise samples.

        Returns shape (n, size), uint8: each row is one message, and ``rows[k].tobytes()`` can be published unchanged.

        Raises
        ------
        ValueError
            The samples do not have this layout's dtype.
        """
        if samples.dtype != self.dtype:
            raise ValueError(f"samples: expected the dtype of {self.type_name}, got {samples.dtype}")
        samples = np.atleast_1d(samples)
        name = frame_id.encode()
        dtype = self.row_dtype(len(name))
        rows = np.zeros(len(samples), dtype=dtype)
        rows["head"] = _HEAD
        rows["sec"], rows["nanosec"] = np.divmod(samples["stamp_ns"], NANOSECONDS)
        rows["length"] = len(name) + 1
        rows["frame"] = np.void(name + b"\0")
        for field, _, _ in self.fields:
            rows[field] = samples[field]
        return rows.view(np.uint8).reshape(len(samples), dtype.itemsize)

    def decode(self, rows: Rows | bytes, fields: tuple[str, ...] | None = None) -> Samples:
        """
        Return the samples, shape (n,), of messages whose frame names have equal length.

        Parameters
        ----------
        rows : ndarray of uint8, shape (n, size), or bytes
            Messages, or the bytes of a single message.
        fields : tuple of str, optional
            Fields to read in addition to the stamp, as in `dtype_of`. Leaving out the covariances saves most of the
            copying.

        Raises
        ------
        WireError
            The bytes are not little-endian CDR, their length does not fit this layout, or the frame names differ in
            length.
        ValueError
            The message does not have one of `fields`.
        """
        if isinstance(rows, (bytes, bytearray, memoryview)):
            rows = np.frombuffer(rows, dtype=np.uint8)[None, :]
        if rows.ndim != 2 or rows.shape[1] < FRAME_AT + 1:
            raise WireError(f"{self.type_name}: {rows.shape[-1]} bytes are too few for a message")
        samples = np.empty(len(rows), dtype=self.dtype if fields is None else self.dtype_of(fields))
        if len(rows) == 0:
            return samples
        if rows.strides[1] != 1:
            rows = np.ascontiguousarray(rows)
        head = rows[:, :FRAME_AT].view(_HEADER)[:, 0]
        if (head["head"] != _HEAD).any():
            raise WireError(f"{self.type_name}: not little-endian CDR")
        lengths = head["length"]
        frame_bytes = int(lengths[0]) - 1
        if (lengths != lengths[0]).any() or not 0 <= frame_bytes <= rows.shape[1] - FRAME_AT - 1:
            raise WireError(f"{self.type_name}: the frame names do not fit one layout")
        dtype = self.row_dtype(frame_bytes)
        # Some writers pad a message to a multiple of four; nothing else may follow.
        if not 0 <= rows.shape[1] - dtype.itemsize < 4:
            raise WireError(f"{self.type_name}: expected {dtype.itemsize} bytes, got {rows.shape[1]}")
        samples["stamp_ns"] = head["sec"].astype(np.int64) * NANOSECONDS + head["nanosec"]
        first = dtype.fields[self.fields[0][0]][1]  # type: ignore[index]
        if fields is None and dtype.itemsize - first == samples.dtype.itemsize - 8:
            # No gaps on the wire: the fields of a message are one contiguous block of bytes.
            samples.view(np.uint8).reshape(len(samples), -1)[:, 8:] = rows[:, first : dtype.itemsize]
            return samples
        records = rows[:, : dtype.itemsize].view(dtype)[:, 0]
        for field in samples.dtype.names[1:]:  # type: ignore[index]
            samples[field] = records[field]
        return samples


_HEADER = np.dtype([("head", "<u4"), ("sec", "<i4"), ("nanosec", "<u4"), ("length", "<u4")])


@functools.lru_cache(maxsize=256)
def _row_dtype(layout: Layout, frame_bytes: int) -> np.dtype[np.void]:
    names, formats, offsets = (
        ["head", "sec", "nanosec", "length", "frame"],
        ["<u4", "<i4", "<u4", "<u4", f"V{frame_bytes + 1}"],
        [0, 4, 8, 12, FRAME_AT],
    )
    end = FRAME_AT + frame_bytes + 1
    for name, kind, count in layout.fields:
        size = np.dtype(_KINDS[kind]).itemsize
        # Alignment counts from the end of the encapsulation header.
        end += -(end - 4) % size
        names.append(name)
        formats.append(f"({count},){_KINDS[kind]}" if count > 1 else _KINDS[kind])
        offsets.append(end)
        end += size * count
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})


def frame_id(message: bytes) -> str:
    """
    Return the frame name in the header of a serialised message.

    Raises
    ------
    WireError
        The bytes end inside the header.
    """
    length = int.from_bytes(message[12:16], "little")
    name = bytes(message[FRAME_AT : FRAME_AT + length])
    if len(message) < FRAME_AT or length == 0 or len(name) != length:
        raise WireError("the message ends inside its header")
    return name[:-1].decode(errors="replace")


def _doubles(*names: str, count: int = 1) -> tuple[tuple[str, str, int], ...]:
    return tuple((name, "float64", count) for name in names)


IMU = Layout(
    "sensor_msgs/msg/Imu",
    (
        ("orientation", "float64", 4),
        ("orientation_covariance", "float64", 9),
        ("angular_velocity", "float64", 3),
        ("angular_velocity_covariance", "float64", 9),
        ("linear_acceleration", "float64", 3),
        ("linear_acceleration_covariance", "float64", 9),
    ),
)
MAG = Layout(
    "sensor_msgs/msg/MagneticField",
    (("magnetic_field", "float64", 3), ("magnetic_field_covariance", "float64", 9)),
)
TEMPERATURE = Layout("sensor_msgs/msg/Temperature", (("temperature", "float64", 1), ("variance", "float64", 1)))
GRAVITY = Layout(
    "mwd_msgs/msg/Gravity",
    (
        ("gravity", "float64", 3),
        *_doubles("sigma", "non_gravity", "rotary_speed"),
        ("status", "uint32", 1),
    ),
)
ATTITUDE = Layout(
    "mwd_msgs/msg/Attitude",
    (
        *_doubles("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"),
        *_doubles("sigma_inclination", "sigma_azimuth", "sigma_gravity_toolface", "sigma_magnetic_toolface"),
        ("status", "uint32", 1),
        ("north", "uint8", 1),
    ),
)
INTERFERENCE = Layout(
    "mwd_msgs/msg/Interference",
    (
        ("axial", "float64", 1),
        ("cross_axial", "float64", 2),
        ("sigma_axial", "float64", 1),
        ("sigma_cross_axial", "float64", 2),
        ("total_residual", "float64", 1),
        ("dip_residual", "float64", 1),
        ("status", "uint32", 1),
    ),
)
DYNAMICS = Layout(
    "mwd_msgs/msg/Dynamics",
    (
        ("duration", "float64", 1),
        ("samples", "uint32", 1),
        *_doubles("rotary_speed", "rotary_speed_least", "rotary_speed_most", "stick_slip_index", "stick_share"),
        *_doubles("axial_rms", "lateral_rms", "axial_peak", "lateral_peak"),
        ("shocks", "uint32", 1),
        ("shock_peak", "float64", 1),
        ("shocks_total", "uint32", 1),
        ("status", "uint32", 1),
    ),
)
RIG_STATE = Layout(
    "mwd_msgs/msg/RigState",
    (
        *_doubles("bit_depth", "hole_depth", "block_position", "hookload", "weight_on_bit"),
        *_doubles("torque", "rotary_speed", "flow_rate", "pressure", "rate_of_penetration"),
        ("valid", "uint32", 1),
        ("in_slips", "bool", 1),
    ),
)
# Field of RIG_STATE -> bit of `valid` that is set if the field has a value.
RIG_VALID = {name: 1 << k for k, name in enumerate(name for name, *_ in RIG_STATE.fields if name != "valid")}
TRUTH = Layout(
    "mwd_msgs/msg/Truth",
    (
        ("orientation", "float64", 4),
        *_doubles("angular_velocity", "specific_force", "gravity", "position", "velocity", "magnetic_field", count=3),
        *_doubles("interference", "gyro_bias", "accel_bias", "precision_gyro_bias", "precision_accel_bias", count=3),
        *_doubles("inclination", "azimuth", "gravity_toolface", "measured_depth", "temperature"),
        ("activity", "uint32", 1),
    ),
)

COUNTS = Layout(
    "mwd_msgs/msg/DetectorCounts",
    (
        ("duration", "float64", 1),
        ("counts", "uint32", 1),
        *_doubles("dead_time", "tool_factor", "toolface_offset", "sensor_to_bit"),
    ),
)
TOOL_FLOW = Layout("mwd_msgs/msg/ToolFlow", (("flow", "float64", 1), ("sigma", "float64", 1)))
TOOL_STATUS = Layout(
    "mwd_msgs/msg/ToolStatus",
    (
        *_doubles("battery_voltage", "battery_current", "consumed_charge", "run_time"),
        ("self_tests", "uint32", 1),
        ("failed_self_tests", "uint32", 1),
    ),
)
#: Bit in `self_tests` and `failed_self_tests` of TOOL_STATUS -> name of the self-test.
SELF_TESTS = {1: "sensors", 2: "magnetometer", 4: "detector", 8: "memory", 16: "clock", 32: "battery"}

#: Vector without a stated quantity or unit; no topic of this project uses it.
VECTOR = Layout("geometry_msgs/msg/Vector3Stamped", (("vector", "float64", 3),))
LAYOUTS = {
    layout.type_name: layout
    for layout in (
        *(IMU, MAG, TEMPERATURE, GRAVITY, ATTITUDE, INTERFERENCE, DYNAMICS, RIG_STATE, TRUTH, COUNTS, TOOL_FLOW),
        TOOL_STATUS,
    )
}
# Topics of the sonde and the rig, relative to the well's namespace, with their layouts.
SONDE_TOPICS = {
    "imu/data_raw": IMU,
    "imu/mag": MAG,
    "gyro/data_raw": IMU,
    "imu/temperature": TEMPERATURE,
    "truth": TRUTH,
    "rig/state": RIG_STATE,
}
#: Topic of the gamma detector's counts, if the sonde has a detector.
GAMMA_TOPIC = "gamma/counts"
#: Topic of the tool's status, if the sonde has a battery.
STATUS_TOPIC = "tool/status"
#: Key and value in the diagnostics of a simulation or replay that has ended and sends no more samples.
OVER = ("over", "true")
# Frame names; a node puts its prefix in front of them in headers and transforms (`GraphNode.frame`).
SONDE_FRAME = "sonde_link"  # x down the hole, z along the scribe line
BIT_FRAME = "bit"  # axes of the sonde, at the bit
RIG_FRAME = "rig_floor"  # axes of local_enu; origin of the measured depth
WELLHEAD_FRAME = "wellhead"  # north, east, down from the start of the well path
LOCAL_FRAME = "local_enu"  # east, north, up


def decode_messages(layout: Layout, messages: Sequence[bytes]) -> tuple[Samples, list[WireError]]:
    """Decode serialised messages of one layout; return their samples in order and one error per unreadable message."""
    if not messages:
        return layout.empty(0), []
    size = len(messages[0])
    try:
        if all(len(message) == size for message in messages):
            rows = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(len(messages), size)
            return layout.decode(rows), []
    except WireError:
        pass
    parts, errors = [layout.empty(0)], []
    for message in messages:
        try:
            parts.append(layout.decode(message))
        except WireError as error:
            errors.append(error)
    return np.concatenate(parts), errors
