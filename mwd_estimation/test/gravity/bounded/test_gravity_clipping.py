# SPDX-License-Identifier: Apache-2.0
"""Clipping in the bounded filter: velocities lost in shocks that samples show, and in those that they do not."""

import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.gravity.bounded import clipping
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import ROOT

# Every other or third second a slide hits the wall. Means of 20 ms show less of a clipped shock than of the vibration.
RARE_SHOCKS = {
    "well": {"stations": [[0.0, 50.0, 60.0]]},
    "schedule": [{"kind": "slide", "seconds": 100.0, "rop_m_h": 0.0, "toolface_deg": 40.0}],
    "rate_hz": 50,
    "vibration": {
        "random": [{"band_hz": [8.0, 300.0], "acceleration_mps2": [10.0, 10.0, 10.0]}],
        "shocks": [{"rate_hz": 0.4, "peak_g": [20.0, 80.0], "width_ms": [0.5, 3.0], "clearance_mm": 10.0}],
    },
}


@pytest.mark.slow
def test_rare_shocks_that_do_not_stand_out_in_long_samples_cost_no_tilt_either():
    p = bounded.Params()
    errors, sigmas, directions = [], [], []
    for seed in range(51, 54):
        sonde = Sonde(scenario.read(ROOT / "bags/scenarios/bench/rot155.yaml", {**RARE_SHOCKS, "seed": seed}))
        blocks = list(sonde.blocks(5.0))
        imu = np.concatenate([block["imu/data_raw"] for block in blocks])
        down = np.concatenate([block["truth"] for block in blocks])["gravity"]
        got = bounded.run(p, bounded.initial(p), imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"])
        late = imu["stamp_ns"] - imu["stamp_ns"][0] > 20_000_000_000
        inclination = np.arctan2(np.hypot(down[:, 1], down[:, 2]), down[:, 0])
        errors.append((got.inclination - inclination)[late])
        sigmas.append(got.sigma_inclination[late])
        directions.append(np.linalg.norm(np.cross(got.g_t, down), axis=1)[late])
    assert math.degrees(np.sqrt(np.mean(np.square(directions)))) < 0.06
    assert_consistent(np.stack(errors), np.stack(sigmas), correlated=True)


def test_the_more_shocks_were_seen_the_smaller_an_innovation_shows_a_velocity_lost():
    s = bounded.initial(bounded.Params()).record[0]
    s.sums.time, s.innovations.usual = 0.03, 1.0
    assert clipping.jump_gate(s) == clipping.NEVER
    gates = []
    for s.shocks in (1.0, 10.0):
        gates.append(clipping.jump_gate(s))
    # One shock in 333 updates, and in 33: as likely as a normal innovation of 3.4 and of 2.6 sigma.
    assert gates == pytest.approx([2.0 * math.log(1000.0 / 3.0), 2.0 * math.log(100.0 / 3.0)])
