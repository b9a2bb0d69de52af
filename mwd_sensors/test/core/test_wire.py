# SPDX-License-Identifier: Apache-2.0
"""Wire layouts against the messages' own definitions and an independent serialiser."""

import re

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mwd_sensors.core import wire
from project import MESSAGES


def _typestore():
    store = get_typestore(Stores.ROS2_JAZZY)
    for layout in wire.LAYOUTS.values():
        name = layout.type_name.rpartition("/")[2]
        if not (MESSAGES / f"{name}.msg").exists():
            continue
        store.register(get_types_from_msg((MESSAGES / f"{name}.msg").read_text(), f"mwd_msgs/msg/{name}"))
    return store


def _random_samples(layout, count, seed):
    rng = np.random.default_rng(seed)
    samples = layout.empty(count)
    for name in samples.dtype.names:
        field = samples[name]
        if field.dtype == np.float64:
            field[...] = rng.normal(size=field.shape)
        elif field.dtype == bool:
            field[...] = rng.integers(0, 2, field.shape)
        else:
            field[...] = rng.integers(0, 200, field.shape)
    samples["stamp_ns"] = rng.integers(0, 2**31 * 10**9, count)
    return samples


@pytest.mark.parametrize("layout", wire.LAYOUTS.values(), ids=lambda x: x.type_name)
@pytest.mark.parametrize("frame", ["", "a", "sonde_link", "föür"])
def test_samples_survive_the_wire(layout, frame):
    samples = _random_samples(layout, 7, 1)
    rows = layout.encode(samples, frame)
    assert rows.shape == (7, layout.size(frame))
    np.testing.assert_array_equal(layout.decode(rows), samples)
    np.testing.assert_array_equal(layout.decode(rows[3].tobytes()), samples[3:4])
    assert wire.frame_id(rows[0].tobytes()) == frame


@pytest.mark.parametrize("layout", wire.LAYOUTS.values(), ids=lambda x: x.type_name)
def test_an_independent_serialiser_reads_and_writes_the_same_bytes(layout):
    store = _typestore()
    sample = _random_samples(layout, 1, 2)
    raw = layout.encode(sample, "sonde_link")[0].tobytes()
    message = store.deserialize_cdr(raw, layout.type_name)
    assert message.header.frame_id == "sonde_link"
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == sample["stamp_ns"][0]
    for name, _, _ in layout.fields:
        value = getattr(message, name)
        if hasattr(value, "x"):
            value = [getattr(value, axis) for axis in "xyzw" if hasattr(value, axis)]
        np.testing.assert_array_equal(np.asarray(value), sample[name][0])
    # Padding bytes are free, so the check is by reading back, not by comparing bytes.
    np.testing.assert_array_equal(layout.decode(bytes(store.serialize_cdr(message, layout.type_name))), sample)


@pytest.mark.parametrize(
    "name", ["Gravity", "Attitude", "Interference", "Dynamics", "RigState", "Truth", "DetectorCounts", "ToolStatus"]
)
def test_layout_lists_the_fields_of_the_message_in_order(name):
    fields = []
    for line in (MESSAGES / f"{name}.msg").read_text().splitlines():
        match = re.match(r"(float64|uint32|uint8|bool)(?:\[(\d+)\])?\s+(\w+)\s*(#|$)", line)
        if match:
            fields.append((match[3], match[1], int(match[2] or 1)))
    assert wire.LAYOUTS[f"mwd_msgs/msg/{name}"].fields == tuple(fields)


def test_the_bits_of_rig_data_are_those_of_the_message():
    bits = re.findall(r"^uint32 (\w+)=(\d+)$", (MESSAGES / "RigState.msg").read_text(), re.MULTILINE)
    assert {name.lower(): int(bit) for name, bit in bits} == {
        {"in_slips": "slips"}.get(name, name): bit for name, bit in wire.RIG_VALID.items()
    }


def test_damaged_bytes_are_refused_with_a_reason():
    raw = bytearray(wire.IMU.encode(wire.IMU.empty(1), "x")[0].tobytes())
    with pytest.raises(wire.WireError, match="too few"):
        wire.IMU.decode(bytes(raw[:10]))
    with pytest.raises(wire.WireError, match="expected"):
        wire.IMU.decode(bytes(raw[:-8]))
    raw[12:16] = (2**31).to_bytes(4, "little")
    with pytest.raises(wire.WireError, match="do not fit"):
        wire.IMU.decode(bytes(raw))
    raw[1] = 0
    with pytest.raises(wire.WireError, match="little-endian"):
        wire.IMU.decode(bytes(raw))
    with pytest.raises(wire.WireError, match="inside its header"):
        wire.frame_id(bytes(raw[:14]))
    with pytest.raises(ValueError, match="expected the dtype"):
        wire.IMU.encode(wire.MAG.empty(1), "x")


@pytest.mark.parametrize("layout", wire.LAYOUTS.values(), ids=lambda x: x.type_name)
def test_some_fields_of_messages_that_lie_apart_are_those_of_the_whole(layout):
    samples = _random_samples(layout, 9, 4)
    apart = np.zeros((9, layout.size("sonde_link") + 31), dtype=np.uint8)
    rows = apart[:, 31:]
    rows[...] = layout.encode(samples, "sonde_link")
    np.testing.assert_array_equal(layout.decode(rows), samples)
    chosen = tuple(name for name, _, _ in layout.fields)[1:3]
    some = layout.decode(rows, chosen)
    assert some.dtype.names == ("stamp_ns", *chosen)
    for name in some.dtype.names:
        np.testing.assert_array_equal(some[name], samples[name])
    assert layout.decode(rows[:0], chosen).dtype == some.dtype


def test_a_field_that_no_message_has_is_named_with_those_it_has():
    with pytest.raises(ValueError, match=r"no 'angle'; it has magnetic_field"):
        wire.MAG.dtype_of(("angle",))


def test_the_bits_of_the_self_tests_are_those_of_the_message():
    bits = re.findall(r"^uint32 (\w+)=(\d+)", (MESSAGES / "ToolStatus.msg").read_text(), re.MULTILINE)
    assert {int(bit): name.lower() for name, bit in bits} == wire.SELF_TESTS
