# SPDX-License-Identifier: Apache-2.0
"""The string decides what a magnetic station may claim; an undetermined azimuth is harmless near the vertical only."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tool_streams import earth_field

from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.station import station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.settings import changed

REFERENCE = Reference(total=5.7e-5, dip=math.radians(65.0), declination=0.0, convergence=0.0, gravity=9.81)


def settings(**given):
    """Settings of a station with these of the tool."""
    found = changed(EstimatorSettings(), {f"tool.{name}": value for name, value in given.items()})
    errors = derivation.sensor_errors(found)
    return StationSettings(errors=errors, priors=derivation.station_priors(found))


def taken(inclination, azimuth, toolface, turned, using, reference=REFERENCE):
    """A station whose horizontal field is turned about the vertical by an angle, rad: total and dip stay."""
    mat = mat_nt(inclination, azimuth, toolface)
    field_n = earth_field(reference.total, reference.dip, turned)
    return station(mat.T @ [0.0, 0.0, -9.81], mat.T @ field_n, reference, using)


angles = st.floats(0.0, 6.28)


@pytest.mark.slow(3)
@given(inclination=st.floats(0.3, 1.9), azimuth=angles, toolface=angles, turned=st.floats(-0.5, 0.5))
def test_in_a_string_of_steel_no_single_station_claims_what_its_totals_cannot_show(
    inclination, azimuth, toolface, turned
):
    one = taken(inclination, azimuth, toolface, turned, settings(string="steel"))
    assert one.verdict == "doubtful"
    assert abs(float(wrap_pi(one.azimuth - azimuth))) < 3.0 * one.sigma_azimuth


def test_each_kind_of_string_is_less_certain_than_the_one_before():
    sigmas = [
        taken(1.2, 2.4, 0.5, 0.0, settings(string=kind)).sigma_azimuth for kind in ("non_magnetic", "short", "steel")
    ]
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] > math.radians(10.0)


def test_a_field_of_the_string_that_is_stated_replaces_that_of_its_kind():
    def axial_nt(**given):
        settings = changed(EstimatorSettings(), {"tool.string": "steel", **given})
        return derivation.sensor_errors(settings).axial_interference_nt

    assert axial_nt(**{"tool.axial_interference_nt": 400.0}) == 400.0
    # Tool codes are those of non-magnetic collars: what is said of another string goes before.
    assert axial_nt() == axial_nt(**{"survey.tool_code": "MWD+SRGM"}) == 3000.0


@pytest.mark.parametrize(("inclination_deg", "verdict"), [(2.0, "accept"), (40.0, "doubtful")])
def test_an_azimuth_that_is_not_determined_is_harmless_near_the_vertical_only(inclination_deg, verdict):
    polar = dataclasses.replace(REFERENCE, dip=math.radians(88.5))
    one = taken(math.radians(inclination_deg), 1.0, 0.4, 0.0, StationSettings(), polar)
    assert one.verdict == verdict
    assert one.verdicts.inclination == "accept"
    codes = [reason.code for reason in one.reasons]
    assert (ReasonCode.UNCERTAIN_FOR_ANY_TOOL in codes) == (verdict == "doubtful")


@given(
    toolface=angles,
    along_ut=st.floats(-3.0, 3.0),
    across_ut=st.sampled_from((-12.0, -6.0, 6.0, 12.0)),
    inclination_deg=st.floats(0.2, 1.0),
)
def test_near_the_vertical_a_field_across_the_string_is_not_accepted_and_one_along_it_is(
    toolface, along_ut, across_ut, inclination_deg
):
    """A driller orients there by the magnetic toolface, which a field across the string turns."""
    mat = mat_nt(math.radians(inclination_deg), 1.0, toolface)
    force, field = mat.T @ [0.0, 0.0, -9.81], mat.T @ [REFERENCE.horizontal, 0.0, REFERENCE.vertical]
    across = 1e-6 * across_ut * np.array([0.0, *field[1:]]) / math.hypot(*field[1:])
    along = np.array([1e-6 * along_ut, 0.0, 0.0])
    assert station(force, field + along, REFERENCE, StationSettings()).verdict == "accept"
    assert station(force, field + across, REFERENCE, StationSettings()).verdict in {"doubtful", "reject"}
