# SPDX-License-Identifier: Apache-2.0
"""Invariances of path, covariance and clearance on S-shaped and horizontal wells, and with codes that have limits."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st
from test_clearance_invariances import PRINTED, REFERENCE, RULE, depths, least

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.clearance.clearance import clearance
from mwd_surface.list_files.list_file import list_of
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.uncertainty.error_terms import ErrorTool
from mwd_surface.uncertainty.position_covariance import StationErrors, UncertainWell

pytestmark = pytest.mark.slow

bounded = settings(max_examples=6, deadline=None)
# Largest inclination of each code; the first two are surveyed at any.
CODES = {"MWD+SRGM": 110.0, "MWD+IFR1+SAG+MS": 110.0, "GYRO-NS": 60.0, "GYRO-NS-CT": 110.0, "INC-ONLY": 29.0}


def shape(kind, md, top, azimuth):
    """Inclination and azimuth of an S (back to the vertical), a horizontal well or a slanted one, rad."""
    share = np.clip((md - 120.0) / (md[-1] - 180.0), 0.0, 1.0)
    bend = {
        "S": np.sin(math.pi * share) ** 2,
        "horizontal": np.minimum(1.0, 1.6 * share),
        "slant": np.full(md.size, 0.7),
    }[kind]
    inc = np.radians(top) * bend
    # A station printed as vertical is vertical.
    return np.where(inc < math.radians(0.005), 0.0, inc), azimuth + 0.4 * share


@st.composite
def shaped(draw, start=(0.0, 0.0, 0.0), name="A"):
    code = draw(st.sampled_from(list(CODES)))
    md = depths(draw(st.floats(600.0, 800.0)), 30.0)
    inc, azi = shape(
        draw(st.sampled_from(["S", "horizontal", "slant"])),
        md,
        draw(st.floats(5.0, CODES[code])),
        draw(st.floats(0.0, 6.2)),
    )
    # Below a third of the hole another tool takes over, as in a survey programme.
    tools = [ErrorTool(code) if m < md[-1] / 3.0 or code != "MWD+SRGM" else ErrorTool("MWD+IFR1+SAG+MS") for m in md]
    return UncertainWell(
        name, md, inc, azi, mc.path(md, inc, azi, start), North.GRID, StationErrors(tools), REFERENCE, 0.15
    )


@st.composite
def pairs(draw):
    first, second = draw(shaped()), draw(shaped(name="B"))
    try:
        covariances(first), covariances(second)
    except ValueError:
        # The code gives no azimuth at some station of this shape.
        reject()
    k = draw(st.integers(1, min(first.md.size, second.md.size) - 1))
    apart = np.array([draw(st.floats(-12.0, 12.0)) for _ in range(3)])
    moved = second.positions + first.positions[k] - second.positions[k] + apart
    assume(np.linalg.norm(moved[0] - first.positions[0]) > 0.5)
    assume(np.linalg.norm(apart) > 1.0)
    return first, dataclasses.replace(second, positions=moved)


def covariances(one):
    return np.asarray(one.covariance())


@bounded
@given(one=shaped(), printed=st.lists(st.floats(0.0, 6.28), min_size=60, max_size=60))
def test_the_azimuth_of_vertical_stations_changes_no_covariance(one, printed):
    other = dataclasses.replace(one, azimuth=np.where(one.inclination == 0.0, printed[: one.md.size], one.azimuth))
    try:
        expected = covariances(one)
    except ValueError:
        # The code gives no azimuth at some station of this shape.
        reject()
    np.testing.assert_array_equal(covariances(other), expected)


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("kind", ["S", pytest.param("horizontal", marks=pytest.mark.nightly)])
def test_any_azimuths_at_the_vertical_stations_of_a_shape_give_one_clearance(code, kind):
    md = depths(700.0, 30.0)
    inc, azi = shape(kind, md, min(80.0, CODES[code]), 1.0)
    found = []
    for printed in PRINTED:
        wells = []
        for name, start in (("A", (0.0, 0.0, 0.0)), ("B", (9.0, -4.0, 0.0))):
            angles = inc, np.where(inc == 0.0, printed, azi)
            path = mc.path(md, *angles, start)
            wells.append(
                UncertainWell(
                    name, md, *angles, path, North.GRID, StationErrors([ErrorTool(code)] * md.size), REFERENCE, 0.15
                )
            )
        found.append(least(clearance(*wells, RULE)))
    assert np.ptp(np.array(found), axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)


# In the gate, `test_clearance_invariances.py` shows that order and map change nothing, with wells of one code.


@pytest.mark.nightly
@bounded
@given(pair=pairs())
def test_the_order_of_two_shaped_wells_changes_nothing(pair):
    assert least(clearance(pair[1], pair[0], RULE)) == pytest.approx(least(clearance(*pair, RULE)), rel=1e-6, abs=1e-6)


@pytest.mark.nightly
@bounded
@given(pair=pairs(), north=st.floats(-2000.0, 2000.0), east=st.floats(-2000.0, 2000.0), turn=st.floats(-3.1, 3.1))
def test_a_shifted_and_turned_map_changes_no_clearance_of_shaped_wells(pair, north, east, turn):
    c, s = math.cos(turn), math.sin(turn)
    mat = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    reference = dataclasses.replace(REFERENCE, convergence=REFERENCE.convergence + turn)
    other = [
        dataclasses.replace(
            one,
            azimuth=one.azimuth - turn,
            positions=(one.positions + np.array([north, east, 0.0])) @ mat.T,
            reference=reference,
        )
        for one in pair
    ]
    want = least(clearance(*pair, RULE))
    assume(want[1] > 0.5)
    assert least(clearance(*other, RULE)) == pytest.approx(want, rel=1e-4, abs=1e-4)


@bounded
@given(one=shaped(), share=st.floats(0.1, 0.9), k=st.integers(1, 14))
def test_a_station_inserted_on_the_arc_moves_no_place_and_no_clearance_by_more_than_its_own_noise(one, share, k):
    """The hole is the same; one station more has one random error more, which is a small part of the whole."""
    at = (1.0 - share) * one.md[k - 1] + share * one.md[k]
    inc, azi, _ = mc.interpolate(one.md, one.inclination, one.azimuth, one.positions, at)
    md, inc, azi = (np.insert(a, k, b) for a, b in ((one.md, at), (one.inclination, inc), (one.azimuth, azi)))
    path = mc.path(md, inc, azi, one.positions[0])
    np.testing.assert_allclose(np.delete(path, k, axis=0), one.positions, atol=1e-7)
    tools = list(one.errors.tools)
    tools.insert(k, tools[k])
    more = dataclasses.replace(one, md=md, inclination=inc, azimuth=azi, positions=path, errors=StationErrors(tools))
    sigmas = [np.sqrt(np.diagonal(covariances(w)[-1])) for w in (one, more)]
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=0.03, atol=0.005)


@bounded
@given(one=shaped(), unit=st.sampled_from([("ft", 0.3048), ("usft", 1200.0 / 3937.0), ("km", 1000.0)]))
def test_a_shaped_list_in_any_unit_is_the_same_path(one, unit):
    word, factor = unit
    texts = []
    for name, per in (("m", 1.0), (word, factor)):
        rows = [
            f"md ({name}),inc,azi_grid",
            *(
                f"{m / per:.9f},{math.degrees(i):.6f},{math.degrees(a) % 360.0:.6f}"
                for m, i, a in zip(one.md, one.inclination, one.azimuth, strict=True)
            ),
        ]
        texts.append("\n".join(rows).encode())
    paths = [survey_list(list_of(text)).definitive() for text in texts]
    np.testing.assert_allclose(paths[1].positions, paths[0].positions, atol=1e-4)
    np.testing.assert_allclose(paths[0].positions, one.positions, atol=1e-3)
