# SPDX-License-Identifier: Apache-2.0
"""Where a recording without settings was made: by the satellite receiver in it, where that had a fix."""

import plotted_bag
import pytest

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings
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


def test_a_parameter_that_cannot_be_used_is_named_and_the_others_count(tmp_path):
    told = {ESTIMATOR: {"tool.lever_m": "0.03", "survey.duration_s": "-1.0", "tool.gyro.bias_deg_h": "100.0"}}
    with Bag(fixes(tmp_path / "bag", (0, 59.9, 10.7), tables=told)) as bag:
        got = recorded_settings(bag)
    assert got.estimator == settings.changed(EstimatorSettings(), {"tool.gyro.bias_deg_h": 100.0})
    unknown, refused = got.remarks
    assert unknown.startswith("tool.lever_m = 0.03 of the recording is not used: ")
    assert refused.startswith("survey.duration_s = -1.0 of the recording is not used: ")
