# SPDX-License-Identifier: Apache-2.0
"""What the simulated tool sends."""

import numpy as np
import pytest

from mwd_sensors.simulator.pulse_tool import transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration

TOOL = ToolConfiguration(pulse_width_s=0.5, toolface_sequences=("2{aTFA:6:P} Gama:8:P",))


def test_survey_comes_first_after_each_flow_on_then_toolface():
    sent = transmit(TOOL, ((20.0, 260.0), (300.0, 500.0)), seed=1)
    assert sent.pulses[0, 0] == pytest.approx(20.0 + TOOL.transmit_delay_s)
    surveys = [word.frame for word in sent.words if word.name == "Inc"]
    assert len(surveys) == 2
    assert sent.words[0].start_s == pytest.approx(65.0 + 40 * TOOL.tu_s)
    assert all(word.end_s < 260.0 or word.start_s > 300.0 for word in sent.words)
    assert np.all(np.diff(sent.pulses[:, 0]) >= 5.0 * TOOL.tu_s - 1e-9)


def test_a_slow_clock_sends_slowly():
    right, slow = (transmit(TOOL, ((0.0, 400.0),), seed=1, clock=clock) for clock in (0.0, 1e-3))
    ratio = (slow.pulses[-1, 0] - slow.pulses[0, 0]) / (right.pulses[-1, 0] - right.pulses[0, 0])
    assert ratio == pytest.approx(1.001, abs=1e-6)
    assert np.diff(slow.pulses[:, :2], axis=1) == pytest.approx(0.5005)
