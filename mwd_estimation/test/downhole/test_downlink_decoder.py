# SPDX-License-Identifier: Apache-2.0
"""Commands found in rotation and flow: through stick-slip, however the samples are cut, and in nothing else."""

import math

import numpy as np
import pytest

from mwd_estimation.downhole.commands import DownlinkDecoder
from mwd_sensors.simulator.schedule import Rig, SchedulePhase, timeline
from mwd_sensors.simulator.steering import ROTATE, Steering, SteeringCommand, String
from mwd_sensors.telemetry.downlink import FLOW, Downlink, DownlinkFrame, programme

RPM = math.pi / 30.0
START = 1_700_000_000_000_000_000
ROTATION = Downlink()
PUMPS = Downlink(medium=FLOW, ramp_s=8.0, hold_s=8.0, depth=0.2, least=0.01)


def sent(frame, downlink, base, rate=20.0, before=60.0, after=60.0):
    """Times and set-points of a command between spans of drilling."""
    ordered = programme(frame, downlink)
    time = np.arange(0.0, before + ordered.duration_s + after, 1.0 / rate)
    return time, base * np.array([ordered.at(at - before) for at in time])


def stamps(time):
    return START + np.round(time * 1e9).astype(np.int64)


def stick_slip(frames, rpm, rate=500, seed=1):
    """Times and rotation of the tool below a string that sticks and slips while commands are sent."""
    ordered = [programme(frame, ROTATION) for frame in frames]
    seconds = 60.0 + sum(one.duration_s + 60.0 for one in ordered)
    line = timeline((SchedulePhase(seconds=seconds + 60.0, rpm=rpm),), Rig(), 1000.0, (), np.random.default_rng(seed))
    string = String(Steering(), line, 0.3, rate, np.random.default_rng(seed + 1))
    shares = [1.0] * 300
    for one in ordered:
        shares += [one.at(0.2 * k) for k in range(math.ceil(one.duration_s / 0.2))] + [1.0] * 300
    turned, count = [], round(0.2 * rate)
    for k, share in enumerate(shares):
        string.command(SteeringCommand(ROTATE, rpm * share * RPM, valid_for=1.0))
        turned.append(string.advance(k * count, count)[0][1])
    rotation = np.concatenate(turned)[::5]
    return np.arange(len(rotation)) * 5.0 / rate, rotation


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [80.0, 130.0])
def test_commands_come_through_full_stick_slip(rpm):
    random = np.random.default_rng(3)
    frames = [DownlinkFrame(k % 7 + 1, int(random.integers(6)), int(random.integers(16))) for k in range(6)]
    time, rotation = stick_slip(frames, rpm)
    last = rotation[len(rotation) // 2 :]
    assert last.min() < 0.1 * rpm * RPM
    assert last.max() > 1.7 * rpm * RPM
    found = DownlinkDecoder(ROTATION).push(stamps(time), rotation)
    assert [one.frame for one in found] == frames


@pytest.mark.parametrize(("downlink", "base", "noise"), [(ROTATION, 12.0, 0.5), (PUMPS, 0.033, 2e-4)])
def test_the_stamp_is_the_end_of_the_command_and_does_not_depend_on_the_blocks(downlink, base, noise):
    random = np.random.default_rng(1)
    frame = DownlinkFrame(3, 1, 9)
    time, signal = sent(frame, downlink, base)
    signal = signal + noise * random.standard_normal(len(signal))
    whole = DownlinkDecoder(downlink).push(stamps(time), signal)
    assert [one.frame for one in whole] == [frame]
    end = 60.0 + programme(frame, downlink).duration_s
    assert (whole[0].stamp_ns - START) * 1e-9 == pytest.approx(end, abs=0.5 * downlink.ramp_s)
    decoder, cut = DownlinkDecoder(downlink), []
    for part in np.split(np.arange(len(time)), np.sort(random.integers(0, len(time), 400))):
        cut += decoder.push(stamps(time[part]), signal[part])
    assert cut == whole


def test_a_sample_that_is_not_finite_and_a_short_gap_do_no_harm_and_a_long_one_breaks_the_command():
    frame = DownlinkFrame(1, 4, 0)
    time, signal = sent(frame, ROTATION, 12.0)
    signal[::7] = np.nan
    short = (time < 130.0) | (time > 131.5)
    assert [one.frame for one in DownlinkDecoder(ROTATION).push(stamps(time[short]), signal[short])] == [frame]
    long = (time < 130.0) | (time > 140.0)
    assert DownlinkDecoder(ROTATION).push(stamps(time[long]), signal[long]) == []


def test_a_drop_that_is_not_the_one_agreed_is_no_command():
    time, signal = sent(DownlinkFrame(1, 4, 0), ROTATION, 12.0)
    shallow = 12.0 + 0.4 * (signal - 12.0)
    assert DownlinkDecoder(ROTATION).push(stamps(time), shallow) == []
    assert DownlinkDecoder(ROTATION).push(stamps(time), 0.2 * signal) == []


def drilled(hours, seed, full, rate=5.0):
    """Rotation or flow of a driller who changes it every half a minute on average, and stops for connections."""
    random = np.random.default_rng(seed)
    values, value = [], 0.0
    while len(values) < hours * 3600.0 * rate:
        wanted = float(random.choice([0.0, full, full * random.uniform(0.5, 1.0)], p=[0.15, 0.35, 0.5]))
        ramp = np.linspace(value, wanted, max(round(random.uniform(1.0, 10.0) * rate), 1))
        values += [*ramp, *([wanted] * round(random.exponential(25.0) * rate))]
        value = wanted
    signal = np.array(values)
    time = np.arange(len(signal)) / rate
    return time, signal * (1.0 + random.uniform(0.0, 0.9) * np.sin(2.0 * math.pi * 0.17 * time))


@pytest.mark.slow
@pytest.mark.parametrize(("downlink", "full"), [(ROTATION, 13.0), (PUMPS, 0.033)])
def test_a_restless_driller_sends_no_command(downlink, full):
    for seed in range(5):
        time, signal = drilled(2.0, seed, full)
        assert DownlinkDecoder(downlink).push(stamps(time), signal) == []
