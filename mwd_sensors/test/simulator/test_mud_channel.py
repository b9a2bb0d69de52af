# SPDX-License-Identifier: Apache-2.0
"""The mud channel: waves against an independent model of 3 km of mud, pulses, pumps, and the same bits for a seed."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator import mud_channel
from mwd_sensors.simulator.mud_channel import (
    RATE_HZ,
    MudChannel,
    Pressure,
    PressureNoise,
    Pump,
    WellGeometry,
    responses,
    wave_speed,
)

QUIET = MudChannel(pumps=(), noise=PressureNoise(bit_pa=0.0, surface_pa=0.0, gauge_pa=0.0, adc_bits=24))


def pressure(channel, pulses=(), seconds=40.0, seed=1):
    stream = Pressure(channel, np.array(pulses, dtype=float).reshape(-1, 2), seed)
    return np.concatenate([stream.block() for _ in range(round(seconds / 10.0))])


def test_same_seed_same_pressure_and_another_seed_another():
    one, two, other = (pressure(MudChannel(), seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("depth", [1000.0, 4000.0])
def test_a_pulse_arrives_with_the_wave(depth):
    channel = dataclasses.replace(QUIET, well=WellGeometry(depth_m=depth))
    with_pulse, without = pressure(channel, [(10.0, 10.8)]), pressure(channel)
    rise = with_pulse - without
    first = np.flatnonzero(rise > 0.3 * rise.max())[0] / RATE_HZ
    assert first - 10.0 == pytest.approx(depth / wave_speed(channel.well) + 0.2, abs=0.25)


def test_two_healthy_pumps_make_half_a_bar():
    """0.45 bar rms, 3 bar peak to peak (computed with an independent model)."""
    settled = pressure(MudChannel(), seconds=120.0)[6000:]
    assert np.std(settled) == pytest.approx(0.45e5, rel=0.25)
    assert np.ptp(settled) == pytest.approx(3.0e5, rel=0.4)


def test_a_leaking_valve_shows_at_the_strokes():
    def line(leak):
        channel = dataclasses.replace(QUIET, pumps=(Pump(1.5, leak=leak, hunting=0.0),))
        settled = pressure(channel, seconds=100.0)[4000:]
        power = np.abs(np.fft.rfft((settled - settled.mean()) * np.hanning(len(settled))))
        return power[round(1.5 * len(settled) / RATE_HZ)]

    assert line(0.1) > 4.0 * line(0.0)


def test_strokes_are_counted_when_the_pump_makes_them():
    stream = Pressure(dataclasses.replace(QUIET, pumps=(Pump(1.5),)), np.zeros((0, 2)), 3)
    for _ in range(12):
        stream.block()
    (strokes,) = stream.strokes()
    assert len(strokes) == pytest.approx(180, abs=2)
    assert np.diff(strokes) == pytest.approx(1.0 / 1.5, rel=0.02)


def test_a_counter_that_jitters_and_misses_strokes_changes_no_pressure():
    exact, counted = (
        Pressure(dataclasses.replace(QUIET, pumps=(pump,)), np.zeros((0, 2)), 3)
        for pump in (Pump(1.5), Pump(1.5, counter_jitter_s=0.01, counter_missed=0.05))
    )
    for _ in range(60):
        np.testing.assert_array_equal(exact.block(), counted.block())
    (true,), (seen,) = exact.strokes(), counted.strokes()
    assert 1.0 - len(seen) / len(true) == pytest.approx(0.05, abs=0.02)
    late = seen - true[np.abs(seen[:, None] - true).argmin(axis=1)]
    assert np.std(late) == pytest.approx(0.01, rel=0.1)


def test_no_flow_no_pressure_and_no_pulse():
    channel = dataclasses.replace(QUIET, flow_off_s=((-100.0, 20.0),))
    off = pressure(channel, [(10.0, 10.8)])[:1000]
    assert np.all(off < 1e4)


def test_pumps_of_two_rates_share_the_flow():
    two = dataclasses.replace(QUIET, pumps=(Pump(1.45), Pump(1.52)))
    one = dataclasses.replace(QUIET, pumps=(Pump(1.45),))
    settled = [np.std(pressure(channel, seconds=100.0)[4000:]) for channel in (one, two)]
    assert settled[1] < settled[0]


FREQUENCY = np.array([1.0, 4.0, 12.0, 24.0])


def loss_db(friction):
    """Loss of 3 km of drill pipe."""
    well = WellGeometry()
    line = mud_channel._line(well, 2.0 * np.pi * FREQUENCY, 0.5 * well.bore_m, 0.25 * np.pi * well.bore_m**2, friction)
    return 3000.0 * line[0].real * 20.0 / np.log(10.0)


def test_loss_is_that_of_the_independent_model():
    """20 mPa s, 2.1 GPa, bore 108.6 mm: boundary layer alone, then with 1.6 kPa/m of turbulent friction."""
    # The independent model took another density, to which the boundary layer is sensitive.
    assert loss_db(0.0) == pytest.approx([2.6, 5.3, 9.1, 12.9], rel=0.15)
    assert loss_db(1600.0) == pytest.approx([10.0, 13.0, 17.0, 21.0], abs=0.7)


def test_waves_run_at_korteweg_s_speed():
    assert wave_speed(WellGeometry()) == pytest.approx(1250.0, abs=15.0)
    assert wave_speed(WellGeometry(bulk_modulus=1.0e8)) < 300.0


def test_a_dampener_makes_a_null_between_two_and_two_and_a_half_hertz():
    frequency = np.array([1.0, 2.25, 6.0])
    charged = np.abs(responses(WellGeometry(), frequency)[0])
    assert charged[1] < 0.2 * charged[0]
    assert charged[1] < 0.4 * charged[2]
    flat = np.abs(responses(WellGeometry(precharge=0.0), frequency)[0])
    assert flat[1] > 0.7 * flat[0]


def test_depth_costs_some_decibels_a_kilometre_at_a_few_hertz():
    frequency = np.linspace(3.0, 6.0, 31)
    power = [np.mean(np.abs(responses(WellGeometry(depth_m=depth), frequency)[0]) ** 2) for depth in (3000.0, 5000.0)]
    assert 10.0 * np.log10(power[0] / power[1]) / 2.0 == pytest.approx(4.5, abs=0.6)


def test_pumps_are_quieter_behind_a_charged_dampener():
    frequency = np.array([4.35, 8.7])
    charged, flat = (
        np.abs(responses(dataclasses.replace(WellGeometry(), precharge=p), frequency)[1]) for p in (0.35, 0.0)
    )
    assert np.all(charged < 0.3 * flat)
