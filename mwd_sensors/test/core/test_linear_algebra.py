# SPDX-License-Identifier: Apache-2.0
"""However a node is started, its linear algebra uses one thread, unless its user says otherwise."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

# What `ros2 run` and launch files do before they call `main`; OpenBLAS reads the variable with numpy, and what is
# imported after it does not matter.
ENTRY_POINT = """
import os, sys
from importlib import import_module
class Watch:
    def find_spec(self, name, *_):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"))
            sys.exit()
sys.meta_path.insert(0, Watch())
import_module(sys.argv[1])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "given", "seen"),
    [
        ("mwd_sensors.nodes.sonde", None, "1"),
        ("mwd_estimation.nodes.estimator", None, "1"),
        ("mwd_surface.nodes.surface", None, "1"),
        ("mwd_surface.nodes.receiver", "2", "2"),
    ],
)
def test_one_thread_is_set_before_numpy_is_imported(module, given, seen):
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    environment |= {"OPENBLAS_NUM_THREADS": given} if given else {}
    words = [sys.executable, "-P", "-c", ENTRY_POINT, module]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [seen]
