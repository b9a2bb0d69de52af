# SPDX-License-Identifier: Apache-2.0
"""Definitions against the hashes that ROS 2 itself generated, and against a parser of the schema text."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import plotted_bag
import pytest
from rosbags.typesys import get_types_from_msg

from mwd_surface.bags.definitions import DefinitionError, Definitions, share_folders
from project import ROOT

MWD_MSGS = sorted((ROOT / "mwd_msgs" / "msg").glob("*.msg"))


@pytest.fixture(scope="module")
def definitions() -> Definitions:
    return Definitions([ROOT])


@pytest.mark.parametrize(
    ("type_name", "type_hash"),
    [
        # As `ros2 topic info -v` of Jazzy prints them.
        ("sensor_msgs/msg/Imu", "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"),
        ("sensor_msgs/msg/MagneticField", "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff"),
        (
            "geometry_msgs/msg/QuaternionStamped",
            "RIHS01_381add86c6c3160644d228ca342182c7fd6c7fab11c7a85ad817a9cc22dbac6e",
        ),
    ],
)
def test_the_hash_of_a_common_type_is_the_one_ros_computes(definitions, type_name, type_hash):
    assert definitions.definition(type_name).type_hash == type_hash


@pytest.mark.parametrize("package", ["std_msgs", "sensor_msgs", "geometry_msgs", "nav_msgs", "diagnostic_msgs"])
def test_every_hash_agrees_with_the_installed_packages(package):
    definitions = Definitions([Path(sys.prefix, "share")])
    files = sorted(Path(sys.prefix, "share", package, "msg").glob("*.json"))
    if not files:
        pytest.skip(f"{package} is not installed in this Python's share folder")
    for file in files:
        table = json.loads(file.read_text())
        name = table["type_description_msg"]["type_description"]["type_name"]
        hashes = {item["type_name"]: item["hash_string"] for item in table["type_hashes"]}
        # rosbags keeps std_msgs/Char as uint8, which ROS hashes as another type.
        if name != "std_msgs/msg/Char":
            assert definitions.definition(name).type_hash == hashes[name]


@pytest.mark.parametrize("path", MWD_MSGS, ids=lambda path: path.stem)
def test_the_schema_of_our_message_holds_every_type_it_uses_and_its_comments(definitions, path):
    found = definitions.definition(f"mwd_msgs/msg/{path.stem}")
    assert path.read_text().strip() in found.text
    types = get_types_from_msg(found.text, found.type_name)
    store = Definitions([])
    store.typestore.register({k: v for k, v in types.items() if k not in store.typestore.fielddefs})
    assert store.typestore.hash_rihs01(found.type_name) == found.type_hash


@pytest.mark.parametrize("path", MWD_MSGS, ids=lambda path: path.stem)
def test_the_size_of_a_message_is_that_of_its_serialisation(definitions, path):
    type_name = f"mwd_msgs/msg/{path.stem}"
    definitions.load(type_name)
    message = plotted_bag.blank(definitions.typestore, type_name)
    data = definitions.typestore.serialize_cdr(plotted_bag.arrays(message), type_name)
    assert len(data) - definitions.size(type_name, message) in (0, 1, 2, 3)


def test_a_schema_text_read_from_a_bag_makes_its_types_known(definitions):
    given = definitions.definition("mwd_msgs/msg/SurveyList")
    other = Definitions([])
    other.learn(given.type_name, given.text)
    assert other.typestore.hash_rihs01(given.type_name) == given.type_hash
    other.learn(given.type_name, given.text)


@pytest.mark.parametrize(("text", "named"), [("float64[ broken", "a_msgs/msg/A"), ("b_msgs/B field", "b_msgs/msg/B")])
def test_a_schema_text_that_is_broken_or_lacks_a_type_is_refused_by_name(text, named):
    with pytest.raises(DefinitionError, match=named):
        Definitions([]).learn("a_msgs/msg/A", text)


@pytest.mark.parametrize(
    ("type_name", "words"),
    [
        ("mwd_msgs/msg/Survey", r"make run.*looked in"),
        ("rig_msgs/msg/Pump", "has no such message"),
        ("pump_msgs/msg/Pump", "install the ROS package pump_msgs"),
    ],
)
def test_a_missing_message_is_distinguished_from_a_missing_package_with_its_remedy(tmp_path, type_name, words):
    (tmp_path / "rig_msgs" / "msg").mkdir(parents=True)
    with pytest.raises(DefinitionError, match=words):
        Definitions([tmp_path]).definition(type_name)


def test_a_foreign_package_found_on_this_machine_needs_no_further_setting(tmp_path):
    folder = tmp_path / "rig_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Pump.msg").write_text("std_msgs/Header header\nStroke[] strokes\nfloat64 pressure\n")
    (folder / "Stroke.msg").write_text("uint32 count\n")
    found = Definitions([tmp_path]).definition("rig_msgs/msg/Pump")
    assert "MSG: rig_msgs/Stroke" in found.text
    assert found.type_hash.startswith("RIHS01_")


@pytest.mark.parametrize("name", ["Imu", "sensor_msgs/Imu", "../msg/Imu", "sensor_msgs/srv/Imu", "a b/msg/C"])
def test_a_name_that_is_not_a_message_type_is_refused(tmp_path, name):
    with pytest.raises(DefinitionError, match="is not a message type"):
        Definitions([tmp_path]).definition(name)


def test_the_source_tree_is_searched_even_when_nothing_is_installed(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    assert ROOT in share_folders()


def test_a_sourced_workspace_comes_before_the_rest(monkeypatch, tmp_path):
    (tmp_path / "share").mkdir()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert share_folders()[0] == tmp_path / "share"
