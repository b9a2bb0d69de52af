# SPDX-License-Identifier: Apache-2.0
"""A toolface counts after a pause longer than those of stick-slip; how the stream is cut does not change a bit."""

import dataclasses
import itertools

import numpy as np
import pytest

from mwd_estimation.attitude import toolface_dwell
from mwd_estimation.attitude.toolface_dwell import DwellParams
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import ROTATING_ABOVE, Track
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

PERIOD = 0.01
ROTATING, UNSETTLED = int(Status.ROTATING), int(Status.TOOLFACE_UNSETTLED)


def track_of(speed):
    track = Track.empty(len(speed))
    track.rotary_speed[:] = speed
    track.status[:] = np.where(np.abs(speed) > ROTATING_ABOVE, ROTATING, 0)
    return track


def settled(speed, cuts=()):
    """Whether the toolface counts at each sample, for a rotary speed, rad/s, at each."""
    stamps = 10**18 + np.arange(len(speed)) * round(PERIOD * 1e9)
    track, state = track_of(speed), np.zeros(1, toolface_dwell.RECORD)
    for a, b in itertools.pairwise([0, *cuts, len(speed)]):
        toolface_dwell.run(DwellParams(), state, stamps[a:b], track.part(slice(a, b)))
    return track.status & UNSETTLED == 0


def pauses(turn_s, pause_s, cycles, speed=12.0):
    one = np.r_[np.full(round(turn_s / PERIOD), speed), np.zeros(round(pause_s / PERIOD))]
    return np.tile(one, cycles)


@pytest.mark.parametrize(("turn_s", "pause_s"), [(1.0, 2.0), (3.0, 4.0), (2.0, 4.9), (0.8, 0.7)])
def test_the_pauses_of_stick_slip_give_no_toolface(turn_s, pause_s):
    assert not settled(pauses(turn_s, pause_s, 30)).any()


@pytest.mark.parametrize("pause_s", [8.0, 15.0])
def test_pauses_longer_than_the_dwell_count_once_and_are_known_then(pause_s):
    got = settled(pauses(3.0, pause_s, 20))
    cycle = round((3.0 + pause_s) / PERIOD)
    # The second cycle shows how long a cycle is.
    assert got[:cycle].any()
    assert not got[2 * cycle :].any()


def test_after_rotation_a_slide_has_a_toolface_behind_the_dwell():
    got = settled(np.r_[np.full(6000, 12.0), np.zeros(3000)])
    assert np.flatnonzero(got)[0] == pytest.approx(6000 + 5.0 / PERIOD, abs=2)
    assert got[-2400:].all()


def test_a_string_that_never_turned_has_a_toolface_at_once():
    assert settled(np.zeros(10)).all()


def test_orienting_by_less_than_a_turn_at_a_time_does_not_lengthen_the_dwell():
    got = settled(np.r_[pauses(0.4, 8.0, 20), np.zeros(100)])
    assert got[-200:].all()


def test_a_cycle_is_forgotten_after_minutes_of_even_rotation():
    slip = pauses(3.0, 15.0, 5)
    even = np.full(round(3 * toolface_dwell.MEMORY / PERIOD), 12.0)
    got = settled(np.r_[slip, even, np.zeros(1000)])
    assert got[-400:].all()
    assert not settled(np.r_[slip, np.full(500, 12.0), np.zeros(1000)])[-1000:].any()


def test_the_cut_of_the_stream_changes_nothing():
    speed = np.r_[pauses(3.0, 4.0, 3), pauses(2.0, 12.0, 3), np.zeros(2000)]
    assert (settled(speed, cuts=(1, 2, 777, 778, 2500)) == settled(speed)).all()


@pytest.mark.slow(4)
@pytest.mark.parametrize(("frequency_hz", "depth", "rpm"), [(0.1, 1.6, 60.0), (0.15, 1.6, 60.0), (0.3, 1.3, 60.0)])
def test_a_simulated_string_that_sticks_below_a_steady_top_drive_gives_no_toolface(frequency_hz, depth, rpm):
    stick_slip = scenario.read(SCENARIOS / "bench" / "stickslip.yaml")
    vibration = stick_slip.vibration
    slip = dataclasses.replace(vibration.stick_slip, frequency_hz=frequency_hz, depth=depth, sticky=True)
    drill = dataclasses.replace(stick_slip.schedule[0], seconds=60.0, rpm=rpm)
    run = dataclasses.replace(stick_slip, schedule=(drill,), vibration=dataclasses.replace(vibration, stick_slip=slip))
    pipeline = Pipeline(EstimatorSettings())
    blocks = Sonde(run).blocks(1.0)
    status = np.concatenate([pipeline.push_imu(block["imu/data_raw"]).attitude["status"] for block in blocks])[300:]
    assert (status & ROTATING == 0).mean() > 0.02
    assert (status & UNSETTLED != 0).all()
