# SPDX-License-Identifier: Apache-2.0
"""The path between stations: a published gyro survey, closed forms, and what no set of stations may break."""

import csv

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from project import REFERENCE_DATA

F4 = REFERENCE_DATA / "volve" / "F-4_gyro_ns_trajectory.csv"
inclinations = st.floats(0.0, np.pi)
azimuths = st.floats(0.0, 2 * np.pi)


@pytest.fixture(scope="module")
def volve_f4():
    with F4.open() as file:
        rows = list(csv.DictReader(file))
    return {
        key: np.array([float(row[key]) for row in rows]) for key in rows[0] if not key.startswith(("station", "survey"))
    }


def test_the_published_volve_f4_positions_are_reproduced_to_their_rounding(volve_f4):
    """
    Equinor Volve 15/9-F-4, north-seeking gyro, 87 stations.

    The inputs were single-precision numbers before they were printed to 1e-6; restored, positions agree to the print.
    """
    columns = (volve_f4[key].astype(np.float32).astype(float) for key in ("md_m", "inc_deg", "azi_true_deg"))
    md, inc_deg, azi_deg = columns
    got = mc.path(md, np.radians(inc_deg), np.radians(azi_deg))
    want = np.column_stack([volve_f4["north_m"], volve_f4["east_m"], volve_f4["tvd_m"]])
    assert np.max(np.abs(got - want)) < 6e-7


def test_the_published_volve_f4_dogleg_severities_are_reproduced(volve_f4):
    got = mc.dogleg_severity(volve_f4["md_m"], np.radians(volve_f4["inc_deg"]), np.radians(volve_f4["azi_true_deg"]))
    np.testing.assert_allclose(np.degrees(got), volve_f4["dls_deg_per_30m"], atol=1e-6)


def test_a_quarter_circle_ends_a_radius_away_in_both_directions():
    radius = 300.0
    end = mc.path([0.0, radius * np.pi / 2], [0.0, np.pi / 2], [0.0, np.radians(30)])[-1]
    np.testing.assert_allclose(end, [radius * np.cos(np.pi / 6), radius * np.sin(np.pi / 6), radius], rtol=1e-15)


def test_a_straight_hole_is_exact_at_zero_dogleg():
    assert mc.path([10.0, 110.0], [0.0, 0.0], [0.3, 0.3])[-1].tolist() == [0.0, 0.0, 100.0]
    assert mc.dogleg(0.7, 1.1, 0.7, 1.1) == 0.0


def test_dogleg_keeps_its_digits_at_the_smallest_angles_and_near_180_degrees():
    assert mc.dogleg(0.5, 1.0, 0.5 + 2**-40, 1.0) == pytest.approx(2**-40, rel=1e-12)
    assert mc.dogleg(np.pi / 2, 0.0, np.pi / 2, 1e-12) == pytest.approx(1e-12, rel=1e-12)
    assert np.pi - mc.dogleg(np.pi / 2, 0.0, np.pi / 2, np.pi - 2**-30) == pytest.approx(2**-30, abs=1e-15)
    assert mc.dogleg(0.0, 0.3, np.pi, 2.0) == pytest.approx(np.pi, abs=1e-15)


@given(i_1=inclinations, a_1=azimuths, i_2=inclinations, a_2=azimuths)
def test_dogleg_is_the_angle_between_the_tangents(i_1, a_1, i_2, a_2):
    t_1, t_2 = mc.tangent(i_1, a_1), mc.tangent(i_2, a_2)
    angle = float(mc.dogleg(i_1, a_1, i_2, a_2))
    assert angle == pytest.approx(2 * np.arctan2(np.linalg.norm(t_1 - t_2), np.linalg.norm(t_1 + t_2)), abs=1e-14)
    assert angle == mc.dogleg(i_2, a_2, i_1, a_1)


@given(i_1=inclinations, a_1=azimuths, i_2=inclinations, a_2=azimuths, share=st.floats(0.0, 1.0))
def test_a_station_put_on_the_arc_changes_neither_path_nor_curvature(i_1, a_1, i_2, a_2, share):
    assume(mc.dogleg(i_1, a_1, i_2, a_2) < np.pi - 0.1)
    assume(1e-3 < share < 0.999)
    md, inc, azi = np.array([100.0, 160.0]), np.array([i_1, i_2]), np.array([a_1, a_2])
    two = mc.path(md, inc, azi)
    at = 100.0 + 60.0 * share
    inc_at, azi_at, position = mc.interpolate(md, inc, azi, two, at)
    three = mc.path([100.0, at, 160.0], [i_1, inc_at, i_2], [a_1, azi_at, a_2])
    np.testing.assert_allclose(three[1], position, atol=1e-9)
    np.testing.assert_allclose(three[2], two[1], atol=1e-9)
    severity = mc.dogleg_severity([100.0, at, 160.0], [i_1, inc_at, i_2], [a_1, azi_at, a_2])
    whole = mc.dogleg_severity(md, inc, azi)[1]
    np.testing.assert_allclose(severity[1:], whole, atol=1e-9)


@given(i_1=inclinations, a_1=azimuths, i_2=inclinations, a_2=azimuths, turn=azimuths)
def test_turning_north_turns_the_path(i_1, a_1, i_2, a_2, turn):
    assume(mc.dogleg(i_1, a_1, i_2, a_2) < np.pi - 0.01)
    md, inc = [0.0, 30.0], [i_1, i_2]
    plain = mc.path(md, inc, [a_1, a_2])[-1]
    turned = mc.path(md, inc, [a_1 + turn, a_2 + turn])[-1]
    c, s = np.cos(turn), np.sin(turn)
    np.testing.assert_allclose(turned, [c * plain[0] - s * plain[1], s * plain[0] + c * plain[1], plain[2]], atol=1e-10)


@given(i_1=inclinations, a_1=azimuths, i_2=inclinations, a_2=azimuths)
def test_no_path_is_longer_than_the_hole(i_1, a_1, i_2, a_2):
    assume(mc.dogleg(i_1, a_1, i_2, a_2) < np.pi - 1e-3)
    step = mc.path([0.0, 30.0], [i_1, i_2], [a_1, a_2])[-1]
    assert 30.0 * 2 / np.pi - 1e-9 <= np.linalg.norm(step) <= 30.0 + 1e-9


def test_stations_give_themselves_back_to_the_last_bit(volve_f4):
    md, inc, azi = volve_f4["md_m"], np.radians(volve_f4["inc_deg"]), np.radians(volve_f4["azi_true_deg"])
    positions = mc.path(md, inc, azi)
    inc_at, azi_at, position = mc.interpolate(md, inc, azi, positions, md)
    assert np.array_equal(inc_at, inc)
    assert np.array_equal(azi_at[inc > 0.0], azi[inc > 0.0])
    assert np.array_equal(position, positions)


def test_a_vertical_interval_has_the_azimuth_in_which_the_hole_leaves_the_vertical():
    md, inc, azi = [0.0, 100.0, 130.0, 160.0], [0.0, 0.0, 0.1, 0.0], [1.0, 2.0, 3.0, 5.0]
    _, azi_at, _ = mc.interpolate(md, inc, azi, mc.path(md, inc, azi), [0.0, 50.0, 101.0, 159.0, 160.0])
    np.testing.assert_allclose(azi_at, 3.0, atol=1e-12)


@given(printed=st.lists(azimuths, min_size=6, max_size=6), upward=st.booleans())
def test_the_azimuth_that_a_list_prints_at_vertical_stations_changes_nothing(printed, upward):
    """Path, dogleg, build and turn rate, points between and their azimuths are the same to the last bit."""
    md = np.arange(6) * 30.0
    inc = np.array([0.0, 0.0, 0.2, 0.3, 0.0, 0.0]) if not upward else np.pi - np.array([0.0, 0.0, 0.2, 0.3, 0.0, 0.0])
    fixed = np.array([0.0, 0.0, 2.0, 2.5, 0.0, 0.0])
    at = np.linspace(0.0, 150.0, 31)
    results = []
    for azi in (fixed, np.where(np.sin(inc) < 1e-9, printed, fixed)):
        positions = mc.path(md, inc, azi)
        rates = [f(md, inc, azi) for f in (mc.dogleg_severity, mc.build_rate, mc.turn_rate)]
        results.append([positions, *rates, *mc.interpolate(md, inc, azi, positions, at)])
    for one, other in zip(*results, strict=True):
        assert np.array_equal(one, other)


@given(i=st.floats(0.0, 0.01), a=azimuths, turn=azimuths)
def test_what_is_known_of_an_azimuth_is_continuous_and_turns_with_the_map(i, a, turn):
    known_from = 0.005
    inc = np.array([0.0, i, 0.0, 0.2, 0.0])
    azi = np.array([3.0, a, 1.0, 2.0, 0.5])
    found = mc.directions(inc, azi, known_from)
    assert np.all(np.abs(found) <= 1.0 + 1e-12)
    # A vertical station next to the curve has its azimuth, whatever it prints itself.
    np.testing.assert_allclose(found[2:], np.exp(2.0j), atol=1e-12)
    near = mc.directions(np.where(inc == i, i + 1e-9, inc), azi, known_from)
    np.testing.assert_allclose(near, found, atol=1e-5)
    np.testing.assert_allclose(mc.directions(inc, azi + turn, known_from), found * np.exp(1j * turn), atol=1e-9)
    assert not mc.directions(np.zeros(3), [a, 1.0, turn]).any()


def test_position_between_stations_is_the_integral_of_the_tangent():
    md, inc, azi = np.array([0.0, 40.0]), np.radians([10.0, 75.0]), np.radians([350.0, 120.0])
    at = np.linspace(0.0, 40.0, 20001)
    inc_at, azi_at, position = mc.interpolate(md, inc, azi, mc.path(md, inc, azi), at)
    direction = mc.tangent(inc_at, azi_at)
    integral = np.cumsum(0.5 * (direction[1:] + direction[:-1]) * np.diff(at)[:, None], axis=0)
    np.testing.assert_allclose(position[1:], integral, atol=1e-7)


def test_one_station_is_a_path_of_one_point():
    assert mc.path([5.0], [0.1], [0.2], (1.0, 2.0, 3.0)).tolist() == [[1.0, 2.0, 3.0]]
    inc, azi, position = mc.interpolate([5.0], [0.1], [0.2], [[1.0, 2.0, 3.0]], 5.0)
    assert (float(inc), float(azi), position.tolist()) == (0.1, 0.2, [1.0, 2.0, 3.0])


@pytest.mark.fault_case(38)
def test_turn_goes_the_short_way_through_north_and_is_zero_where_vertical():
    rate = mc.turn_rate([0.0, 30.0, 60.0], np.radians([10.0, 10.0, 0.0]), np.radians([359.0, 1.0, 90.0]))
    np.testing.assert_allclose(np.degrees(rate), [0.0, 2.0, 0.0], atol=1e-12)
    assert np.degrees(mc.build_rate([0.0, 15.0], [0.0, np.radians(1.0)], [0.0, 0.0]))[1] == pytest.approx(2.0)


def test_vertical_section_is_the_distance_along_its_azimuth():
    assert mc.vertical_section([[3.0, 4.0, 9.0]], np.arctan2(4.0, 3.0))[0] == pytest.approx(5.0)
    assert mc.vertical_section([3.0, 4.0], 0.0) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("md", "inc", "azi", "says"),
    [
        ([0.0, 30.0], [0.0], [0.0, 0.0], "one length"),
        ([], [], [], "at least 1"),
        ([0.0, np.nan], [0.0, 0.0], [0.0, 0.0], "md: must be finite, got nan at station 1"),
        ([0.0, 30.0], [0.0, 4.0], [0.0, 0.0], "inclination: must be within 0 and pi rad, got 4.0 at station 1"),
        ([0.0, 30.0, 30.0], [0.0] * 3, [0.0] * 3, "md: must increase, got 30.0 m at station 2 after 30.0 m"),
        ([0.0, 30.0], [np.pi / 2, np.pi / 2], [0.0, np.pi], "point opposite ways"),
    ],
)
def test_impossible_stations_are_refused_by_name(md, inc, azi, says):
    with pytest.raises(ValueError, match=says):
        mc.path(md, inc, azi)


def test_a_depth_outside_the_stations_is_refused():
    with pytest.raises(ValueError, match=r"31.0 m is outside the stations, 0.0 to 30.0 m"):
        mc.interpolate([0.0, 30.0], [0.0, 0.0], [0.0, 0.0], np.zeros((2, 3)), 31.0)
    with pytest.raises(ValueError, match="nan m is outside"):
        mc.interpolate([0.0, 30.0], [0.0, 0.0], [0.0, 0.0], np.zeros((2, 3)), np.nan)
    with pytest.raises(ValueError, match=r"positions: expected shape \(2, 3\)"):
        mc.interpolate([0.0, 30.0], [0.0, 0.0], [0.0, 0.0], np.zeros((3, 3)), 1.0)
    with pytest.raises(ValueError, match="start: expected three finite numbers"):
        mc.path([0.0], [0.0], [0.0], (0.0, np.inf, 0.0))


def test_two_independent_libraries_give_the_same_path_and_doglegs(volve_f4):
    """wellpathpy (Equinor) and welleng, peers only."""
    import wellpathpy
    from welleng import survey

    md, inc_deg, azi_deg = (volve_f4[key] for key in ("md_m", "inc_deg", "azi_true_deg"))
    got = mc.path(md, np.radians(inc_deg), np.radians(azi_deg))
    severity = np.degrees(mc.dogleg_severity(md, np.radians(inc_deg), np.radians(azi_deg)))
    one = wellpathpy.deviation(md, inc_deg, azi_deg).minimum_curvature(course_length=30)
    np.testing.assert_allclose(got, np.column_stack([one.northing, one.easting, one.depth]), atol=1e-8)
    np.testing.assert_allclose(severity, one.dls, atol=1e-6)
    header = survey.SurveyHeader(azi_reference="grid", b_total=5e4, dip=70.0, declination=0.0, convergence=0.0)
    other = survey.Survey(md=md, inc=inc_deg, azi=azi_deg, header=header, deg=True)
    np.testing.assert_allclose(got, np.column_stack([other.n, other.e, other.tvd]), atol=1e-8)
