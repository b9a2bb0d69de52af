# SPDX-License-Identifier: Apache-2.0
"""What is gathered for a picture: everything a bag has, in bounded memory, and a sentence where there is nothing."""

import numpy as np
import plotted_bag
import pytest

from mwd_sensors.core import wire
from mwd_sensors.core.settings import from_mapping
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.plots.plot_data import gather
from mwd_surface.plots.traces import WHAT
from mwd_surface.processing.bag_input import InputSettings


def gathered(path, *what, topics=(), bins=1600, **given):
    with Bag(path) as bag:
        return gather(bag, what, from_mapping(InputSettings, given), topics, bins)


@pytest.mark.slow
def test_everything_a_bag_has_is_found(run):
    path, sonde = run
    data = gathered(path, *WHAT)
    titles = [panel.title for panel in data.panels]
    assert len(titles) == 6 + 4 + 9 + 4 + 2 + 1
    assert "/w1/attitude: azimuth from true north" in titles
    assert [(item.topic, item.quantity) for item in data.spectra] == [
        ("/w1/imu/data_raw", "angular rate"),
        ("/w1/imu/data_raw", "specific force"),
        ("/w1/imu/mag", "magnetic field"),
        ("/w1/gyro/data_raw", "angular rate"),
        ("/w1/gyro/data_raw", "specific force"),
    ]
    assert len(data.allan) == 4
    assert len(data.surveys) == 12
    assert all(depth > 0.0 for _, depth in data.surveys)
    assert data.seconds == pytest.approx(sonde.duration, abs=0.02)
    assert not data.remarks


def test_envelopes_hold_the_extremes_of_the_samples(run):
    path, sonde = run
    panel = next(p for p in gathered(path, "sensors", bins=100).panels if p.title == "/w1/imu/data_raw: specific force")
    with Bag(path) as bag:
        force = np.concatenate(
            [b["/w1/imu/data_raw"][1]["linear_acceleration"] for b in bag.blocks(["/w1/imu/data_raw"])]
        )
    for axis in range(3):
        line = panel.envelope.line(axis)[1]
        assert len(line) <= 200
        assert (np.nanmin(line), np.nanmax(line)) == (force[:, axis].min(), force[:, axis].max())
    assert panel.envelope.samples == len(force) == round(sonde.duration * 100)


def test_the_allan_deviation_is_that_of_the_still_interval_and_shows_the_grade(run):
    path, _ = run
    gyro = next(item for item in gathered(path, "allan").allan if item.topic == "/w1/imu/data_raw")
    assert gyro.start_s < 1.0
    assert 12.5 < gyro.seconds < 15.5
    # White noise of the grade: 0.007 deg/s/sqrt(Hz), at the averaging time of one sample.
    assert gyro.curve.tau[0] == pytest.approx(0.01)
    np.testing.assert_allclose(np.degrees(gyro.curve.deviation[0]) * 0.1, 0.007, rtol=0.1)


def test_a_span_and_topics_can_be_chosen(run):
    path, _ = run
    data = gathered(path, "sensors", start_s=5.0, end_s=8.0, topics=["w1/imu/mag"])
    assert [panel.title for panel in data.panels] == ["/w1/imu/mag: magnetic field"]
    assert data.seconds == pytest.approx(3.0)
    assert data.panels[0].envelope.exact
    assert data.panels[0].envelope.samples == pytest.approx(300, abs=1)


@pytest.mark.slow
def test_a_bag_without_magnetometer_truth_or_estimate_is_drawn_as_far_as_it_goes(tmp_path):
    plotted_bag.record(tmp_path / "b", ("imu/data_raw",), estimate=False, surveys=False, namespace="/")
    data = gathered(tmp_path / "b", *WHAT)
    assert [panel.title for panel in data.panels] == ["/imu/data_raw: angular rate", "/imu/data_raw: specific force"]
    assert len(data.spectra) == len(data.allan) == 2


def test_a_run_without_rest_says_so_instead_of_an_allan_plot(run):
    path, _ = run
    data = gathered(path, "sensors", "allan", start_s=17.0, end_s=25.0)
    assert not data.allan
    assert data.remarks[0] == "/w1/imu/data_raw has no still interval of 10 s for an Allan deviation"


@pytest.mark.parametrize(
    ("what", "options", "sentence"),
    [
        (("sensor",), {}, "use one of sensors"),
        (("sensors",), {"start_s": 500.0}, "the recording ends after"),
        (("sensors",), {"topics": ["imu/dta"]}, "has no topic imu/dta; it has /w1/imu/data_raw"),
        (("surveys",), {"topics": ["/w1/imu/mag"]}, "has nothing to draw for surveys; it has /w1/imu/data_raw"),
        (("allan",), {"start_s": 17.0, "end_s": 25.0}, "no still interval"),
    ],
)
def test_what_cannot_be_drawn_is_reported(run, what, options, sentence):
    path, _ = run
    with pytest.raises((ValueError, BagError), match=sentence):
        gathered(path, *what, **options)


def test_stamps_of_another_clock_are_drawn_at_the_time_of_recording(tmp_path):
    samples = wire.IMU.empty(1000)
    samples["stamp_ns"] = np.arange(1, 1001) * 10_000_000
    log_ns = samples["stamp_ns"] + 1_700_000_000 * wire.NANOSECONDS
    with BagWriter(tmp_path / "b") as bag:
        bag.write_rows(bag.topic("/imu/data_raw", wire.IMU.type_name), wire.IMU.encode(samples, "imu"), log_ns)
    data = gathered(tmp_path / "b", "sensors")
    assert data.panels[0].envelope.samples == 1000
    assert data.panels[0].envelope.line(0)[0][-1] == pytest.approx(9.99)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_recording(tmp_path):
    # Ten hours of an IMU at one sample a second: the picture holds no more than its columns.
    samples = wire.IMU.empty(36_000)
    samples["stamp_ns"] = np.arange(36_000, dtype=np.int64) * wire.NANOSECONDS + 1_700_000_000 * wire.NANOSECONDS
    samples["linear_acceleration"][20_000] = 500.0
    with BagWriter(tmp_path / "b") as bag:
        channel = bag.topic("/imu/data_raw", wire.IMU.type_name)
        bag.write_rows(channel, wire.IMU.encode(samples, "imu"), samples["stamp_ns"])
    data = gathered(tmp_path / "b", "sensors", "spectra", bins=300)
    seconds, line = data.panels[1].envelope.line(0)
    assert len(line) <= 600
    assert np.nanmax(line) == 500.0
    assert seconds[np.nanargmax(line)] == pytest.approx(20_000.0, abs=120.0)
    assert data.spectra[0].spectrum.waterfall.size <= 240 * 9 * 3
