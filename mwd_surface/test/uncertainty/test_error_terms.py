# SPDX-License-Identifier: Apache-2.0
"""Error terms of tool codes: the library's own sums, tools that follow each other, wells drawn from the terms."""

import math

import numpy as np
import pytest

from consistency import assert_consistent
from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.uncertainty.error_terms import (
    RANDOM,
    ErrorReference,
    ErrorTool,
    check_tool_code,
    error_terms,
    tool_codes,
)
from mwd_surface.uncertainty.position_covariance import (
    StationErrors,
    covariance_of,
    position_covariance,
    shared_shifts,
    well_terms,
)

REFERENCE = ErrorReference(math.radians(60), 50e-6, math.radians(72), math.radians(-4), math.radians(1.5), 9.80665)
MD = np.arange(0.0, 2400.0, 30.0)
# Builds, drops below the start of a continuous gyro and builds again.
INC = np.interp(MD, [0, 300, 900, 1400, 1700, 2400], np.radians([0, 0, 40, 8, 25, 60]))
AZI = np.radians(30.0 + MD / 50.0)


def by_library(code, md=MD, inc=INC, azi=AZI):
    from welleng.survey import Survey, SurveyHeader

    header = SurveyHeader(
        latitude=60.0,
        longitude=0.0,
        altitude=0.0,
        survey_date="2026-01-01",
        G=REFERENCE.g_total,
        b_total=50000.0,
        dip=72.0,
        declination=-4.0,
        convergence=0.0,
        azi_reference="true",
    )
    return Survey(md=md, inc=np.degrees(inc), azi=np.degrees(azi), header=header, error_model=code).cov_nev


@pytest.mark.parametrize("code", ["MWD+SRGM", "MWD+IFR2+SAG+MS", "EMS+SRGM+AX", "BLIND", "GYRO-NS-CT", "GYRO-MWD"])
def test_one_tool_gives_the_sums_of_the_library(code):
    """Where no station is next to the vertical: there the library has weights of its own, some of them wrong."""
    inc = np.maximum(INC, math.radians(0.5))
    got = position_covariance(MD, inc, AZI, North.TRUE, code, REFERENCE)
    np.testing.assert_allclose(got, by_library(code, inc=inc), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_set_b_is_known_and_lies_between_the_field_models_of_set_a():
    codes = tool_codes()
    assert {"MWD+HRGM+SAG+MS", "MWD+LRGM", "EMS+IFR1+SAG", "GYRO-NS", "MWD+IFR1+AX"} <= set(codes)
    sigma = [
        np.linalg.det(position_covariance(MD, INC, AZI, North.TRUE, code, REFERENCE)[-1, :2, :2])
        for code in ("MWD+IFR1+SAG", "MWD+HRGM+SAG", "MWD+LRGM+SAG")
    ]
    assert sigma == sorted(sigma)
    for code in codes:
        check_tool_code(code)


def test_a_new_run_of_the_same_tool_makes_the_well_better_known_but_keeps_what_runs_share():
    whole = position_covariance(MD, INC, AZI, North.TRUE, "MWD+SRGM", REFERENCE)[-1]
    runs = [ErrorTool("MWD+SRGM", "1")] * 40 + [ErrorTool("MWD+SRGM", "2")] * 40
    two = position_covariance(MD, INC, AZI, North.TRUE, StationErrors(runs), REFERENCE)[-1]
    assert np.trace(two) < 0.9 * np.trace(whole)
    terms = well_terms((MD, INC, AZI), North.TRUE, StationErrors(runs), REFERENCE)
    shared = sum(np.outer(s[-1], s[-1]) for (_, reach), s in shared_shifts(terms).items() if reach == "whole well")
    assert np.all(np.linalg.eigvalsh(two - shared) > 0.0)
    assert np.trace(shared) > 0.2 * np.trace(two)


def test_a_station_beyond_its_code_is_told_in_a_sentence():
    inc = np.interp(MD, [0, 300, 2400], np.radians([0, 0, 92]))
    with pytest.raises(ValueError, match=r"GYRO-NS is meant for .* 0 to 89 deg; the station at 2340.0 m has 89.4 deg"):
        position_covariance(MD, inc, AZI, North.TRUE, "GYRO-NS", REFERENCE)
    tools = [ErrorTool("GYRO-NS") if i < math.radians(60) else ErrorTool("MWD+SRGM") for i in inc]
    assert position_covariance(MD, inc, AZI, North.TRUE, StationErrors(tools), REFERENCE).shape == (80, 3, 3)


def test_a_gyro_code_needs_a_latitude_and_a_magnetic_one_does_not():
    nowhere = ErrorReference(math.nan, 50e-6, math.radians(72), 0.0)
    with pytest.raises(ValueError, match=r"GYRO-NS is a gyro code and needs the latitude"):
        position_covariance(MD, INC, AZI, North.TRUE, "GYRO-NS", nowhere)
    assert np.all(np.isfinite(position_covariance(MD, INC, AZI, North.TRUE, "MWD+SRGM", nowhere)))


def test_a_code_the_library_cannot_evaluate_is_told_in_a_sentence():
    with pytest.raises(ValueError, match="CB_Film_GMS cannot be evaluated on this well"):
        position_covariance(MD, INC, AZI, North.TRUE, "CB_Film_GMS", REFERENCE)


def drawn_wells(stations, errors, tie_on, number, rng):
    """Positions, shape (number, n, 3), of wells whose stations have errors drawn from the terms; true axes."""
    md, inc, azi = stations
    terms = error_terms(stations, errors.tools, REFERENCE, first_tvd=1000.0)
    keys = {(t.name, t.shared) for t in terms if t.shared != RANDOM}
    wells = []
    for _ in range(number):
        common = {key: rng.standard_normal() for key in sorted(keys)}
        measured, shift = np.zeros((md.size, 3)), np.zeros((md.size, 3))
        for term in terms:
            if term.shared == RANDOM:
                draw = rng.standard_normal((md.size, 1))
            else:
                draw = np.full((md.size, 1), common[term.name, term.shared])
            if term.name.startswith("XCL"):
                above = np.vstack([np.zeros(3), np.cumsum(term.error * draw, axis=0)[:-1]])
                shift += term.own * draw + above
            else:
                measured += term.measured * draw
        start = rng.multivariate_normal((0.0, 0.0, 1000.0), tie_on)
        wells.append(mc.path(md + measured[:, 0], inc + measured[:, 1], azi + measured[:, 2], start) + shift)
    return np.array(wells)


@pytest.mark.slow
def test_a_thousand_wells_lie_in_their_95_percent_ellipses():
    """
    Errors of a gyro run, two magnetic runs and the tie-on, drawn and carried through minimum curvature.

    The gyro stays where its azimuths are good to about a degree: the error model is of first order.
    """
    md = np.arange(1000.0, 3401.0, 40.0)
    inc = np.interp(md, [1000, 1600, 2200, 3400], np.radians([10, 25, 60, 88]))
    azi = np.interp(md, [1000, 3400], np.radians([40, 130]))
    tools = (
        [None]
        + [ErrorTool("GYRO-NS", "g")] * 15
        + [ErrorTool("MWD+IFR1+SAG", "1")] * 20
        + [ErrorTool("MWD+SRGM", "2")] * 25
    )
    tie_on = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, 0.1], [0.0, 0.1, 0.5]])
    errors = StationErrors(tools, None, tie_on)
    covariance = position_covariance(md, inc, azi, North.TRUE, errors, REFERENCE, 1000.0)
    nominal = mc.path(md, inc, azi, (0.0, 0.0, 1000.0))
    wells = drawn_wells((md, inc, azi), errors, tie_on, 1000, np.random.default_rng(7))
    for k in (15, 35, 60):
        away = wells[:, k, :2] - nominal[k, :2]
        d2 = np.einsum("wi,ij,wj->w", away, np.linalg.inv(covariance[k, :2, :2]), away)
        # 95 % of a normal distribution in the plane.
        assert 0.94 <= np.mean(d2 < -2.0 * math.log(0.05)) <= 0.97
        whole = wells[:, k] - nominal[k]
        assert_consistent(whole @ np.linalg.inv(np.linalg.cholesky(covariance[k])).T, 1.0)


def test_the_sum_of_no_terms_is_no_uncertainty():
    assert not covariance_of([], 4).any()
