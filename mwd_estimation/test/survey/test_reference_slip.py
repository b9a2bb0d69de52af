# SPDX-License-Identifier: Apache-2.0
"""A reference given with a usual slip: the readings name what was meant, and a sound reference is never doubted."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tool_streams import streams

from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.verdicts import ACCEPT
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place, reference_of
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.revision import findings
from mwd_estimation.survey.run_model import Taken
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.totals import reference_slip
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core.frames import mat_nt
from mwd_sensors.core.settings import SettingsError, changed

DAY_NS = 1_772_323_200 * 10**9  # 2026-03-01
SIGMAS = np.array([6e-3, 2e-7, math.radians(0.3)])
COVARIANCE = np.diag(SIGMAS**2)
angles = st.tuples(st.floats(0.01, 3.1), st.floats(0.0, 6.28), st.floats(0.0, 6.28))
latitudes = st.floats(15.0, 80.0) | st.floats(-80.0, -15.0)
longitudes = st.floats(-85.0, 85.0)
SLIPS = {
    "latitude": lambda lat, lon: (-lat, lon),
    "longitude": lambda lat, lon: (lat, -lon),
    "both": lambda lat, lon: (-lat, -lon),
    "exchanged": lambda lat, lon: (lon, lat),
}


def place(lat, lon, **given):
    return Place(field="model", lat_deg=lat, lon_deg=lon, date="2026-03-01", **given)


def field_of(reference):
    """Field of a reference in north, east and down, T."""
    return np.array([reference.horizontal * math.cos(0.1), reference.horizontal * math.sin(0.1), reference.vertical])


def readings(reference, attitude):
    """Gravity and field of a reference in tool axes at an attitude."""
    mat = mat_nt(*attitude)
    return mat.T @ [0.0, 0.0, -9.81], mat.T @ field_of(reference)


@pytest.mark.parametrize("slip", SLIPS)
@given(lat=latitudes, lon=longitudes, attitude=angles)
def test_the_slip_that_was_made_is_named_at_every_place_and_attitude(slip, lat, lon, attitude):
    wrong, meant = reference_of(place(*SLIPS[slip](lat, lon)), DAY_NS), reference_of(place(lat, lon), DAY_NS)
    apart = np.array([wrong.total - meant.total, wrong.dip - meant.dip]) / SIGMAS[1:]
    assume(float(apart @ apart) > 40.0)
    found = reference_slip(*readings(meant, attitude), wrong, COVARIANCE)
    assert found is not None
    # Two different slips may lead to fields that the readings cannot distinguish.
    assert abs(found.total - meant.total) < 3.0 * SIGMAS[1]
    assert abs(found.dip - meant.dip) < 3.0 * SIGMAS[2]


@given(lat=latitudes, lon=longitudes, attitude=angles, seed=st.integers(0, 2**31))
def test_a_sound_reference_is_not_doubted(lat, lon, attitude, seed):
    reference = reference_of(place(lat, lon), DAY_NS)
    f_t, b_t = readings(reference, attitude)
    b_t = b_t + 1e-7 * np.random.default_rng(seed).normal(size=3)
    assert reference_slip(f_t, b_t, reference, COVARIANCE) is None


@given(total=st.floats(25_000.0, 65_000.0), dip=st.floats(5.0, 85.0), attitude=angles)
def test_a_dip_from_the_vertical_is_named(total, dip, attitude):
    assume(abs(90.0 - 2.0 * dip) > 3.0)
    meant = reference_of(Place(field="fixed", total_nt=total, dip_deg=dip), DAY_NS)
    wrong = reference_of(Place(field="fixed", total_nt=total, dip_deg=90.0 - dip), DAY_NS)
    found = reference_slip(*readings(meant, attitude), wrong, COVARIANCE)
    assert found is not None
    assert found.dip == pytest.approx(meant.dip, abs=1e-9)


@pytest.mark.parametrize("flipped", ["reference", "force", "field"])
@given(total=st.floats(25_000.0, 65_000.0), dip=st.floats(5.0, 85.0) | st.floats(-85.0, -5.0), attitude=angles)
def test_a_dip_of_the_other_sign_blames_neither_reference_nor_sensor_alone(flipped, total, dip, attitude):
    meant = reference_of(Place(field="fixed", total_nt=total, dip_deg=dip), DAY_NS)
    f_t, b_t = readings(meant, attitude)
    given_deg = -dip if flipped == "reference" else dip
    reference = reference_of(Place(field="fixed", total_nt=total, dip_deg=given_deg), DAY_NS)
    force, field = -f_t if flipped == "force" else f_t, -b_t if flipped == "field" else b_t
    own = measured(force, field, reference, StationSettings())
    (finding,), _ = findings([Taken(own)], StationSettings())
    station = judged(own, finding, StationSettings())
    assert station.reasons[0].code is ReasonCode.DIP_SIGN
    assert station.verdicts.inclination != ACCEPT
    assert station.verdicts.azimuth != ACCEPT


@pytest.mark.parametrize("day", ["1926-03-01", "1980-03-01"])
def test_a_day_of_another_decade_is_named(day):
    meant = reference_of(place(58.4, 1.88), DAY_NS)
    wrong = reference_of(dataclasses.replace(place(58.4, 1.88), field="igrf", date=day), DAY_NS)
    found = reference_slip(*readings(meant, (0.5, 0.7, 0.3)), wrong, COVARIANCE)
    assert found is not None
    assert day in found.words


@pytest.mark.parametrize(("figure", "unit"), [(0.508, "G"), (508.0, "mG"), (50.8, "uT")])
def test_a_fixed_field_in_another_unit_is_refused_with_the_figure_in_nt(figure, unit):
    with pytest.raises(SettingsError, match=rf"{figure:g} {unit} are 50800 nT"):
        reference_of(Place(field="fixed", total_nt=figure, dip_deg=70.0), DAY_NS)


def test_a_station_names_the_slip_first_and_not_a_casing():
    meant = reference_of(place(58.4, 1.88), DAY_NS)
    mat, field_n = np.broadcast_to(mat_nt(0.5, 0.7, 0.3), (2000, 3, 3)), field_of(meant)
    imu, mag = streams(mat, np.random.default_rng(3), field_n=field_n, gravity=meant.gravity, start_ns=DAY_NS)
    for lat, wrong in ((-58.4, True), (58.4, False)):
        given_place = {"place.field": "model", "place.lat_deg": lat, "place.lon_deg": 1.88, "place.date": "2026-03-01"}
        pipeline = Pipeline(changed(EstimatorSettings(), given_place))
        pipeline.push_mag(mag)
        (survey,) = pipeline.push_imu(imu).surveys + pipeline.finish().surveys
        codes = [reason.code for reason in survey.station.reasons]
        assert (ReasonCode.REFERENCE_SLIP in codes) == wrong
        if wrong:
            assert codes[0] == ReasonCode.REFERENCE_SLIP
            assert survey.station.verdict == "doubtful"
