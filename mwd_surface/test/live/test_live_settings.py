# SPDX-License-Identifier: Apache-2.0
"""What people may choose of the live page: a period for every stream, and bounds that keep the page small."""

import dataclasses

import pytest

from mwd_sensors.core.settings import SettingsError, from_mapping
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings


def test_every_stream_has_its_period_and_every_period_its_stream():
    links = LiveState().streams(0.0)
    periods = {f.name.removesuffix("_period") for f in dataclasses.fields(LiveSettings) if f.name.endswith("_period")}
    assert periods == set(links)
    for name, link in links.items():
        assert link.stale_after == 2.0 * getattr(LiveSettings(), f"{name}_period")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rig_period": 0.0}, "rig_period: 0 s is below the lowest allowed"),
        ({"history_seconds": 1e6}, "above the highest allowed, 7200 s"),
        ({"max_rows": 1.0}, "expected a whole number"),
        ({"rig_perod": 1.0}, "did you mean rig_period"),
    ],
)
def test_what_is_not_allowed_is_refused_with_its_reason(given, message):
    with pytest.raises(SettingsError, match=message):
        from_mapping(LiveSettings, given)
