# SPDX-License-Identifier: Apache-2.0
"""Samples as they stream to the page, with the figures a test gives them."""

from mwd_sensors.core import wire
from mwd_surface.bags.recorder.status import RecorderState, RecorderStatus
from mwd_surface.live.live_state import LiveState
from mwd_surface.page.state_json import StateJson


def attitude(inclination=0.8, azimuth=1.0, toolface=0.5, sigma=0.01, status=0, north=3, n=1, **more):
    samples = wire.ATTITUDE.empty(n)
    samples["stamp_ns"] = 5
    samples["inclination"], samples["azimuth"], samples["gravity_toolface"] = inclination, azimuth, toolface
    for name in ("inclination", "azimuth", "gravity_toolface", "magnetic_toolface"):
        samples["sigma_" + name] = sigma
    samples["status"], samples["north"] = status, north
    for name, value in more.items():
        samples[name] = value
    return samples


def rig(valid=2047, **values):
    samples = wire.RIG_STATE.empty(1)
    samples["valid"] = valid
    for name, value in values.items():
        samples[name] = value
    return samples


def recorder(**changes):
    """Status of a recorder."""
    return RecorderStatus(
        **{"state": RecorderState.RECORDING, "path": "bags/a", "messages": 5, "duration": 2.0, **changes}
    )


class ShownState(LiveState):
    """A live state, and the tables of the page made of it."""

    def __init__(self, settings=None):
        super().__init__(settings)
        self._tables = StateJson(settings)

    def snapshot(self, now):
        return self._tables.snapshot(self.at(now))
