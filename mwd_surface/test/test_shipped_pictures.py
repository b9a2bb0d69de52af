# SPDX-License-Identifier: Apache-2.0
"""The Foxglove layout and the rviz configuration that are shipped name only topics, fields and frames that exist."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_sensors.core import wire
from mwd_surface.ros.topics import TOPICS

PACKAGE = Path(__file__).resolve().parents[1]
LAYOUT = json.loads((PACKAGE / "config" / "foxglove.json").read_text())
RVIZ = yaml.safe_load((PACKAGE / "config" / "mwd.rviz").read_text())
WELL = "/well_1/"


def strings(value):
    if isinstance(value, dict):
        for key, part in value.items():
            yield key
            yield from strings(part)
    elif isinstance(value, list):
        for part in value:
            yield from strings(part)
    elif isinstance(value, str):
        yield value


def kind_of(topic):
    return TOPICS[topic.removeprefix(WELL)][0]


def test_every_topic_of_the_layout_exists_and_has_the_field():
    paths = [text for text in strings(LAYOUT) if text.startswith("/")]
    assert len(paths) > 12
    for path in paths:
        topic, *fields = path.split(".")
        kind = kind_of(topic)
        for field in fields:
            if not field.startswith("@"):
                assert re.sub(r"\[.*\]$", "", field) in kind.get_fields_and_field_types(), path


def test_the_layout_shows_every_panel_it_configures():
    shown = {text for text in strings(LAYOUT["layout"]) if "!" in text}
    assert shown == set(LAYOUT["configById"])


def test_rviz_subscribes_to_topics_that_exist_with_profiles_that_match():
    topics = [d["Topic"] for d in RVIZ["Visualization Manager"]["Displays"] if "Topic" in d]
    assert [topic["Value"] for topic in topics] == ["/well_1/path"]
    profile = TOPICS["path"][1]
    assert topics[0]["Durability Policy"].replace(" ", "_").upper() == profile.durability.name
    assert topics[0]["Reliability Policy"].upper() == profile.reliability.name


def test_every_frame_is_one_of_a_well_and_documented():
    frames = {text for text in [*strings(LAYOUT), *strings(RVIZ)] if re.fullmatch(r"well_1/\w+", text)}
    assert frames == {"well_1/local_enu", "well_1/sonde_link"}
    text = (PACKAGE.parent / "docs" / "reference" / "frames.md").read_text()
    for frame in (wire.LOCAL_FRAME, wire.SONDE_FRAME, wire.WELLHEAD_FRAME, wire.RIG_FRAME, wire.BIT_FRAME):
        assert f"`WELL/{frame}`" in text


def test_the_drawing_of_the_tool_names_the_frames_of_tf():
    drawing = ET.parse(PACKAGE / "config" / "sonde.urdf").getroot()  # noqa: S314  (our own file)
    assert {link.get("name") for link in drawing.iter("link")} == {wire.SONDE_FRAME, wire.BIT_FRAME}
    (joint,) = drawing.iter("joint")
    assert joint.find("origin").get("xyz") == "8.0 0 0"
    (display,) = (d for d in RVIZ["Visualization Manager"]["Displays"] if d["Class"].endswith("RobotModel"))
    assert display["Description File"] == "package://mwd_surface/config/sonde.urdf"


def test_they_are_installed():
    setup = (PACKAGE / "setup.py").read_text()
    assert 'glob("config/*")' in setup
