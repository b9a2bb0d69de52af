# SPDX-License-Identifier: Apache-2.0
"""Position covariance against the published ISCWSA example well, its axes, its ellipses and its words."""

import csv
import dataclasses
import json
import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_surface.uncertainty.error_terms import CovarianceUnavailableError, ErrorReference, ErrorTool, error_terms
from mwd_surface.uncertainty.position_covariance import covariance_of, ellipse, in_section, position_covariance
from project import REFERENCE_DATA

AUTHORITIES = REFERENCE_DATA / "authorities"
REFERENCE = ErrorReference(math.radians(60), 50e-6, math.radians(72), math.radians(-4), math.radians(1.5), 9.80665)
MODEL = "ISCWSA MWD Rev5.11"


def rows(name):
    with (AUTHORITIES / name).open() as file:
        return list(csv.DictReader(file))


def well_1():
    stations = rows("well1_stations.csv")
    md, inc, azi = (np.array([float(r[k]) for r in stations]) for k in ("md_m", "inc_deg", "azi_true_deg"))
    return md, np.radians(inc), np.radians(azi)


def test_the_iscwsa_example_well_is_reproduced_at_every_station():
    """
    ISCWSA example well 1, MWD revision 5: 268 stations, six elements, printed to 1e-6 m^2.

    The example prints azimuth 0 in its vertical part and takes its errors there along that north, though the hole
    leaves the vertical at 75 deg. The error model is therefore summed at the azimuths as they are printed.
    """
    with (AUTHORITIES / "well1_header.json").open() as file:
        header = json.load(file)
    assert (header["Btotal (nT)"], header["Dip (deg)"], header["Declination (deg)"]) == (50000, 72, -4)
    md, inc, azi = well_1()
    got = covariance_of(error_terms((md, inc, azi), [ErrorTool(MODEL)] * md.size, REFERENCE), md.size)
    pairs = {"NN": (0, 0), "EE": (1, 1), "VV": (2, 2), "NE": (0, 1), "NV": (0, 2), "EV": (1, 2)}
    published = rows("well1_total_cov_nev.csv")
    # The first station's vertical is the depth reference alone, DRFR^2, in newer issues of the model.
    assert got[0, 2, 2] == pytest.approx(0.35**2)
    for name, (i, j) in pairs.items():
        want = np.array([float(r[name]) for r in published])[1:]
        np.testing.assert_allclose(got[1:, i, j], want, rtol=3e-7, atol=3e-5, err_msg=name)


def test_the_example_well_is_as_published_down_to_its_kick_off_and_at_most_one_percent_larger_below():
    """Below, the errors of the vertical part point along the hole that follows, not to the example's printed north."""
    published = rows("well1_total_cov_nev.csv")
    got = position_covariance(*well_1(), North.TRUE, MODEL, REFERENCE)
    vertical = int(np.sum(well_1()[1] == 0.0))
    for name, k in (("NN", 0), ("EE", 1), ("VV", 2)):
        want = np.array([float(r[name]) for r in published])
        np.testing.assert_allclose(got[1 : vertical - 1, k, k], want[1 : vertical - 1], rtol=3e-7, atol=3e-5)
    trace = np.array([sum(float(r[name]) for name in ("NN", "EE", "VV")) for r in published])[1:]
    ratio = np.sqrt(np.trace(got[1:], axis1=1, axis2=2) / trace)
    assert ratio.min() > 0.999
    assert ratio.max() < 1.01


def test_ellipses_turn_with_the_north_of_the_axes():
    md, inc, azi = well_1()
    true = position_covariance(md, inc, azi, North.TRUE, MODEL, REFERENCE)[-1]
    grid = position_covariance(md, inc, azi - REFERENCE.convergence, North.GRID, MODEL, REFERENCE)[-1]
    magnetic = position_covariance(md, inc, azi - REFERENCE.declination, North.MAGNETIC, MODEL, REFERENCE)[-1]
    for other, turn in ((grid, REFERENCE.convergence), (magnetic, REFERENCE.declination)):
        a, b = ellipse(true[:2, :2]), ellipse(other[:2, :2])
        assert (b.major, b.minor) == pytest.approx((a.major, a.minor))
        assert b.angle == pytest.approx(a.angle - turn, abs=1e-6)
        assert other[2, 2] == pytest.approx(true[2, 2])


@given(st.floats(0.1, 30.0), st.floats(0.1, 1.0), st.floats(0.0, math.pi - 1e-6), st.floats(0.5, 3.0))
def test_an_ellipse_gives_back_the_axes_it_was_made_of(major, ratio, angle, sigmas):
    minor = major * ratio * 0.99
    mat = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    cov = mat @ np.diag([major**2, minor**2]) @ mat.T
    got = ellipse(cov, sigmas)
    assert (got.major, got.minor) == pytest.approx((sigmas * major, sigmas * minor))
    assert math.cos(2 * (got.angle - angle)) == pytest.approx(1.0, abs=1e-6)
    assert ellipse([[1.0, 1e-12], [1e-12, 1.0]]).angle == 0.0
    outline = got.outline()
    radii = np.einsum("ni,ij,nj->n", outline, np.linalg.inv(cov), outline)
    np.testing.assert_allclose(radii, sigmas**2, rtol=1e-6)


def test_a_covariance_is_cut_along_the_section():
    cov = np.diag([1.0, 4.0, 9.0])
    np.testing.assert_allclose(in_section(cov, math.pi / 2), [[4.0, 0.0], [0.0, 9.0]], atol=1e-15)
    assert in_section(np.array([cov, cov]), 0.3).shape == (2, 2, 2)


def test_what_has_no_model_is_reported():
    stations = ([0.0, 30.0], [0.0, 0.1], [0.0, 0.0])
    with pytest.raises(ValueError, match=r"no tool code 'MWD\+SRGN'; did you mean MWD\+SRGM"):
        position_covariance(*stations, North.TRUE, "MWD+SRGN", REFERENCE)
    with pytest.raises(ValueError, match="unknown north"):
        position_covariance(*stations, North.UNKNOWN, MODEL, REFERENCE)
    with pytest.raises(ValueError, match="totals must be positive"):
        position_covariance(*stations, North.TRUE, MODEL, dataclasses.replace(REFERENCE, b_total=math.nan))
    with pytest.raises(ValueError, match="grid north need the convergence"):
        position_covariance(*stations, North.GRID, MODEL, dataclasses.replace(REFERENCE, convergence=math.nan))
    with pytest.raises(ValueError, match="expected a finite 2 x 2 matrix"):
        ellipse(np.eye(3))


def test_one_station_is_where_it_is():
    assert not position_covariance([0.0], [0.0], [0.0], North.TRUE, MODEL, REFERENCE).any()


@pytest.mark.parametrize("model", ["MWD+SRGM", "MWD+IFR2+SAG+MS", "GYRO-NS", "ISCWSA MWD Rev4"])
def test_tool_codes_give_positive_definite_covariances(model):
    md = np.arange(0.0, 1500.0, 30.0)
    inc, azi = np.clip((md - 300) / 900, 0.0, 1.2), np.full(md.size, 1.0)
    got = position_covariance(md, inc, azi, North.TRUE, model, REFERENCE)
    assert np.all(np.linalg.eigvalsh(got[1:]) > 0.0)


def test_without_the_library_the_message_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "welleng.error", None)
    with pytest.raises(CovarianceUnavailableError, match="pip install welleng"):
        position_covariance([0.0, 30.0], [0.0, 0.1], [0.0, 0.0], North.TRUE, MODEL, REFERENCE)


@pytest.mark.parametrize("model", ["MWD+SRGM", MODEL])
def test_two_stations_are_as_uncertain_as_in_a_longer_well(model):
    md, inc, azi = np.array([0.0, 30.0, 60.0]), np.radians([20.0, 24.0, 24.0]), np.radians([40.0, 44.0, 44.0])
    three = position_covariance(md, inc, azi, North.GRID, model, REFERENCE)
    two = position_covariance(md[:2], inc[:2], azi[:2], North.GRID, model, REFERENCE)
    assert two.shape == (2, 3, 3)
    np.testing.assert_allclose(two, three[:2], rtol=1e-9)
