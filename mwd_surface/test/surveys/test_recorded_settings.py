# SPDX-License-Identifier: Apache-2.0
"""Where a recording without settings was made: by the satellite receiver in it, where that had a fix."""

import plotted_bag
import pytest

from mwd_estimation.settings import former
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.surveys.recorded_settings import ESTIMATOR, recorded_settings

FIX = "sensor_msgs/msg/NavSatFix"


def fixes(path, *rows, tables=()):
    """A bag of fixes: status, latitude and longitude in deg."""
    with BagWriter(path) as bag:
        for name, table in dict(tables).items():
            bag.add_metadata(name, table)
        bag.definitions.load(FIX)
        store = bag.definitions.typestore
        channel = bag.topic("/gnss/fix", FIX)
        for k, (status, latitude, longitude) in enumerate(rows):
            message = plotted_bag.blank(store, FIX)
            message.status.status, message.latitude, message.longitude = status, latitude, longitude
            bag.write(channel, bytes(store.serialize_cdr(plotted_bag.arrays(message), FIX)), k, k)
    return path


def test_the_first_fix_is_the_place_and_names_its_topic(tmp_path):
    with Bag(fixes(tmp_path / "bag", (-1, 1.0, 1.0), (0, 59.9, 10.7), (0, 0.0, 0.0))) as bag:
        got = recorded_settings(bag)
    assert got.source == "the place of /gnss/fix"
    assert (got.estimator.place.lat_deg, got.estimator.place.lon_deg) == (59.9, 10.7)
    assert got.estimator.survey.north == "true"


@pytest.mark.parametrize("rows", [((-1, 1.0, 1.0),), ((0, float("nan"), 1.0),)])
def test_a_receiver_without_a_fix_tells_no_place(tmp_path, rows):
    with Bag(fixes(tmp_path / "bag", *rows)) as bag:
        assert recorded_settings(bag).estimator is None


def test_settings_in_the_recording_count_before_a_fix(tmp_path):
    told = {ESTIMATOR: {"place.field": "model", "place.lat_deg": "38.3", "place.lon_deg": "109.6"}}
    with Bag(fixes(tmp_path / "bag", (0, 59.9, 10.7), tables=told)) as bag:
        got = recorded_settings(bag)
    assert (got.source, got.estimator.place.lat_deg) == ("those of the recording", 38.3)


def test_a_parameter_of_before_is_named_where_its_value_was_not_todays_constant(tmp_path):
    before = {"tool.lever_m": "0.03", "survey.rotary_s": "60.0", "tool.misalignment_y_deg": "0.3"}
    before |= {"tool.gyro.walk_deg_h_sqrt_h": "10.0", "tool.possible_axial_nt": "2000.0"}
    told = {ESTIMATOR: {**before, "tool.gyro.bias_deg_h": "100.0"}}
    with Bag(fixes(tmp_path / "bag", (0, 59.9, 10.7), tables=told)) as bag:
        got = recorded_settings(bag)
    assert got.estimator.tool.gyro.bias_deg_h == 100.0
    assert got.remarks == (
        "survey.rotary_s = 60.0 of the recording is not used: it is now a constant (30.0)",
        "tool.misalignment_y_deg = 0.3 of the recording is not used: it is now tool.hole_axis_deg, about y and z",
        # It follows from the bias, which is not the usual one here; the axial field is.
        "tool.gyro.walk_deg_h_sqrt_h = 10.0 of the recording is not used: it is now "
        + former.FORMER["tool.gyro.walk_deg_h_sqrt_h"],
    )
