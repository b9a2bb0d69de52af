# SPDX-License-Identifier: Apache-2.0
"""The figures of a report: what is drawn, and the same drawing twice."""

import example_surveys as example
import numpy as np
import pytest

from mwd_surface.exports import report_plots
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.station_quality import totals
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.plan import plan_of

PLAN = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 1.0], [0.0, 1.3, 1.3])


def line(ax, label):
    return next(drawn for drawn in ax.get_lines() if drawn.get_label() == label)


def test_plan_view_and_section_show_stations_plan_bit_and_wellhead():
    table = example.table(plan=PLAN)
    view, section = report_plots.plan_view(table), report_plots.section_view(table)
    ax = view.axes[0]
    survey = line(ax, "survey")
    np.testing.assert_allclose(np.column_stack(survey.get_data()), table.path.positions[:-1, [1, 0]])
    assert line(ax, "bit (projected)").get_xdata()[0] == pytest.approx(table.path.positions[-1, 1])
    assert line(ax, "plan") is not None
    down = section.axes[0]
    np.testing.assert_allclose(line(down, "survey").get_xdata(), table.path.vertical_section[:-1])
    bottom, top = down.get_ylim()
    assert bottom > top


def test_ellipses_are_drawn_around_their_stations():
    ax = report_plots.plan_view(example.table()).axes[0]
    ellipses = [drawn for drawn in ax.get_lines() if drawn.get_color() == "#999999"]
    assert 6 <= len(ellipses) <= 12
    places = example.table().path.positions[:, [1, 0]]
    for drawn in ellipses:
        middle = np.mean(np.column_stack(drawn.get_data())[:-1], axis=0)
        assert np.min(np.linalg.norm(places - middle, axis=1)) < 1e-6


def test_a_list_without_surveys_draws_its_tie_on_alone():
    table = survey_table(SurveyList(), 1)
    assert len(report_plots.plan_view(table).axes) == 1
    assert [one.heading for one in content(table).sections] == ["Definitive survey", "Well path", "Survey programme"]


@pytest.mark.slow
def test_deviations_are_drawn_as_judged_with_their_limits_as_a_band():
    table = example.table()
    axes = report_plots.quality_view(table).axes
    records = sorted((r for r in table.surveys.records if r.in_use), key=lambda r: r.measured_depth)
    np.testing.assert_allclose(
        line(axes[1], "used").get_xdata(), [totals(r.survey)[1].deviation * 1e9 for r in records]
    )
    band = axes[1].collections[0].get_paths()[0].vertices
    assert (band[:, 0].min(), band[:, 0].max()) == pytest.approx((-300.0, 300.0))
    assert report_plots.quality_view(table).legends
