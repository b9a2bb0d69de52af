# SPDX-License-Identifier: Apache-2.0
"""Where a recording without settings was made: by the satellite receiver in it, where that had a fix."""

import plotted_bag
import pytest

from mwd_estimation.settings import former
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


def test_a_parameter_of_before_is_named_where_its_value_was_not_todays_constant(tmp_path):
    before = {"tool.lever_m": "0.03", "survey.rotary_s": "60.0", "health.watch": "False"}
    before |= {"tool.gyro.walk_deg_h_sqrt_h": "10.0", "tool.possible_axial_nt": "2000.0"}
    told = {ESTIMATOR: {**before, "tool.gyro.bias_deg_h": "100.0"}}
    with Bag(fixes(tmp_path / "bag", (0, 59.9, 10.7), tables=told)) as bag:
        got = recorded_settings(bag)
    assert got.estimator.tool.gyro.bias_deg_h == 100.0
    assert got.remarks == (
        "survey.rotary_s = 60.0 of the recording is not used: it is now a constant (30.0)",
        "health.watch = False of the recording is not used: it is now always on: a faulty sensor is left out",
        # It follows from the bias, which is not the usual one here; the axial field is.
        "tool.gyro.walk_deg_h_sqrt_h = 10.0 of the recording is not used: it is now "
        + former.FORMER["tool.gyro.walk_deg_h_sqrt_h"],
    )


@pytest.mark.parametrize(
    ("recorded", "now"),
    [
        (
            {
                "place.field": "fixed",
                "place.total_nt": "50000.0",
                "place.source": "IFR1",
                "place.model": "igrf",
                "place.sigma_total_nt": "60.0",
                "place.sigma_dip_deg": "0.11",
                "place.sigma_declination_deg": "0.15",
            },
            {
                "place.field": "fixed",
                "place.total_nt": 50000.0,
                "place.source": "IFR1",
                "place.source_sigmas": [60.0, 0.11, 0.15],
            },
        ),
        (
            {"verdict.limits": "custom", "verdict.gravity_limit_mg": "4.0", "verdict.dip_limit_deg": "0.6"},
            {"verdict.limits": "custom", "verdict.custom_limits": [4.0, 300.0, 0.6]},
        ),
        ({"place.field": "model", "place.model": "igrf"}, {"place.field": "igrf"}),
        ({"place.field": "model", "place.model": "wmm2025"}, {"place.field": "model"}),
        (
            {"transmit.rotation_switching": "True", "transmit.rotation_hold_s": "5.0"},
            {"transmit.rotation_switching_s": 5.0},
        ),
        ({"transmit.rotation_switching": "True"}, {"transmit.rotation_switching_s": 10.0}),
        ({"transmit.rotation_switching": "False", "transmit.rotation_hold_s": "5.0"}, {}),
        ({"tool.calibrated_low_c": "10.0"}, {"tool.calibrated_c": [10.0, 175.0]}),
        ({"tool.misalignment_y_deg": "0.3"}, {"tool.hole_axis_deg": [0.3, 0.0]}),
        ({"tool.hole_axis_deg": "[0.1, 0.2]"}, {"tool.hole_axis_deg": [0.1, 0.2]}),
    ],
)
def test_a_parameter_with_another_name_today_counts_as_it_was_recorded(tmp_path, recorded, now):
    with Bag(fixes(tmp_path / "bag", (0, 59.9, 10.7), tables={ESTIMATOR: recorded})) as bag:
        got = recorded_settings(bag)
    assert (got.estimator, got.remarks) == (settings.changed(EstimatorSettings(), now), ())
