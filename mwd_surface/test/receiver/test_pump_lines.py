# SPDX-License-Identifier: Apache-2.0
"""Lines of pumps: found where they are, taken out of the noise, and nothing else with them."""

import numpy as np
import pytest

from mwd_surface.receiver.pump_lines import line_frequencies, pump_noise

N = 2000
OMEGA = (0.41, 1.37)
KNOWN = np.ones(N)


def noise(seed=1):
    return np.random.default_rng(seed).normal(size=N)


def lines(hunting=0.0):
    phase = np.cumsum(1.0 + hunting * np.sin(np.arange(N) / 300.0))
    return 60.0 * np.cos(OMEGA[0] * phase + 1.0) + 25.0 * np.cos(OMEGA[1] * phase)


def test_lines_are_found_strongest_first():
    found = line_frequencies(noise() + lines())
    assert found == pytest.approx(OMEGA[::-1], abs=1e-3) or found == pytest.approx(OMEGA, abs=1e-3)


def test_white_noise_and_noise_of_1_over_f_have_no_lines():
    assert len(line_frequencies(noise())) == 0
    assert len(line_frequencies(np.cumsum(noise()))) == 0


@pytest.mark.parametrize("hunting", [0.0, 5e-4])
def test_what_is_left_is_the_noise(hunting):
    pumps = lines(hunting)
    left = noise() + pumps - pump_noise(noise() + pumps, KNOWN)[0].pressure
    assert np.std(left - noise()) < 0.05 * np.std(pumps)
    assert np.std(left) < 2.5


def test_unknown_samples_do_not_count():
    known = KNOWN.copy()
    known[500:700] = 0.0
    filled = noise() + lines()
    filled[500:700] = 0.0
    left = (filled - pump_noise(filled, known)[0].pressure - noise())[900:]
    assert np.std(left) < 0.05 * np.std(lines())


def test_counted_strokes_follow_a_hunting_pump():
    """Two harmonics of a pump whose rate wanders by 2 %: too fast for lines of fixed frequency."""
    angle = 0.3 * np.cumsum(1.0 + 0.02 * np.sin(np.arange(N) / 100.0))
    pumps = 60.0 * np.cos(angle + 1.0) + 25.0 * np.cos(3.0 * angle)
    blind = noise() + pumps - pump_noise(noise() + pumps, KNOWN)[0].pressure
    left = noise() + pumps - pump_noise(noise() + pumps, KNOWN, angles=angle[None, :])[0].pressure
    assert np.std(left - noise()) < 0.02 * np.std(pumps)
    # The average over 15 s leaves a tenth of what the lines of fixed frequency leave; jitter of real counters needs it.
    assert np.std(left - noise()) < 0.15 * np.std(blind - noise())


def test_strokes_that_are_not_in_the_pressure_take_nothing_out():
    """A counter of a pump that is not on the line."""
    angle = 0.3 * np.arange(N)
    taken = pump_noise(noise(), KNOWN, angles=angle[None, :])[0].pressure
    assert np.std(taken) < 0.1
