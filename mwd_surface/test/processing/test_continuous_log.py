# SPDX-License-Identifier: Apache-2.0
"""Depth of continuous measurements: only while new hole is made steadily, and where the rig reported it."""

import numpy as np
import pytest

from mwd_surface.processing import continuous_log as module
from mwd_surface.processing.continuous_log import drilled_depth

S = 10**9


def _rig():
    """A stand drilled at 36 m/h, a connection with the bit pulled 2 m off bottom, and drilling again."""
    seconds = np.arange(0.0, 600.0, 5.0)
    bit = np.interp(seconds, [0.0, 200.0, 220.0, 300.0, 320.0, 600.0], [100.0, 102.0, 100.0, 100.0, 102.0, 104.8])
    return (seconds * S).astype(np.int64), bit


def test_depth_is_known_while_new_hole_is_made_and_only_then():
    stamps, bit = _rig()
    at = np.array([5.0, 100.0, 185.0, 195.0, 210.0, 260.0, 310.0, 400.0, 580.0])
    depth = drilled_depth(stamps, bit, (at * S).astype(np.int64))
    # Start-up, drilled, drilled, slowing down, pulled up, off bottom, run in, drilled, drilled.
    unknown = [np.nan] * 4
    assert depth == pytest.approx([np.nan, 101.0, 101.85, *unknown, 102.8, 104.6], nan_ok=True)


def test_a_silence_of_the_rig_leaves_the_depth_unknown():
    stamps, bit = _rig()
    kept = (stamps < 50 * S) | (stamps > 150 * S)
    depth = drilled_depth(stamps[kept], bit[kept], np.array([40, 100, 180]) * S)
    assert depth == pytest.approx([100.4, np.nan, 101.8], nan_ok=True)
    assert np.isnan(drilled_depth(stamps, bit, np.array([-S, 700 * S]))).all()


def test_angles_from_before_the_direction_of_gravity_is_known_are_left_out(monkeypatch):
    """After a silence of the sensors, an inclination of 54 deg in a hole of 32 deg entered the path."""
    stamps, bit = _rig()
    at = (np.array([100.0, 101.0, 102.0]) * S).astype(np.int64)
    block = {
        "stamp_ns": at,
        "inclination_deg": np.array([54.0, 32.0, 32.0]),
        "azimuth_deg": np.array([10.0, 45.0, 45.0]),
        "status": np.array(["initialising|no_mag", "rotating", "rotating|sensor_suspect"], dtype=object),
    }
    monkeypatch.setattr(module, "_bit_depths", lambda _bag: (stamps, bit))
    monkeypatch.setattr(module.run_folder, "attitude", lambda _folder: iter([block]))
    found = module.continuous_log("folder", "bag", 1.0)
    assert np.degrees(found.inclination) == pytest.approx([32.0, 32.0])
    assert found.md == pytest.approx([100.01, 100.02], abs=1e-6)
