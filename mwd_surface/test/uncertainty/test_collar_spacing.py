# SPDX-License-Identifier: Apache-2.0
"""The field of magnetised steel at the sensors, the azimuth error it makes, and the collars that keep it small."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.assembly.assembly import Assembly, Component
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_surface.uncertainty.collar_spacing import (
    POLES,
    Steel,
    azimuth_error,
    interference,
    largest_interference,
    pieces_of,
    shortest_collars,
)

HORIZONTAL = 15e-6


def test_a_thousand_microweber_ten_metres_away_are_796_nanotesla():
    # P / (4 pi r^2).
    assert Steel(10.0, math.inf, 1000e-6).field == pytest.approx(795.8e-9, abs=0.1e-9)


def test_the_far_pole_of_a_piece_takes_off_its_share():
    whole = Steel(5.0, math.inf, 300e-6).field
    assert Steel(5.0, 5.0, 300e-6).field == pytest.approx(0.75 * whole)
    assert Steel(5.0, 1e6, 300e-6).field == pytest.approx(whole)


@given(
    axial=st.floats(-3e-6, 3e-6),
    inclination=st.floats(0.05, 1.6),
    azimuth=st.floats(0.0, 6.28),
    toolface=st.floats(0.0, 6.28),
)
def test_the_azimuth_error_is_that_of_the_readings(axial, inclination, azimuth, toolface):
    from mwd_estimation.core import magnetic_geometry

    mat = mat_nt(inclination, azimuth, toolface)
    b_t = mat.T @ np.array([HORIZONTAL, 0.0, 48e-6]) + [axial, 0.0, 0.0]
    measured = magnetic_geometry.raw_azimuth(mat.T @ np.array([0.0, 0.0, -9.81]), b_t)
    got = azimuth_error(axial, inclination, azimuth, HORIZONTAL)
    assert wrap_pi(measured - azimuth - got) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("inclination", "azimuth"), [(30, 45), (60, 90), (90, 90), (80, 265), (50, 10)])
def test_the_largest_interference_reaches_the_limit_and_no_more(inclination, azimuth):
    attitude = math.radians(inclination), math.radians(azimuth)
    limit = math.radians(0.5)
    most = largest_interference(limit, *attitude, HORIZONTAL)
    errors = [abs(azimuth_error(sign * most, *attitude, HORIZONTAL)) for sign in (-1, 1)]
    assert max(errors) == pytest.approx(limit, rel=1e-6)


def test_a_hole_to_magnetic_north_bears_any_interference_that_does_not_turn_it_round():
    assert largest_interference(0.01, math.radians(90.0), 0.0, HORIZONTAL) > 0.99 * HORIZONTAL
    assert largest_interference(0.01, 0.0, 1.0, HORIZONTAL) == math.inf


@pytest.mark.parametrize("most", [50e-9, 200e-9, 1000e-9])
def test_the_shortest_collars_meet_the_limit_and_no_other_pair_is_shorter(most):
    above, below = shortest_collars(900e-6, 300e-6, 10.0, most)

    def field(up, down):
        return interference([Steel(up, math.inf, 900e-6), Steel(down, 10.0, 300e-6)])

    assert field(above, below) == pytest.approx(most, rel=1e-6)
    for shift in (-0.5, 0.5):
        if below + shift > 0.1:
            assert field(above - shift, below + shift) > most * (1.0 - 1e-6)


def test_a_limit_that_no_collar_meets_is_refused():
    with pytest.raises(ValueError, match="more than 300 m"):
        shortest_collars(900e-6, 300e-6, 10.0, 1e-12)


ASSEMBLY = Assembly(
    hole_mm=215.9,
    sensor_m=15.0,
    components=(
        Component(name="bit", length_m=0.3, od_mm=215.9, id_mm=50.0),
        Component(name="motor", length_m=8.7, od_mm=171.0, id_mm=100.0, pole_uwb=1000.0),
        Component(name="NMDC", length_m=18.0, od_mm=171.0, id_mm=71.0, magnetic=False),
        Component(name="collars", length_m=27.0, od_mm=165.0, id_mm=71.0),
    ),
)


def test_the_pieces_of_an_assembly_are_its_magnetic_parts():
    low, high = pieces_of(ASSEMBLY)
    assert (low.near, low.length, low.pole) == pytest.approx((6.0, 9.0, 1000e-6))
    assert (high.near, high.length, high.pole) == pytest.approx((12.0, math.inf, POLES["collars"]))
    assert low.name == "bit + motor"


def test_a_string_above_non_magnetic_collars_is_magnetic_all_the_same():
    short = dataclasses.replace(ASSEMBLY, components=ASSEMBLY.components[:3])
    assert pieces_of(short)[-1] == Steel(12.0, math.inf, POLES["collars"], "string above")


@pytest.mark.parametrize("sensor", [5.0, 40.0])
def test_sensors_in_magnetic_steel_are_refused(sensor):
    with pytest.raises(ValueError, match="magnetic steel"):
        pieces_of(dataclasses.replace(ASSEMBLY, sensor_m=sensor))
