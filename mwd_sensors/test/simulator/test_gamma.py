# SPDX-License-Identifier: Apache-2.0
"""Gamma detector of the simulator: Poisson counts with dead time, formation by depth, sensitivity by direction."""

import math

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.simulator.gamma import Gamma, GammaDetector, _vertical
from mwd_sensors.simulator.motion import well_path
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from simulated_sonde import samples_of

HORIZONTAL = well_path([0.0, 500.0], [0.0, math.pi / 2.0], [0.0, 0.0])
TVD = 500.0 * 2.0 / math.pi


def counted(api, seconds=2000, rate_hz=100, **settings):
    detector = GammaDetector(Gamma(formation=((0.0, api),), **settings), HORIZONTAL, np.random.default_rng(11))
    index = np.arange(1, seconds * rate_hz + 1)
    samples, picked = detector.samples(index, index, np.zeros(len(index)), np.full(len(index), 900.0), rate_hz)
    assert picked.sum() == len(samples)
    return samples


@pytest.mark.slow
def test_counts_are_a_poisson_process_where_the_dead_time_is_short():
    samples = counted(90.0, dead_time_us=0.0)
    expected = 90.0 / 1.5 * 0.04
    mean, variance = samples["counts"].mean(), samples["counts"].var()
    spread = math.sqrt(expected / len(samples))
    assert mean == pytest.approx(expected, abs=4.0 * spread)
    assert variance == pytest.approx(expected, rel=4.0 * math.sqrt(2.0 / len(samples)))


@pytest.mark.parametrize("dead_time_us", [200.0, 2000.0])
def test_the_dead_time_follows_the_non_paralysable_model(dead_time_us):
    """m = n / (1 + n tau), and a renewal process has less scatter: variance m (1 + n tau)^-2 per interval."""
    api, tau = 600.0, dead_time_us * 1e-6
    samples = counted(api, seconds=1000, dead_time_us=dead_time_us)
    rate = api / 1.5
    expected = rate / (1.0 + rate * tau)
    total = samples["counts"].sum() / samples["duration"].sum()
    assert total == pytest.approx(expected, rel=0.01)
    seconds = samples["counts"].reshape(-1, 25).sum(axis=1)
    assert seconds.var() == pytest.approx(expected / (1.0 + rate * tau) ** 2, rel=0.2)


def test_the_layer_is_that_of_the_depth_of_the_detector():
    by_md = GammaDetector(Gamma(formation=((0.0, 20.0), (700.0, 140.0)), by="md"), HORIZONTAL, None)
    assert by_md.expected([690.0, 710.0], [0.0, 0.0]) == pytest.approx([20.0, 140.0])
    vertical = GammaDetector(Gamma(formation=((0.0, 20.0), (300.0, 140.0))), well_path([0.0], [0.0], [0.0]), None)
    assert vertical.expected([290.0, 310.0], [0.0, 2.0]) == pytest.approx([20.0, 140.0])


def test_on_the_boundary_of_a_horizontal_bed_up_and_down_see_the_two_rocks():
    layers = ((0.0, 120.0), (TVD, 20.0))
    detector = GammaDetector(Gamma(formation=layers, leak=0.0), HORIZONTAL, None)
    around = np.radians([0.0, 90.0, 180.0, 270.0])
    up, right, down, left = detector.expected(np.full(4, 900.0), around)
    # Share of the lobe (1 + cos)^2 / 4 within a right angle of the window: (3 pi / 2 + 4) / (3 pi).
    share = (1.5 * math.pi + 4.0) / (3.0 * math.pi)
    assert up == pytest.approx(20.0 + 100.0 * share, abs=0.5)
    assert down == pytest.approx(120.0 - 100.0 * share, abs=0.5)
    assert right == pytest.approx(left)
    assert right == pytest.approx(70.0, abs=1.0)
    # The mean over the window's direction is the mean of the rock around: the sensitivity is normalised.
    many = math.tau / 48.0 * np.arange(48)
    assert detector.expected(np.full(48, 900.0), many).mean() == pytest.approx(70.0, abs=1.0)
    bare = GammaDetector(Gamma(formation=layers, leak=1.0), HORIZONTAL, None)
    assert np.ptp(bare.expected(np.full(4, 900.0), around)) < 1e-9


def test_without_contrast_the_direction_means_nothing():
    detector = GammaDetector(Gamma(formation=((0.0, 77.0),)), HORIZONTAL, None)
    assert detector.expected([100.0, 400.0, 900.0], [0.3, 2.0, 5.0]) == pytest.approx(77.0)


def test_the_vertical_depth_of_the_hole_is_that_of_the_motion():
    path = well_path([0.0, 300.0, 600.0], [0.0, 0.7, 1.6], [0.2, 0.2, 0.9])
    md = np.array([0.0, 150.0, 300.0, 444.0, 600.0, 700.0])
    tvd, cosine = _vertical(path, md)
    ahead, _ = _vertical(path, md + 1e-4)
    assert (ahead - tvd) / 1e-4 == pytest.approx(cosine, abs=1e-4)
    assert cosine[[2, 4]] == pytest.approx(np.cos([0.7, 1.6]))


SCENARIO = """
name: g
precision: null
gamma: {formation: [[0.0, 80.0]], sensor_to_bit_m: 5.0}
schedule:
  - {kind: drill, seconds: 6.0, rpm: 60.0, rop_m_h: 100.0}
"""


@pytest.mark.slow
def test_the_counts_of_a_run_do_not_depend_on_the_blocks_and_do_not_disturb_the_other_sensors():
    one, other = (samples_of(Sonde(parse(SCENARIO)), block_s=seconds) for seconds in (0.1, 2.7))
    assert one[wire.GAMMA_TOPIC].tobytes() == other[wire.GAMMA_TOPIC].tobytes()
    assert len(one[wire.GAMMA_TOPIC]) == 150
    assert one[wire.GAMMA_TOPIC]["sensor_to_bit"][0] == 5.0
    bare = "\n".join(line for line in SCENARIO.splitlines() if not line.startswith("gamma"))
    without = samples_of(Sonde(parse(bare)))
    assert wire.GAMMA_TOPIC not in without
    for topic in wire.SONDE_TOPICS:
        assert one[topic].tobytes() == without[topic].tobytes()


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("gamma: {formation: []}", "formation"),
        ("gamma: {formation: [[5.0, 1.0], [5.0, 2.0]]}", "rise"),
        ("gamma: {formation: [[0.0, -1.0]]}", "within 0 and 5000"),
        ("gamma: {formatoin: [[0.0, 1.0]]}", "did you mean formation"),
    ],
)
def test_a_wrong_formation_is_refused_by_name(line, named):
    with pytest.raises(SettingsError, match=named):
        parse(f"name: g\n{line}\n")
