# SPDX-License-Identifier: Apache-2.0
"""Pictures of bags: files of the right kind and size, with the series, titles, units and norths that are promised."""

import functools
import struct
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.plots import bag_plots
from mwd_surface.plots.plot_data import gather
from mwd_surface.plots.traces import WHAT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drawn(run):
    """Makes the data and the picture of what is named, each once."""

    @functools.cache
    def draw(*what):
        with Bag(run[0]) as bag:
            data = gather(bag, what)
        return data, bag_plots.figure(data, what)

    return draw


def axes(picture, title):
    return next(ax for ax in picture.axes if title in ax.get_title(loc="left"))


def test_a_png_has_the_size_of_its_figure_and_an_svg_is_one(drawn):
    _, picture = drawn("sensors")
    png = bag_plots.image(picture, "png")
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", png[16:24])
    assert (width, height) == tuple(int(110 * inches) for inches in picture.get_size_inches())
    assert width == 1375
    root = ElementTree.fromstring(bag_plots.image(picture, "svg"))  # noqa: S314  (written here)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"


def test_the_same_picture_gives_the_same_bytes(drawn):
    _, picture = drawn("sensors")
    for kind in ("png", "svg"):
        assert bag_plots.image(picture, kind) == bag_plots.image(picture, kind)


def test_every_sensor_has_its_panel_with_unit_title_and_legend(drawn):
    data, picture = drawn("sensors")
    assert len(picture.axes) == len(data.panels) == 6
    for panel, ax in zip(data.panels, picture.axes, strict=True):
        assert ax.get_title(loc="left") == panel.title
        assert ax.get_ylabel() == panel.trace.unit
        assert [line.get_label() for line in ax.lines] == list(panel.trace.labels)
        assert [text.get_text() for text in ax.get_legend().get_texts()] == list(panel.trace.labels)
    assert picture.axes[-1].get_xlabel() == "seconds after 06:00:00 UTC"
    assert axes(picture, "imu/data_raw: angular rate").lines[0].get_ydata().max() == pytest.approx(540.0, abs=15.0)


def test_an_attitude_names_its_north_and_is_compared_with_the_truth(drawn):
    _, picture = drawn("attitude")
    azimuth = axes(picture, "azimuth from true north")
    assert [line.get_label() for line in azimuth.lines] == ["estimate", "truth"]
    # Passing north is no jump of a whole turn.
    assert np.ptp(azimuth.lines[1].get_ydata()) < 3.0
    estimate, truth = (line.get_ydata()[-5:] for line in axes(picture, "inclination").lines)
    assert np.nanmean(estimate) == pytest.approx(np.nanmean(truth), abs=0.3)
    assert axes(picture, "1 sigma").get_yscale() == "log"


def test_magnetic_azimuths_are_not_compared_with_the_true_one(drawn):
    data, _ = drawn("attitude")
    panel = next(panel for panel in data.panels if "attitude: azimuth" in panel.title)
    panel.north, before = 1, panel.north
    picture = bag_plots.figure(data, ["attitude"])
    panel.north = before
    assert [line.get_label() for line in axes(picture, "azimuth from magnetic north").lines] == ["estimate"]


def test_depth_runs_down(drawn):
    _, picture = drawn("rig", "truth")
    for title in ("depth along the hole", "depth of the sonde"):
        low, high = axes(picture, title).get_ylim()
        assert low > high


def test_surveys_are_drawn_over_depth_by_their_verdict(drawn):
    data, picture = drawn("surveys")
    inclination = picture.axes[0]
    low, high = inclination.get_ylim()
    assert low > high
    assert inclination.get_ylabel() == "measured depth, m"
    points = {bars.get_label(): len(bars.lines[0].get_xdata()) for bars in inclination.containers}
    assert sum(points.values()) == len(data.surveys) == 12
    assert points["rejected"] == 1
    assert picture.axes[1].get_xlabel() == "azimuth from magnetic north, deg (± 1 sigma)"


def test_spectra_and_allan_plots_have_their_units_and_figures(drawn):
    data, picture = drawn("spectra", "allan")
    force = axes(picture, "imu/data_raw: specific force")
    assert force.get_ylabel() == "m/s²/√Hz"
    assert "averages of" in force.get_xlabel()
    assert len(force.lines) == 3
    gyro = axes(picture, "angular rate, still for")
    assert gyro.get_ylabel() == "Allan deviation, deg/h"
    assert "deg/√h; lowest" in gyro.lines[0].get_label()
    assert len([ax for ax in picture.axes if ax.get_images()]) == 2
    assert len(data.allan) == 4


def test_all_of_it_fits_one_picture_and_remarks_are_printed(drawn):
    data, picture = drawn(*WHAT)
    headings = {text.get_text() for text in picture.texts}
    assert {"Sensors", "Rig", "Truth of the simulator", "Attitude as estimated", "Surveys", "Spectra"} <= headings
    data.remarks.append("something is missing")
    again = bag_plots.figure(data, ["sensors"])
    data.remarks.clear()
    assert "something is missing" in {text.get_text() for text in again.texts}
