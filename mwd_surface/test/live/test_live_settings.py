# SPDX-License-Identifier: Apache-2.0
"""Settings of the live page: every stream has a period."""

import dataclasses

from mwd_surface.live.live_state import LiveState
from mwd_surface.live.settings import LiveSettings


def test_every_stream_has_its_period_and_every_period_its_stream():
    links = LiveState().streams(0.0)
    periods = {f.name.removesuffix("_period") for f in dataclasses.fields(LiveSettings) if f.name.endswith("_period")}
    assert periods == set(links)
    for name, link in links.items():
        assert link.stale_after == 2.0 * getattr(LiveSettings(), f"{name}_period")
