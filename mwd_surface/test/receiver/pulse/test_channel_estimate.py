# SPDX-License-Identifier: Apache-2.0
"""What an uncertain response and an uncertain time add to a decision, against drawn ones."""

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU, basis, response_length, sensitivity, uncertainty


def _apart(response, later=True):
    """Pulse less the pulse one TU later or earlier; the pulse begins one TU behind the first sample."""
    other = 2 * SAMPLES_PER_TU if later else 0
    return _placed(response, SAMPLES_PER_TU) - _placed(response, other)


def _placed(response, at):
    return np.pad(response, (at, 2 * SAMPLES_PER_TU - at))


@pytest.mark.parametrize("size", [3.0, 0.3])
def test_an_uncertain_response_adds_the_variance_that_is_claimed(size):
    """Strong pulses, where its error meets the pulse, and weak ones, where it meets the noise."""
    random = np.random.default_rng(7)
    shapes = basis(response_length(0.25), 0.25)
    count = len(shapes)
    u = size * random.normal(size=count)
    root = 0.1 * random.normal(size=(count, count))
    pulse = _placed(u @ shapes, SAMPLES_PER_TU)
    errors = []
    for trial in range(4000):
        later = trial % 2 == 0
        estimated = _apart((u + root @ random.normal(size=count)) @ shapes, later)
        errors.append(estimated @ (pulse + random.normal(size=len(pulse))) - _apart(u @ shapes, later) @ pulse)
    true = _apart(u @ shapes)
    claimed = np.sqrt(true @ true * (1.0 + uncertainty(u, root @ root.T, shapes)))
    assert_consistent(np.array(errors), np.full(len(errors), claimed))


def test_a_late_pulse_moves_a_decision_as_is_claimed():
    at = np.arange(-40.0, 80.0)
    response = np.exp(-0.5 * (at / 6.0) ** 2)
    late = np.exp(-0.5 * ((at - 0.1) / 6.0) ** 2)
    apart = _apart(response)
    moved = apart @ _placed(late - response, SAMPLES_PER_TU)
    assert abs(moved) / np.linalg.norm(apart) == pytest.approx(0.1 * sensitivity(response), rel=0.05)
