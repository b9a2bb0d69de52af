# SPDX-License-Identifier: Apache-2.0
"""Two surveys of one hole: a list against itself, against a turned one, and in units of its sigma."""

import math

import numpy as np
import pytest

from mwd_surface.exports.csv_tables import comparison_csv
from mwd_surface.list_files.list_file import list_of
from mwd_surface.plots.path_plots import figure_of
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.trajectory.list_comparison import difference


def path(*rows, north="true"):
    text = f"md_m,inc,azi_{north}\n" + "".join(f"{md},{inc},{azi}\n" for md, inc, azi in rows)
    return survey_list(list_of(text.encode())).definitive()


STRAIGHT = ((0, 30, 10), (100, 30, 10), (200, 30, 10), (300, 30, 10))


def test_the_same_hole_at_other_stations_is_the_same_hole():
    found = difference(path(*STRAIGHT), path((0, 30, 10), (250, 30, 10)))
    assert found.md.tolist() == [0.0, 100.0, 200.0]
    np.testing.assert_allclose(found.position, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.turn, 0.0, atol=1e-12)


@pytest.mark.slow
def test_an_azimuth_error_moves_the_end_across_and_counts_in_sigmas():
    turned = path(*((md, inc, azi + 359.0) for md, inc, azi in ((0, 30, 1), (150, 30, 1), (300, 30, 1))))
    cov = np.zeros((4, 3, 3)) + np.eye(3) * (np.array([0.0, 100.0, 200.0, 300.0]) / 100.0)[:, None, None]
    found = difference(path(*((md, inc, 1.0) for md, inc, _ in STRAIGHT)), turned, (cov, cov[:3]))
    np.testing.assert_allclose(np.degrees(found.turn[:, 1]), 1.0)
    assert found.distance[-1] == pytest.approx(300.0 * math.sin(math.radians(30.0)) * math.radians(1.0), rel=1e-3)
    # 300 m of the first covariance, the last of the second one: sigma^2 of 3 and of 2 m^2.
    assert found.sigmas[-1] == pytest.approx(found.distance[-1] / math.sqrt(5.0))
    assert math.isnan(found.sigmas[0])
    lines = comparison_csv(found).splitlines()
    assert len(lines) == 5
    assert lines[1].endswith(",0.000000,0.000000,0.000000,")
    upper, lower = figure_of(found, "mwd", "gyro").axes
    np.testing.assert_allclose(upper.lines[1].get_ydata(), 0.5, atol=1e-3)
    np.testing.assert_allclose(lower.lines[0].get_ydata(), found.position[:, 0])


def test_lists_that_cannot_be_compared_say_why():
    with pytest.raises(ValueError, match=r"no depth in common: 0\.0 to 300\.0 m and 400\.0 to 500\.0 m"):
        difference(path(*STRAIGHT), _from(400.0))
    with pytest.raises(ValueError, match="from true north, the second from grid"):
        difference(path(*STRAIGHT), path(*STRAIGHT, north="grid"))


def _from(md):
    # A hole from the wellhead does not reach this place: the path starts at its first station.
    text = f"md_m,inc,azi_true,tvd_m,north_m,east_m\n{md},0,0,{md},{md},0\n{md + 100},0,0,{md + 100},{md},0\n"
    return survey_list(list_of(text.encode())).definitive()
