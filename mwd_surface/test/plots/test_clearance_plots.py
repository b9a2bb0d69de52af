# SPDX-License-Identifier: Apache-2.0
"""Pictures of clearance: every well named, levels as bands, nearest points marked."""

import numpy as np
import pytest

from mwd_surface.clearance.clearance import Clearance, ClearanceRule
from mwd_surface.plots.clearance_plots import ladder, travelling_cylinder
from mwd_surface.plots.drawing import png

MD = np.arange(0.0, 900.0, 30.0)


def near(name, least):
    distance = least + np.abs(MD - 600.0) / 10.0
    allowed = np.full(MD.size, 12.0)
    away = np.full(MD.size, 0.5)
    return Clearance(name, MD, MD, distance, allowed, distance / allowed, away, away, ClearanceRule())


def test_the_ladder_shows_wells_levels_and_allowed_distances():
    factor, distance = ladder([near("A-3", 9.0), near("A-2", 40.0)]).axes
    assert factor.get_legend_handles_labels()[1] == ["stop, below 1", "warning, below 1.25", "A-3", "A-2"]
    assert len(distance.get_lines()) == 4
    assert factor.get_ylim()[0] > factor.get_ylim()[1]


def test_the_cylinder_marks_the_nearest_point_of_each_well_and_names_depths():
    ax = travelling_cylinder([near("A-3", 9.0), near("A-2", 40.0)]).axes[0]
    marks = [line for line in ax.get_lines() if line.get_marker() == "o"]
    assert [float(mark.get_ydata()[0]) for mark in marks] == [9.0, 40.0]
    assert any(text.get_text() == "600" for text in ax.texts)


@pytest.mark.slow
def test_both_are_pictures():
    for draw in (ladder, travelling_cylinder):
        assert png(draw([near("A-3", 9.0)])).startswith(b"\x89PNG")
