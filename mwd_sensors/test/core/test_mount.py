# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import frames, wire
from mwd_sensors.core.mount import (
    PRESETS,
    MountSettings,
    Transforms,
    axis_down,
    by_turning,
    resolve,
    rotation,
    turned,
    words,
)
from mwd_sensors.core.settings import SettingsError, from_mapping

TURN = frames.mat_from_quat(frames.quat_from_rotvec([0.3, -1.1, 2.0]))


def quaternion(mat):
    return tuple(float(v) for v in frames.quat_from_mat(mat))


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_a_rotation_that_takes_the_named_axis_down_hole(name):
    mat = rotation(name)
    assert np.array_equal(mat @ mat.T, np.eye(3))
    assert np.linalg.det(mat) == pytest.approx(1.0)
    axis = np.eye(3)["xyz".index(name[0])]
    assert np.array_equal(mat @ axis, [1.0 if name.endswith("down") else -1.0, 0.0, 0.0])
    assert words(mat) == name


def test_a_matrix_and_a_quaternion_say_the_same_as_each_other():
    nine = ", ".join(repr(float(v)) for v in TURN.ravel())
    four = " ".join(repr(v) for v in quaternion(TURN))
    assert rotation(nine) == pytest.approx(TURN, abs=1e-12)
    assert rotation(four) == pytest.approx(TURN, abs=1e-12)


def test_a_quarter_turn_given_in_numbers_exchanges_axes_to_the_bit():
    assert np.array_equal(rotation("[0 0 1; 1 0 0; 0 1 0]"), PRESETS["z-down"])
    assert np.array_equal(resolve(MountSettings(imu="0.5,0.5,0.5,0.5")).imu, rotation("0,0,1,1,0,0,0,1,0"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("z-dwon", "write one of"),
        ("1,0,0", "write one of"),
        ("1,0,0,1", "length 1"),
        ("1,0,0,0,1,0,0,0,-1", "right-handed"),
        ("1,0,0,0,2,0,0,0,1", "rows must have length 1"),
        ("nan,0,0,1", "length 1"),
    ],
)
def test_what_is_no_mount_is_refused_with_what_is(text, words):
    with pytest.raises(SettingsError, match=f"(?s)tool.mount.*imu: .*{words}"):
        from_mapping(MountSettings, {"imu": text}, "tool.mount")


@pytest.mark.fault_case(11)
def test_the_frames_and_static_transforms_turn_a_magnetometer_into_the_axes_of_the_imu():
    transforms = Transforms()
    transforms.add("sonde_link", "imu_link", quaternion(PRESETS["z-down"]))
    transforms.add("board", "/mag_link", quaternion(TURN))
    transforms.add("imu_link", "board", (0.0, 0.0, 0.0, 1.0))
    names = {"imu": "imu_link", "mag": "mag_link"}
    given = resolve(MountSettings(imu="tf"), names, transforms)
    assert given.unusable == {}
    assert np.array_equal(given.imu, PRESETS["z-down"])
    assert given.mag == pytest.approx(PRESETS["z-down"] @ TURN, abs=1e-9)
    well = Transforms()
    well.add("well_1/sonde_link", "imu_link", quaternion(PRESETS["z-down"]))
    assert np.array_equal(resolve(MountSettings(imu="tf"), names, well).imu, PRESETS["z-down"])
    assert transforms.between("mag_link", "imu_link") == pytest.approx(TURN, abs=1e-9)
    assert transforms.between("imu_link", "mag_link") == pytest.approx(TURN.T, abs=1e-9)
    assert transforms.between("imu_link", "elsewhere") is None


@pytest.mark.fault_case(11)
@pytest.mark.parametrize("number", [0.0, math.nan, math.inf, 1e308])
def test_the_last_transform_that_is_a_rotation_counts(number):
    names, transforms = {"imu": "imu_link", "mag": "mag_link"}, Transforms()
    for quat in ((0.0, 0.0, 0.0, number), quaternion(TURN), (0.0, 0.0, 0.0, number), (0.0, 0.0, 0.0, number)):
        transforms.add("imu_link", "mag_link", quat)
    expected = np.eye(3) if number == 1e308 else TURN
    assert resolve(MountSettings(), names, transforms).mag == pytest.approx(expected, abs=1e-9)
    # The sensor is now on a part that nothing joins to the IMU.
    transforms.add("elsewhere", "mag_link", (0.0, 0.0, 0.0, 1.0))
    sentence = resolve(MountSettings(), names, transforms).unusable["mag"]
    assert "'mag_link'" in sentence
    assert "'imu_link'" in sentence


def test_a_ring_of_transforms_ends():
    transforms = Transforms()
    transforms.add("a", "b", (0.0, 0.0, 0.0, 1.0))
    transforms.add("b", "a", (0.0, 0.0, 0.0, 1.0))
    assert np.array_equal(transforms.between("a", "b"), np.eye(3))


def test_a_unit_whose_rotation_is_not_known_is_named_with_what_to_do():
    apart = resolve(MountSettings(), {"imu": "imu_link", "mag": "mag_link", "precision": "fog_link"})
    assert list(apart.unusable) == ["mag"]
    assert "'mag_link'" in apart.unusable["mag"]
    assert "tool.mount.mag" in apart.unusable["mag"]
    # The rates of a precision unit are compared with those of the other: it is used, and said to be so.
    assert list(apart.assumed) == ["precision"]
    assert "'fog_link'" in apart.assumed["precision"]
    assert "tool.mount.precision" in apart.assumed["precision"]
    assert resolve(MountSettings(precision="x-down"), {"imu": "imu_link", "precision": "fog_link"}).assumed == {}
    assert resolve(MountSettings(), {"imu": "imu_link", "precision": "imu_link"}).assumed == {}
    assert resolve(MountSettings(mag="x-down"), {"imu": "imu_link", "mag": "mag_link"}).unusable == {}
    unknown = resolve(MountSettings(imu="tf"), {"imu": "imu_link"})
    assert "'imu_link' to 'sonde_link'" in unknown.unusable["imu"]


def test_samples_are_turned_with_their_covariances_and_kept_to_the_bit_by_x_down():
    samples = wire.IMU.empty(2)
    samples["angular_velocity"] = [[1.0, 2.0, 3.0], [4.0, math.nan, 6.0]]
    samples["angular_velocity_covariance"][:] = np.diag([1.0, 4.0, 9.0]).ravel()
    samples["linear_acceleration_covariance"][:, 0] = -1.0
    assert resolve(MountSettings()).imu_in_tool(samples) is samples
    out = resolve(MountSettings(imu="z-down")).imu_in_tool(samples)
    assert np.array_equal(out["angular_velocity"], [[3.0, 1.0, 2.0], [6.0, 4.0, math.nan]], equal_nan=True)
    assert np.array_equal(out["angular_velocity_covariance"][0], np.diag([9.0, 1.0, 4.0]).ravel())
    assert np.array_equal(out["linear_acceleration_covariance"], samples["linear_acceleration_covariance"])
    assert np.array_equal(samples["angular_velocity"][0], [1.0, 2.0, 3.0])


def test_any_rotation_turns_vectors_as_its_matrix_does():
    vectors = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 9.0]])
    assert turned(TURN, vectors) == pytest.approx(vectors @ TURN.T)


@pytest.mark.parametrize("name", PRESETS)
def test_a_string_that_turns_right_shows_the_axis_that_points_down(name):
    turn = PRESETS[name].T @ np.array([20.0, 0.5, -0.4])
    assert axis_down(turn, 21.0) == name
    assert axis_down(turn, 60.0) == ""
    assert axis_down(np.array([1.0, 1.0, 0.0]), 1.5) == ""


@pytest.mark.parametrize("name", PRESETS)
def test_a_turning_axis_near_one_of_the_unit_s_is_its_preset(name):
    along = PRESETS[name][0] + np.array([0.05, -0.05, 0.05])
    assert words(by_turning(7.0 * along)) == name


@given(st.tuples(*(st.floats(-1.0, 1.0),) * 3).filter(lambda axis: math.hypot(*axis) > 0.1))
def test_a_mount_by_turning_puts_the_axis_down_hole_by_the_least_turn_from_a_preset(axis):
    unit = np.array(axis) / np.linalg.norm(axis)
    mat = by_turning(np.array(axis))
    assert mat @ mat.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(mat) == pytest.approx(1.0)
    off = math.acos(min(max(float((mat @ unit)[0]), -1.0), 1.0))
    assert off < math.radians(8.01) if any(np.array_equal(mat, one) for one in PRESETS.values()) else off < 1e-6
    turn = min(math.acos(min((np.trace(mat @ one.T) - 1.0) / 2.0, 1.0)) for one in PRESETS.values())
    assert turn < math.radians(54.75)
    assert rotation(words(mat)) == pytest.approx(mat, abs=2e-3)
