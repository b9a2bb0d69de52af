# SPDX-License-Identifier: Apache-2.0
"""Options of place and field: what they set, and which of them mean nothing together."""

import pytest

from mwd_sensors.core.settings import SettingsError
from mwd_surface.commands.shared_options import place_changes, placed_settings, recording_changes, tool_changes

FIELD = {
    "place.field": "fixed",
    "place.total_nt": 50360.0,
    "place.dip_deg": 71.6,
    "place.declination_deg": -2.2,
}
GYRO = {"place.lat_deg": 58.4}


def test_a_place_is_the_model_s_and_a_known_field_stands_for_itself():
    place = {"place.field": "model", "place.lat_deg": 58.4, "place.lon_deg": 1.9}
    for changes in (place_changes, recording_changes):
        assert changes(58.4, 1.9, None, None) == place
        assert changes(58.4, 1.9, "2026-03-01", None) == place | {"place.date": "2026-03-01"}
        assert changes(None, None, None, "50360,71.6,-2.2") == FIELD
        assert changes(None, None, None, None) == {}


def test_the_gyro_of_a_recording_needs_no_more_than_the_latitude():
    assert recording_changes(58.4, None, None, None) == GYRO
    assert recording_changes(58.4, None, None, "50360,71.6,-2.2") == FIELD | GYRO
    assert recording_changes(58.4, 1.9, None, "50360,71.6,-2.2") == FIELD | GYRO


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ((58.4, None, "2026-03-01", None), "--date: has no effect"),
        ((58.4, 1.9, "2026-03-01", "50360,71.6"), "--date: has no effect"),
        ((None, 1.9, None, None), "give both"),
        ((None, None, None, "50360"), "nT,dip,declination"),
        ((58.4, None, None, "much,little"), "nT,dip,declination"),
    ],
)
def test_what_means_nothing_is_refused(given, sentence):
    with pytest.raises(ValueError, match=sentence):
        recording_changes(*given)


def test_a_tool_file_or_a_grade_says_what_the_units_can_do(tmp_path):
    file = tmp_path / "tool.yaml"
    file.write_text("name: ours\naccelerometer: {range_g: [8.0, 8.0, 8.0], noise_ug_sqrt_hz: 90.0}\n")
    made = placed_settings(None, None, {}, tool=tool_changes(str(file), "navigation"))
    assert made.tool.accelerometer.range_g == (8.0, 8.0, 8.0)
    assert made.tool.precision.gyro.bias_deg_h == 0.01
    assert made.survey.north == "best"
    with pytest.raises(SettingsError, match="no such file or grade; did you mean navigation"):
        tool_changes("navigator", None)
