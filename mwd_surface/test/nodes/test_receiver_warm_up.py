# SPDX-License-Identifier: Apache-2.0
"""What is prepared at start is all that a receiver needs later."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow(4)

# In a process of its own, for kernels that another test has used are ready already.
PROGRAM = """
import gc, sys
import numpy as np
from numba.core.registry import CPUDispatcher
from mwd_sensors.simulator import carrier_tool, pulse_tool
from mwd_sensors.simulator.mud_channel import MudChannel
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.nodes.receiver import warm_up
from mwd_surface.receiver.link.receivers import receiver_of

def ready():
    kernels = [one for one in gc.get_objects() if isinstance(one, CPUDispatcher)]
    return {
        (one.__module__, one.__name__, str(kinds))
        for one in kernels if one.__module__.startswith("mwd_surface.receiver") for kinds in one.signatures
    }

tool = ToolConfiguration(code=sys.argv[1])
flows = ((10.0, 230.0),)
if tool.code == "psk":
    run = carrier_tool.siren_run(MudChannel(), carrier_tool.transmit(tool, flows, 1), 240.0, 1)
else:
    run = pulse_tool.link_run(MudChannel(), pulse_tool.transmit(tool, flows, 1), 240.0, 1)
warm_up([tool])
before = ready()
receiver = receiver_of(tool)
receiver.strokes(1, np.arange(10.0, 230.0, 0.6))
words = receiver.push(run.time_s, run.pressure_pa).words + receiver.finish().words
print(len(words), *sorted(ready() - before))
"""


@pytest.mark.parametrize("code", ["mary", "psk"])
def test_a_receiver_compiles_nothing_once_it_is_prepared(code):
    words = [sys.executable, "-c", PROGRAM, code]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    received, *compiled = done.stdout.split()
    assert int(received) > 5
    assert not compiled, done.stdout
