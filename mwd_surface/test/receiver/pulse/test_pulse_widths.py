# SPDX-License-Identifier: Apache-2.0
"""What one pulse width tells of another: predicted from one run, measured in another of the same well."""

import numpy as np
import pytest
from link_runs import TOOLS, reception, simulated

from mwd_surface.receiver.pulse import pulse_widths
from mwd_surface.receiver.pulse.pulse_receiver import PulseReceiver


@pytest.mark.slow
@pytest.mark.parametrize(("heard", "other"), [("0.8", "0.5"), ("0.5", "0.8")])
def test_the_margin_of_another_pulse_width_is_what_it_turns_out_to_be(heard, other):
    run = simulated(heard)
    receiver = PulseReceiver(TOOLS[heard])
    frames = receiver.push(run.time_s, run.pressure_pa).frames + receiver.finish().frames
    ebn0_db = np.mean([frame.ebn0_db for frame in frames])
    found = dict(pulse_widths.margins(receiver.channel, float(heard), float(ebn0_db)))
    assert found[float(heard)] == pytest.approx(ebn0_db)
    measured = np.mean([frame.ebn0_db for frame in reception(other).frames])
    assert found[float(other)] == pytest.approx(measured, abs=1.5)
    assert list(found.values()) == sorted(found.values(), reverse=True)
    # Pulses show the channel at the frequencies of widths up to 2.5 times longer or shorter, and say nothing of others.
    expected = [width for width in pulse_widths.WIDTHS_S if 0.39 < width / float(heard) < 2.51]
    assert list(found) == expected


def test_nothing_heard_has_no_channel():
    receiver = PulseReceiver(TOOLS["0.5"])
    receiver.push(np.arange(0.0, 60.0, 0.02), np.random.default_rng(1).normal(size=3000))
    receiver.finish()
    assert receiver.channel is None
