# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pressure: the line shows the last two minutes, the spectrum the frequency that is there."""

import numpy as np
import pytest

from mwd_surface.live.link_state import LINE_HZ, LINE_S, PressureHistory


def pushed(rate, seconds, block, hertz=1.5):
    history = PressureHistory()
    time = np.arange(round(rate * seconds)) / rate
    pressure = 2.0e7 + 1e5 * np.sin(2.0 * np.pi * hertz * time)
    many = round(block * rate)
    for first in range(0, len(time), many):
        history.push(round(time[first] * 1e9), 1.0 / rate, pressure[first : first + many])
    return history.picture()


@pytest.mark.parametrize("rate", [25.0, 50.0, 100.0, 1000.0])
@pytest.mark.parametrize("block", [1.0, 2.0])
def test_the_spectrum_has_its_peak_where_the_pressure_swings(rate, block):
    picture = pushed(rate, 60.0, block)
    assert len(picture.spectra) >= 8
    assert np.argmax(picture.spectra[-1]) * picture.bin_hz == pytest.approx(1.5, abs=1.5 * picture.bin_hz)


def test_the_line_is_the_last_two_minutes_around_their_median():
    picture = pushed(100.0, 200.0, 1.0, hertz=0.3)
    assert len(picture.line) == pytest.approx(LINE_HZ * LINE_S, rel=0.3)
    # The median is lopsided within half its window of an end.
    assert max(picture.line[50:-50]) == pytest.approx(100.0, rel=0.05)
    assert picture.end_ns == 200_000_000_000


def test_pumps_that_start_do_not_hide_what_follows():
    history = PressureHistory()
    time = np.arange(15000) / 100.0
    pressure = 2.0e7 * np.clip((time - 80.0) / 8.0, 0.0, 1.0) + 1e5 * np.sin(2.0 * np.pi * 0.3 * time)
    for first in range(0, len(time), 100):
        history.push(round(time[first] * 1e9), 0.01, pressure[first : first + 100])
    line = np.array(history.picture().line)
    assert np.abs(line[-500:-50]).max() == pytest.approx(100.0, rel=0.05)


def test_before_any_pressure_there_is_nothing_to_draw():
    picture = PressureHistory().picture()
    assert picture.line == ()
    assert picture.spectra == ()
