# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml: written as rosbag2 Jazzy writes it, read from any version, replaced only as a whole."""

from __future__ import annotations

import pytest
import yaml

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, File, MetadataError, Topic

BAG = BagMetadata(
    files=[File("w_0.mcap", 100, 300, 2), File("w_1.mcap", 350, 1000, 3), File("w_2.mcap", None, 0, 0)],
    topics=[
        Topic("/a", "std_msgs/msg/String", 5, "RIHS01_00", [bag_metadata.qos_profile("best_effort")]),
        Topic("/b", "std_msgs/msg/String", 0, "RIHS01_00", [bag_metadata.qos_profile("best_effort")]),
    ],
    custom={"well": "F-4"},
)


def test_what_is_written_is_read_back(tmp_path):
    bag_metadata.write(tmp_path, BAG)
    assert bag_metadata.read(tmp_path) == BAG
    assert [path.name for path in tmp_path.iterdir()] == ["metadata.yaml"]


def test_the_table_has_the_keys_and_the_version_of_jazzy():
    info = yaml.safe_load(bag_metadata.to_text(BAG))["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["starting_time"]["nanoseconds_since_epoch"] == 100
    assert info["duration"]["nanoseconds"] == 900
    assert info["message_count"] == 5
    assert info["relative_file_paths"] == ["w_0.mcap", "w_1.mcap", "w_2.mcap"]
    assert info["files"][1] == {
        "path": "w_1.mcap",
        "starting_time": {"nanoseconds_since_epoch": 350},
        "duration": {"nanoseconds": 650},
        "message_count": 3,
    }
    assert info["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"][0]["reliability"] == (
        "best_effort"
    )
    assert info["custom_data"] == {"well": "F-4"}


def test_equal_profiles_are_written_out_each_time_because_rosbag2_knows_no_references():
    assert "&" not in bag_metadata.to_text(BAG)


def test_numbers_of_old_bags_become_names_and_missing_policies_get_defaults():
    (profile,) = bag_metadata.parse_qos("- {history: 1, depth: 5, reliability: 2, durability: 1, liveliness: 77}")
    assert (profile["history"], profile["reliability"], profile["durability"]) == (
        "keep_last",
        "best_effort",
        "transient_local",
    )
    assert profile["liveliness"] == "unknown"
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}


def test_profiles_survive_the_way_through_the_channel_text():
    profiles = [bag_metadata.qos_profile("reliable", "transient_local", depth=1)]
    assert bag_metadata.parse_qos(bag_metadata.qos_text(profiles)) == profiles
    assert bag_metadata.qos_text([]) == ""


@pytest.mark.parametrize("given", ["{a: 1}", "[1]", "a: [", "text"])
def test_what_is_not_a_list_of_profiles_is_refused(given):
    with pytest.raises(ValueError, match="qos"):
        bag_metadata.parse_qos(given)


def test_a_policy_that_rmw_does_not_have_is_refused_with_the_ones_it_has():
    with pytest.raises(ValueError, match=r"reliability: 'sometimes'.*best_effort"):
        bag_metadata.qos_profile("sometimes")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "No such file"),
        ("a: [", "does not have the expected content"),
        ("", "does not have the expected content"),
        ("rosbag2_bagfile_information: {}", "does not have the expected content"),
        ("3", "not"),
    ],
)
def test_a_missing_or_broken_file_is_refused_with_its_reason(tmp_path, text, words):
    if text is not None:
        (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(MetadataError, match=words):
        bag_metadata.read(tmp_path)


def test_a_bag_of_version_4_without_files_and_hashes_is_read(tmp_path):
    (tmp_path / "metadata.yaml").write_text(
        """
rosbag2_bagfile_information:
  version: 4
  storage_identifier: sqlite3
  relative_file_paths: [old/a_0.db3]
  duration: {nanoseconds: 5}
  starting_time: {nanoseconds_since_epoch: 7}
  message_count: 3
  topics_with_message_count:
    - topic_metadata: {name: /a, type: std_msgs/msg/String, serialization_format: cdr, offered_qos_profiles: ""}
      message_count: 3
  compression_format: ""
  compression_mode: ""
"""
    )
    found = bag_metadata.read(tmp_path)
    assert found.files == [File("a_0.db3", None, 0, 0)]
    assert found.topics == [Topic("/a", "std_msgs/msg/String", 3, qos=[])]
