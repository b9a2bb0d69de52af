# SPDX-License-Identifier: Apache-2.0
"""A sample that no gauge can read counts as missing: the words are the same."""

import numpy as np
import pytest
from link_runs import TOOLS, simulated

from mwd_surface.receiver.pulse.pulse_receiver import decode

pytestmark = pytest.mark.slow(20)


@pytest.mark.parametrize("value", [-1e308, 1e300, np.inf, 2e9])
def test_one_impossible_pressure_changes_no_word(value):
    run = simulated()
    words = []
    for sample in (np.nan, value):
        pressure = run.pressure_pa.copy()
        pressure[len(pressure) // 2] = sample
        words.append([(w.name, w.raw, w.usable) for w in decode(TOOLS["0.8"], run.time_s, pressure).words])
    assert words[0]
    assert words[0] == words[1]
