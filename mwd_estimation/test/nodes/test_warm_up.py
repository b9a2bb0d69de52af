# SPDX-License-Identifier: Apache-2.0
"""What is prepared at start is all that the estimator needs later."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow(6)

# In a process of its own, for kernels that another test has used are ready already.
PROGRAM = """
import gc, sys
from numba.core.registry import CPUDispatcher
from mwd_estimation.nodes.warm_up import warm_up
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator import scenario, scenario_files
from mwd_sensors.simulator.sonde import Sonde

def ready():
    kernels = [one for one in gc.get_objects() if isinstance(one, CPUDispatcher)]
    return {
        (one.__module__, one.__name__, str(kinds))
        for one in kernels if one.__module__.startswith("mwd_estimation") for kinds in one.signatures
    }

place = {"place.field": "model", "place.lat_deg": 38.3, "place.lon_deg": 109.6}
settings = changed(EstimatorSettings(), place)
warm_up(settings)
before = ready()
for name in sys.argv[1:]:
    pipeline, surveys = Pipeline(settings), 0
    pipeline.request_north(30.0)
    pipeline.requests.start_rotary(10.0)
    for block in Sonde(scenario.read(scenario_files.find(name))).blocks(10.0):
        pipeline.push_mag(block["imu/mag"])
        pipeline.push_precision(block["gyro/data_raw"])
        pipeline.push_temperature(block["imu/temperature"])
        surveys += len(pipeline.push_imu(block["imu/data_raw"]).surveys)
    surveys += len(pipeline.finish().surveys)
    pipeline.revisions()
    print(surveys, *sorted(ready() - before))
"""


def test_an_estimator_compiles_nothing_once_it_is_prepared():
    words = [sys.executable, "-c", PROGRAM, "default", "faults"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    runs = [line.split() for line in done.stdout.splitlines()]
    assert all(int(surveys) > 1 for surveys, *_ in runs)
    assert [compiled for _, *compiled in runs] == [[], []], done.stdout
