# SPDX-License-Identifier: Apache-2.0
"""Sag against closed forms and the three-moment equations of beam-columns, and the limits that any hole sets."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve

from mwd_estimation.assembly.assembly import Assembly, Blade, Component, read_assembly
from mwd_estimation.assembly.sag import SagCorrection, correction_of, lie, sag
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import SettingsError

HORIZONTAL = 0.5 * math.pi
COLLAR = Component(name="collar", length_m=40.0, od_mm=228.6, id_mm=71.4)
SLICK = Assembly(hole_mm=311.15, sensor_m=5.0, components=(COLLAR,))


def _with(assembly, **changes):
    return dataclasses.replace(assembly, **changes)


def _weight(assembly):
    return assembly.components[0].buoyed_mass(assembly.mud_kg_m3) * STANDARD_GRAVITY


@pytest.mark.parametrize("sensor", [1.0, 3.0, 5.0, 8.0, 10.0])
def test_a_slick_assembly_lies_as_lubinski_and_woods_have_it(sensor):
    # A. Lubinski, H. B. Woods, Drilling and Production Practice (1953): without axial force the collar meets the wall
    # at (24 E I r / q)^(1/4) from the bit; its slope follows from the simply supported span that it is up to there.
    weight, stiffness = _weight(SLICK), COLLAR.stiffness
    clearance = 0.5e-3 * (SLICK.hole_mm - COLLAR.od_mm)
    tangent = (24.0 * stiffness * clearance / weight) ** 0.25
    slope = -weight / (24.0 * stiffness) * (2.0 * tangent**3 - 6.0 * tangent * sensor**2 + 4.0 * sensor**3)
    assert sag(_with(SLICK, sensor_m=sensor), HORIZONTAL) == pytest.approx(slope, abs=math.radians(1e-4))


def _three_moments(first, clearances, weight, stiffness, push, curvature):
    """
    Slope against the hole at the stabiliser of a one-stabiliser assembly in a horizontal hole, rad.

    Source: S. Timoshenko, J. Gere, Theory of Elastic Stability (1961), section 1.11; applied to assemblies by Bai
    Jiazhi, SPE 10561 (1982): the bit is hinged, the collar above ends where it touches the wall with its curvature.
    """

    def factors(length):
        u = max(0.5 * length * math.sqrt(push / stiffness), 1e-3)
        load = 3.0 * (math.tan(u) - u) / u**3
        near = 3.0 / (2.0 * u) * (1.0 / (2.0 * u) - 1.0 / math.tan(2.0 * u))
        far = 3.0 / u * (1.0 / math.sin(2.0 * u) - 1.0 / (2.0 * u))
        return load, near, far

    def rotation(length, here, there):
        """Slope of a span's end towards its middle, downwards."""
        load, near, far = factors(length)
        bend = weight * length**3 / 24.0 * load + here * length / 3.0 * near + there * length / 6.0 * far
        return bend / stiffness

    def depth(x, clearance):
        return clearance - 0.5 * curvature * x**2

    def equations(unknown):
        moment, second = unknown
        end = first + second
        down = depth(first, clearances[0])
        slope_1 = down / first
        slope_2 = (depth(end, clearances[1]) - down) / second
        last = stiffness * curvature
        left = slope_1 - rotation(first, moment, 0.0)
        right = slope_2 + rotation(second, moment, last)
        return left - right, slope_2 - rotation(second, last, moment) + curvature * end

    moment, _ = fsolve(equations, (-weight * first**2 / 10.0, 15.0), xtol=1e-9)
    down = depth(first, clearances[0]) / first - rotation(first, moment, 0.0)
    return -down - curvature * first


@pytest.mark.parametrize("push_kn", [0.01, 100.0])
@pytest.mark.parametrize("build", [-1.0, 0.0, 2.0])
@pytest.mark.parametrize("first", [6.0, 12.0])
def test_one_stabiliser_agrees_with_the_three_moment_equations(first, build, push_kn):
    blade_mm = 309.0
    collar = dataclasses.replace(COLLAR, blades=(Blade(at_m=first, od_mm=blade_mm),))
    assembly = Assembly(hole_mm=311.15, sensor_m=first, components=(collar,), weight_on_bit_kn=push_kn)
    clearances = 0.5e-3 * (311.15 - blade_mm), 0.5e-3 * (311.15 - COLLAR.od_mm)
    curvature = math.radians(build) / 30.0
    want = _three_moments(first, clearances, _weight(assembly), COLLAR.stiffness, 1e3 * push_kn, curvature)
    # Inclination, and so weight across, hardly changes along these few metres.
    assert sag(assembly, HORIZONTAL, curvature) == pytest.approx(want, abs=math.radians(0.002))


PACKED = Assembly(
    hole_mm=215.9,
    sensor_m=12.0,
    components=(
        Component(name="bit", length_m=0.3, od_mm=215.9, id_mm=50.0),
        Component(name="near-bit", length_m=1.8, od_mm=171.0, id_mm=71.0, blades=(Blade(at_m=0.8, od_mm=214.3),)),
        Component(name="MWD", length_m=18.0, od_mm=171.0, id_mm=83.0, magnetic=False, youngs_modulus_gpa=195.0),
        Component(name="stabiliser", length_m=1.8, od_mm=171.0, id_mm=71.0, blades=(Blade(at_m=0.8, od_mm=212.7),)),
        Component(name="collars", length_m=27.0, od_mm=165.0, id_mm=71.0),
    ),
)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    inclination=st.floats(0.2, 2.0),
    build=st.floats(-8.0, 8.0),
    push=st.floats(0.0, 60.0),
    sensor=st.floats(0.5, 45.0),
)
def test_the_assembly_stays_in_the_hole_and_the_wall_only_pushes(inclination, build, push, sensor):
    assembly = _with(PACKED, sensor_m=sensor, weight_on_bit_kn=push)
    at, lies = lie(assembly, inclination, math.radians(build) / 30.0)
    clearance = np.full(len(at), 0.5e-3 * (assembly.hole_mm - 165.0))
    assert np.all(np.abs(lies.deflection) <= clearance + 1e-9)
    # At the bit and the upper end the force is a support's.
    pushes = lies.contact[1:-1] * -np.sign(lies.deflection[1:-1])
    assert np.all(pushes >= -1e-3 * max(np.abs(lies.contact).max(), 1.0))


def test_in_a_vertical_hole_sag_mirrors_the_curvature_and_nothing_sags_where_it_is_straight():
    assert sag(PACKED, 0.0) == pytest.approx(0.0, abs=1e-12)
    wide, bend = _with(PACKED, hole_mm=250.0), math.radians(3.0) / 30.0
    assert sag(wide, 1e-12, bend) == pytest.approx(-sag(wide, 1e-12, -bend), abs=math.radians(2e-3))


@pytest.mark.slow
def test_the_table_of_a_correction_has_the_model_at_its_steps_and_between_them():
    correction = correction_of(PACKED)
    for degrees in (10.0, 33.0, 61.0, 89.0):
        inclination = math.radians(degrees)
        assert correction.at(inclination) == pytest.approx(sag(PACKED, inclination), abs=math.radians(0.005))
    assert SagCorrection(horizontal=0.01).at(math.radians(30.0)) == pytest.approx(0.005)


def test_more_push_than_the_assembly_bears_is_refused():
    thin = Component(name="pipe", length_m=9.0, od_mm=60.0, id_mm=50.0)
    with pytest.raises(ValueError, match="buckles"):
        sag(Assembly(hole_mm=300.0, sensor_m=3.0, components=(thin,), weight_on_bit_kn=1000.0), 0.01)


YAML = """
hole_mm: 215.9
sensor_m: 12
components:
  - {name: bit, length_m: 0.3, od_mm: 215.9, id_mm: 50}
  - {name: collar, length_m: 30, od_mm: 171, id_mm: 71, blades: [{at_m: 2, od_mm: 212}]}
"""


def test_an_assembly_is_read_from_yaml(tmp_path):
    path = tmp_path / "bha.yaml"
    path.write_text(YAML)
    assembly = read_assembly(path)
    assert assembly.length == pytest.approx(30.3)
    assert assembly.components[1].blades == (Blade(at_m=2.0, od_mm=212.0),)
    # 8 in of steel collar weighs about 147 kg/m in 6 3/4 in OD and 2 13/16 in bore (API RP 7G: 100.8 lb/ft).
    assert assembly.components[1].mass == pytest.approx(149.2, abs=1.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sensor_m: 12", "sensor_m: 40", "beyond the assembly"),
        ("od_mm: 212", "od_mm: 220", "does not go into a hole"),
        ("at_m: 2", "at_m: 31", "beyond its length"),
        ("id_mm: 71", "id_mm: 171", "not smaller"),
        ("hole_mm: 215.9", "hole_size: 215.9", "did you mean hole_mm"),
        ("components:", "parts:", "no such setting"),
    ],
)
def test_what_is_no_assembly_is_refused_in_words(tmp_path, old, new, words):
    path = tmp_path / "bha.yaml"
    path.write_text(YAML.replace(old, new))
    with pytest.raises(SettingsError, match=words):
        read_assembly(path)
