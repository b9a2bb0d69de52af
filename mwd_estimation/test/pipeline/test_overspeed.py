# SPDX-License-Identifier: Apache-2.0
"""A string that turns faster than the gyro reads: angles with a true sigma, and the cause named."""

import numpy as np
import pytest

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde

SCENARIO = """
name: overspeed
about: Steady rotation beyond the range of the gyro about the axis.
date: 2026-03-01
rig: {running_start: true}
vibration:
  random: [{band_hz: [5.0, 120.0], acceleration_mps2: [2.0, 2.0, 2.0], when: always}]
  per_turn: [{per_turn: 1, speed_fraction: 0.01}, {per_turn: 2, displacement_mm: [0.8, 0.0, 0.0]}]
precision: null
"""


@pytest.mark.slow(4)
@pytest.mark.fault_case(21)
@pytest.mark.parametrize(("rpm", "inclination_deg"), [(340.0, 90.0), (340.0, 20.0), (600.0, 50.0)])
@pytest.mark.parametrize("lever_mm", [[0.0, 0.0, 0.0], [20.0, 8.0, -6.0]])
def test_angles_of_a_string_beyond_the_range_of_its_gyro_have_a_true_sigma(rpm, inclination_deg, lever_mm):
    changes = {
        "well": {"stations": [[0.0, inclination_deg, 60.0]]},
        "schedule": [{"kind": "drill", "seconds": 25.0, "rpm": rpm, "rop_m_h": 0.0}],
        "ahrs": {"grade": "mti3_calibrated", "lever_mm": lever_mm},
    }
    sonde = Sonde(scenario.parse(SCENARIO, changes))
    pipeline, rows, truth, faults, surveys = Pipeline(EstimatorSettings()), [], [], [], []
    for block in sonde.blocks(5.0):
        pipeline.push_mag(block["imu/mag"])
        output = pipeline.push_imu(block["imu/data_raw"])
        rows.append(output.attitude)
        truth.append(block["truth"])
        faults += [fault.code for fault in output.health]
        surveys += output.surveys
    got, true = np.concatenate(rows), np.concatenate(truth)
    true = true[np.searchsorted(true["stamp_ns"], got["stamp_ns"])]
    late = got["stamp_ns"] - got["stamp_ns"][0] > 3_000_000_000
    for name in ("inclination", "gravity_toolface"):
        error, sigma = wrap_pi(got[name] - true[name])[late], got[f"sigma_{name}"][late]
        assert np.isfinite(error).mean() > 0.99
        assert np.mean(np.abs(error) > 3.0 * sigma) < 0.01
    # The estimated gravity is too uncertain to remove the magnetic field of the string from the azimuth.
    assert got["sigma_inclination"][late].min() > 0.1
    assert np.isnan(got["azimuth"]).all()
    assert FaultCode.SATURATED in faults
    assert not surveys
