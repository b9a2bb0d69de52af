# SPDX-License-Identifier: Apache-2.0
"""The head of every report: names, datums and norths, and what is not allowed there."""

import pytest

from mwd_estimation.core.north import North
from mwd_sensors.core.settings import SettingsError, from_mapping
from mwd_surface.surveys.well import NORTHS, Well


def test_a_wellbore_without_a_name_has_that_of_its_well():
    assert Well(name="34/10-A-12").wellbore_name == "34/10-A-12"
    assert Well(name="34/10-A-12", wellbore="ST2").wellbore_name == "ST2"


def test_the_norths_are_those_of_the_surveys_in_their_order():
    assert [North[name.upper()] for name in NORTHS] == [North.MAGNETIC, North.TRUE, North.GRID]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"latitude_deg": 91.0}, "latitude_deg: 91 deg is above the highest allowed, 90 deg"),
        ({"longitude_deg": -181.0}, "longitude_deg: -181 deg is below the lowest allowed"),
        ({"section_azimuth_deg": -2.0}, "section_azimuth_deg: -2 deg is below"),
        ({"sensor_to_bit": -2.0}, "sensor_to_bit: -2 m is below"),
        ({"north_reference": "gird"}, "did you mean grid"),
        ({"latitude": 60.0}, "did you mean latitude_deg"),
    ],
)
def test_what_no_well_can_have_is_refused_with_its_reason(given, message):
    with pytest.raises(SettingsError, match=message):
        from_mapping(Well, given)
